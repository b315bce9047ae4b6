"""What the static alignment sums up, its noise and its fit: each against a slow twin."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm
from scipy.sparse import csr_array
from scipy.stats import multivariate_normal
from swaying_case import DEGREE, HOUR, UG, Unit, phi_of, spoilt, waves

from sagnac.align.static import noise as noises
from sagnac.align.static.coarse import inertial
from sagnac.align.static.fit import Data, look, loose, rows, settled, stated, windows
from sagnac.align.static.model import collect, joined, to_enu_of_inertial, upward
from sagnac.align.static.noise import Noise
from sagnac.errors import DataError
from sagnac.frames import rotation_matrix, skew
from sagnac.navigate.stream import Piece

EPS, NAB = np.full(3, 0.01 * HOUR), np.full(3, 50 * UG)
NOISE = Noise(1e-3, 1e-4, 2e-3, 3e-4, 10 * UG, 0.002 * DEGREE / 60)


def swaying(seed=0, duration=60, frequency=50, **more):
    rng = np.random.default_rng(seed)
    unit = Unit(sway=waves(rng, 0.5, 2, 2e-3), heave=waves(rng, 0.5, 2, 2e-3), **more)
    return unit, unit.increments(duration, frequency)


# --------------------------------------------------------------------------------------------------------- the sums


def test_upward_is_integrated():
    """Against quadrature."""
    rate, middle = Unit().place.rate, 100.0

    def up(t):
        return rotation_matrix(rate * (t - middle))[:, 2]

    t = np.array([0.5, 77.0, 200.0])
    sums = upward(t, middle, rate)
    for i, stop in enumerate(t):
        assert np.allclose(sums[0][i], up(stop), atol=1e-15)
        for k in (0, 1):
            expected, _ = quad_vec(lambda u, s=stop, k=k: (s - u) ** k * up(u), 0, stop, epsrel=1e-13)
            assert np.allclose(sums[k + 1][i], expected, rtol=1e-12, atol=1e-10), k


def test_zero_test():
    """Ideal sensors of a unit that turns and sways without travelling: velocity and place stay with gravity's.

    At 100 Hz, sway up to 2 Hz with 2 mm and 2 mrad; what is left is the sculling of the integration, below 1e-8 g on the mean.
    """
    unit, piece = swaying(1, 120, 100)
    blocks = collect([piece])
    stop = float(blocks.end[-1])
    C_s_i = to_enu_of_inertial(0.0, stop / 2, unit.place.rate).T @ unit.C_b_n(0.0)
    C = to_enu_of_inertial(stop, stop / 2, unit.place.rate) @ C_s_i @ blocks.C_b_s[-1]
    assert np.abs(phi_of(C, unit.C_b_n(stop))).max() < 1e-8
    t = blocks.end
    C_i_n = rotation_matrix(-unit.place.rate * (t[:, None] - stop / 2))
    own = np.einsum("nji,nj->ni", C_i_n, unit.heave(t, 1))
    own -= rotation_matrix(unit.place.rate * -stop / 2) @ unit.heave(np.array(0.0), 1)
    left = blocks.speed @ C_s_i.T - unit.place.gravity * upward(t, stop / 2, unit.place.rate)[1] - own
    assert np.abs(left).max() < 1e-8 * 9.8 * stop


def test_pieces_may_be_cut_anywhere():
    _, piece = swaying()
    whole = collect([piece])
    cuts = [0, 1, 777, 778, 1999, piece.time.size]
    parts = []
    for a, b in pairwise(cuts):
        begin = piece.begin if a == 0 else piece.time[a - 1]
        parts.append(Piece(begin, *(getattr(piece, n)[a:b] for n in ("time", "steps", "turns", "pushes"))))
    other = collect(parts)
    for name in (
        "end",
        "length",
        "place",
        "gyro",
        "accel",
        "speed",
        "speed_gyro",
        "turned",
        "C_b_s",
        "rate",
        "body_force",
    ):
        first, second = getattr(whole, name), getattr(other, name)
        assert np.allclose(first, second, rtol=1e-9, atol=1e-12), name


def test_joined_blocks_have_the_same_means_and_ends():
    _, piece = swaying()
    blocks = collect([piece])
    fewer = joined(blocks, 40)
    assert fewer.end.size <= 40
    assert fewer.length.sum() == pytest.approx(blocks.length.sum())
    assert np.allclose(fewer.length @ fewer.place, blocks.length @ blocks.place, rtol=1e-12)
    assert np.array_equal(fewer.C_b_s[-1], blocks.C_b_s[-1])


def test_too_short_is_refused():
    with pytest.raises(DataError, match=r"5 s of samples are too few"):
        collect([Unit().increments(5, 50)])


@pytest.mark.parametrize("turn", [None, (20.0, 30.0, np.pi)])
def test_biases_act_as_the_sums_say(turn):
    """Derivatives of place, speed and attitude to the biases against the same samples with biases, at rest and turned round."""
    _, piece = swaying(turn=turn)
    clean = collect([piece])
    for k in range(3):
        for size, which in ((1e-7, "eps"), (1e-5, "nab")):
            bias = np.zeros(3)
            bias[k] = size
            rng = np.random.default_rng(0)
            sides = [
                collect([spoilt(piece, rng, s * bias * (which == "eps"), s * bias * (which == "nab"))]) for s in (1, -1)
            ]
            moved = {n: (getattr(sides[0], n) - getattr(sides[1], n)) / (2 * size) for n in ("place", "speed")}
            if which == "eps":
                # readings that are too large make the computed place too small: H is what is added
                assert np.allclose(-moved["place"], clean.gyro[..., k], rtol=2e-4, atol=1e-3 * np.abs(clean.gyro).max())
                assert np.allclose(
                    -moved["speed"], clean.speed_gyro[..., k], rtol=2e-4, atol=1e-3 * np.abs(clean.speed_gyro).max()
                )
                off = phi_of(sides[0].C_b_s[-1], sides[1].C_b_s[-1]) / (2 * size)
                assert np.allclose(-off, clean.turned[-1][:, k], rtol=1e-4, atol=1e-4 * clean.end[-1])
            else:
                assert np.allclose(
                    moved["place"], clean.accel[..., k], rtol=1e-6, atol=1e-6 * np.abs(clean.accel).max()
                )
                assert np.allclose(moved["speed"], clean.turned[..., k], rtol=1e-6, atol=1e-6 * clean.end[-1])


def test_rows_are_the_derivative_of_the_place():
    """Attitude by central differences; place, velocity and biases enter linearly."""
    unit, piece = swaying()
    data = Data.of(collect([piece]), unit.place)
    C = rotation_matrix([0.3, -0.1, 2.0])
    table = rows(data, C)
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-6
        up, down = (rows(data, rotation_matrix(s * step) @ C)[..., -1] for s in (1, -1))
        assert np.allclose((up - down) / 2e-6, table[..., k], rtol=1e-6, atol=1e-5 * np.abs(table[..., :3]).max())
    assert np.allclose(table[:, :, 3:6], -np.eye(3))
    assert np.allclose(table[:, :, 6:9], -data.middle[:, None, None] * np.eye(3))


def test_windows_hold_back_sway():
    """Of a cosine of 2 Hz less than the square of what the mean over the step lets through, plus the blocks' own raggedness."""
    _, piece = swaying(duration=120)
    blocks = collect([piece])
    W = windows(blocks)
    assert np.allclose(W.sum(axis=1), 1)
    step = blocks.end[-1] / 120
    seen = W @ (np.cos(2 * np.pi * 0.73 * blocks.middle) * np.sinc(0.73 * blocks.length))
    assert np.abs(seen).max() < np.sinc(0.73 * step) ** 2 + 0.01


