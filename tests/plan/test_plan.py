"""Plans: out and in again without loss, and every refusal in words."""

from __future__ import annotations

import math
import re
import tempfile
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac import plan as plans
from sagnac.earth import EARTH_RATE, STANDARD_GRAVITY
from sagnac.errors import InputError, SagnacError
from sagnac.plan import Limits, Noise, Plan, Rig, Segment, Unit

DEG = math.pi / 180

EXAMPLE = """\
latitude = "45 deg"
height   = "0 m"
gravity  = "9.8061992 m/s^2"        # optional
[unit]
model = "demo RLG"; serial = "0001"
noise = { accel = "10 ug/sqrt(Hz)", gyro = "0.001 deg/sqrt(h)" }   # optional, else estimated from the data
[rig]
kind = "turntable"                  # turntable | centrifuge | roll-isolated
angle_uncertainty = "1 arcmin"      # 1 sigma per axis setting
axis_uncertainty = "5 arcsec"       # tilt, non-perpendicularity, zero
[[segment]]
name = "1"; start = "0 s"; stop = "60 s"
outer = "30 deg"; middle = "0 deg"; inner = "-31.7175 deg"
outer_rate = "0 deg/s"
"""


def read(text: str | bytes) -> Plan:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return plans.load(path)


def refusal(text: str | bytes) -> str:
    with pytest.raises(InputError) as caught:
        read(text)
    assert "plan.toml: " in str(caught.value)
    return str(caught.value)


def test_the_documented_example():
    plan = read(EXAMPLE)
    assert plan.latitude == pytest.approx(math.pi / 4, rel=1e-15)
    assert plan.height == 0
    assert plan.gravity == plan.site_gravity == 9.8061992
    assert plan.earth_rate == EARTH_RATE
    assert (plan.unit.model, plan.unit.serial) == ("demo RLG", "0001")
    assert plan.unit.noise.accel == pytest.approx(10e-6 * STANDARD_GRAVITY, rel=1e-15)
    assert plan.unit.noise.gyro == pytest.approx(0.001 * DEG / 60, rel=1e-15)
    assert plan.rig.angle_uncertainty == pytest.approx(DEG / 60, rel=1e-15)
    assert plan.rig.axis_uncertainty == pytest.approx(5 * DEG / 3600, rel=1e-15)
    (segment,) = plan.segment
    assert (segment.name, segment.start, segment.stop, segment.outer_rate) == ("1", 0, 60, 0)
    assert segment.angles == pytest.approx((30 * DEG, 0, -31.7175 * DEG), rel=1e-15)


# ------------------------------------------------------------------------------------------ out and in again

size = st.floats(0, 1e3)
signed = st.floats(-1e3, 1e3)
text = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


def maybe(strategy):
    return st.none() | strategy


def turntable_keys(draw):
    turning = draw(st.sampled_from(["outer_rate", "middle_rate", "inner_rate"]))
    return {
        "outer": draw(maybe(signed)),
        "middle": draw(maybe(signed)),
        "inner": draw(maybe(signed)),
        turning: draw(signed),
        "x_azimuth": draw(maybe(signed)),
        "y_azimuth": draw(maybe(signed)),
        "z": draw(st.sampled_from([None, "up", "down"])),
    }


def centrifuge_keys(draw):
    angles = {name: draw(signed) for name in ("alpha", "beta", "gamma")}
    return {"arm_rate": draw(signed), "arm_phase": draw(maybe(signed)), **angles}


def roll_keys(draw):
    stage = draw(st.sampled_from(["inner", "spin"]))
    return {"stage": stage, f"{stage}_rate": draw(signed.filter(bool))}


@st.composite
def segments(draw, keys=turntable_keys):
    times = sorted(draw(st.lists(st.floats(-1e5, 1e5), min_size=0, max_size=12, unique=True)))
    pairs = [(a, b) for a, b in zip(times[::2], times[1::2], strict=False) if b > a]
    names = draw(st.lists(text, min_size=len(pairs), max_size=len(pairs), unique=True))
    return tuple(Segment(name=name, start=a, stop=b, **keys(draw)) for name, (a, b) in zip(names, pairs, strict=True))


