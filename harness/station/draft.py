"""A mission as it is drawn, and what its places must be."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from harness.files import in_words
from harness.onboard.radio import MAX_LATITUDE, MAX_LONGITUDE, Mission, Position, RadioError
from models.cmec import MAX_WAYPOINTS
from models.errors import UsageError, printable
from models.fence import MAX_CORNERS

DIGITS = 7  # of a degree: 1 cm, as the radio sends
HOME, WAYPOINT, FENCE = "home", "waypoint", "fence"
# `float` reads 1_0 as 10. Each digit is read once, and no long text, which would hold up the station.
NUMBER = re.compile(r"(?!.{41})[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
NAMED = 5  # of what there is too much of


class MissionFileError(UsageError):
    """A file holds no mission that can be read, or a mission cannot be written."""


@dataclass(frozen=True)
class Draft:
    """A mission as it is drawn: without home, or without waypoints, it is not complete yet.

    Attributes:
        fence: corners in order, 3 to 7; none for no fence.
        notes: what of its file was left out, in words.
    """

    home: Position | None = None
    waypoints: tuple[Position, ...] = ()
    fence: tuple[Position, ...] = ()
    notes: tuple[str, ...] = ()

    @cached_property
    def mission(self) -> Mission | str:
        """The mission as it is sent; while it cannot be, why."""
        if self.home is None or not self.waypoints:
            lacks = "home" if self.home is None else "waypoints"
            return f"the mission has no {lacks}; expected home and at least one waypoint"
        mission = Mission(self.home, self.waypoints, self.fence)
        try:
            mission.payload()
        except RadioError as reason:
            return str(reason)
        return mission


def as_json(draft: Draft) -> dict[str, Any]:
    """A draft as the browser has it: positions are pairs [latitude, longitude] in deg, home may be null."""
    return {
        "home": pair(draft.home) if draft.home else None,
        "waypoints": [pair(position) for position in draft.waypoints],
        "fence": [pair(corner) for corner in draft.fence],
        "notes": list(draft.notes),
    }


def from_json(value: object) -> Draft:
    """A draft that a browser sent, in the form of `as_json`; it may be incomplete, and its fence no polygon.

    Raises:
        MissionFileError: it has another form, too many places, or a position out of range.
    """
    if not isinstance(value, Mapping):
        raise MissionFileError(f"the mission is {in_words(value)}, expected home, waypoints and fence")
    home = value.get("home")
    return Draft(
        None if home is None else _position(home, HOME),
        _listed(value, "waypoints", MAX_WAYPOINTS),
        _listed(value, "fence", MAX_CORNERS),
    )


def _listed(value: Mapping[str, object], key: str, most: int) -> tuple[Position, ...]:
    places = value.get(key, [])
    expected = f"up to {most} pairs [latitude, longitude] in deg"
    if not isinstance(places, list):
        raise MissionFileError(f"{key} is {in_words(places)}, expected {expected}")
    if len(places) > most:
        raise MissionFileError(f"{key} has {len(places)} places, expected {expected}")
    return tuple(_position(place, f"{key}[{number}]") for number, place in enumerate(places, start=1))


def _position(value: object, what: str) -> Position:
    if not isinstance(value, list) or len(value) != 2:
        raise MissionFileError(f"{what} is {in_words(value)}, expected a pair [latitude, longitude] in deg")
    return place_of(what, *value)


def place_of(what: str, latitude: object, longitude: object) -> Position:
    """A position, in range; `what` names the place in errors."""
    return Position(
        _number(what, "latitude", latitude, MAX_LATITUDE),
        _number(what, "longitude", longitude, MAX_LONGITUDE),
    )


def _number(what: str, name: str, value: object, limit: float) -> float:
    """A number of degrees, or the text of one."""
    number = math.nan
    if isinstance(value, str):
        number = float(value) if NUMBER.fullmatch(value.strip()) else math.nan
    elif isinstance(value, int | float) and not isinstance(value, bool):
        with suppress(OverflowError):
            number = float(value)
    if not -limit <= number <= limit:
        shown = printable(in_words(value))
        raise MissionFileError(f"{what}: {name} is {shown}, expected -{limit:g} to {limit:g} deg")
    return number


def pair(position: Position) -> tuple[float, float]:
    """Latitude and longitude in deg, as they are written and sent."""
    return round(position.latitude, DIGITS), round(position.longitude, DIGITS)


def opened(ring: Iterable[Position]) -> tuple[Position, ...]:
    """The corners of a fence, whose last may repeat its first."""
    corners = tuple(ring)
    return corners[:-1] if len(corners) > 1 and corners[0] == corners[-1] else corners


def sole(places: list[Position]) -> Position | None:
    """The home of a file, if it has one."""
    if len(places) > 1:
        raise MissionFileError(f'holds {len(places)} places of the name "{HOME}", expected one at most')
    return places[0] if places else None


def is_named(name: object, word: str) -> bool:
    """Does a file call a place so?"""
    return isinstance(name, str) and name.strip().lower() == word


def listed(names: Iterable[str]) -> str:
    """The first NAMED of the names, and how many more there are."""
    named = list(names)
    more = f" and {len(named) - NAMED} more" if len(named) > NAMED else ""
    return ", ".join(named[:NAMED]) + more


def left_out(count: int, what: str) -> list[str]:
    """The note on what a reader does not take; none for a count of 0."""
    return [f"{count} {what}{'s' if count > 1 else ''} left out"] if count else []
