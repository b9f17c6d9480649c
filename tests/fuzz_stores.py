"""Kill -9 at every file operation of those who create, fill, grow and repair stores, alone and up to eight at once.

    python tests/fuzz_stores.py --minutes 10

Every trial runs processes on a store, of which some are killed at a chosen file operation (any open for writing,
rename, link, deletion, folder or lock: what Python reports to audit hooks, below the folder of the trial). Then:

- nothing wrong: every sample that can be read is the recipe's, to the bit; verify calls nothing damaged;
- nothing lost: what was on the ledger before is there still, and is not rendered again;
- nothing unusable: the same call, made again, ends with the bytes of an uninterrupted run and leaves nothing behind.
"""

import argparse
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import numpy as np
from fake_recipe import FakeRecipe, assert_same
from small_stores import age, contents

from specklegen.core.whole_files import is_temporary
from specklegen.datasets.loading.cache import SpeckleCache
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.shards import MissingSample
from specklegen.datasets.store.verify import verify

RECIPE = FakeRecipe(side=4)
FEW, MANY, SHARD = 8, 22, 5
_EVENTS = ("open", "os.rename", "os.link", "os.remove", "os.mkdir", "os.rmdir", "fcntl.lockf")


def create(folder: Path) -> None:
    """Make a small store; its last shard is not full."""
    generate(RECIPE, samples=FEW, shard_samples=SHARD, folder=folder, processes=1)


def fill(folder: Path) -> None:
    """Make or grow a store to its full size."""
    generate(RECIPE, samples=MANY, shard_samples=SHARD, folder=folder, processes=1)


def repair(folder: Path) -> None:
    """Mend a store."""
    verify(folder, repair=RECIPE)


def damage(folder: Path) -> None:
    """Spoil a whole store: a flipped byte, a lost file, a torn header."""
    fill(folder)
    _flip(folder / "image/c/1/0/0")
    (folder / "object/c/3/0/0").unlink()
    (folder / "field/zarr.json").write_bytes(b"{")


def _flip(file: Path) -> None:
    data = file.read_bytes()
    file.write_bytes(bytes([data[0] ^ 1]) + data[1:])


def wear(folder: Path) -> None:
    """Make a small store and spoil its first shard."""
    create(folder)
    _flip(folder / "image/c/0/0/0")


def tend(folder: Path) -> None:
    """Grow and mend a store, every other process the other way round."""
    for work in (fill, repair) if os.getpid() % 2 else (repair, fill):
        work(folder)


SCENES: dict[str, tuple[Callable[[Path], None] | None, Callable[[Path], None]]] = {
    "create": (None, create), "generate": (None, fill), "grow": (create, fill), "repair": (damage, repair),
    "tend": (wear, tend),
}  # fmt: skip
"""Name to what is there before, and what is killed."""

DAMAGED = ("repair", "tend")
"""Scenes that begin with a store that is not sound."""


class Dying:
    """An audit hook that kills its process before a file operation below a folder."""

    def __init__(self, folder: Path, kill_at: int) -> None:
        self.folder, self.kill_at, self.seen, self.on = str(folder), kill_at, 0, True

    def __call__(self, event: str, arguments: tuple) -> None:
        """Count, and die."""
        if event not in _EVENTS or not self.on:
            return
        if event == "open" and not (isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)):
            return
        if event != "fcntl.lockf" and not str(arguments[0]).startswith(self.folder):
            return
        self.seen += 1
        if self.seen == self.kill_at:
            os.kill(os.getpid(), signal.SIGKILL)


def child(work: Callable[[Path], None], folder: Path, kill_at: int, log: Path) -> int:
    """Start a process that does the work, and dies at one of its file operations (0: at none)."""
    number = os.fork()
    if number:
        return number
    _do(work, folder, kill_at, log)


def _do(work: Callable[[Path], None], folder: Path, kill_at: int, log: Path) -> NoReturn:
    code = 1
    try:
        hook = Dying(folder.parent, kill_at)
        sys.addaudithook(hook)
        work(folder)
        hook.on = False
        log.write_text(str(hook.seen))
        code = 0
    except BaseException:
        log.write_text(traceback.format_exc())
    finally:
        os._exit(code)


def run(work: Callable[[Path], None], folder: Path, kills: list[int], logs: Path) -> list[str]:
    """Run as many processes at once as there are kills; return what those that were not killed say."""
    logs.mkdir(exist_ok=True)
    numbers = [child(work, folder, kill, logs / str(place)) for place, kill in enumerate(kills)]
    said = []
    for place, number in enumerate(numbers):
        status = os.waitpid(number, 0)[1]
        if os.WIFSIGNALED(status):
            assert os.WTERMSIG(status) == signal.SIGKILL, status
            continue
        text = (logs / str(place)).read_text()
        assert os.WEXITSTATUS(status) == 0, f"a process that was not killed failed:\n{text}"
        said.append(text)
    return said


