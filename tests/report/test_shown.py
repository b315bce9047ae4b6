"""Numbers and words as reports show them."""

from __future__ import annotations

import pytest

from sagnac.calibration import Value
from sagnac.report.shown import MINUS, plain_words, quantity, scales_of, term_of


def value(name, v, u, unit="1"):
    return Value(name=name, value=v, unit=unit, standard_uncertainty=u)


@pytest.mark.parametrize(
    ("name", "term"),
    [
        ("gyro.misalignment.xy", "gyro.misalignment"),
        ("accel.bias.z", "accel.bias"),
        ("rig.zero.inner", "rig.zero.inner"),
        ("rig.mount_yaw", "rig.mount_yaw"),
        ("rig.encoder_eccentricity.cos1", "rig.encoder_eccentricity.cos1"),
        ("x", "x"),
    ],
)
def test_like_parameters_differ_by_their_axis(name, term):
    assert term_of(name) == term


def test_the_axes_of_a_term_have_one_unit_and_the_same_digits():
    # one by one the first would be a plain number (U = 0.011), the others ppm, without a digit after the point and with one
    own = [value("gyro.scale_error.x", 0.2, 5.5e-3), value("gyro.scale_error.y", 2e-3, 1.2e-3)]
    own += [value("gyro.scale_error.z", -1e-5, 3e-4), value("gyro.bias.x", 1e-6, 1e-9, "rad/s")]
    scales = scales_of(own, [2 * p.standard_uncertainty for p in own])
    x, y, z, other = (scales[p.name] for p in own)
    assert x == y == z
    assert other != x
    assert x.unit == "ppm"
    assert z.text(-1e-7) == "0"  # and no minus before it


def test_a_far_worse_axis_does_not_get_digits_that_it_has_not():
    own = [value("gyro.scale_error.x", 2.017e-3, 4.2e-5), value("gyro.scale_error.y", 2e-4, 7e-3)]
    own.append(value("gyro.scale_error.z", 2e-4, 7e-3))
    scales = scales_of(own, [2 * p.standard_uncertainty for p in own])
    assert len({(s.unit, s.size) for s in scales.values()}) == 1
    assert scales["gyro.scale_error.x"].text(8.4e-5) == "84"
    assert scales["gyro.scale_error.y"].text(0.014) == "14000"


def test_what_is_exact_does_not_set_the_digits():
    own = [value("a.b.x", 1.0, 0.0, "m"), value("a.b.y", 1.0, 0.1, "m")]
    scales = scales_of(own, [0.0, 0.2])
    assert scales["a.b.x"] == scales["a.b.y"]
    assert scales["a.b.y"].text(0.2) == "0.20"


def test_zero_has_no_sign():
    assert quantity(-0.0, "m") == "0\xa0m"
    assert quantity(-1.0, "m") == f"{MINUS}1\xa0m"


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("it needs a plan (--plan) that says", "it needs a plan that says"),
        ("columns are permuted (--map gyro=w)", "columns are permuted"),
        ("not stated (unit.limits.gyro_drift): not in", "not stated: not in"),
        ("unit.limits.gyro_drift is not stated", "the drift is not stated"),
        ("state it in unit.limits", "state it in the limits"),
        ("rig.mount rests on the table", "rig.mount rests on the table"),
        ("a - b (c) -- d", "a - b (c) -- d"),
    ],
)
def test_a_report_speaks_without_options_and_keys(said, shown):
    assert plain_words(said, {"unit.limits": "the limits", "unit.limits.gyro_drift": "the drift"}) == shown
