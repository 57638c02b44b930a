"""The Canine Trial Simulator in numpy: arrays over the trials, masks for the modes.

It is a peer of the batch runner, like `cts_by_hand.c`, which `by_hand` compiles. Both take the same settings
and omit the same things (the head of the C lists them).
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.toolchains.compiler import FLAGS, build_library
from models.canine import Canine
from models.cmec import Cmec
from models.commands import Status
from models.modes import Anomaly

TICK = Cmec.sample_time  # s
LAST_TICK = 7500  # 300 s
PARAMETERS = (  # in the order of C's struct
    "capture_radius", "stopped_speed", "moving_deviation", "stop_deviation", "turn_end_deviation",
    "stop_hold", "turn_timeout", "forward_timeout", "forward_distance", "dead_time",
    "max_turns", "limit_stop_deviation", "count_reissue", "reset_turns",
    "start_heading", "start_heading_deviation", "drift", "drift_deviation",
    "right_turn_rate", "right_turn_rate_deviation", "left_turn_rate", "left_turn_rate_deviation",
    "right_success", "left_success", "cruise_speed", "speeding_up", "slowing_down",
    "recall_turn_rate",
)  # fmt: skip
ANOMALIES = 5  # the first ones of Anomaly, without NONE
OUTCOME = np.dtype(
    [
        ("status", "i4"),
        ("ticks", "i4"),
        ("directional_commands", "i4"),
        ("anomalies", "i4", ANOMALIES),
        ("distance", "f8"),
        ("deviation", "f8"),
    ]
)
EVERY_EQUATION = "-DEVERY_EQUATION"
FAST = ("-O3", "-march=native", "-fno-math-errno")

Setting = dict[str, float]
Route = Sequence[tuple[float, float]]
Outcomes = npt.NDArray[Any]
Array = npt.NDArray[Any]


def setting(**changes: float) -> Setting:
    """The declared parameters of both blocks (SI), with some changes."""
    declared = {**Cmec.variables(), **Canine.variables()}  # `drift` is the animal's, not the aim's
    assert changes.keys() <= set(PARAMETERS), changes
    return {name: float(changes.get(name, declared[name].start[0])) for name in PARAMETERS}


class Compiled:
    """A simulator in C, called as `cts_by_hand` is."""

    def __init__(self, library: Path, name: str) -> None:
        self._run = getattr(ctypes.CDLL(str(library)), name)
        self._run.restype = None

    def run(
        self, values: Setting, route: Route, trials: int, seed: int, last_tick: int = LAST_TICK
    ) -> Outcomes:
        """(trials,) outcomes of trials along waypoints (north, east in m)."""
        outcomes = np.zeros(trials, dtype=OUTCOME)
        parameters = np.array([values[name] for name in PARAMETERS])
        points = np.array(route, dtype=np.float64)
        self._run(
            ctypes.c_void_p(parameters.ctypes.data),
            ctypes.c_int32(len(points)),
            ctypes.c_void_p(points.ctypes.data),
            ctypes.c_int32(last_tick),
            ctypes.c_int64(trials),
            ctypes.c_uint64(seed),
            ctypes.c_void_p(outcomes.ctypes.data),
        )
        return outcomes


def by_hand(folder: Path, flags: Sequence[str] = FAST) -> Compiled:
    """`cts_by_hand.c`, compiled into a folder.

    Raises:
        CompileError: with the compiler's own words.
    """
    library = build_library(
        Path(__file__).parent,
        ["cts_by_hand.c"],
        folder / "cts_by_hand.so",
        what="cts_by_hand.c",
        flags=(*FLAGS, *flags, "-lm"),
    )
    return Compiled(library, "cts_by_hand")


# the controller's modes, plain numbers because numpy is slow with enumerations
FORWARD, STOP_TO_TURN, LEFT, RIGHT, DEAD, STOP_AT_WAYPOINT, RECALL, SUCCESS, FAILED = range(9)
EVENTS = (  # what the controller decides on a tick, of several the first, and the mode that follows
    ("waypoint", STOP_AT_WAYPOINT),
    ("home", SUCCESS),
    ("off course", STOP_TO_TURN),
    ("stuck", DEAD),
    ("turned", FORWARD),
    ("wrong way", DEAD),
    ("turn timeout", DEAD),
    ("go on", FORWARD),
    ("do not go on", STOP_TO_TURN),
    ("all reached", RECALL),
    ("ahead", FORWARD),
    ("too many", FAILED),
    ("to the right", RIGHT),
    ("to the left", LEFT),
)
NUMBERS = [np.int8(i) for i in range(len(EVENTS))]
NOTHING = np.int8(len(EVENTS))
NEXT = np.array([mode for _, mode in EVENTS], dtype=np.int8)
WAYPOINT, STUCK, WRONG_WAY, TURN_TIMEOUT, TOO_MANY = (
    [name for name, _ in EVENTS].index(name)
    for name in ("waypoint", "stuck", "wrong way", "turn timeout", "too many")
)


def wrap(angle: Array) -> Array:
    """The same angle in (-pi, pi] [rad]."""
    return angle - 2 * np.pi * np.ceil(angle / (2 * np.pi) - 0.5)


def lasting(time: float) -> int:
    """The first tick of a mode on which it has lasted so many seconds, less a tenth of a tick."""
    return int(np.floor(time / TICK - 0.1)) + 1


class Trials:
    """Many trials of one setting, stepped together; trials that end are dropped."""

    def __init__(self, values: Setting, route: Route, trials: int, seed: int) -> None:
        self.p = p = values
        self.route = np.array([*route, (0.0, 0.0)])  # home comes last
        self.random = np.random.default_rng(seed)
        self.outcomes = np.zeros(trials, dtype=OUTCOME)
        heading, drift, right, left = self.random.standard_normal((4, trials))
        self.trial = np.arange(trials)  # which one, among the outcomes
        self.heading = wrap(p["start_heading"] + p["start_heading_deviation"] * heading)
        self.drift = p["drift"] + p["drift_deviation"] * drift
        self.right_rate = p["right_turn_rate"] + p["right_turn_rate_deviation"] * right
        self.left_rate = p["left_turn_rate"] + p["left_turn_rate_deviation"] * left
        self.north, self.east, self.speed = np.zeros((3, trials))
        self.issue_north, self.issue_east = np.zeros((2, trials))
        self.target_north, self.target_east = np.tile(self.route[0][:, None], trials)
        self.ticks, self.reached, self.turns, self.commands = np.zeros((4, trials), dtype=np.int32)
        self.mode = np.full(trials, FORWARD, dtype=np.int8)
        self.planned = self.mode.copy()
        self.obeys, self.uncounted = np.zeros((2, trials), dtype=bool)
        self.anomalies = np.zeros((trials, ANOMALIES), dtype=np.int32)
        self.arrays = [name for name, value in vars(self).items() if len(np.shape(value)) and name != "route"]
        self.arrays.remove("outcomes")

    def run(self, last_tick: int) -> Outcomes:
        """(trials,) outcomes."""
        for tick in range(last_tick + 1):
            self.control()
            self.drop(tick, (self.mode >= SUCCESS) | (tick == last_tick))
            if not len(self.trial):
                break
            self.move()
        return self.outcomes

    def drop(self, tick: int, ended: Array) -> None:
        """Store the outcomes of trials that ended, and drop them."""
        if not ended.any():
            return
        mode = self.mode[ended]
        result = np.zeros(len(mode), dtype=OUTCOME)
        result["status"] = np.select(
            [mode == SUCCESS, mode == FAILED], [Status.SUCCESS, Status.FAILED], Status.RUNNING
        )
        result["ticks"] = tick
        result["directional_commands"] = self.commands[ended]
        result["anomalies"] = self.anomalies[ended]
        self.outcomes[self.trial[ended]] = result
        for name in self.arrays:
            setattr(self, name, getattr(self, name)[~ended])

    def control(self) -> None:
        """The controller: Figure 4.2, Table 4.3."""
        p, mode, ticks = self.p, self.mode, self.ticks
        at_rest = (ticks >= lasting(p["stop_hold"])) & (self.speed < p["stopped_speed"])
        self.aim_at_next(np.flatnonzero((mode == STOP_AT_WAYPOINT) & at_rest))
        to_north, to_east = self.target_north - self.north, self.target_east - self.east
        won = to_north**2 + to_east**2 <= p["capture_radius"] ** 2
        deviation = wrap(np.arctan2(to_east, to_north) - self.heading)
        off = np.abs(deviation)
        limit = p["stop_deviation"]
        if p["limit_stop_deviation"]:
            limit = min(limit, p["moving_deviation"])

        forward, left, right = mode == FORWARD, mode == LEFT, mode == RIGHT
        stopping, recalled = mode == STOP_AT_WAYPOINT, mode == RECALL
        over = (mode == DEAD) & (ticks >= lasting(p["dead_time"]))
        go_on = over & (self.planned == FORWARD)
        turning = left | right
        moved = (self.north - self.issue_north) ** 2 + (self.east - self.issue_east) ** 2
        stuck = (ticks == lasting(p["forward_timeout"])) & (moved < p["forward_distance"] ** 2)
        arrived = stopping & at_rest
        choose = ((mode == STOP_TO_TURN) & at_rest) | over | arrived
        side = np.where(deviation >= 0, RIGHT, LEFT).astype(np.int8)
        counts = ~(over & self.uncounted & (self.planned == side))
        event = np.select(
            [
                won & ~stopping & ~recalled,
                won & recalled,
                forward & (off >= p["moving_deviation"]),
                forward & stuck,
                turning & (off < p["turn_end_deviation"]),
                (off >= limit) & ((right & (deviation < 0)) | (left & (deviation > 0))),
                turning & (ticks >= lasting(p["turn_timeout"])),
                go_on & (off < p["moving_deviation"]),
                go_on,
                arrived & (self.reached >= len(self.route) - 1),
                choose & (off < limit),
                choose & counts & (self.turns >= p["max_turns"]),
                choose & (deviation >= 0),
                choose,
            ],
            NUMBERS,
            NOTHING,
        )
        changed = np.flatnonzero(event != NOTHING)
        self.ticks = ticks + 1
        if len(changed):
            self.change(changed, event[changed], side[changed], counts[changed])

    def aim_at_next(self, i: Array) -> None:
        """The dogs i have stopped at a waypoint."""
        self.reached[i] += 1
        self.target_north[i], self.target_east[i] = self.route[self.reached[i]].T
        if self.p["reset_turns"]:
            self.turns[i] = 0

    def change(self, i: Array, event: Array, side: Array, counts: Array) -> None:
        """Carry out the decision for the dogs i."""
        before, after = self.mode[i], NEXT[event]
        self.mode[i] = after
        kept = (event == WAYPOINT) & (before == STOP_TO_TURN)  # the stop command is on already
        self.ticks[i] = np.where(kept, self.ticks[i], 1)
        ahead = i[after == FORWARD]
        self.issue_north[ahead], self.issue_east[ahead] = self.north[ahead], self.east[ahead]

        unplanned = (before == DEAD) & (after != self.planned[i]) & (event != TOO_MANY)
        for anomaly, reported in (
            (Anomaly.FORWARD_FAILURE, event == STUCK),
            (Anomaly.TURN_FAILURE, event == TURN_TIMEOUT),
            (Anomaly.DIRECTION_SWITCH, event == WRONG_WAY),
            (Anomaly.NO_COMMAND, unplanned),
            (Anomaly.TRIAL_FAILURE, event == TOO_MANY),
        ):
            self.anomalies[i[reported], anomaly - 1] += 1

        dead = after == DEAD
        opposite = np.where(before == RIGHT, LEFT, RIGHT)
        planned = np.where(event == WRONG_WAY, opposite, before)
        self.planned[i[dead]] = planned[dead]
        self.uncounted[i[dead]] = (event[dead] == TURN_TIMEOUT) & (not self.p["count_reissue"])

        issued = (after == LEFT) | (after == RIGHT)
        turned = i[issued]
        self.commands[turned] += 1
        self.turns[turned] += counts[issued]
        chance = np.where(side[issued] == RIGHT, self.p["right_success"], self.p["left_success"])
        self.obeys[turned] = 1 - self.random.random(len(turned)) <= chance  # eq. 5.3, 5.4

    def move(self) -> None:
        """The dogs: they brake on every command except FORWARD and RECALL, and drift while they move."""
        p, mode, past = self.p, self.mode, self.speed
        homing = mode == RECALL
        running = (mode == FORWARD) | homing
        acceleration = np.where(running, p["speeding_up"], -p["slowing_down"])
        self.speed = np.clip(past + acceleration * TICK, 0, p["cruise_speed"])
        turn_rate = np.where(running | (past > 0), self.drift, 0)
        turn_rate += np.where((mode == RIGHT) & self.obeys, self.right_rate, 0)
        turn_rate += np.where((mode == LEFT) & self.obeys, self.left_rate, 0)
        self.heading = np.where(homing, self.heading, wrap(self.heading + turn_rate * TICK))
        course = np.where(homing, np.arctan2(-self.east, -self.north), self.heading)
        step = 0.5 * (past + self.speed) * TICK
        self.north = self.north + step * np.cos(course)
        self.east = self.east + step * np.sin(course)


def simulate(values: Setting, route: Route, trials: int, seed: int, last_tick: int = LAST_TICK) -> Outcomes:
    """(trials,) outcomes of trials along waypoints (north, east in m)."""
    return Trials(values, route, trials, seed).run(last_tick)
