"""The noise on a certificate: which terms, in which units, from where, and what is said of its use."""

from __future__ import annotations

from dataclasses import replace

import pytest
from certificates import made, table, words

from sagnac.calibration import NoiseLevel
from sagnac.plan import Noise, Plan, Unit
from sagnac.report import html
from sagnac.report.certificate import certificate
from sagnac.report.certificate.evidence import of

UG, DEG_H = 9.80665e-6, 4.84813681109536e-06
"""m/s^2, and rad/s of a degree an hour (pi / 648000)."""
CAPTION = "Noise of the axes"


def section(levels, plan=None, **more):
    document = certificate(replace(of(made(noise=levels, **more)), plan=plan))
    return next(s for s in document.sections if s.title == "Method")


def level(scale=1.0, unit="rad/s/sqrt(Hz)", **keys):
    return NoiseLevel(density=tuple(scale * v for v in (1.0, 2.0, 3.0)), unit=unit, **keys)


def test_every_term_in_the_units_of_data_sheets():
    """0.01 deg/sqrt(h) is 0.6 deg/h per sqrt(Hz); K of 1 deg/h per second is 60 deg/h in an hour."""
    gyro = level(
        0.6 * DEG_H,
        origin="noise test",
        instability=(0.02 * DEG_H, 0.03 * DEG_H, 0.0),
        walk=(0.001 * DEG_H, 0.0, 0.0),
        walk_limit=(0.002 * DEG_H, 0.001 * DEG_H, 0.001 * DEG_H),
    )
    accel = level(10 * UG, "m/s^2/sqrt(Hz)", origin="noise test", instability=(3 * UG,) * 3, walk=(0.1 * UG,) * 3)
    rows = table(section({"accel": accel, "gyro": gyro}), CAPTION)
    said = [(r["sensor"], r["noise"], r["x"], r["y"], r["z"], r["unit"], r["from"]) for r in rows]
    test = "a noise test"
    assert said == [
        ("accelerometers", "white noise", "10.0", "20.0", "30.0", "µg/√Hz", test),
        ("accelerometers", "bias instability", "3.00", "3.00", "3.00", "µg", test),
        ("accelerometers", "random walk", "6.00", "6.00", "6.00", "µg/√h", test),
        ("gyros", "white noise", "0.0100", "0.0200", "0.0300", "deg/√h", test),
        ("gyros", "bias instability", "0.0200", "0.0300", "none", "deg/h", test),
        ("gyros", "random walk", "0.0600", "none", "none", "deg/h/√h", test),
        ("gyros", "random walk, below (95 %)", "0.120", "0.0600", "0.0600", "deg/h/√h", test),
    ]
    assert "has not weighed its data" in words(section({"gyro": gyro}))


def test_found_in_the_data_beside_what_the_plan_states():
    plan = Plan(unit=Unit(noise=Noise(gyro=0.5 * DEG_H, gyro_instability=0.02 * DEG_H)))
    own = level(0.6 * DEG_H, origin="recording", instability=(0.02 * DEG_H,) * 3)
    at = section({"gyro": own}, plan)
    rows = {r["noise"]: r for r in table(at, CAPTION)}
    assert rows["white noise"]["from"] == "found in the data"
    assert rows["white noise, stated"]["x"] == "0.00833"
    assert rows["bias instability"]["from"] == rows["white noise, stated"]["from"] == "the plan"
    assert "White noise that the plan states has weighed the data" in words(at)
    assert "Slow noise is in the weights" in words(at)


def test_white_noise_alone():
    at = section({"gyro": level(0.6 * DEG_H, origin="plan", walk=(0.0,) * 3)})
    assert [r["noise"] for r in table(at, CAPTION)] == ["white noise"]
    assert "No slow noise was stated" in words(at)
    assert "stated in" not in words(at)


def test_raw_counts_stay_counts():
    rows = table(section({"gyro": level(0.5, "count/sqrt(Hz)", origin="recording")}), CAPTION)
    assert [(r["x"], r["unit"]) for r in rows] == [("0.500", "count/√Hz")]


def test_slow_noise_of_raw_counts_is_not_denied():
    own = level(0.5, "count/sqrt(Hz)", origin="recording", instability=(0.2,) * 3, walk=(0.01,) * 3)
    rows = table(section({"gyro": own}), CAPTION)
    assert [(r["noise"], r["x"], r["unit"]) for r in rows[1:]] == [
        ("bias instability", "0.200", "count"),
        ("random walk", "0.0100", "count/√s"),
    ]
    # a record without it, of a plan that states it
    plan = Plan(unit=Unit(noise=Noise(gyro_instability=0.02 * DEG_H)))
    said = words(section({"gyro": level(0.5, "count/sqrt(Hz)", origin="recording")}, plan))
    assert "No slow noise was stated" not in said
    assert "Slow noise is in the weights" in said


def test_no_noise_on_record_is_said():
    assert "No noise of the sensors is on record" in words(section({}))


@pytest.mark.parametrize("origin", ["plan", "recording", "noise test"])
def test_it_is_on_the_page(origin):
    document = certificate(of(made(noise={"gyro": level(0.6 * DEG_H, origin=origin, instability=(0.02 * DEG_H,) * 3)})))
    page = html.render(document)
    assert CAPTION in page
    assert "bias instability" in page
