"""The spectrum of a log that lost single samples: these are filled, so that low frequencies are told as well.

A lost sample becomes the mean of its neighbours. At low frequencies that adds about the share that is lost to the density, at
high ones it takes it off.
"""

from __future__ import annotations

import numpy as np

from ...frames import Array
from .bridges import MOST, NEAR
from .spectrum import Density, SpectrumPass

_HELD = 1 << 12
"""Rows that are worth passing on."""


class FilledSpectrum:
    """Takes samples, losses and gaps one after the other.

    As soon as more is lost than may be bridged (:data:`sagnac.noise.curves.bridges.MOST`), a loss is a gap.

    Parameters
    ----------
    interval : float, s
    axes : int
    """

    def __init__(self, interval: float, axes: int) -> None:
        self._running = SpectrumPass(interval, axes)
        self._tail = np.zeros((0, axes))
        self._held: list[Array] = []
        self._rows = self._samples = self._filled = 0
        self._pending = 0

    def add(self, values: Array) -> None:
        """Take in the next samples.

        Parameters
        ----------
        values : ndarray, shape (n, axes)
        """
        if not len(values):
            return
        reach = max(NEAR, self._pending)
        if self._pending:
            mean = np.concatenate([self._tail[-reach:], values[:reach]]).mean(axis=0)
            self._hold(np.tile(mean, (self._pending, 1)))
            self._pending = 0
        self._samples += len(values)
        self._tail = values[-reach:].copy()
        self._hold(values)

    def loss(self, lost: int) -> None:
        """So many samples are missing here, few enough to be filled.

        Parameters
        ----------
        lost : int
        """
        if self._filled + lost > MOST * (self._samples + self._filled):
            self.gap()
            return
        self._filled += lost
        self._pending += lost

    def gap(self) -> None:
        """What comes next does not follow what came before."""
        self._flush()
        self._pending = 0
        self._running.gap()

    def result(self) -> Density:
        """The density, see :meth:`sagnac.noise.curves.spectrum.SpectrumPass.result`."""
        self._flush()
        return self._running.result()

    def _hold(self, rows: Array) -> None:
        self._held.append(rows)
        self._rows += len(rows)
        if self._rows >= _HELD:
            self._flush()

    def _flush(self) -> None:
        if self._held:
            self._running.add(self._held[0] if len(self._held) == 1 else np.concatenate(self._held))
        self._held, self._rows = [], 0
