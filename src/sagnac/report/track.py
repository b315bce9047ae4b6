"""Pictures of a track: how far it drifts from its start, and where it goes on a plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import formats
from ..errors import InputError
from ..frames import Array
from ..navigate.free import displacement
from .style import BLUE, GREEN, GREY, ORANGE, blank, clean, in_family, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = (BLUE, ORANGE, GREEN, GREY)
_DRAWN = 5000
_COLUMNS = ("time [s]", "latitude [deg]", "longitude [deg]", "height [m]")


@dataclass(frozen=True)
class Track:
    """A track on the plane of its start.

    Attributes
    ----------
    label : str
    time : ndarray, shape (n,), s
        From the start.
    east, north : ndarray, shape (n,), m
    """

    label: str
    time: Array
    east: Array
    north: Array

    @property
    def distance(self) -> Array:
        """Horizontal distance from the start, shape (n,), m."""
        return np.hypot(self.east, self.north)


def read_track(path: str | Path, label: str = "") -> Track:
    """Read a track, at most some thousand of its rows.

    Raises
    ------
    InputError
        When the file is no track.
    """
    table = formats.open_table(path)
    missing = [c for c in _COLUMNS if c not in table.columns]
    if missing:
        raise InputError(f"{path}: no track: it lacks the columns {', '.join(missing)}")
    pieces = [
        np.column_stack([piece.column(i).to_numpy(zero_copy_only=False) for i in range(len(_COLUMNS))])
        for piece in table.read(_COLUMNS, ())
    ]
    rows = np.concatenate(pieces) if pieces else np.empty((0, len(_COLUMNS)))
    if len(rows) < 2:
        raise InputError(f"{path}: a track of {len(rows)} rows cannot be drawn")
    chosen = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), _DRAWN)).round().astype(int))
    time, latitude, longitude, height = rows[chosen].T
    latitude, longitude = np.radians(latitude), np.radians(longitude)
    east, north = displacement(latitude, longitude, float(latitude[0]), float(longitude[0]), float(height[0]))
    return Track(label, time - time[0], east, north)


@in_family
def track_figure(tracks: Sequence[Track], marks: Mapping[str, tuple[Array, Array]] | None = None) -> Figure:
    """Distance from the start over time, and the tracks on a plane.

    Parameters
    ----------
    tracks : sequence of Track
    marks : mapping of label to (time, distance), optional
        Further distances to compare with, arrays of shape (m,), s and m.
    """
    figure = blank(10.0, 4.4)
    left, right = figure.subplots(1, 2, width_ratios=[1.2, 1.0])
    for track, colour in zip(tracks, _COLOURS, strict=False):
        left.plot(track.time, track.distance, color=colour, lw=1.4, label=track.label)
        right.plot(track.east, track.north, color=colour, lw=1.4, label=track.label)
        right.plot(track.east[-1], track.north[-1], "o", color=colour, ms=5)
    for label, (time, distance) in (marks or {}).items():
        left.plot(time, distance, "o", mfc="white", mec=GREY, ms=6, label=label)
    left.set_xlabel("time from the start [s]")
    left.set_ylabel("horizontal distance from the start [m]")
    left.set_xlim(left=0.0)
    left.set_ylim(bottom=0.0)
    if len(tracks) + len(marks or {}) > 1:
        left.legend(fontsize=8, frameon=False, loc="upper left")
    right.plot(0.0, 0.0, "+", color="black", ms=10, zorder=5)
    right.set_xlabel("east [m]")
    right.set_ylabel("north [m]")
    right.set_aspect("equal", adjustable="datalim")
    right.set_title("+ start, dot end", fontsize=9, loc="left")
    for axes in (left, right):
        clean(axes)
    return figure


def draw_track(track: str | Path, out: str | Path) -> None:
    """Draw the track of a file to a PNG, SVG or PDF file."""
    save(track_figure([read_track(track)]), out)
