"""The map of a place, in metres: no-go areas, streets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from models.errors import UsageError

Place = tuple[float, float]  # north and east, m


class RouteError(UsageError):
    """A map cannot be used, or no route is to be had on it."""


def rings_of(polygon: shapely.Polygon) -> list[npt.NDArray[np.float64]]:
    """The rings of a polygon: (corners, 2), the first corner not repeated."""
    return [np.array(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]


@dataclass(frozen=True)
class Area:
    """A building, or another area that the animal may not enter.

    Attributes:
        where: what it is, for errors.
        shape: places are (north, east) in m.
    """

    name: str
    where: str
    shape: shapely.Polygon


@dataclass(frozen=True)
class Site:
    """A map about an origin.

    Attributes:
        origin: latitude and longitude of north = east = 0, deg; None if the map does not say where it is.
    """

    name: str
    areas: Sequence[Area] = ()
    streets: Sequence[shapely.LineString] = ()
    origin: tuple[float, float] | None = None
    notes: Sequence[str] = ()

    @cached_property
    def union(self) -> shapely.Geometry:
        """All areas as one."""
        return shapely.union_all([area.shape for area in self.areas])

    def surrounded(self, a: Place, b: Place) -> Place | None:
        """Which of two places the areas keep from the other, where they touch all round it."""
        for area in shapely.get_parts(self.union):
            for ring in area.interiors:
                a_in, b_in = (shapely.Polygon(ring).contains(shapely.Point(place)) for place in (a, b))
                if a_in != b_in:
                    return a if a_in else b
        return None

    def area_at(self, place: Place) -> Area | None:
        """The area that a place is in or at the edge of."""
        point = shapely.Point(place)
        return next((area for area in self.areas if area.shape.intersects(point)), None)
