"""Objects behind one stack of thin screens, as the screens sampler images them."""

import numpy as np
import torch
from one_object import OneObject

from specklegen.datasets.recipes.parts.diffuser import known
from specklegen.samplers.sampler import MediaRequest
from specklegen.samplers.screens.objects import screen_imagings
from specklegen.synthesis.correlations import Tabulated
from specklegen.synthesis.sight import Sight


def screen_objects(
    stack, *, wavelength, object_shape, object_pitch, grid, base, width, moved=None, tolerance=0.01
):  # fmt: skip
    """Sampler of objects; images are over the mean of an even object."""
    one = lambda value: torch.as_tensor(np.asarray(value, np.float64))[None]  # noqa: E731
    sight = Sight(wavelength=wavelength, profile="square", shape=object_shape, camera=grid.shape, center=grid.center,
                  integrated=False, width=one(width), object_pitch=one(object_pitch), camera_pitch=one(grid.pitch),
                  base=one(base))  # fmt: skip
    request = MediaRequest(sight=sight, correlations=Tabulated([known(stack, wavelength).correlation]), light=None,
                           tolerance=tolerance, media=(lambda: stack,), units=one(1.0),
                           moved=None if moved is None else one(moved))  # fmt: skip
    ((_, imaging),) = screen_imagings(request)
    return OneObject(imaging, 1.0)
