"""The estimator on board: GPS position and speed corrected dead reckoning (Chapter 3)."""

from __future__ import annotations

from models.earth import GRAVITY
from models.estimator import BIAS, SPEED
from models.fuzzy import RUNS_FROM, noise_running, noise_walking
from models.given_heading import GivenHeading
from models.kit import casadi as ca
from models.kit.block import before, triggered
from models.kit.declaration import SX, Boolean, Input, Parameter, State
from models.kit.ekf import propagate
from models.kit.geometry import all_of, clip, where

NORTH, EAST = 2, 3  # behind speed and bias in the state, eq. 3.9


class FourState(GivenHeading):
    """Loosely coupled four-state EKF: speed, accelerometer bias, north, east from GPS, IMU and AHRS."""

    source = "Miller 2010, eq. 3.1-3.21"
    north_state, east_state = NORTH, EAST
    order = (NORTH, EAST, SPEED, BIAS)
    sensed = ("accel_x", "pitch_meas", "heading_meas")
    samples = (*sensed, "heading_meas_sd")

    pitch_meas = Input("rad", "pitch from the AHRS, nose up positive", min=-4, max=4)

    use_pitch = Parameter(Boolean, "take gravity out of the specific force by pitch (eq. 3.10)", start=1)
    fuzzy = Parameter(Boolean, "tune the process noise by speed (3.3); off: sigma_constant", start=1)
    sigma_floor = Parameter("m/s2", "least process noise when tuned", start=0.01, min=0, max=1e4)
    sigma_cap = Parameter(
        "m/s2",
        "largest process noise when tuned (ours; eq. 3.21 gives 152 at most)",
        start=1e3,
        min=0,
        max=1e4,
    )

    x = State("1", "speed, bias, north, east (eq. 3.9)", size=4)
    covariance = State("1", "UD factors of P for north, east, speed, bias: D, then U by rows", size=10)
    innovation = State("1", "of the last accepted fix: speed, north, east (eq. 3.14)", size=3)
    innovation_variance = State("1", "what the filter expects of each, its variance", start=1, size=3)

    def _listen(m, good: SX) -> None:
        gravity = where(m.use_pitch, GRAVITY * ca.sin(m.pitch_meas), 0)
        m.acceleration = where(good, m.accel_x - gravity, m.x[BIAS])  # eq. 3.10
        m._hold_heading(good)

    @before("predict")
    @triggered(
        lambda m: all_of(m.fuzzy, ca.fabs(m.x[SPEED]) < RUNS_FROM), f"`fuzzy`, slower than {RUNS_FROM:g} m/s"
    )
    def tune_walking(m) -> None:
        """Process noise by speed (eq. 3.18-3.21) of an animal that stands or walks."""
        m.sigma = clip(noise_walking(m.x[SPEED]), m.sigma_floor, m.sigma_cap)

    @before("predict")
    @triggered(
        lambda m: all_of(m.fuzzy, ca.fabs(m.x[SPEED]) >= RUNS_FROM), f"`fuzzy`, {RUNS_FROM:g} m/s or faster"
    )
    def tune_running(m) -> None:
        """Process noise by speed (eq. 3.18-3.21) of an animal that runs."""
        m.sigma = clip(noise_running(m.x[SPEED]), m.sigma_floor, m.sigma_cap)

    def _propagate(m) -> tuple[SX, SX]:
        derivative = ca.vertcat(
            m.acceleration - m.x[BIAS],  # eq. 3.10
            0,  # the bias is a random walk
            m.x[SPEED] * ca.cos(m.held_heading),  # eq. 3.11
            m.x[SPEED] * ca.sin(m.held_heading),
        )
        return propagate(m.x, derivative, m.sample_time)

    def _process_noise(m) -> list[SX]:
        position_noise = m.sigma_position**2
        return [m.sigma**2 * m.sample_time, m.sigma_bias**2, position_noise, position_noise]  # eq. 3.16
