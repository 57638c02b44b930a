"""Ways along streets: Yen's shortest simple paths, without those that share most of their length."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import networkx as nx
import shapely
from shapely.ops import substring

from harness.routes.site import Place, RouteError, Site
from harness.routes.way import STREETS, Way

GRID = 0.01  # m: street ends that are as near meet
SHARED = 0.7  # share of the shorter way that two ways may have in common
TRIED = 300  # shortest paths, at most
SMOOTH = 1.0  # m: bends of a street that leave it by less are no corners

Crossing = tuple[float, float]


def street_ways(site: Site, begin: Place, end: Place, *, count: int, longest: float) -> list[Way]:
    """Ways along the streets that differ, the shortest first; none if the streets do not lead there.

    From the begin the way goes straight to the nearest street, and from there to the end.

    Args:
        count: of ways, at most.
        longest: no way is longer than so many times the shortest.
    """
    network = _network(site)
    if not network:
        return []
    ends = [_attach(network, site, place) for place in (begin, end)]
    if ends[0] == ends[1] or not nx.has_path(network, *ends):
        return []
    ways: list[Way] = []
    taken: list[set[frozenset[Crossing]]] = []
    shortest = math.inf
    for nodes in itertools.islice(nx.shortest_simple_paths(network, *ends, weight="length"), TRIED):
        edges = {frozenset(pair) for pair in itertools.pairwise(nodes)}
        length = _length(network, edges)
        shortest = min(shortest, length)
        if length > longest * shortest or len(ways) == count:
            break
        if all(
            _length(network, edges & other) <= SHARED * min(length, _length(network, other))
            for other in taken
        ):
            taken.append(edges)
            ways.append(Way(_places(network, nodes, begin, end), STREETS))
    return ways


def _network(site: Site) -> nx.Graph:
    """The streets as a graph of crossings; `line` of an edge has its bends. Through areas they are closed."""
    graph = nx.Graph()
    if not site.streets:
        return graph
    noded = shapely.union_all(list(site.streets), grid_size=GRID)
    for line in getattr(noded, "geoms", [noded]):
        if not any(line.crosses(area.shape) or line.within(area.shape) for area in site.areas):
            _add(graph, line)
    return graph


def _add(graph: nx.Graph, line: shapely.LineString) -> None:
    """Add a street between two crossings; a second one between them, or a loop, in two parts."""
    a, b = line.coords[0], line.coords[-1]
    if graph.has_edge(a, b) or a == b:
        half = line.length / 2
        for part in (substring(line, 0, half), substring(line, half, line.length)):
            _add(graph, part)
    else:
        graph.add_edge(a, b, line=line, length=line.length)


def _attach(graph: nx.Graph, site: Site, place: Place) -> Crossing:
    """The nearest place on a street, as a crossing of the graph.

    Raises:
        RouteError: an area lies between.
    """
    point = shapely.Point(place)
    a, b, line = min(graph.edges(data="line"), key=lambda edge: edge[2].distance(point))
    at = line.project(point)
    nearest = line.interpolate(at)
    between = shapely.LineString([point, nearest])
    for area in site.areas:
        if between.crosses(area.shape):
            raise RouteError(
                f"{site.name}: between {place[0]:.1f} m north, {place[1]:.1f} m east and the nearest street "
                f"lies {area.where}; expected a way there, or take --along open"
            )
    if at <= GRID or at >= line.length - GRID:
        return tuple(line.coords[0] if at <= GRID else line.coords[-1])
    graph.remove_edge(a, b)
    parts = substring(line, 0, at), substring(line, at, line.length)
    for part in parts:
        _add(graph, part)
    return tuple(parts[0].coords[-1])


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
