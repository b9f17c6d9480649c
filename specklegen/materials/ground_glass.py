"""Ground glass by the grit that ground it; the roughness is assumed, and stands in :mod:`specklegen.scene.screens`."""

from specklegen.materials.preset import Checked, Number, Preset
from specklegen.scene.screens import GRITS, GroundGlass


def make(wavelength: float, micrometre: float, *, grit: float) -> GroundGlass:
    """A ground glass in air: a thin medium, not a bulk."""
    return GroundGlass(grit=int(grit), unit=1e-6 / micrometre)


GROUND_GLASS = Preset(
    "ground-glass", "ground glass in air by its grit: a thin medium", (0.3, 2.5),
    {"grit": Number(220, min(GRITS), max(GRITS), "", f"of the abrasive, one of {', '.join(map(str, GRITS))}",
                    "Roughness and angular width of the scattered light of each grit: docs/screens.md", Checked.ASSUMED,
                    tuple(GRITS))},
    ("No maker prints a roughness: right within a factor of 1.5 in the angle and 2 in the height",),
    make, "For precise work measure the angular width, and use GroundGlass(angle=).",
)  # fmt: skip
