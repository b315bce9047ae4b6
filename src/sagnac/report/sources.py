"""The files that a calibration was made from: found again by name, known by their SHA-256."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ..files import sha256

if TYPE_CHECKING:
    from ..calibration import Calibration


def find(calibration: Calibration, folder: str | Path) -> dict[str, Path]:
    """Files that went into a calibration, by their role, as far as they are there unchanged.

    Each is looked for in `folder`, where the calibration itself lies, and where it is named. One with another SHA-256, or
    of which the calibration has none, is another file.

    Parameters
    ----------
    calibration : Calibration
    folder : path

    Returns
    -------
    dict of role (``recording``, ``plan``, ``prior``) to Path
    """
    out: dict[str, Path] = {}
    for source in calibration.source:
        if source.role in out or not source.sha256:
            continue
        for place in _places(source.file, Path(folder)):
            if _is(place, source.sha256):
                out[source.role] = place
                break
    return out


def _is(place: Path, digest: str) -> bool:
    """Whether a file of this content is there; a name that no file can have is none."""
    try:
        return place.is_file() and sha256(place) == digest
    except (OSError, ValueError):
        return False


def missing(calibration: Calibration, found: dict[str, Path]) -> dict[str, str]:
    """Names of the files that :func:`find` did not find, by role.

    Parameters
    ----------
    calibration : Calibration
    found : dict
        Its answer.
    """
    return {s.role: s.file for s in reversed(calibration.source) if s.role not in found}


def _places(file: str, folder: Path) -> Iterator[Path]:
    name = file.replace("\\", "/")
    yield folder / Path(name).name
    yield folder / name
    yield Path(file)
