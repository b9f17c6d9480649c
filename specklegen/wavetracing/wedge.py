"""Perfect wedges by the uniform theory of diffraction (UTD): coefficients, and the field of one wedge.

A plane wave from the angle phi' (measured from the 0-face, through the air) and a receiver at phi, s away along its
ray: geometric waves and one diffracted wave,

    u = u_direct [|phi - phi'| < pi] -+ u_image [phi + phi' < pi] -+ u_image [phi + phi' > (2n - 1) pi]
        + u_i(Q) D_{s,h} e^{iks} / sqrt(s)

soft (u = 0 on the faces) with the upper sign, hard (du/dn = 0) with the lower. Exact for the half plane, n = 2; for
other wedges the error falls like 1/r and faster: rms 2e-3 at a wavelength, 1e-4 at ten (docs/wavetracing.md).
Formulae, conventions and how boundaries are treated: `specklegen.wavetracing.kernels.wedges`. Time e^{-i omega t}.
Source: Kouyoumjian and Pathak, Proc. IEEE 62, 1448 (1974).
"""

from __future__ import annotations

from typing import Annotated, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import choice, positive_number, real_array, real_number, together
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.units import INVERSE_LENGTH, LENGTH, RADIAN
from specklegen.wavetracing.kernels.wedges import wedge_pairs, wedge_weights

Boundary = Literal["soft", "hard"]

NEAREST = 1.0
"""k s below which a receiver is refused: there the edge is no more than a sixth of a wavelength away."""


