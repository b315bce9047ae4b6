"""Random numbers for many runs side by side: every lane has a generator of its own, see :mod:`sagnac.kernels.lanes`.

The generator is xoshiro256++ (Blackman & Vigna 2021, doi 10.1145/3460772) with a state of four rows of integers; what a
run draws depends on its own state alone. Normal numbers come in pairs from Box and Muller's transform, with the
logarithm, sine and cosine as polynomials, so that all lanes go the same way.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from .lanes import LANES

_QUICK = {"contract"}  # a product and a sum may become one instruction

_U = np.uint64
_ONE = _U(0x3FF0000000000000)  # exponent of numbers from 1 to 2
_MANTISSA = _U(0x000FFFFFFFFFFFFF)
_ROOT_HALF = _U(0x3FE6A09E00000000)  # a little less than the root of 1/2
_BIG = _U(0x4330000000000000)  # 2^52: an integer below that becomes a number when it is put behind
_BIG_AND_BIAS = 4503599627370496.0 + 1023.0
_LOG_2 = math.log(2.0)
_QUARTER_TURN = 0.5 * math.pi


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _next(a, b, c, d):  # type: ignore[no-untyped-def]
    """A number of 64 bits, and the next state."""
    r = a + d
    r = ((r << _U(23)) | (r >> _U(41))) + a
    t = b << _U(17)
    c ^= a
    d ^= b
    b ^= c
    a ^= d
    c ^= t
    d = (d << _U(45)) | (d >> _U(19))
    return r, a, b, c, d


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def normals(state, out, at):  # type: ignore[no-untyped-def]
    """Draw two rows of standard normal numbers.

    Parameters
    ----------
    state : ndarray of uint64, shape (4 * LANES,)
        In place.
    out : ndarray
        Rows `at` and ``at + 1`` are filled.
    at : int

    Notes ----- ``sqrt(-2 ln u)`` times the cosine and the sine of an angle. Of u there are 52 bits, so that no number
    is beyond 8.5; the angle is drawn within an eighth of a turn of an axis, and three more bits choose which. The
    polynomials are those of fdlibm (Sun Microsystems 1993: e_log.c, k_sin.c, k_cos.c), good to the last bit or two.
    """
    rows = out[at * LANES : (at + 2) * LANES]
    for i in range(LANES):
        a, b, c, d = state[i], state[LANES + i], state[2 * LANES + i], state[3 * LANES + i]
        x, a, b, c, d = _next(a, b, c, d)
        y, a, b, c, d = _next(a, b, c, d)
        state[i], state[LANES + i], state[2 * LANES + i], state[3 * LANES + i] = a, b, c, d

        # logarithm of u in (0, 1]: u = 2^e m with m around one
        u = 2.0 - np.uint64((x >> _U(12)) | _ONE).view(np.float64)
        bits = np.float64(u).view(np.uint64) + (_ONE - _ROOT_HALF)
        e = np.uint64((bits >> _U(52)) | _BIG).view(np.float64) - _BIG_AND_BIAS
        f = np.uint64((bits & _MANTISSA) + _ROOT_HALF).view(np.float64) - 1.0
        s = f / (2.0 + f)
        z = s * s
        p = 1.818357216161805012e-01 + z * (1.531383769920937332e-01 + z * 1.479819860511658591e-01)
        p = 3.999999999940941908e-01 + z * (2.857142874366239149e-01 + z * (2.222219843214978396e-01 + z * p))
        half = 0.5 * f * f
        log = e * _LOG_2 - ((half - s * (half + z * (6.666666666666735130e-01 + z * p))) - f)
        radius = math.sqrt(-2.0 * log)

        # sine and cosine of an angle from -45 to 45 deg
        w = _QUARTER_TURN * (np.uint64((y >> _U(12)) | _ONE).view(np.float64) - 1.5)
        z = w * w
        p = -1.98412698298579493134e-04 + z * (
            2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
        )
        sine = w + w * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * p))
        p = 2.48015872894767294178e-05 + z * (
            -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)
        )
        cosine = 1.0 - 0.5 * z + z * z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * p))
        swap, left, down = (y & _U(1)) == _U(0), (y & _U(2)) == _U(0), (y & _U(4)) == _U(0)
        rows[i] = (radius if left else -radius) * (sine if swap else cosine)
        rows[LANES + i] = (radius if down else -radius) * (cosine if swap else sine)
