"""Mutated files at every door for foreign files: each is read, or refused with a sentence, with no raw error.

    (ulimit -v 12000000; python tests/fuzz_files.py --files 3000)       prints a table by format and outcome
"""

import argparse
import copy
import io
import json
import random
import tempfile
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
import tomli_w
import torch
from PIL import Image
from scipy.io import savemat

import specklegen as sg
from specklegen.core.errors import ToldError
from specklegen.datasets import load_recipe
from specklegen.measured import read_curve
from specklegen.measured.files import read_raw
from specklegen.measured.sphere import read_sphere
from specklegen.models.judging.entries import VERSION, read_entry
from specklegen.models.learning.model_file import read_model, write_model

FRAMES = (np.arange(3 * 12 * 10) % 251).reshape(3, 12, 10).astype(np.uint16)
SPHERE = "IAD1\n" + "\n".join(map(str, [1.33, 1.5, 1.0, 1.0, 2.0, 0.99, 1, *[200.0, 20.0, 20.0, 5.0, 0.97] * 2]))
ODD: list[Any] = [None, [], {}, [[]], [{}], {"type": []}, "x", "", -1, 0, 1e400, float("nan"), True, 10**400, "1 mm",
                  [None]]  # fmt: skip
"""What is put in the place of a value of a table."""


def _written(write: Callable[[io.BytesIO], Any]) -> bytes:
    buffer = io.BytesIO()
    write(buffer)
    return buffer.getvalue()


def _hdf5(buffer: io.BytesIO) -> None:
    import h5py  # pyright: ignore[reportMissingImports]

    with h5py.File(buffer, "w") as file:
        file.create_dataset("frames", data=FRAMES, chunks=(1, 12, 10), compression="gzip")


def _scene() -> dict[str, Any]:
    slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.5))
    light = sg.CollimatedBeams.tilts([0.0], width=2000.0)
    sensor = sg.FarField.grid((4, 4), 1e-3)
    return json.loads(sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sensor).canonical_json())


def _recipe() -> dict[str, Any]:
    return tomllib.loads(load_recipe("through-slab").to_toml())


def _film(file: Path) -> bytes:
    import av  # pyright: ignore[reportMissingImports]

    with av.open(str(file), "w") as film:
        stream = film.add_stream("ffv1" if file.suffix == ".mkv" else "rawvideo", rate=10)
        stream.height, stream.width, stream.pix_fmt = *FRAMES.shape[1:], "gray"
        for frame in FRAMES.astype(np.uint8):
            film.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="gray")))
        film.mux(stream.encode())
    return file.read_bytes()


