"""The station's page in a real browser, against a station that the test plays."""

from __future__ import annotations

import base64
import json
import math
import struct
from typing import TYPE_CHECKING, Any

import pytest

from harness.log.geodesy import TangentPlane
from models.commands import Command
from models.modes import Mode
from tests.browser import DESK, TABLET, OpenPage, Visit
from tests.harness.station import vector_tiles
from tests.harness.station.played_station import (
    HELLO,
    HOME,
    ME,
    MISSION,
    OTHER,
    READY,
    RUNNING,
    TELEMETRY,
    URL,
    PlayedStation,
)
from tests.harness.station.vector_tiles import LINE, POLYGON, Feature

if TYPE_CHECKING:
    from playwright.sync_api import FilePayload, Page

PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


@pytest.fixture
def station() -> PlayedStation:
    return PlayedStation()


@pytest.fixture
def visit(station: PlayedStation, open_page: OpenPage) -> Visit:
    return opened(station, open_page)


def opened(station: PlayedStation, open_page: OpenPage, **how: Any) -> Visit:
    visit = open_page(URL, prepare=station.prepare, **how)
    visit.page.get_by_text(station.hello["source"]).wait_for()
    station.state(draft=MISSION if not station.hello["replay"] else None)
    return visit


@pytest.fixture
def page(visit: Visit) -> Page:
    return visit.page


def spot(page: Page, right: float, down: float) -> tuple[float, float]:
    """A point of the window, by its share of the map."""
    box = page.locator("#map").bounding_box()
    assert box
    return box["x"] + right * box["width"], box["y"] + down * box["height"]


def click_map(page: Page, right: float, down: float) -> None:
    page.mouse.click(*spot(page, right, down))
    page.wait_for_timeout(50)


