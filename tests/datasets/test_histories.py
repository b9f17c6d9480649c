"""Histories: whatever a program has done before, a sample's bits depend on (recipe, seed, split, number) alone.

    HISTORIES=100 FUZZ_SEED=1 pytest tests/datasets/test_histories.py      # as many others
    PYTHONPATH=tests python tests/datasets/test_histories.py 10000 1       # 250 in a process

A machine redefines classes, exchanges folders and links, nests contexts, samples in threads, forks and copies sent by
pickle, leaves garbage in memory, samples of other sizes and seeds, forgets some or all of what is kept, changes what it
was handed and whatever state there is. Before all that every sample is rendered once: each later one has these bits, or
is refused. A history begins with what the one before it has left in memory.
"""

import contextlib
import functools
import hashlib
import io
import os
import pickle
import random
import signal
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp

import numpy as np
import pytest
import torch
from forgotten import forget_some
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule, run_state_machine_as_test
from own_scatterers import defined, forgotten
from PIL import Image
from quick_recipes import quick_recipe
from threadpoolctl import threadpool_limits

from specklegen.core import shielded
from specklegen.core.errors import RuleError
from specklegen.datasets import SpeckleCache, SpeckleStream
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.datasets.recipes.parts import particles
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.shards import DamagedShard, MissingSample
from specklegen.paths import pilot, roulette
from specklegen.samplers.stationary import stationarity

HISTORIES, SEED = int(os.environ.get("HISTORIES", "10")), os.environ.get("FUZZ_SEED")
STEPS, PIECE = 20, 250
REFUSED = (RuleError, MissingSample, DamagedShard, pickle.PicklingError)
LOBES = {"narrow": "(1.5 + cos) ** 2 + 0 * self.power", "wide": "1.5 + cos + 0 * self.power"}  # 200 nodes: soon made
KINDS = ("own", "slab", "glass", "pictures")
SEEDS, NUMBERS = st.integers(0, 1), st.integers(0, 2)
ONE_SLAB = {"thickness": 500.0, "optical_depth": 5.0}  # media at the ends of all ranges are what takes the time
SMALL = {"camera": {"shape": [16, 16]}, "samples": {"train": 3}}


def loaded(kind, pictures):
    """A recipe of a kind, as its parts are defined now."""
    traced = {"material": {"kernel_paths": 300}}
    if kind == "own":
        lobe = {"type": "Lobe", "power": {"uniform": [1.0, 2.0]}}
        own = {"material": {"kernel_paths": 300, "scatterer": lobe} | ONE_SLAB}
        return quick_recipe("tilt-stack", **SMALL, **own, media="new")
    if kind == "slab":
        return quick_recipe("through-slab", **SMALL, **traced)
    if kind == "glass":
        return quick_recipe("ground-glass", **SMALL)
    return quick_recipe("through-slab", **SMALL, **traced, objects={"type": "Folder", "path": str(pictures)})


def bits(value):
    """SHA-256 of a sample or batch: names, types, shapes, bytes."""
    digest = hashlib.sha256()

    def feed(each):
        if isinstance(each, dict):
            for name in sorted(each):
                digest.update(name.encode())
                feed(each[name])
        else:
            array = np.asarray(each)
            digest.update(f"{array.dtype} {array.shape}".encode() + array.tobytes())

    feed(value)
    return digest.hexdigest()


def picture_folders(place):
    for number, name in enumerate(("pictures", "others")):
        (place / name).mkdir()
        for n, picture in enumerate(drawn_pictures(number)):
            (place / name / f"{n}.png").write_bytes(picture)


@functools.cache
def drawn_pictures(seed):
    """Nine pictures, as the bytes of their files."""
    written = []
    for picture in np.random.default_rng(seed).integers(0, 255, (9, 12, 12), dtype=np.uint8):
        Image.fromarray(picture).save(file := io.BytesIO(), "png")
        written.append(file.getvalue())
    return written


