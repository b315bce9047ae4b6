"""The rate found in the samples: at its bound, from far away, or refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.errors import DataError
from sagnac.observe.harmonics import rate_of, segment_harmonics
from sagnac.plan import Plan, Rig, Segment
from sagnac.recording import from_arrays, open_recording

RATE = 3.0
AMPLITUDE = np.array([1.0, 0.1, 0.05, 0.01])
H = np.arange(1, 5)


def signal(time, rate, *, axes=2, order=4, offset=3.0):
    """DC and harmonics with phases of their own on each axis; the second axis has half the amplitudes."""
    angle = rate * time[:, None] * H[:order]
    return np.stack(
        [offset + np.cos(angle + H[:order] + a) @ (AMPLITUDE[:order] / (1 + a)) for a in range(axes)], axis=1
    )


def bound(count, dt, sigma, *, axes=2, order=4):
    """Cramer-Rao bound of the rate over many turns: 1 / sqrt(sum (h A)^2 / 2 sigma^2 * n T^2 / 12), T = n dt."""
    information = sum(((H[:order] * AMPLITUDE[:order] / (1 + a)) ** 2).sum() for a in range(axes)) / (2 * sigma**2)
    return 1.0 / math.sqrt(information * count * (count * dt) ** 2 / 12)


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("turns", "error"), [(5, 1e-4), (40, 1e-4), (40, -0.01), (40, 0.019), (1500, 1e-4), (1500, 0.01), (1500, -0.019)]
)
@pytest.mark.parametrize("order", [1, 4])
def test_the_rate_is_found_at_its_bound(turns, error, order):
    """100 runs each: the scatter over the bound is within 4 / sqrt(2 * 100) of one, the mean within four standard errors."""
    count, sigma, runs = 20_000 if turns > 100 else 2000, 0.02, 100
    dt = 2 * math.pi * turns / RATE / count
    time = np.arange(count) * dt
    rng = np.random.default_rng(turns)
    clean = signal(time, RATE * (1 + error), order=order)
    least = bound(count, dt, sigma, order=order)
    found = [rate_of(clean + sigma * rng.normal(size=clean.shape), dt, RATE, order=order) for _ in range(runs)]
    z = (np.array([f.rate for f in found]) - RATE * (1 + error)) / least
    assert abs(z.mean()) < 4 / math.sqrt(runs)
    assert z.std() == pytest.approx(1.0, abs=4 / math.sqrt(2 * runs) + (0.03 if turns < 10 else 0.0))
    # five turns are not whole turns of the true rate: DC and harmonics are a little correlated
    assert np.median([f.sigma for f in found]) == pytest.approx(least, rel=0.05 if turns < 10 else 0.02)


def segments(*rows):
    named = [Segment(name=f"s{i}", start=a, stop=b, arm_rate=w) for i, (a, b, w) in enumerate(rows, 1)]
    return Plan(rig=Rig(kind="centrifuge", radius=1.0), segment=tuple(named))


def test_each_segment_has_a_rate_of_its_own():
    dt, sigma = 2e-3, 0.01
    time = np.arange(100_000) * dt
    true = [0.0, RATE * 1.0001, -2 * RATE * 1.01, 0.5 * RATE * 0.985]
    edges = [0.0, 20.0, 80.0, 140.0, 200.0]
    values = np.zeros((time.size, 3))
    for a, b, w in zip(edges[:-1], edges[1:], true, strict=True):
        here = (time >= a) & (time < b)
        values[here] = signal(time[here] - a, w, axes=3)
    values += sigma * np.random.default_rng(1).normal(size=values.shape)
    spans = segments((0, 20, 0.0), (20, 80, RATE), (80, 140, -2 * RATE), (140, 200, 0.5 * RATE))
    found = segment_harmonics(from_arrays(time, values), spans, rate="estimate")
    least = bound(30_000, dt, sigma, axes=3)
    assert np.isnan(found.measured_rate[0])
    assert np.isnan(found.rate_sigma[0])
    assert found.rate[0] == 0.0
    assert np.all(np.abs(found.rate[1:] - true[1:]) < 4 * least)
    np.testing.assert_array_equal(found.rate[1:], found.measured_rate[1:])
    np.testing.assert_allclose(found.rate_sigma[1:], least, rtol=0.05)
    assert found.remarks == ()
    # the angle is zero at the start of each segment
    np.testing.assert_allclose(found.phase[1:], found.rate[1:] * (found.mid_time[1:] - edges[1:-1]), rtol=1e-12)
    first = found.coefficient[1, 0, 1:3]
    assert math.hypot(*first) == pytest.approx(1.0, abs=4e-3)
    # nothing is left of the error: the terms in tau are zero within their uncertainty
    extended = segment_harmonics(from_arrays(time, values), spans, rate="estimate", extended=True)
    for i in (1, 2, 3):
        z = extended.coefficient[i, :, 9:] / sigma / np.sqrt(np.diag(extended.unit_covariance[i])[9:])
        assert np.abs(z).max() < 4.5
    np.testing.assert_array_equal(extended.rate, found.rate)


@pytest.mark.parametrize("turns", [1.3, 2.2, 3.1, 6.0])
@pytest.mark.parametrize("error", [0.0, 0.01, -0.02])
def test_few_turns(turns, error):
    dt = 1e-3
    count = round(2 * math.pi * turns / RATE / dt)
    values = signal(np.arange(count) * dt, RATE * (1 + error), order=2)
    found = rate_of(values + 1e-3 * np.random.default_rng(2).normal(size=values.shape), dt, RATE, order=2)
    assert abs(found.rate - RATE * (1 + error)) < 4 * found.sigma
    assert found.sigma < (40 if turns < 2 else 3) * bound(count, dt, 1e-3, order=2)


def test_noise_free_samples():
    values = signal(np.arange(50_000) * 1e-3, RATE * 1.005)
    found = rate_of(values, 1e-3, RATE, order=4)
    assert found.rate == pytest.approx(RATE * 1.005, rel=1e-12)


def test_a_dead_axis_and_a_weak_one_do_no_harm():
    rng = np.random.default_rng(3)
    values = signal(np.arange(50_000) * 1e-3, RATE * 1.005, axes=3)
    values[:, 2] = 1.0
    values[:, 1] = 1e6 * rng.normal(size=50_000)
    values[:, 0] += 0.01 * rng.normal(size=50_000)
    found = rate_of(values, 1e-3, RATE, order=4)
    assert abs(found.rate - RATE * 1.005) < 4 * found.sigma
    assert found.sigma == pytest.approx(bound(50_000, 1e-3, 0.01, axes=1), rel=0.03)


def test_a_weak_wave_in_much_noise():
    """Amplitude 1 in noise of 20, 200 000 samples: 16 standard deviations of the spectrum."""
    dt = 5e-3
    values = signal(np.arange(200_000) * dt, RATE * 0.991, axes=1, order=1)
    found = rate_of(values + 20 * np.random.default_rng(4).normal(size=values.shape), dt, RATE, order=2)
    assert abs(found.rate - RATE * 0.991) < 4 * found.sigma
    assert found.sigma == pytest.approx(bound(200_000, dt, 20.0, axes=1, order=1), rel=0.15)


def test_slow_noise_widens_the_uncertainty():
    """The wave's amplitude wanders, alike for 500 samples: 22 times the noise of the single sample at the harmonic."""
    rng = np.random.default_rng(5)
    time = np.arange(100_000) * 1e-3
    wander = np.repeat(rng.normal(size=200), 500)
    values = signal(time, RATE, axes=1, order=1) + 0.05 * wander[:, None] + 0.01 * rng.normal(size=(time.size, 1))
    found = rate_of(values, 1e-3, RATE, order=1)
    assert abs(found.rate - RATE) < 4 * found.sigma
    assert found.sigma > 10 * bound(100_000, 1e-3, 0.05, axes=1, order=1)


