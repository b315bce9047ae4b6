"""Recordings on a turning arm whose harmonics are known."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from plain import harmonic_terms, harmonics
from sagnac.plan import Plan, Rig, Segment
from sagnac.recording import Batch, Recording

DT = 1e-3
RATE = 3.0


def plan(*spans: tuple[float, ...]) -> Plan:
    """Segments (start, stop, arm rate, arm phase or nothing)."""
    rows = [
        Segment(name=f"s{i}", start=a, stop=b, arm_rate=w, arm_phase=p[0] if p else None)
        for i, (a, b, w, *p) in enumerate(spans, 1)
    ]
    return Plan(rig=Rig(kind="centrifuge", radius=1.0), segment=tuple(rows))


def wave(angle, axes=3, offset=9.8, size=50.0, seed=5):
    """Some DC and four harmonics on each axis, with the coefficients (axes, 9)."""
    truth = np.random.default_rng(seed).normal(size=(axes, 9)) * np.array(
        [1, *[size, size, 0.3, 0.3, 0.1, 0.1, 0.02, 0.02]]
    )
    truth[:, 0] += offset
    return harmonic_terms(angle, 4) @ truth.T, truth


def noisy(seconds, *, rate=RATE, phase=0.4, start=0.0, sigma=0.01, clock=None, **options):
    """Time, three axes and their coefficients."""
    time = start + np.arange(round(seconds / DT)) * DT if clock is None else clock
    values, truth = wave(phase + rate * (time - start), **options)
    return time, values + sigma * np.random.default_rng(1).normal(size=values.shape), truth


def in_pieces(recording: Recording, cuts: list[int]) -> Recording:
    """The same samples in other batches."""
    (whole,) = recording.batches()
    edges = [0, *sorted({c for c in cuts if 0 < c < whole.time.size}), whole.time.size]

    def stream(_: bool):
        for a, b in pairwise(edges):
            cut = {k: {n: v[a:b] for n, v in getattr(whole, k).items()} for k in ("rig", "single")}
            parts = [None if v is None else v[a:b] for v in (whole.accel, whole.gyro)]
            yield Batch(a + 1, whole.time[a:b], *parts, cut["rig"], single=cut["single"])

    return replace(recording, _stream=stream)


def same(found, i, time, values, angle, order=4, *, extended=False, within=1e-12):
    """Segment i against plain least squares of its samples."""
    tau = time - found.mid_time[i] if extended else None
    coefficient, unit, squares = harmonics(values, angle, order, tau)
    # rounding errors of the normal equations grow with the condition
    least = np.sqrt(np.diag(unit) * len(time))
    size = np.abs(values - values.mean(axis=0)).max(axis=0) + 1e-3 * np.abs(values).max(axis=0)
    exact = within * max(1.0, 1e-2 * found.condition[i])
    assert np.all(np.abs(found.coefficient[i] - coefficient) < exact * size[:, None] * least)
    assert np.all(np.abs(found.unit_covariance[i] - unit) < exact * np.sqrt(np.outer(np.diag(unit), np.diag(unit))))
    dof = len(time) - coefficient.shape[1]
    np.testing.assert_allclose(found.residual_variance[i], squares / dof, rtol=1e-5)
