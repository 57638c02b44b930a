"""Points, lines and polygons of a map, and the mission that they make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from harness.files import in_words
from harness.onboard.radio import Position
from harness.station.draft import (
    HOME,
    WAYPOINT,
    Draft,
    MissionFileError,
    is_named,
    left_out,
    listed,
    opened,
    pair,
    place_of,
    sole,
)
from models.errors import printable


@dataclass(frozen=True)
class Shape:
    """A point, line or polygon of a file.

    Attributes:
        where: what it is, for errors.
        kind: Point, LineString or Polygon; another kind is left out.
        places: (longitude, latitude), perhaps with a height.
    """

    where: str
    name: object
    kind: str
    places: list[Any]

    def positions(self) -> tuple[Position, ...]:
        """Checked."""
        for place in self.places:
            if not isinstance(place, list | tuple) or len(place) < 2:
                raise MissionFileError(
                    f"{self.where}: a place is {printable(in_words(place))}, expected longitude, latitude"
                )
        return tuple(place_of(self.where, place[1], place[0]) for place in self.places)


def of_shapes(shapes: list[Shape]) -> Draft:
    """The mission that shapes make."""
    by_kind = {
        kind: [shape for shape in shapes if shape.kind == kind] for kind in ("Point", "LineString", "Polygon")
    }
    points, lines, polygons = by_kind.values()
    homes = [shape for shape in points if is_named(shape.name, HOME)]
    marks = [shape for shape in points if not is_named(shape.name, HOME)]
    for found, what in ((lines, "lines"), (polygons, "polygons")):
        if len(found) > 1:
            names = listed(shape.where for shape in found)
            raise MissionFileError(f"holds {len(found)} {what} ({names}), expected one: leave one of them")
    way = lines or marks
    others = len(shapes) - sum(map(len, by_kind.values()))
    notes = [
        *(left_out(len(marks), "point beside the line") if lines else []),
        *left_out(others, "shape that is no point, line or polygon"),
    ]
    return Draft(
        sole([position for shape in homes for position in shape.positions()]),
        tuple(position for shape in way for position in shape.positions()),
        opened(polygons[0].positions() if polygons else ()),
        tuple(notes),
    )


def labelled(draft: Draft) -> list[tuple[str, Position]]:
    """Home and waypoints with the names that they get in a file."""
    home = [(HOME, draft.home)] if draft.home else []
    return [*home, *((f"{WAYPOINT} {i}", place) for i, place in enumerate(draft.waypoints, start=1))]


def ring(fence: tuple[Position, ...]) -> list[tuple[float, float]]:
    """Longitude and latitude of the corners, the first again at the end."""
    return [(longitude, latitude) for latitude, longitude in map(pair, (*fence, fence[0]))]
