"""Ways round areas over open ground: the shortest of each kind, by which side of each area it passes.

Shortest ways round polygons go from corner to corner (the visibility graph). Two ways between the same ends
are of one kind (homotopic) if one can be drawn over to the other without crossing an area. To tell kinds
apart, a ray goes north from each area. A way's *word* is the rays that it crosses, in order and with their
direction; crossing one to and fro at once counts as nothing. Words are equal exactly if ways are of one kind.
So a search over pairs of corner and word finds the shortest way of each kind, shortest kinds first, and never
a variant of one that is there already (after Bhattacharya, Likhachev and Kumar 2012).
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial

import networkx as nx
import numpy as np
import shapely

from harness.routes.site import Place, RouteError, Site
from harness.routes.way import OPEN, Way

MITRE = 2.0  # a grown corner lies at most so many clearances off; sharper ones are cut
SLACK = 1e-3  # m: a way along an area's grown edge does not enter it
NEAR = 0.9  # share of its own distance from the areas that a begin or an end near one keeps
MOST_CORNERS = 1000  # of the grown areas: their pairs are looked at one by one
MOST_STEPS = 200_000  # of the search

Word = tuple[int, ...]  # area numbers from 1 on; negative westward


@dataclass(frozen=True)
class _Ground:
    """The grown areas, and what between their corners is free.

    Attributes:
        graph: corners by number, begin 0 and end 1; edges with `length`.
        places: of the corners.
        posts: where each grown area's ray begins.
    """

    graph: nx.Graph
    places: list[Place]
    posts: list[Place]


def open_ways(
    site: Site, begin: Place, end: Place, clearance: float, *, count: int, longest: float
) -> list[Way]:
    """The shortest way of each kind, the shortest first.

    Args:
        clearance: from the areas, m; a begin or an end nearer to one is left by less.
        count: of ways, at most.
        longest: no way is longer than so many times the shortest.

    Raises:
        RouteError: the end cannot be reached, or the map has too many corners.
    """
    ground = _ground(site, begin, end, clearance)
    return [
        Way(tuple(ground.places[node] for node in nodes), OPEN, clearance)
        for nodes in itertools.islice(_by_kind(ground, longest), count)
    ]


def _ground(site: Site, begin: Place, end: Place, clearance: float) -> _Ground:
    grown = cache(partial(_grown, [area.shape for area in site.areas]))
    blocks = cache(lambda clearance: _blocks(grown(clearance)))
    corners = [corner for polygon in grown(clearance) for corner in _corners_of(polygon)]
    if len(corners) > MOST_CORNERS:
        raise RouteError(
            f"{site.name}: its areas have {len(corners)} corners, expected {MOST_CORNERS} at most; cut the "
            "map to the place of the route, or simplify its outlines"
        )
    places = [begin, end, *(corner.place for corner in corners)]
    graph = nx.Graph()
    graph.add_nodes_from(range(len(places)))
    numbers = range(2, len(places))

    def touches(node: int, other: int) -> bool:
        return corners[node - 2].touched_from(places[other])

    _connect(
        graph,
        places,
        [(i, k) for i, k in itertools.combinations(numbers, 2) if touches(i, k) and touches(k, i)],
        blocks(clearance),
    )
    kept = [min(clearance, NEAR * site.union.distance(shapely.Point(place))) for place in (begin, end)]
    for node in (0, 1):
        within = kept[node] < clearance  # of a grown area: its corners are not touched from there, but left
        ends = [(node, k) for k in numbers if within or touches(k, node)]
        _connect(graph, places, ends, blocks(kept[node]))
    _connect(graph, places, [(0, 1)], blocks(min(kept)))
    posts = [
        next(area.shape for area in site.areas if area.shape.intersects(part)).representative_point()
        for part in grown(clearance)
    ]
    return _Ground(graph, places, [(post.x, post.y) for post in posts])


def _blocks(grown: Sequence[shapely.Polygon]) -> shapely.Geometry:
    """What no way enters: the grown areas without their edges."""
    blocks = shapely.union_all(grown).buffer(-SLACK, join_style="mitre")
    shapely.prepare(blocks)
    return blocks


def _grown(shapes: Sequence[shapely.Polygon], clearance: float) -> list[shapely.Polygon]:
    """The areas with a clearance about them; those that then touch are one."""
    grown = shapely.union_all(
        [shape.buffer(clearance, join_style="mitre", mitre_limit=MITRE) for shape in shapes]
    )
    return [part for part in getattr(grown, "geoms", [grown]) if not part.is_empty]


@dataclass(frozen=True)
class _Corner:
    """A corner of a grown area that sticks out, and its neighbours along the edge."""

    before: Place
    place: Place
    after: Place

    def touched_from(self, other: Place) -> bool:
        """Does a line from there only touch the corner? A shortest way turns at no other."""
        a, b = (_side(other, self.place, neighbour) for neighbour in (self.before, self.after))
        return a * b >= 0


def _corners_of(polygon: shapely.Polygon) -> Iterator[_Corner]:
    oriented = shapely.orient_polygons(polygon)  # the area is to the left of all its rings
    for ring in (oriented.exterior, *oriented.interiors):
        places = [(float(x), float(y)) for x, y in ring.coords[:-1]]
        for k, place in enumerate(places):
            before, after = places[k - 1], places[(k + 1) % len(places)]
            if _side(before, place, after) > 0:
                yield _Corner(before, place, after)


def _side(a: Place, b: Place, c: Place) -> float:
    """Is c to the left (above 0) or to the right of the line from a to b?"""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _connect(
    graph: nx.Graph, places: Sequence[Place], pairs: Sequence[tuple[int, int]], blocks: shapely.Geometry
) -> None:
    """Add the pairs that nothing lies between."""
    ends = np.array(places)[np.array(pairs, dtype=int).reshape(-1, 2)]
    free = ~shapely.intersects(blocks, shapely.linestrings(ends))
    for (i, k), is_free in zip(pairs, free, strict=True):
        if is_free:
            graph.add_edge(i, k, length=math.dist(places[i], places[k]))


def _by_kind(ground: _Ground, longest: float) -> Iterator[list[int]]:
    """The shortest way of each kind as its corners' numbers, the shortest first."""
    graph = ground.graph
    left = nx.single_source_dijkstra_path_length(graph, 1, weight="length")
    if 0 not in left:
        return
    most = longest * left[0] + SLACK
    crossed: dict[tuple[int, int], Word] = {}
    heap: list[tuple[float, float, int, Word, tuple[int, ...]]] = [(left[0], 0.0, 0, (), (0,))]
    done: set[tuple[int, Word]] = set()
    for _ in range(MOST_STEPS):
        if not heap:
            return
        _, length, node, word, path = heapq.heappop(heap)
        if (node, word) in done:
            continue
        done.add((node, word))
        if node == 1:
            yield list(path)
            continue
        for other, edge in graph[node].items():
            if other not in left:
                continue
            if (node, other) not in crossed:
                crossed[node, other] = _word(ground.places[node], ground.places[other], ground.posts)
            further = _joined(word, crossed[node, other])
            total = length + edge["length"]
            bound = total + left[other]
            is_new = bound <= most and (other, further) not in done
            if is_new and not _meets_itself(path, other, ground.places):
                heapq.heappush(heap, (bound, total, other, further, (*path, other)))


