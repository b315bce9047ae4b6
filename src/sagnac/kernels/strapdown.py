"""Strapdown navigation in the wander frame: attitude, velocity and position from increments of angle and velocity.

The equations and their symbols are those of :mod:`sagnac.navigate.strapdown`. What is known stands in one array::

    0:4    quaternion from body to w, scalar last
    4:7    velocity over the Earth in w, m/s
    7:16   C_e_w, row by row
    16     height, m
    17:24  the sample before the first one: turn, push, step (zero: none); may be left out, and then there is none

Numbers stay in scalars and products are written out: the same work with ``np.dot`` on small arrays takes an order of
magnitude longer.
"""

from __future__ import annotations

import math

import numba as nb

FULL = 24
"""Numbers of a state with the sample before."""

_EVEN = 1e-3  # steps that differ by less count as equal: a clock that is written to six digits is not the sampling
_LIKE = 2.0  # a step this much longer than its neighbour is a gap: how the rate changes is not to be had across it


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def cross(a0, a1, a2, b0, b1, b2):  # type: ignore[no-untyped-def]
    """``a x b``."""
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _pair(turns, pushes, steps, k):  # type: ignore[no-untyped-def]
    """Coning and sculling terms of samples k and k + 1."""
    h1, h2 = steps[k], steps[k + 1]
    c = 0.5  # two constant rates, one after the other
    if h1 < _LIKE * h2 and h2 < _LIKE * h1:
        c = (h1 + h2) * (h1 + h2) / (6.0 * h1 * h2)
    a0, a1, a2 = c * turns[k, 0], c * turns[k, 1], c * turns[k, 2]
    u0, u1, u2 = c * pushes[k, 0], c * pushes[k, 1], c * pushes[k, 2]
    b0, b1, b2 = turns[k + 1, 0], turns[k + 1, 1], turns[k + 1, 2]
    v0, v1, v2 = pushes[k + 1, 0], pushes[k + 1, 1], pushes[k + 1, 2]
    c0, c1, c2 = cross(a0, a1, a2, b0, b1, b2)
    s0, s1, s2 = cross(a0, a1, a2, v0, v1, v2)
    r0, r1, r2 = cross(u0, u1, u2, b0, b1, b2)
    return c0, c1, c2, s0 + r0, s1 + r1, s2 + r2


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _against(turns, pushes, k, w1, w2, w3, i):  # type: ignore[no-untyped-def]
    """The same of sample i against a weighted sum of samples k + 1 to k + 3; a weight of zero: there may be none."""
    a0, a1, a2 = turns[i, 0], turns[i, 1], turns[i, 2]
    u0, u1, u2 = pushes[i, 0], pushes[i, 1], pushes[i, 2]
    b0, b1, b2 = w2 * turns[k + 2, 0], w2 * turns[k + 2, 1], w2 * turns[k + 2, 2]
    v0, v1, v2 = w2 * pushes[k + 2, 0], w2 * pushes[k + 2, 1], w2 * pushes[k + 2, 2]
    if w1 != 0.0:
        b0, b1, b2 = b0 + w1 * turns[k + 1, 0], b1 + w1 * turns[k + 1, 1], b2 + w1 * turns[k + 1, 2]
        v0, v1, v2 = v0 + w1 * pushes[k + 1, 0], v1 + w1 * pushes[k + 1, 1], v2 + w1 * pushes[k + 1, 2]
    if w3 != 0.0:
        b0, b1, b2 = b0 + w3 * turns[k + 3, 0], b1 + w3 * turns[k + 3, 1], b2 + w3 * turns[k + 3, 2]
        v0, v1, v2 = v0 + w3 * pushes[k + 3, 0], v1 + w3 * pushes[k + 3, 1], v2 + w3 * pushes[k + 3, 2]
    c0, c1, c2 = cross(a0, a1, a2, b0, b1, b2)
    s0, s1, s2 = cross(a0, a1, a2, v0, v1, v2)
    r0, r1, r2 = cross(u0, u1, u2, b0, b1, b2)
    return c0, c1, c2, s0 + r0, s1 + r1, s2 + r2


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _three(turns, pushes, k):  # type: ignore[no-untyped-def]
    """Coning and sculling terms of three samples: 9/20 a1 x a3 + 27/40 a2 x (a3 - a1)."""
    c0, c1, c2, s0, s1, s2 = _against(turns, pushes, k, 27 / 40, 9 / 20, 0.0, k)
    d0, d1, d2, t0, t1, t2 = _against(turns, pushes, k, 0.0, 27 / 40, 0.0, k + 1)
    return c0 + d0, c1 + d1, c2 + d2, s0 + t0, s1 + t1, s2 + t2


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _four(turns, pushes, k):  # type: ignore[no-untyped-def]
    """Coning and sculling terms of four samples."""
    c0, c1, c2, s0, s1, s2 = _against(turns, pushes, k, 232 / 315, 138 / 315, 162 / 315, k)
    d0, d1, d2, t0, t1, t2 = _against(turns, pushes, k, 0.0, 178 / 315, 138 / 315, k + 1)
    e0, e1, e2, r0, r1, r2 = _against(turns, pushes, k, 0.0, 0.0, 232 / 315, k + 2)
    return c0 + d0 + e0, c1 + d1 + e1, c2 + d2 + e2, s0 + t0 + r0, s1 + t1 + r1, s2 + t2 + r2


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _even(steps, k, m):  # type: ignore[no-untyped-def]
    """Whether m steps are equal."""
    low = high = steps[k]
    for j in range(k + 1, k + m):
        low, high = min(low, steps[j]), max(high, steps[j])
    return high - low <= _EVEN * low


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _curvature(sine2, height, a, e2):  # type: ignore[no-untyped-def]
    """k1 and k2 of :func:`sagnac.navigate.wander.curvature`, and ``sqrt(1 - e^2 sin^2 L)``."""
    w2 = 1.0 - e2 * sine2
    root = math.sqrt(w2)
    normal = a / root
    k1 = 1.0 / (normal + height)
    return k1, k1 * e2 * normal / (normal * (1.0 - e2) + height * w2), root


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _orthonormal(state):  # type: ignore[no-untyped-def]
    """Take out of C_e_w what rounding has put in: rows of length one, at right angles."""
    x0, x1, x2, z0, z1, z2 = state[7], state[8], state[9], state[13], state[14], state[15]
    f = 1.0 / math.sqrt(z0 * z0 + z1 * z1 + z2 * z2)
    z0, z1, z2 = f * z0, f * z1, f * z2
    f = x0 * z0 + x1 * z1 + x2 * z2
    x0, x1, x2 = x0 - f * z0, x1 - f * z1, x2 - f * z2
    f = 1.0 / math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
    x0, x1, x2 = f * x0, f * x1, f * x2
    state[7], state[8], state[9] = x0, x1, x2
    state[10], state[11], state[12] = cross(z0, z1, z2, x0, x1, x2)
    state[13], state[14], state[15] = z0, z1, z2


