"""The hand-turned gyro and norm work in plain NumPy, as one would write it first: the twin of the kernels and the baseline.

Nothing here is imported by the package. Tests compare the kernels with it; ``make bench`` times both in the same run.
"""

from __future__ import annotations

import numpy as np


def exponential(v):
    """Rotation matrices and left Jacobians of rotation vectors (n, 3)."""
    t2 = np.sum(v * v, axis=1)
    t = np.sqrt(t2)
    small = t2 < 1e-8
    safe = np.where(small, 1.0, t)
    c1 = np.where(small, 1 - t2 / 6, np.sin(safe) / safe)
    c2 = np.where(small, 0.5 - t2 / 24, (1 - np.cos(safe)) / safe**2)
    c3 = np.where(small, 1 / 6 - t2 / 120, (1 - c1) / safe**2)
    k = np.zeros((len(v), 3, 3))
    k[:, 0, 1], k[:, 0, 2], k[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    k -= np.swapaxes(k, 1, 2)
    k2 = k @ k
    eye = np.eye(3)
    return (
        eye + c1[:, None, None] * k + c2[:, None, None] * k2,
        eye + c2[:, None, None] * k + c3[:, None, None] * k2,
    )


def integrate(time, gyro, force, inverse, bias, g_matrix, first, last):
    """Same arguments and results as :func:`sagnac.kernels.rotation.integrate`."""
    rotation, sum_1, sum_w, sum_f = [], [], [], []
    for a, b in zip(first, last, strict=True):
        dt = np.diff(time[a : b + 1])
        f = 0.5 * (force[a:b] + force[a + 1 : b + 1])
        w = (0.5 * (gyro[a:b] + gyro[a + 1 : b + 1]) - bias - f @ g_matrix.T) @ inverse.T
        turns, left = exponential(w * dt[:, None])
        before = np.empty_like(turns)
        r = np.eye(3)
        for k, turn in enumerate(turns):
            before[k] = r
            r = r @ turn
        moved = before @ left * dt[:, None, None]
        rotation.append(r)
        sum_1.append(moved.sum(axis=0))
        sum_w.append(np.einsum("nij,nl->ijl", moved, w))
        sum_f.append(np.einsum("nij,nl->ijl", moved, f))
    return np.array(rotation), np.array(sum_1), np.array(sum_w), np.array(sum_f)


def moving_variance(values, width):
    """Variance of every window, by strided views: the direct form of :func:`sagnac.observe.static.moving_variance`."""
    return np.lib.stride_tricks.sliding_window_view(values, width, axis=0).var(axis=-1)


def norm_by_scipy(readings, gravity, sigma, least_squares):
    """Norm calibration with the direction of every position as two unknowns of its own, solved by a general solver."""
    n = len(readings)
    first = readings / np.linalg.norm(readings, axis=1)[:, None]
    lon, lat = np.arctan2(first[:, 1], first[:, 0]), np.arcsin(first[:, 2])

    def residual(x):
        matrix = np.array([[1 + x[0], 0, 0], [x[3], 1 + x[1], 0], [x[4], x[5], 1 + x[2]]])
        o, a = x[9 : 9 + n], x[9 + n :]
        u = np.stack([np.cos(a) * np.cos(o), np.cos(a) * np.sin(o), np.sin(a)], axis=1)
        return ((readings - gravity * u @ matrix.T - x[6:9]) / sigma).ravel()

    start = np.concatenate([np.zeros(9), lon, lat])
    return least_squares(residual, start, x_scale="jac", xtol=1e-12, ftol=1e-12).x[:9]


def segment_means(time, samples, plan):
    """Mean and variance of each segment, nothing else."""
    out = {}
    for sensor, values in samples.items():
        means = []
        for s in plan.segment:
            i, j = np.searchsorted(time, [s.start, s.stop])
            values[i:j].var(axis=0)
            means.append(values[i:j].mean(axis=0))
        out[sensor] = np.array(means)
    return out


def table_by_scipy(readings, sigma, plan, angles, left, least_squares):
    """Joint calibration on a table with every setting's error among the unknowns: SciPy, derivatives by differences.

    The unknowns are S_a, b_a (9), S_g, b_g (12), mounting (3), lever arm (3), seven errors of the table, and three settings a
    segment. Returns the first 21.
    """
    from scipy.spatial.transform import Rotation

    from sagnac.rigs.turntable import Site, TableErrors, mean_inputs

    rates = np.array([s.rates for s in plan.segment])
    site = Site(plan.latitude, plan.site_gravity, plan.earth_rate)
    rig, n, low = plan.rig, len(angles), np.tril_indices(3)

    def residual(x):
        q, settings = x[27:34] * rig.axis_uncertainty, x[34:].reshape(n, 3) * rig.angle_uncertainty
        errors = TableErrors((q[0], q[1]), (q[2], q[3]), (q[4], q[5], q[6]))
        felt = mean_inputs(angles + settings, rates, left, site, errors, derivatives=False)
        to_b = Rotation.from_euler("XYZ", x[21:24]).as_matrix().T
        s_a = np.eye(3)
        s_a[low] += x[:6]
        axis = felt.axis @ to_b.T
        force = felt.force @ to_b.T + rates.sum(axis=1)[:, None] ** 2 * (axis * (axis @ x[24:27])[:, None] - x[24:27])
        accel = force @ s_a.T + x[6:9]
        gyro = felt.rate @ to_b.T @ (np.eye(3) + x[9:18].reshape(3, 3)).T + x[18:21]
        parts = [(readings["accel"] - accel) / sigma["accel"], (readings["gyro"] - gyro) / sigma["gyro"]]
        return np.concatenate([*(p.ravel() for p in parts), x[24:27] / 0.5, x[27:]])

    return least_squares(residual, np.zeros(34 + 3 * n), x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12).x[:21]


def harmonic_terms(angle, order, tau=None):
    """Columns 1, cos th, sin th, cos 2 th, ...; with tau also tau cos th, tau sin th, ..."""
    waves = [f(h * angle) for h in range(1, order + 1) for f in (np.cos, np.sin)]
    return np.stack([np.ones_like(angle), *waves, *([] if tau is None else [tau * w for w in waves])], axis=1)


def harmonics(values, angle, order, tau=None):
    """Least-squares coefficients (axes, k), inverse Gram matrix and residual sums of squares, from the whole design matrix."""
    terms = harmonic_terms(angle, order, tau)
    found = np.linalg.lstsq(terms, values, rcond=None)[0]
    return found.T, np.linalg.inv(terms.T @ terms), ((values - terms @ found) ** 2).sum(axis=0)


def block_harmonics(values, interval, rate, order, block=512):
    """Coefficients of evenly spaced samples (n,) by one matrix product over reshaped blocks and a phase for each."""
    table = np.exp(-1j * rate * interval * np.outer(np.arange(block), np.arange(order + 1)))
    whole = len(values) // block * block
    local = values[:whole].reshape(-1, block) @ np.concatenate([table.real, table.imag[:, 1:]], axis=1)
    starts = np.exp(-1j * rate * interval * block * np.outer(np.arange(len(local)), np.arange(order + 1)))
    waves = local[:, : order + 1].astype(complex)
    waves[:, 1:] += 1j * local[:, order + 1 :]
    sums = (waves * starts).sum(axis=0)
    at = np.arange(whole, len(values))
    sums += values[whole:] @ np.exp(-1j * rate * interval * np.outer(at, np.arange(order + 1)))
    moment = np.array([_dirichlet(m * rate * interval, len(values)) for m in range(2 * order + 1)])
    h = np.arange(-order, order + 1)
    apart = h[None, :] - h[:, None]
    matrix = np.where(apart >= 0, moment[abs(apart)], moment[abs(apart)].conj())
    spectrum = np.linalg.solve(matrix, np.concatenate([sums[:0:-1].conj(), sums]))[order:]
    pairs = np.stack([2 * spectrum[1:].real, -2 * spectrum[1:].imag], axis=1)
    return np.concatenate([spectrum[:1].real, pairs.ravel()])


def _dirichlet(step, count):
    """Sum of exp(i step k), k = 0 ... count - 1."""
    half = np.sin(0.5 * step)
    ratio = count if half == 0 else np.sin(0.5 * step * count) / half
    return ratio * np.exp(0.5j * step * (count - 1))


def extremes(column):
    """What :func:`sagnac.kernels.harmonics.look` finds in one axis, by name of its column."""

    def longest(flags):
        best = now = 0
        for flag in flags:
            now = now + 1 if flag else 0
            best = max(best, now)
        return best

    steps = np.abs(np.diff(column))
    low, high = column.min(), column.max()
    return {
        "LOW": low,
        "HIGH": high,
        "AT_LOW": np.sum(column == low),
        "AT_HIGH": np.sum(column == high),
        "LONGEST_LOW": longest(column == low),
        "LONGEST_HIGH": longest(column == high),
        "SQUARED_STEPS": np.sum(steps**2),
        "FINEST": np.min(steps[steps > 0], initial=np.inf),
    }
