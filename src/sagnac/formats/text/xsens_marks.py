"""What tells a text export of Xsens MT Manager from a table of somebody else with the same names of columns.

Comment lines: exports of MT Manager 4.x (``// Start Time``, ``// Update Rate``, ``// Filter Profile``, ``// Option Flags``,
``// Firmware Version``, of the MTw ``// Sample rate`` and ``// Scenario``) and 2019 to 2022 (``//  MT Manager version``).
"""

from __future__ import annotations

import re
from collections.abc import Sequence

TICKS = "SampleTimeFine"
PACKET = "PacketCounter"
SENSOR = re.compile(r"(Acc|Gyr)_([XYZ])(?:\s*[\[(]([^\[\]()]*)[\])])?")
_OWN = re.compile(r"//\s*(?:MT ?Manager\b|Filter Profile:|Option Flags:|Scenario:)", re.IGNORECASE)
_ALSO = re.compile(r"//\s*(?:Start Time|Update Rate|Sample Rate|Firmware Version|Device ?Id)\s*:", re.IGNORECASE)


def fields(line: str) -> list[str]:
    """Fields of a line, by the delimiter that occurs most often in it: tab, semicolon, comma or blank."""
    mark = delimiter(line)
    return line.split() if mark == " " else line.strip("\r\n").split(mark)


def delimiter(line: str) -> str:
    """What parts the fields of a line."""
    return max("\t;, ", key=line.count)


def by_mt_manager(comments: Sequence[str], names: Sequence[str]) -> bool:
    """Whether the comment lines are those of MT Manager, so that units and ticks are known.

    Lines that any logger could write count only beside a column that is Xsens' own.
    """
    own = {PACKET, TICKS} & {name.strip() for name in names}
    return any(_OWN.match(line) or (own and _ALSO.match(line)) for line in comments)


def is_export(comments: Sequence[str], header: str) -> bool:
    """Whether a text with these comment lines and this header line is an export of MT Manager (or of a DOT).

    Parameters
    ----------
    comments : sequence of str
    header : str
        First line that is no comment.
    """
    names = [name.strip() for name in fields(header)] if header else []
    if {PACKET, TICKS} & set(names):
        return True
    return any(SENSOR.fullmatch(name) for name in names) and by_mt_manager(comments, names)
