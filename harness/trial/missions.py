"""The missions in a station's log, which may hold several, or none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.log.log import Log
from models.commands import Status


def is_of_station(log: Log) -> bool:
    """Did `canine station` write it?"""
    return "station" in log.metadata.get("run", {})


def last_mission(log: Log) -> Log:
    """A station's log up to the end of its last mission; the log itself if none was under way.

    ABORT withdraws the start; the stop that follows it is the mission's end.
    """
    rows = np.flatnonzero(log["controller.start"] != 0)
    if not rows.size:
        return log
    until = int(rows[-1]) + 1
    after = log["controller.status"][until:] != Status.STOPPED
    until += int(np.argmax(after)) if after.any() else len(after)
    values = {component: table[:until] for component, table in log.values.items()}
    return replace(log, time=log.time[:until], values=values)


def start_of(mission: Log) -> float | None:
    """When the mission began that a log ends with, s; None if none did."""
    starts = np.flatnonzero(np.diff(mission["controller.start"], prepend=0.0) > 0)
    return float(mission.time[starts[-1]]) if starts.size else None
