"""Logs in CSV for the tests of recordings, and the refusal that a bad one meets."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from sagnac.errors import InputError
from sagnac.recording import open_recording

G = 9.80665
DEG = math.pi / 180
AXES = [f"{s}_{a}" for s in ("accel", "gyro") for a in "xyz"]
HEADER = ["time [s]", *(f"accel_{a} [g]" for a in "xyz"), *(f"gyro_{a} [deg/s]" for a in "xyz")]
N = 200
RAW = np.column_stack([np.arange(1, N + 1) * 0.01, np.random.default_rng(3).normal(size=(N, 6))])


def csv(path: Path, raw=RAW, header=HEADER) -> Path:
    lines = [",".join(header), *(",".join(v if isinstance(v, str) else repr(float(v)) for v in row) for row in raw)]
    path.write_text("\n".join(lines) + "\n")
    return path


def rows() -> list[list[float | str]]:
    return RAW.tolist()


def refusal(path, **options) -> str:
    with pytest.raises(InputError) as caught:
        open_recording(path, **options).read()
    return str(caught.value)
