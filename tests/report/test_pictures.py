"""Pictures of a calibration: what is drawn, that nothing overlaps, and that files come out alike."""

from __future__ import annotations

import importlib
import re
import tracemalloc
from itertools import combinations
from xml.dom import minidom

import numpy as np
import pytest

from sagnac import from_arrays
from sagnac.calibrate import calibrate
from sagnac.calibration import BudgetLine, Calibration, Fit, Influence, Site, Value
from sagnac.errors import DataError, InputError
from sagnac.observe.static import static_intervals
from sagnac.plan import Plan, Segment
from sagnac.recording import Batch, Recording
from sagnac.report import pictures, sources, style
from sagnac.report.pictures import bars, matrix, segments
from sagnac.report.pictures.envelope import Envelope
from sagnac.report.pictures.log import look, static_spans
from sagnac.results import Software
from sagnac.verification import Check, Verification

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


# ------------------------------------------------------------------------------------------------------ correlation


def test_correlations_of_a_known_covariance():
    calibration = made(3, 3)
    covariance = np.diag([4.0, 9.0, 0.0])
    covariance[0, 1] = covariance[1, 0] = -3.0  # -3 / (2 * 3)
    changed = tuple(
        p.model_copy(update={"standard_uncertainty": float(np.sqrt(covariance[i, i]))})
        for i, p in enumerate(calibration.parameters)
    )
    known = calibration.model_copy(update={"parameters": changed, "covariance": tuple(map(tuple, covariance))})
    assert matrix.correlations(known) == pytest.approx(np.array([[1, -0.5, 0], [-0.5, 1, 0], [0, 0, 0]]))
    assert matrix.strongest(known) == [("accel.bias.x", "accel.bias.y", pytest.approx(-0.5))]
    assert "1 pair beyond ±0.3" in texts_of(pictures.correlation(known))
    assert "−0.50" in texts_of(pictures.correlation(known))


def test_parameters_stand_by_sensor_whatever_their_order():
    calibration = made(60, 3)
    order = np.random.default_rng(0).permutation(60)
    mixed = calibration.model_copy(
        update={
            "parameters": tuple(calibration.parameters[i] for i in order),
            "covariance": tuple(tuple(calibration.covariance[i][j] for j in order) for i in order),
        }
    )
    labels = [t.get_text() for t in pictures.correlation(mixed).axes[0].get_yticklabels()]
    sensor = {f"{p.name.partition('.')[2]}": p.name.partition(".")[0] for p in calibration.parameters}
    rig = [label for label in labels if sensor[label] == "rig"]
    assert labels[-12:] == rig
    terms = [label.rpartition(".")[0] for label in labels]
    assert len(segments_of(terms)) == 2 * len(TERMS) + len(RIG)


def segments_of(keys: list[str]) -> list[str]:
    return [k for i, k in enumerate(keys) if i == 0 or keys[i - 1] != k]


# ----------------------------------------------------------------------------------------------------------- budget


def test_shares_of_a_budget_are_of_the_variance():
    calibration = made(3, 3, sources_=2)
    u = np.array([p.standard_uncertainty for p in calibration.parameters])
    # 3-4-5: 36 and 64 percent; half of the variance only; both together more than the whole
    lines = {"noise": u * [0.6, np.sqrt(0.5), 1.0], "rig": u * [0.8, 0.0, 1.0]}
    told = calibration.model_copy(
        update={"budget": tuple(BudgetLine(source=s, standard_uncertainty=tuple(v)) for s, v in lines.items())}
    )
    share = bars.shares(told)
    assert share["noise"] == pytest.approx([0.36, 0.5, 0.5])
    assert share["rig"] == pytest.approx([0.64, 0.0, 0.5])
    assert share["not in the budget"] == pytest.approx([0.0, 0.5, 0.0], abs=1e-12)
    assert {"noise", "rig", "not in the budget"} <= set(texts_of(pictures.budget(told)))


