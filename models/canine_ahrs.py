"""The attitude reference on board, from raw inertial samples: the Canine AHRS that 6.2 asks for.

All of it is ours. `down` is the direction of gravity in the body. The gyroscopes turn it, and the specific
force draws it back by a linear correction: swings of a stride average out exactly, and what an acceleration
of the carrier tilts is gain / g times the change of its velocity. Fixes tell that change, and it is taken
out: speed times yaw rate on every tick, and the change of speed when the next fix tells it. A correction of
a fixed length, such as Madgwick's, swallows acceleration instead.
"""

from __future__ import annotations

from models.earth import GRAVITY
from models.inertial import Inertial
from models.kit import casadi as ca
from models.kit.block import triggered
from models.kit.declaration import SX, Boolean, Input, Integer, Output, Parameter, State
from models.kit.geometry import (
    COUNT_MAX,
    LONGEST,
    SHORT_COUNT_MAX,
    all_of,
    any_of,
    clip,
    counted,
    where,
    wrap,
)
from models.kit.units import DEG

ALONE_S = 1.5  # s after a fix, from which on the acceleration forward is not known
WINDOW = 25  # samples, about 1 s: over them the samples of a body at rest have one mean
QUIET_RATE, QUIET_FORCE = 1e-6, 1e-6  # (rad/s)2, g2: noise of 0.06 deg/s, 0.01 m/s2, if there is none
LOUDER = 1.01  # a window: a variance of the noise may double in 70 s, as a sensor warms up
BIAS_WINDOWS = 10  # windows at rest over which the bias is averaged
UPRIGHT = 0.03  # least square of the cosine of pitch, 80 deg: beyond it the heading is ill defined
UNKNOWN = 1e6  # variance of the heading before the first course, in those of a course
SLIP = 0.5  # rad between body and course, deviation: what a course is off by, however accurate its speed
UNSURE = 2.0  # m/s: a larger speed is a motion, even of a receiver that states less accuracy
LEARNING = 0.5  # a course that counts for more finds the heading, and says nothing of the gyro's bias
LEAST_FIELD = 1e-6  # T: the earth's is at least 2e-5; a magnetometer that is missing gives none


