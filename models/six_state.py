"""The first estimator: heading and the gyroscope's bias are states, GPS course corrects them (Appendix B)."""

from __future__ import annotations

from typing import ClassVar

from models.estimator import BIAS, SPEED, Estimator
from models.kit import casadi as ca
from models.kit.declaration import SX, Input, Parameter, State
from models.kit.ekf import UNUSED, Measurement, travel
from models.kit.geometry import at_least, where, wrap

HEADING, GYRO_BIAS, NORTH, EAST = 2, 3, 4, 5  # behind speed and bias in the state, eq. B.1


class SixState(Estimator):
    """Six-state EKF: speed, heading, north, east and the biases of accelerometer and gyroscope."""

    source = "Miller 2010, eq. B.1-B.13"
    north_state, east_state = NORTH, EAST
    order: ClassVar[tuple[int, ...]] = (NORTH, EAST, SPEED, HEADING, BIAS, GYRO_BIAS)
    angles = (HEADING,)
    samples = sensed = ("accel_x", "gyro_z")
    fix = (*Estimator.fix, "gps_course")

    gyro_z = Input("rad/s", "yaw rate from the IMU, clockwise positive", min=-40, max=40)
    gps_course = Input("rad", "course over ground of the fix", min=-7, max=7)

    # sigma_A is per tick (eq. B.10); that of eq. 3.16 is per square root of a second. B.12 gives ranges
    sigma_constant = Parameter(
        "m/s2", "process noise of the speed, each tick (B.12: 0.01-0.3)", start=0.3, min=0, max=1e4
    )
    sigma_bias = Parameter("m/s2", "random walk of the bias per tick (eq. B.12)", start=1e-10, min=0, max=1e3)
    sigma_heading = Parameter(
        "rad/s", "process noise of the heading, each tick (B.12: 0.009-0.02)", start=0.02, min=0, max=1e2
    )
    sigma_gyro_bias = Parameter(
        "rad/s", "random walk of the gyro's bias per tick (eq. B.12)", start=1e-10, min=0, max=1e2
    )
    sigma_position = Parameter(
        "m", "random walk of north and east per tick (eq. B.12)", start=1e-5, min=1e-9, max=1e3
    )
    course_noise = Parameter(
        "1", "deviation of the course [rad] times speed [m/s] (eq. B.11)", start=0.5, min=1e-3, max=1e3
    )
    # ours: the text's deviation of the course is infinite at rest (CHOICES.md 10)
    course_from = Parameter("m/s", "a slower fix's course is not used", start=0.5, min=0.01, max=50)
    # eq. B.13 has the variance of the fix alone for speed and position
    initial_speed_variance = Parameter(
        "1", "of P0 beside the fix's, in (m/s)^2", start=1e-9, min=1e-9, max=1e6
    )
    initial_position_variance = Parameter(
        "1", "of P0 beside the fix's, in m^2", start=1e-9, min=1e-9, max=1e6
    )
    initial_heading_variance = Parameter("1", "of P0, in rad^2 (eq. B.13)", start=1e6, min=1e-9, max=1e6)
    initial_gyro_bias_variance = Parameter("1", "of P0, in (rad/s)^2 (eq. B.13)", start=2, min=1e-9, max=1e6)

    x = State("1", "speed, bias, heading, gyro bias, north, east (eq. B.1)", size=6)
    covariance = State(
        "1", "UD factors of P for north, east, speed, heading, bias, gyro bias: D, then U by rows", size=21
    )
    innovation = State("1", "of the last accepted fix: speed, course, north, east (eq. B.8)", size=4)
    innovation_variance = State("1", "what the filter expects of each, its variance", start=1, size=4)
    turn_rate = State("rad/s", "yaw rate with its bias; the bias alone where the sample is bad")

    def _listen(m, good: SX) -> None:
        m.acceleration = where(good, m.accel_x, m.x[BIAS])
        m.turn_rate = where(good, m.gyro_z, m.x[GYRO_BIAS])

    def _propagate(m) -> tuple[SX, SX]:
        after = m._after_a_tick()
        return after, ca.jacobian(after, m.x)  # eq. B.6, integrated over the tick

    def _after_a_tick(m) -> SX:
        time = m.sample_time
        acceleration = m.acceleration - m.x[BIAS]  # eq. B.2
        rate = m.turn_rate - m.x[GYRO_BIAS]  # eq. B.3
        north, east = travel(m.x[SPEED], acceleration, m.x[HEADING], rate, time)  # eq. B.5
        return ca.vertcat(
            m.x[SPEED] + acceleration * time,
            m.x[BIAS],  # the biases are random walks, eq. B.4
            m.x[HEADING] + rate * time,
            m.x[GYRO_BIAS],
            m.x[NORTH] + north,
            m.x[EAST] + east,
        )

    def _process_noise(m) -> list[SX]:
        deviations = (
            m.sigma, m.sigma_bias, m.sigma_heading, m.sigma_gyro_bias, m.sigma_position, m.sigma_position,
        )  # fmt: skip
        return [deviation**2 for deviation in deviations]  # eq. B.10

    def _measurements(m) -> list[Measurement]:
        speed, *position = super()._measurements()
        return [speed, Measurement(HEADING, m.gps_course, m._course_variance(), angle=True), *position]

    def _begin(m) -> dict[int, tuple[SX, SX]]:
        moves = m.gps_speed >= m.course_from
        heading, variance = m._kept(HEADING, m.initial_heading_variance)
        return {
            **super()._begin(),
            HEADING: (
                where(moves, wrap(m.gps_course), heading),
                where(moves, m._course_variance(), variance),
            ),
            GYRO_BIAS: m._kept(GYRO_BIAS, m.initial_gyro_bias_variance),
        }

    def _facing(m) -> SX:
        return m.x[HEADING]

    def _heading(m) -> tuple[SX, SX]:
        return m.x[HEADING], ca.sqrt(m._factors().variance(HEADING))

    def _course_variance(m) -> SX:
        """Of the fix's course as a measurement of the heading: side slip is taken for zero (B.3)."""
        deviation = m.course_noise / at_least(m.gps_speed, m.course_from)  # eq. B.11
        return where(m.gps_speed >= m.course_from, deviation**2, UNUSED)
