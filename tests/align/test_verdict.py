"""After the filter: innovations that are not as they should be, estimates that the prior does not allow, what was not seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from voyages import DEG, config, voyage

from sagnac.align import run
from sagnac.align.checks import verdict
from sagnac.align.transfer import examine
from sagnac.errors import DataError
from sagnac.frames import rotation_matrix

SETTINGS = config()


def changed(y, **changes):
    return replace(y, **{name: change(getattr(y, name)) for name, change in changes.items()})


def judged(y, settings=SETTINGS):
    found = run.transfer(settings, y.slave, y.master)
    record, said = verdict.judge(found, settings)
    return record, said + verdict.beyond_prior(found, settings), found


def test_innovations_of_a_true_model():
    record, said, _ = judged(voyage("s-turn"))
    assert said == []
    assert record.updates == 1200
    assert record.expected == 2
    assert record.band[0] < record.mean < record.band[1]
    # the mean of 2400 squares of unit normals: its band is 2 -+ 3.29 sqrt(2 * 2 / 1200)
    assert record.band == pytest.approx((2 - 0.19, 2 + 0.19), abs=0.01)
    assert set(record.ratio) == {"velocity.x", "velocity.y"}
    assert all(r == pytest.approx(1, abs=0.07) for r in record.ratio.values())


@pytest.mark.parametrize(("noise", "word", "fits"), [(0.015, "larger", "0.015"), (0.003, "smaller", "0.003")])
def test_noise_that_is_a_little_off_is_spoken_of(noise, word, fits):
    _, said, _ = judged(voyage("s-turn", velocity_noise=noise))
    assert f"the innovations are {word} than stated" in said[0]
    assert f'noise.velocity = "{fits} m/s" would fit better' in said[0]


def test_innovations_far_too_large_are_refused():
    y = voyage("s-turn", velocity_noise=0.05)
    with pytest.raises(DataError, match=r"innovations are 5 times as large .* noise.velocity = \"0.05 m/s\" would fit"):
        judged(y, config(gate="off"))


def test_a_model_that_lacks_something_is_told_from_noise():
    y = voyage("swaying", lever=(0.5, 2.0, 1.0))
    with pytest.raises(DataError, match=r"They follow one another \(correlation .* a lever arm"):
        judged(y, config(gate="off"))


def test_a_mounting_that_moves():
    y = voyage("s-turn")
    C = rotation_matrix(np.array([0.3 * DEG, 0, 0]))
    late = y.time > 60
    y = changed(
        y,
        gyro=lambda v: np.where(late[:, None], v @ C, v),
        accel=lambda v: np.where(late[:, None], v @ C, v),
    )
    with pytest.raises(DataError, match=r"none of them from 61.* s on\): the master or the slave jumped at that time"):
        judged(y)


def test_initial_uncertainties_that_are_too_small():
    y = voyage("s-turn", mounting=(1.0, 1.0, 1.0))
    with pytest.raises(
        DataError, match=r"the two part at once: the uncertainties in \[initial\] or \[noise\] are too small"
    ):
        judged(
            y, config(initial__misalignment="0.5 arcmin", initial__accel_bias="1 ug", initial__gyro_bias="0.001 deg/h")
        )


def test_estimates_that_the_prior_does_not_allow():
    with pytest.raises(DataError, match=r"accel.bias.x came out as .* times what initial.accel_bias lets expect"):
        judged(voyage("s-turn", accel_bias=(1000.0, -500.0, 300.0)))
    _, said, _ = judged(voyage("s-turn", mounting=(0.0, 0.0, 2.2)))
    assert "misalignment.z came out as" in said[0]
    assert "times what initial.misalignment lets expect" in said[0]


def test_what_is_not_observed_is_named():
    _, _, found = judged(voyage("straight"))
    parameters = [n for n in found.names if not n.endswith("_error.x")]
    unseen = {n.name: n for n in verdict.not_observed(found, parameters)}
    assert {"accel.bias.x", "accel.bias.y", "gyro.bias.z"} <= set(unseen)
    assert not {"misalignment.x", "misalignment.y", "misalignment.z"} & set(unseen)
    assert "a level error and an accelerometer bias do the same" in unseen["accel.bias.x"].reason
    assert unseen["accel.bias.x"].shown_by == "a turn of 90 deg or more would show it"
    assert 0.9 < unseen["accel.bias.x"].remains <= 1.0
    _, _, turning = judged(voyage("s-turn"))
    assert "accel.bias.x" not in {n.name for n in verdict.not_observed(turning, parameters)}
    for words in verdict.not_separated(found, parameters, list(unseen.values())):
        members = set(words.split()) & set(parameters)
        assert len(members) > 1
        assert not members <= set(unseen)


def test_a_small_jump_shuts_the_gate_for_good():
    y = voyage("s-turn")
    y = changed(y, velocity=lambda v: np.where((y.stamps >= 60)[:, None], v + [0.09, 0, 0], v))
    examine(y.slave, y.master, SETTINGS)
    with pytest.raises(DataError, match=r"none of them from 60 s on\): the master or the slave jumped at that time"):
        verdict.judge(run.transfer(SETTINGS, y.slave, y.master), SETTINGS)
