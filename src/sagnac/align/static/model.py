r"""What a unit that stays at its place says of its attitude: the specific force, integrated twice in an inertial frame.

Frames: s is the body at the start, kept inertially; i is east, north, up at the middle of the time, kept inertially; b and n as
everywhere. With W = w_ie, r the displacement of the unit from its place (it sways), g the size of gravity, U upward::

    int C_b^i f dt = C_n^i r' + int g U dt  (+ W x r, which is below a micrometre per second),   U(t) = exp([W (t - t_mid) x]) u

Integrated once more, the unknown sway enters only as the bounded displacement r. Gyros that read eps too much turn C_b^s by
-A eps, with ``A = int C_b^s dt``, and accelerometers that read nab too much add it, so that to first order in them, and exactly
in the attitude::

    C_s^i (P + H eps - B nab) - int int g U = r + r_0 + v_0 t,   P = int int C_b^s f,  H = int int [C_b^s f x] A,  B = int A

which is what this module sums up, in one pass over the samples, block by block. The attitude of the body may change as it likes:
a unit that is turned on its place tells more than one at rest, and needs no other formula.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

import numpy as np

from ...errors import DataError
from ...frames import Array, cross, rotation_matrix, rotation_vector, skew, transform
from ...kernels.attitude import compose
from ...navigate.stream import Piece

_SHORTEST = 0.2
"""s: blocks while samples come; for long times they are joined."""
_MOST = 1500
_LEAST = 10.0  # s


@dataclass(frozen=True)
class Blocks:
    """Sums over the blocks, see the module. Times count from the start.

    Attributes
    ----------
    start : float, s
        Time of the first increment's beginning, on the recording's clock.
    end : ndarray, shape (m,), s
    length : ndarray, shape (m,), s
    place : ndarray, shape (m, 3), m
        P, the mean over each block.
    gyro, accel : ndarray, shape (m, 3, 3), m s and s^2
        H and B, the mean over each block.
    speed : ndarray, shape (m, 3), m/s
        The first integral of the specific force in s, at the end of each block.
    speed_gyro : ndarray, shape (m, 3, 3), m
        Its derivative to eps, ``int [C_b^s f x] A``, at the end.
    turned : ndarray, shape (m, 3, 3), s
        A, at the end.
    C_b_s : ndarray, shape (m, 3, 3)
        At the end.
    rate : ndarray, shape (m, 3), rad/s
        Mean of each block, in s.
    body_force, body_rate : ndarray, shape (m, 3), m/s^2 and rad/s
        Means in body axes.
    """

    start: float
    end: Array
    length: Array
    place: Array
    gyro: Array
    accel: Array
    speed: Array
    speed_gyro: Array
    turned: Array
    C_b_s: Array
    rate: Array
    body_force: Array
    body_rate: Array

    @property
    def middle(self) -> Array:
        """Middle of each block, shape (m,), s from the start."""
        return self.end - 0.5 * self.length

    def head(self, count: int) -> Blocks:
        """The first blocks only."""
        return replace(self, **{f.name: getattr(self, f.name)[:count] for f in fields(self) if f.name != "start"})


_MEANS = ("place", "gyro", "accel", "rate", "body_force", "body_rate")
_ENDS = ("speed", "speed_gyro", "turned", "C_b_s")


class _Sums:
    """Running integrals, and what has been summed of each block so far."""

    def __init__(self) -> None:
        self.time, self.quaternion = 0.0, np.array([0.0, 0.0, 0.0, 1.0])
        self.before = (np.zeros(3), np.zeros(3))
        self.speed, self.place = np.zeros(3), np.zeros(3)
        self.turned, self.accel, self.speed_gyro, self.gyro = (np.zeros((3, 3)) for _ in range(4))
        self.number: list[Array] = []
        self.rows: dict[str, list[Array]] = {name: [] for name in (*_MEANS, *_ENDS, "length", "end")}

    def add(self, piece: Piece) -> None:
        """Take in the next increments."""
        h, turns, pushes = piece.steps, piece.turns, piece.pushes
        begin, end = self._attitudes(turns)
        pushed = _running(self.speed, transform(begin, self._unrotated(turns, pushes)))
        gained = np.diff(pushed, axis=0)
        A = _running(self.turned, 0.5 * h[:, None, None] * (begin + end))
        G = _running(self.speed_gyro, skew(gained) @ _middle(A))
        P, B, H = (
            _running(at, h.reshape(-1, *[1] * at.ndim) * _middle(first))
            for at, first in ((self.place, pushed), (self.accel, A), (self.gyro, G))
        )
        time = _running(np.array(self.time), h)
        number = np.floor((time[:-1] + 0.5 * h) / _SHORTEST)
        first = np.flatnonzero(np.diff(number, prepend=-1.0))
        last = np.append(first[1:], number.size) - 1
        weighted = {
            "place": h[:, None] * _middle(P),
            "gyro": h[:, None, None] * _middle(H),
            "accel": h[:, None, None] * _middle(B),
            "rate": transform(begin, turns),
            "body_force": pushes,
            "body_rate": turns,
            "length": h,
        }
        for name, values in weighted.items():
            self.rows[name].append(np.add.reduceat(values, first, axis=0))
        ends = {"speed": pushed[1:], "speed_gyro": G[1:], "turned": A[1:], "C_b_s": end, "end": time[1:]}
        for name, values in ends.items():
            self.rows[name].append(values[last])
        self.number.append(number[first])
        self.speed, self.place, self.turned, self.accel = pushed[-1], P[-1], A[-1], B[-1]
        self.speed_gyro, self.gyro, self.time = G[-1], H[-1], float(time[-1])
        self.before = (turns[-1], pushes[-1])

    def _attitudes(self, turns: Array) -> tuple[Array, Array]:
        """C_b^s before and after each increment, shape (n, 3, 3)."""
        from scipy.spatial.transform import Rotation

        quaternions = compose(turns, self.before[0], self.quaternion)
        both = Rotation.from_quat(np.vstack([self.quaternion, quaternions])).as_matrix()
        self.quaternion = quaternions[-1]
        return both[:-1], both[1:]

    def _unrotated(self, turns: Array, pushes: Array) -> Array:
        """Increments of velocity in the axes that the body had before each: rotation and sculling (Savage 1998)."""
        turn, push = (np.vstack([b, v[:-1]]) for b, v in zip(self.before, (turns, pushes), strict=True))
        turning = cross(turns, pushes)
        sculling = cross(turn, pushes) + cross(push, turns)
        return np.asarray(pushes + 0.5 * turning + cross(turns, turning) / 6.0 + sculling / 12.0)


def _running(start: Array, increments: Array) -> Array:
    """Running sums with the start in front, shape (n + 1, ...)."""
    return np.cumsum(np.concatenate([start[None], increments]), axis=0)


def _middle(ends: Array) -> Array:
    """Means of neighbours, shape (n, ...) of (n + 1, ...)."""
    return np.asarray(0.5 * (ends[1:] + ends[:-1]))


def collect(pieces: Iterable[Piece]) -> Blocks:
    """Sum up the increments of a unit.

    Parameters
    ----------
    pieces : iterable of Piece
        Without gaps, as :class:`sagnac.navigate.stream.Stream` hands them out.

    Returns
    -------
    Blocks
        Of a fifth of a second, or so long that there are not more than some 1500.

    Raises
    ------
    DataError
        When there is too little time in them.
    """
    sums, start = _Sums(), np.nan
    for piece in pieces:
        start = piece.begin if np.isnan(start) else start
        sums.add(piece)
    if sums.time < _LEAST:
        raise DataError(
            f"{sums.time:.3g} s of samples are too few for an alignment; half a minute is short and five minutes are usual"
        )
    return _grouped(
        float(start), np.concatenate(sums.number), {n: np.concatenate(r) for n, r in sums.rows.items()}, _MOST
    )


def read_otherwise(blocks: Blocks, gyro: Array) -> Blocks:
    """The same blocks with gyros whose axes are others.

    Parameters
    ----------
    blocks : Blocks
    gyro : ndarray, shape (3, 3)
        Takes rates as they were read to those of the other reading.

    Returns
    -------
    Blocks
        Put together from the blocks' rotations and mean forces: good to a centimetre or so.
    """
    before = np.concatenate([np.eye(3)[None], blocks.C_b_s[:-1]])
    turns = rotation_vector(np.swapaxes(before, -1, -2) @ blocks.C_b_s) @ gyro.T
    begin = blocks.start
    return collect([Piece(begin, begin + blocks.end, blocks.length, turns, blocks.body_force * blocks.length[:, None])])


def joined(blocks: Blocks, most: int) -> Blocks:
    """The same in longer blocks, not more than so many."""
    rows = {f.name: getattr(blocks, f.name) for f in fields(blocks) if f.name != "start"}
    for name in _MEANS:
        rows[name] = rows[name] * blocks.length.reshape(-1, *[1] * (rows[name].ndim - 1))
    return _grouped(blocks.start, np.arange(float(blocks.end.size)), rows, most)


def _grouped(start: float, number: Array, rows: dict[str, Array], most: int) -> Blocks:
    """Blocks of sums over parts of blocks, in the order of time, with the number of the block that each belongs to."""
    group = np.floor((number - number[0]) / -(-np.unique(number).size // most))
    first = np.flatnonzero(np.diff(group, prepend=-1.0))
    last = np.append(first[1:], group.size) - 1
    length = np.add.reduceat(rows["length"], first)
    out = {n: np.add.reduceat(rows[n], first, axis=0) for n in _MEANS}
    out = {n: v / length.reshape(-1, *[1] * (v.ndim - 1)) for n, v in out.items()}
    return Blocks(start=start, end=rows["end"][last], length=length, **out, **{n: rows[n][last] for n in _ENDS})


def upward(t: Array, middle: float, rate: Array) -> tuple[Array, Array, Array]:
    """The upward direction at the place, seen from i, and integrated once and twice from zero.

    Parameters
    ----------
    t : ndarray, shape (k,), s
        From the start.
    middle : float, s
        When i is east, north, up.
    rate : ndarray, shape (3,), rad/s
        Earth rate in east, north, up.

    Returns
    -------
    ndarray, shape (k, 3), of size one, s and s^2
    """
    w = float(np.linalg.norm(rate))
    axis = rate / w
    up = np.array([0.0, 0.0, 1.0])
    along = (up @ axis) * axis
    flat, side = up - along, np.cross(axis, up)
    # the turning part at the start, and a quarter of a turn later
    c, s = np.cos(w * middle), np.sin(w * middle)
    x, y = c * flat - s * side, s * flat + c * side
    a = w * t
    sine, less = np.sin(a), 2.0 * np.sin(0.5 * a) ** 2
    direction = along + np.outer(1.0 - less, x) + np.outer(sine, y)
    once = np.outer(t, along) + (np.outer(sine, x) + np.outer(less, y)) / w
    twice = np.outer(0.5 * t**2, along) + (np.outer(less, x) + np.outer(a - sine, y)) / w**2
    return direction, once, twice


def to_enu_of_inertial(t: float, middle: float, rate: Array) -> Array:
    """C_i_n at a time: takes coordinates in i to east, north, up then."""
    return rotation_matrix(-rate * (t - middle))
