"""A literal NumPy transcription of physics.md 2 for one bank: what the kernels must agree with.

Written from the formulas, in absolute phases and long double; it shares no code with specklegen.kernels.
"""

import numpy as np

LONG_PI = np.longdouble("3.14159265358979323846264338327950288")


def phase_function(g: float, cos: np.ndarray) -> np.ndarray:
    return (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * cos) ** 1.5)


def way_out(z: np.ndarray, vz: float | np.ndarray, thickness: float) -> np.ndarray:
    """Length inside the slab on leaving from depth z along vz."""
    return np.where(vz > 0, (thickness - z) / vz, -z / vz)


def beam_profile(profile: str, width: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    if profile == "square":
        return ((np.abs(x) <= width / 2) & (np.abs(y) <= width / 2)).astype(float)
    if profile == "disc":
        return (np.hypot(x, y) <= width / 2).astype(float)
    if profile == "gaussian":
        return np.exp(-4 * (x**2 + y**2) / width**2)
    return np.ones_like(x)  # an unlimited plane wave


def entrance_power(bank, medium, light: np.ndarray, profile: str, width: float) -> np.ndarray:
    """W |A|^2 of each connection, without the phase function for single scattering."""
    x, y, z = bank.entry.T
    beam = beam_profile(profile, width, x - z * light[0] / light[2], y - z * light[1] / light[2])
    power = bank.weight * beam**2 / light[2] * np.exp(-medium.extinction * z / light[2])
    first = phase_function(medium.scatterer.g, bank.entry_direction @ light)
    return power * np.where(bank.orders > 1, first, 1.0)


def connection_weights(bank, medium, light, view, profile: str, width: float) -> np.ndarray:
    """w = W |A|^2 |B|^2 of each connection, whose sum over the number of paths is the intensity."""
    arriving = np.where(bank.orders[:, None] > 1, bank.exit_direction, light)
    out = phase_function(medium.scatterer.g, arriving @ view)
    out = out * np.exp(-medium.extinction * way_out(bank.exit[:, 2], view[2], medium.thickness))
    return entrance_power(bank, medium, light, profile, width) * out


def turns(direction: np.ndarray, points: np.ndarray, wavelength: float) -> np.ndarray:
    """direction . x / wavelength in long double, the last component from the others' exact unit length."""
    d = direction.astype(np.longdouble)
    d[2] = np.sign(direction[2]) * np.sqrt(1 - d[0] ** 2 - d[1] ** 2)
    return (points.astype(np.longdouble) @ d) / np.longdouble(wavelength)


def phasor(t: np.ndarray) -> np.ndarray:
    angle = 2 * LONG_PI * (t - np.rint(t))
    return np.cos(angle).astype(float) + 1j * np.sin(angle).astype(float)


def field(bank, medium, wavelength, lights, views, phases, references, profile, width, *, reverse=False) -> np.ndarray:
    """u complex128[T, V]: a = A_i(x1, w1) B_v(xB, wB), plus a^r = A_i(xB, -wB) B_v(x1, -w1). ``references`` = (i_ref,
    v_ref): a connection's random phase is relative to k (i_ref . x1 - v_ref . xB)."""
    g, thickness, sigma = medium.scatterer.g, medium.thickness, medium.extinction
    common = turns(references[0], bank.entry, wavelength) - turns(references[1], bank.exit, wavelength)
    single = bank.orders == 1

    def amplitude(first, leaving, last, arriving, light, view):
        x, y, z = first.T
        beam = beam_profile(profile, width, x - z * light[0] / light[2], y - z * light[1] / light[2])
        cos_in = np.where(single, light @ view, leaving @ light)
        power = phase_function(g, cos_in) * np.where(single, 1.0, phase_function(g, arriving @ view))
        attenuation = np.exp(-sigma * (z / light[2] + way_out(last[:, 2], view[2], thickness)))
        modulus = beam * np.sqrt(bank.weight * power * attenuation / light[2])
        return modulus * phasor(turns(light, first, wavelength) - turns(view, last, wavelength) - common)

    u = np.zeros((len(lights), len(views)), complex)
    for t, light in enumerate(lights):
        for v, view in enumerate(views):
            a = amplitude(bank.entry, bank.entry_direction, bank.exit, bank.exit_direction, light, view)
            if reverse:
                back = amplitude(bank.exit, -bank.exit_direction, bank.entry, -bank.entry_direction, light, view)
                a = a + np.where(single, 0, back)
            u[t, v] = (phases * a).sum()
    return u / np.sqrt(bank.count)
