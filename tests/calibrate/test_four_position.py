"""Four-position biases: cancellation, budget, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from sagnac.calibrate import four_position
from sagnac.errors import DataError, InputError
from sagnac.observe.means import SegmentMeans
from sagnac.plan import Limits, Noise, Plan, Rig, Segment, Unit

DEG_H = np.pi / 648000
SET = ((45, 315, "up"), (45, 135, "down"), (225, 315, "down"), (225, 135, "up"))  # [ZHOU13], table of positions
BIAS = {"accel": np.array([1e-3, 2e-3, 3e-3]), "gyro": np.array([0.1, 0.2, -0.3]) * DEG_H}
LINEAR = np.eye(3) + np.array([[2e-3, 1e-3, -1e-3], [1e-3, -2e-3, 3e-4], [5e-4, 1e-3, 1e-3]])
K2 = 12e-6 / 9.80665  # 12 ug/g^2 in s^2/m


def plan_of(base=0.0, positions=SET, *, unit=None, angle=0.0, hold=50.0):
    segments = tuple(
        Segment(
            name=str(i + 1), start=60.0 * i, stop=60.0 * i + hold,
            x_azimuth=np.radians(x + base), y_azimuth=np.radians(y + base), z=z,
        )
        for i, (x, y, z) in enumerate(positions)
    )  # fmt: skip
    unit = unit or Unit(noise=Noise(accel=9.8e-5, gyro=2.9e-7))
    return Plan(latitude=np.radians(40.0), unit=unit, rig=Rig(angle_uncertainty=angle), segment=segments)


def simulated(plan, rng=None, *, angle=0.0, k2=0.0, linear=LINEAR, duration=None):
    """Independent of the code under test: attitudes as plain rotation matrices, inputs turned by small errors."""
    to_enu = np.array(
        [
            np.column_stack(
                [
                    [np.sin(s.x_azimuth), np.cos(s.x_azimuth), 0],
                    [np.sin(s.y_azimuth), np.cos(s.y_azimuth), 0],
                    [0, 0, 1 if s.z == "up" else -1],
                ]
            )
            for s in plan.segment
        ]
    )
    n = len(to_enu)
    earth = 7.292115e-5 * np.array([0, np.cos(plan.latitude), np.sin(plan.latitude)])
    turn = np.zeros((n, 3)) if rng is None else angle * rng.standard_normal((n, 3))
    f, w = (np.einsum("nji,j->ni", to_enu, v) for v in ([0, 0, plan.site_gravity], earth))
    f, w = f + np.cross(f, turn), w + np.cross(w, turn)
    duration = np.full(n, 50.0) if duration is None else duration
    noise = {"accel": plan.unit.noise.accel or 0.0, "gyro": plan.unit.noise.gyro or 0.0}
    mean = {}
    for sensor, u in (("accel", f), ("gyro", w)):
        white = 0.0 if rng is None else noise[sensor] / np.sqrt(duration)[:, None] * rng.standard_normal((n, 3))
        mean[sensor] = u @ linear.T + BIAS[sensor] + white + (k2 * f**2 if sensor == "accel" else 0.0)
    unknown = {s: np.full(3, np.nan) for s in mean}
    interval = np.full(n, 0.01)
    return SegmentMeans(
        plan.segment, np.arange(n) * 60.0 + 25, interval, duration, np.full(n, 5000), mean, unknown, 0.0
    )


def errors(found):
    return np.concatenate(
        [[found[f"{s}.bias.{a}"].value - BIAS[s][i] for i, a in enumerate("xyz")] for s in ("gyro", "accel")]
    )


@pytest.mark.parametrize("base", [0.0, 33.3, -120.0, 271.25])
def test_linear_errors_cancel_for_any_base_azimuth(base):
    """Scale and misalignment of 1e-3 leave nothing: without table uncertainty the mean of the four is exact."""
    plan = plan_of(base)
    e = errors(four_position.calibrate_means(simulated(plan), plan))
    assert np.abs(e[:3]).max() < 1e-12 * DEG_H * 1e3
    assert np.abs(e[3:]).max() < 1e-12


def test_equals_the_published_closed_form():
    plan = plan_of(10.0, angle=np.pi / 10800)
    means = simulated(plan, np.random.default_rng(1), angle=np.pi / 10800)
    found = four_position.calibrate_means(means, plan)
    for sensor in ("gyro", "accel"):
        closed = means.mean[sensor].mean(axis=0)
        got = [found[f"{sensor}.bias.{a}"].value for a in "xyz"]
        limit = 0.02 * np.array([found[f"{sensor}.bias.{a}"].standard_uncertainty for a in "xyz"])
        assert np.all(np.abs(got - closed) < np.maximum(limit, 1e-12))


def test_unequal_times_do_not_spoil_the_cancellation():
    plan = plan_of()
    e = errors(four_position.calibrate_means(simulated(plan, duration=np.array([50.0, 20.0, 50.0, 5.0])), plan))
    assert np.abs(e[:3]).max() < 1e-6 * DEG_H
    assert np.abs(e[3:]).max() < 1e-9


def test_known_k2_is_taken_out_and_unknown_is_said():
    plan = plan_of()
    means = simulated(plan, k2=K2)
    plain = four_position.calibrate_means(means, plan)
    g2 = plan.site_gravity**2
    assert plain["accel.bias.z"].value - BIAS["accel"][2] == pytest.approx(K2 * g2, rel=1e-6)
    assert any("K2" in r for r in plain.remarks)
    known = plan_of(unit=Unit(noise=plan.unit.noise, accel_k2=(K2, K2, K2)))
    assert four_position.calibrate_means(means, known)["accel.bias.z"].value == pytest.approx(
        BIAS["accel"][2], abs=1e-9
    )
    limited = plan_of(unit=Unit(noise=plan.unit.noise, limits=Limits(accel_k2=K2)))
    found = four_position.calibrate_means(means, limited)
    assert found["accel.bias.z"].standard_uncertainty == pytest.approx(K2 * g2, rel=1e-2)


def test_budget_has_every_term_and_adds_up():
    limits = Limits(accel_k2=K2, gyro_g_squared=1e-11, accel_drift=1e-4, gyro_drift=0.005 * DEG_H)
    plan = plan_of(unit=Unit(noise=Noise(accel=9.8e-5, gyro=2.9e-7), limits=limits), angle=np.pi / 10800)
    found = four_position.calibrate_means(simulated(plan), plan)
    lines = {line.source: np.array(line.standard_uncertainty) for line in found.budget}
    assert set(lines) == {
        "noise", "settings of the table", "g-squared sensitivity", "quadratic coefficient K2", "drift during the turn-over",
    }  # fmt: skip
    total = np.sqrt(sum(v**2 for v in lines.values()))
    stated = np.array([p.standard_uncertainty for p in found.parameters])
    assert np.allclose(total, stated, rtol=1e-6)
    # 1 arcmin x 15 deg/h before averaging over four positions (section 1 of the methods: 0.0044 deg/h)
    perpendicular = np.sqrt(1 - np.array([0.5 * np.cos(np.radians(40)) ** 2] * 2 + [np.sin(np.radians(40)) ** 2]))
    assert np.allclose(lines["settings of the table"][:3], np.pi / 10800 * 7.292115e-5 * perpendicular / 2, rtol=0.02)
    assert np.allclose(lines["noise"][:3], 2.9e-7 / np.sqrt(50) / 2, rtol=0.02)
    assert lines["drift during the turn-over"][0] == pytest.approx(0.005 * DEG_H / np.sqrt(12))


@pytest.mark.statistical
def test_biases_scatter_as_stated():
    plan = plan_of(20.0, angle=np.pi / 10800)
    rng = np.random.default_rng(4)
    z = []
    for _ in range(500):
        found = four_position.calibrate_means(simulated(plan, rng, angle=np.pi / 10800), plan)
        z.append(errors(found) / [p.standard_uncertainty for p in found.parameters])
    assert np.all(np.abs(np.std(z, axis=0) - 1) < 3.3 / np.sqrt(1000))
    coverage = np.mean(np.abs(z) < 1.96, axis=0)
    assert np.all((coverage > 0.92) & (coverage < 0.98))


def test_missing_position_is_refused_with_axis_and_input():
    plan = plan_of(positions=SET[:1] + SET[2:])
    # z: the Earth rate's vertical part of positions up, down, up leaves a third of w_e sin L
    left = 7.292115e-5 * np.sin(np.radians(40)) / 3 / DEG_H
    with pytest.raises(DataError, match=rf"do not cancel: on axis z a mean Earth rate of {left:.4g} deg/h"):
        four_position.calibrate_means(simulated(plan), plan)


def test_position_off_by_a_degree_is_refused():
    plan = plan_of(positions=((46, 316, "up"), *SET[1:]))
    with pytest.raises(DataError, match="do not cancel"):
        four_position.calibrate_means(simulated(plan), plan)


def test_other_sets_that_cancel_are_accepted():
    """Eight positions, the four at two base azimuths."""
    plan = plan_of(positions=SET + tuple((x + 20, y + 20, z) for x, y, z in SET))
    e = errors(four_position.calibrate_means(simulated(plan), plan))
    assert np.abs(e[3:]).max() < 1e-9


def test_table_angles_serve_as_well():
    segments = tuple(
        Segment(
            name=str(i),
            start=60.0 * i,
            stop=60.0 * i + 50,
            outer=np.radians(o),
            middle=np.radians(m),
            inner=np.radians(k),
        )
        for i, (o, m, k) in enumerate(((45, 0, 0), (45, 180, 0), (225, 180, 0), (225, 0, 0)))
    )
    plan = plan_of().model_copy(update={"segment": segments})
    means = simulated(plan_of())
    up = np.array([1, -1, -1, 1.0])
    found = four_position.calibrate_means(
        SegmentMeans(
            segments, means.mid_time, means.interval, means.duration, means.count,
            {"accel": np.outer(up, [0, 0, plan.site_gravity]) + BIAS["accel"]}, {"accel": np.full(3, np.nan)}, 0.0,
        ),
        plan,
    )  # fmt: skip
    assert found["accel.bias.y"].value == pytest.approx(BIAS["accel"][1], abs=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"z": "down"}, "left-handed"),
        ({"y_azimuth": 0.3}, "not 90 deg apart"),
        ({"z": None}, "gives no attitude"),
    ],
)
def test_impossible_attitudes_are_refused(change, said):
    plan = plan_of()
    segments = (plan.segment[0].model_copy(update=change), *plan.segment[1:])
    means = replace(simulated(plan), segments=segments)
    with pytest.raises(InputError, match=f"segment '1'.*{said}"):
        four_position.calibrate_means(means, plan)


def test_turning_segments_and_counts_are_refused():
    plan = plan_of()
    means = simulated(plan)
    turning = tuple(s.model_copy(update={"outer_rate": 0.1}) for s in plan.segment)
    with pytest.raises(DataError, match="static positions"):
        four_position.calibrate_means(replace(means, segments=turning), plan)
    with pytest.raises(InputError, match="--scale"):
        four_position.calibrate_means(replace(means, counts=frozenset({"accel"})), plan)
