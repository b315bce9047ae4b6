"""Do slave and master speak of the same motion? Axes, signs, units and conventions that do not fit are found and named.

Before any filter runs, means over windows of what the slave feels are held against what the master's log says it should feel.
They may differ by what the configuration allows (mounting, biases, noise). Where they differ by more, both logs are read
otherwise (axes exchanged, signs turned, other units, other conventions of the master's angles): when another reading explains
what this one does not, the data are refused with its name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import permutations, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError, InputError
from ...frames import Array, attitude_matrix, heading_pitch_roll, rotation_vector, skew, wahba
from .windows import Intervals, Windows, intervals, predicted, windows

if TYPE_CHECKING:
    from ..config import Config
    from ..master import Master
    from ..samples import Slave

AXES = ("x", "y", "z")
_SPANS = (2.0, 60.0)  # s: windows that see turns, and windows that see the Earth turn
_LIMIT = 6.0  # times the misfit allowed, beyond which the logs are doubted
_HOPELESS = 30.0  # and beyond which no filter is tried
_BETTER = 0.3  # share of the misfit that another reading may leave
_ALIKE = 1.5  # readings whose misfits differ by less are equally good: the simplest is told
_GAIN = 0.01  # error of the sensors' scale that is nobody's mistake, in motion
_CONSTANT = 0.002  # and of what they feel on the mean
_LATE = 0.05  # share of the change from window to window: a master that is a little late is not told here
_EXPLAINED = 15.0  # misfit above which no reading explains anything

_SCALES = {
    "accel": (
        (1.0, ""),
        (1 / 9.80665, "the samples look like m/s^2 but are labelled g"),
        (9.80665, "the samples look like g but are labelled m/s^2"),
        (1e3, "the samples look like g but are labelled mg"),
        (1e-3, "the samples look like mg but are labelled g"),
    ),
    "gyro": (
        (1.0, ""),
        (math.pi / 180, "the samples look like deg/s but are labelled rad/s"),
        (180 / math.pi, "the samples look like rad/s but are labelled deg/s"),
        (1 / 3600, "the samples look like deg/h but are labelled deg/s"),
        (3600.0, "the samples look like deg/s but are labelled deg/h"),
    ),
}
"""What samples are to be multiplied by, and how that is said."""
_REVERSED = {
    "accel": "the accelerometers have the other sign: at rest an upward axis must read +g",
    "gyro": "the gyros have the other sign: a turn to port must read plus about z, bow up plus about x",
}


class _Misfit(NamedTuple):
    """Rms of slave less master over what may be expected, of the accelerometers and of the gyros."""

    accel: float
    gyro: float

    @property
    def total(self) -> float:
        return max(1.0, math.hypot(*self))


@dataclass(frozen=True)
class _Reading:
    """Another way to read the logs: the simpler the less it costs."""

    words: str
    cost: float
    of_slave: bool
    misfit: _Misfit


def refuse_apart(slave: Slave, master: Master, latency: float) -> None:
    """Refuse logs that do not overlap in time, or a slave with a dead axis.

    Raises
    ------
    InputError
        With the times of both.
    DataError
        With the axis that is the same in all samples.
    """
    stamps = master.time - latency
    common = min(stamps[-1], slave.time[-1]) - max(stamps[0], slave.time[0])
    if common < 2.0 * master.interval:
        ratio = (stamps[-1] - stamps[0]) / (slave.time[-1] - slave.time[0])
        scale = next((f for f in (1e3, 1e-3, 1e6, 1e-6, 1e9, 1e-9) if 0.5 < ratio / f < 2.0), None)
        hint = "shift the clock of one of them" if scale is None else "check the unit of both time columns"
        raise InputError(
            f"{master.name} ({stamps[0]:.9g} to {stamps[-1]:.9g} s) and {slave.name} ({slave.time[0]:.9g} to "
            f"{slave.time[-1]:.9g} s) do not overlap: are they of the same run, on the same clock? If so, {hint}"
        )
    for sensor, values in (("accel", slave.pushes), ("gyro", slave.turns)):
        moving = np.ptp(values / slave.steps[:, None], axis=0) > 0
        if moving.any() and not moving.all() and slave.steps.size > 100:
            axis = AXES[int(np.argmin(moving))]
            raise DataError(
                f"{slave.name}: {sensor}_{axis} is the same in all samples while others change: a dead channel"
            )


def refuse_other_reading(slave: Slave, master: Master, config: Config) -> list[str]:
    """Refuse logs that do not fit while another reading of them does.

    Parameters
    ----------
    slave : Slave
    master : Master
        With attitude.
    config : Config
        What they may differ by.

    Returns
    -------
    list of str
        Misfits that no reading explains; worth knowing if the filter has trouble.

    Raises
    ------
    DataError
        Naming what is likely wrong.
    """
    found = _Comparison(intervals(slave, master, config.latency), master, config)
    sides = [i for i in range(2) if found.misfit[i] > _LIMIT]
    if not sides:
        return []
    sizes = [_size(i, found.rms[i]) for i in sides]
    words = _explained(found, sides) or found.beyond(sides)
    if words:
        raise DataError(f"{slave.name} does not fit {master.name}, its {' and its '.join(sizes)}: {words}")
    if max(found.misfit) < 2.0 * _LIMIT:  # single outliers come to as much
        return []
    text = (
        f"{slave.name} differs from what {master.name} says, in {' and '.join(sizes)}: {max(found.misfit):.2g} times what "
        "[initial] and [noise] allow, and no other axes, signs, units or conventions explain it"
    )
    if max(found.misfit) > _HOPELESS:
        raise DataError(f"{text}: are the two logs of the same run?")
    return [text]


def _size(sensor: int, rms: float) -> str:
    """A misfit of specific force (0) or angular rate (1), SI, in words."""
    if sensor == 0:
        return f"specific force by {rms:.3g} m/s^2 rms"
    degrees = math.degrees(rms)
    return (
        f"angular rate by {degrees:.3g} deg/s rms"
        if degrees > 0.1
        else f"angular rate by {3600 * degrees:.3g} deg/h rms"
    )


class _Scale:
    """Slave against master in windows of one length, ``felt = p + p x mu + b`` with the mounting mu and the bias b.

    Parameters
    ----------
    given : Intervals
    master : Master
    config : Config
    span : float, s
    """

    def __init__(self, given: Intervals, master: Master, config: Config, span: float) -> None:
        self._given, self._master, self._config = given, master, config
        self._span = max(span, 10.0 * master.interval)
        self.base = self.of(master)
        self._noise = self._uneven(self.base)
        flexing = 0.0 if config.flexure is None else np.square(config.flexure.sigma)
        self.mounting = np.sqrt(np.square(config.initial.misalignment) + flexing + 1e-10)
        biases = config.initial.accel_bias, config.initial.gyro_bias
        self.sigma = [
            np.concatenate(
                [self.mounting, np.hypot(np.array(bias) + 1e-12, _CONSTANT * np.linalg.norm(p.mean(axis=0)))]
            )
            for bias, p in zip(biases, (self.base.force, self.base.rate), strict=True)
        ]

    def of(self, master: Master) -> Windows:
        """With the predictions of a master's log."""
        return windows(self._given, *predicted(master, self._given.number, self._config), self._span)

    def _uneven(self, given: Windows) -> tuple[Array, Array]:
        """What slave and master may differ by from window to window, m/s^2 and rad/s, (n, 3)."""
        first, noise, span = self._config.initial, self._config.noise, given.span
        flexing = 0.0 if self._config.flexure is None else float(np.linalg.norm(self._config.flexure.sigma))
        angle = _attitude_noise(self._master) + flexing
        mounted = float(np.linalg.norm(first.misalignment))
        curved = 0.5 * mounted**2
        lever = float(np.linalg.norm(self._config.lever_arm)) + float(np.linalg.norm(first.lever_arm or 0.0))
        rate = np.linalg.norm(given.rate, axis=1)
        carried = lever * (rate**2 + _greatest_change(given.rate) / span)
        accel = noise.accel**2 / span + 2.0 * (noise.velocity / span) ** 2 + carried**2
        gyro = noise.gyro**2 / span + 2.0 * (angle / span) ** 2
        out = []
        for p, own, turned in ((given.force, accel, angle + curved), (given.rate, gyro, curved)):
            varying = _GAIN * (p - p.mean(axis=0))
            step = _LATE * np.diff(p, axis=0, prepend=p[:1], append=p[-1:])
            sudden = mounted * (np.linalg.norm(step[1:], axis=1) + np.linalg.norm(step[:-1], axis=1)) / _LATE
            common = own + (turned * np.linalg.norm(p, axis=1)) ** 2 + sudden**2
            out.append(np.maximum(np.sqrt(common[:, None] + varying**2 + step[1:] ** 2 + step[:-1] ** 2), 1e-15))
        return out[0], out[1]

    def misfit(self, sensor: int, felt: Array, other: Windows | None = None) -> float:
        """Of accelerometers (0) or gyros (1) against a prediction, with mounting and bias as far as they are likely."""
        left, x = self.fit(sensor, felt, other)
        return math.sqrt(left + float(np.mean(x**2)))

    def fit(self, sensor: int, felt: Array, other: Windows | None = None) -> tuple[float, Array]:
        """Mean square of what mounting and bias leave, over what it may be, and both of them over what they may be, (6,)."""
        to = other or self.base
        p = (to.force, to.rate)[sensor]
        sigma, noise = self.sigma[sensor], (self._noise if other is None else self._uneven(other))[sensor]
        A = np.concatenate([skew(p), np.broadcast_to(np.eye(3), (len(p), 3, 3))], axis=-1) / noise[..., None]
        y = (felt - p) / noise
        kept: NDArray[np.int64] = np.arange(len(p))
        x: Array = np.zeros(6)
        left: Array = np.zeros(len(p))
        # a tenth may be anything, outliers or a turn that comes a little late: the second time without it
        for _ in range(2):
            rows, wanted = A[kept].reshape(-1, 6), y[kept].ravel()
            N = (rows.T @ rows + np.diag(1.0 / sigma**2)) * np.outer(sigma, sigma)
            x = np.asarray(np.linalg.solve(N, sigma * (rows.T @ wanted)), dtype=float)
            left = ((y - A @ (sigma * x)) ** 2).sum(axis=1)
            kept = np.argsort(left)[: max(1, len(p) - len(p) // 10)]
        return float(left[kept].mean()) / 3.0, x


class _Comparison:
    """Slave against master in short windows, that see it turn, and in long ones, that see the Earth turn."""

    def __init__(self, given: Intervals, master: Master, config: Config) -> None:
        self._master = master
        self._scales = [_Scale(given, master, config, span) for span in _SPANS]
        self.misfit = self.judge(np.eye(3), np.eye(3))
        base = self._scales[0].base
        self.rms = tuple(
            float(np.sqrt(((a - b) ** 2).sum(axis=1).mean()))
            for a, b in ((base.felt, base.force), (base.turned, base.rate))
        )

    def judge(self, accel: Array | None, gyro: Array | None, master: Master | None = None) -> _Misfit:
        """Misfits with the samples multiplied by matrices (None: left as they are), or against another master."""
        out = [0.0, 0.0]
        for scale in self._scales:
            other = None if master is None else scale.of(master)
            for i, (matrix, felt) in enumerate(((accel, scale.base.felt), (gyro, scale.base.turned))):
                if matrix is None:
                    out[i] = self.misfit[i]
                else:
                    out[i] = max(out[i], scale.misfit(i, felt @ matrix.T, other))
        return _Misfit(*out)

    def beyond(self, sides: list[int]) -> str:
        """Mounting and biases far beyond ``[initial]`` that would explain the misfit, in words; empty when they do not."""
        parts = []
        for i in sides:
            scale = self._scales[-1]
            base = scale.base
            left, x = scale.fit(i, (base.felt, base.turned)[i])
            far = np.flatnonzero(np.abs(x) > _LIMIT)
            if left > _LIMIT**2 or not far.size:
                return ""
            size = x * scale.sigma[i]
            bias, unit, factor = (("accel_bias", "mg", 1e3 / 9.80665), ("gyro_bias", "deg/h", 648000.0 / math.pi))[i]
            parts += [
                f"misalignment {AXES[k]} {math.degrees(size[k]):.2g} deg"
                if k < 3
                else f"{bias} {AXES[k - 3]} {size[k] * factor:.2g} {unit}"
                for k in far.tolist()
            ]
        return f"it would fit with {', '.join(parts)}, far more than [initial] says; write more there if the unit is like that"

    def readings(self) -> Iterator[_Reading]:
        """All others."""
        for sensor in ("accel", "gyro"):
            for (scale, said), (matrix, cost, words) in product(_SCALES[sensor], _signed_permutations()):
                if scale == 1.0 and cost == 0.0:
                    continue
                mended = scale * matrix
                misfit = self.judge(mended, None) if sensor == "accel" else self.judge(None, mended)
                parts = [p for p in (said, _REVERSED[sensor] if words == "-" else words.replace("~", sensor)) if p]
                yield _Reading(", and ".join(parts), cost + 0.8 * (scale != 1.0), True, misfit)
        for matrix, cost, _ in _signed_permutations():
            if cost and np.linalg.det(matrix) > 0:
                usual = np.array_equal(matrix, _FORWARD_RIGHT_DOWN)
                words = f"its axes are not x right, y forward, z up: {_pointing(matrix)}"
                yield _Reading(words, 1.0 if usual else 1.0 + 0.5 * cost, True, self.judge(matrix, matrix))
        eye = np.eye(3)
        for k, (words, change) in enumerate(_CONVENTIONS):
            misfit = self.judge(eye, eye, _with_angles(self._master, change))
            yield _Reading(f"{self._master.name}: {words}", 1.0 + 0.1 * k, False, misfit)
        turned = self._turned()
        angles = rotation_vector(turned)
        if np.linalg.norm(angles / self._scales[0].mounting) < _LIMIT:
            return
        degrees = np.degrees(angles)
        words = (
            f"it seems to be turned against the master by {degrees[0]:.3g}, {degrees[1]:.3g}, {degrees[2]:.3g} deg about "
            "x, y, z, far more than initial.misalignment says; if it is not mounted so, the master's angles are wrong"
        )
        yield _Reading(words, 9.0, True, self.judge(turned, turned))

    def _turned(self) -> Array:
        """Rotation that takes what the slave felt best to what the master says, (3, 3)."""
        here, there = [], []
        for scale in self._scales:
            base = scale.base
            for felt, p in ((base.felt, base.force), (base.turned, base.rate)):
                size = math.sqrt(float((p**2).sum()))
                here.append(felt / size)
                there.append(p / size)
        return wahba(np.concatenate(here), np.concatenate(there))


def _explained(found: _Comparison, sides: list[int]) -> str:
    """What would explain the misfit of the accelerometers (0) or gyros (1), in words; empty when nothing does."""
    before = found.misfit
    others = list(found.readings())

    def mends(reading: _Reading, wanted: list[int]) -> bool:
        rest = [i for i in range(2) if i not in wanted]
        unharmed = all(reading.misfit[i] <= max(_LIMIT, 1.01 * before[i]) for i in rest)
        return unharmed and all(reading.misfit[i] < min(_EXPLAINED, _BETTER * before[i]) for i in wanted)

    told = []
    for wanted in [sides] if len(sides) == 1 else [sides, [0], [1]]:
        good = [r for r in others if mends(r, wanted)]
        if good:
            told.append(_simplest(good))
            if wanted == sides:
                break
    return "; and ".join(told)


def _simplest(good: list[_Reading]) -> str:
    """The simplest of the best readings; two of them where slave and master may be to blame alike."""
    least = min(r.misfit.total for r in good)
    best = sorted((r for r in good if r.misfit.total <= _ALIKE * least), key=lambda r: r.cost)
    told = [best[0], *[r for r in best if r.of_slave != best[0].of_slave][:1]]
    return "; or else ".join(r.words for r in told)


# the mistake made most often: x forward, y right, z down; these are what x, y, z of the house read from such columns
_FORWARD_RIGHT_DOWN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_DIRECTIONS = (("right", "left"), ("forward", "backward"), ("up", "down"))


@lru_cache(maxsize=1)
def _signed_permutations() -> tuple[tuple[Array, float, str], ...]:
    """All 48: matrix from the columns as they are to x, y, z, what it costs to believe, and words with ~ for the sensor."""
    out = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            moved, turned = sum(o != i for i, o in enumerate(order)), signs.count(-1.0)
            if not moved and turned == 3:
                out.append((matrix, 1.0, "-"))
                continue
            parts = [
                f"~_{AXES[o]} has the other sign"
                if o == i
                else f"~_{AXES[o]} reads {'minus ' if s < 0 else ''}what ~_{AXES[i]} should"
                for i, (o, s) in enumerate(zip(order, signs, strict=True))
                if o != i or s < 0
            ]
            out.append((matrix, moved + 1.2 * turned, ", ".join(parts)))
    return tuple(out)


def _pointing(matrix: Array) -> str:
    """Where the axes of the columns point."""
    parts = []
    for i in range(3):
        axis = int(np.argmax(np.abs(matrix[:, i])))
        parts.append(f"{AXES[i]} points {_DIRECTIONS[axis][int(matrix[axis, i] < 0)]}")
    return ", ".join(parts)


_Angles = Callable[[Array, Array, Array], tuple[Array, Array, Array]]
_DEG = math.pi / 180.0
_CONVENTIONS: tuple[tuple[str, _Angles], ...] = (
    ("its heading is counted counter-clockwise; it must grow when turning to starboard", lambda h, p, r: (-h, p, r)),
    (
        "its heading is counted from east, counter-clockwise; it must be clockwise from north",
        lambda h, p, r: (math.pi / 2 - h, p, r),
    ),
    ("its pitch has the other sign; bow up is positive", lambda h, p, r: (h, -p, r)),
    ("its roll has the other sign; starboard down is positive", lambda h, p, r: (h, p, -r)),
    ("its pitch and roll have the other sign", lambda h, p, r: (h, -p, -r)),
    ("its pitch and roll are exchanged", lambda h, p, r: (h, r, p)),
    ("its heading is 180 deg off", lambda h, p, r: (h + math.pi, p, r)),
    ("its heading is counted from east, clockwise", lambda h, p, r: (h + math.pi / 2, p, r)),
    ("its heading is counted from west, clockwise", lambda h, p, r: (h - math.pi / 2, p, r)),
    ("its angles look like radians but are labelled as degrees", lambda h, p, r: (h / _DEG, p / _DEG, r / _DEG)),
    ("its angles look like degrees but are labelled as radians", lambda h, p, r: (h * _DEG, p * _DEG, r * _DEG)),
)


def _with_angles(master: Master, change: _Angles) -> Master:
    assert master.attitude is not None  # refused before
    angles = heading_pitch_roll(master.attitude)
    return replace(master, attitude=attitude_matrix(*change(np.unwrap(angles[0]), *angles[1:])))


def _attitude_noise(master: Master) -> float:
    """Noise of the master's attitude, rad, from how unevenly it turns from sample to sample."""
    assert master.attitude is not None
    turn = rotation_vector(np.swapaxes(master.attitude[:-1], -1, -2) @ master.attitude[1:])
    if len(turn) < 3:
        return 0.0
    uneven = np.linalg.norm(np.diff(turn, axis=0), axis=1)
    return float(np.median(uneven)) / math.sqrt(6.0)


def _greatest_change(rate: Array) -> float:
    """Greatest change of the rate from window to window, rad/s."""
    return float(np.linalg.norm(np.diff(rate, axis=0), axis=1).max()) if len(rate) > 1 else 0.0
