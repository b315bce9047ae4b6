"""Gravity and Earth rate against published values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.earth import (
    EARTH_RATE,
    ELLIPSOID,
    STANDARD_GRAVITY,
    earth_rate_enu,
    gravity_by_sine,
    gravity_excess,
    normal_gravity,
    radii,
)


@pytest.mark.parametrize(
    ("latitude", "gravity"),
    [
        (0.0, 9.7803253359),  # NIMA TR8350.2, table 3.4: normal gravity at the equator
        (90.0, 9.8321849378),  # the same table: at the pole
        (-90.0, 9.8321849378),
        (45.0, 9.806197769),  # the value that goes with both in Somigliana's formula, worked by hand below
    ],
)
def test_normal_gravity_on_the_ellipsoid(latitude, gravity):
    assert normal_gravity(math.radians(latitude)) == pytest.approx(gravity, abs=5e-10)


def test_gravity_at_45_degrees_by_the_other_form_of_somigliana():
    # g = (a g_e cos^2 + b g_p sin^2) / sqrt(a^2 cos^2 + b^2 sin^2), from NIMA TR8350.2 tables 3.1, 3.3, 3.4
    a, b, equator, pole = 6378137.0, 6356752.3142, 9.7803253359, 9.8321849378
    for latitude in np.radians([0, 10, 45, 48.1, 89, 90]):
        c2, s2 = math.cos(latitude) ** 2, math.sin(latitude) ** 2
        other = (a * equator * c2 + b * pole * s2) / math.sqrt(a**2 * c2 + b**2 * s2)
        assert normal_gravity(float(latitude)) == pytest.approx(other, abs=1e-9)


@given(st.floats(-math.pi / 2, math.pi / 2), st.floats(-400, 9000))
def test_gravity_falls_with_height_as_free_air_says(latitude, height):
    # The free-air gradient is 3.086e-6 /s^2 within 0.3 % over the Earth (2 g / R, with the centrifugal part), and
    # its own change with height is 7.2e-13 per metre and second squared.
    fall = normal_gravity(latitude) - normal_gravity(latitude, height)
    assert fall == pytest.approx(3.086e-6 * height - 7.2e-13 * height**2, abs=0.003 * 3.086e-6 * abs(height) + 1e-12)


@pytest.mark.parametrize("latitude", [0.0, 0.5, 1.0, math.pi / 2])
def test_gravity_bends_with_height_as_the_inverse_square_does(latitude):
    # g ~ 1 / r^2 has the second derivative 6 g / r^2; the ellipsoid's radii are within 1 % of each other (e^2 = 0.67 %)
    h = 4000.0
    bend = (normal_gravity(latitude, 2 * h) - 2 * normal_gravity(latitude, h) + normal_gravity(latitude)) / h**2
    assert bend == pytest.approx(6 * 9.8 / 6371e3**2, rel=0.01)


@given(st.floats(0, math.pi / 2), st.floats(0, 5000))
def test_gravity_is_the_same_north_and_south(latitude, height):
    assert normal_gravity(latitude, height) == normal_gravity(-latitude, height)


def test_gravity_of_many_places_is_that_of_each():
    latitude, height = np.linspace(-1.5, 1.5, 7), np.linspace(-100.0, 9000.0, 7)
    both = [normal_gravity(float(a), float(h)) for a, h in zip(latitude, height, strict=True)]
    assert normal_gravity(latitude, height).tolist() == both
    assert gravity_by_sine(np.sin(latitude), height).tolist() == both


def test_gravity_that_was_measured_is_more_or_less_than_the_normal_one():
    assert gravity_excess(None, 1.0, 0.0) == 0.0
    assert gravity_excess(9.82, 1.0, 100.0) == 9.82 - normal_gravity(1.0, 100.0)


@given(st.floats(-math.pi / 2, math.pi / 2))
def test_earth_rate_points_along_the_axis(latitude):
    rate = earth_rate_enu(latitude)
    assert np.linalg.norm(rate) == pytest.approx(7.292115e-5, rel=1e-15)  # WGS-84
    # elevation of the axis above the northern horizon is the latitude
    assert rate[0] == 0
    assert math.atan2(rate[2], rate[1]) == pytest.approx(latitude, abs=1e-15)


def test_constants():
    assert EARTH_RATE == 7.292115e-5  # rad/s, NIMA TR8350.2
    assert STANDARD_GRAVITY == 9.80665  # m/s^2, CGPM 1901
    assert earth_rate_enu(0.0, 1.0).tolist() == [0, 1, 0]


def test_radii_are_those_of_the_ellipse_itself():
    # an ellipse with half axes a, b: R_N = a^2 / sqrt(a^2 cos^2 + b^2 sin^2), R_M = a^2 b^2 / (...)^(3/2) (Torge, Geodesy, 4.1)
    a, b = 6378137.0, 6356752.3142
    for latitude in np.radians([0, 30, -45, 60, 89.9, 90]):
        root = math.sqrt((a * math.cos(latitude)) ** 2 + (b * math.sin(latitude)) ** 2)
        meridian, normal = radii(latitude)
        assert normal == pytest.approx(a * a / root, rel=1e-10)
        assert meridian == pytest.approx((a * b) ** 2 / root**3, rel=1e-10)


def test_the_ellipsoid_of_the_kernels_gives_the_same_gravity():
    a, e2, equator, k, p, q = ELLIPSOID
    for latitude, height in ((0.0, 0.0), (1.0, 500.0), (-1.4, 12e3)):
        s2, r = math.sin(latitude) ** 2, height / a
        g = equator * (1 + k * s2) / math.sqrt(1 - e2 * s2) * (1 - (p - q * s2) * r + 3 * r * r)
        assert g == pytest.approx(normal_gravity(latitude, height), rel=1e-14)
