"""Partially coherent light: cross-spectral densities, their coherent modes, and sampled fields.

The cross-spectral density of fields U at points 1, 2 is the Hermitian, positive matrix

    W[1, 2] = <U1 U2*>,   S = diag W,   mu[1, 2] = W[1, 2] / sqrt(S1 S2)     ([Prahl09] Eq. 4, conjugated)

and W = G W0 G^H behind a linear system G (pixels x source points). With the Karhunen-Loeve (Mercer)
modes of the source, W0 = Phi diag(lambda) Phi^H, an intensity needs no matrix W:

    S = sum_k lambda_k |G phi_k|^2,

which is how partially coherent light enters any system whose response to coherent light is known:
a focus (`specklegen.coherence.cylindrical_focus`) or a scattering scene. Points may be pixels, modes or directions;
lengths are in any one unit. See docs/coherence.md.
"""

import math
import warnings
from typing import Annotated, Literal

import numpy as np
from scipy.special import ndtri

from specklegen.core.arguments import choice, finite_numbers, real_array, real_number, whole_number
from specklegen.core.errors import reject
from specklegen.core.memory import require_memory
from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH

_ROUNDING = 1e-10  # of the trace: what an estimated or rounded W may have of negative eigenvalues
_COPULA_TOLERANCE = 0.02  # |mu| of the copula against W0; 0.0023 at phase_turns=1 for a Gaussian Schell model


