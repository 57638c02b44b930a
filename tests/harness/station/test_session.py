"""A station whose port is pulled, or whose disk is full, goes on and says so."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from harness.log.log import LogError
from harness.station.events import Level
from harness.station.opening import vest_parameters
from harness.station.ports import PortError
from harness.station.session import REOPEN_S, About, Session
from harness.station.sink import Sink
from harness.trial.scenario import Scenario
from models.errors import UsageError
from tests.harness.station.browser import Silence


class Pulled(Silence):
    """A port that is pulled."""

    def read(self) -> bytes:
        raise PortError("port x: is gone")


class Hands:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def session(
    folder: Path, port: Silence, hands: Hands, reopen: Callable[[], Silence] | None = None
) -> Session:
    about = About("x", vest_parameters(Scenario("x")))
    sink = Sink(folder, {"parameters": about.parameters})
    return Session(port, None, sink, about, reopen=reopen, clock=hands)


def texts(station: Session, hands: Hands, until: str) -> list[str]:
    """The events up to the one with a text."""
    found: list[str] = []
    end = time.monotonic() + 30
    while until not in found:
        assert time.monotonic() < end, found
        hands.now += 0.1
        found += [event.text for event in station.poll().events]
        time.sleep(0.001)
    return found


def test_a_port_that_is_pulled_is_told_and_opened_again_as_soon_as_it_can_be(tmp_path: Path) -> None:
    hands, tries = Hands(), [0]

    def reopen() -> Silence:
        tries[0] += 1
        if tries[0] < 3:
            raise UsageError("not there yet")
        return Silence()

    station = session(tmp_path, Pulled(), hands, reopen)
    found = texts(station, hands, "the port is there again")
    assert found[0] == "port x: is gone"
    assert tries[0] == 3
    assert hands.now > 3 * REOPEN_S
    station.close()


def test_a_port_that_cannot_be_opened_again_leaves_a_station_that_answers(tmp_path: Path) -> None:
    hands = Hands()
    station = session(tmp_path, Pulled(), hands)
    assert texts(station, hands, "port x: is gone") == ["port x: is gone"]
    station.order(1, {"do": "stop"})
    assert station.state(station.now)["stop_latched"]
    station.close()


def test_a_log_that_cannot_be_written_stops_no_station_and_is_an_alarm(tmp_path: Path) -> None:
    hands = Hands()
    station = session(tmp_path, Silence(), hands)

    def full(now: float) -> None:
        raise LogError("log x: cannot be written (No space left on device)")

    sink = station._sink
    assert sink is not None
    sink.step = full  # type: ignore[method-assign]
    found = texts(
        station, hands, "nothing is recorded any more: log x: cannot be written (No space left on device)"
    )
    assert len(found) == 1, "it is told once"
    station.order(1, {"do": "take"})
    alarm = station.alarms(station.now)[0]
    assert (alarm.key, alarm.level) == ("log", Level.WARNING)
    station.close()
