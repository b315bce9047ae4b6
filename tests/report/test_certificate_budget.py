"""Where a certificate says that the uncertainty comes from, what it calls exact, and what it does not call a result."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.calibration import BudgetLine, Calibration, Fit, Scatter, Site, Software, Value
from sagnac.plan import from_table
from sagnac.report import pictures
from sagnac.report.certificate import certificate
from sagnac.report.certificate.evidence import Evidence, of
from sagnac.report.certificate.methods import method_of
from sagnac.report.document import Bullets, Grid, Text
from sagnac.results import covariance_rows

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"></svg>'
UNITS = {
    "accel.bias": "m/s^2",
    "accel.scale_error": "1",
    "gyro.bias": "rad/s",
    "gyro.scale_error": "1",
    "rig.tilt": "rad",
}
METHODS = (
    "four-position",
    "multi-position",
    "norm",
    "table",
    "centrifuge",
    "centrifuge closed form",
    "roll-isolated",
)


@pytest.fixture(autouse=True)
def undrawn(monkeypatch):
    """No pictures: these tests are about words."""
    monkeypatch.setattr(pictures, "svg", lambda _: SVG)
    for name in ("parameters", "correlation", "budget", "residuals", "influence", "log"):
        monkeypatch.setattr(pictures, name, lambda *_, **__: None)


def made(sigma, *, method="norm", **more):
    """A calibration of parameters of value zero with these standard uncertainties."""
    names = list(sigma)
    fit = Fit(
        chi2=9.0,
        degrees_of_freedom=9,
        residual_rms=1.0,
        converged=True,
        iterations=2,
        **more.pop("fit", {}),
    )
    parameters = tuple(
        Value(name=n, value=0.0, unit=UNITS.get(n.rpartition(".")[0], "s"), standard_uncertainty=s)
        for n, s in sigma.items()
    )
    return Calibration(
        method=method,
        parameters=parameters,
        covariance=covariance_rows(np.diag(np.square([sigma[n] for n in names]))),
        fit=fit,
        site=Site(gravity=9.81234, gravity_source="given", latitude=math.radians(45.5)),
        software=Software(version="1"),
        created="2026-11-22T09:27:53+00:00",
        **more,
    )


def section(document, title):
    return next(s for s in document.sections if s.title == title)


def words(found):
    return " ".join(b.text for b in found.blocks if isinstance(b, Text))


def items(found):
    return [i for b in found.blocks if isinstance(b, Bullets) for i in b.items]


def rows(found, caption):
    grid = next(b for b in found.blocks if isinstance(b, Grid) and caption in b.caption)
    return {r[0]: dict(zip(grid.header, r, strict=True)) for r in grid.rows}


# ---------------------------------------------------------------------------------------------------------- budget


def test_the_budget_has_a_column_a_source_and_leaves_out_what_is_nothing():
    lines = tuple(
        BudgetLine(source=source, standard_uncertainty=(u,))
        for source, u in (("noise", 3.0), ("gravity", 4.0), ("rate", 1e-6))
    )
    found = section(certificate(of(made({"accel.bias.x": 5.0}, budget=lines))), "Uncertainty budget")
    (row,) = rows(found, "budget").values()
    assert list(row) == ["parameter", "unit", "noise", "gravity", "u"]
    parts = [float(row[k]) for k in ("noise", "gravity", "u")]
    assert math.hypot(*parts[:2]) == pytest.approx(parts[2], rel=0.01)
    assert "Less than a thousandth of every u comes from: rate" in words(found)
    assert "one weighted fit" not in words(found)
    assert "do not come to u" not in words(found)


def test_a_budget_that_does_not_rebuild_u_is_said():
    lines = (BudgetLine(source="noise", standard_uncertainty=(3.0, 5.0)),)
    calibration = made({"accel.bias.x": 5.0, "accel.bias.y": 5.0}, budget=lines)
    said = words(section(certificate(of(calibration)), "Uncertainty budget"))
    assert "do not come to u for accel.bias.x; u is" in said


def test_what_is_not_counted_is_no_part_of_u():
    lines = (
        BudgetLine(source="noise", standard_uncertainty=(5.0,)),
        BudgetLine(source="truncation, not counted", standard_uncertainty=(9.0,)),
    )
    calibration = made({"accel.bias.x": 5.0}, method="centrifuge closed form", budget=lines)
    said = words(section(certificate(of(calibration)), "Uncertainty budget"))
    assert "do not come to u" not in said
    assert "not in u" in said


def test_without_a_budget_the_evaluations_stand_and_their_method_says_why():
    fit = {"white": (3.0, 3.0), "cluster": (2.0, 3.0)}
    calibration = made({"gyro.bias.x": 5.0, "gyro.bias.y": 3.0}, method="roll-isolated", fit=fit)
    found = section(certificate(of(calibration)), "Uncertainty budget")
    assert "in one weighted fit" in words(found)
    assert "For gyro.bias.x u is larger than all evaluations" in words(found)
    other = section(certificate(of(calibration.model_copy(update={"method": "norm"}))), "Uncertainty budget")
    assert "in one weighted fit" not in words(other)


# ----------------------------------------------------------------------------------------------------- taken as exact


@pytest.mark.parametrize("method", METHODS)
def test_every_method_names_what_it_rests_on_and_takes_as_exact(method):
    known = method_of(made({"accel.bias.x": 1.0}, method=method))
    assert known.rests
    assert known.exact
    assert all(text.format(gravity="G").endswith(".") for text in known.rests.values())


def test_exact_is_what_has_no_stated_uncertainty():
    def exact(**more):
        return items(
            section(certificate(of(made({"accel.bias.x": 1.0, "gyro.bias.x": 1.0}, **more))), "Uncertainty budget")
        )

    assert exact() == [
        "gravity: 9.81234 m/s² (given)",
        "rate of the table",
        "vertical of the axis that turns",
        "latitude: 45.5°",
        "time stamps of the recording",
    ]
    stated = {"rate_uncertainty": "1e-5", "axis_uncertainty": "5 arcsec"}
    assert "rate of the table" not in exact(rig=stated)
    assert "vertical of the axis that turns" not in exact(rig=stated)
    lines = (BudgetLine(source="gravity", standard_uncertainty=(1.0, 0.0)),)
    assert not [i for i in exact(budget=lines) if "gravity" in i]


def test_exact_is_told_of_the_sensors_that_are_there():
    accel = certificate(of(made({"accel.bias.x": 1.0})))
    assert items(section(accel, "Uncertainty budget")) == ["gravity: 9.81234 m/s² (given)"]
    gyro = certificate(of(made({"gyro.bias.x": 1.0})))
    assert not [i for i in items(section(gyro, "Uncertainty budget")) if "gravity" in i]


def test_the_radius_of_an_arm_without_uncertainty_is_exact():
    rig = {"kind": "centrifuge", "radius": "2.5 m"}
    found = certificate(of(made({"accel.bias.x": 1.0}, method="centrifuge", rig=rig)))
    assert "radius of the arm: 2.5\xa0m" in items(section(found, "Uncertainty budget"))
    better = certificate(
        of(made({"accel.bias.x": 1.0}, method="centrifuge", rig={**rig, "radius_uncertainty": "1 mm"}))
    )
    assert not [i for i in items(section(better, "Uncertainty budget")) if "radius" in i]


def test_the_plan_says_how_gravity_is_known():
    calibration = made({"accel.bias.x": 1.0})
    plan = from_table({"latitude": "45.5 deg", "gravity_uncertainty": "1 mGal"}, "plan")
    found = certificate(Evidence(calibration, b"{}", plan=plan))
    assert not items(section(found, "Uncertainty budget"))


# ------------------------------------------------------------------------------------------------------- traceability


def test_traceability_speaks_of_the_sensors_and_of_the_method():
    def said(names, method):
        return words(section(certificate(of(made(dict.fromkeys(names, 1.0), method=method))), "Traceability"))

    both = said(("accel.scale_error.x", "gyro.scale_error.x"), "norm")
    assert "scale of the accelerometers rests on the gravity of the site (given)" in both
    assert "rate of the table" in both
    alone = said(("gyro.scale_error.x",), "norm")
    assert "accelerometers" not in alone
    biases = said(("accel.bias.x", "gyro.bias.x"), "four-position")
    assert "The biases of the accelerometers" in biases
    assert "scale of the gyros" not in biases
    by_hand = certificate(
        of(
            made(
                {"accel.scale_error.x": 1.0, "gyro.scale_error.x": 1.0}, remarks=("38 static intervals found in 512 s",)
            )
        )
    )
    assert "table" not in words(section(by_hand, "Traceability"))


# ------------------------------------------------------------------------------------------- given, assumed, expanded


def test_what_was_given_or_assumed_is_not_called_a_result():
    sigma = {
        "gyro.scale_error.x": 4e-5,
        "gyro.scale_error.y": 0.0071,
        "gyro.scale_error.z": 0.0035,
        "rig.encoder_delay": 0.0,
    }
    calibration = made(sigma, method="roll-isolated", rig={"encoder_delay": "0.0 s"})
    found = section(certificate(of(calibration)), "Results")
    # without a plan the limit of gyros y and z is 0.01 (sagnac.calibrate.roll_isolated.GYRO_SCALE)
    told = {name: row[""] for name, row in rows(found, "Values").items()}
    assert told == {
        "gyro.scale_error.x": "",
        "gyro.scale_error.y": "assumed, not measured",
        "gyro.scale_error.z": "",
        "rig.encoder_delay": "given",
    }
    assert rows(found, "Values")["rig.encoder_delay"]["U"] == "–"
    assert "no result of this calibration" in words(found)
    plan = from_table({"latitude": "45 deg", "unit": {"limits": {"gyro_scale": 0.004}}}, "plan")
    stated = section(certificate(Evidence(calibration, b"{}", plan=plan)), "Results")
    assert rows(stated, "Values")["gyro.scale_error.z"][""] == "assumed, not measured"


def test_an_axis_that_the_data_show_no_better_than_the_plan_is_assumed():
    rig = {"axis_uncertainty": "1e-5 rad"}
    found = section(certificate(of(made({"rig.tilt.x": 9.6e-6, "rig.tilt.y": 2e-6}, rig=rig))), "Results")
    assert [row[""] for row in rows(found, "Values").values()] == ["assumed, not measured", ""]


def test_where_all_is_measured_there_is_no_column_for_it():
    found = section(certificate(of(made({"accel.bias.x": 1e-3}))), "Results")
    assert "" not in rows(found, "Values")["accel.bias.x"]


def test_the_picture_has_the_coverage_factors_of_the_table(monkeypatch):
    drawn = {}
    monkeypatch.setattr(pictures, "parameters", lambda _, k: drawn.update(k))
    fit = {"uncertainty": "scaled"}
    found = section(certificate(of(made({"accel.bias.x": 1e-3}, fit=fit))), "Results")
    (row,) = rows(found, "Values").values()
    assert f"{drawn['accel.bias.x']:.2f}" == row["k"]
    assert float(row["k"]) > 2.2  # Student's, nine degrees of freedom


def test_rotations_that_the_calibration_does_not_keep_are_said():
    residuals = {"rotation": Scatter(rms=0.1, unit="deg", count=7)}
    found = section(certificate(of(made({"accel.bias.x": 1e-3}, fit={"residuals": residuals}))), "Residuals")
    assert "keeps the rms alone" in words(found)