def middle(page: Page, selector: str) -> tuple[float, float]:
    box = page.locator(selector).first.bounding_box()
    assert box
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def tool(page: Page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


# the mission


def test_a_mission_is_marked_by_clicks_and_uploaded(page: Page, station: PlayedStation) -> None:
    page.click("#clear")
    tool(page, "Waypoint")
    click_map(page, 0.3, 0.3)
    click_map(page, 0.7, 0.3)
    page.click("#upload")
    draft = station.await_order("draft", lambda order: len(order["mission"]["waypoints"]) == 2)["mission"]
    station.await_order("upload")
    (north, west), (same, east) = draft["waypoints"]
    assert draft["home"] == HOME
    assert north == pytest.approx(same, abs=1e-6)
    assert west < east
    assert station.sent.index({"do": "upload"}) > station.sent.index({"do": "draft", "mission": draft})
    rows = page.locator("#places tbody tr").all_inner_texts()
    assert [row.split("\t")[0].strip() for row in rows] == ["H", "1", "2", "H"]


def test_legs_have_their_lengths_and_turns(page: Page) -> None:
    rows = [row.split() for row in page.locator("#places tbody tr").all_inner_texts()]
    meridian, parallel = 110_909.0, 93_868.0  # m per degree at 32.6 deg, by another formula
    lengths = [0.00032 * meridian, 0.00038 * parallel]
    assert [float(rows[1][1]), float(rows[2][1])] == pytest.approx(lengths, rel=1e-3)
    assert rows[2][2:4] == ["90", "R"]
    assert float(rows[3][-3]) == pytest.approx(math.hypot(*lengths), rel=1e-3)


def test_a_waypoint_is_inserted_on_a_leg_dragged_and_deleted(page: Page, station: PlayedStation) -> None:
    tool(page, "Waypoint")
    one, two = middle(page, "[aria-label^='waypoint 1']"), middle(page, "[aria-label^='waypoint 2']")
    page.mouse.click((one[0] + two[0]) / 2, (one[1] + two[1]) / 2)
    inserted = station.await_order("draft", lambda order: len(order["mission"]["waypoints"]) == 3)["mission"]
    assert inserted["waypoints"][0] == MISSION["waypoints"][0]
    assert inserted["waypoints"][2] == MISSION["waypoints"][1]

    page.mouse.move(*two)
    page.mouse.down()
    page.mouse.move(two[0] - 10, two[1] + 40, steps=4)
    page.mouse.up()
    order = station.await_order(
        "draft", lambda order: order["mission"]["waypoints"][-1] != MISSION["waypoints"][1]
    )
    moved = order["mission"]["waypoints"][-1]
    assert moved[0] < MISSION["waypoints"][1][0]

    page.locator("[aria-label^='waypoint 2']").first.press("Delete")
    left = [MISSION["waypoints"][0], moved]
    station.await_order("draft", lambda order: order["mission"]["waypoints"] == left)


def test_the_mission_is_edited_by_keyboard_alone_and_undone(page: Page, station: PlayedStation) -> None:
    latitude = page.get_by_label("latitude of waypoint 2 in deg")
    latitude.fill("32.607")
    latitude.press("Enter")
    station.await_order("draft", lambda order: order["mission"]["waypoints"][1][0] == 32.607)
    page.locator("[aria-label^='waypoint 1']").first.press("ArrowUp")
    page.wait_for_timeout(50)
    page.get_by_label("earlier waypoint 2").press("Enter")
    page.get_by_label("latitude of waypoint 1 in deg").wait_for()
    assert page.get_by_label("latitude of waypoint 1 in deg").input_value() == "32.6070000"
    moved = float(page.get_by_label("latitude of waypoint 2 in deg").input_value())
    assert (moved - 32.60652) * 110_909 == pytest.approx(0.5, abs=0.02)
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    assert page.get_by_label("latitude of waypoint 1 in deg").input_value() == "32.6065200"
    page.keyboard.press("Control+y")
    assert float(page.get_by_label("latitude of waypoint 1 in deg").input_value()) == moved

    latitude.fill("north")
    latitude.press("Enter")
    assert 'latitude of waypoint 2 is "north", expected a number' in page.locator("#said").inner_text()


def test_a_fence_has_seven_corners_at_most(page: Page, station: PlayedStation) -> None:
    tool(page, "Fence")
    for i in range(8):
        click_map(page, 0.5 + 0.4 * math.sin(i), 0.5 + 0.35 * math.cos(i))
    station.await_order("draft", lambda order: len(order["mission"]["fence"]) == 7)
    station.wait(400)
    assert max(len(order["mission"]["fence"]) for order in station.orders("draft")) == 7
    assert "fence of 7 corners" in page.locator("#total").inner_text()
    assert page.locator("#map path.fence").count() == 1


def test_what_is_on_board_and_differs_is_dashed(page: Page, station: PlayedStation) -> None:
    station.state(link="loaded", draft=MISSION, on_board={"id": 6874, "mission": MISSION})
    assert page.locator("#map .differs").count() == 0
    assert page.locator("#map .waypoint.new").count() == 0
    assert page.locator("#on-board").inner_text() == "Mission 1ada: on screen is what is on board"
    assert page.locator("#upload").is_disabled()
    station.state(**{**READY, "on_board": {"id": 6874, "mission": OTHER}})
    assert page.locator("#map .leg.differs").count() == 1
    assert page.locator("#map .waypoint.new").count() == 1
    dashes = page.locator("#map .leg.differs").evaluate("line => getComputedStyle(line).strokeDasharray")
    assert dashes != "none"
    assert page.locator("#start").is_disabled()


def test_files_are_imported_and_exported_by_the_station(page: Page, station: PlayedStation) -> None:
    station.answers["/import"] = (
        200,
        json.dumps({**OTHER, "home": None, "notes": ["1 track left out"]}).encode(),
    )
    page.set_input_files("#import", file("walk.gpx", b"<gpx/>"))
    order = station.await_order("draft", lambda order: order["mission"]["waypoints"] == OTHER["waypoints"])
    assert order["mission"]["home"] == HOME  # the file has none
    assert page.locator("#said").inner_text() == "walk.gpx: 2 waypoints; 1 track left out"
    station.answers["/export"] = (200, b"kind,latitude,longitude\n")
    with page.expect_download() as download:
        page.select_option("#export", "csv")
    assert download.value.suggested_filename == "mission.csv"
    station.answers["/import"] = (400, json.dumps({"error": "x.kml: holds no waypoint"}).encode())
    page.set_input_files("#import", file("x.kml", b"<kml/>"))
    page.get_by_text("Import: x.kml: holds no waypoint").wait_for()
    (path, query, body), (_, to, sent), _ = station.posts
    assert (path, query, body) == ("/import", "name=walk.gpx", b"<gpx/>")
    assert (to, json.loads(sent)["mission"]["waypoints"]) == ("to=csv", OTHER["waypoints"])


# conduct


def test_start_is_given_by_holding_for_a_second_and_not_before(page: Page, station: PlayedStation) -> None:
    station.state(**READY)
    page.mouse.move(*middle(page, "#start"))
    page.mouse.down()
    station.wait(500)
    page.mouse.up()
    station.wait(800)
    assert station.orders("start") == []
    page.mouse.down()
    station.await_order("start")
    page.mouse.up()
    station.sent.clear()
    page.keyboard.down("g")
    station.await_order("start")
    page.keyboard.up("g")


def test_start_that_the_focus_leaves_is_not_given(page: Page, station: PlayedStation) -> None:
    station.state(**READY)
    page.keyboard.down("g")
    page.evaluate("window.dispatchEvent(new Event('blur'))")
    station.wait(1400)
    assert station.orders("start") == []


def test_each_check_that_is_not_met_is_told(page: Page, station: PlayedStation) -> None:
    missing = [
        {"bit": "FIX", "words": "there has been a fix"},
        {"bit": "HEADING", "words": "courses do not contradict"},
    ]
    station.state(**{**READY, "link": "loaded"}, missing=missing, refusal="no fix yet")
    told = page.locator("#why").inner_text()
    for words in ("there has been a fix", "courses do not contradict", "was refused: no fix yet"):
        assert words in told
    assert page.locator("#start").is_disabled()
    assert page.locator("#steps [aria-current]").inner_text() == "loaded"


@pytest.mark.parametrize("where", ["body", "#abort", "#export", "[data-command=LEFT]", "#map", "#note"])
def test_space_is_stop_wherever_the_focus_is(page: Page, station: PlayedStation, where: str) -> None:
    station.state(**RUNNING)
    if where == "#note":
        page.click("#tab-events")
    if where != "body":
        page.focus(where)
    page.keyboard.press("Space")
    station.wait(100)
    assert [order["do"] for order in station.sent if order["do"] != "alive"][-1] == "stop"
    assert station.orders("abort", "hold") == []
    station.state(**RUNNING, stop_latched=True, telemetry={**TELEMETRY, "command": Command.STOP})
    assert page.locator("#stop").inner_text().split("\n") == ["STOPPED", "STOP holds until it is cleared"]
    page.click("#clear-stop")
    station.await_order("clear_stop")


@pytest.mark.parametrize(
    ("changes", "hint"),
    [
        ({**RUNNING}, "the vest does not tell yet that it obeys"),
        ({"link": "disconnected", "telemetry": None}, "the vest does not hear it"),
        (
            {"link": "disconnected", "telemetry": {**TELEMETRY, "command": Command.STOP}},
            "the vest does not hear it",
        ),
    ],
)
def test_a_stop_that_the_vest_does_not_show_is_ordered_alone(
    page: Page, station: PlayedStation, changes: dict[str, Any], hint: str
) -> None:
    station.state(**changes, stop_latched=True)
    assert page.locator("#stop").inner_text().split("\n") == ["STOP ordered", hint]


@pytest.mark.parametrize("size", [DESK, TABLET], ids=["desk", "tablet"])
def test_no_button_moves_when_operators_come_or_stop_holds(
    station: PlayedStation, open_page: OpenPage, size: tuple[int, int]
) -> None:
    page = opened(station, open_page, size=size).page
    buttons = ("#stop", "#start", "#manual")

    def places() -> list[Any]:
        return [page.locator(button).bounding_box() for button in buttons]

    before = places()
    long = [f"reason {number} of many why nothing can be started" for number in range(12)]
    for changes in (
        {"operators": [1, 2]},
        {"operators": [1, 2], "offered": True},
        {"operators": [1, 2], "commander": 2, "offered": True},
        {"missing": [{"bit": "x", "words": words} for words in long]},
    ):
        station.state(**changes)
        assert places() == before, changes
    station.state(**RUNNING, stop_latched=True)
    assert [place and place["y"] for place in places()] == [place and place["y"] for place in before]
    why = page.locator("#why").evaluate("(why) => why.scrollHeight - why.clientHeight")
    assert why <= 0 or size == TABLET


def test_the_state_the_alarms_and_stop_stay_in_sight_on_a_tablet(
    station: PlayedStation, open_page: OpenPage
) -> None:
    page = opened(station, open_page, size=TABLET).page
    warning = {"key": "fence", "level": "warning", "text": "the animal is outside the fence", "since": 0.0}
    station.state(**RUNNING, alarms=[warning])
    seen = """(one) => {
      const { left, top, right, bottom } = one.getBoundingClientRect();
      const middle = (left + right) / 2;
      return [top + 1, bottom - 1].every((y) => one.contains(document.elementFromPoint(middle, y)));
    }"""
    for where in ("#map", "#panel-mission", "#course"):
        page.locator(where).evaluate("(one) => one.scrollIntoView({ block: 'start' })")
        assert page.evaluate("scrollY") > 0
        for what in ("[data-step=running]", "#alarms", "#stop", "#start"):
            assert page.locator(what).evaluate(seen), (where, what)


def test_the_panel_of_a_mission_with_a_fence_and_long_words_fit(page: Page, station: PlayedStation) -> None:
    fence = [[32.606, -85.488], [32.606, -85.487], [32.607, -85.487], [32.607, -85.488]]
    station.say(station.hello)
    telemetry = {**TELEMETRY, "mode": Mode.STOP_AT_WAYPOINT}
    station.state(**{**RUNNING, "draft": {**MISSION, "fence": fence}}, telemetry=telemetry)
    for _ in range(60):
        station.state(**{**RUNNING, "draft": {**MISSION, "fence": fence}}, telemetry=telemetry)
    assert page.locator("#places tbody tr.fence").count() == 4
    cut = "(one) => one.scrollWidth - one.clientWidth"
    assert page.locator("#desk-panels").evaluate(cut) <= 0
    numbers = page.locator("#numbers dd")
    assert "stop at waypoint" in numbers.all_inner_texts()
    assert any(text.startswith("silent 1") for text in numbers.all_inner_texts())
    assert [numbers.nth(which).evaluate(cut) for which in range(numbers.count())] == [0] * numbers.count()


def test_space_writes_in_a_note_while_nothing_can_move(page: Page, station: PlayedStation) -> None:
    page.click("#tab-events")
    page.focus("#note")
    page.keyboard.type("a dry day")
    page.keyboard.press("Enter")
    assert station.await_order("note") == {"do": "note", "text": "a dry day"}
    assert station.orders("stop") == []
    station.state(**RUNNING)
    page.keyboard.type("it")
    page.keyboard.press("Shift+Space")
    page.keyboard.type("rests")
    assert page.locator("#note").input_value() == "it rests"
    assert station.orders("stop") == []


def test_the_stop_button_acts_when_it_is_touched(page: Page, station: PlayedStation) -> None:
    page.mouse.move(*middle(page, "#stop"))
    page.mouse.down()
    station.await_order("stop")
    page.mouse.up()
    station.wait(100)
    assert len(station.orders("stop")) == 1
    page.focus("#stop")
    page.keyboard.press("Enter")
    station.wait(100)
    assert len(station.orders("stop")) == 2


LEAVE = {
    "released": None,
    "blurred": "window.dispatchEvent(new Event('blur'))",
    "hidden": "Object.defineProperty(document, 'hidden', {value: true, configurable: true});"
    "document.dispatchEvent(new Event('visibilitychange'))",
    "left": "window.dispatchEvent(new Event('pagehide'))",
    "cancelled": "document.querySelector('[data-command=LEFT]').dispatchEvent("
    "new PointerEvent('pointercancel', {pointerId: 1}))",
}
NO_POINTER = ("cancelled", "key")  # a key has none


@pytest.mark.parametrize(
    ("how", "by"), [(how, by) for how in LEAVE for by in ("pointer", "key") if (how, by) != NO_POINTER]
)
def test_a_command_by_hand_ends_when_it_is_let_go(
    page: Page, station: PlayedStation, how: str, by: str
) -> None:
    page.mouse.move(*middle(page, "[data-command=LEFT]"))
    page.mouse.down() if by == "pointer" else page.keyboard.down("l")
    station.wait(450)
    held = station.orders("hold")
    assert len(held) >= 3
    assert all(order == {"do": "hold", "command": "LEFT"} for order in held)
    script = LEAVE[how]
    if script is not None:
        page.evaluate(script)
    elif by == "pointer":
        page.mouse.up()
    else:
        page.keyboard.up("l")
    station.await_order("release")
    count = len(station.orders("hold"))
    station.wait(300)
    assert len(station.orders("hold")) == count
    assert len(station.orders("release")) == 1


def test_a_socket_that_is_lost_lets_go_and_comes_back(page: Page, station: PlayedStation) -> None:
    page.keyboard.down("f")
    station.await_order("hold")
    station.cut()
    page.get_by_text("the station does not answer: nothing can be sent").wait_for()
    assert page.locator("[data-command=FORWARD]").is_disabled()
    while station.connections < 2:
        page.wait_for_timeout(50)
    before = len(station.orders("hold"))
    station.state()
    station.wait(300)
    assert len(station.orders("hold")) == before  # the key is still down, and nothing resumes
    page.keyboard.up("f")


def test_a_hold_ends_when_another_takes_the_command(page: Page, station: PlayedStation) -> None:
    page.mouse.move(*middle(page, "[data-command=RIGHT]"))
    page.mouse.down()
    station.await_order("hold")
    station.state(commander=2)
    count = len(station.orders("hold"))
    station.wait(300)
    assert len(station.orders("hold")) == count


def test_only_a_page_that_is_seen_keeps_the_vest_going(page: Page, station: PlayedStation) -> None:
    station.await_order("alive")
    page.evaluate(LEAVE["hidden"] or "")
    station.wait(100)
    count = len(station.orders("alive"))
    station.wait(600)
    assert len(station.orders("alive")) == count


def test_what_the_page_sends_names_the_state_that_it_answers(page: Page, station: PlayedStation) -> None:
    for _ in range(2):
        station.state()
        station.sent.clear()
        station.await_order("alive")
        assert station.seen == station.time


def test_a_page_takes_the_command_that_nobody_has_unless_a_mission_runs(
    station: PlayedStation, open_page: OpenPage
) -> None:
    page = opened(station, open_page).page
    station.sent.clear()
    station.state(**RUNNING, commander=None, commander_alive=False)
    assert station.orders("take") == []
    page.click("#take")
    station.await_order("take")
    station.sent.clear()
    station.state(commander=None, commander_alive=False)  # who has watched has to ask
    station.wait(300)
    assert station.orders("take") == []
    station.say(station.hello)  # as after a new connection
    station.state(commander=None, commander_alive=False)
    station.await_order("take")


def test_who_watches_can_stop_and_take_what_is_offered(page: Page, station: PlayedStation) -> None:
    station.state(**RUNNING, commander=2, operators=[1, 2])
    assert page.locator("#who").inner_text() == "operator 2 commands, you watch"
    for button in ("#start", "#abort", "#upload", "#clear", "[data-command=LEFT]", "#take"):
        assert page.locator(button).is_disabled(), button
    assert page.get_by_label("latitude of waypoint 1 in deg").is_disabled()
    page.keyboard.press("Space")
    station.await_order("stop")
    station.state(**{**RUNNING, "draft": OTHER}, commander=2, operators=[1, 2], offered=True)
    assert (
        page.get_by_label("longitude of waypoint 2 in deg").input_value() == "-85.4872000"
    )  # what they draw
    page.click("#take")
    station.await_order("take")
    station.state(**RUNNING, commander=ME, operators=[1, 2])
    page.click("#hand-over")
    station.await_order("hand_over")


# what it shows


def test_readings_are_those_of_the_vest(page: Page, station: PlayedStation) -> None:
    station.state(**RUNNING, place=[32.6063, -85.4876])
    terms, values = page.locator("#numbers dt"), page.locator("#numbers dd")
    numbers = dict(zip(terms.all_inner_texts(), values.all_inner_texts(), strict=True))
    assert numbers["Speed"] == "2.0 m/s"
    assert numbers["Heading"] == "11 deg"
    assert numbers["To target"] == "25.3 m"
    assert numbers["Reached"] == "1 of 2"
    assert numbers["Place 2-sigma"] == "1.6 m"
    assert (numbers["Turns in all"], numbers["Turn budget"]) == ("1", "5 more")
    assert page.locator("#gauge .words").inner_text() == "17 deg left"
    assert page.locator("#cue").inner_text().split("\n") == ["↑", "FORWARD", "the dog feels: tone of 1500 Hz"]
    page.click("#tab-vest")
    told = page.locator("#panel-vest").inner_text()
    for words in ("3.91 V", "21.5 °C", "12.0 s", "no limit", "0.24 s"):
        assert words in told
    assert page.locator("#map .sigma").count() == 1
    assert page.locator("#map .to-target").get_attribute("d") != "M0 0"


def test_alarms_tell_their_reason_and_go_with_it(page: Page, station: PlayedStation) -> None:
    warning = {"key": "fence", "level": "warning", "text": "the animal is outside the fence", "since": 0.0}
    caution = {"key": "gps", "level": "caution", "text": "no fix for 3 s", "since": 0.0}
    station.state(
        **RUNNING, alarms=[caution, warning, {"key": "x", "level": "advisory", "text": "hm", "since": 0.0}]
    )
    assert "the animal is outside the fence" in page.get_by_role("alert").inner_text()
    assert page.locator("#cautions li").count() == 1
    assert page.locator("#calm").is_hidden()
    page.keyboard.press("m")
    assert page.locator("#mute").get_attribute("aria-pressed") == "true"
    station.state(**RUNNING)
    assert page.locator("#alarms li").count() == 0
    assert page.locator("#calm").is_visible()


def test_a_warning_sounds_again_and_again_until_it_is_muted(
    station: PlayedStation, open_page: OpenPage
) -> None:
    page = opened(station, open_page).page
    page.evaluate(
        "window.tones = 0; const start = OscillatorNode.prototype.start;"
        "OscillatorNode.prototype.start = function (at) { window.tones += 1; start.call(this, at); }; 0"
    )
    page.click("#steps")
    warning = [{"key": "fence", "level": "warning", "text": "outside", "since": 0.0}]
    station.state(**RUNNING, alarms=warning)
    while page.evaluate("window.tones") < 6:
        station.wait(100)
    page.keyboard.press("m")
    muted = page.evaluate("window.tones")
    station.wait(2500)
    assert page.evaluate("window.tones") == muted


def test_events_are_text_with_their_times(page: Page, station: PlayedStation, visit: Visit) -> None:
    page.click("#tab-events")
    station.say({"is": "event", "time": 3.5, "level": "caution", "text": "<img src=x onerror=alert(1)>"})
    station.say({"is": "error", "text": "upload: no vest is heard"})
    page.locator("#events").get_by_text("upload: no vest is heard").wait_for()
    assert page.locator("#events li").nth(1).inner_text() == "0:03.5 caution <img src=x onerror=alert(1)>"
    assert page.locator("#events img").count() == 0
    assert visit.errors == []


def file(name: str, content: bytes) -> FilePayload:
    return {"name": name, "mimeType": "", "buffer": content}


def test_a_picture_with_a_world_file_lies_under_the_map(page: Page, visit: Visit) -> None:
    page.click("#tab-background")
    picture = file("field.png", PIXEL)
    page.set_input_files("#ground", [picture])
    page.get_by_text("Not drawn: field.png has no world file").wait_for()
    page.set_input_files("#ground", [picture, file("field.pgw", b"0.001\n0\n0\n-0.001\n-85.4877\n32.6062\n")])
    page.get_by_text("field.png lies under the map").wait_for()
    assert page.locator("#map img").count() == 1
    page.set_input_files("#ground", [picture, file("field.pgw", b"1\n0.5\n0.5\n-1\n0\n0\n")])
    page.get_by_text("Not drawn: the picture is rotated").wait_for()
    page.set_input_files("#ground", [picture, file("field.pgw", b"1\n0\n0\n-1\n0\n0" + b" " * 1000)])
    page.get_by_text("Not drawn: field.pgw has 1012 bytes, expected 1000 at most").wait_for()
    page.set_input_files("#ground", [file("a.pmtiles", b"no tiles")])
    page.get_by_text("Not drawn: ").last.wait_for()
    page.click("#ground-remove")
    assert page.locator("#map img").count() == 0
    assert visit.errors == []


def archive(tile: bytes, kind: int) -> bytes:
    """PMTiles, version 3, of the one tile of zoom 0: header, root directory, metadata, tile; uncompressed."""
    directory, metadata = bytes([1, 0, 1, len(tile), 1]), b"{}"  # entries, tile, run, length, offset + 1
    root, about = 127, 127 + len(directory)
    data = about + len(metadata)
    places = (root, len(directory), about, len(metadata), data, 0, data, len(tile), 1, 1, 1)
    world = (-180 * 10**7, -85 * 10**7, 180 * 10**7, 85 * 10**7)
    header = b"PMTiles\3" + struct.pack("<11Q", *places) + bytes([1, 1, 1, kind, 0, 0])
    return header + struct.pack("<4iB2i", *world, 0, 0, 0) + directory + metadata + tile


def test_an_archive_of_pictures_lies_under_the_map_and_one_of_unknown_tiles_is_refused(
    page: Page, visit: Visit
) -> None:
    page.click("#tab-background")
    page.set_input_files("#ground", [file("field.pmtiles", archive(PIXEL, kind=2))])
    page.get_by_text("field.pmtiles lies under the map: PNG, zoom 0 to 0").wait_for()
    page.locator("#map img.leaflet-tile-loaded").first.wait_for(state="attached")
    page.set_input_files("#ground", [file("roads.pmtiles", archive(PIXEL, kind=0))])
    page.get_by_text("Not drawn: roads.pmtiles holds tiles of type 0, expected PNG").wait_for()
    assert visit.errors == []


def test_streets_and_poles_are_named_as_the_simulated_dogs(open_page: OpenPage) -> None:
    latitude, longitude = HOME
    corners = [(-1, -1), (-1, 9), (1, 9), (1, -1)]  # 1e-5 deg
    street = [[latitude + 1e-5 * north, longitude + 1e-5 * east] for north, east in corners]
    world = {"streets": [street], "poles": [[latitude + 1e-4, longitude]]}
    page = opened(PlayedStation(hello=HELLO | {"world": world}), open_page).page
    assert page.locator("#map path.street").count() == 1
    assert page.get_by_title("pole of the simulated dog").count() == 1
    assert page.get_by_text("poles of the simulated dog, not on board").is_visible()


def test_a_station_with_other_streets_loads_the_page_anew(page: Page, station: PlayedStation) -> None:
    # given a page that shows the map of a real dog
    assert page.locator("#map path.street").count() == 0
    # when the station at its address has become one of a simulated dog
    latitude, longitude = HOME
    street = [[latitude, longitude], [latitude + 1e-4, longitude], [latitude, longitude + 1e-4]]
    station.hello = HELLO | {"world": {"streets": [street], "poles": []}}
    station.cut()
    # then its streets alone are on the map
    page.locator("#map path.street").wait_for(state="attached")
    # and when it is that of a real dog again
    station.hello = HELLO
    station.cut()
    page.locator("#map path.street").wait_for(state="detached")


def test_a_refusal_that_is_plain_text_is_told_as_it_is(page: Page, station: PlayedStation) -> None:
    station.state()
    station.answers["/import"] = (403, b"Host: evil.example, expected localhost")
    page.set_input_files("#import", [file("walk.gpx", b"<gpx/>")])
    page.get_by_text("Import: Host: evil.example, expected localhost").wait_for()


def test_a_real_dogs_map_says_nothing_of_streets(page: Page) -> None:
    assert page.locator("#map path.street").count() == 0
    assert not page.locator("#world").is_visible()


# a lake in the west of the tile, a building and a street in its east
VECTORS = {
    "earth": [Feature(POLYGON, [(0, 0), (4096, 0), (4096, 4096), (0, 4096)], {"kind": "earth"})],
    "water": [Feature(POLYGON, [(0, 0), (1600, 0), (1600, 4096), (0, 4096)], {"kind": "lake"})],
    "buildings": [
        Feature(POLYGON, [(2400, 600), (3400, 600), (3400, 3400), (2400, 3400)], {"kind": "building"})
    ],
    "roads": [Feature(LINE, [(2000, 0), (2000, 4096)], {"kind": "major_road"})],
}
ZOOM = 14
COLOURS = """() => {
  const found = new Set();
  for (const tile of document.querySelectorAll(".leaflet-ground-pane canvas")) {
    const copy = Object.assign(document.createElement("canvas"), { width: tile.width, height: tile.height });
    const context = copy.getContext("2d", { willReadFrequently: true });
    context.drawImage(tile, 0, 0);
    const { data } = context.getImageData(0, 0, copy.width, copy.height);
    for (let i = 0; i < data.length; i += 4) found.add(data.slice(i, i + 3).join());
  }
  return [...found];
}"""
LAKE = {"light": "128,222,234", "dark": "49,53,63"}  # of Protomaps' flavours
BUILDING = {"light": "204,204,204", "dark": "24,24,24"}


def place_of_home() -> tuple[int, int]:
    """Column and row of the tile with home in it."""
    latitude, longitude = map(math.radians, HOME)
    count = 1 << ZOOM
    row = count * (1 - math.asinh(math.tan(latitude)) / math.pi) / 2
    return int(count * (longitude / math.pi + 1) / 2), int(row)


def test_a_map_of_vectors_lies_under_the_map_in_the_colours_of_the_page(page: Page, visit: Visit) -> None:
    content = vector_tiles.archive(vector_tiles.tile(VECTORS), list(VECTORS), ZOOM, place_of_home())
    page.click("#tab-background")
    page.set_input_files("#ground", [file("town.pmtiles", content)])
    page.get_by_text("town.pmtiles lies under the map: vectors, zoom 14 to 14; © OpenStreetMap").wait_for()
    for theme in ("light", "dark"):
        expected = {LAKE[theme], BUILDING[theme]}
        page.wait_for_function(
            f"(colours) => colours.every((c) => ({COLOURS})().includes(c))", arg=list(expected)
        )
        page.evaluate("canine.setTheme('dark')")
    page.click("#ground-remove")
    assert page.locator(".leaflet-ground-pane canvas").count() == 0
    assert visit.errors == []
    assert [url for url in visit.requests if not url.startswith(("http://localhost", "blob:", URL))] == []


def test_vectors_of_another_schema_are_refused_by_their_layers(page: Page, visit: Visit) -> None:
    content = vector_tiles.archive(vector_tiles.tile({}), ["transportation", "park"], ZOOM, place_of_home())
    page.click("#tab-background")
    page.set_input_files("#ground", [file("other.pmtiles", content)])
    page.get_by_text("Not drawn: other.pmtiles has the layers transportation, park, expected some").wait_for()
    assert visit.errors == []


def test_the_map_has_the_plane_of_the_logs(page: Page) -> None:
    plane = TangentPlane(*map(math.radians, HOME))
    place = page.evaluate(f"canine.plane({HOME}).toDegrees([120, -70])")
    assert place == pytest.approx(plane.place(120, -70), abs=1e-12)


def test_corners_of_a_picture_follow_its_world_file(page: Page) -> None:
    world = "canine.readWorld('2\\n0\\n0\\n-2\\n1\\n-1')"  # pixels of 2 m, its corner at 0, 0
    metres = page.evaluate(f"canine.corners({world}, [50, 25], 'metres', {HOME})")
    assert metres[0] == pytest.approx([HOME[0] - 50 / 110_909, HOME[1]], abs=2e-7)
    assert metres[1] == pytest.approx([HOME[0], HOME[1] + 100 / 93_868], abs=2e-6)
    mercator = page.evaluate(f"canine.corners({world}, [50, 25], 'mercator')")
    degree = 2 * math.pi * 6378137 / 360
    assert mercator == [pytest.approx([-50 / degree, 0]), pytest.approx([0, 100 / degree])]
    degrees = page.evaluate(
        "canine.corners({width: 0.1, height: -0.1, x: 8.05, y: 46.95}, [10, 20], 'degrees')"
    )
    assert degrees == [pytest.approx([45, 8]), pytest.approx([47, 9])]
    far = "canine.readWorld('1e7\\n0\\n0\\n-1e7\\n1e308\\n-1e308')"
    for crs in ("metres", "mercator", "degrees"):
        asked = f"canine.corners({far}, [50, 25], '{crs}', {HOME})"
        told = page.evaluate(f"(() => {{ try {{ {asked}; }} catch (error) {{ return error.message; }} }})()")
        assert "expected latitude -90 to 90 and longitude -180 to 180 deg" in told, crs
    # given a picture whose south-west corner alone is out of range
    asked = "canine.corners({width: 1, height: -1, x: -190, y: 46}, [200, 25], 'degrees')"
    told = page.evaluate(f"(() => {{ try {{ {asked}; }} catch (error) {{ return error.message; }} }})()")
    # then that one is named
    assert told.startswith("a corner of the picture is 21.5, -190.5, expected latitude")


def test_a_replay_is_led_by_its_slider_and_orders_nothing(open_page: OpenPage) -> None:
    station = PlayedStation({**HELLO, "replay": {"from": 0.0, "until": 60.0}})
    visit = opened(station, open_page)
    page = visit.page
    times = [float(i) for i in range(61)]
    columns = {
        "time": times, "latitude": [HOME[0] + i * 5e-6 for i in times], "longitude": [HOME[1]] * 61,
        "speed": [1.0] * 61, "heading": [0.0] * 61, "position_sd": [1.0] * 61, "deviation": [0.1] * 61,
        "distance": [20.0] * 61, "command": [1] * 61, "mode": [1] * 61, "waypoint": [0] * 61,
    }  # fmt: skip
    station.say(
        {"is": "history", "columns": columns, "events": [{"time": 1.0, "level": "advisory", "text": "go"}]}
    )
    station.state(
        **RUNNING,
        commander=None,
        link_quality=None,  # as of a trial with the firmware on board
        replay={"time": 10.0, "playing": False, "speed": 1},
    )
    slider = page.get_by_label("time", exact=True)
    assert slider.input_value() == "10"
    slider.fill("30")
    assert station.await_order("seek") == {"do": "seek", "time": 30}
    page.get_by_role("button", name="Play").click()
    assert station.await_order("play")["speed"] == 1
    assert page.locator("#conduct").is_hidden()
    page.keyboard.press("Space")
    page.keyboard.press("f")
    station.wait(200)
    assert station.orders("stop", "hold", "alive", "take") == []
    assert page.locator("#map .track").count() >= 1
    assert page.locator("#plots canvas").count() >= 1
    assert visit.errors == []


# the page as such


@pytest.mark.parametrize(
    ("size", "theme"), [(DESK, "light"), (TABLET, "light"), (DESK, "dark")], ids=["desk", "tablet", "dark"]
)
def test_the_page_keeps_nobody_out_asks_nobody_else_and_has_no_error(
    station: PlayedStation, open_page: OpenPage, size: tuple[int, int], theme: str
) -> None:
    visit = opened(station, open_page, size=size, theme=theme)
    station.state(
        **{**RUNNING, "on_board": {"id": 1, "mission": OTHER}},
        alarms=[
            {"key": "a", "level": "warning", "text": "the vest is silent", "since": 0.0},
            {"key": "b", "level": "caution", "text": "no fix for 3 s", "since": 0.0},
        ],
    )
    assert visit.harm() == []
    assert all(request.startswith(URL) for request in visit.requests)
    assert visit.errors == []
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= size[0]
    assert visit.page.locator("#stop").is_visible()


def test_what_lies_behind_tabs_and_keys_keeps_nobody_out(visit: Visit) -> None:
    for tab in ("vest", "events", "background"):
        visit.page.click(f"#tab-{tab}")
        assert visit.harm() == []
    visit.page.click("#help")
    assert visit.harm() == []
