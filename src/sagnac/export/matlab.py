"""MATLAB: a ``.mat`` file of version 5 with matrices, covariance and names."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from .canonical import Canonical
from .loss import lost, whole
from .record import FORCE, RATE, Exported, Options
from .wording import header, plain

_HEADER = 116
_USE = (
    "load('FILE.mat'); f = (y_accel - accel.bias) * accel.matrix'; "
    "w = (y_gyro - gyro.bias - f * gyro.g_sensitivity') * gyro.matrix';  % one row a sample"
)


def build(canonical: Canonical, options: Options) -> Exported:  # noqa: ARG001 - every builder takes the options
    """The file: structures ``accel`` and ``gyro``; ``names``, ``units``, ``values``, ``covariance`` of all entries; ``about``."""
    from scipy.io import savemat

    dropped = lost(canonical.triads, {k: whole(t) for k, t in canonical.triads.items()})
    content: dict[str, Any] = {}
    for kind, triad in canonical.triads.items():
        content[kind] = {"matrix": triad.matrix, "bias": triad.bias[None, :], "counts": triad.counts}
        if kind == "gyro":
            content[kind]["g_sensitivity"] = triad.g_matrix
    content |= {
        "names": np.array(canonical.names, dtype=object),
        "units": np.array(canonical.units, dtype=object),
        "values": canonical.entries[:, None],
        "covariance": canonical.covariance,
        "dropped": np.array([plain(d.line()) for d in dropped], dtype=object),
        "dropped_at": {"specific_force": FORCE, "angular_rate": RATE},
        "about": np.array([*header(canonical, dropped), _USE], dtype=object),
    }
    stream = io.BytesIO()
    savemat(stream, content, oned_as="column")  # type: ignore[arg-type] # any binary stream will do
    data = bytearray(stream.getvalue())
    # scipy writes the time of day there; the same calibration shall give the same file
    data[:_HEADER] = b"MATLAB 5.0 MAT-file, calibration by sagnac".ljust(_HEADER)
    return Exported({"": bytes(data)}, dropped)
