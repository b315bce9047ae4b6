"""What the tests of certificates and pictures share."""

from __future__ import annotations

import pytest
from certificates import SVG
from figures import hand_log

from sagnac.calibrate import calibrate
from sagnac.calibration import Calibration
from sagnac.plan import Plan
from sagnac.recording import Recording
from sagnac.report import pictures


@pytest.fixture
def undrawn(monkeypatch):
    """No pictures, where a test is about words: drawing takes a second."""
    monkeypatch.setattr(pictures, "svg", lambda _: SVG)
    for name in ("parameters", "correlation", "budget", "residuals", "influence", "log", "before_after", "as_found"):
        monkeypatch.setattr(pictures, name, lambda *_, **__: None)
    monkeypatch.setattr(pictures, "comparison", lambda *_, **__: None)


@pytest.fixture(scope="module")
def turned() -> tuple[Recording, Calibration]:
    """A unit turned by hand, and its calibration."""
    recording = hand_log()
    return recording, calibrate("norm", recording, Plan(gravity=9.81))
