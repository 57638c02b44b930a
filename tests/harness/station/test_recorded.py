"""A log that somebody sends is played, or refused in words."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import pytest

from codegen.firmware.telemetry import FIELDS, Telemetry
from harness.log.log import LogError, read_log
from harness.station import playback
from harness.station.events import Event, Level
from harness.station.playback import Playback
from harness.station.sink import EVENTS, Sink
from models.commands import Command
from models.errors import UsageError
from tests.harness.station.browser import Silence
from tests.harness.station.rig import Hands
from tests.harness.station.test_session import session

NOTHING = Telemetry(*[0] * len(FIELDS))


def told(folder: Path, parameters: dict[str, str] | None = None) -> Sink:
    """What records a station that heard a vest."""
    sink = Sink(folder, {"parameters": parameters or {}})
    sink.tell(1.0, replace(NOTHING, session=5, time_ms=1000), Command.NONE)
    return sink


def welcomed(sink: Sink) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The hello and the events of a log that is played."""
    sink.close()
    hello, history = map(orjson.loads, Playback(sink.path).join(1))
    return hello, history["events"]


@pytest.fixture(scope="module")
def state(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A state that was shown."""
    station = session(tmp_path_factory.mktemp("state"), Silence(), Hands())
    shown = station.poll().state
    station.close()
    assert shown
    content: dict[str, Any] = orjson.loads(shown)
    return content


def test_a_state_that_a_station_shows_is_one(tmp_path: Path, state: dict[str, Any]) -> None:
    sink = told(tmp_path)
    sink.show(1.5, orjson.dumps(state))
    assert welcomed(sink)[1] == []


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (lambda state: b"[]", r"/station/state at 1.5 s is \[\]; expected an object"),
        (lambda state: b'{"is"', r"/station/state at 1.5 s is no JSON"),
        (lambda state: b"[" * 10000, r"/station/state at 1.5 s is no JSON"),
        (lambda state: b"{}", "lacks time; expected a number"),
        (
            lambda state: orjson.dumps(state)[:-1] + b',"x":' + b"[" * 300 + b"]" * 300 + b"}",
            "/station/state at 1.5 s cannot be shown",
        ),
        (lambda state: state | {"alarms": 5}, "alarms is 5; expected a list of keys, levels and texts"),
        (lambda state: state | {"alarms": [{"key": 5}]}, "expected a list of keys, levels and texts"),
        (lambda state: state | {"missing": None}, "missing is None; expected a list of bits and words"),
        (lambda state: state | {"telemetry": "x"}, "telemetry is 'x'; expected null or numbers by name"),
        (lambda state: state | {"telemetry": {"mode": "\x1b"}}, r"telemetry is {'mode': '\\x1b'}; expected"),
        (lambda state: state | {"place": [1]}, "expected null or latitude and longitude"),
        (lambda state: state | {"time": True}, "time is True; expected a number"),
    ],
)
def test_a_state_that_is_none_is_told(
    tmp_path: Path, state: dict[str, Any], wrong: Callable[[dict[str, Any]], Any], says: str
) -> None:
    sink, content = told(tmp_path), wrong(state)
    sink.show(1.5, content if isinstance(content, bytes) else orjson.dumps(content))
    with pytest.raises(LogError, match=says) as error:
        welcomed(sink)
    assert str(sink.path) in str(error.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ([1], r"is \[1\]; expected an object"),
        ({"message": "x"}, "lacks level; expected a whole number"),
        ({"level": [1], "message": "x"}, r"level is \[1\]; expected a whole number"),
        ({"level": 2, "message": 3}, "message is 3; expected text"),
    ],
)
def test_an_event_that_is_none_is_told(tmp_path: Path, content: Any, says: str) -> None:
    sink = told(tmp_path)
    sink._write(EVENTS, 1.5, content)
    with pytest.raises(LogError, match=f"/station/events at 1.5 s:? {says}"):
        welcomed(sink)


def test_who_joins_is_told_the_last_500_events_and_no_book(tmp_path: Path) -> None:
    sink = told(tmp_path)
    for k in range(600):
        sink.event(Event(1.0 + k / 1000, Level.ADVISORY, f"{k} " + "A" * 5000))
    events = welcomed(sink)[1]
    assert len(events) == 500
    assert events[-1]["text"].startswith("599 ")
    assert len(events[-1]["text"]) == 1000


def test_parameters_that_are_no_finite_numbers_are_left_out_and_counted(tmp_path: Path) -> None:
    odd = {"controller.stopped_speed": "<b>", "command_module.stop_tone": "nan"}
    hello, events = welcomed(
        told(tmp_path, odd | {"controller.capture_radius": "7.0", "plant.seed": "nan", "x.y": "z"})
    )
    assert hello["thresholds"] == {"capture_radius": 7.0}
    assert hello["cues"]["STOP"]["tone_hz"] > 0, "what is usual"
    assert hello["world"] is None
    assert [event["text"] for event in events] == ["2 parameters are no finite numbers, and are left out"]


@pytest.mark.parametrize("tone", ["1e300", "0.5", "0"])
def test_a_tone_that_nothing_plays_is_told(tmp_path: Path, tone: str) -> None:
    with pytest.raises(UsageError, match=r"command_module.stop_tone is .* Hz"):
        welcomed(told(tmp_path, {"command_module.stop_tone": tone}))


def test_rows_that_are_not_finite_are_left_out_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sink = told(tmp_path)
    sink.close()
    log = read_log(sink.path)
    log.values["telemetry"][-1, 3] = np.inf
    log.values["telemetry"][-2, 4] = np.nan
    monkeypatch.setattr(playback, "read_log", lambda path: log)
    events = json.loads(Playback(sink.path).join(1)[1])["events"]
    assert [event["text"] for event in events] == ["2 rows are no finite numbers, and are left out"]
    log.values["telemetry"][:, 3] = np.inf
    with pytest.raises(LogError, match=re.escape("no telemetry is finite")):
        Playback(sink.path)