letters = st.sampled_from([("z", "x", "y"), ("z", "x", "z"), ("x", "z"), ("y",)])
axis_names = st.lists(st.from_regex(r"[a-z]{3,8}", fullmatch=True), min_size=3, max_size=3, unique=True).filter(
    lambda names: not {"name", "start", "stop"} & {n.removesuffix("_rate") for n in names}
)
trust = {"angle_uncertainty": size, "axis_uncertainty": size, "rate_uncertainty": size}
positive = st.floats(1e-3, 1e3)
RIGS = {
    "turntable": (st.builds(Rig, **trust), turntable_keys),
    "centrifuge": (
        st.builds(
            Rig,
            kind=st.just("centrifuge"),
            radius=positive,
            radius_uncertainty=size,
            counter_rotating=st.booleans(),
            phase_uncertainty=size,
            **trust,
        ),
        centrifuge_keys,
    ),
    "roll-isolated": (
        st.builds(
            Rig,
            kind=st.just("roll-isolated"),
            encoder_resolution=size,
            encoder_uncertainty=maybe(size),
            encoder_delay=maybe(signed),
            **trust,
        ),
        roll_keys,
    ),
}


def planned(kind):
    rig, keys = RIGS[kind]
    return st.builds(
        Plan,
        latitude=maybe(st.floats(-math.pi / 2, math.pi / 2)),
        height=st.floats(-500, 9000),
        gravity=maybe(st.floats(9.76, 9.84)),
        gravity_uncertainty=size,
        earth_rate=st.floats(7e-5, 8e-5),
        unit=st.builds(
            Unit,
            model=text,
            serial=text,
            noise=st.builds(Noise, accel=maybe(size), gyro=maybe(size)),
            scale=st.dictionaries(st.sampled_from(["accel", "gyro_x"]), st.just("1.1866 pulse/arcsec")),
            accel_k2=maybe(st.tuples(signed, signed, signed)),
            limits=st.builds(
                Limits,
                accel_k2=maybe(size),
                gyro_g_squared=maybe(size),
                accel_drift=maybe(size),
                gyro_drift=maybe(size),
                gyro_scale=maybe(size),
            ),
        ),
        rig=rig,
        segment=segments(keys),
    )


@pytest.mark.parametrize("kind", RIGS)
@given(st.data())
def test_a_plan_reads_back_equal_to_the_last_bit(kind, data):
    plan = data.draw(planned(kind))
    assert read(plan.to_toml()) == plan


@given(axis_names, letters, st.lists(st.tuples(signed, signed, signed, signed), min_size=1, max_size=3))
def test_a_table_with_names_of_its_own_reads_back_equal(names, letters, settings):
    own = dict(zip(names, letters, strict=False))
    segments = []
    for i, (*angles, rate) in enumerate(settings):
        keys = dict(zip(list(own), (f"{a!r} rad" for a in angles), strict=False))
        segments.append(
            {"name": str(i), "start": f"{i} s", "stop": f"{i + 0.5} s", **keys, f"{names[0]}_rate": f"{rate!r} rad/s"}
        )
    plan = plans.from_table({"rig": {"axes": own}, "segment": segments})
    assert plan.rig.axes == own
    for s, (*angles, rate) in zip(plan.segment, settings, strict=True):
        assert s.angles == (*angles[: len(own)], *[0.0] * (3 - len(own)))
        assert s.outer_rate == rate
    assert read(plan.to_toml()) == plan


