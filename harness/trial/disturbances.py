"""What disturbed a trial: outages, orders and lost radio, as its rows show them; the scenario's faults."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import numpy.typing as npt

from harness.log.log import Log
from harness.trial.scenario import LOST, Disturbance, ScenarioError, parse
from models.commands import Command

GPS_OUTAGE, ORDER, LOST_RADIO = "GPS outage", "operator's order", "lost radio"
Span = tuple[float, float]  # s, from and until


def disturbances(log: Log) -> dict[str, list[Span]]:
    """When each kind was; kinds that were not are left out.

    - GPS outage: from the first fix that was due and did not come to the next that came.
    - operator's order: an override, or the start signal withdrawn after it was given.
    - lost radio: `link_ok` was false.
    - each fault of the scenario, under its words.
    """
    kinds = {GPS_OUTAGE: _outages(log), ORDER: _orders(log), LOST_RADIO: _lost_radio(log)}
    end = float(log.time[-1])
    for fault in faults_of(log):
        if fault.kind != LOST and fault.at <= end:
            span = (fault.at, end if fault.until is None else min(fault.until, end))
            kinds.setdefault(fault.words(log.units), []).append(span)
    return {kind: spans for kind, spans in kinds.items() if spans}


def faults_of(log: Log) -> tuple[Disturbance, ...]:
    """The faults of a log's scenario; none if the log does not tell."""
    with suppress(KeyError, ScenarioError):
        return parse(log.metadata["scenario"]["toml"], "the log's scenario").faults
    return ()


def spans_where(log: Log, condition: npt.NDArray[np.bool_]) -> list[Span]:
    """The stretches of ticks, (ticks,), where a condition holds: from the first to the one after the last."""
    edges = np.flatnonzero(np.diff(condition.astype(np.int8), prepend=0, append=0))
    return [
        (float(log.time[first]), float(log.time[min(after, len(log.time) - 1)]))
        for first, after in edges.reshape(-1, 2)
    ]


def _outages(log: Log) -> list[Span]:
    if "sensors.gps_fix" not in log:
        return []
    begin, end = float(log.time[0]), float(log.time[-1])
    step = float(np.diff(log.time).max(initial=0.0))
    fixes = log.time[log["sensors.gps_fix"] > 0]
    period = log.parameter("sensors.gps_period")
    if period is None:  # a foreign receiver
        period = float(np.median(np.diff(fixes))) if len(fixes) > 1 else 0.0
    known = [begin - period, *map(float, fixes)]
    spans = [
        (last + period, following)
        for last, following in zip(known, [*known[1:], end], strict=True)
        if following - last > period + 1.01 * step  # a fix falls on the first tick after it is due
    ]
    return [(begin, end)] if not len(fixes) else spans


def _orders(log: Log) -> list[Span]:
    if "controller.override" not in log:
        return []
    ordered = log["controller.override"] != Command.NONE
    if "controller.start" in log:
        start = log["controller.start"] != 0
        ordered |= np.logical_or.accumulate(start) & ~start
    return spans_where(log, ordered)


def _lost_radio(log: Log) -> list[Span]:
    return spans_where(log, log["controller.link_ok"] == 0) if "controller.link_ok" in log else []
