"""Monte Carlo of a transfer alignment: does the filter know as much as it says, over many runs of the whole chain.

Every run has a slave of its own, with a mounting, biases, a first velocity error and noise drawn from what the
configuration states. It navigates from its samples, is matched with the master's noisy velocity at each update, and the
estimated errors are taken out of it. True errors stand against the filter's covariance in the filter's own
definitions::

    dv = v~ - v,   phi = -log(C~ C'),   eps, nab: what is left of the biases,   dal = al~ - al

each in the slave's and the true wander frame (method "wander"), or each in its own east, north, up (method
"geographic", ``Phi = -log((C_w_g~ C~) (C_w_g C)')``, no dal).

The short model takes the position for known. Feedback makes that true: the slave's velocity error lasts for a second or
two, its position error stays at a metre or less, and what that does to the Earth's rate is less than a ten thousandth
of the gyro biases. In a slave that is not corrected the position would drift away, and the model would drift with it.

The attitude is corrected by a rotation, ``exp([phi^ x])``, and the covariance is turned with it, because an error
``phi^ + d`` leaves ``Jl(phi^) d`` and not d. Second-order effects that remain do not show with mountings of 0.2 deg in
level and 0.5 deg in azimuth (NEES inside its band with 16000 runs, with turns and without). They do with larger ones:
on a straight course NEES of 11 states, 30 s after the start, is 11.5 with three times as much, 13.3 with six times, 17
with ten times (without the turn of the covariance 11.8, 15.1, 24). For still larger ones there is
:mod:`sagnac.align.large`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...errors import InputError
from ...frames import Array
from .chain import Chain, Group

if TYPE_CHECKING:
    from ..config import Config

_CONFIDENCE = 0.95
_BLOCK = 64  # groups of runs whose errors are computed at a time
_SEEN = 1e-12  # of the largest: smaller eigenvalues of a correlation matrix belong to what is known exactly
_COLUMNS = ("velocity x [m/s]", "level x [arcmin]", "level y [arcmin]", "azimuth [arcmin]")
_BANDS = f"  {'NEES':>7} {'95 % band':>13}  {'NIS':>7} {'95 % band':>13}"
_MARKS = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0)


@dataclass(frozen=True)
class MonteCarlo:
    """What many runs of an alignment came to, at m times.

    Attributes
    ----------
    method : str
        ``wander`` or ``geographic``.
    names, units : tuple of str, length n
        Of the states.
    runs, seed : int
    time : ndarray, shape (m,), s
    mean, rms : ndarray, shape (m, n), SI
        Of the true errors over the runs.
    sigma : ndarray, shape (m, n), SI
        What the filters say: root of the mean of their variances.
    nees : ndarray, shape (m,)
        Normalised estimation error squared, mean over the runs; expected is the number of states not known exactly.
    nees_band : ndarray, shape (m, 2)
        In which it lies with a probability of 95 %.
    nis : ndarray, shape (m,)
        Normalised innovation squared, mean over the runs and the updates since the time before; expected are 2.
    nis_band : ndarray, shape (m, 2)
    drift : ndarray, shape (m,), m
        Root mean square over the runs of the horizontal position error, which the model takes for zero.
    errors : ndarray, shape (m, runs, n), or None
        The true errors themselves, if they were asked for.
    """

    method: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    runs: int
    seed: int
    time: Array
    mean: Array
    rms: Array
    sigma: Array
    nees: Array
    nees_band: Array
    nis: Array
    nis_band: Array
    drift: Array
    errors: Array | None = None

    @property
    def ratio(self) -> Array:
        """RMS error over sigma, shape (m, n); one where the filter is honest, give or take ``1 / sqrt(2 runs)``."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.rms / self.sigma)

    def to_dict(self) -> dict[str, Any]:
        """A plain table for JSON, without the errors of single runs."""
        names = ("time", "mean", "rms", "sigma", "nees", "nees_band", "nis", "nis_band", "drift")
        table = {name: getattr(self, name).tolist() for name in names}
        same = {name: getattr(self, name) for name in ("method", "runs", "seed")}
        return {**same, "names": list(self.names), "units": list(self.units), **table}

    def summary(self) -> str:
        """Text for a person: errors over time, then every state at the end."""
        arcmin = 10800.0 / math.pi
        lines = [
            f"{self.runs} runs, {self.method} form, seed {self.seed}: RMS error / sigma of the filter",
            f"{'time [s]':>9}" + "".join(f"  {h:>19}" for h in _COLUMNS) + _BANDS,
        ]
        for k, time in enumerate(self.time):
            pairs = [f"{self.rms[k, 0]:.3g} / {self.sigma[k, 0]:.3g}"]
            pairs += [f"{arcmin * self.rms[k, i]:.4g} / {arcmin * self.sigma[k, i]:.4g}" for i in (2, 3, 4)]
            (low, high), (least, most) = self.nees_band[k], self.nis_band[k]
            lines.append(
                f"{time:>9.6g}"
                + "".join(f"  {pair:>19}" for pair in pairs)
                + f"  {self.nees[k]:>7.2f} {f'{low:.2f}..{high:.2f}':>13}"
                + f"  {self.nis[k]:>7.3f} {f'{least:.3f}..{most:.3f}':>13}"
            )
        lines.append(f"at {self.time[-1]:g} s:")
        for i, name in enumerate(self.names):
            found = f"RMS {self.rms[-1, i]:.4g}, sigma {self.sigma[-1, i]:.4g} {self.units[i]}"
            lines.append(f"  {name:<18} {found}, ratio {self.ratio[-1, i]:.3f}")
        inside = int(np.sum((self.nees >= self.nees_band[:, 0]) & (self.nees <= self.nees_band[:, 1])))
        lines.append(
            f"NEES is inside its band at {inside} of {self.time.size} times; position error {self.drift[-1]:.2g} m"
        )
        return "\n".join(lines)


