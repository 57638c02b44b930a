"""The polygon of a mission (rule 7): on board edge by edge, here by the angle that it goes round."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from models.commands import Command, Status
from models.fence import MAX_CORNERS, encloses, fault_of
from models.modes import Anomaly, Mode
from tests.models.leading import Trial
from tests.models.test_safety import FREE, LIMITS, SECOND, reported

Corners = Sequence[tuple[float, float]]
WIDE = {"fence_radius": 1e5, "fence_width": 1e5, "departing_distance": 1e5, "leg_time": 900.0}
AHEAD = {"moving_deviation": 4.0, "stop_deviation": 4.0}  # no turns
SQUARE: Corners = [(-10, -10), (-10, 10), (10, 10), (10, -10)]
# an L around the north-east
CONCAVE: Corners = [(0, 0), (10, 0), (10, 10), (5, 10), (5, 5), (0, 5)]


def fenced(corners: Corners, **parameters: Any) -> Trial:
    """A guarded trial with a polygon, in which nothing else ends it."""
    own: dict[str, float] = {"fence_count": len(corners)}
    for k, (north, east) in enumerate(corners, start=1):
        own |= {f"fence_north[{k}]": north, f"fence_east[{k}]": east}
    return Trial(**(LIMITS | FREE | WIDE | AHEAD | own | parameters))


def goes_round(corners: Corners, place: tuple[float, float]) -> bool:
    """Does the polygon go round a place? The angles under which it sees the edges are a full turn."""
    seen = 0.0
    for k, (north, east) in enumerate(corners):
        a = math.atan2(corners[k - 1][1] - place[1], corners[k - 1][0] - place[0])
        seen += math.remainder(math.atan2(east - place[1], north - place[0]) - a, 2 * math.pi)
    return abs(seen) > math.pi


def on_an_edge(corners: Corners, place: tuple[float, float]) -> bool:
    """By whole numbers."""
    for k, b in enumerate(corners):
        a = corners[k - 1]
        along, to = (b[0] - a[0], b[1] - a[1]), (place[0] - a[0], place[1] - a[1])
        part = along[0] * to[0] + along[1] * to[1]
        if along[0] * to[1] == along[1] * to[0] and 0 <= part <= along[0] ** 2 + along[1] ** 2:
            return True
    return False


def kept_in(corners: Corners, place: tuple[float, float]) -> bool:
    """Does a trial go on with the animal at a place?"""
    trial = fenced(corners)
    trial.tick(2 * len(corners), north=place[0], east=place[1])
    return not reported(trial, Anomaly.OUTSIDE_FENCE)


# where lines through corners and edges along them are common
WHOLE = st.integers(-4, 4)
PLACE = st.tuples(WHOLE, WHOLE)


@given(st.lists(PLACE, min_size=3, max_size=MAX_CORNERS), PLACE)
@settings(max_examples=400, deadline=None)
def test_rule_7_a_place_is_inside_if_the_polygon_goes_round_it(
    corners: list[tuple[int, int]], place: tuple[int, int]
) -> None:
    # given any polygon whose edges do not cross, often a concave one
    middle = [sum(x) / len(corners) for x in zip(*corners, strict=True)]
    corners.sort(key=lambda c: math.atan2(c[1] - middle[1], c[0] - middle[0]))
    assume(not fault_of(corners))
    assume(not on_an_edge(corners, place))
    # then it is decided alike, whichever way round the corners are listed
    expected = goes_round(corners, place)
    assert kept_in(corners, place) is expected
    assert kept_in(corners[::-1], place) is expected


@pytest.mark.parametrize(
    ("place", "inside"),
    [
        ((2, 2), True), ((7, 2), True), ((7, 7), True), ((2, 7), False),  # the notch
        ((5, 7.5), True), ((5, 2), True),  # on the northern edge of the notch; on the line of that edge
        ((10.1, 5), False), ((-0.1, 2), False), ((7, -0.1), False), ((7, 10.1), False),
        ((-5, 5), False), ((-5, 0), False), ((-5, 10), False), ((7, 5), True),  # on the line of a corner
    ],
)  # fmt: skip
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("size", [1.0, 1 / 32])
def test_rule_7_a_concave_fence_has_its_notch_outside(
    place: tuple[float, float], inside: bool, turned: bool, size: float
) -> None:
    corners = [(size * north, size * east) for north, east in (CONCAVE[::-1] if turned else CONCAVE)]
    place = (size * place[0], size * place[1])
    assert kept_in(corners, place) is inside
    assert encloses(corners, place) is inside


def test_rule_7_a_place_is_noted_once_in_a_round() -> None:
    # given a place inside, noted on tick 8
    trial = fenced(SQUARE)
    trial.tick(9)
    # when the animal is outside until the next is noted
    trial.tick(3, east=11.0)
    trial.tick(SECOND, east=0.0)
    # then
    assert not reported(trial, Anomaly.OUTSIDE_FENCE)


def test_rule_7_an_edge_to_the_south_or_west_is_inside_and_one_to_the_north_or_east_outside() -> None:
    for corners in (SQUARE, SQUARE[::-1]):
        for place, inside in (((-10, 0), True), ((0, -10), True), ((10, 0), False), ((0, 10), False)):
            assert kept_in(corners, place) is inside
            assert encloses(corners, place) is inside


@pytest.mark.parametrize("n", range(3, MAX_CORNERS + 1))
def test_rule_7_the_first_estimate_outside_stops_the_animal_within_half_a_second(n: int) -> None:
    # given a fence of n corners, and an animal that leaves it on any tick of a round
    corners = [
        (20 * math.cos(angle), 20 * math.sin(angle)) for angle in (2 * math.pi * k / n for k in range(n))
    ]
    waits = set()
    for k in range(1, n + 1):
        trial = fenced(corners)
        trial.tick(3 * n + k)
        trial.tick(3 * n, north=21.0)
        (end,) = reported(trial, Anomaly.OUTSIDE_FENCE)
        assert trial.commands[end] == Command.STOP
        waits.add(end - (3 * n + k))
    # then 2n - 2 ticks later at most, 0.48 s with seven corners
    assert waits == set(range(n - 1, 2 * n - 1))
    assert max(waits) * 0.04 < 0.5


def test_rule_7_an_animal_that_comes_back_before_its_place_is_noted_is_not_stopped() -> None:
    trial = fenced(SQUARE)
    trial.tick(5)
    trial.tick(2, north=11.0)
    trial.tick(SECOND, north=0.0)
    assert trial.commands == [Command.FORWARD] * (7 + SECOND)


@pytest.mark.parametrize("recall", [0, 1])
def test_rule_7_outside_the_polygon_the_animal_is_stopped_and_recalled_if_wanted(
    recall: int,
) -> None:
    trial = fenced(SQUARE, fence_recall=recall)
    trial.tick(10)
    trial.tick(8, north=11.0, speed=0)
    assert trial.commands[-1] == Command.STOP
    assert trial.status == Status.STOPPED
    trial.tick(2 * SECOND)
    assert trial.commands[-1] == (Command.RECALL if recall else Command.NONE)
    assert trial.mode == (Mode.FAILURE_RECALL if recall else Mode.STOPPED)
    # on the way home from outside it is not reported again
    trial.tick(SECOND)
    assert len(reported(trial, Anomaly.OUTSIDE_FENCE)) == 1


def test_rule_7_a_bad_estimate_tells_no_place_to_hold_against_the_polygon() -> None:
    trial = fenced(SQUARE)
    trial.tick(10)
    for bad in ({"valid": 0, "north": 50.0}, {"valid": 1, "north": math.nan}):
        trial.tick(SECOND, **bad)
        assert not reported(trial, Anomaly.OUTSIDE_FENCE)
    trial.tick(8, north=50.0)
    assert len(reported(trial, Anomaly.OUTSIDE_FENCE)) == 1


def test_rule_7_a_place_that_was_noted_is_decided_although_the_estimate_has_gone_bad() -> None:
    # given an animal outside, for the one tick on which its place is noted
    trial = fenced(SQUARE)
    trial.tick(8)
    trial.tick(north=11.0)
    # when the estimate tells no place any more
    trial.tick(3, valid=0)
    # then the round is finished
    assert len(reported(trial, Anomaly.OUTSIDE_FENCE)) == 1


def test_rule_9_a_link_that_is_lost_as_the_animal_is_found_outside_recalls_nobody() -> None:
    # given an animal outside, that is to be recalled from there
    for k in range(1, 9):
        trial = fenced(SQUARE, fence_recall=1)
        trial.tick(8)
        trial.tick(k, north=11.0, speed=0)
        found = bool(reported(trial, Anomaly.OUTSIDE_FENCE))
        # when the link is lost on any of the ticks until that is found
        trial.tick(3 * SECOND, link_ok=0)
        # then the trial ends with the link
        assert found or Command.RECALL not in trial.commands
        assert found or trial.mode == Mode.STOPPED
        assert found or not reported(trial, Anomaly.OUTSIDE_FENCE)


def test_rule_7_nobody_is_stopped_at_a_polygon_whose_trial_is_over() -> None:
    trial = fenced(SQUARE)
    trial.tick(5)
    trial.tick(2 * SECOND, start=0)
    assert trial.mode == Mode.IDLE
    trial.tick(SECOND, north=50.0)
    assert not reported(trial, Anomaly.OUTSIDE_FENCE)


def test_rule_7_the_polygon_is_latched_at_start() -> None:
    trial = fenced(SQUARE)
    trial.tick(5)
    # when its parameters change in the trial
    trial.model["fence_count"] = 0
    trial.model["fence_north[1]"] = -1000.0
    trial.tick(8, north=11.0)
    # then the fence stands, until the next start
    assert trial.status == Status.STOPPED
    trial.tick(2 * SECOND, start=0)
    assert trial.mode == Mode.IDLE
    assert trial.tick(SECOND, start=1, north=11.0) == Command.FORWARD


def test_rule_7_the_polygon_of_another_trial_is_looked_at_from_its_first_edge_on() -> None:
    # given a trial that ends in the midst of a round, its animal west of the fence
    trial = fenced(SQUARE)
    trial.tick(6)
    trial.tick(2 * SECOND, start=0)
    # when another begins inside a smaller one
    for k, (north, east) in enumerate([(-5, -5), (-5, 5), (5, 0)], start=1):
        trial.model[f"fence_north[{k}]"], trial.model[f"fence_east[{k}]"] = north, east
    trial.model["fence_count"] = 3
    trial.tick(SECOND, start=1)
    assert trial.mode == Mode.FORWARD
    trial.tick(5, north=6.0)
    assert trial.status == Status.STOPPED


def test_without_the_limits_or_without_corners_there_is_no_polygon() -> None:
    for trial in (fenced(SQUARE, guarded=0), fenced([])):
        trial.tick(5)
        trial.tick(SECOND, north=50.0)
        assert trial.status == Status.RUNNING


# --- what is a fence ---


@pytest.mark.parametrize(
    ("corners", "fault"),
    [
        (SQUARE, ""),
        (CONCAVE, ""),
        ([(north / 32, east / 32) for north, east in CONCAVE], ""),
        ([(north / 32, east / 32) for north, east in [*CONCAVE[3:], *CONCAVE[:3]]], ""),
        ([(0, 0), (0, 3), (5, 5), (0, 7), (0, 10), (10, 5)], ""),  # two edges on one line
        ([(0, 0), (0, 10), (10, 10), (5, 0), (10, -10), (0, -5)], ""),  # a corner near an edge
        ([(0.0, 0.0), (0.0, 1e-9), (1e-9, 0.0)], ""),
        ([], "it has 0 corners, expected 3 to 7"),
        ([(0, 0), (1, 1)], "it has 2 corners, expected 3 to 7"),
        ([(k, k * k) for k in range(8)], "it has 8 corners, expected 3 to 7"),
        ([(0, 0), (5, 5), (10, 10)], "its corners lie on one line, so its area is 0"),
        ([(3, 3)] * 3, "its corners lie on one line, so its area is 0"),
        ([(0, 0), (10, 10), (10, 0), (0, 10)], "its edges from corner 1 and from corner 3 cross or touch"),
        ([(0, 0), (10, 10), (10, 0), (0, 11)], "its edges from corner 1 and from corner 3 cross or touch"),
        ([(0, 0), (0, 10), (0, 5), (10, 5)], "its edges from corner 1 and from corner 2 cross or touch"),
        ([(0, 5), (10, 5), (0, 0), (0, 10)], "its edges from corner 1 and from corner 3 cross or touch"),
        ([(0, 0), (0, 0), (10, 10), (10, 0)], "its edges from corner 1 and from corner 2 cross or touch"),
        # one corner on another, or on an edge
        ([(0, 0), (10, 0), (5, 5), (10, 10), (0, 10), (5, 5)],
         "its edges from corner 2 and from corner 5 cross or touch"),
        ([(0, 0), (0, 10), (10, 10), (0, 5), (10, -10)],
         "its edges from corner 1 and from corner 3 cross or touch"),
        # along each other
        ([(0, 0), (0, 10), (5, 10), (5, 12), (0, 12), (0, 5), (-5, 5)],
         "its edges from corner 1 and from corner 5 cross or touch"),
    ],
)  # fmt: skip
def test_a_polygon_is_no_fence_if_it_crosses_itself_or_has_no_area(corners: Corners, fault: str) -> None:
    assert fault_of(corners) == fault
