"""Filling a store: every shard rendered once, by as many processes and machines as there are.

What is there is kept; what is missing is rendered. Several calls may fill one store at the same time, on one
machine or over a shared folder: each claims the shards that it renders. A call returns when all its shards
are there.
"""

import contextlib
import os
import pickle
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from specklegen.core.arguments import file_path, whole_number, whole_numbers
from specklegen.core.errors import counted, reject
from specklegen.core.parallel import MOST_THREADS, thread_count
from specklegen.core.registered import require_importable
from specklegen.core.whole_files import sweep
from specklegen.datasets.sample_schema import Renderable
from specklegen.datasets.store.card import write_card
from specklegen.datasets.store.creation import grown, open_for
from specklegen.datasets.store.files import reaching, writing
from specklegen.datasets.store.filling import GenerationError, Outcome, fill_shard
from specklegen.datasets.store.info import info
from specklegen.datasets.store.places import is_remote, place_of
from specklegen.datasets.store.reading import SampleReader
from specklegen.datasets.store.shards import DamagedShard, ForeignShard, MissingSample, UnlistedSample
from specklegen.datasets.store.store import Store
from specklegen.datasets.store.timing import processes_for
from specklegen.datasets.workers import end_with_parent, prepare_worker, worker_context

if TYPE_CHECKING:
    from distributed import Client
    from distributed.deploy import Cluster

_POOL_RESTARTS = 2


def generate(
    recipe: Renderable, seed: int = 0, split: str = "train", *, samples: int, folder: str | os.PathLike,
    dtype: str = "uint16", shard_samples: int | None = None, progress: Callable[[int, int], None] | None = None,
    processes: int | None = None, shard_range: tuple[int, int] = (0, 1),
    cluster: "str | Client | Cluster | None" = None, notes: str = "",
) -> dict[str, Any]:  # fmt: skip
    """Fill the store at ``folder`` with samples 0 to ``samples`` - 1, keeping those that are there.

    Parameters
    ----------
    recipe, seed, split
        What to render.
    samples : int
        Number of samples; more than the store holds makes it grow.
    folder : path
        The folder of the store, by custom ending in ``.zarr``; or an address that fsspec knows, such as
        ``s3://bucket/a.zarr`` (extra ``remote``), a ``UPath`` where it needs options.
    dtype : {"uint16", "float32"}
        How counts are stored; without loss either way. Other arrays keep the type of the layout.
    shard_samples : int, optional
        Samples in a shard of a new store; by default 32 MB, and at least sixteen shards.
    progress : callable, optional
        Called with (samples done, samples asked for) after every shard.
    processes : int, optional
        Worker processes; by default the cores that this process may use, or none where what is missing takes less time
        than they save, by a few samples rendered now. 1 renders in this process.
    shard_range : (i, n)
        Do part i of n equal parts, 0 <= i < n: for n machines with a shared folder. Of the store such a call reads
        and reports its own shards alone.
    cluster : str, Client or Cluster, optional
        Render on a Dask cluster: :mod:`specklegen.datasets.store.dask`.
    notes : str
        Markdown for the data card of a new store, such as what the splits share.

    Returns
    -------
    dict
        What :func:`specklegen.datasets.store.info.info` says of the store, or of its own shards where it does a part,
        and rendered: samples that this very call rendered, not those that another one did beside it.

    Raises
    ------
    RuleError
        If the folder holds something else, or an argument breaks a rule.
    GenerationError
        If samples could not be rendered: the (seed, index) of the first of each shard; the rest is done. If the disk
        is full: at once.

    Examples
    --------
    >>> import tempfile
    >>> from specklegen.datasets import generate, load_recipe
    >>> recipe = load_recipe("through-slab", {"material": {"kernel_paths": 1000}})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     generate(recipe, samples=4, folder=f"{folder}/a.zarr", processes=1)["done"]
    4
    """
    if not isinstance(recipe, Renderable):
        reject("generate.recipe", "a recipe", recipe, "Read one with load_recipe.")
    # Python's integers: those of NumPy are no JSON, and overflow.
    samples = whole_number("generate.samples", samples, 1)
    if shard_samples is not None:
        remedy = "Leave it out for shards of 32 MB."
        shard_samples = whole_number("generate.shard_samples", shard_samples, 1, remedy=remedy)
    if processes is not None:
        processes = whole_number("generate.processes", processes, 1, MOST_THREADS)
    part, parts = _part(shard_range)
    if cluster is not None and processes is not None:
        reject("generate.processes", "left out with a cluster, which has its own", processes)
    if not is_remote(folder):
        file_path("generate.folder", folder)
    there = place_of(folder)
    if not is_remote(there):
        there = there.resolve()  # links are followed once: they may be moved while this runs
    with reaching(there):
        share = open_for(recipe, seed, split, dtype, there, samples, shard_samples, notes, (part, parts))
        store, shards, missing = share.store, share.shards, share.missing
        if parts == 1:  # which looks through all of the store
            sweep(store.temporaries())
        with writing(store.folder):
            write_card(store)
        missing = sorted([*missing, *unlisted(store, [shard for shard in shards if shard not in set(missing)])])
    total = sum(len(store.span(shard)) for shard in shards)
    done = total - sum(len(store.span(shard)) for shard in missing)
    report = progress or (lambda done, total: None)
    report(done, total)
    failures, rendered = [], 0
    if cluster is None:
        if processes is None and missing:
            processes = processes_for(recipe, seed, split, total - done)
        run = partial(_run, store, recipe, processes=thread_count(processes))
    else:
        from specklegen.datasets.store.dask import run as run_on

        run = partial(run_on, cluster, store, recipe)
    with contextlib.closing(_outcomes(run, missing)) as outcomes:
        for outcome in outcomes:
            if outcome.final:
                raise GenerationError(
                    f"Writing to {store.folder} failed after {done} of {total} samples.\n{outcome.message}\n"
                    "Free some space, then run the same command again: it resumes."
                )
            if outcome.state == "failed":
                failures.append(outcome.message)
                continue
            rendered += len(store.span(outcome.shard)) if outcome.state == "written" else 0
            done += len(store.span(outcome.shard))
            report(done, total)
    if failures:
        shown = "\n".join(failures[:5])
        raise GenerationError(
            f"{len(failures)} of {counted(len(shards), 'shard')} failed; the others are stored. Remove the cause, "
            "then run the "
            f"same command again: it resumes.\n{shown}"
        )
    with reaching(store.folder):
        if is_remote(store.folder) and Store(store.folder).samples < samples:
            grown(store, samples)
        return info(store.folder, shards if parts > 1 else None) | {"rendered": rendered}


