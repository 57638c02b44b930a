"""A network that is lost while its connections stay open: between browser, station and vest."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from codegen.firmware.telemetry import Telemetry
from harness.station.desk import OrderError
from harness.vest.tcp_port import TcpPort
from harness.vest.vest import open_vest
from models.commands import Command, Status
from models.modes import Anomaly
from tests.browser import OpenPage
from tests.harness.network import Network, network_to
from tests.harness.station.browser import Served, by_radio, simulated
from tests.harness.station.hands import begin, step, until, upload, warnings

if TYPE_CHECKING:
    from playwright.sync_api import Page

STOPPED_BY = "the mission was stopped: the radio link was lost (rule 9)"
NOT_HEARD = "the station does not answer: nothing can be sent, not even STOP; the vest stops by itself"


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Served]:
    """By the clock, so that what is late is so by the vest's clock too."""
    with simulated(tmp_path / "out", speed=1.0) as running:
        yield running


@pytest.fixture
def network(station: Served) -> Iterator[Network]:
    """Between the browser and the station."""
    with network_to(int(station.address.rpartition(":")[2])) as way:
        yield way


@pytest.fixture
def page(network: Network, station: Served, open_page: OpenPage) -> Page:
    page = open_page(f"http://{network.address}/").page
    until(page, lambda: page.locator("#who").inner_text() == "you command")
    return page


def telemetry_of(station: Served) -> Telemetry:
    told: Telemetry = station.shown.conduct.telemetry  # type: ignore[attr-defined]
    return told


def heard_within(station: Served, seconds: float) -> set[Command]:
    """What the animal hears in so many s of the vest's time."""
    heard: set[Command] = set()
    end = station.vest.state.time + seconds
    while (state := station.vest.state).time < end:
        heard.add(state.command)
        time.sleep(0.005)
    return heard


def test_a_mission_whose_browser_lost_the_network_while_left_was_held_is_stopped_and_the_page_says_why(
    page: Page, network: Network, station: Served
) -> None:
    upload(page)
    begin(page)
    page.keyboard.down("l")
    until(page, lambda: station.vest.state.command is Command.LEFT)

    network.cut()

    until(page, lambda: station.vest.state.command is not Command.LEFT)  # the hold is let go
    until(page, lambda: telemetry_of(station).status == Status.STOPPED)  # the heartbeat has ended
    assert telemetry_of(station).last_anomaly == Anomaly.LOST_LINK
    until(page, lambda: NOT_HEARD in warnings(page))
    assert step(page) == "disconnected"

    network.restore()

    until(page, lambda: "The trial has ended: stopped" in page.locator("#why").inner_text())
    until(page, lambda: STOPPED_BY in warnings(page))
    assert NOT_HEARD not in warnings(page)
    page.click("#tab-events")
    told = "\n".join(page.locator("#events li").all_inner_texts())
    assert "LEFT is let go" in told
    assert "is silent: the heartbeat to the vest ends" in told
    assert "the radio link was lost (rule 9)" in told
    # the command can be had again, but the key that is still down does nothing: nothing resumes
    if page.locator("#take").is_visible():
        page.click("#take")
    until(page, lambda: page.locator("#who").inner_text() == "you command")
    assert Command.LEFT not in heard_within(station, 1.0)


def orders_of(station: Served, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, bool]]:
    """The orders that come from now on: their names, and whether they are carried out."""
    came: list[tuple[str, bool]] = []
    carry_out = station.shown.order

    def order(operator: int, content: dict[str, Any]) -> Sequence[bytes]:
        try:
            answers = carry_out(operator, content)
        except OrderError:
            came.append((content["do"], False))
            raise
        came.append((content["do"], True))
        return answers

    monkeypatch.setattr(station.shown, "order", order)
    return came


def test_a_start_and_a_hold_that_the_network_held_back_do_not_act_when_it_is_back(
    page: Page, network: Network, station: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    upload(page)
    until(page, page.locator("#start").is_enabled)
    came = orders_of(station, monkeypatch)

    network.cut()
    page.keyboard.down("f")  # the page cannot know yet that nobody hears it
    page.wait_for_timeout(300)
    page.keyboard.up("f")
    page.keyboard.down("g")
    page.wait_for_timeout(1200)
    page.keyboard.up("g")
    until(page, lambda: NOT_HEARD in warnings(page))
    network.restore()

    until(page, lambda: ("start", False) in came)
    commands = heard_within(station, 1.0)
    assert ("hold", False) in came
    assert not {("start", True), ("hold", True)} & set(came)
    assert not commands & {Command.FORWARD}


def test_a_vest_that_the_network_takes_from_the_station_stops_and_the_page_says_so_and_why(
    open_page: OpenPage, tmp_path: Path
) -> None:
    with (
        closing(TcpPort()) as radio,
        open_vest("three_waypoint", radio=radio) as vest,
        network_to(int(radio.address.rpartition(":")[2])) as network,
        by_radio(tmp_path / "out", f"tcp://{network.address}") as station,
    ):
        page = open_page(f"http://{station.address}/").page
        until(page, page.locator("#upload").is_enabled)
        page.click("#upload")
        begin(page)
        until(page, lambda: vest.state.command is Command.FORWARD)

        network.cut()

        until(page, lambda: vest.state.command is Command.STOP)  # it hears nobody: rule 9
        until(page, lambda: "the vest is not heard" in warnings(page))
        assert step(page) == "disconnected"
        assert page.locator("#start").is_disabled()

        network.restore()

        until(page, lambda: STOPPED_BY in warnings(page))
        until(page, lambda: step(page) != "disconnected")
        assert telemetry_of(station).last_anomaly == Anomaly.LOST_LINK
        assert "The trial has ended: stopped" in page.locator("#why").inner_text()
        page.click("#tab-events")
        told = "\n".join(page.locator("#events li").all_inner_texts())
        assert told.index("the vest has not been heard for 2 s") > told.index("the vest is heard"), (
            "newest first"
        )
