"""How a system is stepped, for options and scenarios: the order, for how long, and what changes meanwhile."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Order = Literal["sequential", "jacobi"]
Loop = Literal["native", "python"]  # what makes the calls of a tick
Ticks = tuple[int, int]  # from the first to before the second
DURATION = 300.0  # s, after which a trial is cut
GIB = 2**30  # bytes
CALL_LIMIT_S, MEMORY_LIMIT_GIB = (0.1, 3600.0), (0.5, 1024.0)  # what a user may set


def first_tick(time: float, step: float) -> int:
    """The first tick of `step` [s] at or after a time [s] of the trial."""
    return max(0, math.ceil(time / step - 1e-9))


@dataclass(frozen=True)
class Event:
    """From the first tick at or after `time` [s] the free input has this value (SI)."""

    time: float
    component: str
    variable: str
    value: float


@dataclass(frozen=True)
class Limits:
    """What FMUs that others built may take; the worker that they run in is ended beyond.

    Attributes:
        call: s for one call in the loop.
        start: s for one call before the first tick, loading included; `free`: for one after the last.
        memory: bytes in use.
    """

    call: float = 10.0
    start: float = 60.0
    free: float = 5.0
    memory: int = 2 * GIB


def whole_steps(spans: Iterable[Ticks], every: int) -> tuple[Ticks, ...]:
    """The ticks of the steps that begin in spans, where a step begins on every so many ticks.

    Returns:
        spans that are not empty, apart and in their order.
    """
    whole: list[Ticks] = []
    for span in sorted(spans):
        first, after = (-(-tick // every) * every for tick in span)
        if whole and first <= whole[-1][1]:
            whole[-1] = whole[-1][0], max(whole[-1][1], after)
        elif first < after:
            whole.append((first, after))
    return tuple(whole)