# -------------------------------------------------------------------------------------------------------- the noise


def test_kernels_against_brute_sums():
    """Covariances of the block means of integrated white noise, from a fine grid."""
    length = np.tile([0.5, 1.0, 0.7, 0.2], 10)
    end = np.cumsum(length)
    middle = end - length / 2
    fine = 50
    h = 1.0 / fine
    t = np.arange(1, round(end[-1] * fine) + 1) * h
    white = np.eye(t.size) * h  # increments of a Wiener process
    walk = np.tril(np.ones((t.size, t.size))) - 0.5 * np.eye(t.size)  # at the middle of each step
    once = walk * h
    twice = once @ walk  # the first integral of the Wiener process
    mean = np.array([((t > e - n + 1e-9) & (t <= e + 1e-9)) / (n * fine) for e, n in zip(end, length, strict=True)])
    found = noises.kernels(middle, length, csr_array(np.eye(length.size)))
    for name, integral in (("walk", walk), ("accel", twice), ("gyro", once @ twice)):
        response = mean @ integral
        brute = response @ white @ response.T
        # the middle stands for the mean in smooth kernels: off by the square of the block over that of the time
        assert np.allclose(getattr(found, name), brute, rtol=0.01, atol=0.002 * brute.max()), name
    assert np.allclose(np.diag(found.sway) * length, (np.diag(found.sway) * length)[0])


