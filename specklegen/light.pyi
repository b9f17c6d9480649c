from .scene.coherent import CoherentObject as CoherentObject
from .scene.focused import FocusedBeams as FocusedBeams
from .scene.illumination import CollimatedBeams as CollimatedBeams
from .scene.illumination import IncoherentObject as IncoherentObject
from .scene.illumination import PlaneWaves as PlaneWaves
from .scene.illumination import PointSources as PointSources
from .scene.polarisation import Polarisers as Polarisers
