"""Signs, swapped columns and wrong units, found from the first matrices of a fit and named."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..frames import Array
from ..sensors import AXES, signed_permutation

_MISREAD = {
    "accel": {
        9.80665: "the samples look like m/s^2 but are labelled g",
        1 / 9.80665: "the samples look like g but are labelled m/s^2",
    },
    "gyro": {
        57.29577951308232: "the samples look like deg/s but are labelled rad/s",
        1 / 57.29577951308232: "the samples look like rad/s but are labelled deg/s",
        3600.0: "the samples look like deg/h but are labelled deg/s",
        1 / 3600.0: "the samples look like deg/s but are labelled deg/h",
    },
}

_REVERSED = {
    "accel": "reads minus the specific force (at rest an upward axis must read +g)",
    "gyro": "wrong sense of rotation against the plan's rates and angles",
}


def check_scale(kind: str, matrix: Array) -> None:
    """Refuse SI readings whose gain is no gain of a sensor in that unit.

    Parameters
    ----------
    kind : str
        ``accel`` or ``gyro``.
    matrix : ndarray, shape (3, 3)
        First S of readings in SI.

    Raises
    ------
    DataError
        Naming the unit that would explain it.
    """
    gains = np.linalg.norm(matrix, axis=1)
    usual = float(np.median(gains))
    if np.all(np.abs(gains - 1.0) < 0.4):
        return
    for ratio, text in _MISREAD[kind].items():
        if abs(np.log(usual / ratio)) < 0.2:
            raise DataError(
                f"the {kind} gain is {usual:.4g} where 1 is expected: {text}. Correct the header or --units"
            )
    shown = ", ".join(f"{kind}_{a} {v:.4g}" for a, v in zip(AXES, gains, strict=True))
    raise DataError(
        f"gains of {shown} where 1 is expected: check the unit, the plan's rates and angles, or pass raw samples as counts"
    )


def common_scale(kind: str, matrix: Array) -> list[str]:
    """A word where all three SI gains are off alike: then what they were compared with is the likelier cause."""
    errors = np.linalg.norm(matrix, axis=1) - 1.0
    mean = float(errors.mean())
    if abs(mean) < 0.004 or np.ptp(errors) > 0.6 * abs(mean):
        return []
    cause = "gravity" if kind == "accel" else "outer_rate"
    text = (
        f"all three {kind} gains are off by about {100 * mean:.2g} %: check {cause} in the plan, which sets the scale"
    )
    return [text]


def scale_remarks(kind: str, matrix: Array, counts: bool) -> list[str]:
    """:func:`check_scale` and :func:`common_scale` for readings in SI; raw counts have no gain to compare with."""
    if counts:
        return []
    check_scale(kind, matrix)
    return common_scale(kind, matrix)


def check_linear(sensor: str, matrix: Array, seen: NDArray[np.bool_]) -> None:
    """Refuse readings whose linear part is no instrument's, as far as the positions show it.

    Parameters
    ----------
    sensor : str
        ``accel`` or ``gyro``.
    matrix : ndarray, shape (3, 3)
        S of readings in SI.
    seen : ndarray of bool, shape (3, 3)
        Which elements the positions determine.

    Raises
    ------
    DataError
        Naming the axis and what would explain it.
    """
    for i in range(3):
        if seen[i, i] and abs(matrix[i, i] - 1.0) > 0.4:
            gain = float(matrix[i, i])
            guesses = [
                text for ratio, text in _MISREAD[sensor].items() if abs(np.log(abs(gain) / ratio + 1e-300)) < 0.2
            ]
            cause = "the axis is dead, or two columns are swapped, or the plan's attitudes are wrong"
            if gain < -0.4:
                cause = "the sign of the column is reversed, or the plan's attitudes are (z up or down, the azimuths)"
            elif guesses:
                cause = guesses[0]
            raise DataError(
                f"{sensor}_{AXES[i]} answers to its input with a gain of {gain:.3g} where 1 is expected: {cause}"
            )
        for j in range(3):
            if i != j and seen[i, j] and abs(matrix[i, j]) > 0.4:
                raise DataError(
                    f"{sensor}_{AXES[i]} answers to axis {AXES[j]} with a gain of {matrix[i, j]:.3g} where 0 is expected: two "
                    "columns are swapped, or the plan's azimuths are wrong"
                )


def check_sense(kind: str, measured: Array, nominal: Array, counts: bool) -> tuple[Array, list[str]]:
    """Signs of a triad calibrated by norm against the table's settings.

    A norm cannot tell a gain from minus it. The table can: a set of directions that fits the settings only through a
    mirror has an axis reversed or two columns swapped.

    Parameters
    ----------
    kind : str
        ``accel`` or ``gyro``.
    measured : ndarray, shape (n, 3)
        Directions of up (of the rate) found with all gains positive, in the triad's frame.
    nominal : ndarray, shape (n, 3)
        The same from the settings, in k.
    counts : bool
        Whether negative gains can be expressed (raw counts); SI readings with a wrong sign are refused.

    Returns
    -------
    signs : ndarray, shape (3,)
        Of the gains x, y, z.
    remarks : list of str

    Raises
    ------
    DataError
        Naming the axis or the swap.
    """
    left, values, right = np.linalg.svd(measured.T @ nominal)
    turn = left @ right  # b from k
    axes, signs = signed_permutation(turn)
    spread = values[2] > 0.05 * values[0]  # positions all in one plane look the same in a mirror
    if np.linalg.det(turn) > 0 or not spread:
        return np.ones(3), _turned_mount(turn) if spread else []
    if axes == (0, 1, 2):
        reversed_axes = [f"{kind}_{a}" for a, s in zip(AXES, signs, strict=True) if s < 0]
        text = f"{', '.join(reversed_axes)}: {_REVERSED[kind]}"
        if not counts:
            raise DataError(f"{text}. Change the sign of the column, or the plan's angles")
        return np.array(signs, dtype=float), [f"negative gain of {text}"]
    swapped = ", ".join(f"{kind}_{AXES[i]} answers to {AXES[axes[i]]}" for i in range(3) if axes[i] != i)
    raise DataError(f"the {kind} axes form a left-handed set: {swapped}. Two columns are swapped; see --map")


def _turned_mount(turn: Array) -> list[str]:
    angle = float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0))))
    if angle < 20.0:
        return []
    text = (
        f"the unit sits turned by {angle:.0f} deg against the table's case frame; if it did not, two axes have their signs "
        "reversed, columns are permuted, or the plan's angles are in another order"
    )
    return [text]


def check_accel_sense(matrix: Array, counts: bool) -> list[str]:
    """Order and signs of the accelerometers against the plan's axes.

    Parameters
    ----------
    matrix : ndarray, shape (3, 3)
        First S of the accelerometers in the table's case frame.
    counts : bool
        Whether negative gains can be expressed.

    Returns
    -------
    list of str
        Remarks.

    Raises
    ------
    DataError
        Naming the permutation or the reversed axis.
    """
    axes, signs = signed_permutation(matrix)
    if axes != (0, 1, 2):
        answers = ", ".join(f"accel_{AXES[i]} answers to {AXES[axes[i]]}" for i in range(3) if axes[i] != i)
        raise DataError(
            f"the accelerometers do not answer to the plan's axes: {answers}. Columns are permuted (--map) or the plan's angles "
            "are in another order"
        )
    negative = [f"accel_{AXES[i]}" for i, s in enumerate(signs) if s < 0]
    if not negative:
        return []
    text = f"{', '.join(negative)}: {_REVERSED['accel']}"
    if not counts:
        raise DataError(f"{text}. Change the sign of the column, or the plan's angles")
    return [f"negative gain of {text}"]


def check_gyro_sense(matrix: Array, counts: bool, against: str) -> list[str]:
    """Order and signs of the gyros against the accelerometers or the table.

    Parameters
    ----------
    matrix : ndarray, shape (3, 3)
        First S of the gyros in the accelerometers' frame.
    counts : bool
        Whether negative gains can be expressed.
    against : str
        What the gyros were compared with, for the message.

    Returns
    -------
    list of str
        Remarks.

    Raises
    ------
    DataError
        Naming the permutation or the wrong sense.
    """
    axes, signs = signed_permutation(matrix)
    if axes != (0, 1, 2):
        answers = ", ".join(
            f"gyro_{AXES[i]} answers to rotation about {AXES[axes[i]]}" for i in range(3) if axes[i] != i
        )
        raise DataError(f"the gyro columns are permuted against {against}: {answers}. Rename columns with --map")
    negative = [f"gyro_{a}" for a, s in zip(AXES, signs, strict=True) if s < 0]
    if not negative:
        return []
    if len(negative) == 3:
        text = (
            f"wrong sense of rotation: all three gyros turn against {against} (gyro signs reversed, a left-handed set of "
            f"axes such as two swapped columns{', or the sign of outer_rate' if 'plan' in against else ''})"
        )
    else:
        text = f"wrong sense of rotation: {', '.join(negative)} against {against}"
    if not counts:
        raise DataError(f"{text}. Change the sign of the columns or of the plan's rates")
    return [f"{text}; the gain is reported negative"]


def check_hand_turned_sense(matrix: Array, counts: bool) -> list[str]:
    """:func:`check_gyro_sense` against accelerometers whose gains were all taken as positive.

    One accelerometer that reads minus the specific force makes the two gyros across it seem reversed.

    Parameters
    ----------
    matrix : ndarray, shape (3, 3)
        First S of the gyros in the accelerometers' frame.
    counts : bool

    Returns
    -------
    list of str
        Remarks.

    Raises
    ------
    DataError
        Naming the permutation, the wrong sense, or both explanations where the data cannot choose.
    """
    axes, signs = signed_permutation(matrix)
    negative = [i for i, s in enumerate(signs) if s < 0]
    if axes == (0, 1, 2) and len(negative) == 2:
        other = ({0, 1, 2} - set(negative)).pop()
        raise DataError(
            f"wrong sense of rotation: either accel_{AXES[other]} reads minus the specific force (at rest an upward axis must "
            f"read more than its bias), or gyro_{AXES[negative[0]]} and gyro_{AXES[negative[1]]} are both reversed; the log "
            "cannot tell which. Change the sign of the column or columns at fault"
        )
    remarks = check_gyro_sense(matrix, counts, "the accelerometers")
    if not counts:
        check_scale("gyro", matrix)
    return remarks
