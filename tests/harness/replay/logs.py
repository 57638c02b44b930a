"""Small logs of trials with sensors, made without an FMU: a walk straight north."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from harness.log.channel import Array, Channel
from harness.log.writer import LogWriter
from models.four_state import FourState

TICK_S = 0.04
BOOLEANS = ("gps_fix",)


def walk(seconds: float = 30.0) -> dict[str, Array]:
    """The sensors' signals of a walk to the north at 2 m/s from 4 s on, (ticks,) each."""
    time = np.arange(round(seconds / TICK_S)) * TICK_S
    names = (*FourState.flat_names("input"), "gps_course")
    signals = {name: np.zeros(len(time)) for name in names}
    moving = np.clip(time - 4, 0, None)
    signals["gps_fix"] = (np.arange(len(time)) % 5 == 0).astype(float)
    signals["gps_north"], signals["gps_speed"] = 2 * moving, np.where(moving > 0, 2.0, 0.0)
    signals["gps_h_acc"], signals["gps_s_acc"] = np.full((2, len(time)), 0.5)
    return signals


def write(
    path: Path,
    signals: dict[str, Array],
    at: Array | None = None,
    metadata: Mapping[str, Mapping[str, str]] | None = None,
) -> Path:
    """Write a log of these signals, at every tick from 0 s on by default."""
    names = tuple(signals)
    types = tuple("Boolean" if name in BOOLEANS else "Real" for name in names)
    channel = Channel("sensors", "sensors", names, ("",) * len(names), types, names)
    rows = np.column_stack(list(signals.values()))
    times = np.arange(len(rows), dtype=np.float64) * TICK_S if at is None else at
    with LogWriter(path, [channel], origin=(0, 0), metadata=metadata or {}, attachments={}) as log:
        for start in range(0, len(rows), 25):
            log.write_rows(times[start : start + 25], {"sensors": rows[start : start + 25]})
    return path
