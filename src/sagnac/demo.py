"""The main job on a simulated unit: the laser-gyro unit of [DONG18] on its imperfect table, from log to verified calibration."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .calibrate import calibrate, multi_position, norm, table
from .calibration import Calibration
from .earth import STANDARD_GRAVITY
from .files import write_atomically
from .frames import Array
from .plan import Plan
from .recording import open_recording
from .simulate.plans import CHECK, ICOSAHEDRON, table_plan
from .simulate.table import SimulatedTable, imperfect_table, simulate_readings, simulate_recording, write_recording
from .simulate.unit import SimulatedUnit, laser_gyro_unit
from .verification import Verification, verify

_DEG_H = np.pi / 648000
ANGLES = np.radians([1 / 3600, 1 / 60, 1 / 6, 1.0, 10.0])
"""Angle errors of the published comparison, rad."""

# [DONG18], result of the norm method, and its comparison against the angle error
PUBLISHED_NORM = {
    "gyro.scale_error.x": "0.00200",
    "gyro.scale_error.y": "-0.001494",
    "gyro.scale_error.z": "-0.001492",
    "gyro.bias.x": "-0.3363",
    "gyro.bias.y": "0.1664",
    "gyro.bias.z": "-0.0509",
    "gyro.misalignment.xy": "0.94e-4",
    "gyro.misalignment.xz": "0.82e-4",
    "gyro.misalignment.yx": "2.11e-4",
    "gyro.misalignment.yz": "0.03e-4",
    "gyro.misalignment.zx": "-5.85e-4",
    "gyro.misalignment.zy": "5.97e-4",
    "accel.scale_error.x": "0.00194",
    "accel.scale_error.y": "0.00802",
    "accel.scale_error.z": "0.00601",
    "accel.bias.x": "0.000795",
    "accel.bias.y": "-0.00101",
    "accel.bias.z": "-0.003182",
    "accel.misalignment.yx": "0.99e-4",
    "accel.misalignment.zx": "0.62e-4",
    "accel.misalignment.zy": "1.61e-4",
}
"""As printed: biases in deg/h and g, the rest in 1 and rad."""
PUBLISHED_CURVES = {
    "accel.scale_error.x": {
        "norm": np.array([5.72e-5, 5.72e-5, 5.72e-5, 5.72e-5, 5.53e-5]),
        "multi-position": np.array([2.86e-5, 8.27e-5, 5.74e-4, 3.43e-3, 4.79e-2]),
    },
    "gyro.bias.y": {
        "norm": np.array([3.6e-3, 3.6e-3, 3.4e-3, 3.7e-3, 4.2e-3]) * _DEG_H,
        "multi-position": np.array([0.039, 0.083, 0.093, 3.6, 1.8]) * _DEG_H,
    },
}


@dataclass(frozen=True)
class Demo:
    """What :func:`run` made.

    Attributes
    ----------
    truth : dict of str to float
    norm, multi_position : Calibration
    verification : Verification
    folder : Path
    """

    truth: dict[str, float]
    norm: Calibration
    multi_position: Calibration
    verification: Verification
    folder: Path

    def to_dict(self) -> dict[str, Any]:
        """Truth, results and verdict as a plain table for JSON."""
        results = {"norm": self.norm, "multi-position": self.multi_position}
        return {
            "folder": str(self.folder),
            "truth": self.truth,
            **{m: {p.name: [p.value, p.standard_uncertainty] for p in c.parameters} for m, c in results.items()},
            "passed": self.verification.passed,
        }


def run(folder: str | Path = "sagnac-demo", *, seed: int = 1, say: Callable[[str], None] = print) -> Demo:
    """Simulate, calibrate by norm and by multi-position, compare with the truth, verify, draw.

    Parameters
    ----------
    folder : path
        Where recordings, plans, results and plots go.
    seed : int
    say : callable
        Takes each line of progress.

    Returns
    -------
    Demo
    """
    folder = Path(folder)
    unit, streams = laser_gyro_unit(), np.random.SeedSequence(seed).spawn(3)
    plan, check = table_plan(unit), table_plan(unit, CHECK, dwell=120.0, turning=144.0)
    say(f"Simulating a laser-gyro unit on a table whose settings are off by up to 1' ({_span(plan)}) ...")
    _record(folder / "recording.parquet", unit, plan, np.random.default_rng(streams[0]))
    _record(folder / "check.parquet", unit, check, np.random.default_rng(streams[1]))
    plan.save(folder / "plan.toml")
    check.save(folder / "check.toml")
    _save_json(folder / "truth.json", unit.truth())
    recording = open_recording(folder / "recording.parquet", scale=plan.unit.scale)
    say("Calibrating by norm and by multi-position ...")
    by_norm = calibrate("norm", recording, plan).with_source(folder / "plan.toml", "plan")
    by_table = calibrate("multi-position", recording, plan, matrix="triangular").with_source(
        folder / "plan.toml", "plan"
    )
    by_norm.save(folder / "norm.json")
    by_table.save(folder / "multi-position.json")
    say("")
    say(comparison(unit.truth(), by_norm, by_table))
    say("Verifying the norm calibration on a recording that it has not seen ...")
    checked = verify(by_norm, open_recording(folder / "check.parquet", scale=check.unit.scale), check)
    _save_json(folder / "verification.json", checked.to_dict())
    say(checked.summary())
    say("Repeating the published comparison: one reading a position, table errors from 1 arcsec to 10 deg ...")
    _draw(folder, unit.truth(), by_norm, by_table, angle_curves(np.random.default_rng(streams[2])))
    pages = _certificates(folder)
    say(f"Results, recordings and plots are in {folder}/ (demo.png, angle-errors.png, {', '.join(pages)})")
    return Demo(unit.truth(), by_norm, by_table, checked, folder)


def _certificates(folder: Path) -> list[str]:
    """The certificate of the norm calibration: a page, and a PDF where typst is installed."""
    from importlib.util import find_spec

    from .report.certificate import certificate, gather, write

    evidence = gather(
        folder / "norm.json",
        recording=folder / "recording.parquet",
        plan=folder / "plan.toml",
        check=folder / "check.parquet",
        check_plan=folder / "check.toml",
    )
    document = certificate(evidence)
    pages = ["certificate.html"] + ["certificate.pdf"] * (find_spec("typst") is not None)
    for page in pages:
        write(document, folder / page)
    return pages


def _span(plan: Plan) -> str:
    return f"{len(plan.segment)} segments, {plan.segment[-1].stop / 3600:.1f} h"


def _record(path: Path, unit: SimulatedUnit, plan: Plan, rng: np.random.Generator) -> None:
    time, samples = simulate_recording(unit, plan, imperfect_table(plan, rng), rng)
    write_recording(path, time, samples, unit.pulses)


def _save_json(path: Path, table: object) -> None:
    with write_atomically(path) as temporary:
        temporary.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


def comparison(truth: dict[str, float], by_norm: Calibration, by_table: Calibration) -> str:
    """Both results against the truth, and the errors that [DONG18] published, as a table of text."""
    head = (
        f"  {'parameter':<23}{'truth':>10}  {'norm':>10} {'+-':>8} {'err/sig':>8}  {'multi-pos.':>10} {'+-':>8} {'err/sig':>8}"
        f"  {'published':>10}  unit"
    )
    lines, closer = [head], 0
    for name, value in truth.items():
        if name not in by_norm.values():
            continue
        a, b = by_norm[name], by_table[name]
        unit, size = _shown(name)
        published = published_norm(name)
        cells = [f"  {name:<23}{value * size:>10.4g}"]
        cells += [
            f"  {p.value * size:>10.{_digits(p.standard_uncertainty * size)}f} {p.standard_uncertainty * size:>8.2g} "
            f"{(p.value - value) / p.standard_uncertainty:>8.2f}"
            for p in (a, b)
        ]
        lines.append(
            "".join(cells) + f"  {'' if published is None else format(published[0] * size, '.4g'):>10}  {unit}"
        )
        if published is not None:
            closer += abs(a.value - value) <= abs(published[0] - value) + published[1]
    lines.append(
        f"  closer to the truth than the published norm result: {closer} of {len(PUBLISHED_NORM)} parameters "
        "(there, one reading a position; here, five to six minutes of the same noise)"
    )
    return "\n".join(lines) + "\n"


def published_norm(name: str) -> tuple[float, float] | None:
    """Published norm result of a parameter and half a unit of its last printed digit, SI; None where none is printed."""
    text = PUBLISHED_NORM.get(name)
    if text is None:
        return None
    size = {"gyro.bias": _DEG_H, "accel.bias": STANDARD_GRAVITY}.get(name.rpartition(".")[0], 1.0)
    digits, _, exponent = text.partition("e")
    half = 0.5 * 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))
    return float(text) * size, half * size


def _shown(name: str) -> tuple[str, float]:
    if name.startswith("accel.bias"):
        return "ug", 1e6 / STANDARD_GRAVITY
    if name.startswith("gyro.bias"):
        return "deg/h", 1 / _DEG_H
    if "scale" in name:
        return "ppm", 1e6
    return "arcsec", 648000 / np.pi


def _digits(sigma: float) -> int:
    return int(np.clip(1 - np.floor(np.log10(sigma)), 0, 6)) if sigma > 0 else 6


def angle_curves(rng: np.random.Generator, runs: int = 12) -> dict[str, dict[str, Array]]:
    """Rms error against the table's angle error: norm and multi-position, as [DONG18] compares them, and table.

    One reading a position with the published noise. Multi-position is the traditional closed form, which trusts the
    settings; table is the joint estimator, told how far the settings can be trusted.

    Parameters
    ----------
    rng : numpy Generator
    runs : int
        Simulated calibrations at each angle error.

    Returns
    -------
    dict of parameter to dict of method to ndarray, shape (5,), SI
    """
    unit = laser_gyro_unit(gyro_density=0.01 * _DEG_H)
    methods = ("norm", "multi-position", "table")
    out = {name: {m: np.zeros(len(ANGLES)) for m in methods} for name in PUBLISHED_CURVES}
    for i, angle in enumerate(ANGLES):
        sigma = float(angle) / np.sqrt(3.0)  # of a uniform error of +-angle
        stated = table_plan(unit, ICOSAHEDRON, dwell=1.0, turning=1.0, move=1.0, angle_uncertainty=sigma)
        for _ in range(runs):
            made = imperfect_table(stated, rng, setting=float(angle))
            for name, errors in _one(unit, stated, made, rng).items():
                for method, error in zip(methods, errors, strict=True):
                    out[name][method][i] += error**2 / runs
    return {name: {m: np.sqrt(v) for m, v in curves.items()} for name, curves in out.items()}


def _one(
    unit: SimulatedUnit, plan: Plan, made: SimulatedTable, rng: np.random.Generator
) -> dict[str, tuple[float, ...]]:
    """Errors of the three methods in one simulated run."""
    means = simulate_readings(unit, plan, made, rng)
    truth = unit.truth()
    found = (
        norm.calibrate_means(means, plan).values(),
        multi_position.closed_form(means, plan),
        table.calibrate_means(means, plan).values(),
    )
    return {n: tuple(values[n] - truth[n] for values in found) for n in PUBLISHED_CURVES}


def _draw(
    folder: Path,
    truth: dict[str, float],
    by_norm: Calibration,
    by_table: Calibration,
    curves: dict[str, dict[str, Array]],
) -> None:
    from .report import plots

    names = [n for n in truth if n in by_norm.values()]
    errors = {
        method: np.array([(c[n].value - truth[n]) / c[n].standard_uncertainty for n in names])
        for method, c in (("norm", by_norm), ("multi-position", by_table))
    }
    name = "accel.scale_error.x"
    plots.save(plots.demo_figure(names, errors, ANGLES, curves[name], PUBLISHED_CURVES[name]), folder / "demo.png")
    panels = []
    for parameter, label, size in (
        (name, "accel.scale_error.x, rms [ppm]", 1e6),
        ("gyro.bias.y", "gyro.bias.y, rms [deg/h]", 1 / _DEG_H),
    ):
        panels.append(
            (
                label,
                {m: v * size for m, v in curves[parameter].items()},
                {m: v * size for m, v in PUBLISHED_CURVES[parameter].items()},
            )
        )
    plots.save(plots.angle_error_figure(ANGLES, panels), folder / "angle-errors.png")
