"""Pictures of parameters: correlation, budget, influence, as found."""

from __future__ import annotations

import numpy as np
import pytest
from figures import RIG, TERMS, assert_clear, made, texts_of

from sagnac.calibration import BudgetLine, Influence
from sagnac.errors import DataError
from sagnac.report import pictures
from sagnac.report.pictures import bars, matrix, segments

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
