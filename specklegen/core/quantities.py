"""Lengths, times and angles of a table or a call: texts with units become numbers, and what has no unit is refused.

Once a length of a table or call has a unit, every length of it that is not 0 must have one; so with times. Texts become
numbers in the unit of a part with a physical scale (a ground glass, a preset), or else in micrometres and seconds. A
value that was made of texts, or has a scale, remembers its :class:`Mark` outside its fields, so that a later call can
refuse to combine it with bare numbers. What this package itself computes from such values is trusted.

The dimension of a field is read from its annotation (:mod:`specklegen.core.units`), also inside unions, sequences and
values; a mark :class:`Like` says what the tables of a field hold that is no value yet.
"""

import inspect
import re
import sys
import threading
from collections import ChainMap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache, reduce, wraps
from operator import or_
from types import UnionType
from typing import Any, NamedTuple, ParamSpec, TypeVar, cast, get_args, get_type_hints

import numpy as np
from pydantic import BaseModel

from specklegen.core.errors import RuleError, reject, shown
from specklegen.core.units import NEAR_LIGHT, UNIT, Dimension, quantity

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")
Place = tuple[str | int, ...]

MARK = "_mark"
"""Name under which a value keeps its mark in its ``__dict__``, as cached properties are kept there."""
_MARKED = re.compile(r"Annotated\[((?:[^,\[\]]|\[[^\[\]]*\])+), \w+(?:\([^()]*\))?\]")
_STARTS = frozenset("+-.0123456789")
_HERE = threading.local()  # .trusted: whether this thread combines numbers of one value anew


class Like:
    """Mark of a field whose tables hold what values of some types hold: classes, unions of them, or nodes by name."""

    def __init__(self, *members: Any) -> None:
        self.members = members


class Mark(NamedTuple):
    """Unit of the lengths of a value: metres in it, if known, and whether lengths and times were written with units."""

    metres: float | None = None
    lengths: bool = False
    times: bool = False


_UNKNOWN = Mark()


class Bare(NamedTuple):
    """A number without a unit, where it stands, and whether its powers of length and time are in no known unit."""

    place: Place
    dimension: Dimension
    value: Any
    length: bool
    time: bool


class Node(NamedTuple):
    """Possible contents of a field: a number of a dimension, or values and tables."""

    dimension: Dimension | None = None
    members: tuple[Any, ...] = ()


Nodes = Mapping[str, Node]


def node_of(annotation: Any, metadata: Sequence[Any] = ()) -> Node | None:
    """Return what an annotation says of dimensions; None where it says nothing."""
    for rule in reversed((*getattr(annotation, "__metadata__", ()), *metadata)):  # the last says most
        if isinstance(rule, Dimension):
            return Node(rule)
        if isinstance(rule, Like):
            nodes = [(part, node_of(part)) for part in rule.members]
            return Node(members=tuple(each for part, node in nodes for each in (node.members if node else (part,))))
    if _is_part(annotation):
        return Node(members=(annotation,))
    inner = [node for part in get_args(annotation) if (node := node_of(part)) is not None]
    dimension = next((node.dimension for node in inner if node.dimension is not None), None)
    members = tuple(dict.fromkeys(each for node in inner for each in node.members))
    return Node(dimension, members) if dimension or members else None


def _is_part(kind: Any) -> bool:
    """Return whether a class is one of values, or says itself that its fields have dimensions."""
    return isinstance(kind, type) and (issubclass(kind, BaseModel) or getattr(kind, "has_quantities", False))


def _nodes_of_class(kind: type) -> Nodes:
    if not issubclass(kind, BaseModel):
        hints = get_type_hints(kind, include_extras=True).items()
        return {name: node for name, each in hints if (node := node_of(each)) is not None}
    nodes: dict[str, Node] = {}
    for name, field in kind.model_fields.items():
        node = node_of(field.annotation, field.metadata)
        if node is not None:
            nodes |= {name: node, field.alias or name: node}
    return nodes


def _parts_of_class(kind: type) -> tuple[str, ...]:
    nodes = nodes_of(kind)
    return tuple(name for name in getattr(kind, "model_fields", ()) if name in nodes and nodes[name].members)


nodes_of = cast("Callable[[type], Nodes]", lru_cache(4096)(_nodes_of_class))
"""Fields of a class that have a dimension, or hold values which may, by name and alias."""
parts_of = cast("Callable[[type], tuple[str, ...]]", lru_cache(4096)(_parts_of_class))
"""Fields of a class of values that hold values."""


