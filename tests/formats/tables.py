"""All rows of a table, in arrays."""

from __future__ import annotations

import numpy as np

from sagnac.errors import InputError
from sagnac.formats import Fault, open_table

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


def survives(path):
    """Whatever a file holds is read, or refused as an input."""
    try:
        table = open_table(path)
        for batch in table.read(table.columns, []):
            assert batch.num_rows
    except InputError:  # a Fault is one
        pass
