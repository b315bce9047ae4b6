"""Effects of temperature: the coefficient comes out within its uncertainty, and drifting noise is not taken for one."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.noise.findings.blocks import Ledger
from sagnac.noise.temperature import effects, taken_off
from sagnac.simulate.noise import AxisNoise, NoiseModel

DT = 0.01
N = 20_000
AXES = ("gyro_x", "gyro_y", "gyro_z")
READINGS = ("rad/s",) * 3
TRIAD = [(0, 1, 2)]
WHITE = NoiseModel(density=1.0)
SLOW = NoiseModel(density=1.0, instability=0.3, band=(1.0, 3000.0), walk=0.02)
WALK = NoiseModel(density=0.3, walk=0.3)
LOUD = NoiseModel(density=0.3, walk=3.0)


def noise(models, seed, samples=N):
    out = np.zeros((samples, len(models)))
    for k, model in enumerate(models):
        column = np.zeros(samples)
        AxisNoise(model, DT, seed, (k,)).add(column)
        out[:, k] = column
    return out


def blocks_of(values, warmth=None):
    ledger = Ledger(values.shape[1], DT)
    ledger.add(DT * np.arange(len(values)), values, warmth)
    return ledger.blocks()


def warming(kind, seed, samples=N):
    """Warming up, a day's cycle, or a walk of its own: what a laboratory does."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / samples
    if kind == "settling":
        return 295.0 + 6.0 * (1.0 - np.exp(-t / rng.uniform(0.1, 0.6))) + rng.uniform(-2, 2) * t
    if kind == "day":
        return 295.0 + 3.0 * np.sin(2 * np.pi * (rng.uniform(0.7, 3.0) * t + rng.uniform()))
    return 295.0 + 0.2 * np.repeat(np.cumsum(rng.normal(size=samples // 100)), 100)


def test_an_effect_is_found_with_its_coefficient():
    n = 120_000
    warmth = 295.0 + 3.0 * np.sin(2 * np.pi * DT * np.arange(n) / 700.0)
    values = noise([SLOW] * 3, 16, n)
    values[:, 1] += 0.5 * warmth
    found = effects(blocks_of(values, warmth), TRIAD)
    assert found is not None
    effect = found[1]
    assert effect.p_value < 1e-4
    assert effect.of_triad < 1e-4
    assert abs(effect.coefficient - 0.5) < 3.0 * effect.standard_uncertainty
    assert effect.explained > 0.5
    assert effect.told_apart
    assert effect.helps
    assert all(found[k].p_value > 1e-3 for k in (0, 2))


def test_axes_by_themselves_and_axes_left_out():
    values = noise([SLOW] * 3, 16)
    warmth = warming("day", 1)
    values[:, 1] += 2.0 * warmth
    found = effects(blocks_of(values, warmth), [(1,), (2,)])
    assert found is not None
    assert sorted(found) == [1, 2]
    # the square of a normal deviate is as likely as the deviate: of a single axis both probabilities average the same
    assert found[1].of_triad < 1e-4
    assert found[2].of_triad == pytest.approx(found[2].p_value, rel=1e-6)


def test_a_steady_rise_cannot_be_told_from_a_drift():
    warmth = 295.0 + 4e-2 * DT * np.arange(N)
    values = noise([WHITE] * 3, 17)
    values[:, 1] += 2.0 * warmth
    found = effects(blocks_of(values, warmth), TRIAD)
    assert found is not None
    assert not found[1].told_apart


def test_without_change_of_temperature_there_is_nothing_to_tell():
    values = noise([WHITE] * 3, 18)
    assert effects(blocks_of(values, np.full(N, 295.0)), TRIAD) is None
    assert effects(blocks_of(values), TRIAD) is None
    assert taken_off(blocks_of(values), AXES, [0, 1, 2], READINGS) == (None, {})


def test_all_axes_of_a_triad_are_told_and_those_clearly_moved_are_corrected():
    warmth = warming("day", 3)
    values = noise([SLOW] * 3, 19)
    values += np.array([3.0, -0.6, 0.0]) * warmth[:, None]
    correction, told = taken_off(blocks_of(values, warmth), AXES, [0, 1, 2], READINGS)
    assert correction is not None
    assert sorted(told) == [0, 1, 2]
    assert correction.coefficient[0] == pytest.approx(3.0, rel=0.1)
    assert correction.coefficient[1] == pytest.approx(-0.6, rel=0.5)
    assert correction.coefficient[2] == 0.0
    assert "taken off before the terms" in told[1].text
    assert "not clear enough to be taken off, as it was off gyro_x, gyro_y" in told[2].text
    assert told[2].significance is not None
    assert told[2].significance < 3.0
    none, silent = taken_off(blocks_of(values, warmth), AXES, [2], READINGS)
    assert none is None
    assert silent == {}


@pytest.mark.statistical
@pytest.mark.parametrize("kind", ["settling", "day", "walk"])
def test_drifting_noise_is_no_effect(kind):
    """Flicker noise and walks, alike on the axes or one of them ten times the others', beside a temperature that drifts."""
    chances = []
    for seed in range(34):
        for models in ([SLOW] * 3, [WALK] * 3, [WALK, WALK, LOUD]):
            found = effects(blocks_of(noise(models, 100 + seed), warming(kind, seed)), TRIAD)
            assert found is not None
            chances.append(found[0].of_triad)
    # 102 logs: as many below a hundredth as chance gives, P(Poisson(1.02) > 5) = 0.07 %, and none that would be named
    assert sum(p < 0.01 for p in chances) <= 5
    assert min(chances) > 1e-4


@pytest.mark.statistical
def test_coefficients_come_out_within_their_uncertainty():
    z = []
    for seed in range(60):
        kind = ("settling", "day", "walk")[seed % 3]
        warmth = warming(kind, seed)
        values = noise([SLOW] * 3, 300 + seed)
        true = np.random.default_rng(seed).normal(size=3)
        found = effects(blocks_of(values + true * warmth[:, None], warmth), TRIAD)
        assert found is not None
        z += [(found[k].coefficient - true[k]) / found[k].standard_uncertainty for k in range(3)]
    inside = np.mean(np.abs(z) < 1.96)
    # 180 coefficients, three of a log: 95 % with a standard deviation of sqrt(0.95 * 0.05 / 180) = 1.6 %
    assert inside >= 0.90
