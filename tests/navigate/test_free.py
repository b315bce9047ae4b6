"""Free inertial navigation of a recording to a file."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from pyarrow import csv, parquet

from sagnac.align import static
from sagnac.align.start import biases_of, state_of
from sagnac.earth import earth_rate_enu, normal_gravity, radii
from sagnac.errors import DataError, InputError
from sagnac.frames import attitude_matrix
from sagnac.navigate.free import COLUMNS, displacement, navigate
from sagnac.navigate.state import State
from sagnac.navigate.strapdown import increments, integrate
from sagnac.recording import Batch, from_arrays, open_recording

DEGREE = np.pi / 180
PLACE = (34.0 * DEGREE, 109.0 * DEGREE, 380.0)
ANGLES = (350 * DEGREE, 2 * DEGREE, -1 * DEGREE)


def start(velocity=(0.0, 0.0, 0.0)):
    return State.from_angles(*PLACE, np.array(velocity), ANGLES)


def at_rest(duration=600.0, frequency=20.0, begin=100.0, gyro_bias=0.0, accel_bias=0.0):
    """Means of a unit at rest, with biases."""
    n = round(duration * frequency) + 1
    C = attitude_matrix(*ANGLES)
    f = np.tile(C.T @ [0, 0, normal_gravity(PLACE[0], PLACE[2])] + accel_bias, (n, 1))
    w = np.tile(C.T @ earth_rate_enu(PLACE[0]) + gyro_bias, (n, 1))
    return from_arrays(begin + np.arange(n) / frequency, f, w, name="rest.csv")


def rows_of(path):
    table = parquet.read_table(path)
    assert tuple(table.column_names) == COLUMNS
    return np.column_stack([table.column(i).to_numpy() for i in range(len(COLUMNS))])


def test_a_unit_at_rest_stays(tmp_path):
    done = navigate(at_rest(), start((0, 0, 0.1)), tmp_path / "track.parquet", meaning="mean")  # the height is held
    rows = rows_of(tmp_path / "track.parquet")
    assert done.distance < 1e-4
    assert (done.begin, done.stop, done.samples, done.rows) == (100.0, 700.0, 12000, 601)
    assert np.array_equal(np.diff(rows[:, 0]).round(9), np.ones(600))
    assert rows[:, 1:4] == pytest.approx(np.tile([34.0, 109.0, 380.0], (601, 1)), abs=1e-9)
    assert rows[:, 7:] == pytest.approx(np.tile([350.0, 2.0, -1.0], (601, 1)), abs=1e-8)
    assert np.abs(rows[:, 4:7]).max() < 1e-6


def test_it_is_what_integrate_does(tmp_path):
    """A unit that turns and accelerates, against the library's own integration of the same increments."""
    rng = np.random.default_rng(1)
    t = np.arange(0, 60.001, 0.01)
    w = 0.05 * np.sin(t[:, None] * [0.3, 0.4, 0.5] + rng.uniform(0, 6, 3))
    f = 9.79 * (np.array([0, 0, 1.0]) + 0.02 * np.sin(t[:, None] * [0.7, 0.2, 0.3]))
    recording = from_arrays(t, f, w)
    navigate(recording, start(), tmp_path / "track.parquet", interval=0.5, vertical="free")
    steps, turns, pushes = increments(t, w, f)
    path = integrate(start(), turns, pushes, steps, every=50)
    rows = rows_of(tmp_path / "track.parquet")
    latitude, longitude, _ = path.states.place
    assert np.allclose(rows[:, 0], path.time)
    assert np.allclose(rows[:, 1], np.degrees(latitude), rtol=0, atol=1e-12)
    assert np.allclose(rows[:, 2], np.degrees(longitude), rtol=0, atol=1e-12)
    assert np.allclose(rows[:, 3], path.states.height, rtol=0, atol=1e-7)
    assert np.allclose(rows[:, 4:7], path.states.velocity_enu, rtol=0, atol=1e-9)
    assert np.allclose(rows[:, 7:], np.degrees(np.transpose(path.states.angles)), rtol=0, atol=1e-9)


