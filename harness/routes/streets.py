"""Ways along streets: Yen's shortest simple paths, without those that share most of their length."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import NamedTuple

import networkx as nx
import shapely
from shapely.ops import substring

from harness.routes.site import Area, Place, RouteError, Site
from harness.routes.way import STREETS, Way

GRID = 0.01  # m, of the crossings' places
MEET = 0.25  # m: streets whose ends are as near to others meet them; six decimals of a degree leave 0.16 m
SHARED = 0.7  # share of the shorter way that two ways may have in common
TRIED = 300  # shortest paths, at most
SMOOTH = 1.0  # m: bends of a street that leave it by less are no corners

Crossing = tuple[float, float]


class _Access(NamedTuple):
    """How a place gets to a street: the street's ends and its line, and how far away it is [m]."""

    a: Crossing
    b: Crossing
    line: shapely.LineString
    length: float


class _Net(NamedTuple):
    """Streets that are connected.

    Attributes:
        gap: from the begin and from the end to them, together [m].
        is_nearest: no other streets are nearer to one of both.
    """

    streets: nx.Graph
    gap: float
    is_nearest: bool


def street_ways(
    site: Site,
    begin: Place,
    end: Place,
    *,
    count: int,
    longest: float,
    note: Callable[[str], None] = lambda text: None,
) -> list[Way]:
    """Ways along the streets that differ, the shortest first; none if the streets do not lead there.

    From the begin the way goes straight to the nearest street that leads to one beside the end, and from
    there to the end. Of several nets of streets the one is taken that lies nearest to both; if other streets
    lie nearer to one of them, then only if most of the way is along the net.

    Args:
        count: of ways, at most.
        longest: no way is longer than so many times the shortest.
        note: called with what the streets lack, for the user.

    Raises:
        RouteError: areas lie between the begin or the end and all streets.
    """
    network = _network(site, note)
    if not network:
        return []
    for net in _nets(network, site, begin, end):
        ends = [_attach(net.streets, site, place) for place in (begin, end)]
        if ends[0] != ends[1] and (net.is_nearest or _distance(net.streets, ends) > net.gap):
            break
    else:
        _tell_gap(network, begin, note)
        return []
    if not net.is_nearest:
        _tell_gap(network, begin, note)
    ways: list[Way] = []
    taken: list[set[frozenset[Crossing]]] = []
    shortest = math.inf
    for nodes in itertools.islice(nx.shortest_simple_paths(net.streets, *ends, weight="length"), TRIED):
        edges = {frozenset(pair) for pair in itertools.pairwise(nodes)}
        length = _length(net.streets, edges)
        shortest = min(shortest, length)
        if length > longest * shortest or len(ways) == count:
            break
        if all(
            _length(net.streets, edges & other) <= SHARED * min(length, _length(net.streets, other))
            for other in taken
        ):
            taken.append(edges)
            ways.append(Way(_places(net.streets, nodes, begin, end), STREETS))
    return ways


def _network(site: Site, note: Callable[[str], None]) -> nx.Graph:
    """The streets as a graph of crossings; `line` of an edge has its bends. Through areas they are closed.

    Crossings with a stretch of street between them that is no longer than MEET are one. A street between two
    crossings that is nowhere farther than MEET from another is that one, drawn twice.
    """
    graph, crossings = nx.Graph(), nx.utils.UnionFind()
    between: defaultdict[frozenset[Crossing], list[shapely.LineString]] = defaultdict(list)
    if not site.streets:
        return graph
    noded = shapely.union_all([*site.streets, *_joints(site.streets)], grid_size=GRID)
    parts = [line for line in shapely.get_parts(noded) if not line.is_empty]
    areas = [_area_on(site, line) for line in parts]
    closed = [area for area in areas if area is not None]
    if closed:
        is_one = len(closed) == 1
        note(
            f"{len(closed)} {'stretch of street is' if is_one else 'stretches of street are'} closed: "
            f"{'it leads' if is_one else 'the first leads'} through {closed[0].where}"
        )
    lines = [line for line, area in zip(parts, areas, strict=True) if area is None]
    for line in lines:
        if line.length <= MEET:
            crossings.union(line.coords[0], line.coords[-1])
    for line in lines:
        first, *bends, last = line.coords
        moved = shapely.LineString([crossings[first], *bends, crossings[last]])
        others = between[frozenset((crossings[first], crossings[last]))]
        if moved.length > MEET and all(moved.hausdorff_distance(other) > MEET for other in others):
            others.append(moved)
            _add(graph, moved)
    return graph


def _joints(streets: Sequence[shapely.LineString]) -> list[shapely.LineString]:
    """Lines from the ends of streets to the streets that they meet: files round places, and draw by hand."""
    ends = shapely.points([place for street in streets for place in (street.coords[0], street.coords[-1])])
    stretches = shapely.linestrings(
        [pair for street in streets for pair in itertools.pairwise(street.coords)]
    )
    end, beside = shapely.STRtree(stretches).query(ends, predicate="dwithin", distance=MEET)
    joints = shapely.shortest_line(ends[end], stretches[beside])
    return [joint for joint in joints if joint.length > 0]


