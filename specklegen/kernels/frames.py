"""Direction frames: turn a direction by a polar and an azimuthal angle."""

import math

from specklegen.kernels import inlined
from specklegen.kernels.arithmetic import fma


@inlined
def deflect(x, y, z, one_minus_cos, cos_azimuth, sin_azimuth):
    """Turn the unit vector (x, y, z) by the polar angle with 1 - cos given, at the azimuth given.

    The frame is the branchless one of Duff et al., *Building an orthonormal basis, revisited* (JCGT, 2017), good at
    both poles. The polar angle enters as 1 - cos, so that tiny angles keep their relative precision.
    """
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    cos_polar = 1.0 - one_minus_cos
    sin_polar = math.sqrt(max(0.0, one_minus_cos * (2.0 - one_minus_cos)))
    s = sin_polar * cos_azimuth
    t = sin_polar * sin_azimuth
    return (
        fma(s, fma(sign * x * x, a, 1.0), fma(t, b, cos_polar * x)),
        fma(s * sign, b, fma(t, fma(y * y, a, sign), cos_polar * y)),
        fma(-s * sign, x, fma(-t, y, cos_polar * z)),
    )
