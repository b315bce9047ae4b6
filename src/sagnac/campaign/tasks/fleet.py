"""Calibrations of the recordings of a fleet: one row a recording, its calibration with it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ... import plan as plans
from ... import results
from ...calibration import Calibration
from ...errors import DataError, SagnacError
from ...files import sha256, write_atomically
from ...plan import Plan
from ...recording import Recording, open_recording
from ..chunks import UnfitError
from ..spec import Campaign, Settings, shown
from .about import About, Parameter, PointAbout
from .calibration import calibrated
from .outcome import OK, Cell

FOLDER = "calibrations"
"""Of the calibrations, in the folder of a campaign."""
_NEVER = "1970-01-01T00:00:00+00:00"
"""Stands for the time of a calibration in the rows, which are the same whenever they are made."""


@dataclass(frozen=True)
class Fleet:
    """Calibrations of recordings; a task of the campaign's engine.

    Attributes
    ----------
    about : About
    folder : Path
        That the shown names start from.
    settings : Settings
    recordings : tuple of Path
    plans : tuple of Path or None
    digests : dict of str to str
        SHA-256 of recordings and plans by shown name, as they were when the campaign began.
    """

    about: About
    folder: Path
    settings: Settings
    recordings: tuple[Path, ...]
    plans: tuple[Path | None, ...]
    digests: dict[str, str] = field(default_factory=dict, repr=False)

    @property
    def columns(self) -> dict[str, str]:
        """Columns of the rows, by the names of their Arrow types."""
        head = {"run": "int64", "recording": "string", "serial": "string", "status": "string"}
        fit = {"chi2": "float64", "degrees_of_freedom": "int64", "p_value": "float64", "remarks": "string"}
        values = {f"{what}.{p.name}": "float64" for p in self.about.parameters for what in ("value", "sigma")}
        return head | fit | values | {"calibration": "string"}

    def row(self, index: int) -> dict[str, Cell]:
        """One recording; a refusal is a row whose status says why."""
        file = self.recordings[index]
        out: dict[str, Cell] = dict.fromkeys(self.columns)
        out |= {"run": index, "recording": shown(file, self.folder), "serial": file.stem}
        try:
            found = self.calibration(index)
        except SagnacError as refused:
            self._need_unchanged(index)
            return out | {"status": self._moved(index, str(refused).splitlines()[0])}
        self._need_unchanged(index)
        known = {p.name for p in self.about.parameters}
        more = [p.name for p in found.parameters if p.name not in known]
        remarks = [*found.remarks, *([f"in its calibration alone: {', '.join(more)}"] if more else [])]
        say = partial(self._moved, index)
        out |= {
            "status": OK,
            "serial": found.unit.serial,
            "chi2": found.fit.chi2,
            "degrees_of_freedom": found.fit.degrees_of_freedom,
            "p_value": found.fit.p_value,
            "remarks": say("; ".join(remarks)),
            "calibration": json.dumps(_told(_table(found), say), separators=(",", ":"), allow_nan=False),
        }
        for p in found.parameters:
            if p.name in known:
                out |= {f"value.{p.name}": p.value, f"sigma.{p.name}": p.standard_uncertainty}
        return out

    def calibration(self, index: int) -> Calibration:
        """The calibration of one recording; raises as :func:`sagnac.calibrate.calibrate` does."""
        settings, file, plan_file = self.settings, self.recordings[index], self.plans[index]
        plan = None if plan_file is None else plans.load(plan_file)
        found = calibrated(opened(settings, file, plan), plan, settings)
        # where the plan names none, the file's name is as good as any
        serial = (found.unit.serial if settings.serial_from == "plan" else "") or file.stem
        found = found.model_copy(update={"unit": found.unit.model_copy(update={"serial": serial})})
        return found if plan_file is None else found.with_source(plan_file, "plan")

    def _moved(self, index: int, text: str) -> str:
        """A text with the names of files as they are from the campaign's folder: a row does not tell where that is."""
        for file in (self.recordings[index], self.plans[index]):
            if file is not None:
                text = text.replace(str(file), shown(file, self.folder))
        return text

    def _need_unchanged(self, index: int) -> None:
        """Refuse files other than the campaign began with: its results would not be those of its fingerprint."""
        for file in (self.recordings[index], self.plans[index]):
            name = "" if file is None else shown(file, self.folder)
            if file is None or name not in self.digests:
                continue
            try:
                now = sha256(file)
            except OSError as cause:
                now = "missing" if isinstance(cause, FileNotFoundError) else f"unreadable ({cause.strerror})"
            if now != self.digests[name]:
                raise UnfitError(
                    f"{file} is not what it was when the campaign began, or not the same on this worker (SHA-256 "
                    f"{self.digests[name][:12]}, now {now[:12]}): put it back, or take another folder for the results"
                )


