"""Filter lanes against a plain NumPy filter, the system matrix of the readable kernel, and the published covariance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import plain_lanes as plain
from sagnac.earth import EARTH_RATE, ELLIPSOID, normal_gravity, radii
from sagnac.frames import attitude_matrix
from sagnac.kernels import lanes_filter as kernel
from sagnac.kernels.error_model import system
from sagnac.kernels.lanes import LANES

DEG, ARCMIN = math.pi / 180.0, math.pi / 10800.0
ORDER = [0, 1, 2, 3, 4, 10, 5, 6, 7, 8, 9]
"""States of the paper in the order of the kernel: the wander angle comes before the biases."""


def motions(rng, slaved, height=1e4):
    """Rows of motion of all lanes: any attitude, any place between 80 deg south and north."""
    latitude, wander = rng.uniform(-1.4, 1.4, LANES), rng.uniform(-3, 3, LANES) * (not slaved)
    return np.concatenate(
        [
            Rotation.random(LANES, random_state=np.random.RandomState(1)).as_matrix().reshape(LANES, 9).T,
            rng.normal(0, 50, (3, LANES)),
            rng.normal(0, 10, (3, LANES)),
            [np.cos(latitude) * np.sin(wander), np.cos(latitude) * np.cos(wander), np.sin(latitude)],
            rng.uniform(0, height, (1, LANES)),
        ]
    )


def parts(motion):
    """C, v, f, u and height of one lane."""
    return motion[:9].reshape(3, 3).copy(), *(motion[i : i + 3].copy() for i in (9, 12, 15)), motion[18]


def readable_system(motion, slaved):
    """System matrix of the kernel for one filter, in the order of the lanes."""
    at = np.array([0, 2, 2, 10, 0 if slaved else 1, -1, 5, 8, 2, int(slaved)])
    F, (C, v, f, u, h) = np.zeros((11, 11)), parts(motion)
    system(C, v, u, h, f, EARTH_RATE, ELLIPSOID, at, F)
    return F[np.ix_(ORDER, ORDER)]


@pytest.mark.parametrize("slaved", [False, True])
def test_transitions_are_those_of_the_readable_model(slaved):
    motion, dt = motions(np.random.default_rng(1), slaved), 0.7
    phi, room = np.empty(kernel.MOVING * kernel.STATES * LANES), np.empty(kernel.ROOM * LANES)
    kernel.transition(motion.ravel(), dt, EARTH_RATE, ELLIPSOID, slaved, phi, room)
    rows = phi.reshape(kernel.MOVING, kernel.STATES, LANES)
    for i in range(LANES):
        F = readable_system(motion[:, i], slaved)
        np.testing.assert_allclose(plain.system(*parts(motion[:, i]), EARTH_RATE, slaved), F, rtol=1e-12, atol=1e-20)
        expected = np.eye(11) + F * dt + 0.5 * (F * dt) @ (F * dt)
        np.testing.assert_allclose(rows[:, :, i], expected[: kernel.MOVING], rtol=1e-13, atol=1e-15)
        np.testing.assert_array_equal(expected[kernel.MOVING :], np.eye(11)[kernel.MOVING :])


def first_covariance(C=None):
    """P0 of the published case, in the kernel's order."""
    sigma = np.array([0.2, 0.2, *[0.2 * DEG] * 2, 0.5 * DEG, 1e-9, *[0.01 * DEG / 3600] * 3, *[5e-5 * 9.80665] * 2])
    P = np.diag(sigma**2)
    if C is not None:
        P[2:5, 2:5] = C @ P[2:5, 2:5] @ C.T
    return P


class Filters:
    """Lanes of filters that start alike."""

    def __init__(self, P, slaved=False):
        self.P, self.x, self.nis = np.repeat(P.ravel(), LANES), np.zeros(11 * LANES), np.zeros(LANES)
        self.room, self.slaved = np.empty(2 * kernel.ROOM * LANES), slaved

    def step(self, motion, seen, dt, noise, variance):
        given = dt, EARTH_RATE, ELLIPSOID, self.slaved, noise, variance, self.nis, self.room
        kernel.step(self.P, self.x, motion.ravel(), seen.ravel(), *given)

    @property
    def matrices(self):
        return np.moveaxis(self.P.reshape(11, 11, LANES), -1, 0)


@pytest.mark.parametrize("slaved", [False, True])
def test_9000_updates_are_those_of_a_plain_filter(slaved):
    """In each lane another attitude, place and force that turns; 1e-10 of each standard deviation, squared for P."""
    rng, variance, dt = np.random.default_rng(2), 1e-4, 0.1
    noise = dt * np.array([6.7e-11, 6.7e-11, *[8.5e-14] * 3, 0.0, *[1e-20] * 3, 1e-14, 1e-14])
    motion = motions(rng, slaved, 100.0)
    motion[9:12] *= 0.2
    P0 = first_covariance()
    if slaved:
        P0[5, 5] = 0.0
    filters = Filters(P0, slaved)
    i, P, x, nis = 7, P0.copy(), np.zeros(11), 0.0
    for k in range(9000):
        angle = 0.005 * k
        motion[12:15] = [[3.0 * math.sin(angle)], [3.0 * math.cos(2.1 * angle)], [9.8]]
        seen = np.concatenate([0.05 * rng.standard_normal((2, LANES)), [-motion[10], motion[9]] * np.array(not slaved)])
        filters.step(motion, seen, dt, noise, variance)
        F = plain.system(*parts(motion[:, i]), EARTH_RATE, slaved)
        P, x, more = plain.step(P, x, F, dt, noise, seen[:, i], variance)
        nis += more
    sigma = np.sqrt(np.diag(P))
    sigma[sigma == 0.0] = 1.0
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(filters.matrices[i] / scale, P / scale, rtol=0, atol=1e-10)
    np.testing.assert_allclose(filters.x.reshape(11, LANES)[:, i] / sigma, x / sigma, rtol=0, atol=1e-10)
    assert filters.nis[i] == pytest.approx(nis, rel=1e-10)


