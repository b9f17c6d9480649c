"""Small stores of a fake recipe, for the tests of data sets."""

import multiprocessing
import os
import subprocess
import sys

import numpy as np
from fake_recipe import FakeRecipe, assert_same

from specklegen.core.whole_files import AGE
from specklegen.datasets.loading.cache import SpeckleCache
from specklegen.datasets.store.generate import generate

TIMEOUT = 120


class Forked(multiprocessing.get_context("fork").Process):
    """A process that imports nothing; it is waited for as one that runs a program."""

    def wait(self, timeout):
        self.join(timeout)
        return self.exitcode


def make(folder, recipe=None, **options):
    settings = {"samples": 22, "shard_samples": 5, "processes": 1} | options
    return generate(recipe or FakeRecipe(), folder=folder, **settings)


def assert_holds(folder, recipe, samples, seed=0, split="train"):
    """Require samples 0 to ``samples`` - 1 to be in the store, to the bit."""
    cache = SpeckleCache(folder)
    for n in range(samples):
        assert_same(cache.numpy(n) | {"index": np.int64(n)}, recipe.sample(seed, split, n))


def contents(folder):
    """Return every file of a store but the claims, by its path."""
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file.name != "locks"]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def age(folder):
    """Date what is not yet whole, in and beside the stores of a folder, as if nobody had touched it for long."""
    for path in [*folder.rglob("*.partial"), *folder.rglob("*.creating")]:
        then = path.stat().st_mtime - 2 * AGE
        os.utime(path, (then, then))


def claiming(file, number):
    """Start a process that claims a piece and keeps it until it is killed."""
    code = (
        "import sys, time; from pathlib import Path; from specklegen.datasets.store.locks import claim\n"
        "with claim(Path(sys.argv[1]), int(sys.argv[2])) as state: print(state, flush=True); time.sleep(600)"
    )
    command = [sys.executable, "-c", code, file, str(number)]
    other = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None
    assert other.stdout.readline().strip() == "held"
    return other
