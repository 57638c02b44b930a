"""A way over a map, and how two ways differ."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from harness.routes.site import Place
from models.kit.units import DEG

OPEN, STREETS = "open", "streets"
LIKED = (0.0, 45 * DEG, 90 * DEG)  # turns that the dog was trained in: on, 45 and 90 deg (Figure 4.8)


@dataclass(frozen=True)
class Way:
    """A polyline from the begin to the end.

    Attributes:
        places: its corners, begin and end included.
        kind: round the areas over open ground, or along streets.
        clearance: from the areas, m; 0 along streets.
    """

    places: tuple[Place, ...]
    kind: str
    clearance: float = 0.0

    @cached_property
    def legs(self) -> list[float]:
        """The lengths from corner to corner [m]."""
        return [math.dist(a, b) for a, b in itertools.pairwise(self.places)]

    @property
    def length(self) -> float:
        """In m."""
        return sum(self.legs)

    @cached_property
    def turns(self) -> list[float]:
        """The turn at each corner between begin and end, right positive [rad]."""
        bearings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in itertools.pairwise(self.places)]
        return [math.remainder(after - before, math.tau) for before, after in itertools.pairwise(bearings)]

    @property
    def awkwardness(self) -> float:
        """How far the turns are from the nearest of LIKED, summed, in units of 45 deg."""
        return sum(min(abs(abs(turn) - liked) for liked in LIKED) for turn in self.turns) / (45 * DEG)


def best(ways: Sequence[Way], count: int, preference: float) -> list[Way]:
    """The `count` ways of the least length.

    Args:
        preference: how many m of length a turn is worth that is 45 deg nearer to 45 or 90 deg.
    """
    return sorted(ways, key=lambda way: way.length + preference * way.awkwardness)[:count]
