"""What an ideal unit on an ideal rig would give for a plan: noise-free observations that carry the stated noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..calibrate import common
from ..errors import InputError
from ..observe.means import SegmentMeans
from ..plan import Plan
from ..rigs.turntable import Site, mean_inputs

_INTERVAL = 0.01  # s: any that is short against the turns gives the same means


def need_noise(plan: Plan, sensors: Sequence[str]) -> None:
    """Refuse a plan that does not say how noisy the sensors are.

    Raises
    ------
    InputError
        With the key that is missing.
    """
    for sensor in sensors:
        if not getattr(plan.unit.noise, sensor):
            example = {"accel": "10 ug/sqrt(Hz)", "gyro": "0.01 deg/sqrt(h)"}[sensor]
            raise InputError(
                f"the plan does not state the noise of the {sensor} triad, without which nothing can be predicted: write "
                f'noise = {{ {sensor} = "{example}" }} under [unit]'
            )


def table_means(plan: Plan, sensors: Sequence[str]) -> SegmentMeans:
    """Means of the segments of a turntable's plan.

    Parameters
    ----------
    plan : Plan
    sensors : sequence of str
        ``accel``, ``gyro``.
    """
    hold = np.array([s.stop - s.start for s in plan.segment])
    count = np.maximum(np.round(hold / _INTERVAL), 1).astype(int)
    n = len(hold)
    means = SegmentMeans(
        segments=plan.segment,
        mid_time=np.array([(s.start + s.stop) / 2 for s in plan.segment]),
        interval=hold / count,
        duration=hold,
        count=count,
        mean=dict.fromkeys(sensors, np.zeros((n, 3))),
        density={s: np.full(3, np.nan) for s in sensors},
        noise_degrees_of_freedom=0.0,
        span=(plan.segment[0].start, plan.segment[-1].stop),
    )
    rates = common.rates_of(means)
    latitude = plan.need_latitude("the Earth rate") if "gyro" in sensors else plan.latitude or 0.0
    felt = mean_inputs(
        common.need_angles(means, "a prediction"),
        rates,
        common.left_of(means, rates),
        Site(latitude, plan.site_gravity, plan.earth_rate),
        letters=plan.rig.letters,
        derivatives=False,
    )
    means.mean.update({s: felt.force if s == "accel" else felt.rate for s in sensors})
    return means
