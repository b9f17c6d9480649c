"""Endpoint factors of connections, and their amplitudes sqrt(W) a at every light and view, forward and reversed.

    a = A_i(x1, w1) B_v(x_B, w_(B-1)),    a^r = A_i(x_B, -w_(B-1)) B_v(x1, -w1)        docs/physics.md 2

Single scattering is its own reverse; its s(i . v) joins both ends.
"""

from typing import Literal

import numpy as np

from specklegen.core.parallel import Threads, map_blocks, slices
from specklegen.kernels import endpoints as kernels
from specklegen.kernels import legs, walk
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoints import Endpoints
from specklegen.paths.faces import crossing_factors
from specklegen.paths.kept_angles import each_light
from specklegen.paths.layout import Layout
from specklegen.paths.legs import Ways
from specklegen.paths.phases import reversal_phases

End = Literal["entry", "exit"]
# Position's column, the sign that makes the direction beside it arrive at the end, and the particle's column.
_COLUMNS = {"entry": (walk.ENTRY, -1.0, 0), "exit": (walk.EXIT, 1.0, 1)}
_VIEWS_AT_ONCE = 64
_NO_PHASES = np.empty((0, 3))
BLOCK = 16384
"""Connections whose factors are found at a time; each stands alone, so the size changes no bit."""


