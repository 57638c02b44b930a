"""Candidates: waypoints evenly on a way's legs, each leg longer than d', 16 at most."""

from __future__ import annotations

import itertools
import math

import pytest
import shapely

from harness.routes.candidates import candidates_of
from harness.routes.site import Area, RouteError, Site
from harness.routes.way import Way

BEGIN = (0.0, 0.0)
EMPTY = Site("yard")


def test_legs_are_split_evenly_so_that_no_part_is_longer_than_the_spacing() -> None:
    # given legs of 50 and 30 m
    way = Way((BEGIN, (50, 0), (50, 30)), "open")
    found, notes = candidates_of([way], [None, 20.0, 30.0], EMPTY, 7.0)
    # then the first is unsplit, the second in three and two parts, the third in two parts and one
    assert [candidate.waypoints for candidate in found] == [
        ((50, 0), (50, 30)),
        (pytest.approx((50 / 3, 0)), pytest.approx((100 / 3, 0)), (50, 0), (50, 15), (50, 30)),
        ((25, 0), (50, 0), (50, 30)),
    ]
    assert notes == []


def test_a_leg_that_would_be_as_long_as_the_capture_radius_is_not_split_so() -> None:
    # given 21 m and 8 m between waypoints: three parts of 7 m
    (candidate,), _ = candidates_of([Way((BEGIN, (21, 0)), "open")], [8.0], EMPTY, 7.0)
    assert candidate.waypoints == ((10.5, 0), (21, 0))


def test_a_spacing_longer_than_any_leg_splits_none() -> None:
    way = Way((BEGIN, (50, 0), (50, 30)), "open")
    (candidate,), _ = candidates_of([way], [1e12], EMPTY, 7.0)
    assert candidate.waypoints == ((50, 0), (50, 30))


def test_the_same_waypoints_are_one_candidate() -> None:
    way = Way((BEGIN, (18, 0)), "open")
    found, _ = candidates_of([way, way], [None, 20.0, 30.0], EMPTY, 7.0)
    assert [candidate.spacing for candidate in found] == [None]


def test_what_needs_more_than_16_waypoints_is_left_out_with_a_note() -> None:
    # given 200 m: 16 parts of 12.5 m, 20 of 10 m
    way = Way((BEGIN, (200, 0)), "open")
    found, notes = candidates_of([way], [12.5, 10.0], EMPTY, 7.0)
    assert [len(candidate.waypoints) for candidate in found] == [16]
    assert notes == ["1 candidate left out: it needs more than 16 waypoints"]
    with pytest.raises(RouteError, match=r"no candidate is left .*16 waypoints.*; take a wider spacing"):
        candidates_of([way], [10.0], EMPTY, 7.0)


@pytest.mark.parametrize("spacing", [7.5, 10, 14, 20])
def test_every_leg_is_longer_than_the_capture_radius(spacing: float) -> None:
    # given legs just above d', below twice d', and long ones
    way = Way((BEGIN, (7.1, 0), (7.1, 13), (60, 13)), "open")
    (candidate,), _ = candidates_of([way], [spacing], EMPTY, 7.0)
    places = [BEGIN, *candidate.waypoints]
    assert all(math.dist(a, b) > 7 for a, b in itertools.pairwise(places))
    assert {(7.1, 0), (7.1, 13), (60, 13)} <= set(candidate.waypoints)


def test_a_corner_too_near_to_the_one_before_goes_if_nothing_stands_in_the_short_cut() -> None:
    # given corners 5 m from each other
    way = Way((BEGIN, (30, 0), (35, 0.5), (60, 20)), "open")
    (candidate,), _ = candidates_of([way], [None], EMPTY, 7.0)
    assert candidate.waypoints == ((30, 0), (60, 20))
    # and where a hut stands in the short cut the way is left out
    hut = Site("yard", [Area("hut", "feature 1", shapely.box(40, 5, 46, 9))])
    straight = Way((BEGIN, (30, 0), (60, 0)), "open")
    found, notes = candidates_of([way, straight], [None], hut, 7.0)
    assert [candidate.way for candidate in found] == [straight]
    assert notes == ["1 candidate left out: it has corners within d', 7 m, of each other"]


def test_an_end_too_near_to_the_last_corner_takes_its_place_if_nothing_stands_in_the_short_cut() -> None:
    way, straight = Way((BEGIN, (30, 0), (33, 3)), "open"), Way((BEGIN, (0, 40)), "open")
    (candidate,), _ = candidates_of([way], [None], EMPTY, 7.0)
    assert candidate.waypoints == ((33, 3),)
    # and with a hut there the way is left out
    hut = Site("yard", [Area("hut", "feature 1", shapely.box(14, 1, 16, 9))])
    found, _ = candidates_of([way, straight], [None], hut, 7.0)
    assert [candidate.way for candidate in found] == [straight]


@pytest.mark.parametrize("spacing", [6.0, math.inf, math.nan])
def test_a_spacing_within_the_capture_radius_or_without_a_length_is_refused(spacing: float) -> None:
    with pytest.raises(
        RouteError, match=f"spacing {spacing:g}: expected a length of more than d', 7 m, or none"
    ):
        candidates_of([Way((BEGIN, (30, 0)), "open")], [spacing], EMPTY, 7.0)
