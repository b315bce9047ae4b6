"""Single sensors with all their terms: equations, derivatives, names."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac import units
from sagnac.sensors import TERMS, Axis
from sagnac.sensors.axis import rows, unit_of

G = 9.80665
MISALIGNMENTS = {
    "accel.x": (),
    "accel.y": ("yx",),
    "accel.z": ("zx", "zy"),
    "gyro.x": ("xy", "xz"),
    "gyro.y": ("yx", "yz"),
    "gyro.z": ("zx", "zy"),
}


def whole(sensor: str) -> Axis:
    kind, axis = sensor.split(".")
    return Axis(kind, axis, (*TERMS[kind], *(["scale_error"] if kind == "gyro" else [])), MISALIGNMENTS[sensor])


def inputs(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=30), 20 * rng.normal(size=(7, 3)), rng.normal(size=(7, 3))


@pytest.mark.parametrize("sensor", MISALIGNMENTS)
def test_derivatives_are_those_of_a_complex_step(sensor):
    model = whole(sensor)
    x, force, rate = inputs(3)
    x = 1e-2 * x[: len(model.names)]
    reading = model.evaluate(x, force, rate)
    h = 1e-30
    for k in range(x.size):
        step = np.where(np.arange(x.size) == k, 1j * h, 0)
        slope = model.evaluate(x + step, force, rate).value.imag / h
        np.testing.assert_allclose(reading.to_parameters[:, k], slope, rtol=1e-12, atol=1e-12)
    for j in range(3):
        step = np.where(np.arange(3) == j, 1j * h, 0)
        by_force = model.evaluate(x, force + step, rate).value.imag / h
        by_rate = model.evaluate(x, force, rate + step).value.imag / h
        np.testing.assert_allclose(reading.to_force[:, j], by_force, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(reading.to_rate[:, j], by_rate, rtol=1e-12, atol=1e-12)


def test_the_published_accelerometer_equation():
    # [XU18], accelerometer z, by hand in units of g: a_I = th_pz f_x + th_oz f_y + f_z, a_P = f_y - th_oz f_z
    k0, k1, k2, k3, kip, th_pz, th_oz = 6.31e-3, -1.1e-3, 1.2e-5, 3e-6, 5e-6, 0.001478, 0.00126
    f = np.array([3.0, -5.0, 7.0])
    a_i, a_p = th_pz * f[0] + th_oz * f[1] + f[2], f[1] - th_oz * f[2]
    expected = k0 + (1 + k1) * a_i + k2 * a_i**2 + k3 * a_i**3 + kip * a_i * a_p
    model = Axis("accel", "z", ("bias", "scale_error", "k2", "k3", "kip"), ("zx", "zy"))
    x = np.array([k0 * G, k1, k2 / G, k3 / G**2, kip / G, th_pz, th_oz])
    assert model.evaluate(x, G * f[None], np.zeros((1, 3))).value[0] == pytest.approx(G * expected, rel=1e-14)


def test_the_published_gyro_equation():
    # [XU18], gyro x without misalignment: a_I = f_x, a_O = -f_z, a_S = f_y
    d = dict(zip(TERMS["gyro"], [7.4, 1.1, 1.2, 1.3, 0.06, 0.075, 0.09, 0.045, 0.046, 0.047], strict=True))
    i, o, s = 2.0, 3.0, -4.0
    expected = 0.5 + 7.4 + 1.1 * i + 1.2 * o + 1.3 * s + 0.06 * i * i + 0.075 * o * o + 0.09 * s * s
    expected += 0.045 * i * o + 0.046 * i * s + 0.047 * o * s
    model = Axis("gyro", "x", tuple(d))
    value = model.evaluate(np.array(list(d.values())), np.array([[i, s, -o]]), np.array([[0.5, 9.0, 9.0]])).value
    assert value[0] == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("sensor", MISALIGNMENTS)
def test_the_three_axes_stay_perpendicular(sensor):
    # to first order in the misalignments, which is what [XU18] keeps
    small = dict.fromkeys(MISALIGNMENTS[sensor], 1e-4)
    c = rows(sensor, small)
    np.testing.assert_allclose(c @ c.T, np.eye(3), atol=5e-8)


def test_units_are_those_of_the_terms():
    for kind, reading in (("accel", "m/s^2"), ("gyro", "rad/s")):
        for term, powers in TERMS[kind].items():
            given = unit_of(kind, term)
            input_unit = f"{reading}/(m/s^2)^{sum(powers)}" if sum(powers) else reading
            assert units.convert(1.0, input_unit, given) == pytest.approx(1.0)


def test_a_term_that_the_sensor_lacks_is_refused():
    with pytest.raises(ValueError, match="has no such terms"):
        Axis("accel", "x", ("d_ii",))
    with pytest.raises(ValueError, match="has no such terms"):
        Axis("accel", "x", ("bias",), ("xy",))
