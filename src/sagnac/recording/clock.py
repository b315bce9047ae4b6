"""Time of the samples in s, exact where the file has whole numbers since an epoch."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frames import Array
from .columns import Channel

EPOCH = 1e8
"""s: no log lasts three years; a time above counts from an epoch, and a double keeps little of the steps in it."""


@dataclass
class Clock:
    """Time of successive pieces of one pass over a file.

    Whole numbers (int64 nanoseconds since 1970) are counted from the first sample, the difference taken before they become
    doubles. What is a double in the file already stays what it is.

    Parameters
    ----------
    channel : Channel
        Of the time.
    remarks : list of str
        Gets what is to be said of it.
    origins: list of float
        Gets where the time is counted from, s.
    """

    channel: Channel
    remarks: list[str]
    origins: list[float]
    _origin: int = field(default=0, init=False)
    _started: bool = field(default=False, init=False)

    def seconds(self, column: Any) -> Array:
        """Time in s of the next rows, from their pyarrow column."""
        values = column.to_numpy(zero_copy_only=False)
        if values.size and not self._started:
            self._start(values[0])
        return np.asarray(_since(values, self._origin) * self.channel.factor)

    def _start(self, first: Any) -> None:
        self._started = True
        begin = float(first) * self.channel.factor
        if not EPOCH < abs(begin) < math.inf:
            return
        name = self.channel.column
        if isinstance(first, np.integer):
            self._origin = int(first)
            self.origins[:] = [begin]
            said = f"time counted from the first sample, which has {self._origin} in the column {name!r}"
        else:
            step = float(np.spacing(abs(begin))) * 1e6
            said = (
                f"the times in the column {name!r} count from an epoch and are known to {step:.2g} us only: doubles hold no "
                "more; write them as integers (int64), or counted from the start of the log"
            )
        self.remarks[:] = [said]


def _since(values: NDArray[Any], origin: int) -> Array:
    """Values less the origin: of integers the exact difference, turned into doubles after."""
    rough = values.astype(float) - float(origin)
    if not origin or values.dtype.kind not in "iu":
        return np.asarray(rough)
    if values.dtype.itemsize < 8:
        values = values.astype(np.int64)
    exact = (values - values.dtype.type(origin)).view(np.int64)  # modulo 2^64: right where the difference fits
    return np.where(np.abs(rough) < 2.0**62, exact, rough)
