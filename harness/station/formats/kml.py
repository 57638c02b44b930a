"""KML: the line, or else the points; a point "home"; the polygon is the fence."""

from __future__ import annotations

import io
import math
from typing import Any
from xml.etree import ElementTree

import fastkml
from fastkml.exceptions import FastKMLError
from fastkml.utils import find_all
from pygeoif import LineString, Point, Polygon

from harness.files import in_words
from harness.station.draft import DIGITS, FENCE, NUMBER, Draft, MissionFileError, pair
from harness.station.formats.shapes import Shape, labelled, of_shapes, ring
from harness.station.formats.xml import MAX_ELEMENTS, plain_xml
from models.errors import printable

GEOMETRIES = {"Point", "LineString", "LinearRing", "Polygon", "MultiGeometry", "Model", "Track", "MultiTrack"}


def read(data: bytes) -> Draft:
    """The mission in such a file.

    Raises:
        MissionFileError: it holds none, or several.
    """
    return of_shapes([_shape(*labelled_mark) for labelled_mark in placemarks(data, MAX_ELEMENTS)])


def placemarks(data: bytes, most: float = math.inf) -> list[tuple[str, Any]]:
    """The placemarks of such a file, of so many elements at most, each behind what errors call it.

    Raises:
        MissionFileError: the data is not KML, or a place in it is not longitude,latitude.
    """
    plain = plain_xml(data, "kml", most)
    for number, element in enumerate(ElementTree.fromstring(plain).iterfind(".//{*}Placemark"), start=1):
        _check(_where(number, element.findtext("{*}name")), element)
    try:
        document = fastkml.KML.parse(io.BytesIO(plain), strict=True, validate=False)
        marks: list[Any] = list(find_all(document, of_type=fastkml.Placemark))
        for mark in marks:
            mark.geometry  # noqa: B018 - made here, of what the file holds
    except (FastKMLError, ValueError, TypeError, AttributeError) as reason:
        raise MissionFileError(f"is no KML: {printable(reason)}") from None
    named = [(_where(number, mark.name), mark) for number, mark in enumerate(marks, start=1)]
    for where, mark in named:
        if mark.geometry is None and mark.kml_geometry is not None:
            raise MissionFileError(f"{where}: has no place, expected longitude,latitude in deg")
    return named


def _where(number: int, name: str | None) -> str:
    """What errors call a placemark."""
    return f"placemark {number}" + (f" ({printable(in_words(name))})" if name else "")


def _check(where: str, placemark: ElementTree.Element) -> None:
    """Refuse what the library would leave out or misread.

    It reads the first of several geometries alone, leaves out a place that is NaN and parts without a place,
    and takes 1_0 for 10.
    """
    names = [name for child in placemark if (name := child.tag.rpartition("}")[2]) in GEOMETRIES]
    if len(names) > 1:
        raise MissionFileError(f"{where}: has {' and '.join(names)}, expected one; give each a placemark")
    for part in placemark.iterfind(".//{*}MultiGeometry/*"):
        kind = part.tag.rpartition("}")[2]
        texts = [coordinates.text or "" for coordinates in part.iterfind(".//{*}coordinates")]
        is_read = kind not in ("Model", "Track", "MultiTrack") and texts and all(map(str.strip, texts))
        if kind in GEOMETRIES and not is_read:
            raise MissionFileError(
                f"{where}: its MultiGeometry has a {kind} that cannot be read, expected points, lines and "
                "polygons, each with coordinates"
            )
    for coordinates in placemark.iterfind(".//{*}coordinates"):
        for number in (coordinates.text or "").replace(",", " ").split():
            if not NUMBER.fullmatch(number):
                shown = printable(in_words(number))
                raise MissionFileError(f'{where}: a place has "{shown}", expected longitude,latitude in deg')


def _shape(where: str, mark: Any) -> Shape:
    geometry = mark.geometry
    match geometry:
        case Point():
            places: list[Any] = list(geometry.coords)
        case Polygon():
            if list(geometry.interiors):
                raise MissionFileError(f"{where}: the polygon has holes, expected none")
            places = list(geometry.exterior.coords)
        case LineString():
            places = list(geometry.coords)
        case _:
            places = []
    return Shape(where, mark.name, type(geometry).__name__, places)


def write(draft: Draft, name: str) -> bytes:
    """A mission of this name as such a file."""

    def mark(label: str, geometry: Point | Polygon) -> fastkml.Placemark:
        return fastkml.Placemark(name=label, geometry=geometry)

    marks = [mark(label, Point(*reversed(pair(position)))) for label, position in labelled(draft)]
    if draft.fence:
        marks.append(mark(FENCE, Polygon(ring(draft.fence))))
    document = fastkml.Document(name=name, features=marks)
    return fastkml.KML(features=[document]).to_string(prettyprint=True, precision=DIGITS).encode()
