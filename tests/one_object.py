"""Objects through one medium after the other, in the terms in which tests write them out."""

from dataclasses import dataclass

import numpy as np
import torch

from specklegen.scene.window import Window
from specklegen.synthesis.exit_grid import Axis
from specklegen.synthesis.imaging import Imaging
from specklegen.synthesis.objects import object_imaging, object_media
from specklegen.synthesis.stacks import mean_intensity


@dataclass(frozen=True)
class OneObject:
    """An imaging of one medium, and the expected image of an object of total brightness 1."""

    imaging: Imaging
    mean: float

    @property
    def rank(self):
        return self.imaging.rank

    @property
    def modes(self):
        """real[T, R, h * w]."""
        return self.imaging.modes[0]

    @property
    def mixing(self):
        return None if self.imaging.mixing is None else self.imaging.mixing[0]

    @property
    def x(self):
        return self._axis(1)

    @property
    def y(self):
        return self._axis(0)

    def _axis(self, axis):
        own = self.imaging
        return Axis(int(own.cells[0, axis]), float(own.size[0, axis]), own.lags[axis])

    def medium(self, seed, number=0):
        """Fields b G_r under the window for each mode of light, complex[N, R, rows, columns]."""
        rows, columns = self.imaging.envelope.shape[1:]
        return object_media(self.imaging, seed, number).drawn[0, 0, :, :, :rows, :columns]

    def spectra(self, medium):
        return self.imaging.spectra(medium[None, None])[0, 0]

    def image(self, medium, brightness, *, form=None):
        return self.images(medium, brightness, form=form)[0]

    def images(self, medium, brightness, *, form=None):
        """Expected intensities real[T, H, W], through :meth:`medium` or its :meth:`spectra`."""
        imaging = self.imaging
        light = torch.as_tensor(np.array(brightness), dtype=imaging.modes.dtype)[None].to(imaging.envelope.device)
        shared = medium.dim() == 3
        if form is None:
            cheaper = not shared and imaging.points_cheaper(int((light != 0).sum()), 1, len(medium))
            form = "points" if cheaper else "pairs"
        if form == "points":
            seen = imaging.images_by_points(medium[None, None], light)[0]
        else:
            seen = imaging.images((medium if shared else self.spectra(medium))[None, None], light)[0]
        return seen * self.mean

    def superposed(self, medium, amplitudes, step):
        waves = torch.as_tensor(np.asarray(amplitudes, np.complex128))[None].to(medium.device)
        return self.imaging.superposed(medium[None, None], waves, step)[0, 0]

    def contrast(self, brightness):
        light = torch.as_tensor(np.array(brightness, np.float64))[None].to(self.imaging.variance.device)
        return float(self.imaging.contrast(light))


def one_object(kernel, **options):
    """Prepare one; see :func:`object_imaging`."""
    area = Window(options.get("profile", "square"), options["width"]).area
    return OneObject(object_imaging(kernel, **options), mean_intensity(kernel, area))