def test_without_a_budget_the_ways_to_the_uncertainty_are_compared():
    calibration = made(9, 3, sources_=0)
    figure = pictures.budget(calibration)
    curves = {line.get_label(): line for line in figure.axes[0].get_lines()}
    ratio = np.array(calibration.fit.delete_one) / [p.standard_uncertainty for p in calibration.parameters]
    assert curves["leaving out one segment at a time"].get_xdata() == pytest.approx(ratio)
    assert curves["from the noise"].get_xdata() == pytest.approx(np.ones(9))


# --------------------------------------------------------------------------------------------- influence, as found


def test_a_segment_of_two_fits_counts_with_its_greatest_shift():
    calibration = made(9, 2)
    said = (
        Influence(segment="a", leverage=1, chi2=1.0, shift=0.2, parameter="accel.bias.x"),
        Influence(segment="b", leverage=1, chi2=2.0, shift=0.1, parameter="accel.bias.x"),
        Influence(segment="a", leverage=1, chi2=4.0, shift=0.7, parameter="accel.bias.y"),
        Influence(segment="b", leverage=1, chi2=8.0, shift=None, parameter=""),
    )
    told = calibration.model_copy(update={"fit": calibration.fit.model_copy(update={"influence": said})})
    assert bars.strongest_shifts(told) == {"a": (0.7, "accel.bias.y"), "b": (None, "")}
    assert segments.chi_squares(told) == {"a": 5.0, "b": 10.0}
    assert "without it the parameters would not be determined" in texts_of(pictures.influence(told))
    assert_clear(pictures.influence(told))


def test_without_influence_there_is_no_picture_of_it():
    calibration = made(9, 2)
    silent = calibration.model_copy(update={"fit": calibration.fit.model_copy(update={"influence": ()})})
    with pytest.raises(DataError, match="no influence"):
        pictures.influence(silent)
    with pytest.raises(DataError, match="no chi-square"):
        pictures.residuals(silent)


def test_as_found_draws_the_en_number():
    calibration = made(3, 3)
    u = [p.standard_uncertainty for p in calibration.parameters]
    # E_n = difference / (2 sqrt(u^2 + u^2)): half, twice, and far beyond
    number = [0.5, -2.0, 40.0]
    later = tuple(
        p.model_copy(update={"value": p.value + e * 2 * np.sqrt(2) * s})
        for p, e, s in zip(calibration.parameters, number, u, strict=True)
    )
    figure = pictures.as_found(calibration, calibration.model_copy(update={"parameters": later}))
    lines = figure.axes[0].get_lines()
    marks = [line for line in lines if line.get_marker() not in ("None", "") and len(line.get_xdata())]
    drawn = {line.get_marker(): line.get_xdata() for line in marks}
    assert drawn["o"] == pytest.approx([0.5])
    assert drawn["D"] == pytest.approx([-2.0])
    assert drawn[">"] == pytest.approx([3.21])
    assert "40" in texts_of(figure)
    assert_clear(figure)


def test_as_found_needs_a_common_parameter():
    other = made(3, 3)
    renamed = tuple(p.model_copy(update={"name": p.name.replace("accel", "gyro")}) for p in other.parameters)
    with pytest.raises(DataError, match="no parameter in common"):
        pictures.as_found(other, other.model_copy(update={"parameters": renamed}))


# -------------------------------------------------------------------------------------------------------- residuals


def test_residuals_beyond_their_bar_are_open():
    checks = [Check(f"s{i}", "static norm", r * 1e-5, 1e-5, "m/s^2") for i, r in enumerate([0.5, -1.9, 2.5, 1.0, 0.0])]
    figure = pictures.residuals(made(9, 3), checks)
    assert any(text.endswith("1 of 5 beyond their bar (open)") for text in texts_of(figure))
    dots = [line for line in figure.axes[0].get_lines() if line.get_marker() == "o"]
    assert [len(line.get_xdata()) for line in dots] == [4, 1]
    # 2.5e-5 m/s^2 in ug
    assert dots[1].get_ydata() == pytest.approx([2.5e-5 / 9.80665e-6])


