"""Every target: what its own software makes of a raw sample is what we make of it, within what was said to be dropped."""

from __future__ import annotations

import shutil

import export_consumers as consumers
import numpy as np
import pytest
from export_units import RATE, G, calibration, samples, units
from hypothesis import given, settings
from hypothesis import strategies as st

from sagnac.errors import InputError
from sagnac.export import TARGETS, Options, export
from sagnac.export.noise import UNITS
from sagnac.sensors import correction, invert

NOISE = {"accel_density": 8e-4, "accel_random_walk": 2e-5, "gyro_density": 9e-5, "gyro_random_walk": 1e-6}
GIVEN = Options(noise=NOISE, rate=200.0, device_id={"accel": 1310988, "gyro": 1311244})


def ours(cal, readings):
    """The whole model read backwards (sagnac.sensors.invert), as `sagnac apply` does."""
    out = {}
    for kind in readings:
        model = correction(cal.values(), kind, ratio=cal.misalignment == "input-axis")
        out[kind] = invert(model, readings[kind], out.get("accel"))
    return out


def allowance(cal, readings):
    """Rounding of a double in the products with the raw readings, by sensor."""
    out = {}
    for kind in readings:
        model = correction(cal.values(), kind)
        gain = np.abs(np.linalg.inv(model.matrix)).max() * (1.0 + np.abs(model.g_matrix).max())
        out[kind] = 1e-12 * gain * (np.abs(readings[kind]).max() + np.abs(model.bias).max() + 10.0)
    return out


def consume(target, files, readings):
    """The consumer of each target; those that correct nothing take readings as they are."""
    content = files.get("", b"")
    if target in ("kalibr", "vins"):
        return dict(readings)
    if target == "imu_tk":
        return consumers.imu_tk(files, readings)
    reader = {
        "px4": consumers.px4,
        "ardupilot": consumers.ardupilot,
        "ros": consumers.imu_calib,
        "kalibr-intrinsics": consumers.kalibr_intrinsics,
        "openvins": consumers.openvins,
        "openvins-rpng": consumers.openvins,
        "matlab": consumers.matlab,
        "json": consumers.plain_json,
    }[target]
    return reader(content, readings)


SI_TARGETS = [name for name in TARGETS if name != "c"]
COUNT_TARGETS = [name for name in TARGETS if TARGETS[name].counts and name != "c"]


def check(target, cal):
    """The consumer's samples against ours; returns the largest part of what was allowed that was used."""
    _, _, readings = samples(cal)
    done = export(cal, target, GIVEN)
    theirs, right, rounding = consume(target, done.files, readings), ours(cal, readings), allowance(cal, readings)
    for kind in readings:
        said = sum(d.size for d in done.dropped if d.sensor == kind)
        error = np.linalg.norm(theirs[kind] - right[kind], axis=1).max()
        assert error <= said * (1 + 1e-9) + rounding[kind], (kind, error, done.dropped)


@pytest.mark.parametrize("target", SI_TARGETS)
@given(units())
@settings(max_examples=25)
def test_agrees_within_what_was_dropped(target, unit):
    values, meaning = unit
    check(target, calibration(values, misalignment=meaning))


@pytest.mark.parametrize("target", COUNT_TARGETS)
@given(units(counts=True, negative=True))
@settings(max_examples=25)
def test_agrees_on_raw_counts(target, unit):
    values, meaning = unit
    check(target, calibration(values, misalignment=meaning))


# what each target holds: for a unit that has no more than that, nothing is dropped and the samples agree to rounding
_DIAGONAL = {f"accel.scale_error.{a}": v for a, v in zip("xyz", (0.25, -0.125, 0.0), strict=True)}
_OFFSETS = {
    f"{k}.bias.{a}": v for k, s in (("accel", 0.25), ("gyro", 0.0625)) for a, v in zip("xyz", (s, -s, 0.0), strict=True)
}
_ACCEL_CROSS = {f"accel.misalignment.{i}{j}": 0.01 for i in "xyz" for j in "xyz" if i != j}
_GYRO = {f"gyro.scale_error.{a}": 0.02 for a in "xyz"} | {
    f"gyro.misalignment.{p}": 0.015 for p in ("xy", "yz", "zx", "xz")
}
_FORCE = {"gyro.g_sensitivity.xy": 1e-3, "gyro.g_sensitivity.zz": -2e-3}
WHOLE = {
    "imu_tk": {**_DIAGONAL, **_OFFSETS, **_ACCEL_CROSS, **_GYRO},
    "ros": {**_DIAGONAL, **_OFFSETS, **_ACCEL_CROSS, **{f"gyro.bias.{a}": 0.0 for a in "xyz"}},
    "kalibr-intrinsics": {**_DIAGONAL, **_ACCEL_CROSS, **_GYRO, **_FORCE},
    "openvins": {**_DIAGONAL, **_ACCEL_CROSS, **_GYRO, **_FORCE},
    "openvins-rpng": {**_DIAGONAL, **_ACCEL_CROSS, **_GYRO, **_FORCE},
    "matlab": {**_DIAGONAL, **_OFFSETS, **_ACCEL_CROSS, **_GYRO, **_FORCE},
    "json": {**_DIAGONAL, **_OFFSETS, **_ACCEL_CROSS, **_GYRO, **_FORCE},
}


