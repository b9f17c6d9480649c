"""The field behind an opening in an opaque screen at z = 0, on a plane.

Four methods. The first two are the same integral, the first of Rayleigh and Sommerfeld (the field in the opening is
that of the light, the rest of the plane z = 0 is dark); the third knows how light bends at real edges; the fourth is
its far field.

* ``boundary``: by the rim, exact to 1e-13 at any distance, for plane waves and light of a point
  (`specklegen.wavetracing.kernels.apertures`).
* ``spectrum``: by plane waves, ``u = (1/4 pi^2) int Psi(xi) e^{i xi.r + iz sqrt(k^2 - xi^2)} d^2xi``, any light, on
  planes parallel to the screen; periodic, so that what leaves the padded window comes back (`.angular_spectrum`).
* ``utd``: geometric light plus one diffracted ray of each edge; soft or hard screens (`.edge_rays`).
* ``fraunhofer``: ``(k/2 pi i)(e^{ikr}/r) cos(theta) Psi``, right beyond some size^2 / wavelength.

When to believe which: docs/wavetracing.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np

from specklegen.core.arguments import choice, instance, positive_number, real_number
from specklegen.core.errors import reject
from specklegen.core.parallel import map_blocks, slices
from specklegen.core.quadrature import gauss_legendre
from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH
from specklegen.wavetracing.angular_spectrum import light_strengths, spectrum_field
from specklegen.wavetracing.aperture import aperture_transform
from specklegen.wavetracing.edge_rays import Polarisation, edge_ray_field
from specklegen.wavetracing.emitters import PointEmitter
from specklegen.wavetracing.kernels.apertures import rim_field
from specklegen.wavetracing.light import Light, PlaneWave, seen_from
from specklegen.wavetracing.mask import Mask
from specklegen.wavetracing.opening import Opening, Rim, doubt_narrow, rim_of
from specklegen.wavetracing.plane import Plane, PlaneField

FieldMethod = Literal["boundary", "spectrum", "utd", "fraunhofer"]

BLOCK = 1 << 12
"""Points that a thread takes at once."""


@with_units
def field_on_plane(
    opening: Opening | Mask | None,
    light: Light,
    plane: Plane,
    method: FieldMethod = "boundary",
    *,
    polarisation: Polarisation = "soft",
    padding: float = 2.0,
    shift: Annotated[Sequence[float], LENGTH] | None = None,
    rotation: np.ndarray | None = None,
    threads: int | None = None,
) -> PlaneField:
    """Return the field of ``light`` behind an opening.

    Parameters
    ----------
    opening
        Loops in the plane z = 0, outer ones counter-clockwise, holes clockwise; None: there is no screen. An opening
        of no area lets nothing through. Or a `Mask`, for "spectrum" and "fraunhofer".
    light
        A `PlaneWave`, a `PointEmitter`, a `GaussianBeam`, or anything with ``wavelength`` and ``field(points)``, from
        z < 0.
    plane
        Where the field is wanted; every pixel at z > 0 (no screen, or ``spectrum``: z >= 0).
    method
        "boundary", "spectrum", "utd" or "fraunhofer"; see above.
    polarisation
        For "utd": "soft" (u = 0 on the screen) or "hard" (du/dn = 0).
    padding
        For "spectrum": the period over the size of the plane and the opening together, at least 1.
    shift, rotation
        The screen's place: turned by ``rotation`` float64[3, 3] (proper), then moved by ``shift``, as `Mesh.placed`.
        Light and plane stay where they are. "spectrum" wants planes parallel to the screen.
    threads
        Of "boundary", by default all cores that the process may run on; results do not depend on them.

    Returns
    -------
    PlaneField
        Not normalised: u = 1 in the opening for a `PlaneWave` of amplitude 1.

    Raises
    ------
    RuleError
        If the opening is not made of loops, a pixel lies at z <= 0, or the method does not know this light or plane.

    A `DoubtWarning` says where an opening is narrower than a wavelength in the mean, or corners matter for "utd".

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.wavetracing import Plane, PlaneWave, field_on_plane
    >>> square = [[-5, -5], [5, -5], [5, 5], [-5, 5]]
    >>> found = field_on_plane(square, PlaneWave(wavelength=1.0), Plane(center=[0, 0, 50], shape=(8, 8), pitch=2.0))
    >>> round(float(np.abs(found.values).max()), 2)
    1.41
    """
    choice("field_on_plane method", method, ("boundary", "spectrum", "utd", "fraunhofer"))
    choice("field_on_plane polarisation", polarisation, ("soft", "hard"))
    instance("field_on_plane plane", plane, Plane)
    padding = real_number("field_on_plane padding", padding)
    if not callable(getattr(light, "field", None)):
        reject("field_on_plane light", "a PlaneWave, or another light with a wavelength and a field", light)
    wavelength = positive_number("field_on_plane light.wavelength", getattr(light, "wavelength", None))
    if shift is not None or rotation is not None:
        light, plane = seen_from("field_on_plane", light, plane, shift, rotation)
    points = plane.points.copy().reshape(-1, 3)  # kernels are compiled for arrays that may be written into
    lowest = float(points[:, 2].min())
    if lowest < 0 or (lowest == 0 and opening is not None and method != "spectrum"):
        reject("field_on_plane plane", "behind the screen, at z > 0", lowest)
    if opening is not None and isinstance(light, PointEmitter) and not light.position[2] < 0:
        reject("field_on_plane light", "a point before the screen, at z < 0", light.position)
    if opening is None:
        values = np.asarray(light.field(points), np.complex128)
    elif isinstance(opening, Mask):
        if method not in ("spectrum", "fraunhofer"):
            reject("field_on_plane method", "'spectrum' or 'fraunhofer' for a Mask", method, "Its rim is no sharp one.")
        far = method == "fraunhofer"
        values = _far_field(opening, light, points) if far else spectrum_field(opening, light, plane, padding)
    else:
        rim = rim_of("field_on_plane opening", opening)
        doubt_narrow("field_on_plane opening", rim.breadth, wavelength)
        if rim.area <= 0:
            values = np.zeros(len(points), np.complex128)
        elif method == "spectrum":
            values = spectrum_field(rim, light, plane, padding)
        elif method == "utd":
            if not isinstance(light, PlaneWave):
                reject("field_on_plane light", "a PlaneWave for method 'utd'", type(light).__name__, 'Use "boundary".')
            values = edge_ray_field(rim, light, points, polarisation)
        elif method == "fraunhofer":
            values = _far_field(rim, light, points)
        else:
            values = _rim_field(rim, light, points, threads)
    return PlaneField(values.reshape(plane.shape), plane.pitch, wavelength)


def _rim_field(rim: Rim, light: Light, points: np.ndarray, threads: int | None) -> np.ndarray:
    if isinstance(light, PlaneWave):
        source = np.append(light.direction, 0.0)
    elif isinstance(light, PointEmitter):
        source = np.append(light.position, 1.0)
    else:
        reject(
            "field_on_plane light", "a PlaneWave or a PointEmitter for method 'boundary'", type(light).__name__,
            'Use "spectrum".',
        )  # fmt: skip
    edges = np.hstack([rim.starts, rim.ends])
    nodes, weights = gauss_legendre(16)
    values = np.empty(len(points), np.complex128)

    def fill(block: slice) -> None:
        rim_field(edges, 2 * np.pi / light.wavelength, source, points[block], nodes, weights, values[block])

    map_blocks(fill, slices(len(points), BLOCK), threads)
    return light.field(points) * values


def _far_field(rim: Rim | Mask, light: Light, points: np.ndarray) -> np.ndarray:
    """Field by Psi about the middle of the opening, so that r is the distance from there."""
    k = 2 * np.pi / light.wavelength
    centre = rim.center if isinstance(rim, Mask) else rim.centre
    middle = np.append(centre, 0.0)
    rays = points - middle
    r = np.linalg.norm(rays, axis=1)
    xi = k * rays[:, :2] / r[:, None]
    if isinstance(rim, Rim) and isinstance(light, PlaneWave):
        loops = [loop - centre for loop in rim.loops]
        psi = aperture_transform(loops, xi - k * light.direction[:2]) * light.field(middle)
    else:
        from finufft import nufft2d3

        nodes, strengths = light_strengths(rim, light)
        x, y = np.ascontiguousarray((nodes - centre).T)
        psi = np.asarray(nufft2d3(x, y, strengths, *np.ascontiguousarray(xi.T), isign=-1, eps=1e-10, nthreads=1))
    return k / (2j * np.pi) * np.exp(1j * k * r) / r * (points[:, 2] / r) * psi
