"""The command ``specklegen check measured``: public measurements of other laboratories, listed, fetched and checked."""

from pathlib import Path

import typer

from specklegen.cli.examples import epilog
from specklegen.cli.output import AsJson, echo_json
from specklegen.cli.settings import argument, option
from specklegen.core.errors import counted

measured = typer.Typer(help="List the public measurements that docs/measurements.md reads, or fetch one.",
                       rich_markup_mode=None, no_args_is_help=True)  # fmt: skip


@measured.command("list", epilog=epilog("check measured list"))
def list_measured(as_json: AsJson = False) -> None:
    """List public measurements: what they are, their licence, where they lie."""
    from specklegen.measured import public_data, public_data_names

    sets = [public_data(name) for name in public_data_names()]
    if as_json:
        echo_json([
            {"name": each.name, "what": each.what, "licence": each.licence, "address": each.address,
             "commit": each.commit, "files": each.files} for each in sets
        ])  # fmt: skip
        return
    for each in sets:
        licence = "no licence: do not redistribute" if each.licence == "none" else each.licence
        typer.echo(f"{each.name:16s} {each.what} ({licence}; {each.address}, {each.commit[:7]})")


@measured.command("get", epilog=epilog("check measured get"))
def get_measured(
    name: str = argument(..., "Name of the set; `specklegen check measured list` has them all."),
    out: Path | None = option(None, "Folder to clone into, or a clone to check (default: NAME)."),
    source: str | None = option(None, "Address or path of another clone (default: GitHub)."),
) -> None:
    """Clone the files of a set by git, no others, and hold each against its digest."""
    from specklegen.measured import public_data

    data = public_data(name)
    folder = data.get(out or Path(name), source)
    number = counted(len(data.files), "file")
    typer.echo(f"{folder}: {number} of {data.repository} {data.commit[:7]}, all checksums right")
    if data.licence == "none":
        typer.echo("The authors state no licence: use the files here, and do not redistribute them.")
    else:
        typer.echo(f"Licence: {data.licence}.")