@pytest.mark.parametrize("target", WHOLE)
def test_agrees_to_rounding_when_nothing_is_dropped(target):
    cal = calibration(WHOLE[target])
    force, rate, readings = samples(cal)
    done = export(cal, target, GIVEN)
    assert done.dropped == ()
    theirs = consume(target, done.files, readings)
    assert np.allclose(theirs["accel"], force, rtol=0, atol=1e-12 * G)
    assert np.allclose(theirs["gyro"], rate, rtol=0, atol=1e-12 * RATE)


@pytest.mark.parametrize("target", ["px4", "ardupilot"])
def test_agrees_to_rounding_with_numbers_of_single_precision(target):
    """Offsets and gains that a float holds: 1/0.8 and 1/1 are taken apart from it by the reader alone."""
    values = {f"accel.scale_error.{a}": v for a, v in zip("xyz", (0.0, -0.125, 0.0625), strict=True)} | _OFFSETS
    cal = calibration(values)
    force, rate, readings = samples(cal)
    done = export(cal, target, GIVEN)
    assert {d.what for d in done.dropped} <= {"digits beyond single precision"}
    assert sum(d.size for d in done.dropped) < 1e-7 * G
    theirs = consume(target, done.files, readings)
    assert np.allclose(theirs["accel"], force, rtol=0, atol=1e-7 * G)
    assert np.allclose(theirs["gyro"], rate, rtol=0, atol=1e-14)


@pytest.mark.parametrize("target", ["px4", "ardupilot"])
def test_single_precision_is_counted(target):
    """Offsets that no float holds: all that is left is their rounding, and it is no more than what is said."""
    cal = calibration({f"{k}.bias.{a}": 1.0 / 3.0 for k in ("accel", "gyro") for a in "xyz"})
    _, _, readings = samples(cal)
    done = export(cal, target, GIVEN)
    theirs = consume(target, done.files, readings)
    for kind in ("accel", "gyro"):
        (found,) = [d for d in done.dropped if d.sensor == kind]
        assert found.what == "digits beyond single precision"
        error = np.linalg.norm(theirs[kind] - ours(cal, readings)[kind], axis=1).max()
        assert 0.99 * found.size < error < found.size + 1e-14


def test_a_tilted_input_axis_feels_more():
    """K2 works on the force along the input axis, here (1, 0.3, 0) f: 1.09 times the square of 1 g."""
    values = {f"accel.scale_error.{a}": 0.0 for a in "xyz"} | {
        f"accel.k2.{a}": v for a, v in zip("xyz", (1e-6, 0, 0), strict=True)
    }
    values |= {f"accel.misalignment.{i}{j}": 0.0 for i in "xyz" for j in "xyz" if i != j} | {
        "accel.misalignment.xy": 0.3
    }
    cal = calibration(values)
    (found,) = export(cal, "json").dropped
    assert found.size == pytest.approx(1e-6 * 1.09 * G**2, rel=1e-9)
    _, _, readings = samples(cal, 20000)
    theirs, right = consume("json", export(cal, "json").files, readings), ours(cal, readings)
    assert np.linalg.norm(theirs["accel"] - right["accel"], axis=1).max() > 0.97 * found.size


CASES = {
    # what is dropped, by hand: the target, the only error of the unit, and its size at 1 g and 100 deg/s
    "gyro scale": ("px4", {"gyro.scale_error.z": 0.01}, 0.01 * RATE),
    "gyro misalignment (cross terms)": ("ardupilot", {"gyro.misalignment.zx": 1e-3}, 1e-3 * RATE),
    "gyro g-sensitivity": ("imu_tk", {"gyro.g_sensitivity.xy": 1e-4}, 1e-4 * G),
    "gyro bias": ("openvins", {"gyro.bias.x": 3e-3, "gyro.bias.y": -4e-3}, 5e-3),
    "accel k2": ("json", {"accel.k2.x": 1e-5}, 1e-5 * G**2),
    "accel k3": ("json", {"accel.k3.y": 1e-6}, 1e-6 * G**3),
    "accel kip": ("matlab", {"accel.kip.z": 1e-5}, 0.5e-5 * G**2),
    "gyro d ii": ("json", {"gyro.d_ii.y": 1e-5}, 1e-5 * G**2),
    "gyro d os": ("json", {"gyro.d_os.y": 1e-5}, 0.5e-5 * G**2),
}


