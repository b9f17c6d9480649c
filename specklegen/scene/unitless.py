"""Fingerprints that no unit of length changes."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from specklegen.core.quantities import Node, nodes_in, nodes_of
from specklegen.core.values import IDENTITY, Value


def unitless_fingerprint(value: Value, unit: float) -> str:
    """SHA-256 of a value with every length over ``unit``, to 9 digits: the same in any unit, on any processor.

    Components of unit vectors are rounded as lengths are: where one was computed, its last bit is the processor's.
    """
    content = _unitless_table(value.model_dump(mode="json", context=IDENTITY), nodes_of(type(value)), unit)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _unitless_table(table: dict[str, Any], nodes: Mapping[str, Node], unit: float) -> dict[str, Any]:
    """JSON of a value; motions decide no path."""
    return {name: _unitless(each, nodes.get(name), unit) for name, each in table.items() if name != "motion"}


def _unitless(content: Any, node: Node | None, unit: float) -> Any:
    """JSON with every number rounded, and lengths by their power of the unit."""
    if isinstance(content, dict):
        return _unitless_table(content, {} if node is None else nodes_in(node, content), unit)
    dimension = None if node is None else node.dimension
    power = dimension.length if dimension is not None and dimension.scaled else None
    if isinstance(content, list):
        if power is None and isinstance(next(iter(content), None), float):  # millions of pixels stay as they are
            return content
        return [_unitless(each, node, unit) for each in content]
    if isinstance(content, float) or power:
        return float(f"{content / unit ** (power or 0):.9g}")
    return content
