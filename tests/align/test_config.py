"""Settings of an alignment: out and in again without loss, and every refusal in words."""

from __future__ import annotations

import math
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.align import config as configs
from sagnac.align.config import Config, Flexure, Initial, Noise, from_table, load
from sagnac.earth import EARTH_RATE, STANDARD_GRAVITY
from sagnac.errors import InputError, SagnacError

DEG = math.pi / 180

EXAMPLE = """\
method = "wander"                 # wander | geographic | north-then-wander
matching = "velocity"             # velocity | velocity+attitude
update_interval = "0.1 s"
lever_arm = ["0 m", "0 m", "0 m"] # master to slave, in b; with [initial] lever_arm uncertainty it is estimated
[initial]                         # 1 sigma
misalignment = ["0.2 deg", "0.2 deg", "0.5 deg"]
velocity = "0.2 m/s"; gyro_bias = "0.01 deg/h"; accel_bias = "50 ug"
[noise]
gyro = "0.001 deg/sqrt(h)"; accel = "0.833 ug/sqrt(Hz)"; velocity = "0.01 m/s"; attitude = "1 arcmin"
[trajectory]
latitude = "60 deg"; longitude = "108 deg"; height = "0 m"; speed = "19.44 kn"; heading = "90 deg"
[[trajectory.leg]]
duration = "900 s"
"""
LEAST = """\
[initial]
misalignment = "1 deg"
velocity = "1 m/s"
gyro_bias = "1 deg/h"
accel_bias = "1 mg"
[noise]
gyro = "0.1 deg/sqrt(h)"
accel = "100 ug/sqrt(Hz)"
velocity = "0.1 m/s"
"""


@pytest.fixture
def read(tmp_path):
    def read(text: str | bytes) -> Config:
        path = tmp_path / "config.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load(path)

    return read


def test_the_documented_example(read):
    config = read(EXAMPLE)
    assert (config.method, config.matching, config.states, config.correction) == (
        "wander",
        "velocity",
        "short",
        "feedback",
    )
    assert config.update_interval == 0.1
    assert config.lever_arm == (0, 0, 0)
    assert config.initial.misalignment == pytest.approx((0.2 * DEG, 0.2 * DEG, 0.5 * DEG), rel=1e-15)
    assert config.initial.velocity == 0.2
    assert config.initial.gyro_bias == pytest.approx((0.01 * DEG / 3600,) * 3, rel=1e-14)
    assert config.initial.accel_bias == pytest.approx((50e-6 * STANDARD_GRAVITY,) * 3, rel=1e-14)
    assert config.noise.gyro == pytest.approx(0.001 * DEG / 60, rel=1e-15)
    assert config.noise.accel == pytest.approx(0.833e-6 * STANDARD_GRAVITY, rel=1e-14)
    assert config.noise.attitude == pytest.approx(DEG / 60, rel=1e-15)
    assert config.trajectory.duration == 900
    assert config.trajectory.speed == pytest.approx(19.44 * 1852 / 3600, rel=1e-14)


def test_what_is_left_out(read):
    config = read(LEAST)
    assert (config.gate, config.latency, config.smooth, config.samples, config.coning) == (
        0.9999,
        0,
        False,
        "instant",
        2,
    )
    assert config.gravity is None
    assert config.earth_rate == EARTH_RATE
    assert config.trajectory is None
    assert config.flexure is None
    first = config.initial
    assert (first.position, first.height, first.lever_arm, first.delay, first.wander) == (10, 10, None, None, 1e-9)
    assert (config.noise.attitude, config.noise.gyro_walk, config.noise.accel_walk) == (None, 0, 0)


def test_one_value_stands_for_three(read):
    config = read(LEAST.replace('velocity = "1 m/s"', 'velocity = "1 m/s"\nlever_arm = "2 m"'))
    assert config.initial.misalignment == (DEG, DEG, DEG)
    assert config.initial.lever_arm == (2, 2, 2)


@pytest.mark.parametrize(("text", "value"), [('"off"', 0), ("0", 0), ("0.0", 0), ("0.99", 0.99)])
def test_gates(read, text, value):
    assert read(f"gate = {text}\n{LEAST}").gate == value


def test_numbers_in_python_are_si():
    config = Config(
        update_interval=0.5,
        initial=Initial(misalignment=0.01, velocity=1, gyro_bias=(1e-6, 2e-6, 3e-6), accel_bias=0.01),
        noise=Noise(gyro=1e-6, accel=1e-4, velocity=0.1),
    )
    assert config.initial.misalignment == (0.01, 0.01, 0.01)
    assert config.initial.gyro_bias == (1e-6, 2e-6, 3e-6)


# ------------------------------------------------------------------------------------------ out and in again

length = st.floats(-900, 900)
positive = st.floats(1e-9, 0.9)
size = st.floats(0, 0.9)


def three(of):
    return st.tuples(of, of, of)


def maybe(of):
    return st.none() | of


