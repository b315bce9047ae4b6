"""Disturbances: each is found at a stated size, and none in clean noise."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.noise.findings import disturbances as clues
from sagnac.noise.findings import levels
from sagnac.noise.findings.blocks import Ledger
from sagnac.simulate.noise import AxisNoise, NoiseModel

DT = 0.01
N = 120_000
AXES = ("gyro_x", "gyro_y", "gyro_z")


def noise(model: NoiseModel, seed: int, axes: int = 3, samples: int = N) -> np.ndarray:
    out = np.zeros((samples, axes))
    for k in range(axes):
        column = np.zeros(samples)
        AxisNoise(model, DT, seed, (k,)).add(column)
        out[:, k] = column
    return out


WHITE = NoiseModel(density=1.0)
SLOW = NoiseModel(density=1.0, instability=0.3, band=(1.0, 3000.0), walk=0.02)


def blocks_of(values, warmth=None):
    ledger = Ledger(values.shape[1], DT)
    ledger.add(DT * np.arange(len(values)), values, warmth)
    return ledger.blocks()


def seen(values, pulses=(False, False, False)):
    b = blocks_of(values)
    axes = AXES[: values.shape[1]]
    return clues.find(b, axes, pulses, ["unit"] * len(axes), [1.0] * len(axes))


def kinds(found, axis="gyro_y"):
    return {d.kind for d in found if d.axis == axis}


@pytest.mark.parametrize("model", [WHITE, SLOW], ids=["white", "slow"])
def test_nothing_is_found_in_clean_noise(model):
    assert seen(noise(model, 1)) == []


def test_a_dead_axis():
    values = noise(SLOW, 2)
    values[:, 1] = 3.0
    assert kinds(seen(values)) == {"dead"}


def test_an_axis_whose_channel_stops():
    values = noise(SLOW, 3)
    values[60_000:60_050, 1] = values[60_000, 1]
    found = seen(values)
    stuck = next(d for d in found if d.kind == "stuck")
    assert stuck.axis == "gyro_y"
    assert stuck.spoils
    assert stuck.start == pytest.approx(600.0, abs=0.02)
    assert "50 samples" in stuck.text


def test_a_channel_that_stops_many_times():
    values = noise(WHITE, 3)
    values[:, 1] = np.round(4.0 * values[:, 1])  # of four steps: one sample in fourteen equals the one before
    for i in range(60):
        start = 1000 + 1900 * i
        values[start : start + 40 + i, 1] = values[start, 1]
    assert "stuck" in kinds(seen(values))


@pytest.mark.parametrize("seed", range(4))
def test_a_unit_that_is_calm_at_times_is_not_stuck(seed):
    """Pulses of a parked vehicle: between gusts some tens of samples are zero, far more than their share would make likely."""
    rng = np.random.default_rng(seed)
    loud = np.exp(noise(NoiseModel(markov=((2.0, 0.2),)), seed, axes=1))
    values = np.round(3.0 * loud * rng.standard_normal((N, 1)))
    b = blocks_of(values)
    assert b.run[0] > 40
    assert b.equal[0] < 0.3
    assert not {d.kind for d in clues.samples_at_fault(b, AXES[:1], (False,))} & {"stuck"}


def test_a_saturated_axis():
    values = noise(WHITE, 4)
    values[:, 1] = np.clip(values[:, 1], None, np.quantile(values[:, 1], 0.99))
    assert kinds(seen(values)) == {"saturated"}


def test_rounding_coarser_than_the_noise():
    values = noise(WHITE, 5)  # 10 rms a sample
    values[:, 1] = np.round(values[:, 1] / 40.0) * 40.0
    assert kinds(seen(values)) == {"rounded"}


@pytest.mark.parametrize("rms", [0.25, 0.35, 0.5])
@pytest.mark.parametrize("middle", [0.0, 0.25, 0.5])
def test_rounding_is_refused_wherever_the_mean_lies_among_the_steps(rms, middle):
    values = noise(WHITE, 5)
    values[:, 1] = np.round(values[:, 1] / 10.0 * rms + middle)
    assert kinds(seen(values)) == {"rounded"}
    assert any(d.spoils for d in seen(values) if d.axis == "gyro_y")


def test_rounding_that_the_noise_dithers_is_told_and_pulses_carry_theirs_on():
    values = noise(WHITE, 6)
    values[:, 1] = np.round(values[:, 1] / 15.0) * 15.0
    found = seen(values)
    assert kinds(found) == {"rounded"}
    assert not found[0].spoils
    assert found[0].text.startswith("16%") or found[0].text.startswith("17%")  # 15^2 / 12 of 10^2 + 15^2 / 12
    values[:, 1] = np.round(noise(WHITE, 6)[:, 1] / 5.0) * 5.0  # 2 %
    assert seen(values) == []
    total = np.cumsum(values * 0.02 + 0.3, axis=0)
    pulses = np.diff(np.floor(total), axis=0, prepend=0.0)
    assert seen(pulses, pulses=(True, True, True)) == []


def test_samples_that_are_repeated():
    values = noise(WHITE, 7)
    values[1::2] = values[::2]
    found = seen(values)
    assert kinds(found) == {"repeated"}
    assert "2 times" in found[0].text
    assert not found[0].spoils


def test_motion_is_found_and_the_undisturbed_stretch_offered():
    values = noise(SLOW, 8)
    t = DT * np.arange(N)
    moving = (t > 300.0) & (t < 320.0)
    values[moving, 1] += 200.0 * np.sin(2 * np.pi * t[moving] * 1.3)
    found = seen(values)
    moved = next(d for d in found if d.kind == "motion" and d.axis == "gyro_y")
    assert moved.spoils
    assert moved.start == pytest.approx(300.0, abs=1.0)
    assert moved.stop == pytest.approx(320.0, abs=1.0)
    words = clues.advice(blocks_of(values), found)
    assert words.startswith("undisturbed for longest (8")
    assert "--from '32" in words
    assert "--to" not in words


def test_a_knock_too_short_to_matter_is_told_and_refuses_nothing():
    values = noise(WHITE, 9)
    values[70_000:70_020, 1] += 60.0
    found = [d for d in seen(values) if d.axis == "gyro_y"]
    assert found
    assert not any(d.spoils for d in found)


def test_noise_that_is_never_steady():
    values = noise(WHITE, 10)
    loudness = np.exp(0.7 * np.sin(2 * np.pi * DT * np.arange(N) / 180.0))
    values[:, 1] *= loudness
    assert kinds(seen(values)) == {"restless"}


def test_a_step_is_found_at_its_time_with_its_size():
    # means over 1/32 of the log differ by sqrt(2) N / sqrt(T / 32) in white noise; ten times that is found
    values = noise(WHITE, 11)
    size = 10.0 * np.sqrt(2.0 / (N * DT / 32.0))
    values[72_000:, 1] += size
    found = seen(values)
    step = next(d for d in found if d.kind == "step")
    assert [d.axis for d in found] == ["gyro_y"]
    assert step.spoils
    assert step.start == pytest.approx(720.0, abs=12.0)
    assert step.size == pytest.approx(size, rel=0.25)


def test_a_step_in_slow_noise_has_to_be_larger():
    values = noise(SLOW, 12)
    values[72_000:, 1] += 4.0
    assert kinds(seen(values)) == {"step"}
    random_walk = np.cumsum(np.random.default_rng(1).normal(size=(N, 3)), axis=0)
    assert seen(random_walk) == []


def test_a_push_that_comes_back_is_a_shock():
    values = noise(WHITE, 13)
    values[72_000:72_800, 1] += 8.0
    shock = next(d for d in seen(values) if d.axis == "gyro_y")
    assert shock.kind == "shock"
    assert "comes back" in shock.text


def test_rates_from_an_angle_that_was_logged_are_not_saturated():
    # the steps of the rates are those of the angle over the interval, but for rounding errors of some 1e-12
    step = 1e-5
    angle = 1e-3 + np.cumsum(noise(WHITE, 21) * 1e-3 * DT, axis=0)
    values = np.diff(step * np.floor(angle / step), axis=0) / DT
    b = blocks_of(values)
    assert b.finest == pytest.approx(step / DT, rel=1e-6)
    assert not kinds(seen(values), "gyro_x") & {"saturated", "stuck"}


@pytest.mark.parametrize("seed", range(8))
def test_what_noise_did_during_a_gap_is_no_step(seed):
    walk = NoiseModel(density=0.6, walk=0.0083)  # N 0.01 deg/sqrt(h), K 0.5 deg/h/sqrt(h), per sample of 10 Hz
    values = noise(walk, 100 + seed, axes=1, samples=432_000)
    t = DT * np.arange(432_000)
    kept = (t < 1440.0) | (t > 2880.0)
    ledger = Ledger(1, DT)
    ledger.add(t[kept], values[kept], None)
    b = ledger.blocks()
    found = clues.find(b, AXES[:1], (False,), ["unit"], [1.0], [(1440.0, 1440.0)])
    assert found == []
    values[kept & (t > 3600.0)] += 20.0
    ledger = Ledger(1, DT)
    ledger.add(t[kept], values[kept], None)
    found = clues.find(ledger.blocks(), AXES[:1], (False,), ["unit"], [1.0], [(1440.0, 1440.0)])
    assert [d.kind for d in found] == ["step"]
    assert found[0].start == pytest.approx(3600.0, abs=5.0)


def test_no_block_is_taken_that_holds_a_gap():
    time = np.concatenate([DT * np.arange(1003), 100.0 + DT * np.arange(1000)])
    ledger = Ledger(1, DT)
    ledger.add(time, np.random.default_rng(1).normal(size=(2003, 1)), None)
    b = ledger.blocks()
    first, second = levels.between(b, [(float(time[1002]), float(time[1003] - time[1002]))])
    assert b.stop[first][-1] <= time[1002] < time[1003] <= b.start[second][0]
    assert second.start - first.stop == 1


def test_warming_up_is_a_drift_and_no_step():
    t = DT * np.arange(N)
    values = noise(WHITE, 19)
    values[:, 1] += 50.0 * np.exp(-t / 200.0)
    found = [d for d in seen(values) if d.axis == "gyro_y"]
    assert [d.kind for d in found] == ["drift"]
    assert found[0].spoils
    assert "time constant of 2" in found[0].text
    assert found[0].size == pytest.approx(-50.0, rel=0.05)
    words = clues.advice(blocks_of(values), found)
    assert "--from" in words
    assert found[0].stop == pytest.approx(1000.0, rel=0.1)
    values[:, 1] = noise(WHITE, 19)[:, 1] + 20.0 * (t > 100.0)  # early, and yet a step
    assert kinds(seen(values)) == {"step"}


def test_several_steps_are_all_found():
    values = noise(WHITE, 14, axes=1)
    for at, size in ((30_000, 3.0), (60_000, -5.0), (95_000, 4.0)):
        values[at:] += size
    found = [d for d in seen(values, (False,)) if d.kind == "step"]
    assert sorted(round(d.start, -1) for d in found if d.start) == [300.0, 600.0, 950.0]


def test_the_share_of_a_step_is_what_the_variances_say():
    rng = np.random.default_rng(15)
    mean = rng.normal(size=4096)
    stepped = mean.copy()
    stepped[2048:] += 2.0
    found = levels.steps(stepped)
    assert len(found) == 1
    without, width = [], 1
    while 4 * width <= mean.size:
        made = [
            np.mean(np.convolve(x, np.r_[np.ones(width), -np.ones(width)] / width, "valid") ** 2)
            for x in (mean, stepped)
        ]
        without.append(1.0 - made[0] / made[1])
        width *= 2
    assert levels.harm(found[0], stepped) == pytest.approx(max(without), abs=0.1)


@pytest.mark.statistical
def test_clean_logs_raise_no_alarm():
    """At most one log in a hundred, of three axes each: white noise, with flicker noise and walk, and walk alone."""
    alarms, logs = 0, 0
    walk = NoiseModel(density=0.3, walk=0.3)
    for seed in range(70):
        for model in (WHITE, SLOW, walk):
            logs += 1
            alarms += bool(seen(noise(model, 1000 + seed, samples=20_000)))
    # 1 % of 210 logs, and what chance adds to it: P(Poisson(2.1) > 6) = 0.6 %
    assert alarms <= 6