def nodes_in(node: Node, table: Mapping[Any, Any]) -> Nodes:
    """Return the fields of the members that a table may stand for: of those it names, or else of all."""
    return ChainMap(*(nodes_for(kind, table) for member in node.members for kind in _named(member, table)))


def nodes_for(kind: Any, table: Mapping[str, Any]) -> dict[str, Node]:
    """Return the fields of a class, or of nodes by name, that have a dimension where a table says the rest."""
    nodes = nodes_of(kind) if isinstance(kind, type) else kind
    plain = kind.plain_fields(table) if hasattr(kind, "plain_fields") else ()
    return {name: node for name, node in nodes.items() if name not in plain}


def _and_subclasses(member: Any) -> Iterator[Any]:
    yield member
    for subclass in type.__subclasses__(member) if isinstance(member, type) and issubclass(member, BaseModel) else ():
        yield from _and_subclasses(subclass)


def _named(member: Any, table: Mapping[Any, Any]) -> list[Any]:
    """Return the classes that a table may mean where one or a registry of them is allowed."""
    registry = getattr(member, "registry", None)
    kinds = [*_and_subclasses(member)] if registry is None else [member, *(registry[name] for name in registry)]
    for key in ("type", "kind"):
        names = [getattr(kind, "model_fields", {}).get(key) for kind in kinds]
        if key in table and any(names):
            return [kind for kind, field in zip(kinds, names, strict=True) if field and field.default == table[key]]
    return kinds


def holds_text(value: Any, levels: int = 8) -> bool:
    """Return whether an argument is, or holds, a text that begins as a number, or a value that was made of texts."""
    kind = type(value)
    if kind is float or kind is int or value is None:
        return False
    if kind is str:
        return value.lstrip()[:1] in _STARTS if value else False
    if kind is np.ndarray:
        return value.dtype.kind in "UO"
    if kind is list or kind is tuple:
        return levels > 0 and any(holds_text(each, levels - 1) for each in value)
    if isinstance(value, Mapping):
        return levels > 0 and any(holds_text(each, levels - 1) for each in value.values())
    mark = mark_of(value)
    return mark is not None and (mark.lengths or mark.times)


def scales_in(values: Iterable[Any]) -> set[float]:
    """Return the metres in the units of length of values, and of values in sequences, that have a physical scale."""
    scales = set()
    for value in values:
        mark = mark_of(value)
        if mark is not None and mark.metres and not mark.lengths:
            scales.add(mark.metres)
        elif type(value) is tuple or type(value) is list:
            scales |= scales_in(value)
    return scales


Visit = Callable[[Place, Dimension, Any], Any]
"""What makes something of a number or text and its dimension."""


def walked_table(
    content: Mapping[str, Any], nodes: Nodes, visit: Visit, part: Callable[[Place, Any], Any] = lambda _, each: each,
    place: Place = (), whole: Any = None,
) -> dict[str, Any]:  # fmt: skip
    """Return a table with what ``visit`` makes of each text or number of a dimension, and ``part`` of each value.

    Of a table that changes another, ``whole`` is what it becomes part of, which may say what it is a table of.
    """

    def walked(content: Any, node: Node, place: Place, whole: Any) -> Any:
        if isinstance(content, np.ndarray) and content.dtype.kind in "UO":
            content = content.tolist()
        if type(content) is list or type(content) is tuple:
            return type(content)(walked(each, node, (*place, n), None) for n, each in enumerate(content))
        if isinstance(content, Mapping):
            table = {**whole, **content} if isinstance(whole, Mapping) else content
            nodes = dict.fromkeys(content, node) if node.dimension else nodes_in(node, table)
            return walked_table(content, nodes, visit, part, place, whole)
        if node.dimension is None:
            return part(place, content) if _is_part(type(content)) else content
        if isinstance(content, BaseModel):  # a distribution of numbers
            numbers = {name: walked(getattr(content, name), node, place, None) for name in type(content).model_fields}
            return type(content)(**numbers)
        return content if content is None or isinstance(content, bool) else visit(place, node.dimension, content)

    above = whole if isinstance(whole, Mapping) else {}
    return {
        name: walked(each, nodes[name], (*place, name), above.get(name)) if name in nodes else each
        for name, each in content.items()
    }


