"""Changes to a recipe written as text: ``material.g=0.8``."""

from collections.abc import Iterable
from typing import Any

from specklegen.core.errors import RuleError, reject
from specklegen.core.tables import toml_table
from specklegen.datasets.recipes.recipe_files import merged


def changes_of(texts: Iterable[str]) -> dict[str, Any]:
    """Nested table of changes from texts KEY=VALUE; a key is dotted, a value is TOML (a bare word is a text)."""
    table: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            reject("a change", "of the form KEY=VALUE, such as material.g=0.8", text)
        table = merged(table, _parse(key.strip(), value.strip(), text))
    return table


def _parse(key: str, value: str, text: str) -> dict[str, Any]:
    for candidate in (value, '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'):
        try:
            return toml_table(f"{key} = {candidate}", "a change")
        except RuleError:
            continue
    reject("a change", "of the form KEY=VALUE with a dotted key, such as material.g=0.8", text)
