"""Two calibrations side by side: differences, altogether, and what is not the same quantity."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import f as fisher
from scipy.stats import t as student

from sagnac import results
from sagnac.calibration import Calibration, Fit, Site, UnitName, named
from sagnac.errors import DataError
from sagnac.registry.compare import SCHEMA, Comparison, compare
from sagnac.registry.conventions import alike
from sagnac.results import Software, Source, covariance_rows
from sagnac.sensors import Triad

RNG = np.random.default_rng(3)


def made(names, units, values, covariance, **other) -> Calibration:
    given = {
        "method": "norm",
        "unit": UnitName(model="LG-1", serial="0001"),
        "fit": Fit(chi2=1.0, degrees_of_freedom=2, residual_rms=1.0, converged=True, iterations=1),
        "site": Site(gravity=9.81, latitude=0.8),
        "software": Software(version="0"),
        "created": "2026-01-01T00:00:00+00:00",
    } | other
    covariance = np.asarray(covariance, float)
    return Calibration(
        parameters=named(names, units, np.asarray(values, float), covariance),
        covariance=covariance_rows(covariance),
        **given,
    )


def biases(values, covariance=None, **other) -> Calibration:
    n = len(values)
    covariance = np.eye(n) * 1e-10 if covariance is None else covariance
    return made([f"accel.bias.{a}" for a in "xyz"[:n]], ["m/s^2"] * n, values, covariance, **other)


def correlated(n=3, size=1e-5):
    mix = RNG.standard_normal((n, n))
    return size**2 * (mix @ mix.T + np.eye(n))


def test_differences_are_over_the_joint_uncertainty():
    before, after = biases([1.0, 2.0, 3.0]), biases([1.0, 2.00003, 2.99999], np.diag([1e-10, 4e-10, 9e-10]))
    found = compare(before, after)
    expected = np.array([0, 3e-5, -1e-5]) / np.sqrt([2e-10, 5e-10, 10e-10])
    assert [d.normalised for d in found.parameters] == pytest.approx(expected, rel=1e-6)
    assert [d.standard_uncertainty for d in found.parameters] == pytest.approx(np.sqrt([2e-10, 5e-10, 10e-10]))
    assert found.parameters[1].p_value == pytest.approx(2 * (1 - 0.9101438), rel=1e-4)  # 1.3416 sigma, two-sided
    assert not found.left_out


def test_altogether_is_chi_square_with_both_covariances():
    one, other = correlated(), correlated()
    change = np.array([2e-5, -1e-5, 3e-5])
    found = compare(biases([1.0, 2.0, 3.0], one), biases([1.0, 2.0, 3.0] + change, other)).together
    assert found is not None
    expected = change @ np.linalg.solve(one + other, change)
    assert found.chi2 == pytest.approx(expected, rel=1e-6)
    assert found.degrees_of_freedom == 3
    assert found.p_value == pytest.approx(chi2_distribution.sf(expected, 3), rel=1e-6)


def test_a_covariance_without_full_rank_counts_what_it_has():
    # x and y only known to move together
    together = np.array([[1.0, 1.0], [1.0, 1.0]]) * 1e-10
    same = compare(biases([1.0, 2.0], together), biases([1.00001, 2.00001], together))
    assert same.together is not None
    assert same.together.degrees_of_freedom == 1
    assert same.together.chi2 == pytest.approx(0.5, rel=1e-6)
    assert not any("certain" in r for r in same.remarks)
    apart = compare(biases([1.0, 2.0], together), biases([1.00001, 1.99999], together))
    assert any("in some combination both calibrations are certain, and yet they differ" in r for r in apart.remarks)


def test_exact_values_that_differ_are_named():
    exact = np.diag([0.0, 1e-10])
    found = compare(biases([1.0, 2.0], exact), biases([1.5, 2.0], exact))
    assert found.parameters[0].normalised is None
    assert "stated as exact in both and yet different: accel.bias.x" in found.remarks
    assert found.together is not None
    assert found.together.parameters == 1
    nothing = compare(biases([1.0], np.zeros((1, 1))), biases([1.0], np.zeros((1, 1))))
    assert nothing.together is None
    assert not any("exact" in r for r in nothing.remarks)


def test_parameters_that_only_one_has_are_left_out_by_name():
    found = compare(biases([1.0, 2.0]), biases([1.0, 2.0, 3.0]))
    assert [d.name for d in found.parameters] == ["accel.bias.x", "accel.bias.y"]
    assert [(left.name, left.reason) for left in found.left_out] == [("accel.bias.z", "not in the first calibration")]
    assert "not compared, not in the first calibration: accel.bias.z" in found.summary()
    gyro = made(["gyro.bias.x"], ["rad/s"], [0.0], [[1e-16]])
    with pytest.raises(DataError, match=r"a.json and b.json have no parameter that can be compared \(gyro.bias.x: not"):
        compare(biases([1.0]), gyro, names=("a.json", "b.json"))


def whole(matrices, *, full, ratio=False, counts=1.0, size=1e-6, **other) -> Calibration:
    """Both triads of a unit with these matrices (accelerometers, gyros) and biases of one percent of a g and 1e-5 rad/s."""
    names, units, values = [], [], []
    for kind, matrix, bias in zip(("accel", "gyro"), matrices, (0.098, 1e-5), strict=True):
        triad = Triad(kind, counts=counts != 1.0, full=full or kind == "gyro", ratio=ratio)
        names += triad.names
        units += triad.units
        values += list(triad.pack(counts * matrix, counts * bias * np.array([1.0, -2.0, 0.5])))
    scale = np.where([".scale_factor" in n or ".bias" in n for n in names], counts, 1.0)
    misalignment = "input-axis" if ratio else "element"
    return made(names, units, values, np.diag((size * scale) ** 2), misalignment=misalignment, **other)


def turned():
    """Lower triangular accelerometers and full gyros in their frame, and both in a frame turned by up to 2 degrees."""
    accel = np.tril(np.eye(3) + 0.01 * RNG.standard_normal((3, 3)))
    gyro = np.eye(3) + 0.01 * RNG.standard_normal((3, 3))
    turn = np.linalg.qr(np.eye(3) + 0.02 * RNG.standard_normal((3, 3)))[0]
    turn = turn * np.sign(np.diag(turn))
    return (accel, gyro), (accel @ turn, gyro @ turn)


def test_one_unit_in_two_frames_is_one_unit():
    own, mounted = turned()
    for before, after in (
        (whole(own, full=False), whole(mounted, full=True)),
        (whole(mounted, full=True), whole(own, full=False)),
    ):
        found = compare(before, after)
        assert max(abs(d.difference) for d in found.parameters) < 1e-9
        assert len(found.parameters) == 9 + 12
        rows = {d.name: d for d in found.parameters}
        assert rows["accel.misalignment.yx"].converted == "in the accelerometers' frame"
        assert rows["accel.scale_error.x"].converted
        assert not rows["accel.bias.x"].converted
        assert "in the accelerometers' frame" in found.summary()


def test_the_covariance_is_turned_too():
    """What is uncertain in one parameter alone becomes uncertain along the change that moving it makes."""
    own, mounted = turned()
    given, other = whole(mounted, full=True), whole(own, full=False)
    names, units = [p.name for p in given.parameters], [p.unit for p in given.parameters]
    values = np.array([p.value for p in given.parameters])
    for i in range(values.size):
        alone = np.zeros((values.size, values.size))
        alone[i, i] = 1e-6
        moved = []
        for step in (1e-4, -1e-4):
            there = values + step * (np.arange(values.size) == i)
            moved.append(np.array(list(alike(made(names, units, there, alone), other).before.values.values())))
        change = (moved[0] - moved[1]) / 2e-4
        found = alike(made(names, units, values, alone), other).before.covariance
        assert found == pytest.approx(1e-6 * np.outer(change, change), abs=1e-12)


def test_elements_become_directions_where_the_other_has_them():
    own, _ = turned()
    before, after = whole(own, full=False), whole(own, full=False, ratio=True)
    plain = {p.name: p.value for p in before.parameters}
    assert plain["accel.misalignment.yx"] != pytest.approx(after["accel.misalignment.yx"].value, rel=1e-4)
    found = {d.name: d for d in compare(before, after).parameters}
    for name, row in found.items():
        assert row.difference == pytest.approx(0.0, abs=1e-12)
        assert row.converted == ("directions of input axes" if ".misalignment." in name else "")


def test_counts_and_si_meet_at_the_input():
    own, _ = turned()
    raw, si = whole(own, full=False, counts=8000.0), whole(own, full=False)
    found = compare(raw, si)
    rows = {d.name: d for d in found.parameters}
    assert rows["accel.bias.x"].unit == "m/s^2"
    assert rows["accel.bias.x"].converted == "referred to the input"
    assert max(abs(d.difference) for d in found.parameters) < 1e-9
    assert {left.name for left in found.left_out} == {
        f"{kind}.{scale}.{a}" for kind in ("accel", "gyro") for scale in ("scale_factor", "scale_error") for a in "xyz"
    }
    # without the conversion of the SI side the biases would differ by the scale error of 1e-2
    assert rows["accel.bias.x"].after != pytest.approx(si["accel.bias.x"].value, rel=1e-4)


def test_two_raw_calibrations_are_compared_as_they_are():
    own, _ = turned()
    found = compare(whole(own, full=False, counts=8000.0), whole(own, full=False, counts=8000.0))
    assert not any(d.converted for d in found.parameters)
    assert {d.unit for d in found.parameters} >= {"count", "count/(m/s^2)"}


def test_frames_that_cannot_be_turned_are_left_out():
    """Full accelerometers without a scale are no whole triad."""
    own, mounted = turned()
    full = whole(mounted, full=True)
    keep = [i for i, p in enumerate(full.parameters) if p.name != "accel.scale_error.z"]
    parameters = [full.parameters[i] for i in keep]
    part = made(
        [p.name for p in parameters],
        [p.unit for p in parameters],
        [p.value for p in parameters],
        full.matrix[np.ix_(keep, keep)],
    )
    left = {x.name: x.reason for x in compare(part, whole(own, full=False)).left_out}
    for name in ("accel.misalignment.yx", "gyro.misalignment.xy"):
        assert left[name] == "in the frame of the mounting faces and in the accelerometers' own"
    assert left["accel.scale_error.z"] == "not in the first calibration"


def test_gyros_in_their_own_frame_are_not_compared_with_others():
    triads = [Triad("gyro", full=full) for full in (False, True)]
    both = [made(t.names, t.units, np.full(len(t.names), 1e-3), np.eye(len(t.names)) * 1e-12) for t in triads]
    left = {x.name: x.reason for x in compare(*both).left_out}
    assert left["gyro.misalignment.yx"] == "in the gyros' own frame and in another one"


def test_a_rig_does_not_count_altogether():
    names, units = ["accel.bias.x", "rig.tilt.x"], ["m/s^2", "rad"]
    before, after = (made(names, units, [1.0, x], np.diag([1e-10, 1e-12])) for x in (0.0, 1.0))
    found = compare(before, after)
    assert [d.of_the_unit for d in found.parameters] == [True, False]
    assert found.together is not None
    assert found.together.chi2 == 0
    assert "of the rig" in found.summary()


def source(role, sha):
    return Source(file="x", role=role, sha256=sha)


@pytest.mark.parametrize(
    ("one", "other", "words"),
    [
        ({"unit": UnitName(model="LG-1", serial="7")}, {}, "of different units: LG-1 7 and LG-1 0001"),
        ({"unit": UnitName()}, {}, "of one unit is not known"),
        ({"method": "table"}, {}, "different methods (table, norm)"),
        ({"site": Site(gravity=9.80)}, {}, "different sites, or with another gravity (9.800000 and 9.810000 m/s^2)"),
        ({"rig": {"kind": "turntable"}}, {"rig": {"kind": "turntable"}}, "on a rig described in the same words"),
        ({"source": (source("prior", "a"),)}, {"source": (source("prior", "a"),)}, "rest on the same prior"),
        ({"source": (source("recording", "a"),)}, {"source": (source("recording", "a"),)}, "from the same recording"),
    ],
)  # fmt: skip
def test_what_makes_a_comparison_doubtful_is_named(one, other, words):
    found = compare(biases([1.0], **one), biases([1.0], **other))
    assert any(words in r for r in found.remarks)
    assert words in found.summary()
    assert not compare(biases([1.0]), biases([1.0])).remarks


def test_it_reads_back_from_json():
    found = compare(biases([1.0, 2.0]), biases([1.1, 2.0]), names=("old", "new"))
    assert results.loads(Comparison, SCHEMA, "a comparison", found.to_json(), "x") == found
    assert json.loads(found.to_json())["before"]["source"] == "old"


def scaled(values, dof, **other):
    fit = Fit(chi2=1.0, degrees_of_freedom=dof, residual_rms=1.0, converged=True, iterations=1, uncertainty="scaled")
    return biases(values, fit=fit, **other)


def test_uncertainties_of_few_degrees_of_freedom_give_probabilities_of_student_and_fisher():
    found = compare(scaled([1.0, 2.0], 2), scaled([1.00003, 2.0], 2))
    row = found.parameters[0]
    assert row.normalised == pytest.approx(3 / np.sqrt(2), rel=1e-6)
    assert row.degrees_of_freedom == pytest.approx(4.0)  # Welch and Satterthwaite, of equal variances: both together
    assert row.p_value == pytest.approx(
        2 * student.sf(3 / np.sqrt(2), 4), rel=1e-6
    )  # 0.10, where a normal one has 0.034
    both = found.together
    assert both is not None
    assert both.uncertainty_degrees_of_freedom == pytest.approx(4.0)
    assert both.p_value == pytest.approx(fisher.sf(4.5 / 2, 2, 4), rel=1e-5)
    assert "estimated with 4 degrees of freedom" in found.summary()
    known = compare(scaled([1.0, 2.0], 2, covariance=np.diag([1e-10, 9e-10])), biases([1.0, 2.0])).parameters
    assert [d.degrees_of_freedom for d in known] == pytest.approx(
        [2 * 4, 2 * (10 / 9) ** 2]
    )  # only one side is estimated


@pytest.mark.statistical
def test_one_scale_estimated_on_each_side_keeps_the_level():
    # 3 parameters, each side with a scale from 5 degrees of freedom: 5 % are below 0.05; by chi-square it would be 20 %
    p_values = []
    for _ in range(400):
        sides = []
        for _ in range(2):
            size = 1e-10 * RNG.chisquare(5) / 5
            sides.append(scaled(1e-5 * RNG.standard_normal(3), 5, covariance=size * np.eye(3)))
        found = compare(*sides).together
        assert found is not None
        p_values.append(found.p_value)
    assert np.mean(np.array(p_values) < 0.05) == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / 400))


@pytest.mark.statistical
def test_altogether_has_the_distribution_of_chi_square():
    one, other = correlated(), correlated()
    factors = np.linalg.cholesky(one), np.linalg.cholesky(other)
    p_values = []
    for _ in range(400):
        x, y = (f @ RNG.standard_normal(3) for f in factors)
        found = compare(biases(x, one), biases(y, other)).together
        assert found is not None
        p_values.append(found.p_value)
    # uniform: mean 1/2 with 1/sqrt(12 * 400)
    assert np.mean(p_values) == pytest.approx(0.5, abs=4 / np.sqrt(4800))
    assert np.mean(np.array(p_values) < 0.05) == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / 400))
