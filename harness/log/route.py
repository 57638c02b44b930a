"""The mission's waypoints and its fence, as a log's parameters state them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Route:
    """The mission: places as (label, north, east) in m, home last, and the capture radius in m.

    Attributes:
        fence: corners of the polygon that held in the trial, north and east in m; none if there was none.
    """

    places: tuple[tuple[str, float, float], ...]
    radius: float
    fence: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of(cls, parameters: Mapping[str, str]) -> Route | None:
        """From a log's `parameters` record; None if its controller has no such waypoints."""
        try:

            def value(name: str) -> float:
                number = float(parameters[f"controller.{name}"])
                if not math.isfinite(number):
                    raise ValueError
                return number

            numbers = range(1, int(value("waypoint_count")) + 1)
            places = [
                (f"waypoint {i}", value(f"waypoint_north[{i}]"), value(f"waypoint_east[{i}]"))
                for i in numbers
            ]
            home = ("home", value("home_north"), value("home_east"))
            route = cls((*places, home), value("capture_radius"))
        except (KeyError, ValueError):
            return None
        try:
            corners = range(1, int(value("fence_count")) + 1 if value("guarded") else 1)
            fence = tuple((value(f"fence_north[{i}]"), value(f"fence_east[{i}]")) for i in corners)
        except (KeyError, ValueError):  # another's controller, or an earlier log
            return route
        return replace(route, fence=fence)
