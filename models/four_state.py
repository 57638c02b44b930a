"""The estimator on board: GPS position and speed corrected dead reckoning (Chapter 3)."""

from __future__ import annotations

from models.earth import GRAVITY
from models.fuzzy import RUNS_FROM, noise_running, noise_walking
from models.kit import casadi as ca
from models.kit.block import Block, triggered
from models.kit.declaration import SX, Boolean, Input, Integer, Output, Parameter, State
from models.kit.ekf import Factors, propagate
from models.kit.geometry import COUNT_MAX, all_of, any_of, counted, where, wrap
from models.kit.units import DEG

SPEED, BIAS, NORTH, EAST = range(4)  # order of the state, eq. 3.9
FACTORED = (NORTH, EAST, SPEED, BIAS)  # order of the covariance's factors: each before those it depends on


class FourState(Block):
    """Loosely coupled four-state EKF: speed, accelerometer bias, north, east from GPS, IMU and AHRS."""

    source = "Miller 2010, eq. 3.1-3.21"
    precisions = ("double", "float")

    accel_x = Input("m/s2", "longitudinal specific force from the IMU", min=-200, max=200)
    pitch_meas = Input("rad", "pitch from the AHRS, nose up positive", min=-4, max=4)
    heading_meas = Input("rad", "heading from the AHRS, clockwise from true north", min=-7, max=7)
    gps_fix = Input(Boolean, "a fix arrived on this tick")
    gps_north = Input("m", "position of the fix", min=-1e5, max=1e5)
    gps_east = Input("m", "position of the fix", min=-1e5, max=1e5)
    gps_speed = Input("m/s", "ground speed of the fix", min=0, max=50)
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
    heading_sd = Output("rad", "standard deviation of the heading, as the AHRS is trusted")
    accel_bias_sd = Output("m/s2", "standard deviation of the bias")
    sigma_accel = Output("m/s2", "process noise of the acceleration in force")
    valid = Output(Boolean, "the last accepted fix is no older than max_age")

    use_pitch = Parameter(Boolean, "take gravity out of the specific force by pitch (eq. 3.10)", start=1)
    fuzzy = Parameter(Boolean, "tune the process noise by speed (3.3); off: sigma_constant", start=1)
    sigma_constant = Parameter("m/s2", "process noise of the acceleration, not tuned (D.7)", start=0.1, min=0)
    sigma_floor = Parameter("m/s2", "least process noise when tuned", start=0.01, min=0)
    sigma_bias = Parameter("m/s2", "random walk of the bias per tick (eq. 3.16)", start=1e-3, min=0)
    sigma_position = Parameter("m", "random walk of north and east per tick (eq. 3.16)", start=1e-6, min=1e-9)
    initial_speed_variance = Parameter("1", "of P0, in (m/s)^2 (eq. 3.17)", start=0.1, min=1e-9)
    initial_bias_variance = Parameter("1", "of P0, in (m/s2)^2 (eq. 3.17)", start=1, min=1e-9)
    initial_position_variance = Parameter("1", "of P0, in m^2 (eq. 3.17)", start=0.01, min=1e-9)
    # the gate and the recovery are ours: the text accepts every fix
    gate = Parameter("1", "a fix farther off than this many nominal deviations is rejected", start=5, min=0)
    gate_speed_growth = Parameter("m/s2", "nominal growth of the speed's deviation", start=4, min=0)
    gate_position_growth = Parameter("m/s", "nominal growth of the position's deviation", start=1.5, min=0)
    recovery_fixes = Parameter(
        Integer, "fixes rejected in a row after which the filter begins anew", start=4, min=1, max=1000
    )
    max_age = Parameter("s", "a fix older than this makes the estimate invalid", start=15, min=0, max=1e6)
    heading_accuracy = Parameter("rad", "standard deviation of the AHRS's heading", start=3 * DEG, min=0)

    started = State(Boolean, "a first fix has set the state")
    x = State("1", "speed, bias, north, east (eq. 3.9)", size=4)
    covariance = State("1", "UD factors of P for north, east, speed, bias: D, then U by rows", size=10)
    acceleration = State(
        "m/s2", "longitudinal acceleration with its bias; the bias alone where the sample is bad"
    )
    held_heading = State("rad", "last good heading")
    sigma = State("m/s2", "process noise of the acceleration in force", start=0.1)
    age = State(Integer, "ticks since the last accepted fix", max=COUNT_MAX)
    good = State(Boolean, "the last fix has all its values in range")
    accepted = State(Boolean, "this tick's fix passed the gate")
    rejected = State(Integer, "fixes rejected in a row")
    bad_samples = State(Integer, "IMU or AHRS samples skipped", max=COUNT_MAX)
    bad_fixes = State(Integer, "fixes skipped for values out of range", max=COUNT_MAX)

    def listen(m) -> None:
        """Take the sample if all its values are good; else hold speed and heading, and count it."""
        good = m.within("accel_x", "pitch_meas", "heading_meas")
        gravity = where(m.use_pitch, GRAVITY * ca.sin(m.pitch_meas), 0)
        m.acceleration = where(good, m.accel_x - gravity, m.x[BIAS])  # eq. 3.10
        m.held_heading = where(good, m.heading_meas, m.held_heading)
        m.bad_samples = counted(m.bad_samples, ca.logic_not(good))
        m.age = counted(m.age)
        m.accepted = 0
        m.sigma = m.sigma_constant

    @triggered(
        lambda m: all_of(m.fuzzy, ca.fabs(m.x[SPEED]) < RUNS_FROM), f"`fuzzy`, slower than {RUNS_FROM:g} m/s"
    )
    def tune_walking(m) -> None:
        """Process noise by speed (eq. 3.18-3.21) of an animal that stands or walks."""
        m.sigma = m._at_least_floor(noise_walking(m.x[SPEED]))

    @triggered(
        lambda m: all_of(m.fuzzy, ca.fabs(m.x[SPEED]) >= RUNS_FROM), f"`fuzzy`, {RUNS_FROM:g} m/s or faster"
    )
    def tune_running(m) -> None:
        """Process noise by speed (eq. 3.18-3.21) of an animal that runs."""
        m.sigma = m._at_least_floor(noise_running(m.x[SPEED]))

    @triggered("started")
    def predict(m) -> None:
        """Time update over one tick (eq. 3.5, 3.6, 3.10-3.12, 3.16)."""
        derivative = ca.vertcat(
            m.acceleration - m.x[BIAS],  # eq. 3.10
            0,  # the bias is a random walk
            m.x[SPEED] * ca.cos(m.held_heading),  # eq. 3.11
            m.x[SPEED] * ca.sin(m.held_heading),
        )
        position_noise = m.sigma_position**2
        noise = [m.sigma**2 * m.sample_time, m.sigma_bias**2, position_noise, position_noise]  # eq. 3.16
        m.x, transition = propagate(m.x, derivative, m.sample_time)
        m.covariance = Factors.unpack(m.covariance, FACTORED).predict(transition, noise).pack()

    @triggered("gps_fix")
    def judge(m) -> None:
        """Accept or reject the fix: the gate of its innovations has a nominal width, without sigma."""
        m.good = m.within("gps_north", "gps_east", "gps_speed", "gps_h_acc", "gps_s_acc")
        age = m.age * m.sample_time
        position_variance = 2 * (0.5 * m.gps_h_acc) ** 2 + (m.gate_position_growth * age) ** 2
        speed_variance = 2 * m.gps_s_acc**2 + (m.gate_speed_growth * age) ** 2
        near = all_of(
            (m.gps_north - m.x[NORTH]) ** 2 <= m.gate**2 * position_variance,
            (m.gps_east - m.x[EAST]) ** 2 <= m.gate**2 * position_variance,
            (m.gps_speed - m.x[SPEED]) ** 2 <= m.gate**2 * speed_variance,
        )
        m.accepted = all_of(m.good, near, m.started)
        m.rejected = where(m.good, where(m.accepted, 0, m.rejected + 1), m.rejected)
        m.bad_fixes = counted(m.bad_fixes, ca.logic_not(m.good))

    @triggered("accepted")
    def correct(m) -> None:
        """Measurement update by speed, north, east in turn (eq. 3.1-3.4, 3.14, 3.15)."""
        x = [m.x[i] for i in range(4)]
        factors = Factors.unpack(m.covariance, FACTORED)
        position_variance = (0.5 * m.gps_h_acc) ** 2  # eq. 3.15
        for component, measured, variance in (
            (SPEED, m.gps_speed, m.gps_s_acc**2),
            (NORTH, m.gps_north, position_variance),
            (EAST, m.gps_east, position_variance),
        ):
            correction, factors = factors.correct(component, variance, measured - x[component])
            x = [value + more for value, more in zip(x, correction, strict=True)]  # eq. 3.2
        m.x = ca.vertcat(*x)
        m.covariance = factors.pack()
        m.age = 0

    @triggered(
        lambda m: all_of(m.gps_fix, m.good, any_of(ca.logic_not(m.started), m.rejected >= m.recovery_fixes)),
        "a good fix is the first, or the last of `recovery_fixes` rejected in a row",
    )
    def recover(m) -> None:
        """Begin, or begin anew, at the fix; keep the bias if there is one.

        Eq. 3.9 begins with zeros at a known start, with P0 of eq. 3.17. A state taken from a fix is as
        uncertain as the fix, so its variance is added.
        """
        bias_variance = Factors.unpack(m.covariance, FACTORED).variance(BIAS)
        position_variance = m.initial_position_variance + (0.5 * m.gps_h_acc) ** 2
        m.x = ca.vertcat(m.gps_speed, m.x[BIAS], m.gps_north, m.gps_east)
        m.covariance = Factors.diagonal(
            [
                m.initial_speed_variance + m.gps_s_acc**2,
                where(m.started, bias_variance, m.initial_bias_variance),
                position_variance,
                position_variance,
            ],
            FACTORED,
        ).pack()
        m.started = 1
        m.age = m.rejected = 0

    def output(m) -> None:
        """The estimate for this tick."""
        factors = Factors.unpack(m.covariance, FACTORED)
        m.speed, m.accel_bias, m.north, m.east = (m.x[i] for i in range(4))
        m.speed_sd, m.accel_bias_sd, m.north_sd, m.east_sd = (ca.sqrt(factors.variance(i)) for i in range(4))
        m.heading, m.heading_sd = wrap(m.held_heading), m.heading_accuracy
        m.sigma_accel = m.sigma
        m.valid = all_of(m.started, m.age * m.sample_time <= m.max_age)

    def _at_least_floor(m, sigma: SX) -> SX:
        return where(sigma > m.sigma_floor, sigma, m.sigma_floor)
