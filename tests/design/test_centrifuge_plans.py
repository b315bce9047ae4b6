"""Plans for a centrifuge: the published bounds, and two speeds for a gyro."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.design import check, optimise
from sagnac.design.spec import spec_of
from sagnac.plan import Noise, Plan, Rig, Segment, Unit

G = 9.80665
RADIUS = 10 * G / math.pi**2  # [XU18]: ten g at pi rad/s


def published(speeds, noise, gammas=(0.0, math.pi / 2, math.pi), phase=0.0) -> Plan:
    segments, now = [], 0.0
    for speed in speeds:
        for gamma in gammas:
            turn = 2 * math.pi / speed
            segments.append(
                Segment(
                    name=str(len(segments) + 1),
                    start=now,
                    stop=now + turn,
                    arm_rate=speed,
                    arm_phase=phase,
                    gamma=gamma,
                )
            )
            now += turn + 10.0
    return Plan(
        latitude=math.radians(29.89),
        gravity=G,
        earth_rate=7.292e-5,
        unit=Unit(noise=noise),
        rig=Rig(kind="centrifuge", radius=RADIUS),
        segment=tuple(segments),
    )


def test_the_published_bounds():
    # methods.md, section 3, row "Cramer-Rao bound": 2.5e-5 g a sample at 1000 Hz, one turn, gamma 0, 90 and 180 deg
    found = check(published((math.pi,), Noise(accel=2.5e-5 * G / math.sqrt(1000))), sensors=("accel_z",))
    bounds = {
        "accel.bias.z": 3.7e-7 * G,
        "accel.scale_error.z": 2.1e-7,
        "accel.k2.z": 1.05e-8 / G,
        "accel.k3.z": 2.7e-9 / G**2,
        "accel.kip.z": 1.5e-8 / G,
        "accel.misalignment.zx": 5.6e-8,
        "accel.misalignment.zy": 4.6e-8,
    }
    for name, bound in bounds.items():
        assert found[name] == pytest.approx(bound, rel=0.02), name  # two printed digits


def test_one_speed_is_not_enough_for_a_gyro():
    noise = Noise(gyro=1e-6)
    found = check(published((math.pi,), noise), sensors=("gyro_x",))
    assert "gyro.bias.x (DF) and the sum gyro.d_ii.x + gyro.d_oo.x + gyro.d_ss.x cannot be told apart" in found.unseen
    both = check(published((math.pi, 2 * math.pi), noise), sensors=("gyro_x",))
    assert len(both.parameters) == 10
    assert not both.unseen


def test_an_unknown_phase_costs_something_and_says_so():
    noise = Noise(accel=2.5e-5 * G / math.sqrt(1000))
    known, unknown = (check(published((math.pi,), noise, phase=p), sensors=("accel",)) for p in (0.0, None))
    assert "rig.arm_phase" in {p.name for p in unknown.parameters}
    assert any("arm_phase was not given" in r for r in unknown.remarks)
    for p in known.parameters:
        assert unknown[p.name] >= 0.999 * p.standard_uncertainty


def test_the_search_finds_that_two_speeds_are_needed():
    wanted = {
        "latitude": "29.89 deg",
        "gravity": "9.80665 m/s^2",
        "unit": {"noise": {"gyro": "0.001 deg/sqrt(h)"}},
        "rig": {"kind": "centrifuge", "radius": "9.94 m"},
        "optimise": {
            "method": "centrifuge",
            "sensors": ["gyro_x"],
            "positions": 6,
            "dwell": "60 s",
            "candidates": {
                "arm_rate": ["90 deg/s", "180 deg/s", "360 deg/s"],
                "gamma": ["0 deg", "45 deg", "90 deg", "135 deg", "180 deg"],
            },
        },
    }
    done = optimise(spec_of(wanted))
    assert len({s.arm_rate for s in done.plan.segment}) >= 2
    assert any(r.startswith("one arm rate is not enough: gyro_x: gyro.bias.x (DF)") for r in done.remarks)
    for s in done.plan.segment:
        assert s.arm_rate * (s.stop - s.start) / (2 * np.pi) == pytest.approx(
            round(s.arm_rate * (s.stop - s.start) / (2 * np.pi)), abs=1e-9
        )
    assert not check(done.plan, sensors=("gyro_x",)).unseen
