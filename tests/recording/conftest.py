"""Where the logs of these tests lie."""

from __future__ import annotations

import pytest


@pytest.fixture
def log(tmp_path):
    return tmp_path / "log.csv"
