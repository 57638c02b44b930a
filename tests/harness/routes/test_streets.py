"""Ways along streets: they follow them, differ, and are the shortest ones."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from harness.routes.map_file import load
from harness.routes.site import Area, RouteError, Site
from harness.routes.streets import street_ways
from harness.routes.way import Way
from tests.harness.routes.maps import line, write


def grid(size: int = 4, block: float = 30.0) -> list[shapely.LineString]:
    """So many streets each way."""
    ends = (0, block * (size - 1))
    lines = [shapely.LineString([(k * block, ends[0]), (k * block, ends[1])]) for k in range(size)]
    return lines + [shapely.LineString([(ends[0], k * block), (ends[1], k * block)]) for k in range(size)]


def ways_of(site: Site, begin: tuple[float, float], end: tuple[float, float], **options: float) -> list[Way]:
    asked = {"count": 5, "longest": 2.0} | options
    return street_ways(site, begin, end, **asked)  # type: ignore[arg-type]


def test_ways_follow_the_streets_and_differ() -> None:
    # given a grid of streets, a begin 3 m beside one and an end at a crossing
    site = Site("town", streets=grid())
    ways = ways_of(site, (3.0, 15.0), (90.0, 90.0))
    # then they have the length that a grid gives, with the 3 m to the street
    assert len(ways) == 5
    assert ways[0].length == pytest.approx(3 + 75 + 90)
    streets = shapely.union_all(site.streets)
    for way in ways:
        assert streets.buffer(0.01).contains(shapely.LineString(way.places[1:]))
    # and no two share more than 0.7 of the shorter one, to the metres at their begin
    for k, way in enumerate(ways):
        for other in ways[:k]:
            shared = shapely.LineString(way.places).intersection(shapely.LineString(other.places)).length
            assert shared <= 0.7 * min(way.length, other.length) + 3


def test_the_first_way_is_the_shortest_over_bends_and_second_streets() -> None:
    # given two streets between the same crossings, of which the second one bends, and a loop
    straight = shapely.LineString([(0, 0), (100, 0)])
    bend = shapely.LineString([(0, 0), (50, 40), (100, 0)])
    loop = shapely.LineString([(100, 0), (120, 20), (120, -20), (100, 0)])
    site = Site("town", streets=[bend, straight, loop])
    # when
    first, second = ways_of(site, (0, 0), (100, 0))
    # then
    assert [first.length, second.length] == pytest.approx([100, 2 * math.hypot(50, 40)])
    assert second.places == ((0, 0), (50, 40), (100, 0))


def test_a_street_is_followed_against_the_order_of_its_places_and_no_way_is_too_long() -> None:
    # given a street written from its far end, with unequal bends, and a longer one
    bent = shapely.LineString([(100, 0), (90, 30), (10, 10), (0, 0)])
    long = shapely.LineString([(0, 0), (50, -90), (100, 0)])
    site = Site("town", streets=[bent, long])
    # then the bends come in the order of the way
    (way,) = ways_of(site, (0, 0), (100, 0), longest=1.5)
    assert way.places == ((0, 0), (10, 10), (90, 30), (100, 0))
    assert len(ways_of(site, (0, 0), (100, 0), longest=2.0)) == 2


def test_a_street_through_an_area_is_closed() -> None:
    # given a gate house over the straight street
    house = Area("gate house", "feature 1", shapely.box(40, -5, 60, 5))
    streets = [shapely.LineString([(0, 0), (100, 0)]), shapely.LineString([(0, 0), (50, 40), (100, 0)])]
    (way,) = ways_of(Site("town", [house], streets), (0, 0), (100, 0))
    assert way.places[1] == (50, 40)


@pytest.mark.parametrize("decimals", [6, 7])
def test_a_street_that_ends_at_another_meets_it_however_a_file_in_degrees_rounds_both(
    decimals: int, tmp_path: Path
) -> None:
    # given streets that end on others, at any place and in any direction
    rng = np.random.default_rng(1)
    scale = np.array([math.cos(math.radians(32)), 1]) * 111_000  # m a degree

    def written(place: np.ndarray[Any, Any]) -> tuple[float, float]:
        x, y = np.round([10, 32] + place / scale, decimals)
        return float(x), float(y)

    for _ in range(40):
        a, b = rng.uniform(-200, 0, 2), rng.uniform(0, 200, 2)
        joint = a + rng.uniform(0.2, 0.8) * (b - a)
        away = joint + rng.uniform(20, 100, 2) * rng.choice([-1, 1], 2)
        streets = line("", written(a), written(b)), line("", written(joint), written(away))
        # when
        found = load(write(tmp_path, *streets, units=None))
        site = found.site(written(a))
        ends = [found.place_at(written(place), written(a)) for place in (a, away)]
        # then they lead from the one to the other
        (way,) = ways_of(site, *ends)
        assert way.length == pytest.approx(math.dist(a, joint) + math.dist(joint, away), rel=0.01)


@pytest.mark.parametrize(("gap", "nets"), [(0.24, 1), (0.26, 2)])
def test_a_street_meets_another_a_quarter_of_a_metre_from_its_end(gap: float, nets: int) -> None:
    street, side = shapely.LineString([(0, 0), (100, 0)]), shapely.LineString([(50, gap), (50, 90)])
    notes: list[str] = []
    street_ways(Site("town", streets=[street, side]), (0, 0), (50, 90), count=1, longest=2, note=notes.append)
    assert len(notes) == nets - 1


def test_ends_a_little_beyond_a_street_leave_no_ways_that_hardly_differ() -> None:
    # given a ring road with ten side streets that begin 0.1 m before or beyond its near side
    ring = shapely.LineString([(0, 0), (100, 0), (100, 60), (0, 60), (0, 0)])
    sides = [shapely.LineString([(5 + 9 * k, (-0.1) ** (k % 2)), (5 + 9 * k, -40)]) for k in range(10)]
    # when
    ways = ways_of(Site("town", streets=[ring, *sides]), (0, 0), (100, 0), longest=4.0)
    # then both ways round are found
    assert [way.length for way in ways] == pytest.approx([100, 220], abs=0.5)


def drawn(times: int, apart: float) -> list[shapely.LineString]:
    """A street with a bend so many times, each beside the last, and a way round."""
    copies = [[(0.0, k * apart), (50.0, 20 + k * apart), (100.0, k * apart)] for k in range(times)]
    side = [(0.0, 0.0), (0.0, -50.0), (100.0, -50.0), (100.0, 0.0)]
    return [shapely.LineString(each) for each in (side, *copies)]


@pytest.mark.parametrize(("times", "apart"), [(2, 0.0), (25, 0.0), (5, 0.05)])
def test_a_street_that_is_drawn_many_times_is_one(times: int, apart: float) -> None:
    ways = ways_of(Site("town", streets=drawn(times, apart)), (0, 0), (100, 0))
    assert [way.length for way in ways] == pytest.approx([2 * math.hypot(50, 20), 200], abs=0.5)


def test_a_hatch_of_streets_is_planned_along() -> None:
    # given 25 that are each within a crossing's width of the next, though not of the first
    ways = ways_of(Site("town", streets=drawn(25, 0.2)), (0, 0), (100, 0))
    assert ways[0].length == pytest.approx(2 * math.hypot(50, 20), abs=1)


def test_streets_that_lie_elsewhere_are_no_matter() -> None:
    # given a footpath far from a way along streets
    streets = [shapely.LineString([(0, 0), (100, 0)]), shapely.LineString([(0, 80), (100, 80)])]
    notes: list[str] = []
    (way,) = street_ways(
        Site("town", streets=streets), (0, 0), (100, 0), count=5, longest=2.0, note=notes.append
    )
    assert (way.length, notes) == (100, [])


def test_what_the_streets_lack_is_told() -> None:
    # given a gap of 0.3 m, more than ends may be apart, and a gate house over a lane beside it
    house = Area("gate house", "feature 1 (gate house)", shapely.box(40, -25, 60, -15))
    streets = [[(0, 0), (40, 0)], [(40.3, 0), (70, 0)], [(0, 0), (0, -20), (70, -20), (70, -5)]]
    notes: list[str] = []
    # when
    site = Site("town", [house], [shapely.LineString(street) for street in streets])
    street_ways(site, (0, 0), (70, 0), count=5, longest=2.0, note=notes.append)
    # then
    assert notes == [
        "1 stretch of street is closed: it leads through feature 1 (gate house)",
        "the streets are 2 nets that do not meet: the one at the begin is 0.30 m from the next, at 40.0 m "
        "north, 0.0 m east; a street meets those that are within 0.25 m of its ends",
    ]


def test_streets_shorter_than_a_crossing_is_wide_give_no_way() -> None:
    assert ways_of(Site("town", streets=[shapely.LineString([(0, 0), (0, 0.004)])]), (0, 0), (9, 0)) == []


def test_a_street_from_wall_to_wall_of_an_area_is_closed() -> None:
    house = Area("gate house", "feature 1", shapely.box(40, -5, 60, 5))
    pieces = [[(0, 0), (40, 0)], [(40, 0), (60, 0)], [(60, 0), (100, 0)], [(0, 0), (50, 40), (100, 0)]]
    (way,) = ways_of(Site("town", [house], [shapely.LineString(piece) for piece in pieces]), (0, 0), (100, 0))
    assert way.places[1] == (50, 40)


def test_the_nearest_streets_are_taken_for_a_way_that_is_mostly_beside_them() -> None:
    street = shapely.LineString([(0, 0), (100, 0)])
    (way,) = ways_of(Site("town", streets=[street]), (10, 10), (25, 10))
    assert way.length == 35


def test_a_way_that_shares_most_of_the_shorter_one_is_none_of_its_own() -> None:
    # given 100 m, and 180 m that has 80 m of them
    streets = [[(0, 0), (80, 0)], [(80, 0), (100, 0)], [(80, 0), (80, 48.99), (100, 0)]]
    (way,) = ways_of(
        Site("town", streets=[shapely.LineString(street) for street in streets]), (0, 0), (100, 0)
    )
    assert way.length == 100


def test_streets_that_do_not_lead_there_give_no_way() -> None:
    streets = [shapely.LineString([(0, 0), (40, 0)]), shapely.LineString([(60, 0), (100, 0)])]
    assert ways_of(Site("town", streets=streets), (0, 0), (100, 0)) == []
    assert ways_of(Site("town"), (0, 0), (100, 0)) == []


def test_a_stub_beside_the_begin_does_not_hide_the_street_that_leads_to_the_end() -> None:
    # given a stub 2 m from the begin, and a street 5 m from it that passes the end at 3 m
    stub = shapely.LineString([(2, 0), (2, 8)])
    street = shapely.LineString([(-20, -5), (100, -5)])
    site = Site("town", streets=[stub, street])
    # then
    (way,) = ways_of(site, (0, 0), (90, -2))
    assert way.places == ((0, 0), (0, -5), (90, -5), (90, -2))
    # and a street that is farther from both than it is long is no way there
    far = Site("town", streets=[stub, shapely.LineString([(40, 0), (50, 0)])])
    assert ways_of(far, (0, 0), (90, 3)) == []


def test_a_street_behind_an_area_is_passed_over_for_the_nearest_that_is_not() -> None:
    # given a hut between the begin and the nearer of two streets that meet
    hut = Area("hut", 'feature 1 ("hut")', shapely.box(2, -5, 4, 5))
    near, other = shapely.LineString([(6, -50), (6, 50)]), shapely.LineString([(6, 50), (-9, 50), (-9, -50)])
    (way,) = ways_of(Site("town", [hut], [near, other]), (0, 0), (6, 40), longest=1.2)
    assert way.places == ((0, 0), (-9, 0), (-9, 50), (6, 50), (6, 40))


def test_an_area_between_the_begin_and_the_nearest_street_is_named() -> None:
    house = Area("hut", 'feature 1 ("hut")', shapely.box(2, -5, 4, 5))
    site = Site("town", [house], [shapely.LineString([(6, -50), (6, 50)])])
    with pytest.raises(
        RouteError, match=r'0.0 m north, 0.0 m east and the nearest street lies feature 1 \("hut"\)'
    ):
        ways_of(site, (0, 0), (6, 40))
