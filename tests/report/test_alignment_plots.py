"""Pictures of an alignment: what is drawn, not how it looks."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pyarrow as pa
import pytest
from matplotlib.text import Text
from pyarrow import parquet

from sagnac.align import record
from sagnac.align.history import Run
from sagnac.align.observability import Observability
from sagnac.align.result import Alignment, load, values_of
from sagnac.errors import InputError
from sagnac.navigate.state import State
from sagnac.report import alignment, alignment_files
from sagnac.report.plot import offers, plot
from sagnac.results import Software, covariance_rows

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


def panels(figure) -> dict[str, object]:
    """Axes that can be seen, by the first line of their titles."""
    return {axes.get_title(loc="left").partition("\n")[0]: axes for axes in figure.axes if axes.get_visible()}


def test_every_parameter_has_a_panel_with_its_band(found):
    figure = alignment.estimates_figure(found)
    shown = panels(figure)
    assert list(shown) == [
        *(f"mounting, {a}" for a in "xyz"),
        *(f"gyro bias, {a}" for a in "xyz"),
        *(f"bending, {a}" for a in "xyz"),
        "delay of the master",
    ]
    assert all(len(axes.collections) == 1 for axes in shown.values())
    # drawn, and told in the title, in arcmin
    value, sigma = (np.degrees(part[-1, 5]) * 60 for part in (found.values, found.sigmas))
    mounting = shown["mounting, x"]
    assert mounting.get_lines()[-1].get_ydata()[-1] == pytest.approx(value)
    told = f"{value:.2f} ± {sigma:.2f} arcmin".replace("-", "−")
    assert mounting.get_title(loc="left").endswith(told)
    assert {axes.get_xlabel() for axes in shown.values()} == {"", "time [s]"}


def test_the_last_band_is_in_sight(found):
    for i, name in zip((5, 6, 7), "xyz", strict=True):
        low, high = panels(alignment.estimates_figure(found))[f"mounting, {name}"].get_ylim()
        size = np.pi / 10800
        last, band = found.values[-1, i] / size, 3 * found.sigmas[-1, i] / size
        assert low < last - band
        assert high > last + band


def test_smoothed_estimates_are_dashed(found):
    smooth = replace(found, smoothed=found.values * 0.9, smoothed_sigmas=found.sigmas)
    figure = alignment.estimates_figure(smooth)
    assert "smoothed dashed" in figure.get_suptitle()
    for axes in panels(figure).values():
        assert sum(line.get_linestyle() == "--" for line in axes.get_lines()) == 1


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


def test_observability_names_every_curve(found):
    first, second = alignment.observability_figure(found).axes
    assert len(first.get_lines()) == 3 + 3 + 3 + 1 + 1  # every parameter, and the line of one; no rate of the bending
    drawn = first.get_lines()[0].get_ydata()
    assert drawn[-1] == pytest.approx(0.1)
    assert drawn[0] == pytest.approx(1.0)
    labels = {t.get_text() for t in first.texts}
    assert labels == {n for n in NAMES if not n.startswith(("velocity_error", "flexure_rate"))}
    lines = second.get_lines()
    assert len(lines) == len(NAMES)
    assert lines[0].get_ydata()[-1] == pytest.approx(1e3)  # the square root of the gain
    assert min(line.get_ydata().min() for line in lines) >= second.get_ylim()[0]
    # the directions are single states here; those too small to be drawn have no name
    gains = found.observability.gains
    assert {t.get_text() for t in second.texts} == {n for n, g in zip(NAMES, gains, strict=True) if g > 1e-6 * 1.03}


def test_names_of_curves_stand_clear_of_one_another(found):
    figure = alignment.observability_figure(found)
    figure.draw_without_rendering()
    for axes in figure.axes:
        boxes = sorted((Text.get_window_extent(t) for t in axes.texts), key=lambda b: b.y0)  # without their lines
        assert all(a.y1 - b.y0 < 0.3 * a.height for a, b in pairwise(boxes))


def test_long_clocks_are_shown_from_the_start(found):
    figure = alignment.estimates_figure(replace(found, time=432000 + found.time))
    assert figure.axes[-3].get_xlabel() == "time after 432000 s [s]"
    assert figure.axes[0].get_lines()[0].get_xdata()[0] == 0


def test_pictures_from_the_files_of_an_alignment(found, tmp_path):
    write(tmp_path, found)
    result, history = alignment_files.read(tmp_path)
    assert result.kind == "transfer"
    assert alignment_files.pictures_of(history) == ["estimates", "innovations", "observability"]
    assert history.names == found.names
    assert history.innovation_names == found.innovation_names
    for kept, own in ((history.values, found.values), (history.sigmas, found.sigmas), (history.nis, found.nis)):
        np.testing.assert_array_equal(kept, own)
    np.testing.assert_array_equal(history.used, found.used)
    assert len(alignment_files.PICTURES["observability"][1](history).axes) == 1  # no singular values over time in them
    for name in ("estimates", "innovations"):
        assert alignment_files.PICTURES[name][1](history).axes


def test_files_of_a_covariance_analysis_have_no_innovations(found, tmp_path):
    nothing = np.full_like(found.nis, np.nan)
    write(tmp_path, replace(found, values=np.full_like(found.values, np.nan), nis=nothing))
    _, history = alignment_files.read(tmp_path)
    assert alignment_files.pictures_of(history) == ["estimates", "observability"]
    assert alignment_files.PICTURES["estimates"][1](history).axes[0].get_yscale() == "log"


def test_a_folder_that_holds_something_else_is_refused(found, tmp_path):
    with pytest.raises(InputError, match="cannot read the alignment"):
        alignment_files.read(tmp_path)
    write(tmp_path, found)
    (tmp_path / "history.parquet").write_bytes(b"no history")
    with pytest.raises(InputError, match="cannot read the history"):
        alignment_files.read(tmp_path)
    parquet.write_table(pa.table({"time [s]": [1.0]}), tmp_path / "history.parquet")
    with pytest.raises(InputError, match="not the history of an alignment"):
        alignment_files.read(tmp_path)
    kept = pa.table({"time [s]": [1.0]}).replace_schema_metadata({"sagnac": "sagnac/alignment-history/1"})
    parquet.write_table(kept, tmp_path / "history.parquet")
    with pytest.raises(InputError, match="damaged history"):
        alignment_files.read(tmp_path)


def test_the_result_of_an_alignment_stands_for_its_folder(found, tmp_path):
    write(tmp_path, found)
    assert [o.name for o in offers(tmp_path / "alignment.json")] == ["estimates", "innovations", "observability"]
    assert plot(tmp_path, "estimates").figure.axes
    (tmp_path / "alignment.json").rename(tmp_path / "mine.json")
    with pytest.raises(InputError, match="give the folder that it was written to"):
        offers(tmp_path / "mine.json")


def test_a_static_alignment_has_nothing_to_draw(found, tmp_path):
    write(tmp_path, found)
    result = load(tmp_path / "alignment.json").model_copy(update={"kind": "static"})
    result.save(tmp_path / "parked.json")
    result.save(tmp_path / "alignment.json")
    for path in (tmp_path, tmp_path / "parked.json"):
        with pytest.raises(InputError, match="a static alignment keeps no history"):
            offers(path)


def write(folder, run: Run) -> None:
    """The files of an alignment, as the command leaves them."""
    names = [n for n in run.names if not n.startswith(("velocity_error", "flexure_rate"))]
    at = [run.names.index(n) for n in names]
    covariance = run.covariance[np.ix_(at, at)]
    result = Alignment.model_validate(
        {
            "schema": "sagnac/alignment/1",
            "kind": "transfer",
            "method": "wander",
            "time": float(run.time[-1]),
            "parameters": values_of(names, [run.units[i] for i in at], None, np.sqrt(np.diag(covariance))),
            "covariance": covariance_rows(covariance),
            "observed": [{"name": n, "unit": "1", "initial": 1.0, "final": 0.1} for n in names],
            "software": Software(version="0"),
            "created": "2026-01-01T00:00:00+00:00",
        }
    )
    record.write(folder, result, run, None)


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