class Truth:
    """Every sample, rendered before anything has happened."""

    def __init__(self):
        self.place = Path(mkdtemp(prefix="histories-"))
        picture_folders(self.place)
        self.samples, self.batches, self.recipes = {}, {}, {}
        for name, source in LOBES.items():
            defined(source)
            self.add("own", name)
        for kind in KINDS[1:3]:
            self.add(kind, "")
        for name in ("pictures", "others"):
            self.add("pictures", name)
        for kind in KINDS[:2]:  # stores to move links to, which nobody writes into
            for chosen in (0, 1):
                stored(kind, chosen, self.place)

    def add(self, kind, name):
        recipe = loaded(kind, self.place / (name or "pictures"))
        self.recipes[kind, name] = recipe.fingerprint()
        for chosen in (0, 1):
            for number in range(3):
                sample = recipe.sample(chosen, "train", number)
                self.samples[recipe.fingerprint(), chosen, number] = bits(sample)
            if kind == "slab":
                made = SpeckleGenerator(recipe, chosen, "train")([0, 1, 2])
                self.batches[recipe.fingerprint(), chosen] = bits(made)


def stored(kind, chosen, place):
    """The folder of a store, filled if it is not there."""
    folder = place / f"{kind}-{chosen}.zarr"
    generate(loaded(kind, None), seed=chosen, samples=3, folder=folder, processes=1, shard_samples=1)
    return folder


def switched(read, write, value):
    @contextlib.contextmanager
    def context():
        before = read()
        write(value)
        try:
            yield
        finally:
            write(before)

    return context