@nb.njit(cache=True, nogil=True, error_model="numpy")
def advance(  # type: ignore[no-untyped-def] # noqa: PLR0915 - one flat loop keeps its numbers in registers
    state, turns, pushes, steps, samples, slaved, held, heights, constants, pushed
):
    """Advance a state over all samples, in place.

    The samples are taken in groups. The rotation vector of a group is the sum of its turns a1 + a2 + ... and a coning
    term, its translation vector the sum of its pushes u1 + u2 + ... and a sculling term, and the velocity gained in
    body axes at the start is what the two give as if the rate and the specific force were constant, in closed form:
    ``u + a x u / 2 + a x (a x u) / 6 + ...`` [Savage2006]_. The sculling term is the coning term with ``a x b``
    replaced by ``a x v + u x b`` [Roscoe2001]_. In equal steps the coning term of a group is

    - 1 sample: 1/12 of the product of the sample before with it [Savage1998]_. The first sample of all takes the one
      after it if there is one in the same call, and else goes without;
    - 2 samples: 2/3 a1 x a2 [Ignagni1996]_;
    - 3 samples: 9/20 a1 x a3 + 27/40 a2 x (a3 - a1) [Miller1983]_;
    - 4 samples: (232 (a1 x a2 + a3 x a4) + 178 a2 x a3 + 138 (a1 x a3 + a2 x a4) + 162 a1 x a4) / 315. In coning, where
      only the distance of two samples counts, this is the same as the optimal (54 a1 + 92 a2 + 214 a3) x a4 / 105
      [Ignagni1996]_: 2 * 232 + 178 = 3 * 214, 2 * 138 = 3 * 92, 162 = 3 * 54. Spread evenly over both ends it is exact
      to fifth order in the step for any motion, and the concentrated form only to third (the idea is that of
      [Song2013]_).

    In pure coning at the frequency W with the half-angle b this leaves a drift of ``b^2 W (W h)^4 / 60``, the same,
    ``(W h)^6 / 280`` and ``(W h)^8 / 1260`` for 1 to 4 samples [Park1999]_. Other motion is followed to fourth order in
    the length of the group (position to second), so that 2 samples, in shorter groups, do better on large slow motion,
    and 3 or 4 in vibration.

    In unequal steps the coefficients of one and two samples are exact for rates that change linearly, whatever the
    steps: h2^2 / (6 h1 (h1 + h2)) with the sample before, (h1 + h2)^2 / (6 h1 h2) for two; the order is then
    three. A group of three or four is done by twos and ones when its steps differ by more than a thousandth. Next to a
    step that is twice as long or more (a gap) nothing is known of how the rate changed: each sample counts as a
    constant rate, which leaves 1/2 a1 x a2 for two samples and nothing for one.

    Position, Earth rate, gravity and the rates of w are taken in the middle of the group.

    Parameters
    ----------
    state : ndarray, shape (17,) or (24,)
        See the module. With 24 numbers a call may end anywhere and the next one knows the sample before.
    turns : ndarray, shape (n, 3), rad
        Integral of the angular rate of the body against i, in body axes, over each sample interval.
    pushes : ndarray, shape (n, 3), m/s
        Integral of the specific force, the same.
    steps : ndarray, shape (n,), s
        Lengths of the sample intervals, above zero.
    samples : int
        Samples in a group, 1 to 4. What is left over at the end is a smaller group.
    slaved : bool
        Turn w with north: x stays east if it is. Singular at the poles.
    held : bool
        Keep the height; the vertical velocity is zero.
    heights : ndarray, shape (n,) or (0,), m
        Given height at the end of each sample interval; the vertical velocity is its difference quotient.
    constants : ndarray, shape (8,)
        `sagnac.earth.ELLIPSOID`, Earth rate (rad/s), excess of the real gravity over the normal one (m/s^2).
    pushed : ndarray, shape (3,), m/s
        The velocity gained from the specific force, in w, is added to it.

    Returns
    -------
    float, rad
        With `slaved` the largest turn of w about the vertical in one group: large near a pole.

    References
    ----------
    .. [Ignagni1996] M. B. Ignagni, "Efficient class of optimized coning compensation algorithms", J. Guidance 19(2),
       1996.
    .. [Miller1983] R. B. Miller, "A new strapdown attitude algorithm", J. Guidance 6(4), 1983.
    .. [Park1999] C. G. Park, K. J. Kim, J. G. Lee, D. Chung, "Formalized approach to obtaining optimal coefficients
       for coning algorithms", J. Guidance 22(1), 1999.
    .. [Roscoe2001] K. M. Roscoe, "Equivalency between strapdown inertial navigation coning and sculling
       integrals/algorithms", J. Guidance 24(2), 2001.
    .. [Savage1998] P. G. Savage, "Strapdown inertial navigation integration algorithm design", J. Guidance 21(1, 2),
       1998.
    .. [Savage2006] P. G. Savage, "A unified mathematical framework for strapdown algorithm design", J. Guidance
       29(2), 2006.
    .. [Song2013] M. Song, W. Wu, X. Pan, "Approach to recovering maneuver accuracy in classical coning algorithms",
       J. Guidance 36(6), 2013.
    """
    n = steps.size
    given = heights.size > 0
    tied = held or given
    a, e2, g_e, g_k, g_p, g_q = constants[0], constants[1], constants[2], constants[3], constants[4], constants[5]
    earth_rate, excess = constants[6], constants[7]
    x, y, z, w = state[0], state[1], state[2], state[3]
    v0, v1, v2 = state[4], state[5], state[6]
    m00, m01, m02 = state[7], state[8], state[9]
    m10, m11, m12 = state[10], state[11], state[12]
    m20, m21, m22 = state[13], state[14], state[15]
    height = state[16]
    sum0 = sum1 = sum2 = largest = 0.0
    p0 = p1 = p2 = q0 = q1 = q2 = before = 0.0  # the sample before
    if state.size >= FULL:
        p0, p1, p2, q0, q1, q2, before = state[17], state[18], state[19], state[20], state[21], state[22], state[23]
    if before == 0.0 and n > 1:  # the first of all: -next x this = this x next
        p0, p1, p2, before = -turns[1, 0], -turns[1, 1], -turns[1, 2], steps[1]
        q0, q1, q2 = -pushes[1, 0], -pushes[1, 1], -pushes[1, 2]
    if held:
        v2 = 0.0

    k1, k2, root = _curvature(m22 * m22, height, a, e2)
    k = 0
    while k < n:
        m = min(samples, n - k)
        if m > 2 and not _even(steps, k, m):
            m = 2

        # rotation vector a and translation vector u of the group
        a0, a1, a2 = turns[k, 0], turns[k, 1], turns[k, 2]
        u0, u1, u2 = pushes[k, 0], pushes[k, 1], pushes[k, 2]
        step = steps[k]
        if m == 1:
            c0 = c1 = c2 = s0 = s1 = s2 = 0.0
            if step < _LIKE * before and before < _LIKE * step:
                c = step * step / (6.0 * before * (before + step))
                c0, c1, c2 = c * (p1 * a2 - p2 * a1), c * (p2 * a0 - p0 * a2), c * (p0 * a1 - p1 * a0)
                s0 = c * (p1 * u2 - p2 * u1 + q1 * a2 - q2 * a1)
                s1 = c * (p2 * u0 - p0 * u2 + q2 * a0 - q0 * a2)
                s2 = c * (p0 * u1 - p1 * u0 + q0 * a1 - q1 * a0)
        elif m == 2:
            c0, c1, c2, s0, s1, s2 = _pair(turns, pushes, steps, k)
        elif m == 3:
            c0, c1, c2, s0, s1, s2 = _three(turns, pushes, k)
        else:
            c0, c1, c2, s0, s1, s2 = _four(turns, pushes, k)
        for j in range(k + 1, k + m):
            a0, a1, a2 = a0 + turns[j, 0], a1 + turns[j, 1], a2 + turns[j, 2]
            u0, u1, u2 = u0 + pushes[j, 0], u1 + pushes[j, 1], u2 + pushes[j, 2]
            step += steps[j]
        k += m
        p0, p1, p2, before = turns[k - 1, 0], turns[k - 1, 1], turns[k - 1, 2], steps[k - 1]
        q0, q1, q2 = pushes[k - 1, 0], pushes[k - 1, 1], pushes[k - 1, 2]

        a0, a1, a2, u0, u1, u2 = a0 + c0, a1 + c1, a2 + c2, u0 + s0, u1 + s1, u2 + s2

        # velocity gained, in body axes at the start: u + b1 a x u + b2 a x (a x u)
        # with b1 = (1 - cos a) / a^2, b2 = (a - sin a) / a^3
        angle2 = a0 * a0 + a1 * a1 + a2 * a2
        if angle2 < 0.25:
            b1 = 0.5 - angle2 / 24.0 * (1.0 - angle2 / 30.0 * (1.0 - angle2 / 56.0 * (1.0 - angle2 / 90.0)))
            b2 = (1.0 - angle2 / 20.0 * (1.0 - angle2 / 42.0 * (1.0 - angle2 / 72.0 * (1.0 - angle2 / 110.0)))) / 6.0
        else:
            angle = math.sqrt(angle2)
            b1, b2 = (1.0 - math.cos(angle)) / angle2, (angle - math.sin(angle)) / (angle2 * angle)
        t0, t1, t2 = cross(a0, a1, a2, u0, u1, u2)
        r0, r1, r2 = cross(a0, a1, a2, t0, t1, t2)
        u0, u1, u2 = u0 + b1 * t0 + b2 * r0, u1 + b1 * t1 + b2 * r1, u2 + b1 * t2 + b2 * r2

        # in w at the start: C u, from the quaternion
        t0, t1, t2 = cross(x, y, z, u0, u1, u2)
        t0, t1, t2 = t0 + t0, t1 + t1, t2 + t2
        r0, r1, r2 = cross(x, y, z, t0, t1, t2)
        u0, u1, u2 = u0 + w * t0 + r0, u1 + w * t1 + r1, u2 + w * t2 + r2

        # axis of the Earth in w and height, in the middle of the group, with the velocity at its start
        half = 0.5 * step
        if given:
            v2 = (heights[k - 1] - height) / step
        middle = height + half * v2
        along = k2 * (m02 * v0 + m12 * v1)
        f0, f1 = k1 * v0 + along * m02, k1 * v1 + along * m12  # K v
        f2 = f0 * m22 / m12 if slaved else 0.0
        l0, l1, l2 = (
            m02 - half * (f0 * m22 - f2 * m12),
            m12 - half * (f1 * m22 + f2 * m02),
            m22 + half * (f0 * m02 + f1 * m12),
        )

        # curvature and gravity there (NIMA TR8350.2, equations 4-1 and 4-3)
        sine2 = l2 * l2
        k1, k2, root = _curvature(sine2, middle, a, e2)
        ratio = middle / a
        gravity = g_e * (1.0 + g_k * sine2) / root * (1.0 - (g_p - g_q * sine2) * ratio + 3.0 * ratio * ratio) + excess

        # rates of the Earth and of w over it, with that velocity
        e0, e1, ez = earth_rate * l0, earth_rate * l1, earth_rate * l2
        f2 = f0 * l2 / l1 if slaved else 0.0
        w0, w1, wz = e0 - f1, e1 + f0, ez + f2
        t0, t1, t2 = cross(w0, w1, wz, u0, u1, u2)
        u0, u1, u2 = u0 - half * t0, u1 - half * t1, u2 - half * t2  # in w at half time
        sum0, sum1, sum2 = sum0 + u0, sum1 + u1, sum2 + u2
        u2 -= gravity * step

        # velocity in the middle, and again the rate of w with it
        t0, t1, t2 = cross(e0 + w0, e1 + w1, ez + wz, v0, v1, v2)
        h0, h1, h2 = v0 + 0.5 * (u0 - step * t0), v1 + 0.5 * (u1 - step * t1), v2 + 0.5 * (u2 - step * t2)
        if tied:
            h2 = v2
        along = k2 * (l0 * h0 + l1 * h1)
        f0, f1 = k1 * h0 + along * l0, k1 * h1 + along * l1
        f2 = f0 * l2 / l1 if slaved else 0.0
        w0, w1, wz = e0 - f1, e1 + f0, ez + f2

        t0, t1, t2 = cross(e0 + w0, e1 + w1, ez + wz, h0, h1, h2)
        v0, v1 = v0 + u0 - step * t0, v1 + u1 - step * t1
        if given:
            height = heights[k - 1]
        elif not held:
            fall = u2 - step * t2
            height += step * (v2 + 0.5 * fall)
            v2 += fall

        # position: (I - [r x] + [r x]^2 / 2) C_e_w, r = w_ew step
        f0, f1, f2 = -step * f1, step * f0, step * f2
        largest = max(largest, abs(f2))
        t0, t1, t2 = cross(f0, f1, f2, m00, m10, m20)
        r0, r1, r2 = cross(f0, f1, f2, t0, t1, t2)
        m00, m10, m20 = m00 - t0 + 0.5 * r0, m10 - t1 + 0.5 * r1, m20 - t2 + 0.5 * r2
        t0, t1, t2 = cross(f0, f1, f2, m01, m11, m21)
        r0, r1, r2 = cross(f0, f1, f2, t0, t1, t2)
        m01, m11, m21 = m01 - t0 + 0.5 * r0, m11 - t1 + 0.5 * r1, m21 - t2 + 0.5 * r2
        t0, t1, t2 = cross(f0, f1, f2, m02, m12, m22)
        r0, r1, r2 = cross(f0, f1, f2, t0, t1, t2)
        m02, m12, m22 = m02 - t0 + 0.5 * r0, m12 - t1 + 0.5 * r1, m22 - t2 + 0.5 * r2

        # attitude: quaternion of the body's turn from the right, of the turn of w against i from the left
        quarter = 0.25 * (a0 * a0 + a1 * a1 + a2 * a2)
        if quarter < 0.0625:
            s = 0.5 - quarter / 12.0 * (1.0 - quarter / 20.0 * (1.0 - quarter / 42.0 * (1.0 - quarter / 72.0)))
            c = 1.0 - quarter / 2.0 * (1.0 - quarter / 12.0 * (1.0 - quarter / 30.0 * (1.0 - quarter / 56.0)))
        else:
            angle = math.sqrt(quarter)
            s, c = 0.5 * math.sin(angle) / angle, math.cos(angle)
        a0, a1, a2 = s * a0, s * a1, s * a2
        r0, r1, r2, rw = (
            w * a0 + x * c + y * a2 - z * a1,
            w * a1 - x * a2 + y * c + z * a0,
            w * a2 + x * a1 - y * a0 + z * c,
            w * c - x * a0 - y * a1 - z * a2,
        )
        d0, d1, d2 = half * w0, half * w1, half * wz
        s = 1.0 - 0.5 * (d0 * d0 + d1 * d1 + d2 * d2)
        x = s * r0 - d0 * rw - d1 * r2 + d2 * r1
        y = s * r1 - d1 * rw - d2 * r0 + d0 * r2
        z = s * r2 - d2 * rw - d0 * r1 + d1 * r0
        w = s * rw + d0 * r0 + d1 * r1 + d2 * r2
        s = 1.5 - 0.5 * (x * x + y * y + z * z + w * w)  # to length one: one step of Newton's
        x, y, z, w = s * x, s * y, s * z, s * w

    state[0], state[1], state[2], state[3] = x, y, z, w
    state[4], state[5], state[6] = v0, v1, v2
    state[7], state[8], state[9] = m00, m01, m02
    state[10], state[11], state[12] = m10, m11, m12
    state[13], state[14], state[15] = m20, m21, m22
    state[16] = height
    _orthonormal(state)
    if state.size >= FULL and n > 0:
        state[17], state[18], state[19], state[20], state[21], state[22] = p0, p1, p2, q0, q1, q2
        state[23] = before
    pushed[0] += sum0
    pushed[1] += sum1
    pushed[2] += sum2
    return largest


