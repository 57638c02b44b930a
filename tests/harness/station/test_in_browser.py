"""All of it: the page in a real browser, the station, a simulated vest that runs faster than the clock."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from harness.log.log import FILE, read_log
from harness.station import opening
from harness.station.opening import report
from harness.station.session import Session
from harness.station.shown import News
from harness.vest.vest import open_vest
from models.commands import Command
from tests.browser import OpenPage, launch
from tests.harness.station.browser import Served, simulated
from tests.harness.station.dogs import obedient
from tests.harness.station.hands import begin, enter, steady, step, until, upload, warnings

if TYPE_CHECKING:
    from playwright.sync_api import Browser

METRES_A_PIXEL = 0.2516  # of Web Mercator at zoom 19 and a latitude of 32.6 deg
STOP_S = 0.2  # of the vest's time, from Space to the tone
PRESSES = 3


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Served]:
    """By the clock, so that a mission is still under way when a busy machine comes to look."""
    with simulated(tmp_path / "out", speed=1.0) as running:
        yield running


def test_a_mission_drawn_by_clicks_is_led_to_success_and_is_in_the_log(
    open_page: OpenPage, tmp_path: Path
) -> None:
    with simulated(tmp_path / "out", speed=20.0, scenario=obedient(tmp_path)) as station:
        visit = enter(station, open_page)
        page = visit.page
        tools = {name: page.get_by_role("button", name=name, exact=True) for name in ("Home", "Waypoint")}
        until(page, tools["Home"].is_enabled)
        x, y = steady(page, "#map .animal")  # home is where it stands, as for whoever draws
        away = 35.73 / METRES_A_PIXEL
        for name, right, up in (("Home", 0, 0), ("Waypoint", 0, 1), ("Waypoint", 1, 1)):
            tools[name].click()
            page.mouse.click(x + right * away, y - up * away)
        assert page.locator("#total").inner_text().startswith("2 waypoints, 12")  # 122 m, as in Figure 4.8
        until(page, page.locator("#upload").is_enabled)
        page.click("#upload")
        begin(page)
        until(page, lambda: page.get_by_text("The trial has ended").count() == 1)
        assert page.get_by_text("The trial has ended: success").count() == 1, warnings(page)
        terms, values = page.locator("#numbers dt"), page.locator("#numbers dd")
        numbers = dict(zip(terms.all_inner_texts(), values.all_inner_texts(), strict=True))
        page.click("#tab-events")
        told = page.locator("#events li").all_inner_texts()
        assert any("the trial has succeeded" in text for text in told)
        assert any("waypoint 2 reached" in text for text in told)
        assert visit.errors == []
        assert all(request.startswith(f"http://{station.address}/") for request in visit.requests)
    summary = report(tmp_path / "out")
    assert summary is not None
    assert (summary["outcome"], summary["waypoints_reached"]) == ("success", 2)
    assert summary["directional_commands"] == int(numbers["Turns in all"])
    log = read_log(tmp_path / "out" / FILE)
    assert log.route is not None
    one, two, home = [(north, east) for _, north, east in log.route.places]
    assert (one[0] - home[0], one[1] - home[1]) == pytest.approx((35.73, 0), abs=1)
    assert (two[0] - one[0], two[1] - one[1]) == pytest.approx((0, 35.73), abs=1)


def test_space_stops_the_animal_and_a_hold_ends_with_the_focus(station: Served, open_page: OpenPage) -> None:
    page = enter(station, open_page).page
    vest = station.vest
    upload(page)
    begin(page)
    until(page, lambda: vest.state.command is Command.FORWARD)
    page.focus("#export")
    page.keyboard.press("Space")
    until(page, lambda: vest.state.command is Command.STOP)
    until(page, lambda: page.locator("#stop strong").inner_text() == "STOPPED")
    page.click("#abort")
    until(page, lambda: step(page) != "running")
    page.click("#clear-stop")
    until(page, lambda: page.locator("#clear-stop").is_hidden())
    page.keyboard.down("l")
    until(page, lambda: vest.state.command is Command.LEFT)
    until(page, lambda: page.locator("[data-command=LEFT].active").count() == 1)
    page.evaluate("window.dispatchEvent(new Event('blur'))")
    until(page, lambda: vest.state.command is not Command.LEFT)


def test_space_is_stop_within_a_fifth_of_a_second_of_the_vests_time(
    open_page: OpenPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a vest whose clock waits for the station's, so that a busy machine holds up both
    polled = threading.Event()
    poll = Session.poll

    def noted(session: Session) -> News:
        polled.set()
        return poll(session)

    def sleep(stopped: threading.Event, seconds: float) -> None:
        stopped.wait(seconds)
        polled.clear()
        while not (polled.wait(0.05) or stopped.is_set()):
            pass

    monkeypatch.setattr(Session, "poll", noted)
    monkeypatch.setattr(opening, "open_vest", partial(open_vest, out=tmp_path / "vest", sleep=sleep))
    came = []
    with simulated(tmp_path / "out", speed=2.0) as station:
        carry_out = station.shown.order

        def order(operator: int, content: dict[str, Any]) -> Sequence[bytes]:
            if content["do"] == "stop":
                came.append(station.vest.state.time)  # of the tick that is being made, or was made last
            return carry_out(operator, content)

        monkeypatch.setattr(station.shown, "order", order)
        page = enter(station, open_page).page
        upload(page)
        begin(page)

        def is_stopped(press: int) -> bool:
            return len(came) > press and station.vest.state.command is Command.STOP

        # when Space is pressed while the animal hears FORWARD, several times
        for press in range(PRESSES):
            until(page, lambda: station.vest.state.command is Command.FORWARD)
            page.keyboard.press("Space")
            until(page, partial(is_stopped, press))
            until(page, page.locator("#clear-stop").is_visible)
            page.click("#clear-stop")
    # then on a tick at most so much after the order came to the station the vest plays STOP
    log = read_log(tmp_path / "vest" / FILE)
    stops = log.time[log["controller.command"] == Command.STOP]
    delays = [float(stops[np.searchsorted(stops, at - 1e-6)]) - at for at in came]
    assert len(delays) == PRESSES
    assert max(delays) <= STOP_S, delays


def test_a_waypoint_that_is_dragged_under_way_changes_nothing_on_board_and_the_page_says_so(
    station: Served, open_page: OpenPage
) -> None:
    visit = enter(station, open_page)
    page = visit.page
    upload(page)
    begin(page)
    conduct = station.shown.conduct  # type: ignore[attr-defined]
    mission = conduct.on_board
    assert page.locator("#map .differs").count() == 0
    # when a waypoint is dragged
    box = page.locator("[aria-label^='waypoint 2']").first.bounding_box()
    assert box
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] - 30, box["y"] + 50, steps=4)
    page.mouse.up()
    # then what is on board is still drawn, in dashes, and is what the animal is led by
    until(page, lambda: page.locator("#map .leg.differs").count() == 1)
    assert page.locator("#map .waypoint.differs").count() == 1
    words = "the mission under way is that on board: ABORT it to upload another"
    until(page, lambda: words in page.locator("#on-board").inner_text())
    assert page.locator("#upload").is_disabled()
    until(page, lambda: conduct.draft_id != mission.id)
    # when it is uploaded all the same
    page.evaluate("button => { button.disabled = false; button.click(); }", page.query_selector("#upload"))
    # then it is refused, in words, and the mission goes on
    until(page, lambda: "upload: a mission is under way" in page.locator("#said").inner_text())
    told = conduct.telemetry.time_ms
    until(page, lambda: conduct.telemetry.time_ms > told + 1000)
    assert (conduct.telemetry.mission_id, conduct.is_under_way) == (mission.id, True)
    assert conduct.on_board is mission
    # when it was ended by ABORT, the new one is taken, and is the one that START begins
    page.click("#abort")
    until(page, page.locator("#upload").is_enabled)
    page.click("#upload")
    until(page, lambda: conduct.telemetry.mission_id == conduct.draft_id != mission.id)
    until(page, lambda: page.locator("#map .differs").count() == 0)
    begin(page)
    # and neither while a mission is under way nor while STOP holds does the page keep anybody out
    assert visit.harm() == []
    page.keyboard.press("Space")
    until(page, lambda: page.locator("#stop.latched").count() == 1)
    assert visit.harm() == []


@pytest.fixture
def doomed(browser: Browser) -> Iterator[Browser]:
    """Another browser, whose processes can be killed."""
    with launch(browser.browser_type) as another:
        yield another


def kill_tabs(browser: Browser) -> None:
    """As `kill -9` does to the processes that draw its pages."""
    told = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    for one in told:
        if one["type"] == "renderer":
            os.kill(one["id"], signal.SIGKILL)


def test_a_tab_that_dies_ends_the_mission_and_the_other_tab_says_why(
    station: Served, open_page: OpenPage, doomed: Browser
) -> None:
    page = doomed.new_page()
    page.goto(f"http://{station.address}/")
    until(page, lambda: page.locator("#who").inner_text() == "you command")
    other = enter(station, open_page).page
    until(other, lambda: other.locator("#who").inner_text() == "operator 1 commands, you watch")
    assert other.locator("#take").is_disabled()
    upload(page)
    begin(page)
    until(other, lambda: step(other) == "running")
    kill_tabs(doomed)
    until(other, lambda: other.locator("#who").inner_text() == "nobody commands")
    until(other, lambda: "the radio link was lost" in other.get_by_role("alert").inner_text())
    until(other, lambda: station.vest.state.command is Command.STOP)
    other.click("#take")
    until(other, lambda: other.locator("#who").inner_text() == "you command")


def test_a_vest_that_begins_anew_is_shown_without_a_mission(station: Served, open_page: OpenPage) -> None:
    page = enter(station, open_page).page
    upload(page)
    begin(page)
    station.vest.reset()
    until(page, lambda: page.locator("#on-board").inner_text() == "No mission is on board")
    page.click("#tab-events")
    until(page, lambda: page.locator("#events").get_by_text("begun anew").count() >= 1)
    assert page.locator("#start").is_disabled()
    until(page, lambda: "the vest holds no mission" in page.locator("#why").inner_text())
    page.click("#tab-mission")
    until(page, page.locator("#upload").is_enabled)  # what was drawn is still there
