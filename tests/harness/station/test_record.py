"""A station's log and the vest's own record of the same missions: they tell the same, one by one."""

from __future__ import annotations

import json
from functools import partial
from itertools import pairwise
from typing import Any, cast

import numpy as np
import pytest

from harness.log.events import ANOMALIES, STATUSES
from harness.log.log import FILE, Log, read_log
from harness.station import opening
from harness.station.headless import Headless
from harness.station.mission_files import load
from harness.station.opening import Request, opened
from harness.vest.vest import open_vest
from models.commands import Command, Status
from models.modes import Anomaly
from tests.harness.station.dogs import TURN, obedient

SPEED = 8.0
FARTHER = [[70.0, 0.0]]  # behind the first waypoint of TURN
OF_BOTH = ("command", "mode", "status", "waypoint", "directional_commands")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Log, Log]:
    """The vest's log and the station's of two missions: a rule ends that of a dog that obeys no
    turn; the other is stopped, goes on, and is aborted."""
    folder = tmp_path_factory.mktemp("record")
    scenario = str(obedient(folder, TURN, obeys=0.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(opening, "open_vest", partial(open_vest, out=folder / "vest"))
        with opened(
            Request(simulate=scenario, speed=SPEED, out=folder / "out"), lambda text: None
        ) as session:
            operator, conduct = Headless(session), cast("Any", session.conduct)
            operator.lead(session.about.mission, start=True)
            operator.lead(load(str(obedient(folder, FARTHER))), start=False)
            operator._wait(lambda: not conduct.missing(session.now), 60, "the vest was not ready")
            operator._order("start")
            operator._wait(lambda: conduct.telemetry.command == Command.FORWARD, 60, "no FORWARD")
            operator._order("stop")
            operator._wait(lambda: conduct.telemetry.command == Command.STOP, 60, "no STOP")
            operator._order("clear_stop")
            operator._wait(lambda: conduct.telemetry.command == Command.FORWARD, 60, "no FORWARD again")
            operator._order("abort")
            operator._wait(lambda: conduct.telemetry.status == Status.IDLE, 60, "no end")
    return read_log(folder / "vest" / FILE), read_log(folder / "out" / FILE)


def reports(log: Log) -> list[int]:
    """The rows on which a telemetry is new."""
    rows: list[int] = np.flatnonzero(np.diff(log["telemetry.time"], prepend=0.0)).tolist()
    return rows


def paired(logs: tuple[Log, Log]) -> list[tuple[int, int]]:
    """The rows of the vest and of the station with each telemetry, from the first that was believed on."""
    vest, station = logs
    of_vest = {float(vest["telemetry.time"][row]): row for row in reports(vest)}
    of_station = {float(station["telemetry.time"][row]): row for row in reports(station)}
    times = [time for time in of_vest if min(of_station) <= time <= max(of_station)]
    assert times == list(of_station), "none is lost, none is invented, and they are in order"
    return [(of_vest[time], of_station[time]) for time in times]


def test_each_telemetry_that_the_vest_sent_is_logged_with_every_value(logs: tuple[Log, Log]) -> None:
    vest, station = logs
    rows = np.array(paired(logs))
    assert len(rows) > 100
    assert np.array_equal(vest.values["telemetry"][rows[:, 0]], station.values["telemetry"][rows[:, 1]])


def test_what_the_log_says_of_the_controller_is_what_the_vest_had_in_its_memory(
    logs: tuple[Log, Log],
) -> None:
    vest, station = logs
    rows = np.array(paired(logs))
    for name in OF_BOTH:
        of_vest, of_station = vest[f"controller.{name}"], station[f"controller.{name}"]
        assert np.array_equal(of_vest[rows[:, 0]], of_station[rows[:, 1]]), name
        assert len(set(of_station)) > 1, f"{name} tells nothing here"


def told_by(station: Log) -> list[str]:
    """The events in a station's log about the trial, in order."""
    from mcap.reader import make_reader  # noqa: PLC0415 - an independent reader

    with station.path.open("rb") as file:
        messages = make_reader(file).iter_messages("/station/events")
        texts = [json.loads(message.data)["message"] for _, _, message in messages]
    of_trial = {*STATUSES.values(), *ANOMALIES.values()}
    return [text for text in texts if text in of_trial or text.startswith("waypoint ")]


def remembered(vest: Log, rows: list[int]) -> list[str]:
    """The same events from what the vest had in its memory on each tick, as reports on these rows show it."""
    status, waypoint = vest["controller.status"], vest["controller.waypoint"]
    starts = np.diff(vest["controller.start"], prepend=0.0) > 0
    last, known = 0, np.zeros(len(vest.time), dtype=int)
    for tick, anomaly in enumerate(vest["controller.anomaly"].astype(int).tolist()):
        last = anomaly or (0 if starts[tick] else last)
        known[tick] = last
    events = []
    for before, now in pairwise(rows):
        if status[now] != status[before]:
            events.append(STATUSES[status[now]])
        if waypoint[now] > waypoint[before]:
            events.append(f"waypoint {int(waypoint[now])} reached")
        if known[now] not in (0, known[before]):
            events.append(ANOMALIES[int(known[now])])
    return events


def test_the_events_that_the_station_tells_are_those_of_the_vests_memory_one_by_one(
    logs: tuple[Log, Log],
) -> None:
    vest, station = logs
    expected = remembered(vest, [row for row, _ in paired(logs)])
    assert told_by(station) == expected
    assert {"the trial has begun", "the trial was stopped", "waypoint 1 reached"} <= set(expected)
    assert {ANOMALIES[a] for a in (Anomaly.TURN_FAILURE, Anomaly.BUDGET_SPENT)} <= set(expected)


def test_nothing_that_the_vest_remembers_for_a_report_is_left_out_of_the_log(logs: tuple[Log, Log]) -> None:
    # the vest's own record has 25 ticks a second, the telemetry five: no status or waypoint lasts less
    vest, station = logs
    rows = paired(logs)
    for name in ("status", "waypoint"):
        first, last = rows[0][0], rows[-1][0]
        assert steps(vest[f"controller.{name}"][first : last + 1]) == steps(
            station[f"controller.{name}"][rows[0][1] : rows[-1][1] + 1]
        ), name


def steps(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[float]:
    """The values one after another, each once."""
    changed = np.flatnonzero(np.diff(values, prepend=np.nan) != 0)
    return [float(value) for value in values[changed]]