def trial(scene: str, kills: list[int], reference: dict[str, bytes], start: Path | None, room: Path) -> int:
    """Run one trial; return the file operations of a process that was not killed, 0 if there was none."""
    shutil.rmtree(room, ignore_errors=True)
    room.mkdir()
    folder, work = room / "a.zarr", SCENES[scene][1]
    if start is not None:
        shutil.copytree(start, folder)
    logs = room.with_name(room.name + ".logs")
    said = run(work, folder, kills, logs)
    before = _ledger(folder)
    if scene not in DAMAGED and (folder / "zarr.json").exists():
        found = verify(folder)
        assert not found.damaged, found
        assert _read(folder) == before, "what the ledger lists can be read, and nothing else"
    if scene == "grow":
        assert set(range(FEW)) <= before, "samples that were there before are there"
    kept = _finished(before) if scene not in DAMAGED else set()
    stamps = _stamps(folder, kept)
    age(room)  # what the dead left is swept an hour later
    run(work, folder, [0], logs)
    assert contents(folder) == reference, _difference(contents(folder), reference)
    assert stamps == _stamps(folder, kept), "finished shards were written again"
    left = {file.name for file in room.iterdir()} - {"a.zarr", "a.card.md"}
    assert not left, left
    assert verify(folder).sound
    return max((int(text) for text in said), default=0)


def _ledger(folder: Path) -> set[int]:
    listed = set()
    for file in (folder / "valid" / "c").glob("*"):
        if file.name.isdigit():
            rows = np.frombuffer(file.read_bytes()[:-4], bool)
            listed |= {int(file.name) * SHARD + int(row) for row in np.flatnonzero(rows)}
    return listed


def _finished(listed: set[int]) -> set[str]:
    """Full shards all of whose samples are listed."""
    shards = {n // SHARD for n in listed}
    return {str(s) for s in shards if set(range(s * SHARD, s * SHARD + SHARD)) <= listed}


def _stamps(folder: Path, shards: set[str]) -> dict[str, int]:
    """Which file, by its number on the disk, holds each part of some shards: a file written again is another one."""
    files = [file for file in folder.glob("*/c/**/*") if file.is_file() and not is_temporary(file)]
    return {str(file): file.stat().st_ino for file in files if file.relative_to(folder).parts[2] in shards}


def _read(folder: Path) -> set[int]:
    cache, there = SpeckleCache(folder), set()
    for n in range(len(cache)):
        try:
            sample = cache.numpy(n)
        except MissingSample:
            continue
        assert_same(sample | {"index": np.int64(n)}, RECIPE.sample(0, "train", n))
        there.add(n)
    return there


def _difference(there: dict[str, bytes], wanted: dict[str, bytes]) -> str:
    other = sorted(name for name in there.keys() & wanted.keys() if there[name] != wanted[name])
    return f"missing {sorted(wanted.keys() - there.keys())}, left {sorted(there.keys() - wanted.keys())}, other {other}"


class Fuzz:
    """Prepared starts and references of every scene, in a temporary folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.start: dict[str, Path | None] = {}
        self.reference: dict[str, dict[str, bytes]] = {}
        self.operations: dict[str, int] = {}
        logs = folder / "logs"
        for scene, (prepare, work) in SCENES.items():
            whole = folder / f"{scene}-whole" / "a.zarr"
            run(fill if scene in DAMAGED else work, whole, [0], logs)
            self.reference[scene] = contents(whole)
            self.start[scene] = None
            if prepare is not None:
                self.start[scene] = folder / f"{scene}-start" / "a.zarr"
                run(prepare, self.start[scene], [0], logs)  # type: ignore[arg-type]
            self.operations[scene] = self.trial(scene, [0])

    def trial(self, scene: str, kills: list[int]) -> int:
        """Run one trial."""
        try:
            return trial(scene, kills, self.reference[scene], self.start[scene], self.folder / "room")
        except Exception as error:
            error.add_note(f"in the scene {scene!r}, with processes killed at {kills}")
            raise

    def several(self, draws: random.Random) -> tuple[str, list[int]]:
        """Draw a scene with two to eight processes, of which about half are killed."""
        scene = draws.choice(list(SCENES))
        count = draws.randint(2, 8)
        last = self.operations[scene]
        return scene, [draws.randint(1, last) if draws.random() < 0.5 else 0 for _ in range(count)]


def main() -> None:
    """Kill at every operation, then at random with several processes until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    end, draws = time.monotonic() + 60 * arguments.minutes, random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as folder:
        fuzz = Fuzz(Path(folder))
        for scene, count in fuzz.operations.items():
            for kill in range(1, count + 1):
                fuzz.trial(scene, [kill])
            print(f"{scene}: killed at each of {count} file operations, nothing lost", flush=True)
        trials = kills = 0
        while time.monotonic() < end:
            scene, chosen = fuzz.several(draws)
            fuzz.trial(scene, chosen)
            trials, kills = trials + 1, kills + sum(map(bool, chosen))
        print(f"{trials} trials of 2 to 8 processes, {kills} of them killed, nothing lost")


if __name__ == "__main__":
    main()
