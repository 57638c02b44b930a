"""Maps in files: GeoJSON and KML.

Polygons are no-go areas, lines are streets, points with a name are places. KML is in degrees, and so is
GeoJSON (RFC 7946: longitude before latitude), unless it says `"units": "metres"` beside its features, or
`--metres` is given: then coordinates are metres, east before north, and a member
`"origin": [longitude, latitude]` may say where [0, 0] is.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import shape
from shapely.validation import explain_validity

from harness.files import in_words, nearest_file
from harness.log.geodesy import TangentPlane
from harness.routes import MAPS
from harness.routes.site import Area, Place, RouteError, Site
from harness.station.draft import MissionFileError
from harness.station.formats import geojson
from models.errors import nearest, printable

SHIPPED = Path(__file__).with_name("maps")
MAX_BYTES = 16 * 2**20
FARTHEST = 20_000.0  # m from where the route begins; a map in other units is farther
SMALLEST = 0.25  # m2: an area smaller than this is no building; it is in other units, or damaged
SHORTEST = 0.1  # m: nor is a line that is shorter a street
METRES, DEGREES = "metres", "degrees"
HINT = ' A map in metres says "units": "metres" beside its features, or takes --metres'
SWAPPED = (
    ". Latitude and longitude look swapped: the coordinates of a file are longitude before latitude, places "
    "that are given with it latitude before longitude"
)
EXPECTED = "expected polygons of no-go areas, or lines of streets"
MAX_LATITUDE, MAX_LONGITUDE = 85.0, 180.0  # deg
CRS84 = ("CRS84", "EPSG:4326", "EPSG::4326")  # names of what GeoJSON has been in before RFC 7946, and is in
BROKEN = (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError)  # of Shapely, by it
LINES = ("LineString", "LinearRing", "MultiLineString")
POLYGONS = ("Polygon", "MultiPolygon")
COLLECTION = "GeometryCollection"

Point = tuple[float, float]  # x and y, as the file has them: longitude or east, latitude or north


@dataclass(frozen=True)
class Figure:
    """A feature of a map as its file has it, x before y."""

    where: str
    name: str
    shape: shapely.Geometry


@dataclass(frozen=True)
class Map:
    """A map as its file has it.

    Attributes:
        label: of the file, for errors.
        origin: latitude and longitude of [0, 0], deg, where a map in metres says so.
    """

    name: str
    label: str
    units: str
    figures: list[Figure]
    origin: tuple[float, float] | None = None
    notes: list[str] = field(default_factory=list)

    def point_of(self, name: str, text: str) -> Point:
        """A place as a user names it: a named point, or latitude,longitude or north,east.

        Raises:
            RouteError: it is neither, or several points have this name.
        """
        pair = "latitude,longitude in deg" if self.units == DEGREES else "north,east in m"
        named: dict[str, dict[Point, str]] = {}  # by name and place, what each is called in errors
        for figure in self.figures:
            if figure.shape.geom_type == "Point" and figure.name:
                named.setdefault(figure.name, {})[figure.shape.x, figure.shape.y] = figure.where
        if text in named:
            (point, where), *others = named[text].items()
            if others:
                raise RouteError(
                    f'{name} "{text}": {self.label} has {len(named[text])} points of this name, {where} and '
                    f"{others[0][1]}; expected one: give another a name of its own, or take {pair}"
                )
            return point
        try:
            y, x = map(float, text.split(","))
        except ValueError:
            hint = nearest(text, named) if named else ""
            raise RouteError(
                f'{name} "{text}": expected {pair}, or a named point of {self.label}{hint}'
            ) from None
        _check_numbers(f'{name} "{text}"', np.array([[x, y]]), self.units)
        return x, y

    def site(self, begin: Point, origin: tuple[float, float] | None = None) -> Site:
        """The map in metres.

        Args:
            begin: where the route begins; the origin of a map in degrees.
            origin: latitude and longitude, deg, of [0, 0] of a map in metres; overrides the file's.

        Raises:
            RouteError: a feature is none that can be used, or lies too far away.
        """
        if origin is not None:
            if self.units == DEGREES:
                raise RouteError(f"origin: {self.label} is in degrees; expected it with a map in metres")
            _check_origin(origin)
        at = self.origin if origin is None else origin
        if self.units == DEGREES:
            at = begin[1], begin[0]
        areas: list[Area] = []
        streets: list[shapely.LineString] = []
        for figure in self.figures:
            self.check_distance(
                f"{self.label}: {figure.where} reaches", shapely.get_coordinates(figure.shape), begin
            )
            laid = shapely.transform(figure.shape, lambda points: self._metres(points, begin))
            parts = list(getattr(laid, "geoms", [laid]))
            if laid.geom_type in POLYGONS:
                areas += [self._area(figure, part, len(areas) + 1) for part in parts]
            elif laid.geom_type in LINES:
                streets += [self._street(figure, part) for part in parts]
        if not areas and not streets:
            raise RouteError(
                f"{self.label}: has points alone ({self.figures[0].where}), no polygon, no line; {EXPECTED}"
            )
        return Site(self.name, areas, streets, at, self.notes)

    def place_at(self, point: Point, begin: Point) -> Place:
        """A point of the file in metres to the north and the east."""
        north, east = self._metres(np.array([point]), begin)[0]
        return float(north), float(east)

    def _metres(self, points: Any, begin: Point) -> Any:
        """(n, 2) x and y as the file has them to (n, 2) north and east in m."""
        if self.units == METRES:
            return points[:, ::-1]
        plane = TangentPlane(math.radians(begin[1]), math.radians(begin[0]))
        north, east = plane.to_plane(np.radians(points[:, 1]), np.radians(points[:, 0]))
        return np.column_stack((north, east))

    def _area(self, figure: Figure, polygon: shapely.Polygon, number: int) -> Area:
        """A polygon as an area, checked."""
        if polygon.area < SMALLEST:
            raise RouteError(
                f"{self.label}: {figure.where}: the polygon has {polygon.area:.2g} m2, expected {SMALLEST:g} "
                f"at least; the map is read in {self.units}: are its units mixed?"
            )
        return Area(figure.name or f"area {number}", figure.where, polygon)

    def _street(self, figure: Figure, line: shapely.LineString) -> shapely.LineString:
        """A line as a street, checked."""
        if line.length < SHORTEST:
            raise RouteError(
                f"{self.label}: {figure.where}: the line is {line.length:.2g} m long, expected {SHORTEST:g} "
                f"at least; the map is read in {self.units}: are its units mixed?"
            )
        return shapely.LineString(line.coords)

    def check_distance(self, what: str, points: Any, begin: Point) -> None:
        """Refuse places that are too far from where the route begins.

        Args:
            what: they are, with a verb, for the error.
            points: (n, 2) x and y, as the file has them.

        Raises:
            RouteError: one is.
        """

        def farthest(points: Any) -> float:
            away = self._metres(points, begin) - self._metres(np.array([begin]), begin)
            return float(np.hypot(*away.T).max(initial=0.0))

        far = farthest(points)
        if far > FARTHEST:
            hint = HINT if self.units == DEGREES else ""
            if self.units == DEGREES and farthest(points[:, ::-1]) <= FARTHEST:
                hint = SWAPPED
            raise RouteError(
                f"{what} {far / 1000:.0f} km from where the route begins ({begin[1]:.10g},{begin[0]:.10g}), "
                f"expected {FARTHEST / 1000:g} km at most; the map is read in {self.units}: are its units "
                f"mixed?{hint}"
            )


def _check_numbers(where: str, places: Any, units: str, hint: str = HINT) -> None:
    """Refuse coordinates, x before y, that are none of these units."""
    if not np.isfinite(places).all():
        raise RouteError(f"{where}: has a coordinate that is no finite number")
    if units == METRES:
        return
    most = np.abs(places).max(axis=0)
    swapped = SWAPPED if most[0] <= MAX_LATITUDE and most[1] <= MAX_LONGITUDE else ""
    for axis, name, limit in ((0, "longitude", MAX_LONGITUDE), (1, "latitude", MAX_LATITUDE)):
        worst = places[np.abs(places[:, axis]).argmax(), axis]
        if abs(worst) > limit:
            raise RouteError(
                f"{where}: {name} is {worst:.10g}, expected -{limit:g} to {limit:g} deg{swapped}.{hint}"
            )


def load(target: str, *, metres: bool = False) -> Map:
    """The map of a file, or the shipped one of this name.

    Args:
        metres: a GeoJSON's coordinates are metres, whatever it says.

    Raises:
        RouteError: it cannot be read, is no map, has no feature, or one that is not what it should be.
    """
    path = Path(target)
    if not path.suffix and not path.exists() and target in shipped():
        path = SHIPPED / f"{target}.geojson"
    ending = path.suffix.lower().lstrip(".")
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        hint = nearest_file(path) if path.suffix else nearest(target, shipped())
        raise RouteError(f'there is no map "{target}"{hint}') from None
    except OSError as reason:
        raise RouteError(f"{target}: cannot be read ({reason.strerror})") from None
    except ValueError as reason:  # a path with a null byte
        raise RouteError(f"{printable(target)}: cannot be read ({reason})") from None
    if ending not in MAPS:
        raise RouteError(f'{target}: the ending is "{ending}", expected one of {", ".join(MAPS)}')
    if len(data) > MAX_BYTES:
        raise RouteError(
            f"{target}: has more than {MAX_BYTES // 2**20} MiB; cut it to the place of the route"
        )
    try:
        return (_read_kml if ending == "kml" else _read_geojson)(path.stem, target, data, metres)
    except (MissionFileError, RouteError) as reason:
        raise RouteError(f"{target}: {reason}") from None


def shipped() -> list[str]:
    """The names of the maps that come with the project."""
    return sorted(path.stem for path in SHIPPED.glob("*.geojson"))


def _read_geojson(name: str, label: str, data: bytes, metres: bool) -> Map:
    content = geojson.content_of(data)
    units = METRES if metres else _units_of(content)
    raw = []
    for feature in geojson.features_of(content):
        own = feature.properties.get("units", units)
        if own != units:
            raise RouteError(
                f"{feature.where}: its units are {printable(in_words(own))}, those of the map are {units}; "
                "expected the same of all"
            )
        raw.append((feature.where, feature.name, feature.geometry))
    return _map(name, label, units, raw, _origin_of(content))


def _units_of(content: dict[str, Any]) -> str:
    """Degrees, unless the file says something else."""
    units, crs = content.get("units", DEGREES), content.get("crs")
    if units not in (METRES, DEGREES):
        raise RouteError(f'units is {printable(in_words(units))}, expected "{METRES}" or "{DEGREES}"')
    if crs is not None and units == DEGREES and not _name_of(crs).endswith(CRS84):
        raise RouteError(
            f"crs is {printable(in_words(crs))}, expected longitude and latitude of WGS 84 (RFC 7946); "
            'convert it, or say "units": "metres" if its axes are east and north in m'
        )
    return str(units)


def _name_of(crs: object) -> str:
    """The name in a `crs` member, as files before RFC 7946 have it."""
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    return name if isinstance(name, str) else ""


def _origin_of(content: dict[str, Any]) -> tuple[float, float] | None:
    """Latitude and longitude of [0, 0]."""
    origin = content.get("origin")
    if origin is None:
        return None
    if not isinstance(origin, list) or len(origin) != 2 or not all(map(_is_number, origin)):
        raise RouteError(f"origin is {printable(in_words(origin))}, expected [longitude, latitude] in deg")
    longitude, latitude = map(float, origin)
    _check_origin((latitude, longitude))
    return latitude, longitude


def _check_origin(origin: tuple[float, float]) -> None:
    _check_numbers("origin", np.array([origin[::-1]]), DEGREES, hint="")


def _read_kml(name: str, label: str, data: bytes, metres: bool) -> Map:
    if metres:
        raise RouteError("KML is in degrees; expected --metres with GeoJSON alone")
    from harness.station.formats import kml  # noqa: PLC0415 - fastkml, which GeoJSON does without

    raw = []
    for where, mark in kml.placemarks(data):
        if mark.geometry is None:
            continue
        try:
            raw.append((where, mark.name, mark.geometry.__geo_interface__))
        except AttributeError:  # of pygeoif
            raise RouteError(f"{where}: is no {mark.geometry.geom_type} (too few places)") from None
    return _map(name, label, DEGREES, raw, None)


def _is_number(value: object) -> bool:
    """Is it a number that a coordinate can be? A whole one may be larger than any float."""
    return isinstance(value, float) or (type(value) is int and abs(value) <= sys.float_info.max)


def _check_types(where: str, coordinates: object) -> None:
    """Refuse coordinates that are not numbers: a text that reads as one is a sign of a damaged file."""
    left = [coordinates]
    while left:
        each = left.pop()
        if isinstance(each, list | tuple):
            left += each
        elif not _is_number(each):
            raise RouteError(
                f"{where}: has the coordinate {printable(in_words([each]))[1:-1]}, expected a number"
            )


def _parts(where: str, geometry: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """A geometry, or the parts of a collection and of those in it, each behind what errors call it."""
    if geometry["type"] != COLLECTION:
        return [(where, geometry)]
    parts, single = geometry.get("geometries"), []
    if not isinstance(parts, list | tuple):
        raise RouteError(f"{where}: geometries is {printable(in_words(parts))}, expected a list")
    for number, part in enumerate(parts, start=1):
        of_part = f"{where}, part {number}"
        if not isinstance(part, dict) or not isinstance(part.get("type"), str):
            raise RouteError(
                f"{of_part}: is {printable(in_words(part))}, expected one with a type, such as Polygon"
            )
        single += _parts(of_part, part)
    return single or [(where, geometry)]


def _map(
    name: str,
    label: str,
    units: str,
    raw: list[tuple[str, object, Any]],
    origin: tuple[float, float] | None,
) -> Map:
    """A map of features: what each is called, its name, its geometry."""
    figures, others = [], []
    parts = [(where, named, part) for own, named, whole in raw for where, part in _parts(own, whole)]
    for where, named, geometry in parts:
        if geometry["type"] not in ("Point", *LINES, *POLYGONS):
            others.append(f"{where}: {printable(in_words(geometry['type']))}")
            continue
        _check_types(where, geometry.get("coordinates"))
        try:
            figure = shapely.force_2d(shape(geometry))
        except (*BROKEN, shapely.GEOSException) as reason:
            raise RouteError(f"{where}: is no {geometry['type']} ({printable(reason)})") from None
        if figure.is_empty:
            raise RouteError(f"{where}: has no coordinates")
        _check_numbers(where, shapely.get_coordinates(figure), units)
        if geometry["type"] in POLYGONS and not figure.is_valid:
            raise RouteError(
                f"{where}: the polygon crosses or touches itself ({explain_validity(figure)}, as the file "
                "writes places); expected edges that meet at corners alone: mend it there"
            )
        figures.append(Figure(where, printable(named) if isinstance(named, str) else "", figure))
    if not figures:
        lack = f"no polygon and no line ({others[0]})" if others else "no feature"
        raise RouteError(f"has {lack}; {EXPECTED}")
    notes = []
    if others:
        plural = "ies" if len(others) > 1 else "y"
        notes.append(
            f"{label}: {len(others)} geometr{plural} left out, no polygon, line or point: {others[0]}"
        )
    return Map(name, label, units, figures, origin, notes)
