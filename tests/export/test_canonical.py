"""The one correction: equal to the instrument read backwards, with a covariance that is its own."""

import numpy as np
import pytest
from export_units import calibration, names, samples, units
from hypothesis import given, settings
from hypothesis import strategies as st

from sagnac.errors import DataError, InputError
from sagnac.export.canonical import _inverse, _slopes, best_diagonal, canonical
from sagnac.export.factors import angle, lower_times_rotation, rotation_times_lower, rotation_times_upper
from sagnac.sensors import correction, invert


def corrected(found, readings):
    out = {}
    for kind, triad in found.triads.items():
        raw = readings[kind] - triad.bias
        if kind == "gyro":
            raw = raw - out["accel"] @ triad.g_matrix.T
        out[kind] = raw @ triad.matrix.T
    return out


@given(units(counts=None, higher=False, negative=True))
def test_is_the_inverse_of_the_instrument(unit):
    values, meaning = unit
    cal = calibration(values, misalignment=meaning)
    force, rate, readings = samples(cal, 20)
    found = corrected(canonical(cal), readings)
    for kind, truth in (("accel", force), ("gyro", rate)):
        model = correction(values, kind, ratio=meaning == "input-axis")
        ours = invert(model, readings[kind], found.get("accel"))
        scale = np.abs(np.linalg.inv(model.matrix)) @ np.abs(readings[kind]).max(axis=0)
        assert np.allclose(found[kind], ours, rtol=0, atol=1e-12 * scale.max())
        assert np.allclose(found[kind], truth, rtol=0, atol=1e-12 * scale.max())


@given(units(counts=None, higher=True))
@settings(max_examples=25)
def test_slopes_are_those_of_differences(unit):
    """Complex step against central differences, the entries of one triad to every parameter."""
    values, meaning = unit
    for kind in ("accel", "gyro"):
        rule = (kind, f"{kind}.scale_factor.x" in values, meaning == "input-axis")

        def entries(moved, rule=rule):
            return np.concatenate([np.ravel(part) for part in _inverse(moved, *rule)])[
                : 12 if rule[0] == "accel" else 21
            ]

        slopes = _slopes(values, *rule)
        for k, (name, value) in enumerate(values.items()):
            step = 1e-5 * max(1.0, abs(value))
            J = (entries({**values, name: value + step}) - entries({**values, name: value - step})) / (2 * step)
            assert np.allclose(slopes[:, k], J, rtol=1e-6, atol=1e-6 * np.abs(J).max())


@given(units(counts=None), st.integers(0, 100))
@settings(max_examples=10)
def test_covariance_of_what_is_computed_from_the_entries(unit, seed):
    """J C J' for the entries; for themselves and for a product with them, the same by small steps along its principal axes."""
    values, meaning = unit
    n = len(values)
    root = np.random.default_rng(seed).normal(size=(n, n)) * 1e-6
    cal = calibration(values, covariance=root @ root.T, misalignment=meaning)
    found = canonical(cal)
    J = np.vstack([_slopes(values, k, t.counts, meaning == "input-axis") for k, t in found.triads.items()])
    assert np.allclose(found.covariance, J @ (root @ root.T) @ J.T, rtol=1e-9, atol=0)
    sigma = np.sqrt(np.diag(found.covariance))
    assert np.allclose(
        found.uncertainty(lambda triads: np.concatenate([t.entries for t in triads.values()])), sigma, rtol=1e-4, atol=0
    )
    offset = J[:9].reshape(3, 3, -1), J[9:12]
    accel = found.triads["accel"]
    slope = np.einsum("ijk,j->ik", offset[0], accel.bias) + accel.matrix @ offset[1]
    expected = np.sqrt(np.diag(slope @ (root @ root.T) @ slope.T))
    assert np.allclose(found.uncertainty(lambda t: t["accel"].matrix @ t["accel"].bias), expected, rtol=1e-4, atol=0)


def test_names_and_units_follow_the_entries():
    values = dict.fromkeys(names("gyro", full=True, counts=False, g=True), 1e-3)
    found = canonical(calibration(values))
    at = dict(zip(found.names, found.entries, strict=True))
    assert len(found.names) == len(found.units) == found.entries.size == 21
    assert at["gyro.bias.z"] == 1e-3
    assert found.units[found.names.index("gyro.g_sensitivity.xy")] == "rad*s/m"
    assert at["gyro.matrix.xy"] == pytest.approx(found.triads["gyro"].matrix[0, 1], rel=0, abs=0)


def test_linear_terms_of_the_centrifuge_are_g_sensitivity():
    """d_i along the input axis, d_o and d_s along the axes of [XU18]: gyro x has O = -z and S = y."""
    values = {f"gyro.bias.{a}": 0.0 for a in "xyz"} | {
        f"gyro.{t}.{a}": v for t, v in (("d_i", 1e-4), ("d_o", 2e-4), ("d_s", 3e-4)) for a in "xyz"
    }
    triad = canonical(calibration(values)).triads["gyro"]
    assert np.allclose(triad.g_matrix[0], [1e-4, 3e-4, -2e-4], rtol=0, atol=1e-18)
    assert not triad.higher