@with_units
def gaussian_schell_model(
    x: Annotated[np.ndarray, LENGTH], coherence_length: Annotated[float, LENGTH], amplitude: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Return the cross-spectral density of a Gaussian Schell-model line source.

    ``W0[1, 2] = A1 A2* exp{-(x1 - x2)^2 / (2 coherence_length^2)}``.

    Parameters
    ----------
    x : float64[n]
        Positions of the source points.
    coherence_length : float
        sigma_g, in the unit of ``x``: 0 gives independent points, infinity full coherence.
    amplitude : float64[n] or complex128[n], optional
        Amplitude A (and phase) along the source; ones by default.

    Returns
    -------
    float64[n, n], or complex128[n, n] for a complex amplitude

    Warns
    -----
    UserWarning
        If points lie farther apart than half a coherence length: results then depend on their number.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import gaussian_schell_model
    >>> gaussian_schell_model(np.array([0.0, 0.5, 1.0]), coherence_length=1.0).round(3)
    array([[1.   , 0.882, 0.607],
           [0.882, 1.   , 0.882],
           [0.607, 0.882, 1.   ]])
    """
    x = finite_numbers("gaussian_schell_model x", real_array("gaussian_schell_model x", x))
    if x.ndim != 1 or not x.size:
        reject("gaussian_schell_model x", "a list of at least one position", x)
    coherence_length = real_number("gaussian_schell_model coherence_length", coherence_length)
    if not coherence_length >= 0:
        reject("gaussian_schell_model coherence_length", "at least 0", coherence_length)
    amplitude = np.ones(x.size) if amplitude is None else amplitude
    amplitude = finite_numbers("gaussian_schell_model amplitude", amplitude)
    if amplitude.shape != x.shape:
        reject("gaussian_schell_model amplitude", f"{x.size} numbers, one for each position", amplitude.shape)
    spacing = np.diff(np.sort(x)).max(initial=0.0)
    if spacing > coherence_length / 2:
        warnings.warn(
            f"source points {spacing:.3g} apart undersample a coherence length of {coherence_length:.3g}: "
            "the result depends on their number; space them at most half a coherence length apart",
            stacklevel=2,
        )
    if coherence_length == 0:
        degree = np.eye(x.size)
    else:
        with np.errstate(over="ignore"):  # points too far apart for their square: independent
            degree = np.exp(-(((x[:, None] - x) / coherence_length) ** 2) / 2)
    return amplitude[:, None] * degree * amplitude.conj()


def coherent_modes(W0: np.ndarray, n_modes: int | None = None, energy: float = 0.99) -> tuple[np.ndarray, np.ndarray]:
    """Return the strongest coherent modes of a source (Karhunen-Loeve, Mercer).

    Parameters
    ----------
    W0 : float64[n, n] or complex128[n, n]
        Cross-spectral density; Hermitian and positive. Eigenvalues down to -1e-10 of the trace, as an
        estimate or rounding leaves them, count as 0.
    n_modes : int, optional
        How many; by default the fewest that hold the share ``energy`` of the trace.
    energy : float
        Between 0 and 1; 1 keeps all n modes.

    Returns
    -------
    eigenvalues : float64[K]
        Power of each mode, falling.
    modes : [n, K]
        Orthonormal columns: W0 ~ modes @ diag(eigenvalues) @ modes^H.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import coherent_modes, gaussian_schell_model
    >>> W0 = gaussian_schell_model(np.linspace(-1, 1, 65), coherence_length=0.6)
    >>> power, modes = coherent_modes(W0, energy=0.99)
    >>> modes.shape
    (65, 4)
    """
    eigenvalues, modes = _eigenvalues_falling("coherent_modes W0", W0)
    kept = _kept("coherent_modes", eigenvalues, n_modes, energy)
    return eigenvalues[:kept], modes[:, :kept]


def separable_coherent_modes(
    W0_y: np.ndarray, W0_x: np.ndarray, n_modes: int | None = None, energy: float = 0.99
) -> tuple[np.ndarray, np.ndarray]:
    """Return the strongest coherent modes of a two-dimensional source that is a product of two lines.

    A Gaussian Schell model is: W0[(y1, x1), (y2, x2)] = W0_y[y1, y2] W0_x[x1, x2], so that its
    eigenvalues and modes are products of one-dimensional ones; they are sorted, then cut.

    Parameters
    ----------
    W0_y, W0_x : [ny, ny], [nx, nx]
        Cross-spectral densities along the two axes.
    n_modes : int, optional
        How many; by default the fewest that hold the share ``energy`` of the trace.
    energy : float
        Between 0 and 1, 0.99 by default; 1 keeps all modes.

    Returns
    -------
    eigenvalues : float64[K]
        Power of each mode, falling.
    modes : [ny * nx, K]
        Orthonormal columns over the points in C order, x running fastest.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import gaussian_schell_model, separable_coherent_modes
    >>> line = gaussian_schell_model(np.linspace(-1, 1, 16), coherence_length=2.0)
    >>> power, modes = separable_coherent_modes(line, line)
    >>> modes.shape
    (256, 4)
    """
    along_y, modes_y = _eigenvalues_falling("separable_coherent_modes W0_y", W0_y)
    along_x, modes_x = _eigenvalues_falling("separable_coherent_modes W0_x", W0_x)
    products = np.outer(along_y, along_x).ravel()
    order = np.argsort(-products, kind="stable")
    order = order[: _kept("separable_coherent_modes", products[order], n_modes, energy)]
    y, x = np.divmod(order, along_x.size)
    modes = modes_y[:, None, y] * modes_x[None, :, x]
    return products[order], modes.reshape(-1, order.size)


def _eigenvalues_falling(field: str, W0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    W0 = finite_numbers(field, W0)
    if W0.ndim != 2 or W0.shape[0] != W0.shape[1] or not W0.size:
        reject(field, "a square matrix", W0.shape)
    if not np.abs(W0 - W0.conj().T).max() <= _ROUNDING * np.abs(W0).max():
        reject(field, "Hermitian", W0)
    eigenvalues, modes = np.linalg.eigh(W0)
    if eigenvalues[0] < -_ROUNDING * max(eigenvalues.sum(), 0):
        remedy = "A cross-spectral density has no mode of negative power."
        reject(field, f"positive semidefinite to {_ROUNDING:g} of its trace", eigenvalues[0], remedy)
    return np.maximum(eigenvalues[::-1], 0), modes[:, ::-1]


def _kept(owner: str, eigenvalues: np.ndarray, n_modes: int | None, energy: float) -> int:
    if n_modes is not None:
        return whole_number(f"{owner} n_modes", n_modes, 1, eigenvalues.size)
    _check_energy(owner, energy)
    if energy == 1:
        return eigenvalues.size
    # Sums of the tail: from the small end, so that a share of 1 - 1e-12 still counts modes and not rounding.
    left_out = np.cumsum(eigenvalues[::-1])[::-1]
    return max(1, int(np.sum(left_out > (1 - energy) * left_out[0])))


def _check_energy(owner: str, energy: float) -> None:
    energy = real_number(f"{owner} energy", energy)
    if not 0 < energy <= 1:
        reject(f"{owner} energy", "greater than 0 and at most 1", energy)


def number_of_modes(a_over_sigma: float, energy: float = 0.99) -> int:
    """Return how many modes hold the share ``energy`` of a uniform Gaussian Schell-model line source.

    ``K = ceil(2 q a / (pi sigma_g)) + ceil(-log10(1 - energy) / 2)``: the number of degrees of freedom of a
    source of width 2 a in the band that holds the share ``energy`` of its Gaussian spectrum, +-q
    standard deviations, and a few for its edges. For 99 %: ``ceil(1.64 a / sigma_g) + 1``. It is never too
    small and at most three too many (tested for a / sigma_g up to 50, and energies from 0.5 to
    ``1 - 1e-6``). `coherent_modes` counts exactly.

    Parameters
    ----------
    a_over_sigma : float
        Half the width of the source over its coherence length sigma_g.
    energy : float
        Share of the power that the modes are to hold, between 0 and 1; 0.99 by default. More asks for more modes.

    Examples
    --------
    >>> from specklegen.coherence import number_of_modes
    >>> number_of_modes(5.0), number_of_modes(50.0)
    (10, 83)
    """
    a_over_sigma = real_number("number_of_modes a_over_sigma", a_over_sigma)
    if not 0 <= a_over_sigma < math.inf:
        reject("number_of_modes a_over_sigma", "at least 0 and finite", a_over_sigma)
    _check_energy("number_of_modes", energy)
    energy = real_number("number_of_modes energy", energy)
    if energy == 1:
        reject("number_of_modes energy", "less than 1", energy, "A finite share needs finitely many modes.")
    if a_over_sigma == 0:
        return 1
    quantile = float(ndtri((1 + energy) / 2))
    return math.ceil(2 * quantile * a_over_sigma / math.pi) + math.ceil(-math.log10(1 - energy) / 2)


def effective_modes(W: np.ndarray) -> float:
    """Return N_eff = (tr W)^2 / tr W^2, the number of equally strong modes of the same contrast.

    Parameters
    ----------
    W : float64[n, n] or complex128[n, n]
        Cross-spectral density of the light, between points of one spacing.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import effective_modes
    >>> effective_modes(np.eye(4))  # four independent points
    4.0
    """
    W = _square("effective_modes W", W)
    total = float(np.trace(W).real)
    if not total > 0:
        reject("effective_modes W", "of a trace above 0: of some light", total)
    return 1 / float(np.sum(np.square(np.abs(W / total))))


def speckle_contrast(W: np.ndarray) -> float:
    """Return the contrast (standard deviation over mean) of the speckle that a source makes.

    C = 1 / sqrt(N_eff), for a transmission matrix of independent circular Gaussian entries. The memory effect
    correlates the columns of a real medium, but at shifted views: at one pixel, behind a window much wider
    than the slab is thick, the law holds (see :mod:`specklegen.coherence.partially_coherent`).

    Parameters
    ----------
    W : [n, n]
        Cross-spectral density of the source.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import speckle_contrast
    >>> speckle_contrast(np.eye(4))
    0.5
    """
    return effective_modes(W) ** -0.5


def sample_fields(
    W0: np.ndarray, n: int, method: Literal["kl", "copula"] = "kl", *, seed: int, phase_turns: float = 1.0
) -> np.ndarray:
    """Draw realizations of a source: W0[i, j] = <U[:, i] U[:, j]*>.

    Parameters
    ----------
    W0 : [points, points]
        Cross-spectral density.
    n : int
        Number of realizations.
    method : {"kl", "copula"}
        "kl" sums the coherent modes with independent circular Gaussian weights: exactly Gaussian, of
        exactly this W0, independent of one another. "copula" is the method of [Prahl09] Eqs. 10-11:
        the points carry unit phasors of correlated Gaussian phases in a disc, and a realization is one
        pixel of their Fourier transforms, taken in a square twice as wide as the disc. It needs a
        Gaussian Schell model, has it to 0.2 % at one turn, and its neighbouring realizations are
        correlated: n of them count as 0.2 n.
    seed : int
        The result is a pure function of it.
    phase_turns : float
        m, the standard deviation of the phases of "copula" in turns.

    Returns
    -------
    complex128[n, points]

    Raises
    ------
    RuleError
        If W0 is not positive, ``n`` < 1, ``method`` is unknown; for "copula" also if ``phase_turns`` <
        0.3 (the fields would have a mean) or < a / (pi^2 sigma_g) (the correlation would rise again
        across the source), or if W0 is no Gaussian Schell model.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import gaussian_schell_model, sample_fields
    >>> W0 = gaussian_schell_model(np.linspace(-1, 1, 9), coherence_length=1.0)
    >>> sample_fields(W0, 100, seed=0).shape
    (100, 9)
    """
    n = whole_number("sample_fields n", n, 1)
    W0 = finite_numbers("sample_fields W0", W0)
    require_memory(
        "sample_fields n", "held", 48.0 * n * W0.size**0.5, f"{n} fields", "Draw fewer fields at a time.", share=0.9
    )  # fmt: skip
    choice("sample_fields method", method, ("kl", "copula"))
    random = np.random.default_rng(np.random.SeedSequence([whole_number("sample_fields seed", seed)]))
    if method == "kl":
        eigenvalues, modes = coherent_modes(W0, energy=1)
        weights = random.normal(size=(n, eigenvalues.size, 2)) @ np.array([1, 1j]) / math.sqrt(2)
        return (weights * np.sqrt(eigenvalues)) @ modes.T
    return _copula_fields(_copula_angles(W0, phase_turns), n, phase_turns, random) * np.sqrt(spectral_density(W0))


def _copula_angles(W0: np.ndarray, turns: float) -> np.ndarray:
    """Angles beta with ``|mu| = exp{-(2 pi m)^2 [1 - cos(beta_i - beta_j)]}``, from neighbouring points."""
    if not turns >= 0.3:
        remedy = "Phases of smaller spread give fields with a mean."
        reject("sample_fields phase_turns", "at least 0.3", turns, remedy)
    degree = spectral_degree_of_coherence(W0)
    nearest = np.real(np.diagonal(degree, 1))
    if np.abs(np.imag(degree)).max() > _ROUNDING or not np.all(nearest > 0):
        remedy = "Use method='kl', which takes any W0."
        reject("sample_fields W0", "a Gaussian Schell model for method='copula'", W0, remedy)
    spread = (2 * math.pi * turns) ** 2
    step = np.arccos(np.maximum(1 + np.log(np.minimum(nearest, 1)) / spread, -1))
    beta = np.concatenate([[0.0], np.cumsum(step)])
    if beta[-1] > math.pi:
        remedy = f"Use phase_turns of at least {math.ceil(100 * turns * beta[-1] / math.pi) / 100:g}."
        reject("sample_fields phase_turns", "so large that the angles span at most pi", turns, remedy)
    model = np.exp(-spread * (1 - np.cos(beta[:, None] - beta)))
    worst = np.abs(model - degree).max()
    if worst > _COPULA_TOLERANCE:
        reject("sample_fields W0", f"a Gaussian Schell model to {_COPULA_TOLERANCE:g} for method='copula'",
               f"a difference of {worst:.3g}",
               "Raise phase_turns, or use method='kl', which takes any W0.")  # fmt: skip
    return beta


def _copula_fields(beta: np.ndarray, n: int, turns: float, random: np.random.Generator) -> np.ndarray:
    """Fields of unit power from phases (cos beta Y1 + sin beta Y2) in a disc of a square of n pixels."""
    diameter = max(8, math.ceil(math.sqrt(n) / 2))  # at least 52 phasors, for something like a Gaussian
    square = 2 * diameter
    across = np.arange(diameter) - (diameter - 1) / 2
    disc = np.hypot(across, across[:, None]) <= diameter / 2
    y1, y2 = random.normal(size=(2, disc.sum()))
    phase = 2 * math.pi * turns * (np.cos(beta)[:, None] * y1 + np.sin(beta)[:, None] * y2)
    grid = np.zeros((beta.size, square, square), complex)
    grid[:, :diameter, :diameter][:, disc] = np.exp(1j * phase)
    return np.fft.fft2(grid).reshape(beta.size, -1)[:, :n].T / math.sqrt(disc.sum())


def propagate_csd(G: np.ndarray, W0: np.ndarray) -> np.ndarray:
    """Return W = G W0 G^H, the cross-spectral density behind a linear system.

    Parameters
    ----------
    G : [pixels, points]
        Response of the system: any Green's function or transmission matrix.
    W0 : [points, points]
        Cross-spectral density of the source, Hermitian.

    Returns
    -------
    complex128[pixels, pixels]
        Hermitian and positive, of rank ``points`` at most. For intensities alone use
        `intensity_from_modes`, which needs no such matrix.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import propagate_csd
    >>> propagate_csd(np.ones((1, 4)), np.eye(4))  # four independent points on one pixel
    array([[4.]])
    """
    G, W0 = _behind("propagate_csd", G, "W0", _square("propagate_csd W0", W0)), np.asarray(W0)
    return G @ W0 @ G.conj().T


def _square(field: str, W: np.ndarray) -> np.ndarray:
    """Check a matrix over pairs of points."""
    W = finite_numbers(field, W, 2)
    if W.shape[0] != W.shape[1]:
        reject(field, "a square matrix", W.shape)
    return W


def _behind(owner: str, G: np.ndarray, name: str, source: np.ndarray) -> np.ndarray:
    """Check the response to as many points as a source has."""
    G = finite_numbers(f"{owner} G", G)
    if G.shape[-1:] != source.shape[:1]:
        reject(f"{owner} G", f"a response to the {len(source)} points of {name} along its last axis", G.shape)
    return G


def intensity_from_modes(G: np.ndarray, modes: np.ndarray, eigenvalues: np.ndarray) -> np.ndarray:
    """Return the spectral density sum_k eigenvalues_k |G modes_k|^2 behind a linear system.

    Parameters
    ----------
    G : [..., points]
        Response of the system at pixels of any layout.
    modes, eigenvalues : [points, K], float64[K]
        From `coherent_modes` or `separable_coherent_modes`. With all modes this is the diagonal of
        `propagate_csd` to rounding; with those of 99 % of the energy, 1 % of it is missing.

    Returns
    -------
    float64[...]

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import coherent_modes, gaussian_schell_model, intensity_from_modes
    >>> power, modes = coherent_modes(gaussian_schell_model(np.linspace(-1, 1, 9), 2.0), energy=1.0)
    >>> intensity_from_modes(np.eye(9), modes, power).round(6)  # nothing in the way: of the source itself
    array([1., 1., 1., 1., 1., 1., 1., 1., 1.])
    """
    modes = finite_numbers("intensity_from_modes modes", modes, 2)
    power = finite_numbers("intensity_from_modes eigenvalues", eigenvalues, 1)
    if power.shape != modes.shape[1:] or not (power >= 0).all():
        reject("intensity_from_modes eigenvalues", f"{modes.shape[1]} powers of at least 0, one for each mode",
               eigenvalues)
    fields = _behind("intensity_from_modes", G, "modes", modes) @ (modes * np.sqrt(power))
    return np.sum(np.real(fields) ** 2 + np.imag(fields) ** 2, axis=-1)


def spectral_density(W: np.ndarray) -> np.ndarray:
    """Return S = diag W, the mean intensity: float64[n].

    Parameters
    ----------
    W : float64[n, n] or complex128[n, n]
        Cross-spectral density.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import spectral_density
    >>> spectral_density(np.diag([1.0, 2.0]))
    array([1., 2.])
    """
    return np.real(np.diagonal(_square("spectral_density W", W))).copy()


def spectral_degree_of_coherence(W: np.ndarray, reference: int | None = None) -> np.ndarray:
    """Return ``mu[1, 2] = W[1, 2] / sqrt(S1 S2)``, of modulus at most 1.

    Parameters
    ----------
    W : [n, n]
        Cross-spectral density.
    reference : int, optional
        A point; then only mu[reference, :].

    Returns
    -------
    complex128[n, n] or complex128[n]
        0 wherever a point is dark: S at most 1e-15 of its largest, where W is rounding and mu has no
        meaning. Rounding, and the slight indefiniteness of `specklegen.coherence.cylindrical_focus.flux_weighted_csd`,
        may carry a modulus past 1; it is brought back to 1.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import gaussian_schell_model, spectral_degree_of_coherence
    >>> W0 = gaussian_schell_model(np.array([0.0, 0.5, 1.0]), coherence_length=1.0)
    >>> spectral_degree_of_coherence(W0, reference=0).real.round(3)
    array([1.   , 0.882, 0.607])
    """
    W = finite_numbers("spectral_degree_of_coherence W", W)
    S = spectral_density(W)
    if reference is not None:
        reference = whole_number("spectral_degree_of_coherence reference", reference, -len(S), len(S) - 1)
    bright = 1e-15 * S.max() < S
    scale = np.where(bright, 1, 0) / np.sqrt(np.where(bright, S, 1))
    rows = slice(None) if reference is None else reference
    mu = np.asarray(W[rows] * scale * (scale[:, None] if reference is None else scale[reference]), complex)
    return mu / np.maximum(np.abs(mu), 1)
