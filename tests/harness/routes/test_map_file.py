"""Maps in files: what is read of them, and each way to be none, refused by name."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest

from harness.routes.map_file import load
from harness.routes.site import RouteError, Site
from models.earth import ECCENTRICITY_SQUARED, SEMI_MAJOR_AXIS
from tests.harness.routes.maps import box, collection, line, mark, polygon, write

HALL = polygon("hall", box(10, 20, 40, 60))
KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document>
<Placemark><name>gate</name><Point><coordinates>-85.4877,32.6062,200</coordinates></Point></Placemark>
<Placemark><name>hall</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
-85.488,32.6065 -85.487,32.6065 -85.487,32.6067 -85.488,32.6067 -85.488,32.6065
</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
<Placemark><name>lane</name><LineString><coordinates>-85.4877,32.6062 -85.4867,32.6062</coordinates></LineString></Placemark>
</Document></kml>"""  # noqa: E501

MULTI = re.sub(
    "<Placemark><name>.*?</name>(.*?)</Placemark>", r"\1", KML.replace("\n<P", "<P"), flags=re.DOTALL
)
MULTI = MULTI.replace("<Document>", "<Document><Placemark><name>yard</name><MultiGeometry>")
MULTI = MULTI.replace("</Document>", "</MultiGeometry></Placemark></Document>")
TRACK = '<gx:Track xmlns:gx="http://www.google.com/kml/ext/2.2"><gx:coord>-85 32 0</gx:coord></gx:Track>'


def read(path: str, begin: str = "0,0", **options: Any) -> Site:
    found = load(path, **options)
    return found.site(found.point_of("begin", begin))


def test_a_map_in_metres_has_east_before_north_and_places_north_before_east(tmp_path: Path) -> None:
    # given a hall from 10 to 40 m east and 20 to 60 m north, a street to the east, a mark
    path = write(tmp_path, HALL, line("lane", (0, 0), (50, 0)), mark("pond", 7, 9), origin=[-85.5, 32.6])
    # when
    site = read(path)
    # then
    (hall,) = site.areas
    assert (hall.name, hall.where, hall.shape.bounds) == ("hall", "feature 1 (hall)", (20, 10, 60, 40))
    assert [list(street.coords) for street in site.streets] == [[(0, 0), (0, 50)]]
    assert site.origin == (32.6, -85.5)
    pond = load(path).point_of("end", "pond")
    assert load(path).point_of("end", "9,7") == pond
    assert load(path).place_at(pond, (0, 0)) == (9, 7)


def test_a_map_in_degrees_is_laid_about_where_the_route_begins(tmp_path: Path) -> None:
    # given a place 0.001 deg north and east of the begin
    latitude, longitude = 32.6, -85.5
    north = polygon("hut", box(longitude + 0.001, latitude + 0.001, longitude + 0.002, latitude + 0.002))
    site = read(write(tmp_path, north, units=None), f"{latitude},{longitude}")
    # then it is as far as WGS 84 says
    flattening = 1 - ECCENTRICITY_SQUARED * math.sin(math.radians(latitude)) ** 2
    meridian = SEMI_MAJOR_AXIS * (1 - ECCENTRICITY_SQUARED) / flattening**1.5
    parallel = SEMI_MAJOR_AXIS / math.sqrt(flattening) * math.cos(math.radians(latitude))
    corner = math.radians(0.001) * meridian, math.radians(0.001) * parallel
    assert site.areas[0].shape.bounds[:2] == pytest.approx(corner)
    assert site.origin == (latitude, longitude)


def test_a_kml_is_the_map_that_the_same_geojson_is(tmp_path: Path) -> None:
    # given
    (tmp_path / "map.kml").write_text(KML)
    ring = box(-85.488, 32.6065, -85.487, 32.6067)
    lane = line("lane", (-85.4877, 32.6062), (-85.4867, 32.6062))
    same = write(tmp_path, mark("gate", -85.4877, 32.6062), polygon("hall", ring), lane, units=None)
    # when
    kml, geojson = (read(path, "gate") for path in (str(tmp_path / "map.kml"), same))
    # then
    assert kml.areas[0].shape.equals(geojson.areas[0].shape)
    assert kml.streets[0].equals(geojson.streets[0])
    assert (kml.areas[0].name, kml.origin) == ("hall", geojson.origin)


