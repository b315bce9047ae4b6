"""Instrument models: derivatives, inverse, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.errors import DataError
from sagnac.sensors import TERMS, Axis, Correction, Triad, correction, forward, invert, signed_permutation, triad_of

TRIADS = [
    Triad(kind, counts, full, g_sensitivity, ratio)
    for kind in ("accel", "gyro")
    for counts, ratio in ((False, False), (True, False), (False, True))
    for full in (False, True)
    for g_sensitivity in ((False, True) if kind == "gyro" else (False,))
]
ids = [f"{t.kind}{'-counts' * t.counts}{'-full' * t.full}{'-g' * t.g_sensitivity}{'-ratio' * t.ratio}" for t in TRIADS]
small = st.floats(-0.02, 0.02)
HIGHER = {
    "accel": {"k2": 2e-5, "k3": 3e-7, "kip": 1e-5, "kio": -2e-5, "kpo": 4e-5},
    "gyro": dict(
        zip(["d_i", "d_o", "d_s", "d_ii", "d_oo", "d_ss", "d_io", "d_is", "d_os"], np.arange(1, 10) * 1e-4, strict=True)
    ),
}


def parameters(triad: Triad, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    matrix = np.eye(3) + 0.02 * rng.normal(size=(3, 3))
    if not triad.full:
        matrix = np.tril(matrix)
    gain = 5000.0 if triad.counts else 1.0
    g_matrix = 1e-4 * rng.normal(size=(3, 3)) * gain if triad.g_sensitivity else None
    return triad.pack(gain * matrix, gain * 0.1 * rng.normal(size=3), g_matrix)


@pytest.mark.parametrize("triad", TRIADS, ids=ids)
def test_names_units_and_parameters_have_one_length(triad):
    k = 3 + (6 if triad.full else 3) + 3 + 9 * triad.g_sensitivity
    assert len(triad.names) == len(set(triad.names)) == len(triad.units) == k
    x = parameters(triad, 0)
    assert x.shape == triad.scales(triad.unpack(x)[0], 9.8).shape == (k,)
    assert all(name.startswith(triad.kind + ".") for name in triad.names)


@pytest.mark.parametrize("triad", TRIADS, ids=ids)
def test_pack_undoes_unpack(triad):
    x = parameters(triad, 1)
    np.testing.assert_allclose(triad.pack(*triad.unpack(x)), x, rtol=1e-14, atol=1e-16)


@pytest.mark.parametrize("triad", TRIADS, ids=ids)
def test_derivatives_are_those_of_unpack(triad):
    # unpack is a product of at most two parameters: central differences are exact but for rounding, 1e-16 / step
    x = parameters(triad, 2)
    exact = triad.derivatives(x)
    size = np.maximum(np.abs(x), 1e-3)
    for k in range(x.size):
        step = np.zeros(x.size)
        step[k] = 0.1 * size[k]
        above, below = triad.unpack(x + step), triad.unpack(x - step)
        for whole, up, down in zip(exact, above, below, strict=True):
            rounding = 1e-15 * np.abs(up).max() / step[k] + 1e-15
            np.testing.assert_allclose(whole[k], (up - down) / (2 * step[k]), rtol=1e-12, atol=rounding)


@pytest.mark.parametrize("triad", TRIADS, ids=ids)
def test_a_triad_is_recognised_by_its_names(triad):
    assert triad_of([*triad.names, "rig.mount.x"], triad.kind, ratio=triad.ratio) == triad
    assert triad_of(triad.names[1:], triad.kind) is None


@pytest.mark.parametrize("triad", TRIADS, ids=ids)
def test_the_correction_is_the_triad(triad):
    x = parameters(triad, 3)
    model = correction(dict(zip(triad.names, x.tolist(), strict=True)), triad.kind, ratio=triad.ratio)
    matrix, bias, g_matrix = triad.unpack(x)
    np.testing.assert_allclose(model.matrix, matrix, rtol=1e-15)
    np.testing.assert_array_equal(model.bias, bias)
    np.testing.assert_array_equal(model.g_matrix, g_matrix)
    assert model.counts is triad.counts


def matrices(values):
    return np.eye(3) + np.array(values).reshape(3, 3)


@given(
    st.lists(small, min_size=9, max_size=9),
    st.lists(small, min_size=3, max_size=3),
    st.lists(st.floats(-1e-3, 1e-3), min_size=3, max_size=3),
    st.lists(st.floats(-20, 20), min_size=3, max_size=30).filter(lambda v: len(v) % 3 == 0),
    st.sampled_from([None, 1.0, 16384.0, 1e6]),
)
def test_invert_undoes_forward(scale, bias, k2, u, gain):
    # k2 a is at most 2 %: the quadratic term is strong, and its inverse still unique
    g = gain or 1.0
    model = Correction(
        "accel", g * matrices(scale), g * np.array(bias), terms={"k2": np.array(k2)}, counts=gain is not None
    )
    u = np.array(u).reshape(-1, 3)
    back = invert(model, forward(model, u))
    # condition of these matrices is below 1.3; readings of up to 21 carry 2e-15 of rounding, once in, once out
    np.testing.assert_allclose(back, u, rtol=0, atol=5e-14)


@given(st.integers(0, 10_000))
def test_g_sensitive_gyros_are_inverted_with_the_specific_force(seed):
    rng = np.random.default_rng(seed)
    model = Correction("gyro", matrices(0.02 * rng.normal(size=9)), rng.normal(size=3), 1e-2 * rng.normal(size=(3, 3)))
    u, f = rng.normal(size=(2, 7, 3)) * 10
    np.testing.assert_allclose(invert(model, forward(model, u, f), f), u, rtol=0, atol=1e-13)
    with pytest.raises(DataError, match="the gyros are g-sensitive"):
        invert(model, u)


@pytest.mark.parametrize(
    "scale_error",
    [
        0.0,
        0.01,
    ],
)
def test_forward_is_the_published_equation(scale_error):
    # IEEE 1293 without cross terms: K0 + (1 + K1) a + K2 a^2, on one axis by hand
    model = correction({"accel.bias.x": 0.1, "accel.scale_error.x": scale_error, "accel.k2.x": 1e-3}, "accel")
    a = 10.0
    expected = 0.1 + (1 + scale_error) * a + 1e-3 * a**2
    assert forward(model, np.array([[a, 0, 0]]))[0, 0] == pytest.approx(expected, rel=1e-15)


def test_counts_and_si_are_the_same_instrument():
    rng = np.random.default_rng(4)
    si, gain, u = parameters(Triad("accel", full=True), 5), 16384.0, 10 * rng.normal(size=(6, 3))
    si[1] = 0.0  # no scale error on the axis with the quadratic term
    matrix, bias, _ = Triad("accel", full=True).unpack(si)
    counts = Triad("accel", counts=True, full=True)
    x = counts.pack(gain * matrix, gain * bias)
    values = [dict(zip(t.names, v.tolist(), strict=True)) for t, v in ((Triad("accel", full=True), si), (counts, x))]
    for v in values:
        v["accel.k2.y"] = 1e-3
    in_si, in_counts = (correction(v, "accel") for v in values)
    np.testing.assert_allclose(forward(in_counts, u), gain * forward(in_si, u), rtol=1e-13)
    # misalignments S_ij / S_ii are those of the SI matrix over its own diagonal
    assert values[1]["accel.misalignment.xy"] == pytest.approx(matrix[0, 1] / matrix[0, 0], rel=1e-14)


def test_a_quadratic_term_without_solution_is_refused():
    model = correction({"accel.k2.x": 1.0}, "accel")
    # a + a^2 is never below -1/4; at 1.8 there is an input, but other ones nearby explain the reading as well
    with (
        np.errstate(over="ignore", invalid="ignore"),
        pytest.raises(DataError, match="higher accelerometer terms are too large"),
    ):
        invert(model, np.array([[-1.0, 0, 0]]))
    with pytest.raises(DataError, match="higher accelerometer terms are too large"):
        invert(model, np.array([[1.8, 0, 0]]))


@pytest.mark.parametrize(
    "name",
    [
        "accel.d_i.x",
        "accel.k4.x",
        "accel.k2.xy",
        "accel.bias",
        "accel.bias.xy",
        "accel.misalignment.x",
        "accel.g_sensitivity.xx",
        "accel.colour.x",
        "accel.bias.x.y",
        "accel.",
    ],
)
def test_unknown_parameters_are_refused(name):
    with pytest.raises(DataError, match=f"no term for the parameter '{name}'"):
        correction({"accel.bias.x": 0.0, name: 0.1}, "accel")


@pytest.mark.parametrize("name", ["accel.bias.w", "accel.misalignment.xw", "accel.misalignment.xx"])
def test_unknown_axes_are_refused(name):
    with pytest.raises(DataError, match=f"no term for the parameter '{name}'"):
        correction({"accel.bias.x": 0.0, name: 0.1}, "accel")


@pytest.mark.parametrize("kind", ["accel", "gyro"])
@pytest.mark.parametrize("gain", [1.0, 16384.0])
@given(st.integers(0, 10_000))
def test_the_full_model_is_inverted(kind, gain, seed):
    # accelerations of 15 g: the terms above add up to 7 % of the reading
    rng = np.random.default_rng(seed)
    u, f = 50 * rng.normal(size=(2, 9, 3))
    terms = {name: size * rng.uniform(-1, 1, 3) for name, size in HIGHER[kind].items()}
    counts = gain != 1.0
    model = Correction(
        kind, gain * matrices(0.01 * rng.normal(size=9)), gain * rng.normal(size=3), terms=terms, counts=counts
    )
    back = invert(model, forward(model, u, f), f)
    np.testing.assert_allclose(back, u, rtol=0, atol=2e-12)


@pytest.mark.parametrize("sensor", ["accel.x", "accel.y", "accel.z", "gyro.x", "gyro.y", "gyro.z"])
def test_the_triad_says_what_its_single_sensors_say(sensor):
    kind, axis = sensor.split(".")
    rng = np.random.default_rng(8)
    f, w = 30 * rng.normal(size=(2, 5, 3))
    pairs = {"accel.x": (), "accel.y": ("yx",), "accel.z": ("zx", "zy"), "gyro.x": ("xy", "xz"), "gyro.y": ("yx", "yz")}
    single = Axis(kind, axis, tuple({*TERMS[kind], "scale_error"}), pairs.get(sensor, ("zx", "zy")))
    x = 1e-3 * rng.normal(size=len(single.names))
    values = dict(zip(single.names, x.tolist(), strict=True)) | {
        f"{kind}.scale_error.{a}": 0.0 for a in "xyz" if a != axis
    }
    model = correction(values, kind, ratio=True)
    both = forward(model, f if kind == "accel" else w, f)
    np.testing.assert_allclose(both[:, "xyz".index(axis)], single.evaluate(x, f, w).value, rtol=1e-13)


def test_no_parameters_no_correction():
    assert correction({"gyro.bias.x": 0.1, "rig.mount.x": 0.2}, "accel") is None


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 0, 2)])
@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1)])
def test_signed_permutation(order, signs):
    rng = np.random.default_rng(6)
    matrix = 0.3 * rng.uniform(-1, 1, (3, 3))
    for i in range(3):
        matrix[i, order[i]] = signs[i]
    assert signed_permutation(matrix * [[1], [1e4], [1e-4]]) == (order, signs)
