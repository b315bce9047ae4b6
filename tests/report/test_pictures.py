"""Pictures of calibrations: all of them, and what they have in common."""

from __future__ import annotations

import importlib
import re
from itertools import combinations
from xml.dom import minidom

import numpy as np
import pytest
from figures import HARMONICS, NORMS, OF_CALIBRATION, assert_clear, checks_of, compared, made, texts_of

from sagnac.calibration import Influence
from sagnac.errors import DataError, InputError
from sagnac.plan import Plan
from sagnac.report import pictures, sources, style
from sagnac.report.pictures import segments
from sagnac.verification import Check, Verification

# ------------------------------------------------------------------------------------------------------ all of them


@pytest.mark.parametrize("size", [(1, 1), (9, 3), (60, 120)])
@pytest.mark.parametrize("draw", OF_CALIBRATION)
def test_nothing_overlaps_and_all_fits_an_a4_page(draw, size):
    figure = draw(made(*size))
    assert_clear(figure)
    width, height = figure.get_size_inches()
    assert width == style.WIDTH
    assert height <= style.TALLEST + 1e-9


@pytest.mark.parametrize("positions", [3, 120])
@pytest.mark.parametrize("whats", [NORMS[:1], NORMS, HARMONICS])
def test_residuals_of_many_segments_and_quantities_do_not_overlap(positions, whats):
    checks = checks_of(positions, whats)
    for figure in (pictures.residuals(made(9, 3), checks), pictures.before_after(compared(checks))):
        assert_clear(figure)
        assert figure.get_size_inches()[1] <= style.TALLEST + 1e-9


@pytest.mark.parametrize("draw", OF_CALIBRATION)
def test_svg_is_the_same_every_time_small_and_sound(draw):
    calibration = made(12, 24)
    first, again = pictures.svg(draw(calibration)), pictures.svg(draw(calibration))
    assert first == again
    assert first.startswith("<svg ")
    assert len(first) < 60_000
    assert not re.search(r"<\?xml|<!|<metadata|<style|xlink:|\d{4}-\d\d-\d\dT", first.replace("xmlns:xlink", ""))
    minidom.parseString(first)
    ids = re.findall(r'\sid="([^"]+)"', first)
    referred = set(re.findall(r'(?:href="#|url\(#)([^")]+)', first))
    assert len(ids) == len(set(ids))
    assert referred == set(ids)


def test_svg_of_the_largest_matrix_is_small():
    assert len(pictures.svg(pictures.correlation(made(60, 3)))) < 130_000


def test_svgs_of_one_page_share_no_id():
    ids = [
        set(re.findall(r'\sid="([^"]+)"', pictures.svg(draw(made(9, 12)))))
        for draw in (pictures.correlation, pictures.budget, pictures.influence)
    ]
    assert all(not a & b for a, b in combinations(ids, 2))


def test_names_are_text_whatever_they_hold():
    calibration = made(3, 3, name="<b>$x_{}$ & \"'#")
    drawn = pictures.influence(calibration)
    assert "<b>$x_1$ & \"'#" in texts_of(drawn)
    minidom.parseString(pictures.svg(drawn))


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_files_are_the_same_every_time(tmp_path, ending):
    for name in ("a", "b"):
        style.save(pictures.parameters(made(6, 5)), tmp_path / f"{name}.{ending}")
    assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()


def test_drawing_leaves_the_callers_settings_alone():
    import matplotlib as mpl

    with mpl.rc_context({"font.size": 21.0, "axes.grid": True}):
        pictures.svg(pictures.correlation(made(9, 3)))
        assert mpl.rcParams["font.size"] == 21.0


def test_pictures_say_what_they_lack():
    calibration = made(9, 3)
    with pytest.raises(InputError, match="there is no picture 'x'; choose from parameters, correlation"):
        pictures.draw("x", pictures.Material(calibration))
    with pytest.raises(InputError, match="'before-after' .* needs recording"):
        pictures.draw("before-after", pictures.Material(calibration))
    assert pictures.draw("budget", pictures.Material(calibration)) is not None


# ---------------------------------------------------------------------------------------------------- small things


def test_what_names_have_in_common_is_left_out_where_they_are_long():
    names = [f"position {i} of the third day" for i in (9, 10, 11)]
    assert style.told_apart(names, 12) == (["9", "10", "11"], "position … of the third day")
    assert style.told_apart(["10", "11"], 12) == (["10", "11"], "")
    assert style.told_apart(["abcdefghijk", "x"], 5) == (["ab…jk", "x"], "")


