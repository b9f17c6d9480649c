"""Where the tests find things, and the slabs and scenes that many of them share."""

import sys
from importlib import import_module, util
from pathlib import Path
from types import ModuleType

import numpy as np

import specklegen as sg

ROOT = Path(__file__).parent.parent
DATA = ROOT / "tests" / "data"

ISOTROPIC = sg.Isotropic()


def slab(optical_depth=10.0, g=0.0, albedo=1.0, thickness=100.0):
    """A slab of Henyey and Greenstein's particles, or isotropic ones."""
    return sg.Slab(thickness=thickness, mean_free_path=thickness / optical_depth, albedo=albedo,
                   scatterer=sg.HenyeyGreenstein(g=g) if g else ISOTROPIC)  # fmt: skip


def flat_box(lights, sensor, *, half=10.0, mean_free_path=10.0, scatterer=ISOTROPIC, **medium):
    """Lights at angles in degrees on a square box in flatland, wavelength 1."""
    return sg.Scene(
        wavelength=1.0,
        medium=sg.Box(lower=[-half] * 2, upper=[half] * 2, mean_free_path=mean_free_path, scatterer=scatterer,
                      **medium),
        illumination=sg.PlaneWaves.tilts(np.deg2rad(lights), dimensions=2), sensor=sensor,
    )  # fmt: skip


def views(degrees):
    return sg.FarField.angles(np.deg2rad(np.asarray(degrees, float)))


def script_at(path: str) -> ModuleType:
    """Import a file of the repository that is part of no package, afresh."""
    spec = util.spec_from_file_location(Path(path).stem, ROOT / path)
    assert spec is not None
    assert spec.loader is not None
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def of_the_figures(name: str) -> ModuleType:
    """Import a file of ``scripts/figures``, whose neighbours import one another by their bare names."""
    figures = str(ROOT / "scripts" / "figures")
    sys.path.insert(0, figures)
    try:
        return import_module(name)
    finally:
        sys.path.remove(figures)
