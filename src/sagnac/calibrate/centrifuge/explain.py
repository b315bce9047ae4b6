"""What is wrong when harmonics do not fit the plan: units, columns, signs, sense of rotation, gimbals, radius, a missing turn.

First a coarse look, with sensors taken as perfect, at what no sensor's errors could do; after a poor fit, the same fit with the
plan read otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ...errors import DataError
from ...frames import Array
from ...rigs.centrifuge import series
from ...rigs.turntable import Site
from .task import Fitted, Task, fit
from .turning import as_planned, freed

_POOR = 0.05  # misfit relative to the input that no sensor's errors make
_GOOD = 0.03
_GAIN = 0.4
_STILL = 0.1  # share of the expected amplitude below which nothing turned
_LARGE = 0.05  # share of the input from which an amplitude must show
_EXPLAINED = 1e-3  # chi-square probability of a reading that explains the data,
_LEFT = 0.02  # or this share of the misfit as planned
GIMBALS = ("alpha", "beta", "gamma")
_UNITS = {
    "accel": {9.80665: ("m/s^2", "g"), 1 / 9.80665: ("g", "m/s^2"), 1e3: ("mg", "g"), 1e-3: ("g", "mg")},
    "gyro": {
        57.29577951308232: ("deg/s", "rad/s"),
        1 / 57.29577951308232: ("rad/s", "deg/s"),
        3600.0: ("deg/h", "deg/s"),
        1 / 3600.0: ("deg/s", "deg/h"),
    },
}


class _Match(NamedTuple):
    """Gain of a measured series on an expected one, and what is left of it relative to it."""

    gain: float
    misfit: float


def _nominal(task: Task) -> dict[str, Array]:
    """Series of the inputs along x, y, z as (n, 3) of mean, cosine and sine, in the angle of the coefficients."""
    felt = series(task.arm, task.site, task.planned_rate, task.settings)
    seen = task.look()
    told = as_planned(seen, task.segments, task.plan)  # uncertain rates and phases as the samples show them
    ahead = told.to_angle @ [p.start for p in told.parameters]
    apart = np.where(np.isfinite(seen.angle_sigma), seen.angle + ahead - task.phase, 0.0)
    c, s = np.cos(apart)[:, None], np.sin(apart)[:, None]
    out = {}
    for kind, values in (("accel", felt.force), ("gyro", felt.rate)):
        mean, cos, sin = np.moveaxis(values, -1, 0)
        turned = np.stack([mean, cos * c + sin * s, sin * c - cos * s], axis=-1)
        there = np.nan_to_num(task.planned_angle)[:, None]
        turned[..., 0] += np.where(task.stands[:, None], cos * np.cos(there) + sin * np.sin(there), 0.0)
        turned[task.mean_only, :, 1:] = 0.0
        for i, axis in enumerate("xyz"):
            out[f"{kind}.{axis}"] = turned[:, i]
    return out


def _measured(task: Task, j: int) -> Array:
    out = task.plain()[0][:, j, :3].copy()
    out[task.mean_only, 1:] = 0.0
    return out


def _match(measured: Array, expected: Array, size: float) -> _Match:
    """Least squares of gain and bias, what is left relative to a size.

    Readings that the own input could hardly have caused are no match, nor a contradiction.
    """
    own = expected.copy()
    own[:, 0] -= own[:, 0].mean()
    share = float(np.linalg.norm(own)) / size
    told = measured.copy()
    told[:, 0] -= told[:, 0].mean()
    gain = float(np.sum(told * own) / max(np.sum(own**2), 1e-300)) if share > _LARGE else 1.0
    return _Match(gain, float(np.linalg.norm(told - gain * own)) / (max(abs(gain), 1e-3) * size))


def _sound(match: _Match) -> bool:
    return match.misfit < _POOR and abs(match.gain - 1.0) < _GAIN


def refuse_other_reading(task: Task) -> None:
    """Refuse harmonics that no sensor's errors bring together with the plan, naming what would.

    Parameters
    ----------
    task : Task

    Raises
    ------
    DataError
    """
    matches = _matches(task)
    bad = [j for j, m in matches.items() if not _sound(m)]
    if not bad:
        return
    _refuse_units(task, matches, bad)
    shown = ", ".join(_column(task, j) for j in bad)
    explained = _columns_answer(task, bad) + _plan_answers(task)
    if explained:
        least = min(misfit for misfit, _ in explained)
        words = " or ".join([w for misfit, w in explained if misfit < 1.5 * least + 1e-3][:4])
        raise DataError(
            f"{shown}: the readings do not fit the plan, but do if {words}. Correct the columns or the plan"
        )
    _refuse_still(task, bad)
    worst = max(bad, key=lambda j: matches[j].misfit)
    raise DataError(
        f"{_column(task, worst)} does not show what the plan says it felt: its gain on that is {matches[worst].gain:.3g}, and "
        f"{100 * min(matches[worst].misfit, 9.99):.2g} % is missed. Check arm_rate, arm_phase, alpha, beta, gamma, radius, the "
        "segments' times, and the columns' names and units"
    )


def _matches(task: Task) -> dict[int, _Match]:
    """Each column against the input along its own axis, as far as that is known: a counter-rotating gyro hardly has one."""
    expected, sizes = _nominal(task), _sizes(task)
    felt = [j for j, s in enumerate(task.sensors) if s.kind == "accel" or not task.arm.counter_rotating]
    own = [task.sensors[j] for j in felt]
    return {j: _match(_measured(task, j), expected[s.sensor], sizes[s.kind]) for j, s in zip(felt, own, strict=True)}


def _sizes(task: Task) -> dict[str, float]:
    """Size of the whole input over all segments."""
    expected = _nominal(task)
    return {k: float(np.sqrt(sum(np.sum(expected[f"{k}.{a}"] ** 2) for a in "xyz"))) for k in ("accel", "gyro")}


def _column(task: Task, j: int) -> str:
    return task.sensors[j].sensor.replace(".", "_")


def _refuse_units(task: Task, matches: dict[int, _Match], bad: list[int]) -> None:
    for j in bad:
        gain, misfit = matches[j]
        for ratio, (unit, label) in _UNITS[task.sensors[j].kind].items():
            if misfit < _POOR and gain > 0 and abs(np.log(gain / ratio)) < 0.2:
                raise DataError(
                    f"the gain of {_column(task, j)} is {gain:.4g} where 1 is expected: the samples look like {unit} but are "
                    f"labelled {label}. Correct the header or --units"
                )


def _columns_answer(task: Task, bad: list[int]) -> list[tuple[float, str]]:
    """Columns that answer to another axis, or to the other sign of their own: misfit and words."""
    expected, sizes, found = _nominal(task), _sizes(task), {}
    misfit = max([m.misfit for j, m in _matches(task).items() if j not in bad], default=0.0)
    for j in bad:
        own = task.sensors[j]
        matches = {a: _match(_measured(task, j), expected[f"{own.kind}.{a}"], sizes[own.kind]) for a in "xyz"}
        good = [a for a, m in matches.items() if m.misfit < _GOOD and abs(abs(m.gain) - 1.0) < _GAIN]
        if len(good) != 1:
            return []
        found[j] = ("-" if matches[good[0]].gain < 0 else "") + good[0]
        misfit = max(misfit, matches[good[0]].misfit)
    said = " and ".join(f"{_column(task, j)} answers to {a}" for j, a in found.items())
    if all(a == f"-{task.sensors[j].axis}" for j, a in found.items()):
        return [(misfit, f"{said} (the column's sign is reversed; at rest an upward accelerometer must read +g)")]
    return [(misfit, f"{said} (columns are swapped, see --map)")]


def _refuse_still(task: Task, bad: list[int]) -> None:
    """Segments said to turn that do not."""
    expected = _nominal(task)
    for i in np.flatnonzero(task.turns & ~task.mean_only):
        for j in bad:
            amplitude = float(np.linalg.norm(expected[task.sensors[j].sensor][i, 1:]))
            seen = float(np.linalg.norm(_measured(task, j)[i, 1:]))
            if amplitude > _LARGE * task.size and seen < _STILL * amplitude:
                raise DataError(
                    f"segment {task.names[i]!r} is said to turn at {np.degrees(task.planned_rate[i]):.6g} deg/s, but "
                    f"{_column(task, j)} hardly changes with the arm ({seen / 9.80665:.3g} g where {amplitude / 9.80665:.3g} g "
                    "is expected): the arm stood still or turned at another rate, the segment lies beside the run, or its alpha, "
                    "beta and gamma are those of another segment"
                )


def _plan_answers(task: Task) -> list[tuple[float, str]]:
    """Other readings of the plan under which every column fits: misfit and words."""
    good = []
    for words, other in readings(task):
        matches = _matches(other).values()
        if matches and all(_sound(m) for m in matches):
            good.append((max(m.misfit for m in matches), words))
    return good


def readings(task: Task) -> Iterator[tuple[str, Task]]:
    """The same data with the plan read otherwise, the simplest first.

    Parameters
    ----------
    task : Task

    Yields
    ------
    words : str
    Task
    """
    yield "the arm turned the other way (the sign of arm_rate)", task.reversed()
    for i, name in enumerate(GIMBALS):
        if np.any(task.settings[:, i]):
            signs = np.where(np.arange(3) == i, -1.0, 1.0)
            yield f"{name} has the other sign", replace(task, settings=task.settings * signs)
    told = [task.settings]
    for order in ((2, 1, 0), (1, 0, 2), (0, 2, 1), (1, 2, 0), (2, 0, 1)):  # exchanges of two first
        settings = task.settings[:, list(order)]
        if not any(np.array_equal(settings, other) for other in told):
            told.append(settings)
            swapped = ", ".join(f"{GIMBALS[i]} is {GIMBALS[order[i]]}" for i in range(3) if order[i] != i)
            yield f"the gimbals' angles are in another order ({swapped})", replace(task, settings=settings)
    if not np.any(task.mean_only & task.turns):
        other = "fixed to the arm" if task.arm.counter_rotating else "on a counter-rotating platform"
        arm = replace(task.arm, counter_rotating=not task.arm.counter_rotating)
        yield f"the unit is {other} (rig.counter_rotating)", replace(task, arm=arm)
    if np.isfinite(task.planned_angle[task.turns]).any():
        for degrees in (90.0, 180.0, -90.0):
            moved = replace(task, planned_angle=task.planned_angle + np.radians(degrees))
            yield f"arm_phase is {degrees:+.0f} deg off (it counts from east, counter-clockwise)", moved


def refuse_no_gain(fitted: Fitted) -> None:
    """Refuse a scale error that no sensor has: a reversed column or a wrong unit that the segments could not show before.

    Parameters
    ----------
    fitted : Fitted

    Raises
    ------
    DataError
    """
    for sensor in fitted.task.sensors:
        name = f"{sensor.kind}.scale_error.{sensor.axis}"
        if name in sensor.names and abs(fitted[name]) > _GAIN:
            raise DataError(
                f"{sensor.sensor.replace('.', '_')} answers to its input with a gain of {1.0 + fitted[name]:.4g} where 1 is "
                "expected: its sign is reversed, its unit is wrong, or the plan's alpha, beta and gamma are"
            )


Solve = Callable[[Task], Fitted]
_Attempt = tuple[Callable[[Fitted], str], Callable[[], Fitted]]


def refuse_poor(task: Task, solve: Solve, misfit: float, remarks: Sequence[str] = ()) -> None:
    """After a poor fit, refuse the plan where another reading of it explains the data, naming that reading.

    Parameters
    ----------
    task : Task
    solve : callable
        Fits a task, with the arm's angle as planned or, where it is unknown, found anew.
    misfit : float
        Chi-square for each degree of freedom of the fit as planned; infinite where it failed.
    remarks : sequence of str
        What was noted before, on the arm's column for one, which may be the cause.

    Raises
    ------
    DataError
    """
    told = task
    if any(s.kind == "accel" for s in task.sensors) and any(s.kind == "gyro" for s in task.sensors):
        only = task.only("accel")
        if _failed(solve, only):  # the gyros are not needed to see what is wrong
            told = only
    explained = _explained(_attempts(told, solve), misfit) or _explained([_settings_off(told, solve)], misfit)
    if not explained:
        return
    least = min(left for left, _ in explained)
    words = " or ".join([w for left, w in explained if left < 1.2 * least][:3])
    by = f" by {np.sqrt(misfit):.3g} times what noise and stated uncertainty allow" if np.isfinite(misfit) else ""
    before = f"\nNoted before: {'; '.join(remarks)}" if remarks else ""
    raise DataError(f"the harmonics miss the plan{by}, but fit if {words}. Correct the plan{before}")


def _failed(solve: Solve, task: Task) -> bool:
    try:
        return solve(task).estimate.p_value < _EXPLAINED
    except DataError:
        return True


def _explained(attempts: Iterable[_Attempt], misfit: float) -> list[tuple[float, str]]:
    """Misfit and words of the attempts that explain the data."""
    out = []
    for words, attempt in attempts:
        try:
            other = attempt()
        except DataError:
            continue
        if other.estimate.p_value > _EXPLAINED or (np.isfinite(misfit) and other.misfit < max(_LEFT * misfit, 1.5)):
            out.append((other.misfit, words(other)))
    return out


def _attempts(task: Task, solve: Solve) -> Iterator[_Attempt]:
    """What to try, and how to say it once it is fitted."""
    planned = task.arm.radius
    yield (
        lambda other: (
            f"the arm's radius is {other['rig.radius']:.7g} m, not {planned:.7g} m (or state rig.radius_uncertainty)"
        ),
        partial(solve, replace(task, free=task.free | {"radius"})),
    )
    seen = task.look()
    if seen.known.all() and not np.all(task.mean_only):
        turning = as_planned(seen, task.segments, task.plan)
        named = {p.name for p in turning.parameters}
        if "rig.phase_error" not in named:
            yield (
                lambda other: (
                    f"the arm is {np.degrees(other['rig.phase_error']):.3g} deg ahead of arm_phase, or of the column arm "
                    "where there is one (or state rig.phase_uncertainty)"
                ),
                partial(fit, task, freed(turning, "phase", seen, task.segments)),
            )
        if "rig.rate_error" not in named:
            yield (
                lambda other: (
                    f"arm_rate is off by {1e6 * other['rig.rate_error']:.3g} ppm (or state rig.rate_uncertainty)"
                ),
                partial(fit, task, freed(turning, "rate", seen, task.segments)),
            )
    for words, other in readings(task):
        yield partial(_constant, words), partial(solve, other)
    south = Site(-task.site.latitude, task.site.gravity, task.site.earth_rate)
    yield partial(_constant, "latitude has the other sign"), partial(solve, replace(task, site=south))
    told = task.plan.rig.arm_continuous
    if told is not None and not seen.known.all():
        rig = task.plan.rig.model_copy(update={"arm_continuous": not told})
        said = "had the same angle at every start" if told else "turned on from segment to segment"
        yield (
            partial(_constant, f"the arm {said} (rig.arm_continuous)"),
            partial(solve, replace(task, plan=task.plan.model_copy(update={"rig": rig}))),
        )
    if "mount" not in task.free:
        yield (
            partial(_constant, "the unit does not sit square on its gimbals"),
            partial(solve, replace(task, free=task.free | {"mount"})),
        )
    yield (
        lambda other: (
            f"the arm's axis is tilted by {np.degrees(np.hypot(other['rig.tilt.x'], other['rig.tilt.y'])):.3g} deg (state "
            "rig.axis_uncertainty)"
        ),
        partial(solve, replace(task, free=task.free | {"tilt"})),
    )


def _settings_off(task: Task, solve: Solve) -> _Attempt:
    """Gimbals that stand elsewhere than the plan says, the last resort: they explain much."""

    def words(other: Fitted) -> str:
        worst = max(float(np.abs(other.model.locals(g, other.estimate.value)).max()) for g in other.model.groups)
        return f"the gimbals' settings are off by up to {np.degrees(worst):.2g} deg (state rig.angle_uncertainty)"

    return words, partial(solve, replace(task, setting_sigma=max(30.0 * task.setting_sigma, 1e-3)))


def _constant(words: str, _: Fitted) -> str:
    return words
