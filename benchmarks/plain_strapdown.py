"""Strapdown navigation in plain NumPy, matrices throughout, as one would write it first: the twin of the kernel.

Nothing here is imported by the package. Tests compare the kernel with :func:`advance`; ``make bench`` times it against
:func:`with_dots`, which Numba compiles.
"""

from __future__ import annotations

import numpy as np


def skew(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def exponential(v):
    """``exp([v x])``."""
    angle = np.sqrt(np.dot(v, v))
    if angle < 1e-4:
        first, second = 1.0 - angle**2 / 6.0, 0.5 - angle**2 / 24.0
    else:
        first, second = np.sin(angle) / angle, 2.0 * (np.sin(0.5 * angle) / angle) ** 2
    return np.eye(3) + first * skew(v) + second * np.dot(skew(v), skew(v))


def to_matrix(q):
    """C_b_w of a quaternion, scalar last."""
    v, w = q[:3], q[3]
    return (2.0 * w * w - 1.0) * np.eye(3) + 2.0 * w * skew(v) + 2.0 * np.outer(v, v)


def to_quaternion(C):
    """The inverse, from the largest of the four components on."""
    squares = np.array([C[0, 0], C[1, 1], C[2, 2], 0.0])
    squares[3] = C[0, 0] + C[1, 1] + C[2, 2]
    squares[:3] = 1.0 + 2.0 * squares[:3] - squares[3]
    squares[3] = 1.0 + squares[3]
    i = np.argmax(squares)
    out = np.empty(4)
    if i == 3:
        out[:] = C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1], squares[3]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i], out[j], out[k], out[3] = squares[i], C[i, j] + C[j, i], C[i, k] + C[k, i], C[k, j] - C[j, k]
    return out / np.sqrt(np.dot(out, out))


def weights(steps):
    """Coefficients of the products of two samples of a group, upper triangle."""
    m = len(steps)
    out = np.zeros((4, 4))
    if m == 2:
        h1, h2 = steps[0], steps[1]
        near = h1 < 2.0 * h2 and h2 < 2.0 * h1
        out[0, 1] = (h1 + h2) ** 2 / (6.0 * h1 * h2) if near else 0.5
    elif m == 3:
        out[0, 1] = out[1, 2] = 27.0 / 40.0
        out[0, 2] = 9.0 / 20.0
    elif m == 4:
        out[0, 1] = out[2, 3] = 232.0 / 315.0
        out[1, 2] = 178.0 / 315.0
        out[0, 2] = out[1, 3] = 138.0 / 315.0
        out[0, 3] = 162.0 / 315.0
    return out


def terms(turns, pushes, steps, before):
    """Coning and sculling terms of a group; a group of one goes with the sample before it."""
    w = weights(steps)
    coning, sculling = np.zeros(3), np.zeros(3)
    for i in range(len(steps)):
        for j in range(i + 1, len(steps)):
            coning += w[i, j] * np.dot(skew(turns[i]), turns[j])
            sculling += w[i, j] * (np.dot(skew(turns[i]), pushes[j]) + np.dot(skew(pushes[i]), turns[j]))
    turn, push, last = before
    step = steps[0]
    if len(steps) == 1 and step < 2.0 * last and last < 2.0 * step:
        factor = step**2 / (6.0 * last * (last + step))
        coning = factor * np.dot(skew(turn), turns[0])
        sculling = factor * (np.dot(skew(turn), pushes[0]) + np.dot(skew(push), turns[0]))
    return coning, sculling


def size(steps, samples):
    """How many of the samples that are left make the next group."""
    m = min(samples, len(steps))
    return 2 if m > 2 and np.ptp(steps[:m]) > 1e-3 * np.min(steps[:m]) else m


def rotated(turn, push, second):
    """Velocity in the axes at the start; `second`: with the double cross product and what follows it."""
    angle = np.sqrt(np.dot(turn, turn))
    once, twice = np.dot(skew(turn), push), np.dot(skew(turn), np.dot(skew(turn), push))
    if not second:
        return push + 0.5 * once
    if angle < 1e-2:
        first, then = 0.5 - angle**2 / 24.0 + angle**4 / 720.0, 1.0 / 6.0 - angle**2 / 120.0 + angle**4 / 5040.0
    else:
        first, then = 2.0 * (np.sin(0.5 * angle) / angle) ** 2, (angle - np.sin(angle)) / angle**3
    return push + first * once + then * twice


def earth(axis, height, constants):
    """Curvature and gravity, from the third component of the Earth's axis and the height: NIMA TR8350.2."""
    a, e2, g_e, g_k, g_p, g_q = constants[:6]
    sine2 = axis[2] ** 2
    normal = a / np.sqrt(1.0 - e2 * sine2)
    meridian = normal * (1.0 - e2) / (1.0 - e2 * sine2)
    surface = g_e * (1.0 + g_k * sine2) / np.sqrt(1.0 - e2 * sine2)
    gravity = surface * (1.0 - (g_p - g_q * sine2) * height / a + 3.0 * (height / a) ** 2) + constants[7]
    cosine2 = axis[0] ** 2 + axis[1] ** 2
    p = axis[:2]
    extra = 1.0 / (meridian + height) - 1.0 / (normal + height)
    K = np.eye(2) / (normal + height)
    if cosine2 > 0.0:
        K += extra / cosine2 * np.outer(p, p)
    return K, gravity


def transport(K, v, axis, slaved):
    """w_ew."""
    flow = np.dot(K, v[:2])
    return np.array([-flow[1], flow[0], flow[0] * axis[2] / axis[1] if slaved else 0.0])


