"""Increments of a recording, piece by piece: exact pulses, any cut of the file, gaps."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from sagnac.errors import DataError, InputError
from sagnac.navigate.strapdown import increments
from sagnac.navigate.stream import Gap, Stream
from sagnac.recording import Batch, from_arrays, open_recording

RNG = np.random.default_rng(3)
SCALE = {"gyro": "10 pulse/arcsec", "accel": "800 pulse/(m/s)"}
ARCSEC = np.pi / 648000


def whole(stream):
    """All pieces together: begin, time, steps, turns, pushes."""
    pieces = list(stream)
    assert all(a.time[-1] == b.begin for a, b in pairwise(pieces))
    return pieces[0].begin, *(
        np.concatenate([getattr(p, n) for p in pieces]) for n in ("time", "steps", "turns", "pushes")
    )


def in_pieces(recording, cuts):
    """The same recording, handed out in other batches."""
    batch = recording.read()
    edges = [0, *cuts, batch.time.size]

    def stream(_):
        for a, b in pairwise(edges):
            yield Batch(a + 1, batch.time[a:b], batch.accel[a:b], batch.gyro[a:b])

    return replace(recording, _stream=stream)


def smooth(n=400, dt=0.01, start=5.0):
    """Instantaneous samples of slow sines."""
    t = start + dt * np.arange(n)
    phase = 2 * np.pi * t[:, None] * [0.3, 0.5, 0.7]
    return from_arrays(t, np.cos(phase) * 9.8, np.sin(phase) * 0.1, name="smooth")


def pulse_file(tmp_path, time, counts):
    columns = {"time [s]": time}
    for i, axis in enumerate(("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")):
        columns[f"{axis} [pulse]"] = counts[:, i]
    path = tmp_path / "pulses.parquet"
    parquet.write_table(pa.table(columns), path)
    return open_recording(path, scale=SCALE)


def test_pulses_are_handed_on_as_counted(tmp_path):
    """Time stamps that jitter by a tenth of a sample change the steps and no increment."""
    n = 1000
    time = 3.0 + 0.01 * np.arange(n) + RNG.uniform(-5e-4, 5e-4, n)
    counts = RNG.integers(-300, 300, (n, 6))
    begin, t, steps, turns, pushes = whole(Stream(pulse_file(tmp_path, time, counts)))
    assert begin == time[0]
    assert np.array_equal(t, time[1:])
    assert np.allclose(steps, np.diff(time), rtol=0, atol=1e-15)
    assert np.abs(turns / (0.1 * ARCSEC) - counts[1:, :3]).max() < 1e-10
    assert np.abs(pushes * 800 - counts[1:, 3:]).max() < 1e-10


@pytest.mark.parametrize("meaning", ["instant", "mean"])
@pytest.mark.parametrize("cuts", [[2], [2, 3, 4, 5], [100, 101, 399], list(range(2, 400, 7))])
def test_batches_do_not_matter(meaning, cuts):
    recording = smooth()
    batch = recording.read()
    expected = increments(batch.time, batch.gyro, batch.accel, meaning)
    begin, t, *found = whole(Stream(in_pieces(recording, cuts), meaning=meaning))
    assert begin == batch.time[0]
    assert np.array_equal(t, batch.time[1:])
    for a, b in zip(expected, found, strict=True):
        assert np.allclose(a, b, rtol=1e-12, atol=1e-15)


def test_instantaneous_samples_are_integrated():
    """Against the integral of the sines, to the order of the four-point rule: 11/720 h^4 of the fourth derivative."""
    _, t, steps, _, pushes = whole(Stream(smooth()))
    w = 2 * np.pi * np.array([0.3, 0.5, 0.7])
    exact = 9.8 * (np.sin(w * t[:, None]) - np.sin(w * (t - steps)[:, None])) / w
    assert np.abs(pushes - exact)[1:-1].max() < 9.8 * 0.01**5 * w.max() ** 4 * 11 / 720 * 1.1


def test_part_of_the_time():
    recording = smooth()
    all_of_it = whole(Stream(recording))
    begin, t, _, turns, _ = whole(Stream(recording, start=6.0, stop=7.5))
    assert begin == pytest.approx(6.0)
    assert (t[0], t[-1]) == (pytest.approx(6.01), pytest.approx(7.5))
    inside = (all_of_it[1] > 6.005) & (all_of_it[1] < 7.505)
    assert np.array_equal(turns, all_of_it[3][inside])


def test_it_may_be_gone_through_again():
    stream = Stream(smooth())
    assert np.array_equal(whole(stream)[3], whole(stream)[3])


def test_long_batches_come_in_short_pieces():
    n = 50_000
    recording = from_arrays(0.001 * np.arange(n), np.ones((n, 3)), np.zeros((n, 3)))
    sizes = [p.time.size for p in Stream(recording)]
    assert max(sizes) <= 1 << 14
    assert sum(sizes) == n - 1


def test_reading_stops_after_the_time_wanted():
    recording = smooth()
    seen = []

    def stream(_):
        for a in range(0, 400, 50):
            seen.append(a)
            batch = recording.read()
            cut = slice(a, a + 50)
            yield Batch(a + 1, batch.time[cut], batch.accel[cut], batch.gyro[cut])

    list(Stream(replace(recording, _stream=stream), stop=5.3))
    assert max(seen) <= 100


# ------------------------------------------------------------------------------------------------------------- gaps


def holed(first=150, missing=50):
    batch = smooth().read()
    keep = np.r_[0:first, first + missing : 400]
    return from_arrays(batch.time[keep], batch.accel[keep], batch.gyro[keep], name="holed")


def test_gap_is_refused_with_its_times():
    with pytest.raises(DataError, match=r"holed: no samples from 6.49 s to 7 s"):
        list(Stream(holed()))


def test_gap_outside_the_time_wanted_is_no_matter():
    assert whole(Stream(holed(), stop=6.4))[1][-1] == pytest.approx(6.4)
    assert whole(Stream(holed(), start=7.0))[0] == pytest.approx(7.0)


@pytest.mark.parametrize("meaning", ["instant", "mean"])
def test_gap_is_filled_with_the_mean_of_its_sides(meaning):
    recording = holed()
    stream = Stream(recording, meaning=meaning, bridge=True)
    begin, t, steps, turns, pushes = whole(stream)
    assert stream.gaps == [Gap(pytest.approx(6.49), pytest.approx(7.0))]
    assert steps.sum() == pytest.approx(t[-1] - begin)
    assert np.all(steps > 0)
    at = int(np.argmax(steps))
    assert steps[at] == pytest.approx(0.5)
    near = (t > 5.495) & (t < 8.005) & (steps < 0.02) & (np.abs(t - 7.0) > 0.005)  # a second on each side
    assert np.allclose(turns[at] / steps[at], turns[near].sum(axis=0) / steps[near].sum(), rtol=1e-9)
    assert np.allclose(pushes[at + 1] / steps[at + 1], recording.read().accel[150], rtol=1e-6)


def test_pulses_after_a_gap_count_as_they_are(tmp_path):
    """The first sample after a gap counted over its own interval; only the rest of the gap is a guess."""
    n = 400
    time = 0.01 * np.arange(n)
    counts = np.tile([[7, -3, 2, 80, -1, 4]], (n, 1))
    counts[200] = [9, 9, 9, 9, 9, 9]
    keep = np.r_[0:150, 200:n]
    recording = pulse_file(tmp_path, time[keep], counts[keep])
    _, t, steps, turns, _ = whole(Stream(recording, bridge=True))
    at = int(np.argmax(steps))
    assert (steps[at], steps[at + 1]) == (pytest.approx(0.5), pytest.approx(0.01))
    assert t[at + 1] == pytest.approx(2.0)
    assert np.allclose(turns[at + 1] / (0.1 * ARCSEC), [9, 9, 9])
    assert np.allclose(turns[at] / (0.1 * ARCSEC), 50 * np.array([7, -3, 2]), rtol=0.02, atol=7)


def test_long_gap_is_refused_all_the_same():
    batch = smooth(3000).read()
    keep = np.r_[0:500, 1700:3000]
    with pytest.raises(DataError, match="too long to be bridged"):
        list(Stream(from_arrays(batch.time[keep], batch.accel[keep], batch.gyro[keep]), bridge=True))


# ---------------------------------------------------------------------------------------------------------- refused


def test_counts_without_a_scale_are_refused():
    ones = np.ones((9, 3))
    with pytest.raises(InputError, match="counts of unknown size; give --scale"):
        Stream(from_arrays(np.arange(9.0), ones, ones, counts=("gyro",)))


def test_missing_triad_is_refused():
    with pytest.raises(InputError, match="gyro_x, gyro_y, gyro_z"):
        Stream(from_arrays(np.arange(9.0), np.ones((9, 3))))


def test_unknown_meaning_is_refused():
    with pytest.raises(InputError, match="'instant'"):
        Stream(smooth(), meaning="increment")


@pytest.mark.parametrize(("start", "stop"), [(6.0, 6.0), (7.0, 6.0), (np.nan, 7.0)])
def test_no_stretch_of_time(start, stop):
    with pytest.raises(InputError, match="no stretch of time"):
        Stream(smooth(), start=start, stop=stop)


def test_nothing_in_the_time_wanted():
    with pytest.raises(DataError, match="no samples from 100 s on: they go from 5 s to 8.99 s"):
        list(Stream(smooth(), start=100.0))
    with pytest.raises(DataError, match="no samples up to 1 s: they go"):
        list(Stream(smooth(), stop=1.0))
    with pytest.raises(DataError, match="no samples between 1 s and 2 s: they go"):
        list(Stream(smooth(), start=1.0, stop=2.0))


def test_a_time_beyond_the_end_is_refused():
    pieces = []
    with pytest.raises(DataError, match=r"the samples end at 8.99 s, before the 9.1 s that were asked for \(--to\)"):
        pieces.extend(Stream(smooth(), stop=9.1))
    assert pieces
    assert list(Stream(smooth(), stop=9.0))[-1].time[-1] == pytest.approx(8.99)  # a sample from the end is the end


def test_single_sample_is_refused():
    one = np.ones((1, 3))
    with pytest.raises(DataError, match="fewer than two"):
        list(Stream(from_arrays(np.ones(1), one, one)))