class Reading:
    """Texts, bare numbers and marks of one table or call.

    Parameters
    ----------
    table, nodes
        What a user gave, and the dimensions of its fields.
    whole
        The table that it becomes part of, as far as that says what tables are tables of.
    beside
        Mark of what the table changes.
    """

    def __init__(
        self, table: Mapping[str, Any], nodes: Nodes, whole: Mapping[str, Any] | None = None, beside: Mark | None = None
    ) -> None:
        self.texts: dict[Place, str] = {}
        self.bare: list[Bare] = []
        self.wrong: list[tuple[Place, str, Any]] = []
        self._units: list[float] = []
        self._powers: set[tuple[bool, bool]] = set()
        self._marks: list[tuple[Place, Mark]] = [] if beside is None else [((), beside)]
        walked_table(table, nodes, self._number, self._part, (), whole)

    def _number(self, place: Place, dimension: Dimension, value: Any, known: Mark = _UNKNOWN) -> Any:
        if isinstance(value, str):
            read = quantity(value)
            if read is not None and read.of(dimension):
                self.texts[place] = value
                self._powers.add((bool(read.length), bool(read.time)))
            elif (number := _float(value)) is not None:
                self._number(place, dimension, number, known)
            elif value.lstrip()[:1] in _STARTS:
                self.wrong.append((place, dimension.rule, value))
        elif dimension is UNIT:
            self._units += [float(value)] if isinstance(value, int | float) else []
        elif (dimension.length or dimension.time) and isinstance(value, np.ndarray | np.generic | int | float):
            array, own = np.asarray(value), mark_of(value)
            if own is not None:  # a number that was a text when the command line was read
                self._marks.append((place, own))
            elif array.dtype.kind in "iuf" and (np.isfinite(array) & (array != 0)).any():
                powers = bool(dimension.length) and not known.metres, bool(dimension.time) and not known.times
                self.bare.append(Bare(place, dimension, value, *powers))
        return value

    def _part(self, place: Place, value: Any) -> Any:
        mark = mark_of(value) or _UNKNOWN
        self._marks.append((place, mark))
        given = value.model_fields_set if isinstance(value, BaseModel) else vars(value)
        nodes = nodes_of(type(value))
        if not (mark.metres and mark.times):
            fields = {name: getattr(value, name) for name in nodes if name in given}
            walked_table(fields, nodes, lambda *each: self._number(*each, known=mark), self._part, place)
        return value

    @property
    def mark(self) -> Mark:
        """Mark of a value that is made of this."""
        marks = [mark for _, mark in self._marks]
        lengths = any(length for length, _ in self._powers) or any(mark.lengths for mark in marks)
        times = any(time for _, time in self._powers) or any(mark.times for mark in marks)
        metres = {*self._units, *(mark.metres for mark in marks if mark.metres)}
        return Mark(min(metres, default=1e-6 if lengths else None), lengths, times)

    def require_one_unit(self, owner: str) -> None:
        """Refuse parts in different units of length."""
        metres = {*self._units, *(mark.metres for _, mark in self._marks if mark.metres)}
        if len(metres) > 1:
            reject(owner.rstrip(". "), "given in one unit of length", sorted(metres), "Use one unit for all parts.")

    def unmeasured(self) -> list[tuple[Place, str, Any]]:
        """Return the numbers that lack a unit: place, rule, and value."""
        read = [(f'{dotted(place)} = "{text}"', quantity(text)) for place, text in self.texts.items()]
        beside = [(name, bool(each.length), bool(each.time)) for name, each in read if each]
        beside += [(dotted(place) or "the inherited recipe", each.lengths, each.times) for place, each in self._marks]
        lengths, times = ([each[0] for each in beside if each[power]] for power in (1, 2))
        unmeasured = []
        for each in self.bare:
            if names := (lengths if each.length else []) or (times if each.time else []):
                rule = f"written with its unit, such as {each.dimension.example(each.value)}, as {names[0]} has one"
                unmeasured.append((each.place, rule, each.value))
        return unmeasured


def plain_numbers(
    owner: str, table: Mapping[str, Any], nodes: Nodes, *, made: object = None, beside: Mark | None = None,
    whole: Mapping[str, Any] | None = None,
) -> tuple[dict[str, Any], Reading]:  # fmt: skip
    """Return a table with numbers for texts, and what was read in it.

    Raise a `RuleError` for texts of another dimension, and for lengths or times without a unit where others have one.

    Parameters
    ----------
    owner
        What stands before the places in an error: "Slab.", or "memory_effect ".
    table, nodes, whole, beside
        As of a :class:`Reading`.
    made
        The value that is being made of it, if any.
    """
    reading = Reading(table, nodes, whole, beside)
    unmeasured = reading.unmeasured()
    # Only people write texts; what is combined without any may have been computed from marked values here.
    refuse(owner, reading.wrong + (unmeasured if unmeasured and (reading.texts or not is_trusted(made)) else []))
    reading.require_one_unit(owner)
    metres = reading.mark.metres or 1e-6

    def number(_: Place, dimension: Dimension, value: Any) -> Any:
        if not isinstance(value, str):
            return value if mark_of(value) is None else float(value)
        read = quantity(value)
        return value if read is None else read.number(dimension, metres)

    return walked_table(table, nodes, number, whole=whole), reading


