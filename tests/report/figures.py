"""Calibrations of any size for the pictures of them, and whether what is drawn can be read."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from sagnac.calibration import BudgetLine, Calibration, Fit, Influence, Site, Value
from sagnac.recording import Recording, from_arrays
from sagnac.report import pictures, style
from sagnac.results import Software
from sagnac.verification import Check

TERMS = ("bias", "scale_error", "quadratic_nonlinearity_coefficient", "kio", "kip", "k3", "d_ii", "sensitivity_to_spin")
RIG = ("nonperpendicularity_of_the_middle", "lever_arm", "zero", "tilt")
OF_CALIBRATION = [
    pictures.correlation,
    pictures.budget,
    pictures.parameters,
    pictures.influence,
    pictures.residuals,
]
NORMS = ("static norm", "rate norm", "rate axis")
HARMONICS = tuple(f"accel_{a} {h}" for a in "xyz" for h in ("mean", "1x", "2x"))
UNITS = {"bias": "m/s^2", "scale_error": "1", "lever_arm": "m"}


def made(count: int, positions: int, *, sources_: int = 5, seed: int = 0, name: str = "position {} of day three"):
    """A calibration of so many parameters and segments, with random numbers in it."""
    rng = np.random.default_rng(seed)
    names = [f"{s}.{t}.{a}" for s in ("accel", "gyro") for t in TERMS for a in "xyz"]
    names = [*names, *(f"rig.{t}.{a}" for t in RIG for a in "xyz")][:count]
    k = len(names)
    mix = 0.6 * rng.standard_normal((k, k)) + 2 * np.eye(k)
    square = mix @ mix.T
    size = 10.0 ** rng.uniform(-7, -3, k) / np.sqrt(np.diag(square))
    covariance = square * np.outer(size, size)
    covariance = (covariance + covariance.T) / 2
    sigma = np.sqrt(np.diag(covariance))
    share = np.sqrt(rng.dirichlet(np.ones(max(sources_, 1)), k))
    lines = ("noise", "rig angles", "model: g-squared sensitivity", "stability of the bias", "gravity of the site")
    return Calibration(
        schema="sagnac/calibration/1",
        method="norm",
        parameters=tuple(
            Value(
                name=n,
                value=float(30 * s * rng.standard_normal()),
                unit=UNITS.get(n.split(".")[1], "rad"),
                standard_uncertainty=float(s),
            )
            for n, s in zip(names, sigma, strict=True)
        ),
        covariance=tuple(tuple(float(v) for v in row) for row in covariance),
        fit=Fit(
            chi2=2.0 * positions,
            degrees_of_freedom=2 * positions,
            residual_rms=1.0,
            converged=True,
            iterations=3,
            p_value=0.4,
            white=tuple(sigma),
            cluster=tuple(sigma * rng.uniform(0.5, 2.0, k)),
            delete_one=tuple(sigma * rng.uniform(0.5, 2.0, k)),
            influence=tuple(
                Influence(
                    segment=name.format(i + 1),
                    leverage=0.3,
                    chi2=float(rng.chisquare(2)),
                    shift=float(rng.exponential(0.4)),
                    parameter=names[i % k],
                )
                for i in range(positions)
            ),
        ),
        budget=tuple(
            BudgetLine(source=s, standard_uncertainty=tuple(share[:, j] * sigma))
            for j, s in enumerate(lines[:sources_])
        ),
        site=Site(gravity=9.8),
        software=Software(version="0"),
        created="2026-01-01T00:00:00+00:00",
    )


def checks_of(positions: int, whats: tuple[str, ...]) -> list[Check]:
    rng = np.random.default_rng(1)
    return [
        Check(f"position {i + 1} of day three", w, float(1e-5 * rng.standard_normal()), 1e-5, "m/s^2")
        for i in range(positions)
        for w in whats
    ]


def compared(checks: list[Check]) -> pictures.Comparison:
    pairs = (
        pictures.Pair(c.segment, c.what, 1e3 * c.residual, c.residual, c.standard_uncertainty, c.unit) for c in checks
    )
    return pictures.Comparison(tuple(pairs), "uncalibrated", "with this calibration", tuple(checks))


def texts_of(figure) -> list[str]:
    return [t.get_text() for t in written(figure)]


def written(figure) -> list:
    """Texts that can be seen."""
    from matplotlib.text import Text

    hidden = {t for axes in figure.axes if not axes.get_visible() for t in axes.findobj(Text)}
    beyond = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                outside = not low - 1e-9 * abs(low) <= tick.get_loc() <= high + 1e-9 * abs(high)
                if outside or not tick.label1.get_visible():
                    beyond |= {tick.label1, tick.label2}
    return [
        t
        for t in figure.findobj(Text)
        if t.get_visible() and t.get_text().strip() and t not in hidden and t not in beyond
    ]


def assert_clear(figure) -> None:
    """No two texts overlap, and none is cut off by the edge of the page."""
    with style.family():  # as it is saved
        style.settle(figure)
        figure.draw_without_rendering()
        boxes = [(t.get_text(), t.get_window_extent()) for t in written(figure)]
    page = figure.bbox
    for text, box in boxes:
        cut = max(page.x0 - box.x0, box.x1 - page.x1, page.y0 - box.y0, box.y1 - page.y1)
        assert cut < 2.0, f"{text!r} is cut off by {cut:.1f} pixels"
    for (a, one), (b, other) in combinations(boxes, 2):
        wide = min(one.x1, other.x1) - max(one.x0, other.x0)
        high = min(one.y1, other.y1) - max(one.y0, other.y0)
        # boxes hold room for ascenders and descenders that hardly any word needs
        assert min(wide, high - 0.25 * min(one.height, other.height)) < 1.0, f"{a!r} lies over {b!r}"


def hand_log() -> Recording:
    """Twelve attitudes at rest with quick turns between; gains and biases off by known amounts."""
    rng = np.random.default_rng(3)
    directions = np.vstack([np.eye(3), -np.eye(3), rng.standard_normal((10, 3))])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    parts = []
    for k, direction in enumerate(directions):
        parts.append(np.tile(direction, (400, 1)))
        if k + 1 < len(directions):
            way = np.linspace(direction, directions[k + 1], 60) + 0.05 * rng.standard_normal((60, 3))
            parts.append(way)
    force = 9.81 * np.vstack(parts)
    accel = force * [1.01, 0.99, 1.02] + [0.05, -0.03, 0.02] + 1e-3 * rng.standard_normal(force.shape)
    return from_arrays(np.arange(len(accel)) / 100, accel)