def _word(a: Place, b: Place, posts: Sequence[Place]) -> Word:
    """The rays that the way from a to b crosses, in order."""
    crossings = []
    for number, (north, east) in enumerate(posts, start=1):
        if (a[1] > east) != (b[1] > east):
            along = (east - a[1]) / (b[1] - a[1])
            if a[0] + along * (b[0] - a[0]) > north:
                sign = 1 if b[1] > a[1] else -1
                crossings.append((along, sign * number))
    return tuple(number for _, number in sorted(crossings))


def _joined(word: Word, further: Word) -> Word:
    """Two words in one; what crosses a ray to and fro at once counts as nothing."""
    letters = list(word)
    for letter in further:
        if letters and letters[-1] == -letter:
            letters.pop()
        else:
            letters.append(letter)
    return tuple(letters)


def _meets_itself(path: Sequence[int], further: int, places: Sequence[Place]) -> bool:
    """Does a way come back to a corner, or cross itself, with one corner more? Then it goes round an area."""
    a, b = places[path[-1]], places[further]
    return further in path or any(
        _side(a, b, places[i]) * _side(a, b, places[k]) < 0
        and _side(places[i], places[k], a) * _side(places[i], places[k], b) < 0
        for i, k in itertools.pairwise(path[:-1])
    )
