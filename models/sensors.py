"""The sensor suite on the vest: GPS receiver, IMU, attitude reference, magnetometer (2.3, D.6)."""

from __future__ import annotations

from models.earth import GRAVITY
from models.kit import casadi as ca
from models.kit.block import Block, triggered
from models.kit.declaration import SX, Boolean, Input, Integer, Output, Parameter, State, Stream
from models.kit.geometry import COUNT_MAX, all_of, any_of, clip, counted, where, wrap
from models.kit.random import MAX_SEED, normals, uniform
from models.kit.timing import TICK, lasted
from models.kit.units import DEG

OUTAGES = 8  # time windows without GPS
UNIT = (
    *(f"{kind}_{axis}" for kind in ("accel", "gyro", "mag") for axis in "xyz"),
    *(f"{angle}_meas" for angle in ("roll", "pitch", "heading")),
)  # what the inertial unit gives


class Sensors(Block):
    """Sensor suite: GPS, IMU, AHRS and magnetometer measure the animal's motion."""

    source = "Miller 2010, 2.3, eq. C.3, D.12-D.17; multipath and the leaning AHRS: ours"

    north = Input("m", "true position")
    east = Input("m", "true position")
    speed = Input("m/s", "true ground speed")
    heading = Input("rad", "true heading, clockwise from north")
    acceleration = Input("m/s2", "true longitudinal acceleration", start=0)
    pitch = Input("rad", "true pitch, nose up positive", start=0)
    roll = Input("rad", "true roll, right side down positive", start=0)
    yaw_rate = Input("rad/s", "true yaw rate, clockwise positive", start=0)
    slip = Input("rad", "true slip: course less heading", start=0)
    slip_acceleration = Input("m/s2", "true lateral acceleration by slip, rightwards", start=0)

    accel_x = Output("m/s2", "specific force, forward")
    accel_y = Output("m/s2", "specific force, right")
    accel_z = Output("m/s2", "specific force, down")
    gyro_x = Output("rad/s", "turn rate about forward")
    gyro_y = Output("rad/s", "turn rate about right")
    gyro_z = Output("rad/s", "turn rate about down")
    mag_x = Output("T", "magnetic field, forward")
    mag_y = Output("T", "magnetic field, right")
    mag_z = Output("T", "magnetic field, down")
    roll_meas = Output("rad", "roll from the AHRS")
    pitch_meas = Output("rad", "pitch from the AHRS, nose up positive")
    heading_meas = Output("rad", "heading from the AHRS, clockwise from true north")
    gps_fix = Output(Boolean, "a fix arrived on this tick")
    gps_north = Output("m", "position of the last fix")
    gps_east = Output("m", "position of the last fix")
    gps_speed = Output("m/s", "ground speed of the last fix")
    gps_course = Output("rad", "course over ground of the last fix")
    gps_h_acc = Output("m", "the receiver's estimate of its horizontal accuracy")
    gps_s_acc = Output("m/s", "the receiver's estimate of its speed accuracy")

    seed = Parameter(Integer, "trial number: selects the random streams", start=1, min=0, max=MAX_SEED)
    noisy = Parameter(Boolean, "noise, biases and saturation; off: the sensors return the truth", start=1)
    gps_period = Parameter("s", "time between fixes (4 Hz)", start=0.25, min=TICK, max=1e3)
    # ours: D.12's white 0.1 m is the motion simulator's; a receiver that states 3.5 m (B.11) wanders
    gps_wander = Parameter("m", "slowly varying position error, standard deviation", start=1.0, min=0)
    gps_wander_time = Parameter("s", "correlation time of that error", start=60, min=0)
    gps_position_noise = Parameter("m", "white position noise, standard deviation", start=0.3, min=0)
    gps_speed_noise = Parameter("m/s", "speed noise (eq. D.12)", start=0.05, min=0)
    gps_slow_speed = Parameter("m/s", "speed below which the course noise grows no more", start=0.1, min=1e-3)
    gps_reported_h_acc = Parameter(
        "m", "horizontal accuracy that the receiver states (B.11)", start=3.5, min=0
    )
    gps_reported_s_acc = Parameter("m/s", "speed accuracy that the receiver states", start=0.1, min=0)
    outage_start = Parameter("s", "windows without GPS: from", start=0, size=OUTAGES, min=0)
    outage_end = Parameter(
        "s", "windows without GPS: until", start=0, size=OUTAGES, min=0, begins="outage_start"
    )
    # near buildings, ours: a fix by a reflected signal is off until the signal is gone; off
    multipath = Parameter("m", "position error by a reflected signal, standard deviation", start=10, min=0)
    multipath_rate = Parameter("Hz", "reflections that begin in a second", start=0, min=0, max=10)
    multipath_time = Parameter("s", "mean time that a reflection lasts", start=5, min=0, max=1e4)
    accel_noise = Parameter("m/s2", "specific force noise (eq. D.14)", start=1.0, min=0)
    accel_bias = Parameter("m/s2", "bias forward, right, down (eq. D.14)", start=(0.1, 0.1, 0.1), size=3)
    accel_limit = Parameter("m/s2", "the accelerometers saturate", start=50, min=0)
    gyro_noise = Parameter("rad/s", "turn rate noise (eq. D.13)", start=0.1 * DEG, min=0)
    gyro_bias = Parameter("rad/s", "bias forward, right, down (eq. D.13)", start=(0.1 * DEG,) * 3, size=3)
    gyro_limit = Parameter("rad/s", "the gyroscopes saturate", start=300 * DEG, min=0)
    attitude_noise = Parameter("rad", "AHRS roll and pitch noise", start=0.5 * DEG, min=0)
    heading_noise = Parameter("rad", "AHRS heading noise", start=1.0 * DEG, min=0)
    # failures, ours; off
    heading_error = Parameter(
        "rad", "error of the AHRS's heading: the mounting, the magnetic field", start=0, min=-4, max=4
    )
    frozen_start = Parameter("s", "when the inertial unit begins to repeat its sample", start=0, min=0)
    frozen_time = Parameter("s", "for how long it does", start=0, min=0)
    # an AHRS that levels itself by its accelerometers leans with them (6.2); ours, off
    attitude_lean = Parameter(
        "1", "share of the acceleration that the AHRS takes for gravity", start=0, min=0, max=1
    )
    attitude_lean_time = Parameter("s", "time constant in which it does", start=1, min=0, max=1e3)
    mag_noise = Parameter("T", "magnetometer noise", start=5e-7, min=0)
    mag_horizontal = Parameter("T", "horizontal component of the earth's field", start=2.4e-5, min=0)
    mag_down = Parameter("T", "downward component of the earth's field", start=4.3e-5)
    mag_declination = Parameter("rad", "declination, east positive", start=-3.5 * DEG)

    tick = State(Integer, "ticks since the start", max=COUNT_MAX)
    fixes = State(Integer, "fixes due so far")
    past_pitch = State("rad", "pitch a tick ago")
    past_roll = State("rad", "roll a tick ago")
    wander_north = State("m", "slowly varying position error")
    wander_east = State("m", "slowly varying position error")
    reflected_north = State("m", "position error by a reflected signal")
    reflected_east = State("m", "position error by a reflected signal")
    leaning_pitch = State("rad", "error of the AHRS's pitch by acceleration")
    leaning_roll = State("rad", "error of the AHRS's roll by acceleration")
    noise = State("1", "this tick's normal draws", size=12)
    frozen = State(Boolean, "the inertial unit repeats its sample")
    frozen_sample = State("1", "what it repeats, in the order of the outputs", size=len(UNIT))
    fixed = State(Boolean, "a fix arrived on this tick")
    fix_north = State("m", "position of the last fix")
    fix_east = State("m", "position of the last fix")
    fix_speed = State("m/s", "ground speed of the last fix")
    fix_course = State("rad", "course over ground of the last fix")
    gps_stream = Stream("GPS noise", substream=8)
    imu_stream = Stream("IMU, AHRS and magnetometer noise", substream=9)
    multipath_stream = Stream("reflected GPS signals", substream=10)

    def initialize(m) -> None:
        """Draw the slowly varying position error as it might be at any time."""
        draws, m.gps_stream = normals(m.gps_stream, 2)
        m.wander_north, m.wander_east = m.gps_wander * draws[0], m.gps_wander * draws[1]

    @triggered("noisy")
    def draw(m) -> None:
        """This tick's noise of IMU, AHRS and magnetometer."""
        draws, m.imu_stream = normals(m.imu_stream, 12)
        m.noise = ca.vertcat(*draws)

    def listen(m) -> None:
        """Begin the tick without a fix."""
        m.fixed = 0

    @triggered(
        lambda m: all_of(m.noisy, m.multipath_rate > 0, m._fix_is_due()),
        "`noisy`, `multipath_rate` is above 0, and a fix is due",
        seldom=True,
    )
    def reflect(m) -> None:
        """By chance a reflected signal takes the place of the direct one, or of another, or is gone.

        The receiver does not know: the accuracy that it states stays as it is.
        """
        begin, stream = uniform(m.multipath_stream)
        end, stream = uniform(stream)
        draws, m.multipath_stream = normals(stream, 2)
        begins = begin < m.multipath_rate * m.gps_period
        ends = end * m.multipath_time < m.gps_period
        m.reflected_north, m.reflected_east = (
            where(begins, m.multipath * draw, where(ends, 0, held))
            for draw, held in zip(draws, (m.reflected_north, m.reflected_east), strict=True)
        )

    @triggered(lambda m: m._fix_is_due(), "a fix is due, every `gps_period`")
    def fix(m) -> None:
        """The receiver's fix, on the first tick at or after its time (eq. D.12, D.15; 2.3)."""
        draws, m.gps_stream = normals(m.gps_stream, 6)
        m.fixes = m.fixes + 1
        kept = m.gps_wander_time / (m.gps_wander_time + m.gps_period)
        driven = m.gps_wander * ca.sqrt(1 - kept * kept)
        m.wander_north = kept * m.wander_north + driven * draws[0]
        m.wander_east = kept * m.wander_east + driven * draws[1]
        on = where(m.noisy, 1, 0)
        time = m.tick * m.sample_time
        m.fixed = ca.logic_not(
            any_of(*(all_of(time >= m.outage_start[i], time < m.outage_end[i]) for i in range(OUTAGES)))
        )
        north = m.north + on * (m.wander_north + m.gps_position_noise * draws[2] + m.reflected_north)
        east = m.east + on * (m.wander_east + m.gps_position_noise * draws[3] + m.reflected_east)
        speed = ca.fabs(m.speed + on * m.gps_speed_noise * draws[4])
        course_noise = m.gps_speed_noise / where(m.speed > m.gps_slow_speed, m.speed, m.gps_slow_speed)
        course = wrap(m.heading + m.slip + on * course_noise * draws[5])
        m.fix_north, m.fix_east = where(m.fixed, north, m.fix_north), where(m.fixed, east, m.fix_east)
        m.fix_speed, m.fix_course = where(m.fixed, speed, m.fix_speed), where(m.fixed, course, m.fix_course)

    def output(m) -> None:
        """The measurements: eq. D.16 and D.17 in three axes, eq. C.3 solved for the field."""
        n = [where(m.noisy, m.noise[i], 0) for i in range(12)]
        sine_pitch, cosine_pitch = ca.sin(m.pitch), ca.cos(m.pitch)
        sine_roll, cosine_roll = ca.sin(m.roll), ca.cos(m.roll)

        level = cosine_pitch * GRAVITY
        force = (
            m.acceleration + sine_pitch * GRAVITY,  # eq. D.17
            m.speed * m.yaw_rate - level * sine_roll + m.slip_acceleration,
            -level * cosine_roll,
        )
        m.accel_x, m.accel_y, m.accel_z = (
            m._sensed(force[i], m.accel_bias[i], m.accel_noise * n[i], m.accel_limit) for i in range(3)
        )

        began = m.tick > 0
        # the mean over the tick: with the angles half way, else swings of a stride turn into drift
        pitching = where(began, (m.pitch - m.past_pitch) / m.sample_time, 0)
        rolling = where(began, (m.roll - m.past_roll) / m.sample_time, 0)
        half_pitch, half_roll = (m.pitch + m.past_pitch) / 2, (m.roll + m.past_roll) / 2
        half_pitch, half_roll = where(began, half_pitch, m.pitch), where(began, half_roll, m.roll)
        level_rate = m.yaw_rate * ca.cos(half_pitch)
        rate = (
            rolling - m.yaw_rate * ca.sin(half_pitch),
            pitching * ca.cos(half_roll) + level_rate * ca.sin(half_roll),
            level_rate * ca.cos(half_roll) - pitching * ca.sin(half_roll),
        )
        m.gyro_x, m.gyro_y, m.gyro_z = (
            m._sensed(rate[i], m.gyro_bias[i], m.gyro_noise * n[3 + i], m.gyro_limit) for i in range(3)
        )

        magnetic_heading = m.heading - m.mag_declination
        forward = m.mag_horizontal * ca.cos(magnetic_heading)
        right = -m.mag_horizontal * ca.sin(magnetic_heading)
        pitched_down = sine_pitch * forward + cosine_pitch * m.mag_down
        m.mag_x = cosine_pitch * forward - sine_pitch * m.mag_down + m.mag_noise * n[6]
        m.mag_y = cosine_roll * right + sine_roll * pitched_down + m.mag_noise * n[7]
        m.mag_z = cosine_roll * pitched_down - sine_roll * right + m.mag_noise * n[8]

        m.roll_meas = m.roll + m.attitude_noise * n[9] + m.leaning_roll
        m.pitch_meas = m.pitch + m.attitude_noise * n[10] + m.leaning_pitch
        m.heading_meas = wrap(m.heading + m.heading_error + m.heading_noise * n[11])

        m.gps_fix = m.fixed
        m.gps_north, m.gps_east = m.fix_north, m.fix_east
        m.gps_speed, m.gps_course = m.fix_speed, m.fix_course
        m.gps_h_acc, m.gps_s_acc = m.gps_reported_h_acc, m.gps_reported_s_acc

    @triggered(
        lambda m: all_of(m.noisy, m.attitude_lean > 0), "`noisy`, `attitude_lean` is above 0", seldom=True
    )
    def lean(m) -> None:
        """The AHRS takes a share of the acceleration for gravity: its error follows the acceleration's tilt.

        It levels itself by what its accelerometers give, bias and saturation included.
        """
        kept = m.attitude_lean_time / (m.attitude_lean_time + m.sample_time)
        forward = m.accel_x - GRAVITY * ca.sin(m.pitch)
        right = m.accel_y + GRAVITY * ca.cos(m.pitch) * ca.sin(m.roll)
        m.leaning_pitch = kept * m.leaning_pitch + (1 - kept) * m.attitude_lean * ca.atan2(forward, GRAVITY)
        m.leaning_roll = kept * m.leaning_roll - (1 - kept) * m.attitude_lean * ca.atan2(right, GRAVITY)

    @triggered(
        lambda m: all_of(
            m.frozen_time > 0,
            m.tick * m.sample_time >= m.frozen_start,
            m.tick * m.sample_time < m.frozen_start + m.frozen_time,
        ),
        "for `frozen_time` from `frozen_start` on",
        seldom=True,
    )
    def freeze(m) -> None:
        """The inertial unit repeats the sample with which the failure began."""
        sample = where(m.frozen, m.frozen_sample, ca.vertcat(*(getattr(m, name) for name in UNIT)))
        for i, name in enumerate(UNIT):
            setattr(m, name, sample[i])
        m.frozen_sample, m.frozen = sample, 1

    def remember(m) -> None:
        """Keep pitch and roll, whose differences are rates, and count the tick."""
        m.past_pitch, m.past_roll = m.pitch, m.roll
        m.tick = counted(m.tick)

    def _fix_is_due(m) -> SX:
        """Is this the first tick at or after the next fix's time?"""
        return lasted(m.tick, m.fixes * m.gps_period, m.sample_time, tolerance=1e-6)

    def _sensed(m, truth: SX, bias: SX, noise: SX, limit: SX) -> SX:
        return where(m.noisy, clip(truth + bias + noise, -limit, limit), truth)
