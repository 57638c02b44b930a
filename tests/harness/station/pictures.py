"""Takes the pictures of the station's page anew: python -m tests.harness.station.pictures."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from playwright.sync_api import sync_playwright

from tests.browser import DESK, TABLET, launch
from tests.harness.station.browser import Served, simulated

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

RESULTS = Path(__file__).parents[3] / "harness" / "results"
LEG_S = 14_000  # ms of the clock until the animal is on its second leg


def main() -> None:
    """A mission under way on a laptop; the same from a tablet, and dark, where another operator watches."""
    with (
        tempfile.TemporaryDirectory() as folder,
        simulated(Path(folder), speed=1.0) as station,
        sync_playwright() as playwright,
    ):
        browser = launch(playwright.chromium)
        page = _enter(browser, station, DESK)
        page.click("#scenario")
        page.click("#upload", timeout=60_000)
        page.click("#fit")
        page.locator("#start:enabled").wait_for(timeout=60_000)
        page.keyboard.down("g")
        page.locator("[data-step=running][aria-current]").wait_for()
        page.keyboard.up("g")
        page.wait_for_timeout(LEG_S)
        _take(page, "station")
        page.emulate_media(color_scheme="dark")
        page.click("#tab-events")
        _take(page, "station_dark")
        _take(_enter(browser, station, TABLET), "station_tablet")
        browser.close()


def _enter(browser: Browser, station: Served, size: tuple[int, int]) -> Page:
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    page.goto(f"http://{station.address}/")
    page.locator("body[data-drawn]").wait_for()
    page.wait_for_timeout(2000)
    return page


def _take(page: Page, name: str) -> None:
    page.wait_for_timeout(700)
    page.screenshot(path=RESULTS / f"{name}.png")


if __name__ == "__main__":
    main()