class CanineAhrs(Inertial):
    """Attitude reference: roll, pitch, heading and gyro bias from raw samples and fixes."""

    source = "Miller 2010, 6.2, eq. C.3; equations of ours"
    precisions = ("double", "float")
    sensed = ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z")

    accel_x = Input("m/s2", "specific force, forward", min=-200, max=200)
    accel_y = Input("m/s2", "specific force, right", min=-200, max=200)
    accel_z = Input("m/s2", "specific force, down", min=-200, max=200)
    gyro_x = Input("rad/s", "turn rate about forward, mean since the last tick", min=-100, max=100)
    gyro_y = Input("rad/s", "turn rate about right, mean since the last tick", min=-100, max=100)
    gyro_z = Input("rad/s", "turn rate about down, mean since the last tick", min=-100, max=100)
    mag_x = Input("T", "magnetic field, forward", start=0, min=-1e-3, max=1e-3)
    mag_y = Input("T", "magnetic field, right", start=0, min=-1e-3, max=1e-3)
    mag_z = Input("T", "magnetic field, down", start=0, min=-1e-3, max=1e-3)
    gps_fix = Input(Boolean, "a fix arrived on this tick", start=0)
    gps_speed = Input("m/s", "ground speed of the fix", start=0, min=0, max=100)
    gps_course = Input("rad", "course over ground of the fix", start=0, min=-7, max=7)
    gps_s_acc = Input("m/s", "speed accuracy stated by the receiver", start=0, min=0, max=1e6)

    roll_meas = Output("rad", "roll, right side down positive")
    pitch_meas = Output("rad", "pitch, nose up positive")
    heading_meas = Output("rad", "heading, clockwise from true north; from an arbitrary zero until aligned")
    heading_meas_sd = Output("rad", "standard deviation of the heading, 500 rad until it is aligned")
    gyro_bias_x = Output("rad/s", "gyro bias, forward")
    gyro_bias_y = Output("rad/s", "gyro bias, right")
    gyro_bias_z = Output("rad/s", "gyro bias, down")

    gain = Parameter("1", "of gravity's correction by the specific force, in 1/s", start=0.04, min=0, max=25)
    alone_share = Parameter(
        "1", "of the gain, where fixes have stopped and the bias is known", start=0.25, min=0, max=1
    )
    heading_gain = Parameter("1", "of the heading's correction, in 1/s", start=0.1, min=0, max=25)
    bias_gain = Parameter(
        "1", "of the bias by these corrections before the first rest, in 1/s", start=0.01, min=0, max=1
    )
    use_magnetometer = Parameter(Boolean, "align the heading by the magnetometer, not by courses", start=0)
    start_by_magnetometer = Parameter(Boolean, "it shows the heading as long as no course has", start=1)
    declination = Parameter("rad", "of the magnetic field, east positive", start=0, min=-4, max=4)
    moving_speed = Parameter(
        "m/s",
        "faster than this and the stated accuracy, it is not at rest; its course is used",
        start=0.5,
        min=0,
        max=50,
    )
    hold_time = Parameter("s", "the speed of an older fix is not used", start=15, min=0, max=1e6)
    lost_time = Parameter(
        "s", "without samples for longer, speed and heading are lost", start=0.25, min=0, max=LONGEST
    )
    start_time = Parameter(
        "s", "over which the first force is averaged, moving or not", start=2, min=0, max=LONGEST
    )
    rest_rate = Parameter("rad/s", "largest deviation of the turn rate at rest", start=0.05, min=0, max=1e2)
    rest_noise = Parameter(
        "1", "largest deviations at rest, by those when it was quietest", start=2, min=1, max=1e3
    )
    largest_bias = Parameter("rad/s", "of a gyro on an axis", start=3 * DEG, min=0, max=1e2)

    down = State("1", "gravity's direction: the mean specific force, reversed, in g", size=3)
    yaw = State("rad", "heading of the body")
    bias = State("rad/s", "gyro bias", size=3)
    rate = State("rad/s", "turn rate of the last good sample, without bias", size=3)
    innovation = State("1", "specific force less known acceleration, reversed, in g, less `down`", size=3)
    correction = State("1", "part of the innovation that is taken on a tick", start=1)
    share = State("1", "part of the correction that is in force", start=1)
    averaged = State(Integer, "samples in the average of the first force", min=0, max=SHORT_COUNT_MAX)
    settled = State(Boolean, "the first force is averaged")
    heading_variance = State("1", "of the heading, in variances of a course", start=UNKNOWN)
    good = State(Boolean, "this tick's inertial sample is good")
    missed = State(Integer, "bad samples in a row", min=0, max=SHORT_COUNT_MAX)
    speed = State("m/s", "of the last good fix; 0 if it is too old")
    moving = State(Boolean, "the last good fix shows that it moves")
    age = State(Integer, "ticks since the last good fix", start=COUNT_MAX, max=COUNT_MAX)
    gap = State(Integer, "ticks between the last two good fixes", start=COUNT_MAX, max=COUNT_MAX)
    samples = State(Integer, "samples in the window", min=0, max=WINDOW)
    rate_sum = State("rad/s", "turn rates in the window", size=3)
    rate_squares = State("1", "their squares, in (rad/s)2")
    force_sum = State("1", "innovations in the window", size=3)
    force_squares = State("1", "their squares")
    judged = State(Boolean, "the window was judged on this tick")
    resting = State(Boolean, "at rest in the last window")
    moved = State(Boolean, "not all windows were at rest")
    rested = State(Integer, "windows at rest so far", min=0, max=SHORT_COUNT_MAX)
    quiet_rate = State("1", "least variance of the turn rate in a window, in (rad/s)2", start=1)
    quiet_force = State("1", "least variance of the force in a window, in g2", start=1)
    bad_samples = State(Integer, "inertial samples skipped", max=COUNT_MAX)
    bad_fields = State(Integer, "magnetic fields skipped", max=COUNT_MAX)
    bad_fixes = State(Integer, "fixes skipped for values out of range", max=COUNT_MAX)

    def listen(m) -> None:
        """Is the sample good? Else the attitude is held, and the sample counted."""
        m.good = m._take(*m.sensed)
        m.bad_samples = counted(m.bad_samples, ca.logic_not(m.good))
        m.missed = where(m.good, 0, counted(m.missed, most=SHORT_COUNT_MAX))
        lost = m.missed * m.sample_time > m.lost_time
        m.heading_variance = where(lost, UNKNOWN, m.heading_variance)
        m.age = where(lost, COUNT_MAX, counted(m.age))
        m.speed = where(m.age * m.sample_time > m.hold_time, 0, m.speed)
        m.moving = all_of(m.moving, m.age * m.sample_time <= m.hold_time)
        alone = all_of(m.age * m.sample_time > ALONE_S, m.age * m.sample_time <= m.hold_time, m.rested > 0)
        m.share = where(alone, m.alone_share, 1)
        m.judged = 0

    @triggered(lambda m: all_of(m.good, ca.logic_not(m.settled)), "a good sample, until `settled`")
    def settle(m) -> None:
        """Average the first force as long as no unknown acceleration is in it, at least over `start_time`."""
        m.averaged = counted(m.averaged, most=SHORT_COUNT_MAX)
        least = m.gain * m.sample_time
        early = m.averaged * m.sample_time < m.start_time
        known = any_of(ca.logic_not(m.moved), m.age * m.sample_time <= m.hold_time)
        averaging = all_of(m.averaged * least < 1, any_of(early, known))
        m.correction = where(averaging, 1 / m.averaged, least)  # a running mean, turned along
        m.settled = ca.logic_not(averaging)

    @triggered("good")
    def turn(m) -> None:
        """Turn gravity and heading by the gyro, then correct gravity by the specific force."""
        rate = ca.vertcat(m.gyro_x, m.gyro_y, m.gyro_z) - m.bias
        m.rate = rate
        half = (0.5 * m.sample_time) * rate  # of the angle turned: a sample is the mean over its tick
        # a rotation by 2 atan(|half|), which keeps the length at any rate (Cayley)
        middle = m.down + ca.cross(m.down, half)
        down = m.down + 2 / (1 + ca.sumsqr(half)) * ca.cross(middle, half)
        # the rate of Euler's heading, half way: (q sin(roll) + r cos(roll)) / cos(pitch)
        upright = middle[1] ** 2 + middle[2] ** 2
        turned = 2 * (half[1] * middle[1] + half[2] * middle[2]) / where(upright > UPRIGHT, upright, UPRIGHT)
        m.yaw = m.yaw + turned
        # the force is acceleration less gravity, and the acceleration sideways is speed times yaw rate
        force = ca.vertcat(m.accel_x, m.accel_y, m.accel_z) * (-1 / GRAVITY)
        sideways = m.speed * turned * (1 / (GRAVITY * m.sample_time))
        m.innovation = force + ca.vertcat(0, sideways, 0) - down
        m.down = down + m.share * m.correction * m.innovation

    @triggered("gps_fix")
    def hear(m) -> None:
        """A fix: take out what the change of speed has tilted since the one before it."""
        good = m.within("gps_speed", "gps_course", "gps_s_acc")
        m.bad_fixes = counted(m.bad_fixes, ca.logic_not(good))
        known = all_of(good, m.age * m.sample_time <= m.hold_time)
        forward = where(known, (m.gps_speed - m.speed) * (1 / (GRAVITY * m.sample_time)), 0)
        m.down = m.down + ca.vertcat(m.share * m.correction * forward, 0, 0)
        m.force_sum = m.force_sum + ca.vertcat(forward, 0, 0)
        m.speed = where(good, m.gps_speed, m.speed)
        sure = m.moving_speed + where(m.gps_s_acc < UNSURE, m.gps_s_acc, UNSURE)
        m.moving = where(good, m.gps_speed > sure, m.moving)
        m.gap = where(good, m.age, m.gap)
        m.age = where(good, 0, m.age)

    @triggered(
        lambda m: all_of(
            m.gps_fix, m.age <= 0, m.speed > m.moving_speed, m.good, ca.logic_not(m.use_magnetometer)
        ),
        "a good fix while it moves, without `use_magnetometer`",
    )
    def align(m) -> None:
        """Turn the heading towards the course: a mean of the courses that forgets old ones."""
        noise = 1 + (m.gps_s_acc * (1 / SLIP) / m.speed) ** 2  # of a course, to that by slip
        m._correct_heading(wrap(m.gps_course - m.yaw), m.gap, noise)

    @triggered(
        lambda m: all_of(
            m.good, any_of(m.use_magnetometer, all_of(m.start_by_magnetometer, m.heading_variance >= UNKNOWN))
        ),
        "a good sample, with `use_magnetometer`, or with `start_by_magnetometer` before the first course",
    )
    def point(m) -> None:
        """Turn the heading towards that of the levelled magnetic field (eq. C.3, CHOICES.md 11)."""
        field = ca.vertcat(m.mag_x, m.mag_y, m.mag_z)
        good = all_of(m.within("mag_x", "mag_y", "mag_z"), ca.sumsqr(field) > LEAST_FIELD**2)
        m.bad_fields = counted(m.bad_fields, ca.logic_not(good))
        x, y, z = (m.down[i] for i in range(3))
        across = field[1] * z - field[2] * y  # to the right, times the length of (y, z)
        along = field[0] * (y**2 + z**2) - x * (field[1] * y + field[2] * z)  # forward, times both lengths
        magnetic = ca.atan2(-across * ca.sqrt(ca.sumsqr(m.down)), along)
        error = where(good, wrap(magnetic + m.declination - m.yaw), 0)
        m._correct_heading(error, where(good, 1, 0), 1)

    @triggered(lambda m: all_of(m.good, m._spare()), "a good sample, and no fix unless there always is one")
    def gather(m) -> None:
        """Add the sample to the window."""
        m.samples = m.samples + 1
        m.rate_sum, m.rate_squares = m.rate_sum + m.rate, m.rate_squares + ca.sumsqr(m.rate)
        m.force_sum = m.force_sum + m.innovation
        m.force_squares = m.force_squares + ca.sumsqr(m.innovation)

    @triggered(lambda m: m.samples >= WINDOW, "the window is full, about once a second")
    def judge(m) -> None:
        """Was the body at rest? Then its mean turn rate is the gyro's bias."""
        rate, force = m.rate_sum * (1 / WINDOW), m.force_sum * (1 / WINDOW)
        rate_variance = m.rate_squares * (1 / WINDOW) - ca.sumsqr(rate)
        force_variance = m.force_squares * (1 / WINDOW) - ca.sumsqr(force)
        m.quiet_rate = clip(rate_variance, QUIET_RATE, LOUDER * m.quiet_rate)
        m.quiet_force = clip(force_variance, QUIET_FORCE, LOUDER * m.quiet_force)
        m.resting = all_of(
            rate_variance <= m.rest_rate**2,
            rate_variance <= m.rest_noise**2 * m.quiet_rate,
            force_variance <= m.rest_noise**2 * m.quiet_force,
            ca.logic_not(m.moving),
            *(ca.fabs(m.bias[i] + rate[i]) <= m.largest_bias for i in range(3)),
        )
        m.moved = any_of(m.moved, ca.logic_not(m.resting))
        m.rested = counted(m.rested, m.resting, most=SHORT_COUNT_MAX)
        share = where(m.rested < BIAS_WINDOWS, 1 / where(m.rested > 1, m.rested, 1), 1 / BIAS_WINDOWS)
        m.bias = m.bias + where(m.resting, share, 0) * rate
        m.judged = 1

    @triggered(
        lambda m: all_of(m.judged, m.rested <= 0, m.averaged * m.sample_time >= m.start_time),
        "a window is judged, after `start_time` and before the first rest",
    )
    def learn(m) -> None:
        """Gravity shows a bias, too: it keeps up a tilt, which the corrections go on taking out."""
        taken = m.correction * m.force_sum
        m.bias = m._bounded(m.bias + m.bias_gain * ca.cross(m.down, taken))

    @triggered("judged")
    def empty(m) -> None:
        """Begin another window."""
        m.samples = m.rate_squares = m.force_squares = 0
        m.rate_sum = m.force_sum = ca.SX.zeros(3)

    def output(m) -> None:
        """The attitude for this tick."""
        x, y, z = (m.down[i] for i in range(3))
        m.roll_meas = ca.atan2(y, z)
        m.pitch_meas = ca.atan2(-x, ca.sqrt(y**2 + z**2))
        m.yaw = wrap(m.yaw)
        m.heading_meas = m.yaw
        m.heading_meas_sd = SLIP * ca.sqrt(m.heading_variance)
        m.gyro_bias_x, m.gyro_bias_y, m.gyro_bias_z = (m.bias[i] for i in range(3))

    def _correct_heading(m, error: SX, ticks: SX, noise: SX | float) -> None:
        """A scalar Kalman filter: in this time the variance has grown by (time * heading_gain)^2."""
        variance = m.heading_variance + (ticks * m.sample_time * m.heading_gain) ** 2
        share = variance / (noise + variance)  # 1, 1/2, 1/3 .. at first, later about time * heading_gain
        m.heading_variance = where(ticks > 0, share * noise, m.heading_variance)
        taken = share * error
        m.yaw = m.yaw + taken
        learning = all_of(m.rested <= 0, share < LEARNING)
        m.bias = m._bounded(m.bias - ca.vertcat(0, 0, where(learning, m.bias_gain, 0) * taken))

    def _bounded(m, bias: SX) -> SX:
        return ca.vertcat(*(clip(bias[i], -m.largest_bias, m.largest_bias) for i in range(3)))

    def _spare(m) -> SX:
        """Is this tick one without a fix? Not both are done on one tick, unless every tick has a fix."""
        return any_of(ca.logic_not(m.gps_fix), m.gap <= 1)
