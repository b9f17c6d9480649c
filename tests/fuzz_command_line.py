"""Random command lines, good ones and bad ones: each ends in an answer or in a message, never in a traceback.

    python tests/fuzz_command_line.py --lines 600 --seed 0

Lines are put together from every command, its options, and values that people and programs get wrong: numbers out
of range and of thousands of digits, texts for numbers, files that are damaged, deep, binary, missing or in the way,
recipes that inherit in circles. They run in this process, in a folder that is made for them, under a limit of memory. A
line that takes more than a few seconds of processor time, or waits for minutes, is stopped and counted, not judged.
"""

import argparse
import contextlib
import io
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

MEMORY = 12 * 2**30
"""Bytes of address space that a line may take; torch alone maps some of it."""

PATIENCE = 60
"""Seconds by the clock for each of the processor's."""

HUGE = "9" * 5000
WHOLE = ["-3", "0", "1", "2", "3", "7", "2.5", "x", "", "²", HUGE, "12345678901234567890", "-9223372036854775809"]
REAL = ["-1", "0", "0.5", "1", "3", "nan", "inf", "-inf", "1e300", "1e-300", "1e400", "x", "", HUGE]
WORDS = ["", "x", "auto", "camera", "stationary", "reflection", "png", "train", "validation", "dense", "²/3", "1/0",
         "3/2", "1/3"]  # fmt: skip
NAMES = ["through-slab", "tilt-stack", "two-tilts", "thruogh-slab", "unknown-slab"]
FILES = ["good.toml", "pictures.toml", "deep.toml", "deep.json", "deep-keys.toml", "huge.toml", "hex.toml", "huge.json",
         "list.json", "latin.toml", "binary.toml", "empty.toml", "circle-a.toml", "circle-spelt.toml", "chain-0.toml",
         "inherits-7.toml", "inherits-table.toml", "inherits-missing.toml", "kind-list.toml", "scene.toml",
         "scene.json", "model.pt", "flipped.pt", "folder", "folder/inner.toml", "store.zarr", "broken.zarr",
         "emptied.zarr", "nothing", "n" * 300, "pictures", "odd-pictures", "good.toml/inside", "loop"]  # fmt: skip
RECIPES = [*["through-slab"] * 40, *NAMES, *FILES]  # half of the lines go beyond their first argument
STORES = [*["store.zarr"] * 30, *FILES]
MODELS = [*["model.pt"] * 30, *FILES]
SETS = [
    "material.g=0.8", "material.g=1", "material.g=nan", "material.g=x", "material", "=", "material.g", "material.g="
    + HUGE,
    "material.g=0x" + "f" * 5000, "material=3", "objects=3", "objects.path=nothing", "samples=x", "samples.train=-1",
    "media=0", "exposure.photons=1e300", "exposure.photons=1e-12", "material.thickness=1e300", "mode_tolerance=1e4",
    "material.kernel_paths=1", "camera.shape=7", "camera.shape=[1,1]", "camera.shape=[0,3]", "inherits=x", "a." * 90
    + "a=1",
    "name==1+1", "material.g={uniform=[0.1]}", "objects.type=Folder", "window.width=fitted", "\x00=1",
    "objects.shape=[0,1]",
]  # fmt: skip