@pytest.mark.parametrize(
    ("size", "unit", "shown"),
    [(5e-6, "m/s^2", "ug"), (0.5, "m/s^2", "mg"), (3.0, "count", "count"), (1.0, "kg", "kg")],
)
def test_unit_for_the_size(size, unit, shown):
    assert style.shown_unit(size, unit)[0] == shown


def test_units_are_set_as_in_print():
    assert style.pretty("ug/sqrt(Hz)") == "µg/√Hz"
    assert style.in_brackets("m/s^2") == " [m/s²]"
    assert style.in_brackets("1") == ""
    assert style.number(-2e-3 * 9.80665, 1e-4 * 9.80665, "m/s^2") == ("−2.00", "0.10", "mg")
    assert style.number(-1e-9, 0.3 * 9.80665e-3, "m/s^2")[0] == "0.00"


def test_own_files_are_found_by_name_and_hash(tmp_path):
    from sagnac.files import sha256
    from sagnac.results import Source

    (tmp_path / "log.csv").write_text("time [s]\n")
    (tmp_path / "plan.toml").write_text("")
    named = (
        Source(file="elsewhere/log.csv", sha256=sha256(tmp_path / "log.csv")),
        Source(file="plan.toml", role="plan", sha256="0" * 64),
        Source(file="prior.json", role="prior"),
    )
    calibration = made(3, 3).model_copy(update={"source": named})
    found = sources.find(calibration, tmp_path)
    assert found == {"recording": tmp_path / "log.csv"}
    assert sources.missing(calibration, found) == {"plan": "plan.toml", "prior": "prior.json"}


# ------------------------------------------------------------------------------------------------ true to the numbers


def with_influence(*said: Influence):
    calibration = made(9, 2)
    return calibration.model_copy(update={"fit": calibration.fit.model_copy(update={"influence": said})})


def test_residuals_of_next_to_nothing_are_marked_and_not_drawn_higher():
    """Their place is a hundredth of the uncertainty of 10 ug (1e-4 m/s^2); they are less than that, and a triangle says so."""
    pairs = [pictures.Pair(f"s{i}", "static norm", 0.05, v, 1e-4, "m/s^2") for i, v in enumerate([2e-4] * 5 + [1e-9])]
    figure = pictures.before_after(pictures.Comparison(tuple(pairs), "uncalibrated", "with this calibration", ()))
    marked = [line for line in figure.axes[0].get_lines() if line.get_marker() == "v" and line.get_xdata().size]
    assert len(marked) == 1
    assert marked[0].get_xdata().size == 1
    assert "smaller than is drawn" in [t.get_text() for t in figure.legends[0].get_texts()]
    drawn = [line for line in figure.axes[0].get_lines() if line.get_marker() == "o"]
    assert drawn[0].get_xdata().size == 5
    listed = pictures.before_after(pictures.Comparison(tuple(pairs[3:]), "uncalibrated", "with this calibration", ()))
    (marked,) = [line for line in listed.axes[0].get_lines() if line.get_marker() == "<" and line.get_xdata().size]
    assert marked.get_xdata().size == 1
    assert_clear(figure)
    assert_clear(listed)


def test_every_residual_in_sight_is_drawn_where_it_is():
    pairs = [pictures.Pair(f"s{i}", "static norm", 0.05, 1e-4 * 2.0**-i, 1e-4, "m/s^2") for i in range(6)]
    figure = pictures.before_after(pictures.Comparison(tuple(pairs), "before", "after", ()))
    (after,) = [line for line in figure.axes[0].get_lines() if line.get_marker() == "o"]
    values = np.asarray(after.get_ydata())
    np.testing.assert_allclose(values / values[0], 0.5 ** np.arange(6))
    assert values[0] == pytest.approx(1e-4 / 9.80665e-6)  # in ug
    assert "5099 µg → " in figure.axes[0].get_title(loc="left")  # 0.05 / 9.80665e-6, in the unit of the axis


def test_one_unit_a_panel():
    """Angles whose uncertainties lie either side of a hundredth of a degree stand in the unit of their axis."""
    calibration = made(9, 2)
    changed = []
    for p in calibration.parameters:
        if "misalignment" in p.name:
            small = p.name.endswith("yx")
            update = {"value": 1e-4 if small else 0.2, "standard_uncertainty": 1e-6 if small else 1e-3}
            changed.append(p.model_copy(update=update))
            continue
        changed.append(p)
    figure = pictures.parameters(calibration.model_copy(update={"parameters": tuple(changed)}))
    for axes in figure.axes:
        if axes.get_visible() and "misalignment" in axes.get_title(loc="left"):
            unit = axes.get_xlabel().strip("[]")
            assert all(t.get_text().endswith(f" {unit}") for t in axes.texts)
            assert len(axes.texts) > 1