def test_few_segments_are_listed_over_their_uncertainty():
    checks = [Check("1", f"accel_z {h}", r, 0.5, "m/s^2") for h, r in (("mean", 0.5), ("1x", 1.5), ("2x", 0.0))]
    figure = pictures.residuals(made(9, 3), checks)
    dots = {line.get_marker(): line.get_xdata() for line in figure.axes[0].get_lines() if line.get_marker() in "oD"}
    assert dots["o"] == pytest.approx([1.0, 0.0])
    assert dots["D"] == pytest.approx([3.0])
    assert {"segment 1", "accel_z 1x"} <= set(texts_of(figure))


@pytest.fixture(scope="module")
def turned() -> tuple[Recording, Calibration]:
    """A unit turned by hand, and its calibration."""
    recording = hand_log()
    return recording, calibrate("norm", recording, Plan(gravity=9.81))


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


def test_comparison_of_a_recording_with_and_without_its_calibration(turned):
    recording, calibration = turned
    found = pictures.comparison(calibration, recording, Plan(gravity=9.81))
    assert len(found.pairs) == 16
    before, after = found.rms("static norm")
    # uncalibrated: gains 1 to 2 % of gravity and biases of some 0.04 m/s^2; after: noise of a mean over 4 s at 100 Hz
    assert 0.05 < before < 0.3
    assert after < 4 * 1e-3 / np.sqrt(400)
    # uncalibrated is what the readings say themselves
    batch = recording.read()
    intervals = static_intervals(batch)
    a, b = intervals.start[0], intervals.stop[0]
    norm = np.linalg.norm(batch.accel[a:b].mean(axis=0))
    assert found.pairs[0].before == pytest.approx(norm - 9.81, rel=1e-6)
    assert_clear(pictures.before_after(found))
    assert found.before == "uncalibrated"
    with pytest.raises(KeyError):
        found.rms("rate norm")


def test_comparison_with_an_earlier_calibration(turned):
    recording, calibration = turned
    found = pictures.comparison(calibration, recording, Plan(gravity=9.81), calibration)
    assert found.before == "with the earlier calibration"
    assert [p.before for p in found.pairs] == [p.after for p in found.pairs]


def test_a_unit_in_counts_is_compared_with_one_gain_for_all_axes():
    calibration = made(3, 3)
    names = ("accel.scale_factor.x", "accel.scale_factor.y", "accel.bias.x")
    values = (410.0, 420.0, 33000.0)
    counted = tuple(
        p.model_copy(update={"name": n, "value": v})
        for p, n, v in zip(calibration.parameters, names, values, strict=True)
    )
    plain = pictures.nominal(calibration.model_copy(update={"parameters": counted}))
    assert plain.values() == {names[0]: 415.0, names[1]: 415.0, names[2]: 33000.0}


def test_the_unit_without_errors_keeps_what_is_the_rigs():
    calibration = made(60, 3)
    plain = pictures.nominal(calibration).values()
    for name, value in calibration.values().items():
        assert plain[name] == (
            value if name.startswith(("rig.lever_arm", "rig.zero", "rig.tilt", "rig.nonperp")) else 0
        )


# -------------------------------------------------------------------------------------------------------------- log


def test_envelope_of_a_stream_is_that_of_the_whole():
    rng = np.random.default_rng(0)
    values = rng.standard_normal((10_007, 2))
    values[5_003] = [9.0, -9.0]
    time = np.arange(len(values)) / 10
    for pieces in (1, 7, 10_007):
        envelope = Envelope(2, stretches=64)
        for part in np.array_split(np.arange(len(values)), pieces):
            envelope.add(time[part], values[part])
        found = envelope.result()
        assert 16 <= found.first.size <= 65
        assert np.all(found.first <= found.last)
        assert np.all(found.last[:-1] < found.first[1:])
        for i in range(found.first.size):
            there = values[(time >= found.first[i]) & (time <= found.last[i])]
            assert found.low[i] == pytest.approx(there.min(axis=0), abs=0)
            assert found.high[i] == pytest.approx(there.max(axis=0), abs=0)
        assert (found.first[0], found.last[-1]) == (time[0], time[-1])