@nb.njit(cache=True, nogil=True, error_model="numpy")
def trace(  # type: ignore[no-untyped-def]
    state, turns, pushes, steps, samples, slaved, held, heights, constants, pushed, every, since, clock, rows
):
    """:func:`advance`, and the state and its time after every so many samples.

    Parameters
    ----------
    state, turns, pushes, steps, samples, slaved, held, heights, constants, pushed
        As :func:`advance` takes them. Groups end where a state is kept.
    every : int
        Keep a state after so many samples each.
    since : int
        Samples since the last kept state, before these.
    clock : ndarray, shape (1,), s
        Time of `state`; advanced with it.
    rows : ndarray, shape ((since + n) // every, 1 + width of a state)
        Time and state; overwritten.

    Returns
    -------
    float, rad
        As :func:`advance`.
    """
    k, row, n, largest = 0, 0, steps.size, 0.0
    while k < n:
        stop = min(n, k + every - since)
        given = heights[k:stop] if heights.size > 0 else heights
        t, p, h = turns[k:stop], pushes[k:stop], steps[k:stop]
        largest = max(largest, advance(state, t, p, h, samples, slaved, held, given, constants, pushed))
        for j in range(k, stop):
            clock[0] += steps[j]
        since += stop - k
        k = stop
        if since == every:
            rows[row, 0] = clock[0]
            rows[row, 1:] = state
            row, since = row + 1, 0
    return largest
