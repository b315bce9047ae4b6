"""What is to be fitted on a centrifuge: harmonics and plan brought together, parameters, model, and one fit of them.

A :class:`Task` can be read otherwise (sense of rotation, gimbals, a free radius, ...), which is how a wrong plan is found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...estimate import Estimate, Parameter, estimate
from ...frames import Array
from ...plan import Plan, Segment
from ...rigs.centrifuge import Arm, series
from ...rigs.turntable import Site
from ...sensors import Axis
from .model import MOUNT, CentrifugeModel, Group, PriorBlock, Turning
from .prior import Prior, whitening
from .turning import Seen

ACCEL_TERMS = ("bias", "scale_error", "k2", "k3", "kip")
GYRO_TERMS = ("bias", "d_i", "d_o", "d_s", "d_ii", "d_oo", "d_ss", "d_io", "d_is", "d_os")
PAIRS: dict[str, tuple[str, ...]] = {
    "accel_x": (),
    "accel_y": ("yx",),
    "accel_z": ("zx", "zy"),
    "gyro_x": ("xy", "xz"),
    "gyro_y": ("yx", "yz"),
    "gyro_z": ("zx", "zy"),
}
"""Misalignments of each sensor: directions of its input axis."""
_CLEAR = 0.1  # share of the arm's acceleration that a sensor must feel for its phase to tell where the arm is
_EXACT = 1e-9  # of what matters: standard deviation of a prior that claims none


@dataclass(frozen=True)
class Task:
    """n segments, m sensors, c coefficients.

    Attributes
    ----------
    plan : Plan
    segments : tuple of Segment
    sensors : tuple of Axis
    coefficient : ndarray, shape (n, m, c), m/s^2 and rad/s
    covariance : ndarray, shape (n, c, c)
        Of the coefficients for samples of variance one.
    variance : ndarray, shape (n, m)
        Of the samples, white noise.
    noise_known : bool
    order : int
    extended : bool
        See :class:`Group`.
    phase, rate : ndarray, shape (n,), rad and rad/s
        Of the angle that the coefficients refer to, at mid time.
    mid_time : ndarray, shape (n,), s
    planned_rate : ndarray, shape (n,), rad/s
    planned_angle : ndarray, shape (n,), rad
        At mid time, or where the arm stands; NaN where neither plan nor arm column tells.
    mean_only : ndarray of bool, shape (n,)
        Where only the means are used: nothing turns, or the unit is fixed to a turning arm whose angle nobody knows.
    rate_sigma : ndarray, shape (n,), rad/s
        Of rates that were found in the samples.
    by_column : ndarray of bool, shape (n,)
        Where an arm column tells angle and rate; `planned_rate` is then the rate found there.
    settings : ndarray, shape (n, 3), rad
    setting_sigma : float, rad
    arm : Arm
    site : Site
    fixed : mapping of str to float
    bounds : mapping of str to float
        Standard deviations of parameters that are solved for but not reported, around zero.
    prior : Prior, optional
    slow : ndarray, shape (n, m, c, c), or None
        What slow noise adds to the covariance of the coefficients.
    free : frozenset of str
        What is unknown besides what the plan says: ``mount``, and in other readings of the plan ``radius``, ``tilt``.
    """

    plan: Plan
    segments: tuple[Segment, ...]
    sensors: tuple[Axis, ...]
    coefficient: Array
    covariance: Array
    variance: Array
    noise_known: bool
    order: int
    extended: bool
    phase: Array
    rate: Array
    mid_time: Array
    planned_rate: Array
    planned_angle: Array
    mean_only: NDArray[np.bool_]
    rate_sigma: Array
    by_column: NDArray[np.bool_]
    settings: Array
    setting_sigma: float
    arm: Arm
    site: Site
    fixed: Mapping[str, float]
    bounds: Mapping[str, float]
    prior: Prior | None = None
    slow: Array | None = None
    free: frozenset[str] = frozenset()

    @property
    def names(self) -> tuple[str, ...]:
        """Segment names."""
        return tuple(s.name for s in self.segments)

    @property
    def turns(self) -> NDArray[np.bool_]:
        """Which segments turn, (n,)."""
        return np.asarray(self.planned_rate != 0)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where the arm's angle is known beforehand, or does not matter, (n,)."""
        return np.asarray(np.isfinite(self.planned_angle) | self.mean_only)

    @property
    def stands(self) -> NDArray[np.bool_]:
        """Where a unit fixed to the arm rests at a known angle, on which its readings depend, (n,)."""
        return np.asarray(~self.turns & np.isfinite(self.planned_angle) & (not self.arm.counter_rotating))

    @property
    def mountable(self) -> bool:
        """Whether the accelerometers can show how the unit sits on its gimbals: x and y define its frame."""
        return {"accel.x", "accel.y"} <= {s.sensor for s in self.sensors}

    @property
    def size(self) -> float:
        """Largest specific force, m/s^2."""
        return float(np.hypot(self.site.gravity, self.arm.radius * np.abs(self.planned_rate).max() ** 2))

    def only(self, kind: str) -> Task:
        """The same with one kind of sensor."""
        at = [j for j, s in enumerate(self.sensors) if s.kind == kind]
        sensors = tuple(self.sensors[j] for j in at)
        prior = None if self.prior is None else self.prior.only([n for s in sensors for n in s.names])
        return replace(
            self,
            sensors=sensors,
            coefficient=self.coefficient[:, at],
            variance=self.variance[:, at],
            slow=None if self.slow is None else self.slow[:, at],
            prior=prior,
        )

    def reversed(self) -> Task:
        """The same data with the arm turning the other way."""
        flip = np.ones(self.coefficient.shape[-1])
        flip[2 : 1 + 2 * self.order : 2] = -1.0
        flip[2 + 2 * self.order :: 2] = -1.0
        back = self.mid_time - np.array([s.start for s in self.segments])
        return replace(
            self,
            coefficient=self.coefficient * flip,
            covariance=self.covariance * np.outer(flip, flip),
            slow=None if self.slow is None else self.slow * np.outer(flip, flip),
            phase=-self.phase,
            rate=-self.rate,
            planned_rate=-self.planned_rate,
            planned_angle=self.planned_angle - 2.0 * self.planned_rate * back,
        )

    def plain(self) -> tuple[Array, Array]:
        """Coefficients (n, m, 1 + 2 order) without the terms that go with tau, were they zero, and their covariance (n, c, c)."""
        if not self.extended:
            return self.coefficient, self.covariance
        return without_tau(self.coefficient, self.covariance, self.order)

    def plain_slow(self) -> Array | None:
        """What slow noise adds to the covariance of the coefficients of :meth:`plain`, (n, m, c, c), or None."""
        if self.slow is None or not self.extended:
            return self.slow
        c = 1 + 2 * self.order
        taken = np.zeros((len(self.segments), c, self.slow.shape[-1]))
        taken[:, :, :c] = np.eye(c)
        at, crossed = _shares(self.covariance, c)
        taken[at, :, c:] = -np.swapaxes(crossed, -1, -2)
        return np.asarray(taken[:, None] @ self.slow @ np.swapaxes(taken, -1, -2)[:, None])

    def _first_variance(self, covariance: Array) -> Array:
        """Variance of samples, (n, m), that would scatter the first harmonic as white and slow noise do together."""
        slow = self.plain_slow()
        if slow is None:
            return self.variance
        own = np.where(self.turns, covariance[:, 1, 1] + covariance[:, 2, 2], 1.0)
        return np.asarray(self.variance + (slow[..., 1, 1] + slow[..., 2, 2]) / own[:, None])

    def look(self) -> Seen:
        """What the samples say of the arm, see :class:`Seen`."""
        felt = series(self.arm, self.site, self.planned_rate, self.settings)
        plain, covariance = self.plain()
        variance = self._first_variance(covariance)
        told = np.zeros(len(self.segments), dtype=complex)
        found, clear = np.zeros((2, len(self.segments)))
        centripetal = self.arm.radius * self.planned_rate**2
        for j, sensor in enumerate(self.sensors):
            if sensor.kind != "accel":
                continue
            nominal = felt.force[:, "xyz".index(sensor.axis)]
            expected, measured = nominal[:, 1] - 1j * nominal[:, 2], plain[:, j, 1] - 1j * plain[:, j, 2]
            told += measured * np.conj(expected)
            found += np.abs(expected) ** 2 / variance[:, j]
            clear = np.maximum(clear, np.abs(expected))
        usable = self.turns & (clear > _CLEAR * centripetal)
        scatter = np.sqrt((covariance[:, 1, 1] + covariance[:, 2, 2]) / 2.0 / np.maximum(found, 1e-300))
        shown, shown_sigma = self.phase + np.angle(told), np.where(usable, np.maximum(scatter, 1e-9), np.inf)
        angle = np.where(self.known, np.nan_to_num(self.planned_angle), shown)
        sigma = np.where(self.known, 0.0, shown_sigma)
        rate = np.where(self.known, self.planned_rate, self.rate)
        stated = np.where(self.by_column, 0.0, self.planned_rate)
        return Seen(
            mid_time=self.mid_time,
            known=self.known,
            angle=angle,
            angle_sigma=sigma,
            rate=rate,
            rate_sigma=self.rate_sigma,
            stated=stated,
            measured=self.rate,
            shown=shown,
            shown_sigma=shown_sigma,
        )

    def groups(self) -> tuple[Group, ...]:
        """Segments by what is used of them: all coefficients, the reading at the angle where the arm stands, or the mean."""
        out = []
        stands = self.mean_only & self.stands
        for which, order in ((~self.mean_only, self.order), (self.mean_only & ~stands, 0), (stands, 0)):
            index = np.flatnonzero(which)
            if index.size == 0:
                continue
            extended = self.extended and order > 0
            c = self.coefficient.shape[-1] if order else 1
            weight = self._whitening(index, c)
            out.append(
                Group(
                    index,
                    order,
                    extended,
                    self.coefficient[index, :, :c],
                    weight,
                    self.phase[index],
                    self.rate[index],
                    at_rest=bool(stands[index].all()),
                )
            )
        return tuple(out)

    def _whitening(self, index: NDArray[np.intp], c: int) -> Array:
        """Inverse triangular roots of the covariance of the first c coefficients of some segments, (n, m, c, c)."""
        own = self.covariance[index, :c, :c]
        if self.slow is None:
            return np.asarray(
                np.linalg.inv(np.linalg.cholesky(own))[:, None] / np.sqrt(self.variance[index])[..., None, None]
            )
        both = own[:, None] * self.variance[index][..., None, None] + self.slow[index, :, :c, :c]
        return np.linalg.inv(np.linalg.cholesky(both))

    def rig_unknowns(self) -> list[Parameter]:
        """Unknowns of the rig, with what the plan says of them."""
        rig, out = self.plan.rig, []
        if rig.radius_uncertainty > 0 or "radius" in self.free:
            sigma = np.inf if "radius" in self.free else rig.radius_uncertainty
            out.append(Parameter("rig.radius", "m", self.arm.radius, 0.01 * self.arm.radius, self.arm.radius, sigma))
        if rig.axis_uncertainty > 0 or "tilt" in self.free:
            sigma = np.inf if "tilt" in self.free else rig.axis_uncertainty
            out += [Parameter(f"rig.tilt.{a}", "rad", 0.0, 0.01, 0.0, sigma) for a in "xy"]
        if self.plan.gravity_uncertainty > 0:
            g, sigma = self.site.gravity, self.plan.gravity_uncertainty
            out.append(Parameter("rig.gravity", "m/s^2", g, 0.01 * g, g, sigma, nuisance=True))
        if "mount" in self.free:
            out += [Parameter(name, "rad", 0.0, 0.01) for name in MOUNT]
        return out

    def parameters(self, turning: Turning) -> list[Parameter]:
        """All unknowns in the order of the model."""
        start: dict[str, float] = {}
        spread: dict[str, float] = {}  # what is stated with a wide uncertainty is of use all the same
        if self.prior is not None:
            start = dict(zip(self.prior.names, self.prior.mean.tolist(), strict=True))
            spread = dict(zip(self.prior.names, np.sqrt(np.diag(self.prior.covariance)).tolist(), strict=True))
        out = []
        for s in self.sensors:
            for name, unit, scale in zip(s.names, s.units, s.scales(self.size), strict=True):
                sigma = self.bounds.get(name, np.inf)
                first = float(start.get(name, 0.0))
                enough = max(float(scale), 2.0 * spread.get(name, 0.0), 2.0 * self.bounds.get(name, 0.0))
                out.append(Parameter(name, unit, first, enough, 0.0, sigma, nuisance=name in self.bounds))
        return [*out, *self.rig_unknowns(), *turning.parameters]

    def model(self, turning: Turning) -> CentrifugeModel:
        """The residuals."""
        unknown = tuple(p.name for p in self.rig_unknowns())
        model = CentrifugeModel(
            self.sensors,
            self.fixed,
            self.arm,
            self.site,
            self.settings,
            self.setting_sigma,
            turning,
            self.groups(),
            unknown,
        )
        if self.prior is None or not self.prior.names:
            return model
        scale = {p.name: p.scale for p in self.parameters(turning)}
        at = np.array([model.places[n] for n in self.prior.names])
        least = _EXACT * np.array([scale[n] for n in self.prior.names])
        return replace(model, prior=PriorBlock(at, self.prior.mean, whitening(self.prior.covariance, least)))


