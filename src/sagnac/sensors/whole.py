"""Whether named parameters make up the model of a whole triad, in the right units."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..errors import DataError
from .axis import TERMS, unit_of
from .inverse import Correction
from .triad import AXES, Triad

_LINEAR = ("bias", "scale_error")


def check_whole(units: Mapping[str, str], model: Correction) -> None:
    """Refuse parameters that are not those of a triad: a hand-edited file may lack an axis or carry other units.

    Parameters
    ----------
    units : mapping of str to str
        Unit of each parameter, by name.
    model : Correction
        What has been made of them.

    Raises
    ------
    DataError
        When an axis lacks, a unit is another than it must be, or the matrix cannot be inverted.
    """
    kind = model.kind
    own = {name: unit for name, unit in units.items() if name.startswith(f"{kind}.")}
    covered = {name[-1] for name in own if len(name.rpartition(".")[2]) == 1}
    if covered and covered != set(AXES):
        raise DataError(
            f"the calibration covers {kind} {', '.join(sorted(covered))} only; a triad is compensated as a whole, so all three "
            "axes are needed"
        )
    for term in ("bias", "scale_error", "scale_factor"):
        there = [axis for axis in AXES if f"{kind}.{term}.{axis}" in own]
        if 0 < len(there) < 3:
            raise DataError(
                f"the calibration gives {kind}.{term} of {', '.join(there)} only; all three axes are needed"
            )
    triad = Triad(kind, model.counts, full=True, g_sensitivity=kind == "gyro")
    expected = dict(zip(triad.names, triad.units, strict=True))
    expected |= {f"{kind}.{t}.{a}": unit_of(kind, t) for t in TERMS[kind] for a in AXES if t not in _LINEAR}
    for name, unit in expected.items():
        if name in own and own[name] != unit and (unit != "rad" or own[name] != "1"):
            raise DataError(f"the calibration gives {name} in {own[name]!r}; it must be in {unit!r}")
    if not np.linalg.cond(model.matrix / np.maximum(np.abs(np.diag(model.matrix)), 1e-300)[:, None]) < 1e6:
        raise DataError(f"the {kind} matrix of the calibration cannot be inverted: an axis has no gain")
