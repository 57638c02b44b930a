"""What a log says that a station showed. It is checked first: a log may come from anybody."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import orjson

from harness.log.channel import SECOND
from harness.log.contents import MESSAGE, Contents
from harness.log.log import LogError, read_records
from harness.station.events import Event, Level
from harness.station.sink import EVENTS, SEVERITY, STATE
from models.errors import printable

LEVEL_OF = {number: level for level, number in SEVERITY.items()}
TEXT_CHARS = 1000  # of an event, at most: a note has half of it


@dataclass(frozen=True)
class Recorded:
    """What was shown, in order of time.

    Attributes:
        states: with their times, s: JSON objects that a page can draw.
    """

    states: list[tuple[float, bytes]]
    events: list[Event]


def read_recorded(path: Path) -> Recorded:
    """What a log's station showed; nothing if the log is not of a station.

    Raises:
        LogError: a state or an event is not one.
    """
    with path.open("rb") as file:
        contents = _Messages(path.stat().st_size)
        read_records(path, file, path.stat().st_size, contents)
    states, events = sorted(contents.messages[STATE]), contents.messages[EVENTS]
    for moment, data in states:
        _checked(path, STATE, moment, data, _STATE)
    return Recorded(
        states, [_event(moment, _checked(path, EVENTS, moment, data, _EVENT)) for moment, data in events]
    )


class _Messages(Contents):
    """The messages of what was shown, with their times in s."""

    def __init__(self, size: int) -> None:
        super().__init__(size)
        self.messages: dict[str, list[tuple[float, bytes]]] = {STATE: [], EVENTS: []}

    def _take_message(self, data: bytes, start: int, end: int) -> None:
        super()._take_message(data, start, end)
        channel, moment = MESSAGE.unpack_from(data, start)
        messages = self.messages.get(self._channels[channel].topic)
        if messages is not None:
            messages.append((moment / SECOND, data[start + MESSAGE.size : end]))


Checks = Mapping[str, tuple[str, Callable[[Any], bool]]]  # by name: what is expected, and whether it is so


def _checked(path: Path, topic: str, moment: float, data: bytes, checks: Checks) -> dict[str, Any]:
    what = f"log {path}: the message of {topic} at {moment:g} s"
    try:
        content = orjson.loads(data)
    except orjson.JSONDecodeError as reason:
        raise LogError(f"{what} is no JSON ({reason}); take another copy") from None
    try:
        orjson.dumps(content)
    except TypeError as reason:  # deeper than a state that is shown may be
        raise LogError(f"{what} cannot be shown ({reason}); take another copy") from None
    if not isinstance(content, dict):
        raise LogError(f"{what} is {_shown(content)}; expected an object; take another copy")
    for name, (expected, is_so) in checks.items():
        if name not in content:
            raise LogError(f"{what} lacks {name}; expected {expected}; take another copy")
        if not is_so(content[name]):
            raise LogError(
                f"{what}: {name} is {_shown(content[name])}; expected {expected}; take another copy"
            )
    return content


def _shown(value: Any) -> str:
    return f"{printable(repr(value)):.80}"


def _event(moment: float, content: Mapping[str, Any]) -> Event:
    return Event(moment, LEVEL_OF.get(content["level"], Level.CAUTION), content["message"][:TEXT_CHARS])


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _are_numbers(value: Any) -> bool:
    return value is None or (isinstance(value, dict) and all(map(_is_number, value.values())))


def _is_place(value: Any) -> bool:
    return value is None or (isinstance(value, list) and len(value) == 2 and all(map(_is_number, value)))


def _are_with(*names: str) -> Callable[[Any], bool]:
    """A list of objects that have texts of these names."""
    return lambda value: (
        isinstance(value, list)
        and all(isinstance(each, dict) and all(_is_text(each.get(name)) for name in names) for each in value)
    )


_STATE: Checks = {
    "time": ("a number", _is_number),
    "link": ("text", _is_text),
    "telemetry": ("null or numbers by name", _are_numbers),
    "place": ("null or latitude and longitude", _is_place),
    "missing": ("a list of bits and words", _are_with("bit", "words")),
    "draft": ("an object", lambda value: isinstance(value, dict)),
    "stop_latched": ("true or false", lambda value: isinstance(value, bool)),
    "alarms": ("a list of keys, levels and texts", _are_with("key", "level", "text")),
}
_EVENT: Checks = {
    "level": ("a whole number", lambda value: _is_number(value) and isinstance(value, int)),
    "message": ("text", _is_text),
}
