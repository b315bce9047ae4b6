"""Running sums of one segment against harmonics of its angle, and the least-squares fit that they hold.

Terms are ``1, cos th, sin th, cos 2 th, ...``, th(t) = phase + rate (t - start), and in the extended form also
``tau cos th, tau sin th, ...``, tau the time from the middle of the segment: what a small error of the rate adds to first
order. Sums over blocks of evenly spaced samples are taken against one table and turned to the angle of the block; the
products of the terms follow from the sums of exp(i m th), so that gaps and parts of turns cost nothing and lose nothing.
Sums are kept for a number of stretches of equal time (cells), by which slow disturbances are judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frames import Array
from .sums import BLOCKS

Complex = NDArray[np.complex128]

BLOCK = 512
"""Most samples in a block: those that go by one angle, and the length of the table."""
WORKERS = 2
"""Threads that share the samples."""
CLEAR = 5.0
"""Standard deviations by which the slow scatter must differ from that of samples to be taken for another."""
_PHASE = 1e-10  # rad by which the highest harmonic may be off the even grid of a block; more is summed sample by sample
_SHARE = 1 << 24  # samples that one thread works on at a time: what belongs to their blocks stays in its cache
_FIRST = 4096  # samples after which the reference signal is set first,
_GROWTH = 32  # and again whenever there are so many times more
_SOUND = 1e8  # condition up to which a fit serves as reference signal
_SEEN = 1e-9  # of the largest eigenvalue: what a cell can tell
_FEWEST = 4  # degrees of freedom from which the scatter between cells is judged


class Even(NamedTuple):
    """Times of evenly spaced samples: the first, and the step from each to the next (s)."""

    first: float
    step: float


@dataclass(frozen=True)
class Turn:
    """Angle over a segment: `phase` at `start`, turning at `rate` (rad, s, rad/s)."""

    start: float
    stop: float
    rate: float
    phase: float = 0.0

    def angle(self, time: Array) -> Array:
        """Angle at some times, rad."""
        return np.asarray(self.phase + self.rate * (time - self.start))


@dataclass(frozen=True)
class Fit:
    """Least-squares fit of one segment, k terms.

    Attributes
    ----------
    coefficient : ndarray, shape (axes, k)
    unit_covariance : ndarray, shape (k, k)
        Inverse Gram matrix: covariance for samples of unit variance.
    condition : float
        Of the Gram matrix with its terms scaled to equal size.
    squares : ndarray, shape (axes,)
        Residual sum of squares.
    degrees_of_freedom : int
    slow_squares : ndarray, shape (axes,)
        The same of the scatter between cells, a drift of the constant taken out, scaled to single samples.
    slow_degrees_of_freedom : int
        Zero where there are too few cells.
    """

    coefficient: Array
    unit_covariance: Array
    condition: float
    squares: Array
    degrees_of_freedom: int
    slow_squares: Array
    slow_degrees_of_freedom: int

    @property
    def noise(self) -> Array:
        """Variance of single samples as it counts for the terms, shape (axes,): the slow one where it is clearly another."""
        quick = self.squares / max(self.degrees_of_freedom, 1)
        if not self.slow_degrees_of_freedom:
            return quick
        slow = self.slow_squares / self.slow_degrees_of_freedom
        clear = CLEAR * np.sqrt(2.0 / self.slow_degrees_of_freedom)
        return np.where((slow > (1.0 + clear) * quick) | (slow < (1.0 - clear) * quick), slow, quick)


@dataclass(frozen=True)
class _Table:
    """What the kernel needs to know of a block of evenly spaced samples (see there).

    The moments are the sums of ``u^p exp(i m rate u)`` over its first 0, 1, 2, ... samples, u the time from the middle of the
    longest block.
    """

    step: float
    rows: Array
    moments: Complex


@dataclass(frozen=True)
class _Part:
    """Sums over some blocks, from one cell on; see :class:`HarmonicSums`."""

    cell: int
    sums: Array
    squares: Array
    moments: Complex
    time_sums: Array


def _cut(clock: Array | Even, start: int, stop: int) -> Array | Even:
    return Even(clock.first + start * clock.step, clock.step) if isinstance(clock, Even) else clock[start:stop]


def _tabulate(rate: float, step: float, size: int, order: int, powers: int) -> _Table:
    u = (np.arange(size) - 0.5 * (BLOCK - 1)) * step
    wave = np.exp(1j * np.outer(np.arange(2 * order + 1), rate * u))
    moments = np.zeros((powers, 2 * order + 1, size + 1), dtype=complex)
    np.cumsum([u**p * wave for p in range(powers)], axis=2, out=moments[:, :, 1:])
    half = (np.arange(BLOCK // 2) + 0.5) * step
    upper = np.exp(1j * np.outer(np.arange(1, order + 1), rate * half))
    rows = np.stack([upper.real, upper.imag], axis=1).reshape(2 * order, half.size)
    if powers > 1:
        rows = np.concatenate([rows, rows * half])
    return _Table(step, np.ascontiguousarray(rows), moments)


@lru_cache
def _terms(order: int, powers: int) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
    """Harmonic, power of tau, and whether it is a sine, of each term."""
    harmonic = [0, *np.repeat(np.arange(1, order + 1), 2)]
    power, sine = [0] * len(harmonic), [False, *([False, True] * order)]
    if powers > 1:
        harmonic, power, sine = harmonic + harmonic[1:], power + [1] * (2 * order), sine + sine[1:]
    return np.array(harmonic), np.array(power), np.array(sine)


def gram(moments: Complex) -> Array:
    """Products of the terms from the sums of ``tau^p exp(i m th)``.

    Parameters
    ----------
    moments : ndarray of complex, shape (..., powers, 2 order + 1)
        powers is 1, or 3 for the extended terms.

    Returns
    -------
    ndarray, shape (..., k, k)
    """
    harmonic, power, sine = _terms(moments.shape[-1] // 2, moments.shape[-2])
    a, b = harmonic[:, None], harmonic[None, :]
    both = power[:, None] + power[None, :]
    plus = moments[..., both, a + b]
    minus = moments[..., both, np.abs(a - b)]
    minus = np.where(a < b, minus.conj(), minus)
    s, t = sine[:, None], sine[None, :]
    even = np.where(s & t, minus.real - plus.real, minus.real + plus.real)
    odd = np.where(s, plus.imag + minus.imag, plus.imag - minus.imag)
    return np.asarray(0.5 * np.where(s == t, even, odd))


def inverted(matrix: Array) -> tuple[Array, float]:
    """Inverse of a Gram matrix (k, k), and its condition with unit diagonal; NaN and infinite where there is none."""
    size = np.sqrt(np.diag(matrix))
    if not np.all(size > 0):
        return np.full_like(matrix, np.nan), np.inf
    scaled = matrix / np.outer(size, size)
    values, vectors = np.linalg.eigh(scaled)
    if values[0] <= np.finfo(float).eps * values[-1]:
        return np.full_like(matrix, np.nan), np.inf
    return (vectors / values) @ vectors.T / np.outer(size, size), float(values[-1] / values[0])


class HarmonicSums:
    """Sums of one segment.

    Parameters
    ----------
    turn : Turn
    axes : int
        Number of axes over all groups of samples.
    order : int
        Highest harmonic; 0 for a segment that does not turn.
    cells : int
        Stretches of equal time that keep sums of their own.
    extended : bool
        Whether the terms with tau are summed as well.
    compare : bool
        Whether the squares are those of the difference from a reference signal (see there).

    Attributes
    ----------
    count : int
        Samples so far.
    centre : ndarray, shape (axes,)
        First sample: all sums are of the samples less this.
    sums : ndarray, shape (cells, axes, k)
        Against the terms.
    moments : ndarray of complex, shape (cells, 1 or 3, 2 order + 1)
        Of ``tau^p exp(i m th)``.
    time_sums : ndarray, shape (cells,), s
        Of tau, to the length of a block.
    squares : ndarray, shape (axes,)
        Squared differences from the reference signal.
    reference : ndarray, shape (axes, c)
        The signal that the samples are compared with: the fit of an earlier part. It makes the squares small, no more.
    """

    def __init__(
        self, turn: Turn, axes: int, order: int, *, cells: int = BLOCKS, extended: bool = False, compare: bool = True
    ) -> None:
        self.turn, self.axes, self.order, self.cells = turn, axes, order, cells
        self.middle = 0.5 * (turn.start + turn.stop)
        self.powers = 3 if extended else 1
        self.plain = 1 + 2 * order
        self.compare = compare
        self.count = self.renewed = self.size = 0
        self.time_sums = np.zeros(cells)
        self.centre = np.zeros(axes)
        self.sums = np.zeros((cells, axes, self.plain + (2 * order if extended else 0)))
        self.moments: Complex = np.zeros((cells, self.powers, 2 * order + 1), dtype=complex)
        self.squares = np.zeros(axes)
        self.reference = np.zeros((axes, self.plain))
        self._table: _Table | None = None

    def add(
        self,
        groups: Sequence[Array],
        clock: Array | Even,
        interval: float,
        *,
        angle: Array | None = None,
        pool: ThreadPoolExecutor | None = None,
    ) -> None:
        """Take in the next samples.

        Parameters
        ----------
        groups : sequence of ndarray, shape (n, ...)
            Samples of all axes, C-contiguous, in the order of the axes.
        clock : ndarray, shape (n,), s; or Even
            Sample times.
        interval : float, s
            Usual sample interval.
        angle : ndarray, shape (n,), rad, optional
            Measured angle of each sample, instead of the one that the turn gives.
        pool : ThreadPoolExecutor, optional
            Of :data:`WORKERS` threads.
        """
        if self.count == 0:
            self.centre = np.concatenate([g[0] for g in groups])
            share = (self.turn.stop - self.turn.start) / self.cells / interval
            self.size = int(np.clip(share / 4, 8, BLOCK))
        done, n = 0, len(groups[0])
        while done < n:
            stop = done + min(n - done, max(_FIRST, (_GROWTH - 1) * self.count))
            self._add(
                [g[done:stop] for g in groups],
                _cut(clock, done, stop),
                None if angle is None else angle[done:stop],
                pool,
            )
            self.count, done = self.count + stop - done, stop
            if self.count >= _GROWTH * self.renewed:
                self.renew()

    def _add(
        self, groups: Sequence[Array], clock: Array | Even, angle: Array | None, pool: ThreadPoolExecutor | None
    ) -> None:
        """Share the samples among the threads and add up what comes back."""
        self._fit_table(clock)
        n, size = len(groups[0]), self.size
        count = -(-n // size)
        parts = 1 if pool is None or count < 4 * WORKERS else WORKERS * -(-n // (WORKERS * _SHARE))
        edges = [i * count // parts for i in range(parts + 1)]
        squared = np.array([_square_series(r) for r in self.reference])

        def job(blocks: tuple[int, int]) -> _Part:
            i, j = blocks[0] * size, min(blocks[1] * size, n)
            return self._part(
                [g[i:j] for g in groups], _cut(clock, i, j), None if angle is None else angle[i:j], squared
            )

        for part in map(job, pairwise(edges)) if pool is None or parts == 1 else pool.map(job, pairwise(edges)):
            here = slice(part.cell, part.cell + len(part.sums))
            self.sums[here] += part.sums
            self.squares += part.squares
            self.moments[here] += part.moments
            self.time_sums[here] += part.time_sums

    def _part(self, groups: Sequence[Array], clock: Array | Even, angle: Array | None, squared: Complex) -> _Part:
        """Sums over some blocks, the last of which may be short."""
        from ..kernels.harmonics import harmonic_sums

        assert self._table is not None
        table, size, turn, n = self._table, self.size, self.turn, len(groups[0])
        begin = np.arange(0, n, size)
        starts: Array = np.asarray(clock.first + begin * table.step if isinstance(clock, Even) else clock[begin])
        regular = np.ones(starts.size, dtype=np.bool_)
        if not isinstance(clock, Even):
            regular = self._regular(clock, table.step) if angle is None else ~regular
        cells_per_second = self.cells / (turn.stop - turn.start)
        ends = np.clip((starts[[0, -1]] - turn.start) * cells_per_second, 0, self.cells - 1).astype(int)
        low, many = int(ends[0]), int(ends[1] - ends[0]) + 1
        way = np.array([turn.start, turn.phase, turn.rate, self.middle, table.step, cells_per_second, low])
        moment = np.ascontiguousarray(np.moveaxis(table.moments[:, :, [size, n - begin[-1]]], 2, 0))
        sums, squares, time_sums = np.zeros((many, *self.sums.shape[1:])), np.zeros(self.axes), np.zeros(many)
        moments = np.zeros((many, *self.moments.shape[1:]), dtype=complex)
        nothing, axis = np.zeros(0), 0
        times = nothing if isinstance(clock, Even) else clock
        for values in groups:
            axes = slice(axis, axis + values.shape[1])
            own, own_squares = np.zeros_like(sums[:, axes]), np.zeros(values.shape[1])
            harmonic_sums(
                values, size, way, starts, regular, times, nothing if angle is None else angle, table.rows,
                moment, self.centre[axes], self.reference[axes], squared[axes], own, own_squares, moments, time_sums, axis == 0,
            )  # fmt: skip
            sums[:, axes], squares[axes], axis = own, own_squares, axes.stop
        return _Part(low, sums, squares, moments, time_sums)

    def _regular(self, clock: Array, step: float) -> NDArray[np.bool_]:
        from ..kernels.harmonics import regular_blocks

        tolerance = _PHASE / (self.order * abs(self.turn.rate)) if self.order and self.turn.rate else np.inf
        return np.asarray(regular_blocks(clock, self.size, step, tolerance))

    def _fit_table(self, clock: Array | Even) -> None:
        """Make the table, anew where the samples are even but have another interval than it."""
        table = self._table
        if isinstance(clock, Even):
            step, fits = clock.step, table is not None and table.step == clock.step
        else:
            first = clock[: self.size]
            step = float(first[-1] - first[0]) / max(first.size - 1, 1)
            fits = table is not None and bool(self._regular(first, table.step)[0] or not self._regular(first, step)[0])
        if not fits:
            self._table = _tabulate(self.turn.rate, step, self.size, self.order, self.powers)

    def rest(self) -> tuple[Array, Array]:
        """Gram matrix (k, k) of all samples, and the sums (axes, k) of the samples less the reference signal."""
        products = gram(self.moments.sum(axis=0))
        return products, self.sums.sum(axis=0) - self.reference @ products[: self.plain]

    def renew(self) -> None:
        """Make the fit so far the reference signal, where there is one and it is well determined."""
        if not self.compare or self.count <= 2 * self.plain:
            return
        products, rest = self.rest()
        inverse, condition = inverted(products[: self.plain, : self.plain])
        if condition > _SOUND:
            return
        step = rest[:, : self.plain] @ inverse
        self.squares -= (
            2.0 * (step * rest[:, : self.plain]) - step * (step @ products[: self.plain, : self.plain])
        ).sum(1)
        self.reference = self.reference + step
        self.renewed = self.count

    def fit(self, zero: float | None = None) -> Fit:
        """Least-squares fit to all samples (NaN where they do not determine it, see its condition).

        Parameters
        ----------
        zero : float, s, optional
            Time from which tau counts, instead of the middle of the segment.
        """
        self.renew()
        products, rest = self.rest()
        inverse, condition = inverted(products)
        step = rest @ inverse
        coefficient = step.copy()
        coefficient[:, : self.plain] += self.reference
        slow, slow_dof = self._slow(coefficient) if np.isfinite(condition) else (np.zeros(self.axes), 0)
        moved = np.eye(len(products))
        if zero is not None and self.powers > 1:
            moved[range(1, self.plain), range(self.plain, len(products))] = zero - self.middle
        coefficient = coefficient @ moved.T
        coefficient[:, 0] += self.centre
        return Fit(
            coefficient=coefficient,
            unit_covariance=moved @ inverse @ moved.T,
            condition=condition,
            squares=np.maximum(self.squares - (step * rest).sum(axis=1), 0.0),
            degrees_of_freedom=self.count - len(products),
            slow_squares=slow,
            slow_degrees_of_freedom=slow_dof,
        )

    def _slow(self, coefficient: Array) -> tuple[Array, int]:
        """Scatter of the cells about the fit, shape (axes,), and its degrees of freedom.

        Of the sums u over a cell with Gram matrix G, u' G^-1 u has the expectation of one sample's variance for each term
        that the cell can tell.
        """
        products = gram(self.moments)
        rest = self.sums - np.einsum("aj,mjk->mak", coefficient, products)
        size = np.sqrt(np.maximum(np.einsum("mkk->mk", products), 1e-300))
        values, vectors = np.linalg.eigh(products / (size[:, :, None] * size[:, None, :]))
        told = (values > _SEEN * values[:, -1:]) & (values > 0) & (products[:, 0, 0] > 0)[:, None]
        root = np.where(told, 1.0 / np.sqrt(np.where(told, values, 1.0)), 0.0)[:, :, None] * vectors.swapaxes(1, 2)
        root = root / size[:, None, :]
        # whitened: one row for each term of each cell; a drift of the constant is no noise
        drift = products[:, :, 0] * (self.time_sums / np.maximum(products[:, 0, 0], 1.0))[:, None]
        design = (root @ np.concatenate([products, drift[:, :, None]], axis=2)).reshape(-1, products.shape[1] + 1)
        scatter = (root @ rest.swapaxes(1, 2)).reshape(-1, self.axes)
        norm = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
        left, singular, _ = np.linalg.svd(design / norm, full_matrices=False)
        left = left[:, singular > _SEEN * singular[0]]
        dof = int(told.sum()) - left.shape[1]
        if dof < _FEWEST:
            return np.zeros(self.axes), 0
        scatter = scatter - left @ (left.T @ scatter)
        return np.asarray((scatter**2).sum(axis=0)), dof


def _square_series(reference: Array) -> Complex:
    """Series of the square of a signal, for the real part of ``sum s[m] exp(i m th)``, m = 0 ... 2 order."""
    half = 0.5 * (reference[1::2] - 1j * reference[2::2])
    whole = np.concatenate([half[::-1].conj(), reference[:1], half])
    square = np.convolve(whole, whole)[reference.size - 1 :]
    square[1:] *= 2.0
    return np.asarray(square)
