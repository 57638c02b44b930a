"""The CMEC's predecessor, a prototype whose LEFT and RIGHT are turns of 90 degrees (1.1, 2.2.1, 4.2)."""

from __future__ import annotations

import math
from collections.abc import Iterator

from models.kit import casadi as ca
from models.kit.block import Row, before, moves, table, triggered
from models.kit.declaration import Parameter, State
from models.kit.geometry import LONGEST, all_of, where, wrap
from models.kit.timing import TICK
from models.kit.tracing import Condition
from models.kit.units import DEG
from models.leader import Leader
from models.modes import Mode

QUARTER = math.pi / 2  # rad, what LEFT and RIGHT turn the animal by (2.2.1, 4.2.2.2)


class QuarterTurn(Leader):
    """The CMEC's predecessor: turns of 90 degrees, by the course of an animal that moves.

    The text has three facts of it. It led by GPS with the remote control's commands (1.1). The animal turned
    by about 90 degrees on LEFT and RIGHT (2.2.1, 4.2.2.2). It did not know the heading of an animal that
    stands or is slow (4.2.3). Assumed here: the rest is as in the CMEC; the course is known from
    `course_speed` on, except while a turn is told, and at the start, where the handler points the animal
    (4.2.1); else it is the last one, turned by 90 degrees as a turn comes to its end. A turn lasts its
    time, whatever the heading; one that is cut short, at a waypoint or by an interruption, changes no course.
    No dead period, and no anomaly except that of MAXTURN.
    """

    source = "Miller 2010, 1.1, 2.2.1, 4.2.2.2, 4.2.3 on its reference [48], eq. 4.1-4.4"

    turn_deviation = Parameter(
        "rad",
        "orientation deviation at which the animal is stopped and turned; above 45 deg, so that a turn helps",
        start=60 * DEG,
        min=46 * DEG,
        max=3,
    )
    turn_time = Parameter(
        "s", "how long a turn is told: 90 deg at 60 deg/s", start=1.5, min=TICK, max=LONGEST
    )
    course_speed = Parameter("m/s", "ground speed from which the course is known", start=1, min=0.01, max=50)

    course = State("rad", "the way that the animal is taken to face")

    @triggered(
        lambda m: all_of(m.start, m.now == Mode.IDLE, m._free()),
        "in IDLE, `start` is on, not blocked",
        seldom=True,
    )
    @moves({Mode.IDLE: Mode.FORWARD})
    def begin(m) -> None:
        """Latch the mission; the first command is forward, and the animal faces as it was pointed (4.2.1)."""
        Leader.begin(m)
        m.course = wrap(m.heading)

    @before("issue")
    def hold_course(m) -> None:
        """The deviation from the course, measured while the animal moves and no turn is told (4.2.3)."""
        placed = m.within("north", "east", "heading")
        moves_on = all_of(m.within("speed"), m.speed >= m.course_speed)
        # `decide` adds a turn as it ends: what the animal has made of it by then would count twice
        known = all_of(placed, m.valid, moves_on, m.now != Mode.LEFT, m.now != Mode.RIGHT)
        m.course = where(known, wrap(m.heading), m.course)
        m.deviation = where(placed, wrap(m.deviation + m.heading - m.course), 0)  # eq. 4.4

    @before("issue")
    @triggered(lambda m: all_of(m._begun(), m._free()), "not in IDLE, not blocked")
    @table("now")
    def decide(m) -> Iterator[Row]:
        """The table: forward, and where the way is off, a stop and turns of 90 degrees."""
        limit, won = m.turn_deviation, m._won()
        off = ca.fabs(m.deviation)

        yield Row(Mode.FORWARD, won, Mode.STOP_AT_WAYPOINT, {"ticks": 0})
        misaligned = Condition(off >= limit, "|h| >= `turn_deviation`")
        yield Row(Mode.FORWARD, misaligned, Mode.STOP_TO_TURN, {"ticks": 0})
        yield from m._stops(Condition(off < limit, "|h| < `turn_deviation`"))

        turned = Condition(m._lasted(m.turn_time), "the command has lasted `turn_time`")
        for mode, angle, sign in ((Mode.RIGHT, QUARTER, "-"), (Mode.LEFT, -QUARTER, "+")):
            left_over = ca.fabs(wrap(m.deviation - angle)) < limit
            aligned = Condition(left_over, f"|h {sign} 90 deg| < `turn_deviation`")
            after = {"ticks": 0, "course": wrap(m.course + angle)}
            yield Row(mode, won, Mode.STOP_AT_WAYPOINT, {"ticks": 0})
            yield Row(mode, turned & aligned, Mode.FORWARD, after)
            yield Row(mode, turned, Mode.STOP_TO_TURN, after)
        yield from m._recalls()
