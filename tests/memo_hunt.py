"""Memos, watched: what is kept is what would be worked out again, nobody has changed it, and who could.

    python tests/memo_hunt.py tests/core tests/scene tests/datasets/recipes/test_recipes.py     # pytest's arguments

Every ``lru_cache`` and ``cached_property`` of the package is watched while tests run. At hits 1, 2, 4, 8, ... of each
entry the kept result is compared, by its SHA-256, with what it was when it was kept (changed), and with what is worked
out anew then and there (impure). What is kept is searched for arrays that may be written into, too. Impure ones, which
depend on something that is no argument, and changed ones are findings: the script names them, and exits with 1.
"""

import dataclasses
import functools
import sys
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from threading import RLock, local
from typing import Any

import numpy as np

PACKAGE = "specklegen"
STATEFUL = {
    "specklegen.core.parallel._linear_algebra": "a handle of libraries",
    "specklegen.samplers.screens.sampler.ScreensRenderer._envelopes": "a table that fills as tilts are asked for",
}
"""What is kept because it changes, and why that is no number of a result."""
_KEPT = 4000
"""Values of properties that are remembered here, to be compared."""
_real_cache, _real_property = functools.lru_cache, functools.cached_property
_HERE, _LOCK = local(), RLock()


class Watch:
    """What was found: how often memos were asked and compared, which were changed or impure, and what is writable."""

    def __init__(self) -> None:
        self.hits: dict[str, int] = {}
        self.compared: dict[str, int] = {}
        self.findings: dict[str, str] = {}
        self.writable: dict[str, set[str]] = {}

    def kept(self, name: str, value: Any) -> "Kept":
        """Remember a result."""
        with _LOCK:
            found = {f"{place}: {what}" for place, what in writable(value)}
            self.writable.setdefault(name, set()).update(found)
        return Kept(value, digest(value))

    def hit(self, name: str, kept: "Kept", again: Callable[[], Any]) -> None:
        """Compare a kept result at hits 1, 2, 4, 8, ..."""
        with _LOCK:
            self.hits[name] = self.hits.get(name, 0) + 1
            kept.hits += 1
            due = kept.hits & (kept.hits - 1) == 0
        if not due or name in STATEFUL or getattr(_HERE, "inside", False):
            return
        _HERE.inside = True
        try:
            if digest(kept.value) != kept.sha256:
                self.findings.setdefault(name, "changed by whoever got it")
                return
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                new = digest(again())
            with _LOCK:
                self.compared[name] = self.compared.get(name, 0) + 1
            if new != kept.sha256:
                self.findings.setdefault(name, f"impure: hit {kept.hits} would be worked out otherwise")
        finally:
            _HERE.inside = False

    def report(self) -> str:
        """Lines about all memos that were hit, and the findings."""
        asked = sorted(self.hits.items())
        lines = [f"{name}: {hits} hits, {self.compared.get(name, 0)} compared" for name, hits in asked]
        for name, places in sorted(self.writable.items()):
            lines += [f"WRITABLE {name}: {', '.join(sorted(places)[:4])}"] if places else []
        lines += [f"FINDING {name}: {what}" for name, what in sorted(self.findings.items())]
        made, compared = sum(self.hits.values()), sum(self.compared.values())
        last = f"{len(self.hits)} memos, {made} hits, {compared} compared, {len(self.findings)} found"
        return "\n".join([*lines, last])


@dataclasses.dataclass(eq=False)
class Kept:
    """A result, and what it was."""

    value: Any
    sha256: str
    hits: int = 0


WATCH = Watch()


def digest(value: Any) -> str:
    """SHA-256 of all that a result holds."""
    from specklegen.core.content import content_digest

    return content_digest(value)


