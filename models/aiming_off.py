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
TURNED = 4  # standard deviations of a heading from which an animal is known to turn
LONGEST_RESPONSE = 10.0  # s
NOT_YET = SHORT_COUNT_MAX  # behind any tick of a mode


class AimingOff(Block):
    """Base of a controller that aims off; without drift, response time and braking it does nothing.

    *Drift.* The heading of an animal under FORWARD turns by d, so it runs an arc, whose chord leads to the
    target if the run begins b = d t / 2 to the other side; t is the time to the target. Turns end at h = b,
    which is found where a turn may be told. d is the parameter `drift`; with `drift_sd` it is learnt in the
    trial by a scalar Kalman filter, from the change of the heading over each run. From run to run it keeps
    `drift_persistence` of its difference from the mean; what it loses is drawn anew (Gauss-Markov).
    *Lead.* An animal turns on for its response time after its turn has ended. So a turn ends where its rate
    so far will have brought it to b by then, or past b. The time is the parameter `response_time`; with
    `response_sd` it is learnt by another such filter. An animal that is told to turn stands, and its heading
    stays until it obeys. The line through two later headings gives the time at which it obeyed.
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
    drift_persistence = Parameter(
        "1",
        "correlation of the drift of a run with that of the run before; 1: it stays",
        start=1,
        min=0,
        max=1,
    )
    heading_sd = Parameter(
        "rad",
        "standard deviation of a heading, for learning",
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
        "s", "time from a command to the animal's obedience, its mean", start=0, min=0, max=LONGEST_RESPONSE
    )
    response_sd = Parameter(
        "s",
        "its standard deviation from animal to animal; above 0 it is learnt, from turns of 8 `heading_sd`",
        start=0,
        min=0,
        max=LONGEST_RESPONSE,
    )
    braking = Parameter(
        "m/s2", "the animal's deceleration on STOP, for the braking point; 0: stop at d'", start=0, min=0
    )

    learnt_drift = State("rad/s", "drift as it is known", min=-FASTEST_DRIFT, max=FASTEST_DRIFT)
    drift_variance = State("rad2/s2", "its variance")
    learnt_response = State("s", "response time as it is known", min=0, max=LONGEST_RESPONSE)
    response_variance = State("s2", "its variance")
    settling = State(Integer, "tick of a mode on which the animal obeys, 0: not needed", min=0, max=300)
    issue_heading = State("rad", "heading where FORWARD, RIGHT or LEFT was issued")
    noted_heading = State("rad", "heading from which a drift or a turn is measured")
    noted_tick = State(Integer, "tick of the mode on which it was noted", min=0, max=NOT_YET)
    timed = State(Boolean, "the response to this turn is timed")
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
    def learn_drift(m) -> None:
        """Correct the drift by the change of the heading over a run, whose ends are as sure as a heading.

        Then predict that of the next run.
        """
        known = all_of(m.ran > m.settling, ca.logic_not(m._blocked()))
        time = at_least(m.ran + 1 - m.settling, 1) * m.sample_time
        gain = m.drift_variance / (m.drift_variance + 2 * (m.heading_sd / time) ** 2)
        innovation = wrap(m.heading - m.noted_heading) / time - m.learnt_drift
        learnt = m.learnt_drift + where(known, gain * innovation, 0)
        learnt = clip(learnt, -FASTEST_DRIFT, FASTEST_DRIFT)
        variance = m.drift_variance - where(known, gain * m.drift_variance, 0)
        m.learnt_drift = learnt - (1 - m.drift_persistence) * (learnt - m.drift)
        m.drift_variance = variance + (1 - m.drift_persistence**2) * (m.drift_sd**2 - variance)
        m.ran = 0

    @before("decide")
    @triggered(
        lambda m: all_of(
            m.ticks == m.settling,
            any_of(m.now == Mode.FORWARD, all_of(m._turns(), m.response_sd <= 0)),
        ),
        "FORWARD, or RIGHT or LEFT where `response_sd` is 0, has lasted the response time",
        seldom=True,
    )
    def note(m) -> None:
        """Note the heading from which a drift and a turn are measured."""
        m.noted_heading, m.noted_tick = m.heading, m.ticks

    @before("decide")
    @triggered(
        lambda m: all_of(m._turns(), m.response_sd > 0, ca.logic_not(m.timed)),
        "in RIGHT and LEFT, `response_sd` is above 0, not yet `timed`",
        seldom=True,
    )
    def learn_response(m) -> None:
        """Correct the response time by the time at which the heading began to change.

        The heading changes in a line. It has changed by TURNED `heading_sd` at time t1, by twice as much at
        t2. So the change began at 2 t1 - t2, and half a tick earlier, since ticks see it late. Three headings
        with independent errors give that time a variance of 6 ((t2 - t1) / TURNED)^2.
        """
        turned = ca.fabs(wrap(m.heading - m.issue_heading)) / m.heading_sd
        ticks = m.ticks - m.noted_tick
        is_timed = all_of(ticks > 0, turned >= 2 * TURNED)
        time = ticks * m.sample_time
        measured = (m.noted_tick - 0.5) * m.sample_time - time
        gain = m.response_variance / (m.response_variance + 6 / TURNED**2 * time**2)
        gain = where(is_timed, gain, 0)
        learnt = m.learnt_response + gain * (measured - m.learnt_response)
        m.learnt_response = clip(learnt, 0, LONGEST_RESPONSE)
        m.response_variance = m.response_variance - gain * m.response_variance
        m.settling = m._settling()
        m.lead, m.timed = 0, is_timed  # no lead is found for an animal that obeys at once
        is_noted = all_of(ticks < 0, turned >= TURNED)
        m.noted_heading = where(is_noted, m.heading, m.noted_heading)
        m.noted_tick = where(is_noted, m.ticks, m.noted_tick)

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
        lambda m: all_of(m._turns(), m.learnt_response > 0),
        "in RIGHT and LEFT, the response time as it is known is above 0",
        seldom=True,
    )
    def lead_turn(m) -> None:
        """Find how far the animal will turn before it obeys FORWARD, at its rate since it obeyed the turn."""
        turning = m.ticks - m.noted_tick
        turned = wrap(m.heading - m.noted_heading)
        lead = turned * (m.learnt_response / (at_least(turning, 1) * m.sample_time))
        m.lead = where(turning >= LEAST_TURN, lead, 0)

    @before("decide")
    @triggered(
        lambda m: all_of(m.braking > 0, m.now == Mode.FORWARD, m.distance <= m.capture_radius),
        "in FORWARD, `braking` is above 0, d <= d'",
        seldom=True,
    )
    def brake(m) -> None:
        """Is the braking point ahead, of an animal that still looks at the waypoint?"""
        left = m.distance - ca.fabs(m.speed) * m.learnt_response  # when it obeys
        is_far = 2 * m.braking * left > m.speed**2  # no division: firmware may have `braking` 0 as a constant
        m.early = all_of(is_far, ca.fabs(m.deviation) < m.moving_deviation)

    def _aim_anew(m) -> None:
        """Begin a trial with what is known of all animals."""
        m.learnt_drift, m.drift_variance = m.drift, m.drift_sd**2
        m.learnt_response, m.response_variance = m.response_time, m.response_sd**2
        asked = any_of(m.drift_sd > 0, m.response_time > 0, m.response_sd > 0)
        m.settling = where(asked, m._settling(), 0)
        m.ran = m.offset = m.early = 0

    def _begin_mode(m) -> None:
        """Begin to watch what the animal makes of another command."""
        m.issue_heading, m.noted_tick = m.heading, NOT_YET
        m.lead = m.timed = 0

    def _settling(m) -> SX:
        """The tick of a mode on which the animal obeys, or the one behind it."""
        return ticks_within(m.learnt_response, m.sample_time) + 1

    def _halts(m) -> SX:
        """Is the animal told to stop, for a turn or at a waypoint?"""
        return any_of(m.now == Mode.STOP_TO_TURN, m.now == Mode.STOP_AT_WAYPOINT)

    def _leads(m) -> SX:
        """Is the animal told to run or to turn?"""
        return any_of(m.now == Mode.FORWARD, m._turns())

    def _turns(m) -> SX:
        """Is a turn told?"""
        return any_of(m.now == Mode.RIGHT, m.now == Mode.LEFT)

    def _astray(m) -> tuple[SX, str]:
        """The deviation from the heading that is aimed at [rad], and its name."""
        return m.deviation - m.offset, "h - b"