def test_end_against_kernels():
    """The displacement at the very end is an integral of the speed there: differentiate the kernels numerically."""
    stop, h = 50.0, 1e-3
    t = np.array([10.0, 30.0, 45.0])
    one = csr_array(np.eye(5))
    grid = np.array([*t, stop - h, stop + h])
    k = noises.kernels(grid, np.full(5, 1e-9), one)
    end = noises.at_the_end(t, stop, csr_array(np.eye(3)))
    assert np.allclose(end.speed, (k.gyro[:3, 4] - k.gyro[:3, 3]) / (2 * h), rtol=1e-5)
    assert np.allclose(end.drift, (k.accel[:3, 4] - k.accel[:3, 3]) / (2 * h), rtol=1e-5)
    h = 0.5  # the tilt is the second derivative
    grid = np.array([*t, stop - h, stop, stop + h])
    k = noises.kernels(grid, np.full(6, 1e-9), csr_array(np.eye(6))).gyro
    assert np.allclose(end.tilt, (k[:3, 5] - 2 * k[:3, 4] + k[:3, 3]) / h**2, rtol=1e-6)


def small_problem(seed=3):
    rng = np.random.default_rng(seed)
    m, k = 12, 4
    middle = np.arange(1.0, m + 1)
    kernel = noises.kernels(middle, np.ones(m), csr_array(np.eye(m)))
    noise = Noise(0.5, 0.1, 0.7, 0.2, 0.05, 0.001)
    prior = np.diag([0.0, 0.0, 2.0, 0.5])
    return noise, kernel, rng.normal(size=(m, 3, k + 1)), prior


def test_likelihood_against_the_density():
    """The density of the places with the unknowns integrated out: those without prior as one of great width."""
    noise, kernel, table, prior = small_problem()
    wide = 300.0

    def minus_log(noise):
        level, up = noises.covariances(noise, kernel, 9.8)
        cov = np.zeros((36, 36))
        for i, part in enumerate((level, level, up)):
            cov[i::3, i::3] = part
        J, z = table[..., :-1].reshape(36, -1), table[..., -1].ravel()
        sigma2 = np.array([wide**2, wide**2, 0.25, 4.0])
        return -multivariate_normal(np.zeros(36), cov + (J * sigma2) @ J.T).logpdf(z)

    other = replace(noise, walk=0.3, accel=0.01, gyro=0.004, sway_up=0.4)
    differences = [
        f(other) - f(noise) for f in (minus_log, lambda n: noises.minus_log_likelihood(n, kernel, 9.8, table, prior))
    ]
    assert differences[0] == pytest.approx(differences[1], abs=1e-3)


def test_noise_that_is_no_covariance_is_infinitely_unlikely():
    noise, kernel, table, prior = small_problem()
    assert (
        noises.minus_log_likelihood(replace(noise, sway=0.0, walk=0.0, accel=0.0, gyro=0.0), kernel, 9.8, table, prior)
        == np.inf
    )


# ----------------------------------------------------------------------------------------------------------- the fit


def filter_twin(unit, blocks, noise, window_sway):
    """A Kalman filter over all blocks with tilt, velocity, place and biases: covariance at the end, as Solution has it."""
    g, w = unit.place.gravity, unit.place.rate
    stop, middle = blocks.end[-1], blocks.end[-1] / 2
    P = np.diag([1.0] * 3 + [1e2] * 3 + [1e2] * 3 + [*EPS**2] + [*NAB**2])
    H = np.zeros((3, 15))
    H[:, 6:9] = np.eye(3)
    R = np.diag([noise.sway**2] * 2 + [noise.sway_up**2]) * window_sway
    Q = np.zeros((15, 15))
    Q[:3, :3] = noise.gyro**2 * np.eye(3)
    Q[3:6, 3:6] = noise.accel**2 * np.eye(3)
    Q[6:9, 6:9] = np.diag([noise.walk**2] * 2 + [noise.walk_up**2])
    C_b_n = unit.C_b_n(0.0)
    t = 0.0
    for k in range(blocks.end.size + 1):
        to = blocks.middle[k] if k < blocks.end.size else stop
        h = to - t
        C_n_i = rotation_matrix(w * (0.5 * (t + to) - middle))
        up, C = C_n_i[:, 2], C_n_i @ C_b_n
        F = np.zeros((15, 15))
        F[:3, 9:12] = -C  # phi' = -C eps, dv' = f x phi + C nab
        F[3:6, :3] = g * skew(up)
        F[3:6, 12:] = C
        F[6:9, 3:6] = np.eye(3)
        M = expm(np.block([[-F, Q], [np.zeros((15, 15)), F.T]]) * h)
        A = M[15:, 15:].T
        P = A @ P @ A.T + A @ M[:15, 15:]
        t = to
        if k < blocks.end.size:
            K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            P = (np.eye(15) - K @ H) @ P @ (np.eye(15) - K @ H).T + K @ R @ K.T
    turn = np.eye(15)
    turn[:3, :3] = turn[3:6, 3:6] = to_enu_of_inertial(stop, middle, w)
    P = turn @ P @ turn.T
    keep = [*range(6), *range(9, 15)]
    return P[np.ix_(keep, keep)]


