"""All of it: the page in a real browser, the station, a simulated vest that runs faster than the clock."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from harness.log.log import read_log
from harness.station.opening import report
from models.commands import Command
from tests.browser import OpenPage, Visit, launch
from tests.harness.station.browser import Served, simulated

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

LONGEST_S = 90.0
METRES_A_PIXEL = 0.2516  # of Web Mercator at zoom 19 and a latitude of 32.6 deg
ATTEMPTS = 4  # a dog does not always obey


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Served]:
    """By the clock, so that a mission is still under way when a busy machine comes to look."""
    with simulated(tmp_path / "out", speed=1.0) as running:
        yield running


def until(page: Page, is_so: Callable[[], bool]) -> None:
    """The browser goes on until something is so."""
    end = time.monotonic() + LONGEST_S
    while not is_so():
        assert time.monotonic() < end, (step(page), page.locator("#why").inner_text())
        page.wait_for_timeout(50)


def step(page: Page) -> str:
    """How far the vest is, as the page shows it."""
    return page.locator("#steps [aria-current]").inner_text()


def enter(station: Served, open_page: OpenPage) -> Visit:
    visit = open_page(f"http://{station.address}/")
    visit.page.get_by_text("simulation of three_waypoint").wait_for()
    return visit


def upload(page: Page) -> None:
    until(page, page.locator("#scenario").is_enabled)
    page.click("#scenario")
    until(page, page.locator("#upload").is_enabled)
    page.click("#upload")


def begin(page: Page) -> None:
    """Hold START until the mission is under way."""
    until(page, page.locator("#start").is_enabled)
    box = page.locator("#start").bounding_box()
    assert box
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    until(page, lambda: step(page) == "running")
    page.mouse.up()


def test_a_mission_drawn_by_clicks_is_led_to_success_and_is_in_the_log(
    open_page: OpenPage, tmp_path: Path
) -> None:
    with simulated(tmp_path, speed=20.0) as station:
        visit = enter(station, open_page)
        page = visit.page
        tools = {name: page.get_by_role("button", name=name, exact=True) for name in ("Home", "Waypoint")}
        until(page, tools["Home"].is_enabled)
        box = page.locator("#map").bounding_box()
        assert box
        away = 35.73 / METRES_A_PIXEL
        middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        for name, east, north in (("Home", 0, 0), ("Waypoint", 0, 1), ("Waypoint", 1, 1)):
            tools[name].click()
            page.mouse.click(middle[0] + east * away, middle[1] - north * away)
        assert page.locator("#total").inner_text().startswith("2 waypoints, 12")  # 122 m, as in Figure 4.8
        until(page, page.locator("#upload").is_enabled)
        page.click("#upload")
        for _ in range(ATTEMPTS):
            begin(page)
            until(page, lambda: page.get_by_text("The trial has ended").count() == 1)
            if page.get_by_text("The trial has ended: SUCCESS").count():
                break
            page.click("#abort")
        assert page.get_by_text("The trial has ended: SUCCESS").count() == 1
        terms, values = page.locator("#numbers dt"), page.locator("#numbers dd")
        numbers = dict(zip(terms.all_inner_texts(), values.all_inner_texts(), strict=True))
        page.click("#tab-events")
        told = page.locator("#events li").all_inner_texts()
        assert any("trial SUCCESS" in text for text in told)
        assert any("waypoint 2 reached" in text for text in told)
        assert visit.errors == []
        assert all(request.startswith(f"http://{station.address}/") for request in visit.requests)
    summary = report(tmp_path)
    assert summary is not None
    assert (summary["outcome"], summary["waypoints_reached"]) == ("success", 2)
    assert summary["directional_commands"] == int(numbers["Turns used"])
    log = read_log(tmp_path / "trial.mcap")
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
