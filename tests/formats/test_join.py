"""Accelerometers at the times of the gyros: whole arrays are the twin of pieces."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.errors import InputError
from sagnac.formats import join
from sagnac.formats.join import Joiner, Stream


def stream(time, width=0, slope=1e-3):
    """Values that are linear in time, so that interpolation gives them exactly; what goes along counts."""
    time = np.asarray(time, dtype=np.int64)
    values = slope * time[:, None] * np.array([1.0, -2.0, 0.5])
    return Stream(time, values, np.tile(np.arange(time.size, dtype=float)[:, None], (1, width)))


def joined(accel, gyro, step, cuts=()):
    """Both streams in pieces: `cuts` are times at which what came so far is handed over."""
    joiner = Joiner("log", step, accel.other.shape[1])
    parts = []
    edges = [np.iinfo(np.int64).min, *sorted(cuts), np.iinfo(np.int64).max]
    for low, high in itertools.pairwise(edges):
        for which in (accel, gyro):
            mine = which[(which.time > low) & (which.time <= high)]
            parts.append(joiner.add(*((mine, None) if which is accel else (None, mine))))
    joiner.finish()
    return joiner, *(
        np.concatenate([getattr(p[i], k) for p in parts]) for i, k in ((0, "time"), (0, "values"), (0, "other"))
    )


def test_same_times_are_taken_as_they_are():
    accel, gyro = stream(np.arange(100) * 1000, 2, slope=0.1), stream(np.arange(100) * 1000)
    joiner, time, values, other = joined(accel, gyro, 1000.0, cuts=[7500])
    np.testing.assert_array_equal(time, gyro.time)
    np.testing.assert_array_equal(values, accel.values)
    np.testing.assert_array_equal(other, accel.other)
    assert joiner.lost == 0
    assert join.remark(accel.time, gyro.time) is None
    assert join.remark(accel.time[:60], gyro.time[5:]) is None  # where one begins or ends is no difference


def test_between_samples_it_is_linear_and_what_goes_along_is_of_the_sample_before():
    accel, gyro = stream(np.arange(50) * 4000 + 300, 1), stream(np.arange(200) * 1000)
    joiner, time, values, other = joined(accel, gyro, 4000.0)
    inside = (gyro.time >= 300) & (gyro.time <= accel.time[-1])
    np.testing.assert_array_equal(time, gyro.time[inside])
    np.testing.assert_allclose(values, stream(time).values, rtol=1e-14)
    np.testing.assert_array_equal(other[:, 0], np.searchsorted(accel.time, time, "right") - 1)
    assert joiner.lost == 200 - inside.sum()


def test_no_value_is_found_across_a_gap():
    """Accelerometers lack 20 to 30 ms; the gyros there are left out, those at the very edges are not."""
    whole = np.arange(100) * 1000
    accel, gyro = stream(whole[(whole <= 20000) | (whole >= 30000)]), stream(whole + 500)
    _, time, _, _ = joined(accel, gyro, 1000.0)
    assert not np.any((time > 20000) & (time < 30000))
    assert time.size == 99 - 10
    at_samples, time, values, _ = joined(accel, stream(whole), 1000.0)
    np.testing.assert_array_equal(time, accel.time)
    np.testing.assert_array_equal(values, accel.values)
    assert at_samples.lost == 9


def test_a_gap_of_the_gyros_stays_one():
    whole = np.arange(100) * 1000
    gyro = stream(whole[(whole < 20000) | (whole > 60000)] + 400)
    _, time, values, _ = joined(stream(whole), gyro, 1000.0, cuts=[30000, 50000])
    np.testing.assert_array_equal(time, gyro.time[gyro.time <= 99000])
    np.testing.assert_allclose(values, stream(time).values, rtol=1e-14)


times = st.lists(st.integers(1, 3000), min_size=1, max_size=60).map(np.cumsum)


@given(times, times, st.lists(st.integers(0, 90000), max_size=5))
def test_pieces_give_what_the_whole_does(accel, gyro, cuts):
    whole, *expected = joined(stream(accel, 1), stream(gyro), 1000.0)
    pieces, *found = joined(stream(accel, 1), stream(gyro), 1000.0, cuts)
    for a, b in zip(expected, found, strict=True):
        np.testing.assert_array_equal(a, b)
    assert whole.lost == pieces.lost
    near = [bool(t in accel or np.any((accel[:-1] < t) & (t < accel[1:]) & (np.diff(accel) <= 1500))) for t in gyro]
    np.testing.assert_array_equal(expected[0], gyro[near])


def test_memory_is_bounded_when_one_sensor_falls_silent(monkeypatch):
    monkeypatch.setattr(join, "_PENDING", 100)
    joiner = Joiner("log", 1000.0)
    joiner.add(stream(np.arange(10) * 1000), None)
    for k in range(1, 20):
        joiner.add(None, stream(np.arange(50) * 1000 + 50_000 * k))
    assert joiner._gyro.time.size <= 100
    joiner = Joiner("log", 1000.0)
    for k in range(20):
        joiner.add(stream(np.arange(50) * 1000 + 50_000 * k), None)
    assert joiner._accel.time.size <= 100


def test_time_of_gyros_that_goes_back_is_refused_wherever_it_does():
    """Also behind gyro samples that have been handed out: they are not left out without a word."""
    joiner = Joiner("a.ulg", 1000.0)
    joiner.add(stream([1000, 2000, 3000]), None)
    assert joiner.add(None, stream([1500, 2500]))[0].time.size == 2
    with pytest.raises(InputError, match=r"a\.ulg: .*gyros goes from 0.002500 s to 0.001600 s"):
        joiner.add(None, stream([1600, 2700]))
    with pytest.raises(InputError, match="gyros goes from 0.002500 s to 0.002500 s"):
        joiner.add(None, stream([2500]))


def test_time_that_goes_back_is_refused():
    joiner = Joiner("a.ulg", 1000.0)
    joiner.add(stream([1000, 2000]), None)
    with pytest.raises(InputError, match=r"a\.ulg: .*accelerometers goes from 0.002000 s to 0.002000 s"):
        joiner.add(stream([2000, 3000]), None)


def test_the_remark_gives_rates_and_offset():
    accel, gyro = np.arange(1000) * 2000 + 250, np.arange(2000) * 1000
    text = join.remark(accel, gyro)
    assert "gyros at 1000 Hz and accelerometers at 500 Hz" in text
    assert "+0.250 ms" in join.remark(np.arange(100) * 1000, np.arange(100) * 1000 + 250)


def test_bunches_are_no_gaps():
    """Eight samples read at once, a microsecond apart, every eight milliseconds: a ninth of the steps is long."""
    time = (np.arange(100)[:, None] * 8000 + np.arange(8)).ravel()
    assert join.usual_step(time) == pytest.approx(7993)
    assert join.usual_step(time[:1]) == 0.0
    assert join.rate(time) == pytest.approx(1000, rel=0.02)


@pytest.mark.parametrize(("many", "within"), [(10, 12), (16, 12), (20, 10), (32, 1), (50, 3), (20, 400)])
def test_no_sample_of_large_bunches_is_lost(many, within):
    """1 kHz, `many` samples read at once and stamped `within` us apart; one bunch is missing, and that is a gap."""
    bunches = np.delete(np.arange(60), 30)
    accel = stream((bunches[:, None] * many * 1000 + np.arange(many) * within).ravel())
    gyro = stream(np.arange(60 * many) * 1000 + 5)
    usual = join.usual_step(accel.time)
    assert usual == many * 1000 - (many - 1) * within
    _, time, values, _ = joined(accel, gyro, usual)
    gap = gyro.time > 29 * many * 1000 + (many - 1) * within
    gap &= gyro.time < 31 * many * 1000
    np.testing.assert_array_equal(time, gyro.time[~gap & (gyro.time <= accel.time[-1])])
    np.testing.assert_allclose(values, stream(time).values, rtol=1e-14)


def test_gaps_are_not_usual():
    """A pause as long as all the rest, stalls after every fifty samples, one sample in thirteen lost: the step stays."""
    whole = np.arange(1000) * 1000
    assert join.usual_step(np.append(whole, whole + 2_000_000)) == 1000
    assert join.usual_step(whole + np.arange(1000) // 50 * 20_000) == 1000
    assert join.usual_step(np.delete(whole, np.arange(5, 1000, 13))) == 1000
    assert join.usual_step(np.delete(whole, slice(1, 999))) == whole[-1]  # two samples tell no better
    assert join.usual_step(whole[::-1]) == 0.0