def test_covariances_stay_symmetric_to_the_last_bit_and_positive():
    rng = np.random.default_rng(3)
    filters, motion = Filters(first_covariance()), motions(rng, False, 100.0)
    for _ in range(2000):
        motion[12:15] = rng.normal(0, 5, (3, LANES))
        filters.step(motion, rng.normal(0, 0.1, (4, LANES)), 0.1, np.full(11, 1e-18), 1e-4)
    np.testing.assert_array_equal(filters.matrices, np.swapaxes(filters.matrices, 1, 2))
    sigma = np.sqrt(np.einsum("kii->ki", filters.matrices))
    assert np.linalg.eigvalsh(filters.matrices / sigma[:, :, None] / sigma[:, None, :]).min() > 0.0


def test_a_lane_knows_nothing_of_the_others():
    rng, order = np.random.default_rng(4), np.random.default_rng(5).permutation(LANES)
    motion, seen = motions(rng, False), rng.normal(0, 0.1, (4, LANES))
    whole, mixed = Filters(first_covariance()), Filters(first_covariance())
    for _ in range(5):
        whole.step(motion, seen, 0.1, np.full(11, 1e-16), 1e-4)
        mixed.step(motion[:, order], seen[:, order], 0.1, np.full(11, 1e-16), 1e-4)
    np.testing.assert_array_equal(whole.matrices[order], mixed.matrices)
    np.testing.assert_array_equal(whole.x.reshape(11, LANES)[:, order], mixed.x.reshape(11, LANES))


def due_east(wander=0.0):
    """Motion of the published case: 19.44 kn due east at 60 deg north."""
    latitude, east = 60.0 * DEG, 19.44 * 1852.0 / 3600.0
    _, normal = radii(latitude)
    over = east / float(normal) * np.array([0.0, 1.0, math.tan(latitude)])
    earth = EARTH_RATE * np.array([0.0, math.cos(latitude), math.sin(latitude)])
    force = np.array([0.0, 0.0, normal_gravity(latitude)]) + np.cross(2.0 * earth + over, [east, 0.0, 0.0])
    to_w = Rotation.from_euler("z", -wander).as_matrix()
    C = to_w @ attitude_matrix(0.5 * math.pi, 0.0, 0.0)
    axis = to_w @ [0.0, math.cos(latitude), math.sin(latitude)]
    return np.concatenate([C.ravel(), to_w @ [east, 0.0, 0.0], to_w @ force, axis, [0.0]]), C


@pytest.mark.parametrize(("slaved", "wander"), [(False, 0.0), (False, 2.0), (True, 0.0)])
def test_the_published_case_has_the_covariance_of_the_table(slaved, wander):
    """Standard deviations of an independent computation at 10, 30, 60, 120, 300, 600 and 900 s, 10 Hz updates, arcmin."""
    level = [0.2105, 0.1743, 0.1737, 0.1722, 0.1717, 0.1717, 0.1717]
    azimuth = [29.998, 29.479, 20.73, 7.02, 4.70, 4.49, 4.44]
    motion, C = due_east(wander)
    P0 = first_covariance(C)
    if slaved:
        P0[5, 5] = 0.0
    filters = Filters(P0, slaved)
    rows = np.repeat(motion[:, None], LANES, axis=1)
    seen = np.zeros((4, LANES))
    if not slaved:
        seen[2], seen[3] = -motion[10], motion[9]
    gyro, accel = 0.001 * DEG / 60.0, 0.833e-6 * 9.80665
    noise = 0.1 * np.array([accel**2, accel**2, *[gyro**2] * 3, *[0.0] * 6])
    found = []
    for k in range(1, 9001):
        filters.step(rows, seen, 0.1, noise, 1e-4)
        if k in {100, 300, 600, 1200, 3000, 6000, 9000}:
            found.append(np.sqrt(np.diag(filters.matrices[0]))[2:5] / ARCMIN)
    found = np.array(found)
    np.testing.assert_allclose(found[:, 2], azimuth, rtol=0.01)
    np.testing.assert_allclose(found[:, 0], level, rtol=0.01)
    np.testing.assert_allclose(found[:, 1], level, rtol=0.01)


def test_the_compiled_functions_are_the_plain_ones():
    rng = np.random.default_rng(6)
    motion, seen = motions(rng, False), rng.normal(0, 0.1, (4, LANES))
    compiled, plain = Filters(first_covariance()), Filters(first_covariance())
    for _ in range(2):
        compiled.step(motion, seen, 0.1, np.full(11, 1e-16), 1e-4)
        rest = 0.1, EARTH_RATE, ELLIPSOID, False, np.full(11, 1e-16), 1e-4, plain.nis, plain.room
        kernel.step.py_func(plain.P, plain.x, motion.ravel(), seen.ravel(), *rest)
    np.testing.assert_allclose(compiled.P, plain.P, rtol=1e-12, atol=1e-30)
