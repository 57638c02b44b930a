"""Reads an animal's statistics from one logged trial.

The statistics are the random draws of the animal's model (models/canine.py):

- The model draws speed, acceleration, deceleration, drift and both turn rates once a trial. So a trial gives
  one value of each: the slope of the least-squares line over all its stretches of one command, each stretch
  with an intercept of its own.
- The speed during a command is constant, then a line, then constant: an edge, found by least squares. After
  FORWARD from rest the line's slope is the acceleration, after STOP the deceleration; the constant after the
  line of FORWARD or RECALL is the cruising speed. An animal that reacts late continues for a while as the
  command before told it. The search for the edge starts where that ends: at the highest speed during STOP, at
  the lowest during FORWARD or RECALL.
- Drift turns the animal while it is told to run or still moves. Its rate is read during FORWARD; on RECALL
  the body turns home. In a turn, the drift is subtracted while the animal still moves.
- The model draws a response for each LEFT or RIGHT issued. A command counts as obeyed if the heading changes
  at the threshold or faster, to either side: drawn turn rates may be negative, and an obedient dog then turns
  the wrong way. A slower change counts as not obeyed.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from harness.log.channel import Array
from harness.trial.units import is_angular
from models.canine import Canine
from models.commands import Command
from models.kit.block import Block
from models.kit.units import DEG

MOVING_M_S = 1.0  # speed above which an animal is under way
AT_REST_M_S = 0.5  # speed below which a start is from rest
CRUISE_S = 1.0  # s at least at a steady speed for the cruising speed, and under way for the drift
COUNTED = 3  # responses counted for each side in a trial: a dog that turns too slowly is told again and again
EDGE_S = 30.0  # s from a command within which the search for an edge ends
ENDED_EARLY = f"ended before {CRUISE_S:g} s of steady speed"


@dataclass(frozen=True)
class MotionSource:
    """A component of the log whose speed and heading are read, with the limits of its accuracy.

    Attributes:
        component: its name in the log.
        rest: m/s, speed up to which the animal stands still, and loss of speed up to which it does not brake.
        moving: m/s, least speed from which braking is measured, and which a measured start must reach.
        shortest: s, least time of a turn; at least one tick.
        turned: rad/s, turn rate from which on a command counts as obeyed.
        exact: it shows each response, however slow the turn.
    """

    component: str
    rest: float
    moving: float
    shortest: float
    turned: float
    exact: bool = False


MOTION_SOURCES = {
    # the truth is exact, and a dog that does not obey does not turn at all
    "plant": MotionSource("plant", 1e-6, 1.0, 0.0, 0.1 * DEG, exact=True),
    # rest: V' of Table 4.2; moving: braking from a lower speed may end between two fixes; turned: 5 deg/s for
    # the 3 s of DELTHRESH2 are 15 deg, the least turn commanded (from h'' = 20 deg to 5)
    "estimator": MotionSource("estimator", 0.3, 2.0, 0.2, 5 * DEG),
}


@dataclass(frozen=True)
class Statistic:
    """A statistic of which each trial gives one value.

    Attributes:
        key: the name of the canine's parameter; its deviation is `<key>_deviation`.
        label: in tables and pictures.
        needs: the commands that a trial must have for it.
        published: mean, standard deviation and n of Table 5.1.
    """

    key: str
    label: str
    needs: str
    published: tuple[float, float, int] | None = None

    @property
    def unit(self) -> str:
        """The unit of results, with degrees for angles."""
        return Canine.variables()[self.key].unit.replace("rad", "deg")

    @property
    def scale(self) -> float:
        """The factor from SI to `unit`."""
        return 1 / DEG if is_angular(Canine.variables()[self.key]) else 1.0


STATISTICS = (  # published: Table 5.1; the deceleration is positive, as in the model
    Statistic("cruise_speed", "velocity", "FORWARD or RECALL", (4.86, 1.49, 66)),
    Statistic("speeding_up", "acceleration", "FORWARD", (1.78, 0.67, 73)),
    Statistic("slowing_down", "deceleration", "STOP of a moving animal", (2.72, 1.31, 40)),
    Statistic("right_turn_rate", "right turn", "RIGHT", (57.92, 37.66, 26)),
    Statistic("left_turn_rate", "left turn", "LEFT", (-77.67, 41.13, 26)),
    Statistic("drift", "heading drift", "FORWARD", (2.62, 1.62, 35)),
    Statistic("start_heading", "start heading", "command"),
)
RATES = {"left_success": (0.64, 45), "right_success": (0.60, 35)}  # Table 5.1: rate, n
TURNS = {
    Command.LEFT: ("left_turn_rate", "left_success"),
    Command.RIGHT: ("right_turn_rate", "right_success"),
}


@dataclass(frozen=True, eq=False)
class Track:
    """The commands and the motion of one trial; arrays are (ticks,), SI.

    Attributes:
        name: of the log.
        command: in force from its tick to the next.
        heading: clockwise from north, wrapped or not.
        usable: the motion is known on the tick.
        fresh: the speed is new on the tick, such as at a fix.
        aim: bearing of the first waypoint from the start; None if the log has no waypoint.
        seed: of the plant; None if it has none.
        plant: the block or FMU that moved; "" if the log has none.
        file: digest of the FMU in the plant's place; "" for our own.
        parameters: of the plant, those of the trial apart, by name, as the log writes them.
        success: did the controller say so at the end?
        way_home: m, straight from where the log ends to where the animal is home; 0 if that is not known.
        path: of the log.
    """

    name: str
    time: Array
    command: Array
    speed: Array
    heading: Array
    usable: npt.NDArray[np.bool_]
    fresh: npt.NDArray[np.bool_]
    aim: float | None = None
    seed: float | None = None
    plant: str = ""
    file: str = ""
    parameters: Mapping[str, str] = field(default_factory=dict)
    success: bool = False
    way_home: float = 0.0
    path: Path = Path()

    @property
    def step(self) -> float:
        """Sample time [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def held(self) -> Array:
        """The last fresh speed that is known at each tick, (ticks,); zero before the first."""
        known = self.fresh & self.usable
        latest = np.maximum.accumulate(np.where(known, np.arange(len(self.speed)), -1))
        return np.where(latest >= 0, self.speed[latest], 0.0)


@dataclass
class Trial:
    """The statistics of one trial.

    Attributes:
        name: of the log.
        values: by the statistic's key, SI.
        responses: whether each command issued was obeyed, by the success rate's name.
        left_out: number of stretches that could not be used, by the statistic's key and the reason.
        heard: of each response, the row of its command, the command, and was it obeyed? Those that do not
            count are among them only if the motion is exact.
        delays: of each FORWARD from rest, the row of its command and the time until the animal sets out [s].
        cruised: the rows from which the cruising speed is read.
    """

    name: str
    values: dict[str, float] = field(default_factory=dict)
    responses: dict[str, list[bool]] = field(default_factory=lambda: {name: [] for name in RATES})
    left_out: Counter[tuple[str, str]] = field(default_factory=Counter)
    heard: list[tuple[int, Command, bool]] = field(default_factory=list)
    delays: list[tuple[int, float]] = field(default_factory=list)
    cruised: list[int] = field(default_factory=list)


def stretches(command: Array) -> list[tuple[int, int, int]]:
    """Command, first row and last row of each stretch of one command.

    The last row is the first of the next command, since a command shows in the motion one tick later.
    """
    starts = [0, *(np.flatnonzero(np.diff(command)) + 1).tolist()]
    ends = [*starts[1:], len(command) - 1]
    return [(int(command[first]), first, last) for first, last in zip(starts, ends, strict=True)]


def slope(lines: Sequence[tuple[Array, Array]]) -> float:
    """The least-squares slope common to lines (abscissae, ordinates) that have each an own intercept."""
    products = [((t - t.mean()) @ (y - y.mean()), (t - t.mean()) @ (t - t.mean())) for t, y in lines]
    return float(sum(xy for xy, _ in products) / sum(xx for _, xx in products))


def edge(x: Array, y: Array, least: int, most: int) -> tuple[int, int]:
    """First and last row of the line in a curve that is constant, then a line, then constant: least squares.

    Args:
        x, y: (n,), n > least.
        least: number of the line's intervals at least.
        most: row by which the line ends at the latest, or `least` if that is larger.
    """
    n, x, y = len(y), x - x.mean(), y - y.mean()  # centred, so that the sums of squares keep their digits
    one, sx, sy, sxx, sxy, syy = (
        np.concatenate([[0.0], np.cumsum(p)]) for p in (np.ones(n), x, y, x * x, x * y, y * y)
    )

    def flat(count: Any, total: Any, square: Any) -> Any:  # arrays, or numbers and arrays
        return square - total**2 / np.maximum(count, 1)

    end = min(n, max(most, least) + 1)
    first, stop = np.arange(end - least)[:, None], np.arange(least + 1, end + 1)[None, :]
    count, x1, y1, x2, xy, y2 = (s[stop] - s[first] for s in (one, sx, sy, sxx, sxy, syy))
    with np.errstate(divide="ignore", invalid="ignore"):  # lines of one row or fewer, which are masked below
        line = y2 - y1**2 / count - (xy - x1 * y1 / count) ** 2 / (x2 - x1**2 / count)
    before = flat(first, sy[first], syy[first])
    after = flat(n - stop, sy[n] - sy[stop], syy[n] - syy[stop])
    error = np.where(stop - first > least, before + line + after, np.inf)
    i, j = np.unravel_index(int(np.argmin(error)), error.shape)
    return int(first[i, 0]), int(stop[0, j]) - 1


def ramp(time: Array, speed: Array, *, rising: bool) -> tuple[int, int]:
    """First and last row of the line along which an animal speeds up or slows down, however late it reacts.

    If the speed first changes the other way, the rows before its extreme are left out. The extreme is sought
    up to the line's end only: a stray fix at the new speed does not count.

    Args:
        time, speed: (n,), n > 1; s, m/s.
        rising: it speeds up.
    """
    most = round(EDGE_S / float(np.median(np.diff(time))))
    begin, end = edge(time, speed, 1, most)
    extreme = int(np.argmin(speed[: end + 1] if rising else -speed[: end + 1]))
    if 0 < extreme < len(speed) - 1:
        begin, end = (extreme + row for row in edge(time[extreme:], speed[extreme:], 1, most))
    return begin, end


def measure(track: Track, source: MotionSource) -> Trial:
    """Read the statistics of one trial."""
    trial = Trial(track.name)
    known = []
    for command, first, last in stretches(track.command):
        if command in set(Command) and command != Command.NONE and last > first:
            if track.usable[first : last + 1].all():
                # read finer logs at the models' tick: the cost of the edges grows with the square of the rows
                stride = min(last - first, max(1, round(Block.sample_time / track.step)))
                known.append((Command(command), slice(first, last + 1, stride)))
            else:
                for key in _read_from(Command(command)):
                    trial.left_out[key, "the motion is not known throughout"] += 1
    _speed(track, known, source, trial)
    _drift(track, known, trial)
    _turn(track, known, source, trial)
    begun = np.flatnonzero((track.command != Command.NONE) & track.usable)
    if track.aim is None:
        trial.left_out["start_heading", "the log has no waypoint"] += 1
    elif len(begun):
        trial.values["start_heading"] = math.remainder(
            float(track.heading[begun[0]]) - track.aim, 2 * math.pi
        )
    return trial


def _read_from(command: Command) -> tuple[str, ...]:
    """The statistics that a stretch of a command gives."""
    return {
        Command.FORWARD: ("cruise_speed", "speeding_up", "drift"),
        Command.RECALL: ("cruise_speed",),
        Command.STOP: ("slowing_down",),
    }.get(command) or TURNS[command][:1]


def _speed(track: Track, known: Sequence[tuple[Command, slice]], source: MotionSource, trial: Trial) -> None:
    """Read cruising speed, acceleration and deceleration."""
    lines: dict[str, list[tuple[Array, Array]]] = {"speeding_up": [], "slowing_down": []}
    steady = []
    for command, rows in known:
        running = command in (Command.FORWARD, Command.RECALL)
        fresh = track.fresh[rows]
        time, speed = track.time[rows][fresh], track.speed[rows][fresh]
        if len(speed) < 2 or not (running or (command == Command.STOP and speed[0] > AT_REST_M_S)):
            continue  # it was at rest when told to stop, or two fresh speeds are missing
        begin, end = ramp(time, speed, rising=running)
        line = time[begin : end + 1], speed[begin : end + 1]
        if not running:
            if speed[: end + 1].max() < source.moving:
                trial.left_out["slowing_down", f"from less than {source.moving:g} m/s"] += 1
            elif speed[begin] - speed[end] <= source.rest:
                trial.left_out["slowing_down", "ended before it slowed down"] += 1
            else:
                lines["slowing_down"].append(line)
            continue
        reached = speed[end:].mean()
        if reached < MOVING_M_S:
            trial.left_out["cruise_speed", f"came to less than {MOVING_M_S:g} m/s"] += 1
        elif time[-1] - time[end] > CRUISE_S - 1e-9:
            steady.append(speed[end + 1 :])
            trial.cruised += np.arange(len(track.time))[rows][fresh][end + 1 :].tolist()
        else:
            trial.left_out["cruise_speed", ENDED_EARLY] += 1
        if command == Command.RECALL:
            continue
        if speed[0] < AT_REST_M_S and reached >= source.moving:
            lines["speeding_up"].append(line)
            if (pace := slope([line])) > 0:
                began = line[0].mean() - (line[1].mean() - speed[0]) / pace  # where the line starts
                trial.delays.append((rows.start, float(began - time[0])))
        else:
            reason = (
                "not from rest" if speed[0] >= AT_REST_M_S else f"came to less than {source.moving:g} m/s"
            )
            trial.left_out["speeding_up", reason] += 1
    if steady:
        trial.values["cruise_speed"] = float(np.concatenate(steady).mean())
    for key, sign in (("speeding_up", 1), ("slowing_down", -1)):
        if lines[key]:
            trial.values[key] = sign * slope(lines[key])


def _drift(track: Track, known: Sequence[tuple[Command, slice]], trial: Trial) -> None:
    """Read the drift: the rate of the heading during FORWARD, from where the animal is under way."""
    lines = []
    for command, rows in known:
        if command != Command.FORWARD:
            continue
        time, heading = track.time[rows], np.unwrap(track.heading[rows])
        moving = np.flatnonzero(track.held[rows] > MOVING_M_S)
        if len(moving) and time[-1] - time[moving[0]] > CRUISE_S - 1e-9:
            lines.append((time[moving[0] :], heading[moving[0] :]))
        else:
            trial.left_out["drift", f"under way for less than {CRUISE_S:g} s"] += 1
    if lines:
        trial.values["drift"] = slope(lines)


def _turn(track: Track, known: Sequence[tuple[Command, slice]], source: MotionSource, trial: Trial) -> None:
    """Read the responses to LEFT and RIGHT, and the turn rates of those obeyed.

    The drift must have been read before.
    """
    lines: dict[str, list[tuple[Array, Array]]] = {key: [] for key, _ in TURNS.values()}
    drift = trial.values.get("drift", 0.0)
    for command, rows in known:
        if command not in TURNS:
            continue
        key, rate = TURNS[command]
        time = track.time[rows]
        step = time[1] - time[0]
        least = max(1, math.ceil(source.shortest / step - 1e-9))
        if len(time) <= least:
            trial.left_out[key, "too short"] += 1
            continue
        moving = track.held[rows][:-1] > source.rest
        drifted = drift * np.concatenate([[0.0], np.cumsum(np.diff(time) * moving)])
        heading = np.unwrap(track.heading[rows]) - drifted
        obeyed = abs(slope([(time, heading)])) >= source.turned
        counts = len(trial.responses[rate]) < COUNTED
        if counts or source.exact:
            trial.heard.append((rows.start, command, bool(obeyed)))
        if counts:
            trial.responses[rate].append(obeyed)
        else:
            trial.left_out[rate, f"after the first {COUNTED} of a trial"] += 1
        if obeyed:
            begin, end = edge(time, heading, least, round(EDGE_S / step))
            lines[key].append((time[begin : end + 1], heading[begin : end + 1]))
    for key, turns in lines.items():
        if turns:
            trial.values[key] = slope(turns)
