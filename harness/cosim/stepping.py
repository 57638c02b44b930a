"""How a system is stepped, for options and scenarios: the order, for how long, and what changes meanwhile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Order = Literal["sequential", "jacobi"]
Loop = Literal["native", "python"]  # what makes the calls of a tick
DURATION = 300.0  # s, after which a trial is cut


@dataclass(frozen=True)
class Event:
    """From the first tick at or after `time` [s] the free input has this value (SI)."""

    time: float
    component: str
    variable: str
    value: float
