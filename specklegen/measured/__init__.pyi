from .curve import MeasuredCurve as MeasuredCurve
from .curve import read_curve as read_curve
from .measurement import Measurement as Measurement
from .measurement import read_measurement as read_measurement
