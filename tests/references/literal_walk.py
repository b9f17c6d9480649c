"""One photon after the other through layers or a box, with all that may happen to it: a walk to judge combinations by.

Written from [Bar19] sec. 6, docs/motion.md and docs/polarisation.md; nothing of the library is used. A photon of weight
1 enters at z = 0. Every collision connects it to the view; K is the mean of weights times

    exp(-i [d_in . x1 - d_out . xB] - i sum of (w_in - w_out) . V - sum of loss (1 - cos))

over that of weights: phases of tilts (d: wavenumber times the change of light and view), a flow V (wavenumber times
displacement), and Brownian motion (loss: 2 k^2 D lag). The field of polarised light is a real vector, of which each
scattering leaves the part across the new direction, times sqrt(2 / (1 + cos^2)). Two fields go along one path, and are
seen through two analysers: one of each decides w.
"""

import math

import numpy as np
from numba import njit

BATCHES = 64


@njit(cache=True, inline="always")
def dot(a, b):
    """Scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def walked(edges, extinction, albedo, g, half, light, view, field, analyser, d_in, d_out, loss, flow, dk, paths,
           seed):  # fmt: skip
    """Sums complex128[64, 2 + m] of w, w times phases, w e^(i dk s); light sent back and let through float64[64, 2];
    light float64[64, 2, 2] of each field through each analyser.

    edges float64[n + 1], other arrays [n]; half: half width of a box, infinite of layers; flow float64[n, 4]: V and its
    x per z; field and analyser float64[2, 3]; fields of length 0: light is a scalar.
    """
    np.random.seed(seed)  # noqa: NPY002 (Numba's own generator)
    sums, left = np.zeros((BATCHES, 2 + len(dk)), np.complex128), np.zeros((BATCHES, 2))
    passed = np.zeros((BATCHES, 2, 2))
    n, polarised = len(g), (field * field).sum() > 0
    up, e = view[2] < 0, np.zeros((2, 3))
    x, w, new, across, first = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for number in range(paths):
        batch = number % BATCHES
        x[:] = 0.0
        w[:] = light
        e[:] = field
        if half < math.inf:
            x[0], x[1] = half * (2 * np.random.random() - 1), half * (2 * np.random.random() - 1)  # noqa: NPY002
        weight, turned, lost, flown, layer = 1.0, 0.0, 0.0, 0.0, 0
        started = False
        while weight > 1e-9:
            tau = -math.log(1 - np.random.random())  # noqa: NPY002
            out = False
            while True:
                way = (edges[layer + 1 if w[2] > 0 else layer] - x[2]) / w[2] if w[2] != 0 else math.inf
                side = math.inf
                for axis in range(2):
                    if w[axis] != 0:
                        side = min(side, (math.copysign(half, w[axis]) - x[axis]) / w[axis])
                step = min(tau / extinction[layer], way, side)
                for axis in range(3):
                    x[axis] += step * w[axis]
                flown += step
                if step == side:
                    out = True
                elif step == way:
                    tau -= step * extinction[layer]
                    layer += 1 if w[2] > 0 else -1
                    out = layer < 0 or layer == n
                else:
                    break
                if out:
                    break
            if out:
                if layer < 0 or layer == n:
                    left[batch, 0 if layer < 0 else 1] += weight
                break
            if not started:
                first[:] = x
                started = True
            weight *= albedo[layer]
            # To the view.
            cos = dot(w, view)
            escape = 0.0
            for k in range(n):
                low, high = (edges[k], min(x[2], edges[k + 1])) if up else (max(x[2], edges[k]), edges[k + 1])
                escape += max(0.0, high - low) / abs(view[2]) * extinction[k]
            if half < math.inf:
                away = (edges[0 if up else n] - x[2]) / view[2]
                for axis in range(2):
                    if view[axis] != 0:
                        away = min(away, (math.copysign(half, view[axis]) - x[axis]) / view[axis])
                escape = away * extinction[0]
            h = g[layer]
            c = weight * (1 - h * h) / (1 + h * h - 2 * h * cos) ** 1.5 * math.exp(-escape)
            if polarised:
                c *= 2 / (1 + cos * cos)
                for i in range(2):
                    for j in range(2):
                        seen = dot(e[i], analyser[j]) - dot(e[i], view) * dot(view, analyser[j])
                        passed[batch, i, j] += c * seen * seen
                seen = dot(e[0], analyser[0]) - dot(e[0], view) * dot(view, analyser[0])
                c *= seen * seen
            v = flow[layer]
            vx = v[0] + v[3] * x[2]
            phase = turned + (w[0] - view[0]) * vx + (w[1] - view[1]) * v[1] + (w[2] - view[2]) * v[2]
            phase += dot(d_in, first) - dot(d_out, x)
            decay = math.exp(-lost - loss[layer] * (1 - cos))
            sums[batch, 0] += c
            sums[batch, 1] += c * decay * complex(math.cos(phase), -math.sin(phase))
            length = flown + (edges[0 if up else n] - x[2]) / view[2]
            for m in range(len(dk)):
                sums[batch, 2 + m] += c * complex(math.cos(dk[m] * length), math.sin(dk[m] * length))
            # On.
            cos = 2 * np.random.random() - 1  # noqa: NPY002
            if h != 0:
                cos = (1 + h * h - ((1 - h * h) / (1 + h * cos)) ** 2) / (2 * h)
            sin, turn = math.sqrt(max(0.0, 1 - cos * cos)), 2 * math.pi * np.random.random()  # noqa: NPY002
            if abs(w[2]) < 0.9:
                across[0], across[1], across[2] = w[1], -w[0], 0.0
            else:
                across[0], across[1], across[2] = 0.0, w[2], -w[1]
            a, b = math.cos(turn) * sin, math.sin(turn) * sin
            size = math.sqrt(dot(across, across))
            for axis in range(3):  # the last term is that of w x across
                j, k = (axis + 1) % 3, (axis + 2) % 3
                new[axis] = cos * w[axis] + (a * across[axis] + b * (w[j] * across[k] - w[k] * across[j])) / size
            size = math.sqrt(dot(new, new))
            for axis in range(3):
                new[axis] /= size
            if polarised:
                size = math.sqrt(2 / (1 + cos * cos))
                for i in range(2):
                    out_of_plane = dot(e[i], new)
                    for axis in range(3):
                        e[i, axis] = size * (e[i, axis] - out_of_plane * new[axis])
            turned += (w[0] - new[0]) * vx + (w[1] - new[1]) * v[1] + (w[2] - new[2]) * v[2]
            lost += loss[layer] * (1 - cos)
            w[:] = new
    return sums, left, passed


def walk(layers, paths, seed, *, light=(0.0, 0.0, 1.0), view=(0.0, 0.0, 1.0), field=(0.0, 0.0, 0.0),
         analyser=(0.0, 0.0, 0.0), d_in=(0.0, 0.0, 0.0), d_out=(0.0, 0.0, 0.0), loss=0.0, flow=0.0, dk=(),
         half=math.inf):  # fmt: skip
    """The same of layers (thickness, extinction, albedo, g)."""
    thickness, extinction, albedo, g = np.array(layers, float).T
    n = len(g)
    field, analyser = (np.reshape([*np.ravel(each), 0.0, 0.0, 0.0][:6], (2, 3)) for each in (field, analyser))
    vectors = (np.array(each, float) for each in (light, view, field, analyser, d_in, d_out))
    return walked(np.concatenate([[0.0], np.cumsum(thickness)]), extinction, albedo, g, half, *vectors,
                  np.broadcast_to(loss, n).astype(float), np.broadcast_to(flow, (n, 4)).astype(float),
                  np.array(dk, float), paths, seed)  # fmt: skip
