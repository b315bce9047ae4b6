"""What a test needs before it begins, in words and for machines."""

import math

import pytest

from sagnac import units
from sagnac.errors import InputError
from sagnac.noise.expected import from_text, needs, to_dict, told
from sagnac.noise.requirement import smallest


def test_terms_that_are_not_expected_are_given_with_what_a_record_would_show():
    need = needs([from_text("gyro=N=0.2 deg/sqrt(h), K=20 deg/h/sqrt(h)")], 0.01)[0]
    assert set(need.smallest) == {"instability"}
    sizes = need.smallest["instability"]
    assert list(sizes) == sorted(sizes, reverse=True)  # a longer record shows less
    assert sizes[1] == smallest("instability", need.expected.coefficients, 0.01, 3600.0)
    row = next(line for line in told([need]).splitlines() if line.startswith("  bias instability B"))
    assert "none  shown from" in row
    assert float(row.split()[7]) == pytest.approx(units.convert(sizes[1], "rad/s", "deg/h"), rel=0.05)  # two digits
    entry = to_dict([need])[0]["smallest"]["instability"]
    assert [e["duration"] for e in entry] == [600.0, 3600.0, 14400.0, 86400.0]
    assert entry[1]["value"] == sizes[1]


def test_records_that_are_too_short_show_nothing():
    need = needs([from_text("accel=N=50 ug/sqrt(Hz)")], 60.0)[0]  # ten samples in ten minutes
    assert need.smallest["walk"][0] == math.inf
    assert to_dict([need])[0]["smallest"]["walk"][0]["value"] is None
    assert "        -" in told([need])


@pytest.mark.parametrize(
    ("text", "what"),
    [("mag=N=1", "begin with accel= or gyro="), ("gyro=X=2", "'X=2' is no term"), ("gyro=N=1 m", "not in")],
)
def test_what_cannot_be_read_is_told(text, what):
    with pytest.raises(InputError, match=what):
        from_text(text)
