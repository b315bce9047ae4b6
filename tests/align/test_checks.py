"""Logs with a mistake: each is found before or after the filter, and named; sound logs pass."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scene as scenes
from voyages import DEG, config, voyage

from sagnac.align.checks import differences, timing
from sagnac.align.checks.windows import apart, intervals, predicted, windows
from sagnac.align.transfer import examine
from sagnac.errors import DataError, InputError

ARCMIN = DEG / 60
SETTINGS = config()


def changed(y, **changes):
    return replace(y, **{name: change(getattr(y, name)) for name, change in changes.items()})


def columns(order, signs=(1, 1, 1)):
    return lambda v: v[:, order] * np.array(signs)


def angles(change):
    return lambda a: np.column_stack(change(*a.T))


def refusal(y, settings=SETTINGS, error=DataError) -> str:
    with pytest.raises(error) as caught:
        examine(y.slave, y.master, settings)
    return str(caught.value)


# ----------------------------------------------------------------------------------------- axes, signs and units

FRD = columns([1, 0, 2], [1, 1, -1])  # x forward, y right, z down
TURNED = columns([1, 0, 2], [1, -1, 1])  # x forward, y left, z up
SLAVE = [
    ({"accel": lambda v: -v}, "all", "the accelerometers have the other sign: at rest an upward axis must read +g"),
    ({"accel": columns([0, 1, 2], [1, 1, -1])}, "s-turn", "accel_z has the other sign"),
    ({"accel": columns([2, 1, 0])}, "all", "accel_z reads what accel_x should, accel_x reads what accel_z should"),
    ({"accel": columns([1, 0, 2])}, "s-turn", "accel_y reads what accel_x should, accel_x reads what accel_y should"),
    ({"accel": lambda v: v * 9.80665}, "all", "the samples look like m/s^2 but are labelled g"),
    ({"accel": lambda v: v / 9.80665}, "all", "the samples look like g but are labelled m/s^2"),
    ({"accel": lambda v: v / 1000}, "all", "the samples look like g but are labelled mg"),
    ({"gyro": lambda v: -v}, "all", "the gyros have the other sign: a turn to port must read plus about z"),
    ({"gyro": columns([0, 1, 2], [1, 1, -1])}, "all", "gyro_z has the other sign"),
    ({"gyro": columns([1, 0, 2])}, "all", "gyro_y reads what gyro_x should, gyro_x reads what gyro_y should"),
    ({"gyro": lambda v: v / DEG}, "all", "the samples look like deg/s but are labelled rad/s"),
    ({"gyro": lambda v: v * DEG}, "all", "the samples look like rad/s but are labelled deg/s"),
    ({"gyro": lambda v: v * 3600}, "all", "the samples look like deg/h but are labelled deg/s"),
    ({"gyro": FRD, "accel": FRD}, "all", "x points forward, y points right, z points down"),
    ({"gyro": TURNED, "accel": TURNED}, "swaying", "x points forward, y points left, z points up"),
    (
        {"gyro": lambda v: v / DEG, "accel": lambda v: v * 9.80665},
        "all",
        "the samples look like m/s^2 but are labelled g; and the samples look like deg/s but are labelled rad/s",
    ),
]


def each_way(cases):
    for changes, ways, says in cases:
        for way in ("straight", "swaying") if ways == "all" else ways.split():
            yield pytest.param(changes, way, says, id=f"{way}: {says[:45]}")


@pytest.mark.parametrize(("changes", "way", "says"), list(each_way(SLAVE)))
def test_a_slave_that_is_read_wrong(changes, way, says):
    said = refusal(changed(voyage(way), **changes))
    assert said.startswith("slave does not fit master, its ")
    assert says in said


MASTER = [
    (
        lambda h, p, r: (-h, p, r),
        "all",
        "its heading is counted counter-clockwise; it must grow when turning to starboard",
    ),
    (lambda h, p, r: (math.pi / 2 - h, p, r), "all", "its heading is counted from east, counter-clockwise"),
    (lambda h, p, r: (h + math.pi, p, r), "all", "its heading is 180 deg off"),
    (lambda h, p, r: (h - math.pi / 2, p, r), "s-turn", "its heading is counted from east, clockwise"),
    (lambda h, p, r: (h, -p, r), "swaying", "its pitch has the other sign; bow up is positive"),
    (lambda h, p, r: (h, p, -r), "swaying", "its roll has the other sign; starboard down is positive"),
    (lambda h, p, r: (h, r, p), "swaying", "its pitch and roll are exchanged"),
    (lambda h, p, r: (h * DEG, p * DEG, r * DEG), "all", "its angles look like radians but are labelled as degrees"),
]


@pytest.mark.parametrize(("change", "way", "says"), list(each_way(MASTER)))
def test_a_master_of_other_conventions(change, way, says):
    said = refusal(changed(voyage(way), angles=angles(change)))
    assert f"master: {says}" in said


@pytest.mark.parametrize("way", ["straight", "s-turn"])
def test_a_mounting_far_beyond_what_is_stated(way):
    said = refusal(voyage(way, mounting=(0.2, 0.2, 10.0)))
    assert "it seems to be turned against the master by 0.19" in said
    assert "9.9" in said
    assert "far more than initial.misalignment says" in said


def test_biases_far_beyond_what_is_stated():
    said = refusal(voyage("straight", gyro_bias=(1.0, 1.0, 1.0)))
    assert "it would fit with " in said
    assert "gyro_bias" in said
    assert "far more than [initial] says; write more there if the unit is like that" in said


def test_logs_of_different_runs():
    one, other = voyage("s-turn"), voyage("swaying")
    said = refusal(
        replace(one, stamps=other.stamps, place=other.place, velocity=other.velocity, angles=-3.1 * other.angles)
    )
    assert "no other axes, signs, units or conventions explain it: are the two logs of the same run?" in said


# -------------------------------------------------------------------------------------------- time and channels


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: t * 1000, "master (0 to 120000 s) and slave (0 to 120 s) do not overlap"),
        (lambda t: t * 1000, "check the unit of both time columns"),
        (lambda t: t + 1e6, "are they of the same run, on the same clock? If so, shift the clock of one of them"),
    ],
)
def test_logs_that_do_not_overlap(change, says):
    y = changed(voyage("straight"), stamps=lambda t: change(t + 1) - 1 if change(t[1]) > 1e4 else change(t))
    assert says in refusal(y, error=InputError)


def test_a_dead_channel():
    y = changed(voyage("straight"), gyro=lambda v: v * [1, 0, 1] + [0, 1e-3, 0])
    assert refusal(y) == "slave: gyro_y is the same in all samples while others change: a dead channel"


def test_a_master_without_attitude():
    y = voyage("straight")
    with pytest.raises(InputError, match=r"the columns heading \[deg\], pitch \[deg\] and roll \[deg\] are missing"):
        examine(y.slave, replace(y.master, attitude=None), SETTINGS)


@pytest.mark.parametrize("way", ["s-turn", "swaying"])
@pytest.mark.parametrize("late", [0.3, 0.05, -0.2])
def test_a_master_that_is_late_or_early(way, late):
    said = refusal(voyage(way, late=late))
    which = "late" if late > 0 else "early"
    found = float(said.partition(f"is {which} by ")[2].split()[0])
    assert found == pytest.approx(abs(late), abs=0.012)
    assert f'write latency = "{math.copysign(found, late):.3f} s", or have it estimated with initial.delay' in said


@pytest.mark.parametrize("changes", [{"latency": "0.3 s"}, {"initial__delay": "0.2 s"}])
def test_a_lateness_that_is_known_or_estimated(changes):
    y = voyage("swaying", late=0.3)
    assert examine(y.slave, y.master, config(**changes)) == ([], [], 0.0)


def test_a_lateness_far_beyond_the_delay_stated():
    assert 'far beyond initial.delay; write latency = "0.29' in refusal(
        voyage("swaying", late=0.3), config(initial__delay="1 ms")
    )


def test_a_small_lateness_is_spoken_of():
    y = voyage("s-turn", late=0.015)
    (said,), _, _ = examine(y.slave, y.master, SETTINGS)
    assert "master is late by 0.015 s" in said
    assert "which is not taken out" in said


def test_lateness_is_found_to_its_uncertainty():
    for seed in range(5):
        y = voyage("swaying", seed=seed, late=0.1, attitude_noise=1.0)
        found = timing.lateness(*apart_of(y))
        assert abs(found.value - 0.1) < 4 * found.sigma + 1e-3  # the rate is a mean over some samples of the slave
        assert found.sigma < 2e-3


def apart_of(y, settings=SETTINGS):
    given = intervals(y.slave, y.master, settings.latency)
    return given, apart(y.slave, given, y.master, settings)


# ------------------------------------------------------------------------------------------------------- jumps


def stepped(at, by, until=None):
    def change(values):
        out = values.copy()
        out[at:until] += by
        return out

    return change


@pytest.mark.parametrize("way", ["straight", "s-turn", "swaying"])
def test_a_velocity_that_jumps(way):
    said = refusal(changed(voyage(way), velocity=stepped(600, [0.5, 0, 0])))
    assert "master: its velocity jumps by 0.5" in said
    assert "at 60 s (row 601), where the slave feels nothing" in said
    assert "align on one side of it" in said


def test_single_samples_that_are_off_are_left_to_the_gate():
    y = changed(voyage("s-turn"), velocity=stepped(600, [1.0, 0, 0], 601))
    (said,), _, _ = examine(y.slave, y.master, SETTINGS)
    assert said == "master: velocity is off in single samples (1: 60 s)"


def test_an_attitude_that_jumps():
    y = changed(voyage("s-turn"), angles=stepped(600, [0, 0.01, 0]))
    (said,), _, _ = examine(y.slave, y.master, SETTINGS)
    assert "its attitude jumps by 0.57" in said
    assert "deg at 60 s (row 601), where the slave feels nothing" in said
    with pytest.raises(DataError, match=r"its attitude jumps by 0.57"):
        timing.check(y.slave, y.master, config(matching="velocity+attitude", noise__attitude="1 arcmin"))


# -------------------------------------------------------------------------------------------- noise, lever arm


@pytest.mark.parametrize("rate", [1.0, 10.0, 50.0])
@pytest.mark.parametrize("way", ["straight", "swaying", "aircraft"])
def test_noise_of_the_master_is_found(way, rate):
    y = voyage(way, rate=rate, velocity_noise=0.02, attitude_noise=2.0)
    noise = differences.noise_of(*apart_of(y), SETTINGS)
    tolerance = 4 / math.sqrt(len(y.stamps))  # a median of as many second differences
    assert noise.velocity == pytest.approx(0.02, rel=tolerance)
    assert noise.attitude == pytest.approx(2 * ARCMIN, rel=tolerance)


def test_a_master_noisier_than_stated():
    said = refusal(voyage("s-turn", velocity_noise=0.05))
    assert (
        "its velocity is as noisy as 0.05 m/s from sample to sample, where noise.velocity says 0.01 m/s: write noise.velocity"
        in said
    )
    y = voyage("s-turn", attitude_noise=10.0)
    with pytest.raises(DataError, match="its attitude is as noisy as 10 arcmin .* noise.attitude says 1 arcmin"):
        differences.check(y.slave, y.master, config(matching="velocity+attitude", noise__attitude="1 arcmin"))


def test_the_noise_of_the_first_attitude_is_told():
    y = voyage("s-turn", attitude_noise=1.0)
    (said,), doubts, noise = examine(y.slave, y.master, SETTINGS)
    assert doubts == []
    assert noise == pytest.approx(ARCMIN, rel=0.1)
    assert "the mounting is told against one sample of the master's attitude; its noise, 1 arcmin" in said
    matched = config(matching="velocity+attitude", noise__attitude="1 arcmin")
    assert examine(y.slave, y.master, matched) == ([], [], 0.0)


@pytest.mark.parametrize(("given", "words"), [(None, "(0, 0, 0 m)"), (["-0.5 m", "-2 m", "-1 m"], "(-0.5, -2, -1 m)")])
def test_a_lever_arm_that_is_not_what_is_stated(given, words):
    settings = config(lever_arm=given) if given else SETTINGS
    said = refusal(voyage("swaying", lever=(0.5, 2.0, 1.0)), settings)
    assert "slave seems to sit at x, y, z = 0.5" in said
    assert f"m from the master, not at lever_arm {words}: write lever_arm, or have it estimated" in said


@pytest.mark.parametrize("changes", [{"lever_arm": ["0.5 m", "2 m", "1 m"]}, {"initial__lever_arm": "2 m"}])
def test_a_lever_arm_that_is_known_or_estimated(changes):
    y = voyage("swaying", lever=(0.5, 2.0, 1.0))
    assert examine(y.slave, y.master, config(**changes)) == ([], [], 0.0)


@pytest.mark.parametrize("rate", [1.0, 10.0])
def test_lever_arms_are_found_to_their_uncertainty(rate):
    for seed in range(4):
        y = voyage("swaying", seed=seed, rate=rate, lever=(0.5, 2.0, 1.0), attitude_noise=1.0)
        found = differences.lever_arm(*apart_of(y), SETTINGS)
        assert np.all(np.abs(found.value - [0.5, 2.0, 1.0]) < 4 * found.sigma)
        assert np.all(found.sigma < 0.1)


# --------------------------------------------------------------------------------------------- what is compared


@pytest.mark.parametrize("way", ["straight", "swaying", "aircraft", "pole"])
@pytest.mark.parametrize("rate", [1.0, 10.0])
def test_an_ideal_slave_parts_from_its_master_by_nothing(way, rate):
    quiet = {"mounting": (0, 0, 0), "gyro_bias": (0, 0, 0), "accel_bias": (0, 0, 0), "velocity_noise": 0.0}
    y = voyage(way, rate=rate, **quiet)
    given, found = apart_of(y)
    # the sensors' own white noise; curved paths between samples 1 s apart add some mm/s
    assert np.abs(found.velocity).max() < (2e-4 if rate > 1 else 5e-3) + 5 * 8.2e-6
    assert np.abs(found.angle).max() < 6 * 2.9e-7 + 1e-6 / rate
    push, turn = predicted(y.master, given.number, SETTINGS)
    seen = windows(given, push, turn, 5.0)
    assert np.abs(seen.felt - seen.force).max() < 0.02 * np.abs(seen.felt).max()


def test_intervals_leave_gaps_out():
    y = voyage("straight")
    kept = (y.time <= 30.05) | (y.time >= 32.02)
    gappy = replace(y, time=y.time[kept], gyro=y.gyro[kept], accel=y.accel[kept])
    given = intervals(gappy.slave, y.master, 0.0)
    assert given.number.size == y.stamps.size - 1 - 21
    assert not np.any((given.start + given.steps > 30.06) & (given.start < 32.0))
    late = intervals(y.slave, y.master, 0.5)
    assert late.start[0] == pytest.approx(0.0)
    assert late.number[0] == 5


# ------------------------------------------------------------------------------------------ sound logs pass


@pytest.mark.parametrize("way", ["straight", "s-turn", "swaying", "parked", "aircraft", "pole"])
@pytest.mark.parametrize("rate", [1.0, 10.0])
@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_sound_logs_pass(way, rate, noise):
    rng = np.random.default_rng(len(way))
    y = voyage(
        way,
        seed=len(way),
        rate=rate,
        attitude_noise=noise,
        mounting=tuple(rng.normal(size=3) * [0.2, 0.2, 0.5]),
        gyro_bias=tuple(rng.normal(size=3) * 0.01),
        accel_bias=tuple(rng.normal(size=3) * 50),
    )
    remarks, doubts, told = examine(y.slave, y.master, SETTINGS)
    assert doubts == []
    assert len(remarks) == (noise > 0)
    assert (told > 0) == (noise > 0)


def test_a_large_mounting_that_is_stated_passes():
    y = voyage("s-turn", mounting=(10.0, -10.0, 30.0))
    assert examine(y.slave, y.master, config(initial__misalignment="20 deg")) == ([], [], 0.0)


def test_a_slave_of_low_grade_passes():
    rng = np.random.default_rng(3)
    y = voyage(
        "s-turn", mounting=(0.5, -1, 1.2), gyro_bias=(15, -20, 10), accel_bias=(2e3, -3e3, 1e3), velocity_noise=0.05
    )
    y = changed(
        y,
        gyro=lambda v: v + 0.2 * DEG / 60 / 0.1 * rng.standard_normal(v.shape),
        accel=lambda v: v + 100e-6 * 9.8 / 0.1 * rng.standard_normal(v.shape),
    )
    settings = config(
        initial__gyro_bias="20 deg/h",
        initial__accel_bias="3 mg",
        initial__misalignment="1 deg",
        noise__gyro="0.2 deg/sqrt(h)",
        noise__accel="100 ug/sqrt(Hz)",
        noise__velocity="0.05 m/s",
    )
    assert examine(y.slave, y.master, settings) == ([], [], 0.0)


@pytest.mark.parametrize("matching", ["velocity", "velocity+attitude"])
def test_a_late_master_that_is_to_be_estimated_does_not_jump(matching):
    # the heading rate steps by 6 deg/s: 0.15 s late, that is a step of 0.9 deg between the two attitudes
    more = scenes.BASE.replace("[initial]", '[initial]\ndelay = "0.2 s"')
    settings = scenes.config(scenes.S_TURN, more, matching=matching)
    world = scenes.scene(settings, seed=1, delay=0.15)
    remarks, doubts, _ = examine(world.slave, world.master, settings)
    assert not any("jump" in said for said in (*remarks, *doubts))
