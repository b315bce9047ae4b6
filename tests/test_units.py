"""Units: text in, SI out, and nothing but InputError for what is no unit."""

from __future__ import annotations

import contextlib
import math
import subprocess
import sys

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from sagnac import units
from sagnac.errors import InputError

DEG = math.pi / 180
G = 9.80665  # CGPM 1901
# unit, kind, factor to SI written out by hand from the definitions of the units
FACTORS = [
    ("m/s^2", "acceleration", 1.0),
    ("m/s**2", "acceleration", 1.0),
    ("m/s/s", "acceleration", 1.0),
    ("m s^-2", "acceleration", 1.0),
    ("m/s²", "acceleration", 1.0),
    ("g", "acceleration", G),
    ("mg", "acceleration", G * 1e-3),
    ("ug", "acceleration", G * 1e-6),
    ("µg", "acceleration", G * 1e-6),  # micro sign
    ("μg", "acceleration", G * 1e-6),  # Greek mu
    ("Gal", "acceleration", 0.01),
    ("mGal", "acceleration", 1e-5),
    ("ft/s^2", "acceleration", 0.3048),
    ("rad/s", "angular rate", 1.0),
    ("deg/s", "angular rate", DEG),
    ("°/s", "angular rate", DEG),
    ("deg/h", "angular rate", DEG / 3600),
    ("deg/hr", "angular rate", DEG / 3600),
    ("rpm", "angular rate", 2 * math.pi / 60),
    ("mrad/s", "angular rate", 1e-3),
    ("eru", "angular rate", 7.292115e-5),  # WGS-84
    ("rad", "angle", 1.0),
    ("deg", "angle", DEG),
    ("arcmin", "angle", DEG / 60),
    ("arcsec", "angle", DEG / 3600),
    ("mas", "angle", DEG / 3.6e6),
    ("turn", "angle", 2 * math.pi),
    ("gon", "angle", math.pi / 200),
    ("s", "time", 1.0),
    ("ms", "time", 1e-3),
    ("us", "time", 1e-6),
    ("ns", "time", 1e-9),
    ("min", "time", 60.0),
    ("h", "time", 3600.0),
    ("m", "length", 1.0),
    ("mm", "length", 1e-3),
    ("km", "length", 1e3),
    ("ft", "length", 0.3048),
    ("in", "length", 0.0254),
    ("nmi", "length", 1852.0),
    ("ug/sqrt(Hz)", "accelerometer noise density", G * 1e-6),
    ("m/s/sqrt(h)", "accelerometer noise density", 1 / 60),
    ("deg/sqrt(h)", "gyro noise density", DEG / 60),
    ("deg/s/sqrt(Hz)", "gyro noise density", DEG),
    ("deg/s/Hz^0.5", "gyro noise density", DEG),
    ("ug/g^2", "quadratic coefficient", 1e-6 / G),
    ("deg/h/g^2", "g-squared sensitivity", DEG / 3600 / G**2),
    ("ppm", "ratio", 1e-6),
    ("ppb", "ratio", 1e-9),
    ("%", "ratio", 0.01),
    ("count", "count", 1.0),
    ("pulse", "count", 1.0),
    ("LSB", "count", 1.0),
]


@pytest.mark.parametrize(("unit", "kind", "size"), FACTORS)
def test_factor_is_that_of_the_definition(unit, kind, size):
    assert units.factor(unit, kind) == pytest.approx(size, rel=4e-15)


@given(st.sampled_from(FACTORS), st.floats(-1e12, 1e12))
def test_parse_is_number_times_factor(case, x):
    unit, kind, size = case
    assert units.parse(f"{x!r} {unit}", kind) == pytest.approx(x * size, rel=1e-14, abs=1e-300)


@given(st.floats(allow_nan=False, allow_infinity=False))
@pytest.mark.parametrize("unit", ["rad", "m", "s", "m/s^2", "rad/s", "m/s^2/Hz^0.5", "rad/s/Hz^0.5", "s^2/m"])
def test_si_texts_read_back_exactly(unit, x):
    kind = next(k for k, (si, _) in units.KINDS.items() if si == unit)
    assert units.parse(f"{x!r} {unit}", kind) == x


