"""``sagnac registry trend`` and ``compare`` as a user types them."""

from __future__ import annotations

import json

import pytest

from sagnac.calibration import Calibration, Fit, Site, UnitName, Value
from sagnac.results import Software

UG = 9.80665e-6


def calibration(year: int, serial: str = "0001", *, rate: float = 5.0, **other) -> Calibration:
    """Two parameters of the unit and one of the rig; the bias drifts by `rate` ug a year."""
    given = {
        "method": "norm",
        "unit": UnitName(model="LG-1", serial=serial),
        "parameters": (
            Value(name="accel.bias.x", value=UG * rate * (year - 2015), unit="m/s^2", standard_uncertainty=UG),
            Value(name="gyro.bias.x", value=1e-8, unit="rad/s", standard_uncertainty=1e-9),
            Value(name="rig.tilt.x", value=1e-4, unit="rad", standard_uncertainty=1e-6),
        ),
        "fit": Fit(chi2=9.0, degrees_of_freedom=10, residual_rms=1.0, converged=True, iterations=3),
        "site": Site(gravity=9.81),
        "software": Software(version="0"),
        "created": f"{year}-03-01T10:00:00+00:00",
    } | other
    n = range(len(given["parameters"]))
    covariance = [[given["parameters"][i].standard_uncertainty ** 2 if i == j else 0.0 for j in n] for i in n]
    return Calibration(covariance=tuple(map(tuple, covariance)), **given)


@pytest.fixture
def fleet(run, tmp_path):
    """Three units with six calibrations each, and one with one."""
    for unit in range(3):
        for year in range(2015, 2021):
            calibration(year, f"{unit + 1:04d}", rate=5.0 * (unit + 1)).save(tmp_path / f"{unit}-{year}.json")
    calibration(2015, "0009").save(tmp_path / "single.json")
    assert run("registry", "add", *sorted(tmp_path.glob("*.json")), "--registry", "fleet.db").status == 0
    assert run("registry", "limits", "accel.bias.*=±0.1 mg", "--model", "LG-1", "--registry", "fleet.db").status == 0
    return "fleet.db"


def test_trend_of_a_unit(run, fleet, tmp_path):
    outcome = run("registry", "trend", "0002", "--registry", fleet, "--plot", "trend.png", "--at", "2022-01-01")
    assert outcome.status == 0, outcome.err
    assert "Trend of LG-1 0002: 6 calibrations from 2015-03-01 to 2020-03-01" in outcome.out
    assert "expected 2022-01-01" in outcome.out
    row = next(x for x in outcome.out.splitlines() if x.startswith("  accel.bias.x"))
    assert "10.00 ±" in row
    assert "upper limit" in row
    assert "rig.tilt.x" not in outcome.out
    assert (tmp_path / "trend.png").stat().st_size > 10_000


def test_trend_as_json(run, fleet):
    table = json.loads(run("registry", "trend", "0001", "--registry", fleet, "--json").out)
    assert table["schema"] == "sagnac/trend/1"
    assert [p["name"] for p in table["parameters"]] == ["accel.bias.x", "gyro.bias.x"]
    drift = table["parameters"][0]["drift"]
    assert drift["value"] * 31557600 == pytest.approx(5 * UG, rel=1e-2)
    assert drift["lower"] < drift["value"] < drift["upper"]
    limits = table["parameters"][0]["limits"]
    assert limits["upper"] == pytest.approx(100 * UG)
    assert table["calibrations"][0]["method"] == "norm"


def test_parameters_can_be_chosen_also_those_of_the_rig(run, fleet):
    out = run("registry", "trend", "0001", "--parameter", "rig.*", "--registry", fleet).out
    assert "rig.tilt.x" in out
    assert "accel.bias.x" not in out
    wrong = run("registry", "trend", "0001", "--parameter", "accel.k9", "--registry", fleet)
    assert wrong.status == 2
    assert "no calibration has a parameter 'accel.k9'" in wrong.err


def test_since(run, fleet):
    assert "3 calibrations from 2018" in run(
        "registry", "trend", "0001", "--since", "2018-01-01", "--registry", fleet
    ).out  # fmt: skip
    late = run("registry", "trend", "0001", "--since", "2030-01-01", "--registry", fleet)
    assert late.status == 1
    assert "there is no calibration since 2030-01-01" in late.err