COURSES = [
    None,
    {"latitude": "60 deg", "speed": "10 m/s", "heading": "90 deg", "leg": [{"duration": "900 s"}]},
    {
        "latitude": "-33.1 deg",
        "longitude": "0.1 deg",
        "height": "11 m",
        "speed": "7.3 kn",
        "heading": "1 deg",
        "leg": [
            {
                "repeat": 2,
                "legs": [{"duration": "15 s", "turn_rate": "3 deg/s"}, {"duration": "30 s", "climb": "1 m/s"}],
            },
            {"duration": "1 min", "acceleration": "0.01 g", "ease": "2 s"},
        ],
        "sway": {"roll": "3 deg", "roll_period": "9 s"},
    },
]
configurations = st.builds(
    Config,
    method=st.sampled_from(["wander", "geographic", "north-then-wander"]),
    states=st.sampled_from(["short", "full"]),
    correction=st.sampled_from(["feedback", "output"]),
    update_interval=positive,
    lever_arm=three(length),
    gate=st.floats(0, 0.9999),
    latency=st.floats(-10, 10),
    smooth=st.booleans(),
    samples=st.sampled_from(["instant", "mean"]),
    coning=st.integers(1, 4),
    gravity=maybe(st.floats(9.71, 9.89)),
    earth_rate=st.floats(7e-5, 8e-5),
    initial=st.builds(
        Initial,
        misalignment=three(positive),
        velocity=size,
        gyro_bias=three(size),
        accel_bias=three(size),
        position=size,
        height=size,
        lever_arm=maybe(three(size)),
        delay=maybe(size),
        wander=size,
    ),
    noise=st.builds(
        Noise,
        gyro=positive,
        accel=positive,
        velocity=positive,
        attitude=maybe(positive),
        gyro_walk=size,
        accel_walk=size,
    ),
    flexure=maybe(st.builds(Flexure, sigma=three(size), time=positive)),
    trajectory=st.sampled_from(COURSES),
)


@given(configurations)
def test_a_configuration_reads_back_equal_to_the_last_bit(config):
    assert from_table(tomllib.loads(config.to_toml())) == config


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_no_sensor_is_free_of_noise(sensor):
    table = tomllib.loads(LEAST)
    unit = table["noise"][sensor].partition(" ")[2]
    for size in (0, -1):
        table["noise"][sensor] = f"{size} {unit}"
        with pytest.raises(InputError, match=rf"noise.{sensor}: .*no sensor is free of it"):
            from_table(table)


def test_save_and_load(read, tmp_path):
    config = read(EXAMPLE)
    config.save(tmp_path / "again.toml")
    assert load(tmp_path / "again.toml") == config


def test_angles_are_written_in_degrees(read):
    text = read(EXAMPLE).to_toml()
    assert '"0.2 deg"' in text
    assert '"0.01 deg/h"' in text
    assert '"0.001 deg/sqrt(h)"' in text


# ------------------------------------------------------------------------------------------------- refusals

REFUSALS = [
    ('method = "wonder"', "method: 'wonder' is none of 'wander', 'geographic', 'north-then-wander'"),
    ('matching = "position"', "matching: 'position' is none of 'velocity', 'velocity+attitude'"),
    (
        'matching = "velocity+attitude"',
        'noise.attitude is missing: matching = "velocity+attitude" needs the master\'s attitude noise, for example attitude = "1',
    ),
    ("update_interval = 0.1", "update_interval: write it as a text with its unit, for example '0.1 s'; got 0.1"),
    ('update_interval = "0 s"', "update_interval: 0 is not above zero"),
    ('update_interval = "0.1 m"', "update_interval: '0.1 m' has m where s is needed (for example '0.1 s')"),
    ('lever_arm = "1 m"', "lever_arm: write a list of three texts, for x, y and z; got '1 m'"),
    ('lever_arm = ["1 m", "2 m"]', "lever_arm.2: is missing"),
    ('lever_arm = ["1 m", "2", "3 m"]', "lever_arm.1: '2' has no unit where m is needed (for example '1.5 m')"),
    ('lever_arm = ["1 km", "2 km", "3 km"]', "is longer than any vehicle; check its unit"),
    ("gate = 99.99", 'gate: write a probability below 1, for example 0.9999, or "off"; got 99.99'),
    ("gate = true", "gate: write a probability below 1"),
    ("gate = nan", "gate: write a probability below 1"),
    ('gate = "on"', "gate: write a probability below 1"),
    ('latency = "1 min"', "latency 60 s is no lateness of a log; check its unit"),
    ('states = "all"', "states: 'all' is none of 'short', 'full'"),
    ("coning = 5", "coning: 5 is none of 1, 2, 3, 4"),
    ('samples = "pulse"', "samples: 'pulse' is none of 'instant', 'mean'"),
    ('smooth = "perhaps"', "smooth: "),
    ('gravity = "9.81"', "gravity: '9.81' has no unit where m/s^2 is needed"),
    ('gravity = "32.2 m/s^2"', "gravity 32.2 m/s^2 is not found on Earth (9.76 to 9.84); check its unit"),
    ('laver_arm = "1 m"', "laver_arm: no such key"),
    ('[flexure]\nsigma = "1 arcmin"', "flexure.time: is missing"),
    ('[flexure]\nsigma = "1 arcmin"\ntime = "0 s"', "flexure.time: 0 is not above zero"),
    ("[trajectory]\nlatitude = 60", "trajectory.latitude: "),
    ('[trajectory]\nlatitude = "60 deg"', "trajectory.leg: is missing"),
    ("trajectory = 3", "trajectory: "),
    ("initial = 3", "initial: "),
]


