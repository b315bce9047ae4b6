"""Definitions in a ULog file: what the messages of a topic are made of.

Source: PX4 guide, "ULog File Format" (dev_log/ulog_file_format), messages F and A.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

_TYPES = {f"int{n}_t": f"<i{n // 8}" for n in (8, 16, 32, 64)} | {f"uint{n}_t": f"<u{n // 8}" for n in (8, 16, 32, 64)}
_TYPES |= {"float": "<f4", "double": "<f8", "bool": "<u1", "char": "<u1"}
_FIELD = re.compile(r"([\w/]+)(?:\[(\d{1,5})\])? (\w+)", re.ASCII)
_DEEP = 16  # levels of types in types; real logs have two
LARGEST = 1 << 16
"""No message is as long."""


class DefinitionError(ValueError):
    """A definition or subscription that cannot be; its text is the reason."""


@dataclass(frozen=True)
class Topic:
    """One subscription.

    Attributes
    ----------
    name : str
    instance : int
        Which of several sensors of this kind (``multi_id``).
    shortest, longest : int
        Bytes that its messages may have: padding at the end is not logged.
    dtype : dtype or None
        Plain fields at their offsets, of topics that are wanted.
    """

    name: str
    instance: int
    shortest: int
    longest: int
    dtype: Any = None


@dataclass
class Formats:
    """Definitions met so far.

    Attributes
    ----------
    fields : dict of str to list of (type, count, name)
    """

    fields: dict[str, list[tuple[str, int, str]]] = field(default_factory=dict)

    def define(self, text: str) -> None:
        """Take the text of a definition, ``name:type field;type[4] field;``."""
        name, colon, rest = text.partition(":")
        found = [_FIELD.fullmatch(part.strip()) for part in rest.split(";") if part.strip()]
        if not colon or not found or not all(found):
            raise DefinitionError(f"a definition of a format that says {text[:60]!r}")
        parsed = [(match[1], int(match[2] or 1), match[3]) for match in found if match]
        if self.fields.setdefault(name, parsed) != parsed:
            raise DefinitionError(f"the format {name} is defined twice and differently")

    def topic(self, name: str, instance: int, wanted: bool) -> Topic:
        """Subscription of a topic; of one whose definition is missing nothing is known, and it may not be wanted."""
        sizes: dict[str, int] = {}
        try:
            most = self._size(name, sizes)
            kind, count, last = self.fields[name][-1]
            least = most - (count * self._size(kind, sizes) if last.startswith("_padding") else 0)
            dtype = self._dtype(name, sizes) if wanted else None
        except KeyError as cause:
            if wanted:
                raise DefinitionError(f"the topic {name} uses a format that is not defined or holds itself") from cause
            return Topic(name, instance, 0, LARGEST)
        return Topic(name, instance, min(least, LARGEST), min(most, LARGEST), dtype)

    def _size(self, name: str, sizes: dict[str, int], depth: int = 0) -> int:
        """Bytes of a type, padding at its end included; KeyError for one that nobody defined or that holds itself."""
        if name in _TYPES:
            return int(_TYPES[name][2])
        if name not in sizes:
            if depth > _DEEP:
                raise KeyError(name)
            sizes[name] = sum(count * self._size(kind, sizes, depth + 1) for kind, count, _ in self.fields[name])
        return sizes[name]

    def _dtype(self, name: str, sizes: dict[str, int]) -> Any:
        """Plain fields of a format."""
        plain: list[tuple[str, Any, int]] = []
        offset = end = 0
        for kind, count, label in self.fields[name]:
            width = count * self._size(kind, sizes)
            if not label.startswith("_padding"):
                end = offset + width
                if kind in _TYPES:
                    plain.append((label, (_TYPES[kind], (count,)) if count > 1 else _TYPES[kind], offset))
            offset += width
        if end > LARGEST or not plain:
            raise DefinitionError(f"the format {name} has {end} bytes in {len(plain)} plain fields")
        names, kinds, offsets = zip(*plain, strict=True)
        try:
            return np.dtype({"names": names, "formats": kinds, "offsets": offsets, "itemsize": end})
        except ValueError as cause:
            raise DefinitionError(f"the format {name} cannot be: {cause}") from cause
