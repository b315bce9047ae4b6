"""Tasks for the tests of the engine: quick, and as badly behaved as a test asks."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sagnac.campaign.store import Store
from sagnac.errors import DataError

COLUMNS = {"seed": "int64", "value": "double", "product": "double", "name": "string", "good": "bool"}


@dataclass(frozen=True)
class Draw:
    """Random numbers of each run's own, and a product of matrices, which BLAS threads might add in another order.

    Attributes
    ----------
    refuse : int
        Every so many runs the data support no result.
    fail : int
        Run that has a bug.
    kill : int
        Run whose worker is killed, as long as there is no such file.
    once : str
        The file; it is made before. Without one the worker is killed each time.
    pause : float, s
        That each run takes besides.
    """

    refuse: int = 0
    fail: int = -1
    kill: int = -1
    once: str = ""
    pause: float = 0.0

    @property
    def columns(self) -> Mapping[str, str]:
        return COLUMNS

    def row(self, index: int) -> Mapping[str, Any]:
        rng = np.random.default_rng(np.random.SeedSequence(5, spawn_key=(index,)))
        if self.refuse and index % self.refuse == self.refuse - 1:
            raise DataError(f"nothing to be seen in run {index}")
        if index == self.fail:
            raise ZeroDivisionError("a bug")
        if index == self.kill and not (self.once and Path(self.once).exists()):
            if self.once:
                Path(self.once).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if self.pause:
            time.sleep(self.pause)
        matrix = rng.standard_normal((40, 40))
        value = float(rng.standard_normal())
        product = float(np.linalg.inv(matrix @ matrix.T).sum())
        return {"seed": index, "value": value, "product": product, "name": f"run {index}", "good": value > 0}


def store(folder: Path, runs: int = 100, **identity: str) -> Store:
    """A folder for the runs of :class:`Draw`."""
    return Store(folder, {"task": "draw", **identity}, runs, COLUMNS)
