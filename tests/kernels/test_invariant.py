"""The batch and the filter in inertial axes against plain twins: exponentials of matrices, dense covariances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from sagnac.frames import rotation_matrix, rotation_vector, skew
from sagnac.kernels.invariant import carry, intervals, normal_equations
from sagnac.kernels.left_invariant import left_invariant

LAST = np.array([5, 10, 17, 20, 30, 41])
STEPS = np.full(41, 0.01)


def samples(seed=0, rate=1.0):
    rng = np.random.default_rng(seed)
    turns = (np.array([0.3, -0.2, rate]) + 0.3 * rng.standard_normal((41, 3))) * STEPS[:, None]
    pushes = (np.array([0.5, 1.0, 9.8]) + rng.standard_normal((41, 3))) * STEPS[:, None]
    return turns, pushes


def group(attitude, velocity):
    """Attitude and velocity as one matrix of SE(3)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = attitude, velocity
    return out


def group_exp(error):
    """Exponential of (xi, zeta)."""
    twist = np.zeros((4, 4))
    twist[:3, :3], twist[:3, 3] = skew(error[:3]), error[3:]
    return expm(twist)


def plain_run(turn, push, attitude, velocity):
    """Attitude and velocity in inertial axes at the start and at the end of each interval."""
    R, y = [attitude], [velocity]
    for q, d in zip(turn, push, strict=True):
        y.append(y[-1] + R[-1] @ d)
        R.append(R[-1] @ q)
    return np.array(R), np.array(y)


def test_intervals_are_the_steady_motion_of_each_sample():
    turns, pushes = samples()
    bias = np.array([0.02, -0.01, 0.03]), np.array([0.2, 0.1, -0.3])
    turn, push, _ = intervals(turns, pushes, STEPS, LAST, *bias)
    X, first = np.eye(4), 0
    for k, end in enumerate(LAST):
        X = np.eye(4)
        for s in range(first, end):
            # R' = R [w x], y' = R f with both steady: one exponential
            X = X @ group_exp(np.concatenate([turns[s] - bias[0] * STEPS[s], pushes[s] - bias[1] * STEPS[s]]))
        np.testing.assert_allclose(turn[k], X[:3, :3], atol=1e-14)
        np.testing.assert_allclose(push[k], X[:3, 3], atol=1e-14)
        first = end


