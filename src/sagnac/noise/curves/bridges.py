"""Logs that lost single samples: short averaging times between the losses, long ones across them.

A log that loses one sample in a hundred is cut into pieces of a hundred samples. Short averaging times are told by these alone,
exactly. In longer ones a lost sample hardly counts: it is filled with the mean of its neighbours, which carries what is slow over
to it. To the variance of a long mean this adds what white noise of a known size would (the error of a filled sample is nearly
independent of the sum of its neighbours: exactly so in white noise, but for means that end right there, which is taken into
account). The size is tried out on the log itself, at places where nothing is lost, whatever its noise is, and what it
adds is subtracted. Averaging times at which that is more than a part of what is left are not told across losses: so it is with
pulses, of which a lost sample takes the angle along.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...frames import Array
from .allan import SPAN, SUMMED, Ints, Variances, divisor, largest_step, octaves, pooled, pyramid_factors, variances

SHORT = 64
"""Samples in a row that may be lost and bridged."""
MOST = 0.05
"""Share of the samples that may be lost and bridged."""
LEAST = 8
"""Samples of a piece that tells anything by itself."""
NEAR = 4
"""Neighbours at each side that a lost sample is filled from, if no more are lost with it."""
PIECE = 1 << 12
"""Samples of a piece up to which it goes together with others."""

_AGAINST = 8.0  # times the usual length of a loss, and
_BEGIN = 32  # samples, from which an averaging time is long against it
_ADDED = 0.2  # share that losses may have added to a variance
_SLOPES = {"allan": 3.0 / 2.0, "hadamard": 10.0 / 6.0, "modified": 0.0}  # of the overlap of a difference with itself


@dataclass(frozen=True)
class Losses:
    """Samples that were lost a few at a time.

    Attributes
    ----------
    lost, places : int
        Samples, and places they were lost at.
    longest : int
        Samples lost at one place at most.
    share : float
        Of all samples that there would be.
    usual : float
        Samples lost at the place of a lost sample, in the mean over these.
    """

    lost: int
    places: int
    longest: int
    share: float
    usual: float

    @property
    def bridged(self) -> bool:
        """Whether they are few enough."""
        return self.places > 0 and self.share <= MOST

    @property
    def begin(self) -> int:
        """Averaging factor from which on they are bridged."""
        return math.ceil(max(_BEGIN, _AGAINST * self.usual, 2 * self.longest))


def losses(lost: Sequence[int], samples: int) -> Losses:
    """What was lost.

    Parameters
    ----------
    lost : sequence of int
        At each place.
    samples : int
        That are there.
    """
    each = np.asarray(lost, dtype=float)
    total = float(each.sum())
    usual = float(each @ each) / total if total else 0.0
    return Losses(int(total), each.size, int(each.max(initial=0.0)), total / max(samples + total, 1.0), usual)


@dataclass(frozen=True)
class Run:
    """Samples of one axis between long gaps.

    Attributes
    ----------
    values : ndarray, shape (n,)
        Those that are there.
    lengths : ndarray of int, shape (k,)
        Of the pieces between the losses.
    lost : ndarray of int, shape (k - 1,)
    """

    values: Array
    lengths: Ints
    lost: Ints


class Added:
    """What filling adds to the variances of one axis."""

    def __init__(self) -> None:
        self._sums = np.zeros(4)
        self._samples = 0

    def fill(self, values: Array, lengths: Ints, lost: Ints) -> Array:
        """Samples with the lost ones filled.

        Parameters
        ----------
        values, lengths, lost : ndarray
            See :class:`Run`.
        """
        from ...kernels.bridges import fill_lost

        out = np.empty(values.size + int(lost.sum()))
        fill_lost(values, lengths, lost, NEAR, out, self._sums)
        return out

    def over(self, samples: int) -> None:
        """Count the samples of a run, filled ones too."""
        self._samples += samples

    def at(self, kind: str, factors: Ints) -> Array:
        """Variance that is added at averaging factors, shape (k,)."""
        all_, tried, found, near = self._sums
        if not tried > 0.0:
            return np.full(factors.size, 0.0 if all_ == 0.0 else np.inf)
        m = factors.astype(float)
        shape = (m**2 + 1.0) / (2.0 * m**3) if kind == "modified" else (1.0 - _SLOPES[kind] * near / (all_ * m)) / m
        return np.asarray(found * (all_ / tried) / self._samples * shape)


class Pieces:
    """Variances within short pieces of a log, of all its axes.

    Parameters
    ----------
    kind : str
        One of :data:`sagnac.noise.curves.allan.KINDS`.
    axes : int
    method : str
        ``exact`` or ``pyramid``: at which averaging times all differences count.
    per_octave : int
    most : int
        Samples of a piece at most.
    """

    def __init__(self, kind: str, axes: int, method: str, *, per_octave: int, most: int = PIECE) -> None:
        self._kind, self._method, self._most = kind, method, most
        self._factors = (pyramid_factors if method == "pyramid" else octaves)(most, kind, per_octave=per_octave)
        steps = [largest_step(m) if method == "pyramid" else 1 for m in self._factors.tolist()]
        self._steps = np.array(steps, dtype=np.int64)
        self._sums = np.zeros((axes, self._factors.size))
        self._lengths: Counter[int] = Counter()

    def add(self, axis: int, values: Array, lengths: Ints) -> None:
        """Take in the pieces of one axis.

        Parameters
        ----------
        axis : int
            Lengths are those of all axes, and counted with the first.
        values, lengths : ndarray
            See :class:`Run`. Pieces that are too short or too long are left out.
        """
        from ...kernels.bridges import add_pieces

        add_pieces(
            values, lengths, LEAST, self._most, SPAN[self._kind], SUMMED[self._kind], self._factors, self._steps,
            self._sums[axis],
        )  # fmt: skip
        if axis == 0:
            self._lengths.update(lengths[(lengths >= LEAST) & (lengths <= self._most)].tolist())

    def result(self, axis: int, interval: float) -> Variances | None:
        """Variances of one axis, None where there were no pieces."""
        if not self._lengths:
            return None
        lengths = np.array(sorted(self._lengths))
        often = np.array([self._lengths[n] for n in lengths.tolist()])
        span = SPAN[self._kind]
        terms = lengths[:, None] + SUMMED[self._kind] - span * self._factors
        inside = 2 * span * self._factors <= lengths[:, None]
        counts = often[:, None] * np.where(inside, -(-terms // self._steps), 0)
        # pieces of nearly equal lengths that reach the same averaging times stand together
        group = np.stack([np.floor(4.0 * np.log2(lengths)).astype(np.int64), inside.sum(axis=1)])
        _, at = np.unique(group, axis=1, return_inverse=True)
        at = at.ravel()
        stretches, alike = [], []
        reach = int(inside.any(axis=0).sum())
        for g in range(int(at.max()) + 1):
            own = at == g
            alike.append(int(often[own].sum()))
            mean = round(float(often[own] @ lengths[own]) / alike[-1])
            stretches.append((mean, counts[own].sum(axis=0)[:reach]))
        factors, count = self._factors[:reach], counts.sum(axis=0)[:reach]
        variance = self._sums[axis, :reach] / (count * divisor(self._kind, factors))
        samples = int(often @ lengths)
        return Variances(
            self._kind,
            interval,
            samples,
            factors,
            variance[:, None],
            count,
            self._method,
            tuple(stretches),
            tuple(alike),
        )


def joined(told: Variances, across: Variances | None, added: Added, given: Losses) -> Variances:
    """Variances of pieces for short averaging times, of the log with its losses filled for long ones.

    Parameters
    ----------
    told : Variances
        Of the pieces, one axis.
    across : Variances or None
        Of the same log, the lost samples filled.
    added : Added
    given : Losses
    """
    if across is None or not given.bridged:
        return told
    extra = added.at(across.kind, across.factors)[:, None]
    clean = across.variance - extra
    good = (across.factors >= given.begin) & (extra <= _ADDED * clean).all(axis=1)
    kept = ~np.isin(told.factors, across.factors[good])
    if not good.any():
        return told
    factors = np.concatenate([told.factors[kept], across.factors[good]])
    order = np.argsort(factors)
    none_told, none_across = np.zeros(int(kept.sum()), dtype=np.int64), np.zeros(int(good.sum()), dtype=np.int64)
    stretches = [(n, np.concatenate([c[kept], none_across])[order]) for n, c in _parts(told)]
    # a filled sample tells nothing: the samples that are there are those of the degrees of freedom
    there = 1.0 - given.share
    stretches += [(round(n * there), np.concatenate([none_told, c[good]])[order]) for n, c in _parts(across)]
    return Variances(
        told.kind,
        told.interval,
        max(told.samples, round(across.samples * there)),
        factors[order],
        np.concatenate([told.variance[kept], clean[good]])[order],
        np.concatenate([told.count[kept], across.count[good]])[order],
        told.method,
        tuple(stretches),
        (*_often(told), *_often(across)),
    )


def _parts(v: Variances) -> Sequence[tuple[int, Ints]]:
    return v.stretches or ((v.samples, v.count),)


def _often(v: Variances) -> tuple[int, ...]:
    return v.often or (1,) * len(_parts(v))


def of_runs(runs: Sequence[Run], interval: float, kind: str, given: Losses, *, per_octave: int) -> Variances:
    """Variances of one axis, every difference counted.

    Parameters
    ----------
    runs : sequence of Run
    interval : float, s
    kind : str
        One of :data:`sagnac.noise.curves.allan.KINDS`.
    given : Losses
    per_octave : int

    Raises
    ------
    DataError
        When the samples of a run are all the same.
    """
    pieces, added = Pieces(kind, 1, "exact", per_octave=per_octave), Added()
    told: list[Variances] = []
    across: list[Variances] = []
    for run in runs:
        if run.lengths.size == 1:
            found = variances(run.values, interval, octaves(run.values.size, kind, per_octave=per_octave), kind)
            told.append(found)
            across.append(found)
            added.over(run.values.size)
            continue
        pieces.add(0, run.values, run.lengths)
        ends = np.cumsum(run.lengths)
        for n, end in zip(run.lengths.tolist(), ends.tolist(), strict=True):
            if n > PIECE:
                told.append(
                    variances(run.values[end - n : end], interval, octaves(n, kind, per_octave=per_octave), kind)
                )
        if given.bridged:
            values = added.fill(run.values, run.lengths, run.lost)
            added.over(values.size)
            factors = octaves(values.size, kind, per_octave=per_octave)
            if factors[-1] >= given.begin:
                across.append(variances(values, interval, factors[factors >= given.begin], kind))
    short = pieces.result(0, interval)
    told += [] if short is None else [short]
    return joined(pooled(told), pooled(across) if across else None, added, given)
