"""
Layers, and a medium of your own
================================

Skin has layers: a thin, dense epidermis over a thicker, clearer dermis. Their memory effect differs from that of a slab
with their mean properties. The last medium is a class of its own, whose density grows with depth.
"""

import numpy as np
import specklegen as sg
from matplotlib import pyplot as plt

epidermis = sg.media.Layer(thickness=60.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.8))
dermis = sg.media.Layer(thickness=240.0, mean_free_path=60.0, scatterer=sg.media.HenyeyGreenstein(0.9))


class Sediment(sg.media.Stratified):
    """Mean free paths that fall with depth. A medium needs the property `layers` only."""

    thickness: float
    top: float
    bottom: float

    @property
    def layers(self):
        share = self.thickness / 16
        paths = np.geomspace(self.top, self.bottom, 16)
        return [sg.media.Layer(thickness=share, mean_free_path=path, scatterer=sg.media.HenyeyGreenstein(0.9))
                for path in paths]


both = sg.Layers([epidermis, dermis])
media = {
    "epidermis over dermis": both,
    "a slab of their mean": sg.Slab(
        thickness=both.thickness, mean_free_path=both.thickness / both.optical_depth, scatterer=both.scatterer
    ),
    "denser with depth": Sediment(thickness=300.0, top=120.0, bottom=20.0),
}
figure, axes = plt.subplots(layout="constrained")
for label, medium in media.items():
    print(f"{label}: optical depth {medium.optical_depth:.2f}, mean cosine {medium.scatterer.mean_cosine():.3f}")
    sg.memory_effect(medium, wavelength=0.5, tilts=np.linspace(0, 4e-3, 21), paths=20_000).plot(axes, label)
axes.legend()
plt.show()