def unlisted(store: Store, shards: Sequence[int]) -> list[int]:
    """Check that listed shards hold what they should: read one sample of each, with its seal.

    Returns
    -------
    list of int
        Shards that the ledger lists no more: another process took them off meanwhile, to write them anew.

    Raises
    ------
    GenerationError
        Naming the first few, and the remedy.
    """
    reader, foreign, taken_off = SampleReader(store), [], []
    for shard in shards:
        try:
            reader.read(store.span(shard)[0])
        except UnlistedSample:
            taken_off.append(shard)
        except (ForeignShard, MissingSample) as error:
            foreign.append(f"shard {shard}: {error}")
        except DamagedShard:
            continue  # `verify` tells of it, and mends it
    if foreign:
        shown = "\n".join(foreign[:5])
        raise GenerationError(f"{counted(len(foreign), 'shard')} of {store.folder} differ from its ledger. Repair the "
                              f"store: specklegen store verify FOLDER --repair RECIPE.\n{shown}")
    return taken_off


def _part(shard_range: tuple[int, int]) -> tuple[int, int]:
    """The part to do, and of how many."""
    both = whole_numbers("generate.shard_range", shard_range)
    if len(both) != 2 or not both[0] < both[1]:
        reject("generate.shard_range", "(i, n) with 0 <= i < n", shard_range,
               "Parts count from 0: the last of four is 3/4 on the command line.")  # fmt: skip
    return both[0], both[1]


def _outcomes(run: Callable[..., Iterator[Outcome]], shards: list[int]) -> Generator[Outcome, None, None]:
    """Yield an outcome for each shard: first those that are free, then those that others had claimed."""
    taken: list[int] = []
    for outcome in run(shards=shards, wait=False):
        if outcome.state == "busy":
            taken.append(outcome.shard)
        else:
            yield outcome
    yield from run(shards=taken, wait=True)


def _run(store: Store, recipe: Renderable, shards: list[int], processes: int, wait: bool) -> Iterator[Outcome]:
    if min(processes, len(shards)) <= 1:
        yield from (fill_shard(store, recipe, shard, wait) for shard in shards)
        return
    left = dict.fromkeys(shards)
    for restart in range(_POOL_RESTARTS + 1):
        before = len(left)
        try:
            for outcome in _pooled(store, recipe, list(left), processes, wait):
                del left[outcome.shard]
                yield outcome
            return
        except BrokenProcessPool:
            if len(left) == before or restart == _POOL_RESTARTS:
                raise GenerationError(
                    f"Worker processes died with {counted(len(left), 'shard')} left. Either memory ran out: use fewer "
                    "processes. Or the script that calls generate runs again in each worker: put the call under "
                    '`if __name__ == "__main__":`. Then run it again; it resumes.'
                ) from None


_job: tuple[Store, Renderable, str] | None = None


def _start_worker(folder: Path, samples: int, fingerprint: str, recipe: bytes) -> None:
    global _job
    end_with_parent()
    prepare_worker()
    store = Store(folder)
    if store.fingerprint == fingerprint:  # others may be growing it, to other lengths
        store = grown(store, samples)
    _job = store, pickle.loads(recipe), fingerprint


def _fill_here(shard: int, wait: bool) -> Outcome:
    assert _job is not None
    store, recipe, fingerprint = _job
    try:
        store.require(fingerprint)
    except ForeignShard as error:
        return Outcome(shard, "failed", message=f"shard {shard}: {error}")
    return fill_shard(store, recipe, shard, wait)


def _pooled(store: Store, recipe: Renderable, shards: list[int], processes: int, wait: bool) -> Iterator[Outcome]:
    require_importable(getattr(recipe, "own_classes", tuple)())
    recipe.sample(store.seed, store.attributes["identity"]["split"], 0)  # compiles once
    pool = ProcessPoolExecutor(
        min(processes, len(shards)), mp_context=worker_context(), initializer=_start_worker,
        initargs=(store.folder, store.samples, store.fingerprint, pickle.dumps(recipe)),
    )  # fmt: skip
    try:
        futures: list[Future[Outcome]] = [pool.submit(_fill_here, shard, wait) for shard in shards]
        broken = None
        for future in as_completed(futures):
            try:
                outcome = future.result()
            except BrokenProcessPool as error:
                broken = error  # after those that were done
                continue
            yield outcome
        if broken:
            raise broken
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
