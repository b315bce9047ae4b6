"""Static intervals and saturation in motion."""

import numpy as np
import pytest

from plain import moving_variance as plain_variance
from sagnac.errors import DataError
from sagnac.observe.saturation import longest_run, refuse_saturated_motion
from sagnac.observe.static import moving_variance, static_intervals
from sagnac.recording import from_arrays


def rests_and_moves(rng, noise=1.0, offset=0.0, scale=1.0, frequency=100):
    """Four rests of 5 s with moves of 2 s between; returns time, samples (n, 3) and the rests' edges."""
    pieces, edges, level, n = [], [], np.zeros(3), 0
    for k in range(4):
        if k:
            u = np.linspace(0, 1, 2 * frequency)
            pieces.append(level + np.outer(u * u * (3 - 2 * u), rng.uniform(300, 900, 3)))
            level = pieces[-1][-1]
            n += 2 * frequency
        pieces.append(np.tile(level, (5 * frequency, 1)))
        edges.append((n, n + 5 * frequency))
        n += 5 * frequency
    values = np.concatenate(pieces) + noise * rng.standard_normal((n, 3))
    return np.arange(n) / frequency, scale * values + offset, np.array(edges)


def test_moving_variance_equals_the_direct_form():
    values = np.random.default_rng(0).standard_normal((300, 4)) + 1e5
    assert np.allclose(moving_variance(values, 21), plain_variance(values, 21), rtol=1e-6)


@pytest.mark.parametrize("scale", [1e-3, 1.0, -1e6])
@pytest.mark.parametrize("offset", [0.0, 1e9])
def test_rests_are_found_whatever_scale_and_offset(scale, offset):
    time, values, edges = rests_and_moves(np.random.default_rng(1), scale=scale, offset=offset * scale)
    found = static_intervals(from_arrays(time, values, counts=("accel",)).read())
    assert found.start.size == 4
    # the ends of a slow move are slower than noise: an edge may be off by half a window
    assert np.all(np.abs(found.start[1:] - edges[1:, 0]) < 50)
    assert np.all(np.abs(found.stop[:-1] - edges[:-1, 1]) < 50)


def test_quantised_data_below_one_count_of_noise():
    """Noise of a tenth of a count: rests are constants, and still rests."""
    time, values, _ = rests_and_moves(np.random.default_rng(1), noise=0.1)
    found = static_intervals(from_arrays(time, np.round(values), counts=("accel",)).read())
    assert found.start.size == 4


def test_noise_free_data():
    time, values, _ = rests_and_moves(np.random.default_rng(1), noise=0.0)
    assert static_intervals(from_arrays(time, values, counts=("accel",)).read()).start.size == 4


def test_gap_splits_a_rest():
    time, values, _ = rests_and_moves(np.random.default_rng(1))
    keep = (np.arange(time.size) < 220) | (np.arange(time.size) > 260)
    found = static_intervals(from_arrays(time[keep], values[keep], counts=("accel",)).read())
    assert found.start.size == 5


def test_short_recording_is_refused():
    with pytest.raises(DataError, match="300 samples.*too few to find static"):
        static_intervals(from_arrays(np.arange(300) / 100, np.zeros((300, 3))).read())


def test_longest_run():
    assert longest_run(np.array([0, 1, 1, 0, 1, 1, 1, 0], dtype=bool)) == (3, 4)
    assert longest_run(np.zeros(4, dtype=bool)) == (0, 0)


@pytest.mark.parametrize(("side", "limits"), [("top", (None, 5.0)), ("bottom", (-5.0, None))])
def test_clipped_swing_is_named(side, limits):
    time = np.arange(1000) / 100
    swing = 8 * np.sin(time)[:, None] * [1, 0.1, 0.1] + 0.01 * np.random.default_rng(0).standard_normal((1000, 3))
    with pytest.raises(DataError, match=rf"gyro_x is saturated at the {side} of its range \(-?5\)"):
        refuse_saturated_motion("log", from_arrays(time, gyro=np.clip(swing, *limits)).read())
    refuse_saturated_motion("log", from_arrays(time, gyro=swing).read())


def test_coarse_converter_is_not_taken_for_saturation():
    """A converter coarser than the noise repeats values for long; nothing says that it is at its end."""
    time = np.arange(1000) / 100
    coarse = np.round(3 * np.sin(0.3 * time))[:, None] * [1, 1, 1]
    refuse_saturated_motion("log", from_arrays(time, gyro=coarse).read())