def refuse(owner: str, broken: Sequence[tuple[Place, str, Any]]) -> None:
    """Raise one error for all values that break a rule, a line each, if there are any."""
    if broken:
        lines = [f"{dotted(place)} must be {rule}; got {shown(value)}." for place, rule, value in broken]
        raise RuleError("\n".join(owner + line for line in lines), "\n".join(lines))


def with_texts(error: RuleError, texts: Mapping[str, str]) -> RuleError:
    """Return the error with what the user wrote for the fields that it names."""
    fields = {place: place.split(".")[1:] or [place] for place in texts}
    named = [f'{place} = "{text}"' for place, text in texts.items()
             if any(name in str(error) for name in fields[place] if not name.isdigit())]  # fmt: skip
    if not named:
        return error
    written = f" Written: {', '.join(named)}."
    return RuleError(str(error) + written, error.in_tables + written)


def in_other_unit(table: Mapping[str, Any], nodes: Nodes, old: float, new: float) -> dict[str, Any]:
    """Return a table of numbers in a unit of ``old`` metres in one of ``new``, rounded to twelve digits."""
    if old == new:
        return dict(table)

    def number(_: Place, dimension: Dimension, value: Any) -> Any:
        if dimension is UNIT:
            return new
        if not dimension.length or dimension.metres or not isinstance(value, int | float):
            return value
        return float(f"{value * (old / new) ** dimension.length:.12g}")

    return walked_table(table, nodes, number)


def mark_of(value: Any) -> Mark | None:
    """Return the mark of a value; None of one whose unit nobody said."""
    return getattr(value, "__dict__", {}).get(MARK)


def marked(value: R, mark: Mark) -> R:
    """Return the value, which remembers a mark from now on."""
    vars(value)[MARK] = mark
    return value


def mark_tables(content: Any, made: Any, mark: Mark) -> None:
    """Mark what was made of a table, and of tables in it; values that were given may be parts of others too."""
    if isinstance(content, Mapping) and isinstance(made, BaseModel):
        if nodes_of(type(made)):
            marked(made, mark._replace(metres=(mark_of(made) or mark).metres))
        for name, each in content.items():
            mark_tables(each, getattr(made, name, None), mark)
    elif isinstance(content, list | tuple) and isinstance(made, list | tuple):
        for each, part in zip(content, made, strict=False):
            mark_tables(each, part, mark)


@contextmanager
def trusting() -> Iterator[None]:
    """Context in which numbers without a unit may stand beside marked values: they come from such a value."""
    before = getattr(_HERE, "trusted", False)
    _HERE.trusted = True
    try:
        yield
    finally:
        _HERE.trusted = before


def is_trusted(made: object = None) -> bool:
    """Return whether the next caller outside the core, and outside the initialiser of ``made``, is this package."""
    if getattr(_HERE, "trusted", False):
        return True
    frame = sys._getframe(1)
    while frame is not None:
        name = str(frame.f_globals.get("__name__"))
        inner = name.partition(".")[0] in ("pydantic", "contextlib", "functools") or name.startswith("specklegen.core.")
        if not inner and (made is None or frame.f_locals.get("self") is not made):
            return name.partition(".")[0] == "specklegen"
        frame = frame.f_back
    return True


def require_light(
    owner: str, numbers: Mapping[str, Any], nodes: Nodes, scales: set[float], made: object = None
) -> None:
    """Refuse parts of different physical scales, and a bare wavelength that is none of light in their unit."""
    if len(scales) > 1:
        reject(owner.rstrip(". "), "given in one unit of length", sorted(scales), "Use one unit for all parts.")
    (metres,) = scales
    for name, node in nodes.items():
        value = numbers.get(name) if node.dimension is not None and node.dimension.light else None
        if not isinstance(value, int | float) or NEAR_LIGHT[0] <= value * metres <= NEAR_LIGHT[1]:
            continue
        if not is_trusted(made):
            unit = _NAMES.get(metres, f"units of {metres:g} m")
            low, high = (float(f"{end / metres:.6g}") for end in NEAR_LIGHT)
            rule = f"from {low:g} to {high:g}, since the medium is given in {unit}"
            reject(f"{owner}{name}", rule, value, unit_remedy(value, metres), name)


