"""Single pictures of a calibration, a recording or an alignment, with the files that they need found."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..align.record import RESULT
from ..align.result import load as load_alignment
from ..calibration import Calibration
from ..calibration import load as load_calibration
from ..errors import InputError
from ..files import sha256
from ..observe.static import THRESHOLD
from ..plan import Plan
from ..plan import load as load_plan
from ..recording import Recording, open_recording
from ..verification import made_by_hand
from . import alignment_files
from .pictures import PICTURES, Material, draw
from .sources import find

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Opener = Callable[[Path, Plan | None, Calibration | None], Recording]
"""Opens a recording with the nominal scale of its plan and calibration."""
_OF_RECORDING = ("log",)


@dataclass(frozen=True)
class Given:
    """Files that go with the one that is drawn, each optional.

    Attributes
    ----------
    recording, plan : Path or None
        Left out, those that a calibration names are looked for beside it.
    earlier : Path or None
        An earlier calibration of the same unit.
    threshold : float
        Of static intervals.
    """

    recording: Path | None = None
    plan: Path | None = None
    earlier: Path | None = None
    threshold: float = THRESHOLD


@dataclass(frozen=True)
class Offer:
    """A picture that can be drawn of a file.

    Attributes
    ----------
    name, shows : str
    missing : str
        What has to be given for it; empty when all is there.
    """

    name: str
    shows: str
    missing: str = ""


@dataclass(frozen=True)
class Drawn:
    """A picture, and what the person should know of how it was made."""

    figure: Figure
    remarks: tuple[str, ...] = ()


def kind_of(path: Path) -> str:
    """What a file is: ``calibration``, ``alignment`` (a folder, or the result in it) or ``recording``.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        When there is no such file, or it is a plan.
    """
    if path.is_dir():
        return "alignment"
    if not path.is_file():
        raise InputError(f"{path}: no such file or folder")
    if path.suffix.lower() == ".toml":
        raise InputError(
            f"{path}: is a plan; there are pictures of a calibration, a recording (with its plan: --plan) and an alignment"
        )
    if path.suffix.lower() != ".json":
        return "recording"
    try:
        table = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        table = None  # the reader of calibrations says what is wrong
    schema = str(table.get("schema", "")) if isinstance(table, dict) else ""
    return "alignment" if schema.startswith("sagnac/alignment/") else "calibration"


def offers(path: Path, given: Given | None = None) -> list[Offer]:
    """What can be drawn of a file.

    Parameters
    ----------
    path : Path
        Calibration, recording, or folder of an alignment.
    given : Given, optional

    Raises
    ------
    InputError
        When the file cannot be read.
    """
    given = given or Given()
    kind = kind_of(path)
    if kind == "alignment":
        _, history = alignment_files.read(_folder(path))
        return [Offer(n, alignment_files.PICTURES[n][0]) for n in alignment_files.pictures_of(history)]
    if kind == "recording":
        return [Offer(n, PICTURES[n].shows) for n in _OF_RECORDING]
    calibration = load_calibration(path)
    there = {"calibration", *find(calibration, path.parent)}
    there |= {n for n in ("recording", "plan", "earlier") if getattr(given, n) is not None}
    return [Offer(name, k.shows, " ".join(f"--{n}" for n in k.needs if n not in there)) for name, k in PICTURES.items()]


def plot(path: Path, name: str, given: Given | None = None, *, opener: Opener | None = None) -> Drawn:
    """Draw one picture.

    Parameters
    ----------
    path : Path
        Calibration, recording, or folder of an alignment.
    name : str
        One of :func:`offers`.
    given : Given, optional
    opener : callable, optional
        How recordings are opened; default: with the nominal scale of plan and calibration.

    Raises
    ------
    InputError
        When there is no such picture, or a file that it needs is missing or cannot be read.
    DataError
        When the data do not support it.
    """
    given = given or Given()
    opened = opener or _opened
    kind = kind_of(path)
    if kind == "alignment":
        return _of_alignment(path, name, given)
    if kind == "recording":
        return _of_recording(path, name, given, opened)
    _refuse(name, PICTURES, path)
    wanted = {*PICTURES[name].needs, *PICTURES[name].takes}
    _refuse_unused(name, given, [n for n in ("recording", "plan", "earlier") if n not in wanted])
    calibration = load_calibration(path)
    remarks: list[str] = []
    earlier = None if given.earlier is None else _earlier(calibration, given.earlier)
    recording, plan = None, None
    if "recording" in wanted:
        recording, plan = _recording(calibration, path, name, given, opened, remarks)
    material = Material(calibration, recording, plan, earlier, given.threshold)
    lacking = [n for n in PICTURES[name].needs if getattr(material, n) is None]
    if lacking:
        options = " and ".join(f"--{n}" for n in lacking)
        raise InputError(f"{path}: the picture {name!r} ({PICTURES[name].shows}) needs {options}")
    return Drawn(draw(name, material), tuple(remarks))


def _opened(path: Path, plan: Plan | None, calibration: Calibration | None) -> Recording:
    scale = dict(calibration.unit.scale) if calibration is not None else {}
    return open_recording(path, scale=scale | (dict(plan.unit.scale) if plan is not None else {}))


def _folder(path: Path) -> Path:
    """Folder of an alignment, of which its result may be named."""
    if path.is_dir():
        return path
    alignment_files.refuse_static(load_alignment(path), path)
    if path.name != RESULT:
        raise InputError(
            f"{path}: the pictures need the history of the alignment: give the folder that it was written to"
        )
    return path.parent


def _refuse(name: str, names: Collection[str], path: Path) -> None:
    if name not in names:
        raise InputError(f"{path}: there is no picture {name!r} of it; choose from {', '.join(names)}")


def _refuse_unused(name: str, given: Given, unused: Sequence[str]) -> None:
    for option in unused:
        if getattr(given, option) is not None:
            raise InputError(f"the picture {name!r} takes no --{option}")


def _of_alignment(path: Path, name: str, given: Given) -> Drawn:
    _refuse_unused(name, given, ("recording", "plan", "earlier"))
    _, history = alignment_files.read(_folder(path))
    _refuse(name, alignment_files.pictures_of(history), path)
    return Drawn(alignment_files.PICTURES[name][1](history))


def _of_recording(path: Path, name: str, given: Given, opened: Opener) -> Drawn:
    _refuse(name, _OF_RECORDING, path)
    _refuse_unused(name, given, ("recording", "earlier"))
    plan = None if given.plan is None else load_plan(given.plan)
    return Drawn(draw(name, Material(recording=opened(path, plan, None), plan=plan, threshold=given.threshold)))


def _earlier(calibration: Calibration, path: Path) -> Calibration:
    earlier = load_calibration(path)
    theirs, ours = earlier.unit.serial, calibration.unit.serial
    if theirs and ours and theirs != ours:
        raise InputError(f"{path}: is of unit {theirs!r}, the calibration is of {ours!r}")
    return earlier


def _recording(
    calibration: Calibration, path: Path, name: str, given: Given, opened: Opener, remarks: list[str]
) -> tuple[Recording | None, Plan | None]:
    """The recording that was given, or the calibration's own; and the plan that belongs to it."""
    found = find(calibration, path.parent)
    file, plan_file = given.recording, given.plan
    own = file is None or _same(file, calibration)
    if file is None:
        file = found.get("recording")
    if plan_file is None and own:
        plan_file = found.get("plan")
    named = {s.role: s.file for s in calibration.source}
    if file is None:
        if "recording" in PICTURES[name].needs:
            raise InputError(
                f"{path}: the picture {name!r} needs the recording"
                + (f"; {named['recording']} is not beside it as it was" if "recording" in named else "")
                + "; give it with --recording"
            )
        remarks.append("the recording was not found, so that this is drawn from the calibration alone (--recording)")
        return None, None
    planless = plan_file is None and own and ("plan" in named or not made_by_hand(calibration))
    lost = "the plan was not found" if "plan" in named else "the calibration names no plan"
    if planless and "recording" not in PICTURES[name].needs:
        remarks.append(f"{lost}, so that this is drawn from the calibration alone (--plan)")
        return None, None
    if planless:
        remarks.append(f"{lost}: give it with --plan")
    plan = None if plan_file is None else load_plan(plan_file)
    if name == "before-after" and own:
        remarks.append("drawn on the recording that the fit has seen; give another one with --recording and --plan")
    return opened(file, plan, calibration), plan


def _same(path: Path, calibration: Calibration) -> bool:
    """Whether a file is the calibration's own recording."""
    known = {s.sha256 for s in calibration.source if s.role == "recording" and s.sha256}
    try:
        return sha256(path) in known
    except OSError as cause:
        raise InputError(f"{path}: cannot read the recording: {cause.strerror}") from cause
