"""The commands about recipes: list them, show one, print the schema of a kind, plan one."""

import resource
from datetime import datetime
from typing import TYPE_CHECKING, Any

import typer

from specklegen.cli.examples import epilog
from specklegen.cli.output import AsJson, echo_json
from specklegen.cli.recipe_options import Images, RecipeName, Set, load, names_starting_with
from specklegen.cli.settings import argument, option
from specklegen.core.errors import counted

if TYPE_CHECKING:
    from specklegen.datasets import Recipe
    from specklegen.planning.plan import Plan

recipes = typer.Typer(help="List the packaged recipes, show one, or the schema of its kind.", rich_markup_mode=None)


@recipes.callback(invoke_without_command=True)
def list_recipes(
    context: typer.Context,
    every: bool = option(False, "List all packaged recipes, not only the six to begin with.", "--all"),
    as_json: AsJson = False,
) -> None:
    """List the packaged recipes."""
    from specklegen.datasets.recipes.recipe_files import FIRST_RECIPES, recipe_names, recipe_table

    if context.invoked_subcommand is not None:
        return
    # Tables alone: to list them, no recipe has to be made, and no engine loaded.
    names = recipe_names() if every else FIRST_RECIPES
    listed = [{"name": name, **_about(recipe_table(name))} for name in names]
    if as_json:
        echo_json(listed)
    else:
        for row in listed:
            typer.echo(f"{row['name']:24s} {row['description']}")
        if not every:
            typer.echo(f"{len(recipe_names()) - len(names)} more: specklegen recipes --all")


def _about(table: dict[str, Any]) -> dict[str, str]:
    return {"kind": table["kind"], "description": table["description"]}


@recipes.command("show", epilog=epilog("recipes show"))
def show_recipe(recipe: RecipeName, changes: Set = None, as_json: AsJson = False) -> None:
    """Print a recipe as TOML, with inherited fields and your changes written out."""
    import tomli_w

    from specklegen.datasets.recipes.overrides import changes_of
    from specklegen.datasets.recipes.recipe_files import recipe_file, recipe_names

    file = recipe_file(recipe, changes_of(changes or []))
    table = file.table()
    if changes or recipe not in recipe_names():  # the packaged ones are known to be right
        from specklegen.datasets import load_recipe
        from specklegen.datasets.recipes.written_units import plain

        table = plain(file, type(load_recipe(recipe, changes_of(changes or [])))).table
    if as_json:
        echo_json(table)
    else:
        typer.echo(tomli_w.dumps(table))


@recipes.command("schema", epilog=epilog("recipes schema"))
def recipe_schema_command(
    name: str = argument(..., "A kind of recipe, or a recipe of that kind.", autocompletion=names_starting_with),
) -> None:
    """Print the JSON schema of a kind of recipe."""
    from specklegen.datasets.recipes.registry import recipe_schema

    echo_json(recipe_schema(name))


def plan(
    recipe: RecipeName,
    samples: int | None = option(None, "Number of samples to estimate the cost of (default: an epoch of train).",
                                 min=1),
    changes: Set = None, images: Images = None,
    verbose: bool = option(False, "Print the reason for each part.", "--verbose", "-v"),
    as_json: AsJson = False,
    anew: bool = option(False, "Plan and measure again, without cached answers.", "--anew"),
) -> None:  # fmt: skip
    """Print sampler, expected error, neglected effects and cost of a recipe; with --verbose, the reasons.

    Answers and measured costs are cached.
    """
    from specklegen.cli.cached_plans import cached_answer, caching, name_of_answer
    from specklegen.datasets.recipes.overrides import changes_of
    from specklegen.datasets.recipes.recipe_files import recipe_file

    words = "verbose" if verbose else "short"
    tables = recipe_file(recipe, changes_of(changes or [])).written()
    name = None if images is not None else name_of_answer(tables, samples)
    answer = None if anew else cached_answer(name)
    if answer is None:
        with caching(name) as answer:
            loaded = load(recipe, changes, images)
            loaded.fingerprint()  # reads a folder of pictures: what is wrong with it is said before anything else
            answer |= _planned(loaded.plans())
            if not as_json:
                typer.echo(answer[words])
            answer["cost"] = _cost(loaded, samples)
    elif not as_json:
        typer.echo(answer[words])
    cost = answer["cost"]
    if as_json:
        echo_json({"plans": answer["plans"], "cost": cost})
        return
    typer.echo(
        f"Data set:    {counted(cost['samples'], 'sample')}: about {cost['bytes'] / 2**20:.1f} MiB on disk, "
        f"{cost['seconds']:.1f} s on {counted(cost['processes'], 'core')}, at most {cost['memory'] / 2**20:.0f} MiB of "
        f"memory in each process (measured on {cost['measured']})"
    )


def _planned(plans: "list[Plan]") -> dict[str, Any]:
    """Texts of plans in each of the ways that the command has."""
    verbose = "\n\n".join(each.explain() for each in plans) + "\n"
    return {"short": _in_short(plans), "verbose": verbose, "plans": [facts(each) for each in plans]}


def _cost(recipe: "Recipe", samples: int | None) -> dict[str, Any]:
    """Estimate the cost of samples on this machine from a few of them."""
    from specklegen.datasets.store.estimate import estimate  # with zarr and torch, after the plans are read

    count = samples if samples is not None else recipe.length("train")
    cost = estimate(recipe, count)
    # This process has just rendered and stored a few samples: what it took, any other takes too.
    rendered = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    when = datetime.now().astimezone().isoformat(" ", "minutes")
    return cost | {"samples": count, "memory": rendered + cost["memory"], "measured": when}


def _in_short(plans: "list[Plan]") -> str:
    """The one plan in a few lines; of many, at the corners of a recipe's ranges, that of the largest error."""
    worst = max(plans, key=lambda each: each.expected_error)
    lines = worst.summary().split("\n")
    if len(plans) > 1:
        errors = sorted(each.expected_error for each in plans)
        samplers = " or ".join(sorted({each.sampler for each in plans}))
        span = f"errors {errors[0]:.2g} to {errors[-1]:.2g}"
        checks = dict.fromkeys(line for each in plans for line in each.checks)
        corners = f"Ranges:      {len(plans)} corners: {samplers}, {span}. Below: the corner of the largest error"
        lines = [*checks, corners, *lines[len(worst.checks) :]]
        lines += sorted({f"Doubtful:    {doubt}" for each in plans for doubt in each.doubts} - set(lines))
    return "\n".join([*lines, "Reasons:     --verbose"])


def facts(made: "Plan") -> dict[str, Any]:
    """Facts of a plan as plain numbers and texts."""
    return {
        "sampler": made.sampler,
        "summation": made.summation,
        "paths": made.paths,
        "decisions": [{"part": d.part, "used": d.needed, "reason": d.reason} for d in made.decisions],
        "expected_error": made.expected_error,
        "seconds": made.seconds,
        "memory_bytes": made.memory_bytes,
        "alternatives": made.alternatives,
        "scene": made.scene.model_dump(mode="json"),
    }
