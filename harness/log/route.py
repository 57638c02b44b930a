"""The mission's waypoints, as a log's parameters state them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Route:
    """The mission: places as (label, north, east) in m, home last, and the capture radius in m."""

    places: tuple[tuple[str, float, float], ...]
    radius: float

    @classmethod
    def of(cls, parameters: Mapping[str, str]) -> Route | None:
        """From a log's `parameters` record; None if its controller has no such waypoints."""
        try:

            def value(name: str) -> float:
                return float(parameters[f"controller.{name}"])

            numbers = range(1, int(value("waypoint_count")) + 1)
            places = [
                (f"waypoint {i}", value(f"waypoint_north[{i}]"), value(f"waypoint_east[{i}]"))
                for i in numbers
            ]
            home = ("home", value("home_north"), value("home_east"))
            return cls((*places, home), value("capture_radius"))
        except (KeyError, ValueError):
            return None
