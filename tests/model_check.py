"""Interleavings of writers, deaths and a reader at a store: one operation at a time, in an order drawn.

    python tests/model_check.py --schedules 10000              at a fake object store
    python tests/model_check.py --schedules 2000 --local       in a folder, whose locks are a fake's
    python tests/model_check.py --schedules 2000 --local --unlockable       in one without locks

Each writer is a thread that runs the real code; before every operation on the store (put, conditional put, list, read,
deletion) and every wait the next thread is drawn. A dead writer does nothing any more, not even what stands in its
``finally``. Time goes on when all that live wait, so that claims of the dead grow old; where writers are stopped, it
goes on at every wait, and living writers lose their claims too. In a folder files are real ones, written in two halves
and dated by the schedule's clock; the locks of the dead are free, as the system frees them.

In every schedule no living writer fails, the reader reads right samples or none, and a last call ends with the bytes of
an undisturbed store.
"""

import argparse
import functools
import os
import random
import shutil
import tempfile
import threading
import time
import types
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from fake_recipe import FakeRecipe, assert_same

from specklegen.core import whole_files
from specklegen.datasets.loading.cache import SpeckleCache
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.store import creation, locks, metadata
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.shards import MissingSample
from specklegen.datasets.store.verify import verify

OPERATIONS = ("pipe_file", "cat_file", "find", "rm_file")
IN_A_FOLDER = [
    *((Path, name) for name in ("read_bytes", "replace", "rename", "unlink", "exists", "is_dir", "is_file", "stat")),
    *((Path, name) for name in ("iterdir", "glob", "rglob", "mkdir", "write_bytes")),
    (os, "open"), (os, "pread"), (os, "utime"), (shutil, "rmtree"),
]  # fmt: skip
SAMPLES = 3
SHARD = 2
LONGEST_WAIT = 4000.0
"""Seconds after which the dead of a schedule keep nobody waiting: some claims of 150 s, one after the other."""


class Small(FakeRecipe):
    """One array and one parameter: few operations a shard."""

    def layout(self) -> dict[str, ArraySpec]:
        level = ArraySpec(dtype="float64", units="photons", description="light level")
        return {"level": level, "parameters": super().layout()["parameters"]}

    @functools.cache  # noqa: B019
    def sample(self, seed: int, split: str, index: int) -> dict[str, Any]:
        sample = super().sample(seed, split, index)
        return {name: sample[name] for name in ("level", "index", "parameters")}


RECIPE = Small(side=1)


class Objects:
    """A fake object store: each operation is one step, each put is whole."""

    def __init__(self) -> None:
        self.all: dict[str, bytes] = {}

    def pipe_file(self, path: str, value: bytes, mode: str = "overwrite") -> None:
        """Put an object; of mode "create", if there is none."""
        if mode == "create" and path in self.all:
            raise FileExistsError(path)
        self.all[path] = value

    def cat_file(self, path: str, start: int | None = None, end: int | None = None) -> bytes:
        """Read an object, or a part of it."""
        try:
            return self.all[path][start:end]
        except KeyError:
            raise FileNotFoundError(path) from None

    def find(self, path: str, maxdepth: int | None = None, detail: bool = False) -> Any:
        """List the objects under a path, in so many levels."""
        start, depth = path.rstrip("/") + "/", maxdepth or 99
        names = sorted(name for name in self.all if name.startswith(start) and name[len(start) :].count("/") < depth)
        return {name: {"name": name, "size": len(self.all[name])} for name in names} if detail else names

    def rm_file(self, path: str) -> None:
        """Delete an object."""
        if self.all.pop(path, None) is None:
            raise FileNotFoundError(path)

    def invalidate_cache(self) -> None:
        """Do nothing: no list is kept."""


