"""Registries: classes and functions of one kind by their names, to which users add their own by defining them.

What is not known by its name may be asked for by its import path, ``"module:Name"``: the module is then imported,
**which runs its code**. A table or command that holds such a path is a program, and to be trusted as one. The module
lies in the folder that is written before it (``"shapes/rings:Rings"``), in that of the file which holds the path, or
else on ``sys.path``. Its folder joins the end of ``sys.path``, so that worker processes find it too. A file that is not
trusted (:func:`imports_of`) can name modules so that are loaded already, and no others.
"""

import contextlib
import importlib
import os
import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Generic, TypeVar

from specklegen.core.errors import RuleError, reject

_WORD = r"[^\W\d]\w*"
_PATH = re.compile(rf"(?:(?P<folder>.*)/)?(?P<module>{_WORD}(?:\.{_WORD})*?)(?:\.py)?:(?P<name>{_WORD})")
IMPORTABLE = ("type", "kind", "sampler")
"""Keys of tables whose texts may be import paths."""

TRUST = "SPECKLEGEN_TRUST"
"""Environment variable that is 1 where files outside the working folder are trusted too."""
_ALLOWED: ContextVar[frozenset[str] | None] = ContextVar("_ALLOWED", default=None)
"""Import paths that may be followed now; None where all may."""

T = TypeVar("T")


def is_import_path(text: object) -> bool:
    """Return whether a text is ``module:Name`` or ``module.py:Name``, perhaps behind a folder.

    Examples
    --------
    >>> is_import_path("my_module:Rings"), is_import_path("../shapes/rings:Rings"), is_import_path("Rings")
    (True, True, False)
    """
    return isinstance(text, str) and _PATH.fullmatch(text) is not None


def imported(field: str, path: str) -> Any:
    """Import ``[folder/]module[.py]:Name``, by default from the working folder or ``sys.path``.

    Raise a `RuleError` if there is no such module or no such name in it, it cannot be imported, or another of its name
    has been.
    """
    match = _PATH.fullmatch(path)
    if match is None:
        reject(field, 'an import path such as "my_module:Name"', path)
    _require_allowed(field, path)
    folder = Path(match["folder"] if match["folder"] is not None else ".").expanduser().resolve()
    file = _file_of(folder, match["module"])
    if file is None and match["folder"] is not None:
        reject(field, f"the path of a module in {folder}", path, f"There is no {match['module']}.py.")
    if file is not None and str(folder) not in sys.path:
        sys.path.append(str(folder))
    try:
        module = importlib.import_module(match["module"])
    except RuleError:
        raise
    except Exception as error:
        reject(field, "the path of a module that can be imported", path, f"{type(error).__name__}: {error}.")
    there = getattr(module, "__file__", None)
    if file is not None and (there is None or Path(there).resolve() != file):
        reject(field, "the path of a module with a unique name", path,
               f"{match['module']} is already {there or 'built in'}: rename {file.name}.")  # fmt: skip
    if not hasattr(module, match["name"]):
        reject(field, f"a name that {match['module']} defines", path)
    return getattr(module, match["name"])


def is_trusted(file: Path) -> bool:
    """Return whether a file lies below the working folder, or the environment says that all files are trusted."""
    return os.environ.get(TRUST) == "1" or file.resolve().is_relative_to(Path.cwd())


@contextlib.contextmanager
def trusting_all() -> Iterator[None]:
    """Trust files anywhere, in this process and in those that it starts."""
    before = os.environ.get(TRUST)
    os.environ[TRUST] = "1"
    try:
        yield
    finally:
        os.environ.pop(TRUST) if before is None else os.environ.update({TRUST: before})


@contextlib.contextmanager
def imports_of(table: Any, trusted: bool, allowed: Collection[str] = ()) -> Iterator[None]:
    """Refuse import paths, unless the table is trusted, their modules are loaded, or they are among those allowed."""
    if trusted:
        yield
        return
    token = _ALLOWED.set(frozenset(allowed))
    try:
        for path in import_paths(table):
            _require_allowed("import path", path)
        yield
    finally:
        _ALLOWED.reset(token)


