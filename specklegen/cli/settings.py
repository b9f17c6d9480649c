"""Options of a command from settings classes: a field gives its option the name, type, default, bounds and help.

A parameter of a command may stand for many options. It is annotated with a dataclass of this package, whose fields are
options, or with :class:`Fields` of a class of the library, whose docstring describes its fields.
Options are made when a command is run or asked for help, so that ``specklegen --help`` imports no settings class.
"""

import importlib
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from functools import cached_property, wraps
from typing import Any, get_args, get_type_hints

import typer
from typer.core import TyperCommand
from typer.models import OptionInfo

from specklegen.core.quantities import Nodes, marked, node_of, plain_numbers
from specklegen.core.units import quantity

_ENTRY = re.compile(r"^(\w+)\n((?:    .*\n?|\n)+)", re.MULTILINE)
_MARKS = re.compile(r"(?::\w+:)?`+~?([^`]*)`+")
_BOUNDS = {"ge": "min", "le": "max"}
_MOST = 2**62  # a bound beyond is that of the processor, and not shown


def option(default: Any, help: str, *flags: str, **words: Any) -> Any:
    """Return the default of a parameter that is an option, with its help; ``...`` where the option is required."""
    return typer.Option(default, *flags, help=help, **words)


def argument(default: Any, help: str, **words: Any) -> Any:
    """Return the default of a parameter that is an argument, with its help; ``...`` where it is required."""
    return typer.Argument(default, help=help, **words)


@dataclass(frozen=True)
class Fields:
    """Fields of a settings class of the library, which a command gets as a table.

    Parameters
    ----------
    place
        Its import path, "module:Class"; imported when the options are made.
    words
        Further words of ``typer.Option`` by the name of a field.
    """

    place: str
    words: Mapping[str, dict[str, Any]]

    def options(self) -> Iterator[inspect.Parameter]:
        """Make the options of all fields."""
        module, _, name = self.place.partition(":")
        settings = getattr(importlib.import_module(module), name)
        described = dict(_ENTRY.findall(inspect.getdoc(settings) or ""))
        for name, info in settings.model_fields.items():
            bounds = {word: getattr(rule, word) for rule in info.metadata for word in _BOUNDS if hasattr(rule, word)}
            words = {_BOUNDS[word]: bound for word, bound in bounds.items() if bound < _MOST}
            help = _MARKS.sub(r"\1", " ".join(described[name].split()))
            made = option(info.default, help, **words | self.words.get(name, {}))
            yield _parameter(settings, name, info.annotation, made)


def _options_of(settings: type) -> Iterator[inspect.Parameter]:
    """Make the options of the fields of a dataclass."""
    for name, kind in get_type_hints(settings).items():
        yield _parameter(settings, name, kind, getattr(settings, name))


def _parameter(settings: type, name: str, kind: Any, info: Any) -> inspect.Parameter:
    info.rich_help_panel = f"{settings.__name__.removesuffix('Options')} options"
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=info, annotation=kind)


def _group(annotation: Any) -> tuple[Callable[..., Any], list[inspect.Parameter]] | None:
    """Return what makes the value of a parameter of several options, and these; None where it is one option."""
    for part in get_args(annotation):
        if isinstance(part, Fields):
            return dict, list(part.options())
    if isinstance(annotation, type) and is_dataclass(annotation):
        return annotation, list(_options_of(annotation))
    return None


class _Written(float):
    """A number that stands in the command line, and is no default; it remembers whether it had a unit."""


def _number(text: Any) -> Any:
    """Read the number of an option, or leave a text with a unit such as "0.5 mm" as it is."""
    try:
        return _Written(text) if isinstance(text, str) else text
    except ValueError:
        if quantity(text) is None:
            raise typer.BadParameter(f"{text!r} is neither a number nor one with a unit, such as '0.5 mm'.") from None
        return text


def _in_numbers(values: dict[str, Any], nodes: Nodes) -> dict[str, Any]:
    """Return numbers for options with units; once one of the command line has a unit, all of it must have one."""
    given = {name: values[name] for name in nodes if isinstance(values[name], str | _Written)}
    numbers, reading = plain_numbers("--", given, nodes)
    return {name: marked(_Written(number), reading.mark) if any(reading.mark) else float(number)
            for name, number in numbers.items()}  # fmt: skip


def expanded(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that takes every option of its settings by name, and units with its numbers."""
    stated = inspect.signature(command).parameters
    nodes = {name: node for name, each in stated.items() if (node := node_of(each.annotation)) and node.dimension}
    for name in nodes:
        info = [*getattr(stated[name].annotation, "__metadata__", ()), stated[name].default]
        next(each for each in info if isinstance(each, OptionInfo)).parser = _number
    groups = {name: group for name in stated if (group := _group(stated[name].annotation))}
    parameters = [
        option for name, parameter in stated.items()
        for option in (groups[name][1] if name in groups else [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)])
    ]  # fmt: skip

    @wraps(command)
    def run(**values: Any) -> None:
        values |= _in_numbers(values, nodes)
        for name, (settings, options) in groups.items():
            values[name] = settings(**{option.name: values.pop(option.name) for option in options})
        command(**values)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


class Generated(TyperCommand):
    """A command that makes its options when they are first asked for, and groups them in its help."""

    command: Callable[..., None]

    @classmethod
    def of(cls, command: Callable[..., None]) -> type[TyperCommand]:
        """Return the class of one command."""
        return type(cls.__name__, (cls,), {"command": staticmethod(command)})

    @cached_property
    def _made(self) -> Any:
        app = typer.Typer(add_completion=False, rich_markup_mode=None)
        app.command(self.name)(expanded(self.command))
        return typer.main.get_command(app)

    @property
    def params(self) -> list:
        """Arguments and options."""
        return self._made.params

    @params.setter
    def params(self, none: list) -> None:  # type: ignore[override]
        """Ignore the options that the command is registered with: it has none yet."""

    @property
    def callback(self) -> Callable[..., None]:
        """Function that runs the command with the values of its options."""
        return self._made.callback

    @callback.setter
    def callback(self, registered: Callable[..., None]) -> None:
        """Ignore the function that the command is registered with."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, options, and below them the options of each group."""
        sections: dict[str, list] = {"Arguments": [], "Options": []}
        for param in self.get_params(ctx):
            group = "Arguments" if param.param_type_name == "argument" else getattr(param, "rich_help_panel", None)
            record = param.get_help_record(ctx)
            sections.setdefault(group or "Options", []).extend([record] if record else [])
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def unmade() -> None:
    """Stand for a command whose options are not made yet."""