@given(st.sampled_from(FACTORS), st.floats(1e-6, 1e6))
def test_convert_undoes_factor(case, x):
    unit, kind, _ = case
    si = units.KINDS[kind][0]
    assert units.convert(x * units.factor(unit, kind), si, unit) == pytest.approx(x, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "kelvin"),
    [
        ("20 degC", 293.15),
        ("20 °C", 293.15),
        ("0 K", 0.0),
        ("32 degF", 273.15),
        ("212 °F", 373.15),
        ("-40 degF", 233.15),
    ],
)
def test_temperatures_have_an_offset(text, kelvin):
    # water freezes at 32 degF = 273.15 K and boils at 212 degF; both scales meet at -40
    assert units.parse(text, "temperature") == pytest.approx(kelvin, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "kind", "says"),
    [
        ("45", "angle", "has no unit where an angle is needed (for example 30 deg, 5 arcsec)"),
        ("45 m", "angle", "'45 m' has m where an angle is needed"),
        ("1 Hz", "angular rate", "has Hz where an angular rate is needed"),
        ("1 rad/s", "acceleration", "where an acceleration is needed"),
        ("3 pulse", "ratio", "has count where a ratio is needed"),
        ("3", "count", "has no unit where a count is needed"),
        ("1 deg", "ratio", "where a ratio is needed"),
        ("5 furlong", "length", "cannot read 'furlong' in '5 furlong' as a unit"),
        ("five m", "length", "cannot read 'five m' as a number with a unit"),
        ("", "length", "cannot read '' as a number with a unit"),
        ("1e400 m", "length", "'1e400 m' is not finite"),
        ("1e308 km", "length", "is not finite in m"),
        ("nan m", "length", "cannot read 'nan m' as a number"),
        ("1 m squared", "length", "write units as in m/s^2"),
    ],
)
def test_what_is_refused_says_why(text, kind, says):
    with pytest.raises(InputError) as caught:
        units.parse(text, kind, "this key")
    assert str(caught.value).startswith("this key: ")
    assert says in str(caught.value)


@pytest.mark.parametrize("text", ["", " ", "1", "9.81", "²", "()"])
def test_a_unit_without_letters_is_no_factor(text):
    with pytest.raises(InputError, match="is not a unit"):
        units.factor(text, "acceleration")


def test_the_gram_is_not_among_the_units():
    # "g" is standard gravity here; a mass would pass silently otherwise
    with pytest.raises(InputError):
        units.parse("1 kilogram", "acceleration")


@pytest.mark.parametrize(
    ("unit", "yes"), [("count", True), ("pulse", True), ("LSB", True), ("count/s", False), ("g", False), ("?", False)]
)
def test_is_count(unit, yes):
    assert units.is_count(unit) is yes


@given(st.text(max_size=80), st.sampled_from(sorted(units.KINDS)))
def test_any_text_is_a_number_or_an_input_error(text, kind):
    try:
        assert math.isfinite(units.parse(text, kind))
    except InputError as error:
        if not str(error).startswith("the value: "):
            raise


@given(st.text("0123456789^*()/. _-gmsHzradeg²³⁹sqrt", max_size=60), st.sampled_from(sorted(units.KINDS)))
@example("m squared squared squared squared", "length")
def test_texts_that_look_like_units_never_hang(text, kind):
    with contextlib.suppress(InputError):
        units.factor(text, kind)


POWERS_OF_POWERS = [
    "9^((99999999))",
    "9^9_999_999_999",
    "9⁹⁹⁹⁹⁹⁹⁹⁹⁹",
    "9**9**9**9",
    "min^9^9^9^9",
    "((((min^9)^9)^9)^9)^9",
    "((((min²)²)²)²)²" * 3,
    "m" + " squared" * 7,
    "m" + " cubed" * 8,
    "m^(9999999999)",
]


def test_powers_of_powers_are_refused_at_once():
    # Computed as written, any of these runs for longer than the test suite: a child is killed after 20 s instead.
    code = (
        "import sys\nfrom sagnac import units\nfrom sagnac.errors import InputError\n"
        "for text in sys.argv[1:]:\n"
        "    try:\n        units.parse('1 ' + text, 'length')\n"
        "    except InputError:\n        continue\n"
        "    sys.exit(text)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *POWERS_OF_POWERS], timeout=20, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(("si_unit", "unit"), units._FACTORS)
def test_factors_that_are_known_are_those_of_the_registry(si_unit, unit):
    ureg = units.registry()
    expected = ureg.Quantity(1.0, units._unit(units._named(si_unit))).to(units._unit(units._named(unit))).magnitude
    assert units.convert(1.0, si_unit, unit) == pytest.approx(expected, rel=4e-16)
