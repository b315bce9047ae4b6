"""What goes into a certificate besides the calibration itself, and where it is found.

A file that the calibration names is taken only where its SHA-256 is the one that the calibration has of it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from ...calibration import Calibration, load, loads
from ...errors import InputError, SagnacError
from ...files import sha256
from ...plan import Plan
from ...plan import load as load_plan
from ...recording import Recording, open_recording
from ...verification import Check, Verification, verify
from ..sources import find
from .methods import by_hand

Opener = Callable[[Path, Plan | None, Calibration], Recording]
Role = Literal["recording", "plan"]
_NOTHING = 1e-6  # standard uncertainties
AS_GIVEN = ", as given"
"""Behind the role of a file that the calibration has no SHA-256 of."""


@dataclass(frozen=True)
class Evidence:
    """A calibration and what its certificate can be drawn from.

    Attributes
    ----------
    calibration : Calibration
    data : bytes
        Of its file, as it was read.
    name : str
        Of its file.
    recording, plan : Recording, Plan or None
        Those that the calibration was made from.
    fit_checks : tuple of Check
        Residuals of the calibration on its own recording.
    check_recording, check_plan : Recording, Plan or None
        Of a run that the fit has not seen.
    verification : Verification or None
        On that run.
    earlier : Calibration or None
        Of the same unit, of an earlier visit.
    as_found : Calibration or None
        Of the same unit, of this visit, before it was adjusted.
    files : tuple of (str, str, str)
        Role, name and SHA-256 of every file that was read.
    absent : mapping of str to str
        What could not be had (``recording``, ``plan``, ``residuals``), and why.
    """

    calibration: Calibration
    data: bytes
    name: str = "calibration.json"
    recording: Recording | None = None
    plan: Plan | None = None
    fit_checks: tuple[Check, ...] = ()
    check_recording: Recording | None = None
    check_plan: Plan | None = None
    verification: Verification | None = None
    earlier: Calibration | None = None
    as_found: Calibration | None = None
    files: tuple[tuple[str, str, str], ...] = ()
    absent: dict[str, str] = field(default_factory=dict)


def of(calibration: Calibration) -> Evidence:
    """The calibration alone."""
    absent = {role: f"the {role} of the calibration was not given" for role in ("recording", "plan")}
    return Evidence(calibration, calibration.to_json().encode("utf-8"), absent=absent)


def gather(
    path: str | Path,
    *,
    recording: str | Path | None = None,
    plan: str | Path | None = None,
    check: str | Path | None = None,
    check_plan: str | Path | None = None,
    earlier: str | Path | None = None,
    as_found: str | Path | None = None,
    opener: Opener | None = None,
) -> Evidence:
    """Read a calibration and all that goes with it.

    Parameters
    ----------
    path : path of the calibration (JSON)
    recording, plan : path, optional
        Those that it was made from. Left out, they are looked for where the calibration names them, and beside it.
    check, check_plan : path, optional
        Recording that the fit has not seen, and its plan: the calibration is verified on it.
    earlier : path, optional
        A calibration of the same unit of an earlier visit.
    as_found : path, optional
        The calibration of this visit before the unit was adjusted.
    opener : callable, optional
        ``opener(path, plan, calibration) -> Recording``; default: with the nominal scale of plan and calibration.

    Returns
    -------
    Evidence

    Raises
    ------
    InputError
        When a file that was given cannot be read, is not the one that the calibration was made from, or is of another unit; when
        the fit has seen the recording to verify on, or that lacks its plan; when two calibrations to compare are one.
    DataError
        When the verification has nothing to compare.
    """
    file = Path(path)
    try:
        data = file.read_bytes()
        calibration = loads(data.decode("utf-8-sig"), str(path))
    except (OSError, UnicodeDecodeError) as cause:
        raise InputError(f"{path}: cannot read the calibration: {cause}") from cause
    found = Evidence(calibration, data, file.name)
    opened = opener or _opened
    absent: dict[str, str] = {}
    files: list[tuple[str, str, str]] = []
    there = find(calibration, file.parent)
    plan_file = _file(calibration, "plan", plan, there, absent, files)
    own_plan = load_plan(plan_file) if plan_file is not None else None
    if own_plan is not None:  # what options said besides the plan's file
        own_plan = own_plan.model_copy(update={"gravity": calibration.site.gravity})
    recording_file = _file(calibration, "recording", recording, there, absent, files)
    own = opened(recording_file, own_plan, calibration) if recording_file is not None else None
    found = replace(found, recording=own, plan=own_plan)
    if own is not None:
        found = replace(found, fit_checks=_fit_checks(calibration, own, own_plan, absent))
    if earlier is not None:
        found = replace(found, earlier=_earlier(found, earlier, "earlier calibration", files))
    if as_found is not None:
        found = replace(found, as_found=_earlier(found, as_found, "calibration as found", files))
    if check is not None:
        found = _verified(found, Path(check), check_plan, opened, files)
    elif check_plan is not None:
        raise InputError(f"--check-plan {check_plan}: give the recording that it belongs to (--check)")
    return replace(found, files=tuple(files), absent=absent)


def _opened(path: Path, plan: Plan | None, calibration: Calibration) -> Recording:
    scale = dict(calibration.unit.scale) | (dict(plan.unit.scale) if plan is not None else {})
    return open_recording(path, scale=scale)


def _file(
    calibration: Calibration,
    role: Role,
    given: str | Path | None,
    there: dict[str, Path],
    absent: dict[str, str],
    files: list[tuple[str, str, str]],
) -> Path | None:
    """The file of this role: the given one if its hash agrees, else the one that was found."""
    named = [s for s in calibration.source if s.role == role]
    known = {s.sha256 for s in named if s.sha256}
    if given is not None:
        digest = _digest(given, role)
        if known and digest not in known:
            raise InputError(
                f"{given}: not the {role} that the calibration was made from ({', '.join(s.file for s in named)}): its SHA-256 "
                f"is {digest[:12]}..., the calibration has {', '.join(sorted(k[:12] for k in known))}..."
            )
        files.append((role if known else f"{role}{AS_GIVEN}", Path(given).name, digest))
        return Path(given)
    if role in there:
        return there[role]
    absent[role] = (
        f"the {role} {named[0].file} was not found with the SHA-256 that the calibration has of it"
        if named
        else f"the calibration names no {role}"
    )
    return None


def _digest(path: str | Path, what: str) -> str:
    try:
        return sha256(path)
    except OSError as cause:
        raise InputError(f"{path}: cannot read the {what}: {cause.strerror}") from cause


def _fit_checks(
    calibration: Calibration, recording: Recording, plan: Plan | None, absent: dict[str, str]
) -> tuple[Check, ...]:
    try:
        checks = verify(calibration, recording, plan).checks
    except SagnacError as cause:  # a certificate does not fail for want of a picture
        absent["residuals"] = str(cause)
        return ()
    if all(abs(c.z) < _NOTHING for c in checks):  # four-position: the same biases from the same readings
        absent["residuals"] = f"a recording by {calibration.method} has no residuals against its own calibration"
        return ()
    return checks


def hints(evidence: Evidence) -> tuple[str, ...]:
    """What the person at the keyboard can do about what a certificate lacks."""
    return tuple(
        f"{evidence.absent[role]}; put it beside the calibration or give it with --{role}"
        for role in ("recording", "plan")
        if role in evidence.absent and not (role == "plan" and by_hand(evidence.calibration))
    )


def _earlier(found: Evidence, path: str | Path, what: str, files: list[tuple[str, str, str]]) -> Calibration:
    digest, calibration = _digest(path, what), found.calibration
    earlier = load(path)
    if digest in {hashlib.sha256(found.data).hexdigest(), *(d for _, _, d in files)}:
        raise InputError(f"{path}: is given twice: a calibration is compared with another one, not with itself")
    if earlier.parameters == calibration.parameters:
        raise InputError(f"{path}: is the same result as this calibration: there is nothing to compare")
    theirs, ours = earlier.unit.serial, calibration.unit.serial
    if theirs and ours and theirs != ours:
        raise InputError(f"{path}: of unit {theirs!r}, this calibration is of {ours!r}: only one unit can be compared")
    if not set(earlier.values()) & set(calibration.values()):
        raise InputError(f"{path}: has no parameter in common with this calibration")
    files.append((what, Path(path).name, digest))
    return earlier


def _verified(
    found: Evidence, check: Path, check_plan: str | Path | None, opened: Opener, files: list[tuple[str, str, str]]
) -> Evidence:
    calibration, digest = found.calibration, _digest(check, "recording to verify on")
    if digest in {s.sha256 for s in calibration.source}:
        raise InputError(
            f"--check {check}: it is the recording that the calibration was made from; that it fits says nothing. Give one that "
            "the fit has not seen"
        )
    if check_plan is None and not by_hand(calibration):
        raise InputError(
            f"--check {check}: give the plan of that recording too (--check-plan): the calibration by {calibration.method} was "
            "made with one, and is verified with one"
        )
    plan = load_plan(check_plan) if check_plan is not None else None
    recording = opened(check, plan, calibration)
    outcome = verify(calibration, recording, plan)
    files.append(("verification recording", check.name, digest))
    if check_plan is not None:
        files.append(("verification plan", Path(check_plan).name, sha256(check_plan)))
    return replace(found, check_recording=recording, check_plan=plan, verification=outcome)
