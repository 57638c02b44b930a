"""A scenario: the start is home; waypoints and fence are metres about the origin."""

from __future__ import annotations

import math

from harness.log.geodesy import TangentPlane
from harness.onboard.radio import Position
from harness.station.draft import Draft, MissionFileError, pair
from harness.trial.scenario import Scenario, ScenarioError, checked, parse


def read(data: bytes) -> Draft:
    """The mission in such a file.

    Raises:
        MissionFileError: it holds none, or several.
    """
    try:
        scenario = parse(data.decode("utf-8-sig"), "scenario")
    except UnicodeDecodeError as reason:
        raise MissionFileError(f"{reason}; save it as UTF-8") from None
    except ScenarioError as reason:
        raise MissionFileError(str(reason).removeprefix("scenario: ")) from None
    return of_scenario(scenario)


def of_scenario(scenario: Scenario) -> Draft:
    """A scenario's start as home, its waypoints and its fence."""
    plane = TangentPlane(*map(math.radians, scenario.origin))

    def position(north: float, east: float) -> Position:
        return Position(*plane.place(north, east))

    north, east, _ = scenario.start
    return Draft(
        position(north, east),
        tuple(position(*place) for place in scenario.waypoints),
        tuple(position(*corner) for corner in scenario.fence),
    )


def write(draft: Draft, name: str) -> bytes:
    """A scenario whose origin is home."""
    origin = pair(draft.home or draft.waypoints[0])
    plane = TangentPlane(*map(math.radians, origin))

    def metres(position: Position) -> tuple[float, float]:
        north, east = plane.to_plane(*map(math.radians, pair(position)))
        return round(float(north), 4), round(float(east), 4)  # a hundredth of what the radio tells apart

    try:
        scenario = checked(
            Scenario(
                name=name,
                waypoints=tuple(map(metres, draft.waypoints)),
                fence=tuple(map(metres, draft.fence)),
                origin=origin,
            )
        )
    except ScenarioError as reason:
        raise MissionFileError(f"the mission makes no scenario: {reason}") from None
    return scenario.text().encode()
