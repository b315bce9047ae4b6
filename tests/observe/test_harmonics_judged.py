"""Harmonics of turning segments: their noise, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from turning import DT, RATE, in_pieces, noisy, plan, wave

from sagnac.errors import DataError, InputError
from sagnac.observe.harmonics import segment_harmonics
from sagnac.plan import Plan
from sagnac.recording import from_arrays

# ---------------------------------------------------------------------------------------------------- noise


@pytest.mark.statistical
@pytest.mark.parametrize(("seconds", "extended"), [(6.0, False), (1.6, False), (6.0, True)])
def test_covariance_is_that_of_many_runs(seconds, extended):
    """600 runs of three axes: sample covariance of whitened errors is unit to 1 / sqrt(1800), its entries within 4.5 of that."""
    dt, sigma = 5e-3, 0.3
    time = np.arange(round(seconds / dt)) * dt
    values, _ = wave(0.2 + RATE * time, offset=0.0)
    spans = plan((0.0, seconds, RATE, 0.2))
    rng = np.random.default_rng(7)
    runs = [
        segment_harmonics(
            from_arrays(time, values + sigma * rng.normal(size=values.shape)), spans, order=2, extended=extended
        )
        for _ in range(600)
    ]
    errors = np.array([f.coefficient[0] for f in runs])
    errors = (errors - errors.mean(axis=0)).reshape(-1, errors.shape[2])
    white = np.linalg.solve(np.linalg.cholesky(runs[0].unit_covariance[0]), errors.T) / sigma
    found = white @ white.T / (len(errors) - 3)
    assert np.abs(np.diag(found) - 1).max() < 4.5 * math.sqrt(2 / 1800)
    assert np.abs(found - np.diag(np.diag(found))).max() < 4.5 / math.sqrt(1800)


def test_density_of_white_noise():
    """Three segments of 20 000 samples and an axis: relative standard deviation 1 / sqrt(2 * 60 000) = 0.3 %; four of them."""
    time, values, _ = noisy(60, sigma=0.02)
    spans = plan(*[(20.0 * i, 20.0 * i + 20, RATE, 0.4 + 20 * i * RATE) for i in range(3)])
    found = segment_harmonics(from_arrays(time, values), spans)
    np.testing.assert_allclose(found.density, 0.02 * math.sqrt(DT), rtol=4 / math.sqrt(120_000))
    assert found.noise_degrees_of_freedom == 3 * (20_000 - 9)
    assert found.remarks == ()


@pytest.mark.statistical
@pytest.mark.parametrize("extended", [False, True])
def test_slow_scatter_of_white_noise_is_its_variance(extended):
    """Sums over cells: 16 * 9 - 10 degrees of freedom for each axis (16 * 17 - 18), 40 runs of three axes."""
    from sagnac.observe.harmonic_sums import Even, HarmonicSums, Turn

    rng = np.random.default_rng(11)
    ratio, dof = [], 0
    for _ in range(40):
        sums = HarmonicSums(Turn(0.0, 12.0, RATE), 3, 4, extended=extended)
        sums.add([rng.normal(size=(6000, 3))], Even(0.0, 2e-3), 2e-3)
        fit = sums.fit()
        ratio.append(fit.slow_squares / fit.slow_degrees_of_freedom)
        dof = fit.slow_degrees_of_freedom
    # cells of 3/8 of a turn tell fewer terms than there are
    assert 60 < dof <= 16 * (17 if extended else 9) - (18 if extended else 10)
    assert np.mean(ratio) == pytest.approx(1.0, abs=4 * math.sqrt(2 / dof / 120))
    assert np.std(ratio) == pytest.approx(math.sqrt(2 / dof), rel=0.3)


def test_a_drift_is_no_noise():
    time, values, _ = noisy(60)
    drifting = values + 0.02 * time[:, None] / 60
    still, moved = (segment_harmonics(from_arrays(time, v), plan((0.0, 60.0, RATE, 0.4))) for v in (values, drifting))
    np.testing.assert_allclose(moved.density, still.density, rtol=0.2)
    assert moved.remarks == ()


def test_slow_disturbances_count():
    """A wandering bias, two steps a second of 10 mm/s^2 beside noise of 10 mm/s^2 a sample: 500 samples go together."""
    time, values, _ = noisy(120)
    values[:, 1] += np.repeat(0.01 * np.random.default_rng(5).normal(size=240), 500)
    found = segment_harmonics(
        from_arrays(time, values), plan((0.0, 60.0, RATE, 0.4), (60.0, 120.0, RATE, 0.4 + 60 * RATE))
    )
    (remark,) = found.remarks
    assert remark.startswith("accel_y: up to ")
    assert "times as noisy about the harmonics as from sample to sample" in remark
    assert found.density[[0, 2]] == pytest.approx(0.01 * math.sqrt(DT), rel=0.02)
    assert found.density[1] > 3 * 0.01 * math.sqrt(DT)
    assert 60 < found.noise_degrees_of_freedom < 300


def test_another_rate_than_the_one_assumed_shows_in_the_noise():
    time, values, _ = noisy(60, rate=RATE * 1.0001)
    found = segment_harmonics(from_arrays(time, values), plan((0.0, 60.0, RATE, 0.4)))
    assert any("an angle that is not quite the one assumed" in r for r in found.remarks)


def test_noise_free_samples_give_no_remarks():
    time, values, truth = noisy(60, sigma=0.0)
    spans = plan(*[(10.0 * i, 10.0 * i + 10, RATE, 0.4 + 10 * i * RATE) for i in range(6)])
    found = segment_harmonics(from_arrays(time, values), spans)
    assert found.remarks == ()
    assert np.all(found.density < 1e-7 * math.sqrt(DT) * 50)
    np.testing.assert_allclose(found.coefficient, np.broadcast_to(truth, (6, 3, 9)), rtol=0, atol=1e-11)


def test_a_restless_segment_is_named():
    time, values, _ = noisy(60)
    values[20_000:30_000, 1] += 0.05 * np.random.default_rng(6).normal(size=10_000)
    spans = plan(*[(10.0 * i, 10.0 * i + 10, RATE, 0.4 + 10 * i * RATE) for i in range(6)])
    (remark,) = segment_harmonics(from_arrays(time, values), spans).remarks
    assert remark.startswith("segment 's3' is restless: accel_y has 5.")


# ---------------------------------------------------------------------------------------------- what is refused


def refusal(recording, *spans, **options) -> str:
    with pytest.raises(DataError) as caught:
        segment_harmonics(recording, plan(*spans), **options)
    return str(caught.value)


@pytest.mark.parametrize("rate", ["known", "estimate"])
@pytest.mark.parametrize(("a", "b"), [(-5, 2), (28, 31), (40, 50), (-9, -8)])
def test_segments_outside_the_data(a, b, rate):
    time, values, _ = noisy(30)
    said = refusal(from_arrays(time, values, name="mine"), (5, 20, RATE), (a, b, RATE), rate=rate)
    assert f"segment 's2' ({a} s to {b} s) lies outside the data of mine (0 s to 29.999 s, " in said
    assert "check the plan's times" in said


def test_no_segments_no_samples():
    time, values, _ = noisy(3)
    with pytest.raises(DataError, match=r"the plan has no \[\[segment\]\]"):
        segment_harmonics(from_arrays(time, values), Plan())
    assert "mine: the recording holds no samples" in refusal(
        from_arrays([], np.zeros((0, 3)), name="mine"), (0, 1, RATE)
    )


def test_too_few_samples():
    time, values, _ = noisy(3)
    said = refusal(from_arrays(time, values), (1.0, 1.0085, RATE))
    assert said == "segment 's1' holds 9 samples: too few for 9 terms (DC, 4 harmonics)"


@pytest.mark.parametrize(
    ("turns", "order", "extended"),
    [(0.002, 1, False), (0.05, 2, False), (0.15, 4, False), (0.05, 1, True), (0.3, 2, True), (0.8, 4, True)],
)
def test_too_short_an_arc(turns, order, extended):
    time, values, _ = noisy(10)
    said = refusal(
        from_arrays(time, values), (1.0, 1.0 + 2 * math.pi * turns / RATE, RATE), order=order, extended=extended
    )
    assert f"segment 's1' shows {turns:g}" in said
    assert f"too little to tell DC and {order} harmonics apart (condition " in said
    assert "take a lower order or a longer arc" in said


def test_the_condition_tells_how_short_an_arc_is():
    time, values, _ = noisy(30)
    arcs = [2 * math.pi * t / RATE for t in (3.0, 1.0, 0.7, 0.4)]
    edges = np.cumsum([0.0, *(a + 0.5 for a in arcs)])
    found = segment_harmonics(
        from_arrays(time, values), plan(*[(s, s + a, RATE) for s, a in zip(edges[:-1], arcs, strict=True)]), order=2
    )
    assert np.all(np.diff(found.condition) > 0)
    assert found.condition[0] == pytest.approx(1.0, abs=0.01)
    assert found.condition[3] > 300


def test_harmonics_above_half_the_sampling_frequency():
    dt = 0.1
    time = np.arange(400) * dt
    values, _ = wave(9.0 * time)
    said = refusal(from_arrays(time, values), (0.0, 40.0, 9.0))
    assert "harmonic 4 of 9 rad/s lies above half the sampling frequency (5 Hz): take a lower order" in said
    segment_harmonics(from_arrays(time, values), plan((0.0, 40.0, 9.0)), order=3)


@pytest.mark.parametrize("cuts", [[], [10_100, 10_200, 19_999]])
@pytest.mark.parametrize(("side", "sign"), [("top", 1), ("bottom", -1)])
@pytest.mark.parametrize("rate", ["known", "estimate"])
def test_a_wave_that_is_cut_off(rate, side, sign, cuts):
    """A tenth of each turn at the end of the range."""
    time, values, _ = noisy(30)
    values[:, 2] = 5.0 * np.cos(RATE * time) + 0.01 * np.random.default_rng(2).normal(size=time.size)
    values[:, 2] = np.clip(sign * values[:, 2], None, 4.8) * sign
    said = refusal(in_pieces(from_arrays(time, values), cuts), (0.0, 15.0, RATE), (15.0, 30.0, RATE), rate=rate)
    assert "accel_z is saturated in segment 's1': " in said
    assert f"samples in a row stand exactly at the {side} of its range ({4.8 * sign:g})" in said


def test_an_axis_that_stays_at_the_end_of_its_range():
    time, values, _ = noisy(30)
    values[:, 0] = np.minimum(values[:, 0], 10.0)
    assert "accel_x is saturated in segment 's1': " in refusal(from_arrays(time, values), (0.0, 30.0, RATE))


def test_dead_and_stuck_axes():
    time, values, _ = noisy(30)
    dead, stuck = values.copy(), values.copy()
    dead[:, 1] = 0.5
    stuck[15_000:, 1] = 0.5
    spans = (0.0, 15.0, RATE), (15.0, 30.0, RATE)
    assert "accel_y never changes (always 0.5): the axis is dead" in refusal(from_arrays(time, dead), *spans)
    assert "accel_y is stuck at 0.5 through segment 's2'" in refusal(from_arrays(time, stuck), *spans)


@pytest.mark.parametrize("step", [1e-6, 0.005, 0.02, 0.1, 1.0])
def test_quantised_samples_are_not_refused(step):
    time, values, truth = noisy(30)
    spans = plan((0.0, 15.0, RATE, 0.4), (15.0, 30.0, RATE, 0.4 + 15 * RATE))
    found = segment_harmonics(from_arrays(time, step * np.round(values / step)), spans)
    assert np.abs(found.coefficient - truth).max() < 0.002 + 0.05 * step


def test_what_needs_whole_triads_refuses_single_axes():
    time, values, _ = noisy(3)
    from sagnac.observe.means import segment_means

    with pytest.raises(InputError, match="recording: accel lacks accel_x, accel_y; rename columns with --map"):
        segment_means(from_arrays(time, single={"accel_z": values[:, 0]}), plan((0.0, 2.0, 0.0)))
