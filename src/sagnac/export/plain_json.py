"""Plain JSON: the canonical correction with its covariance."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from .._version import __version__
from .canonical import Canonical
from .loss import lost, whole
from .record import Exported, Options
from .wording import FRAME

_MODEL = {"accel": "u = matrix (reading - bias)", "gyro": "u = matrix (reading - bias - g_sensitivity f)"}


def build(canonical: Canonical, options: Options) -> Exported:  # noqa: ARG001 - every builder takes the options
    """The file, see the documentation for its keys."""
    cal = canonical.calibration
    dropped = lost(canonical.triads, {k: whole(t) for k, t in canonical.triads.items()})
    sigma = np.sqrt(np.diag(canonical.covariance))
    out: dict[str, Any] = {
        "format": "sagnac correction 1",
        "unit": {"model": cal.unit.model, "serial": cal.unit.serial},
        "method": cal.method,
        "created": cal.created,
        "software": f"sagnac {__version__}",
        "frame": FRAME,
    }
    for kind, triad in canonical.triads.items():
        bias = f"{kind}.bias.x"
        own: dict[str, Any] = {
            "model": _MODEL[kind],
            "reading_unit": canonical.units[canonical.names.index(bias)],
            "result_unit": {"accel": "m/s^2", "gyro": "rad/s"}[kind],
            "matrix": triad.matrix.tolist(),
            "bias": triad.bias.tolist(),
        }
        if kind == "gyro":
            own["g_sensitivity"] = triad.g_matrix.tolist()
        out[kind] = own
    rows = zip(canonical.names, canonical.entries.tolist(), canonical.units, sigma.tolist(), strict=True)
    out["entries"] = [{"name": n, "value": v, "unit": u, "standard_uncertainty": s} for n, v, u, s in rows]
    out["covariance"] = canonical.covariance.tolist()
    exported = Exported({}, dropped, canonical.remarks)
    out |= exported.to_dict()
    text = json.dumps(out, indent=1, allow_nan=False) + "\n"
    return Exported({"": text.encode()}, dropped)
