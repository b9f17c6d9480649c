from .scene.imaging import Imaging as Imaging
from .scene.imaging import Pupil as Pupil
from .scene.sensors import FarField as FarField
from .scene.sensors import FarFieldGrid as FarFieldGrid
from .scene.sensors import NearField as NearField
from .scene.sensors import Sensor as Sensor
