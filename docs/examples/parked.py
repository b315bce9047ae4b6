"""Align and navigate the public log of a laser-gyro unit in a parked vehicle, and draw its drift.

Run as ``python docs/examples/parked.py laser_gyro_parked.parquet docs/images/parked-drift.png``. The log is that of the PSINS
toolbox, in pulses (docs/methods/static_alignment.md).
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from sagnac.align.start import biases_of, state_of
from sagnac.align.static import align, place_of
from sagnac.navigate.free import navigate
from sagnac.recording import open_recording
from sagnac.report.plots import save
from sagnac.report.track import read_track, track_figure

PULSES = {"gyro": "10 pulse/arcsec", "accel": "817.996 pulse/(m/s)"}
PLACE = place_of(np.radians(34.246048), np.radians(108.909664), 380.0)
ANOTHER = (np.array([300.0, 600.0, 900.0, 1547.0]), np.array([7.1, 35.2, 90.2, 312.4]))
"""Time and drift of another toolbox on the same log, s and m."""


def main(log: str, picture: str) -> None:
    """Draw the drift with and without the biases that the alignment found."""
    recording = open_recording(log, scale=PULSES)
    found = align(recording, PLACE, stop=300.0)
    start = state_of(found)
    gyro, accel = biases_of(found)
    biases = {"gyro_bias": gyro, "accel_bias": accel}
    tracks = []
    with tempfile.TemporaryDirectory() as folder:
        for label, taken_off in (("aligned attitude", {}), ("and its biases taken off", biases)):
            out = Path(folder) / "track.parquet"
            navigate(recording, start, out, begin=found.time, **taken_off)
            tracks.append(read_track(out, label))
    save(track_figure(tracks, {"another toolbox": ANOTHER}), picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