@pytest.mark.parametrize("duration", [40, 100])
def test_batch_is_as_good_as_a_filter_over_all_samples(duration):
    """Against the optimal filter over every block: 1 % is lost in attitude and biases, 5 % in the velocity at the end."""
    unit = Unit(angles=(0.8, 0.01, 0.02))
    blocks = collect([unit.increments(duration, 25)])
    data = Data.of(blocks, unit.place)
    C = inertial(blocks, unit.place.latitude)
    found = settled(data, C, NOISE, stated(EPS, NAB)).covariance
    W = windows(blocks)
    twin = filter_twin(unit, blocks, NOISE, 1 / (W.multiply(W)).sum(axis=1).mean())
    ratio = np.sqrt(np.diag(found) / np.diag(twin))
    velocity = slice(3, 6)
    assert ratio[velocity] == pytest.approx(np.ones(3), abs=0.05)
    assert np.delete(ratio, velocity) == pytest.approx(np.ones(9), abs=0.01)
    scale = np.sqrt(np.outer(np.diag(twin), np.diag(twin)))
    assert (np.abs(found - twin) / scale).max() < 0.08  # and all correlations, with their signs


def test_ideal_samples_give_the_attitude():
    """Swaying without displacement, perfect sensors, whatever the noise that is assumed."""
    rng = np.random.default_rng(5)
    unit = Unit(angles=(3.0, 0.2, -0.1), sway=waves(rng, 0.2, 2, 2e-3))
    blocks = collect([unit.increments(90, 100)])
    data, C = Data.of(blocks, unit.place), inertial(blocks, unit.place.latitude)
    found = settled(data, C, NOISE, stated(EPS, NAB))
    assert np.abs(phi_of(found.C_b_n, unit.C_b_n(float(blocks.end[-1])))).max() < 1e-6
    assert np.abs(found.velocity).max() < 1e-6
    assert np.abs(found.place).max() < 1e-5  # what sculling leaves, integrated twice


def test_a_turned_unit_needs_no_formula_of_its_own():
    """Half round in the middle: biases far off are found, heading beats its floor at rest."""
    unit = Unit(turn=(85.0, 95.0, np.pi))
    eps, nab = np.array([0.02, -0.03, 0.01]) * HOUR, np.array([60, -80, 40]) * UG
    piece = spoilt(unit.increments(180, 100), np.random.default_rng(0), eps, nab)
    blocks = collect([piece])
    data, C = Data.of(blocks, unit.place), inertial(blocks, unit.place.latitude)
    quiet = Noise(1e-4, 1e-6, 1e-4, 1e-6, 0.1 * UG, 1e-5 * DEGREE / 60)
    found = settled(data, C, quiet, stated(EPS, NAB))
    assert np.abs(found.eps - eps)[:2].max() < 0.001 * HOUR
    assert np.abs(found.nab - nab).max() < 1 * UG
    off = phi_of(found.C_b_n, unit.C_b_n(180.0))
    assert np.abs(off).max() < 0.1 / 60 * DEGREE
    floor = 0.01 * HOUR / unit.place.rate[1]
    assert np.sqrt(found.covariance[2, 2]) < 0.2 * floor


def test_loose_fit_sees_biases_that_were_not_expected():
    unit = Unit()
    eps = unit.C_b_n(0.0).T @ np.array([0.0, 1.0, 0.0]) * HOUR  # 1 deg/h along north, a hundred times too much
    blocks = collect([spoilt(unit.increments(120, 50), np.random.default_rng(0), eps, np.zeros(3))])
    data, C = Data.of(blocks, unit.place), inertial(blocks, unit.place.latitude)
    seen = look(data, C, loose(unit.place, C, EPS, NAB))
    assert np.allclose(seen.C @ seen.eps, [0, HOUR, 0], atol=0.02 * HOUR)
    assert np.abs(seen.place).max() < 0.01