def test_parts_and_holes_are_kept_and_other_shapes_left_out_with_a_note(tmp_path: Path) -> None:
    # given two halls as one feature, one with a court, and points without a name of their own
    halls = polygon("halls")
    halls["geometry"] = {
        "type": "MultiPolygon",
        "coordinates": [[box(0, 20, 10, 30), box(2, 22, 8, 28)], [box(20, 20, 30, 30)]],
    }
    other = {"type": "MultiPoint", "coordinates": [[1, 2], [3, 4]]}
    # when
    site = read(write(tmp_path, halls, {"type": "Feature", "geometry": other}))
    # then
    assert [area.shape.area for area in site.areas] == [100 - 36, 100]
    assert site.notes == [
        f"{tmp_path}/map.geojson: 1 geometry left out, no polygon, line or point: feature 2: MultiPoint"
    ]


def test_of_a_collection_each_part_is_taken_in_collections_within_it_too(tmp_path: Path) -> None:
    # given a hall with the point of its label, a street and points in a collection of a collection
    other = {"type": "MultiPoint", "coordinates": [[1, 2], [3, 4]]}
    inner = collection("", line("", (0, 0), (50, 0)), other)
    path = write(
        tmp_path, collection("hall", HALL, mark("", 25, 40), inner), polygon("hut", box(90, 90, 95, 95))
    )
    # when
    site = read(path)
    # then
    assert [(area.name, area.where) for area in site.areas] == [
        ("hall", "feature 1 (hall), part 1"), ("hut", "feature 2 (hut)"),
    ]  # fmt: skip
    assert [list(street.coords) for street in site.streets] == [[(0, 0), (0, 50)]]
    assert load(path).point_of("end", "hall") == (25, 40)
    assert site.notes == [
        f"{path}: 1 geometry left out, no polygon, line or point: "
        "feature 1 (hall), part 3, part 2: MultiPoint"
    ]


def test_of_a_kml_s_multigeometry_each_part_is_taken(tmp_path: Path) -> None:
    # given a hall with its label's point and a path, as Google Earth writes it
    (tmp_path / "map.kml").write_text(MULTI)
    # when
    site = read(str(tmp_path / "map.kml"), "32.6062,-85.4877")
    # then
    (tmp_path / "map.kml").write_text(KML)
    same = read(str(tmp_path / "map.kml"), "32.6062,-85.4877")
    assert [area.name for area in site.areas] == ["yard"]
    assert site.areas[0].shape.equals(same.areas[0].shape)
    assert site.streets[0].equals(same.streets[0])
    assert site.notes == []


def test_the_option_says_metres_where_the_file_does_not(tmp_path: Path) -> None:
    path = write(tmp_path, HALL, units=None)
    assert read(path, metres=True).areas[0].shape.bounds == (20, 10, 60, 40)


BOW = polygon("bow", [(0, 10), (10, 20), (10, 10), (0, 20), (0, 10)])


