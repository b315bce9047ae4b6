"""Pictures of an alignment: what is drawn, not how it looks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sagnac.align.history import Run
from sagnac.align.observability import Observability
from sagnac.navigate.state import State
from sagnac.report import alignment

NAMES = (
    *(f"velocity_error.{a}" for a in "xy"),
    *(f"gyro.bias.{a}" for a in "xyz"),
    *(f"misalignment.{a}" for a in "xyz"),
    *(f"flexure.{a}" for a in "xyz"),
    *(f"flexure_rate.{a}" for a in "xyz"),
    "delay",
)
UNITS = ("m/s",) * 2 + ("rad/s",) * 3 + ("rad",) * 6 + ("rad/s",) * 3 + ("s",)


@pytest.fixture
def found() -> Run:
    """A run of 500 updates, of which three were shut out and fifty without a sample of the master."""
    rng = np.random.default_rng(0)
    m, n = 500, len(NAMES)
    sigmas = np.linspace(1.0, 0.1, m)[:, None] * np.full(n, 1e-3)
    innovations = 0.01 * rng.standard_normal((m, 2))
    used = np.ones(m, dtype=bool)
    used[[10, 20, 30]] = False
    innovations[~used] *= 30
    innovations[100:150] = np.nan
    used[100:150] = False
    nis = ((innovations / 0.01) ** 2).sum(axis=1)
    covariance = np.diag(sigmas[-1] ** 2)
    angles = np.tile([1.0, 0.0, 0.0], (m, 1))
    gains = np.linspace(0.1, 1.0, 20)[:, None] * np.geomspace(1e6, 1e-9, n)
    seen = Observability(NAMES, np.full(n, 0.1), gains[-1], np.eye(n), np.linspace(0, 49.9, 20), gains)
    return Run(
        names=NAMES,
        units=UNITS,
        time=0.1 * np.arange(m),
        values=sigmas * rng.standard_normal((m, n)),
        sigmas=sigmas,
        covariance=covariance,
        innovation_names=("velocity.x", "velocity.y"),
        innovations=innovations,
        innovation_sigmas=np.where(np.isfinite(innovations), 0.01, np.nan),
        used=used,
        nis=nis,
        angles=angles,
        angle_sigmas=0.01 * np.ones((m, 3)),
        places=np.zeros((m, 3)),
        observability=seen,
        final=State.from_angles(0.0, 0.0, 0.0, np.zeros(3), (0.0, 0.0, 0.0)),
    )


def titles(figure) -> list[str]:
    return [axes.get_title(loc="left") for axes in figure.axes]


def test_every_parameter_has_a_curve_with_its_band(found):
    figure = alignment.estimates_figure(found)
    assert titles(figure) == [
        "mounting of the slave against the master, bands of 3 σ",
        "gyro biases, bands of 3 σ",
        "bending, bands of 3 σ",
        "delay of the master, bands of 3 σ",
    ]
    assert [len(axes.collections) for axes in figure.axes] == [3, 3, 3, 1]
    x = figure.axes[0].get_lines()[0]
    # drawn in arcmin
    assert x.get_ydata()[-1] == pytest.approx(np.degrees(found.values[-1, 5]) * 60)
    assert [t.get_text() for t in figure.axes[0].get_legend().get_texts()] == ["x", "y", "z"]
    assert figure.axes[-1].get_xlabel() == "time [s]"


def test_the_last_band_is_in_sight(found):
    low, high = alignment.estimates_figure(found).axes[0].get_ylim()
    size = np.pi / 10800
    last = found.values[-1, 5:8] / size
    band = 3 * found.sigmas[-1, 5:8] / size
    assert low < (last - band).min()
    assert high > (last + band).max()


def test_values_far_apart_are_drawn_from_their_last_ones(found):
    values = found.values.copy()
    values[:, 5:8] += [10.0, -20.0, 30.0]
    axes = alignment.estimates_figure(replace(found, values=values)).axes[0]
    assert axes.get_lines()[0].get_ydata()[-1] == 0
    last = values[-1, 5:8] * 10800 / np.pi
    assert [t.get_text() for t in axes.get_legend().get_texts()] == [
        f"x - {last[0]:.4g}",
        f"y + {-last[1]:.4g}",
        f"z - {last[2]:.4g}",
    ]


def test_smoothed_estimates_are_dashed(found):
    smooth = replace(found, smoothed=found.values * 0.9, smoothed_sigmas=found.sigmas)
    figure = alignment.estimates_figure(smooth)
    assert all("smoothed dashed" in t for t in titles(figure))
    assert sum(line.get_linestyle() == "--" for line in figure.axes[0].get_lines()) == 3


def test_without_data_standard_deviations_are_drawn(found):
    figure = alignment.estimates_figure(replace(found, values=np.full_like(found.values, np.nan)))
    assert all(t.endswith(", standard deviation") for t in titles(figure))
    assert all(axes.get_yscale() == "log" for axes in figure.axes)
    drawn = figure.axes[1].get_lines()[0].get_ydata()
    assert drawn[0] == pytest.approx(np.degrees(found.sigmas[0, 2]) * 3600)


def test_innovations_with_what_the_gate_shut_out(found):
    figure = alignment.innovations_figure(found)
    assert titles(figure)[:2] == ["innovation of velocity, x, band of 3 σ", "innovation of velocity, y, band of 3 σ"]
    assert titles(figure)[2].startswith("normalised innovations squared, mean of ")
    crosses = [line for line in figure.axes[0].get_lines() if line.get_marker() == "x"]
    assert [len(line.get_xdata()) for line in crosses] == [3]
    low, high = figure.axes[0].get_ylim()
    assert all(low < y < high for y in crosses[0].get_ydata())  # pulled into sight
    curve = figure.axes[0].get_lines()[0]
    assert len(curve.get_xdata()) == 500 - 50 - 3


def test_few_updates_are_drawn_too(found):
    few = slice(0, 5)
    short = replace(
        found,
        **{
            n: getattr(found, n)[few]
            for n in ("time", "values", "sigmas", "innovations", "innovation_sigmas", "used", "nis")
        },
    )
    alignment.innovations_figure(short)
    alignment.estimates_figure(short)


def test_observability(found):
    left, right = alignment.observability_figure(found).axes
    assert len(left.get_lines()) == 3 + 3 + 3 + 1 + 1  # every parameter, and the line of one; no rate of the bending
    drawn = left.get_lines()[0].get_ydata()
    assert drawn[-1] == pytest.approx(0.1)
    assert drawn[0] == pytest.approx(1.0)
    lines = right.get_lines()
    assert len(lines) == len(NAMES)
    assert lines[0].get_ydata()[-1] == pytest.approx(1e3)  # the square root of the gain
    assert min(line.get_ydata().min() for line in lines) >= right.get_ylim()[0]


def test_long_clocks_are_shown_from_the_start(found):
    figure = alignment.estimates_figure(replace(found, time=432000 + found.time))
    assert figure.axes[-1].get_xlabel() == "time after 432000 s [s]"
    assert figure.axes[0].get_lines()[0].get_xdata()[0] == 0


@pytest.mark.parametrize(
    ("pictures", "names"),
    [
        (alignment.PICTURES, {"estimates.png", "innovations.png", "observability.png"}),
        (alignment.COVARIANCE_PICTURES, {"estimates.png", "observability.png"}),
    ],
)
def test_pictures_are_png_files(found, tmp_path, pictures, names):
    assert set(pictures) == names
    for name, draw in pictures.items():
        draw(None, found, tmp_path / name)
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    assert {p.name for p in tmp_path.iterdir()} == names
