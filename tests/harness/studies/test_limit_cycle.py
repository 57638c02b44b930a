"""The heading's limit cycle: relays whose cycles are known, and the simulated controller."""

from __future__ import annotations

import math

import pytest

from harness.studies.limit_cycle import (
    RATE,
    TURN_END,
    Loop,
    _cycle,
    by_events,
    describing_function,
    drifting,
    exact_relay,
)
from models.kit.timing import TICK
from models.kit.units import DEG


@pytest.fixture(scope="module")
def loop() -> Loop:
    return Loop()


def test_the_describing_function_errs_by_what_a_triangle_is_not_a_sine() -> None:
    # given a hysteresis of 0.1, a delay of 1 s and a rate of 1: 0.1 pi w / 4 = cos w has w = 1.4562,
    # and the amplitude is 4 / (pi w); the triangle itself reaches 0.1 + 1
    assert describing_function(0.1, 1.0, rate=1.0) == pytest.approx((0.8743, 4.3148), rel=1e-3)
    assert exact_relay(0.1, 1.0, rate=1.0) == pytest.approx((1.1, 4.4))


def test_the_describing_function_with_hysteresis_solves_its_equation() -> None:
    # N(A) G = -1 for G = exp(-s delay) / s: A = 4 rate / (pi w), threshold / A = cos(w delay)
    threshold, delay = 0.5, 0.6
    cycle = describing_function(threshold, delay, rate=1.0)
    assert cycle is not None
    w = 2 * math.pi / cycle[1]
    assert cycle[0] == pytest.approx(4 / (math.pi * w), rel=2e-3)
    assert threshold / cycle[0] == pytest.approx(math.cos(w * delay), abs=2e-3)


@pytest.mark.parametrize(("threshold", "delay"), [(23, 0.4), (37, 0.8), (49, 1.2)])
def test_a_dog_that_answers_late_swings_as_its_events_say(loop: Loop, threshold: float, delay: float) -> None:
    foreseen, simulated = by_events(threshold * DEG, delay), _cycle(loop.late(threshold * DEG, delay))
    assert foreseen is not None
    assert simulated is not None
    assert simulated[0] == pytest.approx(foreseen[0], abs=1e-6)
    assert simulated[1] == pytest.approx(foreseen[1], abs=TICK)
    # the relay alone knows neither the pause of 1.5 s on either side nor, by a tick, the amplitude
    amplitude, period = exact_relay(threshold * DEG, delay)
    assert simulated[0] == pytest.approx(amplitude, abs=1.5 * RATE * TICK)
    assert simulated[1] - period == pytest.approx(2 * 1.5, abs=4 * TICK)


@pytest.mark.parametrize(("threshold", "delay"), [(23, 0.2), (49, 0.6)])
def test_a_dog_that_obeys_before_it_has_turned_too_far_comes_to_rest(
    loop: Loop, threshold: float, delay: float
) -> None:
    assert RATE * delay < threshold * DEG + TURN_END
    assert by_events(threshold * DEG, delay) is None
    assert _cycle(loop.late(threshold * DEG, delay)) is None
    assert describing_function(threshold * DEG, delay) is not None  # which is where it is wrong


def test_events_and_simulation_agree_where_the_cycle_begins(loop: Loop) -> None:
    # given h' = 37 deg, whose cycle begins near (37 + 5) / 67.8 = 0.62 s, and delays of 13 to 17 ticks
    delays = [ticks * TICK for ticks in range(13, 18)]
    foreseen = [by_events(37 * DEG, delay) is not None for delay in delays]
    assert foreseen == [_cycle(loop.late(37 * DEG, delay)) is not None for delay in delays]
    assert (foreseen[0], foreseen[-1]) == (False, True)


@pytest.mark.parametrize("threshold", [23, 37, 49])
@pytest.mark.parametrize("delay", [0.2, 0.4, 0.6, 0.8, 1.0, 1.2])
def test_periods_exceed_the_relays_by_two_stops_and_ticks(threshold: float, delay: float) -> None:
    # given the delay from which on there is a cycle: h' and 5 deg more at 67.8 deg/s
    critical = (threshold + 5) / 67.8
    cycle = by_events(threshold * DEG, delay)
    assert cycle is not None or delay < critical
    assert cycle is None or delay > critical - TICK
    # then the dog stands for 1.5 s before each of both turns, and each turn takes up to two ticks more
    if cycle is not None:
        _, period = exact_relay(threshold * DEG, delay)
        assert 0 < cycle[1] - period - 2 * 1.5 < 4 * TICK


def test_a_dog_that_drifts_swings_on_one_side(loop: Loop) -> None:
    log = loop.run(49 * DEG)
    simulated = _cycle(log)
    least, greatest, period = drifting(49 * DEG)
    assert simulated is not None
    assert simulated[1] == pytest.approx(period, abs=0.15)
    late = log["heading"][len(log["heading"]) // 2 :]
    assert late.max() == pytest.approx(greatest, abs=0.5 * DEG)
    assert late.min() == pytest.approx(least, abs=0.5 * DEG)
    assert least > 0
