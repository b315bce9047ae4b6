"""Slow noise on a centrifuge: means as in all methods, harmonics by their own covariance, intervals that hold the truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from centrifuge_case import ACCEL_Z, ACCELS, ALL, DENSITY, RATE, Z, changed, plan

from sagnac.calibrate import common
from sagnac.calibrate.centrifuge import calibrate_harmonics
from sagnac.calibrate.centrifuge.prepare import prepare
from sagnac.plan import Noise, Plan, Unit
from sagnac.sensors.series import basis
from sagnac.simulate.centrifuge import simulate_harmonics
from sagnac.simulate.noise import AxisNoise, NoiseModel

UG = 9.80665e-6
STEP = 0.05  # s
NINE = tuple(np.linspace(0.0, math.pi, 9).tolist())
KINDS = {"flicker": NoiseModel(instability=3 * UG, band=(STEP, 3e4)), "walk": NoiseModel(walk=0.5 * UG)}
"""Biases that wander eight times as far from segment to segment as white noise carries the mean."""


def stating(given: Plan, **noise) -> Plan:
    return given.model_copy(update={"unit": Unit(noise=Noise(accel=DENSITY["accel"], **noise))})


def drawn(given, truth=ACCEL_Z, axes=Z, *, seed=1, **keys):
    return simulate_harmonics(given, truth, axes=axes, density=DENSITY, rng=np.random.default_rng(seed), **keys)


def task_of(given, run):
    return prepare(run, given, None, None, None)[0]


def test_without_slow_terms_there_are_none():
    given = stating(plan())
    assert task_of(given, drawn(given)).slow is None


def test_means_have_it_as_in_all_methods_and_harmonics_their_spectrum():
    given = stating(plan(rates=(RATE, 0.0), hold=40.0), accel_instability=3 * UG, accel_walk=0.1 * UG)
    run = drawn(given)
    task = task_of(given, run)
    np.testing.assert_allclose(task.slow[:, 0, 0, 0], common.slow_variance(run, given, "accel")[:, 2], rtol=1e-9)
    f = RATE / (2 * math.pi)
    density = (3 * UG) ** 2 / (2 * math.pi * f) + 2.0 * (0.1 * UG / (2 * math.pi * f)) ** 2  # mean of cosine and sine
    first = (task.slow[:3, 0, 1, 1] + task.slow[:3, 0, 2, 2]) / 2
    np.testing.assert_allclose(first, 2 / 40.0 * density, rtol=0.05)
    assert not task.slow[3:, 0, 1:].any()


def test_each_axis_has_its_own():
    given = stating(plan(), accel_instability=(0.0, 3 * UG, 6 * UG))
    slow = task_of(given, drawn(given, ALL, ACCELS)).slow
    assert not slow[:, 0].any()
    np.testing.assert_allclose(slow[:, 2], 4 * slow[:, 1], rtol=1e-12)


def test_the_terms_with_tau_taken_out_leave_the_plain_ones_covariance():
    """Least squares without these terms, from the coefficients with them and from the start; on samples and on cells: 1e-5."""
    given = changed(stating(plan(arm_continuous=True), accel_instability=3 * UG, accel_walk=UG), arm_phase=None)
    task = task_of(given, drawn(given, extended=True))
    assert task.extended
    both = task.plain_slow()
    direct = task_of(stating(plan(), accel_instability=3 * UG, accel_walk=UG), drawn(plan())).slow
    assert both.shape == direct.shape
    np.testing.assert_allclose(both, direct, rtol=1e-4, atol=1e-4 * np.abs(direct[..., 1:, 1:]).max())


def test_the_closed_form_counts_it_too():
    quiet, loud = plan(), stating(plan(), accel_instability=3 * UG)
    few, many = (calibrate_harmonics(drawn(quiet), p, closed_form=True) for p in (stating(quiet), loud))
    assert many["accel.bias.z"].standard_uncertainty > few["accel.bias.z"].standard_uncertainty


def test_found_noise_is_named_and_slow_noise_with_it():
    given = plan((0.0, 0.7, 1.5, 2.2, 3.0)).model_copy(update={"unit": Unit(noise=Noise(accel_walk=1e-3 * UG))})
    level = calibrate_harmonics(drawn(given, ALL, ACCELS), given).noise["accel"]
    assert level.origin == "recording"
    assert level.density == pytest.approx((DENSITY["accel"],) * 3, rel=0.1)
    assert level.walk == pytest.approx((1e-3 * UG,) * 3)


# ------------------------------------------------------------------------------------------------------ statistics


def wandering(run, given, model, seed):
    """Coefficients of slow noise in every segment, and its means."""
    end = max(s.stop for s in given.segment)
    series = np.zeros(math.ceil(end / STEP) + 1)
    AxisNoise(model, STEP, seed, (0,)).add(series)
    time = (np.arange(series.size) + 0.5) * STEP
    out, means = [], []
    for i, s in enumerate(run.segments):
        at = (time >= s.start) & (time < s.stop)
        terms = basis(run.phase[i] + run.rate[i] * (time[at] - run.mid_time[i]), run.order)
        out.append(np.linalg.lstsq(terms, series[at], rcond=None)[0])
        means.append(series[at].mean())
    return np.array(out), float(np.mean(means))


def runs_of(kind, *, stated, runs):
    """Errors in standard uncertainties (runs, k), chi-square over freedom, and squared errors over their number where white."""
    model, rng = KINDS[kind], np.random.default_rng(5)
    own = {"accel_instability": model.instability, "accel_walk": model.walk} if stated else {}
    times, chi2, squares = [], [], []
    for seed in range(runs):
        given = stating(plan(tuple(rng.permutation(NINE).tolist()), hold=20.0), **own)
        run = simulate_harmonics(given, ACCEL_Z, axes=Z, density=DENSITY, rng=rng)
        slow, mean = wandering(run, given, model, seed)
        found = calibrate_harmonics(replace(run, coefficient=run.coefficient + slow[:, None]), given)
        # the bias that is found is that of the test
        truth = ACCEL_Z | {"accel.bias.z": ACCEL_Z["accel.bias.z"] + mean}
        error = np.array([p.value - truth[p.name] for p in found.parameters])
        times.append(error / [p.standard_uncertainty for p in found.parameters])
        chi2.append(found.fit.chi2 / found.fit.degrees_of_freedom)
        if found.fit.uncertainty == "white":
            squares.append(error @ np.linalg.solve(found.matrix, error) / error.size)
    return np.array(times), np.array(chi2), np.array(squares)


@pytest.mark.statistical
@pytest.mark.parametrize("kind", KINDS)
def test_intervals_hold_the_truth_with_slow_noise_stated(kind):
    """60 runs, settings in random order: coverage of 95 % intervals, chi-square, squared errors."""
    times, chi2, squares = runs_of(kind, stated=True, runs=60)
    assert 0.92 < np.mean(np.abs(times) < 1.96) < 0.985
    assert 0.9 < chi2.mean() < 1.1
    assert 0.7 < squares.mean() < 1.2


@pytest.mark.statistical
def test_as_white_noise_alone_the_same_noise_gives_far_more():
    _, chi2, squares = runs_of("flicker", stated=False, runs=10)
    assert chi2.min() > 5.0
    assert squares.size == 0
