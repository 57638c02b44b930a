"""A proportional controller of the heading by on and off: the time of a turn grows with the deviation."""

from __future__ import annotations

from collections.abc import Iterator

from models.cmec import MOST_TURNS
from models.kit import casadi as ca
from models.kit.block import Row, before, table, triggered
from models.kit.declaration import Integer, Parameter, State
from models.kit.geometry import LONGEST, all_of, at_most
from models.kit.timing import TICK
from models.kit.tracing import Condition
from models.kit.units import DEG
from models.leader import Leader
from models.modes import Mode


class Proportional(Leader):
    """Proportional control of the heading: LEFT or RIGHT for a time that grows with the deviation.

    The text names control with a middle ground (4.1.2) and has none. A command is on or off, so the turn is
    proportional by its time: t = `longest_turn` * |h| / `proportional_band`, measured when the turn begins.
    A body that turns at the rate r keeps 1 - r * `longest_turn` / `proportional_band` of a deviation in the
    band: it shrinks while that is between -1 and 1. Assumed: turns are told while the animal goes, with
    FORWARD for `forward_time` between them; it is stopped at waypoints alone; a turn shorter than
    `least_turn` is not told; MAXTURN is out of reach, since turns are many. Rule 2 of SAFETY.md forbids
    turns of a walking animal: this one leads robots, persons and simulated dogs.
    """

    source = "ours; the aim: Miller 2010, eq. 4.1-4.4"

    max_turns = Parameter(
        Integer,
        "MAXTURN: directional commands allowed per waypoint; one more fails the trial",
        start=MOST_TURNS,
        min=0,
        max=MOST_TURNS,
    )
    proportional_band = Parameter(
        "rad", "orientation deviation from which a turn is the longest", start=90 * DEG, min=1 * DEG, max=4
    )
    longest_turn = Parameter("s", "longest time of LEFT and RIGHT", start=1, min=TICK, max=LONGEST)
    least_turn = Parameter(
        "s",
        "a turn that would be shorter is not told: the dead zone, 18 deg",
        start=0.2,
        min=TICK,
        max=LONGEST,
    )
    forward_time = Parameter("s", "least time of FORWARD before a turn", start=1, min=0, max=LONGEST)

    turn_time = State("s", "time of the turn that h asks for; of the turn that is on")

    @before("issue")
    @triggered(lambda m: all_of(m.now != Mode.LEFT, m.now != Mode.RIGHT), "not in LEFT or RIGHT")
    def proportion(m) -> None:
        """The law: the time of a turn is proportional to |h| within the band."""
        m.turn_time = m.longest_turn * at_most(ca.fabs(m.deviation) / m.proportional_band, 1)

    @before("issue")
    @triggered(lambda m: all_of(m._begun(), m._free()), "not in IDLE, not blocked")
    @table("now")
    def decide(m) -> Iterator[Row]:
        """The table: forward, with turns of the time that the law gives."""
        won = m._won()
        yield Row(Mode.FORWARD, won, Mode.STOP_AT_WAYPOINT, {"ticks": 0})
        due = Condition(m._lasted(m.forward_time), "FORWARD has lasted `forward_time`")
        off = Condition(m.turn_time >= m.least_turn, "t >= `least_turn`")
        yield from m._turn(Mode.FORWARD, due & off)
        yield from m._stops(Condition(m.turn_time < m.least_turn, "t < `least_turn`"))
        for mode in (Mode.RIGHT, Mode.LEFT):
            yield Row(mode, won, Mode.STOP_AT_WAYPOINT, {"ticks": 0})
            turned = Condition(m._lasted(m.turn_time), "the command has lasted t")
            yield Row(mode, turned, Mode.FORWARD, {"ticks": 0})
        yield from m._recalls()