def monte_carlo(
    config: Config,
    *,
    runs: int = 1000,
    seed: int = 0,
    frequency: float = 100.0,
    times: Sequence[float] | None = None,
    drawn: Config | None = None,
    threads: int | None = None,
    keep: bool = False,
    progress: Callable[[float], object] | None = None,
) -> MonteCarlo:
    """Many runs of a transfer alignment along the course of a configuration, with velocity matching and feedback.

    Parameters
    ----------
    config : Config
        With ``[trajectory]``. Method ``wander`` or ``geographic``, short form, velocity matching, no lever arm. There
        is no gate, the master is in time, slaves navigate with groups of two samples, and their height is the master's.
    runs : int
    seed : int
        What a run draws depends on the seed and on its own number only.
    frequency : float, Hz
        Of the slaves' samples; a whole number of them makes an update interval.
    times : sequence of float, s, optional
        When errors are compared, rounded to the nearest update; some from a second to the end of the course unless
        given.
    drawn : Config, optional
        Draw initial errors and noise from this configuration instead: what if the filter is told wrong?
    threads : int, optional
        One for each core unless given. The result does not depend on it.
    keep : bool
        Keep the errors of all runs at all times.
    progress : callable, optional
        Called with the part that is done, from 0 to 1.

    Returns
    -------
    MonteCarlo

    Raises
    ------
    InputError
        When the configuration asks for what these runs do not do, or times, rates or numbers do not go together.
    """
    if runs < 2:
        raise InputError(f"runs: {runs}; statistics need two runs or more")
    chain = Chain.of(config, config if drawn is None else drawn, frequency)
    if times is None:
        times = [*(t for t in _MARKS if t < chain.duration), chain.duration]
    marks = chain.marks(times)
    groups = chain.start(runs, seed)
    tally = _Tally(chain, runs, keep)
    with ThreadPoolExecutor(min(threads or os.cpu_count() or 1, len(groups))) as pool:
        for piece in chain.pieces(marks):
            waiting = [pool.submit(chain.advance, group, piece) for group in groups]
            for future in waiting:
                future.result()
            if piece.update in marks:
                tally.take(groups, piece.update)
            if progress is not None:
                progress(piece.update / marks[-1])
    return tally.result(config.method, seed)


class _Row(NamedTuple):
    """Statistics at one time."""

    time: float
    mean: Array
    rms: Array
    sigma: Array
    nees: float
    nees_band: Array
    nis: float
    nis_band: Array
    drift: float


class _Tally:
    """Statistics of the runs, time by time."""

    def __init__(self, chain: Chain, runs: int, keep: bool) -> None:
        self._chain, self._runs = chain, runs
        self._rows: list[_Row] = []
        self._errors: list[Array] | None = [] if keep else None
        self._last = 0

    def take(self, groups: Sequence[Group], update: int) -> None:
        """Compare all runs with the truth after an update."""
        chain, runs = self._chain, self._runs
        truth = chain.truth(update)
        errors, variances, squares, ranks, drift = [], [], [], [], []
        for i in range(0, len(groups), _BLOCK):
            error, P, aside = chain.compare(groups[i : i + _BLOCK], truth)
            square, rank = _weighted(error, P)
            errors.append(error)
            variances.append(np.einsum("...ii->...i", P))
            squares.append(square)
            ranks.append(rank)
            drift.append(aside)
        error, variance = np.concatenate(errors)[:runs], np.concatenate(variances)[:runs]
        nis = np.concatenate([g.nis for g in groups])[:runs]
        for group in groups:
            group.nis[:] = 0.0
        passed = update - self._last
        degrees = float(np.concatenate(ranks)[:runs].sum())
        self._last = update
        self._rows.append(
            _Row(
                update * chain.interval,
                error.mean(axis=0),
                np.sqrt((error**2).mean(axis=0)),
                np.sqrt(variance.mean(axis=0)),
                float(np.concatenate(squares)[:runs].mean()),
                _interval(degrees, runs),
                float(nis.mean()) / passed,
                _interval(2.0 * runs * passed, runs * passed),
                float(np.sqrt((np.concatenate(drift)[:runs] ** 2).mean())),
            )
        )
        if self._errors is not None:
            self._errors.append(error)

    def result(self, method: str, seed: int) -> MonteCarlo:
        """All of it."""
        columns = {name: np.array([getattr(row, name) for row in self._rows]) for name in _Row._fields}
        return MonteCarlo(
            method=method,
            names=self._chain.names,
            units=self._chain.units,
            runs=self._runs,
            seed=seed,
            errors=None if self._errors is None else np.array(self._errors),
            **columns,
        )


def _weighted(error: Array, P: Array) -> tuple[Array, Array]:
    """``e' P^-1 e`` of each run, (k,), and the rank of its P; what is known exactly does not count.

    Parameters
    ----------
    error : ndarray, shape (k, n)
    P : ndarray, shape (k, n, n)
    """
    sigma = np.sqrt(np.einsum("...ii->...i", P))
    size = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(P / (size[:, :, None] * size[:, None, :]))
    along = np.einsum("kij,ki->kj", vectors, error / size)
    seen = values > _SEEN * values[:, -1:]
    return np.asarray(np.where(seen, along**2 / np.where(seen, values, 1.0), 0.0).sum(axis=1)), seen.sum(axis=1)


def _interval(degrees: float, count: int) -> Array:
    """In which a chi-square over a count lies with the probability of the bands, shape (2,)."""
    from scipy.stats import chi2

    return np.asarray(chi2.ppf([0.5 - 0.5 * _CONFIDENCE, 0.5 + 0.5 * _CONFIDENCE], degrees) / count)
