"""The start from large mountings: finds them, says how well, is what a filter can begin from, says what is not seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from large_angles import DEG, LASER, MEMS, S_TURN, motion, mounting, run, settings, straight
from sagnac.align import large, model
from sagnac.align import run as linear
from sagnac.align.large import fit as large_fit
from sagnac.align.large import model as large_model
from sagnac.align.master import Master
from sagnac.align.samples import Slave, chosen
from sagnac.errors import DataError, InputError
from sagnac.frames import rotation_matrix, rotation_vector

WIDE = np.array([30.0, 30.0, 60.0]) * DEG
GIVEN = rotation_matrix(np.array([20.0, -30.0, 60.0]) * DEG)
ATTITUDE = {"matching": "velocity+attitude", "noise": {"attitude": 1.0 / 60.0 * DEG}}
WEAVE = {
    "repeat": 3,
    "legs": [{"duration": "5 s", "turn_rate": "4 deg/s"}, {"duration": "5 s", "turn_rate": "-4 deg/s"}],
}


@pytest.fixture(scope="module")
def s_turn():
    return motion(*S_TURN)


@pytest.fixture(scope="module")
def steady():
    return straight(200)


def off(found, truth):
    """Rotation left, in standard uncertainties: a chi-square with three degrees of freedom, and in rad."""
    left = rotation_vector(found.C_s_m.T @ truth)
    return float(left @ np.linalg.solve(found.covariance, left)), float(np.linalg.norm(left))


def exact(config):
    """The same settings for a unit and a master without noise or bias to speak of."""
    noise = config.noise.model_copy(update={"gyro": 1e-11, "accel": 1e-10, "velocity": 1e-8})
    initial = config.initial.model_copy(update={"gyro_bias": (1e-12,) * 3, "accel_bias": (1e-10,) * 3})
    return config.model_copy(update={"noise": noise, "initial": initial})


@pytest.mark.parametrize("angles", [(20, -30, 60), (0, 0, 179.9), (180, 0, 0), (90, 0, 0), (-45, 45, 90), (0.01, 0, 0)])
def test_without_noise_any_mounting_comes_out_exactly(s_turn, angles):
    truth = rotation_matrix(np.array(angles) * DEG)
    config = exact(settings(2.0 * WIDE))
    found = large.start(config, *run(s_turn, config, truth, np.random.default_rng(0))[:2], target=1e-7)
    assert found.converged
    assert found.close
    assert off(found, truth)[1] < 1e-6
    np.testing.assert_allclose(found.C_s_m @ found.C_s_m.T, np.eye(3), atol=1e-13)
    np.testing.assert_allclose(rotation_matrix(found.mounting), found.C_s_m, atol=1e-13)


@pytest.mark.parametrize("grade", [LASER, MEMS], ids=["laser", "mems"])
@pytest.mark.parametrize("more", [{}, ATTITUDE, {"states": "full"}], ids=["velocity", "attitude", "full"])
def test_s_turn_shows_it_within_seconds(s_turn, grade, more):
    config = settings(WIDE, grade, **more)
    found = large.start(config, *run(s_turn, config, GIVEN, np.random.default_rng(1))[:2])
    distance, angle = off(found, GIVEN)
    assert found.converged
    assert found.close
    assert not found.notes
    assert found.used <= 32.0
    assert angle < 1.5 * DEG
    assert distance < chi2.ppf(0.9999, 3)
    assert 0.8 < found.misfit < 1.2


@pytest.mark.parametrize("course", ["s_turn", "steady"])
def test_the_filter_ends_where_one_started_at_the_truth_ends(course, request):
    truth = request.getfixturevalue(course)
    config = settings(WIDE)
    slave, master, _ = run(truth, config, GIVEN, np.random.default_rng(2))
    found = large.start(config, slave, master)
    ends = [linear.transfer(config, slave, master, mounting=m) for m in (found.mounting, rotation_vector(GIVEN))]
    where = [ends[0].names.index(f"misalignment.{a}") for a in "xyz"]
    both = [rotation_matrix(end.values[-1, where]) for end in ends]
    left = rotation_vector(both[0].T @ both[1])
    covariance = ends[1].covariance[np.ix_(where, where)]
    # what is left is of second order in the error of the start, 0.3 deg
    assert left @ np.linalg.solve(covariance, left) < 0.2**2
    np.testing.assert_allclose(ends[0].sigmas[-1, where], ends[1].sigmas[-1, where], rtol=0.02)
    assert linear.transfer(config, slave, master).nis[-100:].mean() > 3.0 * ends[0].nis[-100:].mean()  # with no start


def test_straight_course_takes_longer_and_says_through_what_it_sees(steady):
    config = settings(WIDE)
    slave, master, _ = run(steady, config, GIVEN, np.random.default_rng(3))
    found = large.start(config, slave, master)
    assert found.close
    assert 32.0 < found.used <= 128.0
    assert off(found, GIVEN)[0] < chi2.ppf(0.9999, 3)
    short = large.start(config, slave, master, longest=20.0)
    assert short.converged
    assert not short.close
    assert short.used == pytest.approx(20.0, abs=0.11)
    (note,) = short.notes
    assert "azimuth" in note
    assert "only through the Earth's rotation" in note
    assert "nothing is seen" not in note


def test_an_azimuth_that_nothing_shows_is_named_and_not_made_up(steady):
    # gyro biases of 20 deg/h hide the Earth's 7.5 deg/h: noise must not pass for a manoeuvre
    config = settings(WIDE, MEMS)
    slave, master, _ = run(steady, config, GIVEN, np.random.default_rng(4))
    found = large.start(config, slave, master)
    assert found.converged
    assert not found.close
    assert found.used == pytest.approx(200.0)
    up = (master.attitude[0] @ found.C_s_m)[2]
    assert np.sqrt(up @ found.covariance @ up) > 40.0 * DEG
    true = (master.attitude[0] @ GIVEN)[2]
    assert np.arccos(up @ true) < 0.5 * DEG  # three times the accelerometers' 2 mg
    assert any("nothing is seen of it" in note for note in found.notes)


def test_a_manoeuvre_that_is_too_small_is_called_so():
    config = settings(WIDE)
    found = large.start(
        config,
        *run(motion({"duration": "8 s", "turn_rate": "1.2 deg/s"}), config, GIVEN, np.random.default_rng(5))[:2],
        target=0.05 * DEG,
    )
    assert any("the manoeuvre is too small" in note for note in found.notes)


def test_rates_show_the_mounting_at_once_where_attitudes_are_matched():
    truth = motion(
        {"duration": "8 s"}, sway={"roll": "3 deg", "roll_period": "6 s", "pitch": "2 deg", "pitch_period": "5 s"}
    )
    config = settings(WIDE, **ATTITUDE)
    slave, master, _ = run(truth, config, GIVEN, np.random.default_rng(6))
    found = large.start(config, slave, master)
    assert found.close
    assert found.used <= 4.1
    assert off(found, GIVEN)[0] < chi2.ppf(0.9999, 3)
    alone = large.start(settings(WIDE), slave, master)
    assert not alone.close  # velocities on a straight course show the level only


def test_lever_arm():
    arm = (3.0, -5.0, 2.0)
    truth = motion(WEAVE, lever=arm, ease="2 s")
    config = settings(WIDE, lever_arm=arm)
    slave, master, _ = run(truth, config, GIVEN, np.random.default_rng(7))
    found = large.start(config, slave, master)
    assert found.close
    assert found.misfit < 1.2
    assert off(found, GIVEN)[0] < chi2.ppf(0.9999, 3)
    forgotten = large.start(settings(WIDE), slave, master, target=0.1 * DEG)
    assert forgotten.misfit > 1.5
    assert any("lever arm" in note for note in forgotten.notes)
    wide = settings(WIDE, initial={"lever_arm": (5.0, 5.0, 5.0)})
    unsure = large.start(wide, slave, master)
    assert unsure.close
    assert unsure.misfit < 1.2
    assert off(unsure, GIVEN)[0] < chi2.ppf(0.9999, 3)


@pytest.mark.parametrize("more", [{}, ATTITUDE], ids=["velocity", "attitude"])
def test_unknown_delay_of_the_master(s_turn, more):
    config = settings(WIDE, initial={"delay": 0.1}, **more)
    slave, master, _ = run(s_turn, config, GIVEN, np.random.default_rng(8))
    late = replace(master, time=master.time + 0.08)
    found = large.start(config, slave, late, target=0.1 * DEG)
    assert found.misfit < 1.2
    # velocities alone tell the slave's attitude: against what the master says of its own, 0.08 s of 3 deg/s too early
    truth = GIVEN if more else rotation_matrix([0.0, 0.0, -0.24 * DEG]) @ GIVEN
    assert off(found, truth)[0] < chi2.ppf(0.9999, 3)
    problem = large_model.prepare(config, slave, late, np.arange(300))
    assert large.minima(problem)[0].point.delay == pytest.approx(0.08, abs=0.005)
    assert off(large.start(settings(WIDE, **more), slave, late, target=0.1 * DEG), truth)[0] > 100.0


def test_flexure_makes_attitudes_less_sure(s_turn):
    config = settings(WIDE, **ATTITUDE)
    slave, master, _ = run(s_turn, config, GIVEN, np.random.default_rng(8))
    bent = settings(WIDE, flexure={"sigma": (1e-3, 2e-3, 1e-3), "time": 5.0}, **ATTITUDE)
    found, plain = (large_model.prepare(c, slave, master, np.arange(100)).noise for c in (bent, config))
    np.testing.assert_allclose(found - plain, [0.0, 0.0, 0.0, 4e-6], rtol=1e-12)


@pytest.mark.parametrize("rate", [1.0, 7.0, 50.0])
def test_masters_of_other_rates_and_times_between_the_slaves_samples(rate):
    truth = motion(*S_TURN, rate=rate, start=0.0337)
    config = settings(WIDE, latency=0.2)
    slave, master, _ = run(truth, config, GIVEN, np.random.default_rng(9))
    late = replace(master, time=master.time + 0.2)
    found = large.start(config, slave, late)
    assert found.close
    assert 0.8 < found.misfit < 1.25
    assert off(found, GIVEN)[0] < chi2.ppf(0.9999, 3)
    intervals = np.diff(large_model.prepare(config, slave, late, chosen(config, slave, late, 10.0)).time)
    assert intervals.min() > 0.99 * max(0.1, 1.0 / rate) - 0.5 / rate


def test_gaps_of_the_slave(s_turn):
    config = settings(WIDE)
    slave, master, _ = run(s_turn, config, GIVEN, np.random.default_rng(10))

    def without(first, last):
        """Samples from `first` to `last` merged into one, as where they are missing: what they counted is guessed."""
        rate, force = (v[first - 1] / slave.steps[first - 1] for v in (slave.turns, slave.pushes))
        span = slave.time[last] - slave.time[first]
        parts = [
            np.concatenate([v[:first], np.atleast_1d(middle) if v.ndim == 1 else middle[None], v[last:]])
            for v, middle in ((slave.steps, span), (slave.turns, rate * span), (slave.pushes, force * span))
        ]
        return Slave(np.concatenate([slave.time[: first + 1], slave.time[last:]]), *parts)

    short = large.start(config, without(500, 530), master)
    assert short.close
    assert off(short, GIVEN)[0] < chi2.ppf(0.9999, 3)
    with pytest.raises(DataError, match="no samples from 5 s to 8 s"):
        large.start(config, without(500, 800), master)
    assert large.start(config, without(4000, 4500), master).close  # after what is needed


@pytest.mark.parametrize("wrong", ["gyro", "gravity", "scale"])
def test_wrong_signs_and_units_are_no_mounting(s_turn, wrong):
    config = settings(WIDE)
    slave, master, _ = run(s_turn, config, GIVEN, np.random.default_rng(11))
    slave = {
        "gyro": replace(slave, turns=-slave.turns),
        "gravity": replace(slave, pushes=-slave.pushes * [1.0, 1.0, -1.0]),
        "scale": replace(slave, pushes=slave.pushes / 9.80665),
    }[wrong]
    found = large.start(config, slave, master)
    assert not found.converged
    assert any("times what the stated noise allows" in note for note in found.notes)


def test_what_cannot_be_started():
    truth, config = straight(10), settings(WIDE)
    slave, master, _ = run(truth, config, GIVEN, np.random.default_rng(12))
    with pytest.raises(InputError, match="heading, pitch and roll are missing"):
        large.start(config, slave, replace(master, attitude=None))
    with pytest.raises(InputError, match="have 0 samples of the master in common"):
        large.start(config, slave, replace(master, time=master.time + 1000.0))
    few = Master(
        *(
            v[:3]
            for v in (master.time, master.latitude, master.longitude, master.height, master.velocity, master.attitude)
        )
    )
    found = large.start(config, slave, few)  # two readings: nothing but the level, roughly
    assert not found.close
    assert found.notes


def prior_of_mounting(sigma, vector, lever=(0.0, 0.0, 0.0)):
    """Mean and covariance that a filter starts with when it is linearised about a mounting."""
    states = model.layout("wander")
    now = model.Instant(np.eye(3), np.ones(3), np.zeros(3), np.array([0.1, -0.2, 0.3]), vector, np.array(lever))
    mean, covariance = model.prior(settings(sigma), states, now, 0.0)
    where, H = states.block("mounting"), model.measurement(states, now, True)
    # the start is a measurement without a difference; what it does not tie is the first velocity, stated apart
    np.testing.assert_allclose(H @ mean, 0.0, atol=1e-13)
    tied = H @ covariance @ H.T - np.diag([0.2**2] * 2 + [0.0] * 3)
    np.testing.assert_allclose(tied, 0.0, atol=1e-13)
    return mean[where], covariance[where, where]


def test_the_prior_around_another_point():
    # what the filter gets must be, to first order, the prior that the batch has
    rng = np.random.default_rng(13)
    sigma = np.array([0.5, 0.4, 1.0])
    vector = np.array([0.3, -0.5, 1.0])
    C_s_m = rotation_matrix(vector)
    mean, covariance = prior_of_mounting(sigma, vector)
    np.testing.assert_allclose(mean, -vector, atol=1e-14)
    h = 1e-6
    slope = np.stack(
        [
            (rotation_vector(C_s_m @ rotation_matrix(h * e)) - rotation_vector(C_s_m @ rotation_matrix(-h * e)))
            / (2 * h)
            for e in np.eye(3)
        ],
        axis=1,
    )
    np.testing.assert_allclose(slope @ covariance @ slope.T, np.diag(sigma**2), atol=1e-8)
    for _ in range(5):
        xi = 1e-4 * rng.standard_normal(3)
        cost = np.sum((rotation_vector(C_s_m @ rotation_matrix(xi)) / sigma) ** 2)
        assert (xi - mean) @ np.linalg.solve(covariance, xi - mean) == pytest.approx(cost, rel=1e-7)
    mean, covariance = prior_of_mounting(sigma, np.zeros(3))
    np.testing.assert_allclose(mean, 0.0)
    np.testing.assert_allclose(covariance, np.diag(sigma**2))
    prior_of_mounting(sigma, vector, lever=(3.0, -2.0, 1.0))


def test_start_values_agree(s_turn):
    # the left-invariant filter and the closed form come from opposite sides; both are within the reach of one step
    config = settings(WIDE)
    slave, master, _ = run(s_turn, config, GIVEN, np.random.default_rng(14))
    problem = large_model.prepare(config, slave, master, np.arange(300))
    points = [large_fit.by_filter(problem), large_fit.by_vectors(problem)]
    for point in points:
        assert np.linalg.norm(rotation_vector(GIVEN.T @ point.mounting)) < 0.3 * DEG
        np.testing.assert_allclose(problem.master @ point.mounting, point.attitude, atol=1e-12)
    fits = [large_fit.descend(problem, point) for point in points]
    assert all(fit.settled and fit.steps <= 4 for fit in fits)
    step = rotation_vector(fits[0].point.mounting.T @ fits[1].point.mounting)
    assert step @ np.linalg.solve(fits[0].covariance, step) < 0.02**2
    assert len(large.minima(problem)) == 1


@pytest.mark.parametrize("more", [{}, ATTITUDE], ids=["velocity", "attitude"])
def test_slope_of_the_posterior_is_that_of_its_cost(s_turn, more):
    config = settings(WIDE, LASER, states="full", **more)
    slave, master, _ = run(s_turn, config, GIVEN, np.random.default_rng(15))
    problem = large_model.prepare(config, slave, master, np.arange(60))
    problem = replace(problem, gathered=0.0 * problem.gathered)  # without noise of the sensors it is exact
    fit = large_fit.descend(problem, large_fit.by_vectors(problem))
    sigma = 1.0 / np.sqrt(np.diag(fit.normal))
    point = large_fit._moved(problem, fit.point, 3.0 * sigma * np.random.default_rng(16).standard_normal(sigma.size))
    state = large_fit._evaluate(problem, point)
    for i, s in enumerate(sigma):
        step = 0.01 * s * np.eye(sigma.size)[i]
        ends = [large_fit._evaluate(problem, large_fit._moved(problem, point, sign * step)).cost for sign in (1, -1)]
        assert (ends[1] - ends[0]) / 0.04 == pytest.approx(state.slope[i] * s, rel=1e-4, abs=1e-3)


def test_a_rival_is_named():
    # two minima by hand: the second one holds a tenth of the posterior
    config = settings(WIDE)
    slave, master, _ = run(straight(10), config, np.eye(3), np.random.default_rng(17))
    problem = large_model.prepare(config, slave, master, np.arange(50))
    fit = large_fit.descend(problem, large_fit.by_vectors(problem))
    sure = replace(fit, covariance=1e-6 * np.eye(3), cost=float(problem.count))
    turned = fit.point._replace(mounting=fit.point.mounting @ rotation_matrix([0.0, 0.0, 2.0]))
    rival = replace(sure, point=turned, cost=sure.cost + 2.0 * np.log(9.0))
    fits = large._different([rival, sure, sure])
    assert fits == [sure, rival]
    np.testing.assert_allclose(large._shares(fits), [0.9, 0.1])
    assert not large._sound(problem, fits)
    assert large._sound(problem, fits[:1])
    notes = large._notes(problem, fits, large.TARGET, master.velocity)
    assert any("another mounting" in note and "115 deg away" in note and "its share is 10 %" in note for note in notes)
    assert not large._sound(problem, [replace(sure, settled=False)])
    assert any(
        "had not settled" in note
        for note in large._notes(problem, [replace(sure, settled=False)], 1.0, master.velocity)
    )


# ------------------------------------------------------------------------------------------------------- statistical


def squares(truth, config, count, seed):
    """Squared errors in standard uncertainties of many starts from mountings up to 45 deg in level and 90 deg in azimuth."""
    rng, out = np.random.default_rng(seed), []
    for _ in range(count):
        C_s_m = mounting(rng, rng.uniform(0.0, 45.0) * DEG, rng.uniform(0.0, 90.0) * DEG)
        found = large.start(config, *run(truth, config, C_s_m, rng)[:2])
        assert found.converged
        out.append(off(found, C_s_m)[0])
    return np.array(out)


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("grade", "more"), [(LASER, {}), (MEMS, {}), (LASER, ATTITUDE)], ids=["laser", "mems", "attitude"]
)
def test_errors_match_the_covariance(s_turn, grade, more):
    count = 120
    found = squares(s_turn, settings(WIDE, grade, **more), count, 20)
    low, high = chi2.ppf([0.0005, 0.9995], 3 * count) / count
    assert low < found.mean() < high
    assert found.max() < chi2.ppf(1.0 - 1e-3 / count, 3)


@pytest.mark.statistical
def test_errors_match_the_covariance_on_a_straight_course():
    count = 40
    found = squares(straight(130), settings(WIDE), count, 21)
    low, high = chi2.ppf([0.0005, 0.9995], 3 * count) / count
    assert low < found.mean() < high
    assert found.max() < chi2.ppf(1.0 - 1e-3 / count, 3)


@pytest.mark.statistical
def test_mountings_drawn_from_the_prior_where_the_azimuth_is_not_seen():
    # nothing shows the azimuth: its errors are those of the prior, and they must not be said to be smaller. The posterior is no
    # Gaussian one, so that only the size is asserted: the mean square in units of what is stated, 1 for an honest one
    rng, config, truth, azimuth = np.random.default_rng(22), settings(WIDE, MEMS), straight(120), []
    for _ in range(20):
        C_s_m = rotation_matrix(WIDE * [0.3, 0.3, 1.0] * rng.standard_normal(3))
        slave, master, _ = run(truth, config, C_s_m, rng)
        found = large.start(config, slave, master)
        up = (master.attitude[0] @ found.C_s_m)[2]
        azimuth.append(up @ rotation_vector(found.C_s_m.T @ C_s_m) / np.sqrt(up @ found.covariance @ up))
    assert np.mean(np.square(azimuth)) < 2.5
    assert np.max(np.abs(azimuth)) < 4.0
