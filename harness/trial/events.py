"""The events of a trial from its log, for its page: commands, anomalies, disturbances, the end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

import numpy as np

from harness.log.events import OUTPUTS, because, in_words
from harness.log.log import Log
from harness.report.times import clock
from harness.trial.disturbances import disturbances
from harness.trial.summary import DOUBTS, ended_by
from models.commands import Status

Level = Literal["advisory", "caution", "warning"]
Mark = Literal["waypoint", "anomaly"]
MARKS: dict[str, Mark] = {mark: mark for mark in get_args(Mark)}  # by output of the controller
TOGETHER = 1.01  # s: doubts of the estimator that follow one another within it are one event


@dataclass(frozen=True)
class Event:
    """What happened at a time [s], and how grave it is.

    Attributes:
        mark: what marks it on the path and over time; None for nothing.
    """

    time: float
    level: Level
    text: str
    mark: Mark | None = None


def events(log: Log) -> list[Event]:
    """All events in the order of their times."""
    happened = [*_of_controller(log), *_of_estimator(log), *_of_disturbances(log)]
    if log.broken:
        happened.append(Event(float(log.time[-1]), "warning", f"the log ends here: {log.broken}"))
    return sorted(happened, key=lambda event: event.time)


def _of_controller(log: Log) -> Iterator[Event]:
    for output in OUTPUTS:
        signal = f"controller.{output}"
        if signal not in log:
            continue
        values = log[signal]
        starts = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist()]
        for row, after in pairwise([*starts, len(values)]):
            if (row == 0 and not values[row]) or not (text := in_words(output, values[row])):
                continue
            level: Level = "caution" if output == "anomaly" else "advisory"
            if output == "anomaly" and after > row + 1:
                text += f" for {log.time[min(after, len(values) - 1)] - log.time[row]:.2f} s"
            elif output == "status" and values[row] in (Status.FAILED, Status.STOPPED):
                level, text = "warning", text + because(ended_by(log, row))
            yield Event(float(log.time[row]), level, text, MARKS.get(output))


def _of_estimator(log: Log) -> Iterator[Event]:
    for signal, sign, text in DOUBTS.values():
        if signal not in log:
            continue
        times = log.time[1:][sign * np.diff(log[signal]) > 0]
        for group in np.split(times, np.flatnonzero(np.diff(times) > TOGETHER) + 1):
            if len(group):
                more = f", {len(group)} times until {clock(float(group[-1]))}" if len(group) > 1 else ""
                yield Event(float(group[0]), "caution", text + more, "anomaly")


def _of_disturbances(log: Log) -> Iterator[Event]:
    for kind, spans in disturbances(log).items():
        for start, end in spans:
            yield Event(start, "caution", f"{kind} begins")
            yield Event(end, "advisory", f"{kind} ends")