def endpoint_factors(
    layout: Layout, bank: PathBank, endpoints: Endpoints, end: End, threads: Threads = 1,
    turns: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """complex128[n, M]: profile, attenuation, faces, phase, decay and scattering between one end and each endpoint.

    Parameters
    ----------
    endpoints
        Lights or views of the layout, or others of their kind.
    end
        Which end of the connections.
    turns
        Phases float64[n, 3] in turns per unit length instead of those of the directions; float64[0, 3] for none.
    """
    if layout.ways is not None:
        return _along_legs(layout, layout.ways, bank, endpoints, end, threads, turns)
    column, sign, side = _COLUMNS[end]
    turns = endpoints.turns if turns is None else turns
    vectors = np.ascontiguousarray(endpoints.vectors)
    out = np.empty((len(vectors), len(bank)), np.complex128)

    def part(start: int) -> None:
        stop = start + _VIEWS_AT_ONCE
        kernels.endpoint_factors(
            layout.volume, layout.table, bank.records, column, sign, bank.types, side,
            kernels.Targets(endpoints.near, vectors[start:stop], turns[start:stop]), endpoints.wavelength,
            endpoints.footprint, endpoints.radius, out[start:stop],
        )  # fmt: skip
        if not layout.faces.matched:
            out[start:stop] *= crossing_factors(layout.faces, vectors[start:stop], bank.bounces[:, side])

    map_blocks(part, range(0, len(out), _VIEWS_AT_ONCE), threads)
    return out


def _along_legs(
    layout: Layout, ways: Ways, bank: PathBank, endpoints: Endpoints, end: End, threads: Threads,
    turns: np.ndarray | None,
) -> np.ndarray:  # fmt: skip
    """Factors through layers that refract, along the legs of the connections."""
    column, sign, side = _COLUMNS[end]
    lateral = np.ascontiguousarray((endpoints.turns if turns is None else turns)[:, :2])
    numbers = np.ascontiguousarray(bank.bounces[:, side])
    out = np.empty((len(lateral), len(bank)), np.complex128)
    lights = endpoints.radius > 0

    def part(start: int) -> None:
        some = slice(start, start + _VIEWS_AT_ONCE)
        vectors, way = endpoints.vectors[some], ways.lights if lights else ways.views
        known = way.towards(vectors, endpoints.wavelength, lateral[some], lights=lights)
        legs.leg_factors(layout.table, known, lateral[some], bank.records, column, sign, bank.types, side, numbers,
                         endpoints.footprint, endpoints.radius, out[some])  # fmt: skip

    map_blocks(part, range(0, len(out), _VIEWS_AT_ONCE), threads)
    return out


def light_strengths(layout: Layout, bank: PathBank, factors: np.ndarray, threads: Threads = 1) -> np.ndarray:
    """complex128[T, M], factor_m sqrt(W_m) A_t(m) of the entrances, in blocks of connections."""
    out = np.empty((len(layout.lights), len(bank)), np.complex128)

    def block(part: slice) -> None:
        some = bank.select(part)
        out[:, part] = endpoint_factors(layout, some, layout.lights, "entry") * (np.sqrt(some.weight) * factors[part])

    map_blocks(block, slices(len(bank), BLOCK), threads)
    return out


def single_factors(layout: Layout, bank: PathBank) -> np.ndarray:
    """complex128[T, V, M], s(i . v) of connections of single scattering; [T, V, 1] where all share it."""
    if layout.ways is not None:
        return _single_along_legs(layout, layout.ways, bank)
    lights, views = layout.lights, layout.views
    turned = turned_over(bank)
    kinds = turned if layout.polarised is None else _kinds(layout, bank)
    if len(bank) and (kinds != kinds[0]).any():
        out = np.empty((len(lights), len(views), len(bank)), np.complex128)
        for kind in np.unique(kinds):
            out[..., kinds == kind] = single_factors(layout, bank.select(kinds == kind))
        return out
    if not (lights.near or views.near) and len(layout.table.kinds) == 1:
        bank = bank.select(slice(0, 1))
    out = np.empty((len(lights), len(views), len(bank)), np.complex128)
    passed = None
    if layout.polarised is not None:
        (before, behind), kind = (bank.bounces[0], int(bank.types[0, 0])) if len(bank) else ((0, 0), 0)
        passed = layout.polarised.single(-lights.vectors, views.vectors, (int(before), int(behind)), kind)
    seen = views.vectors * np.array([1.0, 1.0, -1.0]) if turned.any() else views.vectors
    kernels.single_factors(layout.table, bank.records, bank.types, lights.near, np.ascontiguousarray(lights.vectors),
                           views.near, np.ascontiguousarray(seen), out)  # fmt: skip
    return out if passed is None else out * passed[..., None]


def _single_along_legs(layout: Layout, ways: Ways, bank: PathBank) -> np.ndarray:
    """Factors through layers that refract: for each pair of legs, light and view have their own directions."""
    lights = ways.lights.towards(layout.lights.vectors, lights=True).rows
    views = ways.views.towards(layout.views.vectors, lights=False).rows
    out = np.empty((len(lights), len(views), len(bank)), np.complex128)
    pairs, which = np.unique(np.column_stack([bank.bounces, bank.types[:, :1]]), axis=0, return_inverse=True)
    for n, (one, other, _) in enumerate(pairs):
        like = np.flatnonzero(which == n)
        factors = np.empty((len(lights), len(views), 1), np.complex128)
        alike = bank.select(like[:1])
        kernels.single_factors(layout.table, alike.records, alike.types, 0, np.ascontiguousarray(lights[:, one, :3]), 0,
                               np.ascontiguousarray(views[:, other, :3]), factors)  # fmt: skip
        out[..., like] = factors
    return out


def _kinds(layout: Layout, bank: PathBank) -> np.ndarray:
    """Numbers int64[M] that are equal where one scattering does the same to the polarisation of light."""
    types = bank.types[:, 0] if len(layout.table.kinds) > 1 else np.zeros(len(bank), np.int64)
    return (types.astype(np.int64) * 16 + bank.bounces[:, 0]) * 16 + bank.bounces[:, 1]


def turned_over(bank: PathBank) -> np.ndarray:
    """bool[M], connections whose legs are reflected an odd number of times in all: i . v is that of a mirrored view."""
    return bank.bounces.sum(axis=1) % 2 == 1


def single_amplitudes(layout: Layout, bank: PathBank, threads: Threads = 1) -> np.ndarray:
    """Amplitudes sqrt(W) a of a bank of single scattering, complex128[T * V, M]."""
    lights = endpoint_factors(layout, bank, layout.lights, "entry", threads) * np.sqrt(bank.weight)
    views = endpoint_factors(layout, bank, layout.views, "exit", threads)
    pairs = _pairs(lights, views)
    return pairs * single_factors(layout, bank).reshape(len(pairs), -1) if pairs.size else pairs


def multiple_amplitudes(
    layout: Layout, bank: PathBank, *, bidirectional: bool, reverse: bool, threads: Threads = 1
) -> np.ndarray:
    """Amplitudes sqrt(W) a of a bank of multiple scattering, complex128[T * V, n].

    Where paths serve both ways, ``reverse`` adds both amplitudes into one column; without it the two ways
    are columns of their own, incoherent with each other.
    """
    if layout.middle is not None:
        return _by_light(layout, bank, bidirectional, reverse, threads)
    if layout.polarised is not None:
        forward = _polarised(layout, bank, np.ones(1), threads)
        if not bidirectional:
            return forward
        backward = _polarised(layout, bank.reversed(), reversal_phases(layout, bank), threads)
        return forward + backward if reverse else np.concatenate([forward, backward], axis=1)
    root = np.sqrt(bank.weight)
    forward = _pairs(
        endpoint_factors(layout, bank, layout.lights, "entry", threads) * root,
        endpoint_factors(layout, bank, layout.views, "exit", threads),
    )
    if not bidirectional:
        return forward
    backward = _pairs(
        endpoint_factors(layout, bank, layout.lights, "exit", threads) * (root * reversal_phases(layout, bank)),
        endpoint_factors(layout, bank, layout.views, "entry", threads),
    )
    return forward + backward if reverse else np.concatenate([forward, backward], axis=1)


def _polarised(layout: Layout, bank: PathBank, phases: np.ndarray, threads: Threads) -> np.ndarray:
    """Amplitudes of polarised light one way: both components in which it arrives at x_B, through the analyser."""
    assert layout.polarised is not None, "asked for"
    lights = endpoint_factors(layout, bank, layout.lights, "entry", threads) * (np.sqrt(bank.weight) * phases)
    views = endpoint_factors(layout, bank, layout.views, "exit", threads)
    into = layout.polarised.arriving(bank, -layout.lights.vectors)
    out = layout.polarised.passing(bank, layout.views.vectors)
    return _pairs(lights * into[0], views * out[0]) + _pairs(lights * into[1], views * out[1])


def _by_light(layout: Layout, bank: PathBank, bidirectional: bool, reverse: bool, threads: Threads) -> np.ndarray:
    """Factors of lights that keep their angles to phase functions: for each by its own ends."""

    def amplitudes(some: PathBank) -> np.ndarray:
        out = np.empty((len(layout.lights), len(layout.views), len(some)), np.complex128)
        for light, own, seen, phases in each_light(layout, some, np.ones(len(some), np.complex128)):
            ends = endpoint_factors(own, seen, own.lights, "entry", threads) * (np.sqrt(seen.weight) * phases)
            out[light] = endpoint_factors(own, seen, own.views, "exit", threads) * ends
        return out.reshape(len(layout.lights) * len(layout.views), len(some))  # there may be no paths

    forward = amplitudes(bank)
    if not bidirectional:
        return forward
    backward = amplitudes(bank.reversed()) * reversal_phases(layout, bank)
    return forward + backward if reverse else np.concatenate([forward, backward], axis=1)


def contributions(layout: Layout, bank: PathBank) -> np.ndarray:
    """float64[M], w = W |A|^2 |B|^2 for the one light and view of a layout; its mean over paths is the intensity."""
    return contributions_of_pairs(layout, bank)[0, 0]


def contributions_of_pairs(layout: Layout, bank: PathBank) -> np.ndarray:
    """float64[T, V, M], the same for every light and view of a layout; each end of a connection is looked at once."""
    lights = bank.weight * _end_powers(layout, bank, layout.lights, "entry")
    power = lights[:, None] * _end_powers(layout, bank, layout.views, "exit")
    once = np.flatnonzero(bank.orders == 1)
    if layout.polarised is not None:
        often = np.flatnonzero(bank.orders != 1)
        many = bank.select(often)
        into = layout.polarised.arriving(many, -layout.lights.vectors)
        out = layout.polarised.passing(many, layout.views.vectors)
        power[..., often] *= np.square(np.abs((into[:, :, None] * out[:, None]).sum(axis=0)))
    if len(once):
        power[..., once] *= np.square(np.abs(single_factors(layout, bank.select(once))))
    return power


def _end_powers(layout: Layout, bank: PathBank, endpoints: Endpoints, end: End) -> np.ndarray:
    """float64[n, M], |.|^2 of the factors of one end, whose phases nobody then needs."""
    factors = endpoint_factors(layout, bank, endpoints, end, turns=None if layout.ways is not None else _NO_PHASES)
    return np.square(factors.real) + np.square(factors.imag)


def _pairs(lights: np.ndarray, views: np.ndarray) -> np.ndarray:
    return (lights[:, None] * views).reshape(len(lights) * len(views), lights.shape[1])
