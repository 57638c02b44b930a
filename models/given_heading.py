"""What the estimators share whose heading is an AHRS's: they hold it, and how far it is believed."""

from __future__ import annotations

import math

from models.estimator import Estimator
from models.kit.declaration import SX, Input, Parameter, State
from models.kit.geometry import all_of, at_least, at_most, where, wrap
from models.kit.units import DEG

TURNING = 0.5  # rad/s: by it the deviation grows without good samples, since animals turn
ANY = math.pi / math.sqrt(3)  # rad, deviation of a heading that may be any: uniform in (-pi, pi]


class GivenHeading(Estimator):
    """Base of the estimators that take the heading from an AHRS; one that is unknown is not led by."""

    heading_meas = Input("rad", "heading from the AHRS, clockwise from true north", min=-7, max=7)
    heading_meas_sd = Input(
        "rad", "its standard deviation, if it is above `heading_accuracy`", start=0, min=-1e3, max=1e3
    )

    heading_accuracy = Parameter(
        "rad", "standard deviation of the heading, as the AHRS is trusted", start=3 * DEG, min=0, max=4
    )
    max_heading_sd = Parameter(
        "rad", "a heading less certain than this makes the estimate invalid", start=30 * DEG, min=0, max=4
    )

    held_heading = State("rad", "last good heading")
    held_heading_sd = State("rad", "its standard deviation now", start=ANY)

    def output(m) -> None:
        """The estimate for this tick, valid only with a heading."""
        super().output()
        m.valid = all_of(m.valid, m.heading_sd <= m.max_heading_sd)

    def _hold_heading(m, good: SX) -> None:
        """Take the heading of a good sample; else it becomes less certain."""
        m.held_heading = where(good, m.heading_meas, m.held_heading)
        stated = at_least(m.heading_meas_sd, m.heading_accuracy)
        deviation = where(good, stated, m.held_heading_sd + TURNING * m.sample_time)
        m.held_heading_sd = at_most(deviation, ANY)

    def _facing(m) -> SX:
        return m.held_heading

    def _heading(m) -> tuple[SX, SX]:
        return wrap(m.held_heading), m.held_heading_sd
