"""Correlated speckle image stacks from bulk material parameters.

Scene -> plan -> trace -> PathBank -> field sums -> fields -> images: one page, ``specklegen.rendering``.
Names load when they are first used, so that importing the package stays light.
"""

from typing import TYPE_CHECKING

from specklegen.lazy import lazily

if TYPE_CHECKING:
    from specklegen.covariances import Covariance, covariance, covariance_blocks
    from specklegen.gates import DoubtWarning
    from specklegen.illumination import CollimatedBeams, IncoherentObject, PlaneWaves, PointSources
    from specklegen.mean import mean_field
    from specklegen.media import Box, Slab, VoxelGrid
    from specklegen.memory_curve import MemoryEffect, memory_effect
    from specklegen.partially_coherent import render_partially_coherent
    from specklegen.planning import Plan, plan
    from specklegen.rendering import SpeckleStack, render
    from specklegen.scatterers import HenyeyGreenstein, Isotropic, Mie, Mixture, Tabulated, VonMisesFisher
    from specklegen.scene import Scene
    from specklegen.sensors import FarField, FarFieldGrid, NearField
    from specklegen.transmission import transmission_matrix
    from specklegen.values import RuleError

_HOME = {
    "covariance_blocks": "covariances",
    "covariance": "covariances",
    "Covariance": "covariances",
    "NearField": "sensors",
    "PointSources": "illumination",
    "VoxelGrid": "media",
    "Box": "media",
    "CollimatedBeams": "illumination",
    "DoubtWarning": "gates",
    "FarField": "sensors",
    "FarFieldGrid": "sensors",
    "HenyeyGreenstein": "scatterers",
    "IncoherentObject": "illumination",
    "Isotropic": "scatterers",
    "MemoryEffect": "memory_curve",
    "Mie": "scatterers",
    "Mixture": "scatterers",
    "Plan": "planning",
    "PlaneWaves": "illumination",
    "RuleError": "values",
    "Scene": "scene",
    "Slab": "media",
    "SpeckleStack": "rendering",
    "Tabulated": "scatterers",
    "VonMisesFisher": "scatterers",
    "mean_field": "mean",
    "memory_effect": "memory_curve",
    "plan": "planning",
    "render": "rendering",
    "render_partially_coherent": "partially_coherent",
    "transmission_matrix": "transmission",
}

__all__ = [
    "covariance_blocks",
    "covariance",
    "Covariance",
    "NearField",
    "PointSources",
    "VoxelGrid",
    "Box",
    "CollimatedBeams",
    "DoubtWarning",
    "FarField",
    "FarFieldGrid",
    "HenyeyGreenstein",
    "IncoherentObject",
    "Isotropic",
    "MemoryEffect",
    "Mie",
    "Mixture",
    "Plan",
    "PlaneWaves",
    "RuleError",
    "Scene",
    "Slab",
    "SpeckleStack",
    "Tabulated",
    "VonMisesFisher",
    "mean_field",
    "memory_effect",
    "plan",
    "render",
    "render_partially_coherent",
    "transmission_matrix",
]
__version__ = "0.1.0"

__getattr__ = lazily(__name__, _HOME)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
