"""Uniform theory of diffraction: the transition function, and the coefficients of a perfect wedge.

With time e^{-i omega t}, angles from the 0-face, wedges of exterior angle n pi [KP74, conjugated]:

    D_{s,h} = -e^{i pi/4} / (2n sqrt(2 pi k) sin(beta)) 
              x { C_+(phi - phi') + C_-(phi - phi') -+ [C_+(phi + phi') + C_-(phi + phi')] }
    C_+-(B) = cot((pi +- B)/2n) F(k L a_+-(B)),   a_+- = 2 cos^2(pi n N_+- - B/2),   N_+- = round((+-pi + B)/(2 pi n))

With ``delta = +-pi + B - 2 pi n N``, the signed angle to a shadow or reflection boundary, both factors are functions of
delta: ``cot((pi +- B)/2n) = +-cot(delta/2n)``, ``a = 2 sin^2(delta/2)``. So their product is finite and keeps its
digits to delta = 0, where it jumps by the geometric wave. There it is 0 and the geometric wave weighs one half. The
sign of delta, and nothing else, must decide which geometric waves there are: a receiver on a boundary would otherwise
lose or double a wave to rounding.

    F(X) = sqrt(pi X) e^{-i pi/4} w(e^{i pi/4} sqrt(X)),   w(e^{i pi/4} r) = t g(t),   t = 1/(1 + r/2)

and g is a Chebyshev series in t: 42 coefficients, relative error 1e-14 everywhere. Source: Kouyoumjian and Pathak,
Proc. IEEE 62, 1448 (1974), Eqs. 25-33 [KP74].
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel

_SERIES = np.array(
    [
        (0.533109660676224, 0.22082125168421066),
        (0.4239274505642961, -0.058296153571051564),
        (0.08351381986740215, -0.12273567040981578),
        (-0.02226045063032328, -0.04746127043651827),
        (-0.018927858547184716, 0.0005864962717977743),
        (-0.0019447868832726542, 0.00670417150803581),
        (0.0022708919235264135, 0.0013067577860587244),
        (0.0006453864572720772, -0.0007629291584004163),
        (-0.0002603906719966982, -0.00028582782226051505),
        (-0.00012047076503728221, 9.196867456022284e-05),
        (3.4076364929513336e-05, 4.952751080357788e-05),
        (2.007947145621558e-05, -1.3338544996675622e-05),
        (-5.509750071356911e-06, -8.060003670695854e-06),
        (-3.202272474117267e-06, 2.382103392151754e-06),
        (1.064916329811557e-06, 1.2547010765612111e-06),
        (4.814311642728868e-07, -4.860272080169017e-07),
        (-2.2392018931224335e-07, -1.7879945168860055e-07),
        (-6.298885734869437e-08, 1.0318110956447873e-07),
        (4.719796219170514e-08, 2.021975747248098e-08),
        (5.32395648125352e-09, -2.129435508796315e-08),
        (-9.417558417135885e-09, -6.589052190277572e-10),
        (4.879280679497957e-10, 4.0547926918267035e-09),
        (1.6847270527621498e-09, -5.639296726685492e-10),
        (-3.988937804682055e-10, -6.667358326141685e-10),
        (-2.4576193530085937e-10, 2.3712766859874487e-10),
        (1.2753781139770926e-10, 8.054744628280078e-11),
        (2.056554130742949e-11, -6.370237899538572e-11),
        (-2.980156178001323e-11, -1.512577423485752e-12),
        (2.9274609137155955e-12, 1.3034969032303456e-11),
        (5.264761994678419e-12, -2.891102478598245e-12),
        (-1.9311038656437984e-12, -1.9031756346140124e-12),
        (-5.660325278257834e-13, 1.0905577272939557e-12),
        (5.507855389388179e-13, 9.504571021926885e-14),
        (-3.691951961811635e-14, -2.5249828049964076e-13),
        (-1.0428751183170163e-13, 5.286320584277319e-14),
        (3.858924062326459e-14, 3.7423877394117094e-14),
        (1.0363128794369767e-14, -2.2528391243014492e-14),
        (-1.143488787440701e-14, -9.755911427953305e-16),
        (1.4098300984421276e-15, 5.138228071691933e-15),
        (2.0088304452902814e-15, -1.4565104243903123e-15),
        (-9.710694062754255e-16, -6.326863018959315e-16),
        (-1.1063332195776152e-16, 5.315472814615456e-16),
    ]
)
"""Coefficients (real, imaginary) of g over T_m(2t - 1), 0 <= t <= 1."""


@inlined
def faddeeva_ray(root):
    """Return ``w(e^{i pi/4} root)`` for root >= 0, from 1 falling like ``e^{i pi/4} / (sqrt(pi) root)``."""
    t = 1.0 / (1.0 + 0.5 * root)
    y = 2.0 * (2.0 * t - 1.0)
    real0 = real1 = imag0 = imag1 = 0.0
    for m in range(_SERIES.shape[0] - 1, 0, -1):  # Clenshaw
        real0, real1 = _SERIES[m, 0] + y * real0 - real1, real0
        imag0, imag1 = _SERIES[m, 1] + y * imag0 - imag1, imag0
    real = _SERIES[0, 0] + 0.5 * y * real0 - real1
    imag = _SERIES[0, 1] + 0.5 * y * imag0 - imag1
    return complex(real * t, imag * t)


@inlined
def transition(root):
    """Return ``F(root^2)``, which rises from 0 to 1."""
    return math.sqrt(math.pi) * root * complex(math.sqrt(0.5), -math.sqrt(0.5)) * faddeeva_ray(root)


@inlined
def boundary_angle(n, sum_, sign):
    """Return delta = sign pi + sum - 2 pi n N, the signed angle past the nearest boundary of that term."""
    turned = sign * math.pi + sum_
    return turned - 2.0 * math.pi * n * np.rint(turned / (2.0 * math.pi * n))


@inlined
def boundary_term(n, sum_, sign, root_kl):
    """Return C_sign(sum) for root_kl = sqrt(k L)."""
    delta = boundary_angle(n, sum_, sign)
    if delta == 0.0:
        return complex(0.0, 0.0)
    sine = math.sin(0.5 * delta)
    # F / |sin(delta/2)| first: finite, while the cotangent is not.
    smooth = math.sqrt(2.0 * math.pi) * root_kl * complex(math.sqrt(0.5), -math.sqrt(0.5))
    smooth *= faddeeva_ray(math.sqrt(2.0) * root_kl * abs(sine))
    return sign * smooth * (abs(sine) / math.tan(0.5 * delta / n))


@inlined
def wedge_pair(n, phi, incidence, distance, k, sin_beta):
    """Return D_s and D_h, in square roots of length; ``distance`` is the distance parameter L."""
    root_kl = math.sqrt(k * distance)
    below = boundary_term(n, phi - incidence, 1.0, root_kl) + boundary_term(n, phi - incidence, -1.0, root_kl)
    above = boundary_term(n, phi + incidence, 1.0, root_kl) + boundary_term(n, phi + incidence, -1.0, root_kl)
    scale = -complex(math.sqrt(0.5), math.sqrt(0.5)) / (2.0 * n * math.sqrt(2.0 * math.pi * k) * sin_beta)
    return scale * (below - above), scale * (below + above)


@inlined
def _lit(angle):
    """1 before a boundary, 0 behind it, one half on it."""
    return 1.0 if angle < 0.0 else (0.5 if angle == 0.0 else 0.0)


@inlined
def geometric_weights(n, phi, incidence):
    """Weights of the direct wave and of the images in the 0-face and the n-face, by the deltas of `boundary_term`."""
    difference, total = phi - incidence, phi + incidence
    # Past pi the direct wave is in shadow: seen from the 0-face by C_-, from the n-face by C_+.
    behind = -math.pi + difference if difference >= 0.0 else -(math.pi + difference)
    over = math.pi + total - 2.0 * math.pi * n
    return _lit(behind), _lit(-math.pi + total), _lit(-over)


@kernel
def wedge_pairs(n, phi, incidence, distance, k, sin_beta, soft, hard):
    """Fill ``soft``, ``hard`` complex128[m] with the coefficients for angles and distances float64[m]."""
    for m in range(phi.size):
        soft[m], hard[m] = wedge_pair(n, phi[m], incidence[m], distance[m], k, sin_beta[m])


@kernel
def wedge_weights(n, phi, incidence, out):
    """Fill ``out`` float64[m, 3] with the weights of the direct wave and the two images."""
    for m in range(phi.size):
        out[m, 0], out[m, 1], out[m, 2] = geometric_weights(n, phi[m], incidence[m])
