"""The demo end to end: the published case, its files, its pictures."""

import json

import numpy as np
import pytest

from sagnac import load_calibration, load_plan, open_recording
from sagnac.demo import PUBLISHED_NORM, published_norm, run


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    said = []
    return run(tmp_path_factory.mktemp("demo"), seed=1, say=said.append), said


def test_every_parameter_is_right(demo):
    """Within 3.5 standard uncertainties of the truth, both methods (45 values: one beyond by chance in 50 demos)."""
    result, _ = demo
    for calibration in (result.norm, result.multi_position):
        for name, value in result.truth.items():
            p = calibration[name]
            assert abs(p.value - value) < 3.5 * p.standard_uncertainty, name


def test_every_error_is_at_most_the_published_one(demo):
    """All 21 published parameters, to the published digits; five minutes of the published noise a position."""
    result, said = demo
    for name in PUBLISHED_NORM:
        value, half_digit = published_norm(name)
        assert abs(result.norm[name].value - result.truth[name]) <= abs(value - result.truth[name]) + half_digit, name
    assert any("21 of 21 parameters" in line for line in said)


def test_verification_on_a_fresh_recording_passes(demo):
    result, said = demo
    assert result.verification.passed
    assert any("PASS" in line for line in said)


def test_files_can_be_used_again(demo):
    result, _ = demo
    folder = result.folder
    plan = load_plan(folder / "plan.toml")
    assert len(plan.segment) == 24
    assert load_calibration(folder / "norm.json") == result.norm
    assert json.loads((folder / "truth.json").read_text()) == result.truth
    recording = open_recording(folder / "recording.parquet", scale=plan.unit.scale)
    assert recording.increments == {"accel", "gyro"}
    first = next(recording.batches())
    assert np.all(np.diff(first.time) > 0)


@pytest.mark.parametrize("name", ["demo.png", "angle-errors.png"])
def test_pictures_are_pictures(demo, name):
    """PNG signature and a size in pixels that a page can use."""
    data = (demo[0].folder / name).read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = (int.from_bytes(data[k : k + 4], "big") for k in (16, 20))
    assert width > 800
    assert height > 400


def test_same_seed_same_result(demo, tmp_path):
    again = run(tmp_path, seed=1, say=lambda _: None)
    assert [p.value for p in again.norm.parameters] == [p.value for p in demo[0].norm.parameters]
    assert (tmp_path / "recording.parquet").stat().st_size == (demo[0].folder / "recording.parquet").stat().st_size
