"""Our own estimator of a dog or another carrier: slip, a speed that reverts to its mean, standing still.

On a real walk the filters of the text lose against holding the speed. Here the course is not the heading,
the acceleration of a stride is believed for a moment only, a fix no better than the model, and a body at rest
stays in its place. What differs from carrier to carrier is learned from the fixes: how far the course leads
the heading; how quiet the inertial sensors get in motion; and, by rehearsing outages of the speed, how long
an acceleration is to be believed, and how fast a speed without fixes becomes uncertain.
"""

from __future__ import annotations

from models.estimator import BIAS, SPEED
from models.given_heading import ANY, GivenHeading
from models.kit import casadi as ca
from models.kit.block import before, triggered
from models.kit.declaration import SX, Boolean, Input, Integer, Parameter, State
from models.kit.ekf import Factors, Measurement
from models.kit.geometry import (
    LONGEST,
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
from models.kit.timing import TICK, lasted

NORTH, EAST = 2, 3  # behind speed and bias in the state, eq. 3.9
OFFSET, LEAD = 0, 1  # of the slip
BRISK, LONG = 0, 1  # of the two rehearsed speeds
REHEARSED = 8  # rehearsals over which their errors are averaged
DOUBTED = 2  # rehearsals that the errors at the start count for
LEARNED = 0.3  # part of an apparent bias that a rehearsal takes over
SHORT_NOISE = 4.0  # variance that the process noise brings in, by that which rehearsals show
MEAN_SHARE = 1 / 16  # of the process noise of the speed: that of its mean
LATE = 1.0  # s: an end that comes later, after an outage, does not count
FORGET_QUIET = 1.002  # a slowly moving fix: the least motion seen may double in 90 s of moving so
ASTRAY = 8  # courses in a row, 2 s: a turn does not last so long
SLOW = 2.0  # m/s: a faster fix does not tell how little the slow gaits move
UNMOVED = 1e6  # no motion is seen yet: more than any
SETTLED = 40  # moving fixes after which the least motion is known
FRESH = 0.6  # s, age of a fix that still tells whether the body moves
SPEEDS = 4  # fixes over which the speed is averaged that tells of motion
SURE = 2.0  # deviations of a fix's speed, as stated: a body at rest shows a speed below them
LEAST_ERROR = 2.0  # of a rehearsal, in deviations of a fix's speed: running steadily does not tell of a stop


class CanineTracker(GivenHeading):
    """EKF with slip, a speed that reverts to its mean, and zero-velocity updates."""

    source = "Miller 2010, eq. 3.1-3.9, 6.2, B.4; equations of ours"
    north_state, east_state = NORTH, EAST
    order = (NORTH, EAST, SPEED, BIAS)
    sensed = ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z")
    samples = (*sensed, "roll_meas", "pitch_meas", "heading_meas", "heading_meas_sd")

    accel_y = Input("m/s2", "specific force to the right", min=-200, max=200)
    accel_z = Input("m/s2", "specific force down", min=-200, max=200)
    gyro_x = Input("rad/s", "turn rate about forward", min=-100, max=100)
    gyro_y = Input("rad/s", "turn rate about right", min=-100, max=100)
    gyro_z = Input("rad/s", "turn rate about down", min=-100, max=100)
    roll_meas = Input("rad", "roll from the AHRS, right side down positive", min=-7, max=7)
    pitch_meas = Input("rad", "pitch from the AHRS, nose up positive", min=-4, max=4)

    sigma_constant = Parameter(
        "m/s2", "process noise of the acceleration until it is learned", start=0.4, min=1e-3, max=1e4
    )
    position_sd_floor = Parameter(
        "m", "a fix's position is believed no better than this", start=0.25, min=0, max=1e3
    )
    speed_sd_floor = Parameter(
        "m/s", "a fix's speed is believed no better than this", start=0.1, min=0, max=1e2
    )
    heading_accuracy = Parameter(
        "rad", "standard deviation of the course that is moved along, at least", start=0.1, min=0, max=4
    )
    # slip
    use_slip = Parameter(Boolean, "the course leads the heading; off: it is the heading", start=1)
    slip_noise = Parameter(
        "rad", "of course less heading, beside the fix's own noise", start=0.2, min=1e-3, max=4
    )
    slip_offset_walk = Parameter("rad", "random walk of the offset in a second", start=0.02, min=0, max=4)
    slip_lead_walk = Parameter("s", "random walk of the lead in a second", start=0.005, min=0, max=1e2)
    initial_slip_offset = Parameter(
        "rad", "standard deviation of the offset at the start", start=0.3, min=1e-3, max=4
    )
    initial_slip_lead = Parameter(
        "s", "standard deviation of the lead at the start", start=0.5, min=1e-3, max=1e2
    )
    largest_slip = Parameter("rad", "the course differs from the heading by no more", start=1, min=0, max=1)
    moving_speed = Parameter("m/s", "a fix slower than this shows no course", start=0.5, min=0.01, max=50)
    # the speed about its mean
    reversion_time = Parameter(
        "s", "in which the speed reverts to its mean: 0.7 for strides", start=0.7, min=0.1, max=1e6
    )
    long_reversion_time = Parameter(
        "s", "likewise for a carrier whose acceleration is good", start=60, min=0.1, max=1e6
    )
    rehearse = Parameter(Boolean, "learn sigma and which time is right; off: reversion_time", start=1)
    rehearsal_time = Parameter(
        "s", "length of a rehearsed outage of the speed", start=5, min=0.1, max=LONGEST
    )
    rehearsal_margin = Parameter(
        "1", "how often smaller the long one's mean square has to be", start=4, min=0, max=1e6
    )
    # standing still
    use_stillness = Parameter(Boolean, "a body at rest is held in its place", start=1)
    still_time = Parameter("s", "over which motion is measured", start=0.3, min=TICK, max=1e3)
    still_share = Parameter(
        "1", "of the least motion seen while moving: below it the body rests", start=0.25, min=0, max=1e3
    )
    still_accuracy = Parameter(
        "m/s", "standard deviation of the speed of a body at rest", start=0.05, min=1e-3, max=1e2
    )

    x = State("1", "speed, bias less mean speed times reversion, north, east", size=4)
    covariance = State("1", "UD factors of P for north, east, speed, bias: D, then U by rows", size=10)
    innovation = State("1", "of the last accepted fix: speed, north, east (eq. 3.14)", size=3)
    innovation_variance = State("1", "what the filter expects of each, its variance", start=1, size=3)
    yaw_rate = State("rad/s", "last good turn rate about the vertical")
    beta = State("rad", "course less heading, of the last good sample")
    slip = State("1", "offset in rad and lead in s: course less heading is offset + lead * yaw rate", size=2)
    slip_covariance = State("1", "its UD factors: D, then U", size=3)
    astray = State(
        Integer, "courses in a row that neither heading nor slip explains", min=0, max=SHORT_COUNT_MAX
    )
    heard = State(Boolean, "this tick's sample is good")
    reversion = State("1", "by which the speed reverts to its mean, in 1/s")
    learned_reversion = State("1", "likewise, as the last rehearsal says")
    pull = State("1", "the same on this tick: 0 at rest or without a sample")
    rehearsing = State(Boolean, "a rehearsal goes on")
    rehearsed = State("m/s", "speeds of the rehearsed outage, brisk and long", size=2)
    rehearsed_from = State("m/s", "speed at which it began")
    rehearsed_ticks = State(Integer, "since it began", min=0, max=SHORT_COUNT_MAX)
    brisk_bias = State("m/s2", "what the brisk one takes off the acceleration")
    long_bias = State("m/s2", "with which the long one would have ended right: the accelerometer's bias")
    long_bias_sd = State("m/s2", "its standard deviation")
    rehearsals = State(Integer, "that counted", min=0, max=SHORT_COUNT_MAX)
    rehearsal_errors = State("1", "their mean square errors in (m/s)2, brisk and long", size=2)
    force_mean = State("m/s2", "over still_time", size=3)
    rate_mean = State("rad/s", "over still_time", size=3)
    force_motion = State("1", "mean square deviation from it, in (m/s2)2")
    rate_motion = State("1", "likewise, in (rad/s)2")
    least_force_motion = State("1", "least seen while moving", start=UNMOVED)
    least_rate_motion = State("1", "least seen while moving", start=UNMOVED)
    fix_variance = State("1", "of the last fix's position, as believed, in m2")
    sure_speed = State("m/s", "of the last fixes, less two of its deviations")
    seen_moving = State(Boolean, "they tell of motion")
    last_force = State("m/s2", "forward, of the last sample")
    last_rate = State("rad/s", "about down, of the last sample")
    moving_fixes = State(Integer, "of a moving body so far", min=0, max=SHORT_COUNT_MAX)
    still = State(Boolean, "the body rests")

    def initialize(m) -> None:
        """Nothing is learned yet."""
        m.slip_covariance = m._initial_slip_covariance()
        m._forget_rehearsals()

    def listen(m) -> None:
        """Take the sample if all its values are good; else hold speed and course, and count it."""
        learned = m.sigma
        super().listen()
        m.sigma = learned
        m.rehearsed_ticks = counted(m.rehearsed_ticks, most=SHORT_COUNT_MAX)

    def _listen(m, good: SX) -> None:
        sine_pitch, cosine_pitch = ca.sin(m.pitch_meas), ca.cos(m.pitch_meas)
        sine_roll, cosine_roll = ca.sin(m.roll_meas), ca.cos(m.roll_meas)
        # specific force and turn rate in the level: gravity has no part in it
        across = sine_roll * m.accel_y + cosine_roll * m.accel_z
        forward = cosine_pitch * m.accel_x + sine_pitch * across
        right = cosine_roll * m.accel_y - sine_roll * m.accel_z
        upright = where(cosine_pitch > 0.1, cosine_pitch, 0.1)
        m.yaw_rate = where(good, (sine_roll * m.gyro_y + cosine_roll * m.gyro_z) / upright, m.yaw_rate)
        slip = where(m.use_slip, m.slip[OFFSET] + m.slip[LEAD] * m.yaw_rate, 0)
        m.beta = where(good, m._as_slip(slip), m.beta)
        # along the course; of at most 1 rad, the series err by 0.01
        square = m.beta**2
        along = forward * (1 - square * (1 / 2 - square / 24)) + right * m.beta * (1 - square / 6)
        m.acceleration = where(good, along, m.x[BIAS])
        m.pull = where(good, m.reversion, 0)
        m.heard = good
        m.still = 0  # `feel` says so anew on every good sample
        m._hold_heading(good)

    @before("predict")
    @triggered("heard")
    def imagine(m) -> None:
        """The rehearsed outage goes on: two speeds without fixes, of one beginning (ours)."""
        brisk, long = m.rehearsed[BRISK], m.rehearsed[LONG]
        pull = ca.vertcat(brisk / m.reversion_time, (long - m.rehearsed_from) / m.long_reversion_time)
        bias = ca.vertcat(m.brisk_bias, m.long_bias)
        m.rehearsed = m.rehearsed + (m.acceleration - bias - pull) * m.sample_time

    @before("predict")
    @triggered("heard")
    def feel(m) -> None:
        """Does the body rest? Then it moves less than it ever did while fixes told of motion.

        A sensor that repeats its sample exactly is stuck: its quiet tells of no rest.
        """
        part = m.sample_time / at_least(m.still_time, m.sample_time)
        force = ca.vertcat(m.accel_x, m.accel_y, m.accel_z) - m.force_mean
        rate = ca.vertcat(m.gyro_x, m.gyro_y, m.gyro_z) - m.rate_mean
        m.force_mean, m.rate_mean = m.force_mean + part * force, m.rate_mean + part * rate
        m.force_motion = m.force_motion + part * (ca.sumsqr(force) - m.force_motion)
        m.rate_motion = m.rate_motion + part * (ca.sumsqr(rate) - m.rate_motion)
        known = all_of(m.use_stillness, m.moving_fixes >= SETTLED)
        seen_moving = all_of(m.age * m.sample_time < FRESH, m.seen_moving)
        m.still = all_of(
            known,
            ca.logic_not(seen_moving),
            m.accel_x != m.last_force,
            m.gyro_z != m.last_rate,
            any_of(
                m.force_motion < m.still_share * m.least_force_motion,
                m.rate_motion < m.still_share * m.least_rate_motion,
            ),
            m.force_motion < 2 * m.least_force_motion,
            m.rate_motion < 2 * m.least_rate_motion,
        )
        m.last_force, m.last_rate = m.accel_x, m.gyro_z
        m.pull = where(m.still, 0, m.pull)

    def _propagate(m) -> tuple[SX, SX]:
        """Along the course, a Gauss-Markov process: V' = a - b - (V - mean) / T.

        Bias and mean cannot be told apart by V, and are one state: V' = a - (b - mean / T) - V / T.
        """
        time = m.sample_time
        course = m.held_heading + m.beta
        cosine, sine = ca.cos(course), ca.sin(course)
        turned = time * m.pull
        kept = 1 - turned * (1 - 0.5 * turned)  # exp(-turned)
        driven = where(m.pull > 0, time * (1 - 0.5 * turned), 0)
        row = ca.horzcat(kept, -driven, 0, 0)
        speed = kept * m.x[SPEED] + driven * (m.acceleration - m.x[BIAS])
        transition = ca.SX.eye(4)
        transition[SPEED, :] = row
        way = 0.5 * time * (row + ca.SX.eye(4)[SPEED, :])  # of the mean of the speeds before and after
        transition[NORTH, :] += cosine * way
        transition[EAST, :] += sine * way
        step = 0.5 * time * (m.x[SPEED] + speed)
        return ca.vertcat(speed, m.x[BIAS], m.x[NORTH] + step * cosine, m.x[EAST] + step * sine), transition

    def _process_noise(m) -> list[SX]:
        """That of a constant error of the course makes the variance grow with the square of the way."""
        time = m.sample_time
        aside = (m.held_heading_sd * m.x[SPEED] * time) ** 2 * (2 * m.age)
        position = m.sigma_position**2 + aside
        mean = MEAN_SHARE * (m.sigma * m.reversion) ** 2 * time
        return [m.sigma**2 * time, m.sigma_bias**2 + mean, position, position]

    @before("judge")
    @triggered(lambda m: all_of(m.still, m.started), "started, and the body rests")
    def rest(m) -> None:
        """Zero-velocity update: a pseudo-measurement of speed 0."""
        m._correct([Measurement(SPEED, 0, m.still_accuracy**2)])

    @before("correct")
    @triggered(
        lambda m: all_of(m.accepted, m.heard, m.within("gps_course"), m.gps_speed > m.moving_speed),
        "an accepted fix tells the course of a moving body, whose sample is good",
    )
    def slide(m) -> None:
        """Slip: course = heading + offset + lead * yaw rate, of a unit ahead of the turning axis (B.4)."""
        elapsed = m.age * m.sample_time
        walk = [m.slip_offset_walk**2 * elapsed, m.slip_lead_walk**2 * elapsed]
        off = wrap(m.gps_course - m.held_heading - m.beta)
        step = (
            Factors.unpack(m.slip_covariance, 2)
            .predict(ca.SX.eye(2), walk)
            .correct(
                {OFFSET: 1.0, LEAD: m.yaw_rate},
                m.slip_noise**2 + m._speed_variance() / m.gps_speed**2,
                m._as_slip(off),
            )
        )
        offset, lead = (m.slip[i] + step.increments[i] for i in (OFFSET, LEAD))
        m.astray = where(ca.fabs(off) > m.max_heading_sd, counted(m.astray, most=SHORT_COUNT_MAX), 0)
        m.slip, m.slip_covariance = ca.vertcat(m._as_slip(offset), lead), step.factors.pack()

    @before("correct")
    @triggered(lambda m: all_of(m.accepted, m.gps_speed > m.moving_speed), "an accepted fix of a moving body")
    def move(m) -> None:
        """Remember the least motion that the inertial sensors feel of a moving body."""
        m.moving_fixes = counted(m.moving_fixes, most=SHORT_COUNT_MAX)
        rise = where(m.gps_speed < SLOW, FORGET_QUIET, 1)
        m.least_force_motion = at_most(m.force_motion, rise * m.least_force_motion)
        m.least_rate_motion = at_most(m.rate_motion, rise * m.least_rate_motion)

    @before("correct")
    @triggered(
        lambda m: all_of(
            m.accepted, m.rehearsing, lasted(m.rehearsed_ticks, m.rehearsal_time, m.sample_time)
        ),
        "an accepted fix ends a rehearsal",
    )
    def compare(m) -> None:
        """How far off would each of the two speeds be now? By that, choose one and the process noise."""
        lasting = m.rehearsed_ticks * m.sample_time
        counts = all_of(
            lasting < m.rehearsal_time + LATE,
            any_of(m.gps_speed > m.moving_speed, m.rehearsed_from > m.moving_speed),
        )
        error = m.gps_speed - m.rehearsed
        m.rehearsals = where(counts, counted(m.rehearsals, most=SHORT_COUNT_MAX), m.rehearsals)
        part = where(counts, at_least(1 / (m.rehearsals + DOUBTED), 1 / REHEARSED), 0)
        m.rehearsal_errors = m.rehearsal_errors + part * (error**2 - m.rehearsal_errors)
        m.long_bias = m.long_bias - where(counts, LEARNED, 0) * error[LONG] / lasting
        brisk, long = m.rehearsal_errors[BRISK], m.rehearsal_errors[LONG]
        trusted = all_of(m.rehearse, long * m.rehearsal_margin < brisk)
        m.learned_reversion = 1 / where(trusted, m.long_reversion_time, m.reversion_time)
        m.long_bias_sd = ca.sqrt(long) / m.rehearsal_time
        seen = at_least(where(trusted, long, brisk), (LEAST_ERROR * m.speed_sd_floor) ** 2)
        m.sigma = where(m.rehearse, ca.sqrt(SHORT_NOISE * seen / m.rehearsal_time), m.sigma_constant)
        m.rehearsing = 0

    @before("correct")
    @triggered(lambda m: m.learned_reversion != m.reversion, "another reversion is learned", seldom=True)
    def switch(m) -> None:
        """Revert by the other time: the mean speed is about the speed, the bias that of the rehearsals."""
        bias = m.long_bias - m.learned_reversion * m.x[SPEED]
        variance = m.long_bias_sd**2 + m.initial_speed_variance * m.learned_reversion**2
        m.x = ca.vertcat(m.x[SPEED], bias, m.x[NORTH], m.x[EAST])
        m.covariance = m._factors().replaced(BIAS, variance).pack()
        m.reversion = m.learned_reversion

    @before("output")
    @triggered(lambda m: all_of(m.started, m.age < 1), "a fix that was accepted or begun at")
    def mark(m) -> None:
        """Remember how well the receiver knows the place, and whether it tells of motion."""
        m.fix_variance = m._position_variance()
        sure = m.gps_speed - SURE * m.gps_s_acc
        m.sure_speed = m.sure_speed + (sure - m.sure_speed) * (1 / SPEEDS)
        m.seen_moving = any_of(m.sure_speed > 0, m.gps_speed > m.moving_speed)

    @before("output")
    @triggered(
        lambda m: all_of(m.started, m.age < 1, ca.logic_not(m.rehearsing)), "a fix, and nothing is rehearsed"
    )
    def begin(m) -> None:
        """Begin a rehearsal at the estimate."""
        m.rehearsed = ca.vertcat(m.x[SPEED], m.x[SPEED])
        m.rehearsed_from = m.x[SPEED]
        m.brisk_bias = m.x[BIAS] + (m.reversion - 1 / m.reversion_time) * m.x[SPEED]
        m.rehearsed_ticks = 0
        m.rehearsing = 1

    def output(m) -> None:
        """The estimate for this tick; the bias is that of the rehearsals, in which the mean has no part."""
        super().output()
        m.accel_bias, m.accel_bias_sd = m.long_bias, m.long_bias_sd

    def _heading(m) -> tuple[SX, SX]:
        """The heading is unknown, too, where the courses contradict it."""
        heading, deviation = super()._heading()
        return heading, where(m.astray >= ASTRAY, ANY, deviation)

    def _stated_variances(m) -> tuple[SX, SX, SX, SX]:
        """What is common to all fixes, no filter finds: at most the variance of one, beside that of P."""
        speed, bias, north, east = super()._stated_variances()
        return speed, bias, north + m.fix_variance, east + m.fix_variance

    def _begin(m) -> dict[int, tuple[SX, SX]]:
        """The mean speed is that of the fix; what was learned of the carrier is given up if it did not help.

        The rehearsals, whose speeds come from the state that has failed, begin anew in any case.
        """
        m._forget_rehearsals()
        m.long_bias = where(m.renewed, 0, m.long_bias)
        m.slip = where(m.renewed, 0, m.slip)
        m.slip_covariance = where(m.renewed, m._initial_slip_covariance(), m.slip_covariance)
        m.moving_fixes = where(m.renewed, 0, m.moving_fixes)
        m.least_force_motion = where(m.renewed, UNMOVED, m.least_force_motion)
        m.least_rate_motion = where(m.renewed, UNMOVED, m.least_rate_motion)
        bias = m.long_bias - m.reversion * m.gps_speed
        return {**super()._begin(), BIAS: (bias, m.initial_bias_variance)}

    def _as_slip(m, angle: SX) -> SX:
        return clip(angle, -m.largest_slip, m.largest_slip)

    def _initial_slip_covariance(m) -> SX:
        return Factors.diagonal([m.initial_slip_offset**2, m.initial_slip_lead**2]).pack()

    def _forget_rehearsals(m) -> None:
        m.rehearsing = m.rehearsals = 0
        m.reversion = m.learned_reversion = 1 / m.reversion_time
        m.long_bias_sd = ca.sqrt(m.initial_bias_variance)
        m.sigma = m.sigma_constant
        m.rehearsal_errors = ca.vertcat(1, 1) * (m.sigma**2 / SHORT_NOISE * m.rehearsal_time)
