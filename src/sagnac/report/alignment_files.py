"""The pictures of an alignment from the folder that it was written to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..align.record import HISTORY, RESULT
from ..align.result import Alignment, load
from ..errors import InputError
from ..frames import Array
from .alignment import estimates_figure, innovations_figure, observability_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HISTORY = "sagnac/alignment-history/1"


@dataclass(frozen=True)
class Kept:
    """What is kept of an observability: how far each standard deviation fell; no singular values over time."""

    names: tuple[str, ...]
    ratio: Array
    directions: Array
    times: Array
    over_time: Array


@dataclass(frozen=True)
class History:
    """What the file of an alignment's updates holds, see :class:`sagnac.align.history.Run`."""

    names: tuple[str, ...]
    time: Array
    values: Array
    sigmas: Array
    smoothed: Array | None
    innovation_names: tuple[str, ...]
    innovations: Array
    innovation_sigmas: Array
    used: NDArray[np.bool_]
    nis: Array
    observability: Kept


PICTURES: dict[str, tuple[str, Callable[[History], Figure]]] = {
    "estimates": ("estimates over time with their bands, or standard deviations without data", estimates_figure),
    "innovations": ("what each update differed by from its prediction", innovations_figure),
    "observability": ("how far the standard deviation of each parameter fell", observability_figure),
}
"""What each shows, and how it is drawn, by the names of ``sagnac plot``."""


def pictures_of(history: History) -> list[str]:
    """Names of the pictures that a history has the data for.

    Parameters
    ----------
    history : History
    """
    there = bool(history.innovation_names) and bool(np.isfinite(history.nis).any())
    return [name for name in PICTURES if there or name != "innovations"]


def refuse_static(result: Alignment, path: str | Path) -> None:
    """Refuse an alignment that has no history.

    Raises
    ------
    InputError
    """
    if result.kind == "static":
        raise InputError(f"{path}: a static alignment keeps no history: there is nothing to draw over time")


def read(folder: str | Path) -> tuple[Alignment, History]:
    """Result and history of an alignment.

    Parameters
    ----------
    folder : path
        Written by ``sagnac align transfer`` or ``sagnac align covariance``.

    Raises
    ------
    InputError
        When a file is missing or is no such file.
    """
    result, path = load(Path(folder) / RESULT), Path(folder) / HISTORY
    refuse_static(result, folder)
    import pyarrow as pa
    from pyarrow import parquet

    try:
        table = parquet.read_table(path)
    except (OSError, pa.ArrowException) as cause:
        raise InputError(f"{path}: cannot read the history of the alignment: {cause}") from cause
    if (table.schema.metadata or {}).get(b"sagnac", b"").decode() != _HISTORY:
        raise InputError(f"{path}: not the history of an alignment that this version reads ({_HISTORY!r})")
    try:
        return result, _history(result, table)
    except (KeyError, ValueError) as cause:
        raise InputError(f"{path}: damaged history of an alignment: {cause}") from cause


def _history(result: Alignment, table: Any) -> History:
    columns = {name.rpartition(" [")[0] or name: name for name in table.column_names}

    def column(name: str) -> Array:
        return np.asarray(table.column(columns[name]).to_numpy(), dtype=np.float64)

    def together(names: list[str]) -> Array:
        return np.column_stack([column(n) for n in names]) if names else np.zeros((table.num_rows, 0))

    after = ("heading", "pitch", "roll")
    seen = [n.removesuffix(" sigma") for n in columns if n.endswith(" sigma")]
    innovations = [n for n in seen if n.startswith("innovation ")]
    states = [n for n in seen if n not in (*innovations, *after) and not n.endswith(" smoothed")]
    sigmas = together([f"{n} sigma" for n in states])
    smoothed = all(f"{n} smoothed" in columns for n in states)
    fallen = {o.name: o.final / o.initial for o in result.observed if o.initial > 0}
    ratio = np.array([fallen.get(n, np.nan) for n in states])
    none = np.zeros(0)
    return History(
        names=tuple(states),
        time=column("time"),
        values=together(states),
        sigmas=sigmas,
        smoothed=together([f"{n} smoothed" for n in states]) if smoothed else None,
        innovation_names=tuple(n.removeprefix("innovation ") for n in innovations),
        innovations=together(innovations),
        innovation_sigmas=together([f"{n} sigma" for n in innovations]),
        used=table.column("used").to_numpy(zero_copy_only=False),
        nis=column("nis"),
        observability=Kept(tuple(states), ratio, np.zeros((0, len(states))), none, np.zeros((0, 0))),
    )