def _require_allowed(field: str, path: str) -> None:
    allowed, match = _ALLOWED.get(), _PATH.fullmatch(path)
    if allowed is None or path in allowed or match is None:
        return
    module = sys.modules.get(match["module"])
    if module is not None and match["folder"] is None:
        return
    if module is not None and getattr(module, "__file__", None):
        file = _file_of(Path(match["folder"]).expanduser().resolve(), match["module"])
        if Path(str(module.__file__)).resolve() == file:
            return
    reject(field, "a plain name, since the file is not trusted", path,
           "The import would run the code of the module. Read both files; then pass trusted=True in Python, "
           "or run `specklegen --trust COMMAND ...`.")  # fmt: skip


def _file_of(folder: Path, module: str) -> Path | None:
    """File of a module in a folder, if it is there."""
    place = folder.joinpath(*module.split("."))
    for file in (place.with_suffix(".py"), place / "__init__.py"):
        if file.is_file():
            return file.resolve()
    return None


def anchored(table: Any, folder: Path) -> Any:
    """Write the folder before import paths of a table, wherever their module lies in it or below.

    Nothing is imported: a table may be read, listed and shown without running what it names.
    """
    if isinstance(table, Mapping):
        return {name: _anchored(name, value, folder) for name, value in table.items()}
    return [anchored(each, folder) for each in table] if isinstance(table, list) else table


def _anchored(name: str, value: Any, folder: Path) -> Any:
    match = _PATH.fullmatch(value) if name in IMPORTABLE and isinstance(value, str) else None
    if match is None:
        return anchored(value, folder)
    place = (folder / Path(match["folder"] or "").expanduser()).resolve()
    here = match["folder"] is not None or _file_of(place, match["module"]) is not None
    return f"{place}/{match['module']}:{match['name']}" if here else value


def import_paths(table: Any) -> Iterator[str]:
    """Import paths of a table: what reading it as a value would run."""
    if isinstance(table, Mapping):
        for name, value in table.items():
            if name in IMPORTABLE and is_import_path(value):
                yield value
            yield from import_paths(value)
    elif isinstance(table, list):
        for each in table:
            yield from import_paths(each)


class Registry(Generic[T]):
    """Members of one kind by their names, in the order of their definition.

    Parameters
    ----------
    what
        The kind, as errors name it.
    accepts
        Whether something that an import path names is a member; by default subclasses of ``root`` are.
    members
        Those known from the beginning.
    """

    root: type = object

    def __init__(
        self, what: str, accepts: Callable[[Any], bool] | None = None, members: Mapping[str, T] | None = None
    ) -> None:
        self.what, self._accepts, self._members = what, accepts or self._is_subclass, dict(members or {})

    def _is_subclass(self, member: Any) -> bool:
        return isinstance(member, type) and issubclass(member, self.root)

    def add(self, name: str, member: T) -> None:
        """Make a member known; one of the same module and name takes the place of the old one, as in a notebook.

        Raise a `RuleError` if something else has the name.
        """
        known = self._members.get(name)
        if known is not None and _place(known) != _place(member):
            reject(f"{self.what} name", f"unique among names of {self.what}", name,
                   f"{_place(known)[0]} has the same name.")
        self._members[name] = member

    def find(self, field: str, name: object, beside: Collection[str] = ()) -> T:
        """Member of a name or of an import path; ``beside`` them the field takes other words, which an error lists."""
        if isinstance(name, str) and name in self._members:
            return self._members[name]
        if not is_import_path(name):
            reject(field, f"one of {', '.join([*beside, *self._members])}", name,
                   'For your own, import its module first, or write "module:Name".')  # fmt: skip
        member = imported(field, str(name))
        if not self._accepts(member):
            reject(field, f"the import path of a {self.what}", name, f"It is a {type(member).__name__}.")
        return member

    def name_of(self, member: T) -> str:
        """Name of a member."""
        return next(name for name, known in self._members.items() if known is member)

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self._members

    def __getitem__(self, name: str) -> T:
        return self._members[name]


def _place(member: Any) -> tuple[str, str]:
    return member.__module__, member.__qualname__