def _area_on(site: Site, line: shapely.LineString) -> Area | None:
    """The first area that a street leads through."""
    return next((area for area in site.areas if line.crosses(area.shape) or line.within(area.shape)), None)


def _tell_gap(network: nx.Graph, begin: Place, note: Callable[[str], None]) -> None:
    """Note that streets do not meet, if so, and where those at the begin are nearest to the others."""
    nets = [
        shapely.multilinestrings([line for *_, line in network.subgraph(nodes).edges(data="line")])
        for nodes in nx.connected_components(network)
    ]
    if len(nets) == 1:
        return
    here, *others = sorted(nets, key=shapely.Point(begin).distance)
    gap = min((shapely.shortest_line(here, other) for other in others), key=attrgetter("length"))
    north, east = gap.coords[0]
    note(
        f"the streets are {len(nets)} nets that do not meet: the one at the begin is {gap.length:.2f} m "
        f"from the next, at {north:.1f} m north, {east:.1f} m east; a street meets those that are within "
        f"{MEET:g} m of its ends"
    )


def _add(graph: nx.Graph, line: shapely.LineString) -> None:
    """Add a street between two crossings; a second one between them, or a loop, in two parts."""
    a, b = line.coords[0], line.coords[-1]
    if graph.has_edge(a, b) or a == b:
        half = line.length / 2
        for part in (substring(line, 0, half), substring(line, half, line.length)):
            _add(graph, part)
    else:
        graph.add_edge(a, b, line=line, length=line.length)


def _accesses(graph: nx.Graph, site: Site, place: Place) -> list[_Access]:
    """The straight lines from a place to each street, the shortest first, without those through areas."""
    edges = list(graph.edges(data="line"))
    straight = shapely.shortest_line(shapely.Point(place), [line for *_, line in edges])
    is_free = ~shapely.crosses(site.union, straight)
    accesses = [
        _Access(a, b, line, length)
        for (a, b, line), length in itertools.compress(
            zip(edges, shapely.length(straight), strict=True), is_free
        )
    ]
    return sorted(accesses, key=attrgetter("length"))


def _nets(network: nx.Graph, site: Site, begin: Place, end: Place) -> list[_Net]:
    """The parts of the network that both places have access to, each connected, the nearest to both first.

    Raises:
        RouteError: areas lie between one of both and all streets.
    """
    nearest = []
    for place in (begin, end):
        by_node: dict[Crossing, float] = {}
        for access in _accesses(network, site, place):
            by_node.setdefault(access.a, access.length)
        if not by_node:
            raise RouteError(
                f"{site.name}: between {place[0]:.1f} m north, {place[1]:.1f} m east and the nearest street "
                f"lies {_between(network, site, place)}; expected a way there, or take --along open"
            )
        nearest.append(by_node)
    least = sum(min(lengths.values()) for lengths in nearest)
    nets = []
    for nodes in nx.connected_components(network):
        gap = sum(
            min((length for node, length in lengths.items() if node in nodes), default=math.inf)
            for lengths in nearest
        )
        nets.append(_Net(nx.Graph(network.subgraph(nodes)), gap, gap <= least))
    return sorted((net for net in nets if net.gap < math.inf), key=attrgetter("gap"))


def _between(network: nx.Graph, site: Site, place: Place) -> str:
    """What lies between a place and the nearest street."""
    point = shapely.Point(place)
    line = min((line for *_, line in network.edges(data="line")), key=point.distance)
    straight = shapely.shortest_line(point, line)
    return next((area.where for area in site.areas if straight.crosses(area.shape)), "an area")


def _attach(net: nx.Graph, site: Site, place: Place) -> Crossing:
    """The nearest place on a street that no area is before, as a crossing of the net."""
    a, b, line, _ = _accesses(net, site, place)[0]
    at = line.project(shapely.Point(place))
    if at <= GRID or at >= line.length - GRID:
        return tuple(line.coords[0] if at <= GRID else line.coords[-1])
    net.remove_edge(a, b)
    parts = substring(line, 0, at), substring(line, at, line.length)
    for part in parts:
        _add(net, part)
    return tuple(parts[0].coords[-1])


def _distance(graph: nx.Graph, ends: Sequence[Crossing]) -> float:
    """The shortest way along streets [m]."""
    return float(nx.shortest_path_length(graph, *ends, weight="length"))


def _length(graph: nx.Graph, edges: set[frozenset[Crossing]]) -> float:
    return sum(float(graph.edges[tuple(edge)]["length"]) for edge in edges)


def _places(graph: nx.Graph, nodes: Sequence[Crossing], begin: Place, end: Place) -> tuple[Place, ...]:
    """The corners of a path, begin and end included."""
    places = [begin]
    for a, b in itertools.pairwise(nodes):
        coordinates = list(graph.edges[a, b]["line"].coords)
        places += coordinates if coordinates[0] == a else coordinates[::-1]
    simple = shapely.LineString([*places, end]).simplify(SMOOTH)
    return tuple((float(north), float(east)) for north, east in simple.coords)