@dataclass(frozen=True)
class Fitted:
    """One fit and what it was a fit of."""

    task: Task
    turning: Turning
    estimate: Estimate
    model: CentrifugeModel
    words: str = ""

    @property
    def misfit(self) -> float:
        """Chi-square for each degree of freedom."""
        return self.estimate.chi2 / max(self.estimate.degrees_of_freedom, 1)

    def __getitem__(self, name: str) -> float:
        """Value of a parameter."""
        return float(self.estimate.value[self.estimate.names.index(name)])


def fit(task: Task, turning: Turning, words: str = "", *, robust: bool = False) -> Fitted:
    """Fit all sensors and segments at once.

    Parameters
    ----------
    task : Task
    turning : Turning
    words : str
        What the turning assumes.
    robust : bool

    Returns
    -------
    Fitted

    Raises
    ------
    DataError
        See :func:`sagnac.estimate.estimate`.
    """
    model = task.model(turning)
    names = [*task.names, "prior"] if model.prior is not None else list(task.names)
    found = estimate(task.parameters(turning), model.rows, names, noise_known=task.noise_known, robust=robust)
    return Fitted(task, turning, found, model, words)


def without_tau(coefficient: Array, covariance: Array, order: int) -> tuple[Array, Array]:
    """Coefficients as they would be without the terms that go with tau.

    Parameters
    ----------
    coefficient : ndarray, shape (n, m, 1 + 4 order)
    covariance : ndarray, shape (n, 1 + 4 order, 1 + 4 order)
        Infinite where a segment does not turn, beyond the mean.
    order : int

    Returns
    -------
    coefficient : ndarray, shape (n, m, 1 + 2 order)
    covariance : ndarray, shape (n, 1 + 2 order, 1 + 2 order)
    """
    c = 1 + 2 * order
    values, left = coefficient[..., :c].copy(), covariance[:, :c, :c].copy()
    at, crossed = _shares(covariance, c)
    left[at] -= covariance[at, :c, c:] @ crossed
    values[at] -= coefficient[at, :, c:] @ crossed
    return values, left