def test_segments_that_cannot_be_left_out_have_no_bar():
    figure = pictures.influence(
        with_influence(
            Influence(segment="a", leverage=1, chi2=1.0, shift=0.2, parameter="accel.bias.x"),
            Influence(segment="b", leverage=1, chi2=2.0, shift=None, parameter=""),
            Influence(segment="c", leverage=1, chi2=2.0, shift=None, parameter=""),
        )
    )
    assert [p.get_height() for p in figure.axes[0].patches] == [0.2]
    assert "without any of these 2 segments the parameters would not be determined" in texts_of(figure)
    assert_clear(figure)


def test_where_no_segment_can_be_left_out_there_is_no_influence_to_draw():
    nothing = (Influence(segment=s, leverage=1, chi2=1.0, shift=None, parameter="") for s in "abcd")
    with pytest.raises(DataError, match="without any of these 4 segments .* would not be determined"):
        pictures.influence(with_influence(*nothing))


def test_chi_squares_are_held_against_what_is_expected_of_each_segment():
    """20 readings less half a parameter against 2: one average line would call the long segment an outlier."""
    told = with_influence(
        Influence(segment="long", leverage=0.5, chi2=21.0, shift=0.2, parameter="accel.bias.x", rows=20),
        Influence(segment="short", leverage=1.0, chi2=1.2, shift=0.3, parameter="accel.bias.x", rows=2),
    )
    assert segments.expected_chi_squares(told) == {"long": 19.5, "short": 1.0}
    assert "expected of each (its readings less its leverage)" in texts_of(pictures.residuals(told))
    assert_clear(pictures.residuals(told))
    longer = with_influence(
        told.fit.influence[0].model_copy(update={"chi2": 900.0, "rows": 870}), told.fit.influence[1]
    )
    assert pictures.residuals(longer).axes[0].get_yscale() == "log"
    assert not any("$" in t for t in texts_of(pictures.residuals(longer)))
    assert_clear(pictures.residuals(longer))
    alike = with_influence(
        *(Influence(segment=s, leverage=0.5, chi2=1.0, shift=0.2, parameter="accel.bias.x", rows=2) for s in "ab")
    )
    assert any(t.startswith("expected of one on average: 1.5 ") for t in texts_of(pictures.residuals(alike)))
    assert (
        segments.expected_chi_squares(
            with_influence(*(i.model_copy(update={"rows": None}) for i in alike.fit.influence))
        )
        == {}
    )


def test_the_marked_segment_of_a_log_is_explained(turned):
    recording, calibration = turned
    figure = pictures.log(recording, None, calibration)
    words = [t.get_text() for t in figure.legends[0].get_texts()]
    assert "influences the result most" in words
    assert "influences the result most" not in [t.get_text() for t in pictures.log(recording).legends[0].get_texts()]
    assert_clear(figure)


def test_residuals_that_are_nothing_by_construction_are_refused():
    checks = [Check("all", f"accel.bias.{a}", 0.0, 1e-4, "m/s^2") for a in "xyz"]
    with pytest.raises(DataError, match="zero by construction"):
        pictures.refuse_nothing(made(9, 2), checks)
    pictures.refuse_nothing(made(9, 2), [*checks, Check("all", "b", 1e-4, 1e-4, "m/s^2")])


def test_readings_that_cannot_be_judged_uncalibrated_name_the_rig_they_are_from(turned, monkeypatch):
    module = importlib.import_module("sagnac.report.pictures.comparison")
    recording, calibration = turned
    outcome = module.verify(calibration, recording, Plan(gravity=9.81))

    def verified(of, *_, **__):
        if of is calibration:
            return outcome
        raise DataError("check the table")

    monkeypatch.setattr(module, "verify", verified)
    plan = Plan.model_validate({"gravity": 9.81, "rig": {"kind": "centrifuge"}})
    with pytest.raises(DataError, match=r"model of the centrifuge .*--earlier") as told:
        pictures.comparison(calibration, recording, plan)
    assert "table" not in str(told.value)


def test_residuals_of_four_positions_against_themselves_are_refused(turned, monkeypatch):
    recording, calibration = turned
    checks = tuple(Check("all", f"accel.bias.{a}", 0.0, 1e-4, "m/s^2") for a in "xyz")
    outcome = Verification(checks, 0.0, 3, 1.0, passed=True)
    monkeypatch.setattr("sagnac.verification.verify", lambda *_, **__: outcome)
    with pytest.raises(DataError, match="zero by construction"):
        pictures.draw("residuals", pictures.Material(calibration, recording))
