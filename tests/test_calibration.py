"""The result file: out and in again without loss, and refused when it is not sound."""

from __future__ import annotations

import json
import math

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac import calibration as record
from sagnac.calibration import Calibration, load, loads
from sagnac.errors import InputError, SagnacError
from sagnac.printed import printed

DEG = math.pi / 180
G = 9.80665

finite = st.floats(allow_nan=False, allow_infinity=False)
size = st.floats(0, allow_infinity=False)
# squares of these neither overflow nor vanish, as a covariance needs
sigma = st.just(0.0) | st.floats(1e-140, 1e140)
word = st.text(st.characters(exclude_categories=["Cs"]), max_size=15)
UNITS = ["m/s^2", "rad/s", "1", "rad", "count", "m", "count/(m/s^2)", "rad*s/m"]


@st.composite
def calibrations(draw):
    names = draw(st.lists(word, min_size=1, max_size=4, unique=True))
    k = len(names)
    sigmas = [draw(sigma) for _ in names]
    r = np.eye(k)
    if k > 1:
        r[0, 1] = r[1, 0] = draw(st.floats(-1, 1))
    covariance = [[float(r[i, j] * sigmas[i] * sigmas[j]) for j in range(k)] for i in range(k)]
    each = st.none() | st.tuples(*[size] * k)
    scatter = st.builds(record.Scatter, rms=size, unit=word, count=st.integers(0, 10**9))
    influence = st.builds(
        record.Influence, segment=word, leverage=finite, chi2=finite, shift=st.none() | finite, parameter=word
    )
    return Calibration(
        schema=record.SCHEMA,
        method=draw(word),
        unit=record.UnitName(model=draw(word), serial=draw(word), scale=draw(st.dictionaries(word, word, max_size=2))),
        parameters=[
            record.Value(name=n, value=draw(finite), unit=draw(st.sampled_from(UNITS)), standard_uncertainty=s)
            for n, s in zip(names, sigmas, strict=True)
        ],
        covariance=covariance,
        fit=record.Fit(
            chi2=draw(finite),
            degrees_of_freedom=draw(st.integers(0, 10**9)),
            residual_rms=draw(size),
            converged=draw(st.booleans()),
            iterations=draw(st.integers(0, 1000)),
            p_value=draw(st.none() | st.floats(0, 1)),
            condition=draw(st.none() | finite),
            white=draw(each),
            cluster=draw(each),
            delete_one=draw(each),
            residuals=draw(st.dictionaries(word, scatter, max_size=2)),
            influence=draw(st.lists(influence, max_size=2)),
        ),
        budget=[
            record.BudgetLine(source=draw(word), standard_uncertainty=[draw(size) for _ in names])
            for _ in range(draw(st.integers(0, 2)))
        ],
        site=record.Site(latitude=draw(st.none() | finite), height=draw(finite), gravity=draw(finite)),
        source=[
            record.Source(file=draw(word), sha256=draw(st.none() | word), start=draw(st.none() | finite))
            for _ in range(draw(st.integers(0, 2)))
        ],
        remarks=draw(st.lists(word, max_size=3)),
        software=record.Software(version=draw(word)),
        created=draw(word),
    )


def small() -> dict:
    """A sound file as a table, to be damaged."""
    return {
        "schema": "sagnac/calibration/1",
        "method": "norm",
        "parameters": [
            {"name": "accel.bias.x", "value": 0.01, "unit": "m/s^2", "standard_uncertainty": 0.002},
            {"name": "gyro.bias.x", "value": 1e-6, "unit": "rad/s", "standard_uncertainty": 3e-8},
        ],
        "covariance": [[4e-6, 1e-11], [1e-11, 9e-16]],
        "fit": {"chi2": 3.5, "degrees_of_freedom": 4, "residual_rms": 0.9, "converged": True, "iterations": 3},
        "site": {"gravity": 9.81},
        "software": {"version": "0"},
        "created": "2000-01-01T00:00:00+00:00",
    }


# ------------------------------------------------------------------------------------------ out and in again


@given(calibrations())
def test_a_calibration_reads_back_equal_to_the_last_bit(calibration):
    again = loads(calibration.to_json())
    assert again == calibration
    assert [math.copysign(1, p.value) for p in again.parameters] == [
        math.copysign(1, p.value) for p in calibration.parameters
    ]


@pytest.mark.parametrize("value", [5e-324, -5e-324, 2.2250738585072014e-308, 0.1, 1 / 3, 1.7976931348623157e308, -0.0])
def test_numbers_at_the_ends_of_the_range(value):
    table = small()
    table["parameters"][0]["value"] = value
    again = loads(loads(json.dumps(table)).to_json())["accel.bias.x"].value
    assert again.hex() == value.hex()