def _written_beside(suffix: str, write: Callable[[Path], Any]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"whole{suffix}"
        write(file)
        return file.read_bytes()


def _spe() -> bytes:
    head = np.zeros(4100, np.uint8)
    head[108], head[42], head[656], head[1446] = 3, 10, 12, 3
    return head.tobytes() + FRAMES.astype("<u2").tobytes()


def _entry() -> dict[str, Any]:
    score = dict.fromkeys(("mean", "low", "high", "chance"), 0.5)
    of_task = {"digest": "0" * 64, "images": 9} | dict.fromkeys(("pearson", "psnr", "ssim"), score)
    stated = dict.fromkeys(("name", "by", "about", "trained_on"), "x")
    return stated | {"memory_effect": True, "version": VERSION - 1, "tasks": {"slab": of_task}}


def _read_scene(file: Path) -> Any:
    return sg.Scene.from_json(file.read_bytes().decode("utf-8", "replace"))


def _frames(file: Path) -> Any:
    return read_raw("frames", file)


FORMATS: dict[str, tuple[Callable[[], bytes | dict[str, Any]], Callable[[Path], Any]]] = {
    ".tif": (lambda: _written(lambda b: tifffile.imwrite(b, FRAMES, compression="zlib")), _frames),
    ".png": (lambda: _written(lambda b: Image.fromarray(FRAMES[0]).save(b, "PNG")), _frames),
    ".bmp": (lambda: _written(lambda b: Image.fromarray(FRAMES[0].astype(np.uint8)).save(b, "BMP")), _frames),
    ".npy": (lambda: _written(lambda b: np.save(b, FRAMES)), _frames),
    ".mat": (lambda: _written(lambda b: savemat(b, {"frames": FRAMES}, do_compression=True)), _frames),
    ".h5": (lambda: _written(_hdf5), _frames),
    ".spe": (_spe, _frames),
    ".avi": (lambda: _written_beside(".avi", _film), _frames),
    ".mkv": (lambda: _written_beside(".mkv", _film), _frames),
    ".csv": (lambda: b"pixels, C_I, error\n0, 1.0, 0.01\n5, 0.86, 0.02\n10, 0.55, 0.02\n", read_curve),
    ".entry.json": (_entry, read_entry),
    ".model": (
        lambda: _written_beside(".model", lambda file: write_model(file, {"a": 1}, {"w": torch.ones(3, 4)})), read_model
    ),
    ".rxt": (lambda: f"{SPHERE}\nr t u\n.31 .40 .05\n".encode(), read_sphere),
    ".json": (_scene, _read_scene),
    ".toml": (_recipe, load_recipe),
}


def mutated(content: bytes | dict[str, Any], draws: random.Random, suffix: str) -> bytes:
    """Change some bytes of a file, cut it or repeat a part; of a table change a value too."""
    if isinstance(content, dict):
        table = json.loads(json.dumps(content))
        for _ in range(draws.choice([0, 1, 1, 2])):
            _change(table, draws)
        dump = tomli_w.dumps if suffix == ".toml" else json.dumps
        try:
            data = dump(table).encode()
        except (TypeError, ValueError, OverflowError):  # TOML has no None
            data = json.dumps(table).encode()
        if draws.random() < 0.6:
            return data
    else:
        data = content
    changed = bytearray(data)
    for _ in range(draws.choice([1, 1, 2, 8])):
        place = draws.randrange(len(changed))
        changed[place] = draws.choice([draws.randrange(256), changed[place] ^ 1 << draws.randrange(8), 0, 255])
    if draws.random() < 0.2:
        del changed[draws.randrange(len(changed)) :]
    if draws.random() < 0.1:
        place = draws.randrange(len(changed) + 1)
        changed[place:place] = changed[:place] * draws.choice([1, 3])
    return bytes(changed)


def _change(table: Any, draws: random.Random) -> None:
    """Put something odd in the place of a value, anywhere in a table."""
    while True:
        places = list(table) if isinstance(table, dict) else list(range(len(table)))
        if not places:
            return
        place = draws.choice(places)
        if isinstance(table[place], dict | list) and table[place] and draws.random() < 0.7:
            table = table[place]
            continue
        table[place] = copy.deepcopy(draws.choice(ODD))
        return


def run(files: int, folder: Path, seed: int = 0, formats: tuple[str, ...] = tuple(FORMATS)) -> Counter:
    """Read mutated files of every format; count (format, outcome), where a raw error is one with its words."""
    draws, counts = random.Random(seed), Counter()
    whole = {suffix: FORMATS[suffix][0]() for suffix in formats}
    for number in range(files):
        suffix = formats[number % len(formats)]
        file = folder / f"a{suffix}"
        file.write_bytes(mutated(whole[suffix], draws, suffix))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                FORMATS[suffix][1](file)
                counts[suffix, "read"] += 1
            except ToldError:
                counts[suffix, "refused"] += 1
            except Exception as error:
                kept = folder / f"raw{number}{suffix}"
                file.rename(kept)
                counts[suffix, f"raw {type(error).__name__}: {str(error)[:80]} ({kept.name})"] += 1
    return counts


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        counts = run(arguments.files, Path(folder), arguments.seed)
    for (suffix, outcome), count in sorted(counts.items()):
        print(f"{suffix:6} {count:5}  {outcome}")


if __name__ == "__main__":
    main()