def test_a_smaller_gain_is_best_where_axes_are_crossed():
    """Over all directions the rms of (s S_i - e_i) u is least: compared with its neighbours by quadrature."""
    S = np.array([[1.02, 0.03, -0.01], [0.02, 0.97, 0.0], [0.0, -0.03, 1.0]])
    best = best_diagonal(S)
    for i in range(3):
        around = [np.sum((s * S[i] - np.eye(3)[i]) ** 2) for s in best[i] + np.array([-1e-4, 0.0, 1e-4])]
        assert around[1] < min(around[0], around[2])


@given(st.lists(st.floats(-0.4, 0.4), min_size=9, max_size=9))
def test_factors(numbers):
    M = np.eye(3) + np.reshape(numbers, (3, 3))
    if np.linalg.det(M) < 0.05:
        return
    Q, L = rotation_times_lower(M)
    R, U = rotation_times_upper(M)
    lower, turn = lower_times_rotation(M)
    for rotation in (Q, R, turn):
        assert np.allclose(rotation @ rotation.T, np.eye(3), rtol=0, atol=1e-13)
        assert np.linalg.det(rotation) > 0
    for product in (Q @ L, R @ U, lower @ turn):
        assert np.allclose(product, M, rtol=0, atol=1e-13)
    assert not np.triu(L, 1).any()
    assert not np.tril(U, -1).any()
    assert not np.triu(lower, 1).any()
    for factor in (L, U, lower):
        assert np.all(np.diag(factor) > 0)


@pytest.mark.parametrize("split", [rotation_times_lower, rotation_times_upper, lower_times_rotation])
def test_left_handed_axes_have_no_rotation(split):
    for axes in (np.eye(3)[::-1], np.diag([1.0, 1.0, -1.0]), np.diag([-1.0, -1.0, -1.0])):
        with pytest.raises(InputError, match="left-handed"):
            split(axes)
    turned = np.diag([-1.0, -1.0, 1.0])  # half a turn about z
    assert np.array_equal(sum(np.abs(part) for part in split(turned)), 2 * np.eye(3))


def test_angle_of_a_small_rotation():
    a = 1e-7
    assert angle(np.array([[1, -a, 0], [a, 1, 0], [0, 0, 1.0]])) == pytest.approx(a, rel=1e-9)
    assert angle(np.eye(3)) == 0.0


def test_noise_is_that_of_the_corrected_axes():
    values = {f"accel.scale_factor.{a}": s for a, s in zip("xyz", (1000.0, 2000.0, 4000.0), strict=True)}
    noise = {"accel": {"density": [2.0, 2.0, 2.0], "unit": "count/sqrt(Hz)", "origin": "recording"}}
    triad = canonical(calibration(values, noise=noise)).triads["accel"]
    assert np.allclose(triad.noise, [2e-3, 1e-3, 5e-4], rtol=1e-14)


def test_what_is_not_known_is_said():
    cal = calibration({f"gyro.bias.{a}": 1e-3 for a in "xyz"})
    assert canonical(cal).remarks == ("the calibration says nothing of gyro scale, misalignment: taken as nominal",)
    lonely = calibration({f"gyro.bias.{a}": 0.0 for a in "xyz"} | {"gyro.g_sensitivity.xy": 1e-4})
    assert any("specific force" in remark for remark in canonical(lonely).remarks)


@pytest.mark.parametrize(
    ("values", "more", "words"),
    [
        ({"accel.bias.z": 0.1}, {}, "z only; "),
        ({"accel.k2.z": 0.1}, {}, "z only; "),
        ({f"rig.{p}": 0.1 for p in ("mount_yaw", "mount_pitch")}, {}, "nothing to export"),
        ({f"accel.scale_error.{a}": -1.0 for a in "xyz"}, {}, "cannot be inverted"),
        ({f"gyro.bias.{a}": 0.1 for a in "xyz"}, {"method": "roll-isolated"}, "encoder"),
    ],
)
def test_refuses_what_is_no_correction(values, more, words):
    cal = _rig_only(values) if "rig.mount_yaw" in values else calibration(values, **more)
    with pytest.raises(DataError, match=words):
        canonical(cal)


def _rig_only(values):
    cal = calibration({f"gyro.bias.{a}": 0.0 for a in "xyz"})
    first = cal.parameters[0].model_copy(update={"name": next(iter(values)), "unit": "rad"})
    return cal.model_copy(update={"parameters": (first,), "covariance": ((0.0,),)})


def test_refuses_other_units():
    cal = calibration({f"accel.bias.{a}": 0.1 for a in "xyz"})
    odd = cal.model_copy(update={"parameters": tuple(p.model_copy(update={"unit": "mg"}) for p in cal.parameters)})
    with pytest.raises(DataError, match="must be in 'm/s\\^2'"):
        canonical(odd)
