"""An operator's hands at the page of a station, in a real browser."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from tests.browser import OpenPage, Visit
from tests.harness.station.browser import Served

if TYPE_CHECKING:
    from playwright.sync_api import Page

LONGEST_S = 90.0
RESTS, NEAR = 10, 12.0  # looks, 50 ms apart or more; pixels, within which an estimate of who stands wanders


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
    """Open the page; it is there."""
    visit = open_page(f"http://{station.address}/")
    visit.page.get_by_text("simulation of").wait_for()
    return visit


def upload(page: Page) -> None:
    """Send the scenario's own mission."""
    until(page, page.locator("#scenario").is_enabled)
    page.click("#scenario")
    until(page, page.locator("#upload").is_enabled)
    page.click("#upload")


def steady(page: Page, selector: str) -> tuple[float, float]:
    """The middle of an element [pixels] once it hardly moves: alarms that come and go shift the page."""
    places: list[tuple[float, float]] = []

    def rests() -> bool:
        box = page.locator(selector).bounding_box()
        assert box
        places.append((box["x"] + box["width"] / 2, box["y"] + box["height"] / 2))
        x, y = zip(*places[-RESTS:], strict=True)
        return len(places) > RESTS and max(x) - min(x) < NEAR > max(y) - min(y)

    until(page, rests)
    return places[-1]


def warnings(page: Page) -> str:
    """The red alarms, in words."""
    return "\n".join(page.get_by_role("alert").all_inner_texts())


def begin(page: Page) -> None:
    """Hold START until the mission is under way; again, where a busy machine had the page let go of it."""
    while step(page) != "running":
        until(page, page.locator("#start").is_enabled)
        box = page.locator("#start").bounding_box()
        assert box
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.mouse.down()
        until(page, lambda: step(page) == "running" or page.locator("#start").is_disabled())
        page.mouse.up()
