"""Transfer alignment on true courses: the errors are those that the covariance says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scene import ARCMIN, BASE, S_TURN, config, deviations, legs, scene

from sagnac.align.run import transfer
from sagnac.align.samples import Feed, Slave
from sagnac.errors import DataError, InputError
from sagnac.frames import heading_pitch_roll

SHORT_TURN = legs((10, 3), (20, -3), (10, 3))
EASED = S_TURN.replace("turn_rate", 'ease = "2 s"\nturn_rate')
SWAY = '[trajectory.sway]\nroll = "5 deg"\nroll_period = "8 s"\npitch = "2 deg"\npitch_period = "6 s"\n'


def together(runs_and_truths):
    """Mean normalised square of the parameters' errors, each alone and all of them with their covariance."""
    single, whole, nis = [], [], []
    for run, truth in runs_and_truths:
        z = deviations(run, truth)
        at = [run.names.index(name) for name in z]
        error = np.array(list(z.values())) * run.sigmas[-1, at]
        single.append(list(z.values()))
        whole.append(error @ np.linalg.solve(run.covariance[np.ix_(at, at)], error) / len(at))
        nis.append(np.nanmean(run.nis) / len(run.innovation_names))
    return np.sqrt(np.mean(np.square(single), axis=0)), np.mean(whole), np.mean(nis)


def campaign(settings, count, seed=100, more=None, **how):
    out = []
    for k in range(count):
        world = scene(settings, seed=seed + k, **how)
        out.append((transfer(settings, world.slave, world.master), world.truth | (more or {})))
    return out


# Bands: the mean of 16 normalised squares of 8 or more numbers each is chi-square / (16 * 8) distributed, 0.1 % quantiles 0.64
# and 1.44; the
# root mean square of 16 single ones 0.49 and 1.58 (0.05 %, several of them looked at). NIS: 12 800 numbers, three and a half
# sigma.
NEES, SINGLE = (0.64, 1.44), (0.45, 1.65)


@pytest.mark.statistical
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"method": "geographic"},
        {"matching": "velocity+attitude"},
        {"states": "full"},
    ],
    ids=str,
)
def test_errors_are_what_the_covariance_says(changes):
    rms, nees, nis = together(campaign(config(SHORT_TURN, **changes), 16, rate=50.0))
    if changes.get("states") == "full":
        rms = rms[
            :-1
        ]  # the prior of 10 m in height, exact in the scene, is most of what the vertical accelerometer does not know
    assert SINGLE[0] < rms.min()
    assert rms.max() < SINGLE[1]
    assert NEES[0] < nees < NEES[1]
    assert nis == pytest.approx(1.0, abs=0.045)


@pytest.mark.statistical
def test_lever_arm_and_delay_are_estimated_as_well_as_they_say():
    more = BASE.replace(
        "[initial]", 'lever_arm = ["3 m", "-2 m", "1 m"]\n[initial]\nlever_arm = "1 m"\ndelay = "0.2 s"'
    )
    settings = config(SWAY + EASED, more, matching="velocity+attitude")
    lever, late = np.array([3.5, -2.6, 1.4]), 0.07
    runs = campaign(settings, 8, lever=lever, delay=late, more={"lever_arm": lever}, rate=50.0)
    rms, nees, nis = together(runs)
    assert rms.max() < 1.9  # 8 runs: 0.02 % of the root mean square of one number
    assert 0.5 < nees < 1.6
    assert nis == pytest.approx(1.0, abs=0.03)
    z = [(run.values[-1, -1] - late) / run.sigmas[-1, -1] for run, _ in runs]
    assert runs[0][0].names[-1] == "delay"
    assert 0.4 < np.sqrt(np.mean(np.square(z))) < 1.9
    assert runs[0][0].sigmas[-1, -1] < 3e-4


def cut(world, first):
    """The same master's log, begun later: in the middle of a turn."""
    keep = world.master.time >= first
    names = ("time", "latitude", "longitude", "height", "velocity", "attitude")
    return replace(world.master, **{k: getattr(world.master, k)[keep] for k in names})


@pytest.mark.statistical
@pytest.mark.parametrize("matching", ["velocity", "velocity+attitude"])
def test_a_late_master_that_starts_in_a_turn(matching):
    # the first attitude is late by 0.15 s * 3 deg/s = 27 arcmin: it is in the mounting unless the start knows of the delay
    more = BASE.replace("[initial]", '[initial]\ndelay = "0.2 s"')
    settings = config(EASED, more, matching=matching)
    out = []
    for k in range(6):
        world = scene(settings, seed=300 + k, delay=0.15, rate=50.0)
        run = transfer(settings, world.slave, cut(world, 5.0))
        out.append((run, world.truth))
        assert abs(run.values[-1, -1] - 0.15) < 4.5 * run.sigmas[-1, -1]
    rms, nees, nis = together(out)
    assert rms.max() < 2.0  # 6 runs: 0.03 %
    if matching == "velocity+attitude":
        assert 0.4 < nees < 1.8
    # With velocities alone the product of both angles, 27 arcmin times 12 arcmin or 0.1 arcmin, is left in how level and bias
    # go together: no parameter alone shows it (it is 1.5 sigma of the level), their normalised square does.
    assert nis == pytest.approx(1.0, abs=0.05)


