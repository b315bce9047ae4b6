"""The file of a noise test: reads back as it was, agrees with its schema; its page; into plans and calibrations."""

from __future__ import annotations

import json
import math
import shutil

import jsonschema
import numpy as np
import pytest

from sagnac import calibration as calibrations
from sagnac import plan as plans
from sagnac.calibrate import calibrate
from sagnac.errors import DataError, InputError
from sagnac.noise import record
from sagnac.noise.into import into_calibration, into_plan, remarks_of
from sagnac.noise.record import Limit, TermValue
from sagnac.noise.study import study
from sagnac.recording import from_arrays, open_recording

UG, DEG_H = 9.80665e-6, math.pi / 648000
DT = 0.01


def white(n=20_000, counts=(), accel=(60, 60, 60), gyro=(0.2, 0.2, 0.2), seed=1):
    rng = np.random.default_rng(seed)
    scale = np.sqrt(1 / DT)
    force = rng.normal(size=(n, 3)) * np.array(accel) * UG * scale + [0, 0, 9.8]
    rate = rng.normal(size=(n, 3)) * np.array(gyro) * 60 * DEG_H * scale
    if counts:
        force = np.round(force * 1e6)
    return study(from_arrays(DT * np.arange(n), force, rate, counts=counts, name="still.csv"))


@pytest.fixture(scope="module")
def found():
    return white()


def test_the_published_schema_is_that_of_the_records():
    assert record.SCHEMA_FILE.read_text(encoding="utf-8") == json.dumps(record.json_schema(), indent=2) + "\n"
    jsonschema.Draft202012Validator.check_schema(record.json_schema())


def test_a_file_reads_back_as_it_was(found, tmp_path):
    found.save(tmp_path / "noise.json")
    assert record.load(tmp_path / "noise.json") == found
    schema = json.loads(record.SCHEMA_FILE.read_text(encoding="utf-8"))
    jsonschema.validate(json.loads(found.to_json()), schema, cls=jsonschema.Draft202012Validator)


def test_other_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="cannot read the noise test"):
        record.load(tmp_path / "none.json")
    with pytest.raises(InputError, match="not a noise test that this version reads"):
        record.loads('{"schema": "sagnac/noise/2"}')
    with pytest.raises(InputError, match="damaged noise test"):
        record.loads('{"schema": "sagnac/noise/1"}')


def test_axes_and_terms_are_found_by_name(found):
    assert found["gyro_x"]["white"].unit == "rad/s/Hz^0.5"
    with pytest.raises(KeyError, match="accel_x, accel_y"):
        found["gyro_w"]
    with pytest.raises(KeyError, match="not among the terms of gyro_x"):
        found["gyro_x"]["markov"]
    assert found["gyro_x"].value("markov") == 0.0
    triad = found.triad("accel", "white")
    assert triad is not None
    assert triad == pytest.approx((60 * UG,) * 3, rel=0.03)


def test_the_page_is_in_units_of_data_sheets(found):
    page = found.summary()
    assert "20000, 100 Hz, 200 s" in page
    for text in (
        "ug/sqrt(Hz)",
        "m/s/sqrt(h)",
        "deg/sqrt(h)",
        "bias instability B",
        "deg/h",
        "ug",
        "probability of the fit",
    ):
        assert text in page
    row = next(line for line in page.splitlines() if "angle random walk N" in line)
    assert row.count("±") == 3
    assert "< " in next(line for line in page.splitlines() if "bias instability" in line)


# ------------------------------------------------------------------------------------------------ into a plan

PLAN = """# the unit on its table
latitude = "45 deg"; height = "0 m"
[unit]
model = "demo"   # a comment
noise = { accel = "10 ug/sqrt(Hz)", gyro = "0.001 deg/sqrt(h)", gyro_walk = "1 deg/h/sqrt(h)" } # from the data sheet
[rig]
kind = "turntable"
[[segment]]
name = "1"; start = "0 s"; stop = "60 s"
outer = "30 deg"; middle = "0 deg"; inner = "0 deg"
"""


def test_the_noise_goes_into_a_plan_and_all_else_stays(found, tmp_path):
    (tmp_path / "plan.toml").write_text(PLAN)
    written = into_plan(found, tmp_path / "plan.toml", tmp_path / "new.toml")
    text = (tmp_path / "new.toml").read_text()
    assert (tmp_path / "plan.toml").read_text() == PLAN
    for kept in ("# the unit on its table", "# a comment", "# from the data sheet"):
        assert kept in text
    before = plans.load(tmp_path / "plan.toml")
    assert written.segment == before.segment
    assert written.unit.noise.of("accel") == pytest.approx((60 * UG,) * 3, rel=0.03)
    assert written.unit.noise.gyro_walk is None  # the test saw none
    assert isinstance(written.unit.noise.accel, float)


def test_axes_that_differ_are_stated_one_by_one(tmp_path):
    (tmp_path / "plan.toml").write_text('latitude = "45 deg"\n')
    written = into_plan(white(gyro=(0.2, 0.4, 0.2)), tmp_path / "plan.toml", tmp_path / "new.toml")
    assert isinstance(written.unit.noise.gyro, tuple)
    assert written.unit.noise.gyro[1] == pytest.approx(0.4 * 60 * DEG_H, rel=0.03)


