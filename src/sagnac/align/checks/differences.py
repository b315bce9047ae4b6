"""What is in the difference of slave and master besides mounting and biases: the master's noise, and a lever arm.

From sample to sample of the master the slave's own rotation and change of velocity are as good as exact, so that the unevenness
of the difference is the master's noise. Over some seconds the slave's gyros carry an attitude on with no noise to speak of; then
a tilt phi of it, an accelerometer bias b and a lever arm l make the slave's velocity differ by ``sum (C p) x phi + sum C b dt +
C (w x l)``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...earth import STANDARD_GRAVITY
from ...errors import DataError
from ...frames import Array, cross, rot_z, rotation_matrix, skew, transform
from .timing import stretches
from .windows import Apart, Intervals, apart, intervals

if TYPE_CHECKING:
    from ..config import Config
    from ..master import Master
    from ..samples import Slave

_MEDIAN = 1.538  # of the length of a vector of three unit normal components
_SURE = 6.0  # standard deviations
_TELLABLE = 0.3  # share of the slave's own noise that the master's must have to be told from it
_NOISIER = 2.0  # times the noise stated that is refused


class Noise(NamedTuple):
    """White noise of the master's samples: velocity, m/s, and attitude, rad, one sigma of a component."""

    velocity: float
    attitude: float


class Lever(NamedTuple):
    """Lever arm from master to slave, shape (3,), m, and one sigma."""

    value: Array
    sigma: Array


def check(slave: Slave, master: Master, config: Config, late: float = 0.0) -> tuple[Noise, list[str]]:
    """Refuse a master that is noisier than stated, or a slave that sits where the configuration does not say.

    Parameters
    ----------
    slave : Slave
    master : Master
        With attitude.
    config : Config
    late : float, s
        Lateness of the master besides the latency, which the filter will find.

    Returns
    -------
    Noise
        That was found.
    list of str
        What is worth a word.

    Raises
    ------
    DataError
        With the noise or the lever arm that would fit.
    """
    given = intervals(slave, master, config.latency + late)
    found = apart(slave, given, master, config)
    noise = noise_of(given, found, config)
    if given.steps.size < 30:
        return noise, []
    said = _lever_told(slave, config, given, found, max(noise.velocity, config.noise.velocity))
    tilting = (
        STANDARD_GRAVITY * noise.attitude * master.interval
    )  # by the attitude that the slave's velocity is turned with
    for what, unit, size, seen, stated, more in (
        ("velocity", "m/s", 1.0, noise.velocity, config.noise.velocity, tilting),
        ("attitude", "arcmin", 10800.0 / math.pi, noise.attitude, config.noise.attitude, 0.0),
    ):
        if stated is not None and seen > _NOISIER * math.hypot(stated, more):
            raise DataError(
                f"{master.name}: its {what} is as noisy as {seen * size:.2g} {unit} from sample to sample, where noise.{what} "
                f'says {stated * size:.2g} {unit}: write noise.{what} = "{seen * size:.2g} {unit}", or mend the log'
            )
    return noise, said


def noise_of(given: Intervals, found: Apart, config: Config) -> Noise:
    """Noise of the master: how unevenly it parts from the slave, but for what mounting and noise of the slave do.

    Parameters
    ----------
    given : Intervals
    found : Apart
    config : Config
    """
    step = float(np.median(given.steps)) if given.steps.size else 0.0
    out = []
    for between, mounted, density in (
        (found.velocity, found.attitude @ skew(found.gained), config.noise.accel),
        (found.angle, skew(found.turned), config.noise.gyro),
    ):
        y, A = np.diff(between, axis=0), np.diff(mounted, axis=0)
        if len(y) < 6:
            out.append(0.0)
            continue
        mu = np.linalg.lstsq(A.reshape(-1, 3), y.ravel(), rcond=1e-9)[0]
        seen = float(np.median(np.linalg.norm(y - A @ mu, axis=1))) / _MEDIAN
        of_slave = 2.0 * density**2 * step
        variance = (seen**2 - of_slave) / 6.0
        out.append(math.sqrt(variance) if variance > _TELLABLE * of_slave else 0.0)
    return Noise(*out)


