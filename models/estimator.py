"""What all estimators share: the role's signals, the judgement of a fix, the frame of the filter (3.2)."""

from __future__ import annotations

from typing import ClassVar

from models.inertial import Inertial
from models.kit import casadi as ca
from models.kit.block import triggered
from models.kit.declaration import SX, Boolean, Input, Integer, Output, Parameter, State
from models.kit.ekf import Correction, Factors, Measurement, correct
from models.kit.geometry import (
    COUNT_MAX,
    SHORT_COUNT_MAX,
    all_of,
    any_of,
    at_least,
    at_most,
    clip,
    counted,
    where,
    wrap,
)
from models.kit.timing import TICK, TOLERANCE

SPEED, BIAS = 0, 1  # every state begins with them
MOST_REJECTED = 1000  # fixes, before the filter begins anew
SURE = 3.0  # deviations of its speed: a faster fix shows its course to 20 deg
LONGEST_STEP = 1.0  # s: a course speaks for the time since the fix before it, and for no longer


class Estimator(Inertial):
    """Base of the estimators: each is a hybrid EKF that a fix of the GPS receiver corrects.

    A subclass declares `x`, `covariance`, `innovation` and `innovation_variance`, and says by `_listen`,
    `_propagate`, `_process_noise` and `_heading` what is its own, and by `_measurements` and `_begin` what it
    measures and begins with beyond speed, bias and position.

    Heading and course are compared at fixes alone, so that an ordinary tick costs nothing more (rule 6).

    Attributes:
        north_state, east_state: where the position stands in x.
        order: of the covariance's factors: each state before those it depends on.
        angles: the states that are angles, kept in (-pi, pi].
        samples: the inputs of a tick; one of them that is out of range makes the sample bad.
        fix: the inputs of a fix, likewise.
    """

    precisions = ("double", "float")
    north_state: ClassVar[int]
    east_state: ClassVar[int]
    order: ClassVar[tuple[int, ...]]
    angles: ClassVar[tuple[int, ...]] = ()
    samples: ClassVar[tuple[str, ...]]
    fix: ClassVar[tuple[str, ...]] = ("gps_north", "gps_east", "gps_speed", "gps_h_acc", "gps_s_acc")
    x: State
    covariance: State
    innovation: State
    innovation_variance: State

    accel_x = Input("m/s2", "longitudinal specific force from the IMU", min=-200, max=200)
    gps_fix = Input(Boolean, "a fix arrived on this tick")
    gps_north = Input("m", "position of the fix", min=-1e5, max=1e5)
    gps_east = Input("m", "position of the fix", min=-1e5, max=1e5)
    gps_speed = Input("m/s", "ground speed of the fix", min=0, max=50)
    gps_course = Input("rad", "course over ground of the fix", start=0, min=-7, max=7)
    gps_h_acc = Input("m", "horizontal accuracy stated by the receiver", min=1e-3, max=1e3)
    gps_s_acc = Input("m/s", "speed accuracy stated by the receiver", min=1e-3, max=1e2)

    north = Output("m", "position")
    east = Output("m", "position")
    speed = Output("m/s", "ground speed")
    heading = Output("rad", "heading, clockwise from north, in (-pi, pi]")
    accel_bias = Output("m/s2", "accelerometer bias")
    north_sd = Output("m", "standard deviation of the position")
    east_sd = Output("m", "standard deviation of the position")
    speed_sd = Output("m/s", "standard deviation of the speed")
    heading_sd = Output("rad", "standard deviation of the heading")
    accel_bias_sd = Output("m/s2", "standard deviation of the bias")
    sigma_accel = Output("m/s2", "process noise of the acceleration in force")
    valid = Output(
        Boolean,
        "good enough to lead by: a recent fix, deviations in bounds, a live sensor, `heading_ok`",
    )
    heading_ok = Output(Boolean, "courses do not contradict the heading")
    rejected_fixes = Output(Integer, "good fixes that the gate rejected", min=0, max=SHORT_COUNT_MAX)
    jumps = Output(
        Integer,
        "corrections that moved the position by more than `jump_distance`",
        min=0,
        max=SHORT_COUNT_MAX,
    )
    recoveries = Output(Integer, "times that the filter began anew", min=0, max=SHORT_COUNT_MAX)

    sigma_constant = Parameter(
        "m/s2", "process noise of the acceleration, not tuned (D.7)", start=0.1, min=0, max=1e4
    )
    sigma_bias = Parameter("m/s2", "random walk of the bias per tick (eq. 3.16)", start=1e-3, min=0, max=1e3)
    sigma_position = Parameter(
        "m", "random walk of north and east per tick (eq. 3.16)", start=1e-6, min=1e-9, max=1e3
    )
    initial_speed_variance = Parameter("1", "of P0, in (m/s)^2 (eq. 3.17)", start=0.1, min=1e-9, max=1e6)
    initial_bias_variance = Parameter("1", "of P0, in (m/s2)^2 (eq. 3.17)", start=1, min=1e-9, max=1e6)
    initial_position_variance = Parameter("1", "of P0, in m^2 (eq. 3.17)", start=0.01, min=1e-9, max=1e6)
    position_sd_scale = Parameter(
        "1",
        "standard deviation of a fix's position per stated accuracy (eq. 3.15)",
        start=0.5,
        min=1e-6,
        max=1e3,
    )
    speed_sd_scale = Parameter(
        "1", "standard deviation of a fix's speed per stated accuracy (eq. 3.15)", start=1, min=1e-6, max=1e3
    )
    # the floors, the gate and the recovery are ours: the text believes and accepts every fix
    position_sd_floor = Parameter(
        "m", "a fix's position is believed no better than this standard deviation", start=0, min=0, max=1e3
    )
    speed_sd_floor = Parameter(
        "m/s", "a fix's speed is believed no better than this standard deviation", start=0, min=0, max=1e2
    )
    gate = Parameter(
        "1", "a fix farther off than this many nominal deviations is rejected", start=5, min=0, max=1e6
    )
    gate_speed_growth = Parameter("m/s2", "nominal growth of the speed's deviation", start=4, min=0, max=1e3)
    gate_position_growth = Parameter(
        "m/s", "nominal growth of the position's deviation", start=1.5, min=0, max=1e3
    )
    recovery_fixes = Parameter(
        Integer,
        "fixes rejected in a row after which the filter begins anew",
        start=4,
        min=1,
        max=MOST_REJECTED,
    )
    recovery_time = Parameter("s", "and the time for which they must have come", start=0, min=0, max=1e4)
    recovery_speed = Parameter(
        "m/s",
        "rejected fixes farther apart than a body of this speed moves count anew",
        start=1e6,
        min=0,
        max=1e6,
    )
    max_age = Parameter("s", "a fix older than this makes the estimate invalid", start=15, min=0, max=1e6)
    # rule 5 of SAFETY.md: good enough to lead by
    max_position_sd = Parameter(
        "m", "a standard deviation of north or east above this makes it invalid", start=1e9, min=0, max=1e9
    )
    max_speed_sd = Parameter(
        "m/s", "a standard deviation of the speed above this makes it invalid", start=1e9, min=0, max=1e9
    )
    jump_distance = Parameter(
        "m", "a correction that moves the position farther is counted as a jump", start=7, min=0, max=1e6
    )
    # rule 6 of SAFETY.md: heading against course
    heading_limit = Parameter(
        "rad",
        "a course farther from the heading than this contradicts it; above pi: none",
        start=4,
        min=0,
        max=4,
    )
    heading_time = Parameter(
        "s",
        "so long courses contradict it until the estimate is invalid, and agree until it is valid again",
        start=3,
        min=TICK,
        max=1e3,
    )
    course_speed = Parameter(
        "m/s", "a fix slower than this shows no course to hold the heading against", start=0.5, min=0, max=50
    )

    started = State(Boolean, "a first fix has set the state")
    renewed = State(Boolean, "the filter has begun anew, and no fix passed the gate since")
    acceleration = State(
        "m/s2", "longitudinal acceleration with its bias; the bias alone where the sample is bad"
    )
    sigma = State("m/s2", "process noise of the acceleration in force", start=0.1)
    age = State(Integer, "ticks since the last accepted fix", max=COUNT_MAX)
    good = State(Boolean, "the last fix has all its values in range")
    accepted = State(Boolean, "this tick's fix passed the gate")
    rejected = State(Integer, "fixes rejected in a row that agree with each other", min=0, max=MOST_REJECTED)
    rejected_north = State("m", "position of the last of them")
    rejected_east = State("m", "position of the last of them")
    rejected_age = State(Integer, "age when it came")
    rejected_since = State(Integer, "age when the first of them came")
    fix_gap = State(Integer, "ticks between this good fix and the one before", max=COUNT_MAX)
    contradiction = State("s", "for how long courses contradict the heading, less the time they agreed")
    contradicted = State(Boolean, "they did for `heading_time`, and have not agreed for as long since")
    rejections = State(Integer, "good fixes rejected", min=0, max=SHORT_COUNT_MAX)
    jumped = State(Integer, "corrections that were jumps", min=0, max=SHORT_COUNT_MAX)
    renewals = State(Integer, "times begun anew", min=0, max=SHORT_COUNT_MAX)
    bad_samples = State(Integer, "samples skipped: values out of range, or a silent sensor", max=COUNT_MAX)
    bad_fixes = State(Integer, "fixes skipped for values out of range", max=COUNT_MAX)

    def listen(m) -> None:
        """Take the sample if all its values are good; else hold speed and heading, and count it."""
        good = m._take(*m.samples)
        m._listen(good)
        m.bad_samples = counted(m.bad_samples, ca.logic_not(good))
        m.age = counted(m.age)
        m.accepted = 0
        m.sigma = m.sigma_constant

    @triggered("started")
    def predict(m) -> None:
        """Time update over one tick (eq. 3.5, 3.6)."""
        x, transition = m._propagate()
        m.x = m._wrapped(x)
        m.covariance = m._factors().predict(transition, m._process_noise()).pack()

    @triggered("gps_fix")
    def judge(m) -> None:
        """Accept or reject the fix: the gate of its innovations has a nominal width, without sigma."""
        m.good = m.within(*m.fix)
        m.fix_gap = m.age - where(m.rejected > 0, m.rejected_age, 0)
        age = m.age * m.sample_time
        position_variance = 2 * m._position_variance() + (m.gate_position_growth * age) ** 2
        speed_variance = 2 * m._speed_variance() + (m.gate_speed_growth * age) ** 2
        near = all_of(
            (m.gps_north - m.x[m.north_state]) ** 2 <= m.gate**2 * position_variance,
            (m.gps_east - m.x[m.east_state]) ** 2 <= m.gate**2 * position_variance,
            (m.gps_speed - m.x[SPEED]) ** 2 <= m.gate**2 * speed_variance,
        )
        m.accepted = all_of(m.good, near, m.started)
        m._count_rejected(position_variance)
        m.bad_fixes = counted(m.bad_fixes, ca.logic_not(m.good))

    @triggered(
        lambda m: all_of(
            m.gps_fix,
            m.good,
            m.within("gps_course"),
            m.gps_speed > at_least(SURE * m.gps_s_acc, m.course_speed),
        ),
        "a good fix of a moving body, accepted or not, whose course is good",
    )
    def confront(m) -> None:
        """For how long have courses contradicted the heading, on balance (rule 6)?"""
        apart = ca.fabs(wrap(m.gps_course - m._facing())) > m.heading_limit
        step = at_most(m.fix_gap * m.sample_time, LONGEST_STEP)
        m.contradiction = clip(m.contradiction + where(apart, step, -step), 0, m.heading_time)
        lasting = m.contradiction >= m.heading_time
        m.contradicted = any_of(lasting, all_of(m.contradicted, m.contradiction > 0))

    @triggered("accepted")
    def correct(m) -> None:
        """Measurement update by the values of the fix in turn (eq. 3.1-3.4)."""
        north, east = m.x[m.north_state], m.x[m.east_state]
        steps = m._correct(m._measurements())
        moved = (m.x[m.north_state] - north) ** 2 + (m.x[m.east_state] - east) ** 2
        m.jumped = counted(m.jumped, moved > m.jump_distance**2, most=SHORT_COUNT_MAX)
        m.innovation = ca.vertcat(*(step.innovation for step in steps))
        m.innovation_variance = ca.vertcat(*(step.variance for step in steps))
        m.age = m.renewed = 0

    @triggered(
        lambda m: all_of(m.gps_fix, m.good, any_of(ca.logic_not(m.started), m._is_elsewhere())),
        "a good fix is the first, or the last of `recovery_fixes` rejected in a row for `recovery_time`",
    )
    def recover(m) -> None:
        """Begin, or begin anew, at the fix; keep the bias if there is one that has not failed so already.

        Eq. 3.9 begins with zeros at a known start, with P0 of eq. 3.17. A state taken from a fix is as
        uncertain as the fix, so its variance is added.
        """
        begun = m._begin()
        values, variances = zip(*(begun[state] for state in range(len(m.order))), strict=True)
        m.x, m.covariance = ca.vertcat(*values), Factors.diagonal(variances, m.order).pack()
        m.renewals = counted(m.renewals, m.started, most=SHORT_COUNT_MAX)
        m.renewed = m.started
        m.started = 1
        m.age = m.rejected = 0

    def output(m) -> None:
        """The estimate for this tick."""
        m.speed, m.accel_bias, m.north, m.east = (m.x[i] for i in m._reported())
        m.speed_sd, m.accel_bias_sd, m.north_sd, m.east_sd = map(ca.sqrt, m._stated_variances())
        m.heading, m.heading_sd = m._heading()
        m.sigma_accel = m.sigma
        m.heading_ok = ca.logic_not(m.contradicted)
        m.rejected_fixes, m.jumps, m.recoveries = m.rejections, m.jumped, m.renewals
        m.valid = all_of(
            m.started,
            m.heading_ok,
            m._alive(),
            m.age * m.sample_time <= m.max_age,
            m.north_sd <= m.max_position_sd,
            m.east_sd <= m.max_position_sd,
            m.speed_sd <= m.max_speed_sd,
        )

    # What is an estimator's own

    def _listen(m, good: SX) -> None:
        """Set `acceleration`, and what else is held from the sample."""
        raise NotImplementedError

    def _propagate(m) -> tuple[SX, SX]:
        """The state after a tick (n, 1), and its derivative by the state (n, n)."""
        raise NotImplementedError

    def _process_noise(m) -> list[SX]:
        """The diagonal of Q for a tick (n,)."""
        raise NotImplementedError

    def _measurements(m) -> list[Measurement]:
        """The scalars of a fix, in the order of the corrections."""
        variance = m._position_variance()
        return [
            Measurement(SPEED, m.gps_speed, m._speed_variance()),
            Measurement(m.north_state, m.gps_north, variance),
            Measurement(m.east_state, m.gps_east, variance),
        ]

    def _begin(m) -> dict[int, tuple[SX, SX]]:
        """Each state at the first fix, or anew, and its variance."""
        variance = m.initial_position_variance + m._position_variance()
        return {
            SPEED: (m.gps_speed, m.initial_speed_variance + m._speed_variance()),
            BIAS: m._kept(BIAS, m.initial_bias_variance),
            m.north_state: (m.gps_north, variance),
            m.east_state: (m.gps_east, variance),
        }

    def _heading(m) -> tuple[SX, SX]:
        """The heading in (-pi, pi] and its standard deviation [rad]."""
        raise NotImplementedError

    def _facing(m) -> SX:
        """The heading [rad], of any number of turns."""
        raise NotImplementedError

    def _stated_variances(m) -> tuple[SX, SX, SX, SX]:
        """Of speed, bias, north and east."""
        factors = m._factors()
        speed, bias, north, east = (factors.variance(i) for i in m._reported())
        return speed, bias, north, east

    # What they use

    def _factors(m) -> Factors:
        return Factors.unpack(m.covariance, m.order)

    def _wrapped(m, x: SX) -> SX:
        return ca.vertcat(*(wrap(x[i]) if i in m.angles else x[i] for i in range(x.numel())))

    def _reported(m) -> tuple[int, int, int, int]:
        return SPEED, BIAS, m.north_state, m.east_state

    def _correct(m, measurements: list[Measurement]) -> list[Correction]:
        """Correct state and covariance by measurements, or by pseudo-measurements such as speed 0."""
        x, factors, steps = correct(m.x, m._factors(), measurements)
        m.x, m.covariance = m._wrapped(x), factors.pack()
        return steps

    def _count_rejected(m, position_variance: SX) -> None:
        """Fixes that are rejected in a row count together if the body can have moved from one to the next."""
        reach = m.recovery_speed * (m.age * m.sample_time - m.rejected_age * m.sample_time)
        step = (m.gps_north - m.rejected_north) ** 2 + (m.gps_east - m.rejected_east) ** 2
        agrees = all_of(m.rejected > 0, step <= reach**2 + m.gate**2 * position_variance)
        rejected = all_of(m.good, ca.logic_not(m.accepted))
        m.rejections = counted(m.rejections, all_of(rejected, m.started), most=SHORT_COUNT_MAX)
        m.rejected_since = where(all_of(rejected, ca.logic_not(agrees)), m.age, m.rejected_since)
        m.rejected_north = where(rejected, m.gps_north, m.rejected_north)
        m.rejected_east = where(rejected, m.gps_east, m.rejected_east)
        m.rejected_age = where(rejected, m.age, m.rejected_age)
        count = where(agrees, counted(m.rejected, most=MOST_REJECTED), 1)
        m.rejected = where(m.good, where(m.accepted, 0, count), m.rejected)

    def _is_elsewhere(m) -> SX:
        """Have fixes that agree been rejected often and long enough?"""
        since = m.age * m.sample_time - m.rejected_since * m.sample_time
        return all_of(m.rejected >= m.recovery_fixes, since > m.recovery_time - TOLERANCE * m.sample_time)

    def _position_variance(m) -> SX:
        return at_least(m.position_sd_scale * m.gps_h_acc, m.position_sd_floor) ** 2  # eq. 3.15

    def _speed_variance(m) -> SX:
        return at_least(m.speed_sd_scale * m.gps_s_acc, m.speed_sd_floor) ** 2  # eq. 3.15

    def _kept(m, state: int, initial_variance: SX) -> tuple[SX, SX]:
        """A state that goes on when the filter begins anew, or 0 if that did not help; and its variance."""
        variance = m._factors().variance(state)
        known = all_of(m.started, ca.logic_not(m.renewed))
        return where(m.renewed, 0, m.x[state]), where(known, variance, initial_variance)
