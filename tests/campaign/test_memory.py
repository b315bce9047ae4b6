"""Recordings of simulated runs in memory."""

from __future__ import annotations

import numpy as np
import pytest
from campaign_tables import SMALL, norm

from sagnac.campaign import spec
from sagnac.campaign.tasks.memory import recording_of
from sagnac.recording import SENSORS, sample_interval
from sagnac.simulate import engine
from sagnac.simulate.build import build


@pytest.mark.parametrize("scale", [{}, {"gyro": "1 pulse/arcsec"}])
@pytest.mark.parametrize("sensors", [["accel", "gyro"], "accel"])
def test_a_recording_is_its_pieces_put_together(sensors, scale, monkeypatch):
    more = {"recording.sensors": sensors, "unit.scale": scale if sensors != "accel" else {}}
    scenario = spec.scenario(spec.from_table(norm(set={**SMALL, **more})).points[0])
    built = build(scenario, 3)
    pieces = list(engine.stream(built.job, threads=1, piece=50))
    assert len(pieces) > 3
    monkeypatch.setattr("sagnac.campaign.tasks.memory.stream", lambda job, threads: iter(pieces))
    (batch,) = recording_of(built, scenario.plan).batches()
    time = np.concatenate([p.time for p in pieces])
    assert np.array_equal(batch.time, time)
    worth = {c.name: c.worth for c in built.job.channels}
    for sensor in [sensors] if isinstance(sensors, str) else sensors:
        raw = [np.concatenate([p.sensors[a] for p in pieces]) for a in SENSORS[sensor]]
        by = [worth[a] / sample_interval(time) if worth[a] else 1.0 for a in SENSORS[sensor]]
        assert np.array_equal(getattr(batch, sensor), np.column_stack([v * w for v, w in zip(raw, by, strict=True)]))
