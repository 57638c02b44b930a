"""The base of the controllers beside the CMEC: the same role, precedence and mission, without limits.

What it shares with the CMEC is the CMEC's own: a stop for a lost link, bad input or an invalid estimate, the
operator before the last two, a start and an end, the aim. The limits of models/safety.py are the CMEC's
alone: these controllers lead simulated animals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from models.cmec import MOST_TURNS, Cmec
from models.kit import casadi as ca
from models.kit.block import Block, Row, moves, triggered
from models.kit.declaration import SX, Integer, Parameter
from models.kit.geometry import all_of
from models.kit.tracing import Condition
from models.modes import Anomaly, Mode


class Leader(Block):
    """Base of a controller that leads along waypoints: the role's variables, and what beats its table."""

    precisions = ("double", "float")

    north, east = Cmec.north, Cmec.east
    speed, heading, speed_sd, valid = Cmec.speed, Cmec.heading, Cmec.speed_sd, Cmec.valid
    start, override, link_ok = Cmec.start, Cmec.override, Cmec.link_ok

    command, mode, status, waypoint = Cmec.command, Cmec.mode, Cmec.status, Cmec.waypoint
    distance, deviation = Cmec.distance, Cmec.deviation
    directional_commands, anomaly = Cmec.directional_commands, Cmec.anomaly

    capture_radius, stop_hold = Cmec.capture_radius, Cmec.stop_hold
    stopped_speed, rest_speed_sd = Cmec.stopped_speed, Cmec.rest_speed_sd
    max_turns = Parameter(
        Integer,
        "MAXTURN: directional commands allowed per waypoint; one more fails the trial",
        start=2,
        min=0,
        max=MOST_TURNS,
    )
    waypoint_count, waypoint_north, waypoint_east = (
        Cmec.waypoint_count,
        Cmec.waypoint_north,
        Cmec.waypoint_east,
    )
    home_north, home_east = Cmec.home_north, Cmec.home_east

    now, ticks, overruled = Cmec.now, Cmec.ticks, Cmec.overruled
    reached, turns, issued, count = Cmec.reached, Cmec.turns, Cmec.issued, Cmec.count
    target_north, target_east = Cmec.target_north, Cmec.target_east
    route_north, route_east = Cmec.route_north, Cmec.route_east
    base_north, base_east = Cmec.base_north, Cmec.base_east
    anomalies = Cmec.anomalies
    reset_turns = True  # what Cmec.advance asks: MAXTURN is per waypoint (4.1.4.2)

    watch = Cmec.watch

    @triggered(
        lambda m: all_of(m.start, m.now == Mode.IDLE, m._free()),
        "in IDLE, `start` is on, not blocked",
        seldom=True,
    )
    @moves({Mode.IDLE: Mode.FORWARD})
    def begin(m) -> None:
        """Latch the mission; the first command is forward."""
        m._latch()
        m.anomalies = ca.SX.zeros(len(Anomaly) - 1)

    end, interrupt, advance, aim = Cmec.end, Cmec.interrupt, Cmec.advance, Cmec.aim

    @triggered(
        lambda m: all_of(m.ticks == 0, m._turns()), "RIGHT or LEFT has begun on this tick", seldom=True
    )
    def issue(m) -> None:
        """Count a turn that is told."""
        m.issued = m.issued + 1

    answer, report = Cmec.answer, Cmec.report

    _latch: Callable[..., None] = Cmec._latch
    _begun: Callable[..., SX] = Cmec._begun
    _blocked: Callable[..., SX] = Cmec._blocked
    _lasted: Callable[..., SX] = Cmec._lasted
    _at_rest: Callable[..., SX] = Cmec._at_rest
    _turn: Callable[..., Iterator[Row]] = Cmec._turn
    _turns: Callable[..., SX] = Cmec._turns

    def _astray(m) -> tuple[SX, str]:
        """The deviation from the heading that is aimed at, the target's [rad], and its name."""
        return m.deviation, "h"

    def _free(m) -> SX:
        """May the table decide?"""
        return ca.logic_not(m._blocked())

    def _won(m) -> Condition:
        """Has the animal come to its target?"""
        return Condition(m.distance <= m.capture_radius, "d <= d'")

    def _stops(m, aligned: Condition) -> Iterator[Row]:
        """The rows behind a stop: wait until the animal is at rest, then go home, go on, or turn."""
        at_rest = Condition(m._at_rest(), "at rest")
        reached = Condition(m.reached >= m.count, "all waypoints are reached")
        yield Row(Mode.STOP_TO_TURN, m._won(), Mode.STOP_AT_WAYPOINT)  # the stop command is on already
        yield Row(Mode.STOP_AT_WAYPOINT, at_rest & reached, Mode.RECALL, {"ticks": 0})
        for mode in (Mode.STOP_TO_TURN, Mode.STOP_AT_WAYPOINT):
            yield Row(mode, at_rest & aligned, Mode.FORWARD, {"ticks": 0})
            yield from m._turn(mode, at_rest)

    def _recalls(m) -> Iterator[Row]:
        """The rows of the ways home."""
        yield Row(Mode.RECALL, m._won(), Mode.SUCCESS, {"ticks": 0})
        yield Row(Mode.FAILURE_RECALL, m._won(), Mode.FAILED, {"ticks": 0})
