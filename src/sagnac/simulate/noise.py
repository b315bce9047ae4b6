"""Noise of one axis, drawn sample by sample from streams of its own.

White noise of density N has N^2 / dt per sample. What wanders slowly is a sum of processes ::

    x_k = decay x_(k-1) + step z_k,   z_k standard normal,

that are exact at every sample: a random walk (decay one) and first-order Gauss-Markov processes. Bias instability, flicker
noise of spectrum B^2 / (2 pi f) (two-sided, IEEE Std 952, annex C), is a sum of Gauss-Markov processes with correlation times
in geometric progression over a stated band.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..frames import Array

_RATIO = 5.0
"""Largest ratio of neighbouring correlation times of flicker noise; the spectrum ripples by 0.9 % (2 sech(pi^2 / ln 5))."""


@dataclass(frozen=True)
class Process:
    """One slow process, ``x_k = decay x_(k-1) + step z_k``.

    Attributes
    ----------
    decay : float
    step : float
        In the unit of the readings.
    spread : float
        Standard deviation before the first sample.
    """

    decay: float
    step: float
    spread: float


@dataclass(frozen=True)
class NoiseModel:
    """Noise of the axes of one kind of sensor, SI.

    Attributes
    ----------
    density : float
        Of white noise, per sqrt(Hz): a mean over T seconds has density^2 / T.
    instability : float
        B of IEEE Std 952; the Allan deviation is flat at ``sqrt(2 ln 2 / pi) B`` = 0.664 B in the band.
    band : tuple of float, s
        Shortest and longest correlation time of the bias instability.
    walk : float
        Of the bias, per sqrt(s): its change over T seconds has walk^2 T.
    markov : tuple of (float, float)
        Standard deviation and correlation time [s] of further Gauss-Markov processes.
    """

    density: float = 0.0
    instability: float = 0.0
    band: tuple[float, float] = (10.0, 3000.0)
    walk: float = 0.0
    markov: tuple[tuple[float, float], ...] = ()

    def processes(self, interval: float) -> tuple[Process, ...]:
        """The slow ones, for samples `interval` seconds apart."""
        out = [gauss_markov(size, time, interval) for size, time in self.markov if size > 0]
        if self.instability > 0:
            out += flicker(self.instability, self.band, interval)
        if self.walk > 0:
            out.append(Process(1.0, self.walk * math.sqrt(interval), 0.0))
        return tuple(out)


NO_NOISE = NoiseModel()


def gauss_markov(size: float, time: float, interval: float) -> Process:
    """First-order Gauss-Markov process in its steady state.

    Parameters
    ----------
    size : float
        Standard deviation.
    time, interval : float, s
        Correlation time; from sample to sample.
    """
    return Process(math.exp(-interval / time), size * math.sqrt(-math.expm1(-2.0 * interval / time)), size)


def flicker(instability: float, band: tuple[float, float], interval: float) -> list[Process]:
    """Flicker noise over a band of correlation times.

    A process of variance s^2 and correlation time t has the spectrum 2 s^2 t / (1 + (2 pi f t)^2); with equal variances and
    1 / ln(r) of them in each factor e of the correlation time their sum is s^2 / (2 f ln(r)), so that s^2 = B^2 ln(r) / pi.

    Parameters
    ----------
    instability : float
        B.
    band : tuple of float, s
        Shortest and longest correlation time.
    interval : float, s
    """
    shortest, longest = band
    gaps = max(1, math.ceil(math.log(longest / shortest) / math.log(_RATIO)))
    ratio = (longest / shortest) ** (1.0 / gaps)
    size = instability * math.sqrt(math.log(ratio) / math.pi)
    return [gauss_markov(size, shortest * ratio**i, interval) for i in range(gaps + 1)]


def generator(seed: int, *stream: int) -> np.random.Generator:
    """A stream of random numbers of its own.

    Parameters
    ----------
    seed : int
    stream : int
        Which one; streams of different numbers are independent, and none changes when another is used more.
    """
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=stream)))


class AxisNoise:
    """Noise of one axis, continued from call to call; the sum does not depend on how the samples are parted.

    Parameters
    ----------
    model : NoiseModel
    interval : float, s
        From sample to sample.
    seed : int
    stream : tuple of int
        Of this axis.
    """

    def __init__(self, model: NoiseModel, interval: float, seed: int, stream: tuple[int, ...]) -> None:
        self._white = model.density / math.sqrt(interval)
        self._processes = model.processes(interval)
        streams = [generator(seed, *stream, i) for i in range(1 + len(self._processes))]
        self._first, self._others = streams[0], streams[1:]
        self._states = [
            p.spread * float(g.standard_normal()) for p, g in zip(self._processes, self._others, strict=True)
        ]

    def add(self, values: Array) -> None:
        """Add noise to samples, shape (n,), in place."""
        normals = np.empty_like(values)
        if self._white > 0:
            self._first.standard_normal(out=normals)
            normals *= self._white
            values += normals
        if not self._processes:
            return
        from ..kernels.simulation import wander

        for i, (process, stream) in enumerate(zip(self._processes, self._others, strict=True)):
            stream.standard_normal(out=normals)
            self._states[i] = wander(self._states[i], process.decay, process.step, normals, values)