SMALL_SET = ["--set", "material.kernel_paths=1000"]
OPTIONS: dict[str, tuple[list[list[str]], list[str], dict[str, list[str]]]] = {
    # command: pools of its arguments, options that keep it short, options to draw with their pools
    "recipes": ([["show", "schema", "show", "schema", "x", "--json"], RECIPES], [], {"--set": SETS}),
    "plan": ([RECIPES], ["--samples", "2", *SMALL_SET],
             {"--samples": WHOLE, "--set": SETS, "--images": FILES, "--json": []}),
    "physics render": ([], ["--views", "8", "--paths", "64", "--tilts", "2"], {
        "--wavelength": REAL, "--thickness": REAL, "--optical-depth": REAL, "--g": REAL, "--albedo": REAL,
        "--width": REAL,
        "--tilts": WHOLE, "--step": REAL, "--views": WHOLE, "--pitch": REAL, "--paths": WHOLE, "--rel-error": REAL,
        "--sampler": WORDS, "--scene": FILES, "--seed": WHOLE, "--out": FILES, "--mean": []}),
    "memory-effect": ([], ["--paths", "200", "--points", "3"], {
        "--wavelength": REAL, "--thickness": REAL, "--optical-depth": REAL, "--g": REAL, "--albedo": REAL,
        "--largest": REAL,
        "--points": WHOLE, "--mode": WORDS, "--paths": WHOLE, "--seed": WHOLE, "--out": FILES, "--json": []}),
    "generate": ([RECIPES], ["--samples", "2", "--processes", "1", "--out", "new.zarr", *SMALL_SET], {
        "--samples": WHOLE, "--split": WORDS, "--seed": WHOLE, "--set": SETS, "--images": FILES,
        "--shard-range": WORDS, "--out": FILES}),
    "preview": ([RECIPES], ["--samples", "1", *SMALL_SET], {
        "--samples": WHOLE, "--split": WORDS, "--seed": WHOLE, "--set": SETS, "--images": FILES, "--out": FILES}),
    "store info": ([STORES], [], {}),
    "store verify": ([STORES], [], {"--repair": [*NAMES, *FILES], "--set": SETS, "--images": FILES, "--json": []}),
    "store export": ([STORES], ["--out", "exported"], {"--out": FILES, "--format": WORDS, "--samples": WHOLE}),
    "train": ([RECIPES], ["--out", "run", "--epochs", "1", "--seconds", "0.1", "--validation-samples", "2",
    "--width", "1",
                                   "--batch-size", "2", *SMALL_SET, "--set", "samples.train=2"], {
        "--validation": FILES, "--validation-samples": WHOLE, "--input": WORDS, "--network": WORDS, "--width": WHOLE,
        "--loss": WORDS, "--learning-rate": REAL, "--batch-size": WHOLE, "--epochs": WHOLE, "--seconds": REAL,
        "--device": ["cpu", "cuda", "gpu", "meta", ""], "--seed": WHOLE, "--set": SETS, "--out": FILES}),
    "evaluate": ([MODELS], ["--samples", "2", "--no-katz", "--recipe", "unknown-slab", *SMALL_SET], {
        "--recipe": [*NAMES, *FILES], "--split": WORDS, "--samples": WHOLE, "--restarts": WHOLE, "--out": FILES,
        "--seed": WHOLE, "--set": SETS}),
    "check recoverable": ([RECIPES], ["--media", "1", *SMALL_SET], {
        "--beam": REAL, "--removal": REAL, "--media": WHOLE, "--seed": WHOLE, "--set": SETS, "--images": FILES,
        "--json": []}),
    "check compare": ([RECIPES], ["--seconds", "0.01"], {
        "--seconds": REAL, "--seed": WHOLE, "--set": SETS, "--csv": FILES, "--out": FILES}),
}  # fmt: skip


def command_lines(seed: int, count: int) -> Iterator[list[str]]:
    """Draw command lines; line n of a seed is the same whatever the count."""
    for n in range(count):
        rng = random.Random(f"{seed} {n}")
        name = rng.choice(list(OPTIONS))
        pools, short, options = OPTIONS[name]
        line = [*name.split(), *(rng.choice(pool) for pool in pools if rng.random() < 0.97), *short]
        for flag in rng.choices(list(options), k=rng.choice([0, 1, 1, 2])) if options else []:
            line += [flag, rng.choice(options[flag])] if options[flag] else [flag]
        yield line


