"""What is said while a campaign runs."""

from __future__ import annotations

import io
import math

import pytest

from sagnac.campaign import progress
from sagnac.campaign.progress import Pace, telling


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def paced(*seen: tuple[float, int]) -> Pace:
    now = [0.0]
    pace = Pace(lambda: now[0])
    for time, done in seen:
        now[0] = time
        pace.update(done)
    return pace


def test_what_was_there_at_the_start_is_no_speed():
    assert paced((0.0, 5000), (10.0, 6000)).rate == pytest.approx(100.0)


def test_the_rate_is_that_of_the_last_half_minute():
    steps = [(float(t), 10 * t) for t in range(100)] + [(100.0 + t, 1000 + 50 * t) for t in range(60)]
    assert paced(*steps).rate == pytest.approx(50.0)


@pytest.mark.parametrize("seen", [(), ((0.0, 0),), ((0.0, 7), (5.0, 7))])
def test_before_anything_is_done_no_rate_is_told(seen):
    pace = paced(*seen)
    assert math.isnan(pace.rate)
    assert pace.told(7, 100) == ""


@pytest.mark.parametrize(
    ("done", "runs", "words"),
    [
        (100, 200, "10 runs/s, 10 s to go"),
        (100, 101, "10 runs/s, 1 s to go"),
        (100, 1600, "10 runs/s, 3 min to go"),
        (100, 100_000, "10 runs/s, 2 h 47 min to go"),
        (100, 10_000_000, "10 runs/s, 11.6 days to go"),
        (100, 100, "10 runs/s"),
    ],
)
def test_the_remaining_time_in_words(done, runs, words):
    assert paced((0.0, 0), (10.0, 100)).told(done, runs) == words


def test_memory_of_the_rate_is_bounded():
    assert len(paced(*[(1e-6 * i, i) for i in range(10_000)])._seen) <= 4096


def test_without_a_terminal_there_are_lines(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    out = io.StringIO()
    with telling("norm.toml", out) as watch:
        for second in range(25):
            now[0] = float(second)
            watch.progress(4 * second, 100)
        watch.note("a worker was lost")
    assert out.getvalue().splitlines() == [
        "norm.toml: 40 of 100 runs, 4 runs/s, 15 s to go",
        "norm.toml: 80 of 100 runs, 4 runs/s, 5 s to go",
        "a worker was lost",
        "norm.toml: 96 of 100 runs, 4 runs/s, 1 s to go",
    ]


def test_on_a_terminal_there_is_a_bar(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    out = Terminal()
    with telling("[norm].toml", out) as watch:
        watch.progress(0, 100)
        watch.note("a [worker] was lost")
        watch.progress(100, 100)
    said = out.getvalue()
    assert "[norm].toml" in said
    assert "a [worker] was lost" in said
    assert "100/100" in said
