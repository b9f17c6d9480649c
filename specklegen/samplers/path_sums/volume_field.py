"""Fields in any geometry: Algorithms 2 and 4 of [Bar19].

u(t, v) = N^(-1/2) sum over connections of z sqrt(W) a_tv,    z = e^(2 pi i zeta), the same for all t and v
"""

import numpy as np

from specklegen.core.parallel import Threads, map_blocks, one_blas_thread
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.kernels import sums
from specklegen.paths.endpoint_factors import End, endpoint_factors, single_factors
from specklegen.paths.tracer import Tracer, VolumeBank

FIELD_ELEMENTS = 2**21  # of the largest array of ends held at a time
VIEWS_AT_ONCE = 128  # per block of parallel work


def volume_field(
    tracer: Tracer,
    bank: VolumeBank,
    seed: Seed,
    sample: int = 0,
    *,
    reverse: bool,
    threads: Threads = None,
) -> np.ndarray:
    """Field of a bank, complex128[T, V], divided by the root of the number of paths.

    Random phases are addressed by (path, order). Without ``reverse``, a path that serves both ways adds its
    two amplitudes with phases of their own.
    """
    lights, views = tracer.lights.vectors, tracer.views.vectors
    field = np.zeros((len(lights), len(views)), np.complex128)
    step = max(64, FIELD_ELEMENTS // max(len(lights) + len(views), 1))
    with one_blas_thread():
        for start in range(0, len(bank), step):
            _add(tracer, bank.select(slice(start, start + step)), seed, sample, reverse, field, threads)
    return field / np.sqrt(max(bank.count, 1))


def _add(
    tracer: Tracer, bank: VolumeBank, seed: Seed, sample: int, reverse: bool, field: np.ndarray, threads: Threads
) -> None:
    once, more = bank.single, bank.multiple
    z_once, _ = random_phases(once, seed, sample)
    z_more, z_back = random_phases(more, seed, sample)
    lit_once = endpoint_factors(tracer, once, tracer.lights, "entry") * (np.sqrt(once.weight) * z_once)
    lit = endpoint_factors(tracer, more, tracer.lights, "entry") * (np.sqrt(more.weight) * z_more)
    ways: list[tuple[np.ndarray, End]] = [(lit, "exit")]
    if tracer.bidirectional:
        factor = np.sqrt(more.weight) * (z_more if reverse else z_back)
        ways.append((endpoint_factors(tracer, more, tracer.lights, "exit") * factor, "entry"))

    def block(start: int) -> None:
        part = slice(start, start + VIEWS_AT_ONCE)
        few = tracer.of_ends(slice(None), part)
        if len(once):
            ends = endpoint_factors(few, once, few.views, "exit")
            s = single_factors(few, once)
            field[:, part] += (
                s[..., 0] * (lit_once @ ends.T) if s.shape[-1] == 1 else np.einsum("tm,vm,tvm->tv", lit_once, ends, s)
            )
        for light, end in ways:
            field[:, part] += light @ endpoint_factors(few, more, few.views, end).T

    map_blocks(block, range(0, field.shape[1], VIEWS_AT_ONCE), threads)


def random_phases(bank: VolumeBank, seed: Seed, sample: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Unit phasors complex128[M] of every connection, and of its reverse where that is independent."""
    first, second = np.empty((2, len(bank)), np.complex128)
    key = stream_key(seed, Stream.PHASES)
    sums.random_phases(*key, sample, bank.orders, bank.paths, first)
    # Orders are positive: the negative ones address other draws.
    sums.random_phases(*key, sample, -bank.orders, bank.paths, second)
    return first, second
