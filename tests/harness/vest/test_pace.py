"""Ticks are made at their times; deadlines that are missed are counted."""

from __future__ import annotations

import pytest

from harness.vest.pace import Pace

PERIOD = 0.04  # s


class Clock:
    """A clock that goes on by what is slept, and by `oversleep` more."""

    def __init__(self) -> None:
        self.time = 100.0
        self.oversleep = 0.0
        self.slept: list[float] = []

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.time += seconds + self.oversleep


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def pace(clock: Clock) -> Pace:
    return Pace(PERIOD, now=lambda: clock.time, sleep=clock.sleep)


def begin(pace: Pace, clock: Clock, *works: float) -> list[float]:
    """Ticks whose work takes so long; when each began."""
    began = []
    for work in works:
        pace.wait()
        began.append(round(clock.time - 100.0, 9))
        clock.time += work
    return began


def test_the_first_tick_begins_at_once_and_others_a_period_after_each_other(pace: Pace, clock: Clock) -> None:
    assert begin(pace, clock, 0.01, 0.03, 0.0, 0.01) == [0.0, 0.04, 0.08, 0.12]
    assert (pace.ticks, pace.missed, pace.latest, pace.lost) == (4, 0, 0.0, 0.0)
    assert clock.slept == pytest.approx([0.0, 0.03, 0.01, 0.04])


def test_work_of_exactly_a_period_misses_no_deadline(pace: Pace, clock: Clock) -> None:
    clock.time = 0.0
    for _ in range(3):
        pace.wait()
        clock.time = pace.ticks * PERIOD

    assert pace.missed == 0


def test_a_tick_that_is_late_by_less_than_a_period_is_made_up_for(pace: Pace, clock: Clock) -> None:
    assert begin(pace, clock, 0.05, 0.01, 0.0) == [0.0, 0.05, 0.08]
    assert pace.missed == 1
    assert pace.latest == pytest.approx(0.01)
    assert pace.lost == 0.0


def test_time_is_left_out_where_a_tick_is_late_by_a_period_or_more(pace: Pace, clock: Clock) -> None:
    assert begin(pace, clock, 3.04, 0.0, 0.0) == [0.0, 3.04, 3.08]
    assert pace.missed == 1
    assert pace.latest == pytest.approx(3.0)
    assert pace.lost == pytest.approx(3.0)

    clock.time += 1.04  # and once more

    assert begin(pace, clock, 0.0) == [4.12]
    assert pace.lost == pytest.approx(4.0)
    assert pace.latest == pytest.approx(3.0)


def test_a_sleep_that_is_too_long_by_exactly_a_period_is_left_out(pace: Pace, clock: Clock) -> None:
    clock.time, clock.oversleep = 0.0, PERIOD

    pace.wait()
    assert (pace.missed, pace.lost) == (1, PERIOD)

    clock.oversleep = 0.0
    pace.wait()
    assert clock.time == 2 * PERIOD
    assert (pace.missed, pace.lost) == (1, PERIOD)


def test_a_sleep_that_is_too_long_misses_the_deadline_from_a_period_on(pace: Pace, clock: Clock) -> None:
    pace.wait()
    clock.oversleep = 0.039
    pace.wait()
    assert (pace.missed, pace.lost) == (0, 0.0)

    clock.oversleep = 0.041
    pace.wait()

    assert pace.missed == 1
    assert pace.lost == pytest.approx(0.041)
    assert pace.latest == pytest.approx(0.041)