@pytest.mark.statistical
def test_a_lever_arm_that_is_off_at_the_start():
    # the first velocity is that of a point 3 m away, in a turn with sway
    more = BASE.replace("[initial]", '[initial]\nlever_arm = "3 m"').replace(
        'velocity = "0.2 m/s"', 'velocity = "0.02 m/s"'
    )
    settings = config(SWAY + EASED, more)
    lever = np.array([2.5, -4.0, 1.0])
    out = []
    for k in range(6):
        world = scene(settings, seed=320 + k, lever=lever, rate=50.0)
        out.append((transfer(settings, world.slave, cut(world, 5.0)), world.truth | {"lever_arm": lever}))
    rms, nees, nis = together(out)
    assert rms.max() < 2.0
    assert 0.4 < nees < 1.8
    assert nis == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("states", ["short", "full"])
@pytest.mark.parametrize("method", ["wander", "geographic"])
def test_headings_at_85_degrees_with_a_long_lever_arm_and_a_log_that_is_off(method, states):
    # 250 m/s at 85 deg: north turns by 5e-5 rad over 30 m, and by 2e-4 over the 100 m that the log is off
    base = (
        BASE.replace('"60 deg"', '"85 deg"')
        .replace('"10 m/s"', '"250 m/s"')
        .replace("[initial]", 'lever_arm = ["30 m", "0 m", "0 m"]\n[initial]\nposition = "100 m"', 1)
    )
    settings = config(
        legs((60, 0), (40, 1, 'ease = "2 s"'), (60, 0, 'ease = "2 s"')), base, method=method, states=states
    )
    for seed in (1, 2):
        world = scene(settings, seed=seed, lever=(30.0, 0.0, 0.0), rate=50.0)
        radius = 6.37e6
        off = replace(
            world.master,
            latitude=world.master.latitude + 70 / radius,
            longitude=world.master.longitude + 70 / radius / np.cos(np.radians(85)),
        )
        run = transfer(settings, world.slave, off)
        heading = heading_pitch_roll(world.course.state(run.time[-1:]).C_b_n)[0][0]
        # the log's own north is turned against the true one by what its longitude is off, and a heading is told against it
        turned = 70 / radius * np.tan(np.radians(85))
        error = run.angles[-1, 0] - heading
        assert min(abs(error), abs(error - turned), abs(error + turned)) < 4 * run.angle_sigmas[-1, 0]
        assert max(map(abs, list(deviations(run, world.truth).values())[:3])) < 4.5


def test_the_three_methods_are_one_estimate():
    world = scene(config(SHORT_TURN), seed=5)
    runs = [
        transfer(config(SHORT_TURN, method=m, correction=c), world.slave, world.master)
        for m in ("wander", "geographic", "north-then-wander")
        for c in ("feedback", "output")
    ]
    for run in runs[1:]:
        for name in ("misalignment.x", "misalignment.y", "misalignment.z", "gyro.bias.x", "accel.bias.y"):
            a, b = runs[0].names.index(name), run.names.index(name)
            assert abs(run.values[-1, b] - runs[0].values[-1, a]) < 0.02 * runs[0].sigmas[-1, a]
            assert run.sigmas[-1, b] == pytest.approx(runs[0].sigmas[-1, a], rel=1e-3)
        assert run.angles[-1] == pytest.approx(runs[0].angles[-1], abs=2e-8)


def test_the_heading_error_is_not_phi_z_but_less_by_the_wander_error():
    # Huang et al. 2011: with output correction the slave's velocity error, and with it the error of its wander angle, grows
    # without bound; phi_z and the heading error part by it. 0.2 deg of level error: g t^2 / 2 tan L / R in 300 s is 1.4 arcmin
    # at 60 N.
    settings = config(legs((300, 0)), correction="output")
    world = scene(
        settings, seed=2, errors=(np.radians([0.2, -0.2, 0.5]), np.zeros(3), np.zeros(3)), noise=False, rate=20.0
    )
    wander = transfer(settings, world.slave, world.master)
    north = transfer(config(legs((300, 0)), method="geographic", correction="output"), world.slave, world.master)
    phi = wander.values[-1, wander.names.index("attitude_error.z")]
    dal = wander.values[-1, wander.names.index("wander_error")]
    heading = north.values[-1, north.names.index("attitude_error.z")]
    assert abs(dal) > 1.3 * ARCMIN
    assert phi - dal == pytest.approx(heading, abs=2e-3 * abs(dal))


