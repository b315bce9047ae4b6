"""OpenVINS: ``kalibr_imu_chain.yaml``.

``ov_msckf/src/core/VioManagerOptions.h`` reads it and inverts Tw and Ta, ``ov_msckf/src/state/Propagator.cpp`` corrects ::

    a = R_ACCtoIMU Da (a_m - b_a),    w = R_GYROtoIMU Dw (w_m - b_w - Tg a)

with Dw = Tw^-1 and Da = Ta^-1 lower triangular (model kalibr) or upper triangular (model rpng). The biases are states of
the filter.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..frames import Array
from . import factors, noise
from .canonical import Canonical, Linear
from .kalibr import noise_lines
from .loss import Held, lost
from .record import Exported, Options
from .wording import comments, encoded, header, real, row, spread

_Split = Callable[[Array], tuple[Array, Array]]


class _Chain(NamedTuple):
    """Matrices of the file, each shape (3, 3)."""

    Tw: Array
    R_IMUtoGYRO: Array
    Ta: Array
    R_IMUtoACC: Array
    Tg: Array


def kalibr_model(canonical: Canonical, options: Options) -> Exported:
    """The chain for ``model: kalibr``."""
    return _build(canonical, options, "kalibr", factors.rotation_times_lower)


def rpng_model(canonical: Canonical, options: Options) -> Exported:
    """The chain for ``model: rpng``."""
    return _build(canonical, options, "rpng", factors.rotation_times_upper)


def _build(canonical: Canonical, options: Options, model: str, split: _Split) -> Exported:
    if len(canonical.triads) < 2:
        raise InputError("OpenVINS takes accelerometers and gyros together; this calibration has one of them")
    numbers, rate = noise.complete(canonical, options)
    chain = _chain(canonical.triads, split)
    sigma = _Chain(*canonical.uncertainty(lambda triads: np.stack(_chain(triads, split))))
    held = {k: Held(t.matrix, np.zeros(3), t.matrix @ t.g_matrix) for k, t in canonical.triads.items()}
    dropped = lost(canonical.triads, held)
    remarks = [
        "OpenVINS estimates the biases itself; estimator_config.yaml can start it from init_dyn_bias_g and init_dyn_bias_a"
    ]
    start = [
        f"init_dyn_bias_{kind[0]}: {row(t.bias)}, standard uncertainties "
        f"{spread(canonical.uncertainty(lambda triads, k=kind: triads[k].bias))}"  # type: ignore[misc]
        for kind, t in canonical.triads.items()
    ]
    lines = ["%YAML:1.0", *comments(header(canonical, dropped, [*remarks, *start])), "imu0:", "  T_i_b:"]
    lines += [f"    - {row(line)}" for line in np.eye(4)]
    lines += noise_lines(numbers, "  ")
    lines += [
        f"  rostopic: {options.topic}",
        "  time_offset: 0.0",
        f"  update_rate: {real(rate)}",
        f'  model: "{model}"',
    ]
    for name, values, u in zip(_Chain._fields, chain, sigma, strict=True):
        lines += [f"  # standard uncertainties: {spread(u)}", f"  {name}:", *(f"    - {row(line)}" for line in values)]
    return Exported({"": encoded(lines)}, dropped, tuple(remarks))


def _chain(triads: dict[str, Linear], split: _Split) -> _Chain:
    R_gyro, Dw = split(triads["gyro"].matrix)
    R_acc, Da = split(triads["accel"].matrix)
    Tw, Ta = (np.asarray(np.linalg.inv(D)) for D in (Dw, Da))
    return _Chain(Tw, R_gyro.T, Ta, R_acc.T, triads["gyro"].g_matrix)
