"""Kill -9 of those who begin and fill one store at an address, before any of their puts and deletions, several at once.

    python tests/fuzz_addresses.py --trials 100                  at a bucket in a folder of this machine
    python tests/fuzz_addresses.py --trials 100 --server         at a server of the S3 protocol (moto, s3fs)

After every trial the same call ends with the bytes of an uninterrupted run. A process that was not killed has not
failed. A claim of the dead may stay, of the metadata that were whole: it is old, and keeps nobody waiting.
"""

import argparse
import contextlib
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from fake_recipe import FakeRecipe
from small_stores import contents, make

from specklegen.datasets.store import locks
from specklegen.datasets.store.verify import verify

RECIPE = FakeRecipe(side=4)
PUTS = 70
"""Puts and deletions of a call that begins and fills a store, about."""


@contextlib.contextmanager
def quick_claims() -> Iterator[None]:
    """Let claims of the dead count no more after a second."""
    before = locks.LOOK, locks.BEAT, locks.OLD
    locks.LOOK, locks.BEAT, locks.OLD = 0.02, 0.2, 1.0
    try:
        yield
    finally:
        locks.LOOK, locks.BEAT, locks.OLD = before


def child(place: Callable[[], Any], kill_at: int, log: Path) -> int:
    """Fork a process that fills the store, and dies before one of its puts or deletions (0: of none)."""
    number = os.fork()
    if number:
        return number
    code = 1
    try:
        folder = place()
        left = iter(range(kill_at - 1 if kill_at else 10**9))
        for name in ("pipe_file", "rm_file"):
            setattr(folder.fs, name, _dying(getattr(folder.fs, name), left))
        make(folder, RECIPE)
        code = 0
    except BaseException:
        log.write_text(traceback.format_exc())
    finally:
        os._exit(code)


def _dying(act: Callable, left: Iterator[int]) -> Callable:
    def dying(*arguments: Any, **options: Any) -> Any:
        if next(left, None) is None:
            os.kill(os.getpid(), signal.SIGKILL)
        return act(*arguments, **options)

    return dying


def trial(place: Callable[[], Any], rounds: list[list[int]], reference: dict[str, bytes], room: Path) -> int:
    """Run, round after round, as many processes at once as it has kills; return how many of them died."""
    died = 0
    for kills in rounds:
        numbers = [child(place, kill, room / str(row)) for row, kill in enumerate(kills)]
        for row, number in enumerate(numbers):
            status = os.waitpid(number, 0)[1]
            died += os.WIFSIGNALED(status)
            assert os.WIFSIGNALED(status) or status == 0, f"{rounds}: {(room / str(row)).read_text()}"
    folder = place()
    make(folder, RECIPE)
    assert verify(folder).sound, rounds
    folder.fs.invalidate_cache()
    start = len(folder.path.rstrip("/")) + 1
    objects = {name[start:]: folder.fs.cat_file(name) for name in folder.fs.find(folder.path) if "/claims/" not in name}
    assert objects == reference, (rounds, sorted(objects.keys() ^ reference.keys()))
    return died


def run(
    trials: int, place_of: Callable[[int], Callable[[], Any]], room: Path, seed: int = 0, minutes: float = 60.0,
    rounds: int = 1,
) -> tuple[int, int]:  # fmt: skip
    """Run trials for some minutes at most; return how many, and how many processes died.

    Each has one to three processes at once; of more rounds than one all but the last kill whoever begins the store.
    """
    make(room / "a.zarr", RECIPE)
    reference, draws, died, number = contents(room / "a.zarr"), random.Random(seed), 0, 0
    end = time.monotonic() + 60 * minutes
    with quick_claims():
        while number < trials and time.monotonic() < end:
            count = 1 + number % 3
            kills = [[draws.randint(1, 14) for _ in range(count)] for _ in range(rounds - 1)]
            kills += [[draws.choice([0, draws.randint(1, 14), draws.randint(1, PUTS)]) for _ in range(count)]]
            died += trial(place_of(number), kills, reference, room)
            number += 1
    return number, died


def bucket(room: Path) -> Callable[[int], Callable[[], Any]]:
    """Addresses in a folder of this machine."""
    import own_bucket  # noqa: F401
    from upath import UPath

    def place(number: int) -> Any:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a protocol that universal-pathlib has no tests of
            return UPath(f"bucket://{room}/{number}/a.zarr")

    return lambda number: lambda: place(number)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _wait_for(port: int) -> None:
    for _ in range(600):
        with contextlib.suppress(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port)):
            return
        time.sleep(0.1)


def main() -> None:
    """Run the trials that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60.0, help="at most")
    parser.add_argument("--rounds", type=int, default=1, help="of processes, one after the other, in each trial")
    parser.add_argument("--server", action="store_true")
    arguments = parser.parse_args()
    how = {name: getattr(arguments, name) for name in ("seed", "minutes", "rounds")}
    with tempfile.TemporaryDirectory() as folder:
        if not arguments.server:
            made, died = run(arguments.trials, bucket(Path(folder)), Path(folder), **how)
        else:
            from upath import UPath

            port = _free_port()
            # A process of its own: one that is forked beside the server's threads would hold their connections open.
            words = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
            server = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            options = {"key": "any", "secret": "any", "endpoint_url": f"http://127.0.0.1:{port}"}
            options["skip_instance_cache"] = True  # a system of its own, in every process
            _wait_for(port)
            UPath("s3://bucket", **options).mkdir()

            def reached(number: int) -> Any:
                place = UPath(f"s3://bucket/{number}/a.zarr", **options)
                place.fs.invalidate_cache()  # made here, or else once for every file of the store
                return place

            def place_of(number: int) -> Callable[[], Any]:
                return lambda: reached(number)

            try:
                made, died = run(arguments.trials, place_of, Path(folder), **how)
            finally:
                server.kill()
    print(f"{made} trials of 1 to 3 processes, {died} of them killed, nothing lost")


if __name__ == "__main__":
    main()
