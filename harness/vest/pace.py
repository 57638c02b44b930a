"""Ticks at their times by the clock, and deadlines that were missed."""

from __future__ import annotations

import time
from collections.abc import Callable


class Pace:
    """When the next tick is due: a period after the one before, whose deadline that is.

    As on board, one late tick is made up for: the next is due as if it had been in time. From a period on,
    the time that is lost is left out, so a machine that was asleep goes on from where it was.

    Args:
        period: s of the clock from tick to tick.
        now: gives the clock's time, s.
        sleep: waits for so many s, or less.

    Attributes:
        ticks: that were begun.
        missed: deadlines: a tick had not ended, or not even begun, when the next one was due.
        latest: s by which a tick began late, at most.
        lost: s that were left out.
    """

    def __init__(
        self,
        period: float,
        *,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self.period, self._now, self._sleep = period, now, sleep
        self.ticks = self.missed = 0
        self.latest = self.lost = 0.0
        self._due: float | None = None

    def wait(self) -> None:
        """Wait until the next tick is due; the first one is at once."""
        now = self._now()
        due = now if self._due is None else self._due
        overran = now > due
        if not overran:
            self._sleep(due - now)
            now = self._now()
        late = max(0.0, now - due)
        self.ticks += 1
        self.missed += overran or late >= self.period
        self.latest = max(self.latest, late)
        if late >= self.period:
            self.lost += late
            due = now
        self._due = due + self.period
