"""Courses: what is read from a table, and what is refused with the key named."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.errors import InputError
from sagnac.navigate.trajectory import Trajectory
from sagnac.navigate.trajectory.course import Climb, Course, Leg, Sway
from sagnac.navigate.trajectory.read import from_table

DEG = math.pi / 180.0
START = {"latitude": "55 deg", "speed": "10 m/s", "heading": "30 deg"}
STRAIGHT = {"duration": "60 s"}


def course(*legs: dict, **more: object) -> Course:
    return from_table({**START, **more, "leg": list(legs or [STRAIGHT])}, "c.toml")


# ------------------------------------------------------------------------------------------------- what is read


def test_texts_become_si():
    found = from_table(
        {
            "latitude": "-33.5 deg", "longitude": "151 deg", "height": "0.1 km", "speed": "19.44 kn", "heading": "-90 deg",
            "pitch": "1 deg", "roll": "-2 deg", "path": "great-circle", "bank": "coordinated", "ease": "2 s",
            "sway": {"roll": "5 deg", "roll_period": "9 s", "heave": "50 cm", "heave_phase": "90 deg"},
            "leg": [{"duration": "2 min", "turn_rate": "1.5 deg/s", "acceleration": "0.1 g", "climb": "-2 m/s", "ease": "5 s"}],
        }
    )  # fmt: skip
    assert found.latitude == pytest.approx(-33.5 * DEG)
    assert found.height == pytest.approx(100.0)
    assert found.speed == pytest.approx(19.44 * 1852 / 3600)
    assert found.heading == pytest.approx(-90 * DEG)
    assert (found.path, found.bank, found.ease) == ("great-circle", "coordinated", 2.0)
    assert found.sway.roll == pytest.approx(5 * DEG)
    assert (found.sway.heave, found.sway.pitch) == (0.5, 0.0)
    leg = found.leg[0]
    assert (leg.duration, leg.ease) == (120.0, 5.0)
    assert leg.turn_rate == pytest.approx(1.5 * DEG)
    assert leg.acceleration == pytest.approx(0.980665)


def test_what_is_left_out():
    found = course()
    assert (found.longitude, found.height, found.pitch, found.roll) == (0.0, 0.0, 0.0, 0.0)
    assert (found.path, found.bank, found.ease) == ("rhumb", "level", None)
    assert found.sway == Sway()
    assert found.duration == 60.0


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("2 m/s", "speed", 2.0),
        ("3 kn", "speed", 3 * 1852 / 3600),
        ("-3 deg", "angle", -3 * DEG),
        ("300 m", "height", 300.0),
    ],
)
def test_a_climb_is_what_its_unit_says(text, kind, value):
    climb = course({"duration": "60 s", "climb": text}).leg[0].climb
    assert climb.kind == kind
    assert climb.value == pytest.approx(value, rel=1e-12)


def test_groups_are_gone_through_again_and_again():
    weave = [{"duration": "15 s", "turn_rate": "3 deg/s"}, {"duration": "30 s", "turn_rate": "-3 deg/s"}]
    inner = {"repeat": 2, "legs": [STRAIGHT]}
    found = course(STRAIGHT, {"repeat": 3, "legs": [*weave, inner]}, {"duration": "1 s", "repeat": 2})
    assert [name for name, _ in found.legs] == [
        "leg.0",
        *["leg.1.legs.0", "leg.1.legs.1", "leg.1.legs.2.legs.0", "leg.1.legs.2.legs.0"] * 3,
        *["leg.2"] * 2,
    ]
    assert found.duration == 60 + 3 * (45 + 120) + 2
    assert sum(leg.count for leg in found.leg) == len(found.legs)


def test_python_takes_si_and_a_file_does_not():
    made = Course(latitude=0.5, speed=10.0, heading=0.1, leg=(Leg(duration=5, climb=Climb("speed", 1.0)),))
    assert made.leg[0].duration == 5.0
    assert Trajectory.of(made).duration == 5.0
    with pytest.raises(
        InputError, match=r"trajectory.latitude: write it as a text with its unit, for example '60 deg'; got 0.5"
    ):
        from_table({**START, "latitude": 0.5, "leg": [STRAIGHT]})
    with pytest.raises(ValueError, match="nan is not finite"):
        Course(latitude=math.nan, speed=10.0, heading=0.1, leg=(Leg(duration=5),))


angle = st.floats(-1.3, 1.3)
legs = st.builds(
    Leg,
    duration=st.floats(10.0, 1e3),
    turn_rate=st.floats(-0.1, 0.1),
    acceleration=st.sampled_from([0.0, 0.001]),
    climb=st.one_of(
        st.none(),
        st.builds(Climb, st.just("speed"), st.floats(-1, 1)),
        st.builds(Climb, st.just("angle"), st.floats(-0.01, 0.01)),
        st.builds(Climb, st.just("height"), st.floats(-50, 50)),
    ),
    ease=st.one_of(st.none(), st.floats(0.5, 5.0)),
)  # fmt: skip
courses = st.builds(
    Course,
    latitude=angle, longitude=angle, height=st.floats(0, 1e4), speed=st.floats(0, 300), heading=st.floats(-7, 7), pitch=angle,
    path=st.sampled_from(["rhumb", "great-circle"]), ease=st.one_of(st.none(), st.floats(0.5, 5.0)),
    sway=st.builds(Sway, roll=st.floats(0, 0.5), yaw_period=st.floats(1, 20), heave=st.floats(0, 5)),
    leg=st.lists(
        st.one_of(legs, st.builds(Leg, repeat=st.integers(1, 3), legs=st.lists(legs, min_size=1, max_size=2))),
        min_size=1, max_size=3,
    ),
)  # fmt: skip


@given(made=courses)
def test_written_and_read_again_it_is_the_same(made):
    assert from_table(made.to_table()) == made


def test_the_table_is_what_a_person_would_write():
    table = course(
        {"duration": "60 s", "turn_rate": "3 deg/s"}, {"duration": "9 s", "climb": "2 deg", "repeat": 2}
    ).to_table()
    assert table["latitude"] == "55.0 deg"
    assert table["leg"][0] == {"duration": "60.0 s", "turn_rate": "3.0 deg/s"}
    assert table["leg"][1] == {"duration": "9.0 s", "climb": "2.0 deg", "repeat": 2}
    assert "height" not in table


# ---------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("more", "legs", "says"),
    [
        ({"latitude": "91 deg"}, [], "trajectory.latitude: 1.58825 is not within 90 deg; check its unit"),
        ({"latitude": "60"}, [], "trajectory.latitude: '60' has no unit where rad is needed (for example '60 deg')"),
        ({"latitude": "60 m"}, [], "trajectory.latitude: '60 m' has m where rad is needed"),
        ({"height": "200 km"}, [], "trajectory.height: 200000 is not within -12 km and 100 km"),
        ({"speed": "-1 m/s"}, [], "trajectory.speed: -1 is negative"),
        ({"speed": "1001 m/s"}, [], "trajectory.speed: Input should be less than or equal to 1000"),
        ({"pitch": "85 deg"}, [], "trajectory.pitch: 1.48353 is not within 80 deg of level"),
        ({"path": "straight"}, [], "trajectory.path: Input should be 'rhumb' or 'great-circle'"),
        ({"bank": "none"}, [], "trajectory.bank: Input should be 'level' or 'coordinated'"),
        ({"heeding": "1 deg"}, [], "trajectory.heeding: no such key"),
        ({"sway": {"roll": "70 deg"}}, [], "trajectory.sway.roll: 1.22173 is not within 60 deg"),
        ({"sway": {"roll": "5 deg", "roll_period": "0 s"}}, [], "trajectory.sway.roll_period: 0 is not above zero"),
        ({"sway": {"rolls": "5 deg"}}, [], "trajectory.sway.rolls: no such key"),
        ({}, [{}], "trajectory.leg.0: duration is missing"),
        ({}, [{"duration": "0 s"}], "trajectory.leg.0.duration: 0 is not above zero"),
        ({}, [{"duration": 60}], "trajectory.leg.0.duration: write it as a text with its unit, for example '300 s'; got 60"),
        ({}, [{"duration": "60 s", "turn_rate": "3 deg"}], "trajectory.leg.0.turn_rate: '3 deg' has deg where rad/s is needed"),
        ({}, [{"duration": "60 s", "turn_rate": "3 rev/s"}], "trajectory.leg.0.turn_rate: 18.8496 is not within 10 rad/s"),
        ({}, [{"duration": "60 s", "climb": "2"}], "trajectory.leg.0.climb: write a vertical speed, the angle of the path or"),
        ({}, [{"duration": "60 s", "climb": "2 s"}], "trajectory.leg.0.climb: write a vertical speed, the angle of the path or"),
        ({}, [{"duration": "60 s", "climb": "89 deg"}], "trajectory.leg.0.climb: '89 deg' is beyond all sense; check its unit"),
        ({}, [{"duration": "60 s", "repeat": 0}], "trajectory.leg.0.repeat: Input should be greater than or equal to 1"),
        ({}, [{"legs": [STRAIGHT], "duration": "1 s"}], "trajectory.leg.0: duration: a group has legs and repeat only"),
        ({}, [{"legs": [{"duration": "1 m"}]}], "trajectory.leg.0.legs.0.duration: '1 m' has m where s is needed"),
        (
            {}, [{"repeat": 1000, "legs": [{"repeat": 1000, "legs": [STRAIGHT]}]}],
            "trajectory: leg: 1000000 legs, with all repetitions, are more than 20000",
        ),
        ({}, [{"duration": "1 year"}], "trajectory.leg.0.duration: cannot read 'year' in '1 year' as a unit"),
        ({}, [{"duration": "120 d"}], "trajectory: leg: together they take 1.04e+07 s, longer than 1e+07 s; check the units"),
        # what only comes out when the legs are put together
        (
            {}, [STRAIGHT, {"duration": "60 s", "acceleration": "-0.5 m/s^2"}],
            "trajectory.leg.1.acceleration: the speed falls to -20 m/s between 60 s and 120 s; shorten the leg",
        ),
        (
            {}, [{"repeat": 9, "legs": [{"duration": "60 s", "acceleration": "2 m/s^2"}]}],
            "trajectory.leg.0.legs.0.acceleration: the speed grows to 1090 m/s between 480 s and 540 s; shorten the leg",
        ),
        (
            {}, [{"duration": "60 s", "climb": "-300 m/s"}],
            "trajectory.leg.0.climb: the height reaches -17550 m between 3 s and 60 s; it must stay between -12 km and 100 km",
        ),
        ({}, [{"duration": "60 s", "ease": "61 s"}], "trajectory.leg.0.ease: 61 s is longer than the leg, 60 s"),
        ({"ease": "61 s"}, [STRAIGHT], "trajectory.leg.0.ease: 61 s is longer than the leg, 60 s"),
        (
            {"ease": "0 s"}, [STRAIGHT, {"duration": "60 s", "climb": "1 m/s"}],
            "trajectory.leg.1.ease: a climb cannot come in at once; give it a time",
        ),
        (
            {}, [{"duration": "60 s", "climb": "1 m/s"}, {"duration": "60 s", "ease": "0 s"}],
            "trajectory.leg.1.ease: a climb cannot come in at once; give it a time",
        ),
        (
            {"ease": "40 s"}, [{"duration": "60 s", "climb": "10 m"}],
            "trajectory.leg.0.climb: a leg of 60 s is too short to begin a climb and to end it, 40 s each (ease)",
        ),
        (
            {"bank": "coordinated"}, [{"duration": "60 s", "turn_rate": "3 deg/s", "ease": "0 s"}],
            "trajectory.leg.0.ease: a coordinated bank cannot come in at once",
        ),
        (
            {"bank": "coordinated", "speed": "250 m/s"}, [{"duration": "60 s", "turn_rate": "10 deg/s"}],
            "trajectory.leg.0.turn_rate: the bank would be 77.3 deg between 0 s and 3 s, more than 75 deg; turn slower, or write",
        ),
        (
            {"bank": "coordinated"}, [{"duration": "60 s", "acceleration": "-0.16 m/s^2"}],
            "trajectory.leg.0.acceleration: 0.64 m/s between 3 s and 60 s is too slow for a coordinated bank, 1 m/s",
        ),
        (
            {"bank": "coordinated"}, [{"duration": "60 s", "climb": "18 m/s"}],
            "trajectory.leg.0.climb: the path is steeper than 60 deg between 0 s and 3 s; climb slower",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(more, legs, says):
    with pytest.raises(InputError) as error:
        from_table({**START, **more, "leg": legs or [STRAIGHT]}, "c.toml")
    assert str(error.value).startswith("c.toml: ")
    assert says in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({k: v for k, v in START.items() if k != "speed"} | {"leg": [STRAIGHT]}, "trajectory.speed: is missing"),
        (START, "trajectory.leg: is missing"),
        (START | {"leg": []}, "trajectory: leg: a course has one leg at least"),
        (START | {"leg": STRAIGHT}, "trajectory.leg: "),
        ("east", "trajectory: "),
        (None, "trajectory: "),
    ],
)
def test_a_table_that_is_none(given, says):
    with pytest.raises(InputError) as error:
        from_table(given, "c.toml")
    assert str(error.value).startswith(f"c.toml: {says}")


words = st.one_of(st.text(max_size=8), st.sampled_from(["5 deg", "1 s", "1e400 m/s"]))
plain = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), words)
keys = st.sampled_from(["duration", "legs", "roll"])
junk = st.recursive(
    plain, lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(keys, inner, max_size=3)), max_leaves=6
)


def refused(table: dict) -> str:
    """What is said against a table, empty when nothing is."""
    try:
        from_table(table, "c.toml")
    except InputError as error:
        return str(error)
    return ""


@given(key=st.sampled_from([*Course.model_fields]), value=junk)
def test_nonsense_is_refused_or_read_but_nothing_else(key, value):
    said = refused({**START, "leg": [STRAIGHT], key: value})
    assert said == "" or said.startswith("c.toml: trajectory")


@given(key=st.sampled_from([*Leg.model_fields]), value=junk)
def test_nonsense_in_a_leg_is_refused_or_read_but_nothing_else(key, value):
    said = refused({**START, "leg": [{**STRAIGHT, key: value}]})
    assert said == "" or said.startswith("c.toml: trajectory")


@pytest.mark.parametrize("heading", ["0 deg", "2 deg"])
def test_a_rhumb_line_does_not_reach_a_pole(heading):
    far = course({"duration": "300 s"}, latitude="89.8 deg", heading=heading, speed="100 m/s")
    with pytest.raises(
        InputError, match=r"trajectory.leg.0: after .* within 0.1 deg of a pole.*path = \"great-circle\""
    ):
        Trajectory.of(far)
    Trajectory.of(far.model_copy(update={"path": "great-circle"}))


def test_a_rhumb_line_does_not_start_at_a_pole():
    with pytest.raises(InputError, match=r"trajectory.leg.0: after 0 s the course comes within 0.1 deg of a pole"):
        Trajectory.of(course(latitude="-90 deg"))
