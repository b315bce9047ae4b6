"""The exact quadric start."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sagnac.calibrate import quadric
from sagnac.errors import DataError

M, N = np.sqrt(50 - 10 * np.sqrt(5)) / 10, np.sqrt(50 + 10 * np.sqrt(5)) / 10
ICOSAHEDRON = np.array(
    [p for s in (1, -1) for t in (1, -1) for p in ((s * M, 0, t * N), (0, s * N, t * M), (s * N, t * M, 0))]
)


def test_published_case_without_noise_is_exact():
    """[DONG18] drops second-order terms and is off by 5.9e-6 in scale; nothing is dropped here: 1e-15 (methods, section 2)."""
    s = np.array([[1.002, 0, 0], [1e-4, 1.008, 0], [1e-4, 1e-4, 1.006]])
    b = np.array([0.0008, -0.001, -0.0032])
    found = quadric.fit(ICOSAHEDRON @ s.T + b, np.ones(12), "accel")
    assert np.abs(found.matrix - s).max() < 3e-15
    assert np.abs(found.bias - b).max() < 3e-15


@given(
    st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3),
    st.lists(st.floats(0.5, 2.0), min_size=3, max_size=3),
    st.floats(-6, 6),
    st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3),
    st.integers(0, 1000),
)
def test_any_instrument_is_recovered(crossed, gains, exponent, offset, seed):
    """Gains over twelve decades, offsets of up to 1e6 gains: relative error 1e-16 times offset over signal."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((20, 3))
    u *= 9.81 / np.linalg.norm(u, axis=1)[:, None]
    s = np.diag(gains) + np.array([[0, 0, 0], [crossed[0], 0, 0], [crossed[1], crossed[2], 0]])
    s *= 10.0**exponent
    b = np.array(offset) * 10.0**exponent
    found = quadric.fit(u @ s.T + b, np.full(20, 9.81), "accel")
    limit = 1e-9 + 1e-13 * np.abs(offset).max()
    assert np.abs(found.matrix - s).max() < limit * np.abs(s).max() * 10
    assert np.abs(found.bias - b).max() < limit * np.abs(s).max() * 100


def test_different_norms():
    """Rates of both senses differ by twice the Earth rate: one unknown more, still exact."""
    norms = np.where(np.arange(12) % 2, 1.0, 1.0005)
    s, b = np.array([[1.1, 0, 0], [0.02, 0.9, 0], [-0.03, 0.01, 1.2]]), np.array([0.1, -0.2, 0.3])
    found = quadric.fit((ICOSAHEDRON * norms[:, None]) @ s.T + b, norms, "gyro")
    assert np.abs(found.matrix - s).max() < 1e-12
    assert np.abs(found.bias - b).max() < 1e-12


def test_readings_off_any_ellipsoid_are_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(DataError, match="do not lie on an ellipsoid"):
        quadric.fit(
            np.column_stack([rng.standard_normal((30, 2)) ** 3, np.sinh(rng.standard_normal(30) * 3)]),
            np.ones(30),
            "accel",
        )


def test_constant_readings_are_refused():
    with pytest.raises(DataError, match="the same in all 12 positions"):
        quadric.fit(np.ones((12, 3)), np.ones(12), "accel")


def test_distinct_directions():
    close = np.array([[1, 0, 0], [np.cos(0.02), np.sin(0.02), 0], [0, 1, 0], [-1, 0, 0]])
    assert quadric.distinct(close) == 3