def test_slopes_of_the_biases():
    turns, pushes = samples()
    zero, h = np.zeros(3), 1e-5
    turn, _, slopes = intervals(turns, pushes, STEPS, LAST, zero, zero)
    for c in range(6):
        step = h * np.eye(6)[c]
        (plus, gained, _), (minus, lost, _) = (
            intervals(turns, pushes, STEPS, LAST, s * step[:3], s * step[3:]) for s in (1.0, -1.0)
        )
        for k in range(LAST.size):
            xi = rotation_vector(minus[k].T @ plus[k]) / (2.0 * h)
            zeta = turn[k].T @ (gained[k] - lost[k]) / (2.0 * h)
            if c < 3:
                np.testing.assert_allclose(slopes[k, 0, :, c], xi, atol=1e-9)
            np.testing.assert_allclose(slopes[k, 1 + c // 3, :, c % 3], zeta, atol=2e-5 * np.abs(zeta).max() + 1e-9)


@pytest.mark.parametrize("size", [0.01, 1.0, 2.5])
def test_the_error_propagates_linearly_whatever_its_size(size):
    # log-linear property, Barrau & Bonnabel 2017, theorem 2: exact for errors of any size, and whatever the estimate is
    rng = np.random.default_rng(1)
    turn, push, _ = intervals(*samples(), STEPS, LAST, np.zeros(3), np.zeros(3))
    error = rng.standard_normal(6)
    error *= size / np.linalg.norm(error[:3])
    linear = error[:, None].copy()
    for q, d in zip(turn, push, strict=True):
        carry(q, d, linear)
    for seed in range(3):
        start = group(rotation_matrix(np.random.default_rng(seed).standard_normal(3)), np.array([10.0, -3.0, seed]))
        ends = []
        for X in (start, start @ group_exp(error)):
            R, y = plain_run(turn, push, X[:3, :3], X[:3, 3])
            ends.append(group(R[-1], y[-1]))
        np.testing.assert_allclose(np.linalg.inv(ends[0]) @ ends[1], group_exp(linear[:, 0]), atol=1e-12)


class Case:
    """Six readings of a slave with a lever arm, in general position."""

    def __init__(self, matched, noise=(1e-4, 3e-3)):
        rng = np.random.default_rng(7)
        self.matched = matched
        self.turns, self.pushes = samples(3)
        self.gathered = np.array(noise) ** 2 * np.diff(LAST, prepend=0)[:, None] * 0.01
        self.axes = rotation_matrix(0.1 * rng.standard_normal((6, 3)))
        self.rates, self.gains = rng.standard_normal((7, 3)), rng.standard_normal((6, 3))
        self.delay = 0.0004
        self.earth, self.arm = np.array([0.0, 4e-5, 6e-5]), np.array([2.0, -3.0, 1.0])
        self.variances = np.array([0.01, 0.01, 0.3, 1e-3]) ** 2
        self.attitude, self.velocity = rotation_matrix([0.3, -0.5, 1.0]), np.array([10.0, 2.0, -1.0])
        self.mounting = rotation_matrix([0.4, 0.2, -0.7])
        self.attitudes, self.series = np.empty((0, 3, 3)), np.zeros((6, 3))
        R, y, arm = self.ideal(np.zeros(19))
        self.series = y + arm + 0.01 * rng.standard_normal((6, 3))
        if matched:
            small = rotation_matrix(1e-3 * rng.standard_normal((7, 3)))
            late = rotation_matrix(-self.delay * np.einsum("kij,kj->ki", R, self.rates))
            self.attitudes = late @ R @ self.mounting.T @ small

    def moved(self, x):
        attitude = self.attitude @ rotation_matrix(x[:3])
        turn = x[16:] if self.matched else x[:3]
        mounting = self.mounting @ rotation_matrix(turn)
        return attitude, self.velocity + x[3:6], x[6:9], x[9:12], self.arm + x[12:15], self.delay + x[15], mounting

    def ideal(self, x):
        """Attitudes, velocities and what is to be taken off the latter for the arm."""
        attitude, velocity, gyro, accel, lever, _, mounting = self.moved(x)
        turn, push, _ = intervals(self.turns, self.pushes, STEPS, LAST, gyro, accel)
        R, y = plain_run(turn, push, attitude, velocity)
        rates = self.rates[1:] - np.einsum("kji,j->ki", R[1:], self.earth)
        arm = np.einsum("kij,kj->ki", R[1:], np.cross(rates, mounting.T @ lever))
        return R, y[1:], -arm

    def residual(self, x):
        """In the order of the readings: attitudes (turned into i), then velocities east, north, up, of each time."""
        R, y, arm = self.ideal(x)
        *_, delay, mounting = self.moved(x)
        left = np.einsum("kji,kj->ki", self.axes, self.series - y - arm) + delay * self.gains
        if not self.matched:
            return left.ravel()
        turned = rotation_vector(self.attitudes @ mounting @ np.swapaxes(R, -1, -2))
        turned += delay * np.einsum("kij,kj->ki", R, self.rates)
        return np.concatenate([turned[0], np.hstack([turned[1:], left]).ravel()])

    def covariance(self):
        """Of all readings: white noise of the sensors integrated in many small steps, and the readings' own."""
        _, push, _ = intervals(self.turns, self.pushes, STEPS, LAST, np.zeros(3), np.zeros(3))
        R, _, arm = self.ideal(np.zeros(19))
        count = 6
        joint = np.zeros((6 * (count + 1), 6 * (count + 1)))  # of (phi, e) at all times, in inertial axes
        for k in range(count):
            force = R[k] @ push[k]
            rest = np.eye(6)
            rest[3:, :3] = -skew(force)
            now, then = slice(6 * k, 6 * k + 6), slice(6 * k + 6, 6 * k + 12)
            joint[then, : then.start] = rest @ joint[now, : then.start]
            joint[: then.start, then] = joint[then, : then.start].T
            joint[then, then] = rest @ joint[now, now] @ rest.T
            for left in (np.arange(400) + 0.5) / 400.0:
                gain = np.eye(6)
                gain[3:, :3] = -skew(force) * left
                joint[then, then] += gain @ np.diag(np.repeat(self.gathered[k], 3) / 400.0) @ gain.T
        rows, own = [], []
        for k in range(count + 1):
            if self.matched:
                rows.append(np.hstack([np.zeros((3, 6 * k)), np.eye(3), np.zeros((3, 6 * (count - k) + 3))]))
                own += [self.variances[3]] * 3
            if k:
                see = np.hstack([self.axes[k - 1].T @ skew(-arm[k - 1]), self.axes[k - 1].T])
                rows.append(np.hstack([np.zeros((3, 6 * k)), see, np.zeros((3, 6 * (count - k)))]))
                own += [*self.variances[:3]]
        H = np.vstack(rows)
        return H @ joint @ H.T + np.diag(own)

    def readings(self):
        """Of the filter, which knows no delay."""
        return self.gathered, self.series, self.axes, self.rates, self.attitudes, self.earth, self.arm, self.variances

    def kernel(self):
        pieces = intervals(self.turns, self.pushes, STEPS, LAST, np.zeros(3), np.zeros(3))
        readings = self.gathered, self.series, self.axes, self.rates, self.gains, self.attitudes, self.earth
        where = self.attitude, self.velocity, self.arm, self.delay, self.mounting
        return normal_equations(*pieces, *readings, self.variances, *where)


@pytest.mark.parametrize("matched", [False, True])
def test_normal_equations_against_a_dense_covariance(matched):
    case = Case(matched)
    p, h = (19 if matched else 16), 1e-5
    J = np.stack(
        [(case.residual(-h * e) - case.residual(h * e)) / (2.0 * h) for e in np.eye(19)[:p]], axis=1
    )  # residual = r - J parameters
    both = np.column_stack([J, case.residual(np.zeros(19))])
    expected = both.T @ np.linalg.solve(case.covariance(), both)
    found, level = case.kernel()
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / scale / scale[:, None], expected / scale / scale[:, None], atol=5e-4)
    np.testing.assert_allclose(found[-1, -1], expected[-1, -1], rtol=1e-5)
    assert 0.0 < level < 12 + 14 * matched


def test_without_noise_of_the_sensors_nothing_gathers_and_the_slope_is_exact():
    case = Case(False, noise=(0.0, 0.0))
    case.earth[:] = 0.0  # its small part in the arm's velocity is not differentiated
    found, level = case.kernel()
    assert level == 0.0
    h = 1e-6

    def cost(x):
        r = case.residual(x)
        return r @ (r / np.tile(case.variances[:3], 6))

    slope = [(cost(-h * e) - cost(h * e)) / (4.0 * h) for e in np.eye(19)[:16]]
    size = np.sqrt(np.diag(found)[:-1] * found[-1, -1])
    np.testing.assert_allclose(found[:-1, -1] / size, slope / size, atol=3e-6)


@pytest.mark.parametrize("matched", [False, True])
def test_the_filter_is_the_batch_where_errors_are_small(matched):
    case = Case(matched)
    case.delay = 0.0
    p = 15 if matched else 12
    kept = [*range(12), *range(16, 19)][:p]  # the filter knows arm and delay
    sigma = np.concatenate([np.full(3, 3e-3), np.full(3, 0.01), np.full(3, 1e-4), np.full(3, 1e-3), np.full(3, 3e-3)])[
        :p
    ]
    normal = case.kernel()[0][np.ix_([*kept, -1], [*kept, -1])]
    x = np.linalg.solve(normal[:-1, :-1] + np.diag(sigma**-2.0), normal[:-1, -1])
    prior = np.diag(sigma**2)
    pieces = intervals(case.turns, case.pushes, STEPS, LAST, np.zeros(3), np.zeros(3))
    R, bias, mounting = left_invariant(*pieces, *case.readings(), case.attitude, case.velocity, case.mounting, prior)
    posterior = np.sqrt(np.diag(np.linalg.inv(normal[:-1, :-1] + np.diag(sigma**-2.0))))
    # the filter does not smooth: what the gyros' noise turned since the start stays in the attitude carried back
    drift = np.sqrt(case.gathered[:, 0].sum())
    np.testing.assert_allclose(
        rotation_vector(case.attitude.T @ R), x[:3], atol=3.0 * drift + 0.05 * posterior[:3].max()
    )
    np.testing.assert_allclose(bias / posterior[6:12], x[6:12] / posterior[6:12], atol=0.05)
    if matched:
        np.testing.assert_allclose(
            rotation_vector(case.mounting.T @ mounting), x[12:], atol=0.05 * posterior[12:].max()
        )
    else:
        # the mounting is the attitude against what the master said at the start
        np.testing.assert_allclose(mounting, case.mounting @ case.attitude.T @ R, atol=1e-12)