def test_envelope_of_nothing_is_empty():
    assert Envelope(3).result().low.shape == (0, 3)


def streamed(samples: int, piece: int = 100_000) -> Recording:
    """A recording that makes its samples while it is read."""

    def stream(_: bool):
        for row in range(0, samples, piece):
            count = min(piece, samples - row)
            time = (row + np.arange(count)) / 1000
            yield Batch(row + 1, time, np.tile([0.0, 0.0, 9.8], (count, 1)), None)

    return Recording("streamed", None, frozenset(), frozenset({"accel"}), frozenset(), (), {}, stream)


def test_long_logs_take_bounded_memory():
    plan = Plan(segment=(Segment(name="a", start=1.0, stop=900.0),))
    recording = streamed(2_000_000)
    tracemalloc.start()
    seen = look(recording)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert seen.samples == 2_000_000
    assert seen.whole is None
    assert peak < 40e6  # the whole log: 64 MB; a piece of it: 3 MB and its copies
    assert pictures.log(recording, plan) is not None


def test_log_shows_every_axis_and_the_segments_of_the_plan():
    time = np.arange(6000) / 10
    accel = np.column_stack([np.sin(time), np.zeros(6000), np.full(6000, 9.8)])
    gyro = np.where(time[:, None] > 300, 0.1, 0.0) * np.ones(3)
    temperature = {"temperature": np.linspace(293.15, 300.0, 6000)}
    recording = from_arrays(time, accel, gyro, rig=temperature)
    plan = Plan(
        segment=(
            Segment(name="rest", start=10.0, stop=290.0),
            Segment(name="turn", start=310.0, stop=590.0, outer_rate=0.1),
        )
    )
    figure = pictures.log(recording, plan)
    assert len(figure.axes) == 7
    assert {"rest", "turn", "at rest", "turning", "2 segments of the plan", "time [s]"} <= set(texts_of(figure))
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels[0] == "accel x\n[m/s²]"
    assert labels[-1] == "temp.\n[degC]"
    assert_clear(figure)


def test_log_of_a_unit_turned_by_hand_names_its_static_intervals(turned):
    recording, calibration = turned
    figure = pictures.log(recording, None, calibration)
    said = texts_of(figure)
    assert "16 static intervals" in said
    assert sum(t.endswith(("▾", "◂")) for t in said) == 1  # the segment with most influence
    assert_clear(figure)


@pytest.mark.parametrize("count", [3, 24, 120])
def test_names_of_many_segments_do_not_overlap_in_the_log(count):
    time = np.arange(12_000) / 10
    recording = from_arrays(time, np.ones((12_000, 3)))
    step = 1200 / count
    plan = Plan(
        segment=tuple(
            Segment(name=f"position {i + 1}", start=i * step + 0.2, stop=(i + 0.8) * step) for i in range(count)
        )
    )
    assert_clear(pictures.log(recording, plan))


def test_gaps_are_open_in_the_log():
    time = np.concatenate([np.arange(1000) / 10, 500 + np.arange(1000) / 10])
    figure = pictures.log(from_arrays(time, np.ones((2000, 3))), Plan(segment=(Segment(name="a", start=1, stop=9),)))
    (curve,) = figure.axes[0].collections
    assert len(curve.get_paths()) == 2


def test_a_log_without_samples_is_refused():
    empty = from_arrays(np.zeros(0), np.zeros((0, 3)))
    with pytest.raises(InputError, match="no samples"):
        pictures.log(empty)


def test_a_log_too_short_for_static_intervals_is_drawn_without():
    figure = pictures.log(from_arrays(np.arange(20) / 10, np.ones((20, 3))))
    assert "no static intervals" in texts_of(figure)
    assert static_spans(Batch(1, np.arange(3.0), None, None)) == []


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
