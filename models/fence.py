"""The polygon that a mission may carry: an animal that leaves it is stopped (rule 7 of SAFETY.md)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import combinations

from models.kit import casadi as ca
from models.kit.block import before, triggered
from models.kit.declaration import Boolean, Integer, Parameter, State
from models.kit.geometry import all_of, any_of, element, one_of, where
from models.modes import BEFORE_RECALL, Anomaly
from models.safety import Supervised

MIN_CORNERS, MAX_CORNERS = 3, 7


class Fenced(Supervised):
    """Base of a controller whose animal stays inside a polygon.

    Even-odd rule: a place is inside if the line from it to the north crosses an odd number of edges. Of an
    edge's two ends the western one belongs to it, so a corner counts once, and an edge along the line never.
    A place on an edge is north of it.
    So that no tick is long, the place is noted, held against one edge on each tick, and noted anew behind the
    last: with n corners the first estimate outside stops the animal within 2n - 2 ticks, 0.48 s with seven.
    """

    behind = True

    fence_count = Parameter(
        Integer,
        "corners of the fence, 0 for none",
        start=0,
        min=0,
        max=MAX_CORNERS,
        latched=True,
        switch=True,
    )
    fence_north = Parameter(
        "m",
        "corners of the fence, in order",
        start=0,
        size=MAX_CORNERS,
        min=-1e5,
        max=1e5,
        latched=True,
    )
    fence_east = Parameter(
        "m",
        "corners of the fence, in order",
        start=0,
        size=MAX_CORNERS,
        min=-1e5,
        max=1e5,
        latched=True,
        beside="fence_north",
    )

    corners = State(Integer, "corners of the fence, latched", min=0, max=MAX_CORNERS)
    corner_north = State("m", "corners of the fence, latched", size=MAX_CORNERS)
    corner_east = State("m", "corners of the fence, latched", size=MAX_CORNERS)
    edge = State(Integer, "edges that the place noted was held against", min=0, max=MAX_CORNERS)
    edge_north = State("m", "ends of the edge", size=2)
    edge_east = State("m", "ends of the edge", size=2)
    place_north = State("m", "the place noted")
    place_east = State("m", "the place noted")
    beside = State(Boolean, "one end of the edge is west of the place, the other is not")
    inside = State(Boolean, "an odd number of these edges is north of the place")

    @before("halt")
    @triggered("fresh", seldom=True)
    def enclose(m) -> None:
        """A new trial latches its fence."""
        m.corner_north, m.corner_east, m.corners = m.fence_north, m.fence_east, m.fence_count
        last = m.fence_count - 1
        m.edge_north = ca.vertcat(0, element(m.fence_north, last))
        m.edge_east = ca.vertcat(0, element(m.fence_east, last))
        m.edge = m.beside = 0

    @before("halt")
    @triggered(
        lambda m: all_of(m.led, m.corners > 0, any_of(m.edge > 0, m._placed())),
        "`led`, with a fence, once the estimate tells a place",
        seldom="fence_count",
    )
    def patrol(m) -> None:
        """Take the next edge; at the first one note the place."""
        first = m.edge == 0
        m.place_north = where(first, m.north, m.place_north)
        m.place_east = where(first, m.east, m.place_east)
        m.inside = all_of(ca.logic_not(first), m.inside)
        m.edge_north = ca.vertcat(m.edge_north[1], element(m.corner_north, m.edge))
        m.edge_east = ca.vertcat(m.edge_east[1], element(m.corner_east, m.edge))
        m.beside = (m.edge_east[0] > m.place_east) != (m.edge_east[1] > m.place_east)
        m.edge = m.edge + 1

    @before("halt")
    @triggered("beside", seldom="fence_count")
    def cross(m) -> None:
        """An edge that passes the place to the north is crossed; without a division."""
        along_north, along_east = m.edge_north[1] - m.edge_north[0], m.edge_east[1] - m.edge_east[0]
        north, east = m.place_north - m.edge_north[0], m.place_east - m.edge_east[0]
        over, under = along_north * east, along_east * north
        northward = where(along_east > 0, over > under, under > over)
        m.inside = m.inside != northward
        m.beside = 0

    @before("halt")
    @triggered(
        lambda m: all_of(m.edge > 0, m.edge >= m.corners),
        "the place was held against all edges",
        seldom="fence_count",
    )
    def confine(m) -> None:
        """Outside the fence a trial ends, as from any breach."""
        m.edge = 0
        outside = all_of(ca.logic_not(m.inside), one_of(m.now, BEFORE_RECALL), m.breach == Anomaly.NONE)
        m.breach = where(outside, Anomaly.OUTSIDE_FENCE, m.breach)


def fault_of(corners: Sequence[tuple[float, float]]) -> str:
    """What is wrong with a polygon as a fence, in words; "" if nothing is. Decided exactly.

    Args:
        corners: one after another, two coordinates each, of any unit.
    """
    n = len(corners)
    if not MIN_CORNERS <= n <= MAX_CORNERS:
        return f"it has {n} corners, expected {MIN_CORNERS} to {MAX_CORNERS}"
    points = [(Fraction(x), Fraction(y)) for x, y in corners]
    if not any(_turn(points[0], a, b) for a, b in _edges(points)):
        return "its corners lie on one line, so its area is 0"
    for (i, one), (k, other) in combinations(enumerate(_edges(points), start=1), 2):
        if k - i in (1, n - 1):  # they share a corner: does the one lead back along the other?
            before, after = (one, other) if k - i == 1 else (other, one)
            crossed = _holds(before, after[1]) or _holds(after, before[0])
        else:
            crossed = _meet(one, other)
        if crossed:
            return f"its edges from corner {i} and from corner {k} cross or touch"
    return ""


def encloses(corners: Sequence[tuple[float, float]], place: tuple[float, float]) -> bool:
    """Is a place inside a polygon, exactly by the rule of `Fenced`?"""
    north, east = map(Fraction, place)
    inside = False
    for a, b in _edges([(Fraction(x), Fraction(y)) for x, y in corners]):
        if (a[1] > east) != (b[1] > east):
            turn = _turn(a, b, (north, east))
            inside ^= turn > 0 if b[1] > a[1] else turn < 0
    return inside


Point = tuple[Fraction, Fraction]
Edge = tuple[Point, Point]


def _edges(points: Sequence[Point]) -> Iterator[Edge]:
    """From each corner to the next, and from the last to the first."""
    return zip(points, [*points[1:], points[0]], strict=True)


def _turn(a: Point, b: Point, c: Point) -> Fraction:
    """Twice the signed area of a triangle."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _holds(edge: Edge, point: Point) -> bool:
    """Does a point lie on an edge?"""
    a, b = edge
    return _turn(a, b, point) == 0 and all(
        min(p, q) <= x <= max(p, q) for p, q, x in zip(a, b, point, strict=True)
    )


def _meet(one: Edge, other: Edge) -> bool:
    """Have two edges a point in common?"""
    (a, b), (c, d) = one, other
    apart = _turn(a, b, c) * _turn(a, b, d) > 0 or _turn(c, d, a) * _turn(c, d, b) > 0
    parallel = _turn(a, b, c) == 0 and _turn(a, b, d) == 0
    return any((_holds(one, c), _holds(one, d), _holds(other, a))) if parallel else not apart