def lever_arm(given: Intervals, found: Apart, config: Config) -> Lever | None:
    """Where the slave sits, from its velocity against the master's; None where there is too little.

    Parameters
    ----------
    given : Intervals
    found : Apart
    config : Config
        What is known of the biases, the noise and the Earth's rate.
    """
    rows, wanted = [], []
    for part in stretches(given):
        A, y = _of_stretch(given, found, part, config.earth_rate)
        rows.append(A)
        wanted.append(y)
    if not rows:
        return None
    A, y = np.concatenate(rows), np.concatenate(wanted)
    sigma = np.concatenate([3.0 * np.array(config.initial.accel_bias) + 1e-9, np.full(3, 1e3)])
    scale = config.noise.velocity
    N = A.T @ A / scale**2 + np.diag(sigma**-2)
    inverse = np.linalg.inv(N * np.outer(sigma, sigma)) * np.outer(sigma, sigma)
    x = inverse @ (A.T @ y) / scale**2
    scores = np.array([a.T @ (b - a @ x) / scale**2 for a, b in zip(rows, wanted, strict=True)])
    spread = inverse + inverse @ (scores.T @ scores) @ inverse  # as noise has it, and as the stretches scatter
    return Lever(x[3:], np.sqrt(np.diag(spread)[3:]))


def _of_stretch(given: Intervals, found: Apart, part: slice, earth_rate: float) -> tuple[Array, Array]:
    """Rows for bias and lever arm, (3 n, 6), and what they are to explain, (3 n,), m/s: its own tilt and start taken out."""
    turned = np.concatenate([np.eye(3)[None], rotation_matrix(found.turned[part])])
    for i in range(1, len(turned)):
        turned[i] = turned[i - 1] @ turned[i]
    earth = rot_z(-earth_rate * np.concatenate([[0.0], np.cumsum(given.steps[part])]))
    first = np.swapaxes(earth[:-1], -1, -2) @ found.attitude[part] @ np.swapaxes(turned[:-1], -1, -2)
    left, _, right = np.linalg.svd(first.mean(axis=0))
    C = earth @ (left @ right) @ turned
    gained = transform(C[:-1], found.gained[part])
    moved = transform(found.attitude[part], found.gained[part]) - found.velocity[part]
    tilting = np.cumsum(skew(gained), axis=0)
    start = np.broadcast_to(np.eye(3), tilting.shape)
    biasing = np.cumsum(C[:-1] * given.steps[part, None, None], axis=0)
    swinging = C[1:] @ skew(found.rate[part])
    own = np.linalg.qr(np.concatenate([start, tilting], axis=-1).reshape(-1, 6))[0]
    A = np.concatenate([biasing, swinging], axis=-1).reshape(-1, 6)
    y = np.cumsum(gained - moved, axis=0).ravel()
    return A - own @ (own.T @ A), y - own @ (own.T @ y)


def _lever_told(slave: Slave, config: Config, given: Intervals, between: Apart, noise: float) -> list[str]:
    """Refuse a lever arm that shows in the velocity; speak of a smaller one."""
    found = lever_arm(given, between, config)
    if found is None or config.initial.lever_arm is not None:
        return []
    off = found.value - np.array(config.lever_arm)
    swing = cross(between.rate, np.broadcast_to(off, between.rate.shape))
    shown = float(np.sqrt((swing**2).sum(axis=1).mean()))
    sure = np.abs(off) > _SURE * found.sigma
    if not sure.any() or shown < 0.1 * noise:
        return []
    parts = ", ".join(f"{v:.2f} +- {s:.2f}" for v, s in zip(found.value, found.sigma, strict=True))
    text = (
        f"{slave.name} seems to sit at x, y, z = {parts} m from the master, not at lever_arm "
        f"({', '.join(f'{v:g}' for v in config.lever_arm)} m)"
    )
    if shown > noise:
        raise DataError(f"{text}: write lever_arm, or have it estimated with initial.lever_arm")
    return [f"{text}; it is not taken into account unless lever_arm or initial.lever_arm say so"]
