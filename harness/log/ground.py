"""The streets and poles of a trial, as a log's parameters state them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

ROUND = 8  # corners of a street's round end in an outline
Place = tuple[float, float]


@dataclass(frozen=True)
class Ground:
    """What stands where: north and east in m.

    Attributes:
        streets: both ends, and the half-width.
        poles: goal and decoys.
    """

    streets: tuple[tuple[Place, Place, float], ...] = ()
    poles: tuple[Place, ...] = ()

    @classmethod
    def of(cls, parameters: Mapping[str, str]) -> Ground | None:
        """From a log's `parameters` record; None without streets and poles, or where one is not finite."""

        def value(name: str) -> float:
            number = float(parameters[f"plant.{name}"])
            if not math.isfinite(number):
                raise ValueError
            return number

        try:
            ground = cls(
                tuple(
                    (
                        (value(f"street_north[{i}]"), value(f"street_east[{i}]")),
                        (value(f"street_end_north[{i}]"), value(f"street_end_east[{i}]")),
                        value(f"street_half_width[{i}]"),
                    )
                    for i in range(1, int(value("street_count")) + 1)
                ),
                tuple(
                    (value(f"pole_north[{i}]"), value(f"pole_east[{i}]"))
                    for i in range(1, int(value("pole_count")) + 1)
                ),
            )
            if not np.isfinite(ground.outlines()).all():  # the sum of large numbers
                raise ValueError
        except (KeyError, ValueError):
            return None
        return ground if ground.streets or ground.poles else None

    def outlines(self) -> list[list[Place]]:
        """The corners round each street."""
        return [_outline(start, end, half_width) for start, end, half_width in self.streets]


def _outline(start: Place, end: Place, half_width: float) -> list[Place]:
    """The corners round a street, whose ends are round."""
    way = math.atan2(end[1] - start[1], end[0] - start[0])
    return [
        (place[0] + half_width * math.cos(angle), place[1] + half_width * math.sin(angle))
        for place, behind in ((end, -0.5 * math.pi), (start, 0.5 * math.pi))
        for angle in (way + behind + math.pi * k / ROUND for k in range(ROUND + 1))
    ]
