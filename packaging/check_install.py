"""Try a wheel or a source distribution in a clean environment, away from the checkout.

    python packaging/check_install.py dist/specklegen_torch-0.1.0-py3-none-any.whl
    python packaging/check_install.py --python python3.12 --without-torch dist/specklegen_torch-0.1.0.tar.gz

A new virtual environment gets the file with everything that it requires; then, from an empty folder, the command, the
data that come with the package and a few results are tried. PyTorch is the build that the variable TORCH names.
``--without-torch`` leaves PyTorch out and tries what needs none of it: planning scenes, path sums, covariances, memory
effect, recipes as text.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

CORE = """
import numpy as np, specklegen as sg
from importlib.metadata import version
assert version("specklegen-torch") == sg.__version__
slab = sg.Slab(thickness=100.0, mean_free_path=50.0, scatterer=sg.media.HenyeyGreenstein(0.5))
scene = sg.Scene(
    wavelength=0.5, medium=slab, illumination=sg.light.CollimatedBeams.tilts([0.0, 1e-5], width=1000.0),
    sensor=sg.sensors.FarField.grid((12, 13), 1e-4),
)
assert sg.plan(scene, paths=64).explain()
assert sg.render(scene, paths=64, sampler="paths").field.shape == (2, 12, 13)
assert sg.memory_effect(slab, wavelength=0.5, tilts=[0.0, 1e-3], paths=128).intensity[0] == 1
assert sg.statistics.covariance(scene.replace(sensor=sg.sensors.FarField(scene.views[:3])),
                                paths=64).value.shape == (2, 3, 2, 3)
from specklegen.datasets import load_recipe, recipe_names
assert len([load_recipe(name) for name in recipe_names()]) >= 10
print(sg.__file__)
"""
FULL = """
from specklegen.datasets import load_recipe
from specklegen.models import load_pretrained
from specklegen.datasets.loading.stream import tensors
few = {"material": {"kernel_paths": 1000}}
batch = tensors(load_recipe("through-slab", few).batch(0, "test", range(2)))
assert load_pretrained().reconstruct(batch).shape == (2, 28, 28)
"""


def main() -> None:
    """Install, then try."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="a wheel, or a source distribution")
    parser.add_argument("--python", default=sys.executable, help="interpreter of the new environment")
    parser.add_argument("--without-torch", action="store_true", help="leave PyTorch out, and what needs it")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        try_out(chosen.file.resolve(), chosen.python, Path(folder), with_torch=not chosen.without_torch)
    print(f"{chosen.file.name} works on {chosen.python}")


def try_out(file: Path, python: str, folder: Path, *, with_torch: bool) -> None:
    """Make an environment in a folder, install the file and run the programs; raises CalledProcessError."""
    run([python, "-m", "venv", "venv"], folder)
    bin_ = folder / "venv" / "bin"
    if with_torch:
        run([bin_ / "pip", "install", "--quiet", os.environ.get("TORCH", "torch==2.13.0")], folder)
    run([bin_ / "pip", "install", "--quiet", f"{file}[torch]" if with_torch else file], folder)
    away = folder / "away"
    away.mkdir()
    run([bin_ / "specklegen", "--version"], away)
    run([bin_ / "specklegen", "recipes"], away)
    run([bin_ / "python", "-c", CORE], away)
    if with_torch:
        run([bin_ / "python", "-c", FULL], away)
        run([bin_ / "specklegen", "plan", "through-slab", "--samples", "8"], away)


def run(words: list, folder: Path) -> None:
    """Run a program that must not see this checkout."""
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    subprocess.run([str(word) for word in words], cwd=folder, env=clean, check=True)


if __name__ == "__main__":
    main()
