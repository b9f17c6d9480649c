"""What the ledger of a large store costs: opening it, doing a part of it, looking through all of it, shuffling it.

    python scripts/shard_cost.py [SHARDS ...]        by default 1000 10000 100000

A store of so many shards of one sample of a recipe without physics. All but the last thousandth are on the ledger, by
copies of one line: what is timed looks at the ledger, not into samples. Processor milliseconds of this process.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).parents[1]
sys.path.insert(0, str(HERE / "tests"))

from fake_recipe import FakeRecipe  # noqa: E402

from specklegen.datasets.loading.shard_order import ShardOrder  # noqa: E402
from specklegen.datasets.store.generate import generate  # noqa: E402
from specklegen.datasets.store.info import info  # noqa: E402
from specklegen.datasets.store.store import Store  # noqa: E402

PARTS = 1000


def timed(act: Callable[[], object]) -> float:
    """Processor milliseconds, those of children left out."""
    begin = time.process_time()
    act()
    return 1e3 * (time.process_time() - begin)


def row(shards: int, folder: Path) -> str:
    """A row of the table."""
    recipe, own = FakeRecipe(samples=shards), shards // PARTS

    def part(number: int, parts: int) -> None:
        generate(
            recipe, samples=shards, folder=folder, shard_samples=1, processes=1, shard_range=(number, parts)
        )  # fmt: skip

    part(0, shards)  # one shard
    line = (folder / "valid/c/0").read_bytes()
    for shard in range(1, shards - own):
        (folder / f"valid/c/{shard}").write_bytes(line)
    last = PARTS - 1, PARTS
    times = [timed(act) for act in (
        lambda: Store(folder), lambda: part(*last), lambda: part(*last), lambda: info(folder),
        lambda: ShardOrder(1000 * shards, 1000, 4, 0, 0)[0:32],
    )]  # fmt: skip
    return f"| {shards} | {times[0]:.1f} | {times[1]:.0f} ({own}) | " + " | ".join(f"{t:.1f}" for t in times[2:]) + " |"


def main() -> None:
    """Print the table."""
    columns = "open", "render a part (its shards)", "a part that is there", "`info` of all", "begin a shuffled epoch"
    print(f"| shards | {' | '.join(columns)} |")
    print("|---|" + "---|" * len(columns))
    for shards in map(int, sys.argv[1:] or ("1000", "10000", "100000")):
        with tempfile.TemporaryDirectory() as folder:
            print(row(shards, Path(folder) / "a.zarr"), flush=True)


if __name__ == "__main__":
    main()
