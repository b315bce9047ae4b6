"""Monte Carlo of the whole chain: errors against the filter's covariance, published accuracies, refusals."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from sagnac.align import config as settings
from sagnac.align.covariance import covariance
from sagnac.align.monte_carlo import monte_carlo
from sagnac.errors import InputError

ARCMIN = math.pi / 10800.0
STRAIGHT = [{"duration": "900 s"}]
S_TURN = [
    {
        "repeat": 10,
        "legs": [
            {"duration": "15 s", "turn_rate": "3 deg/s"},
            {"duration": "30 s", "turn_rate": "-3 deg/s"},
            {"duration": "15 s", "turn_rate": "3 deg/s"},
        ],
    }
]


def configuration(method="wander", legs=STRAIGHT, **changes):
    """The published case; turning at 10 m/s."""
    table = {
        "method": method,
        "initial": {
            "misalignment": ["0.2 deg", "0.2 deg", "0.5 deg"],
            "velocity": "0.2 m/s",
            "gyro_bias": "0.01 deg/h",
            "accel_bias": "50 ug",
        },
        "noise": {"gyro": "0.001 deg/sqrt(h)", "accel": "0.833 ug/sqrt(Hz)", "velocity": "0.01 m/s"},
        "trajectory": {
            "latitude": "60 deg",
            "longitude": "108 deg",
            "height": "0 m",
            "speed": "19.44 kn" if legs is STRAIGHT else "10 m/s",
            "heading": "90 deg",
            "leg": legs,
        },
    }
    return settings.from_table(table | changes)


def inside(values, bands):
    return (values >= bands[:, 0]) & (values <= bands[:, 1])


def same(a, b):
    for name in ("mean", "rms", "sigma", "nees", "nis", "drift"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


# ------------------------------------------------------------------------------------------------ honest filters


@pytest.mark.statistical
@pytest.mark.parametrize("method", ["wander", "geographic"])
def test_straight_on_errors_are_what_the_filter_says(method):
    """3000 runs: an RMS error is known to 1.3 %, so that 5 % are almost four of its own standard deviations."""
    result = monte_carlo(configuration(method), runs=3000, seed=1, frequency=20.0, times=[10, 30, 60, 120, 300, 600])
    n = 11 if method == "wander" else 10
    assert len(result.names) == n
    np.testing.assert_allclose(result.ratio, 1.0, rtol=0, atol=0.05)
    # of six 95 % bands each one may fail by chance, more are a probability of 3 %
    assert inside(result.nees, result.nees_band).sum() >= 5
    assert inside(result.nis, result.nis_band).sum() >= 5
    np.testing.assert_allclose(result.nees, n, rtol=0.03)
    # no bias: 4 standard deviations of a mean
    assert np.abs(result.mean / result.sigma).max() < 4.0 / math.sqrt(3000)
    # the published standard deviations, methods of the literature and ours alike (arcmin)
    np.testing.assert_allclose(result.sigma[:, 4] / ARCMIN, [29.998, 29.479, 20.73, 7.02, 4.70, 4.49], rtol=0.01)
    np.testing.assert_allclose(result.rms[:, 4] / ARCMIN, [29.998, 29.479, 20.73, 7.02, 4.70, 4.49], rtol=0.05)
    np.testing.assert_allclose(result.rms[:, 2] / ARCMIN, [0.2105, 0.1743, 0.1737, 0.1722, 0.1717, 0.1717], rtol=0.05)
    assert result.drift.max() < 1.0  # what the eleven states take for nothing


@pytest.mark.statistical
@pytest.mark.parametrize("method", ["wander", "geographic"])
def test_turning_shows_the_azimuth(method):
    times = [10, 20, 30, 60, 120]
    result = monte_carlo(configuration(method, S_TURN), runs=4000, seed=2, frequency=50.0, times=times)
    np.testing.assert_allclose(result.ratio, 1.0, rtol=0, atol=0.05)
    assert inside(result.nees, result.nees_band).sum() >= 4
    assert inside(result.nis, result.nis_band).sum() >= 4
    # from an independent covariance analysis of this course
    np.testing.assert_allclose(result.rms[:, 4] / ARCMIN, [22.5, 2.48, 0.88, 0.48, 0.25], rtol=0.06)
    assert result.rms[-1, 4] < 0.3 * ARCMIN
    assert result.rms[-1, 2:4].max() < 0.03 * ARCMIN


@pytest.mark.statistical
def test_biases_that_walk_are_followed():
    noise = {"gyro": "0.001 deg/sqrt(h)", "accel": "0.833 ug/sqrt(Hz)", "velocity": "0.01 m/s"}
    walking = noise | {"gyro_walk": "0.2 deg/h/sqrt(h)", "accel_walk": "500 ug/sqrt(h)"}
    result = monte_carlo(configuration(legs=S_TURN, noise=walking), runs=2000, seed=3, frequency=20.0, times=[60, 120])
    assert inside(result.nees, result.nees_band).any()
    np.testing.assert_allclose(result.ratio, 1.0, rtol=0, atol=0.08)
    still = monte_carlo(configuration(legs=S_TURN), runs=100, seed=3, frequency=20.0, times=[60, 120])
    assert (result.rms[:, 5:10] > 1.2 * still.sigma[:, 5:10])[1].any()


@pytest.mark.statistical
def test_a_filter_that_is_told_wrong_shows_it():
    """Noise of the master twice what the filter takes it for, then gyro biases three times."""
    told = configuration()
    noisy = told.model_copy(update={"noise": told.noise.model_copy(update={"velocity": 0.02})})
    result = monte_carlo(told, drawn=noisy, runs=500, seed=4, frequency=10.0, times=[10.0, 30.0])
    np.testing.assert_allclose(result.nis, 8.0, rtol=0.02)
    assert (result.nees > result.nees_band[:, 1] + 5).all()
    assert (result.ratio[:, :2] > 1.5).all()
    first = told.initial.model_copy(update={"gyro_bias": (1.5e-7,) * 3})
    biased = monte_carlo(
        told, drawn=told.model_copy(update={"initial": first}), runs=500, seed=4, frequency=10.0, times=[30.0]
    )
    np.testing.assert_allclose(biased.ratio[0, 5:8], 1.5e-7 / 4.848e-8, rtol=0.15)


def test_sigmas_are_those_of_the_covariance_analysis():
    """Along the true course, with the readable kernels."""
    config = configuration(legs=S_TURN)
    run = covariance(config)
    result = monte_carlo(config, runs=32, seed=5, frequency=20.0, times=[10.0, 30.0, 60.0])
    for k, time in enumerate(result.time):
        expected = run.sigmas[round(time / 0.1) - 1, : len(result.names)]
        np.testing.assert_allclose(result.sigma[k], expected, rtol=0.03)


# ------------------------------------------------------------------------------------------------ the same again


def test_threads_and_the_number_of_runs_make_no_difference():
    config = configuration(legs=S_TURN)
    first = monte_carlo(config, runs=50, seed=7, frequency=20.0, times=[1, 3], threads=1, keep=True)
    for threads in (2, 5):
        same(monte_carlo(config, runs=50, seed=7, frequency=20.0, times=[1, 3], threads=threads), first)
    more = monte_carlo(config, runs=70, seed=7, frequency=20.0, times=[1, 3], keep=True)
    np.testing.assert_array_equal(more.errors[:, :50], first.errors)
    other = monte_carlo(config, runs=50, seed=8, frequency=20.0, times=[1, 3], keep=True)
    assert not (other.errors == first.errors).any()


def test_statistics_are_those_of_the_errors():
    result = monte_carlo(configuration(), runs=37, seed=9, frequency=10.0, times=[5], keep=True)
    assert result.errors.shape == (1, 37, 11)
    np.testing.assert_allclose(result.rms, np.sqrt((result.errors**2).mean(axis=1)), rtol=1e-12)
    np.testing.assert_allclose(result.mean, result.errors.mean(axis=1), rtol=1e-12)
    assert monte_carlo(configuration(), runs=2, frequency=10.0, times=[1]).errors is None


def test_what_is_known_exactly_does_not_count():
    """No gyro bias at all: eight states are left, and so is NEES."""
    config = configuration()
    exact = config.model_copy(update={"initial": config.initial.model_copy(update={"gyro_bias": (0.0,) * 3})})
    result = monte_carlo(exact, runs=400, seed=10, frequency=10.0, times=[20])
    np.testing.assert_array_equal(result.rms[0, 5:8], 0.0)
    np.testing.assert_allclose(result.nees_band.mean(), 8.0, atol=0.02)
    assert inside(result.nees, result.nees_band).all()


def test_times_are_updates_and_progress_is_told():
    told = []
    result = monte_carlo(configuration(), runs=2, frequency=10.0, times=[30.04, 2.0, 2.01], progress=told.append)
    np.testing.assert_allclose(result.time, [2.0, 30.0])
    assert told[-1] == 1.0
    assert told == sorted(told)
    short = configuration(legs=[{"duration": "7.35 s"}])
    np.testing.assert_allclose(monte_carlo(short, runs=2, frequency=10.0).time, [1, 2, 5, 7.3])


def test_the_summary_says_it_in_words():
    result = monte_carlo(configuration(), runs=20, seed=3, frequency=10.0, times=[10, 20])
    text = result.summary()
    assert text.startswith("20 runs, wander form, seed 3: RMS error / sigma of the filter\n")
    assert "azimuth [arcmin]" in text
    assert f"{result.rms[1, 4] / ARCMIN:.4g} / {result.sigma[1, 4] / ARCMIN:.4g}" in text
    assert "\n  wander_error " in text
    count = inside(result.nees, result.nees_band).sum()
    assert f"NEES is inside its band at {count} of 2 times; position error {result.drift[-1]:.2g} m" in text


# ------------------------------------------------------------------------------------------------ refusals


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"method": "north-then-wander"}, 'do not do method \'north-then-wander\': write "wander" or "geographic"'),
        ({"states": "full"}, "do not do states 'full': write states = \"short\""),
        ({"correction": "output"}, 'write correction = "feedback"'),
        ({"lever_arm": ["1 m", "0 m", "0 m"]}, "do not do a lever arm: leave it out"),
        ({"flexure": {"sigma": "1 arcmin", "time": "3 s"}}, "do not do flexure: leave it out"),
        ({"update_interval": "0.13 s"}, "update_interval 0.13 s is no whole number of samples at 10 Hz: change either"),
        ({"trajectory": None}, r"\[trajectory\] is missing: Monte Carlo runs need the course"),
    ],
)
def test_what_the_runs_do_not_do_is_refused(changes, message):
    config = configuration(**{k: v for k, v in changes.items() if v is not None})
    config = config.model_copy(update={k: None for k, v in changes.items() if v is None})
    with pytest.raises(InputError, match=message):
        monte_carlo(config, runs=2, frequency=10.0)


def test_numbers_that_do_not_go_together_are_refused():
    with pytest.raises(InputError, match="runs: 1; statistics need two runs or more"):
        monte_carlo(configuration(), runs=1)
    with pytest.raises(InputError, match="times: 1000 s; there are updates from 0.1 to 900 s on this course"):
        monte_carlo(configuration(), runs=2, times=[1000.0])
    with pytest.raises(InputError, match="times: 0 s"):
        monte_carlo(configuration(), runs=2, times=[0.0])
    with pytest.raises(InputError, match="times: none"):
        monte_carlo(configuration(), runs=2, times=[])
    with pytest.raises(InputError, match="no whole number of samples at nan Hz"):
        monte_carlo(configuration(), runs=2, frequency=math.nan)


def test_a_course_over_the_pole_is_refused():
    table = {
        "latitude": "89.99 deg",
        "longitude": "0 deg",
        "height": "0 m",
        "speed": "100 m/s",
        "heading": "0 deg",
        "path": "great-circle",
        "leg": [{"duration": "60 s"}],
    }
    with pytest.raises(InputError, match="within 638 m of a pole before"):
        monte_carlo(configuration(trajectory=table), runs=2, frequency=10.0)


def test_memory_does_not_grow_with_the_steps(tmp_path: Path):
    """Pieces of the common motion are all that is kept: the most that is held for 900 s is what it is for 90 s."""
    import tracemalloc

    most = []
    for time in (90.0, 900.0):
        monte_carlo(configuration(), runs=2, frequency=100.0, times=[time])
        tracemalloc.start()
        monte_carlo(configuration(), runs=2, frequency=100.0, times=[time])
        most.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert most[1] < 1.2 * most[0]
