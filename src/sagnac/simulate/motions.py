"""Rigs as the engine wants them: what the unit feels at any time (:class:`sagnac.simulate.engine.Motion`)."""

from __future__ import annotations

import math

import numpy as np

from ..frames import Array
from ..plan import Plan
from ..rigs.centrifuge import series
from ..rigs.roll_isolated import RollRig, encoder_reading, mount, unit_rates
from . import centrifuge, roll_isolated
from .centrifuge import SimulatedCentrifuge

_TURN = 2.0 * math.pi


class CentrifugeMotion:
    """A unit on an imperfect centrifuge; steady segments by their Fourier series.

    Parameters
    ----------
    plan : Plan
    rig : SimulatedCentrifuge
    """

    def __init__(self, plan: Plan, rig: SimulatedCentrifuge) -> None:
        self._motion = centrifuge.Motion(plan, rig)
        steady = [p for p in self._motion.pieces if p.steady]
        felt = series(
            self._motion.arm,
            self._motion.site,
            np.array([p.rates[0] for p in steady]),
            np.array([p.gimbals[0] for p in steady]),
        )
        both = np.concatenate([felt.force, felt.rate], axis=1)
        self._series = {p.start: np.ascontiguousarray(c.T) for p, c in zip(steady, both, strict=True)}

    def inputs(self, time: Array) -> tuple[Array, Array]:
        """Specific force and angular rate of the unit, (n, 3) each, m/s^2 and rad/s."""
        out = np.empty((time.size, 6))
        for at, piece in self._motion.parts(time):
            if piece.steady:
                angle = piece.angles[0] + piece.rates[0] * (time[at] - piece.start)
                basis = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
                np.matmul(basis, self._series[piece.start], out=out[at])
            else:
                out[at] = np.hstack(self._motion.inputs(time[at]))
        return out[:, :3], out[:, 3:]

    def columns(self, time: Array) -> dict[str, Array]:
        """Angle of the arm, less whole turns."""
        return {"arm": np.mod(self._motion.state(time).angle, _TURN)}


class RollMotion:
    """A unit in the inner cylinder of a roll-isolated rig whose axis lies level, pointing north.

    Parameters
    ----------
    plan : Plan
    rig : RollRig
    rate_error : float
        Relative error of all rates.
    swing, swing_frequency : float, rad and Hz
        Of the inner cylinder while the carrier spins.
    """

    def __init__(self, plan: Plan, rig: RollRig, rate_error: float, swing: float, swing_frequency: float) -> None:
        true = tuple(
            s.model_copy(update={k: getattr(s, k) * (1.0 + rate_error) for k in ("inner_rate", "spin_rate")})
            for s in plan.segment
        )
        self._motion = roll_isolated.Motion.of(plan.model_copy(update={"segment": true}), swing, swing_frequency)
        self._rig = rig
        self._step = plan.rig.encoder_resolution
        self._to_unit = mount(rig.mount_yaw, rig.mount_pitch)
        latitude = plan.need_latitude("the Earth rate")
        self._earth = plan.earth_rate * math.cos(latitude), plan.earth_rate * math.sin(latitude)
        self._gravity = plan.site_gravity

    def inputs(self, time: Array) -> tuple[Array, Array]:
        """Specific force and angular rate of the unit, (n, 3) each, m/s^2 and rad/s."""
        turning, turned = self._motion.inner.at(time)
        swung, swinging = self._motion.swing(time)
        spin, _ = self._motion.spin.at(time)
        roll = turned + swung
        up = np.stack(
            [np.zeros_like(roll), np.cos(roll), -np.sin(roll)], axis=1
        )  # of the cylinder, (forward, up, right)
        along, upward = self._earth
        rate = unit_rates(turning + swinging, spin, self._motion.angle(time, self._rig), self._rig)
        rate += (upward * up + [along, 0.0, 0.0]) @ self._to_unit.T
        return self._gravity * up @ self._to_unit.T, rate

    def columns(self, time: Array) -> dict[str, Array]:
        """Reading of the encoder, between zero and one turn."""
        angle = self._motion.angle(time + self._rig.delay, self._rig)
        return {"encoder": np.mod(encoder_reading(angle, self._rig, self._step), _TURN)}
