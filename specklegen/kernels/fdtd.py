"""One-dimensional Yee marches, the exact frequency-domain solution of the same grid, and AR(1) media.

Everything is in grid units: e = E, h = (background impedance) H, S = c_b dt/dx the background Courant
number, kappa = (n/n_b)^2 - 1 the relative permittivity fluctuation at the E nodes.

    h_{k+1/2} -= S (e_{k+1} - e_k);      e_k -= S / (1 + kappa_k) (h_{k+1/2} - h_{k-1/2})

The layer occupies cells ``margin .. margin + N - 1`` of ``N + 2 margin``; both ends are first-order Mur
boundaries of coefficient ``mur``, and a march records e at the first and at the last cell of the layer.
Sample n of a record is the field after step n.
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.rng import uniforms


@kernel
def correlated_normals(key0, key1, first, rho, innovation, out):
    """Fill ``out`` float64[R, N] with stationary AR(1) sequences of unit variance.

    Row r is realization ``first + r``: a pure function of the key and of that number. ``g_0 = w_0``;
    ``g_{k+1} = rho g_k + innovation w_{k+1}``, ``innovation = sqrt(1 - rho^2)``, w standard normal.
    """
    realizations, cells = out.shape
    for r in range(realizations):
        g = 0.0
        for block in range((cells + 3) // 4):
            u0, u1, u2, u3 = uniforms(key0, key1, np.uint64(first + r), np.uint64(block), np.uint64(0))
            radius0, radius1 = math.sqrt(-2.0 * math.log(u0)), math.sqrt(-2.0 * math.log(u2))
            angle0, angle1 = 2.0 * math.pi * u1, 2.0 * math.pi * u3
            w = (
                radius0 * math.cos(angle0),
                radius0 * math.sin(angle0),
                radius1 * math.cos(angle1),
                radius1 * math.sin(angle1),
            )
            for j in range(min(4, cells - 4 * block)):
                k = 4 * block + j
                g = w[j] if k == 0 else rho * g + innovation * w[j]
                out[r, k] = g


@inlined
def _advance_h(e, h, courant):
    for k in range(h.size):
        h[k] -= courant * (e[k + 1] - e[k])


@inlined
def _mur(e, left, right, coefficient):
    """Close both ends; ``left`` and ``right`` are the neighbours' values of one step ago."""
    last = e.size - 1
    e[0] = left + coefficient * (e[1] - e[0])
    e[last] = right + coefficient * (e[last - 1] - e[last])


@kernel
def march_total(kappa, courant, mur, margin, source, source_cell, first, last):
    """March the total field of every medium; ``first``, ``last`` float64[R, T] receive the records.

    ``source`` float64[T] is soft: it emits its own amplitude each way (1/cos(theta/2) of it on the grid).
    """
    realizations, cells = kappa.shape
    size = cells + 2 * margin
    coefficient = np.full(size, courant)
    e, h = np.empty(size), np.empty(size - 1)
    for r in range(realizations):
        for k in range(cells):
            coefficient[margin + k] = courant / (1.0 + kappa[r, k])
        e[:] = 0.0
        h[:] = 0.0
        for n in range(source.size):
            _advance_h(e, h, courant)
            left, right = e[1], e[size - 2]
            for k in range(1, size - 1):
                e[k] -= coefficient[k] * (h[k] - h[k - 1])
            e[source_cell] += 2.0 * courant * source[n]
            _mur(e, left, right, mur)
            first[r, n] = e[margin]
            last[r, n] = e[margin + cells - 1]


