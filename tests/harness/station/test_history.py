"""What was, for who joins late."""

from __future__ import annotations

from dataclasses import replace

import orjson

from codegen.firmware.telemetry import FIELDS, Flag, Telemetry
from harness.station.history import MOST_ROWS, History
from harness.station.shown import TRACK, add_to
from models.commands import Command

NOTHING = Telemetry(*[0] * len(FIELDS))


def test_a_history_stays_small_and_keeps_its_first_and_newest_rows() -> None:
    history = History(("time", "command"))
    for i in range(10 * MOST_ROWS):
        history.add({"time": float(i), "command": Command.STOP, "other": 1.0})
    times = history.columns()["time"]
    assert len(times) <= MOST_ROWS
    assert times[0] == 0
    assert times[-1] >= 10 * MOST_ROWS - 32
    assert times == sorted(times)
    assert History(("time",)).columns() == {"time": []}


def test_what_was_is_told_in_few_bytes_so_that_a_slow_link_carries_it_within_seconds() -> None:
    track = History(TRACK)
    for i in range(MOST_ROWS):
        told = replace(
            NOTHING,
            flags=Flag.FIXED,
            speed=255,
            heading=12345,
            position_sd=123,
            deviation=-3333,
            latitude=326062000 + i,
        )
        add_to(track, 0.2 * i + 1 / 3, told)
    assert track.columns()["latitude"][7] == 32.6062007
    assert len(orjson.dumps(track.columns())) < 100 * MOST_ROWS
