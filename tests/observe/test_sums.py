"""Running sums of a segment against all its samples at once."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.observe.sums import Sums
from sagnac.plan import Segment


@pytest.mark.parametrize("pieces", [1, 3, 50])
def test_what_is_kept_of_the_samples_is_that_of_all_at_once(pieces):
    rng = np.random.default_rng(4)
    time = np.arange(1, 1001) / 100.0
    values = np.round(rng.normal(0.0, 2.0, (1000, 4)), 1)  # with neighbours that are equal
    values[:, 1] = 3.0  # an axis that is dead
    values[500:, 2] = values[:, 2].max()  # one that saturates
    part = Sums(Segment(name="a", start=0.0, stop=10.0), 4)
    for some in np.array_split(np.arange(1000), pieces):
        part.add(time[some], values[some], 0.01)
    steps = np.abs(np.diff(values, axis=0))
    assert np.array_equal(part.low, values.min(axis=0))
    assert np.array_equal(part.high, values.max(axis=0))
    assert np.array_equal(part.at_low, (values == part.low).sum(axis=0))
    assert np.array_equal(part.at_high, (values == part.high).sum(axis=0))
    assert part.at_high[2] >= 500
    assert np.array_equal(part.finest, np.where(steps > 0, steps, np.inf).min(axis=0))
    assert part.finest[1] == np.inf
    assert part.squared_steps == pytest.approx((steps**2).sum(axis=0), rel=1e-12)
    assert part.mean == pytest.approx(values.mean(axis=0), abs=1e-12)
