"""Datasets that hold their numbers packed: what stands in the file is unpacked as their attributes say.

Source: CF conventions 1.11, section 8.1 (packed data: ``scale_factor``, ``add_offset``) and section 2.5.1 (missing data:
``_FillValue``, ``missing_value``, in the numbers as they stand in the file).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...frames import Array
from ..table import Fault
from .variables import Rows, Variable

_FILLS = ("_FillValue", "missing_value")
_KEYS = ("scale_factor", "add_offset", *_FILLS, "_Unsigned")


@dataclass(frozen=True)
class _Packing:
    """True number = number in the file * scale + offset; not a number where one of `fills` stands in the file."""

    scale: float = 1.0
    offset: float = 0.0
    fills: tuple[int | float, ...] = ()

    def unpacked(self, raw: NDArray[Any]) -> Array:
        out = raw.astype(float) * self.scale + self.offset
        for fill in self.fills:
            # a fill of doubles in a dataset of singles stands there rounded
            out[raw == (raw.dtype.type(fill) if raw.dtype.kind == "f" else fill)] = np.nan
        return np.asarray(out)


@dataclass(frozen=True)
class _Unpacked:
    """Rows of another reader, unpacked."""

    rows: Rows
    packing: _Packing

    def take(self, count: int) -> tuple[list[NDArray[Any]], Fault | None]:
        """See :class:`Rows`."""
        pieces, fault = self.rows.take(count)
        return [self.packing.unpacked(piece) for piece in pieces], fault

    def finish(self) -> None:
        """See :class:`Rows`."""
        self.rows.finish()


def unpacked(path: Path, item: Any, variable: Variable) -> Variable:
    """The variable with its true numbers; where its attributes cannot be applied, one that is refused when it is read.

    Parameters
    ----------
    path : Path
    item : h5py.Dataset
    variable : Variable
        Of this dataset, as its numbers stand in the file.
    """
    given = [key for key in _KEYS if key in item.attrs]
    if not given:
        return variable
    numbers = {key: _number(item, key) for key in given}
    bad = [key for key, value in numbers.items() if value is None or not _applicable(key, value)]
    if item.dtype.names is not None:
        bad = given  # for which of the fields they are, nothing says
    packing = _Packing(
        float(numbers.get("scale_factor") or 1.0),
        float(numbers.get("add_offset") or 0.0),
        tuple(value for key in _FILLS if (value := numbers.get(key)) is not None),
    )

    def rows(file: Any, columns: Sequence[int]) -> Rows:
        if bad:
            raise InputError(
                f"{path}: {item_name}: its attribute {', '.join(bad)} is in a form that cannot be applied, and without it "
                "its numbers are not what they mean; write the dataset with its true numbers"
            )
        return _Unpacked(variable.rows(file, columns), packing)

    item_name = item.name
    return replace(variable, rows=rows, whole=False)


def _applicable(key: str, value: float) -> bool:
    if key == "_Unsigned":
        return False
    return key in _FILLS or (math.isfinite(value) and (value != 0 or key == "add_offset"))


def _number(item: Any, key: str) -> int | float | None:
    """Value of an attribute that is one number: damage can make it claim any size and type."""
    known = item.attrs.get_id(key)
    if math.prod(known.shape or (1,)) != 1 or known.dtype.kind not in "iuf" or known.dtype.itemsize > 8:
        return None
    value = np.ravel(item.attrs[key])[0].item()
    return value if isinstance(value, int | float) else None
