"""The alignment file: out and in again without loss, and refused when it is not sound."""

from __future__ import annotations

import json
import math

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.align import result as record
from sagnac.align.result import Alignment, load, loads
from sagnac.calibration import Software, Source
from sagnac.errors import InputError, SagnacError

finite = st.floats(allow_nan=False, allow_infinity=False)
size = st.floats(0, allow_infinity=False)
# squares of these neither overflow nor vanish, as a covariance needs
sigma = st.just(0.0) | st.floats(1e-140, 1e140)
word = st.text(st.characters(exclude_categories=["Cs"]), max_size=15)
UNITS = ["m/s^2", "rad/s", "rad", "m", "s", "m/s"]


def values(draw, names, sigmas):
    return [
        record.Value(name=n, value=draw(st.none() | finite), unit=draw(st.sampled_from(UNITS)), standard_uncertainty=s)
        for n, s in zip(names, sigmas, strict=True)
    ]


@st.composite
def alignments(draw):
    names = draw(st.lists(word, min_size=1, max_size=4, unique=True))
    k = len(names)
    sigmas = [draw(sigma) for _ in names]
    covariance = [[sigmas[i] ** 2 if i == j else 0.0 for j in range(k)] for i in range(k)]
    if k > 1:
        covariance[0][1] = covariance[1][0] = draw(st.floats(-1, 1)) * sigmas[0] * sigmas[1]
    angles = ["heading", "pitch", "roll"]
    each = st.tuples(*[size] * k)
    return Alignment(
        schema=record.SCHEMA,
        kind=draw(st.sampled_from(["transfer", "covariance", "static"])),
        method=draw(word),
        matching=draw(word),
        states=draw(word),
        correction=draw(word),
        time=draw(finite),
        parameters=values(draw, names, sigmas),
        covariance=covariance,
        attitude=draw(st.sampled_from([(), tuple(values(draw, angles, [0.1, 0.2, 0.3]))])),
        innovations=draw(
            st.none()
            | st.builds(
                record.Innovations,
                updates=st.integers(0, 10**9),
                rejected=st.integers(0, 10**9),
                mean=size,
                expected=st.floats(1, 9),
                band=st.tuples(size, size),
                ratio=st.dictionaries(word, size, max_size=3),
            )
        ),
        observed=draw(st.lists(st.builds(record.Observed, name=word, unit=word, initial=size, final=size), max_size=2)),
        singular_values=draw(st.lists(size, max_size=3)),
        not_observed=draw(
            st.lists(st.builds(record.NotObserved, name=word, remains=size, reason=word, shown_by=word), max_size=2)
        ),
        not_separated=draw(st.lists(word, max_size=2)),
        skipped=draw(st.lists(st.builds(record.Stretch, start=finite, stop=finite, reason=word), max_size=2)),
        course=draw(st.lists(st.builds(record.Moment, after=finite, standard_uncertainty=each), max_size=3)),
        source=draw(
            st.lists(st.builds(Source, file=word, sha256=st.none() | word, start=st.none() | finite), max_size=2)
        ),
        remarks=draw(st.lists(word, max_size=3)),
        software=Software(version=draw(word)),
        created=draw(word),
    )


def small() -> dict:
    """A sound file as a table, to be damaged."""
    return {
        "schema": "sagnac/alignment/1",
        "kind": "transfer",
        "method": "wander",
        "time": 900.0,
        "parameters": [
            {"name": "misalignment.x", "value": 0.01, "unit": "rad", "standard_uncertainty": 0.002},
            {"name": "gyro.bias.x", "value": None, "unit": "rad/s", "standard_uncertainty": 3e-8},
        ],
        "covariance": [[4e-6, 1e-11], [1e-11, 9e-16]],
        "attitude": [{"name": "heading", "value": 1.5, "unit": "rad", "standard_uncertainty": 1e-3}],
        "course": [{"after": 10.0, "standard_uncertainty": [0.01, 4e-8]}],
        "software": {"version": "0"},
        "created": "2000-01-01T00:00:00+00:00",
    }


# ------------------------------------------------------------------------------------------ out and in again


@given(alignments())
def test_an_alignment_reads_back_equal_to_the_last_bit(alignment):
    again = loads(alignment.to_json())
    assert again == alignment
    assert [p.value is None for p in again.parameters] == [p.value is None for p in alignment.parameters]


def test_save_and_load(tmp_path):
    alignment = loads(json.dumps(small()))
    alignment.save(tmp_path / "alignment.json")
    assert load(tmp_path / "alignment.json") == alignment
    assert [p.name for p in tmp_path.iterdir()] == ["alignment.json"]


def test_access():
    alignment = loads(json.dumps(small()))
    assert alignment.values() == {"misalignment.x": 0.01, "gyro.bias.x": None}
    assert alignment["gyro.bias.x"].unit == "rad/s"
    assert alignment["heading"].value == 1.5
    assert alignment.matrix.tolist() == [[4e-6, 1e-11], [1e-11, 9e-16]]
    with pytest.raises(KeyError, match="'gyro.bias.y' is not in this alignment; it has: misalignment.x, gyro.bias.x"):
        alignment["gyro.bias.y"]


# ------------------------------------------------------------------------------------------------ JSON Schema


