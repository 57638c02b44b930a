"""The canine maximum effort controller (CMEC): it leads the animal along waypoints by commands (4.1.4)."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum

from models.aiming_off import AimingOff
from models.commands import Command, Status
from models.fence import Fenced
from models.kit import casadi as ca
from models.kit.block import Row, moves, table, triggered
from models.kit.declaration import SX, Boolean, Input, Integer, Output, Parameter, State
from models.kit.geometry import (
    LONGEST,
    SHORT_COUNT_MAX,
    all_of,
    any_of,
    counted,
    element,
    none_of,
    one_of,
    where,
    wrap,
)
from models.kit.timing import TICK, lasted
from models.kit.tracing import Condition
from models.kit.units import DEG
from models.modes import BEFORE_RECALL, COMMANDS, ENDED, STATUSES, Anomaly, Mode

MAX_WAYPOINTS = 16
MOST_TURNS = 1000  # that MAXTURN can allow


class Cmec(AimingOff, Fenced):
    """Canine maximum effort controller: waypoints and the estimate to commands, tick by tick."""

    source = "Miller 2010, 4.1.4, eq. 4.1-4.4, Figure 4.2, Tables 4.1-4.3"
    precisions = ("double", "float")

    north = Input("m", "estimated position", min=-1e5, max=1e5)
    east = Input("m", "estimated position", min=-1e5, max=1e5)
    speed = Input("m/s", "estimated ground speed", min=-50, max=50)
    heading = Input("rad", "estimated heading, clockwise from north", min=-7, max=7)
    speed_sd = Input("m/s", "standard deviation of the speed", start=0, min=0)
    valid = Input(Boolean, "the estimate may be trusted", start=1)
    start = Input(Boolean, "the trial is on; latches the waypoints when it becomes true", start=0)
    override = Input(Command, "the operator's command, which beats the controller's", start=0)
    link_ok = Input(Boolean, "the radio link to the operator is up", start=1)

    command = Output(Command, "what the animal is told")
    mode = Output(Mode, "what the controller is doing")
    status = Output(Status, "how the trial stands")
    waypoint = Output(Integer, "number of waypoints reached", min=0, max=MAX_WAYPOINTS)
    distance = Output("m", "d: distance to the target")
    deviation = Output("rad", "h: orientation deviation from the target, right positive")
    directional_commands = Output(
        Integer, "LEFT and RIGHT commands issued in this trial, and one that the budget refused", min=0
    )
    anomaly = Output(Anomaly, "anomaly that is reported on this tick")

    # Table 4.2
    capture_radius = Parameter("m", "d': distance at which a waypoint counts as reached", start=7, min=0)
    stopped_speed = Parameter("m/s", "V': speed under which the animal counts as stopped", start=0.3, min=0)
    moving_deviation = Parameter(
        "rad", "h': orientation deviation at which the moving animal is stopped", start=49 * DEG, min=0, max=4
    )
    stop_deviation = Parameter(
        "rad",
        "h'': orientation deviation at which the stopped animal is turned",
        start=20 * DEG,
        min=0,
        max=4,
    )
    stop_hold = Parameter("s", "DELAYTHRESH: least time a stop command is on", start=1.5, min=0, max=LONGEST)
    turn_timeout = Parameter(
        "s", "DELTHRESH2: longest time a turn command is on", start=3, min=0, max=LONGEST
    )
    forward_timeout = Parameter(
        "s", "DELTHRESH3: time in which the animal must move", start=3, min=TICK, max=LONGEST
    )
    forward_distance = Parameter("m", "DISTTHRESH: how far it must move in that time", start=1, min=0)
    dead_time = Parameter("s", "HEADCOUNTTHRESH: length of a no-command period", start=1, min=0, max=LONGEST)
    max_turns = Parameter(
        Integer,
        "MAXTURN: directional commands allowed per waypoint (per trial without reset_turns)",
        start=2,
        min=0,
        max=MOST_TURNS,
    )
    rest_speed_sd = Parameter(
        "m/s", "an animal whose speed is less sure than this does not count as stopped", start=1e6, min=0
    )
    # choices that the text leaves open: the readings
    turn_end_deviation = Parameter(
        "rad", "orientation deviation below which a turn command ends", start=5 * DEG, min=0, max=4
    )
    limit_stop_deviation = Parameter(Boolean, "h'' in force is at most h'", start=1)
    count_reissue = Parameter(
        Boolean, "a turn issued again after TURN FAILURE counts towards MAXTURN", start=0
    )
    reset_turns = Parameter(Boolean, "a waypoint reached resets the count towards MAXTURN", start=0)
    # the mission
    waypoint_count = Parameter(Integer, "waypoints in use", start=1, min=1, max=MAX_WAYPOINTS, latched=True)
    waypoint_north = Parameter("m", "waypoints", start=0, size=MAX_WAYPOINTS, min=-1e5, max=1e5, latched=True)
    waypoint_east = Parameter(
        "m",
        "waypoints",
        start=0,
        size=MAX_WAYPOINTS,
        min=-1e5,
        max=1e5,
        latched=True,
        beside="waypoint_north",
    )
    home_north = Parameter("m", "where the animal is recalled to", start=0, min=-1e5, max=1e5, latched=True)
    home_east = Parameter("m", "where the animal is recalled to", start=0, min=-1e5, max=1e5, latched=True)

    now = State(Mode, "mode")
    ticks = State(Integer, "ticks since the mode was entered", min=0, max=SHORT_COUNT_MAX)
    overruled = State(Anomaly, "what keeps the controller from deciding", usual=Anomaly.NONE)
    reached = State(Integer, "waypoints reached", min=0, max=MAX_WAYPOINTS)
    turns = State(Integer, "directional commands that count towards MAXTURN", min=0, max=MOST_TURNS)
    issued = State(Integer, "directional commands issued")
    planned = State(Command, "command to follow the no-command period")
    uncounted = State(Boolean, "the next turn does not count towards MAXTURN")
    issue_north = State("m", "where FORWARD, RIGHT or LEFT was issued")
    issue_east = State("m", "where FORWARD, RIGHT or LEFT was issued")
    target_north = State("m", "waypoint aimed at, or home")
    target_east = State("m", "waypoint aimed at, or home")
    count = State(Integer, "waypoints in use, latched", start=1, min=1, max=MAX_WAYPOINTS)
    route_north = State("m", "waypoints, latched", size=MAX_WAYPOINTS)
    route_east = State("m", "waypoints, latched", size=MAX_WAYPOINTS)
    base_north = State("m", "home, latched")
    base_east = State("m", "home, latched")
    anomalies = State(Integer, "how often each anomaly was reported", size=len(Anomaly) - 1)

    def watch(m) -> None:
        """The order of precedence: a lost link, the operator, bad input, an invalid estimate, the table."""
        good = m.within("north", "east", "speed", "heading", "override")
        cause = where(m.valid, Anomaly.NONE, Anomaly.INVALID_ESTIMATE)
        cause = where(good, cause, Anomaly.BAD_INPUT)
        cause = where(all_of(m.override > Command.NONE, m.within("override")), Anomaly.NONE, cause)
        cause = where(m.link_ok, cause, Anomaly.LOST_LINK)
        m.anomaly = where(cause != m.overruled, cause, Anomaly.NONE)
        m.overruled = cause
        m.ticks = counted(m.ticks, most=SHORT_COUNT_MAX)

    @triggered(
        lambda m: all_of(m.start, m.now == Mode.IDLE, ca.logic_not(m._blocked())),
        "in IDLE, `start` is on, not blocked",
        seldom=True,
    )
    @moves({Mode.IDLE: Mode.FORWARD})
    def begin(m) -> None:
        """Latch the mission; the first command is forward."""
        m._latch()
        m.anomalies = ca.SX.zeros(len(Anomaly) - 1)
        m._aim_anew()

    @triggered(
        lambda m: all_of(
            ca.logic_not(m.start),
            m._begun(),
            any_of(m.now != Mode.STOPPED, m._lasted(m.stop_hold)),  # every stop is held, this one too
        ),
        "not in IDLE, `start` is off; in STOPPED, once the stop has lasted `stop_hold`",
        seldom=True,
    )
    @moves({m: Mode.IDLE if m in ENDED else Mode.STOPPED for m in Mode if m is not Mode.IDLE})
    def end(m) -> None:
        """The start signal is withdrawn: a running trial is stopped, an ended one makes room for the next."""
        m.now = where(none_of(m.now, ENDED), Mode.STOPPED, Mode.IDLE)
        m.ticks = 0

    @triggered(
        lambda m: all_of(m._blocked(), m._begun(), one_of(m.now, BEFORE_RECALL)),
        "in a mode between IDLE and RECALL, blocked",
        seldom=True,
    )
    @moves(
        {m: m if m is Mode.STOP_AT_WAYPOINT else Mode.STOP_TO_TURN for m in BEFORE_RECALL - {Mode.IDLE}},
    )
    def interrupt(m) -> None:
        """Others lead the animal, or nobody does: afterwards the controller begins again from a stop."""
        m.now = where(m.now == Mode.STOP_AT_WAYPOINT, m.now, Mode.STOP_TO_TURN)
        m.ticks = 0

    @triggered(
        lambda m: all_of(m.now == Mode.STOP_AT_WAYPOINT, ca.logic_not(m._blocked()), m._at_rest()),
        "in STOP_AT_WAYPOINT, not blocked, at rest",
        seldom=True,
    )
    def advance(m) -> None:
        """Aim at the next waypoint once the animal has stopped at one, or home after the last (4.1.4.1)."""
        m.turns = where(m.reset_turns, 0, m.turns)
        m.reached = m.reached + 1
        last = m.reached >= m.count
        m.target_north = where(last, m.base_north, element(m.route_north, m.reached))
        m.target_east = where(last, m.base_east, element(m.route_east, m.reached))

    def aim(m) -> None:
        """Distance to the target and orientation deviation from it; 0 on bad input."""
        good = m.within("north", "east", "heading")
        north_difference = where(good, m.target_north - m.north, 0)  # eq. 4.1
        east_difference = where(good, m.target_east - m.east, 0)
        m.distance = ca.sqrt(north_difference**2 + east_difference**2)  # eq. 4.2
        desired = ca.atan2(east_difference, north_difference)  # eq. 4.3
        deviation = wrap(desired - m.heading)  # eq. 4.4
        m.deviation = where(good, deviation, 0)

    @triggered(lambda m: all_of(m._begun(), ca.logic_not(m._blocked())), "not in IDLE, not blocked")
    @table("now")
    def decide(m) -> Iterator[Row]:
        """The controller's table: Figure 4.2 and the anomalies of Table 4.3."""
        limit = where(
            all_of(m.limit_stop_deviation, m.moving_deviation < m.stop_deviation),
            m.moving_deviation,
            m.stop_deviation,
        )
        off, (astray, _) = ca.fabs(m.deviation), m._astray()
        won = Condition(m.distance <= m.capture_radius, "d <= d'")
        at_rest = Condition(m._at_rest(), "at rest")
        roughly_aligned = Condition(off < m.moving_deviation, "|h| < h'")
        # with b, an animal may be near the heading that is aimed at and yet beyond h'
        goes_on = Condition(any_of(m.offset == 0, roughly_aligned.holds), "b = 0 or |h| < h'")
        aligned = Condition(ca.fabs(astray) < limit, "|h - b| < h''") & goes_on
        begun = {"ticks": 0}

        due = Condition(ca.logic_not(m.early), "no braking point is ahead")
        yield Row(Mode.FORWARD, won & due, Mode.STOP_AT_WAYPOINT, begun | {"ran": m.ticks})
        misaligned = Condition(off >= m.moving_deviation, "|h| >= h'")
        obeys = Condition(m.ticks >= m.settling, "it has had time to obey")
        yield Row(Mode.FORWARD, misaligned & obeys, Mode.STOP_TO_TURN, begun | {"ran": m.ticks})
        yield Row(
            Mode.FORWARD,
            Condition(m._stuck(), "moved less than DISTTHRESH in DELTHRESH3"),
            Mode.DEAD,
            {"ticks": 0, "planned": Command.FORWARD},
            Anomaly.FORWARD_FAILURE,
        )

        yield Row(Mode.STOP_TO_TURN, won, Mode.STOP_AT_WAYPOINT)  # the stop command is on already
        yield Row(Mode.STOP_TO_TURN, at_rest & aligned, Mode.FORWARD, begun)
        yield from m._turn(Mode.STOP_TO_TURN, at_rest)

        remaining = astray - m.lead  # of the turn, once the animal obeys FORWARD
        for mode, same, sign, past in (
            (Mode.RIGHT, Command.RIGHT, "<", remaining < 0),
            (Mode.LEFT, Command.LEFT, ">", remaining > 0),
        ):
            opposite = Command.LEFT if same is Command.RIGHT else Command.RIGHT
            yield Row(mode, won, Mode.STOP_AT_WAYPOINT, begun)
            turned = Condition(
                ca.fabs(remaining) < m.turn_end_deviation, "|h - b - lead| < `turn_end_deviation`"
            )
            yield Row(mode, turned, Mode.FORWARD, begun)
            beyond = Condition(past, f"h - b - lead {sign} 0")
            short = Condition(astray >= 0 if mode is Mode.RIGHT else astray <= 0, f"not h - b {sign} 0")
            carried = (
                beyond & short & Condition(ca.fabs(remaining) < m.moving_deviation, "|h - b - lead| < h'")
            )
            yield Row(mode, carried, Mode.FORWARD, begun)
            yield Row(
                mode,
                beyond & Condition(ca.fabs(remaining) >= limit, "|h - b - lead| >= h''"),
                Mode.DEAD,
                {"ticks": 0, "planned": opposite, "uncounted": 0},
                Anomaly.DIRECTION_SWITCH,
            )
            yield Row(
                mode,
                Condition(m._lasted(m.turn_timeout), "the command has lasted DELTHRESH2"),
                Mode.DEAD,
                {"ticks": 0, "planned": same, "uncounted": ca.logic_not(m.count_reissue)},
                Anomaly.TURN_FAILURE,
            )

        # d and h are watched in the dead period too; what they ask for beats the command planned (4.1.4.3)
        over = Condition(m._lasted(m.dead_time), "HEADCOUNTTHRESH is over")
        go_on = Condition(m.planned == Command.FORWARD, "FORWARD is planned")
        changed = Anomaly.NO_COMMAND
        yield Row(Mode.DEAD, won, Mode.STOP_AT_WAYPOINT, begun, changed)
        yield Row(Mode.DEAD, over & go_on & roughly_aligned, Mode.FORWARD, begun)
        yield Row(Mode.DEAD, over & go_on, Mode.STOP_TO_TURN, begun, changed)
        yield Row(Mode.DEAD, over & aligned, Mode.FORWARD, begun, changed)
        reissued = m.planned == where(astray >= 0, Command.RIGHT, Command.LEFT)
        counts = Condition(ca.logic_not(all_of(m.uncounted, reissued)), "the turn counts")
        yield from m._turn(Mode.DEAD, over, counts)

        reached = Condition(m.reached >= m.count, "all waypoints are reached")
        yield Row(Mode.STOP_AT_WAYPOINT, at_rest & reached, Mode.RECALL, begun)
        yield Row(Mode.STOP_AT_WAYPOINT, at_rest & aligned, Mode.FORWARD, begun)
        yield from m._turn(Mode.STOP_AT_WAYPOINT, at_rest)

        yield Row(Mode.RECALL, won, Mode.SUCCESS, begun)
        yield Row(Mode.FAILURE_RECALL, won, Mode.FAILED, begun)

    @triggered(
        lambda m: all_of(m.ticks == 0, m._leads()),
        "FORWARD, RIGHT or LEFT has begun on this tick",
        seldom=True,
    )
    def issue(m) -> None:
        """Note where the animal is told to run or to turn, and count its turns."""
        m.issue_north, m.issue_east = m.north, m.east
        m.issued = m.issued + m._turns()
        m._begin_mode()

    def answer(m) -> None:
        """The mode's command, unless something beats it."""
        command = _choose(m.now, COMMANDS, Command.NONE)
        command = where(m.overruled > Anomaly.NONE, Command.STOP, command)
        overridden = all_of(m.override > Command.NONE, m.overruled == Anomaly.NONE)
        m.command = where(overridden, m.override, command)
        m.mode = m.now
        m.status = _choose(m.now, STATUSES, Status.RUNNING)
        m.waypoint = m.reached
        m.directional_commands = m.issued

    def _latch(m) -> None:
        """Take the mission as it is stated now, and begin with FORWARD towards its first waypoint."""
        m.route_north, m.route_east, m.count = m.waypoint_north, m.waypoint_east, m.waypoint_count
        m.base_north, m.base_east = m.home_north, m.home_east
        m.target_north, m.target_east = m.waypoint_north[0], m.waypoint_east[0]
        m.now, m.ticks = Mode.FORWARD, 0
        m.reached = m.turns = m.issued = 0

    def _begun(m) -> SX:
        """Is a trial on, or over?"""
        return none_of(m.now, {Mode.IDLE})

    def _blocked(m) -> SX:
        """Does a lost link, an operator, bad input or an invalid estimate keep the table from deciding?"""
        return any_of(m.overruled > Anomaly.NONE, m.override > Command.NONE)

    def _lasted(m, time: SX, ticks_ago: int = 0) -> SX:
        """Had the mode lasted the time [s] so many ticks ago?"""
        return lasted(m.ticks - ticks_ago, time, m.sample_time)

    def _at_rest(m) -> SX:
        """Has the stop command been on long enough, and has the animal stopped?"""
        return all_of(
            m._lasted(m.stop_hold),
            ca.fabs(m.speed) < m.stopped_speed,
            m.speed_sd <= m.rest_speed_sd,
        )

    def _stuck(m) -> SX:
        """Has the animal moved too little since FORWARD was issued, on the tick on which its time is up?"""
        moved = (m.north - m.issue_north) ** 2 + (m.east - m.issue_east) ** 2
        due = all_of(m._lasted(m.forward_timeout), ca.logic_not(m._lasted(m.forward_timeout, ticks_ago=1)))
        return all_of(due, moved < m.forward_distance**2)

    def _turn(m, mode: Mode, when: Condition, counts: Condition | None = None) -> Iterator[Row]:
        """Issue the directional command that is asked for; one more than MAXTURN fails the trial."""
        astray, name = m._astray()
        failure = {"ticks": 0, "target_north": m.base_north, "target_east": m.base_east}
        too_many = Condition(m.turns >= m.max_turns, "MAXTURN turns were counted")
        counting = when & counts if counts else when
        yield Row(mode, counting & too_many, Mode.FAILURE_RECALL, failure, Anomaly.TRIAL_FAILURE)
        for next, command, side in (
            (Mode.RIGHT, Command.RIGHT, Condition(astray >= 0, f"{name} >= 0")),
            (Mode.LEFT, Command.LEFT, Condition(astray < 0, f"{name} < 0")),
        ):
            issue = {"ticks": 0, "turns": m.turns + (counts.holds if counts else 1)}
            if mode is Mode.DEAD:
                planned = Condition(m.planned == command, f"{command.name} is planned")
                yield Row(mode, when & side & planned, next, issue)
                yield Row(mode, when & side, next, issue, Anomaly.NO_COMMAND)
            else:
                yield Row(mode, when & side, next, issue)


def _choose(key: SX, table: dict[Mode, Command] | dict[Mode, Status], other: IntEnum) -> SX:
    """The table's value for the key, or `other`."""
    value: SX = ca.SX(other)
    for k, v in table.items():
        value = where(key == k, v, value)
    return value
