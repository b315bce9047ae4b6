"""Plans for a roll-isolated rig."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.calibrate import roll_isolated
from sagnac.design import check
from sagnac.errors import InputError
from sagnac.plan import Unit
from sagnac.simulate.roll_isolated import DENSITY, PUBLISHED, published_plan, recording_of, simulate


def test_prediction_and_result_agree():
    plan = published_plan()
    found = check(plan)
    assert found.method == "roll-isolated"
    assert any("predicted for a cone of 0.16 deg" in r for r in found.remarks)
    made = simulate(plan, PUBLISHED, np.random.default_rng(7), density=plan.unit.noise.gyro or DENSITY)
    result = roll_isolated.calibrate_recording(recording_of(made), plan)
    for p in found.parameters:
        # noise and quantisation are drawn anew: their size is known to a few percent
        assert p.standard_uncertainty == pytest.approx(result[p.name].standard_uncertainty, rel=0.1), p.name


def test_one_sense_of_rotation_is_not_enough():
    plan = published_plan()
    one = tuple(s for s in plan.segment if s.inner_rate >= 0)
    assert check(plan.model_copy(update={"segment": one})).unseen


def test_noise_must_be_stated():
    with pytest.raises(InputError, match="noise of the gyro triad"):
        check(published_plan().model_copy(update={"unit": Unit()}))