def with_terms(found, axis, **terms):
    """The test with terms of an axis replaced; None takes one away and leaves a limit."""
    axes = []
    for a in found.axes:
        if a.name == axis:
            zero = TermValue(key="white", value=0.0, standard_uncertainty=0.0, lower=0.0, upper=None, unit="")
            kept = [t for t in a.terms if t.key not in terms]
            new = [zero.model_copy(update={"key": k, "value": v}) for k, v in terms.items() if v is not None]
            gone = [Limit(key=k, upper=1e-3, unit="") for k, v in terms.items() if v is None]
            absent = [m for m in a.absent if m.key not in terms]
            axes.append(a.model_copy(update={"terms": (*kept, *new), "absent": (*absent, *gone)}))
        else:
            axes.append(a)
    return found.model_copy(update={"axes": tuple(axes)})


def test_correlated_noise_is_written_as_the_instability_with_its_peak(found, calibration, tmp_path):
    q = 20 * DEG_H
    log = with_terms(found, "gyro_y", markov=q, markov_time=100.0)
    (tmp_path / "plan.toml").write_text("")
    written = into_plan(log, tmp_path / "plan.toml", tmp_path / "new.toml")
    # the largest of its Allan variance q^2 (2/x) (1 - (3 - 4 exp(-x) + exp(-2x)) / (2x)), x = tau / T
    x = np.linspace(0.5, 5.0, 4501)
    peak = q * np.sqrt((2 / x * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x))).max())
    expected = (0.0, peak / np.sqrt(2 * np.log(2) / np.pi), 0.0)
    assert written.unit.noise.of("gyro", "instability") == pytest.approx(expected, rel=1e-3)
    done = into_calibration(log, calibration, tmp_path / "new.json")
    assert done.noise["gyro"].instability == pytest.approx(expected, rel=1e-3)
    assert any("gyro_y has correlated noise of 100 s" in r for r in done.remarks)
    assert remarks_of(found) == []


def test_an_axis_without_white_noise_does_not_take_that_of_the_others_away(found, calibration, tmp_path):
    log = with_terms(found, "gyro_y", white=None)
    (tmp_path / "plan.toml").write_text("")
    written = into_plan(log, tmp_path / "plan.toml", tmp_path / "new.toml")
    stated = written.unit.noise.of("gyro")
    assert stated is not None
    assert stated[0] == pytest.approx(0.2 * 60 * DEG_H, rel=0.03)
    assert stated[1] == pytest.approx(1e-3, rel=1e-3)
    assert into_calibration(log, calibration, tmp_path / "new.json").noise["gyro"].density[1] == 1e-3
    assert "gyro_y shows no white noise" in remarks_of(log)[0]


def test_a_calibration_carries_the_limit_of_a_walk_that_was_not_seen(found, calibration, tmp_path):
    level = into_calibration(found, calibration, tmp_path / "new.json").noise["gyro"]
    limits = [next(m.upper for m in found[f"gyro_{a}"].absent if m.key == "walk") for a in "xyz"]
    assert level.walk == (0.0, 0.0, 0.0)
    assert level.walk_limit == pytest.approx(limits)


@pytest.mark.parametrize(
    "header", ["", "[unit]\n", '[unit.noise]\naccel = "1 ug/sqrt(Hz)"\n', '[unit]\nnoise.gyro = "1 deg/sqrt(h)"\n']
)
def test_every_way_to_write_a_plan(found, header, tmp_path):
    (tmp_path / "plan.toml").write_text(header)
    written = into_plan(found, tmp_path / "plan.toml", tmp_path / "new.toml")
    assert written.unit.noise.of("accel") == pytest.approx((60 * UG,) * 3, rel=0.03)
    assert written.unit.noise.of("gyro") == pytest.approx((0.2 * 60 * DEG_H,) * 3, rel=0.03)


def test_counts_do_not_go_into_a_plan(tmp_path):
    (tmp_path / "plan.toml").write_text("")
    with pytest.raises(DataError, match="in raw counts, a plan states it in SI"):
        into_plan(white(counts=("accel",)), tmp_path / "plan.toml", tmp_path / "new.toml")
    assert not (tmp_path / "new.toml").exists()


# ------------------------------------------------------------------------------------------- into a calibration


@pytest.fixture(scope="module")
def calibration(rig, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cal")
    shutil.copy(rig.recording, folder / "recording.parquet")
    done = calibrate("norm", open_recording(folder / "recording.parquet", scale=rig.plan.unit.scale), rig.plan)
    done.save(folder / "cal.json")
    return folder / "cal.json"


def test_the_noise_goes_into_a_calibration(found, calibration, tmp_path):
    before = calibrations.load(calibration)
    written = into_calibration(found, calibration, tmp_path / "new.json")
    assert calibrations.load(tmp_path / "new.json") == written
    assert written.parameters == before.parameters
    level = written.noise["gyro"]
    assert level.origin == "noise test"
    assert level.density == found.triad("gyro", "white")
    assert level.walk == found.triad("gyro", "walk")
    assert [s.role for s in written.source] == [*(s.role for s in before.source), "noise test"]
    again = into_calibration(found, tmp_path / "new.json", tmp_path / "again.json")
    assert len(again.source) == len(written.source)
    assert "noise test  still.csv" in written.summary()


def test_counts_do_not_go_into_a_calibration_of_si(calibration, tmp_path):
    with pytest.raises(InputError, match="reads its accel triad in SI and the log is in count"):
        into_calibration(white(counts=("accel",)), calibration, tmp_path / "new.json")