BAD_RIGS = [
    ({"kind": "centrifuge"}, {"outer": "3 deg", "arm_rate": "1 deg/s"}, "outer says nothing on a centrifuge"),
    ({"kind": "centrifuge", "radius": "1 m"}, {}, "lacks arm_rate"),
    ({"kind": "centrifuge"}, {"arm_rate": "180 deg/s"}, "radius is missing"),
    ({"kind": "centrifuge", "radius": "-1 m"}, {"arm_rate": "180 deg/s"}, "is no radius"),
    ({"kind": "roll-isolated"}, {"spin_rate": "10 deg/s"}, "lacks stage"),
    ({"kind": "roll-isolated"}, {"stage": "spin", "inner_rate": "10 deg/s"}, "needs spin_rate, and no inner_rate"),
    ({"kind": "roll-isolated"}, {"stage": "inner"}, "needs inner_rate"),
    ({"radius": "1 m"}, {}, "radius says nothing on a turntable"),
    ({}, {"gamma": "90 deg"}, "gamma says nothing on a turntable"),
    ({}, {"outer_rate": "1 deg/s", "inner_rate": "1 deg/s"}, "turns two axes at once"),
    ({"axes": {"outer": "z", "middle": "z"}}, {}, "two axes in a row turn about z"),
    ({"axes": {}}, {}, "rig.axes"),
    ({"axes": {"a": "x", "b": "y", "c": "z", "d": "x"}}, {}, "rig.axes"),
    ({"axes": {"outer": "up"}}, {}, "rig.axes"),
]


@pytest.mark.parametrize(("rig", "segment", "said"), BAD_RIGS)
def test_keys_that_the_rig_cannot_have(rig, segment, said):
    with pytest.raises(InputError, match=said):
        plans.from_table({"rig": rig, "segment": [{"name": "1", "start": "0 s", "stop": "1 s", **segment}]})


def test_save_and_load(tmp_path):
    plan = read(EXAMPLE)
    plan.save(tmp_path / "again.toml")
    assert plans.load(tmp_path / "again.toml") == plan


def test_angles_are_written_in_degrees():
    assert '"30.0 deg"' in read(EXAMPLE).to_toml()


# ------------------------------------------------------------------------------------ texts that people write


@pytest.mark.parametrize(
    "line",
    [
        'model = "a"; serial = "1"',
        'model = "a" ;serial = "1" ; # last; one',
        'model = "a"\t;\tserial = "1"',
        "model = 'a'; serial = '1'",
    ],
)
def test_semicolons_part_keys(line):
    assert read(f"[unit]\n{line}\n").unit == Unit(model="a", serial="1")


@pytest.mark.parametrize(
    ("written", "model"),
    [
        ('"a; b"', "a; b"),
        ("'a; b'", "a; b"),
        (r'"C:\\"', "C:\\"),  # a backslash at the end, written for a basic string ...
        ("'C:\\'", "C:\\"),  # ... and for a literal one
        (r'"say \"a; b\""', 'say "a; b"'),
        ('"""a;\nb; "c"; # d"""', 'a;\nb; "c"; # d'),
        ("'''a;\nb'''", "a;\nb"),
        ('"it\'s; # no comment"', "it's; # no comment"),
        ('"a\u2028b\x85c"', "a\u2028b\x85c"),  # line ends elsewhere, not in TOML
    ],
)
def test_semicolons_inside_texts_are_left_alone(written, model):
    assert read(f'[unit]\nmodel = {written}; serial = "1"\n').unit == Unit(model=model, serial="1")


def test_a_byte_order_mark_and_windows_line_ends():
    assert read(b"\xef\xbb\xbf" + EXAMPLE.replace("\n", "\r\n").encode()) == read(EXAMPLE)


# ------------------------------------------------------------------------------------------------- refusals


def with_segments(*parts: str) -> str:
    return "".join(f"[[segment]]\n{p}\n" for p in parts)