def test_output_gives_the_errors_of_the_slave_as_it_navigates_alone():
    settings = config(SHORT_TURN, correction="output")
    world = scene(settings, seed=8)
    run = transfer(settings, world.slave, world.master)
    true = world.course.state(run.time[-1:])
    s = [run.names.index(n) for n in ("velocity_error.x", "velocity_error.y")]
    from sagnac.navigate.state import State
    from sagnac.navigate.strapdown import integrate

    start = State.at(
        world.master.latitude[0], world.master.longitude[0], 0.0, world.master.velocity[0], world.master.attitude[0]
    )
    n = np.searchsorted(world.slave.time, run.time[-1] + 1e-6) - 1
    part = [v[:n] for v in (world.slave.turns, world.slave.pushes, world.slave.steps)]
    alone = integrate(start, *part, every=10**9, heights=np.zeros(n))
    error = (alone.states.velocity_enu[-1] - true.velocity_enu[0])[:2]
    assert np.abs(error).max() > 0.5  # it is far off by then
    assert run.values[-1, s] == pytest.approx(error, abs=5 * run.sigmas[-1, s].max() + 1e-3)


def test_smoothing_gives_the_end_to_every_time():
    settings = config(SHORT_TURN, smooth=True)
    world = scene(settings, seed=4)
    run = transfer(settings, world.slave, world.master)
    plain = transfer(config(SHORT_TURN), world.slave, world.master)
    assert plain.smoothed is None
    mounting = [run.names.index(f"misalignment.{a}") for a in "xyz"]
    # nothing drives the mounting: smoothed it is the same from the first update on, each axis
    for k in (2, 10, 100):
        assert np.abs((run.smoothed[k] - run.values[-1])[mounting] / run.sigmas[-1, mounting]).max() < 0.25
    assert run.smoothed_sigmas[10, mounting] == pytest.approx(run.sigmas[-1, mounting], rel=0.1)
    # those of the mounting are of the rotation that is left, the filter's of the numbers told: 0.1 % apart at 0.5 deg
    assert np.all(run.smoothed_sigmas <= run.sigmas * (1 + 2e-3))
    i = [run.names.index(f"attitude_error.{a}") for a in "xyz"]
    assert np.all(run.smoothed_sigmas[20, i[:2]] < 0.3 * run.sigmas[20, i[:2]])


@pytest.mark.parametrize("azimuth", [30, 60])
def test_a_wide_prior_costs_nothing_once_the_start_is_right(azimuth):
    # the mounting is small, only nobody knew: the prior pulls towards zero with all of its 10, 10, 30 deg and is shouted down
    wide = BASE.replace('["0.2 deg", "0.2 deg", "0.5 deg"]', f'["10 deg", "10 deg", "{azimuth} deg"]')
    errors = np.radians([0.2, 0.2, 0.5]), np.zeros(3), np.zeros(3)
    world = scene(config(S_TURN), seed=11, errors=errors, rate=50.0)
    run = transfer(config(S_TURN, wide), world.slave, world.master, mounting=errors[0] + 1e-4)
    known = transfer(config(S_TURN), world.slave, world.master)
    assert run.used.mean() > 0.99
    names = [run.names.index(f"misalignment.{a}") for a in "xyz"]
    assert run.sigmas[-1, names] == pytest.approx(known.sigmas[-1, names], rel=0.02)
    assert np.abs(run.values[-1, names] - known.values[-1, names]).max() < 0.2 * known.sigmas[-1, names].max()


def test_mountings_of_tens_of_degrees_when_told_where_to_linearise():
    base = BASE.replace('["0.2 deg", "0.2 deg", "0.5 deg"]', '["20 deg", "20 deg", "40 deg"]')
    settings = config(S_TURN, base)
    mounting = np.radians([15.0, -12.0, 50.0])
    world = scene(settings, seed=6, errors=(mounting, np.zeros(3), np.zeros(3)), rate=50.0)
    near = mounting + np.radians([0.8, -0.6, 1.0])
    run = transfer(settings, world.slave, world.master, mounting=near)
    z = deviations(run, {"misalignment": mounting})
    assert max(map(abs, z.values())) < 4.0
    at = [run.names.index(n) for n in z]
    error = np.array(list(z.values())) * run.sigmas[-1, at]
    # all three with their covariance: of the rotation vector's numbers, not of a rotation of the slave's axes; 16.3 is 0.1 %
    assert error @ np.linalg.solve(run.covariance[np.ix_(at, at)], error) < 16.3
    assert run.sigmas[-1, at] == pytest.approx(np.sqrt(run.covariance[at, at]), rel=1e-9)
    assert run.sigmas[-1, run.names.index("misalignment.z")] < 0.4 * ARCMIN
    assert np.nanmean(run.nis) / 2 == pytest.approx(1.0, abs=0.1)
    heading = heading_pitch_roll(world.course.state(run.time[-1:]).C_b_n)[0]
    assert run.angles[-1, 0] == pytest.approx(heading[0], abs=5 * run.angle_sigmas[-1, 0])