def test_schuler(tmp_path):
    """An error of 0.1 m/s north swings with g / R: at most v sqrt(R / g), a quarter period on; Earth rate turns it a little."""
    meridian, _ = radii(PLACE[0])
    schuler = np.sqrt(normal_gravity(PLACE[0], PLACE[2]) / (meridian + PLACE[2]))
    quarter = np.pi / 2 / schuler
    navigate(at_rest(quarter, 10), start((0, 0.1, 0)), tmp_path / "track.parquet", meaning="mean")
    end = rows_of(tmp_path / "track.parquet")[-1]
    _, north = displacement(np.array([end[1]]) * DEGREE, np.array([end[2]]) * DEGREE, *PLACE)
    assert north[0] == pytest.approx(0.1 / schuler, rel=0.01)
    assert abs(end[5]) < 0.002


def test_biases_are_taken_off(tmp_path):
    eps, nab = np.array([1e-6, -2e-6, 3e-6]), np.array([1e-3, 2e-3, -3e-3])
    biased = at_rest(gyro_bias=eps, accel_bias=nab)
    without = navigate(biased, start(), tmp_path / "track.parquet", meaning="mean")
    done = navigate(biased, start(), tmp_path / "track.parquet", meaning="mean", gyro_bias=eps, accel_bias=nab)
    assert without.distance > 100
    assert done.distance < 1e-4


def test_free_vertical_falls(tmp_path):
    """A gravity too small by 1 mGal does nothing to a held height, and lifts a free one by half of it times the time squared."""
    recording = at_rest(100)
    held, free = (
        navigate(recording, start(), tmp_path / "track.parquet", meaning="mean", vertical=v, gravity_excess=-1e-5)
        for v in ("held", "free")
    )
    assert held.final.height == 380.0
    # the unstable vertical adds (2 g / R) t^2 / 12 of it
    assert free.final.height - 380 == pytest.approx(0.5e-5 * 100**2, rel=0.01)


@pytest.mark.parametrize(("interval", "count"), [(0.05, 201), (0.5, 21), (3.0, 5), (1000.0, 2)])
def test_rows_are_as_far_apart_as_told(tmp_path, interval, count):
    """The start and the last sample are always there."""
    done = navigate(at_rest(10), start(), tmp_path / "track.parquet", meaning="mean", interval=interval)
    rows = rows_of(tmp_path / "track.parquet")
    assert len(rows) == done.rows == count
    assert (rows[0, 0], rows[-1, 0]) == (100.0, 110.0)


def test_part_of_the_recording(tmp_path):
    done = navigate(at_rest(), start(), tmp_path / "track.parquet", meaning="mean", begin=200.0, stop=300.0)
    assert (done.begin, done.stop) == (pytest.approx(200.0), pytest.approx(300.0))


def test_csv_too(tmp_path):
    navigate(at_rest(5), start(), tmp_path / "track.csv", meaning="mean")
    assert tuple(csv.read_csv(tmp_path / "track.csv").column_names) == COLUMNS


def test_summary_tells_the_drift(tmp_path):
    done = navigate(at_rest(60), start((1.0, 0, 0)), tmp_path / "track.parquet", meaning="mean")
    assert "60" in done.summary()
    assert "distance from the start 59.9 m; at most 59.9 m, at 160 s" in done.summary()
    assert done.to_dict()["final"]["height"] == 380.0


def test_memory_does_not_grow_with_the_length(tmp_path):
    """Ten times the samples, some more rows: no more memory."""
    piece = at_rest(400, 50).read()

    def recording(count):
        def stream(_):
            for k in range(count):
                yield Batch(1 + k * piece.time.size, piece.time + k * 400.02, piece.accel, piece.gyro)

        return replace(at_rest(1), _stream=stream)

    def peak(count):
        tracemalloc.start()
        navigate(recording(count), start(), tmp_path / "track.parquet", meaning="mean", interval=10.0)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(2)
    assert peak(30) < 1.2 * peak(3)