@pytest.mark.parametrize(("written", "says"), REFUSALS, ids=[says[:40] for _, says in REFUSALS])
def test_what_is_refused_says_why(read, written, says):
    text = f"{LEAST}{written}\n" if written.startswith("[") else f"{written}\n{LEAST}"
    if written.startswith("initial"):
        text = f"{written}\n{LEAST[LEAST.index('[noise]') :]}"
    with pytest.raises(InputError) as caught:
        read(text)
    assert "config.toml: " in str(caught.value)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("key", "text", "says"),
    [
        ("misalignment", '"1"', "initial.misalignment.0: '1' has no unit where rad is needed (for example '0.2 deg')"),
        ("misalignment", '"0 deg"', "initial.misalignment is zero on all axes: then nothing is left to align"),
        ("misalignment", '"-1 deg"', "is negative; it is a size"),
        ("misalignment", '"200 deg"', "is more than 180 deg; check its unit"),
        ("velocity", '"1 m"', "initial.velocity: '1 m' has m where m/s is needed (for example '0.2 m/s')"),
        ("gyro_bias", '"1 deg/s^2"', "initial.gyro_bias.0: "),
        ("gyro_bias", '"0.01 Hz"', "initial.gyro_bias.0: "),
        ("accel_bias", '"50 g"', "initial.accel_bias.0: 490.332 is more than 1 g; check its unit"),
        ("gyro", '"0.001 deg/h"', "where rad/s/Hz^0.5 is needed (for example '0.001 deg/sqrt(h)')"),
        (
            "accel",
            '"10 ug"',
            "noise.accel: '10 ug' has ug where m/s^2/Hz^0.5 is needed (for example '0.833 ug/sqrt(Hz)')",
        ),
    ],
)
def test_quantities_of_the_wrong_kind(read, key, text, says):
    lines = [f"{key} = {text}" if line.startswith(f"{key} =") else line for line in LEAST.splitlines()]
    with pytest.raises(InputError) as caught:
        read("\n".join(lines))
    assert says in str(caught.value)


@pytest.mark.parametrize("key", ["misalignment", "velocity", "gyro_bias", "accel_bias", "gyro", "accel"])
def test_what_is_needed_is_asked_for(read, key):
    lines = [line for line in LEAST.splitlines() if not line.startswith(f"{key} =")]
    table = "noise" if key in ("gyro", "accel") else "initial"
    with pytest.raises(InputError, match=rf"{table}\.{key}: is missing"):
        read("\n".join(lines))


def test_velocity_noise_of_zero_is_refused(read):
    with pytest.raises(InputError, match="noise.velocity: 0 is not above zero"):
        read(LEAST.replace('"0.1 m/s"', '"0 m/s"'))


def test_all_faults_are_told_at_once(read):
    with pytest.raises(InputError) as caught:
        read(f'method = "x"\nupdate_interval = 1\n{LEAST}')
    assert "method: " in str(caught.value)
    assert "update_interval: " in str(caught.value)


@pytest.mark.parametrize("text", [b"\xff\xfe\x00", b"method = ", b"a = " + b"[" * 5000, b""])
def test_what_is_no_configuration(read, text):
    with pytest.raises(InputError):
        read(text)


values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(["1 m", "0.2 deg", "1 deg/h", "0.1 s", "1e400 s", "nan m", "1 g", "wander", "off", "full"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)
KEYS = [*Config.model_fields, "x"]
inside = st.dictionaries(
    st.sampled_from([*Initial.model_fields, *Noise.model_fields, "time", "sigma", "y"]), values, max_size=5
)


@given(st.dictionaries(st.sampled_from(KEYS), values | inside, max_size=5))
def test_whatever_the_table_holds_it_is_read_or_refused(table):
    base = tomllib.loads(LEAST)
    for given_table in (table, {**base, **table}):
        try:
            config = from_table(given_table)
        except SagnacError as error:
            assert str(error).startswith("configuration: ")  # noqa: PT017 - either is right
        else:
            assert from_table(tomllib.loads(config.to_toml())) == config


def test_the_module_reads_what_simulate_writes():
    from sagnac.simulate.scenario import load as scenario

    config = configs.from_table(scenario("transfer").config)
    assert config.trajectory.duration == 900
