"""What is told of a campaign's runs, and what is not: flags joined and kept apart, few segments, refusals, exact parameters."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy import stats
from test_summary import about, table, tallied

from sagnac.campaign import show, summary
from sagnac.campaign.tally import Tally
from sagnac.campaign.tasks.about import Parameter, PointAbout


def told(*tables, **more) -> summary.Summary:
    return summary.summarise(tallied(*tables, **more))


@pytest.mark.parametrize("used", ["delete-one-segment", "accelerometers: white / gyros: scaled"])
def test_nees_is_not_judged_where_uncertainties_come_from_few_segments(used):
    error = 3.0 * np.random.default_rng(1).standard_normal((100, 2))
    judged, not_judged = (told(table(error, 1.0, uncertainty=u), runs=100) for u in ("white", used))
    assert judged.points[0].nees.flags
    assert not_judged.points[0].nees.flags == ()
    assert not_judged.points[0].nees.remark == summary.NOT_JUDGED
    assert "NEES not judged: uncertainties from few segments" in show.text(not_judged)
    mixed = tallied(runs=1100)  # as it happens by chance, once in a hundred
    mixed.add(table(3.0 * np.ones((1000, 2)), 1.0))
    mixed.add(table(3.0 * np.ones((1, 2)), 1.0, first=1000, uncertainty=used))
    assert summary.summarise(mixed).points[0].nees.flags


def test_coverage_of_few_degrees_of_freedom_is_students():
    """Errors over uncertainties of five degrees of freedom are Student's: normal intervals would hold 88 % at 95 %."""
    rng = np.random.default_rng(2)
    runs, dof = 4000, 5.0
    sigma = np.sqrt(rng.chisquare(dof, (runs, 2)) / dof)
    error = rng.standard_normal((runs, 2))
    students, normal = (
        told(table(error, sigma, dof=d), runs=runs, bound=(1.0, 1.0)).points[0].parameters[0] for d in (dof, None)
    )
    for c in students.coverage:
        held = np.mean(np.abs(error[:, 0]) <= stats.t.ppf(0.5 + 0.5 * c.level, dof) * sigma[:, 0])
        assert c.share == pytest.approx(held, abs=1e-12)
        assert c.share == pytest.approx(c.level, abs=0.02)
    assert students.flags == ()
    assert any("95" in f and "hold the truth" in f for f in normal.flags)
    many = told(table(error, sigma, dof=100.0), runs=runs).points[0].parameters[0]
    assert many.coverage == normal.coverage


def test_what_is_stated_as_exact_is_told_when_it_is_off():
    error = np.random.default_rng(3).standard_normal((50, 2)) * [1e-3, 1.0]
    own, other = told(table(error, [0.0, 1.0]), runs=50, bound=(0.0, 1.0)).points[0].parameters
    rmse = np.sqrt(np.mean(error[:, 0] ** 2)) / 9.80665e-6
    assert own.flags == (f"stated as exact, but is off by {rmse:.3g} ug",)
    assert (own.coverage, own.bound, own.ratio, other.flags) == ((), None, None, ())
    error[:, 0] = 0.0
    found = told(table(error, [0.0, 1.0]), runs=50, bound=(0.0, 1.0))
    assert found.flags == ()
    assert "exact" in show.text(found)


def test_refused_runs_are_a_finding():
    error = np.random.default_rng(4).standard_normal((20, 2))
    error[3:] = np.nan
    status = ["ok"] * 3 + ["too few"] * 17
    found = told(table(error, 1.0, status=status), runs=20, bound=(1.0, 1.0))
    assert found.flags == ((0, "17 of 20 runs refused: all numbers are of the others alone"),)
    assert "nothing is out of its band" not in show.text(found)


def named(names) -> summary.Summary:
    """200 runs whose errors are twice what they state, in parameters with these names."""
    made = about(200).model_copy(
        update={
            "parameters": tuple(Parameter(name=n, unit="rad") for n in names),
            "points": (PointAbout(values={}, bound=(None,) * len(names)),),
        }
    )
    rng = np.random.default_rng(5)
    rows = table(2.0 * rng.standard_normal((200, 2)), 1.0)
    for name in names:
        for what, values in (
            ("error", 2.0 * rng.standard_normal(200)),
            ("sigma", np.ones(200)),
            ("dof", np.full(200, np.nan)),
        ):
            rows = rows.append_column(f"{what}.{name}", [values])
    tally = Tally(made)
    tally.add(rows)
    return summary.summarise(tally)


def test_flags_of_names_that_differ_by_a_digit_are_all_told_and_axes_joined():
    names = ("rig.eccentricity.1c", "rig.eccentricity.2c", "gyro.bias.y", "gyro.bias.z")
    text = show.text(named(names))
    assert "rig.eccentricity.1c/2c: states too little: RMSE is" in text
    assert "gyro.bias.y/z: states too little" in text
    assert "rig.delay1: states too little" in show.text(named(("rig.delay1", "rig.delay2")))
    assert "rig.delay2: states too little" in show.text(named(("rig.delay1", "rig.delay2")))


def test_numbers_of_joined_points_are_their_range():
    rng = np.random.default_rng(6)
    tables = [
        table(k * rng.standard_normal((400, 2)), 1.0, point=i, first=400 * i) for i, k in enumerate((5.0, 1.4, 2.8))
    ]
    found = told(*tables, runs=400, points=3, bound=(1.0, 1.0))
    ratios = sorted(p.parameters[0].ratio for p in found.points)
    said = f"points 0, 1, 2: accel.bias.x: RMSE is {ratios[0]:.3g} to {ratios[-1]:.3g} times the bound"
    assert said in show.text(found)


def test_terms_that_only_some_runs_find_are_told():
    error = np.random.default_rng(7).standard_normal((30, 2))
    error[:22, 0] = np.nan
    sigma = np.where(np.isfinite(error), 1.0, np.nan)
    tally = tallied(runs=30, bound=(1.0, 1.0))
    point = PointAbout(values={}, bound=(1.0, 1.0), sure=(True, True))
    tally.about = tally.about.model_copy(update={"points": (point,)})
    rows = table(error, sigma)
    rows = rows.set_column(rows.schema.get_field_index("nees"), "nees", [np.ones(30)])
    tally.add(rows)
    found = summary.summarise(tally)
    assert "not found in 22 of 30 runs" in found.points[0].parameters[0].flags
    lines = show.text(found).splitlines()
    assert next(line for line in lines if line.endswith("found")).startswith("  parameter")
    assert next(line for line in lines if line.startswith("  accel.bias.x")).rstrip("*").endswith("        8")
    error[:, 0], sigma[:, 0] = np.nan, np.nan
    never = tallied(runs=30, bound=(1.0, 1.0))
    never.about = tally.about
    rows = table(error, sigma)
    never.add(rows.set_column(rows.schema.get_field_index("nees"), "nees", [np.ones(30)]))
    assert (0, "accel.bias.x: not found in 30 of 30 runs") in summary.summarise(never).flags


def test_many_points_are_summed_up_in_one_pass():
    """10 000 points of three runs took 25 s when each was picked out of the whole table."""
    points = np.tile(np.arange(10_000), 3)
    rows = table(np.random.default_rng(8).standard_normal((30_000, 2)), 1.0, point=points)
    tally = Tally(about(3, points=10_000))
    begun = time.process_time()
    tally.add(rows)
    assert time.process_time() - begun < 8.0
    assert [p.runs for p in tally.points] == [3] * 10_000