@kernel
def march_scattered(kappa, courant, mur, margin, source, source_cell, first, last):
    """March the scattered field alone, driven by the incident field on the same grid ([Tan13] Eq. 17).

    eps dt E_s = -dx H_s - (eps - eps_b) dt E_inc. On the grid e_inc^{n+1} - e_inc^n = -S (h_inc jump).
    """
    realizations, cells = kappa.shape
    size = cells + 2 * margin
    coefficient, drive = np.full(size, courant), np.zeros(size)
    e, h = np.empty(size), np.empty(size - 1)
    e_inc, h_inc = np.empty(size), np.empty(size - 1)
    for r in range(realizations):
        for k in range(cells):
            coefficient[margin + k] = courant / (1.0 + kappa[r, k])
            drive[margin + k] = -courant * kappa[r, k] / (1.0 + kappa[r, k])
        for field in (e, h, e_inc, h_inc):
            field[:] = 0.0
        for n in range(source.size):
            _advance_h(e, h, courant)
            _advance_h(e_inc, h_inc, courant)
            left, right = e[1], e[size - 2]
            left_inc, right_inc = e_inc[1], e_inc[size - 2]
            for k in range(1, size - 1):
                jump = h_inc[k] - h_inc[k - 1]
                e_inc[k] -= courant * jump
                e[k] -= coefficient[k] * (h[k] - h[k - 1]) + drive[k] * jump
            e_inc[source_cell] += 2.0 * courant * source[n]
            _mur(e, left, right, mur)
            _mur(e_inc, left_inc, right_inc, mur)
            first[r, n] = e[margin]
            last[r, n] = e[margin + cells - 1]


@kernel
def march_currents(currents, courant, mur, margin, first, last):
    """March the mean scattered field in the background, driven by ``currents`` float64[T, N] in the layer."""
    steps, cells = currents.shape
    size = cells + 2 * margin
    e, h = np.zeros(size), np.zeros(size - 1)
    for n in range(steps):
        _advance_h(e, h, courant)
        left, right = e[1], e[size - 2]
        for k in range(1, size - 1):
            e[k] -= courant * (h[k] - h[k - 1])
        for k in range(cells):
            e[margin + k] -= currents[n, k]
        _mur(e, left, right, mur)
        first[n] = e[margin]
        last[n] = e[margin + cells - 1]


@kernel
def grid_scattering(kappa, theta, reflected, transmitted):
    """Exact scattering of the Yee grid: fill ``reflected``, ``transmitted`` complex128[R, F].

    Backwards through the layer from an outgoing wave, ``e_{k-1} = (2 - 4 sin^2(theta/2) (1 + kappa_k)) e_k - e_{k+1}``.
    The coefficient is real, so real and imaginary parts march apart, all frequencies side by side. ``theta``
    float64[F], in (0, pi): the phase per cell of the background.
    """
    realizations, cells = kappa.shape
    count = theta.size
    stiffness, base = np.empty(count), np.empty(count)
    for f in range(count):
        stiffness[f] = 4.0 * math.sin(0.5 * theta[f]) ** 2
        base[f] = 2.0 - stiffness[f]
    here_re, here_im, ahead_re, ahead_im = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    for r in range(realizations):
        for f in range(count):
            here_re[f], here_im[f] = 1.0, 0.0
            ahead_re[f], ahead_im[f] = math.cos(theta[f]), -math.sin(theta[f])
        for k in range(cells - 1, -1, -1):
            fluctuation = kappa[r, k]
            for f in range(count):
                coefficient = base[f] - stiffness[f] * fluctuation
                behind_re = coefficient * here_re[f] - ahead_re[f]
                behind_im = coefficient * here_im[f] - ahead_im[f]
                ahead_re[f], ahead_im[f] = here_re[f], here_im[f]
                here_re[f], here_im[f] = behind_re, behind_im
        for f in range(count):
            # `here` is e_{-1}, `ahead` is e_0; between them e = A w^k + B w^{-k}, w = exp(-i theta)
            w = complex(math.cos(theta[f]), -math.sin(theta[f]))
            before, at = complex(here_re[f], here_im[f]), complex(ahead_re[f], ahead_im[f])
            incident = (before - at * w) / (w.conjugate() - w)
            reflected[r, f] = (at - incident) / incident
            angle = theta[f] * (cells - 1)
            transmitted[r, f] = complex(math.cos(angle), math.sin(angle)) / incident
