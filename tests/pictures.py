"""Takes the pictures of pages anew, a trial's and the station's: python -m tests.pictures."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from playwright.sync_api import sync_playwright

from harness.main import run
from harness.trial.trial import PAGE
from tests.browser import DESK, TABLET, launch
from tests.harness.station.browser import Served, simulated

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

RESULTS = Path(__file__).parents[1] / "harness" / "results"
LEG_MS = 14_000  # of the clock, until the animal is on its second leg
FAULT_S = 8.0  # of the trial with faults: two of them are on


def main() -> None:
    """Take all of them."""
    with sync_playwright() as playwright:
        browser = launch(playwright.chromium)
        _trial(browser)
        _station(browser)
        browser.close()


def _trial(browser: Browser) -> None:
    """A trial with faults, in the midst of them."""
    with tempfile.TemporaryDirectory() as folder:
        run(["run", "faulty", "--out", folder])
        page = browser.new_page(viewport={"width": DESK[0], "height": DESK[1]})
        page.goto((Path(folder) / PAGE).as_uri())
        page.locator("input[type=range]").fill(str(FAULT_S))
        _take(page, "trial_page")


def _station(browser: Browser) -> None:
    """A mission under way on a laptop; the same from a tablet, and dark, where another operator watches."""
    with tempfile.TemporaryDirectory() as folder, simulated(Path(folder), speed=1.0) as station:
        page = _enter(browser, station, DESK)
        page.click("#scenario")
        page.click("#upload", timeout=60_000)
        page.click("#fit")
        page.locator("#start:enabled").wait_for(timeout=60_000)
        page.keyboard.down("g")
        page.locator("[data-step=running][aria-current]").wait_for()
        page.keyboard.up("g")
        page.wait_for_timeout(LEG_MS)
        _take(page, "station")
        page.emulate_media(color_scheme="dark")
        page.click("#tab-events")
        _take(page, "station_dark")
        _take(_enter(browser, station, TABLET), "station_tablet")


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
