"""Positions in time as the true path of trials: a table of them, or a trial's log, in pieces, on the ticks.

The plant `recorded` takes a piece's positions as its inputs `path_north` and `path_east`, one a tick.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import make_smoothing_spline

from harness.log.log import read_log
from harness.recording.attitude import Array
from harness.recording.described import Column, FileDescription, read_columns
from harness.recording.recording import RecordingError
from models.kit.timing import TICK

FASTEST = 12.0  # m/s; a dog among sheep is slower, and what seems faster is a joint between pieces
SHORTEST = 10.0  # s of a piece
CORNER = (
    1.5  # Hz above which smoothing takes more than half away: tags jitter, and animals do not turn so fast
)
LONGEST_GAP = 5.0  # times the usual time between two positions
COLUMNS = {  # of the herding dog's table: a local plane in m
    "time": Column("t_s", np.nan, 1.0),
    "east": Column("x_m", np.nan, 1.0),
    "north": Column("y_m", np.nan, 1.0),
}


@dataclass(frozen=True, eq=False)
class Piece:
    """Positions [m] without a jump, (ticks,) each, one a tick."""

    north: Array
    east: Array

    @property
    def seconds(self) -> float:
        """Its length [s]."""
        return len(self.north) * TICK


def read_positions(file: Path, shortest: float = SHORTEST) -> list[Piece]:
    """The pieces of a csv of positions, or the true path in a trial's log.

    Args:
        shortest: pieces that last no longer [s] are left out.

    Raises:
        RecordingError: it cannot be read, lacks a column, or has no piece that is long enough.
        LogError: the log is damaged.
    """
    if file.is_dir():
        raise RecordingError(
            f"{file}: is a folder; expected a csv of positions with the columns "
            f"{', '.join(str(column.column) for column in COLUMNS.values())}, or a trial's log"
        )
    if file.suffix == ".mcap":
        log = read_log(file)
        missing = [name for name in ("plant.north", "plant.east") if name not in log]
        if missing:
            raise RecordingError(f"{file}: got no {missing[0]}, expected the log of a trial with a plant")
        whole = [Piece(log["plant.north"], log["plant.east"])]
    else:
        values, _, _ = read_columns(FileDescription(file, COLUMNS))
        whole = pieces(values["time"], values["north"], values["east"])
    long_enough = [piece for piece in whole if piece.seconds > shortest]
    if not long_enough:
        longest = max((piece.seconds for piece in whole), default=0.0)
        raise RecordingError(
            f"{file}: its longest piece without a jump lasts {longest:.3g} s; "
            f"expected more than {shortest:g} s"
        )
    return long_enough


def stretches(whole: Iterable[Piece], seconds: float) -> list[Piece]:
    """Stretches of this length [s] from pieces, one behind the other, each from its own start at (0, 0).

    What is left of a piece is dropped.
    """
    ticks = round(seconds / TICK)
    return [
        Piece(*(p[begin : begin + ticks] - p[begin] for p in (piece.north, piece.east)))
        for piece in whole
        for begin in range(0, len(piece.north) - ticks + 1, ticks)
    ]


def pieces(time: Array, north: Array, east: Array) -> list[Piece]:
    """Positions (n,) at times [s], cut where they jump, smoothed and put on the ticks.

    A cubic smoothing spline is laid through each piece: it may look ahead, since this is the truth of a trial
    and no estimate. Pieces of under five positions are left out.
    """
    step = np.diff(time)
    usual = float(np.median(step[step > 0])) if np.any(step > 0) else 0.0
    joint = (
        (step <= 0)
        | (step > LONGEST_GAP * usual)
        | (np.hypot(np.diff(north), np.diff(east)) > FASTEST * step)
    )
    cuts = np.split(np.arange(len(time)), np.flatnonzero(joint) + 1)
    return [_on_ticks(time[cut], north[cut], east[cut]) for cut in cuts if len(cut) >= 5]


def _on_ticks(time: Array, north: Array, east: Array) -> Piece:
    ticks = time[0] + TICK * np.arange(np.floor((time[-1] - time[0]) / TICK + 1e-6) + 1)
    along = np.minimum(ticks, time[-1])
    # of a wave of this angular frequency the spline keeps 1/(1 + stiffness * interval * frequency^4)
    stiffness = 1 / (float(np.median(np.diff(time))) * (2 * np.pi * CORNER) ** 4)
    return Piece(*(np.asarray(make_smoothing_spline(time, x, lam=stiffness)(along)) for x in (north, east)))
