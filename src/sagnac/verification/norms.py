"""Misfits of norms: gravity in static segments, Earth rate and the table's in turning ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from ..calibrate import common
from ..calibration import Calibration
from ..errors import DataError
from ..frames import Array
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..rigs.turntable import Site, mean_inputs
from ..sensors import Correction, invert, triad_of


@dataclass(frozen=True)
class Misfits:
    """Misfits of one kind, n of them, k parameters.

    Attributes
    ----------
    kind : str
        ``accel`` and ``gyro``: norms; ``axis``: direction of the rate's axis.
    names : sequence of str
        Segment of each.
    residual : ndarray, shape (n,)
    jacobian : ndarray, shape (n, k)
        Derivative to all parameters of the calibration.
    variance : ndarray, shape (n,)
        Of the noise.
    common : ndarray, shape (n,)
        One-sigma effect of what all segments share: the rate's error, gravity's.
    lever : ndarray, shape (n, 3), or None
        Derivative to a lever arm that the calibration does not hold.
    turn : ndarray, shape (n, 3), or None
        Derivative to a small turn of all gyro axes against the accelerometers.
    """

    kind: str
    names: Sequence[str]
    residual: Array
    jacobian: Array
    variance: Array
    common: Array
    lever: Array | None = None
    turn: Array | None = None

    @classmethod
    def none(cls, kind: str, parameters: int) -> Self:
        """No misfit of this kind.

        Parameters
        ----------
        kind : str
        parameters : int
            k.
        """
        return cls(kind, [], np.zeros(0), np.zeros((0, parameters)), np.zeros(0), np.zeros(0))


def norms(
    kind: str, calibration: Calibration, means: SegmentMeans, plan: Plan, models: dict[str, Correction]
) -> Misfits:
    """Misfits of the norm of gravity in static segments, or of the norm of rate in turning ones.

    Parameters
    ----------
    kind : str
        ``accel`` or ``gyro``.
    calibration : Calibration
    means : SegmentMeans
    plan : Plan
    models : dict of str to Correction

    Raises
    ------
    DataError
        When the calibration lacks parts of the triad.
    """
    rates = common.rates_of(means).sum(axis=1)
    at = np.flatnonzero(rates == 0 if kind == "accel" else rates != 0)
    names = [means.names[i] for i in at]
    if at.size == 0:
        return Misfits.none(kind, len(calibration.parameters))
    model = models[kind]
    readings = means.mean[kind][at]
    force = None
    if kind == "gyro" and "accel" in models:
        force = invert(models["accel"], means.mean["accel"][at])
    u = invert(model, readings, force)
    size = np.linalg.norm(u, axis=1)
    known = np.full(at.size, plan.site_gravity) if kind == "accel" else _known_rates(means, plan)[at]
    along = (u / size[:, None]) @ np.linalg.inv(model.matrix)  # d|u| / dN
    variance = np.einsum("ni,ni->n", along**2, variance_of(kind, means, plan, model)[at])
    scatter = calibration.fit.residuals.get("static norm" if kind == "accel" else "rate norm")
    if scatter is not None and "white" not in calibration.fit.uncertainty.split(" / ")[0]:
        variance = variance + scatter.rms**2
    common_error = (
        np.abs(rates[at]) * plan.rig.rate_uncertainty if kind == "gyro" else np.full(at.size, plan.gravity_uncertainty)
    )
    return Misfits(kind, names, size - known, _jacobian(kind, calibration, u, along, force), variance, common_error)


def _known_rates(means: SegmentMeans, plan: Plan) -> Array:
    """Size of the mean rate in each segment; it hardly depends on the settings, and not at all about a vertical axis."""
    rates, latitude = common.rates_of(means), plan.need_latitude("the rate norm")
    left = common.left_of(means, rates)
    if all(s.angles is not None for s in means.segments):
        site = Site(latitude, plan.site_gravity, plan.earth_rate)
        angles = common.need_angles(means, "verify")
        felt = mean_inputs(angles, rates, left, site, letters=plan.rig.letters, derivatives=False)
        return np.asarray(np.linalg.norm(felt.rate, axis=1), dtype=np.float64)
    outer = common.outer_rates(means, plan, "verify without the table's angles")
    return np.hypot(outer + plan.earth_rate * math.sin(latitude), left * plan.earth_rate * math.cos(latitude))


def variance_of(kind: str, means: SegmentMeans, plan: Plan, model: Correction) -> Array:
    """Variance of the new means from their noise, (n, 3), in the unit of the readings.

    Parameters
    ----------
    kind : str
        ``accel`` or ``gyro``.
    means : SegmentMeans
    plan : Plan
    model : Correction
    """
    gain = float(np.mean(np.linalg.norm(model.matrix, axis=1))) if model.counts else 1.0
    noise = common.noise_of(means, plan, kind, gain, float(np.abs(means.mean[kind]).max()))
    return means.variance(kind, noise.density if noise.known else np.zeros(3))


def _jacobian(kind: str, calibration: Calibration, u: Array, along: Array, force: Array | None) -> Array:
    """Derivative of the norm to every parameter of the calibration: -d|u|/dN (dS u + db + dG f)."""
    names = list(calibration.values())
    out = np.zeros((len(u), len(names)))
    triad = triad_of(names, kind, ratio=calibration.misalignment == "input-axis")
    if triad is None:
        raise DataError(f"the calibration lacks parts of the {kind} triad: its norm cannot be judged")
    x = np.array([calibration[n].value for n in triad.names])
    d_matrix, d_bias, d_g = triad.derivatives(x)
    change = np.einsum("kij,nj->nik", d_matrix, u) + d_bias.T
    if force is not None:
        change = change + np.einsum("kij,nj->nik", d_g, force)
    out[:, [names.index(n) for n in triad.names]] = -np.einsum("ni,nik->nk", along, change)
    return out
