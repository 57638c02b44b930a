"""Missions in files: what each format holds, the way there and back, and files that do harm or are none."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import fastkml
import gpxpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.onboard.radio import Mission, Position
from harness.station.draft import Draft, MissionFileError, as_json, from_json
from harness.station.formats import geojson
from harness.station.mission_files import FORMATS, MAX_BYTES, load, read, write

HOME = Position(32.6062, -85.4877)
DRAFT = Draft(
    HOME,
    (Position(32.6065, -85.4877), Position(32.6065123, -85.4872001)),
    (Position(32.606, -85.488), Position(32.607, -85.488), Position(32.6065, -85.486)),
)


def mission(draft: Draft) -> Mission:
    return Mission(draft.home or HOME, draft.waypoints, draft.fence)


def fault(name: str, data: bytes) -> str:
    with pytest.raises(MissionFileError) as caught:
        read(name, data)
    return str(caught.value)


@pytest.mark.parametrize("ending", FORMATS)
def test_a_mission_that_is_written_reads_back_with_the_same_id(ending: str) -> None:
    draft = read(f"mission.{ending}", write(DRAFT, ending))
    assert mission(draft).id == mission(DRAFT).id
    assert draft.notes == ()


@pytest.mark.parametrize("ending", FORMATS)
@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)), min_size=1, max_size=16),
    st.sampled_from([(32.6, -85.4), (-54.8, 179.9), (0.0, 0.0)]),
)
def test_each_place_comes_back_to_a_ten_millionth_of_a_degree(
    ending: str, offsets: list[tuple[float, float]], origin: tuple[float, float]
) -> None:
    there = [Position(origin[0] + north, (origin[1] + east + 180) % 360 - 180) for north, east in offsets]
    back = read(f"x.{ending}", write(Draft(Position(*origin), tuple(there)), ending))
    for one, other in zip(there, back.waypoints, strict=True):
        assert other.latitude == pytest.approx(one.latitude, abs=1e-7)
        eastward = (other.longitude - one.longitude + 180) % 360 - 180
        assert eastward == pytest.approx(0, abs=1e-7)


@pytest.mark.parametrize("ending", ["gpx", "kml", "geojson", "csv"])
def test_a_mission_without_home_and_fence_has_none_in_its_file(ending: str) -> None:
    draft = read(f"x.{ending}", write(Draft(waypoints=DRAFT.waypoints), ending))
    assert (draft.home, draft.fence) == (None, ())


def test_a_gpx_of_others_gives_its_route_and_tells_what_it_leaves_out() -> None:
    draft = read(
        "walk.GPX",
        b"""<?xml version="1.0"?>
        <gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">
          <wpt lat="1" lon="2"><name>Home</name></wpt>
          <wpt lat="9" lon="9"><name>a tree</name></wpt>
          <rte><name>round</name><rtept lat="1.1" lon="2"/><rtept lat="1.2" lon="2"/></rte>
          <trk><trkseg><trkpt lat="3" lon="3"/></trkseg></trk>
        </gpx>""",
    )
    assert draft.home == Position(1, 2)
    assert draft.waypoints == (Position(1.1, 2), Position(1.2, 2))
    assert draft.notes == ("1 waypoint beside the route left out", "1 track left out")


def test_a_gpx_without_a_route_gives_its_waypoints_or_else_its_track() -> None:
    marks = b'<gpx><wpt lat="1" lon="2"/><trk><trkseg><trkpt lat="3" lon="3"/></trkseg></trk></gpx>'
    track = b'<gpx><trk><trkseg><trkpt lat="3" lon="4"/><trkpt lat="3" lon="5"/></trkseg></trk></gpx>'
    assert read("a.gpx", marks).waypoints == (Position(1, 2),)
    assert read("a.gpx", track).waypoints == (Position(3, 4), Position(3, 5))


@pytest.mark.parametrize("space", ["http://www.opengis.net/kml/2.2", "http://earth.google.com/kml/2.1"])
def test_a_kml_of_others_gives_the_line_in_its_folders(space: str) -> None:
    draft = read(
        "earth.kml",
        f"""<?xml version="1.0" encoding="UTF-8"?><kml xmlns="{space}"><Document><Folder>
        <Placemark><name>Path</name><LineString><coordinates>2,1,300 2.5,1.5,300</coordinates></LineString>
        </Placemark></Folder><Placemark><name>HOME</name><Point><coordinates>2,0</coordinates></Point></Placemark>
        <Placemark><name>yard</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
        0,0 5,0 5,5 0,5 0,0</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
        </Document></kml>""".encode(),
    )
    assert (draft.home, draft.waypoints) == (Position(0, 2), (Position(1, 2), Position(1.5, 2.5)))
    assert draft.fence == (Position(0, 0), Position(0, 5), Position(5, 5), Position(5, 0))


def test_a_bare_geometry_is_geojson_and_other_shapes_are_counted() -> None:
    line = {"type": "LineString", "coordinates": [[2, 1], [3, 1, 200]]}
    several = {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "properties": None, "geometry": line},
            {"type": "MultiPoint", "coordinates": [[1, 1]]},
            {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [7, 7]}},
        ],
    }
    assert read("a.json", json.dumps(line).encode()).waypoints == (Position(1, 2), Position(1, 3))
    draft = read("a.geojson", json.dumps(several).encode())
    assert draft.waypoints == (Position(1, 2), Position(1, 3))
    assert draft.notes == (
        "1 point beside the line left out",
        "1 shape that is no point, line or polygon left out",
    )


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_a_table_needs_only_two_columns_and_tells_which_it_leaves_out(delimiter: str) -> None:
    rows = [["Lon", "LAT", "height"], ["2.5", " 1.5", "300"], ["", "", ""], ["3", "1", ""]]
    draft = read("a.csv", "\ufeff".encode() + "\r\n".join(map(delimiter.join, rows)).encode())
    assert draft.waypoints == (Position(1.5, 2.5), Position(1, 3))
    assert draft.notes == ("columns left out: height",)


def test_a_scenario_gives_its_start_as_home() -> None:
    draft = load("three_waypoint")
    assert len(draft.waypoints) == 2
    assert draft.home == Position(32.6062, -85.4877)
    north = (draft.waypoints[0].latitude - HOME.latitude) * 110_900
    assert north == pytest.approx(35.73, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.txt", b"", 'a.txt: the ending is "txt", expected one of gpx, kml, geojson'),
        ("a.gpx", b"<gpx>" + b" " * MAX_BYTES, f"more than {MAX_BYTES} bytes"),
        ("a.kml", b"PK\x03\x04rest", "a.kml: is a ZIP archive, such as KMZ; unzip it"),
        ("a.gpx", b"<kml/>", "its first element is <kml>, expected <gpx>"),
        ("a.gpx", b"", "line 1: is no XML (no element found)"),
        ("a.gpx", b"<gpx>\n<rte></gpx>", "line 2: is no XML (mismatched tag)"),
        ("a.gpx", b'<gpx>\n<wpt lat="91" lon="0"/></gpx>', 'line 2: latitude is 91, expected -90 to 90 deg'),
        ("a.gpx", b'<gpx>\n<wpt lat="nan" lon="0"/></gpx>', "line 2: latitude is nan, expected"),
        ("a.gpx", b'<gpx>\n<wpt lat="1"/></gpx>', "line 2: longitude is none, expected -180 to 180 deg"),
        ("a.gpx", b'<gpx><wpt lat="1" lon="1"><ele>x</ele></wpt></gpx>', "a.gpx: is no GPX: Invalid value"),
        ("a.gpx", b"<gpx/>", "a.gpx: holds no waypoint, expected 1 to 16"),
        ("a.gpx", b'<gpx>' + b'<wpt lat="1" lon="1"/>' * 17 + b"</gpx>", "holds 17 waypoints, expected"),
        ("a.gpx", b"<gpx><rte><name>x</name></rte><rte/></gpx>", "2 routes (x, without a name), expected"),
        ("a.gpx", b'<?xml version="1.0" encoding="nonsense"?><gpx/>', "an encoding that cannot be read"),
        ("a.kml", b'<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>p</name><Point><coordinates>1'
                  b"</coordinates></Point></Placemark></kml>", "placemark 1 (p): has no place, expected"),
        ("a.kml", b'<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><Point><coordinates>a,b'
                  b"</coordinates></Point></Placemark></kml>", 'placemark 1: a place has "a", expected'),
        ("a.kml", b'<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark/><Placemark><Point>'
                  b"<coordinates>1,2</coordinates></Point><Polygon/></Placemark></kml>",
                  "placemark 2: has Point and Polygon, expected one; give each a placemark"),
        ("a.gpx", b'<gpx>\n<wpt lat="4_5" lon="0"/></gpx>', "line 2: latitude is 4_5, expected"),
        ("a.gpx", '<gpx>\n<wpt lat="\u0664" lon="0"/></gpx>'.encode(), "latitude is \u0664, expected"),
        ("a.gpx", b'<gpx xmlns="x" xmlns:g="x">\n<g:wpt lat="nan" lon="0"/></gpx>', "2: latitude is nan"),
        ("a.gpx", b"<gpx><g:trk/></gpx>", "is no XML (unbound prefix"),
        ("a.json", b'{"type": "Point", "coordinates": ["1_0", 5]}', "feature 1: longitude is 1_0, expected"),
        ("a.csv", b"lat,lon\n1_0,2\n", "line 2: latitude is 1_0, expected"),
        ("a.json", b'{"type":\n}', "line 2: is no JSON (Expecting value)"),
        ("a.json", b"[1]", "is [1], expected a FeatureCollection"),
        ("a.json", b'{"type": "Point", "coordinates": [0, 95]}', "feature 1: latitude is 95, expected"),
        ("a.json", b'{"type": "Point", "coordinates": [true, 5]}', "feature 1: longitude is true, expected"),
        ("a.json", b'{"type": "Point", "coordinates": "here"}', "a place is here, expected longitude"),
        ("a.json", b'{"type": "Point", "coordinates": [1' + b"0" * 5000 + b", 5]}", "is no JSON that can be"),
        ("a.csv", b"1.5,2.5\n", 'line 1: the header is "1.5, 2.5", expected one column latitude or lat'),
        ("a.csv", b"lat,lon\n1.5\n", "line 2: has 1 columns, expected 2 as line 1"),
        ("a.csv", b"lat,lon\n1,2\n1.5,x\n", "line 3: longitude is x, expected -180 to 180 deg"),
        ("a.csv", b"kind,lat,lon\ntree,1,2\n", 'line 2: kind is "tree", expected one of home'),
        ("a.csv", b"kind,lat,lon\nhome,1,2\nhome,1,2\n", 'holds 2 places of the name "home"'),
        ("a.csv", b"lat,lon\n\xff,2\n", "line 2: is not UTF-8"),
        ("a.csv", b"kind,lat,lon\nwaypoint,1,2\nfence,0,0\nfence,1,1\nfence,2,2\n", "fence is no polygon"),
        ("a.toml", b"waypoints = [[1.0]]", "a.toml: waypoints[1] is [1.0]; expected a pair"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_told_with_its_name_and_line(name: str, data: bytes, words: str) -> None:
    assert fault(name, data).startswith(f"{name}: ")
    assert words in fault(name, data)


BOMB = "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise("abcdefghij"))


@pytest.mark.parametrize("root", ["gpx", "kml"])
@pytest.mark.parametrize(
    "doctype",
    [
        f'<!DOCTYPE x [<!ENTITY a "lol">{BOMB}]>',
        '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE x SYSTEM "http://127.0.0.1:9/x.dtd">',
    ],
    ids=["billion laughs", "a file", "a request"],
)
def test_a_document_type_is_refused_before_an_entity_is_read(root: str, doctype: str) -> None:
    data = f'<?xml version="1.0"?>\n{doctype}\n<{root}><name>&a;</name></{root}>'.encode()
    assert "line 2: has a document type" in fault(f"a.{root}", data)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.gpx", b"<gpx>" + b"<a>" * 100_000),
        ("a.kml", b'<kml xmlns="http://www.opengis.net/kml/2.2">' + b"<Folder>" * 60_000),
        ("a.json", b"[" * 200_000),
        ("a.json", b'{"a":' * 100_000),
    ],
)
def test_what_is_nested_too_deep_is_refused(name: str, data: bytes) -> None:
    assert "nested" in fault(name, data) or "is no JSON" in fault(name, data)


@pytest.mark.parametrize("name", ["a.gpx", "a.kml", "a.geojson", "a.csv", "a.toml"])
@given(st.binary(max_size=200), st.integers(0, 400), st.integers(0, 255))
def test_whatever_bytes_a_file_has_it_is_read_or_refused(name: str, data: bytes, at: int, byte: int) -> None:
    good = bytearray(write(DRAFT, name.partition(".")[2]))
    good[at % len(good)] = byte
    for content in (data, bytes(good)):
        try:
            draft = read(name, content)
        except MissionFileError:  # any other error fails the test
            continue
        assert 1 <= len(draft.waypoints) <= 16


POINT = json.dumps({"type": "Point", "coordinates": [1, 1]})
MARK = b"<Placemark><Point><coordinates>1,1</coordinates></Point></Placemark>"
LINE = b"<Placemark><LineString><coordinates>1,1 1,2</coordinates></LineString></Placemark>"
KML = b'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>%b</Document></kml>'


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.csv", b"lat,lon\n" + b"\n" * 1001, "has more than 1000 rows"),
        ("a.gpx", b"<gpx>" + b"<rte/>\n" * 5000 + b"</gpx>", "line 5000: has more than 5000 elements"),
        ("a.kml", KML % (MARK * 1667), "line 1: has more than 5000 elements"),
        (
            "a.json",
            f'{{"type": "FeatureCollection", "features": [{",".join([POINT] * 1001)}]}}'.encode(),
            "has 1001 features, expected up to 1000",
        ),
    ],
)
def test_what_is_no_mission_but_a_map_is_refused_before_a_library_reads_it(
    name: str, data: bytes, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for library in (gpxpy, fastkml, geojson):
        for reader in ("parse", "KML", "of_shapes"):
            monkeypatch.delattr(library, reader, raising=False)
    assert words in fault(name, data)


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.gpx", b"<gpx>" + b"<rte/>" * 1000 + b"</gpx>", "without a name and 995 more), expected one"),
        ("a.kml", KML % (LINE * 1000), "placemark 4, placemark 5 and 995 more), expected one"),
        ("a.json", json.dumps([[1] * 100_000]).encode(), "..., expected a FeatureCollection"),
    ],
)  # fmt: skip
def test_what_there_is_too_much_of_is_told_in_few_words(name: str, data: bytes, words: str) -> None:
    assert words in fault(name, data)
    assert len(fault(name, data)) < 250


@pytest.mark.parametrize("place", ["nan,2", "1_0,2", "1,\u0662", "inf,2"])
@pytest.mark.parametrize(
    "shape",
    [
        "<Point><coordinates>{}</coordinates></Point>",
        "<LineString><coordinates>3,4 {} 5,6</coordinates></LineString>",
        "<Polygon><outerBoundaryIs><LinearRing><k:coordinates xmlns:k='http://www.opengis.net/kml/2.2'>"
        "0,0 0,1 {} 1,0 0,0</k:coordinates></LinearRing></outerBoundaryIs></Polygon>",
    ],
    ids=["point", "line", "polygon"],
)
def test_no_place_of_a_kml_is_left_out_or_misread(shape: str, place: str) -> None:
    data = KML % (MARK + f"<Placemark>{shape.format(place)}</Placemark>".encode())
    assert "a place has" in fault("a.kml", data)


@pytest.mark.parametrize("number", ["1" * 60_000 + "x", "0" * 60_000 + "1"])
def test_a_number_of_many_digits_is_refused(number: str) -> None:
    with pytest.raises(MissionFileError, match=r"home: latitude is [01]+\.\.\., expected -90 to 90 deg"):
        from_json({"home": [number, "2"]})


@pytest.mark.parametrize("aside", [b"<!-- the gate -->", b"<![CDATA[ ]]>"])
def test_a_text_goes_on_behind_a_comment(aside: bytes) -> None:
    line = b"<LineString><coordinates>1,1 %b 1,2 1,3</coordinates></LineString>" % aside
    way = b'<gpx><wpt lat="0" lon="0"><name>%bhome</name></wpt><wpt lat="1" lon="1"/></gpx>' % aside.strip()
    assert len(read("a.kml", KML % (b"<Placemark>%b</Placemark>" % line)).waypoints) == 3
    assert read("a.gpx", way).home == Position(0, 0)


@pytest.mark.parametrize(
    ("aside", "words"),
    [
        (b"<?pi x?>", "line 2: has an instruction (<?pi) among the elements; remove it"),
        (b"<b/>", "has an element <b>, expected text alone"),
        (b"<b>x</b>", "has an element <b>, expected text alone"),
    ],
)
def test_no_text_is_cut_short_by_what_stands_within_it(aside: bytes, words: str) -> None:
    line = b"<LineString>\n<coordinates>1,1 1,2 %b 1,3 nan,5</coordinates></LineString>" % aside
    assert words in fault("a.kml", KML % (b"<Placemark>%b</Placemark>" % line))
    for text in (b"<name>ho%bme</name>", b"<type>%bhome</type>"):
        way = b'<gpx>\n<wpt lat="0" lon="0">%b</wpt><wpt lat="1" lon="1"/></gpx>' % (text % aside)
        assert words in fault("a.gpx", way)


def test_an_instruction_before_the_first_element_is_no_fault() -> None:
    assert read("a.kml", b'<?xml-stylesheet href="a.css"?>' + KML % LINE).waypoints


def test_a_place_that_is_wrong_is_named_with_its_placemark() -> None:
    wrong = MARK.replace(b"<Point>", b'<name x="a&gt;b">gate</name><Point>').replace(b"1,1", b"1,x")
    assert 'placemark 2 (gate): a place has "x", expected' in fault("a.kml", KML % (MARK + wrong))


def test_an_attribute_of_a_place_may_hold_any_sign() -> None:
    odd = LINE.replace(b"<coordinates>", b'<coordinates x="a>b">')
    assert len(read("a.kml", KML % odd).waypoints) == 2


def test_a_fence_and_home_are_known_however_they_are_spelt() -> None:
    corners = b'<rtept lat="0" lon="0"/><rtept lat="0" lon="5"/><rtept lat="5" lon="5"/>'
    draft = read("a.gpx", b'<gpx><wpt lat="1" lon="1"/><rte><name>Fence</name>%b</rte></gpx>' % corners)
    assert draft.fence == (Position(0, 0), Position(0, 5), Position(5, 5))
    assert draft.waypoints == (Position(1, 1),)


def test_a_file_name_from_a_browser_is_no_path() -> None:
    assert fault("../../etc/x.csv", b"").startswith("x.csv: line 1: the header")


def test_a_mission_file_that_is_not_there_is_told_with_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "field.gpx").write_bytes(write(DRAFT, "gpx"))
    assert mission(load(str(tmp_path / "field.gpx"))).id == mission(DRAFT).id
    with pytest.raises(MissionFileError, match=r"did you mean .*field\.gpx"):
        load(str(tmp_path / "fild.gpx"))
    with pytest.raises(MissionFileError, match="three_waypoint"):
        load("three_waypont")
    with pytest.raises(MissionFileError, match="cannot be read"):
        load(str(tmp_path))


def test_nothing_is_written_without_a_waypoint_or_in_an_unknown_format() -> None:
    with pytest.raises(MissionFileError, match="no waypoint yet"):
        write(Draft(HOME), "gpx")
    with pytest.raises(MissionFileError, match='written to "shp", expected one of gpx, kml'):
        write(DRAFT, "shp")
    far = Draft(HOME, (Position(-32.6, 0.0),))
    with pytest.raises(MissionFileError, match="makes no scenario"):
        write(far, "toml")


def test_a_draft_from_a_browser_may_be_incomplete() -> None:
    assert from_json(json.loads(json.dumps(as_json(DRAFT)))) == DRAFT
    assert from_json({"home": None}) == Draft()
    assert from_json({"waypoints": [[1, 2]], "fence": [[1, 2]]}).fence == (Position(1, 2),)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (None, "the mission is none, expected home, waypoints and fence"),
        ({"home": [1]}, "home is [1], expected a pair [latitude, longitude] in deg"),
        ({"home": [1, 181]}, "home: longitude is 181, expected -180 to 180 deg"),
        ({"home": [1, float("inf")]}, "home: longitude is Infinity, expected"),
        ({"waypoints": {}}, "waypoints is {}, expected up to 16 pairs"),
        ({"waypoints": [[0, 0]] * 17}, "waypoints has 17 places, expected up to 16 pairs"),
        ({"fence": [[0, 0]] * 8}, "fence has 8 places, expected up to 7 pairs"),
        ({"fence": [[0, 0], "x"]}, "fence[2] is x, expected a pair"),
    ],
)
def test_a_draft_of_another_form_is_refused(value: object, words: str) -> None:
    with pytest.raises(MissionFileError) as caught:
        from_json(value)
    assert words in str(caught.value)
