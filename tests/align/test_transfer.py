"""Transfer alignment from files to files: what is written, what is refused, and that nothing is half-written."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy.stats import chi2
from voyages import DEG, START, G, config, voyage

from sagnac import __version__, from_arrays, open_recording
from sagnac.align import transfer as module
from sagnac.align.result import load
from sagnac.align.transfer import covariance, examine, slave_of, transfer
from sagnac.errors import DataError, InputError
from sagnac.files import sha256

ARCMIN = DEG / 60


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    y = voyage("s-turn")
    master, slave = y.write(folder)
    settings = folder / "config.toml"
    config(samples="mean").save(settings)
    return y, master, slave, settings


@pytest.fixture(scope="module")
def done(logs, tmp_path_factory):
    y, master, slave, settings = logs
    out = tmp_path_factory.mktemp("out")
    times = []
    return y, out, transfer(master, slave, settings, out, progress=times.append), times


def written(folder):
    return sorted(p.name for p in folder.iterdir())


# ------------------------------------------------------------------------------------------------- what comes out


def test_the_truth_is_found_within_its_uncertainty(done):
    y, _, found, _ = done
    for name, true in y.truth.items():
        if name in found.values():
            assert abs(found[name].value - true) < 4 * found[name].standard_uncertainty, name
    # methods.md: azimuth 0.25', level 0.024' at 120 s of this S-turn
    assert found["misalignment.z"].standard_uncertainty == pytest.approx(0.25 * ARCMIN, rel=0.02)
    assert found["misalignment.x"].standard_uncertainty == pytest.approx(0.024 * ARCMIN, rel=0.02)


def test_logs_since_an_epoch_are_on_one_clock(logs, done, tmp_path):
    # the same logs with times since 1970: whole nanoseconds of the slave, doubles of the master
    _, master, slave, given = logs
    begin = 1_700_000_000
    table = parquet.read_table(slave)
    at = table.schema.get_field_index("time [s]")
    stamps = np.round(table.column(at).to_numpy() * 1e9).astype(np.int64) + begin * 10**9
    parquet.write_table(table.set_column(at, "time [ns]", pa.array(stamps)), tmp_path / "slave.parquet")
    table = parquet.read_table(master)
    at = table.schema.get_field_index("time [s]")
    times = table.column(at).to_numpy() + begin
    parquet.write_table(table.set_column(at, "time [s]", pa.array(times)), tmp_path / "master.parquet")
    found = transfer(tmp_path / "master.parquet", tmp_path / "slave.parquet", given, tmp_path / "out")
    for p in found.parameters:
        assert abs(p.value - done[2][p.name].value) < 0.02 * p.standard_uncertainty


def test_the_attitude_is_that_of_the_slave(done):
    y, _, found, _ = done
    # heading of the vehicle less what the slave is turned to port; the vehicle is level
    heading = y.angles[-1, 0] - y.truth["misalignment.z"]
    assert abs(found["heading"].value - heading) < 4 * found["heading"].standard_uncertainty
    assert found["pitch"].value == pytest.approx(y.truth["misalignment.x"], abs=0.3 * ARCMIN)
    assert found["roll"].value == pytest.approx(y.truth["misalignment.y"], abs=0.3 * ARCMIN)
    place = {p.name: p for p in found.place}
    assert place["latitude"].value == pytest.approx(y.place[-1, 0], abs=3e-6)
    assert place["v_east"].value == pytest.approx(y.velocity[-1, 0], abs=0.05)
    assert set(place) == {"latitude", "longitude", "height", "v_east", "v_north", "v_up"}


def test_the_files(done, logs):
    _, out, found, times = done
    _, master, slave, settings = logs
    assert written(out) == ["alignment.json", "history.parquet"]
    assert load(out / "alignment.json") == found
    assert [(s.file, s.sha256) for s in found.source] == [(p.name, sha256(p)) for p in (master, slave, settings)]
    assert (found.kind, found.method, found.matching, found.states) == ("transfer", "wander", "velocity", "short")
    assert found.software.version == __version__
    assert found.innovations.updates == 1200
    assert found.time == times[-1] == 120.0
    assert [m.after for m in found.course] == [1, 3, 10, 30, 60, 120]
    last = found.course[-1].standard_uncertainty
    assert last == pytest.approx([p.standard_uncertainty for p in found.parameters], rel=1e-12)
    assert found.remarks == ()


def test_the_history(done):
    _, out, found, _ = done
    table = parquet.read_table(out / "history.parquet")
    assert table.num_rows == 1200
    assert table.schema.metadata[b"sagnac"] == b"sagnac/alignment-history/1"
    for name in ("misalignment.z", "gyro.bias.x", "accel.bias.y"):
        unit = found[name].unit
        assert table[f"{name} [{unit}]"][-1].as_py() == found[name].value
        assert table[f"{name} sigma [{unit}]"][-1].as_py() == pytest.approx(found[name].standard_uncertainty, rel=1e-9)
    innovation = table["innovation velocity.x [m/s]"].to_numpy() / table["innovation velocity.x sigma [m/s]"].to_numpy()
    assert np.sqrt((innovation**2).mean()) == pytest.approx(found.innovations.ratio["velocity.x"], rel=1e-9)
    assert table["heading [deg]"][-1].as_py() * DEG == pytest.approx(found["heading"].value)
    assert {"time [s]", "used", "nis", "pitch sigma [deg]", "latitude [deg]", "height [m]"} <= set(table.column_names)


def test_smoothed_estimates_are_in_the_history(logs, tmp_path):
    _, master, slave, _ = logs
    settings = config(samples="mean", smooth=True)
    found = transfer(master, slave, settings, tmp_path)
    table = parquet.read_table(tmp_path / "history.parquet")
    smoothed = table["misalignment.z smoothed [rad]"].to_numpy()
    assert smoothed[0] == pytest.approx(found["misalignment.z"].value, abs=2e-5)
    assert [s.file for s in found.source] == ["master.parquet", "slave.parquet"]


def test_no_folder_writes_nothing(logs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, master, slave, settings = logs
    transfer(str(master), open_recording(slave), str(settings))
    assert written(tmp_path) == []


def test_a_csv_recording_and_instantaneous_samples(logs, tmp_path):
    y, master, _, _ = logs
    instant = 0.5 * (y.gyro + np.concatenate([y.gyro[1:], y.gyro[-1:]]))
    force = 0.5 * (y.accel + np.concatenate([y.accel[1:], y.accel[-1:]]))
    rows = np.column_stack([y.time, force, instant])[:6001]
    header = "t,ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]"
    np.savetxt(tmp_path / "s.csv", rows, delimiter=",", header=header, comments="", fmt="%.15g")
    names = {f"{s}_{a}": f"{s[0]}{a}" for s in ("accel", "gyro") for a in "xyz"} | {"time": "t"}
    slave = open_recording(tmp_path / "s.csv", rename=names, units_of={"time": "s"})
    found = transfer(master, slave, config())
    assert found.time == pytest.approx(60.0)
    assert (
        abs(found["misalignment.x"].value - y.truth["misalignment.x"])
        < 5 * found["misalignment.x"].standard_uncertainty
    )


def test_a_gap_of_the_slave_is_bridged_and_named(tmp_path):
    y = voyage("s-turn")
    kept = (y.time <= 60.0) | (y.time >= 60.4)
    gappy = replace(y, time=y.time[kept], gyro=y.gyro[kept], accel=y.accel[kept])
    found = transfer(*gappy.write(tmp_path), config(samples="mean"))
    (stretch,) = found.skipped
    assert (stretch.start, stretch.stop) == (60.0, pytest.approx(60.4))
    assert "left out: 60 s to 60.4 s: " in found.summary()
    for name in ("misalignment.x", "misalignment.y", "misalignment.z"):
        assert abs(found[name].value - y.truth[name]) < 4 * found[name].standard_uncertainty


def test_a_gap_that_is_too_long_is_refused(tmp_path):
    y = voyage("s-turn")
    kept = (y.time <= 60.0) | (y.time >= 65.0)
    gappy = replace(y, time=y.time[kept], gyro=y.gyro[kept], accel=y.accel[kept])
    with pytest.raises(DataError, match="no samples from 60 s to 65 s"):
        transfer(*gappy.write(tmp_path), config(samples="mean"))


def test_noise_of_the_first_attitude_is_in_the_uncertainty_of_the_mounting(tmp_path):
    y = voyage("s-turn", attitude_noise=2.0)
    found = transfer(*y.write(tmp_path), config(samples="mean"))
    for name in ("misalignment.x", "misalignment.y", "misalignment.z"):
        assert found[name].standard_uncertainty == pytest.approx(2 * ARCMIN, rel=0.1)
        assert abs(found[name].value - y.truth[name]) < 4 * found[name].standard_uncertainty
    assert "the mounting is told against one sample of the master's attitude" in found.remarks[0]
    matched = transfer(
        tmp_path / "master.parquet",
        tmp_path / "slave.parquet",
        config(samples="mean", matching="velocity+attitude", noise__attitude="2 arcmin"),
    )
    assert matched["misalignment.x"].standard_uncertainty < 0.1 * ARCMIN
    assert (
        abs(matched["misalignment.x"].value - y.truth["misalignment.x"])
        < 4 * matched["misalignment.x"].standard_uncertainty
    )
    assert set(matched.innovations.ratio) == {
        f"{k}.{a}" for k, axes in (("velocity", "xy"), ("attitude", "xyz")) for a in axes
    }


def test_a_large_mounting_is_looked_for_first(tmp_path):
    y = voyage("s-turn", mounting=(8.0, -6.0, 25.0))
    found = transfer(*y.write(tmp_path), config(samples="mean", initial__misalignment="20 deg"))
    for name in ("misalignment.x", "misalignment.y", "misalignment.z"):
        assert abs(found[name].value - y.truth[name]) < 4 * found[name].standard_uncertainty
    assert "show a mounting of about " in found.remarks[0]
    assert "from which the filter starts" in found.remarks[0]


def test_position_and_height_belong_to_the_full_states(logs):
    _, master, slave, _ = logs
    found = transfer(master, slave, config(samples="mean", states="full", initial__delay="0.05 s"))
    assert {"accel.bias.z", "delay"} <= set(found.values())
    assert not {n for n in found.values() if n.endswith("_error.x")}
    assert abs(found["delay"].value) < 4 * found["delay"].standard_uncertainty + 1e-4
    place = {p.name: p.standard_uncertainty for p in found.place}
    assert place["height"] == pytest.approx(10.0, rel=0.01)  # velocities do not show it


@pytest.mark.statistical
def test_sound_voyages_are_not_refused_and_errors_are_as_stated(tmp_path):
    """Twenty voyages with mounting, biases and noise drawn as the configuration says, half of them with a noisy attitude."""
    squares = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        y = voyage(
            "swaying" if seed % 2 else "s-turn",
            seed=seed,
            mounting=tuple(rng.normal(size=3) * [0.2, 0.2, 0.5]),
            gyro_bias=tuple(rng.normal(size=3) * 0.01),
            accel_bias=tuple(rng.normal(size=3) * 50),
            attitude_noise=0.5 * (seed % 4 > 1),
        )
        found = transfer(*y.write(tmp_path), config(samples="mean"))
        known = [p for p in found.parameters if p.name in y.truth]
        squares.append([((p.value - y.truth[p.name]) / p.standard_uncertainty) ** 2 for p in known])
    # the mean of 20 squares of unit normals lies in this band with 99.98 %: over 8 parameters one in 600 such tests fails
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 20) / 20
    means = np.mean(squares, axis=0)
    assert np.all(means > low), means
    assert np.all(means < high), means


# ------------------------------------------------------------------------------------------------- all or nothing


def test_a_picture_that_fails_leaves_nothing(logs, tmp_path):
    _, master, slave, settings = logs

    def fails(*_):
        raise RuntimeError("no ink")

    with pytest.raises(RuntimeError, match="no ink"):
        transfer(master, slave, settings, tmp_path, draw={"picture.png": fails})
    assert written(tmp_path) == []


def test_pictures_are_drawn_beside_the_result(logs, tmp_path):
    _, master, slave, settings = logs
    found = transfer(
        master,
        slave,
        settings,
        tmp_path / "new",
        draw={"p.txt": lambda a, r, path: path.write_text(f"{a.time} {len(r.time)}")},
    )
    assert written(tmp_path / "new") == ["alignment.json", "history.parquet", "p.txt"]
    assert (tmp_path / "new" / "p.txt").read_text() == f"{found.time} 1200"


def test_refused_data_leave_what_was_there(tmp_path):
    y = voyage("s-turn")
    master, slave = replace(y, accel=-y.accel).write(tmp_path)
    out = tmp_path / "out"
    out.mkdir()
    (out / "alignment.json").write_text("old")
    with pytest.raises(DataError, match="the accelerometers have the other sign"):
        transfer(master, slave, config(samples="mean"), out)
    assert written(out) == ["alignment.json"]
    assert (out / "alignment.json").read_text() == "old"


def test_inputs_are_not_written_over(logs, tmp_path):
    _, master, slave, settings = logs
    (tmp_path / "history.parquet").write_bytes(master.read_bytes())
    with pytest.raises(InputError, match="history.parquet: is an input; inputs are never modified"):
        transfer(tmp_path / "history.parquet", slave, settings, tmp_path)
    assert (tmp_path / "history.parquet").read_bytes() == master.read_bytes()
    with pytest.raises(InputError, match=r"is a file; the results need a folder"):
        transfer(master, slave, settings, settings)


def test_a_master_without_attitude(tmp_path):
    master, slave = voyage("straight").write(tmp_path, attitude=True)
    with pytest.raises(
        InputError, match=r"master.parquet: the columns heading \[deg\], pitch \[deg\] and roll \[deg\] are missing"
    ):
        transfer(master, slave, config(samples="mean"), tmp_path / "out")
    assert not (tmp_path / "out").exists()


# ------------------------------------------------------------------------------------------------------ the slave


def recorded(folder, time, turns, pushes, worth=(1e-6, 1e-4)):
    """A recording of whole pulses; the first sample belongs to an interval before the first stamp."""
    counts = [
        np.rint(np.concatenate([v[:1], v]) / w).astype(np.int64) for v, w in zip((turns, pushes), worth, strict=True)
    ]
    table = {"time [s]": time}
    table |= {f"gyro_{a} [pulse]": counts[0][:, i] for i, a in enumerate("xyz")}
    table |= {f"accel_{a} [pulse]": counts[1][:, i] for i, a in enumerate("xyz")}
    parquet.write_table(pa.table(table), folder / "pulses.parquet")
    scale = {"gyro": f"{1 / worth[0]!r} pulse/rad", "accel": f"{1 / worth[1]!r} pulse*s/m"}
    return open_recording(folder / "pulses.parquet", scale=scale), counts


def test_pulses_are_increments_as_they_are(tmp_path):
    y = voyage("swaying").slave
    stamped = y.time + 1e-4 * np.sin(np.arange(y.time.size))  # uneven stamps of even counting
    recording, counts = recorded(tmp_path, stamped, y.turns, y.pushes)
    slave = slave_of(recording, config())
    assert np.array_equal(slave.time, stamped)
    assert slave.turns == pytest.approx(counts[0][1:] * 1e-6, rel=1e-6)  # the interval is a mean of the stamps
    assert slave.pushes == pytest.approx(counts[1][1:] * 1e-4, rel=1e-6)


def test_a_gap_between_pulses_has_what_the_samples_around_it_say(tmp_path):
    y = voyage("straight").slave
    kept = np.r_[0:1000, 1050:3000]
    recording, counts = recorded(tmp_path, y.time[kept], y.turns[kept[1:] - 1], y.pushes[kept[1:] - 1])
    slave = slave_of(recording, config())
    (gap,) = slave.gaps()
    assert slave.steps[gap] == pytest.approx(0.51)
    around = 0.5 * (counts[1][gap] + counts[1][gap + 1]) * 1e-4 / 0.01
    assert slave.pushes[gap] == pytest.approx(around * 0.51, rel=1e-6)


def test_means_and_instants():
    time = np.array([0.0, 1.0, 2.0, 3.0])
    values = np.array([[1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0], [4.0, 0, 0]])
    recording = from_arrays(time, values, values)
    assert slave_of(recording, config(samples="mean")).turns[:, 0].tolist() == [2, 3, 4]
    assert slave_of(recording, config()).turns[:, 0] == pytest.approx([1.5, 2.5, 3.5])


@pytest.mark.parametrize(
    ("recording", "says"),
    [
        (from_arrays([0, 1], np.ones((2, 3))), "this method needs the columns gyro_x, gyro_y, gyro_z"),
        (from_arrays([0, 1], None, np.ones((2, 3))), "this method needs the columns accel_x, accel_y, accel_z"),
        (
            from_arrays([0, 1], np.ones((2, 3)), np.ones((2, 3)), counts=("gyro",)),
            "gyro is in counts; give its nominal scale",
        ),
        (from_arrays([0], np.ones((1, 3)), np.ones((1, 3))), "fewer than two samples"),
        (from_arrays([0, 1], np.ones((2, 3)), single={"gyro_x": [1, 2]}), "gyro lacks gyro_y, gyro_z"),
    ],
)
def test_recordings_that_are_no_slave(recording, says):
    with pytest.raises(InputError, match=says):
        slave_of(recording, config())


def test_checks_see_what_the_filter_gets(logs):
    y, master, slave, _ = logs
    samples = slave_of(open_recording(slave), config(samples="mean"))
    assert examine(samples, module.open_master(master), config()) == ([], [], 0.0)
    assert samples.pushes[:, 2].mean() == pytest.approx(0.01 * G, rel=0.01)
    assert y.time[0] == samples.time[0]


# ------------------------------------------------------------------------------------------------- without data


def published():
    course = {**START, "speed": "19.44 kn", "heading": "90 deg", "leg": [{"duration": "900 s"}]}
    return config(trajectory=course)


def test_the_published_case_without_data(tmp_path):
    """methods.md, section 5: 1-sigma of phi in arcmin at 10, 30, 60, 120, 300, 600, 900 s."""
    settings = published()
    settings.save(tmp_path / "config.toml")
    found = covariance(tmp_path / "config.toml", tmp_path / "out")
    names = [p.name for p in found.parameters]
    table = {m.after: dict(zip(names, m.standard_uncertainty, strict=True)) for m in found.course}
    expected = {
        10: (0.2105, 0.2104, 29.998),
        30: (0.1743, 0.1735, 29.479),
        60: (0.1737, 0.1722, 20.73),
        120: (0.1722, 0.1721, 7.02),
        300: (0.1717, 0.1720, 4.70),
        600: (0.1717, 0.1720, 4.49),
        900: (0.1717, 0.1720, 4.44),
    }
    for after, (one, other, azimuth) in expected.items():
        sigma = {a: table[after][f"misalignment.{a}"] / ARCMIN for a in "xyz"}
        # the table is in w, the mounting in body axes: x and y of one are y and x of the other
        assert sorted([sigma["x"], sigma["y"]]) == pytest.approx(sorted([one, other]), rel=0.005)
        assert sigma["z"] == pytest.approx(azimuth, rel=0.005)
    assert written(tmp_path / "out") == ["alignment.json", "history.parquet"]
    assert load(tmp_path / "out" / "alignment.json") == found


def test_without_data_there_are_no_values():
    found = covariance(published())
    assert found.kind == "covariance"
    assert all(p.value is None for p in (*found.parameters, *found.attitude))
    assert found.innovations is None
    assert found.place == ()
    assert {n.name for n in found.not_observed} >= {"accel.bias.x", "accel.bias.y", "gyro.bias.z"}
    text = found.summary()
    assert text.startswith("Covariance analysis, method wander")
    assert "misalignment.z                     -          4.4  arcmin" in text
    table = json.loads(found.to_json())
    assert table["parameters"][0]["value"] is None


def test_data_and_no_data_agree(done):
    _, _, found, _ = done
    predicted = covariance(config(trajectory=voyage_course()))
    for p in predicted.parameters:
        assert found[p.name].standard_uncertainty == pytest.approx(p.standard_uncertainty, rel=0.05), p.name
    singular = np.array(found.singular_values[:6]) / predicted.singular_values[:6]
    assert singular == pytest.approx(np.ones(6), rel=0.05)


def voyage_course():
    from voyages import S_TURN

    return S_TURN


def test_without_a_course_there_is_nothing_to_follow():
    with pytest.raises(InputError, match=r"\[trajectory\] is missing"):
        covariance(config())
