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
    """The rows of a station's last mission; the log itself if none was under way.

    ABORT withdraws the start; the stop that follows it is the mission's end.
    """
    started = log["controller.start"] != 0
    if not started.any():
        return log
    begin = int(np.flatnonzero(np.diff(started, prepend=False) & started)[-1])
    until = int(np.flatnonzero(started)[-1]) + 1
    after = log["controller.status"][until:] != Status.STOPPED
    until += int(np.argmax(after)) if after.any() else len(after)
    values = {component: table[begin:until] for component, table in log.values.items()}
    return replace(log, time=log.time[begin:until], values=values)


def start_of_last(log: Log) -> float | None:
    """When the last mission began, s; None if none did."""
    mission = last_mission(log)
    return float(mission.time[0]) if mission["controller.start"][0] else None