REFUSALS = [
    ("latitude = 45", "latitude: write it as a text with its unit, for example '30 deg, 5 arcsec'; got 45"),
    ("latitude = true", "latitude: write it as a text with its unit"),
    ('latitude = "45"', "latitude: '45' has no unit where an angle is needed"),
    ('latitude = "45 m"', "latitude: '45 m' has m where an angle is needed"),
    ('latitude = "45 dge"', "latitude: cannot read 'dge' in '45 dge' as a unit"),
    ('latitude = "90.1 deg"', "latitude 90.1 deg is beyond a pole"),
    ('latitude = "-91 deg"', "latitude -91 deg is beyond a pole"),
    ('gravity = "98 m/s^2"', "gravity 98 m/s^2 is not found on Earth (9.76 to 9.84); check its unit"),
    ('gravity = "9.81 mm/s^2"', "is not found on Earth"),
    ('gravity = "9.81 m/s"', "gravity: '9.81 m/s' has m / s where an acceleration is needed"),
    ('heigth = "3 m"', "heigth: no such key"),
    ('[unit]\nmodell = "x"', "unit.modell: no such key"),
    ('[unit.noise]\naccel = "10 ug"', "where an accelerometer noise density is needed (for example 10 ug/sqrt(Hz))"),
    ('[unit.noise]\ngyro = "-1 deg/sqrt(h)"', "unit.noise.gyro: -0.000290888 is negative"),
    ('[unit]\naccel_k2 = ["1 ug/g^2", "1 ug/g^2"]', "unit.accel_k2.2: is missing"),
    ('[rig]\nangle_uncertainty = "-1 arcmin"', "rig.angle_uncertainty: -0.000290888 is negative"),
    ("[rig]\nrate_uncertainty = inf", "rig.rate_uncertainty: inf is not finite"),
    ("[rig]\nrate_uncertainty = nan", "rig.rate_uncertainty: nan is not finite"),
    (f"[rig]\nrate_uncertainty = {'9' * 400}", "rig.rate_uncertainty: the number is too large"),
    ('[rig]\nkind = "carousel"', "rig.kind: "),
    (with_segments('start = "0 s"; stop = "1 s"'), "segment number 1, name: is missing"),
    (with_segments('name = "a"; start = "0 s"'), "segment a, stop: is missing"),
    (with_segments('name = "a"; start = "0 s"; stop = "1 s"; outr = "3 deg"'), "segment a, outr: no such key"),
    (with_segments('name = "a"; start = "0 s"; stop = "1 s"; z = "left"'), "segment a, z: "),
    (with_segments('name = "a"; start = "5 s"; stop = "5 s"'), "segment 'a' stops at 5 s, not after its start 5 s"),
    (with_segments('name = "a"; start = "5 s"; stop = "4 s"'), "segment 'a' stops at 4 s, not after its start 5 s"),
    (
        with_segments('name = "a"; start = "0 s"; stop = "1 s"', 'name = "a"; start = "1 s"; stop = "2 s"'),
        "segment names must differ; used more than once: a",
    ),
    (
        with_segments('name = "b"; start = "9 s"; stop = "12 s"', 'name = "a"; start = "0 s"; stop = "10 s"'),
        "segments 'a' and 'b' overlap in time",
    ),
    ("segment = 3", "segment: "),
    ("segment = [3]", "segment 1: "),
    ('latitude = "45 deg', "cannot read the plan: "),
    ('a = 1; b = 2\nc = "x"; d = \n', "cannot read the plan: Invalid value (at line 2)"),
    ("a = " + "[" * 5000, "cannot read the plan: its brackets are nested too deeply"),
    ("a = " + "1" * 5000, "cannot read the plan: "),
    (b"\xff\xfe\x00", "cannot read the plan: "),
    (b"latitude = \0", "cannot read the plan: "),
]


@pytest.mark.parametrize(("written", "says"), REFUSALS, ids=[says[:40] for _, says in REFUSALS])
def test_what_is_refused_says_why(written, says):
    assert says in refusal(written)


def test_all_faults_are_told_at_once():
    said = refusal('latitude = "45 m"\nheigth = "3 m"\n')
    assert "latitude: " in said
    assert "heigth: no such key" in said


def test_a_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.toml: cannot read the plan"):
        plans.load(tmp_path / "nowhere.toml")


def test_segments_may_touch():
    read(with_segments('name = "a"; start = "0 s"; stop = "1 s"', 'name = "b"; start = "1 s"; stop = "2 s"'))


