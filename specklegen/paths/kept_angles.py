"""Lights that keep their angle to narrow phase functions: the ends of paths turn with each of them.

    s(i_t . w_1) -> s(i_0 . w_1),    s(w_(B-1) . v) -> s(w_(B-1) . (v - t)),    t = i_t - i_0 sideways

i_0 is the middle of all lights. In the near field of a phase function the ladder of multiple scattering conserves the
difference k t of two waves at every collision (:mod:`specklegen.paths.far_field`); the path of light i_t has
every direction turned by the tilt: w_1 as i_0 is turned to i_t, w_(B-1) by t in direction sines, which is what its
phase function sees of v - t. Phases, attenuation, profile and faces stay those of i_t and v. Between both ends every
segment advances more slowly along z, by what the tilt adds in second order, which the ends alone would take from long
paths only in part:

    e^(i k c (z_B - z_1)),    c = i_t,z - i_0,z + t . i_0 / i_0,z,    -t^2 / 2 about the axis

All light then moves with its beam, I_t(v) = I_0(v - t), and the correlation of two lights is that of lateral ways,
K = E[w e^(-i k dt . R)] / E[w], whatever lies in their middle. Single scattering is a function of i_t . v, which is
that of i_0 . (v - t). docs/physics.md 10.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from specklegen.kernels import walk
from specklegen.paths.bank import PathBank
from specklegen.paths.layout import Layout

_ENTRY = slice(walk.ENTRY_DIRECTION, walk.ENTRY_DIRECTION + 3)
_EXIT = slice(walk.EXIT_DIRECTION, walk.EXIT_DIRECTION + 3)


class Seen(NamedTuple):
    """Connections as some lights see them.

    Attributes
    ----------
    lights : slice
        Which lights of the layout.
    layout : Layout
        With these alone.
    phases : complex128[M]
        Of the connections, whatever random ones they have.
    """

    lights: slice
    layout: Layout
    bank: PathBank
    phases: np.ndarray


def each_light(layout: Layout, bank: PathBank, phases: np.ndarray) -> Iterator[Seen]:
    """Connections as all lights see them at once, or as one after the other does, where they keep their angles.

    Of paths walked backwards, give those (:meth:`specklegen.paths.bank.PathBank.reversed`).
    """
    if layout.middle is None:
        yield Seen(slice(0, len(layout.lights)), layout, bank, phases)
        return
    for n in range(len(layout.lights)):
        one = slice(n, n + 1)
        own = layout.of_lights(one)
        light = -own.lights.vectors[0]
        turns = advance(layout.middle, light) / layout.wavelength * depth_between(layout, bank)
        turned = phases * np.exp(2j * np.pi * (turns - np.rint(turns)))
        yield Seen(one, own, _turned(bank, layout.middle, light), turned)


def advance(middle: np.ndarray, light: np.ndarray) -> float:
    """i_t,z - i_0,z beyond first order in the tilt: what each length of depth adds to the phase, over k."""
    tilt = light[:2] - middle[:2]
    first = -float(tilt @ middle[:2]) / middle[2]
    # i_t,z - i_0,z = -t . (i_t + i_0) / (i_t,z + i_0,z), without cancellation
    return -float(tilt @ (light[:2] + middle[:2])) / (light[2] + middle[2]) - first


def spread_exits(layout: Layout, bank: PathBank) -> PathBank:
    """A bank whose paths arrive as those of a few lights do, the farthest among them, each of one: for pilots."""
    if layout.middle is None or not len(layout.lights):
        return bank
    aside = -layout.lights.vectors[:, :2] - layout.middle[:2]
    few = np.linspace(0, len(aside) - 1, 5).round().astype(int)
    few = np.unique(np.append(few, np.square(aside).sum(axis=1).argmax()))
    records = bank.records.copy()
    multiple = bank.orders > 1
    own = aside[few[np.arange(len(bank)) // 2 % len(few)]]  # either half of a pilot has all of them
    records[multiple, _EXIT] = _sideways(bank.exit_direction[multiple], own[multiple])
    return replace(bank, records=records)


def depth_between(layout: Layout, bank: PathBank) -> np.ndarray:
    """z_B - z_1 float64[M] of paths that arrive forwards, as they lie in the medium; else 0."""
    thickness = layout.volume.bounds[1, 2]
    first, last = (np.mod(each[:, 2], 2 * thickness) for each in (bank.entry, bank.exit))  # reflections are unfolded
    between = np.minimum(last, 2 * thickness - last) - np.minimum(first, 2 * thickness - first)
    return np.where(bank.exit_direction[:, 2] > 0, between, 0.0)


def _turned(bank: PathBank, middle: np.ndarray, light: np.ndarray) -> PathBank:
    """The bank as a light float64[3] sees it; single scattering has no directions."""
    records, multiple = bank.records.copy(), bank.orders > 1
    records[multiple, _ENTRY] = _rotated(bank.entry_direction[multiple], middle, light)
    records[multiple, _EXIT] = _sideways(bank.exit_direction[multiple], light[:2] - middle[:2])
    return replace(bank, records=records)


def _rotated(directions: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """float64[n, 3], turned as one unit vector is turned to another less than a half turn away."""
    axis = np.cross(one, other)
    along = (directions @ axis)[:, None] * axis / (1 + one @ other)
    return directions * (one @ other) + np.cross(axis, directions) + along


def _sideways(directions: np.ndarray, sines: np.ndarray) -> np.ndarray:
    """float64[n, 3], directions of other sines on the same side; what would leave the half space grazes its plane."""
    aside = directions[:, :2] + sines
    aside /= np.maximum(np.hypot(*aside.T), 1.0)[:, None]
    along = np.sqrt(np.clip(1 - np.square(aside).sum(axis=1), 0, None))
    return np.column_stack([aside, np.copysign(along, directions[:, 2])])
