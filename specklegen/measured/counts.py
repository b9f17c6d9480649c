"""Bits and saturation of raw numbers, from the numbers themselves."""

from typing import NamedTuple

import numpy as np

from specklegen.core.arguments import whole_number
from specklegen.core.errors import reject

DEPTHS = (8, 10, 12, 14, 16)
"""Bits of the converters that are sold."""
_MOST_VALUES = 2**24  # numbers that are looked at where they do not index a table
_PILE = 8  # pixels at the largest count from which they are a pile
_STEEP = 8.0  # times as many as at the levels below it


class Range(NamedTuple):
    """Range of a camera's counts.

    Attributes
    ----------
    step : int
        Distance of two counts in the file; 16 for 12 bits kept in the upper part of 16.
    bit_depth : int or None
        None for numbers that are not whole.
    largest : float or None
        Number at which pixels saturate; None where none is known and no pile of pixels shows one.
    """

    step: int
    bit_depth: int | None
    largest: float | None
    assumed: tuple[str, ...]
    doubts: tuple[str, ...]


def found_range(raw: np.ndarray, bit_depth: int | None, field: str) -> Range:
    """Find bits and saturation of raw numbers[n, h, w]; ``bit_depth`` where they are known."""
    finite = raw if raw.dtype.kind != "f" else raw[np.isfinite(raw)]
    values, numbers = _histogram(finite)
    whole = not (values % 1).any() and values[0] >= 0
    if bit_depth is not None:
        whole_number(f"{field} bit_depth", bit_depth, 1, 16)
    if not whole:
        if bit_depth is not None:
            reject(f"{field} bit_depth", "left out, since numbers are not whole counts", bit_depth)
        top = float(values[-1]) if _piled(values, numbers, 0.0) else None
        return Range(1, None, top, ("numbers are not whole: these are no raw counts, and the bit depth is unknown",),
                     ())
    step = _step(values)
    highest = int(values[-1]) // step
    needed = max(1, highest.bit_length())
    assumed = [f"counts have steps of {step}: the lowest {step.bit_length() - 1} bits are empty"] if step > 1 else []
    if bit_depth is not None:
        if needed > bit_depth:
            reject(f"{field} bit_depth", f"enough for counts of {highest}, {needed} bits", bit_depth)
        return Range(step, bit_depth, float(step * (2**bit_depth - 1)), (*assumed, f"{bit_depth} bits, as given"), ())
    if highest + 1 == 2**needed and needed in DEPTHS and numbers[-1] > 1:
        return Range(step, needed, float(values[-1]), tuple(assumed), ())
    bits = 8 if raw.dtype.itemsize == 1 and step == 1 else next((depth for depth in DEPTHS if depth >= needed), None)
    basis = f"no count reaches the end of the range: {bits} bits are the fewest that hold {highest}, not measured"
    if bits == 8 and raw.dtype.itemsize == 1:
        basis = "8 bits, from the type of the file"
    if _piled(values, numbers, float(step)):
        doubt = f"pixels pile up at {int(values[-1])}, which is not the end of {bits} bits: assumed to be saturation"
        return Range(step, bits, float(values[-1]), (*assumed, basis), (doubt,))
    return Range(step, bits, None, (*assumed, basis if bits else "counts of more than 16 bits: no camera has these"),
                 ())


def _histogram(raw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values that occur, ascending, and how often."""
    if raw.dtype.kind in "bu" and raw.dtype.itemsize <= 2:
        numbers = np.bincount(raw.ravel())
        values = np.flatnonzero(numbers)
        return values, numbers[values]
    if raw.size > _MOST_VALUES:  # every so many, and the largest
        some = raw.ravel()[:: raw.size // _MOST_VALUES + 1]
        return np.unique(np.append(some, raw.max()), return_counts=True)
    return np.unique(raw, return_counts=True)


def _step(values: np.ndarray) -> int:
    """Power of two that all counts are multiples of, where enough of them occur to tell."""
    if len(values) < 16 or values[-1] >= 2**53:
        return 1
    common = int(np.gcd.reduce(values.astype(np.int64)))
    return common & -common if common else 1


def _piled(values: np.ndarray, numbers: np.ndarray, step: float) -> bool:
    """Return whether many pixels have the very largest number, and far more than the numbers just below it."""
    if len(values) < 16 or numbers[-1] < _PILE:
        return False
    near = numbers[-9:-1] if step == 0 else numbers[:-1][values[:-1] >= values[-1] - 8 * step]
    return bool(numbers[-1] > _STEEP * max(1.0, float(near.sum()) / 8))