def test_progress_is_told(tmp_path):
    told = []
    navigate(at_rest(10), start(), tmp_path / "track.parquet", meaning="mean", progress=told.append)
    assert told[-1] == 200


# ---------------------------------------------------------------------------------------------------------- refused


def test_start_that_does_not_meet_the_samples(tmp_path):
    with pytest.raises(DataError, match=r"samples begin at 100 s, but the start is known at 50 s"):
        navigate(at_rest(), start(), tmp_path / "track.parquet", begin=50.0)
    assert not list(tmp_path.iterdir())


def test_gap_leaves_nothing_half_written(tmp_path):
    batch = at_rest().read()
    keep = (batch.time < 300) | (batch.time > 305)
    recording = from_arrays(batch.time[keep], batch.accel[keep], batch.gyro[keep], name="rest.csv")
    with pytest.raises(DataError, match=r"no samples from 299.95 s to 305.05 s.*--bridge-gaps"):
        navigate(recording, start(), tmp_path / "track.parquet", meaning="mean")
    assert not list(tmp_path.iterdir())
    done = navigate(recording, start(), tmp_path / "track.parquet", meaning="mean", bridge=True)
    assert done.gaps[0] == (pytest.approx(299.95), pytest.approx(305.05))
    assert "filled with the mean" in done.summary()
    assert done.distance < 1e-3  # at rest the mean is right


@pytest.mark.parametrize("name", ["track.txt", "track"])
def test_unknown_kind_of_file(tmp_path, name):
    with pytest.raises(InputError, match=r"\.parquet or \.csv"):
        navigate(at_rest(), start(), tmp_path / name)


@pytest.mark.parametrize("interval", [0.0, -1.0, np.nan])
def test_no_interval(tmp_path, interval):
    with pytest.raises(InputError, match="interval"):
        navigate(at_rest(), start(), tmp_path / "track.parquet", interval=interval)


def test_the_recording_itself_is_kept(tmp_path):
    path = tmp_path / "rest.csv"
    path.write_text(
        "time [s],gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s],accel_x [g],accel_y [g],accel_z [g]\n0,0,0,0,0,0,1\n"
    )
    with pytest.raises(InputError, match="is the recording itself"):
        navigate(open_recording(path), start(), path)


# ------------------------------------------------- the public laser-gyro log of a parked vehicle (PSINS data set)


def test_public_recording_drifts_less_than_another_toolbox(parked_log, tmp_path):
    """Its own, with the height held: 7.1 m at 300 s, 35.2 m at 600 s, 90.2 m at 900 s, 312.4 m at 1547 s."""
    place = static.place_of(34.246048 * DEGREE, 108.909664 * DEGREE, 380.0)
    found = static.align(parked_log, place, stop=300.0)
    state, biases = state_of(found), biases_of(found)
    ends = []
    for use in (False, True):
        out = tmp_path / f"track{use:d}.parquet"
        gyro, accel = biases if use else (None, None)
        done = navigate(parked_log, state, out, begin=found.time, gyro_bias=gyro, accel_bias=accel)
        rows = rows_of(out)
        east, north = displacement(rows[:, 1] * DEGREE, rows[:, 2] * DEGREE, place.latitude, place.longitude, 380.0)
        distance = np.hypot(east, north)
        for after, theirs in ((300, 7.1), (600, 35.2), (900, 90.2), (1547, 312.4)):
            assert distance[np.searchsorted(rows[:, 0], 300 + after - 1e-6)] < theirs
        assert done.samples == 154_718
        ends.append(done.distance)
    assert ends[0] < 320
    assert ends[1] < 0.5 * ends[0]
