"""Plans from TOML files: semicolons between keys are understood, and every problem is told with its key."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..errors import InputError
from .records import Plan

# texts and comments, in which a semicolon parts nothing, or else a semicolon
_TEXTS = (r'"""(?:\\.|[^\\])*?"""', r"'''.*?'''", r'"(?:\\.|[^"\\\n])*"', r"'[^'\n]*'", r"#[^\n]*")
_SEMICOLON = re.compile("|".join([*_TEXTS, r";[ \t]*"]), re.DOTALL)


def load(path: str | Path) -> Plan:
    """Read a plan.

    Parameters
    ----------
    path : path of a TOML file

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        With the key at fault and what to write instead.
    """
    return from_table(read_toml(path), str(path))


def read_toml(path: str | Path, what: str = "plan") -> dict[str, Any]:
    """Table of a TOML file in which semicolons may part keys on one line.

    Parameters
    ----------
    path : path
    what : str
        What the file is, for the message.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as cause:
        raise InputError(f"{path}: cannot read the {what}: {cause}") from cause
    lines, origin = one_key_a_line(text)
    try:
        return tomllib.loads(lines)
    except tomllib.TOMLDecodeError as cause:
        said = re.sub(r"at line (\d+), column \d+", lambda m: f"at line {origin[int(m[1]) - 1]}", str(cause))
        raise InputError(f"{path}: cannot read the {what}: {said}") from cause
    except ValueError as cause:  # a number with thousands of digits
        raise InputError(f"{path}: cannot read the {what}: {cause}") from cause
    except RecursionError as cause:
        raise InputError(f"{path}: cannot read the {what}: its brackets are nested too deeply") from cause


def from_table(table: dict[str, Any], source: str = "plan") -> Plan:
    """A plan from the table that a TOML file holds, see :func:`load`."""
    try:
        return Plan.model_validate(table, context={"file": True})
    except ValidationError as cause:
        problems = [f"{_where(e['loc'], table)}: {_what(e)}" for e in cause.errors()]
        raise InputError(f"{source}: " + "; ".join(problems)) from cause


def one_key_a_line(text: str) -> tuple[str, list[int]]:
    """TOML with semicolons between keys turned into lines (TOML itself has no such separator; people write it).

    Parameters
    ----------
    text : str

    Returns
    -------
    text : str
    origin : list of int
        Line that each line of `text` had before, counted from one.
    """
    cut = _SEMICOLON.sub(lambda m: "\0" if m[0][0] == ";" else m[0], text.replace("\0", "\ufffd"))
    origin = [1]
    for end in re.findall("[\n\0]", cut):
        origin.append(origin[-1] + (end == "\n"))
    return cut.replace("\0", "\n"), origin


def _where(location: tuple[int | str, ...], table: dict[str, Any]) -> str:
    if len(location) >= 2 and location[0] == "segment" and isinstance(location[1], int):
        entry = table["segment"][location[1]]
        name = entry.get("name", f"number {location[1] + 1}") if isinstance(entry, dict) else location[1] + 1
        return f"segment {name}" + "".join(f", {part}" for part in location[2:])
    return ".".join(str(part) for part in location) or "the plan"


def _what(error: Any) -> str:
    if error["type"] == "extra_forbidden":
        return "no such key"
    if error["type"] == "missing":
        return "is missing"
    return str(error["msg"]).removeprefix("Value error, ")
