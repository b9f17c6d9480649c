"""Filling a store on a Dask cluster (extra ``dask``): the same shards as anywhere else, mapped over its workers.

Shard numbers go out and an outcome of a few hundred bytes comes back; arrays go from the worker that
rendered them straight into the store, whose folder or address every worker must see. The shard of a worker that is lost
is given to another one, and a shard that met an OSError is tried again, as network folders have their
moments. Any other failure would come back the same, and is reported.
"""

import os
import pickle
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from specklegen.core.errors import reject, warn_user

# Workers import this module to find `fill`, which has to be first to say how many threads Numba gets:
# what loads Numba is imported inside functions.
if TYPE_CHECKING:
    from distributed import Client, Future
    from distributed.deploy import Cluster

    from specklegen.datasets.sample_schema import Renderable
    from specklegen.datasets.store.filling import Outcome
    from specklegen.datasets.store.store import Store

RETRIES = 3
"""Times that a shard is tried again after an OSError."""

PATIENCE = 60.0
"""Seconds without an outcome after which workers are counted."""

_ONE_AT_A_TIME = threading.Lock()  # claims exclude processes, not the threads of one


def run(
    cluster: "str | Client | Cluster", store: "Store", recipe: "Renderable", shards: Iterable[int], wait: bool
) -> Iterator["Outcome"]:
    """Fill shards on a cluster; yield what became of each, in the order in which they end.

    Parameters
    ----------
    cluster : str, Client or Cluster
        Address of a scheduler, a client, or a cluster such as ``dask_jobqueue.SLURMCluster``.
    store, recipe
        What to fill, and what with.
    shards : iterable of int
        Which shards.
    wait : bool
        Wait for shards that another process is at, instead of reporting them as taken.

    Raises
    ------
    RuleError
        If no scheduler answers, or the extra is not installed.
    """
    shards = list(shards)
    if not shards:
        return
    with _client(cluster) as client:
        import cloudpickle

        task = partial(  # keywords of map above 100 kB fail in distributed 2026.8
            fill,
            folder=store.folder,
            fingerprint=store.fingerprint,
            recipe=cloudpickle.dumps(recipe),  # as bytes, since reading a recipe loads Numba
            wait=wait,
            caller=os.getpid(),
        )
        futures = client.map(task, shards, retries=RETRIES, pure=False)
        shard_of = dict(zip(futures, shards, strict=True))
        try:
            for future in _ended(client, futures):
                yield _outcome(shard_of[future], future)
        finally:
            client.cancel(futures)


def _ended(client: "Client", futures: "Sequence[Future]") -> "Iterator[Future]":
    """Yield futures as they end.

    Where no worker is left, a cluster of jobs may get others: a warning says what is waited for. A local cluster, which
    starts workers anew at once, has given them up: that is a `GenerationError`.
    """
    from distributed import LocalCluster, as_completed

    from specklegen.datasets.store.filling import GenerationError

    ending, last, warned = as_completed(futures, loop=client.loop), time.monotonic(), False
    while not ending.is_empty():
        if ending.has_ready() or warned:
            yield next(ending)
            last = time.monotonic()
            continue
        time.sleep(0.02)
        if time.monotonic() - last < PATIENCE:
            continue
        last = time.monotonic()
        if not client.nthreads():
            kept = "stored shards are kept, and the next call resumes."
            if isinstance(client.cluster, LocalCluster):
                raise GenerationError(f"the local Dask cluster has no worker left: they died, perhaps for lack of "
                                      f"memory. Start a cluster with fewer workers: {kept}")  # fmt: skip
            warn_user(f"generate waits, since the Dask cluster has no worker. Start workers, or stop generate: {kept}")
            warned = True


def _outcome(shard: int, future) -> "Outcome":
    from specklegen.datasets.store.filling import Outcome

    try:
        return future.result()
    except Exception as error:
        return Outcome(shard, "failed", message=f"shard {shard}: {type(error).__name__}: {error}")


@contextmanager
def _client(cluster: "str | Client | Cluster") -> Iterator["Client"]:
    try:
        from distributed import Client
    except ImportError:
        reject("generate.cluster", "used with the extra dask installed", cluster,
               "pip install 'specklegen-torch[dask]'")  # fmt: skip
    if isinstance(cluster, Client):
        yield cluster
        return
    try:
        client = Client(cluster, set_as_default=False)
    except (OSError, ValueError) as error:
        reject("generate.cluster", "the address of a Dask scheduler that answers", cluster, f"Dask says: {error}.")
    with client:
        yield client


def fill(
    shard: int, folder: "str | os.PathLike", fingerprint: str, recipe: bytes, wait: bool, caller: int
) -> "Outcome":
    """Render and write one shard; what a worker runs.

    Raises
    ------
    OSError
        If trying again may help.
    RuleError, ForeignShard
        If this worker sees no store or another one, or would render something else into it.
    """
    if "numba" not in sys.modules:
        os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # Dask leaves it alone: dask/distributed#9075
    from specklegen.datasets.store.creation import require_same
    from specklegen.datasets.store.filling import fill_shard
    from specklegen.datasets.store.identity import identity
    from specklegen.datasets.store.store import Store
    from specklegen.datasets.workers import prepare_worker

    with _ONE_AT_A_TIME:
        if os.getpid() != caller:  # not a cluster of threads in the process that called generate
            prepare_worker()
        store, loaded = Store(folder), pickle.loads(recipe)
        store.require(fingerprint)
        stated = store.attributes["identity"]
        require_same(store, identity(loaded, stated["seed"], stated["split"], stated["dtype"]))
        outcome = fill_shard(store, loaded, shard, wait)
    if outcome.transient:
        raise OSError(outcome.message)
    return outcome