def writable(value: Any, place: str = "", depth: int = 0) -> Iterator[tuple[str, str]]:
    """Arrays within a result that a caller could write into, and where they are."""
    if isinstance(value, np.ndarray):
        if value.flags.writeable and value.size:
            yield place, f"{value.dtype} {value.shape}"
    elif depth > 4:
        return
    elif isinstance(value, Mapping):
        for key, each in value.items():
            yield from writable(each, f"{place}[{key!r}]", depth + 1)
    elif isinstance(value, tuple | list):
        for n, each in enumerate(value[:20]):
            yield from writable(each, f"{place}[{n}]", depth + 1)
    elif type(value).__module__.partition(".")[0] == PACKAGE and hasattr(value, "__dict__"):
        for name, each in vars(value).items():
            yield from writable(each, f"{place}.{name}", depth + 1)


def lru_cache(maxsize: Any = 128, typed: bool = False) -> Any:
    """``functools.lru_cache``, watched in the package."""
    if callable(maxsize):
        return _watched(maxsize, 128, typed)
    return lambda function: _watched(function, maxsize, typed)


def _watched(function: Callable[..., Any], maxsize: int | None, typed: bool) -> Any:
    if not str(getattr(function, "__module__", "")).startswith(PACKAGE + "."):
        return _real_cache(maxsize, typed)(function)
    name = f"{function.__module__}.{function.__qualname__}"
    fresh = local()

    @_real_cache(maxsize, typed)
    @functools.wraps(function)
    def keep(*arguments: Any, **named: Any) -> Kept:
        kept = WATCH.kept(name, function(*arguments, **named))
        fresh.made = kept
        return kept

    @functools.wraps(function)
    def ask(*arguments: Any, **named: Any) -> Any:
        kept = keep(*arguments, **named)
        if getattr(fresh, "made", None) is kept:
            fresh.made = None
        else:
            WATCH.hit(name, kept, lambda: function(*arguments, **named))
        return kept.value

    for each in ("cache_info", "cache_clear", "cache_parameters"):
        setattr(ask, each, getattr(keep, each))
    return ask


class cached_property(_real_property):  # noqa: N801, as functools has it
    """``functools.cached_property``, watched in the package: a data descriptor, so that it sees its hits."""

    __module__ = "functools"  # by which pydantic knows that it is no field
    _seen: "OrderedDict[tuple[int, str], Kept]" = OrderedDict()

    def __get__(self, instance: Any, owner: Any = None) -> Any:
        """Work it out, or look at what is kept."""
        if instance is None:
            return self
        there = self.attrname in instance.__dict__
        value = super().__get__(instance, owner)
        if not str(self.func.__module__).startswith(PACKAGE + "."):
            return value
        name, key = f"{self.func.__module__}.{self.func.__qualname__}", (id(instance), str(self.attrname))
        with _LOCK:
            kept = self._seen.get(key)
        if not there or kept is None or kept.value is not value:
            if not getattr(_HERE, "inside", False):
                _HERE.inside = True
                try:
                    kept = WATCH.kept(name, value)
                finally:
                    _HERE.inside = False
                with _LOCK:
                    self._seen[key] = kept
                    if len(self._seen) > _KEPT:
                        self._seen.popitem(last=False)
            return value
        WATCH.hit(name, kept, lambda: self.func(instance))
        return value

    def __set__(self, instance: Any, value: Any) -> None:
        """As without a descriptor."""
        instance.__dict__[self.attrname] = value

    def __delete__(self, instance: Any) -> None:
        """As without a descriptor."""
        del instance.__dict__[self.attrname]


def begin() -> None:
    """Watch whatever is imported of the package from now on."""
    assert not any(name.partition(".")[0] == PACKAGE for name in sys.modules), "begin before the package is imported"
    functools.lru_cache, functools.cached_property = lru_cache, cached_property  # type: ignore[assignment,misc]


def main(arguments: list[str]) -> int:
    """Run tests under the watch."""
    import pytest

    here = Path(__file__).resolve().parent
    sys.path[:0] = [str(here), str(here.parent)]
    begin()
    status = pytest.main(["-p", "no:cacheprovider", *arguments])
    print(WATCH.report())
    return int(bool(WATCH.findings)) or int(status)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
