"""Sets of positions of a unit on a table: which way is up in the unit, and the angles that bring it there."""

from __future__ import annotations

import math

import numpy as np

from ..errors import InputError
from ..frames import Array
from ..rigs.turntable import STANDARD, Letters
from .plans import CHECK, ICOSAHEDRON

Angles = tuple[float, float, float]
"""Of outer, middle and inner axis, rad."""

_FACES = ((0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
# azimuth of x and y [deg] and direction of z ([ZHOU13])
_FOUR = ((45, 315, "up"), (45, 135, "down"), (225, 315, "down"), (225, 135, "up"))
_UNIT = dict(zip("xyz", np.eye(3), strict=True))
_REACHED = 1e-9


def named(name: str, letters: Letters = STANDARD, axes: int = 3) -> list[Angles]:
    """Angles of the positions of a set.

    Parameters
    ----------
    name : str
        ``icosahedron`` (12; on the usual table with the angles printed in [DONG18]), ``dodecahedron`` (20), ``cube-6``,
        ``cube-12`` (each face up in two headings), ``cube-24`` (in four), or ``check`` (8 other positions, for verification).
    letters : tuple of str
        What the axes turn about.
    axes : int
        How many of them the table has; the others stay at zero.

    Returns
    -------
    list of (outer, middle, inner), rad

    Raises
    ------
    InputError
        When this table cannot bring a direction up.
    """
    if name in ("icosahedron", "check") and letters == STANDARD:
        printed = ICOSAHEDRON if name == "icosahedron" else CHECK
        return [(math.radians(a), math.radians(b), math.radians(c)) for a, b, c in printed]
    headings = {"cube-12": (0.0, math.pi), "cube-24": tuple(math.pi / 2 * i for i in range(4))}.get(name, (0.0,))
    out = []
    for direction in directions(name):
        angles = bring_up(direction, letters, axes)
        for heading in headings:
            # a vertical outer axis turns the unit about the vertical; another one cannot
            turned = heading if letters[0] == "z" else 0.0
            out.append((angles[0] + turned, angles[1], angles[2]))
    if letters[0] != "z" and len(headings) > 1:
        raise InputError(f"{name} turns each face about the vertical, which needs a vertical outer axis (rig.axes)")
    return out


def four_positions() -> list[tuple[float, float, str]]:
    """Azimuths of x and y, rad, and the direction of z in the four positions of [ZHOU13]."""
    return [(math.radians(x), math.radians(y), z) for x, y, z in _FOUR]


def directions(name: str) -> Array:
    """Unit vectors that a set brings up one after the other, in the case, shape (n, 3)."""
    if name.startswith("cube"):
        return np.array(_FACES, dtype=float)
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    if name == "icosahedron":
        corners = [(0.0, a, b * golden) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    elif name == "dodecahedron":
        corners = [(0.0, a / golden, b * golden) for a in (-1, 1) for b in (-1, 1)]
    else:  # the check positions of the usual table, as directions
        return np.array(
            [
                (-math.sin(i) * math.cos(m), math.sin(m), math.cos(i) * math.cos(m))
                for _, m, i in np.radians(np.array(CHECK, dtype=float))
            ]
        )
    out = [np.roll(c, k) for k in range(3) for c in corners]
    if name == "dodecahedron":
        out += [np.array([a, b, c]) for a in (-1.0, 1.0) for b in (-1.0, 1.0) for c in (-1.0, 1.0)]
    found = np.array(out)
    return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


def bring_up(direction: Array, letters: Letters = STANDARD, axes: int = 3) -> Angles:
    """Angles that turn a direction of the case to the vertical.

    Two neighbouring axes do it, the first of which is horizontal at zero: the second brings the direction into the plane
    across the first, and the first brings it up.

    Parameters
    ----------
    direction : ndarray, shape (3,)
        Unit vector in the case.
    letters : tuple of str
    axes : int
        How many axes the table has.

    Raises
    ------
    InputError
        When the table cannot.
    """
    first = 0 if letters[0] != "z" else 1
    p, q = _UNIT[letters[first]], _UNIT[letters[first + 1]]
    if first + 1 < axes:
        # p . Rot_q(a) d = cos(a) (p . d) + sin(a) (p . q x d) = 0
        a = math.atan2(-float(p @ direction), float(p @ np.cross(q, direction)))
        v = (
            direction * math.cos(a)
            + np.cross(q, direction) * math.sin(a)
            + q * float(q @ direction) * (1 - math.cos(a))
        )
    else:
        a, v = 0.0, direction
        if first >= axes or abs(float(p @ v)) > _REACHED:
            raise InputError(f"this table cannot bring the direction {np.round(direction, 3).tolist()} of the unit up")
    b = math.atan2(float(p @ np.cross(v, _UNIT["z"])), float(v[2]))
    out = [0.0, 0.0, 0.0]
    out[first], out[first + 1] = b, a
    return out[0], out[1], out[2]
