"""Rows reduced beforehand: what is left over counts in the cost, and not in the chi-square."""

import numpy as np
import pytest

from sagnac.estimate import Parameter, Rows, estimate

SEGMENTS = [str(i) for i in range(6)]
T = np.linspace(0, 4, 600)
OBSERVED = 2.0 * np.exp(-0.7 * T) + 1e-3 * np.random.default_rng(4).standard_normal(600)
PARAMETERS = [Parameter("a", "1", 1.0, 1.0), Parameter("k", "1", 0.2, 1.0)]


def whole(x):
    e = np.exp(-x[1] * T)
    return Rows((OBSERVED - x[0] * e) / 1e-3, np.column_stack([-e, x[0] * T * e]) / 1e-3, np.arange(600) // 100)


def reduced(x):
    """Two rows a segment and what is left."""
    rows = whole(x)
    r, jac, rest = [], [], []
    for k in range(6):
        here = rows.segment == k
        factor = np.linalg.qr(np.column_stack([rows.jacobian[here], rows.residual[here]]), mode="r")
        r.append(factor[:2, 2])
        jac.append(factor[:2, :2])
        rest.append(factor[2, 2] ** 2)
    return Rows(np.concatenate(r), np.vstack(jac), np.repeat(np.arange(6), 2), np.array(rest))


def test_reduced_rows_give_the_same_estimate():
    full, few = estimate(PARAMETERS, whole, SEGMENTS), estimate(PARAMETERS, reduced, SEGMENTS)
    np.testing.assert_allclose(few.value, full.value, rtol=1e-9)
    np.testing.assert_allclose(few.white, full.white, rtol=1e-9)
    assert few.degrees_of_freedom == 10
    left = reduced(few.value).left
    assert few.chi2 + left == pytest.approx(full.chi2, rel=1e-9)


def test_what_is_left_over_changes_with_the_parameters():
    """Far from the solution rows bend away from what the parameters move there: reduced rows alone are not the cost."""
    start = np.array([p.start for p in PARAMETERS])
    assert reduced(start).left > 10 * reduced(np.array([2.0, 0.7])).left
    assert whole(start).left == 0.0


def test_a_segment_turned_down_takes_its_rest_along():
    def model(x):
        rows = reduced(x)
        r = rows.residual.copy()
        r[rows.segment == 3] += 60.0
        return Rows(r, rows.jacobian, rows.segment, rows.rest)

    fit = estimate(PARAMETERS, model, SEGMENTS, robust=True)
    assert fit.weights[3] < 0.1
    assert np.abs(fit.value - [2.0, 0.7]).max() < 5e-3


def test_a_coarser_tolerance_takes_fewer_passes():
    fine, coarse = (estimate(PARAMETERS, reduced, SEGMENTS, tolerance=t) for t in (1e-9, 1e-4))
    assert coarse.iterations < fine.iterations
    np.testing.assert_allclose(coarse.value, fine.value, atol=1e-3 * fine.sigma.min())
