"""Aiming off: the controller allows for an animal that drifts, that responds late, and that brakes (ours)."""

from __future__ import annotations

from collections.abc import Callable

from models.kit import casadi as ca
from models.kit.block import Block, before, triggered
from models.kit.declaration import SX, Boolean, Integer, Output, Parameter, State
from models.kit.geometry import SHORT_COUNT_MAX, all_of, any_of, at_least, at_most, clip, where, wrap
from models.kit.timing import ticks_within
from models.kit.units import DEG
from models.modes import Mode

FASTEST_DRIFT = 1.0  # rad/s, that is believed
LEAST_TURN = 3  # ticks from which a turn rate is known: 0.12 s


class AimingOff(Block):
    """Base of a controller that aims off; without drift, response time and braking it does nothing.

    *Drift.* The heading of an animal under FORWARD turns by d, so it runs an arc, whose chord leads to the
    target if the run begins b = d t / 2 to the other side; t is the time to the target. Turns end at h = b,
    which is found where a turn may be told. d is the parameter `drift`; with `drift_sd` it is learnt in the
    trial by a scalar Kalman filter, from the change of the heading over each run.
    *Lead.* An animal turns on for `response_time` after its turn has ended. So a turn ends where its rate so
    far will have brought it to b by then, or past b.
    *Braking point.* With `braking`, STOP is told where the animal will come to rest at the waypoint, within
    d'; d' alone stops it d' less its braking distance before.
    """

    behind = True
    now: State
    ticks: State
    heading: SX
    speed: SX
    distance: Output
    deviation: Output
    capture_radius: Parameter
    moving_deviation: Parameter
    turn_end_deviation: Parameter
    dead_time: Parameter
    _blocked: Callable[..., SX]
    _at_rest: Callable[..., SX]
    _lasted: Callable[..., SX]

    drift = Parameter(
        "rad/s", "the animal's heading drift under FORWARD, its mean", start=0, min=-1, max=FASTEST_DRIFT
    )
    drift_sd = Parameter(
        "rad/s",
        "standard deviation of the drift from animal to animal; above 0 it is learnt",
        start=0,
        min=0,
        max=FASTEST_DRIFT,
    )
    heading_sd = Parameter(
        "rad",
        "standard deviation of a heading, for learning the drift",
        start=3 * DEG,
        min=0.1 * DEG,
        max=4,
    )
    cruise_speed = Parameter("m/s", "the animal's speed under FORWARD", start=4.86, min=0.1, max=50)
    starting_time = Parameter(
        "s", "time that speeding up adds to a run: speed / (2 acceleration)", start=1.37, min=0, max=100
    )
    most_aim_off = Parameter(
        "rad", "largest b; h' less `turn_end_deviation` bounds it too", start=45 * DEG, min=0, max=1.5
    )
    response_time = Parameter(
        "s", "time from a command to the animal's obedience, for the lead", start=0, min=0, max=10
    )
    braking = Parameter(
        "m/s2", "the animal's deceleration on STOP, for the braking point; 0: stop at d'", start=0, min=0
    )

    learnt_drift = State("rad/s", "drift as it is known", min=-FASTEST_DRIFT, max=FASTEST_DRIFT)
    learnt_drift_sd = State("rad/s", "its standard deviation", min=0, max=FASTEST_DRIFT)
    settling = State(
        Integer, "tick of a mode on which the animal obeys, -1: nobody asks", start=-1, min=-1, max=300
    )
    noted_heading = State("rad", "heading on that tick")
    ran = State(Integer, "ticks of the run that has just ended", min=0, max=SHORT_COUNT_MAX)
    offset = State("rad", "b: deviation at which the turn is to end", min=-1.5, max=1.5)
    lead = State("rad", "how far the animal will turn before it obeys")
    early = State(Boolean, "the waypoint is within d', the braking point is ahead")

    @before("decide")
    @triggered(
        lambda m: all_of(m._halts(), m.ran > 0, m.drift_sd > 0),
        "in a stop behind a run, `drift_sd` is above 0",
        seldom=True,
    )
    def learn(m) -> None:
        """Correct the drift by the change of the heading over a run, whose ends are as sure as a heading."""
        known = all_of(m.ran > m.settling, ca.logic_not(m._blocked()))
        time = at_least(m.ran + 1 - m.settling, 1) * m.sample_time
        predicted = (m.learnt_drift_sd * time) ** 2
        gain = predicted / (predicted + 2 * m.heading_sd**2)
        innovation = wrap(m.heading - m.noted_heading) / time - m.learnt_drift
        learnt = m.learnt_drift + where(known, gain * innovation, 0)
        m.learnt_drift = clip(learnt, -FASTEST_DRIFT, FASTEST_DRIFT)
        m.learnt_drift_sd = m.learnt_drift_sd * ca.sqrt(at_least(1 - where(known, gain, 0), 0))
        m.ran = 0

    @before("decide")
    @triggered(
        lambda m: all_of(
            any_of(m.now == Mode.FORWARD, m._turns()), m.ticks == m.settling, ca.logic_not(m._blocked())
        ),
        "FORWARD, RIGHT or LEFT has lasted `response_time`, not blocked, `drift_sd` or the time is above 0",
        seldom=True,
    )
    def note(m) -> None:
        """Note the heading from which a drift and a turn are measured."""
        m.noted_heading = m.heading

    @before("decide")
    @triggered(
        lambda m: all_of(
            any_of(m.drift != 0, m.drift_sd > 0),
            any_of(
                all_of(m._halts(), m._at_rest()),
                all_of(m.now == Mode.DEAD, m._lasted(m.dead_time)),
            ),
        ),
        "`drift` or `drift_sd` is not 0, and a turn may be told",
        seldom=True,
    )
    def aim_off(m) -> None:
        """Find b, half of what the heading will drift on the way to the target."""
        time = m.distance / m.cruise_speed + m.starting_time
        most = at_least(at_most(m.most_aim_off, m.moving_deviation - m.turn_end_deviation), 0)
        m.offset = clip(0.5 * m.learnt_drift * time, -most, most)

    @before("decide")
    @triggered(
        lambda m: all_of(m._turns(), m.response_time > 0, ca.logic_not(m._blocked())),
        "in RIGHT and LEFT, `response_time` is above 0, not blocked",
        seldom=True,
    )
    def lead_turn(m) -> None:
        """Find how far the animal will turn before it obeys FORWARD, at its rate since it obeyed the turn."""
        turning = m.ticks - m.settling
        turned = wrap(m.heading - m.noted_heading)
        lead = turned * (m.response_time / (at_least(turning, 1) * m.sample_time))
        m.lead = where(turning >= LEAST_TURN, lead, 0)

    @before("decide")
    @triggered(
        lambda m: all_of(m.braking > 0, m.now == Mode.FORWARD, m.distance <= m.capture_radius),
        "in FORWARD, `braking` is above 0, d <= d'",
        seldom=True,
    )
    def brake(m) -> None:
        """Is the braking point ahead, of an animal that still looks at the waypoint?"""
        left = m.distance - ca.fabs(m.speed) * m.response_time  # when it obeys
        is_far = 2 * m.braking * left > m.speed**2  # no division: firmware may have `braking` 0 as a constant
        m.early = all_of(is_far, ca.fabs(m.deviation) < m.moving_deviation)

    def _aim_anew(m) -> None:
        """Begin a trial with what is known of all animals."""
        m.learnt_drift, m.learnt_drift_sd = m.drift, m.drift_sd
        asked = any_of(m.drift_sd > 0, m.response_time > 0)
        m.settling = where(asked, ticks_within(m.response_time, m.sample_time) + 1, -1)
        m.ran = m.offset = m.lead = m.early = 0

    def _halts(m) -> SX:
        """Is the animal told to stop, for a turn or at a waypoint?"""
        return any_of(m.now == Mode.STOP_TO_TURN, m.now == Mode.STOP_AT_WAYPOINT)

    def _turns(m) -> SX:
        """Is a turn told?"""
        return any_of(m.now == Mode.RIGHT, m.now == Mode.LEFT)

    def _astray(m) -> tuple[SX, str]:
        """The deviation from the heading that is aimed at [rad], and its name."""
        return m.deviation - m.offset, "h - b"