def advance(state, turns, pushes, steps, samples, slaved, held, heights, constants, pushed, second=True):
    """Same arguments and effect as :func:`sagnac.kernels.strapdown.advance`; `second` as :func:`rotated` takes it."""
    n, tied = len(steps), held or heights.size > 0
    C, M = to_matrix(state[:4]), state[7:16].copy().reshape(3, 3)
    v, height = state[4:7].copy(), state[16]
    before = (state[17:20].copy(), state[20:23].copy(), state[23]) if len(state) == 24 else (None, None, 0.0)
    if before[2] == 0.0:
        before = (-turns[1], -pushes[1], steps[1]) if n > 1 else (None, None, 0.0)
    if held:
        v[2] = 0.0
    k = 0
    while k < n:
        m = size(steps[k:], samples)
        group = turns[k : k + m], pushes[k : k + m], steps[k : k + m]
        turn, push, step = (values.sum(axis=0) for values in group)
        coning, sculling = terms(*group, before)
        turn, push = turn + coning, push + sculling
        k += m
        before = turns[k - 1], pushes[k - 1], steps[k - 1]

        if heights.size > 0:
            v[2] = (heights[k - 1] - height) / step
        gained = np.dot(C, rotated(turn, push, second))

        K, _ = earth(M[:, 2].copy(), height, constants)
        rate = transport(K, v, M[:, 2], slaved)
        axis = M[:, 2] - 0.5 * step * np.dot(skew(rate), M[:, 2].copy())
        K, gravity = earth(axis, height + 0.5 * step * v[2], constants)
        rate, earth_rate = transport(K, v, axis, slaved), constants[6] * axis

        gained = gained - 0.5 * step * np.dot(skew(earth_rate + rate), gained)
        pushed += gained
        gained[2] -= gravity * step
        middle = v + 0.5 * (gained - step * np.dot(skew(2.0 * earth_rate + rate), v))
        if tied:
            middle[2] = v[2]
        rate = transport(K, middle, axis, slaved)
        change = gained - step * np.dot(skew(2.0 * earth_rate + rate), middle)
        if tied:
            change[2] = 0.0
        height = heights[k - 1] if heights.size > 0 else height + step * (v[2] + 0.5 * change[2])
        v = v + change
        M = np.dot(exponential(-step * rate), M)
        C = np.dot(exponential(-step * (earth_rate + rate)), np.dot(C, exponential(turn)))
    state[:4], state[4:7], state[7:16], state[16] = to_quaternion(C), v, M.copy().reshape(9), height
    if len(state) == 24 and n > 0:
        state[17:20], state[20:23], state[23] = before


def with_dots(nb):
    """The mechanisation in w with two samples a group and free height, compiled as usual: ``np.dot`` of matrices."""
    jit = nb.njit(error_model="numpy")

    @jit
    def cross(a, b):
        return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])

    @jit
    def skewed(v):
        return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])

    @jit
    def turned(v):
        angle2 = np.dot(v, v)
        if angle2 < 1e-8:
            first, second = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
        else:
            angle = np.sqrt(angle2)
            first, second = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
        K = skewed(v)
        return np.eye(3) + first * K + second * np.dot(K, K)

    @jit
    def curved(axis, height, constants):
        a, e2 = constants[0], constants[1]
        w2 = 1.0 - e2 * axis[2] ** 2
        normal = a / np.sqrt(w2)
        k1 = 1.0 / (normal + height)
        return k1, k1 * e2 * normal / w2 / (normal * (1.0 - e2) / w2 + height)

    @jit
    def over_earth(k1, k2, axis, v):
        along = k2 * (axis[0] * v[0] + axis[1] * v[1])
        return np.array([-k1 * v[1] - along * axis[1], k1 * v[0] + along * axis[0], 0.0])

    @jit
    def advance_two(C, v, M, height, turns, pushes, steps, constants):
        a, g_e, g_k, g_p, g_q = constants[0], constants[2], constants[3], constants[4], constants[5]
        for k in range(0, len(steps), 2):
            step = steps[k] + steps[k + 1]
            turn, push = turns[k] + turns[k + 1], pushes[k] + pushes[k + 1]
            c = step * step / (6.0 * steps[k] * steps[k + 1])
            turn += c * cross(turns[k], turns[k + 1])
            push += c * (cross(turns[k], pushes[k + 1]) + cross(pushes[k], turns[k + 1]))
            once = cross(turn, push)
            gained = np.dot(C, push + 0.5 * once + cross(turn, once) / 6.0)

            axis, middle = M[:, 2].copy(), height + 0.5 * step * v[2]
            k1, k2 = curved(axis, middle, constants)
            axis = axis - 0.5 * step * cross(over_earth(k1, k2, axis, v), axis)
            k1, k2 = curved(axis, middle, constants)
            rate, earth_rate = over_earth(k1, k2, axis, v), constants[6] * axis
            gained = gained - 0.5 * step * cross(earth_rate + rate, gained)
            sine2 = axis[2] ** 2
            surface = g_e * (1.0 + g_k * sine2) / np.sqrt(1.0 - constants[1] * sine2)
            far = middle / a
            gained[2] -= step * (surface * (1.0 - (g_p - g_q * sine2) * far + 3.0 * far**2) + constants[7])
            half = v + 0.5 * (gained - step * cross(2.0 * earth_rate + rate, v))
            rate = over_earth(k1, k2, axis, half)
            new = v + gained - step * cross(2.0 * earth_rate + rate, half)
            height += 0.5 * step * (v[2] + new[2])
            v = new
            M = M - np.dot(skewed(step * rate), M)
            K = skewed(step * (earth_rate + rate))
            lost = np.dot(K, C)
            C = np.dot(C - lost + 0.5 * np.dot(K, lost), turned(turn))
        return C, v, M, height

    return advance_two