class Address:
    """What the library asks of a UPath, without what that costs: half the time of a schedule."""

    __slots__ = ("path",)
    protocol = "fake"
    fs = Objects()

    def __init__(self, path: str) -> None:
        self.path = path

    @property
    def name(self) -> str:
        """Return the last part of the path."""
        return self.path.rsplit("/", 1)[1]

    def joinpath(self, *parts: str) -> "Address":
        """Return the address of something under this one."""
        return Address("/".join((self.path, *parts)))

    __truediv__ = joinpath

    def with_name(self, name: str) -> "Address":
        """Return the address of something beside this one."""
        return Address(f"{self.path.rsplit('/', 1)[0]}/{name}")

    def unlink(self) -> None:
        """Delete the object."""
        self.fs.rm_file(self.path)

    def __str__(self) -> str:
        return f"fake:/{self.path}"


class Death(BaseException):
    """The process is gone."""


class Schedule:
    """Threads of which one runs at a time; the next is drawn before each operation.

    Parameters
    ----------
    draws
        Random numbers.
    deaths
        Operations before which each thread dies; 0 for never.
    stopped
        Whether living writers may be stopped for longer than their claims last.
    """

    def __init__(self, draws: random.Random, deaths: list[int], stopped: bool = False) -> None:
        self._draws, self._deaths, self._stay = draws, deaths, draws.choice([0.5, 0.8, 0.95])
        self._turns = [threading.Lock() for _ in deaths]
        for turn in self._turns:
            turn.acquire()
        self._alive, self._steps = [*range(len(deaths))], [0] * len(deaths)
        self._over, self._here = threading.Event(), threading.local()
        self._stopped, self._waiting = stopped, set()
        self.errors: list[BaseException | None] = [None] * len(deaths)
        self.clock = 1e9
        self.time = types.SimpleNamespace(time=self._now, monotonic=self._now, sleep=self._sleep,
                                          perf_counter=time.perf_counter)  # fmt: skip

    def _now(self) -> float:
        return self.clock

    def _sleep(self, seconds: float) -> None:
        self._waiting.add(getattr(self._here, "number", None))
        if self._stopped or self._waiting >= {*self._alive}:
            self.clock += seconds
            self._waiting.clear()
        self.step(waits=True)

    def step(self, waits: bool = False) -> None:
        """Let another thread go on, perhaps; die, perhaps."""
        number = getattr(self._here, "number", None)
        if number is None:
            return
        if not waits:
            self._waiting.discard(number)
        self._steps[number] += 1
        if self._deaths[number] and self._steps[number] >= self._deaths[number]:
            raise Death
        if self._draws.random() > self._stay:
            following = self._draws.choice(self._alive)
            if following != number:
                self._turns[following].release()
                self._turns[number].acquire()

    def atomic(self, act: Callable) -> Callable:
        """Wrap an operation: what it calls itself belongs to it."""

        def wrapped(*arguments: Any, **options: Any) -> Any:
            if getattr(self._here, "inside", False):
                return act(*arguments, **options)
            self.step()
            self._here.inside = True
            try:
                return act(*arguments, **options)
            finally:
                self._here.inside = False

        return wrapped

    def run(self, works: list[Callable[[], None]]) -> None:
        """Run them all to their ends."""

        def body(number: int) -> None:
            self._here.number = number
            self._turns[number].acquire()
            try:
                works[number]()
            except Death:
                pass
            except BaseException as error:
                self.errors[number] = error
            self._alive.remove(number)
            self._turns[self._draws.choice(self._alive)].release() if self._alive else self._over.set()

        threads = [threading.Thread(target=body, args=(number,), daemon=True) for number in range(len(works))]
        for thread in threads:
            thread.start()
        self._turns[self._draws.choice(self._alive)].release()
        assert self._over.wait(60), "no thread goes on"

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Put the schedule in the place of clocks and operations."""
        quiet = types.SimpleNamespace(Event=threading.Event, Thread=_NoHeart)
        with ExitStack() as stack:
            for name in OPERATIONS:
                stack.enter_context(patch.object(Objects, name, self.atomic(getattr(Objects, name))))
            for module in (locks, creation, metadata, whole_files):
                if hasattr(module, "time"):
                    stack.enter_context(patch.object(module, "time", self.time))
                if hasattr(module, "LOOK"):
                    stack.enter_context(patch.object(module, "LOOK", 40.0))
            stack.enter_context(patch.object(locks, "threading", quiet))
            yield

    @contextmanager
    def in_a_folder(self, unlockable: bool) -> Iterator[None]:
        """Put the schedule in the place of operations on files, of their dates and of locks."""
        held: dict[tuple[int, int], int] = {}
        close = os.close

        def lock(descriptor: int, number: int, wait: bool) -> str:
            key = os.fstat(descriptor).st_ino, number
            while not unlockable:
                self.step()
                if held.setdefault(key, descriptor) == descriptor:
                    return "held"
                if not wait:
                    return "busy"
                self._sleep(1.0)
            return "unlockable"

        def closed(descriptor: int) -> None:
            for key in [key for key, owner in held.items() if owner == descriptor]:
                del held[key]
            close(descriptor)

        def dated(act: Callable) -> Callable:
            def wrapped(path: Any, *arguments: Any, **options: Any) -> None:
                act(path, *arguments, **options)
                utime(path, (self.clock, self.clock))

            return wrapped

        def in_halves(path: Path, data: bytes) -> None:
            for some in (data[: len(data) // 2], data):
                self._here.inside = False
                self.step()
                self._here.inside = True
                with open(path, "wb") as file:
                    file.write(some)

        utime = os.utime
        quiet = types.SimpleNamespace(Event=threading.Event, Thread=_NoHeart)
        with ExitStack() as stack:
            ours = {"write_bytes": dated(in_halves), "mkdir": dated(Path.mkdir), "utime": dated(lambda path: None)}
            for owner, name in IN_A_FOLDER:
                act: Any = ours.get(name, getattr(owner, name))
                if name in ("iterdir", "glob", "rglob"):
                    act = _listed(act)
                stack.enter_context(patch.object(owner, name, self.atomic(act)))
            stack.enter_context(patch.object(os, "close", closed))
            stack.enter_context(patch.object(locks, "_lock", lock))
            stack.enter_context(patch.object(whole_files, "_time_in", lambda folder: self.clock))
            for module in (creation, metadata, whole_files):
                if hasattr(module, "time"):
                    stack.enter_context(patch.object(module, "time", self.time))
            stack.enter_context(patch.object(whole_files, "threading", quiet))
            yield


def _listed(act: Callable) -> Callable:
    return lambda *arguments: iter([*act(*arguments)])


class _NoHeart:
    """A heart that does not beat: claims grow old as time goes on."""

    def __init__(self, **_: Any) -> None:
        pass

    def start(self) -> None:
        """Do nothing."""

    def join(self) -> None:
        """Do nothing."""


def write(place: Any, samples: int = SAMPLES) -> None:
    """Begin, fill and grow the store."""
    generate(RECIPE, samples=samples, shard_samples=SHARD, folder=place, processes=1)


def read(place: Any) -> None:
    """Read what is there, three times."""
    for _ in range(3):
        try:
            cache = SpeckleCache(place)
        except ValueError as error:
            if "a folder that holds a store" in str(error) or "whose creation has ended" in str(error):
                continue
            raise
        for n in range(len(cache)):
            try:
                sample = cache.numpy(n) | {"index": np.int64(n)}
            except MissingSample:
                continue
            assert_same(sample, RECIPE.sample(0, "train", n))


def contents(place: Any) -> dict[str, bytes]:
    """Every object of the store but claims."""
    if isinstance(place, Path):
        files = [file for file in place.rglob("*") if file.is_file()]
        return {str(file.relative_to(place)): file.read_bytes() for file in files}
    start = len(place.path.rstrip("/")) + 1
    names = [name for name in place.fs.find(place.path) if "/claims/" not in name]
    return {name[start:]: place.fs.cat_file(name) for name in names}


def reference(folder: Path | None = None) -> dict[int, dict[str, bytes]]:
    """Contents of undisturbed stores of each length."""
    stores = {}
    for samples in (SAMPLES, SAMPLES + 2):
        name = f"whole{samples}.zarr"
        place = Address(f"/model/{name}") if folder is None else folder / name
        write(place, samples)
        stores[samples] = contents(place)
    return stores


def check(
    seed: int, whole: dict[int, dict[str, bytes]], ahead: bool = False, stopped: bool = False, place: Any = None,
    unlockable: bool = False,
) -> None:  # fmt: skip
    """Run one schedule: two or three writers to one or two lengths, of which up to two die, and perhaps a reader."""
    draws = random.Random(seed)
    local = place is not None
    Address.fs.all.clear()  # of a schedule that broke a law
    place = Address(f"/model/{seed}.zarr") if place is None else place
    lengths = [draws.choice([SAMPLES, SAMPLES + 2]) for _ in range(draws.choice([2, 2, 3]))]
    deaths = [draws.choice([0, draws.randint(1, 25), draws.randint(1, 140)]) for _ in lengths]
    works: list[Callable[[], None]] = [lambda samples=samples: write(place, samples) for samples in lengths]
    if draws.random() < 0.3:
        works.append(lambda: read(place))
        deaths.append(0)
    if local:
        deaths = [4 * death for death in deaths]
    schedule = Schedule(draws, deaths, stopped)
    if local:
        schedule.clock = time.time()  # the system dates folders itself
    start = schedule.clock
    with schedule.in_a_folder(unlockable) if local else schedule.installed():
        if not local and ahead and draws.random() < 0.5:
            place.fs.pipe_file(f"{place.path}/valid/claims/1", f"{schedule.clock + 86400:.3f}".encode())
        schedule.run(works)
        for error in schedule.errors:
            if error is not None:
                raise error
        longest = max(lengths)
        if local:
            schedule.clock += 2 * whole_files.AGE  # what the dead left is swept
        write(place, longest)
        assert schedule.clock < start + LONGEST_WAIT + local * 2 * whole_files.AGE, "waits for a dead claim for hours"
    assert contents(place) == whole[longest], "other bytes"
    assert verify(place).sound
    if local:
        assert sorted(file.name for file in place.parent.iterdir()) == sorted([place.name, f"{seed}.card.md"])
        shutil.rmtree(place.parent)
        return
    assert {name for name in place.fs.all if name.startswith(f"/model/{seed}.")} - {*place.fs.find(place.path)} == {
        f"/model/{seed}.card.md"
    }


def run(
    schedules: int, seed: int = 0, ahead: bool = True, stopped: bool = False, folder: Path | None = None,
    unlockable: bool = False,
) -> dict[int, str]:  # fmt: skip
    """Check schedules, at a fake object store or in a folder; return the words of those that broke a law, by seed."""
    if folder is not None:
        folder.mkdir(exist_ok=True)
    whole, broken = reference(folder), {}
    for number in range(seed, seed + schedules):
        place = None if folder is None else folder / str(number) / f"{number}.zarr"
        if place is not None:
            place.parent.mkdir()
        try:
            check(number, whole, ahead, stopped, place, unlockable)
        except Exception as error:
            broken[number] = f"{type(error).__name__}: {str(error)[:300]}"
    return broken


def _shared(pieces: list[range], folder: Path | None, **options: Any) -> dict[int, str]:
    """Check ranges of schedules, each in a process of its own."""
    with ProcessPoolExecutor(len(pieces), get_context("fork")) as pool:
        works = [
            pool.submit(run, len(piece), piece.start, folder=folder and folder / str(piece.start), **options)
            for piece in pieces
        ]
        return {seed: words for work in works for seed, words in work.result().items()}


def main() -> None:
    """Check as many as are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--schedules", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--stopped", action="store_true", help="writers may be stopped for longer than claims last")
    parser.add_argument("--local", action="store_true", help="in a folder")
    parser.add_argument("--unlockable", action="store_true", help="in one whose files cannot be locked")
    arguments = parser.parse_args()
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        ends = [arguments.seed + arguments.schedules * n // arguments.processes for n in range(arguments.processes + 1)]
        broken = _shared([range(*ends[n : n + 2]) for n in range(arguments.processes)], stopped=arguments.stopped,
                         folder=Path(folder) if arguments.local else None, unlockable=arguments.unlockable)  # fmt: skip
    for seed, words in [*broken.items()][:10]:
        print(seed, words)
    print(f"{arguments.schedules} schedules in {time.perf_counter() - begin:.0f} s, {len(broken)} break a law")


if __name__ == "__main__":
    main()
