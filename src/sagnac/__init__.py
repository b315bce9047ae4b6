"""Calibration of inertial sensors and alignment of inertial navigation systems, with uncertainties that are true.

Names below are loaded on first use, so that ``import sagnac`` stays quick.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._version import __version__
from .errors import DataError, InputError, SagnacError

if TYPE_CHECKING:
    from .align.result import Alignment
    from .align.result import load as load_alignment
    from .calibration import Calibration
    from .calibration import load as load_calibration
    from .compensation import apply
    from .navigate.state import State
    from .navigate.strapdown import Navigator
    from .navigate.trajectory import Trajectory
    from .plan import Plan
    from .plan import load as load_plan
    from .recording import Recording, from_arrays, open_recording
    from .recording import open_recording as read
    from .verification import Verification, verify

_LAZY = {
    "Alignment": ("align.result", "Alignment"),
    "Calibration": ("calibration", "Calibration"),
    "Navigator": ("navigate.strapdown", "Navigator"),
    "Plan": ("plan", "Plan"),
    "Recording": ("recording", "Recording"),
    "State": ("navigate.state", "State"),
    "Trajectory": ("navigate.trajectory", "Trajectory"),
    "Verification": ("verification", "Verification"),
    "apply": ("compensation", "apply"),
    "from_arrays": ("recording", "from_arrays"),
    "load_alignment": ("align.result", "load"),
    "load_calibration": ("calibration", "load"),
    "load_plan": ("plan", "load"),
    "open_recording": ("recording", "open_recording"),
    "read": ("recording", "open_recording"),
    "verify": ("verification", "verify"),
}

__all__ = [
    "Alignment",
    "Calibration",
    "DataError",
    "InputError",
    "Navigator",
    "Plan",
    "Recording",
    "SagnacError",
    "State",
    "Trajectory",
    "Verification",
    "__version__",
    "apply",
    "from_arrays",
    "load_alignment",
    "load_calibration",
    "load_plan",
    "open_recording",
    "read",
    "verify",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    module, attribute = _LAZY[name]
    return getattr(import_module(f".{module}", __name__), attribute)


def __dir__() -> list[str]:
    return __all__
