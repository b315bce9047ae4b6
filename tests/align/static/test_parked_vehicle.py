"""The public laser-gyro log of a parked vehicle (PSINS data set), aligned where it stands."""

from __future__ import annotations

import numpy as np
import pytest
from swaying_case import DEGREE, HOUR, UG

from sagnac.align import static
from sagnac.errors import DataError


def public_place():
    return static.place_of(34.246048 * DEGREE, 108.909664 * DEGREE, 380.0)


@pytest.fixture(scope="module")
def laser(parked_log):
    return static.align(parked_log, public_place(), stop=300.0)


def test_public_recording_agrees_with_three_other_alignments(laser):
    """Another toolbox's three, by inertial frame, Wahba and Kalman filter: pitch, roll, heading in deg."""
    others = np.array([[0.80392, 0.31037, 90.57699], [0.80378, 0.31041, 90.58097], [0.80353, 0.31033, 90.58210]])
    found = np.degrees([laser[n].value for n in ("pitch", "roll", "heading")])
    assert np.abs(found - others)[:, :2].max() * 60 < 0.5
    assert np.abs(found - others)[:, 2].max() * 60 < 2.0
    assert laser.time == 300.0


def test_public_recording_shows_biases_of_a_good_unit(laser):
    for axis in "xyz":
        assert abs(laser[f"gyro.bias.{axis}"].value) < 3 * 0.01 * HOUR
        assert abs(laser[f"accel.bias.{axis}"].value) < 3 * 50 * UG
    assert np.degrees(laser["heading"].standard_uncertainty) * 60 == pytest.approx(2.9, abs=0.3)


def test_public_recording_has_one_answer(parked_log):
    """Halves of the time agree within what they say of themselves; biases and the vehicle's tilt are the same in both."""
    parts = [static.align(parked_log, public_place(), start=a, stop=b) for a, b in ((0.0, 300.0), (150.0, 300.0))]
    first, second = (np.array([p[n].value for n in ("heading", "pitch", "roll")]) for p in parts)
    assert np.abs(first - second)[0] < 2 * parts[1]["heading"].standard_uncertainty
    assert np.degrees(np.abs(first - second)[1:]).max() * 60 < 0.3


def test_means_of_a_vehicle_with_people_in_it_show_no_north(parked_log):
    with pytest.raises(DataError, match="since the unit sways"):
        static.align(parked_log, public_place(), stop=300.0, method="gyrocompass")
