"""The wander frame: what C_e_w holds, and the rate of w over the Earth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.earth import ELLIPSOID, radii
from sagnac.frames import skew
from sagnac.navigate.wander import curvature, direction_cosines, place, to_enu, transport_rate

ANGLE = st.floats(-3.1, 3.1)
LATITUDE = st.floats(-1.57, 1.57)


@given(LATITUDE, ANGLE, ANGLE)
def test_place_is_the_inverse_of_direction_cosines(latitude, longitude, wander):
    C_e_w = direction_cosines(latitude, longitude, wander)
    np.testing.assert_allclose(C_e_w @ C_e_w.T, np.eye(3), rtol=0, atol=1e-15)
    # 1e-16 in the horizontal components of the Earth's axis is 1e-13 rad of angle at 1.57 rad of latitude
    for found, expected in zip(place(C_e_w), (latitude, longitude, wander), strict=True):
        assert found == pytest.approx(expected, abs=1e-12)


def test_rows_are_the_axes_of_w():
    """45 deg from east at 30 N, 60 E: x points north-east."""
    C_e_w = direction_cosines(np.pi / 6, np.pi / 3, np.pi / 4)
    east = np.array([-np.sin(np.pi / 3), np.cos(np.pi / 3), 0.0])
    up = np.array([np.cos(np.pi / 6) * 0.5, np.cos(np.pi / 6) * np.sin(np.pi / 3), 0.5])
    north = np.cross(up, east)
    np.testing.assert_allclose(C_e_w, [(east + north) / 2**0.5, (north - east) / 2**0.5, up], rtol=0, atol=1e-15)
    np.testing.assert_allclose(to_enu(np.pi / 4) @ [1.0, 0.0, 0.0], [0.5**0.5, 0.5**0.5, 0.0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("latitude", [0.5 * np.pi, -0.5 * np.pi])
def test_at_a_pole_everything_but_the_split_of_the_angles_is_kept(latitude):
    C_e_w = direction_cosines(latitude, 0.4, 1.1)
    again = direction_cosines(*place(C_e_w))
    np.testing.assert_allclose(again, C_e_w, rtol=0, atol=1e-15)


def test_arrays_of_places():
    latitudes, longitudes = np.linspace(-1.5, 1.5, 6).reshape(2, 3), np.linspace(-3.0, 3.0, 3)
    C_e_w = direction_cosines(latitudes, longitudes, 0.2)
    assert C_e_w.shape == (2, 3, 3, 3)
    np.testing.assert_allclose(C_e_w[1, 2], direction_cosines(1.5, 3.0, 0.2), rtol=0, atol=1e-16)
    np.testing.assert_allclose(place(C_e_w)[0], latitudes, rtol=0, atol=1e-14)
    assert transport_rate(C_e_w, np.ones((2, 3, 3)), np.zeros((2, 3))).shape == (2, 3, 3)


@given(LATITUDE, ANGLE, st.floats(-500.0, 20000.0))
def test_curvature_is_that_of_meridian_and_prime_vertical(latitude, wander, height):
    """K = k1 I + k2 p p' turned to east and north is diag(1 / (R_N + h), 1 / (R_M + h))."""
    C_e_w = direction_cosines(latitude, 0.3, wander)
    k1, k2 = curvature(C_e_w, height)
    p = C_e_w[:2, 2]
    turn = to_enu(wander)[:2, :2]
    meridian, normal = radii(latitude)
    expected = np.diag([1.0 / (normal + height), 1.0 / (meridian + height)])
    np.testing.assert_allclose(turn @ (k1 * np.eye(2) + k2 * np.outer(p, p)) @ turn.T, expected, rtol=0, atol=1e-20)


@pytest.mark.parametrize("latitude", [0.0, 0.9, -1.4, 0.5 * np.pi - 1e-7, 0.5 * np.pi])
@pytest.mark.parametrize("wander", [0.0, 2.0])
def test_w_turns_with_the_normal_of_the_ellipsoid(latitude, wander):
    """The place is moved along the velocity in Earth-fixed coordinates; w_ew x z_w must be how its normal changes."""
    C_e_w, height, velocity = direction_cosines(latitude, 0.3, wander), 3000.0, np.array([200.0, -120.0, 0.0])
    a, e2 = ELLIPSOID[:2]

    def normal(t):
        """Normal at the place after t seconds, by Newton's method on r(u) = (N + h) u - e^2 N u_z z."""
        u = C_e_w[2]
        aim = place_of(u) + C_e_w.T @ velocity * t
        for _ in range(20):
            u = u + (aim - place_of(u)) / a
            u = u / np.linalg.norm(u)
        return u

    def place_of(u):
        N = a / np.sqrt(1.0 - e2 * u[2] ** 2)
        return (N + height) * u - e2 * N * u[2] * np.array([0.0, 0.0, 1.0])

    dt = 10.0
    change = C_e_w @ (normal(dt) - normal(-dt)) / (2.0 * dt)
    rate = transport_rate(C_e_w, velocity, height)
    # central difference: (v dt / R)^2 / 6 = 2e-8 of it, rounding 1e-16 / 10 s
    np.testing.assert_allclose(skew(rate) @ [0.0, 0.0, 1.0], change, rtol=0, atol=1e-11)
    assert rate[2] == 0.0