def test_save_and_load(tmp_path):
    calibration = loads(json.dumps(small()))
    calibration.save(tmp_path / "cal.json")
    assert load(tmp_path / "cal.json") == calibration
    assert [p.name for p in tmp_path.iterdir()] == ["cal.json"]


def test_a_byte_order_mark_is_read_over(tmp_path):
    (tmp_path / "cal.json").write_text(json.dumps(small()), encoding="utf-8-sig")
    assert load(tmp_path / "cal.json").method == "norm"


def test_access():
    calibration = loads(json.dumps(small()))
    assert calibration.values() == {"accel.bias.x": 0.01, "gyro.bias.x": 1e-6}
    assert calibration["gyro.bias.x"].unit == "rad/s"
    assert calibration.matrix.tolist() == [[4e-6, 1e-11], [1e-11, 9e-16]]
    with pytest.raises(KeyError, match="'gyro.bias.y' is not in this calibration; it has: accel.bias.x, gyro.bias.x"):
        calibration["gyro.bias.y"]


# ------------------------------------------------------------------------------------------------ JSON Schema


def test_the_published_schema_is_that_of_the_code():
    assert record.SCHEMA_FILE.read_text(encoding="utf-8") == json.dumps(record.json_schema(), indent=2) + "\n"


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(record.json_schema())


@given(calibrations())
def test_results_validate_against_the_published_schema(calibration):
    schema = json.loads(record.SCHEMA_FILE.read_text(encoding="utf-8"))
    jsonschema.validate(json.loads(calibration.to_json()), schema, cls=jsonschema.Draft202012Validator)


@pytest.mark.parametrize("key", ["schema", "method", "parameters", "covariance", "fit", "site", "software", "created"])
def test_schema_and_code_refuse_the_same_gap(key):
    table = small()
    del table[key]
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(table, record.json_schema())
    with pytest.raises(InputError):
        loads(json.dumps(table))


# -------------------------------------------------------------------------------------------------- refusals


def changed(path: str, value: object) -> dict:
    table = small()
    *way, last = [int(p) if p.isdigit() else p for p in path.split("/")]
    at = table
    for step in way:
        at = at[step]
    at[last] = value
    return table


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        ("schema", "sagnac/calibration/2", "not a calibration that this version reads ('sagnac/calibration/1')"),
        ("schema", "sagnac/calibration/2", "its schema is 'sagnac/calibration/2'"),
        ("schema", None, "it names no schema"),
        ("schema", 1, "its schema is 1"),
        ("method", 3, "damaged calibration: method: "),
        ("extra", 1, "damaged calibration: extra: "),
        ("parameters/0/value", "much", "damaged calibration: parameters.0.value: "),
        ("parameters/0/value", None, "damaged calibration: parameters.0.value: "),
        ("parameters/0/value", math.nan, "damaged calibration: parameters.0.value: "),
        ("parameters/0/value", math.inf, "damaged calibration: parameters.0.value: "),
        ("parameters/0/value", 10**400, "damaged calibration: parameters.0.value: "),
        ("parameters/0/standard_uncertainty", -0.002, "damaged calibration: parameters.0.standard_uncertainty: "),
        ("parameters/1/name", "accel.bias.x", "a parameter stands twice"),
        ("parameters", [], "damaged calibration: parameters: "),
        ("covariance", [[4e-6]], "the covariance is not 2 by 2 as the parameters ask"),
        ("covariance", [[4e-6, 1e-11], [1e-11]], "the covariance is not 2 by 2"),
        ("covariance/0/0", 5e-6, "the covariance of accel.bias.x does not agree with its standard uncertainty"),
        ("covariance/0/0", -4e-6, "the covariance of accel.bias.x does not agree with its standard uncertainty"),
        ("covariance/0/1", 2e-11, "the covariance of gyro.bias.x and accel.bias.x is not that of two quantities"),
        ("covariance", [[4e-6, 7e-11], [7e-11, 9e-16]], "is not that of two quantities"),  # correlation 7/6
        (
            "budget",
            [{"source": "noise", "standard_uncertainty": [1.0]}],
            "'noise' gives 1 standard uncertainties for 2",
        ),
        ("fit/white", [1.0], "'white' gives 1 standard uncertainties for 2 parameters"),
        ("fit/chi2", "x", "damaged calibration: fit.chi2: "),
    ],
)
def test_what_is_refused_says_why(path, value, says):
    with pytest.raises(InputError) as caught:
        loads(json.dumps(changed(path, value)), "cal.json")
    assert str(caught.value).startswith("cal.json: ")
    assert says in str(caught.value)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "3", "null", '"x"', "[" * 100_000, '{"schema": "sagnac/calibration/1"}']
)
def test_what_is_no_calibration_is_refused(text):
    with pytest.raises(InputError, match=r"^cal\.json: "):
        loads(text, "cal.json")


