"""Pages in a real browser: Debian's Chromium, led by Playwright.

`open_page(url)` is a fixture; `prepare` is called with the page before it goes there. What it gives has noted
all that the page said and asked for; `harm` names what keeps users out who cannot see well or point.
Playwright is imported by the tests that need it alone.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserType, Page

DESK, TABLET = (1366, 768), (768, 1024)  # pixels, width and height
SERIOUS = ("serious", "critical")
PATIENCE_MS = 120_000  # for what a page is asked, on the busiest machine


@dataclass
class Visit:
    """A page that is open.

    Attributes:
        errors: what its console said as an error or warning, and exceptions that nobody caught.
        requests: the addresses that it asked for, itself first.
    """

    page: Page
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def harm(self) -> list[str]:
        """What axe finds that is serious: the rule, and the first element."""
        from axe_playwright_python.sync_playwright import Axe  # noqa: PLC0415

        found = Axe().run(self.page).response["violations"]
        return [f"{v['id']}: {v['nodes'][0]['html'][:200]}" for v in found if v["impact"] in SERIOUS]


OpenPage = Callable[..., Visit]


def launch(kind: BrowserType) -> Browser:
    """Start the system's Chromium; the test is skipped where there is none."""
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("no browser: apt install chromium")
    return kind.launch(executable_path=program, args=["--no-sandbox"])


@pytest.fixture(scope="module")  # not of a session: Playwright's event loop keeps others from having theirs
def browser() -> Iterator[Browser]:
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as started, launch(started.chromium) as browser:
        yield browser


@pytest.fixture
def open_page(browser: Browser) -> Iterator[OpenPage]:
    """Opens an address in a window of its own: nothing is left of other pages."""
    contexts = []

    def open_one(
        url: str,
        size: tuple[int, int] = DESK,
        theme: Literal["light", "dark"] = "light",
        prepare: Callable[[Page], None] = lambda page: None,
    ) -> Visit:
        context = browser.new_context(viewport={"width": size[0], "height": size[1]}, color_scheme=theme)
        context.set_default_timeout(PATIENCE_MS)
        contexts.append(context)
        visit = Visit(context.new_page())
        visit.page.on("pageerror", lambda error: visit.errors.append(str(error)))
        visit.page.on("request", lambda request: visit.requests.append(request.url))
        visit.page.on(
            "console",
            lambda message: (
                visit.errors.append(message.text) if message.type in ("error", "warning") else None
            ),
        )
        prepare(visit.page)
        visit.page.goto(url)
        return visit

    yield open_one
    for context in contexts:
        context.close()
