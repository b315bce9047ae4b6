"""A noise test of all axes: what goes in comes out, and what would be wrong is refused."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from sagnac.errors import DataError, InputError
from sagnac.noise import gather
from sagnac.noise.study import study
from sagnac.plan import Unit
from sagnac.recording import from_arrays, open_recording
from sagnac.simulate.noise import AxisNoise, NoiseModel

DT = 0.01
UG, DEG_H = 9.80665e-6, math.pi / 180 / 3600
ACCEL = NoiseModel(density=60 * UG, walk=4 * UG)
GYRO = NoiseModel(density=0.2 * DEG_H * 60, walk=1.5 * DEG_H)


def samples(model: NoiseModel, seed: int, n: int) -> np.ndarray:
    out = np.zeros((n, 3))
    for k in range(3):
        column = np.zeros(n)
        AxisNoise(model, DT, seed, (k,)).add(column)
        out[:, k] = column
    return out


def gyros(n=100_000, seed=1):
    return from_arrays(DT * np.arange(n), gyro=samples(GYRO, seed + 100, n))


def log(n=100_000, seed=1, **more):
    time = DT * np.arange(n)
    accel = samples(ACCEL, seed, n) + np.array([0.0, 0.0, 9.81])
    return from_arrays(time, accel, samples(GYRO, seed + 100, n), **more)


@pytest.fixture(scope="module")
def found():
    return study(log(), unit=Unit(model="demo", serial="7"))


def test_all_six_axes_are_judged_at_once(found):
    assert [a.name for a in found.axes] == ["accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z"]
    assert not found.refused
    assert found.method == "exact"
    assert found.samples == 100_000
    assert found.interval == pytest.approx(DT, rel=1e-9)
    assert found.unit.serial == "7"


@pytest.mark.parametrize(("sensor", "model"), [("accel", ACCEL), ("gyro", GYRO)])
def test_what_went_in_comes_out_within_its_uncertainty(found, sensor, model):
    for axis in "xyz":
        own = found[f"{sensor}_{axis}"]
        white = own["white"]
        assert abs(white.value - model.density) < 4.0 * white.standard_uncertainty
        assert white.standard_uncertainty < 0.01 * model.density
        walk = own["walk"]
        assert abs(walk.value - model.walk) < 4.0 * walk.standard_uncertainty
        assert walk.lower < walk.value < (walk.upper or math.inf)
        assert own.fit.p_value is not None
        assert own.fit.p_value > 1e-3


def test_an_accelerometer_at_one_g_loses_nothing(found):
    bare = study(from_arrays(DT * np.arange(100_000), samples(ACCEL, 1, 100_000)))
    assert found["accel_z"]["white"].value == pytest.approx(bare["accel_z"]["white"].value, rel=1e-9)
    assert found["accel_z"].mean == pytest.approx(9.81, rel=1e-4)


def test_curves_and_spectra_agree_with_the_terms(found):
    for axis in found.axes:
        curve, white = axis.curve, axis["white"].value
        assert curve.deviation[0] == pytest.approx(white / math.sqrt(DT), rel=0.02)
        assert all(low < d < high for low, d, high in zip(curve.lower, curve.deviation, curve.upper, strict=True))
        assert len(curve.fitted) == len(curve.tau)
        assert axis.spectrum is not None
        upper = [d for f, d in zip(axis.spectrum.frequency, axis.spectrum.density, strict=True) if 10 < f < 45]
        assert np.mean(upper) == pytest.approx(2 * white**2, rel=0.02)  # one-sided


def test_the_pyramid_tells_the_same(found):
    streamed = study(log(), memory=1_000_000)
    assert streamed.method == "pyramid"
    for axis in found.axes:
        other = streamed[axis.name]
        assert other["white"].value == pytest.approx(axis["white"].value, rel=0.01)
        assert np.allclose(other.curve.deviation[:5], axis.curve.deviation[:5], rtol=1e-6)


@pytest.mark.parametrize("kind", ["modified", "hadamard"])
def test_other_deviations(found, kind):
    other = study(gyros(), kind=kind)
    assert other.kind == kind
    assert other["gyro_x"]["white"].value == pytest.approx(found["gyro_x"]["white"].value, rel=0.01)
    # NIST SP 1065 section 5: of white noise the modified deviation is lower from two samples on, Hadamard's the same
    ratio = other["gyro_x"].curve.deviation[2] / found["gyro_x"].curve.deviation[2]
    assert ratio < 0.95 if kind == "modified" else ratio == pytest.approx(1.0, abs=0.02)
    for axis in other.axes:  # the line goes through the marks
        curve = axis.curve
        inside = [low < f < high for low, f, high in zip(curve.lower, curve.fitted, curve.upper, strict=True)]
        assert len(inside) == len(curve.tau)
        assert np.mean(inside) > 0.85
    assert ("from the Allan deviation" in other.summary()) == (kind == "modified")


def test_axes_of_a_sensor_that_lacks_others_and_raw_counts():
    n = 20_000
    rng = np.random.default_rng(2)
    found = study(from_arrays(DT * np.arange(n), single={"accel_z": 30_000 + rng.normal(0, 5, n)}, counts=("accel",)))
    assert [a.name for a in found.axes] == ["accel_z"]
    assert found["accel_z"].unit == "count"
    assert found["accel_z"]["white"].unit == "count/Hz^0.5"
    assert found["accel_z"]["white"].value == pytest.approx(0.5, rel=0.02)
    assert "count/sqrt(Hz)" in found.summary()


def test_stretches_between_gaps_are_pooled():
    batch = gyros(60_000).read()
    keep = np.ones(60_000, dtype=bool)
    keep[20_000:23_000] = keep[41_000:41_003] = False
    cut = from_arrays(batch.time[keep], gyro=batch.gyro[keep])
    found = study(cut)
    assert found.stretches == (20_000, 18_000, 18_997)
    gap = next(d for d in found.disturbances if d.kind == "gap")
    assert "3 samples lost in 1 place (0.01%, 3 in a row at most): bridged" in gap.text
    assert "1 gap, 30 s in all" in gap.text
    assert not gap.spoils
    assert found["gyro_x"]["white"].value == pytest.approx(GYRO.density, rel=0.02)
    assert found.interval == pytest.approx(DT, rel=1e-9)


def test_the_longest_losses_that_are_bridged_are_told_as_such_alone():
    batch = gyros(60_000).read()
    keep = np.ones(60_000, dtype=bool)
    for first in range(2000, 60_000, 6000):
        keep[first : first + 64] = False
    found = study(from_arrays(batch.time[keep], gyro=batch.gyro[keep]))
    gap = next(d for d in found.disturbances if d.kind == "gap")
    assert "640 samples lost in 10 places" in gap.text
    assert "pooled" not in gap.text


def test_a_log_that_loses_every_tenth_sample_is_refused_with_the_reason():
    batch = gyros(20_000).read()
    keep = np.arange(20_000) % 10 != 5
    with pytest.raises(
        DataError, match=r"too few to tell .* by its times the log has \d+ gaps: look at what loses samples"
    ):
        study(from_arrays(batch.time[keep], gyro=batch.gyro[keep]))


def test_a_window_of_the_log():
    found = study(gyros(), start=100.0, stop=500.0)
    assert found.samples == 40_000
    assert found.source[0].start == pytest.approx(100.0)
    with pytest.raises(DataError, match="no samples between"):
        study(log(1000), start=1e6)
    with pytest.raises(DataError, match="30 samples without a gap are too few"):
        study(log(1000), stop=0.3)


def test_pulses_that_the_noise_hardly_moves_on(tmp_path):
    """Rounding to pulses is no white residue from sample to sample where the angle moves on by less than a pulse in each.

    White noise of 0.002 deg/sqrt(h) and pulses of 0.1 arcsec: the residue of a whole one is uniform, 0.1 / sqrt(12) arcsec.
    """
    n, pulse = 360_000, math.radians(0.1 / 3600)
    density = 0.002 * DEG_H * 60
    rng = np.random.default_rng(6)
    rate = np.array([2e-6, 4.7e-5, 5.3e-5]) + density / math.sqrt(DT) * rng.normal(size=(n, 3))
    counts = np.diff(np.floor(np.cumsum(rate * DT, axis=0) / pulse), axis=0, prepend=0.0)
    columns = {"time [s]": DT * np.arange(n)} | {f"gyro_{a} [pulse]": counts[:, k] for k, a in enumerate("xyz")}
    parquet.write_table(pa.table(columns), tmp_path / "pulses.parquet")
    found = study(open_recording(tmp_path / "pulses.parquet", scale={"gyro": "10 pulse/arcsec"}))
    assert not found.refused
    for axis in found.axes:
        assert axis["white"].value == pytest.approx(density, rel=0.05)
        assert axis["quantisation"].value == pytest.approx(pulse / math.sqrt(12), rel=0.05)
        assert axis.fit.shortest > 2 * DT
        assert any("are left out" in note for note in axis.fit.notes)


# ------------------------------------------------------------------------------------------------- disturbances


def disturbed(change, n=100_000):
    batch = gyros(n).read()
    assert batch.gyro is not None
    gyro = batch.gyro.copy()
    change(batch.time, gyro)
    return from_arrays(batch.time, gyro=gyro)


def test_an_axis_that_a_step_would_make_wrong_is_refused_and_the_others_given():
    def step(time, gyro):
        gyro[time >= 600, 1] += 150 * DEG_H

    found = study(disturbed(step))
    assert [r.name for r in found.refused] == ["gyro_y"]
    assert "changes its mean by 1" in found.refused[0].reason
    assert "deg/h at 6" in found.refused[0].reason
    assert "--to '60" in " ".join(found.remarks) or "--to '59" in " ".join(found.remarks)
    assert len(found.axes) == 2
    page = found.summary()
    assert "refused" in page
    told = study(disturbed(step), despite=["step"])
    assert not told.refused
    assert any(d.kind == "step" and d.axis == "gyro_y" for d in told.disturbances)


def test_a_line_is_named_with_frequency_and_size():
    def dither(time, gyro):
        gyro[:, 2] += 100 * DEG_H * np.sin(2 * np.pi * 13.7 * time)

    found = study(disturbed(dither), despite=["line", "misfit"])
    line = next(d for d in found.disturbances if d.kind == "line" and d.axis == "gyro_z")
    assert line.frequency == pytest.approx(13.7, rel=0.02)
    assert line.size == pytest.approx(100 * DEG_H, rel=0.1)
    assert not any(d.kind == "line" and d.axis != "gyro_z" for d in found.disturbances)


def test_a_strong_line_refuses_its_axis():
    def dither(time, gyro):
        gyro[:, 2] += 2000 * DEG_H * np.sin(2 * np.pi * 1.37 * time)

    found = study(disturbed(dither))
    assert [r.name for r in found.refused] == ["gyro_z"]


def test_when_no_axis_can_be_judged_the_reasons_are_told():
    def shaken(time, gyro):
        gyro[(time > 200) & (time < 300)] += 0.1

    with pytest.raises(DataError, match=r"no axis can be judged: gyro_. .*likewise") as told:
        study(disturbed(shaken))
    assert "undisturbed for longest (699.8 s): --from '300.2 s'" in str(told.value)


def test_an_effect_of_temperature_is_taken_off_and_told():
    n = 100_000
    time = DT * np.arange(n)
    warmth = 300.0 + 4.0 * np.sin(2 * np.pi * time / 650.0)
    batch = gyros(n).read()
    assert batch.gyro is not None
    gyro = batch.gyro[:, :2].copy()
    gyro[:, 0] += 60 * DEG_H * (warmth - 300.0)
    for memory in (gather.MEMORY, 100_000):
        single = {"gyro_x": gyro[:, 0], "gyro_y": gyro[:, 1]}
        found = study(from_arrays(time, single=single, rig={"temperature": warmth}), memory=memory)
        told = [d for d in found.disturbances if d.kind == "temperature"]
        assert [d.axis for d in told] == ["gyro_x", "gyro_y"]
        assert "not clear enough to be taken off" in told[1].text
        assert told[0].size == pytest.approx(60 * DEG_H, rel=0.15)
        assert "deg/h/K" in told[0].text
        assert found.environment.temperature is not None
        assert found["gyro_x"].value("walk") < 4 * GYRO.walk
    assert "with it there would be" in told[0].text
    assert "with it there would be" not in told[1].text


def test_what_is_unknown_is_refused():
    with pytest.raises(InputError, match="there is no deviation 'total'"):
        study(log(1000), kind="total")
    with pytest.raises(InputError, match="--despite noise: there are"):
        study(log(1000), despite=["noise"])


def test_a_file_is_named_with_its_hash(tmp_path):
    batch = log(5000).read()
    assert batch.gyro is not None
    columns = {"time [s]": batch.time} | {f"gyro_{a} [rad/s]": batch.gyro[:, k] for k, a in enumerate("xyz")}
    parquet.write_table(pa.table(columns), tmp_path / "still.parquet")
    found = study(open_recording(tmp_path / "still.parquet"))
    assert found.source[0].sha256 is not None
    assert found.source[0].file.endswith("still.parquet")


def test_an_axis_without_noise_is_refused_and_the_others_given():
    n = 20_000
    time, rate = DT * np.arange(n), samples(GYRO, 3, n)
    rate[:, 1] = 1e-3 * (-1.0) ** np.arange(n)  # repeats a pattern
    rate[:, 2] = 5.0 * DEG_H / 3600.0 * time  # 5 deg/h/h and nothing else
    found = study(from_arrays(time, gyro=rate), despite=["rounded", "repeated", "drift"])
    assert [a.name for a in found.axes] == ["gyro_x"]
    assert {r.name for r in found.refused} == {"gyro_y", "gyro_z"}
    assert "gyro_y: The variance at tau = 0.02 s is" in found.refused[0].reason
    assert "gyro_z: The samples lie on a straight line: there is no noise to see" in found.refused[1].reason


def filtered(seed, order, cut, n=1 << 17):
    """Samples of a gyro of 0.2 deg/sqrt(h) and 4 deg/h behind a low-pass filter, cut over half the sample rate."""
    from scipy.signal import butter, lfilter

    model = NoiseModel(density=0.2 * DEG_H * 60, instability=4 * DEG_H, band=(0.5 * DT, 10.0 * n * DT))
    return lfilter(*butter(order, cut), samples(model, seed, n + 500), axis=0)[500:]


@pytest.mark.parametrize(("order", "cut"), [(1, 0.3), (2, 0.4)])
def test_a_sensor_that_filters_its_samples_keeps_its_random_walk(order, cut):
    rate = filtered(order, order, cut)
    found = study(from_arrays(DT * np.arange(len(rate)), gyro=rate))
    assert not found.refused
    assert not [d for d in found.disturbances if d.kind == "line"]  # the edge of the filter is no peak
    for axis in found.axes:
        white = axis["white"]
        assert white.value == pytest.approx(0.2 * DEG_H * 60, abs=3.5 * white.standard_uncertainty)
        assert white.standard_uncertainty < 0.03 * white.value
        assert "markov" not in [t.key for t in axis.terms]
        assert axis.fit.shortest > 5.0 * DT
        assert "the sensor filters its samples" in " ".join(axis.fit.notes)


def test_samples_that_are_given_twice_keep_their_random_walk():
    rate = np.repeat(samples(GYRO, 8, 1 << 16), 2, axis=0)
    found = study(from_arrays(DT / 2 * np.arange(len(rate)), gyro=rate), despite=["repeated"])
    for axis in found.axes:
        white = axis["white"]
        assert white.value == pytest.approx(GYRO.density, abs=3.5 * white.standard_uncertainty)


@pytest.mark.statistical
def test_clean_logs_are_judged_whole():
    """Of 60 clean axes none is refused, and no line seen on any: one log in a hundred may, which is 0.2 of these."""
    for seed in range(20):
        found = study(from_arrays(DT * np.arange(10_000), gyro=samples(GYRO, 700 + seed, 10_000)))
        assert not found.refused
        assert not found.disturbances
