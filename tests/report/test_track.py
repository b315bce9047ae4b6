"""Pictures of a track."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from sagnac.errors import InputError
from sagnac.report.track import Track, draw_track, read_track, track_figure


def track_file(tmp_path, rows=9000):
    """A course to the north-east over the date line, 1e-5 deg a row each way."""
    k = np.arange(rows)
    columns = {
        "time [s]": 300.0 + k,
        "latitude [deg]": 1e-5 * k,
        "longitude [deg]": (179.99 + 1e-5 * k + 180) % 360 - 180,
        "height [m]": np.full(rows, 10.0),
    }
    path = tmp_path / "track.parquet"
    parquet.write_table(pa.table(columns), path)
    return path


def test_track_is_read_thinned_on_the_plane_of_its_start(tmp_path):
    track = read_track(track_file(tmp_path), "a track")
    assert track.label == "a track"
    assert 4000 < track.time.size <= 5000
    assert (track.time[0], track.time[-1]) == (0.0, 8999.0)
    assert (track.east[0], track.north[0]) == (0.0, 0.0)
    # at the equator: a = 6378137 m along it, a (1 - e^2) = 6335439 m across it
    assert track.east[-1] == pytest.approx(np.radians(0.08999) * 6378147, rel=1e-6)
    assert track.north[-1] == pytest.approx(np.radians(0.08999) * 6335449, rel=1e-5)
    assert track.distance[-1] == pytest.approx(np.hypot(track.east[-1], track.north[-1]))


def test_other_files_are_no_tracks(tmp_path):
    path = tmp_path / "other.parquet"
    parquet.write_table(pa.table({"time [s]": [0.0, 1.0]}), path)
    with pytest.raises(InputError, match=r"lacks the columns latitude \[deg\], longitude \[deg\], height \[m\]"):
        read_track(path)
    with pytest.raises(InputError, match="1 rows cannot be drawn"):
        read_track(track_file(tmp_path, 1))


def test_figure_shows_distance_and_plane():
    t = np.linspace(0, 100, 50)
    tracks = [Track("one", t, t, 2 * t), Track("two", t, -t, t)]
    figure = track_figure(tracks, {"another": (np.array([50.0]), np.array([100.0]))})
    left, right = figure.axes
    assert [line.get_label() for line in left.lines] == ["one", "two", "another"]
    assert np.array_equal(left.lines[0].get_ydata(), tracks[0].distance)
    assert np.array_equal(right.lines[0].get_xdata(), t)
    assert right.get_aspect() == 1.0
    assert left.get_legend() is not None
    assert track_figure(tracks[:1]).axes[0].get_legend() is None


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_drawn_to_a_file(tmp_path, kind):
    out = tmp_path / f"track.{kind}"
    draw_track(track_file(tmp_path), out)
    assert out.stat().st_size > 3000
