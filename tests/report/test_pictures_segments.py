"""Pictures of segments: residuals and the log."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from figures import assert_clear, made, texts_of

from sagnac import from_arrays
from sagnac.errors import InputError
from sagnac.observe.static import static_intervals
from sagnac.plan import Plan, Segment
from sagnac.recording import Batch, Recording
from sagnac.report import pictures
from sagnac.report.pictures.envelope import Envelope
from sagnac.report.pictures.log import look, static_spans
from sagnac.verification import Check

# -------------------------------------------------------------------------------------------------------- residuals


def test_residuals_beyond_their_bar_are_open():
    checks = [Check(f"s{i}", "static norm", r * 1e-5, 1e-5, "m/s^2") for i, r in enumerate([0.5, -1.9, 2.5, 1.0, 0.0])]
    figure = pictures.residuals(made(9, 3), checks)
    assert any(text.endswith("1 of 5 beyond their bar (open)") for text in texts_of(figure))
    dots = [line for line in figure.axes[0].get_lines() if line.get_marker() == "o"]
    assert [len(line.get_xdata()) for line in dots] == [4, 1]
    # 2.5e-5 m/s^2 in ug
    assert dots[1].get_ydata() == pytest.approx([2.5e-5 / 9.80665e-6])


def test_few_segments_are_listed_over_their_uncertainty():
    checks = [Check("1", f"accel_z {h}", r, 0.5, "m/s^2") for h, r in (("mean", 0.5), ("1x", 1.5), ("2x", 0.0))]
    figure = pictures.residuals(made(9, 3), checks)
    dots = {line.get_marker(): line.get_xdata() for line in figure.axes[0].get_lines() if line.get_marker() in "oD"}
    assert dots["o"] == pytest.approx([1.0, 0.0])
    assert dots["D"] == pytest.approx([3.0])
    assert {"segment 1", "accel_z 1x"} <= set(texts_of(figure))


def test_comparison_of_a_recording_with_and_without_its_calibration(turned):
    recording, calibration = turned
    found = pictures.comparison(calibration, recording, Plan(gravity=9.81))
    assert len(found.pairs) == 16
    before, after = found.rms("static norm")
    # uncalibrated: gains 1 to 2 % of gravity and biases of some 0.04 m/s^2; after: noise of a mean over 4 s at 100 Hz
    assert 0.05 < before < 0.3
    assert after < 4 * 1e-3 / np.sqrt(400)
    # uncalibrated is what the readings say themselves
    batch = recording.read()
    intervals = static_intervals(batch)
    a, b = intervals.start[0], intervals.stop[0]
    norm = np.linalg.norm(batch.accel[a:b].mean(axis=0))
    assert found.pairs[0].before == pytest.approx(norm - 9.81, rel=1e-6)
    assert_clear(pictures.before_after(found))
    assert found.before == "uncalibrated"
    with pytest.raises(KeyError):
        found.rms("rate norm")


def test_comparison_with_an_earlier_calibration(turned):
    recording, calibration = turned
    found = pictures.comparison(calibration, recording, Plan(gravity=9.81), calibration)
    assert found.before == "with the earlier calibration"
    assert [p.before for p in found.pairs] == [p.after for p in found.pairs]


def test_a_unit_in_counts_is_compared_with_one_gain_for_all_axes():
    calibration = made(3, 3)
    names = ("accel.scale_factor.x", "accel.scale_factor.y", "accel.bias.x")
    values = (410.0, 420.0, 33000.0)
    counted = tuple(
        p.model_copy(update={"name": n, "value": v})
        for p, n, v in zip(calibration.parameters, names, values, strict=True)
    )
    plain = pictures.nominal(calibration.model_copy(update={"parameters": counted}))
    assert plain.values() == {names[0]: 415.0, names[1]: 415.0, names[2]: 33000.0}


def test_the_unit_without_errors_keeps_what_is_the_rigs():
    calibration = made(60, 3)
    plain = pictures.nominal(calibration).values()
    for name, value in calibration.values().items():
        assert plain[name] == (
            value if name.startswith(("rig.lever_arm", "rig.zero", "rig.tilt", "rig.nonperp")) else 0
        )


# -------------------------------------------------------------------------------------------------------------- log


def test_envelope_of_a_stream_is_that_of_the_whole():
    rng = np.random.default_rng(0)
    values = rng.standard_normal((10_007, 2))
    values[5_003] = [9.0, -9.0]
    time = np.arange(len(values)) / 10
    for pieces in (1, 7, 10_007):
        envelope = Envelope(2, stretches=64)
        for part in np.array_split(np.arange(len(values)), pieces):
            envelope.add(time[part], values[part])
        found = envelope.result()
        assert 16 <= found.first.size <= 65
        assert np.all(found.first <= found.last)
        assert np.all(found.last[:-1] < found.first[1:])
        for i in range(found.first.size):
            there = values[(time >= found.first[i]) & (time <= found.last[i])]
            assert found.low[i] == pytest.approx(there.min(axis=0), abs=0)
            assert found.high[i] == pytest.approx(there.max(axis=0), abs=0)
        assert (found.first[0], found.last[-1]) == (time[0], time[-1])


def test_envelope_of_nothing_is_empty():
    assert Envelope(3).result().low.shape == (0, 3)


def streamed(samples: int, piece: int = 100_000) -> Recording:
    """A recording that makes its samples while it is read."""

    def stream(_: bool):
        for row in range(0, samples, piece):
            count = min(piece, samples - row)
            time = (row + np.arange(count)) / 1000
            yield Batch(row + 1, time, np.tile([0.0, 0.0, 9.8], (count, 1)), None)

    return Recording("streamed", None, frozenset(), frozenset({"accel"}), frozenset(), (), {}, stream)


def test_long_logs_take_bounded_memory():
    plan = Plan(segment=(Segment(name="a", start=1.0, stop=900.0),))
    recording = streamed(2_000_000)
    tracemalloc.start()
    seen = look(recording)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert seen.samples == 2_000_000
    assert seen.whole is None
    assert peak < 40e6  # the whole log: 64 MB; a piece of it: 3 MB and its copies
    assert pictures.log(recording, plan) is not None


def test_log_shows_every_axis_and_the_segments_of_the_plan():
    time = np.arange(6000) / 10
    accel = np.column_stack([np.sin(time), np.zeros(6000), np.full(6000, 9.8)])
    gyro = np.where(time[:, None] > 300, 0.1, 0.0) * np.ones(3)
    temperature = {"temperature": np.linspace(293.15, 300.0, 6000)}
    recording = from_arrays(time, accel, gyro, rig=temperature)
    plan = Plan(
        segment=(
            Segment(name="rest", start=10.0, stop=290.0),
            Segment(name="turn", start=310.0, stop=590.0, outer_rate=0.1),
        )
    )
    figure = pictures.log(recording, plan)
    assert len(figure.axes) == 7
    assert {"rest", "turn", "at rest", "turning", "2 segments of the plan", "time [s]"} <= set(texts_of(figure))
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels[0] == "accel x\n[m/s²]"
    assert labels[-1] == "temp.\n[degC]"
    assert_clear(figure)


def test_log_of_a_unit_turned_by_hand_names_its_static_intervals(turned):
    recording, calibration = turned
    figure = pictures.log(recording, None, calibration)
    said = texts_of(figure)
    assert "16 static intervals" in said
    assert sum(t.endswith(("▾", "◂")) for t in said) == 1  # the segment with most influence
    assert_clear(figure)


@pytest.mark.parametrize("count", [3, 24, 120])
def test_names_of_many_segments_do_not_overlap_in_the_log(count):
    time = np.arange(12_000) / 10
    recording = from_arrays(time, np.ones((12_000, 3)))
    step = 1200 / count
    plan = Plan(
        segment=tuple(
            Segment(name=f"position {i + 1}", start=i * step + 0.2, stop=(i + 0.8) * step) for i in range(count)
        )
    )
    assert_clear(pictures.log(recording, plan))


def test_gaps_are_open_in_the_log():
    time = np.concatenate([np.arange(1000) / 10, 500 + np.arange(1000) / 10])
    figure = pictures.log(from_arrays(time, np.ones((2000, 3))), Plan(segment=(Segment(name="a", start=1, stop=9),)))
    (curve,) = figure.axes[0].collections
    assert len(curve.get_paths()) == 2


def test_a_log_without_samples_is_refused():
    empty = from_arrays(np.zeros(0), np.zeros((0, 3)))
    with pytest.raises(InputError, match="no samples"):
        pictures.log(empty)


def test_a_log_too_short_for_static_intervals_is_drawn_without():
    figure = pictures.log(from_arrays(np.arange(20) / 10, np.ones((20, 3))))
    assert "no static intervals" in texts_of(figure)
    assert static_spans(Batch(1, np.arange(3.0), None, None)) == []
