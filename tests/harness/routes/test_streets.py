"""Ways along streets: they follow them, differ, and are the shortest ones."""

from __future__ import annotations

import math

import pytest
import shapely

from harness.routes.site import Area, RouteError, Site
from harness.routes.streets import street_ways
from harness.routes.way import Way


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
