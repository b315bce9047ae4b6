"""Pictures of campaigns: what stands in them, and that they are drawn whatever the campaign looks like."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac._version import __version__
from sagnac.campaign.fleets import FleetSummary, Spread, Unit
from sagnac.campaign.summary import Coverage, Judged, PointSummary, Squares, Summary, ratio_interval, share_interval
from sagnac.errors import DataError, InputError
from sagnac.report import campaign as pictures
from sagnac.results import Software

SOFTWARE = Software(version=__version__)
TERMS = ("accel.bias", "accel.scale_error", "gyro.bias", "gyro.misalignment", "rig.mount", "gyro.d_ii")
UNITS = {"bias": "rad/s", "scale_error": "1", "misalignment": "rad", "mount": "rad", "d_ii": "rad*s^3/m^2"}


def judged(name: str, size: float, rng: np.random.Generator, *, bound: bool = True, runs: int = 200) -> Judged:
    rmse = size * rng.uniform(0.9, 1.1)
    shares = [min(1.0, max(0.0, level + 0.02 * rng.standard_normal())) for level in (0.5, 0.9, 0.95, 0.99)]
    return Judged(
        name=name,
        unit="m/s^2" if name.startswith("accel.bias") else UNITS[name.split(".")[1]],
        runs=runs,
        bias=0.01 * size,
        bias_uncertainty=size / 14,
        rmse=rmse,
        stated=size,
        bound=size if bound else None,
        ratio=rmse / size if bound else None,
        ratio_interval=ratio_interval(rmse / size, runs, 0.95) if bound else None,
        coverage=tuple(
            Coverage(level=level, share=s, interval=share_interval(round(s * runs), runs, 0.95))
            for level, s in zip((0.5, 0.9, 0.95, 0.99), shares, strict=True)
        ),
        flags=("states too much: RMSE is 0.5 of the stated uncertainty",) if name.endswith("mount.x") else (),
    )


def campaign(values, names, *, seed: int = 0, done: int = 200, bound: bool = True) -> Summary:
    rng = np.random.default_rng(seed)
    points = []
    for k, value in enumerate(values):
        squares = rng.chisquare(len(names), 200)
        counts = np.histogram(squares, np.arange(61.0))[0].tolist()
        points.append(
            PointSummary(
                values=value,
                runs=done,
                refused=0,
                nees=Squares(
                    mean=float(squares.mean()),
                    expected=len(names),
                    band=(len(names) - 0.5, len(names) + 0.5),
                    width=1.0,
                    histogram=(*counts, 200 - sum(counts)),
                    ranks={len(names): 200},
                ),
                parameters=tuple(judged(n, 1e-5 * (k + 1), rng, bound=bound) for n in names),
            )
        )
    return Summary(
        title="Norm calibration",
        method="norm",
        seed=1,
        done=done * len(points),
        count=200 * len(points),
        points=tuple(points),
        software=SOFTWARE,
    )


def names(count: int) -> list[str]:
    return [f"{t}.{a}" for t in TERMS for a in "xyz"][:count]


GRID = [{"unit.noise.accel": f"{v} ug/sqrt(Hz)", "method": m} for m in ("norm", "table") for v in (10, 100, 20)]


def words(figure) -> set[str]:
    from matplotlib.text import Text

    return {t.get_text() for t in figure.findobj(Text) if t.get_text() and t.get_visible()}


@pytest.mark.parametrize("count", [1, 9, 18])
def test_the_overview_shows_every_parameter_and_the_band(count):
    figure = pictures.overview(campaign([{}], names(count)))
    said = words(figure)
    assert set(names(count)) <= said
    assert {
        "errors against the bound",
        "coverage",
        "normalised estimation error squared",
        "95 % band of the mean",
    } <= said
    assert any("200 runs, 0 refused" in w for w in said)
    ratios, coverage, nees = figure.findobj(lambda a: a.__class__.__name__ == "Axes")
    low, high = ratios.get_xlim()
    found = campaign([{}], names(count)).points[0].parameters
    assert all(low <= p.ratio_interval[0] and p.ratio_interval[1] <= high for p in found)
    assert coverage.get_xlim()[1] > pictures._ALL
    assert nees.get_xlim() == (0.0, 60.0)


def test_the_chi_square_of_the_histogram_has_its_area():
    figure = pictures.overview(campaign([{}], names(9)))
    nees = figure.findobj(lambda a: a.__class__.__name__ == "Axes")[2]
    curve = next(line for line in nees.lines if "chi-square" in line.get_label())
    assert np.trapezoid(curve.get_ydata(), curve.get_xdata()) == pytest.approx(200.0, rel=0.01)


def test_without_bounds_and_under_way_there_is_still_a_picture():
    figure = pictures.overview(campaign([{}], names(6), bound=False, done=150))
    assert any("so far; 150 of 200 in all" in w for w in words(figure))


def test_a_grid_is_drawn_along_its_keys_in_order_of_their_numbers():
    found = campaign(GRID, names(9))
    assert pictures.axes_of(found) == ["unit.noise.accel", "method"]
    figure = pictures.along(found, "unit.noise.accel")
    panel = next(a for a in figure.axes if a.get_title(loc="left").startswith("accel.bias"))
    bound = next(line for line in panel.lines if line.get_linestyle() == "-" and line.get_marker() == "None")
    np.testing.assert_allclose(bound.get_xdata(), [10, 20, 100])  # the file has 10, 100, 20, of growing bounds
    np.testing.assert_allclose(np.divide(bound.get_ydata(), bound.get_ydata()[0]), [1, 3, 2])
    assert panel.get_xscale() == "log"
    assert any("unit.noise.accel [" in w for w in words(figure))
    assert any("method = norm" in w for w in words(figure))
    labels = words(pictures.along(found, "method"))
    assert {"norm", "table"} <= labels


def fleet(units: int, parameters: int, *, single: bool = False) -> FleetSummary:
    rng = np.random.default_rng(1)
    spreads = [
        Spread(
            name=n,
            unit="m/s^2" if n.startswith("accel.bias") else UNITS[n.split(".")[1]],
            units=units,
            mean=0.0,
            spread=None if single else 1e-3,
            stated=1e-4,
            least=-1e-3,
            greatest=1e-3,
            runs=tuple(range(units)),
            values=tuple((1e-3 * rng.standard_normal(units)).tolist()),
            uncertainties=(1e-4,) * units,
        )
        for n in names(parameters)
    ]
    rows = tuple(Unit(run=i, recording=f"logs/{i}.csv", serial=f"S{i:04d}", status="ok") for i in range(units))
    return FleetSummary(
        title="Fleet", method="norm", done=units, count=units, units=rows, parameters=tuple(spreads), software=SOFTWARE
    )


@pytest.mark.parametrize(("units", "parameters"), [(1, 1), (8, 9), (300, 18)])
def test_a_fleet_is_drawn_parameter_by_parameter(units, parameters):
    figure = pictures.fleet(fleet(units, parameters, single=units == 1))
    said = words(figure)
    assert all(any(w.startswith(n) for w in said) for n in names(parameters))
    assert any("S0000" in w for w in said)


def test_files_are_written_for_one_picture_or_for_all(tmp_path):
    found = campaign(GRID[:2], names(3))
    assert pictures.draw(found, tmp_path / "one.svg", 1) == [tmp_path / "one.svg"]
    assert (tmp_path / "one.svg").read_text().startswith("<?xml")
    files = pictures.draw(found, tmp_path / "all")
    assert [f.name for f in files] == ["point-0.png", "point-1.png", "along-unit-noise-accel.png"]
    assert all(f.stat().st_size > 10_000 for f in files)
    assert [f.name for f in pictures.draw(fleet(3, 3), tmp_path / "fleet")] == ["fleet.png"]
    assert pictures.draw(fleet(3, 3), tmp_path / "fleet.pdf")[0].read_bytes().startswith(b"%PDF")


def test_what_cannot_be_drawn_is_refused(tmp_path):
    found = campaign([{}], names(3))
    with pytest.raises(InputError, match=r"\.png, \.svg or \.pdf"):
        pictures.draw(found, tmp_path / "x.jpg")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        pictures.draw(found, tmp_path / "file")
    empty = found.model_copy(update={"points": (PointSummary(values={}, runs=0, refused=0),)})
    with pytest.raises(DataError, match="no run is done yet"):
        pictures.draw(empty, tmp_path / "x.png")
    with pytest.raises(DataError, match="no run is done yet"):
        pictures.draw(empty, tmp_path / "all")
    with pytest.raises(DataError, match="no recording"):
        pictures.fleet(fleet(2, 0))


def test_nees_that_is_not_judged_has_no_band_and_one_run_is_one():
    found = campaign([{}], names(3))
    point = found.points[0]
    counts = (*point.nees.histogram[:-1], 1)
    own = point.nees.model_copy(update={"remark": "not judged: uncertainties from few segments", "histogram": counts})
    few = found.model_copy(update={"points": (point.model_copy(update={"nees": own}),)})
    said = words(pictures.overview(few))
    assert "95 % band of the mean" not in said
    assert any("not judged" in w for w in said)
    assert any("(1 run lies beyond)" in w for w in said)


def test_a_mean_beyond_the_axis_says_so_and_levels_have_a_legend():
    found = campaign([{}], names(3))
    point = found.points[0]
    far = found.model_copy(
        update={"points": (point.model_copy(update={"nees": point.nees.model_copy(update={"mean": 500.0})}),)}
    )
    said = words(pictures.overview(far))
    assert any("lies beyond the axis" in w for w in said)
    assert {"50%", "90%", "95%", "99%"} <= said


def test_far_ratios_have_more_than_one_tick_and_exact_parameters_no_coverage():
    found = campaign([{}], names(3))
    point = found.points[0]
    first, *rest = point.parameters
    far = first.model_copy(update={"ratio": 5.0, "ratio_interval": (4.5, 5.6)})
    exact = rest[0].model_copy(
        update={"coverage": (), "stated": 0.0, "ratio": None, "ratio_interval": None, "bound": None}
    )
    shown = found.model_copy(update={"points": (point.model_copy(update={"parameters": (far, exact, rest[1])}),)})
    figure = pictures.overview(shown)
    figure.canvas.draw()
    left = figure.findobj(lambda a: a.__class__.__name__ == "Axes")[0]
    low, high = left.get_xlim()
    assert sum(low <= t <= high for t in left.get_xticks()) >= 3


def test_every_value_of_the_other_key_has_its_picture():
    found = campaign(GRID, names(3))
    made = pictures._all(found)
    assert {"along-unit-noise-accel", "along-unit-noise-accel-2", "along-method", "along-method-3"} <= set(made)
    assert any("method = table" in w for w in words(made["along-unit-noise-accel-2"]))
    panels = [a for a in made["along-unit-noise-accel"].axes if a.lines]
    assert len({a.get_yscale() for a in panels}) == 1
    assert sum(line.get_linestyle() == "--" for line in panels[0].lines) == 3  # what is stated


def test_a_fleet_names_its_units_and_marks_the_refused():
    whole = fleet(8, 4)
    units = tuple(u.model_copy(update={"status": "DataError: no"}) if u.run == 3 else u for u in whole.units)
    figure = pictures.fleet(whole.model_copy(update={"units": units}))
    figure.canvas.draw()
    said = words(figure)
    assert {f"S{i:04d}" for i in range(8)} <= said
    assert any("×: refused" in w for w in said)