@pytest.mark.parametrize(
    ("features", "members", "text"),
    [
        ([], {}, "has no feature; expected polygons of no-go areas, or lines of streets"),
        ([mark("pond", 1, 1)], {}, "has points alone (feature 1 (pond)), no polygon, no line; expected"),
        (
            [{"type": "Feature", "geometry": {"type": "GeometryCollection", "geometries": []}}],
            {},
            "has no polygon and no line (feature 1: GeometryCollection); expected polygons of no-go areas",
        ),
        ([polygon("hall", [(0, 10), ("9", 10), (9, 20), (0, 10)])], {}, 'has the coordinate "9", expected a'),
        ([polygon("hall", [(0, 10), (True, 10), (9, 20), (0, 10)])], {}, "has the coordinate true, expected"),
        ([polygon("hall", [(0, 10), (10**400, 10), (9, 20), (0, 10)])], {}, "has the coordinate 1000"),
        ([polygon("hall", [(0, 10), ([[[]]], 10), (9, 20), (0, 10)])], {}, "feature 1 (hall): is no Polygon"),
        ([HALL], {"origin": [32.6, -85.5]}, "origin: latitude is -85.5, expected -85 to 85 deg. Latitude"),
        ([HALL], {"origin": "12"}, "origin is 12, expected [longitude, latitude] in deg"),
        ([HALL], {"origin": [math.nan, 3]}, "origin: has a coordinate that is no finite number"),
        (
            [polygon("hall", box(32.6, -85.5, 32.601, -85.499))],
            {"units": None},
            "feature 1 (hall): latitude is -85.5, expected -85 to 85 deg. Latitude and longitude look",
        ),
        ([HALL, BOW], {}, "feature 2 (bow): the polygon crosses or touches itself (Self-intersection[5 15]"),
        (
            [HALL],
            {"units": None},
            'feature 1 (hall) reaches 7',  # thousand km
        ),
        (
            [polygon("hall", box(100, 200, 140, 260))],
            {"units": None},
            'feature 1 (hall): latitude is 260, expected -85 to 85 deg. A map in metres says',
        ),
        (
            [HALL, polygon("hut", box(-85.5, 32.6, -85.499, 32.601))],
            {},
            'feature 2 (hut): the polygon has 1e-06 m2, expected 0.25 at least; the map is read in metres: '
            "are its units mixed?",
        ),
        (
            [HALL, polygon("hut", box(0, 100, 10, 110), units="degrees")],
            {},
            'feature 2 (hut): its units are degrees, those of the map are metres; expected the same of all',
        ),
        ([HALL], {"units": "feet"}, 'units is feet, expected "metres" or "degrees"'),
        (
            [HALL],
            {"units": None, "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32616"}}},
            "expected longitude and latitude of WGS 84 (RFC 7946); convert it",
        ),
        ([HALL], {"origin": "Auburn"}, "origin is Auburn, expected [longitude, latitude] in deg"),
        ([polygon("dot", [(1, 1), (2, 2)])], {}, 'feature 1 (dot): is no Polygon'),
        ([polygon("words", [("a", "b")] * 4)], {}, 'feature 1 (words): has the coordinate "b", expected a'),
        ([polygon("empty")], {}, 'feature 1 (empty): has no coordinates'),
        ([HALL, collection("all", HALL, BOW)], {}, "feature 2 (all), part 2: the polygon crosses or touches"),
        ([HALL, collection("all", {"type": 3})], {}, 'feature 2 (all), part 1: is {"type": 3}, expected one'),
        (
            [{"type": "Feature", "geometry": {"type": "GeometryCollection"}}],
            {},
            "feature 1: geometries is none, expected a list",
        ),
        ([HALL, line("dot", (0, 0), (0, 0.004))], {}, "feature 2 (dot): the line is 0.004 m long, expected"),
        ([HALL, line("dot", (0, 0), (0, 0))], {}, "feature 2 (dot): the line is 0 m long, expected 0.1 at"),
        ([polygon("far", box(0, 10, math.inf, 20))], {}, "feature 1 (far): has a coordinate that is no"),
    ],
)  # fmt: skip
def test_a_bad_map_is_refused_by_name(
    features: list[dict[str, Any]], members: dict[str, Any], text: str, tmp_path: Path
) -> None:
    path = write(tmp_path, *features, **members)
    with pytest.raises(RouteError) as refusal:
        read(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert text in str(refusal.value)


def test_a_crs_that_names_wgs_84_is_taken(tmp_path: Path) -> None:
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
    hut = polygon("hut", box(-85.5, 32.6, -85.499, 32.601))
    assert read(write(tmp_path, hut, units=None, crs=crs), "32.599,-85.5").areas


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("map.geojson", "{", "line 1: is no JSON"),
        ("map.geojson", "[1]", "expected a FeatureCollection or a Feature"),
        (
            "map.geojson",
            json.dumps({"type": "Feature", "properties": {"name": "lawn"}, "geometry": None}),
            "feature 1 (lawn) has the geometry none, expected one with a type, such as Point; leave out",
        ),
        (
            "map.geojson",
            '{"type": "Polygon", "units": "metres", "coordinates": ' + 900 * "[" + 900 * "]" + "}",
            "feature 1: is no Polygon",
        ),
        ("map.kml", "<gpx></gpx>", "its first element is <gpx>, expected <kml>"),
        ("map.kml", '<!DOCTYPE x [<!ENTITY a "b">]><kml/>', "has a document type"),
        (
            "map.kml",
            KML.replace("\n-85.488", "\n0,0,0 -85.488"),
            "placemark 2 (hall): has no place, expected longitude,latitude",
        ),
        ("map.kml", re.sub("<Point>.*</Point>", TRACK, KML), "placemark 1 (gate): is no LineString (too few"),
        (
            "map.kml",
            re.sub("<Point>.*</Point>", TRACK, MULTI),
            "placemark 1 (yard): its MultiGeometry has a Track that cannot be read, expected points, lines",
        ),
        (
            "map.kml",
            re.sub("<coordinates>\n[^<]*", "<coordinates>", MULTI),
            "placemark 1 (yard): its MultiGeometry has a Polygon that cannot be read, expected points, lines",
        ),
        ("map\0.kml", KML, "map\\x00.kml: cannot be read (embedded null byte)"),
        ("map.gpx", "", 'the ending is "gpx", expected one of geojson, json, kml'),
    ],
)
def test_what_is_no_map_is_refused(name: str, content: str, text: str, tmp_path: Path) -> None:
    if name.isprintable():
        (tmp_path / name).write_text(content)
    with pytest.raises(RouteError, match="map") as refusal:
        load(str(tmp_path / name))
    assert text in str(refusal.value)