@with_units
def wedge_coefficients(
    n: float,
    phi: Annotated[ArrayLike, RADIAN],
    incidence: Annotated[ArrayLike, RADIAN],
    distance: Annotated[ArrayLike, LENGTH],
    k: Annotated[float, INVERSE_LENGTH],
    beta: Annotated[ArrayLike, RADIAN] = np.pi / 2,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the soft and hard diffraction coefficients of a perfect wedge.

    Parameters
    ----------
    n
        Exterior angle over pi, from 1 (a plane) to 2 (a half plane).
    phi, incidence
        Angles of the receiver and of the source from the 0-face, radians in [0, n pi].
    distance
        Distance parameter L, a length: s sin(beta)^2 for a plane wave, s s'/(s + s') sin(beta)^2 for a wave of radius
        of curvature s' at the edge.
    k
        Wave number, radians per unit length.
    beta
        Angle between the ray and the edge, radians.

    Returns
    -------
    soft, hard : complex128[...]
        In square roots of length: the diffracted wave is u_i(Q) D e^{iks} A with A = 1/sqrt(s) for a plane wave,
        sqrt(s'/(s (s + s'))) for a spherical one. On a boundary of light and shadow the term that jumps is 0, and
        the geometric wave that ends there counts half (`geometric_shares`).

    Raises
    ------
    RuleError
        If an angle lies inside the wedge, L is negative or not finite, beta is not between 0 and pi.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.wavetracing import wedge_coefficients
    >>> soft, hard = wedge_coefficients(1.5, 3.0, 0.5, distance=10.0, k=2 * np.pi)
    >>> round(float(abs(soft)), 3), round(float(abs(hard)), 3)
    (0.695, 0.243)
    """
    n, phi, incidence = _angles(n, phi, incidence)
    k = positive_number("wedge_coefficients k", k)
    distance = real_array("wedge_coefficients distance", distance)
    if not (np.isfinite(distance) & (distance >= 0)).all():
        reject("wedge_coefficients distance", "finite and at least 0", distance)
    sine = _sine("wedge_coefficients beta", real_array("wedge_coefficients beta", beta))
    phi, incidence, distance, sine = together(
        "wedge_coefficients", phi=phi, incidence=incidence, distance=distance, beta=sine
    )
    soft, hard = np.empty(phi.size, complex), np.empty(phi.size, complex)
    flat = (np.ascontiguousarray(a).ravel() for a in (phi, incidence, distance))
    wedge_pairs(n, *flat, k, np.ascontiguousarray(sine).ravel(), soft, hard)
    return soft.reshape(phi.shape), hard.reshape(phi.shape)


def geometric_shares(n: float, phi: ArrayLike, incidence: ArrayLike) -> np.ndarray:
    """Return how much of the direct wave and of the images in the 0-face and the n-face is seen, float64[..., 3].

    1 or 0, and one half exactly on a boundary, by the same rounded angles as `wedge_coefficients`. Arguments as there.
    """
    n, phi, incidence = _angles(n, phi, incidence)
    phi, incidence = together("geometric_shares", phi=phi, incidence=incidence)
    out = np.empty((phi.size, 3))
    wedge_weights(n, np.ascontiguousarray(phi).ravel(), np.ascontiguousarray(incidence).ravel(), out)
    return out.reshape(*phi.shape, 3)


@with_units
def wedge_field(
    n: float,
    phi: Annotated[ArrayLike, RADIAN],
    incidence: Annotated[ArrayLike, RADIAN],
    distance: Annotated[ArrayLike, LENGTH],
    k: Annotated[float, INVERSE_LENGTH],
    boundary: Boundary,
    beta: Annotated[float, RADIAN] = np.pi / 2,
) -> np.ndarray:
    """Return the total UTD field complex128[...] of a wedge lit by a plane wave e^{ik d.x}, 1 on the edge at z = 0.

    Parameters
    ----------
    n
        Exterior angle over pi, from 1 (a plane) to 2 (a half plane).
    phi, incidence
        Angles of the receiver and of the source from the 0-face, radians in [0, n pi].
    k
        Wave number, radians per unit length.
    distance
        Length r from the edge to the receiver, in the plane z = 0 across it.
    boundary
        "soft" or "hard".
    beta
        Angle between the wave's direction of travel and the edge, the z axis, radians.

    Raises
    ------
    RuleError
        As `wedge_coefficients`, or if k r sin(beta) < 1.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.wavetracing import wedge_field
    >>> field = wedge_field(2.0, 0.5 + np.pi, 0.5, 100.0, 2 * np.pi, "soft")
    >>> round(float(abs(field)), 2)  # where the shadow of a half plane begins
    0.49
    """
    choice("wedge_field boundary", boundary, get_args(Boundary))
    k = positive_number("wedge_field k", k)
    sine = float(_sine("wedge_field beta", np.array(real_number("wedge_field beta", beta))))
    across = k * sine
    n, phi, incidence = _angles(n, phi, incidence)
    r = real_array("wedge_field distance", distance)
    phi, incidence, r = together("wedge_field", phi=phi, incidence=incidence, distance=r)
    if not (across * r >= NEAREST).all():
        reject(
            "wedge_field distance", "at least 1/(k sin(beta))", r,
            "The theory describes a ray from the edge, and nearer by there is none.",
        )  # fmt: skip
    sign = -1.0 if boundary == "soft" else 1.0
    shares = geometric_shares(n, phi, incidence)
    waves = np.exp(-1j * across * r[..., None] * np.cos(_below(n, phi, incidence)))
    geometric = (shares * waves) @ np.array([1.0, sign, sign])
    # A ray at the angle beta that ends at z = 0 left the edge at Q = -r / tan(beta): s = r / sin(beta), and
    # e^{ik cos(beta) Q} e^{iks} = e^{ikr sin(beta)}.
    s = r / sine
    pair = wedge_coefficients(n, phi, incidence, s * sine**2, k, beta)
    return geometric + pair[sign > 0] * np.exp(1j * across * r) / np.sqrt(s)


def _below(n: float, phi: np.ndarray, incidence: np.ndarray) -> np.ndarray:
    """Angles between the receiver and the directions that the direct wave and its two images come from."""
    return np.stack([phi - incidence, phi + incidence, phi + incidence - 2 * np.pi * n], axis=-1)


def _angles(n: float, phi: ArrayLike, incidence: ArrayLike) -> tuple[float, np.ndarray, np.ndarray]:
    exterior = real_number("wedge n", n)
    if not 1 <= exterior <= 2:
        reject("wedge n", "between 1 (a plane) and 2 (a half plane)", n, "n = 2 - interior angle / pi.")
    angles = []
    for name, angle in (("phi", phi), ("incidence", incidence)):
        angle = real_array(f"wedge {name}", angle)
        if not ((angle >= 0) & (angle <= exterior * np.pi * (1 + 1e-15))).all():
            reject(f"wedge {name}", f"in the air, between 0 and {exterior:g} pi radians", angle)
        angles.append(angle)
    return exterior, angles[0], angles[1]


def _sine(field: str, beta: np.ndarray) -> np.ndarray:
    """Sine of the angle between ray and edge."""
    with np.errstate(invalid="ignore"):  # of infinite angles
        sine = np.sin(beta)
    if not (sine > 0).all():
        reject(field, "between 0 and pi", beta, "A ray along the edge is not diffracted by it.")
    return sine