def _shares(covariance: Array, c: int) -> tuple[NDArray[np.bool_], Array]:
    """Segments that turn, and what of the terms with tau (c0) goes into the first c when they are left out, (n', c0, c)."""
    at = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))
    return at, np.asarray(np.linalg.solve(covariance[at, c:, c:], covariance[at, c:, :c]))


def sensor_axes(
    columns: tuple[str, ...], counter_rotating: bool, known: frozenset[str], terms: tuple[str, ...] | None
) -> tuple[Axis, ...]:
    """Models of the sensors with the parameters that the rig can show.

    Parameters
    ----------
    columns : tuple of str
        ``accel_x`` to ``gyro_z``.
    counter_rotating : bool
        A platform that keeps its direction shows no gyro's scale or misalignment.
    known : frozenset of str
        Parameters that a prior or a bound tells of, which are then solved for all the same.
    terms : tuple of str, optional
        ``accel.k2``, ``gyro.d_ii``, ``accel.misalignment``, ...: those to be estimated of each kind of sensor that is
        mentioned; otherwise :data:`ACCEL_TERMS`, :data:`GYRO_TERMS` and the misalignments. None at all (an empty tuple): only
        what is known.

    Raises
    ------
    InputError
        When a term is none.
    """
    asked: dict[str, list[str]] = {"accel": [], "gyro": []}
    for term in terms or ():
        kind, _, name = term.partition(".")
        if kind not in asked or not name:
            raise InputError(f"terms: {term!r} is none; write accel.k2, accel.kio, gyro.d_ii, accel.misalignment, ...")
        asked[kind].append(name)
    usual = {
        "accel": [*ACCEL_TERMS, "misalignment"],
        "gyro": [*GYRO_TERMS, *(() if counter_rotating else ("scale_error", "misalignment"))],
    }
    out = []
    for column in columns:
        kind, _, letter = column.partition("_")
        mine = asked[kind] if asked[kind] or terms == () else usual[kind]
        pairs = (
            PAIRS[column]
            if "misalignment" in mine
            else tuple(p for p in PAIRS[column] if f"{kind}.misalignment.{p}" in known)
        )
        more = [n.split(".")[1] for n in sorted(known) if n.startswith(f"{kind}.") and n.endswith(f".{letter}")]
        own = tuple(dict.fromkeys(t for t in (*mine, *more) if t != "misalignment"))
        try:
            out.append(Axis(kind, letter, own, pairs))
        except ValueError as cause:
            raise InputError(f"terms: {', '.join(mine)}: {cause}") from cause
    return tuple(out)
