"""The kernels of the harmonics against their plain twins."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plain import extremes, harmonic_terms
from sagnac.kernels import harmonics as kernel
from sagnac.kernels import is_cold
from sagnac.observe.harmonic_sums import _square_series, _tabulate

STEP = 1e-3
NOTHING = np.zeros(0)


def run(values, size, clock, turn, order, *, powers=1, regular=None, angle=NOTHING, reference=None, cells=3):
    """Outputs of the kernel for samples at some times; turn = (start, phase, rate, zero of tau)."""
    n, axes = values.shape
    table = _tabulate(turn[2], STEP, size, order, powers)
    starts = clock[::size]
    regular = np.ones(starts.size, dtype=bool) if regular is None else regular
    centre = values[0].copy()
    reference = np.zeros((axes, 1 + 2 * order)) if reference is None else reference
    k = 1 + 2 * order * (2 if powers > 1 else 1)
    sums, squares, times = np.zeros((cells, axes, k)), np.zeros(axes), np.zeros(cells)
    moments = np.zeros((cells, powers, 2 * order + 1), dtype=complex)
    way = np.array([*turn, STEP, cells / (n * STEP), 0.0])
    moment = np.ascontiguousarray(np.moveaxis(table.moments[:, :, [size, (n - 1) % size + 1]], 2, 0))
    series = np.array([_square_series(r) for r in reference])
    kernel.harmonic_sums(
        values, size, way, starts, regular, clock, angle, table.rows, moment, centre, reference, series,
        sums, squares, moments, times, True,
    )  # fmt: skip
    return sums, squares, moments, times, centre


@pytest.mark.parametrize(("order", "powers"), [(0, 1), (1, 1), (3, 1), (6, 1), (1, 3), (3, 3), (6, 3)])
@pytest.mark.parametrize(("n", "size"), [(5000, 512), (4096, 512), (1700, 400), (700, 511), (300, 40), (3, 8)])
@pytest.mark.parametrize("kind", ["regular", "irregular", "both", "measured"])
def test_sums_equal_the_plain_ones(kind, n, size, order, powers):
    rng = np.random.default_rng(n + order)
    values = rng.normal(size=(n, 3 if n != 4096 else 1)) + [5.0]
    clock = 2.0 + STEP * np.arange(n)
    turn = (2.0, 0.7, -9.0, 2.0 + 0.4 * n * STEP)
    blocks = -(-n // size)
    regular = {"regular": np.ones, "both": lambda b, dtype: np.arange(b) % 2 == 0}.get(kind, np.zeros)(
        blocks, dtype=bool
    )
    if kind in ("irregular", "measured"):
        clock = clock + 3e-4 * rng.uniform(-1, 1, n)
    angle = 0.3 + 4.0 * np.sin(clock) if kind == "measured" else NOTHING
    reference = rng.normal(size=(values.shape[1], 1 + 2 * order))
    sums, squares, moments, times, centre = run(
        values, size, clock, turn, order, powers=powers, regular=regular, angle=angle, reference=reference
    )
    th = angle if kind == "measured" else turn[1] + turn[2] * (clock - turn[0])
    tau = clock - turn[3]
    terms = harmonic_terms(th, order, tau if powers > 1 else None)
    # an angle of some ten rad, rounded, times the harmonic
    scale, exact = n * np.abs(values).max(), 1e-15 * (10 + 5 * order)
    np.testing.assert_allclose(sums.sum(axis=0), (values - centre).T @ terms, rtol=0, atol=exact * scale)
    rest = values - centre - harmonic_terms(th, order) @ reference.T
    np.testing.assert_allclose(squares, (rest**2).sum(axis=0), rtol=1e-12)
    expected = [[np.sum(tau**p * np.exp(1j * m * th)) for m in range(2 * order + 1)] for p in range(powers)]
    np.testing.assert_allclose(moments.sum(axis=0), expected, rtol=0, atol=2 * exact * n)
    # each block belongs to the cell in which it begins
    cell = np.clip((clock[::size] - turn[0]) * 3 / (n * STEP), 0, 2).astype(int)
    block = np.minimum(size, n - size * np.arange(blocks))
    np.testing.assert_allclose(moments[:, 0, 0].real, np.bincount(cell, block, 3), rtol=1e-12)
    np.testing.assert_allclose(times.sum(), tau.sum(), rtol=0, atol=(1e-3 if kind != "regular" else 1e-12) * n)


def test_moments_are_left_alone_when_they_are_not_wanted():
    table = _tabulate(3.0, STEP, 64, 2, 1)
    moments, times = np.full((1, 1, 5), 7.0 + 0j), np.full(1, 7.0)
    kernel.harmonic_sums(
        np.ones((64, 1)), 64, np.array([0.0, 0.0, 3.0, 0.0, STEP, 1.0, 0.0]), np.zeros(1), np.ones(1, dtype=bool), NOTHING,
        NOTHING, table.rows, np.ascontiguousarray(np.moveaxis(table.moments[:, :, [64, 64]], 2, 0)), np.zeros(1),
        np.zeros((1, 5)), np.zeros((1, 5), dtype=complex), np.zeros((1, 1, 5)), np.zeros(1), moments, times, False,
    )  # fmt: skip
    assert np.all(moments == 7.0)
    assert np.all(times == 7.0)


def test_blocks_off_the_even_grid_are_found():
    clock = 5.0 + STEP * np.arange(100)
    assert kernel.regular_blocks(clock, 30, STEP, 1e-12).tolist() == [True] * 4
    clock[35] += 2e-9
    clock[95:] += 0.5
    assert kernel.regular_blocks(clock, 30, STEP, 1e-9).tolist() == [True, False, True, False]
    assert kernel.regular_blocks(clock[:1], 30, STEP, 0.0).tolist() == [True]
    # another interval: off by 29 times the difference at the end of a block
    assert not kernel.regular_blocks(5.0 + 1.0001e-3 * np.arange(60), 30, STEP, 1e-6).any()


@given(
    st.integers(0, 10_000),
    st.sampled_from([0.3, 1.0, 4.0]),
    st.lists(st.integers(1, 1500), max_size=6),
    st.integers(1, 4),
)
@settings(max_examples=100)
def test_look_finds_extremes_runs_and_steps(seed, noise, cuts, repeat):
    values = np.round(noise * np.random.default_rng(seed).normal(size=(1600 // repeat, 2))).repeat(repeat, axis=0)
    state = np.zeros((2, kernel.LAST + 1))
    edges = [0, *sorted({c for c in cuts if c < len(values)}), len(values)]
    for a, b in pairwise(edges):
        kernel.look(values[a:b], state, a == 0)
    for found, column in zip(state, values.T, strict=True):
        for name, expected in extremes(column).items():
            assert found[getattr(kernel, name)] == pytest.approx(expected, rel=1e-12), name


def test_compiled_kernels_are_found_on_disk():
    kernel.look(np.zeros((2, 1)), np.zeros((1, kernel.LAST + 1)), True)
    run(np.zeros((10, 1)), 10, STEP * np.arange(10.0), (0.0, 0.0, 1.0, 0.0), 1)
    assert not is_cold(kernel.look)
    assert not is_cold(kernel.harmonic_sums)