def test_jittered_times_and_gaps():
    rng = np.random.default_rng(6)
    time = np.arange(60_000) * 1e-3 + 2e-4 * rng.uniform(-1, 1, 60_000)
    time = time[(time < 21) | (time > 29)]
    values = signal(time, RATE * 1.01, axes=3) + 0.01 * rng.normal(size=(time.size, 3))
    found = segment_harmonics(from_arrays(time, values), segments((0, 59.9, RATE)), rate="estimate")
    assert abs(found.rate[0] - RATE * 1.01) < 4 * found.rate_sigma[0]
    spread = (
        math.sqrt(np.mean((time - time.mean()) ** 2) * 12) / time.size
    )  # with the gap in the middle more than T / n
    assert found.rate_sigma[0] == pytest.approx(bound(time.size, spread, 0.01, axes=3), rel=0.05)


def test_counted_pulses_tell_the_rate(tmp_path):
    """Pulses of 0.01 rad over 5 ms are a noise of 0.8 rad/s from sample to sample, and hardly any at the harmonics."""
    dt, rate = 5e-3, RATE * 1.003
    stamps = np.arange(1, 40_001) * dt
    angle = rate * np.concatenate([[0.0], stamps])
    counts = np.diff(np.floor(100 * (0.7 * angle / rate + np.sin(angle) / rate)))
    lines = [f"{t!r},{c!r},{c!r},{c!r}" for t, c in zip(stamps.tolist(), counts.tolist(), strict=True)]
    (tmp_path / "log.csv").write_text(
        "time [s],gyro_x [pulse],gyro_y [pulse],gyro_z [pulse]\n" + "\n".join(lines) + "\n"
    )
    recording = open_recording(tmp_path / "log.csv", scale={"gyro": "100 pulse/rad"})
    found = segment_harmonics(recording, segments((0, 200, RATE)), rate="estimate", order=2)
    assert abs(found.rate[0] - rate) < 3e-6
    assert found.rate_sigma[0] < 3e-6
    assert found.density[0] < 0.05 * 0.8 * math.sqrt(dt)  # a twentieth of what samples scatter by