_NAMES = {1e-9: "nanometres", 1e-6: "micrometres", 1e-3: "millimetres", 1.0: "metres"}


def unit_remedy(wavelength: float, metres: float) -> str:
    """Say in which unit a wavelength may have been given, and how to write it."""
    for unit, name in _NAMES.items():
        if NEAR_LIGHT[0] <= wavelength * unit <= NEAR_LIGHT[1]:
            number, nanometres = (float(f"{wavelength * unit / other:.6g}") for other in (metres, 1e-9))
            return f'It looks like {name}: write {number:g} or "{nanometres:g} nm".'
    return "Write it with its unit."


def with_units(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function take texts with units for arguments whose annotations have a dimension.

    Once a length has a unit, all of the call must have one, those of values among its arguments too. A bare wavelength
    beside a value with a physical scale must be one of light.
    """
    signature = inspect.signature(function)
    makes = function.__qualname__.endswith(("__init__", "__new__"))
    owner = f"{function.__qualname__.rpartition('.')[0]}." if makes else f"{function.__qualname__} "

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        everything = (*args, *kwargs.values())
        scales = scales_in(everything)
        if not scales and not any(map(holds_text, everything)):
            return function(*args, **kwargs)
        texts = any(isinstance(each, str | Sequence | Mapping) and holds_text(each) for each in everything)
        if not texts and is_trusted(args[0] if makes else None):  # what this package computed
            return function(*args, **kwargs)
        try:
            bound = signature.bind(*args, **kwargs)
        except TypeError:
            return function(*args, **kwargs)  # which says it in its own words
        if texts:
            bound.apply_defaults()  # a wavelength of 1 by default is no length in micrometres
        given = bound.arguments
        nodes = {name: Node(members=(type(each),)) for name, each in given.items()} | dict(_nodes_of(function))
        numbers, reading = plain_numbers(owner, given, nodes, made=args[0] if makes else None)
        if scales and not reading.mark.lengths:
            require_light(owner, numbers, nodes, scales)
        given.update(numbers)
        result = function(*bound.args, **bound.kwargs)
        made = args[0] if function.__name__ == "__init__" else result
        # A value that was made of what has units has them too: beams, of the width that was written.
        if (isinstance(made, BaseModel) or made is not result) and not mark_of(made):
            marked(made, reading.mark)
        return result

    call.__dict__["__signature__"] = _without_dimensions(signature)
    return call


def takes_units(kind: type[T]) -> type[T]:
    """Let the constructor of a dataclass take texts with units, as :func:`with_units` does; or of a named tuple."""
    maker: Any = kind
    if issubclass(kind, tuple):  # it has no place for a mark
        maker.__new__ = staticmethod(with_units(maker.__new__))
    else:
        maker.__init__, maker.has_quantities = with_units(maker.__init__), True
    return kind


def _without_dimensions(signature: inspect.Signature) -> inspect.Signature:
    """Return the signature that help shows: of types alone, for the text below it says what a number is."""
    parameters = [each.replace(annotation=_plain(each.annotation)) for each in signature.parameters.values()]
    return signature.replace(parameters=parameters)


def _plain(annotation: Any) -> Any:
    if isinstance(annotation, str):
        return _MARKED.sub(r"\1", annotation)
    if isinstance(annotation, UnionType):
        return reduce(or_, map(_plain, annotation.__args__))
    return annotation.__origin__ if hasattr(annotation, "__metadata__") else annotation


@cache
def _nodes_of(function: Callable[..., Any]) -> Nodes:
    """Return the arguments of a function that have a dimension; of ``**arguments``, what they hold by name."""
    nodes: dict[str, Node] = {}
    for name, annotation in function.__annotations__.items():
        if isinstance(annotation, str):
            try:
                annotation = eval(annotation,
                                  inspect.unwrap(function).__globals__)  # noqa: S307 - of this package's own source
            except NameError:  # imported for type checkers alone
                continue
        node = node_of(annotation)
        nodes |= {} if node is None else {name: node}
    return nodes


def _float(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def dotted(place: Place) -> str:
    """Write a place as a file's reader names it: ``material.screens.0.angle``."""
    return ".".join(map(str, place))
