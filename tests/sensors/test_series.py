"""Fourier series of a sensor's output against the sensor evaluated angle by angle."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.sensors import TERMS, Axis
from sagnac.sensors.series import basis, response

SENSORS = [
    Axis("accel", "x", tuple(TERMS["accel"])),
    Axis("accel", "y", tuple(TERMS["accel"]), ("yx",)),
    Axis("accel", "z", tuple(TERMS["accel"]), ("zx", "zy")),
    Axis("gyro", "y", (*TERMS["gyro"], "scale_error"), ("yx", "yz")),
]


def case(axis):
    rng = np.random.default_rng(3)
    x = rng.normal(0, 0.1, len(axis.names))
    return x, rng.normal(0, 3, (2, 3, 3)), rng.normal(0, 1, (2, 3, 3))


@pytest.mark.parametrize("axis", SENSORS, ids=lambda a: a.sensor)
def test_the_series_is_the_sensor_at_every_angle(axis):
    x, force, rate = case(axis)
    angles = np.linspace(0.1, 7.0, 23)
    said = response(axis, x, force, rate)
    for i in range(2):
        at = basis(angles, 1)
        direct = axis.evaluate(x, at @ force[i].T, at @ rate[i].T)
        np.testing.assert_allclose(basis(angles, 4) @ said.value[i], direct.value, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(
            basis(angles, 4) @ said.to_parameters[i], direct.to_parameters, rtol=1e-11, atol=1e-11
        )


@pytest.mark.parametrize("axis", SENSORS, ids=lambda a: a.sensor)
def test_nothing_beyond_the_third_harmonic(axis):
    said = response(axis, *case(axis), order=7)
    size = np.abs(said.value).max()
    assert np.abs(said.value[:, 7:]).max() < 1e-14 * size
    np.testing.assert_allclose(response(axis, *case(axis), order=2).value, said.value[:, :5], atol=1e-14 * size)


@pytest.mark.parametrize("axis", SENSORS, ids=lambda a: a.sensor)
def test_derivatives_to_the_inputs(axis):
    """Central differences; the model is of third order, so that they are exact but for h^2 and rounding."""
    x, force, rate = case(axis)
    said, h = response(axis, x, force, rate), 1e-5
    for k in range(9):
        step = np.zeros(9)
        step[k] = h
        step = step.reshape(3, 3)
        by_force = (response(axis, x, force + step, rate).value - response(axis, x, force - step, rate).value) / (2 * h)
        by_rate = (response(axis, x, force, rate + step).value - response(axis, x, force, rate - step).value) / (2 * h)
        np.testing.assert_allclose(said.to_force.reshape(2, -1, 9)[..., k], by_force, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(said.to_rate.reshape(2, -1, 9)[..., k], by_rate, rtol=1e-7, atol=1e-8)


def test_orders_that_the_points_cannot_tell_are_refused():
    with pytest.raises(ValueError, match="order"):
        response(SENSORS[0], *case(SENSORS[0]), order=8)