@given(st.binary(max_size=300))
def test_any_bytes_are_a_plan_or_a_told_error(data):
    try:
        read(data)
    except SagnacError as error:
        if "plan.toml: " not in str(error):
            raise


@given(st.integers(0, len(EXAMPLE)), st.integers(0, len(EXAMPLE)), st.text(max_size=5))
def test_any_damage_to_the_example_is_a_plan_or_a_told_error(a, b, put):
    try:
        read((EXAMPLE[: min(a, b)] + put + EXAMPLE[max(a, b) :]).encode("utf-8", "replace"))
    except SagnacError as error:
        if "plan.toml: " not in str(error):
            raise


# ---------------------------------------------------------------------------------------------- site and Python


def test_site_gravity_is_measured_else_normal_else_refused():
    # NIMA TR8350.2: normal gravity at the pole
    assert Plan(latitude=math.pi / 2).site_gravity == pytest.approx(9.8321849378, abs=5e-10)
    assert Plan(latitude=math.pi / 2, gravity=9.81).site_gravity == 9.81
    with pytest.raises(InputError, match="neither gravity nor latitude"):
        _ = Plan().site_gravity


def test_python_calls_take_si_numbers_and_texts():
    assert Plan(latitude=0.5).latitude == 0.5
    assert Plan(latitude="30 deg").latitude == pytest.approx(math.pi / 6, rel=1e-15)


def test_the_latitude_is_asked_for_where_it_is_needed():
    with pytest.raises(InputError, match="latitude"):
        Plan().need_latitude("the Earth rate")


def test_plans_do_not_change():
    with pytest.raises(ValueError, match="frozen"):
        Plan().latitude = 0.1


def test_angles_are_all_or_none():
    assert Segment(name="a", start=0, stop=1, outer=0.1, middle=0.2, inner=0.3).angles == (0.1, 0.2, 0.3)
    assert Segment(name="a", start=0, stop=1, outer=0.1, middle=0.2).angles is None


def test_noise_of_each_axis_and_slow_terms():
    text = """
[unit.noise]
accel = ["10 ug/sqrt(Hz)", "20 ug/sqrt(Hz)", "10 ug/sqrt(Hz)"]
gyro = "0.001 deg/sqrt(h)"
gyro_instability = "0.01 deg/h"
accel_walk = ["1 ug/sqrt(h)", "2 ug/sqrt(h)", "0 ug/sqrt(h)"]
"""
    plan = plans.from_table(tomllib.loads(text))
    noise = plan.unit.noise
    ug = 1e-6 * STANDARD_GRAVITY
    assert noise.of("accel") == pytest.approx((10 * ug, 20 * ug, 10 * ug))
    assert noise.of("gyro") == (noise.gyro,) * 3
    assert noise.of("gyro", "instability") == pytest.approx((0.01 * DEG / 3600,) * 3)
    assert noise.of("accel", "walk") == pytest.approx((ug / 60, 2 * ug / 60, 0.0))
    assert noise.of("accel", "instability") is None
    assert plans.from_table(tomllib.loads(plan.to_toml())) == plan


def test_noise_of_zero_states_nothing():
    assert Noise(accel=0.0).of("accel") is None
    with pytest.raises(ValueError, match="no axis is without white noise"):
        Noise(accel=(1.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            '["1 ug/sqrt(Hz)", "1 ug/sqrt(Hz)"]',
            "unit.noise.accel: give one quantity for all axes or three for x, y, z; got 2",
        ),
        ('["1 ug/sqrt(Hz)", "-1 ug/sqrt(Hz)", "1 ug/sqrt(Hz)"]', "unit.noise.accel: -9.80665e-06 is negative"),
        ('["1 ug/sqrt(Hz)", "1 ug", "1 ug/sqrt(Hz)"]', "'1 ug' has ug where"),
    ],
)
def test_noise_of_axes_has_to_be_of_three(given, words):
    with pytest.raises(InputError, match=re.escape(words)):
        plans.from_table(tomllib.loads(f"[unit.noise]\naccel = {given}"))
