"""The rotation kernel against its plain twin and against finite differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plain import exponential
from plain import integrate as plain_integrate
from sagnac.kernels import is_cold
from sagnac.kernels.rotation import integrate


@pytest.fixture
def log():
    rng = np.random.default_rng(4)
    n = 400
    time = np.cumsum(rng.uniform(0.008, 0.012, n))
    gyro = np.cumsum(rng.standard_normal((n, 3)), axis=0) * 0.2 + 5.0
    force = rng.standard_normal((n, 3)) + [0, 0, 9.8]
    inverse = np.eye(3) + 0.05 * rng.standard_normal((3, 3))
    return time, gyro, force, inverse, rng.standard_normal(3), 0.02 * rng.standard_normal((3, 3))


def test_kernel_equals_its_plain_twin(log):
    first, last = np.array([0, 100, 250]), np.array([80, 240, 399])
    for ours, plain in zip(integrate(*log, first, last), plain_integrate(*log, first, last), strict=True):
        assert np.allclose(ours, plain, rtol=1e-11, atol=1e-12)


def test_small_and_zero_rotations_keep_full_precision():
    """Series and closed form of the coefficients meet; a still unit does not rotate."""
    time = np.arange(5) * 0.01
    for size in (0.0, 1e-9, 1e-4, 1e-2, 0.0999, 0.1001):
        gyro = np.full((5, 3), size / 0.01 / np.sqrt(3))
        args = time, gyro, np.zeros((5, 3)), np.eye(3), np.zeros(3), np.zeros((3, 3)), np.array([0]), np.array([4])
        rotation = integrate(*args)[0][0]
        expected = Rotation.from_rotvec(np.full(3, 4 * size / np.sqrt(3))).as_matrix()
        assert np.allclose(rotation, expected, atol=1e-15)


def test_constant_rate_turns_by_its_angle():
    time = np.linspace(0, 1, 201)
    gyro = np.tile([0.3, -1.2, 2.0], (201, 1))
    rotation = integrate(time, gyro, gyro, np.eye(3), np.zeros(3), np.zeros((3, 3)), np.array([0]), np.array([200]))[0]
    assert np.allclose(rotation[0], Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix(), atol=1e-13)


@pytest.mark.parametrize("what", ["inverse", "bias", "g_matrix"])
def test_sums_give_the_derivative_of_the_attitude(log, what):
    """Body-frame error of the end attitude per change of each parameter, against central differences of 1e-6."""
    time, gyro, force, inverse, bias, g_matrix = log
    first, last = np.array([10]), np.array([390])
    rotation, sum_1, sum_w, sum_f = integrate(*log, first, last)
    rng = np.random.default_rng(9)
    step = rng.standard_normal((3, 3)) if what != "bias" else rng.standard_normal(3)
    change = {"inverse": inverse, "bias": bias, "g_matrix": g_matrix}

    def turned(h):
        moved = dict(change)
        moved[what] = change[what] + h * step
        return integrate(time, gyro, force, moved["inverse"], moved["bias"], moved["g_matrix"], first, last)[0][0]

    h = 1e-6
    error = Rotation.from_matrix(turned(-h).T @ turned(h)).as_rotvec() / (2 * h)
    if what == "inverse":  # dw = dA A^-1 w
        d = step @ np.linalg.inv(inverse)
        expected = np.einsum("ijl,jl->i", sum_w[0], d)
    elif what == "bias":
        expected = -sum_1[0] @ inverse @ step
    else:
        expected = -np.einsum("ijl,jl->i", sum_f[0], inverse @ step)
    assert np.allclose(rotation[0].T @ expected, error, rtol=2e-8, atol=1e-8 * np.abs(error).max())


def test_left_jacobian_of_the_twin():
    """Jl(v) d = log(exp(v + d) exp(v)') to first order (Barfoot 2017, equation 7.77)."""
    rng = np.random.default_rng(1)
    v, d = rng.standard_normal((20, 3)), 1e-6 * rng.standard_normal((20, 3))
    plus, minus = exponential(v + d)[0], exponential(v - d)[0]
    error = np.array([Rotation.from_matrix(p @ m.T).as_rotvec() / 2 for p, m in zip(plus, minus, strict=True)])
    assert np.allclose(np.einsum("nij,nj->ni", exponential(v)[1], d), error, rtol=1e-7, atol=1e-14)


def test_compiled_kernel_is_found_on_disk(log):
    integrate(*log, np.array([0]), np.array([2]))
    assert not is_cold(integrate)
