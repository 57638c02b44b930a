"""Ways over open ground: the shortest of each kind, none of which enters an area or comes too near."""

from __future__ import annotations

import math

import networkx as nx
import numpy as np
import pytest
import shapely

from harness.routes.open_ground import _joined, open_ways
from harness.routes.site import Area, Site
from harness.routes.way import Way, best

BEGIN, END = (0.0, 0.0), (100.0, 0.0)


def site_of(*boxes: tuple[float, float, float, float]) -> Site:
    """Areas from south, west to north, east."""
    return Site(
        "yard", [Area(f"area {k}", f"feature {k}", shapely.box(*box)) for k, box in enumerate(boxes, 1)]
    )


def ways_of(site: Site, clearance: float = 2.0, count: int = 10, longest: float = 3.0) -> list[Way]:
    return open_ways(site, BEGIN, END, clearance, count=count, longest=longest)


def test_without_an_area_between_there_is_the_straight_way_alone() -> None:
    (way,) = ways_of(Site("nothing"))
    assert way.places == (BEGIN, END)
    ways = ways_of(site_of((40, 10, 60, 30)))
    assert ways[0].places == (BEGIN, END)


def test_a_box_is_passed_on_either_side_at_its_grown_corners() -> None:
    # given a box from 10 m to the left to 20 m to the right of the straight way, grown by 2 m
    left, right = ways_of(site_of((40, -10, 60, 20)))
    # then the lengths are those that geometry gives
    assert np.allclose(left.places, [BEGIN, (38, -12), (62, -12), END])
    assert left.length == pytest.approx(2 * math.hypot(38, 12) + 24)
    assert right.length == pytest.approx(2 * math.hypot(38, 22) + 24)
    assert [math.degrees(turn) for turn in left.turns] == pytest.approx(
        [math.degrees(math.atan2(12, 38))] * 2
    )


def test_between_two_boxes_there_are_three_kinds_of_way() -> None:
    # given two boxes side by side with a gap of 20 m between
    site = site_of((40, -40, 60, -5), (40, 15, 60, 50))
    # then: between them, to the left of both, to the right of both
    ways = ways_of(site, longest=1.7)
    assert [round(way.places[1][1]) for way in ways] == [0, -42, 52]
    # and with a clearance that closes the gap only the outer two
    assert [round(way.places[1][1]) for way in ways_of(site, clearance=11)] == [-51, 61]
    # and within three times the shortest two more wind: round one box, back through the gap, round the other
    assert len(ways_of(site)) == 5


def random_site(seed: int) -> Site:
    rng = np.random.default_rng(seed)
    boxes = []
    for _ in range(7):
        north, east = rng.uniform(15, 75), rng.uniform(-40, 30)
        boxes.append((north, east, north + rng.uniform(3, 15), east + rng.uniform(3, 20)))
    return site_of(*boxes)


@pytest.mark.parametrize("seed", range(6))
def test_the_first_way_is_the_shortest_of_the_whole_visibility_graph(seed: int) -> None:
    # given random boxes, and a graph of all pairs of all grown corners, without any shortcut
    site = random_site(seed)
    grown = shapely.union_all([area.shape.buffer(2, join_style="mitre") for area in site.areas])
    places = [BEGIN, END, *map(tuple, shapely.get_coordinates(grown))]
    inner = grown.buffer(-1e-3, join_style="mitre")
    graph = nx.Graph()
    for i, a in enumerate(places):
        for k, b in enumerate(places[:i]):
            if not inner.intersects(shapely.LineString([a, b])):
                graph.add_edge(i, k, length=math.dist(a, b))
    expected = nx.shortest_path_length(graph, 0, 1, weight="length")
    # then
    assert ways_of(site)[0].length == pytest.approx(expected)


@pytest.mark.parametrize("seed", range(6))
def test_ways_keep_their_clearance_come_by_length_and_pass_areas_on_other_sides(seed: int) -> None:
    # given
    site = random_site(seed)
    whole = shapely.union_all([area.shape for area in site.areas])
    # when
    ways = ways_of(site)
    # then
    lengths = [way.length for way in ways]
    assert len(ways) > 3
    assert lengths == sorted(lengths)
    assert lengths[-1] <= 3 * lengths[0] + 1e-3
    for way in ways:
        assert shapely.LineString(way.places).distance(whole) > 2 - 2e-3
    # and any two of them enclose an area: neither can be drawn over to the other
    for k, way in enumerate(ways):
        for other in ways[:k]:
            ring = shapely.LineString([*way.places, *other.places[::-1]])
            enclosed = shapely.polygonize([shapely.union_all(ring)])
            assert enclosed.intersects(whole)


def test_a_begin_near_a_wall_is_left_by_less_than_the_clearance() -> None:
    # given a wall 1 m ahead
    (left, right) = ways_of(site_of((1, -20, 5, 20)), clearance=6, count=2)
    # then the way leaves along it, and keeps the clearance from its corner on
    assert abs(left.places[1][1]) == abs(right.places[1][1]) == pytest.approx(26)
    assert all(abs(place[1]) == pytest.approx(26) for way in (left, right) for place in way.places[1:-1])


def test_along_a_wall_the_straight_way_is_kept_where_both_ends_are_near_it() -> None:
    assert ways_of(site_of((-10, 1, 110, 5)), clearance=6)[0].places == (BEGIN, END)


def test_crossing_a_ray_to_and_fro_counts_as_nothing() -> None:
    assert _joined((1,), (-1,)) == ()
    assert _joined((1, 2), (-2, -1, 3)) == (3,)
    assert _joined((1,), (1, -2)) == (1, 1, -2)


def test_a_way_leads_out_of_a_spiral() -> None:
    # given a begin within a wall that goes round it one and three quarter times, open at its outer end
    turns = np.linspace(0, 3.5 * math.pi, 60)
    spine = np.column_stack(((6 + 4 * turns) * np.cos(turns), (6 + 4 * turns) * np.sin(turns)))
    wall = shapely.LineString(spine).buffer(1, cap_style="flat")
    site = Site("spiral", [Area("wall", "feature 1", wall)])
    # when
    ways = ways_of(site, clearance=1.0, longest=1.5)
    # then it is no straight one, and touches nothing
    assert ways[0].length > 130
    assert shapely.LineString(ways[0].places).distance(wall) > 0.99


def test_there_is_no_way_out_of_a_court() -> None:
    court = shapely.Polygon(
        shapely.box(-20, -20, 20, 20).exterior.coords, [shapely.box(-10, -10, 10, 10).exterior.coords]
    )
    assert ways_of(Site("court", [Area("court", "feature 1", court)])) == []


def test_turns_near_45_or_90_deg_are_preferred_where_that_is_asked_for() -> None:
    # given a shorter way with turns of 65 deg and a longer one with turns of 45
    odd = Way((BEGIN, (20, 43), END), "open")
    square = Way((BEGIN, (50, 50), END), "open")
    assert odd.length < square.length
    assert square.awkwardness == pytest.approx(0)
    # then
    assert best([odd, square], 1, 0.0) == [odd]
    assert best([odd, square], 1, 100.0) == [square]


def test_a_begin_at_a_wall_is_left_straight_for_an_end_that_is_clear() -> None:
    house = Area("house", "feature 1", shapely.box(0, 0, 10, 10))
    (way, *_) = open_ways(Site("yard", [house]), (11, 5), (60, 5), 6.0, count=3, longest=2.0)
    assert way.places == ((11, 5), (60, 5))
