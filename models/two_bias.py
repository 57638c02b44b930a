"""Four states with two accelerometer biases, one of detection and one of running, as 6.2 proposes."""

from __future__ import annotations

from models.estimator import BIAS
from models.four_state import FourState
from models.kit import casadi as ca
from models.kit.block import before, triggered
from models.kit.declaration import Boolean, Parameter, State
from models.kit.geometry import all_of, where


class TwoBias(FourState):
    """The four-state EKF with a bias for detection and one for running; the speed of GPS switches them."""

    source = "Miller 2010, eq. 3.1-3.21, 6.2"

    # ours: the text names no speeds; at 3.5 m/s walking and running fire alike (eq. 3.19)
    running_from = Parameter("m/s", "a fix faster than this begins running", start=3.5, min=0, max=50)
    detection_below = Parameter("m/s", "a fix slower than this ends it", start=3.0, min=0, max=50)

    running = State(Boolean, "the bias in x is that of running")
    other_bias = State("m/s2", "the bias that is not in x, as it was when last used")
    other_bias_variance = State("1", "its variance, in (m/s2)^2")

    def initialize(m) -> None:
        """The bias of running is as unknown as that of detection."""
        m.other_bias_variance = m.initial_bias_variance

    @before("output")
    @triggered(
        lambda m: all_of(
            m.gps_fix,
            m.started,
            m.age < 1,
            where(m.running, m.gps_speed < m.detection_below, m.gps_speed > m.running_from),
        ),
        "an accepted fix is past `running_from`, or, running, below `detection_below`",
    )
    def switch(m) -> None:
        """The other bias takes the place of this one, as it was when last used; speed and position stay."""
        factors = m._factors()
        bias, variance = m.x[BIAS], factors.variance(BIAS)
        m.x = ca.vertcat(*(m.other_bias if i == BIAS else m.x[i] for i in range(len(m.order))))
        m.covariance = factors.replaced(BIAS, m.other_bias_variance).pack()
        m.other_bias, m.other_bias_variance = bias, variance
        m.running = 1 - m.running
