"""Routes that are proposed in the station: asked of `canine plan`, compared on the map, used, led."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from harness.log.geodesy import TangentPlane
from harness.onboard.radio import Position
from harness.station import proposals
from harness.station.draft import MissionFileError, pair
from harness.station.opening import report
from harness.station.proposals import Proposals
from models.errors import CanineError
from tests.browser import OpenPage
from tests.harness.station.browser import Served, simulated, unheard
from tests.harness.station.dogs import obedient
from tests.harness.station.hands import begin, enter, until, warnings
from tests.harness.station.played_station import HOME, MISSION, RUNNING, URL, PlayedStation
from tests.harness.station.test_server import request

if TYPE_CHECKING:
    from playwright.sync_api import FilePayload, Page

PLANE = TangentPlane(*map(math.radians, HOME))
HUT = [(14.0, -4.0), (22.0, -4.0), (22.0, 5.0), (14.0, 5.0)]  # north and east of home, m: on the way north
END = pair(Position(*PLANE.place(35.73, 35.73)))


def map_of(*areas: list[tuple[float, float]], **members: object) -> bytes:
    """A map in degrees with these areas."""
    rings = [[pair(Position(*PLANE.place(*place)))[::-1] for place in (*area, area[0])] for area in areas]
    features = [
        {
            "type": "Feature",
            "properties": {"name": "hut"},
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }
        for ring in rings
    ]
    return json.dumps({"type": "FeatureCollection", "features": features, **members}).encode()


def ask(data: bytes, name: str = "yard.geojson") -> Any:
    return asyncio.run(Proposals().ask(name, data, Position(*HOME), Position(*END)))


def test_routes_are_those_of_a_plan_in_degrees() -> None:
    # when
    answer = ask(map_of(HUT))
    # then the area comes back, and each route leads round it to the end
    (area,) = answer["areas"]
    assert area["name"] == "hut"
    expected = {pair(Position(*PLANE.place(*place))) for place in HUT}
    assert {tuple(round(degrees, 6) for degrees in place) for place in area["rings"][0]} == {
        tuple(round(degrees, 6) for degrees in place) for place in expected
    }
    assert [route["waypoints"][-1] for route in answer["routes"]] == [END] * len(answer["routes"])
    assert sum(route["recommended"] for route in answer["routes"]) == 1
    assert max(route["success_rate"] for route in answer["routes"]) > 0.8
    assert any("not yours" in text for text in answer["assumes"])


@pytest.mark.parametrize(
    ("data", "name", "text"),
    [
        (map_of(HUT), "yard.gpx", 'yard.gpx: the ending is "gpx", expected one of geojson, json, kml'),
        (b"{", "yard.json", "yard.json: line 1: is no JSON"),
        (b"{", "\U00010330" * 70 + ".json", ".json: line 1: is no JSON"),
        (map_of([(-5, -5), (5, -5), (5, 5), (-5, 5)]), "../yard.geojson", "yard: begin "),
        (
            map_of(HUT, units="metres"),
            "yard.geojson",
            "yard.geojson: feature 1 (hut): the polygon has",
        ),
    ],
)  # fmt: skip
def test_a_map_that_cannot_be_used_is_refused_by_its_name(data: bytes, name: str, text: str) -> None:
    with pytest.raises(MissionFileError) as refusal:
        ask(data, name)
    assert text in str(refusal.value)
    assert "/tmp" not in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_map_in_metres_is_refused() -> None:
    # given a plan's content whose map was in metres
    content = {
        "origin": [0.0, 0.0],
        "areas": [],
        "routes": [],
        "recommended": None,
        "assumes": [],
        "notes": [],
    }
    for origin in (content["origin"], None):
        with pytest.raises(MissionFileError, match="yard: is in metres"):
            proposals._shaped({**content, "origin": origin}, "yard", Position(*HOME))


def test_a_machine_without_room_for_a_plan_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    with pytest.raises(CanineError, match=r"^yard.geojson: .* \(.*none.*: No such file.* make room"):
        ask(map_of(HUT))


def test_a_program_that_a_plan_lacks_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(CanineError, match=r"\(nice: No such file .* install what is missing"):
        ask(map_of(HUT))


def test_one_plan_runs_at_a_time_and_one_that_takes_too_long_is_killed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(proposals, "LONGEST_S", 0.2)

    async def two() -> list[Any]:
        one = Proposals()
        asked = (one.ask("yard.geojson", map_of(HUT), Position(*HOME), Position(*END)) for _ in range(2))
        return list(await asyncio.gather(*asked, return_exceptions=True))

    first, second = asyncio.run(two())
    assert isinstance(first, CanineError)
    assert "the plan took more than 0.2 s" in str(first)
    assert "a plan is under way" in str(second)


@pytest.fixture(scope="module")
def silent(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with unheard(tmp_path_factory.mktemp("silent")) as running:
        yield running


def test_the_server_refuses_places_that_are_none_and_maps_that_are_too_large(silent: Served) -> None:
    places = f"from={HOME[0]},{HOME[1]}&to={END[0]},{END[1]}"
    for query, data, text in (
        ("name=yard.geojson&from=1&to=2,3", map_of(HUT), "from: longitude is"),
        ("name=yard.geojson", map_of(HUT), "from: latitude is"),
        (f"name=yard.geojson&{places}", b"x" * (proposals.MAX_BYTES + 1), "the map has more than"),
        (f"name=yard.exe&{places}", map_of(HUT), "expected one of geojson, json, kml"),
    ):
        status, _, answer = request(silent, "POST", f"/routes?{query}", data)
        assert status == 400
        assert text in json.loads(answer)["error"]


# the page

ROUTES: dict[str, Any] = {
    "areas": [{"name": "hut", "rings": [[list(pair(Position(*PLANE.place(*place)))) for place in HUT]]}],
    "routes": [
        {
            "label": "60 m, 3 m clear, unsplit", "success_rate": 0.9996, "entry_rate": 0.0,
            "mean_time_s": 30.2, "mean_commands": 3.14, "recommended": False,
            "waypoints": [[32.6063, -85.4876], list(END)],
        },
        {
            "label": "62 m, 6 m clear, unsplit", "success_rate": 0.951, "entry_rate": 0.0004,
            "mean_time_s": 28.0, "mean_commands": 2.0, "recommended": True,
            "waypoints": [[32.6063, -85.4878], list(END)],
        },
    ],
    "assumes": ["the dog is that of Table 5.1"],
    "notes": ["1 candidate left out"],
}  # fmt: skip


@pytest.fixture
def station() -> PlayedStation:
    return PlayedStation()


@pytest.fixture
def page(station: PlayedStation, open_page: OpenPage) -> Iterator[Page]:
    visit = open_page(URL, prepare=station.prepare)
    visit.page.get_by_text(station.hello["source"]).wait_for()
    station.state(draft=MISSION)
    visit.page.click("#tab-routes")
    yield visit.page
    assert visit.harm() == []


def choose(page: Page, data: bytes = b"{}") -> None:
    payload: FilePayload = {"name": "yard.geojson", "mimeType": "application/json", "buffer": data}
    page.set_input_files("#buildings", payload)


def test_routes_are_compared_on_the_map_and_one_becomes_the_mission(
    page: Page, station: PlayedStation
) -> None:
    # given a map; before there is one nothing can be asked
    assert page.locator("#propose").is_disabled()
    assert page.locator("#use-route").is_disabled()
    choose(page)
    station.answers["/routes"] = (200, json.dumps(ROUTES).encode())
    # when routes are asked for
    page.click("#propose")
    page.get_by_text(
        "Route 2 of 2 is recommended; 1 candidate left out; it is assumed that the dog"
    ).wait_for()
    # then the question was the mission's, and area and routes are on the map, the recommended one thick
    (path, query, body), *_ = station.posts
    last = MISSION["waypoints"][-1]
    assert (path, body) == ("/routes", b"{}")
    assert query == f"name=yard.geojson&from={HOME[0]},{HOME[1]}&to={last[0]},{last[1]}"
    assert page.locator("#map .area").count() == 1
    assert page.locator("#map .proposal").count() == 2
    assert page.locator("#map .proposal.chosen").count() == 1
    assert page.locator("#routes button").all_inner_texts() == [
        "> 99.9 % get there, 0.0 % enter an area, 30 s, 3.1 stimuli: 60 m, 3 m clear, unsplit",
        "95.1 % get there, < 0.1 % enter an area, 28 s, 2.0 stimuli: 62 m, 6 m clear, unsplit",
    ]
    # in sight
    panel, route = (page.locator(what).first.bounding_box() for what in ("#desk-panels", "#routes button"))
    assert panel
    assert route
    assert panel["y"] <= route["y"]
    assert route["y"] + route["height"] <= panel["y"] + panel["height"]
    # and the one that is looked at last is used; undo takes it back
    page.locator("#routes button").first.click()
    assert page.locator("#routes [aria-pressed=true]").count() == 1
    page.click("#use-route")
    station.await_order(
        "draft", lambda order: order["mission"]["waypoints"] == ROUTES["routes"][0]["waypoints"]
    )
    page.click("#undo")
    orders = station.orders("draft")
    station.await_order("draft", lambda order: order["mission"] == MISSION and order is not orders[0])


def test_areas_are_drawn_on_the_map_and_routes_are_asked_for_round_them(
    page: Page, station: PlayedStation
) -> None:
    # given the tool for areas, and two corners, which are none yet
    page.get_by_role("button", name="Area", exact=True).click()
    box = page.locator("#map").bounding_box()
    assert box
    corners = [(0.3, 0.3), (0.3, 0.5), (0.5, 0.5), (0.5, 0.3)]
    for right, down in corners[:2]:
        page.mouse.click(box["x"] + right * box["width"], box["y"] + down * box["height"])
    assert page.locator("#end-area").is_disabled()
    # when two more make it one
    for right, down in corners[2:]:
        page.mouse.click(box["x"] + right * box["width"], box["y"] + down * box["height"])
    assert page.locator("#propose").is_disabled()
    page.click("#end-area")
    assert page.locator("#map .area").count() == 1
    page.get_by_text("1 area is drawn").wait_for()
    station.answers["/routes"] = (200, json.dumps(ROUTES).encode())
    page.click("#propose")
    page.get_by_text("Route 2 of 2 is recommended").wait_for()
    # then the question has it as a map: longitude first, the first corner again, and no place of the mission
    (_, query, body), *_ = station.posts
    assert query.startswith(f"name=drawn.geojson&from={HOME[0]},{HOME[1]}&")
    (feature,) = json.loads(body)["features"]
    (ring,) = feature["geometry"]["coordinates"]
    assert (len(ring), ring[0]) == (5, ring[-1])
    west, east = ring[0][0], ring[2][0]
    north, south = ring[0][1], ring[2][1]
    assert ring[:4] == [[west, north], [west, south], [east, south], [east, north]]
    assert west < east
    assert south < north
    assert abs(north - HOME[0]) < 0.01
    assert abs(west - HOME[1]) < 0.01
    assert not station.orders("draft")
    # and a file takes their place
    choose(page)
    assert page.locator("#map .area").count() == 0
    assert page.locator("#clear-areas").is_disabled()


def test_why_there_are_no_routes_is_said(page: Page, station: PlayedStation) -> None:
    station.answers["/routes"] = (400, json.dumps({"error": "yard.geojson: has no feature"}).encode())
    choose(page)
    page.click("#propose")
    page.get_by_text("Routes: yard.geojson: has no feature").wait_for()
    assert page.locator("#propose").is_enabled()


def test_who_watches_asks_for_no_routes(page: Page, station: PlayedStation) -> None:
    choose(page)
    station.state(**{**RUNNING, "commander": 2, "operators": [1, 2]})
    for button in ("#buildings", "#add-area-corner", "#end-area", "#propose", "#use-route"):
        assert page.locator(button).is_disabled()


def test_a_route_is_planned_uploaded_and_led_in_a_browser(open_page: OpenPage, tmp_path: Path) -> None:
    # given the mission of a scenario whose dog obeys, and a hut on its first leg
    with simulated(tmp_path / "out", speed=20.0, scenario=obedient(tmp_path)) as station:
        visit = enter(station, open_page)
        page = visit.page
        until(page, page.locator("#scenario").is_enabled)
        page.click("#scenario")
        page.click("#tab-routes")
        choose(page, map_of(HUT))
        # when the operator takes the recommended route, and leads it
        page.click("#propose")
        until(page, lambda: page.locator("#routes [aria-pressed=true]").count() == 1)
        page.click("#use-route")
        page.click("#tab-mission")
        until(page, page.locator("#upload").is_enabled)
        page.click("#upload")
        begin(page)
        until(page, lambda: page.get_by_text("The trial has ended").count() == 1)
        # then the dog was led to the end and home
        assert page.get_by_text("The trial has ended: success").count() == 1, warnings(page)
        waypoints = page.locator("#map .waypoint:not(.home)").count()
        assert visit.errors == []
    summary = report(tmp_path / "out")
    assert summary is not None
    assert (summary["outcome"], summary["waypoints_reached"]) == ("success", waypoints)
