"""imu_tk: ``T``, ``K`` and ``B`` of ``X' = T K (X - B)``, a ``.calib`` file a triad (``include/imu_tk/calibration.h``).

``CalibratedTriad_::load`` reads 21 numbers, T and K row by row and B, and stops: what follows in the file is a comment. It keeps
all nine entries of T, so that a full matrix is held.
"""

from __future__ import annotations

import numpy as np

from ..frames import Array
from .canonical import Canonical, Linear
from .loss import Held, lost
from .record import Exported, Options
from .wording import comments, encoded, header, real, spread

_TAGS = {"accel": "_acc", "gyro": "_gyro"}


def build(canonical: Canonical, options: Options) -> Exported:  # noqa: ARG001 - every builder takes the options
    """One file for each triad."""
    held = {k: Held(t.matrix, t.matrix @ t.bias, np.zeros((3, 3))) for k, t in canonical.triads.items()}
    dropped = lost(canonical.triads, held)
    remarks = []
    if "accel" in canonical.triads and np.any(np.tril(_numbers(canonical.triads["accel"])[:3], -1)):
        remarks.append(
            "T of the accelerometers is not upper triangular, as imu_tk's own are: it applies such a T, but a new fit that "
            "starts from it drops what stands below the diagonal"
        )
    files = {_TAGS[kind]: _file(canonical, kind, header(canonical, dropped, remarks)) for kind in canonical.triads}
    return Exported(files, dropped, tuple(remarks))


def _file(canonical: Canonical, kind: str, about: list[str]) -> bytes:
    numbers = _numbers(canonical.triads[kind])
    sigma = canonical.uncertainty(lambda triads: _numbers(triads[kind]))
    lines = []
    for part in (numbers[:3], numbers[3:6], numbers[6:].T):
        lines += [" ".join(real(v) for v in line) for line in part] + [""]
    unit = "count" if canonical.triads[kind].counts else "SI"
    lines += comments(
        [
            f"{kind}: T, K, B of X' = T K (X - B), X in {unit}, X' in SI",
            *about,
            f"Standard uncertainties of T: {spread(sigma[:3])}",
            f"of K: {spread(np.diag(sigma[3:6]))}",
            f"of B: {spread(sigma[6])}",
        ]
    )
    return encoded(lines)


def _numbers(triad: Linear) -> Array:
    """T, K and the row B, shape (7, 3)."""
    K = np.diag(triad.matrix)
    return np.vstack([triad.matrix / K, np.diag(K), triad.bias])
