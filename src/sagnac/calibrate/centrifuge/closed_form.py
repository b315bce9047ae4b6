"""The published closed form of the centrifuge, as baseline: small angles, first order, one speed [XU18].

With the platform counter-rotating, alpha = beta = 0 and gamma = 0, pi/2, pi (indices 0, 2, 4), all in units of gravity, k_h,i
being the amplitude of harmonic h at gamma = i pi/4 and A = w^2 r, the accelerometer z has (signs corrected) ::

    th_pz = -k1c,0 / A       th_oz = -k1s,2 / A       Kip = 2 k2s,2 / A^2
    K2 = 2 k2c,2 / A^2       K3 = -4 k3c,2 / A^3
    K0 = (k0,0 + k0,4) / 2 - K2                       K1 = (k0,0 - k0,4 - 2) / 2 - K3

The same reasoning gives those of x, which lies in the arm's plane at gamma = 0 and points down at pi/2 ::

    Kip = 2 k2s,0 / A^2      K2 = 2 k2c,0 / A^2       K3 = -4 k3c,0 / A^3
    K0 = (k0,0 + k0,4) / 2 - k2c,0                    K1 = K0 + K2 - K3 - k0,2 - 1

and of y, which always lies in the arm's plane, so that only A + A1 (A1 = 2 w r W_U) shows its scale ::

    th_py = -k1c,0 / A       Kip = -2 k2s,2 / A^2     K2 = -2 k2c,0 / A^2      K3 = 4 k3s,0 / A^3
    K0 = (k0,0 + k0,4) / 2 + k2c,0                    K1 = -[(k1s,0 + k1s,4) / 2 + 3 k3s,0] / (A + A1) - 1

All are linear in the amplitudes. What they leave out is found by feeding them with what the exact model predicts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...calibration import BudgetLine, Calibration, Fit, named
from ...errors import DataError, InputError
from ...frames import Array
from ...plan import Plan
from ...recording import Recording
from ...rigs.centrifuge import EFFECTS, series
from ...sensors import Axis
from ...sensors.series import response
from .. import common
from .report import SOURCES
from .task import PAIRS, Task

TERMS = ("bias", "scale_error", "k2", "k3", "kip")
_GAMMAS = np.array([0.0, np.pi / 2.0, np.pi])
_NEAR = 1e-3  # rad: as near as a setting must be to the published ones
_C1, _S1, _C2, _S2, _C3, _S3 = range(1, 7)  # places of the harmonics in a row of coefficients
COUNT = 7
"""Amplitudes that are used of each segment: up to the third harmonic."""


@dataclass(frozen=True)
class Linear:
    """Parameters of one accelerometer as ``constant + matrix @ amplitudes``, SI.

    Attributes
    ----------
    axis : Axis
    constant : ndarray, shape (k,)
    matrix : ndarray, shape (k, 21)
        To the seven amplitudes at each of the three gammas, in m/s^2.
    """

    axis: Axis
    constant: Array
    matrix: Array

    def __call__(self, amplitudes: Array) -> Array:
        """Parameters for amplitudes of shape (3, 7 or more)."""
        return np.asarray(self.constant + self.matrix @ amplitudes[:, :COUNT].ravel())


def _z(a: float) -> dict[str, Array]:
    k = np.zeros((7, 3, COUNT))
    zx, zy, kip, k2, k3, bias, scale = k
    zx[0, _C1] = zy[1, _S1] = -1.0 / a
    kip[1, _S2] = k2[1, _C2] = 2.0 / a**2
    k3[1, _C3] = -4.0 / a**3
    bias[0, 0] = bias[2, 0] = scale[0, 0] = 0.5
    scale[2, 0] = -0.5
    return {"zx": zx, "zy": zy, "kip": kip, "k2": k2, "k3": k3, "bias": bias - k2, "scale_error": scale - k3}


def _x(a: float) -> dict[str, Array]:
    k = np.zeros((5, 3, COUNT))
    kip, k2, k3, bias, scale = k
    kip[0, _S2] = k2[0, _C2] = 2.0 / a**2
    k3[0, _C3] = -4.0 / a**3
    bias[0, 0] = bias[2, 0] = 0.5
    bias[0, _C2] = -1.0
    scale[1, 0] = -1.0
    return {"kip": kip, "k2": k2, "k3": k3, "bias": bias, "scale_error": scale + bias + k2 - k3}


def _y(a: float, a_all: float) -> dict[str, Array]:
    k = np.zeros((6, 3, COUNT))
    yx, kip, k2, k3, bias, scale = k
    yx[0, _C1] = -1.0 / a
    kip[1, _S2] = k2[0, _C2] = -2.0 / a**2
    k3[0, _S3] = 4.0 / a**3
    bias[0, 0] = bias[2, 0] = 0.5
    bias[0, _C2] = 1.0
    scale[0, _S1] = scale[2, _S1] = -0.5 / a_all
    scale[0, _S3] = -3.0 / a_all
    return {"yx": yx, "kip": kip, "k2": k2, "k3": k3, "bias": bias, "scale_error": scale}


def published(letter: str, centripetal: float, coriolis: float, gravity: float) -> Linear:
    """Closed form of one accelerometer.

    Parameters
    ----------
    letter : str
        ``x``, ``y`` or ``z``.
    centripetal, coriolis : float, m/s^2
        w^2 r and 2 w r W_U.
    gravity : float, m/s^2

    Returns
    -------
    Linear
    """
    axis = Axis("accel", letter, TERMS, PAIRS[f"accel_{letter}"])
    a = centripetal / gravity
    rows = {"x": _x, "y": lambda v: _y(v, v + coriolis / gravity), "z": _z}[letter](a)
    # back from units of gravity: amplitudes are divided by it, K0 and the higher terms multiplied with its powers
    powers = {"bias": 1.0, "k2": -1.0, "k3": -2.0, "kip": -1.0}
    keys = (*TERMS, *axis.misalignments)
    size = np.array([gravity ** powers.get(key, 0.0) for key in keys])
    constant = np.array([-1.0 if key == "scale_error" else 0.0 for key in keys])
    return Linear(axis, constant, np.stack([rows[key].ravel() for key in keys]) * (size / gravity)[:, None])


def pick(rates: Array, settings: Array, counter_rotating: bool) -> list[list[int]]:
    """Segments at gamma = 0, pi/2 and pi of the fastest speed that has all three.

    Parameters
    ----------
    rates : ndarray, shape (n,), rad/s
    settings : ndarray, shape (n, 3), rad
        alpha, beta, gamma.
    counter_rotating : bool

    Returns
    -------
    list of three lists of int

    Raises
    ------
    InputError
        When the platform is fixed to the arm.
    DataError
        When there are no such segments.
    """
    if not counter_rotating:
        raise InputError("the published closed form is for a counter-rotating platform; leave out --closed-form")
    level = np.abs(np.angle(np.exp(1j * settings[:, :2]))).max(axis=1) < _NEAR
    for rate in sorted(set(rates[rates != 0].tolist()), key=abs, reverse=True):
        near = np.abs(np.angle(np.exp(1j * (settings[:, 2, None] - _GAMMAS)))) < _NEAR
        found = [np.flatnonzero(level & (rates == rate) & near[:, k]).tolist() for k in range(3)]
        if all(found):
            return found
    raise DataError(
        "the published closed form needs segments with alpha = beta = 0 and gamma = 0, 90 and 180 deg at one arm rate; leave "
        "out --closed-form for any other set"
    )


def calibrate(
    task: Task, plan: Plan, recording: Recording | None, span: tuple[float, float], remarks: Sequence[str]
) -> Calibration:
    """The accelerometers by the published equations, with the uncertainties that go into them and what they leave out.

    The stated uncertainties of the rig change the amplitudes, and with them the parameters, as the exact model says, to first
    order. The equations leave no degree of freedom: nothing in the result says how well they describe the data.

    Parameters
    ----------
    task : Task
    plan : Plan
    recording : Recording, optional
    span : tuple of float, s
    remarks : sequence of str
        Those made before.

    Returns
    -------
    Calibration
        The last line of its budget says what the truncated equations leave out; the standard uncertainties do not contain it.

    Raises
    ------
    DataError
        When there are no such segments or no accelerometers.
    InputError
        When a segment's arm phase is not known, the arm's rate is uncertain, or the platform is fixed to the arm.
    """
    from scipy.linalg import block_diag

    if plan.rig.rate_uncertainty > 0:
        raise InputError(
            "the published closed form takes arm_rate as exact, and the plan states rig.rate_uncertainty; leave out --closed-form"
        )
    if not (task.known.all() and np.allclose(np.exp(1j * (task.planned_angle - task.phase)), 1.0, atol=1e-9)):
        raise InputError(
            "the published closed form needs arm_phase of every segment in the plan; leave out --closed-form"
        )
    accels = [j for j, s in enumerate(task.sensors) if s.kind == "accel"]
    if not accels:
        raise DataError("the published closed form is for accelerometers; the recording has none")
    chosen = pick(task.planned_rate, task.settings, task.arm.counter_rotating)
    w = float(task.planned_rate[chosen[0][0]])
    a, a1 = task.arm.radius * w**2, 2.0 * task.arm.radius * w * float(task.site.enu[2])
    values, _ = task.plain()
    names: list[str] = []
    units: list[str] = []
    found, left, blocks, moved = np.zeros(0), np.zeros(0), [], []
    for j in accels:
        linear = published(task.sensors[j].axis, a, a1, task.site.gravity)
        x = linear(np.stack([values[at, j].mean(axis=0) for at in chosen]))
        blocks.append(linear.matrix @ _amplitude_covariance(task, j, chosen) @ linear.matrix.T)
        names, units = [*names, *linear.axis.names], [*units, *linear.axis.units]
        exact, slopes = _exact(task, linear, x, chosen)
        left = np.append(left, linear(exact) - x)
        moved.append(linear.matrix @ slopes)
        found = np.append(found, x)
    noise = np.asarray(block_diag(*blocks))
    lines, rig = _by_rig(task, np.vstack(moved), [len(at) for at in chosen])
    covariance = noise + rig
    sigma = np.sqrt(np.diag(covariance))
    times = np.abs(left) / sigma
    note = (
        "the published equations are of first order: with these values they are off by as much as the last line of the budget "
        f"says, {times.max():.2g} standard uncertainties in {names[int(np.argmax(times))]}, and the uncertainties do not show it"
    )
    budget = (
        BudgetLine(source="noise", standard_uncertainty=tuple(np.sqrt(np.diag(noise)).tolist())),
        *lines,
        BudgetLine(source="truncation, not counted", standard_uncertainty=tuple(np.abs(left).tolist())),
    )
    # one equation for each parameter: solved exactly, without iterations, and with nothing left that could be judged
    how = "noise and stated uncertainties of the rig" if lines else "noise"
    fit = Fit(chi2=0.0, degrees_of_freedom=0, residual_rms=0.0, converged=True, iterations=0, uncertainty=how)
    blind = "one equation for each parameter leaves no degrees of freedom: no chi-square says whether the data fit them"
    result = common.result(
        "centrifuge closed form",
        named(names, units, found, covariance),
        covariance,
        fit,
        plan=plan,
        gravity=task.site.gravity,
        recording=recording,
        span=span,
        budget=budget,
        remarks=[*remarks, blind, note],
    )
    return result.model_copy(update={"misalignment": "input-axis"})


def _amplitude_covariance(task: Task, j: int, chosen: Sequence[Sequence[int]]) -> Array:
    """Covariance (21, 21) of the amplitudes of one sensor, means over segments with the same gamma."""
    (_, covariance), slow = task.plain(), task.plain_slow()
    out = np.zeros((3 * COUNT, 3 * COUNT))
    for k, at in enumerate(chosen):
        own = slice(COUNT * k, COUNT * (k + 1))
        out[own, own] = sum(covariance[i, :COUNT, :COUNT] * task.variance[i, j] for i in at) / len(at) ** 2
        if slow is not None:
            out[own, own] += slow[list(at), j, :COUNT, :COUNT].sum(axis=0) / len(at) ** 2
    return out


def _exact(task: Task, linear: Linear, x: Array, chosen: Sequence[Sequence[int]]) -> tuple[Array, Array]:
    """Amplitudes (3, 7) that the exact model predicts, and their derivatives (21, 14).

    Those are to radius, the two tilts and gravity, to the arm's phase, and to alpha, beta, gamma at each of the three gammas.
    """
    at = [segments[0] for segments in chosen]
    felt = series(task.arm, task.site, task.planned_rate[at], task.settings[at])
    said = response(linear.axis, x, felt.force, felt.rate, order=3)
    to_effects = said.to_force.reshape(3, COUNT, 9) @ felt.to_force.reshape(3, 9, len(EFFECTS))
    out = np.zeros((3, COUNT, 14))
    out[..., :4] = to_effects[..., :4]
    h = np.arange(1, 4)
    # amplitudes of an arm that is ahead by d: c cos h(th + d) + s sin h(th + d)
    out[:, 1::2, 4], out[:, 2::2, 4] = h * said.value[:, 2::2], -h * said.value[:, 1::2]
    for k in range(3):
        out[k, :, 5 + 3 * k : 8 + 3 * k] = to_effects[k, :, 5:]
    return said.value, out.reshape(3 * COUNT, 14)


def _by_rig(task: Task, moved: Array, counts: Sequence[int]) -> tuple[list[BudgetLine], Array]:
    """Budget and covariance of what the plan says to be uncertain.

    Parameters
    ----------
    task : Task
    moved : ndarray, shape (k, 14)
        Derivatives of the parameters, see :func:`_exact`.
    counts : sequence of int
        Segments at each gamma, which have setting errors of their own.
    """
    rig = task.plan.rig
    stated = {
        SOURCES["rig.radius"]: [rig.radius_uncertainty],
        SOURCES["rig.tilt.x"]: [rig.axis_uncertainty] * 2,
        SOURCES["rig.gravity"]: [task.plan.gravity_uncertainty],
        SOURCES["rig.phase_error"]: [rig.phase_uncertainty],
        "gimbal settings": np.repeat(task.setting_sigma / np.sqrt(counts), 3).tolist(),
    }
    lines, covariance, at = [], np.zeros((len(moved), len(moved))), 0
    for source, sigmas in stated.items():
        parts = moved[:, at : at + len(sigmas)] * sigmas
        at += len(sigmas)
        if any(sigmas):
            covariance += parts @ parts.T
            lines.append(BudgetLine(source=source, standard_uncertainty=tuple(np.linalg.norm(parts, axis=1).tolist())))
    return lines, covariance
