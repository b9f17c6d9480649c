"""Reading tables that people write: TOML and JSON, from a text or a file.

Whatever is wrong with a file (it cannot be read, it is no text, it is nested without end, it holds a number of
thousands of digits) becomes a :class:`RuleError` that names it.
"""

import json
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from specklegen.core.errors import reject
from specklegen.core.file_limits import DEEPEST, LARGEST_TEXT


def read_text(path: Path, field: str) -> str:
    """Read a text file that a user named.

    Raise a `RuleError` if there is no such file, or it cannot be read, is too large or is no text in UTF-8.
    """
    try:
        if not path.is_file():
            reject(field, "an existing file", str(path))
        if path.stat().st_size > LARGEST_TEXT:
            reject(field, f"a text file of at most {LARGEST_TEXT // 2**20} MiB", str(path))
        return path.read_text(encoding="utf-8")
    except OSError as error:
        reject(field, "a readable file", str(path), str(error.strerror or error))
    except UnicodeDecodeError:
        reject(field, "a text file in UTF-8", str(path))


def toml_table(text: str, field: str) -> dict[str, Any]:
    """Parse TOML."""
    return _table(tomllib.loads, text, field, "valid TOML")


def json_table(text: str, field: str) -> dict[str, Any]:
    """Parse a JSON object."""
    return _table(json.loads, text, field, "a JSON object")


def _table(parse: Callable[[str], Any], text: str, field: str, rule: str) -> dict[str, Any]:
    try:
        table = parse(text)
    except RecursionError:
        reject(field, f"nested at most {DEEPEST} levels deep", text)
    except ValueError as error:  # of both parsers, and of whole numbers with too many digits
        reject(field, rule, text, f"{str(error).partition(';')[0]}.")
    if not isinstance(table, dict):
        reject(field, rule, table)
    if _deeper(table, DEEPEST):
        reject(field, f"nested at most {DEEPEST} levels deep", text)
    return table


def _deeper(value: object, levels: int) -> bool:
    """Return whether tables and lists lie inside one another more than ``levels`` deep; without recursion."""
    layer = [value]
    for _ in range(levels + 1):
        layer = [inner for outer in layer for inner in _inside(outer)]
        if not layer:
            return False
    return True


def _inside(value: object) -> list[Any]:
    return list(value.values() if isinstance(value, Mapping) else value) if isinstance(value, Mapping | list) else []