def _told(given: Any, say: Callable[[str], str]) -> Any:
    """Nested values with other texts."""
    if isinstance(given, dict):
        return {k: _told(v, say) for k, v in given.items()}
    if isinstance(given, list):
        return [_told(v, say) for v in given]
    return say(given) if isinstance(given, str) else given


def _table(found: Calibration) -> dict[str, object]:
    """A calibration as JSON holds it, without the time at which it was made."""
    return found.model_copy(update={"created": _NEVER}).model_dump(by_alias=True, mode="json")


def opened(settings: Settings, file: Path, plan: Plan | None) -> Recording:
    """A recording of a fleet, with what the campaign says of its columns."""
    return open_recording(
        file,
        units_of=settings.units,
        scale=(plan.unit.scale if plan is not None else {}) | settings.scale,
        rename=settings.map,
        select=settings.select,
        rate=settings.rate,
        partial=settings.partial,
    )


def prepare(campaign: Campaign) -> Fleet:
    """The task of a fleet.

    The first recording with each set of sensors that can be calibrated says which parameters there will be.

    Raises
    ------
    DataError
        When none of the recordings can be calibrated, with the reason of the first.
    """
    settings = campaign.settings
    about = About(
        title=campaign.title,
        kind="fleet",
        method=settings.method,
        runs=campaign.index_count,
        parameters=(),
        points=(PointAbout(values={}),),
    )
    task = known(campaign, about)
    units: dict[str, str] = {}
    seen: set[tuple[frozenset[str], frozenset[str]]] = set()
    refused: SagnacError | None = None
    for index, file in enumerate(campaign.recordings):
        try:
            plan_file = campaign.plans[index]
            recording = opened(settings, file, None if plan_file is None else plans.load(plan_file))
            if (kind := (recording.has, recording.single)) in seen:
                continue
            units |= {p.name: p.unit for p in task.calibration(index).parameters}
            seen.add(kind)
        except SagnacError as cause:
            refused = refused or cause
    if not units:
        raise DataError(f"{campaign.name}: none of the recordings can be calibrated; the first: {refused}")
    parameters = tuple(Parameter(name=n, unit=u) for n, u in units.items())
    return known(campaign, about.model_copy(update={"parameters": parameters}))


def known(campaign: Campaign, about: About) -> Fleet:
    """The task of a fleet whose parameters are known."""
    return Fleet(about, campaign.folder, campaign.settings, campaign.recordings, campaign.plans, campaign.digests)


def write_calibrations(folder: str | Path, rows: Iterator[Mapping[str, Cell]], base: str | Path = "") -> int:
    """Write the calibration of each row to ``calibrations/NAME.json``; those that are there with the same result are kept.

    Parameters
    ----------
    folder : path
        Of the campaign.
    rows : iterator of mapping
        With ``recording`` and ``calibration``.
    base : path, optional
        Of the campaign's file: names of sources are written from there.

    Returns
    -------
    int
        How many there are.
    """
    written = 0
    for row in rows:
        text = row["calibration"]
        if not isinstance(text, str):
            continue
        target = Path(folder) / FOLDER / f"{Path(str(row['recording'])).stem}.json"
        table = json.loads(text)
        for source in table["source"]:
            source["file"] = os.path.normpath(Path(base) / source["file"])
        written += 1
        if target.is_file() and _same(target, table):
            continue
        table["created"] = results.now()
        with write_atomically(target) as temporary:
            temporary.write_text(json.dumps(table, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return written


def _same(target: Path, table: dict[str, object]) -> bool:
    """Whether a file holds a calibration but for the time at which it was made."""
    try:
        held = json.loads(target.read_text(encoding="utf-8"))
    except ValueError:
        return False
    return isinstance(held, dict) and {**held, "created": _NEVER} == table
