"""The commands about stores: fill one, look at it, describe it, check it, write it as common files."""

import re
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from specklegen.cli.failures import NOT_WHOLE, exit_status
from specklegen.cli.output import AsJson, Progress, echo_json, require_writable
from specklegen.cli.recipe_options import Images, Objects, RecipeName, RecipeOrStore, Seed, Set, Split, is_store, load
from specklegen.cli.settings import option
from specklegen.core.errors import counted, reject
from specklegen.core.interrupts import Terminated

if TYPE_CHECKING:
    from specklegen.datasets.store.verify import Verification

Store = Annotated[str, typer.Argument(help="Folder of a store, or its address (s3://bucket/a.zarr).")]


def generate(
    recipe: RecipeName,
    out: str = option(..., "Folder of the store, or an address (s3://bucket/a.zarr); an existing store is continued."),
    samples: int | None = option(None, "Number of samples (default: an epoch of the split).", min=1),
    split: Split = "train", seed: Seed = 0, changes: Set = None, images: Images = None, objects: Objects = None,
    processes: int | None = option(None, "Worker processes (default: all cores).", min=1),
    shard_range: str = option("0/1", "Render part I of N: N machines share one folder.", metavar="I/N"),
    cluster: str | None = option(None, "Render on a Dask cluster, by its scheduler's address.", metavar="ADDRESS"),
    anyway: bool = option(False, "Start even if the disk is too small or the time is months."),
) -> None:  # fmt: skip
    """Fill a zarr store with samples of a recipe; run it again to go on where it stopped."""
    from specklegen.datasets.store.estimate import foreseen
    from specklegen.datasets.store.generate import generate as fill

    loaded = load(recipe, changes, images, objects)
    count = samples if samples is not None else loaded.length(split)
    part = _part(shard_range)
    missing = _missing(out, count, part) if 0 <= part[0] < part[1] else 0
    if missing > 0 and cluster is None:
        report = foreseen(loaded, missing, out, seed, split, processes=processes, anyway=anyway)
        if report:
            typer.echo(report, err=True)
    begin = time.perf_counter()
    with Progress(count) as progress:
        try:
            report = fill(loaded, seed, split, samples=count, folder=out, processes=processes, shard_range=part,
                          progress=progress, notes=loaded.split_notes(), cluster=cluster)  # fmt: skip
        except (KeyboardInterrupt, Terminated) as stopped:
            progress.bar.close()
            typer.echo(
                f"stopped: {progress.done} of {counted(count, 'sample')} are stored in {out}, none of them partly. "
                "Run the same command again to resume.",
                err=True,
            )
            raise typer.Exit(exit_status(stopped)) from None
    took = time.perf_counter() - begin
    rendered, total = report["rendered"], counted(report["total"], "sample")
    whole = total if part[1] == 1 else f"{total} of part {shard_range}"
    typer.echo(
        f"{report['done']} of {whole} in {out} ({report['bytes'] / 2**20:.1f} MiB); "
        f"rendered {rendered} in {took:.1f} s" + (f", {_rate(rendered / took)} a second" if rendered else "")
    )


def _missing(out: str, count: int, part: tuple[int, int]) -> int:
    """Samples of a part that are not there; of the store its own shards alone are looked at."""
    from specklegen.datasets.store.creation import shards_of
    from specklegen.datasets.store.info import info as describe
    from specklegen.datasets.store.store import Store

    share = -(-count // part[1])
    if not is_store(out):
        return share
    shards = None if part[1] == 1 else shards_of(min(count, (there := Store(out)).samples), there.shard_samples, part)
    return max(share - describe(out, shards)["done"], 0)


def _rate(rate: float) -> str:
    return f"{rate:.0f}" if rate >= 10 else f"{rate:.2g}"


def _part(shard_range: str) -> tuple[int, int]:
    """Numbers of a text I/N."""
    numbers = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", shard_range)
    if numbers is None:
        reject("generate --shard-range", "of the form I/N", shard_range)
    return int(numbers[1]), int(numbers[2])


def preview(
    what: RecipeOrStore,
    samples: int = option(6, "Number of samples to show.", min=1, max=100),
    split: Split = "train", seed: Seed = 0, changes: Set = None, images: Images = None,
    out: Path = option(Path("preview.png"), "PNG to write."),
) -> None:  # fmt: skip
    """Draw samples of a recipe or of a store as a contact sheet."""
    from specklegen.pictures import sheet

    require_writable("preview --out", out)
    if is_store(what):
        from specklegen.datasets import SpeckleCache

        cache = SpeckleCache(what)
        shown = [cache.numpy(n) for n in range(min(samples, len(cache)))]
    else:
        loaded = load(what, changes, images)
        shown = [loaded.sample(seed, split, n) for n in range(samples)]
    typer.echo(str(sheet(shown, out)))


def info(folder: Store) -> None:
    """Say what a store holds, from the store alone."""
    from specklegen.datasets.store.info import info as describe

    echo_json(describe(folder))


def verify(
    folder: Store,
    repair: str | None = option(None, "Render damaged and missing shards again.", metavar="RECIPE"),
    changes: Set = None, images: Images = None, as_json: AsJson = False,
) -> None:  # fmt: skip
    """Check every shard of a store against its checksum; exit status 1 if one is damaged or unfinished."""
    from specklegen.datasets.store.verify import verify as check

    result = check(folder, load(repair, changes, images) if repair else None)
    bad = len(result.damaged) + len(result.unfinished)
    if as_json:
        echo_json(
            {
                "shards": result.shards, "damaged": result.damaged, "unfinished": result.unfinished,
                "orphans": result.orphans, "sound": result.sound, "complete": not bad,
                "rendered_again": bad if repair else 0,
            }
        )  # fmt: skip
    else:
        typer.echo(in_words(result))
        if repair:
            typer.echo(f"{counted(bad, 'shard')} rendered again")
        elif result.damaged:
            typer.echo(f"Repair it: specklegen store verify {folder} --repair RECIPE")
        elif result.unfinished:
            typer.echo("Run the same `specklegen generate` again to resume.")
    if bad and not repair:
        raise typer.Exit(NOT_WHOLE)


def in_words(found: "Verification") -> str:
    """Result of a check."""
    sound = found.shards - len(found.damaged) - len(found.unfinished)
    parts = [f"{counted(found.shards, 'shard')}: {sound} sound"]
    parts += [
        f"{len(numbers)} {state} (number{'' if len(numbers) == 1 else 's'} {_first_few(numbers)})"
        for state, numbers in (("damaged", found.damaged), ("unfinished", found.unfinished))
        if numbers
    ]
    if found.orphans:
        parts.append(f"{counted(found.orphans, 'temporary file')} of killed processes")
    return ", ".join(parts)


def _first_few(numbers: tuple[int, ...]) -> str:
    return ", ".join(map(str, numbers[:8])) + (", ..." if len(numbers) > 8 else "")


def export(
    folder: Store,
    out: Path = option(..., "Folder to write to."),
    format: Literal["npy", "png", "parquet"] = option("npy", "Format of the files."),
    samples: int | None = option(None, "Number of samples, from the first (default: all).", min=1),
) -> None:
    """Write samples of a store as files that every program reads."""
    from specklegen.datasets import SpeckleCache
    from specklegen.datasets.loading.export import export as write

    if samples is not None and samples > (there := len(SpeckleCache(folder))):
        reject("--samples", f"at most {there}, the samples of the store", samples)
    written = write(folder, out, format, None if samples is None else range(samples))
    typer.echo(f"{counted(len(written), 'file')} in {out}")
