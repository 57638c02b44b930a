"""GPX: the route, or else the waypoints, or else one track; a waypoint "home"; a route "fence"."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import gpxpy
from gpxpy.gpx import GPX, GPXException, GPXRoute, GPXRoutePoint, GPXWaypoint

from harness.files import in_words
from harness.onboard.radio import Position
from harness.station.draft import (
    FENCE,
    HOME,
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
from harness.station.formats.xml import plain_xml
from models.errors import printable

POINTS = ("wpt", "rtept", "trkpt")


def read(data: bytes) -> Draft:
    """The mission in such a file.

    Raises:
        MissionFileError: it holds none, or several.
    """

    def see(line: int, name: str, attributes: dict[str, str]) -> None:
        if name.rpartition(":")[2] in POINTS:
            place_of(f"line {line}", attributes.get("lat"), attributes.get("lon"))

    plain = plain_xml(data, "gpx", see=see)
    try:
        gpx = gpxpy.parse(plain)
    except (GPXException, ValueError) as reason:
        raise MissionFileError(f"is no GPX: {printable(reason)}") from None
    fences = [route for route in gpx.routes if _is(FENCE, route)]
    routes = [route for route in gpx.routes if not _is(FENCE, route)]
    homes = [point for point in gpx.waypoints if _is(HOME, point)]
    marks = [point for point in gpx.waypoints if not _is(HOME, point)]
    tracks = [segment for track in gpx.tracks for segment in track.segments]
    for found, what in ((routes, "routes"), (fences, 'routes of the name "fence"')):
        if len(found) > 1:
            names = listed(printable(in_words(route.name or "without a name")) for route in found)
            raise MissionFileError(f"holds {len(found)} {what} ({names}), expected one: leave one of them")
    notes: list[str] = []
    if routes:
        points: Iterable[Any] = routes[0].points
        notes = [*left_out(len(marks), "waypoint beside the route"), *left_out(len(tracks), "track")]
    elif marks:
        points, notes = marks, left_out(len(tracks), "track")
    elif len(tracks) > 1:
        raise MissionFileError(f"holds {len(tracks)} tracks, expected a route, or waypoints")
    else:
        points = tracks[0].points if tracks else ()
    return Draft(
        sole(list(_positions(homes))),
        tuple(_positions(points)),
        opened(_positions(fences[0].points if fences else ())),
        tuple(notes),
    )


def _is(word: str, element: GPXWaypoint | GPXRoute) -> bool:
    """Has the element this name or type?"""
    return is_named(element.name, word) or is_named(element.type, word)


def _positions(points: Iterable[Any]) -> Iterator[Position]:
    for point in points:
        yield Position(point.latitude, point.longitude)


def write(draft: Draft, name: str) -> bytes:
    """A mission of this name as such a file."""
    gpx = GPX()
    gpx.name, gpx.creator = name, "canine station"
    if draft.home:
        latitude, longitude = pair(draft.home)
        gpx.waypoints.append(GPXWaypoint(latitude, longitude, name=HOME, type=HOME))
    for label, positions in (("waypoints", draft.waypoints), (FENCE, draft.fence)):
        if positions:
            route = GPXRoute(name=label)
            route.type = FENCE if label == FENCE else None
            route.points = [
                GPXRoutePoint(latitude, longitude, name=f"{label.removesuffix('s')} {number}")
                for number, (latitude, longitude) in enumerate(map(pair, positions), start=1)
            ]
            gpx.routes.append(route)
    return f"{gpx.to_xml(prettyprint=True)}\n".encode()
