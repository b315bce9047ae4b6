"""Means of segments: the numbers, their noise, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.earth import EARTH_RATE
from sagnac.errors import DataError
from sagnac.observe.means import segment_means
from sagnac.plan import Plan, Segment
from sagnac.recording import Batch, Recording, from_arrays, open_recording

RATE_HZ = 100.0
DT = 1 / RATE_HZ


def plan(*spans: tuple[float, float], outer_rate: float = 0.0) -> Plan:
    return Plan(
        segment=tuple(
            Segment(name=f"s{i}", start=a, stop=b, outer_rate=outer_rate) for i, (a, b) in enumerate(spans, 1)
        )
    )


def noisy(seconds: float, seed: int = 0, sigma: float = 0.01) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE_HZ)) * DT
    accel = np.array([0.1, -0.2, 9.8]) + sigma * rng.normal(size=(time.size, 3))
    return time, accel, sigma * rng.normal(size=(time.size, 3))


def in_pieces(recording: Recording, cuts: list[int]) -> Recording:
    """The same samples in other batches."""
    whole = recording.read()
    edges = [0, *sorted({c for c in cuts if 0 < c < whole.time.size}), whole.time.size]

    def stream(_: bool):
        for a, b in pairwise(edges):
            yield Batch(a + 1, whole.time[a:b], whole.accel[a:b], whole.gyro[a:b])

    return replace(recording, _stream=stream)


SPANS = [(0.0, 5.0), (6.0, 14.0), (20.0, 29.9)]


# ------------------------------------------------------------------------------------------------- the numbers


def test_means_are_those_of_numpy():
    time, accel, gyro = noisy(30)
    found = segment_means(from_arrays(time, accel, gyro), plan(*SPANS))
    assert found.names == ("s1", "s2", "s3")
    for i, (a, b) in enumerate(SPANS):
        here = (time >= a) & (time < b)
        assert found.count[i] == here.sum() == round((b - a) * RATE_HZ)
        np.testing.assert_allclose(found.mean["accel"][i], accel[here].mean(axis=0), rtol=1e-14)
        np.testing.assert_allclose(found.mean["gyro"][i], gyro[here].mean(axis=0), rtol=0, atol=1e-17)
        assert found.mid_time[i] == pytest.approx(time[here].mean(), rel=1e-14)
        assert found.interval[i] == pytest.approx(DT, rel=1e-12)
        assert found.duration[i] == pytest.approx(here.sum() * DT, rel=1e-12)
    assert found.span == (time[0], time[-1])
    assert found.remarks == ()
    assert not found.pulse


@given(st.lists(st.integers(1, 2999), max_size=40))
def test_means_do_not_depend_on_the_batches(cuts):
    time, accel, gyro = noisy(30)
    recording = from_arrays(time, accel, gyro)
    one, many = segment_means(recording, plan(*SPANS)), segment_means(in_pieces(recording, cuts), plan(*SPANS))
    for sensor, size in (("accel", 9.8), ("gyro", 0.05)):
        np.testing.assert_allclose(many.mean[sensor], one.mean[sensor], rtol=0, atol=4e-16 * size)
        np.testing.assert_allclose(many.density[sensor], one.density[sensor], rtol=1e-10)
    np.testing.assert_array_equal(many.count, one.count)
    # the sample interval is judged from the first batch, by sums of rounded times
    np.testing.assert_allclose(many.mid_time, one.mid_time, rtol=1e-14)
    np.testing.assert_allclose(many.duration, one.duration, rtol=1e-11)
    assert many.remarks == one.remarks


def test_samples_one_by_one():
    time, accel, gyro = noisy(3)
    recording = from_arrays(time, accel, gyro)
    single = segment_means(in_pieces(recording, list(range(time.size))), plan((0.5, 2.5)))
    np.testing.assert_allclose(
        single.mean["accel"], segment_means(recording, plan((0.5, 2.5))).mean["accel"], rtol=1e-15
    )


def test_a_start_belongs_to_its_segment_and_a_stop_does_not():
    time = np.arange(8) * 1.0
    accel = np.repeat(time[:, None], 3, axis=1)
    found = segment_means(from_arrays(time, accel), plan((1, 3), (3, 6)))
    assert found.count.tolist() == [2, 3]
    assert found.mean["accel"][:, 0].tolist() == [1.5, 4.0]


def test_a_large_offset_costs_no_digits():
    # a mean of 1e6 counts with noise of one: the mean is right to rounding of 1e6
    rng = np.random.default_rng(1)
    time = np.arange(2000) * DT
    accel = 1e6 + rng.normal(size=(2000, 3))
    found = segment_means(from_arrays(time, accel, counts=("accel",)), plan((0, 20)))
    np.testing.assert_allclose(found.mean["accel"][0], [math.fsum(c) / 2000 for c in accel.T], rtol=3e-16)
    assert found.counts == {"accel"}


def test_time_since_an_epoch():
    time, accel, gyro = noisy(30)
    start = 1.7e9  # seconds since 1970: steps are rounded to 2e-7 s
    shifted = segment_means(from_arrays(time + start, accel, gyro), plan(*[(a + start, b + start) for a, b in SPANS]))
    assert shifted.mid_time - start == pytest.approx(
        segment_means(from_arrays(time, accel), plan(*SPANS)).mid_time, abs=5e-7
    )
    assert shifted.interval == pytest.approx(np.full(3, DT), rel=1e-6)


# -------------------------------------------------------------------------------------------------- pulses


def pulse_log(path, increments: np.ndarray, dt: float = 0.1):
    lines = ["time [s],gyro_x [pulse],gyro_y [pulse],gyro_z [pulse]"]
    lines += [f"{(i + 1) * dt!r},{n},{n},{n}" for i, n in enumerate(increments.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return open_recording(path, scale={"gyro": "2 pulse/arcsec"})


def test_pulses_belong_to_the_interval_before_their_time_stamp(tmp_path):
    # Samples stamped 0.1, 0.2, ... 2.0 hold the pulses of the tenth before: the segment from 0.5 to 1.0 has those
    # stamped 0.6, 0.7, 0.8, 0.9 and 1.0, whose middle is 0.75.
    counts = np.arange(1, 21)
    found = segment_means(pulse_log(tmp_path / "log.csv", counts), plan((0.5, 1.0)))
    assert found.count.tolist() == [5]
    assert found.mid_time[0] == pytest.approx(0.75, abs=1e-12)
    arcsec = math.pi / 648000
    assert found.mean["gyro"][0, 0] == pytest.approx(counts[5:10].mean() / 2 * arcsec / 0.1, rel=1e-12)


def test_the_worth_of_a_pulse_and_what_it_does_to_a_mean(tmp_path):
    rng = np.random.default_rng(3)
    counts = rng.integers(100, 110, 400)
    found = segment_means(pulse_log(tmp_path / "log.csv", counts), plan((0, 20), (20, 40)))
    half_arcsec = 0.5 * math.pi / 648000
    np.testing.assert_allclose(found.pulse["gyro"], half_arcsec, rtol=1e-9)
    # uniform residues of one pulse at both ends: 2 / 12 pulse^2 over the time squared
    np.testing.assert_allclose(found.variance("gyro", np.zeros(3)), half_arcsec**2 / 6 / 20**2, rtol=1e-9)


# ---------------------------------------------------------------------------------------------- noise density


def white_densities(
    runs: int, seconds: float, density: float, outer_rate: float = 0.0, level: float = 0.0, hz: float = 50.0
) -> np.ndarray:
    rng = np.random.default_rng(8)
    time = np.arange(round(seconds * hz)) / hz
    wave = level * np.column_stack([np.cos(outer_rate * time), np.sin(outer_rate * time), np.ones_like(time)])
    out = []
    for _ in range(runs):
        gyro = wave + density * math.sqrt(hz) * rng.normal(size=(time.size, 3))
        out.append(segment_means(from_arrays(time, gyro=gyro), plan((0, seconds), outer_rate=outer_rate)))
    assert {m.noise_degrees_of_freedom for m in out} == {12.0 if outer_rate else 14.0}
    return np.array([m.density["gyro"] for m in out])


@pytest.mark.parametrize("outer_rate", [0.0, math.radians(10)])
def test_density_of_white_noise_is_unbiased(outer_rate):
    # 16 blocks less 2 (or 4) fitted terms: density^2 is chi-square with d = 14 (or 12) degrees of freedom over d. The
    # mean of 300 such on 3 axes has the relative standard deviation sqrt(2 / (900 d)) = 1.26 % (1.36 %); four of them.
    found = white_densities(300, 36.0, 2e-5, outer_rate)
    d = 12 if outer_rate else 14
    assert np.mean(found**2) == pytest.approx(4e-10, rel=4 * math.sqrt(2 / (900 * d)))
    assert np.std(found**2) / 4e-10 == pytest.approx(math.sqrt(2 / d), rel=0.15)  # and its spread, for 900 of them


@pytest.mark.parametrize(
    ("seconds", "hz"),
    [(36.0, 100.0), (36.0, 20.0), (37.0, 10.0), (360.0, 1.0)],
)
def test_density_is_not_fooled_by_the_earth_rate_of_a_turning_segment(seconds, hz):
    # The level Earth rate at 45 deg comes round as 5e-5 rad/s, a thousand times the noise of a block mean. What may
    # be left of it is second order in the turn of one block (22.5 deg): far below the spread of one estimate, 20 %.
    quiet, turning = (
        np.sqrt(np.mean(white_densities(20, seconds, 6e-8, math.radians(10), level, hz) ** 2))
        for level in (0.0, EARTH_RATE * math.sqrt(0.5))
    )
    assert turning == pytest.approx(quiet, rel=0.02)


def test_density_is_not_fooled_by_a_drift():
    rng = np.random.default_rng(9)
    time = np.arange(5000) * DT
    noise = 0.01 * rng.normal(size=(5000, 3))
    still = segment_means(from_arrays(time, noise), plan((0, 50)))
    drifting = segment_means(from_arrays(time, noise + 0.1 * time[:, None]), plan((0, 50)))
    np.testing.assert_allclose(drifting.density["accel"], still.density["accel"], rtol=1e-9)


def test_variance_of_a_mean_is_density_squared_over_time():
    time, accel, gyro = noisy(30)
    found = segment_means(from_arrays(time, accel, gyro), plan(*SPANS))
    expected = np.outer(1 / np.array([5, 8, 9.9]), np.array([1.0, 4.0, 9.0]))
    np.testing.assert_allclose(found.variance("accel", np.array([1.0, 2.0, 3.0])), expected, rtol=1e-9)


def test_too_few_samples_for_a_density():
    time = np.arange(20) * 0.1
    found = segment_means(from_arrays(time, np.zeros((20, 3))), plan((0, 1), (1, 2)))
    assert found.noise_degrees_of_freedom == 0
    assert np.isnan(found.density["accel"]).all()


def test_a_restless_segment_is_named():
    time, accel, gyro = noisy(60)
    rng = np.random.default_rng(4)
    shaken = (time >= 20) & (time < 30)
    slow = np.repeat(rng.normal(size=20), 50) * 0.02  # half-second steps of 20 mm/s^2, twenty times a block's noise
    gyro[shaken, 1] += slow
    spans = [(10.0 * i, 10.0 * i + 9.99) for i in range(6)]
    found = segment_means(from_arrays(time, accel, gyro), plan(*spans))
    (remark,) = found.remarks
    assert remark.startswith("segment 's3' is restless: gyro_y has ")


def test_quiet_segments_are_not_called_restless():
    # 40 recordings of 6 segments and 6 axes: 1440 chances to be wrong
    spans = [(5.0 * i, 5.0 * i + 5) for i in range(6)]
    remarks = [r for seed in range(40) for r in segment_means(from_arrays(*noisy(30.1, seed)), plan(*spans)).remarks]
    assert not remarks


# ------------------------------------------------------------------------------------------- what is refused


def test_a_plan_without_segments():
    with pytest.raises(DataError, match=r"the plan has no \[\[segment\]\]"):
        segment_means(from_arrays(*noisy(1)), Plan())


def test_a_recording_without_samples():
    with pytest.raises(DataError, match="mine: the recording holds no samples"):
        segment_means(from_arrays([], np.zeros((0, 3)), name="mine"), plan((0, 1)))


@pytest.mark.parametrize(("a", "b"), [(-5, 2), (28, 31), (40, 50), (-9, -8)])
def test_segments_outside_the_data(a, b):
    with pytest.raises(DataError) as caught:
        segment_means(from_arrays(*noisy(30), name="mine"), plan((5, 6), (a, b)))
    said = str(caught.value)
    assert f"segment 's2' ({a:g} s to {b:g} s) lies outside the data of mine (0 s to 29.99 s, " in said
    assert "check the plan's times" in said


def test_a_segment_inside_a_gap():
    time, accel, gyro = noisy(30)
    keep = (time < 10) | (time > 20)
    with pytest.raises(DataError, match=r"segment 's1' \(12 s to 15 s\) lies outside the data of .*0 samples"):
        segment_means(from_arrays(time[keep], accel[keep], gyro[keep]), plan((12, 15)))


def test_a_segment_may_end_with_the_last_sample():
    # the last sample at 29.99 s stands for the time to 30 s
    assert segment_means(from_arrays(*noisy(30)), plan((20, 30))).count.tolist() == [1000]


@pytest.mark.parametrize(("side", "sign"), [("top", 1), ("bottom", -1)])
@pytest.mark.parametrize("cuts", [[], [2100, 2200, 2950]])
def test_a_saturated_axis(side, sign, cuts):
    time, accel, gyro = noisy(30)
    here = (time >= 20) & (time < 24)
    gyro[here, 2] = 0.5 * sign  # 400 of 990 samples
    with pytest.raises(DataError) as caught:
        segment_means(in_pieces(from_arrays(time, accel, gyro, name="mine"), cuts), plan(*SPANS))
    said = str(caught.value)
    assert f"gyro_z is saturated in segment 's3': 400 of 990 samples stand exactly at the {side} of its range" in said
    assert f"({0.5 * sign:g})" in said


def test_a_saturated_axis_that_clips_its_noise():
    time, accel, gyro = noisy(30)
    here = (time >= 20) & (time < 30)
    accel[here, 0] = np.minimum(accel[here, 0] + 1.0, 1.1)  # about half of the samples above the range
    with pytest.raises(DataError, match=r"accel_x is saturated in segment 's3': \d+ of 990 samples .* at the top"):
        segment_means(from_arrays(time, accel, gyro), plan(*SPANS))


def test_a_stuck_axis():
    time, accel, gyro = noisy(30)
    here = (time >= 6) & (time < 14)
    accel[here, 1] = -0.2  # amid the range of the axis, not at an end of it
    with pytest.raises(DataError, match=r"accel_y is stuck at -0\.2 through segment 's2'"):
        segment_means(from_arrays(time, accel, gyro), plan(*SPANS))


@pytest.mark.parametrize("step", [0.0, 0.01, 0.02, 0.05, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_quantised_data_are_not_refused(step, seed):
    # noise of 0.01 behind a converter with steps of up to a hundred times that, or with none
    time, accel, gyro = noisy(30, seed)
    if step:
        accel, gyro = step * np.round(accel / step), step * np.round(gyro / step)
    found = segment_means(from_arrays(time, accel, gyro), plan(*SPANS))
    assert np.isfinite(found.mean["accel"]).all()


def test_constant_data_are_not_refused():
    # a simulation without noise: six positions, each reading constant
    time = np.arange(600) * 0.1
    accel = np.repeat(9.8 * np.vstack([np.eye(3), -np.eye(3)]), 100, axis=0)
    found = segment_means(from_arrays(time, accel), plan(*[(10 * i, 10 * i + 10) for i in range(6)]))
    np.testing.assert_allclose(found.mean["accel"], 9.8 * np.vstack([np.eye(3), -np.eye(3)]), rtol=1e-15)
    assert found.density["accel"].tolist() == [0, 0, 0]


def test_a_single_touch_of_the_extreme_is_no_saturation():
    time, accel, gyro = noisy(30)
    gyro[2500, 2] = 5.0  # one spike
    segment_means(from_arrays(time, accel, gyro), plan(*SPANS))


# ---------------------------------------------------------------------------------------------------- gaps


@pytest.mark.parametrize("cuts", [[], [700], [751, 760], list(range(0, 2000, 7))])
def test_gaps_are_told(cuts):
    time, accel, gyro = noisy(30)
    keep = (time < 7.5 - DT / 2) | (time > 9 - DT / 2)  # 7.50 to 8.99 s lost
    recording = in_pieces(from_arrays(time[keep], accel[keep], gyro[keep]), cuts)
    found = segment_means(recording, plan(*SPANS))
    assert found.remarks == ("gap of 1.51 s at 7.49 s in segment 's2': excluded",)
    assert found.count.tolist() == [500, 650, 990]
    np.testing.assert_allclose(found.mean["accel"][1], accel[keep & (time >= 6) & (time < 14)].mean(axis=0), rtol=1e-14)


def test_a_gap_does_not_shorten_the_sample_interval():
    time, accel, gyro = noisy(30)
    keep = (time < 7.5 - DT / 2) | (time > 9 - DT / 2)
    found = segment_means(from_arrays(time[keep], accel[keep], gyro[keep]), plan(*SPANS))
    np.testing.assert_allclose(found.interval, DT, rtol=1e-9)
    np.testing.assert_allclose(found.duration, [5, 6.5, 9.9], rtol=1e-9)


def test_gaps_outside_the_segments_do_not_matter():
    time, accel, gyro = noisy(30)
    keep = (time < 15) | (time > 19)
    assert segment_means(from_arrays(time[keep], accel[keep], gyro[keep]), plan(*SPANS)).remarks == ()


def test_a_change_of_temperature_is_noted():
    time = np.arange(0.0, 20.0, 0.1)
    noise = np.random.default_rng(1).standard_normal((time.size, 3))
    for change, noted in ((2.0, False), (15.0, True)):
        warm = from_arrays(time, accel=noise, rig={"temperature": 290.0 + change * time / 20.0})
        remarks = segment_means(warm, plan((0, 10), (10, 19))).remarks
        assert any("temperature changed by 15 K" in r for r in remarks) is noted
