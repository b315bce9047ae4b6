"""Pictures of noise tests: every axis, its terms and its spectrum are there, and can be read."""

from __future__ import annotations

import numpy as np
import pytest

from sagnac.noise.expected import Expected, needs
from sagnac.noise.study import study
from sagnac.recording import from_arrays
from sagnac.report.noise import needs_figure, noise_figure
from sagnac.report.style import save
from sagnac.simulate.noise import AxisNoise, NoiseModel

DT = 0.01


def log(n=40_000):
    model = NoiseModel(density=1e-5, walk=4e-6)
    gyro = np.zeros((n, 3))
    for k in range(3):
        column = np.zeros(n)
        AxisNoise(model, DT, 5, (k,)).add(column)
        gyro[:, k] = column
    return DT * np.arange(n), gyro


@pytest.fixture(scope="module")
def found():
    time, gyro = log()
    gyro[:, 2] += 1e-4 * np.sin(2 * np.pi * 7.0 * time)
    accel = 1e-3 * np.random.default_rng(1).normal(size=gyro.shape) + [0, 0, 9.8]
    return study(from_arrays(time, accel, gyro), despite=["line", "misfit"])


def texts(axes):
    return [t.get_text() for t in axes.texts]


def test_a_row_a_sensor_deviation_and_spectrum(found):
    figure = noise_figure(found)
    assert len(figure.axes) == 4
    left, right = figure.axes[2], figure.axes[3]
    assert left.get_ylabel() == "Allan deviation [deg/h]"
    assert right.get_ylabel() == "root of two-sided density [deg/h/√Hz]"
    assert [t.get_text() for t in left.get_legend().get_texts()] == ["gyro_x", "gyro_y", "gyro_z"]
    assert {"N", "K"} <= set(texts(left))
    assert "7 Hz" in texts(right)
    markers = {line.get_marker() for line in left.lines} - {"None", ""}
    assert len(markers) == 3  # told apart without colour


def test_marks_are_the_deviations_and_the_line_goes_through_them(found):
    left = noise_figure(found).axes[2]
    marks = next(line for line in left.lines if line.get_label() == "gyro_x")
    curve = found["gyro_x"].curve
    assert np.allclose(marks.get_ydata(), np.degrees(curve.deviation) * 3600, rtol=1e-9)
    fitted = np.interp(curve.tau, *left.lines[left.lines.index(marks) + 1].get_data())
    assert np.allclose(fitted[:10], np.degrees(curve.fitted)[:10] * 3600, rtol=0.03)


def test_one_axis_in_counts_and_a_log_too_short_for_a_spectrum(tmp_path):
    n = 200
    single = {"accel_z": 30_000 + np.random.default_rng(2).normal(0, 5, n)}
    one = study(from_arrays(DT * np.arange(n), single=single, counts=("accel",)))
    figure = noise_figure(one)
    assert len(figure.axes) == 2
    assert figure.axes[0].get_ylabel() == "Allan deviation [count]"
    assert "the log is too short" in texts(figure.axes[1])
    save(figure, tmp_path / "one.png")


@pytest.mark.parametrize("kind", ["modified", "hadamard"])
def test_other_deviations_say_so(kind):
    time, gyro = log(20_000)
    figure = noise_figure(study(from_arrays(time, gyro=gyro), kind=kind))
    assert figure.axes[0].get_ylabel().startswith({"modified": "Modified Allan", "hadamard": "Hadamard"}[kind])


def test_refused_axes_are_named():
    time, gyro = log()
    gyro[20_000:, 1] += 3e-4
    figure = noise_figure(study(from_arrays(time, gyro=gyro)))
    assert "gyro_y refused" in figure.axes[0].get_title(loc="left")


def test_the_bound_against_the_length_of_the_record():
    figure = needs_figure(needs([Expected("gyro", {"white": 6e-5, "instability": 2.4e-5})], DT))
    axes = figure.axes[0]
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["N", "B"]
    white = next(line for line in axes.lines if line.get_label() == "N")
    # of white noise alone the uncertainty falls with the root of the length: ten times as long, 3.2 times as well
    x, y = white.get_data()
    slope = np.polyfit(np.log(x[3:12]), np.log(np.asarray(y)[3:12]), 1)[0]
    assert slope == pytest.approx(-0.5, abs=0.02)