def test_the_published_schema_is_that_of_the_code():
    assert record.SCHEMA_FILE.read_text(encoding="utf-8") == json.dumps(record.json_schema(), indent=2) + "\n"


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(record.json_schema())


@given(alignments())
def test_results_validate_against_the_published_schema(alignment):
    schema = json.loads(record.SCHEMA_FILE.read_text(encoding="utf-8"))
    jsonschema.validate(json.loads(alignment.to_json()), schema, cls=jsonschema.Draft202012Validator)


@pytest.mark.parametrize("key", ["schema", "kind", "method", "time", "parameters", "covariance", "software", "created"])
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
        ("schema", "sagnac/alignment/2", "not an alignment that this version reads ('sagnac/alignment/1')"),
        ("schema", "sagnac/calibration/1", "its schema is 'sagnac/calibration/1'"),
        ("schema", None, "it names no schema"),
        ("kind", "guess", "damaged alignment: kind: "),
        ("extra", 1, "damaged alignment: extra: "),
        ("parameters/0/value", "much", "damaged alignment: parameters.0.value: "),
        ("parameters/0/value", math.nan, "damaged alignment: parameters.0.value: "),
        ("parameters/0/standard_uncertainty", -0.002, "damaged alignment: parameters.0.standard_uncertainty: "),
        ("parameters/1/name", "misalignment.x", "a parameter stands twice"),
        ("parameters", [], "damaged alignment: parameters: "),
        ("covariance", [[4e-6]], "the covariance is not 2 by 2 as the parameters ask"),
        ("covariance/0/0", 5e-6, "the covariance of misalignment.x does not agree with its standard uncertainty"),
        ("covariance/0/1", 2e-11, "the covariance of gyro.bias.x and misalignment.x is not that of two quantities"),
        ("covariance", [[4e-6, 7e-11], [7e-11, 9e-16]], "is not that of two quantities"),  # correlation 7/6
        ("course/0/standard_uncertainty", [1.0], "course: each time needs the standard uncertainties of 2 parameters"),
        ("time", "noon", "damaged alignment: time: "),
    ],
)
def test_what_is_refused_says_why(path, value, says):
    with pytest.raises(InputError) as caught:
        loads(json.dumps(changed(path, value)), "alignment.json")
    assert str(caught.value).startswith("alignment.json: ")
    assert says in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "null", '"x"', "[" * 100_000, '{"schema": "sagnac/alignment/1"}'])
def test_what_is_no_alignment_is_refused(text):
    with pytest.raises(InputError, match=r"^alignment\.json: "):
        loads(text, "alignment.json")


def test_missing_and_binary_files(tmp_path):
    with pytest.raises(InputError, match="cannot read the alignment"):
        load(tmp_path / "nowhere.json")
    (tmp_path / "b.json").write_bytes(b"\xff\x00")
    with pytest.raises(InputError, match="cannot read the alignment"):
        load(tmp_path / "b.json")


@given(st.recursive(st.none() | st.booleans() | finite | word, lambda s: st.lists(s) | st.dictionaries(word, s)))
def test_any_json_is_read_or_refused(table):
    if isinstance(table, dict):
        table["schema"] = record.SCHEMA
    with pytest.raises(SagnacError):
        loads(json.dumps(table))


# ------------------------------------------------------------------------------------------------ page of text


def test_the_page_of_text():
    table = small() | {
        "matching": "velocity",
        "states": "short",
        "correction": "feedback",
        "innovations": {"updates": 100, "rejected": 2, "mean": 2.1, "expected": 2.0, "band": [1.5, 2.6]},
        "not_observed": [
            {"name": "accel.bias.x", "remains": 0.99, "reason": "a tilt does the same", "shown_by": "a turn shows it"},
            {"name": "accel.bias.y", "remains": 1.0, "reason": "a tilt does the same", "shown_by": "a turn shows it"},
        ],
        "skipped": [{"start": 60.0, "stop": 60.5, "reason": "no samples"}],
        "remarks": ["the master has a gap"],
        "source": [{"file": "master.csv", "sha256": "0123456789abcdef"}],
    }
    text = loads(json.dumps(table)).summary()
    assert text.startswith("Transfer alignment, method wander, matching velocity, short states, feedback correction\n")
    assert "  master.csv  sha256 0123456789ab...\n" in text
    assert "  at 900.000 s\n" in text
    # 0.002 rad are 6.9 arcmin, 3e-8 rad/s are 0.0062 deg/h
    assert "  misalignment.x                  34.4          6.9  arcmin\n" in text
    assert "  gyro.bias.x                        -       0.0062  deg/h\n" in text
    assert "  heading                       85.944        0.057  deg\n" in text
    assert "normalised innovations squared 2.1 where 2 is expected (99.9 % band 1.5 to 2.6)" in text
    flat = " ".join(text.split())
    assert "left out: 60 s to 60.5 s: no samples" in flat
    assert (
        "not observed: accel.bias.x (99 % of its uncertainty is left), accel.bias.y (100 % of its uncertainty is left): "
        "a tilt does the same; a turn shows it" in flat
    )
    assert "note: the master has a gap" in flat
    assert max(map(len, text.splitlines())) <= 112
