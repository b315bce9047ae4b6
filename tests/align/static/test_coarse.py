"""Coarse alignment: exact at rest, its uncertainty as derived, and gravity turning with the Earth for a unit that sways."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from swaying_case import DEGREE, HOUR, UG, Unit, phi_of, waves

from sagnac.align.static.coarse import gyrocompass, inertial
from sagnac.align.static.model import collect, to_enu_of_inertial
from sagnac.earth import EARTH_RATE, earth_rate_enu, normal_gravity
from sagnac.errors import DataError, InputError
from sagnac.frames import attitude_matrix, rotation_matrix


def at_rest(latitude, C_b_n):
    """Specific force and rate in body axes of a unit at rest."""
    return C_b_n.T @ [0, 0, normal_gravity(latitude)], C_b_n.T @ earth_rate_enu(latitude)


@given(
    st.floats(-80, 80),
    st.floats(0, 360),
    st.floats(-89, 89),
    st.floats(-180, 180),
    st.floats(0.1, 10),
)
def test_gyrocompass_is_exact_at_rest(latitude, heading, pitch, roll, size):
    C = attitude_matrix(*(v * DEGREE for v in (heading, pitch, roll)))
    f, w = at_rest(latitude * DEGREE, C)
    found = gyrocompass(size * f, w / size, latitude * DEGREE)
    assert np.abs(found.C_b_n - C).max() < 1e-12
    assert np.abs(found.C_b_n @ found.C_b_n.T - np.eye(3)).max() < 1e-14


@pytest.mark.parametrize("latitude", [-60 * DEGREE, 0.0, 34 * DEGREE])
def test_gyrocompass_covariance_is_that_of_its_derivative(latitude):
    """Against central differences of the attitude itself; phi by its definition."""
    C = attitude_matrix(1.1, 0.3, -0.2)
    f, w = at_rest(latitude, C)
    accel, gyro = np.array([20, 50, 90]) * UG, np.array([0.01, 0.03, 0.02]) * HOUR
    J = np.empty((3, 6))
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5 if k < 3 else 1e-9
        sides = [phi_of(gyrocompass(f + s * step[:3], w + s * step[3:], latitude).C_b_n, C) for s in (1, -1)]
        J[:, k] = (sides[0] - sides[1]) / (2 * step[k])
    expected = J @ np.diag(np.concatenate([accel, gyro]) ** 2) @ J.T
    found = gyrocompass(f, w, latitude, accel_sigma=accel, gyro_sigma=gyro).covariance
    assert np.allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_gyrocompass_floors_are_the_textbook_ones():
    """methods.md section 5: 50 ug are 0.172' of level, 0.01 deg/h at 60 deg are 4.57' of azimuth."""
    latitude = 60 * DEGREE
    f, w = at_rest(latitude, np.eye(3))
    found = gyrocompass(f, w, latitude, accel_sigma=50 * UG, gyro_sigma=0.01 * HOUR)
    minutes = np.sqrt(np.diag(found.covariance)) / DEGREE * 60
    assert minutes[:2] == pytest.approx([0.172, 0.172], abs=1e-3)
    # the level's 0.172' times tan L come on top of 4.572'
    assert minutes[2] == pytest.approx(np.hypot(4.572, 0.172 * np.tan(latitude)), abs=2e-3)


@pytest.mark.parametrize(
    ("force", "rate", "words"),
    [
        ([0, 0, 9.8], [0, 0, EARTH_RATE], "along the vertical"),
        ([0, 0, 9.8], [0, 0, 0], "along the vertical"),
        ([0, 0, 0], [0, 0, 0], "along the vertical"),
    ],
)
def test_gyrocompass_refuses_what_shows_no_north(force, rate, words):
    with pytest.raises(DataError, match=words):
        gyrocompass(force, rate, 1.0)


@pytest.mark.parametrize("force", [[0, 0], [0, np.nan, 1]])
def test_gyrocompass_refuses_no_vectors(force):
    with pytest.raises(InputError, match="three numbers each"):
        gyrocompass(force, [0, 0, 1], 1.0)


@pytest.mark.parametrize("angles", [(0.3, 0.05, -0.02), (4.0, 1.2, 0.5), (2.0, 0.1, 3.1)])
def test_inertial_finds_any_attitude_at_rest(angles):
    """Ideal sensors at rest: no error is left but that of the sums."""
    unit = Unit(angles=angles)
    blocks = collect([unit.increments(120, 20)])
    stop = float(blocks.end[-1])
    C = to_enu_of_inertial(stop, stop / 2, unit.place.rate) @ inertial(blocks, unit.place.latitude) @ blocks.C_b_s[-1]
    assert np.abs(phi_of(C, unit.C_b_n(stop))).max() < 1e-7


def test_inertial_bears_sway_that_the_means_do_not():
    """Sway of 0.1 deg and some millimetres at 0.3 to 3 Hz over three minutes.

    The velocity of the sway, some 4 cm/s, over g T = 1766 m/s is 0.08' of level, and over g w_e cos L T^2 / 2 = 9.5 m/s it is
    14' of azimuth.
    """
    rng = np.random.default_rng(7)
    unit = Unit(sway=waves(rng, 0.3, 3, 2e-3), heave=waves(rng, 0.3, 3, 3e-3))
    blocks = collect([unit.increments(180, 50)])
    stop = float(blocks.end[-1])
    C = to_enu_of_inertial(stop, stop / 2, unit.place.rate) @ inertial(blocks, unit.place.latitude) @ blocks.C_b_s[-1]
    off = np.abs(phi_of(C, unit.C_b_n(stop))) / DEGREE * 60
    assert off[:2].max() < 3 * 0.08
    assert off[2] < 3 * 14
    means = gyrocompass(blocks.body_force.mean(axis=0), blocks.body_rate.mean(axis=0), unit.place.latitude)
    assert np.abs(phi_of(means.C_b_n, unit.C_b_n(stop)))[2] / DEGREE * 60 > 100


def test_inertial_is_the_same_in_any_body_axes():
    """Turning the sensors by a fixed rotation turns the answer by it."""
    unit = Unit()
    piece = unit.increments(60, 20)
    turn = rotation_matrix([0.4, -1.0, 2.0])
    other = type(piece)(piece.begin, piece.time, piece.steps, piece.turns @ turn.T, piece.pushes @ turn.T)
    first, second = (inertial(collect([p]), unit.place.latitude) for p in (piece, other))
    assert np.abs(second @ turn - first).max() < 1e-9
