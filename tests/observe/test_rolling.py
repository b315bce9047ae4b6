"""Windows over a recording: every sample once, whatever the pieces; local quadratics and integrals against polynomials."""

import numpy as np
import pytest

from sagnac.errors import DataError, InputError
from sagnac.observe.rolling import (
    half_width,
    interval_of,
    local_polynomial,
    need_rates,
    polynomial_taps,
    step_integrals,
    windows,
    wrapped,
)
from sagnac.plan import Segment
from sagnac.recording import Batch, Recording, from_arrays

DT = 0.01


def in_pieces(time, gyro, encoder, sizes):
    """A recording that comes in pieces of given sizes, over and over."""

    def stream(_):
        at, k = 0, 0
        while at < time.size:
            stop = min(at + sizes[k % len(sizes)], time.size)
            yield Batch(at + 1, time[at:stop], None, gyro[at:stop], {"encoder": encoder[at:stop]})
            at, k = stop, k + 1

    return Recording("log", None, frozenset(), frozenset({"gyro"}), frozenset(), (), {}, stream)


def log(count=1000):
    time = np.arange(1, count + 1) * DT
    return time, np.stack([np.sin(time), np.cos(time), time], axis=1), np.mod(7 * time, 2 * np.pi)


SEGMENTS = [
    Segment(name="a", start=1.0, stop=4.0, stage="inner", inner_rate=1.0),
    Segment(name="b", start=4.0, stop=9.0, stage="spin", spin_rate=1.0),
]


@pytest.mark.parametrize("sizes", [(1000,), (1, 2, 3), (7,), (300, 5), (11, 90)])
@pytest.mark.parametrize("half", [2, 5])
def test_every_sample_is_dealt_with_once_with_its_neighbours(sizes, half):
    time, gyro, encoder = log()
    dealt, fresh = {0: [], 1: []}, []
    for w in windows(in_pieces(time, gyro, encoder, sizes), SEGMENTS, DT, half):
        centre = w.time[w.centre]
        dealt[w.segment] += list(centre)
        fresh.append((w.segment, w.fresh))
        first = w.row - 1
        np.testing.assert_array_equal(w.time, time[first : first + w.time.size])
        np.testing.assert_array_equal(w.gyro, gyro[first : first + w.time.size])
        np.testing.assert_array_equal(w.encoder, encoder[first : first + w.time.size])
        assert centre.size == w.time.size - 2 * half > 0
    for k, s in enumerate(SEGMENTS):
        i, j = np.searchsorted(time, [s.start, s.stop])
        np.testing.assert_array_equal(dealt[k], time[i + half : j - half])
        assert [f for seg, f in fresh if seg == k].count(True) == 1
        assert next(f for seg, f in fresh if seg == k)


@pytest.mark.parametrize("sizes", [(1000,), (13,)])
def test_a_gap_begins_a_new_run(sizes):
    time, gyro, encoder = log()
    keep = (time < 6.0) | (time > 6.2)
    time, gyro, encoder = time[keep], gyro[keep], encoder[keep]
    found = [w for w in windows(in_pieces(time, gyro, encoder, sizes), SEGMENTS, DT, 3) if w.segment == 1]
    assert [w.fresh for w in found].count(True) == 2
    for w in found:
        assert np.diff(w.time).max() < 1.5 * DT
    dealt = np.concatenate([w.time[w.centre] for w in found])
    i, j, k = np.searchsorted(time, [4.0, 6.1, 9.0])
    np.testing.assert_array_equal(dealt, np.concatenate([time[i + 3 : j - 3], time[j + 3 : k - 3]]))


def test_a_stretch_too_short_for_neighbours_gives_nothing():
    time, gyro, encoder = log(8)
    segment = [SEGMENTS[0].model_copy(update={"start": 0.0, "stop": 1.0})]
    assert not list(windows(in_pieces(time, gyro, encoder, (3,)), segment, DT, 4))


def test_local_quadratics_are_exact_on_quadratics():
    t = np.arange(60) * DT
    out = local_polynomial(2.0 - 3.0 * t + 5.0 * t**2, polynomial_taps(4, DT))
    inside = t[4:-4]
    np.testing.assert_allclose(out[0], 2 - 3 * inside + 5 * inside**2, rtol=1e-12)
    np.testing.assert_allclose(out[1], -3 + 10 * inside, atol=1e-10)
    np.testing.assert_allclose(out[2], 5.0, rtol=1e-8)


def test_local_quadratics_average_noise():
    """Value weights of the quadratic over 2h + 1 samples: variance (3 (3h^2 + 3h - 1)) / ((2h - 1)(2h + 1)(2h + 3))."""
    h = 6
    weights = polynomial_taps(h, DT)[0]
    expected = 3 * (3 * h * h + 3 * h - 1) / ((2 * h - 1) * (2 * h + 1) * (2 * h + 3))
    assert weights @ weights == pytest.approx(expected, rel=1e-12)


def test_step_integrals_are_exact_on_cubics():
    t = np.arange(30) * DT
    values = np.stack([t**3, 1 - t], axis=1)
    out = step_integrals(t, values, 3)
    a, b = t[2:-4], t[3:-3]
    np.testing.assert_allclose(out[:, 0], (b**4 - a**4) / 4, rtol=1e-9)
    np.testing.assert_allclose(out[:, 1], (b - a) - (b**2 - a**2) / 2, rtol=1e-12)


def test_step_integrals_of_a_swing():
    """1.7 Hz at 100 Hz: relative error (11/720) (w dt)^4 = 2e-6, where the trapezoid has (w dt)^2 / 12 = 1e-3."""
    w = 2 * np.pi * 1.7
    t = np.arange(1000) * DT
    out = step_integrals(t, np.cos(w * t), 2)
    error = out - (np.sin(w * t[2:-2]) - np.sin(w * t[1:-3])) / w
    assert np.abs(error).max() < 3e-6 * DT


def test_neighbours_reach_a_fortieth_of_a_second():
    assert [half_width(dt) for dt in (1e-3, 5e-3, 1e-2, 0.1)] == [25, 5, 3, 2]


def test_wrapped_angles():
    np.testing.assert_allclose(wrapped(np.array([3.5, -3.5, 9 * np.pi + 0.1, 0.2])),
                               [3.5 - 2 * np.pi, 2 * np.pi - 3.5, 0.1 - np.pi, 0.2], atol=1e-12)  # fmt: skip


def test_what_is_no_sampled_rate_is_refused():
    time, gyro, _ = log()
    with pytest.raises(InputError, match=r"gyro_x, gyro_y, gyro_z"):
        need_rates(from_arrays(time, accel=gyro))
    with pytest.raises(InputError, match="raw counts"):
        need_rates(from_arrays(time, gyro=gyro, counts=("gyro",)))
    summed = Recording("log", None, frozenset(), frozenset({"gyro"}), frozenset({"gyro"}), (), {}, lambda _: iter(()))
    with pytest.raises(InputError, match="pulses"):
        need_rates(summed)


def test_interval_of_a_recording():
    time, gyro, encoder = log()
    assert interval_of(in_pieces(time, gyro, encoder, (50,))) == pytest.approx(DT)
    with pytest.raises(DataError, match="too few samples"):
        interval_of(from_arrays(time[:1], gyro=gyro[:1]))
