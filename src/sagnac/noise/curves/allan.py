"""Allan, modified Allan and Hadamard variances of rate data, all overlapping: exact over an array, or in one streaming pass.

With x the cumulative sum of the samples and m samples in an averaging time (Riley, NIST SP 1065, equations 11, 14 and 20):

    Allan     mean of (x[i+2m] - 2 x[i+m] + x[i])^2 / (2 m^2)
    modified  mean of (mean over m neighbours of x[i+2m] - 2 x[i+m] + x[i])^2 / (2 m^2)
    Hadamard  mean of (x[i+3m] - 3 x[i+2m] + 3 x[i+m] - x[i])^2 / (6 m^2)

The mean is removed first, and the sums are kept in blocks (:mod:`sagnac.kernels.allan`), so that an accelerometer at 1 g
loses no digits over any length of record.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import DataError, InputError
from ...frames import Array
from .checks import check_finite, check_interval, table

KINDS = ("allan", "modified", "hadamard")
"""Kinds of variances."""

SPAN = {"allan": 2, "modified": 3, "hadamard": 3}
"""Averaging times that one difference of each kind spans."""

SUMMED = {"allan": 1, "modified": 2, "hadamard": 1}
"""How often samples are summed up before differences of the sums are taken."""

OVERLAP = 8
"""Differences of the streaming pass begin at least this often in an averaging time, if it has as many samples."""

_NAMES = {"allan": "Allan", "modified": "modified Allan", "hadamard": "Hadamard"}
_BLOCK = 4096  # points: 32 KiB, and those of a hundred averaging times stay in the second cache
_TASK = 16  # blocks that a thread takes at a time
_LEVELS = 60
_SERIAL = 1 << 16  # values from which threads are worth their start

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Variances:
    """Variances at k averaging times.

    Attributes
    ----------
    kind : str
        One of :data:`KINDS`.
    interval : float, s
        Of the samples.
    samples : int
        How many were taken in, those of all stretches.
    factors : ndarray of int, shape (k,)
        Samples in an averaging time, ascending.
    variance : ndarray, shape (k, axes)
        Unit of the samples squared.
    count : ndarray of int, shape (k,)
        Differences that were averaged.
    method : str
        ``exact``, every difference there is, or ``pyramid``, those at every eighth of the averaging time or closer.
    stretches : tuple of (int, ndarray of int)
        Where several were pooled: samples of each stretch, and differences that it gave, shape (k,).
    often : tuple of int
        Stretches of nearly equal lengths that each of these stands for, their differences together; one each where it is empty.
    """

    kind: str
    interval: float
    samples: int
    factors: Ints
    variance: Array
    count: Ints
    method: str
    stretches: tuple[tuple[int, Ints], ...] = ()
    often: tuple[int, ...] = ()

    @property
    def tau(self) -> Array:
        """Averaging times, shape (k,), s."""
        return np.asarray(self.interval * self.factors, dtype=float)

    @property
    def deviation(self) -> Array:
        """Square root of the variances, shape (k, axes)."""
        return np.sqrt(self.variance)


def octaves(samples: int, kind: str = "allan", *, per_octave: int = 1) -> Ints:
    """Averaging factors in even steps of their logarithm.

    Parameters
    ----------
    samples : int
    kind : str
        One of :data:`KINDS`.
    per_octave : int
        Factors from one power of two to the next, as far as there are integers.

    Returns
    -------
    ndarray of int, shape (k,)
        From 1 to the longest that the samples hold the span of twice: a fourth of them for Allan, a sixth for the others.

    Raises
    ------
    InputError
        There is no such kind, or less than one factor to the octave.
    DataError
        The samples are too few for one factor.
    """
    longest = longest_factor(samples, kind)
    if per_octave < 1:
        raise InputError(f"{per_octave} averaging times per octave: it has to be 1 or more.")
    steps = np.arange(int(np.log2(longest) * per_octave + 1e-9) + 1)
    return np.unique(np.round(2.0 ** (steps / per_octave)).astype(np.int64))


def longest_factor(samples: int, kind: str = "allan") -> int:
    """Averaging factor of which a record holds the span twice, the longest one of :func:`octaves`."""
    _check_kind(kind)
    if samples < 2 * SPAN[kind]:
        raise DataError(
            f"{samples} samples are too few for the {_NAMES[kind]} variance: it takes {2 * SPAN[kind]} at least, and for "
            "an averaging time of m samples that times m."
        )
    return samples // (2 * SPAN[kind])


def pyramid_factors(samples: int, kind: str = "allan", *, per_octave: int = 1) -> Ints:
    """Averaging factors of a :class:`Pyramid` after so many samples.

    Parameters
    ----------
    samples : int
    kind : str
        One of :data:`KINDS`.
    per_octave : int

    Returns
    -------
    ndarray of int, shape (k,)
        Those of :func:`octaves` that are less than 16, and the upper half of these doubled over and over.
    """
    longest, own = longest_factor(samples, kind), _lowest(per_octave)
    while own[-1] <= longest:
        own = np.unique(np.concatenate([own, 2 * own[own >= OVERLAP]]))
    return own[own <= longest]


def _lowest(per_octave: int) -> Ints:
    """Averaging factors of the lowest level of a pyramid."""
    own = np.unique(np.round(2.0 ** (np.arange(4 * per_octave) / per_octave)).astype(np.int64))
    return own[own < 2 * OVERLAP]


def largest_step(factor: int) -> int:
    """Samples from one difference of a :class:`Pyramid` to the next, at an averaging factor of its own."""
    return 1 << max(factor.bit_length() - OVERLAP.bit_length(), 0)


def variances(
    values: ArrayLike, interval: float, factors: Sequence[int] | Ints | None = None, kind: str = "allan"
) -> Variances:
    """Overlapping variances of an array of samples, every difference counted.

    Takes the memory of one copy of the samples and all processors. Short averaging times go at the pace of the processor's
    arithmetic, those of more than a second cache holds (100 000 samples or so) at that of the memory.

    Parameters
    ----------
    values : array_like, shape (n,) or (n, axes)
        Rates: angular rate or specific force. Samples without gaps.
    interval : float, s
        Of the samples.
    factors : sequence of int, optional
        Samples in each averaging time; :func:`octaves` when there are none.
    kind : str
        One of :data:`KINDS`.

    Raises
    ------
    InputError
        An argument that cannot be: the interval, a factor, the kind, the shape.
    DataError
        Samples that are too few, no numbers, or all the same.
    """
    _check_kind(kind)
    check_interval(interval)
    y = table(values, least=1)
    n, axes = y.shape
    m = octaves(n, kind) if factors is None else _checked(factors, n, kind)
    order = SUMMED[kind]
    with ThreadPoolExecutor(_workers(y.size)) as pool:
        reference, reach = _survey(y, pool)
        local, starts = _sums(y, reference, reach, order, pool)
        out = np.zeros((axes, starts.shape[2], m.size))

        def square(task: tuple[int, int, int]) -> None:
            from ...kernels.allan import add_second, add_third

            a, first, last = task
            if kind == "allan":
                add_second(local[a], starts[a], _BLOCK, m, first, last, out[a])
            else:
                add_third(local[a], starts[a], _BLOCK, order, m, first, last, out[a])

        list(pool.map(square, [(a, *part) for a in range(axes) for part in _parts(starts.shape[2])]))
    count = _terms(kind, n, m)
    variance = out.sum(axis=1).T / (count * divisor(kind, m))[:, None]
    return Variances(kind, float(interval), n, m, variance, count, "exact")


def pooled(parts: Sequence[Variances]) -> Variances:
    """Variances of several stretches as one, weighted by the number of their differences.

    What a record with gaps comes to: no difference spans a gap. A stretch adds to the averaging times that it has.

    Parameters
    ----------
    parts : sequence of Variances
        Of one kind, interval and method, with the same axes.

    Raises
    ------
    InputError
        There are none, or they do not go together.
    """
    if not parts:
        raise InputError("There are no variances to pool: every stretch of the record was left out.")
    first = parts[0]
    for p in parts:
        same = p.kind == first.kind and p.method == first.method and p.variance.shape[1] == first.variance.shape[1]
        if not same or not np.isclose(p.interval, first.interval, rtol=1e-6, atol=0.0):
            raise InputError(
                f"Variances that cannot be pooled: {first.kind} ({first.method}) of {first.variance.shape[1]} axes at "
                f"{first.interval:g} s, and {p.kind} ({p.method}) of {p.variance.shape[1]} axes at {p.interval:g} s."
            )
    factors = np.unique(np.concatenate([p.factors for p in parts]))
    total, count = np.zeros((factors.size, first.variance.shape[1])), np.zeros(factors.size, dtype=np.int64)
    stretches: list[tuple[int, Ints]] = []
    often: list[int] = []
    for p in parts:
        at = np.searchsorted(factors, p.factors)
        total[at] += p.count[:, None] * p.variance
        count[at] += p.count
        for samples, own in p.stretches or ((p.samples, p.count),):
            given = np.zeros(factors.size, dtype=np.int64)
            given[at] = own
            stretches.append((samples, given))
        often += p.often or (1,) * max(len(p.stretches), 1)
    samples = sum(p.samples for p in parts)
    variance = total / count[:, None]
    return Variances(
        first.kind, first.interval, samples, factors, variance, count, first.method, tuple(stretches), tuple(often)
    )


class Pyramid:
    """Variances in one streaming pass and a memory that does not grow with the record.

    Level l of the pyramid holds averages over 2^l samples. Averaging times of up to 15 samples use every difference there
    is, longer ones those that begin at every multiple of 2^l, at most an eighth of the averaging time apart. What they
    leave out is nearly redundant: for white noise the estimate has 97 % or more of the degrees of freedom of the exact one,
    for bias instability and random walk all of them. Quantisation noise is the exception, since each of its differences
    tells something new; it rules the short averaging times, where nothing is left out. The result does not depend on how
    the record is parted into batches.

    Parameters
    ----------
    interval : float, s
        Of the samples.
    axes : int
    kind : str
        One of :data:`KINDS`.
    per_octave : int
        Averaging times from one power of two to the next.

    Raises
    ------
    InputError
        An argument that cannot be.
    """

    def __init__(self, interval: float, axes: int, kind: str = "allan", *, per_octave: int = 1) -> None:
        _check_kind(kind)
        check_interval(interval)
        if axes < 1 or per_octave < 1:
            raise InputError(f"{axes} axes and {per_octave} averaging times per octave: each has to be 1 or more.")
        self.interval, self.kind = float(interval), kind
        self._factors = _lowest(per_octave)
        self._doubled = int(np.searchsorted(self._factors, OVERLAP))
        room = SPAN[kind] * int(self._factors[-1])
        self._tails = np.zeros((axes, _LEVELS, room))
        self._kept = np.zeros((axes, _LEVELS), dtype=np.int64)
        self._unread = np.zeros((axes, _LEVELS), dtype=np.int64)
        self._sums = np.zeros((axes, _LEVELS, self._factors.size))
        self._reference, self._moved = np.zeros(axes), np.zeros(axes, dtype=bool)
        self._held = np.zeros((_BLOCK, axes))
        self._samples = 0

    @property
    def samples(self) -> int:
        """How many were taken in."""
        return self._samples

    def add(self, values: ArrayLike) -> None:
        """Take in the next samples.

        Parameters
        ----------
        values : array_like, shape (n,) or (n, axes)

        Raises
        ------
        DataError
            Samples that are no numbers; none of the batch is taken in.
        InputError
            Another number of axes.
        """
        y = table(values, axes=len(self._reference))
        check_finite(y, self._samples)
        if self._samples == 0 and len(y):
            self._reference = y[0].astype(float)
        for start in range(0, len(y), _BLOCK):
            if self._moved.all():
                break
            self._moved |= (y[start : start + _BLOCK] != self._reference).any(axis=0)
        held = self._samples % _BLOCK
        self._samples += len(y)
        head = min(len(y), _BLOCK - held) if held else 0
        self._held[held : held + head] = y[:head]
        if head and held + head == _BLOCK:
            self._take(self._held)
        whole = (len(y) - head) // _BLOCK * _BLOCK
        if whole:
            self._take(y[head : head + whole])
        rest = y[head + whole :]
        self._held[: len(rest)] = rest

    def result(self) -> Variances:
        """Variances of all that was added; more may be added after.

        Raises
        ------
        DataError
            Samples that are too few or all the same.
        """
        n, span = self._samples, SPAN[self.kind]
        longest = longest_factor(n, self.kind)
        _check_alive(self._moved)
        state = [a.copy() for a in (self._tails, self._kept, self._unread, self._sums)]
        self._take(self._held[: n % _BLOCK], state)
        sums = state[3]
        rows: list[tuple[int, int, Array]] = []
        length = n
        for level in range(_LEVELS):
            for i in range(self._doubled if level else 0, self._factors.size):
                k = int(self._factors[i])
                if k << level <= longest:
                    terms = length + SUMMED[self.kind] - span * k
                    scale = float(divisor(self.kind, np.array([k]))[0]) * terms
                    rows.append((k << level, terms, sums[:, level, i] / scale))
            length = length // 2 if SUMMED[self.kind] == 1 else (length - 1) // 2
        rows.sort(key=lambda row: row[0])
        variance = np.array([row[2] for row in rows])
        factors, count = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
        return Variances(self.kind, self.interval, n, factors, variance, count, "pyramid")

    def _take(self, values: Array, state: Sequence[Array | Ints] | None = None) -> None:
        from ...kernels.allan import stream

        tails, kept, unread, sums = state or (self._tails, self._kept, self._unread, self._sums)

        def one(a: int) -> None:
            stream(
                values, a, self._reference[a], SPAN[self.kind], SUMMED[self.kind], _BLOCK, self._factors, self._doubled,
                tails[a], kept[a], unread[a], sums[a],
            )  # fmt: skip

        axes = range(len(self._reference))
        if values.size < _SERIAL:
            for a in axes:
                one(a)
        else:
            with ThreadPoolExecutor(_workers(values.size)) as pool:
                list(pool.map(one, axes))


def _check_kind(kind: str) -> None:
    if kind not in SPAN:
        raise InputError(f"There is no variance of kind {kind!r}. Kinds: {', '.join(KINDS)}.")


def _check_alive(moves: NDArray[np.bool_]) -> None:
    """Name the first axis that does not move."""
    if not moves.all():
        axis = int(np.argmin(moves))
        raise DataError(
            f"All samples of axis {axis + 1} of {moves.size} are the same: there is no noise to see. Is the sensor on, and "
            "are its digits in the file?"
        )


def _checked(factors: Sequence[int] | Ints, samples: int, kind: str) -> Ints:
    given = np.asarray(factors, dtype=float).ravel()
    if not given.size or not np.isfinite(given).all() or (given != np.round(given)).any() or given.min() < 1:
        raise InputError("Averaging factors are whole numbers of samples, 1 or more, and one at least.")
    m = np.unique(given.astype(np.int64))
    longest = (samples + SUMMED[kind] - 1) // SPAN[kind]
    if m[-1] > longest:
        raise InputError(
            f"An averaging time of {m[-1]} samples does not go into a record of {samples}: the {_NAMES[kind]} variance spans "
            f"{SPAN[kind]} of them, so {longest} is the longest."
        )
    return m


def _terms(kind: str, samples: int, factors: Ints) -> Ints:
    """Differences that a record holds."""
    return np.asarray(samples + SUMMED[kind] - SPAN[kind] * factors, dtype=np.int64)


def divisor(kind: str, factors: Ints) -> Array:
    """What the mean square of the differences is divided by.

    Parameters
    ----------
    kind : str
        One of :data:`KINDS`.
    factors : ndarray of int, shape (k,)
    """
    m = factors.astype(float)
    return 2.0 * m**4 if kind == "modified" else (2.0 if kind == "allan" else 6.0) * m**2


def _workers(values: int) -> int:
    return 1 if values < _SERIAL else os.cpu_count() or 1


def _parts(blocks: int) -> list[tuple[int, int]]:
    return [(b, min(b + _TASK, blocks)) for b in range(0, blocks, _TASK)]


def _survey(y: Array, pool: ThreadPoolExecutor) -> tuple[Array, Array]:
    """Mean of each axis, and how far from it samples lie at most."""
    from ...kernels.allan import survey

    parts = _parts(-(-len(y) // _BLOCK))
    found = np.empty((len(parts), 2, y.shape[1]))
    first = y[0].astype(float)
    list(pool.map(lambda i: survey(y, first, _BLOCK, parts[i][0], parts[i][1], found[i]), range(len(parts))))
    mean, reach = found[:, 0].sum(axis=0) / len(y), found[:, 1].max(axis=0)
    if not np.isfinite(mean).all():
        check_finite(y)
    _check_alive(reach > 0)
    return first + mean, reach + np.abs(mean)


def _sums(y: Array, reference: Array, reach: Array, order: int, pool: ThreadPoolExecutor) -> tuple[Array, Array]:
    """Cumulative sums within blocks and what each block starts from, see :mod:`sagnac.kernels.allan`."""
    from ...kernels.allan import chain_blocks, sum_blocks

    n, axes = y.shape
    blocks = -(-(n + order) // _BLOCK)
    # no sum is longer than the record times its farthest sample. Levels of 2^25 quanta leave room for half the square of the
    # 2^12 points of a block and for 8, the sum of the weights of a third difference, in 53 bits; so do first sums of 2^36
    # quanta for the points, and second sums of 2^49
    most = np.stack([reach, n * reach, 0.5 * float(n) * n * reach])
    quanta = np.exp2(np.ceil(np.log2(most)) - np.array([[25.0], [36.0], [49.0]]))
    local, ends = np.empty((axes, n + order)), np.empty((blocks, 3, axes))

    def add(part: tuple[int, int]) -> None:
        sum_blocks(y, reference, quanta[0], order, _BLOCK, part[0], part[1], local, ends)

    list(pool.map(add, _parts(blocks)))
    starts = np.empty((axes, 5, blocks))
    chain_blocks(ends, _BLOCK, quanta[1:], starts)
    return local, starts