@pytest.mark.parametrize("error", [0.03, -0.05])
def test_a_rate_out_of_reach_is_refused(error):
    values = signal(np.arange(200_000) * 1e-3, RATE * (1 + error))
    values += 0.01 * np.random.default_rng(7).normal(size=values.shape)
    with pytest.raises(
        DataError, match=r"samples: (no periodic signal within 2 % of the rate given|the samples do not show)"
    ):
        rate_of(values, 1e-3, RATE, order=4)
    assert rate_of(values, 1e-3, RATE, order=4, capture=0.06).rate == pytest.approx(RATE * (1 + error), rel=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_has_no_rate(seed):
    values = np.random.default_rng(seed).normal(size=(100_000, 3))
    with pytest.raises(DataError, match=r"samples: (no periodic signal within|the samples do not show the rate)"):
        rate_of(values, 1e-3, RATE, order=3)


@pytest.mark.parametrize("count", [30, 200])
def test_too_short_an_arc_has_no_rate(count):
    values = signal(np.arange(count) * 1e-3, RATE)
    with pytest.raises(
        DataError, match="samples: (no rate can be found in the samples|the samples do not show the rate)"
    ):
        rate_of(values + 0.01 * np.random.default_rng(8).normal(size=values.shape), 1e-3, RATE, order=4)


def test_the_segment_without_a_rate_is_named():
    time = np.arange(40_000) * 1e-3
    values = signal(time, RATE, axes=3)
    values[20_000:] = 3.0
    values += 0.01 * np.random.default_rng(9).normal(size=values.shape)
    with pytest.raises(DataError, match=r"^segment 's2': (no periodic|the samples do not)"):
        segment_harmonics(from_arrays(time, values), segments((0, 20, RATE), (20, 40, RATE)), rate="estimate")