def test_without(run, fleet):
    out = run("registry", "trend", "0001", "--without", "id:2", "--without", "3", "--registry", fleet).out
    assert "4 calibrations from 2015" in out
    fewer = run("registry", "trend", "--without", "id:1", "--without", "id:19", "--registry", fleet).out
    assert "3 units, 17 calibrations" in fewer


def test_one_calibration_says_what_it_cannot_tell(run, fleet):
    outcome = run("registry", "trend", "0009", "--registry", fleet, "--plot", "single.svg")
    assert outcome.status == 0, outcome.err
    assert "one calibration: neither drift nor scatter nor a prediction can be told" in outcome.out


def test_trend_of_a_model(run, fleet, tmp_path):
    outcome = run("registry", "trend", "--model", "LG-1", "--registry", fleet, "--limit", "1", "--plot", "fleet.svg")
    assert outcome.status == 0, outcome.err
    assert "Drift of LG-1: 4 units, 19 calibrations" in outcome.out
    assert "0003" in outcome.out  # the one that drifts most
    assert "... and 2 more: --json names all" in outcome.out
    assert (tmp_path / "fleet.svg").exists()
    table = json.loads(run("registry", "trend", "--registry", fleet, "--json").out)
    assert table["schema"] == "sagnac/fleet-trend/1"
    assert [u["serial"] for u in table["parameters"][0]["units"]] == ["0003", "0002", "0001"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("0004",), "0004"),
        (("--at", "2030-01-01"), "--at: is for the trend of one unit"),
        (("0001", "--at", "soon"), "'soon' is no date"),
        (("-k", "6"), "-k: is for the trend of one unit"),
        (("0001", "--limit", "3"), "--limit: is for the trend of many units"),
        (("0001", "--without", "first"), "'first' is no number of a calibration; write id:12"),
        (("0001", "--without", "id:7"), "id:7 is no calibration of LG-1 0001"),
        (("0001", "--plot", "x.gif"), "write to a .png, .svg or .pdf file"),
        (("0001", "--model", "none"), "none"),
    ],
)
def test_what_is_wrong_is_said(run, fleet, arguments, words):
    outcome = run("registry", "trend", *arguments, "--registry", fleet)
    assert outcome.status == 2
    assert words in outcome.err


def test_a_date_in_the_past_is_refused(run, fleet):
    outcome = run("registry", "trend", "0001", "--at", "2016-01-01", "--registry", fleet)
    assert outcome.status == 1
    assert "2016-01-01 lies before the last calibration of 2020-03-01" in outcome.err


def test_compare_two_files_without_a_registry(run, tmp_path):
    calibration(2015).save(tmp_path / "old.json")
    calibration(2020).save(tmp_path / "new.json")
    outcome = run("registry", "compare", "old.json", "new.json", "--plot", "change.pdf")
    assert outcome.status == 0, outcome.err
    row = next(x for x in outcome.out.splitlines() if x.startswith("  accel.bias.x")).split()
    assert row[-3:] == ["17.68", "below", "1e-15"]  # 25 over the root of two
    assert "of the rig" in outcome.out
    assert "for 2 degrees of freedom" in outcome.out
    assert (tmp_path / "change.pdf").exists()
    assert not (tmp_path / "fleet.db").exists()


def test_compare_calibrations_of_a_registry(run, fleet, tmp_path):
    outcome = run("registry", "compare", "0001@2016-12-31", "0001", "--registry", fleet, "--json")
    assert outcome.status == 0, outcome.err
    table = json.loads(outcome.out)
    assert table["schema"] == "sagnac/comparison/1"
    assert table["before"]["created"].startswith("2016")
    assert table["after"]["created"].startswith("2020")
    assert table["parameters"][0]["normalised"] == pytest.approx(20 / 2**0.5)
    calibration(2021).save(tmp_path / "new.json")
    mixed = run("registry", "compare", "id:1", "new.json", "--registry", fleet)
    assert mixed.status == 0
    assert "after   new.json" in mixed.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("gone.json", "gone.json"), "gone.json"),
        (("0001", "gone.json"), "gone.json"),
        (("0004", "0001"), "0004"),
    ],
)
def test_what_cannot_be_compared(run, fleet, arguments, words):
    outcome = run("registry", "compare", *arguments, "--registry", fleet)
    assert outcome.status == 2
    assert words in outcome.err


def test_a_picture_never_replaces_what_it_is_of(run, tmp_path):
    calibration(2015).save(tmp_path / "old.svg")
    outcome = run("registry", "compare", "old.svg", "old.svg", "--plot", "old.svg")
    assert outcome.status == 2
    assert "is an input" in outcome.err
