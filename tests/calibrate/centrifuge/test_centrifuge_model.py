"""The model of the centrifuge: derivatives, the turn of coefficients to a measured angle, elimination of the settings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sagnac.calibrate import mount
from sagnac.calibrate.centrifuge.model import MOUNT, RIG, CentrifugeModel, Group, PriorBlock, Turning
from sagnac.estimate import Parameter
from sagnac.rigs.centrifuge import Arm, inputs
from sagnac.rigs.turntable import Site
from sagnac.sensors import TERMS, Axis
from sagnac.sensors.series import basis

SITE = Site(math.radians(29.89), 9.80665, 7.292e-5)
SENSORS = (
    Axis("accel", "y", tuple(TERMS["accel"]), ("yx",)),
    Axis("accel", "z", tuple(TERMS["accel"]), ("zx", "zy")),
    Axis("gyro", "x", (*TERMS["gyro"], "scale_error"), ("xy", "xz")),
)
N = 3


def case(*, extended, counter_rotating, setting_sigma=0.0, prior=False):
    """A model with everything unknown, and a parameter vector."""
    rng = np.random.default_rng(8)
    order, c = 4, 9 + 8 * extended
    root = rng.normal(size=(N, len(SENSORS), c, c)) + 3 * np.eye(c)
    group = Group(
        np.arange(N),
        order,
        extended,
        rng.normal(size=(N, len(SENSORS), c)),
        root,
        rng.uniform(0, 6, N),
        np.array([3.0, 3.1, -2.0]),
    )
    parameters = tuple(Parameter(f"rig.arm_{n}", "", 0.0, 1.0) for n in ("phase", "rate"))
    to_angle = np.array([[1.0, 0.5], [1.0, 7.0], [0.0, 2.0]])
    turning = Turning(
        parameters, rng.uniform(0, 6, N), np.array([3.0, 3.0, -2.0]), to_angle, np.array([[0.0, 1.0]] * N)
    )
    unknown = (*RIG, *MOUNT)
    x = np.concatenate(
        [
            rng.normal(0, 1e-3, sum(len(s.names) for s in SENSORS)),
            [2.0, 1e-3, -2e-3, 9.8, 3e-3, -1e-3, 2e-3],
            [1e-2, 1e-3],
        ]
    )
    block = PriorBlock(np.array([1, 4]), np.array([0.1, 0.2]), np.array([[1.0, 2.0], [0.0, 3.0]])) if prior else None
    arm = Arm(2.0, counter_rotating)
    model = CentrifugeModel(
        SENSORS, {}, arm, SITE, rng.uniform(-1, 1, (N, 3)), setting_sigma, turning, (group,), unknown, block
    )
    return model, group, x


@pytest.mark.parametrize("extended", [False, True])
@pytest.mark.parametrize("counter_rotating", [False, True])
def test_derivatives_by_central_differences(extended, counter_rotating):
    model, group, x = case(extended=extended, counter_rotating=counter_rotating)
    local = np.random.default_rng(1).normal(0, 1e-3, (N, 3))
    told = model.predicted(group, x, local)
    h = 1e-5
    assert len(x) == len(model.names)
    for k, name in enumerate(model.names):
        step = np.where(np.arange(len(x)) == k, h, 0.0)
        ahead, behind = (model.predicted(group, v, local).value for v in (x + step, x - step))
        # third derivatives of some 1e5 (rate in the Coriolis and centripetal terms) times h^2, rounding of 1e3 over h
        np.testing.assert_allclose(told.to_x[..., k], (ahead - behind) / (2 * h), rtol=1e-7, atol=3e-7, err_msg=name)
    for k in range(3):
        step = h * (np.arange(3) == k)
        ahead, behind = (model.predicted(group, x, v).value for v in (local + step, local - step))
        np.testing.assert_allclose(told.to_local[..., k], (ahead - behind) / (2 * h), rtol=1e-7, atol=3e-7)


def test_readings_at_the_angle_where_the_arm_stands():
    """The series at that angle, and its derivatives by central differences, the phase's and the settings' among them."""
    model, _, x = case(extended=False, counter_rotating=False)
    rng = np.random.default_rng(2)
    still = replace(model.turning, rate=np.zeros(N), to_rate=np.zeros((N, 2)))
    model, at, ones = replace(model, turning=still), np.arange(N), np.ones((N, len(SENSORS), 1, 1))
    group = Group(at, 0, False, np.zeros((N, len(SENSORS), 1)), ones, np.zeros(N), np.zeros(N), at_rest=True)
    local = rng.normal(0, 1e-3, (N, 3))
    told = model.predicted(group, x, local)
    angle = still.angle + still.to_angle @ x[-2:]
    arm = Arm(x[model.places["rig.radius"]], False, (x[model.places["rig.tilt.x"]], x[model.places["rig.tilt.y"]]))
    site = Site(SITE.latitude, x[model.places["rig.gravity"]], SITE.earth_rate)
    felt = [v @ mount.matrix(x[-5:-2]) for v in inputs(arm, site, angle, np.zeros(N), model.settings + local)]
    first = 0
    for j, s in enumerate(SENSORS):
        own = slice(first, first + len(s.names))
        first = own.stop
        np.testing.assert_allclose(told.value[:, j, 0], s.evaluate(x[own], *felt).value, rtol=1e-12, atol=1e-14)
    h = 1e-5
    for k, name in enumerate(model.names):
        step = np.where(np.arange(len(x)) == k, h, 0.0)
        ahead, behind = (model.predicted(group, v, local).value for v in (x + step, x - step))
        np.testing.assert_allclose(told.to_x[..., k], (ahead - behind) / (2 * h), rtol=1e-7, atol=3e-7, err_msg=name)
    for k in range(3):
        step = h * (np.arange(3) == k)
        ahead, behind = (model.predicted(group, x, v).value for v in (local + step, local - step))
        np.testing.assert_allclose(told.to_local[..., k], (ahead - behind) / (2 * h), rtol=1e-7, atol=3e-7)


def test_coefficients_in_a_measured_angle_are_the_same_signal():
    """A signal predicted in an angle off by 0.3 to 6 rad and in a rate off by 1e-3 against the true one, over a short time."""
    model, group, x = case(extended=True, counter_rotating=True)
    told = model.predicted(group, x, np.zeros((N, 3))).value
    q = x[-2:]
    angle, rate = model.turning.angle + model.turning.to_angle @ q, model.turning.rate + model.turning.to_rate @ q
    plain = CentrifugeModel(
        SENSORS,
        {},
        model.arm,
        SITE,
        model.settings,
        0.0,
        Turning(model.turning.parameters, angle, rate, np.zeros((N, 2)), np.zeros((N, 2))),
        (Group(group.index, 4, False, group.coefficient, group.weight, angle, rate),),
        model.unknown,
    )
    true = plain.predicted(plain.groups[0], x, np.zeros((N, 3))).value
    tau = np.linspace(-1e-3, 1e-3, 5)
    for i in range(N):
        seen = basis(group.phase[i] + group.rate[i] * tau, 4)
        seen = np.hstack([seen, tau[:, None] * seen[:, 1:]])
        was = basis(angle[i] + rate[i] * tau, 4)
        # first order in the error of the angle, 4 (rate error) tau = 4 * 0.1 * 1e-3: its square times 40 m/s^2
        np.testing.assert_allclose(told[i] @ seen.T, true[i] @ was.T, atol=1e-5)


def test_settings_are_projected_out():
    """Solving for the settings and projecting them out leave one and the same least-squares step."""
    model, group, x = case(extended=False, counter_rotating=True, setting_sigma=1e-2, prior=True)
    rows = model.rows(x)
    local = model.locals(group, x)
    r, jac, d = model.whitened(group, x, local)
    n, m = r.shape
    whole = np.zeros((n * (m + 3) + 2, len(x) + 3 * n))
    left = np.zeros(len(whole))
    for i in range(n):
        at = slice(i * (m + 3), i * (m + 3) + m)
        own = slice(len(x) + 3 * i, len(x) + 3 * i + 3)
        whole[at, : len(x)], whole[at, own], left[at] = jac[i], d[i], r[i]
        at = slice(at.stop, at.stop + 3)
        whole[at, own], left[at] = np.eye(3) / 1e-2, local[i] / 1e-2
    whole[-2:, [1, 4]], left[-2:] = model.prior.weight, model.prior.weight @ (x[[1, 4]] - model.prior.mean)
    scale = np.linalg.norm(whole, axis=0)
    # the rig has more unknowns than these three segments show: compare normal equations instead of solutions
    inner = whole / scale
    a, b, c = inner[:, : len(x)], inner[:, len(x) :], left
    project = np.eye(len(b)) - b @ np.linalg.pinv(b)
    np.testing.assert_allclose(
        (rows.jacobian / scale[: len(x)]).T @ rows.jacobian / scale[: len(x)], a.T @ project @ a, atol=1e-9
    )
    np.testing.assert_allclose(
        (rows.jacobian / scale[: len(x)]).T @ rows.residual, a.T @ project @ c, atol=1e-6 * np.linalg.norm(c)
    )
    assert set(rows.segment) == {0, 1, 2, 3}  # the prior counts as a segment of its own


def test_the_settings_found_are_the_most_likely_ones():
    model, group, x = case(extended=False, counter_rotating=False, setting_sigma=1e-2)
    local = model.locals(group, x)
    r, _, d = model.whitened(group, x, local)
    slope = np.einsum("nm,nml->nl", r, d) + local / 1e-4
    assert np.abs(slope).max() < 1e-6 * np.abs(np.einsum("nml,nm->nl", d, np.abs(r))).max()
