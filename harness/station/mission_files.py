"""Missions in files: GPX, KML, GeoJSON, CSV, and scenarios in TOML.

What a file may hold, whoever wrote it:

    GPX       the route, or else the waypoints, or else one short track; a waypoint "home"; a route "fence"
    KML       the line, or else the points; a point "home"; the polygon is the fence
    GeoJSON   as KML; the name is the property `name`
    CSV       a header with latitude and longitude, in deg; `kind` is waypoint (the default), home or fence
    TOML      the waypoints, the start and the fence of a scenario, about its origin

Positions are written to 1e-7 deg, as the radio sends them: a mission that was written reads back as the same,
id included. What a reader leaves out is told in `Draft.notes`. Nothing in a file is followed or expanded: an
XML file with a document type is refused before its entities are read.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from harness.files import nearest_file
from harness.station.draft import Draft, MissionFileError, pair
from harness.station.formats import geojson, gpx, kml, scenario, table
from harness.trial.scenario import SHIPPED, shipped
from models.cmec import MAX_WAYPOINTS
from models.errors import nearest, printable
from models.fence import fault_of

MAX_BYTES = 2**20  # a route of 16 places has 2 kB; a receiver's file with a track has some 100


def load(target: str) -> Draft:
    """The mission of a file, or of the shipped scenario of this name.

    Raises:
        MissionFileError: there is no such file, or it holds no mission.
    """
    path = Path(target)
    if not path.suffix and not path.exists() and target in shipped():
        path = SHIPPED / f"{target}.toml"
    try:
        with path.open("rb") as file:
            return read(path.name, file.read(MAX_BYTES + 1))
    except FileNotFoundError:
        hint = nearest_file(path) if path.suffix else nearest(target, shipped())
        raise MissionFileError(f'there is no file "{target}"{hint}') from None
    except OSError as reason:
        raise MissionFileError(f"{target}: cannot be read ({reason.strerror})") from None


def read(name: str, data: bytes) -> Draft:
    """The mission in a file's bytes; the name's ending tells the format.

    Raises:
        MissionFileError: the format is unknown, the file is no such file or too large, it holds no waypoint,
            too many, or several routes, a position is out of range, or the fence is no polygon.
    """
    shown, ending = printable(Path(name).name), Path(name).suffix.lower().lstrip(".")
    if ending not in READERS:
        raise MissionFileError(f'{shown}: the ending is "{ending}", expected one of {", ".join(READERS)}')
    if len(data) > MAX_BYTES:
        raise MissionFileError(f"{shown}: has more than {MAX_BYTES} bytes; is it the right file?")
    if data.startswith(b"PK\x03\x04"):
        raise MissionFileError(f"{shown}: is a ZIP archive, such as KMZ; unzip it, and take the file inside")
    try:
        return _sound(READERS[ending](data))
    except MissionFileError as reason:
        raise MissionFileError(f"{shown}: {reason}") from None


def write(draft: Draft, to: str, name: str = "mission") -> bytes:
    """A mission as a file.

    Args:
        to: one of FORMATS.
        name: of the mission, in the file.

    Raises:
        MissionFileError: the format is unknown, or the mission has nothing to write.
    """
    if to not in FORMATS:
        raise MissionFileError(
            f'a mission is written to "{printable(to)}", expected one of {", ".join(FORMATS)}'
        )
    if not draft.waypoints:
        raise MissionFileError("the mission has no waypoint yet: mark one before it is written")
    return FORMATS[to](draft, name)


def _sound(draft: Draft) -> Draft:
    """The draft of a file, if it can become a mission."""
    if not draft.waypoints:
        raise MissionFileError(f"holds no waypoint, expected 1 to {MAX_WAYPOINTS}")
    if len(draft.waypoints) > MAX_WAYPOINTS:
        raise MissionFileError(f"holds {len(draft.waypoints)} waypoints, expected 1 to {MAX_WAYPOINTS}")
    if draft.fence and (fault := fault_of([pair(corner) for corner in draft.fence])):
        raise MissionFileError(f"its fence is no polygon: {fault}")
    return draft


READERS: dict[str, Callable[[bytes], Draft]] = {
    "gpx": gpx.read,
    "kml": kml.read,
    "geojson": geojson.read,
    "json": geojson.read,
    "csv": table.read,
    "toml": scenario.read,
}
FORMATS: dict[str, Callable[[Draft, str], bytes]] = {
    "gpx": gpx.write,
    "kml": kml.write,
    "geojson": geojson.write,
    "csv": table.write,
    "toml": scenario.write,
}
