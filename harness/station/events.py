"""Events: what happened, in words, with the three levels of AC 25.1322."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from codegen.firmware.telemetry import Flag, Telemetry
from harness.log.events import ENDS_A_TRIAL, in_words
from models.commands import Status


class Level(StrEnum):
    """How urgent something is (AC 25.1322-1): act at once, know at once and act later, know."""

    ADVISORY = "advisory"
    CAUTION = "caution"
    WARNING = "warning"


@dataclass(frozen=True)
class Event:
    """Something that happened.

    Attributes:
        time: s, of the station.
    """

    time: float
    level: Level
    text: str


Told = tuple[Level, str]

LEVELS = {Status.FAILED: Level.CAUTION, Status.STOPPED: Level.CAUTION}
COUNTED = {
    "link_forged": "the vest refused forged frames",
    "link_replayed": "the vest refused replayed frames",
    "recoveries": "the estimator began anew",
}


def changes(before: Telemetry | None, now: Telemetry) -> Iterator[Told]:
    """What a telemetry tells that the one before it, of the same session, did not."""
    if before is None:
        return
    if now.status != before.status:
        status = now.status
        level = LEVELS.get(Status(status), Level.ADVISORY) if status in set(Status) else Level.CAUTION
        yield level, in_words("status", status)
    if now.waypoint > before.waypoint:
        yield Level.ADVISORY, in_words("waypoint", now.waypoint)
    if now.last_anomaly != before.last_anomaly and now.last_anomaly:
        level = Level.WARNING if now.last_anomaly in ENDS_A_TRIAL else Level.CAUTION
        level = level if Flag.STARTED in Flag(now.flags) else Level.ADVISORY
        yield level, in_words("anomaly", now.last_anomaly)
    for name, what in COUNTED.items():
        if (more := getattr(now, name) - getattr(before, name)) > 0:
            yield Level.CAUTION, f"{what} ({more})"
