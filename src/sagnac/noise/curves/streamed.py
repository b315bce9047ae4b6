"""Variances of samples that are not kept: a pyramid of each run, and of the pieces between single losses in it.

While nothing is lost a run goes straight into its pyramids. From the first loss on samples are held, some ten thousand at a time,
the lost ones filled and passed on; pieces between them are told by themselves as well (:mod:`sagnac.noise.curves.bridges`).
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ...errors import DataError
from ...frames import Array
from .allan import Ints, Pyramid, Variances, pooled
from .bridges import SHORT, Added, Losses, Pieces, joined

_HELD = 1 << 15
"""Samples that are held before they are passed on, and of a piece at most."""


@dataclass(frozen=True)
class Streamed:
    """Variances of one axis and kind.

    Attributes
    ----------
    told : tuple of Variances
        Of pieces, and of runs without a loss.
    across : tuple of Variances
        Of all runs, lost samples filled.
    added : Added
    refused : DataError or None
        Of the first run that shows no noise.
    """

    told: tuple[Variances, ...]
    across: tuple[Variances, ...]
    added: Added
    refused: DataError | None

    def result(self, given: Losses) -> Variances:
        """The variances, with the losses bridged if they are few.

        Parameters
        ----------
        given : Losses

        Raises
        ------
        DataError
            When the samples of a run are all the same.
        """
        if self.refused is not None:
            raise self.refused
        return joined(pooled(self.told), pooled(self.across) if self.across else None, self.added, given)


@dataclass
class _Held:
    """Rows that wait: the end of the last piece that was passed on, and what came since."""

    parts: list[Array]
    lengths: list[int]
    lost: list[int]
    passed: int
    rows: int = 0


class Stream:
    """Takes samples and losses one after the other.

    Parameters
    ----------
    interval : float, s
    axes : int
    kinds : sequence of str
        See :data:`sagnac.noise.curves.allan.KINDS`.
    per_octave : int
    shortest : int
        Samples of a run that is worth taking.
    """

    def __init__(self, interval: float, axes: int, kinds: Sequence[str], *, per_octave: int, shortest: int) -> None:
        self._interval, self._axes, self._kinds, self._per_octave = interval, axes, tuple(kinds), per_octave
        self._shortest = shortest
        self._pieces = {k: Pieces(k, axes, "pyramid", per_octave=per_octave, most=2 * _HELD + SHORT) for k in kinds}
        self._told: dict[str, list[list[Variances]]] = {k: [[] for _ in range(axes)] for k in kinds}
        self._across: dict[str, list[list[Variances]]] = {k: [[] for _ in range(axes)] for k in kinds}
        self._refused: dict[str, list[DataError | None]] = {k: [None] * axes for k in kinds}
        self._added = [Added() for _ in range(axes)]
        self._begin()

    def _begin(self) -> None:
        """A new run."""
        self._pyramids: dict[str, list[Pyramid]] = {}
        self._tail = np.zeros((0, self._axes))
        self._held: _Held | None = None
        self._count = 0

    def add(self, values: Array) -> None:
        """Take in the next samples.

        Parameters
        ----------
        values : ndarray, shape (n, axes)
        """
        for i in range(0, len(values), _HELD):  # what is held stays small, however much comes at once
            self._add(values[i : i + _HELD])

    def _add(self, values: Array) -> None:
        self._count += len(values)
        if self._held is None:
            self._feed([values[:, k] for k in range(self._axes)])
            self._tail = (
                np.concatenate([self._tail, values])[-SHORT:] if len(values) < SHORT else values[-SHORT:].copy()
            )
            return
        held = self._held
        held.parts.append(values)
        held.lengths[-1] += len(values)
        held.rows += len(values)
        if held.rows >= _HELD:
            self._pass(held, last=False)

    def loss(self, lost: int) -> None:
        """So many samples are missing here, few enough to be filled."""
        if self._held is None:
            for kind in self._kinds:
                for k in range(self._axes):
                    self._take(self._told, kind, k)
            self._held = _Held([self._tail], [len(self._tail)], [], len(self._tail))
        self._held.lost.append(lost)
        self._held.lengths.append(0)

    def gap(self) -> None:
        """The run is over."""
        held = self._held
        if held is not None:
            self._pass(held, last=True)
        if self._count >= self._shortest:
            for kind in self._kinds:
                for k in range(self._axes):
                    error = self._take(self._across, kind, k)
                    self._refused[kind][k] = self._refused[kind][k] or error
                    if held is None:
                        self._take(self._told, kind, k)
            for k in range(self._axes):
                self._added[k].over(self._pyramids[self._kinds[0]][k].samples)
        self._begin()

    def done(self) -> dict[str, list[Streamed]]:
        """Of each kind and axis, when all samples were taken in."""
        self.gap()
        out: dict[str, list[Streamed]] = {}
        for kind in self._kinds:
            out[kind] = []
            for k in range(self._axes):
                short = self._pieces[kind].result(k, self._interval)
                told = (*self._told[kind][k], *([] if short is None else [short]))
                out[kind].append(Streamed(told, tuple(self._across[kind][k]), self._added[k], self._refused[kind][k]))
        return out

    def _take(self, into: dict[str, list[list[Variances]]], kind: str, axis: int) -> DataError | None:
        try:
            into[kind][axis].append(self._pyramids[kind][axis].result())
        except DataError as error:  # too few, or all the same
            return error
        return None

    def _feed(self, columns: Sequence[Array]) -> None:
        if not self._pyramids:
            self._pyramids = {
                kind: [Pyramid(self._interval, 1, kind, per_octave=self._per_octave) for _ in columns]
                for kind in self._kinds
            }
        with ThreadPoolExecutor() as pool:
            for own in self._pyramids.values():
                list(pool.map(lambda p, column: p.add(np.ascontiguousarray(column)), own, columns))

    def _pass(self, held: _Held, *, last: bool) -> None:
        """Fill what was lost and pass on; the last piece, while it is short, waits with the loss before it."""
        waits = not last and held.lengths[-1] < SHORT and len(held.lengths) > 1
        whole = len(held.lengths) - waits
        lengths = np.array(held.lengths[:whole], dtype=np.int64)
        lost = np.array(held.lost[: whole - 1], dtype=np.int64)
        rows, until = np.concatenate(held.parts), int(lengths.sum())
        own: Ints = lengths.copy()
        own[0] -= held.passed

        def fill(k: int) -> Array:
            column = np.ascontiguousarray(rows[:until, k])
            for pieces in self._pieces.values():
                pieces.add(k, column[held.passed :], own)
            return self._added[k].fill(column, lengths, lost)[held.passed :]

        with ThreadPoolExecutor() as pool:
            filled = list(pool.map(fill, range(self._axes)))
        self._feed(filled)
        kept = min(int(lengths[-1]), SHORT)
        held.parts = [rows[until - kept :].copy()]
        held.lengths, held.lost = [kept, *held.lengths[whole:]], held.lost[whole - 1 :]
        held.passed, held.rows = kept, len(rows) - until