@pytest.mark.parametrize("what", CASES)
def test_sizes_are_what_the_largest_sample_shows(what):
    target, error, size = CASES[what]
    start = {f"{k}.{t}.{a}": 0.0 for k in ("accel", "gyro") for t in ("scale_error", "bias") for a in "xyz"}
    own = {
        f"{name[:-1]}{a}": 0.0
        for name in error
        if name.split(".")[1] in ("k2", "k3", "kip", "d_ii", "d_os")
        for a in "xyz"
    }
    cal = calibration(start | own | error)
    done = export(cal, target, GIVEN)
    (found,) = [d for d in done.dropped if d.size > 1e-6 * size]
    assert f"{found.sensor} {found.what}" == what
    assert found.size == pytest.approx(size, rel=1e-6)
    _, _, readings = samples(cal, 20000)
    theirs, right = consume(target, done.files, readings), ours(cal, readings)
    seen = np.linalg.norm(theirs[found.sensor] - right[found.sensor], axis=1).max()
    assert 0.97 * size < seen < (1 + 1e-5) * size


def test_sizes_in_the_units_own_noise():
    noise = {"gyro": {"density": [2e-4, 1e-4, 4e-4], "unit": "rad/s/sqrt(Hz)", "origin": "plan"}}
    values = {f"gyro.scale_error.{a}": 0.0 for a in "xyz"} | {f"gyro.bias.{a}": 0.0 for a in "xyz"}
    cal = calibration(
        values | {"gyro.misalignment.zx": 1e-3, "gyro.misalignment.zy": 0.0, "gyro.misalignment.yx": 0.0}, noise=noise
    )
    (found,) = [d for d in export(cal, "px4").dropped if d.what.startswith("misalignment")]
    assert found.in_noise == pytest.approx(1e-3 * RATE / 1e-4, rel=1e-6)  # over one second, of the quietest axis
    assert "times the noise of 1 s" in found.line()
    silent = export(cal.model_copy(update={"noise": {}}), "px4")
    assert all(d.in_noise is None for d in silent.dropped)
    assert "states no noise" in silent.summary()


def test_biases_given_apart_complete_openvins_and_kalibr():
    """They estimate the biases themselves: with the right ones their samples are ours to rounding."""
    cal = calibration(WHOLE["json"])
    force, rate, readings = samples(cal)
    biases = {k: np.array([WHOLE["json"][f"{k}.bias.{a}"] for a in "xyz"]) for k in ("accel", "gyro")}
    for target, reader in (
        ("openvins", consumers.openvins),
        ("openvins-rpng", consumers.openvins),
        ("kalibr-intrinsics", consumers.kalibr_intrinsics),
    ):
        done = export(cal, target, GIVEN)
        assert {(d.sensor, d.what) for d in done.dropped} == {
            ("accel", "bias"), ("gyro", "bias"), ("gyro", "error of the specific force through the g-sensitivity"),
        }  # fmt: skip
        theirs = reader(done.files[""], readings, biases)
        assert np.allclose(theirs["accel"], force, rtol=0, atol=1e-12 * G)
        assert np.allclose(theirs["gyro"], rate, rtol=0, atol=1e-12 * RATE)


COMPILER = shutil.which("cc")


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize("language", ["c", "c++"])
@given(st.data())
@settings(max_examples=2)
def test_c_header(language, tmp_path, data):
    if language == "c++" and shutil.which("c++") is None:
        pytest.skip("no C++ compiler")
    values, meaning = data.draw(units(counts=None, negative=True))
    cal = calibration(values, misalignment=meaning)
    _, _, readings = samples(cal, 50)
    done = export(cal, "c")
    right, rounding = ours(cal, readings), allowance(cal, readings)
    for precision, tolerance in (("double", 1.0), ("float", 1e6)):
        theirs = consumers.c_program(done.files[""], readings, tmp_path, COMPILER, precision, language)
        for kind in readings:
            said = sum(d.size for d in done.dropped if d.sensor == kind)
            error = np.linalg.norm(theirs[kind] - right[kind], axis=1).max()
            assert error <= said * (1 + 1e-9) + tolerance * rounding[kind]


@pytest.mark.parametrize("target", [t for t in TARGETS if not TARGETS[t].counts])
def test_raw_counts_are_refused_where_si_is_needed(target):
    cal = calibration({f"accel.scale_factor.{a}": 1000.0 for a in "xyz"} | {f"accel.bias.{a}": 3.0 for a in "xyz"})
    with pytest.raises(InputError, match="raw counts"):
        export(cal, target, GIVEN)


def test_the_same_calibration_gives_the_same_file():
    cal = calibration(WHOLE["json"] | {f"accel.scale_error.{a}": 0.02 for a in "xyz"}, sigma=1e-6)
    for target in TARGETS:
        assert export(cal, target, GIVEN) == export(cal, target, GIVEN)


def test_unknown_target():
    with pytest.raises(InputError, match="px4"):
        export(calibration(WHOLE["json"]), "px5")


def test_names_of_the_noise_are_told():
    with pytest.raises(InputError) as refused:
        export(calibration(WHOLE["json"]), "kalibr", Options(rate=200.0))
    for name, unit in UNITS.items():
        assert f"--noise {name}='... {unit}'" in str(refused.value)