def test_missing_and_binary_files(tmp_path):
    with pytest.raises(InputError, match="cannot read the calibration"):
        load(tmp_path / "nowhere.json")
    (tmp_path / "b.json").write_bytes(b"\xff\x00")
    with pytest.raises(InputError, match="cannot read the calibration"):
        load(tmp_path / "b.json")


TEXT = json.dumps(small())


@given(st.integers(0, len(TEXT)), st.integers(0, 20), st.text(max_size=6))
def test_any_damage_is_read_or_refused(at, cut, put):
    try:
        again = loads(TEXT[:at] + put + TEXT[at + cut :], "cal.json")
        assert loads(again.to_json()) == again
        again.summary()
    except SagnacError as error:
        if not str(error).startswith("cal.json: "):
            raise


# -------------------------------------------------------------------------------------------------- printing


@pytest.mark.parametrize(
    ("value", "sigma", "unit", "text"),
    [
        # two digits of the uncertainty, and the value to the same place
        (0.0078453, 9.80665e-5, "m/s^2", ("0.800", "0.010", "mg")),
        (0.0078453, 9.80665e-6, "m/s^2", ("800.0", "1.0", "ug")),
        (1.5 * DEG, 0.02 * DEG, "rad/s", ("1.500", "0.020", "deg/s")),
        (-0.34 * DEG / 3600, 0.0123 * DEG / 3600, "rad/s", ("-0.340", "0.012", "deg/h")),
        (0.002, 1.2e-6, "1", ("2000.0", "1.2", "ppm")),
        (0.5, 0.02, "1", ("0.500", "0.020", "")),
        (30 * DEG / 3600, 2 * DEG / 3600, "rad", ("30.0", "2.0", "arcsec")),
        (3.0, 0.5, "count", ("3.00", "0.50", "count")),
        (123456.0, 1234.0, "count", ("123456", "1234", "count")),
        (1671.7, 0.25, "count/(m/s^2)", ("1671.70", "0.25", "count/(m/s^2)")),
        (9.80665, 0.0, "m/s^2", ("1000", "-", "mg")),
        (0.0, 0.0, "m/s^2", ("0", "-", "ug")),
        (1.0, 1e-12, "count", ("1", "1.0e-12", "count")),
    ],
)
def test_printed(value, sigma, unit, text):
    assert printed(value, sigma, unit) == text


@given(finite, size, st.sampled_from(UNITS))
def test_printed_says_the_number(value, sigma, unit):
    from sagnac.units import convert

    number, _, shown = printed(value, sigma, unit)
    scale = convert(1.0, unit, shown) if shown != unit else 1.0
    if math.isfinite(value * scale) and math.isfinite(sigma * scale):
        # to half a digit of the last place: a twentieth of the uncertainty at most, or nine significant digits
        assert float(number) == pytest.approx(value * scale, rel=1e-8, abs=0.06 * sigma * scale)


def test_summary_tells_the_result():
    table = small()
    table["unit"] = {"model": "demo", "serial": "7"}
    table["source"] = [{"file": "log.csv", "sha256": "0123456789abcdef"}]
    table["site"]["gravity_source"] = "given"
    table["fit"]["p_value"] = 0.48
    table["fit"]["residuals"] = {"static norm": {"rms": 1.5e-5, "unit": "m/s^2", "count": 12}}
    table["fit"]["influence"] = [
        {"segment": "s3", "leverage": 0.5, "chi2": 1.0, "shift": 0.4, "parameter": "gyro.bias.x"},
        {"segment": "s4", "leverage": 0.6, "chi2": 1.0, "shift": 0.7, "parameter": "accel.bias.x"},
    ]
    table["budget"] = [{"source": "noise", "standard_uncertainty": [0.002, 0.0]}]
    table["remarks"] = ["a gap"]
    text = loads(json.dumps(table)).summary()
    for part in (
        "Calibration by norm",
        "unit        demo 7",
        "recording   log.csv  sha256 0123456789ab...",
        "gravity     9.810000 m/s^2 (given)",
        "accel.bias.x                          1.02         0.20  mg",  # 0.01 / 9.80665e-3, 0.002 / 9.80665e-3
        "gyro.bias.x                         0.2063       0.0062  deg/h",  # 1e-6 and 3e-8 times 206264.8
        "chi-square 3.5 for 4 degrees of freedom, probability 0.48",
        "residual static norm: 1.530 ug rms over 12",  # 1.5e-5 / 9.80665e-6
        "most influence: segment 's4' moves accel.bias.x by 0.7 standard uncertainties",
        "share of the variance [%]        (1)\n  accel.bias.x                     100\n",
        "100\n  gyro.bias.x                        -\n  (1) noise",
        "note: a gap",
    ):
        assert part in text
    assert text.endswith("\n")


@given(calibrations())
def test_summary_of_anything(calibration):
    assert calibration.summary().startswith(f"Calibration by {calibration.method}\n")
