"""Stretches, filters and blocks against plain NumPy and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import detrend, upfirdn

from sagnac.kernels.stretches import (
    add_power,
    block_sums,
    count_equal,
    filter_quarter,
    follow_runs,
    steps_between,
    window_stretches,
)

Y = np.random.default_rng(0).normal(size=1000).cumsum() + 300.0


@pytest.mark.parametrize(("trend", "kind"), [(False, "constant"), (True, "linear")])
def test_stretches_are_less_their_mean_or_trend_under_the_window(trend, kind):
    window, out = np.hanning(128), np.empty((8, 128))
    window_stretches(Y, 100, window, trend, out)
    expected = [detrend(Y[s : s + 128], type=kind) * window for s in range(0, 800, 100)]
    assert out == pytest.approx(np.array(expected), abs=1e-11)


def test_power_is_added():
    found = np.fft.rfft(Y.reshape(10, 100), axis=1)
    power = np.full(51, 7.0)
    add_power(found.view(float), power)
    assert power == pytest.approx(7.0 + (np.abs(found) ** 2).sum(axis=0))


def test_every_fourth_filtered_sample():
    taps, out = np.random.default_rng(1).normal(size=37), np.empty((1000 - 37) // 4 + 1)
    filter_quarter(Y, taps, out)
    assert out == pytest.approx(upfirdn(taps[::-1], Y)[36 : 36 + 4 * out.size : 4])


def test_blocks():
    out = np.empty((10, 3))
    block_sums(Y.reshape(10, 100), 299.0, out)
    blocks = Y.reshape(10, 100)
    assert out[:, 0] == pytest.approx(blocks.mean(axis=1), rel=1e-14)
    assert out[:, 1] == pytest.approx(100 * blocks.var(axis=1))
    assert out[:, 2] == pytest.approx((np.diff(Y, prepend=299.0) ** 2).reshape(10, 100).mean(axis=1))


def test_steps_and_runs_of_equal_samples():
    y = np.array([1.0, 1.0, 3.0, 3.0 + 1e-12, 3.0, 2.5, 2.5, 7.0])
    steps = np.empty(7)
    assert steps_between(y, 1e-9, steps) == 4
    assert np.isinf(steps[[0, 2, 3, 5]]).all()
    assert steps[[1, 4, 6]] == pytest.approx([2.0, 0.5, 4.5])
    assert count_equal(y, 1.0) == 2
    run = np.array([0.0, np.nan, 0.0, np.nan])
    ended = np.zeros(3, dtype=np.int64)
    follow_runs(y[:4], np.arange(4.0), np.nan, 1e-9, run, ended)
    follow_runs(y[4:], np.arange(4.0, 8.0), y[3], 1e-9, run, ended)
    assert run.tolist() == [0.0, 7.0, 2.0, 2.0]
