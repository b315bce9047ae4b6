"""Whitened residuals of both stages of a roll-isolated rig, from a pass over the recording each time.

The rows of each sixteenth of a segment (:mod:`.rows`, :mod:`.spin`) are reduced by QR to as many as there are
parameters in them, which leaves estimate and covariance as they are; what is left over judges the noise. Memory does not grow
with the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ...estimate import Rows
from ...frames import Array
from ...observe.rolling import windows
from ...observe.sums import BLOCKS
from ...plan import Segment
from ...recording import Recording
from ..slow import SlowNoise
from . import wander
from .rows import Channel, Noise, Piece, inner_rows
from .spin import Run, spin_rows

_SEEN = 1e-9
"""Singular value, relative to the largest, from which a direction counts as seen in a block."""


@dataclass
class _Block:
    """Triangular factor of the rows of one channel in one part of a segment."""

    columns: NDArray[np.intp]
    factor: Array
    count: int = 0
    rough: Array | None = None
    """Products of the differences of the derivatives from sample to sample, where they are asked for, and their number."""
    pairs: int = 0

    def add(self, rows: Array) -> None:
        """Take in rows, shape (k + 1, n)."""
        if self.rough is not None:
            steps = np.diff(rows[:-1], axis=1)
            self.rough += steps @ steps.T
            self.pairs += steps.shape[1]
        self.factor = np.asarray(np.linalg.qr(np.vstack([self.factor, rows.T]), mode="r"))
        self.count += rows.shape[1]

    def reduced(self) -> tuple[Array, Array, float, int]:
        """As many rows as there are directions that the block sees: derivatives, residuals; and what is left over.

        Returns
        -------
        derivatives : ndarray, shape (m, k)
        residuals : ndarray, shape (m,)
        squares, freedom : float, int
            Of the residuals that no parameter moves.
        """
        k = self.columns.size
        size = np.maximum(np.linalg.norm(self.factor[:, :k], axis=0), 1e-300)
        left, values, right = np.linalg.svd(self.factor[:, :k] / size)
        m = int(np.count_nonzero(values > _SEEN * values[0]))
        residual = left.T @ self.factor[:, k]
        rows = values[:m, None] * right[:m] * size
        return rows, residual[:m], float(residual[m:] @ residual[m:]), self.count - m


@dataclass
class RollModel:
    """Rows for the estimator.

    Attributes
    ----------
    recording : Recording
    segments : tuple of Segment
    names : tuple of str
        Of the parameters; those that are not among them are taken from `fixed`, or zero.
    fixed : mapping of str to float
    noise : Noise
    interval : float, s
    half : int
    steady : mapping of str to float
        Segments in which the cylinder does not swing enough to tell motion from noise, and their mean gyro x, rad/s.
    repeated : mapping of str to float
        How many times over the variance of a reading counts in a segment, because its rounding repeats itself.
    blocks : int
        Parts that each segment is judged by.
    slow : SlowNoise, optional
        Of the gyros; the biases are then among the parameters.
    further : callable, optional
        Takes a :class:`Piece`, gives further columns of its channels: names, and rows without residual.
    """

    recording: Recording
    segments: tuple[Segment, ...]
    names: tuple[str, ...]
    fixed: Mapping[str, float]
    noise: Noise
    interval: float
    half: int
    steady: Mapping[str, float]
    repeated: Mapping[str, float]
    blocks: int = BLOCKS
    further: Callable[[Piece], Mapping[str, Channel]] | None = None
    slow: SlowNoise | None = None
    _left: dict[str, tuple[float, int]] = field(default_factory=dict)

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts of segments, which the rows point into."""
        return tuple(f"{s.name} part {i + 1}" for s in self.segments for i in range(self.blocks))

    def with_noise(self, noise: Noise) -> RollModel:
        """The same for other noise."""
        return replace(self, noise=noise, _left={})

    def values(self, x: Array) -> dict[str, float]:
        """Parameters by name."""
        return {**self.fixed, **dict(zip(self.names, map(float, x), strict=True))}

    def rows(self, x: Array) -> Rows:
        """Whitened residuals at a parameter vector, reduced; see :class:`sagnac.estimate.Rows`."""
        blocks: dict[tuple[int, str], _Block] = {}
        for piece in self.pieces(self.values(x)):
            s = self.segments[piece.segment]
            part = ((piece.time - s.start) / (s.stop - s.start) * self.blocks).astype(int)
            edges = np.searchsorted(np.clip(part, 0, self.blocks - 1), np.arange(self.blocks + 1))
            for channel, (names, values) in self._widened(piece).items():
                known = [i for i, n in enumerate(names) if n in self.names]
                columns = np.array([self.names.index(names[i]) for i in known])
                for b in np.flatnonzero(np.diff(edges)):
                    block = blocks.setdefault(
                        (piece.segment * self.blocks + int(b), channel),
                        self._empty(columns),
                    )
                    block.add(values[[*known, -1], edges[b] : edges[b + 1]])
        return self._gather(blocks)

    def _empty(self, columns: NDArray[np.intp]) -> _Block:
        size = columns.size
        return _Block(columns, np.zeros((0, size + 1)), rough=None if self.slow is None else np.zeros((size, size)))

    def _widened(self, piece: Piece) -> dict[str, Channel]:
        more = {} if self.further is None else self.further(piece)
        none = ((), np.zeros((0, piece.time.size)))
        return {
            channel: ((*more.get(channel, none)[0], *names), np.vstack([more.get(channel, none)[1], rows]))
            for channel, (names, rows) in piece.channels.items()
        }

    def left(self) -> dict[str, tuple[float, int]]:
        """Squares and degrees of freedom left over in the last pass, by channel (``x``, ``y``, ``z``, ``encoder``)."""
        return dict(self._left)

    def _gather(self, blocks: Mapping[tuple[int, str], _Block]) -> Rows:
        residual, jacobian, segment = [], [], []
        rest = np.zeros(len(self.parts))
        self._left.clear()
        reduced = {key: block.reduced() for key, block in blocks.items()}
        final = {key: wander.Whitened(rows, seen, 0.0) for key, (rows, seen, _, _) in reduced.items()}
        if self.slow is not None:
            final = self._without_slow(self.slow, blocks, final)
        for (part, channel), block in blocks.items():
            (rows, seen, lost), (_, _, more, further) = final[part, channel], reduced[part, channel]
            wide = np.zeros((len(rows), len(self.names)))
            wide[:, block.columns] = rows
            residual.append(seen)
            jacobian.append(wide)
            segment.append(np.full(len(rows), part))
            squares, dof = self._left.get(channel, (0.0, 0))
            rest[part] += more + lost
            self._left[channel] = (squares + more, dof + further)
        return Rows(np.concatenate(residual), np.vstack(jacobian), np.concatenate(segment), rest)

    def _without_slow(
        self,
        slow: SlowNoise,
        blocks: Mapping[tuple[int, str], _Block],
        reduced: Mapping[tuple[int, str], wander.Whitened],
    ) -> dict[tuple[int, str], wander.Whitened]:
        """Rows whitened for slow noise as well, see :mod:`.wander`."""
        whole = max(s.stop for s in self.segments) - min(s.start for s in self.segments)
        step = float(self.noise.gyro[0]) ** 2 * self.interval
        out: dict[tuple[int, str], wander.Whitened] = {}
        for i, s in enumerate(self.segments):
            rounding = self.noise.encoder * self.repeated.get(s.name, 1.0) / step
            for name in ("x", "y", "z", "encoder"):
                keys = sorted(k for k in blocks if k[0] // self.blocks == i and k[1] == name)
                if not keys:
                    continue
                letter = "x" if name == "encoder" else name
                bias = self.names.index(f"gyro.bias.{letter}")
                channel = wander.Channel(
                    slow,
                    "xyz".index(letter),
                    self.blocks,
                    s.stop - s.start,
                    whole,
                    self.interval,
                    rounding if name == "encoder" else 0.0,
                )
                parts = [self._part(k, blocks[k], reduced[k], bias) for k in keys]
                out |= dict(zip(keys, wander.whitened(channel, parts), strict=True))
        return out

    def _part(self, key: tuple[int, str], block: _Block, own: wander.Whitened, bias: int) -> wander.Reduced:
        assert block.rough is not None  # slow noise asks for it
        column = own.rows[:, block.columns.tolist().index(bias)]
        steps = block.rough * (block.count / max(block.pairs, 1))
        return wander.Reduced(key[0] % self.blocks, own.rows, own.residual, column, steps, block.count)

    def pieces(self, values: Mapping[str, float]) -> Iterator[Piece]:
        """Whitened rows window by window."""
        runs: dict[int, Run] = {}
        for w in windows(self.recording, self.segments, self.interval, self.half):
            segment = self.segments[w.segment]
            run = runs.setdefault(w.segment, Run(float(w.time[w.half])))
            if segment.stage == "spin":
                variance = self.noise.encoder * self.repeated.get(segment.name, 1.0)
                noise = replace(self.noise, encoder=variance)
                yield spin_rows(w, segment, run, values, noise, self.interval, self.steady.get(segment.name))
            else:
                channels = inner_rows(w, segment, run.origin, values, self.noise, self.interval)
                yield Piece(w.segment, w.time[w.centre], channels)