def test_a_missing_map_names_the_one_that_is_meant(tmp_path: Path) -> None:
    with pytest.raises(RouteError, match='there is no map "five_bildings"; did you mean "five_buildings"'):
        load("five_bildings")
    write(tmp_path, HALL, name="yard.geojson")
    with pytest.raises(RouteError, match=r"did you mean .*yard.geojson"):
        load(str(tmp_path / "yart.geojson"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("pont", 'did you mean "pond"?'),
        ("1;2", "expected north,east in m, or a named point of"),
        ("nan,0", "has a coordinate that is no finite number"),
    ],
)
def test_a_place_that_is_none_is_refused(text: str, words: str, tmp_path: Path) -> None:
    path = write(tmp_path, HALL, mark("pond", 1, 1))
    with pytest.raises(RouteError, match=r"^end ") as refusal:
        load(path).point_of("end", text)
    assert words in str(refusal.value)


def test_a_mark_whose_name_another_place_has_is_refused_with_both(tmp_path: Path) -> None:
    # given
    marks = mark("gate", 1, 1), mark("gate", 90, 1), mark("pond", 7, 9), mark("pond", 7, 9)
    found = load(write(tmp_path, HALL, *marks))
    # then
    with pytest.raises(
        RouteError, match=r'end "gate": .* has 2 points .*feature 2 \(gate\) and feature 3 \(gat'
    ):
        found.point_of("end", "gate")
    # and a place that is in the file twice is one
    assert found.point_of("end", "pond") == (7, 9)


def test_latitude_and_longitude_that_look_swapped_are_told(tmp_path: Path) -> None:
    # given a map in Alabama, and one in Germany, where both orders are places on earth
    alabama = load(write(tmp_path, polygon("hut", box(-85.5, 32.6, -85.499, 32.601)), units=None))
    germany = load(write(tmp_path, polygon("hut", box(11.1, 48.1, 11.101, 48.101)), units=None))
    # then
    with pytest.raises(RouteError, match=r'begin "-85.5,32.6": latitude is -85.5, .*look swapped'):
        alabama.point_of("begin", "-85.5,32.6")
    with pytest.raises(RouteError, match=r"\(hut\) reaches \d+ km .*\(11.1,48.09\).*look swapped"):
        germany.site(germany.point_of("begin", "11.1,48.09"))
    with pytest.raises(RouteError, match=r"reaches \d+ km .*A map in metres says"):
        germany.site(germany.point_of("begin", "0,0"))
