"""The second estimator: a magnetometer gives heading too, and scale factors correct the IMU (Appendix C)."""

from __future__ import annotations

from models.estimator import BIAS, SPEED
from models.kit import casadi as ca
from models.kit.block import before, triggered
from models.kit.declaration import SX, Boolean, Input, Integer, Parameter, State
from models.kit.ekf import UNUSED, Measurement
from models.kit.geometry import COUNT_MAX, all_of, counted, where
from models.kit.units import DEG
from models.six_state import EAST, GYRO_BIAS, HEADING, NORTH, SixState

MAG_BIAS = 6  # behind the six states of eq. B.1, eq. C.5

# Table C.1, C.9 and C.11: what is different for a dog and a person; the parameters start at the dog's
TUNINGS: dict[str, dict[str, float]] = {
    "canine": {
        "sigma_constant": 550, "sigma_bias": 8, "sigma_mag_bias": 0.1, "mag_heading_noise": 10,
        "initial_bias_variance": 10, "initial_heading_variance": 1e4,
    },
    "pedestrian": {
        "sigma_constant": 175, "sigma_bias": 25, "sigma_mag_bias": 0.001, "mag_heading_noise": 0.1,
        "initial_bias_variance": 1, "initial_heading_variance": 1e3,
    },
}  # fmt: skip


class SevenState(SixState):
    """Seven-state EKF: the six states, and the bias of the magnetometer's heading."""

    source = "Miller 2010, eq. C.1-C.11"
    order = (NORTH, EAST, SPEED, HEADING, BIAS, GYRO_BIAS, MAG_BIAS)
    magnetic = ("mag_x", "mag_y", "mag_z", "roll_meas", "pitch_meas")

    mag_x = Input("T", "magnetic field, forward", min=-1e-3, max=1e-3)
    mag_y = Input("T", "magnetic field, right", min=-1e-3, max=1e-3)
    mag_z = Input("T", "magnetic field, down", min=-1e-3, max=1e-3)
    roll_meas = Input("rad", "roll from the AHRS, right side down positive", min=-7, max=7)
    pitch_meas = Input("rad", "pitch from the AHRS, nose up positive", min=-4, max=4)

    accel_scale = Parameter("1", "scale factor of the accelerometer (eq. C.1)", start=0.95, min=0.1, max=10)
    gyro_scale = Parameter("1", "scale factor of the gyroscope (eq. C.2)", start=0.9, min=0.1, max=10)
    use_magnetometer = Parameter(Boolean, "correct the heading by the magnetometer on every tick", start=1)
    # ours: the text takes the field as it lies in the body's axes
    level_magnetometer = Parameter(Boolean, "turn the field into the level by roll and pitch", start=1)
    declination = Parameter(
        "rad", "declination, east positive (CHOICES.md 11)", start=-3.5 * DEG, min=-4, max=4
    )
    sigma_constant = Parameter(
        "m/s2", "process noise of the speed, each tick (Table C.1)", start=550, min=0, max=1e4
    )
    sigma_bias = Parameter("m/s2", "random walk of the bias per tick (Table C.1)", start=8, min=0, max=1e3)
    sigma_heading = Parameter(
        "rad/s", "process noise of the heading, each tick (eq. C.10)", start=0.08, min=0, max=1e2
    )
    sigma_gyro_bias = Parameter(
        "rad/s", "random walk of the gyro's bias per tick (eq. C.10)", start=1e-6, min=0, max=1e2
    )
    sigma_mag_bias = Parameter(
        "rad", "random walk of the magnetometer's bias per tick (Table C.1)", start=0.1, min=1e-9, max=1e2
    )
    mag_heading_noise = Parameter(
        "rad", "deviation of the magnetometer's heading (eq. C.9)", start=10, min=1e-3, max=1e2
    )
    course_noise = Parameter(
        "1", "deviation of the course [rad] times speed [m/s] (eq. C.9)", start=0.1, min=1e-3, max=1e3
    )
    initial_bias_variance = Parameter("1", "of P0, in (m/s2)^2 (eq. C.11)", start=10, min=1e-9, max=1e6)
    initial_heading_variance = Parameter("1", "of P0, in rad^2 (eq. C.11)", start=1e4, min=1e-9, max=1e6)
    initial_gyro_bias_variance = Parameter("1", "of P0, in (rad/s)^2 (eq. C.11)", start=10, min=1e-9, max=1e6)

    # ours: with Table C.1 the bias follows each fix, and the speed strays by metres a second until the next
    gate = Parameter(
        "1", "a fix farther off than this many nominal deviations is rejected", start=100, min=0, max=1e6
    )

    x = State("1", "speed, bias, heading, gyro bias, north, east, magnetometer bias (eq. C.5)", size=7)
    covariance = State(
        "1",
        "UD factors of P for north, east, speed, heading, the three biases: D, then U by rows",
        size=28,
    )

    bad_fields = State(Integer, "magnetic fields skipped for values out of range", max=COUNT_MAX)

    def _listen(m, good: SX) -> None:
        m.acceleration = where(good, m.accel_scale * m.accel_x, m.x[BIAS])  # eq. C.1
        m.turn_rate = where(good, m.gyro_scale * m.gyro_z, m.x[GYRO_BIAS])  # eq. C.2

    @before("judge")
    @triggered(lambda m: all_of(m.started, m.use_magnetometer), "`started`, `use_magnetometer`")
    def correct_heading(m) -> None:
        """Measurement update by the magnetometer's heading (eq. C.3, C.4, C.7)."""
        good = m.within(*m.magnetic)
        there = all_of(good, m.mag_x**2 + m.mag_y**2 + m.mag_z**2 > 0)  # no field where no magnetometer is
        heading = where(there, m._magnetic_heading() + m.declination, 0)
        variance = where(there, m.mag_heading_noise**2, UNUSED)
        m._correct([Measurement({HEADING: 1, MAG_BIAS: 1}, heading, variance, angle=True)])
        m.bad_fields = counted(m.bad_fields, ca.logic_not(good))

    def _magnetic_heading(m) -> SX:
        """Clockwise from magnetic north [rad] (eq. C.3, CHOICES.md 11)."""
        roll, pitch = (where(m.level_magnetometer, angle, 0) for angle in (m.roll_meas, m.pitch_meas))
        right = ca.cos(roll) * m.mag_y - ca.sin(roll) * m.mag_z
        down = ca.sin(roll) * m.mag_y + ca.cos(roll) * m.mag_z
        return ca.atan2(-right, ca.cos(pitch) * m.mag_x + ca.sin(pitch) * down)

    def _after_a_tick(m) -> SX:
        return ca.vertcat(super()._after_a_tick(), m.x[MAG_BIAS])  # a random walk, eq. B.4

    def _process_noise(m) -> list[SX]:
        return [*super()._process_noise(), m.sigma_mag_bias**2]  # eq. C.8

    def _begin(m) -> dict[int, tuple[SX, SX]]:
        return {**super()._begin(), MAG_BIAS: m._kept(MAG_BIAS, m.sigma_mag_bias**2)}  # eq. C.11