# ------------------------------------------------------------------------------------------- gaps, late and wrong masters


def test_a_gap_of_the_master_is_no_more_than_a_wait():
    settings = config(S_TURN)
    world = scene(settings, seed=7)
    keep = (world.master.time < 20) | (world.master.time > 50)
    m = world.master
    holed = replace(
        m, **{k: getattr(m, k)[keep] for k in ("time", "latitude", "longitude", "height", "velocity", "attitude")}
    )
    run, whole = transfer(settings, world.slave, holed), transfer(settings, world.slave, m)
    inside = (run.time > 20.05) & (run.time < 49.95)
    assert not run.used[inside].any()
    assert np.all(np.isnan(run.nis[inside]))
    assert max(map(abs, deviations(run, world.truth).values())) < 4.0
    assert np.all(run.sigmas[-1] >= 0.999 * whole.sigmas[-1])
    i = run.names.index("velocity_error.x")
    assert run.sigmas[inside, i].max() > 3 * run.sigmas[~inside, i][-1]


def test_outliers_of_the_master_are_shut_out():
    settings = config(SHORT_TURN)
    world = scene(settings, seed=9)
    wrong = world.master.velocity.copy()
    wrong[[150, 151, 290]] += [1.0, -0.5, 0.0]
    run = transfer(settings, world.slave, replace(world.master, velocity=wrong))
    shut = run.time[~run.used]
    assert {15.0, 15.1, 29.0} <= set(np.round(shut, 6))
    assert shut.size < 6
    clean = transfer(settings, world.slave, world.master)
    assert np.abs(run.values[-1] - clean.values[-1]).max() < np.abs(clean.sigmas[-1]).max()
    assert max(map(abs, deviations(run, world.truth).values())) < 4.0


def test_a_short_gap_of_the_slave_is_bridged_with_doubt_and_a_long_one_refused():
    settings = config(S_TURN)
    world = scene(settings, seed=10)

    def holed(first, last):
        s = world.slave
        keep = np.ones(s.steps.size, dtype=bool)
        keep[first:last] = False  # the sample after the hole stands for all of it, at its own rate
        time = np.concatenate([s.time[:1], s.time[1:][keep]])
        steps = np.diff(time)
        scale = (steps / s.steps[keep])[:, None]
        return Slave(time, steps, s.turns[keep] * scale, s.pushes[keep] * scale)

    run = transfer(settings, holed(1490, 1520), world.master)  # 0.3 s, as the turn changes sides
    assert run.skipped[0][2].startswith("no samples")
    assert run.skipped[0][:2] == pytest.approx((14.9, 15.21), abs=0.011)
    assert max(map(abs, deviations(run, world.truth).values())) < 4.5
    i = run.names.index("attitude_error.z")
    k = np.searchsorted(run.time, 15.25)
    assert run.sigmas[k + 1, i] > np.radians(0.2)
    with pytest.raises(DataError, match=r"no samples from 40 s to 43\.01 s"):
        transfer(settings, holed(4000, 4300), world.master)


def test_logs_that_do_not_meet_are_refused():
    settings = config(SHORT_TURN)
    world = scene(settings, seed=1)
    with pytest.raises(InputError, match="0 samples of the master in common"):
        transfer(settings, world.slave, replace(world.master, time=world.master.time + 1e4))
    with pytest.raises(InputError, match="heading, pitch and roll are missing"):
        transfer(settings, world.slave, replace(world.master, attitude=None))


def test_a_feed_hands_out_every_increment_once():
    rng = np.random.default_rng(0)
    time = np.concatenate([[0.0], np.cumsum(rng.uniform(0.005, 0.015, 500))])
    slave = Slave(time, np.diff(time), rng.standard_normal((500, 3)), rng.standard_normal((500, 3)))
    start = 0.013
    feed, now, total = Feed(slave, start), start, np.zeros(3)
    stops = np.sort(rng.uniform(start, time[-1], 120))
    for stop in [*stops, time[-1]]:
        steps, turns, _, _ = feed.until(stop)
        assert steps.sum() == pytest.approx(stop - now, abs=1e-12)
        total += turns.sum(axis=0)
        now = stop
    first = np.searchsorted(time, start) - 1
    share = (time[first + 1] - start) / slave.steps[first]
    assert total == pytest.approx(share * slave.turns[first] + slave.turns[first + 1 :].sum(axis=0), abs=1e-10)