def make_files(folder: Path) -> None:
    """Make the files that lines name: good, damaged, deep, binary and in the way."""
    from PIL import Image

    import specklegen as sg
    from specklegen.datasets import load_recipe
    from specklegen.datasets.store.generate import generate
    from specklegen.models.learning.networks import build
    from specklegen.models.learning.reconstructor import Reconstructor

    texts = {
        "good.toml": 'inherits = "through-slab"\nname = "good"\n',
        "pictures.toml": 'inherits = "through-slab"\n[objects]\ntype = "Folder"\npath = "pictures"\n',
        "deep.toml": "a = " + "[" * 3000 + "]" * 3000, "deep-keys.toml": "a" + ".a" * 3000 + " = 1\n",
        "deep.json": "[" * 100_000,
        "huge.toml": f"wavelength = {HUGE}\n",
        "hex.toml": 'inherits = "through-slab"\n[material]\ng = 0x' + "f" * 5000 + "\n",
        "huge.json": '{"wavelength": ' + HUGE + "}", "list.json": "[1, 2]", "empty.toml": "",
        "circle-a.toml": 'inherits = "circle-b.toml"\n', "circle-b.toml": 'inherits = "./folder/../circle-a.toml"\n',
        "circle-spelt.toml": 'inherits = "folder/../circle-spelt.toml"\n',
        **{f"chain-{n}.toml": f'inherits = "chain-{n + 1}.toml"\n' for n in range(20)},
        "inherits-7.toml": "inherits = 7\n", "inherits-table.toml": "[inherits]\na = 1\n",
        "inherits-missing.toml": 'inherits = "nothing"\n', "kind-list.toml": "kind = []\n",
    }  # fmt: skip
    for name, text in texts.items():
        (folder / name).write_text(text)
    (folder / "latin.toml").write_bytes('name = "é"\n'.encode("latin-1"))
    (folder / "binary.toml").write_bytes(bytes(range(256)) * 9)
    (folder / "folder").mkdir()
    (folder / "folder" / "inner.toml").write_text('inherits = "../pictures.toml"\n')
    (folder / "loop").symlink_to("loop")
    scene = sg.Scene(
        wavelength=0.5, medium=sg.Slab(thickness=100.0, mean_free_path=50.0, scatterer=sg.HenyeyGreenstein(g=0.5)),
        illumination=sg.CollimatedBeams.tilts([0.0], width=1000.0), sensor=sg.FarField.grid((8, 8), 1e-4),
    )  # fmt: skip
    (folder / "scene.toml").write_text(scene.to_toml())
    (folder / "scene.json").write_text(scene.canonical_json())
    for name in ("pictures", "odd-pictures"):
        (folder / name).mkdir()
        for n in range(4):
            Image.fromarray(np.full((9, 9 + n), 50 * n + 9, np.uint8)).save(folder / name / f"{n}.png")
    (folder / "odd-pictures" / "torn.png").write_bytes((folder / "pictures" / "0.png").read_bytes()[:40])
    recipe = load_recipe("through-slab", {"material": {"kernel_paths": 1000}})
    generate(recipe, samples=2, folder=folder / "store.zarr", processes=1)
    for name in ("broken.zarr", "emptied.zarr"):
        shutil.copytree(folder / "store.zarr", folder / name)
    (folder / "broken.zarr" / "zarr.json").write_text('{"zarr_format": 3, "node_type": "group"')
    shutil.rmtree(folder / "emptied.zarr" / "image")
    network = build("dense", 64, (28, 28), 1, seed=0)
    Reconstructor(network, "dense", "autocorrelation", 1, 64, (28, 28)).save(folder / "model.pt")
    content = bytearray((folder / "model.pt").read_bytes())
    content[len(content) // 2] ^= 1
    (folder / "flipped.pt").write_bytes(content)


class TooSlow(BaseException):
    """A line took its time."""


def _stop(*_: object) -> None:
    raise TooSlow


def outcome(main: Callable[[list[str]], None], line: list[str], seconds: int) -> tuple[str, str]:
    """What becomes of a line: "ok", "refused", "slow" or "traceback"; and the traceback. Seconds are those of the
    processor, so that a busy machine judges as many lines as a quiet one."""
    timers = ((signal.ITIMER_PROF, signal.SIGPROF, seconds), (signal.ITIMER_REAL, signal.SIGALRM, PATIENCE * seconds))
    before = {number: signal.signal(number, _stop) for _, number, _ in timers}
    try:
        for which, _, after in timers:
            signal.setitimer(which, after)
        found = _ended(main, line)
        for which, _, _ in timers:
            signal.setitimer(which, 0)
        return found
    except TooSlow:  # wherever it comes, the very end of the line included
        return "slow", ""
    finally:
        for which, number, _ in timers:
            signal.setitimer(which, 0)
            signal.signal(number, before[number])


def _ended(main: Callable[[list[str]], None], line: list[str]) -> tuple[str, str]:
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            main(line)
    except SystemExit as end:
        if end.code in (0, None):
            return "ok", ""
        return ("refused", "") if said.getvalue().strip() else ("traceback", f"exit {end.code} without a word")
    except TooSlow:
        raise
    except BaseException:
        return "traceback", traceback.format_exc()
    return "ok", ""


def main() -> None:
    """Run the lines; exit with status 1 if one ended in a traceback."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lines", type=int, default=600)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=int, default=10, help="of the processor, after which a line is stopped")
    arguments = parser.parse_args()
    from specklegen.cli import commands

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    counts = {"ok": 0, "refused": 0, "slow": 0, "traceback": 0}
    with tempfile.TemporaryDirectory() as made, tempfile.TemporaryDirectory() as work:
        make_files(Path(made))
        for line in command_lines(arguments.seed, arguments.lines):
            place = Path(work) / "place"
            shutil.copytree(made, place, symlinks=True)
            os.chdir(place)
            state, told = outcome(commands.main, line, arguments.seconds)
            os.chdir(work)
            shutil.rmtree(place)
            counts[state] += 1
            if state in ("traceback", "slow"):
                print(f"{state}: specklegen", *(repr(word)[:80] for word in line), flush=True)
                print(told, end="", flush=True)
    print(", ".join(f"{count} {state}" for state, count in counts.items()))
    sys.exit(1 if counts["traceback"] else 0)


if __name__ == "__main__":
    main()
