"""What another instruction set changes: outcomes of tests, last digits of samples, verdicts of the solver.

    python tests/instruction_sets.py tests/models tests/datasets/recipes/test_golden.py   # outcomes of these tests
    python tests/instruction_sets.py --together tests/models   # under all settings at once, as on an older processor
    python tests/instruction_sets.py --measure                                            # samples and verdicts

Libraries choose their code by the processor. Each setting below makes one of them choose as on an older one, in a
process of its own. A test whose outcome depends on it stands at its margin: the script names it, and exits with 1.
What is measured is in docs/notes/versioning.md.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

SETTINGS: dict[str, dict[str, str]] = {"as it is": {}, "torch without AVX": {"ATEN_CPU_CAPABILITY": "default"},
                                       "Numba for any processor": {"NUMBA_CPU_NAME": "generic"},
                                       "MKL with AVX2": {"MKL_CBWR": "AVX2"}}  # fmt: skip
"""What is set in the environment, by its name; the first is what the others are compared with."""
TOGETHER = "an older processor"
"""All of them at once."""
SAMPLES, IMAGES = 3, 24
_ROOT = Path(__file__).resolve().parents[1]


def run(setting: str, *command: str) -> int:
    """Exit status of a command of Python's under a setting, one thread."""
    asked = SETTINGS.values() if setting == TOGETHER else [SETTINGS[setting]]
    chosen = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(_ROOT)}
    for variables in asked:
        chosen |= variables
    return subprocess.run([sys.executable, *command], env=chosen, cwd=_ROOT, check=False).returncode


def outcomes(report: Path) -> dict[str, str]:
    """Outcome of every test of a report in JUnit's XML: "passed", or the name of what became of it."""
    cases = ElementTree.parse(report).getroot().iter("testcase")
    bad = ("failure", "error", "skipped")
    return {
        f"{case.get('classname')}::{case.get('name')}": next((part.tag for part in case if part.tag in bad), "passed")
        for case in cases
    }


def differing(found: dict[str, dict[str, str]]) -> dict[str, dict[str, str]]:
    """Tests whose outcome is not the same under all settings, with their outcomes by setting."""
    every = dict.fromkeys(test for each in found.values() for test in each)
    rows = {test: {name: each.get(test, "not run") for name, each in found.items()} for test in every}
    return {test: row for test, row in rows.items() if len(set(row.values())) > 1}


def compare_tests(selection: Sequence[str], settings: Sequence[str]) -> int:
    """Run tests under settings and print those that differ, and those that fail; 1 if there are any."""
    found: dict[str, dict[str, str]] = {}
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(os.cpu_count()) as beside:
        reports = [str(Path(folder) / f"{n}.xml") for n in range(len(settings))]
        options = "-m", "pytest", "-qq", "--tb=no", "-p", "no:cacheprovider"
        each = beside.map(lambda name, report: run(name, *options, f"--junit-xml={report}", *selection), settings,
                          reports)  # fmt: skip
        for name, report, status in zip(settings, reports, each, strict=True):
            if status not in (0, 1):  # 1: tests failed; all else: pytest did not run them
                return status
            found[name] = outcomes(Path(report))
            passed = sum(outcome == "passed" for outcome in found[name].values())
            print(f"{name}: {len(found[name])} tests, {passed} passed", flush=True)
    failed = {test: outcome for test, outcome in found[settings[0]].items() if outcome in ("failure", "error")}
    bad = {test: {"every setting": outcome} for test, outcome in failed.items()} | differing(found)
    for test, row in bad.items():
        print(test, *(f"  {name}: {outcome}" for name, outcome in row.items()), sep="\n")
    return int(bool(bad))


def write(path: str) -> None:
    """Write samples of every packaged recipe, and the solver's verdicts, to a file."""
    import torch

    from specklegen.datasets import load_recipe, recipe_names
    from specklegen.models import reconstruct

    kept: dict[str, np.ndarray] = {}
    for name in recipe_names():
        batch = load_recipe(name).batch(0, "test", range(SAMPLES))
        kept |= {f"{name} {key}": np.asarray(batch[key]) for key in ("image", "stack", "frames") if key in batch}
    setup = load_recipe("one-angular-size", {"material": {"thickness": 1000.0, "optical_depth": 10.0, "g": 0.9}})
    images = torch.from_numpy(setup.batch(0, "test", range(IMAGES))["image"])[:, None]
    for key, value in (("", images), (" scaled", images * (1 + 1e-7))):
        each = reconstruct(value, setup, fit=False, fast=True).each
        kept |= {f"solver{key} deviance": np.array([x.deviance for x in each]),
                 f"solver{key} probability": np.array([x.probability for x in each], float),
                 f"solver{key} image": np.stack([x.image for x in each])}  # fmt: skip
    np.savez(path, **kept)


def row(key: str, one: np.ndarray, other: np.ndarray) -> str:
    """How far two results are apart."""
    if key.endswith(("deviance", "probability")):
        return f"rms {np.sqrt(np.nanmean(np.square(other - one))):.3f}, largest {np.nanmax(np.abs(other - one)):.3f}"
    if key.startswith("solver"):
        r = [np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in zip(one, other, strict=True)]
        return f"correlation of images, median {np.median(r):.3f}, least {min(r):.3f}"
    apart = np.abs(other.astype(np.float64) - one.astype(np.float64)).max()
    if np.issubdtype(one.dtype, np.integer):
        return f"{apart:.0f} counts at most"
    return "every bit" if apart == 0 else f"{apart / one.mean(dtype=np.float64):.1e} of the mean at most"


def compare_results() -> int:
    """Print how far samples and verdicts are apart under the settings."""
    with tempfile.TemporaryDirectory() as folder:
        found = {}
        for n, name in enumerate(SETTINGS):
            path = str(Path(folder) / f"{n}.npz")
            if run(name, str(Path(__file__)), "--write", path):
                return 1
            found[name] = dict(np.load(path))
    first, *others = SETTINGS
    for key in (key for key in found[first] if not key.startswith("solver scaled")):
        for name in others:
            print(f"{key}, {name}: {row(key, found[first][key], found[name][key])}")
    for key in ("deviance", "probability", "image"):
        pair = (found[first][f"{name} {key}"] for name in ("solver", "solver scaled"))
        print(f"solver {key}, brightness times 1 + 1e-7: {row(f'solver {key}', *pair)}")
    return 0


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tests", nargs="*", help="what pytest is to run; options after --")
    parser.add_argument("--others", action="store_true", help="leave out the processor as it is, tested already")
    parser.add_argument("--together", action="store_true", help="one run under all settings at once")
    parser.add_argument("--measure", action="store_true", help="compare samples and verdicts instead")
    parser.add_argument("--write", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.write:
        write(asked.write)
        return 0
    if asked.measure:
        return compare_results()
    return compare_tests(asked.tests, [TOGETHER] if asked.together else list(SETTINGS)[int(asked.others) :])


if __name__ == "__main__":
    sys.exit(main())
