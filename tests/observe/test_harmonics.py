"""Harmonics of turning segments: their numbers, pulses, the column of the angle, samples in memory."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from turning import DT, RATE, in_pieces, noisy, plan, same, wave

from plain import block_harmonics, harmonics
from sagnac.errors import DataError
from sagnac.observe.harmonics import harmonics_of, segment_harmonics
from sagnac.recording import from_arrays, open_recording

# --------------------------------------------------------------------------------------------- the numbers


@pytest.mark.parametrize(
    ("turns", "order", "extended"),
    [
        *((t, h, False) for t in (10.0, 3.37, 1.0, 0.8) for h in (1, 3, 4, 7)),
        *((t, h, True) for t in (10.0, 3.37, 1.6) for h in (1, 3, 4)),
        (10.0, 7, True),
        (0.8, 1, True),
        (0.3, 2, False),
    ],
)
@pytest.mark.parametrize("rate", [RATE, -0.7 * RATE])
def test_coefficients_are_those_of_plain_least_squares(rate, turns, order, extended):
    seconds = 2 * math.pi * turns / abs(rate)
    time, values, _ = noisy(seconds + 1, rate=rate, start=2.0)
    found = segment_harmonics(
        from_arrays(time, values), plan((2.3, 2.3 + seconds, rate, 0.4 + 0.3 * rate)), order=order, extended=extended
    )
    here = (time >= 2.3) & (time < 2.3 + seconds)
    same(found, 0, time[here], values[here], 0.4 + rate * (time[here] - 2.0), order, extended=extended)
    assert found.count[0] == here.sum()
    assert found.extended is extended
    assert found.mid_time[0] == pytest.approx(time[here].mean(), rel=1e-14)
    assert found.phase[0] == pytest.approx(0.4 + rate * (found.mid_time[0] - 2.0), rel=1e-13)
    assert found.rate[0] == rate
    assert found.interval[0] == pytest.approx(DT, rel=1e-9)
    assert found.duration[0] == pytest.approx(here.sum() * DT, rel=1e-9)
    assert np.isnan([found.measured_rate[0], found.rate_sigma[0]]).all()
    assert not found.arm_known.any()


def test_all_axes_of_all_sensors_in_standard_order():
    time, values, truth = noisy(20, sigma=0.0, axes=5)
    recording = from_arrays(time, gyro=values[:, 2:], single={"accel_z": values[:, 1], "accel_x": values[:, 0]})
    found = segment_harmonics(recording, plan((0.0, 20.0, RATE, 0.4)))
    assert found.axes == ("accel_x", "accel_z", "gyro_x", "gyro_y", "gyro_z")
    np.testing.assert_allclose(found.coefficient[0], truth, rtol=0, atol=1e-11)
    assert found.names == ("s1",)
    assert found.span == (time[0], time[-1])
    assert found.remarks == ()


def test_one_accelerometer_from_a_file(tmp_path):
    time, values, truth = noisy(10, sigma=0.0, axes=1)
    lines = [f"{t!r},{v!r}" for t, v in zip(time.tolist(), values[:, 0].tolist(), strict=True)]
    (tmp_path / "log.csv").write_text("time [s],accel_z [m/s^2]\n" + "\n".join(lines) + "\n")
    found = segment_harmonics(open_recording(tmp_path / "log.csv"), plan((0.0, 10.0, RATE, 0.4)))
    assert found.axes == ("accel_z",)
    np.testing.assert_allclose(found.coefficient[0], truth, rtol=0, atol=1e-11)


def test_without_a_phase_the_angle_counts_from_the_start():
    time, values, _ = noisy(20)
    found = segment_harmonics(from_arrays(time, values), plan((5.0, 20.0, RATE)))
    here = time >= 5.0
    same(found, 0, time[here], values[here], RATE * (time[here] - 5.0))
    assert found.phase[0] == pytest.approx(RATE * (found.mid_time[0] - 5.0), rel=1e-13)


@given(st.lists(st.integers(1, 29_999), max_size=30), st.booleans())
def test_the_batches_do_not_matter(cuts, extended):
    time, values, _ = noisy(30)
    spans = plan((0.0, 7.0, RATE, 0.4), (7.0, 16.1, RATE, 0.4 + 7 * RATE), (20.5, 29.0, RATE))
    recording = from_arrays(time, values[:, :3], single={"gyro_z": values[:, 0] * 1e-3})
    one, many = (segment_harmonics(r, spans, extended=extended) for r in (recording, in_pieces(recording, cuts)))
    np.testing.assert_array_equal(many.count, one.count)
    size = np.abs(one.coefficient).max(axis=2, keepdims=True)
    np.testing.assert_allclose(many.coefficient / size, one.coefficient / size, rtol=0, atol=1e-13)
    np.testing.assert_allclose(many.unit_covariance, one.unit_covariance, rtol=0, atol=1e-15)
    np.testing.assert_allclose(many.residual_variance, one.residual_variance, rtol=1e-6)
    np.testing.assert_allclose(many.density, one.density, rtol=1e-6)
    np.testing.assert_allclose(many.mid_time, one.mid_time, rtol=1e-14)
    assert many.remarks == one.remarks


def test_samples_one_by_one():
    time, values, _ = noisy(3)
    recording = in_pieces(from_arrays(time, values), list(range(time.size)))
    found = segment_harmonics(recording, plan((0.5, 2.9, RATE, 0.4)), order=2)
    here = (time >= 0.5) & (time < 2.9)
    same(found, 0, time[here], values[here], 0.4 + RATE * (time[here] - 0.5), 2)


@pytest.mark.parametrize("extended", [False, True])
@pytest.mark.parametrize("jitter", [1e-12, 1e-9, 1e-5, 4e-4])
def test_jittered_times_are_taken_as_they_are(jitter, extended):
    rng = np.random.default_rng(2)
    clock = np.arange(20_000) * DT
    clock[5000:15000] += jitter * rng.uniform(-1, 1, 10_000)  # even, jittered, even again
    time, values, _ = noisy(20, clock=clock)
    found = segment_harmonics(from_arrays(time, values), plan((0.0, 20.0, RATE, 0.4)), extended=extended)
    same(found, 0, time[time < 20], values[time < 20], 0.4 + RATE * time[time < 20], extended=extended)


@pytest.mark.parametrize("start", [1e5, 1.7e9])
def test_time_since_an_epoch(start):
    """Stamps rounded to 1.5e-11 s, which does not matter to the phase, and to 2e-7 s, which are taken as they are."""
    time, values, _ = noisy(20, start=start)
    found = segment_harmonics(from_arrays(time, values), plan((start, start + 20.0, RATE, 0.4)))
    same(found, 0, time, values, 0.4 + RATE * (time - start), within=2e-11 if start == 1e5 else 1e-12)


def test_a_clock_that_drifts():
    time, values, _ = noisy(20, clock=(np.arange(20_000) * DT) * (1 + 1e-5 * np.arange(20_000) * DT))
    here = time < 20.0
    found = segment_harmonics(from_arrays(time, values), plan((0.0, 20.0, RATE, 0.4)))
    same(found, 0, time[here], values[here], 0.4 + RATE * time[here])


def test_another_interval_in_each_segment():
    clock = np.concatenate([np.arange(5000) * 1e-3, 10 + np.arange(5000) * 3e-3, 30 + np.arange(2000) * 5e-4])
    time, values, _ = noisy(0, clock=clock)
    found = segment_harmonics(
        from_arrays(time, values), plan(*[(a, b, RATE, 0.4 + a * RATE) for a, b in ((0.0, 4.9), (10.0, 24.9), (30.0, 30.99))]),
        order=1,
    )  # fmt: skip
    for i, s in enumerate(found.segments):
        here = (time >= s.start) & (time < s.stop)
        same(found, i, time[here], values[here], 0.4 + RATE * time[here], 1)
    np.testing.assert_allclose(found.interval, [1e-3, 3e-3, 5e-4], rtol=1e-9)


@pytest.mark.parametrize("cuts", [[], [6000], [6100, 6900, 7000, 7001], list(range(100, 29_000, 977))])
def test_gaps_are_exact_and_told(cuts):
    time, values, _ = noisy(30)
    keep = (time < 6.5) | (time > 8.2)
    time, values = time[keep], values[keep]
    found = segment_harmonics(in_pieces(from_arrays(time, values), cuts), plan((2.0, 16.0, RATE, 0.4 + 2 * RATE)))
    here = (time >= 2) & (time < 16)
    same(found, 0, time[here], values[here], 0.4 + RATE * time[here])
    assert found.remarks == ("gap of 1.7 s at 6.499 s in segment 's1': excluded",)
    assert found.interval[0] == pytest.approx(DT, rel=1e-3)


def test_a_large_offset_costs_no_digits():
    # a mean of 1e8 counts and a wave of ten: the wave is right to the rounding of the mean, 1.5e-8 for each sample
    time, values, truth = noisy(20, sigma=0.0, offset=1e8, size=10.0)
    found = segment_harmonics(from_arrays(time, values, counts=("accel",)), plan((0.0, 20.0, RATE, 0.4)))
    assert np.all(np.abs(found.coefficient[0] - truth)[:, 1:] < 5 * 1.5e-8 * math.sqrt(2 / 20_000))
    assert found.counts == {"accel"}


def test_a_static_segment_has_its_mean():
    time, values, _ = noisy(20)
    values[:5000] = 1.0 + 0.01 * np.random.default_rng(3).normal(size=(5000, 3))
    found = segment_harmonics(
        from_arrays(time, values), plan((0.0, 5.0, 0.0, 1.0), (5.0, 20.0, RATE, 0.0)), extended=True
    )
    np.testing.assert_allclose(found.coefficient[0, :, 0], values[:5000].mean(axis=0), rtol=1e-14)
    assert np.all(found.coefficient[0, :, 1:] == 0)
    assert found.unit_covariance[0, 0, 0] == pytest.approx(1 / 5000, rel=1e-14)
    assert np.all(np.isinf(np.diag(found.unit_covariance[0])[1:]))
    assert found.rate.tolist() == [0.0, RATE]
    assert found.phase[0] == 1.0
    assert found.condition[0] == 1.0


def test_the_extended_form_carries_a_small_error_of_the_rate():
    """Coefficients of a wave at another rate: c and i h dw c, up to (h dw tau)^2 / 2 of the harmonics."""
    faster, seconds = 2e-5, 40.0
    time = np.arange(round(seconds / DT)) * DT
    middle = time.mean()
    values, truth = wave(RATE * middle + (RATE + faster) * (time - middle), offset=0.0, size=1.0)
    found = segment_harmonics(from_arrays(time, values), plan((0.0, seconds, RATE, 0.0)), extended=True)
    assert found.phase[0] == pytest.approx(RATE * middle, rel=1e-14)
    c = found.coefficient[0]
    left = 8 * (faster * seconds / 2) ** 2  # (4 dw tau)^2 / 2 at the ends
    np.testing.assert_allclose(c[:, :9], truth, rtol=0, atol=left)
    pairs = truth[:, 1:].reshape(3, 4, 2)
    turned = faster * np.arange(1, 5)[:, None] * pairs[:, :, ::-1] * [1, -1]
    np.testing.assert_allclose(c[:, 9:].reshape(3, 4, 2), turned, rtol=0, atol=left / 10)
    without = segment_harmonics(from_arrays(time, values), plan((0.0, seconds, RATE, 0.0)))
    assert np.abs(without.coefficient[0] - truth).max() > 3 * left


# --------------------------------------------------------------------------------------- pulses and columns


def test_counted_pulses_are_the_mean_over_the_interval_before(tmp_path):
    """20 Hz, 1.5 rad/s, three harmonics: the mean over an interval is off by up to 0.8 %, and half an interval late."""
    dt, rate = 0.05, 1.5
    stamps = np.arange(1, 2001) * dt
    h = np.arange(1, 4)
    angle = 0.4 + rate * np.stack([stamps - dt, stamps])
    # integral of 2 + sum of cos h th / h + sin h th over each interval
    whole = (np.sin(h * angle[..., None]) / h - np.cos(h * angle[..., None])) / (h * rate)
    counts = (2.0 * dt + (whole[1] - whole[0]).sum(axis=1)) * 1000.0
    lines = [f"{t!r},{c!r},{c!r},{c!r}" for t, c in zip(stamps.tolist(), counts.tolist(), strict=True)]
    header = "time [s]," + ",".join(f"gyro_{a} [pulse]" for a in "xyz")
    (tmp_path / "log.csv").write_text(header + "\n" + "\n".join(lines) + "\n")
    recording = open_recording(tmp_path / "log.csv", scale={"gyro": "1000 pulse/rad"})
    for extended in (False, True):
        found = segment_harmonics(recording, plan((0.0, 100.0, rate, 0.4)), order=3, extended=extended)
        expected = [2.0, 1.0, 1.0, 0.5, 1.0, 1 / 3, 1.0]
        np.testing.assert_allclose(found.coefficient[0, :, :7], np.tile(expected, (3, 1)), rtol=0, atol=1e-11)
        assert found.mid_time[0] == pytest.approx(50.0, abs=1e-9)
        less = np.sinc(3 * rate * dt / 2 / math.pi)
        assert found.unit_covariance[0, 5, 5] == pytest.approx(2 / 2000 / less**2, rel=0.02 if extended else 1e-2)


@pytest.mark.parametrize("cuts", [[], list(range(37, 20_000, 1000))])
@pytest.mark.parametrize("extended", [False, True])
def test_the_arm_column_is_the_angle(cuts, extended):
    time = np.arange(20_000) * DT
    arm = 0.4 + RATE * time + 0.05 * np.sin(0.9 * time)  # it wobbles
    values, _ = wave(arm)
    values += 0.01 * np.random.default_rng(4).normal(size=values.shape)
    recording = in_pieces(from_arrays(time, values, rig={"arm": arm % (2 * math.pi)}), cuts)
    # the phase of the plan, and its rate, which is a little off, do not count
    found = segment_harmonics(recording, plan((3.0, 19.0, 1.01 * RATE, 2.0)), extended=extended, rate="estimate")
    here = (time >= 3) & (time < 19)
    same(found, 0, time[here], values[here], arm[here], extended=extended)
    slope, level = np.polyfit(time[here] - time[here].mean(), arm[here], 1)
    assert found.arm_known.all()
    assert found.rate[0] == found.measured_rate[0] == pytest.approx(slope, rel=1e-10)
    assert math.remainder(found.phase[0] - level, 2 * math.pi) == pytest.approx(0, abs=1e-9)
    rest = arm[here] - level - slope * (time[here] - time[here].mean())
    assert found.rate_sigma[0] == pytest.approx(rest.std() / math.sqrt(here.sum()) / time[here].std(), rel=1e-3)


@pytest.mark.parametrize("true", [-RATE, 0.97 * RATE])
def test_an_arm_that_turns_otherwise_is_told(true):
    time = np.arange(20_000) * DT
    arm = 0.4 + true * time
    values, truth = wave(arm)
    noise = 0.01 * np.random.default_rng(4).normal(size=values.shape)
    recording = from_arrays(time, values + noise, rig={"arm": np.angle(np.exp(1j * arm))})
    found = segment_harmonics(recording, plan((0.0, 20.0, RATE, 0.4)))
    assert found.measured_rate[0] == pytest.approx(true, rel=1e-12)
    assert found.rate_sigma[0] < 1e-12
    assert found.segments[0].arm_rate == RATE
    np.testing.assert_allclose(found.coefficient[0], truth, rtol=0, atol=1e-3)


def test_an_arm_that_turns_in_a_static_segment_is_told():
    time, values, _ = noisy(20)
    recording = from_arrays(time, values, rig={"arm": 0.4 + RATE * time})
    found = segment_harmonics(recording, plan((0.0, 10.0, 0.0), (10.0, 20.0, RATE)))
    np.testing.assert_allclose(found.measured_rate, [RATE, RATE], rtol=1e-12)
    assert found.rate.tolist() == [0.0, pytest.approx(RATE)]


def test_an_arm_that_stands_still_is_refused():
    time, values, _ = noisy(20)
    with pytest.raises(DataError, match=r"segment 's1' shows .* turns, too little .* look at the arm column"):
        segment_harmonics(from_arrays(time, values, rig={"arm": np.full(time.size, 0.3)}), plan((0.0, 20.0, RATE)))


# ------------------------------------------------------------------------------------------ samples in memory


@pytest.mark.parametrize("count", [250, 5000, 60_000, 1_000_000])
@pytest.mark.parametrize("rate", [0.9, -40.0])
def test_samples_in_memory(count, rate):
    step = 1e-3 if count > 5000 or rate < 0 else 0.05
    angle = 0.3 + rate * step * np.arange(count)
    values, truth = wave(angle, axes=2)
    found = harmonics_of(values, step, rate, order=4, phase=0.3)
    np.testing.assert_allclose(found.coefficient, truth, rtol=0, atol=1e-12 * 50 * max(found.condition, 1.0))
    one = harmonics_of(values[:, 0], step, rate, order=4, phase=0.3, extended=True)
    assert one.coefficient.shape == (1, 17)
    np.testing.assert_allclose(one.coefficient[0, :9], truth[0], rtol=0, atol=1e-12 * 50 * max(one.condition, 1.0))


def test_the_plain_block_form_gives_the_same():
    values = np.random.default_rng(0).normal(size=10_007)
    expected = harmonics(values[:, None], RATE * DT * np.arange(10_007), 3)[0][0]
    np.testing.assert_allclose(harmonics_of(values, DT, RATE).coefficient[0], expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(block_harmonics(values, DT, RATE, 3), expected, rtol=0, atol=1e-14)


def test_samples_in_memory_that_do_not_do():
    with pytest.raises(DataError, match=r"20 samples over 0\.00907 turns do not determine DC and 3 harmonics"):
        harmonics_of(np.zeros(20), DT, RATE)
    with pytest.raises(DataError, match="5 samples .* do not determine"):
        harmonics_of(np.zeros(5), 0.1, RATE)
