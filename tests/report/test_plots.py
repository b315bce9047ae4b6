"""Pictures: what is drawn, not how it looks."""

import numpy as np
import pytest

from sagnac import from_arrays
from sagnac.observe.static import static_intervals
from sagnac.plan import Plan, Segment
from sagnac.report import plots


@pytest.fixture
def log():
    rng = np.random.default_rng(0)
    still = np.ones(2000)
    still[800:1000] = 1 + np.sin(np.arange(200) / 10)
    values = still[:, None] * [1.0, 2.0, 3.0] + 0.001 * rng.standard_normal((2000, 3))
    return from_arrays(np.arange(2000) / 100, values)


def test_envelope_keeps_the_extremes_of_a_long_curve():
    time = np.arange(100_000) / 100
    values = np.zeros(100_000)
    values[51_234], values[77_777] = 5.0, -3.0
    thin_time, thin = plots.envelope(time, values, 1000)
    assert thin.size < 1200
    assert thin.max() == 5.0
    assert thin.min() == -3.0
    assert np.all(np.diff(thin_time) >= 0)
    assert plots.envelope(time[:50], values[:50], 1000)[0].size == 50


def test_static_intervals_are_shaded(log):
    batch = log.read()
    found = static_intervals(batch)
    figure = plots.intervals_figure(batch, found, {"accel": "m/s$^2$"}, "static intervals")
    assert found.start.size == 2
    assert all(len(axes.patches) == 2 for axes in figure.axes)
    assert figure.axes[0].get_title(loc="left") == "2 static intervals"
    assert figure.axes[-1].get_xlabel() == "time [s]"


@pytest.mark.parametrize(("ending", "magic"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_log_is_drawn_with_the_segments_of_its_plan(log, tmp_path, ending, magic):
    plan = Plan(segment=(Segment(name="a", start=1.0, stop=7.0), Segment(name="b", start=11.0, stop=19.0)))
    plots.draw_log(log, plan, tmp_path / f"log.{ending}")
    assert (tmp_path / f"log.{ending}").read_bytes().startswith(magic)
    assert [p.name for p in tmp_path.iterdir()] == [f"log.{ending}"]


def test_demo_figure_has_every_parameter_and_method():
    names = ["a", "b", "c"]
    errors = {"norm": np.array([0.1, -1.0, 2.0]), "multi-position": np.array([0.3, 1.0, -2.0])}
    angles = np.radians([0.001, 0.1, 1.0])
    curves = {"norm": np.ones(3), "multi-position": np.array([1.0, 10.0, 100.0])}
    figure = plots.demo_figure(names, errors, angles, curves, curves)
    left, right = figure.axes
    assert [t.get_text() for t in left.get_yticklabels()] == names
    assert len(right.get_lines()) == 4
    assert {t.get_text() for t in right.get_legend().get_texts()} >= {"norm", "norm, published"}