@contextlib.contextmanager
def openmp_told_alone():
    """Two threads of torch, of which another library has told OpenMP that there is one."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with threadpool_limits(1, user_api="openmp"):
            yield
    finally:
        torch.set_num_threads(before)


CONTEXTS = {
    "autocast": lambda: torch.autocast("cpu", dtype=torch.bfloat16),
    "no autocast": lambda: torch.autocast("cpu", enabled=False), "meta": lambda: torch.device("meta"),
    "cpu": lambda: torch.device("cpu"), "inference": torch.inference_mode, "gradients": torch.enable_grad,
    "errors": lambda: np.errstate(all="raise"), "silence": lambda: np.errstate(all="ignore"),
    "double": switched(torch.get_default_dtype, torch.set_default_dtype, torch.float64),
    "half": switched(torch.get_default_dtype, torch.set_default_dtype, torch.bfloat16),
    "deterministic": switched(torch.are_deterministic_algorithms_enabled, torch.use_deterministic_algorithms, True),
    "two threads": switched(torch.get_num_threads, torch.set_num_threads, 2), "OpenMP told alone": openmp_told_alone,
    "coarse": switched(torch.get_float32_matmul_precision, torch.set_float32_matmul_precision, "medium"),
    "without oneDNN": switched(lambda: torch.backends.mkldnn.enabled,
                               lambda value: torch.backends.mkldnn.set_flags(value), False),
    "other order of products": switched(lambda: torch.backends.opt_einsum.enabled,
                                        lambda value: setattr(torch.backends.opt_einsum, "enabled", value), False),
    "short buffers": switched(np.getbufsize, np.setbufsize, 16),
    "denormals": switched(lambda: bool(np.float64(2e-308) / 2 == 0), torch.set_flush_denormal, True),
}  # fmt: skip
STATES = {
    "NumPy's generator": lambda n: np.random.seed(n),  # noqa: NPY002
    "torch's generator": torch.manual_seed,
    "Python's generator": random.seed,
    "environment": lambda n: os.environ.update(OMP_NUM_THREADS=str(n + 1), MKL_NUM_THREADS=str(n + 1)),
    "folder": lambda n: os.chdir(("/", "/tmp")[n % 2]),  # noqa: S108
    "printing": lambda n: np.set_printoptions(precision=n + 1),
}


def leave_garbage(value):
    """Fill memory with a value and free it: what is allocated next, and not written, holds it."""
    for power in range(6, 23):
        for _ in range(4):
            np.full(2**power // 8, value)
            torch.full((2**power // 8,), value, dtype=torch.float64)


def gone(threads):
    """Wait for threads to end for the system too, a little after they have for Python. Until then they give back what
    MKL keeps for them, under a lock that a fork would copy as it is held, for ever."""
    tasks, deadline = Path("/proc/self/task"), time.monotonic() + 60
    while tasks.exists() and {str(each.native_id) for each in threads} & {task.name for task in tasks.iterdir()}:
        assert time.monotonic() < deadline
        time.sleep(1e-3)


class Histories(RuleBasedStateMachine):
    """What a program may do between two samples."""

    truth: Truth
    count = 0  # of them

    def __init__(self):
        super().__init__()
        Histories.count += 1
        self.home, self.environment = Path.cwd(), dict(os.environ)
        self.place = Path(mkdtemp(prefix="history-"))
        picture_folders(self.place)
        self.contexts, self.recipes, self.caches, self.sent = [], [], [], []
        defined(LOBES["narrow"])

    def teardown(self):
        while self.contexts:
            self.contexts.pop().__exit__(None, None, None)
        os.chdir(self.home)
        os.environ.clear()
        os.environ.update(self.environment)
        np.set_printoptions(precision=8)
        self.caches.clear()
        rmtree(self.place, ignore_errors=True)

    def check(self, recipe, chosen, number):
        """One sample of a recipe, which has its bits or is refused."""
        try:
            sample = recipe.sample(chosen, "train", number)
        except REFUSED:
            return None
        assert bits(sample) == self.truth.samples[recipe.fingerprint(), chosen, number]
        return sample

    @rule(name=st.sampled_from(sorted(LOBES)))
    def redefine(self, name):
        defined(LOBES[name])

    @initialize(kind=st.sampled_from(KINDS))
    def load_the_first(self, kind):
        """So that no history goes without samples, or without a store that is open."""
        self.load(kind)
        self.link(self.truth.place / "slab-0.zarr")
        self.open_the_latest()

    def link(self, folder):
        link = self.place / "latest"
        link.unlink(missing_ok=True)
        link.symlink_to(folder)

    @rule(kind=st.sampled_from(KINDS))
    def load(self, kind):
        recipe = loaded(kind, self.place / "pictures")
        assert recipe.fingerprint() in self.truth.recipes.values()
        self.recipes.append(recipe)

    @precondition(lambda self: self.recipes)
    @rule(which=st.integers(0), chosen=SEEDS, number=NUMBERS)
    def sample(self, which, chosen, number):
        self.check(self.recipes[which % len(self.recipes)], chosen, number)

    @precondition(lambda self: self.recipes)
    @rule(which=st.integers(0), chosen=SEEDS, number=NUMBERS)
    def change_what_was_handed_out(self, which, chosen, number):
        recipe = self.recipes[which % len(self.recipes)]
        sample = self.check(recipe, chosen, number)
        for name, value in (sample or {}).items():
            if name == "parameters":
                value.clear()
            elif np.ndim(value):
                value[...] = 7
        self.check(recipe, chosen, number)

    @rule(chosen=SEEDS)
    def generate_on_tensors(self, chosen):
        recipe = loaded("slab", None)
        made = SpeckleGenerator(recipe, chosen, "train")([0, 1, 2])
        assert bits(made) == self.truth.batches[recipe.fingerprint(), chosen]

    @precondition(lambda self: self.recipes)
    @rule(which=st.integers(0), chosen=SEEDS)
    def stream(self, which, chosen):
        recipe = self.recipes[which % len(self.recipes)]
        try:
            batch = next(iter(SpeckleStream(recipe, chosen, batch_size=3).loader()))
        except REFUSED:
            return
        single = {name: value[1].numpy() for name, value in batch.items() if name != "parameters"}
        parameters = {name: float(values[1]) for name, values in batch["parameters"].items()}
        expected = recipe.sample(chosen, "train", 1)
        assert bits({**single, "parameters": parameters}) == bits({
            **{name: value for name, value in expected.items() if name not in ("parameters", "file")},
            "parameters": {name: float(value) for name, value in expected["parameters"].items()},
        })  # fmt: skip

    @rule(name=st.sampled_from(sorted(CONTEXTS)))
    def enter(self, name):
        if len(self.contexts) < 6:
            context = CONTEXTS[name]()
            context.__enter__()
            self.contexts.append(context)

    @precondition(lambda self: self.contexts)
    @rule()
    def leave(self):
        self.contexts.pop().__exit__(None, None, None)

    @rule(name=st.sampled_from(sorted(STATES)), n=st.integers(0, 3))
    def change_state(self, name, n):
        STATES[name](n)

    @rule(value=st.sampled_from([np.nan, 1e300, -1.0]))
    def garbage(self, value):
        leave_garbage(value)

    @rule(shape=st.sampled_from([9, 9, 9, 9, 9, 9, 12, 17, 24]), chosen=st.integers(2, 9))
    def sample_something_else(self, shape, chosen):
        """Of another size and seed, which takes its place in what is kept."""
        slab = {"material": {"kernel_paths": 300, "g": 0.9} | ONE_SLAB}
        quick_recipe("tilt-stack", **SMALL | {"camera": {"shape": [shape, 16]}} | slab).sample(chosen, "validation", 0)

    @rule(drawn=st.integers(0, 2**32 - 1))
    def forget(self, drawn):
        """Some of what is kept, so that it meets what is older; one time in 32 all of it."""
        forget_some(drawn >> 5, 0.03 if drawn % 32 else 1.0)

    @precondition(lambda self: self.recipes)
    @rule(wanted=st.lists(st.tuples(st.integers(0), SEEDS, NUMBERS), min_size=2, max_size=4),
          drawn=st.integers(0, 2**32 - 1))  # fmt: skip
    def sample_in_threads(self, wanted, drawn):
        self.forget(drawn)
        wrong = []

        def one(which, *where):
            try:
                self.check(self.recipes[which % len(self.recipes)], *where)
            except BaseException as error:  # noqa: BLE001, for the thread that waits
                wrong.append(error)

        threads = [threading.Thread(target=one, args=each) for each in wanted]
        for each in threads:
            each.start()
        for each in threads:
            each.join()
        gone(threads)
        if wrong:
            raise wrong[0]

    @precondition(lambda self: self.recipes)
    @rule(which=st.integers(0), chosen=SEEDS, number=NUMBERS)
    def sample_in_a_fork(self, which, chosen, number):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of forks beside threads, which is what is tried
            child = os.fork()
        if not child:
            signal.alarm(300)  # one that hangs is one that fails
            code = 1
            with contextlib.suppress(BaseException):
                self.check(self.recipes[which % len(self.recipes)], chosen, number)
                code = 0
            os._exit(code)
        assert os.waitpid(child, 0)[1] == 0

    @precondition(lambda self: self.recipes)
    @rule(which=st.integers(0))
    def send(self, which):
        sent = None  # kept all the same: which rules come next must not depend on what other histories have left
        with contextlib.suppress(*REFUSED):
            sent = pickle.dumps(self.recipes[which % len(self.recipes)])
        self.sent.append(sent)

    @precondition(lambda self: self.sent)
    @rule(which=st.integers(0))
    def receive(self, which):
        sent = self.sent[which % len(self.sent)]
        with contextlib.suppress(*REFUSED):
            if sent is not None:
                self.recipes.append(pickle.loads(sent))

    @rule()
    def exchange_folders(self):
        for old, new in (("pictures", "meanwhile"), ("others", "pictures"), ("meanwhile", "others")):
            (self.place / old).rename(self.place / new)

    @rule(kind=st.sampled_from(KINDS[:2]), chosen=SEEDS, fill=st.sampled_from([True, False, False, False]))
    def store(self, kind, chosen, fill):
        """Move the link to a store, one that is filled now or one from before."""
        folder = self.truth.place / f"{kind}-{chosen}.zarr"
        if fill:
            with contextlib.suppress(RuleError):  # it may be there, of another class of the same name
                folder = stored(kind, chosen, self.place)
        self.link(folder)

    @rule()
    def open_the_latest(self):
        opened = SpeckleCache(self.place / "latest")
        self.caches.append((opened, opened.store.attributes["recipe_fingerprint"], opened.identity["seed"]))

    @precondition(lambda self: self.caches)
    @rule(which=st.integers(0), number=NUMBERS)
    def send_a_cache(self, which, number):
        opened, *identity = self.caches[which % len(self.caches)]
        try:
            self.caches.append((pickle.loads(pickle.dumps(opened)), *identity))
        except REFUSED:  # the link leads to another store by now
            return
        self.check_read(len(self.caches) - 1, number)

    @precondition(lambda self: self.caches)
    @rule(which=st.integers(0), number=NUMBERS)
    def read(self, which, number):
        self.check_read(which, number)

    def check_read(self, which, number):
        opened, fingerprint, chosen = self.caches[which % len(self.caches)]
        try:
            found = opened.numpy(number)
        except REFUSED:
            return
        found["index"] = np.int64(found["index"])
        assert bits(found) == self.truth.samples[fingerprint, chosen, number]


@contextlib.contextmanager
def changed(owner, name, value):
    """With another attribute of a module or class."""
    before = vars(owner)[name]
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, before)


def handed_out_again():
    """A recipe that keeps its samples, and hands the same arrays out again."""
    kept, pure = {}, Recipe.sample

    def sample(self, *which):
        key = (self.fingerprint(), *which)
        kept[key] = kept[key] if key in kept else pure(self, *which)
        return kept[key]

    return changed(Recipe, "sample", sample)


def kept_without_the_seed():
    """A recipe whose kept samples are known by recipe and number alone."""
    kept, pure = {}, Recipe.sample

    def sample(self, chosen, *which):
        key = (self.fingerprint(), *which)
        kept[key] = kept[key] if key in kept else bytes_of(pure(self, chosen, *which))
        return pickle.loads(kept[key])

    return changed(Recipe, "sample", sample)


bytes_of = pickle.dumps


def opened_anew(self, state):
    """Unpickle a cache that reads whatever is there now."""
    self.__dict__.update(state)
    self._open()


DEPENDENCES = {
    "a sample that is kept and handed out": handed_out_again, "a sample kept without its seed": kept_without_the_seed,
    "torch as the program left it": lambda: changed(shielded, "_shield_torch", lambda stack: None),
    "a class known by its name": lambda: changed(particles, "_require_code", lambda table, made: None),
    "a pickle without its fingerprint": lambda: changed(SpeckleCache, "__setstate__", opened_anew),
}  # fmt: skip
"""Ways in which a history may decide a sample, introduced deliberately: contexts in which they are there."""


def run(histories, chosen, dependences=()):
    """All histories of a seed, None for those that are always the same; what fails is raised. Then histories with each
    deliberate dependence in turn, until one fails: how many it took is printed. One that is not caught by as many as
    ran without is an error."""
    # Planning is two thirds of a history; of few paths it depends on what happens before as much as of many.
    pilot.PILOT_PATHS, roulette.SLAB_PATHS, roulette.SCENE_PATHS = 128, 64, 64
    stationarity.GLANCE_PATHS = stationarity.FIRST_PATHS = stationarity.MOST_PATHS = stationarity.ENVELOPE_PATHS = 64
    os.environ["SPECKLEGEN_CACHE"] = "kernels:"  # nothing of an earlier history
    Histories.truth = Truth()
    try:
        explore(histories, chosen)
        for name in dependences:
            Histories.count = 0
            with DEPENDENCES[name](), contextlib.redirect_stdout(io.StringIO()):
                caught = fails(histories, chosen)
            print(f"{name}: {'caught' if caught else 'NOT caught'} after {Histories.count} histories", flush=True)
            assert caught, name
    finally:
        forgotten()
        rmtree(Histories.truth.place)


def explore(histories, chosen):
    """Go through histories; what fails is raised."""
    how = settings(max_examples=histories, stateful_step_count=STEPS, deadline=None, database=None,
                   derandomize=chosen is None, suppress_health_check=list(HealthCheck), print_blob=False,
                   phases=[Phase.generate])  # fmt: skip
    machine = Histories if chosen is None else seed(chosen)(Histories)
    run_state_machine_as_test(machine, settings=how)


def fails(histories, chosen):
    """Whether a history fails, which goes on failing or not when it is told again."""
    try:
        explore(histories, chosen)
    except Exception:  # noqa: BLE001, hypothesis's own error where it does not fail again
        return True
    return False


def in_a_process(histories, chosen, dependences=()):
    """In a process of its own: forks hang where OpenMP's threads have been used, as other tests do."""
    path = [str(Path(__file__).parent), *sys.path]
    called = f"import test_histories; test_histories.run({histories}, {chosen}, {dependences!r})"
    return subprocess.run([sys.executable, "-c", f"import sys; sys.path[:] = {path!r}; {called}"], capture_output=True,
                          text=True, check=False, timeout=60 * (20 + histories))  # fmt: skip


@pytest.mark.slow
def test_samples_depend_on_nothing_that_has_happened():
    """And a recipe that hands out what it keeps is caught, by as many histories."""
    done = in_a_process(HISTORIES, None if SEED is None else int(SEED), (next(iter(DEPENDENCES)),))
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_every_deliberate_dependence_on_history_is_caught():
    done = in_a_process(60, 1, tuple(DEPENDENCES))
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count(": caught after") == len(DEPENDENCES)


def main(count, first):
    """So many histories, PIECE in a process; what fails is printed with its seed, and the rest goes on."""
    failed, begun = 0, time.perf_counter()
    for number, done in enumerate(range(0, count, PIECE)):
        some, chosen = min(PIECE, count - done), 10**6 * first + number
        found = in_a_process(some, chosen)
        if found.returncode:
            failed += 1
            print(f"seed {chosen}:\n{found.stdout}{found.stderr}")
        took = (time.perf_counter() - begun) / (done + some)
        print(f"{done + some} histories, {took:.2f} s each, {failed} pieces failed", flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
