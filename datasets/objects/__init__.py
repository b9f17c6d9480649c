"""Hidden objects: what stands behind the scattering layer, float32[h, w] with brightness 0 to 1.

A family is a frozen value; ``family.image(seed, split, index)`` is a pure function, and the sources of
the three splits (characters, pictures, files, patterns) are disjoint by construction.
"""

from specklegen.datasets.objects.digits import Digits
from specklegen.datasets.objects.drawings import Blobs, Polygons, Strokes
from specklegen.datasets.objects.families import Families
from specklegen.datasets.objects.family import AnyFamily, ObjectFamily
from specklegen.datasets.objects.folder import Folder
from specklegen.datasets.objects.glyphs import Glyphs
from specklegen.datasets.objects.meshes import LitMesh, Meshes
from specklegen.datasets.objects.patterns import Bars, Points
from specklegen.datasets.objects.photographs import Photographs, Silhouettes
from specklegen.datasets.objects.scan import Scan

__all__ = [
    "AnyFamily", "Bars", "Blobs", "Digits", "Families", "Folder", "Glyphs", "LitMesh", "Meshes", "ObjectFamily",
    "Photographs", "Points", "Polygons", "Scan", "Silhouettes", "Strokes",
]  # fmt: skip
