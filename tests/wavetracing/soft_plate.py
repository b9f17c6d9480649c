"""A thin soft rectangle in space under a plane wave: the exact field by boundary elements, corners included.

On the plate, u = 0, the jump q of the normal derivative solves (Colton and Kress, *Inverse Acoustic and Electromagnetic
Scattering Theory*, section 3.2)

    int e^{ikR} / (4 pi R) q dA' = -u_inc,    u = u_inc + int e^{ikR} / (4 pi R) q dA'.

q is constant on each element of a grid that is finer towards the edges, x = a cos(pi i / n), as q grows there like one
over the root of the distance. The integral of 1 / R over an element is a closed form, the rest is smooth. The plate's
two mirrors make four problems of a quarter of its elements.
"""

import numpy as np

K = 2 * np.pi


class SoftPlate:
    """The solved plate |x| < a, |y| < b, z = 0, lit by e^{ik d.r}, wavelength 1, of n by n elements (n even)."""

    def __init__(self, a, b, direction, n):
        self.direction = np.asarray(direction, float)
        x, y = (-half * np.cos(np.pi * np.arange(n + 1) / n) for half in (a, b))
        self.middles = np.stack(np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2, indexing="ij"), axis=-1)
        sizes = np.stack(np.meshgrid(np.diff(x), np.diff(y), indexing="ij"), axis=-1)
        half, flips = slice(n // 2, n), (slice(None), slice(None, None, -1))
        at, size = self.middles[half, half].reshape(-1, 2), sizes[half, half].reshape(-1, 2)
        light = np.exp(1j * K * self.middles @ self.direction[:2])
        images = {(i, j): potential(at, at * [(-1) ** i, (-1) ** j], size) for i in (0, 1) for j in (0, 1)}
        q = np.zeros((n, n), complex)
        for u in (0, 1):
            for v in (0, 1):
                matrix = sum((-1) ** (u * i + v * j) * image for (i, j), image in images.items())
                part = sum((-1) ** (u * i + v * j) * light[flips[i], flips[j]] for i in (0, 1) for j in (0, 1)) / 4
                quarter = np.linalg.solve(matrix, -part[half, half].ravel()).reshape(n // 2, n // 2)
                whole = np.concatenate([(-1) ** u * quarter[::-1], quarter])
                q += np.concatenate([(-1) ** v * whole[:, ::-1], whole], axis=1)
        self.charges = q * sizes.prod(axis=-1)

    def field(self, points):
        """Total field at float64[P, 3], some elements away from the plate."""
        points = np.asarray(points, float)
        flat = points[:, None, :2] - self.middles.reshape(-1, 2)
        r = np.sqrt((flat**2).sum(axis=-1) + points[:, 2:] ** 2)
        return np.exp(1j * K * points @ self.direction) + (np.exp(1j * K * r) / (4 * np.pi * r)) @ self.charges.ravel()

    @property
    def extinguished(self):
        """Power that the plate takes out of the light, by the optical theorem, over that on its area aslant."""
        forward = (self.charges * np.exp(-1j * K * self.middles @ self.direction[:2])).sum() / (4 * np.pi)
        return float(4 * np.pi / K * forward.imag)


def potential(at, middles, sizes):
    """Integrals of e^{ikR} / (4 pi R) over rectangles, at points of their plane: complex128[at, rectangles]."""
    apart, nodes, weights = at[:, None] - middles, *np.polynomial.legendre.leggauss(2)
    total = 0
    for i in (-0.5, 0.5):
        for j in (-0.5, 0.5):
            x, y = np.moveaxis(apart + sizes * [i, j], -1, 0)
            r = np.hypot(x, y)
            total = total + np.sign(i * j) * (x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y)))
    for s, one in zip(nodes / 2, weights / 2, strict=True):
        for t, two in zip(nodes / 2, weights / 2, strict=True):
            r = np.hypot(*np.moveaxis(apart + sizes * [s, t], -1, 0))
            # (e^{ikR} - 1) / R, without a difference of equals
            total = total + one * two * sizes.prod(axis=-1) * 1j * K * np.exp(0.5j * K * r) * np.sinc(r)
    return total / (4 * np.pi)
