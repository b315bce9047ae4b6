"""All rows of a table, in arrays."""

from __future__ import annotations

import numpy as np

from sagnac.formats import Fault

AXES = tuple(f"{k}_{a} [{u}]" for k, u in (("accel", "m/s^2"), ("gyro", "rad/s")) for a in "xyz")


def rows(table, names=("time [s]", *AXES)):
    """Rows until the end or the fault, and the fault."""
    parts = [np.zeros((0, len(names)))]
    try:
        for batch in table.read(names, []):
            parts += [np.column_stack([batch.column(n).to_numpy() for n in names])]
    except Fault as fault:
        return np.concatenate(parts), fault
    return np.concatenate(parts), None
