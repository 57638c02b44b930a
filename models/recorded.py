"""A recorded path drives the motion: from positions in time come speed, course, heading and acceleration."""

from __future__ import annotations

from models.kit import casadi as ca
from models.kit.declaration import SX, Input, Integer, Parameter, State
from models.kit.geometry import COUNT_MAX, clip, counted, where, wrap
from models.kit.units import DEG
from models.pack import PackMotion
from models.plant import Plant


class Path(Plant):
    """Motion along positions, one a tick: central differences, so it lags behind its input by a tick."""

    path_north = Input("m", "position on the path, a tick ahead", start=0, min=-1e5, max=1e5)
    path_east = Input("m", "position on the path, a tick ahead", start=0, min=-1e5, max=1e5)

    slow_speed = Parameter("m/s", "the course of a slower animal is held", start=0.2, min=0, max=10)
    # as on RECALL: a rate that an animal can reach and a gyroscope can measure
    largest_turn_rate = Parameter("rad/s", "rate at which the body turns at most", start=270 * DEG, min=0)

    ahead_north = State("m", "last position taken")
    ahead_east = State("m", "last position taken")
    course = State("rad", "where the path leads")
    past_course = State("rad", "where it led a tick ago")
    points = State(Integer, "positions taken, up to 2", max=2)
    bad_points = State(Integer, "positions skipped: not a number, or out of range", max=COUNT_MAX)

    def initialize(m) -> None:
        """Stand at the start until the path begins."""
        m._place()
        m.course = m.past_course = m.body_heading
        m.ahead_north, m.ahead_east = m.position_north, m.position_east

    def move(m) -> None:
        """Go on to the position taken before; the difference across it gives speed and course (ours).

        The first position places the animal. The second starts it, with speed and course of the path.
        """
        good = m.within("path_north", "path_east")
        m.bad_points = counted(m.bad_points, ca.logic_not(good))
        placed, going = m.points > 0, m.points > 1
        north = where(good, m.path_north, m.ahead_north)
        east = where(good, m.path_east, m.ahead_east)
        time = where(going, 2 * m.sample_time, m.sample_time)
        forward = where(placed, north - m.position_north, 0) / time
        right = where(placed, east - m.position_east, 0) / time
        m.position_north, m.position_east = (
            where(placed, m.ahead_north, north),
            where(placed, m.ahead_east, east),
        )
        m.ahead_north, m.ahead_east = north, east
        m.velocity = ca.sqrt(forward * forward + right * right)
        m.past_velocity = where(going, m.past_velocity, m.velocity)
        past_course = m.course
        m.course = where(m.velocity > m.slow_speed, ca.atan2(right, forward), past_course)
        m.past_course = where(going, past_course, m.course)
        facing = wrap(m.course - m.side_slip)
        largest = m.largest_turn_rate * m.sample_time
        turned = wrap(m.body_heading + clip(wrap(facing - m.body_heading), -largest, largest))
        m.body_heading = where(going, turned, facing)
        m.past_heading = where(going, m.past_heading, facing)
        m.points = where(good, where(placed, 2, 1), m.points)

    def _slip(m) -> SX:
        """Course less heading: the slip that it takes, and what the body lags behind in fast turns."""
        return wrap(m.course - m.body_heading)

    def _turned(m) -> SX:
        """The turn of the path: the heading itself follows the slip here."""
        return wrap(m.course - m.past_course)


class Recorded(PackMotion, Path):
    """A recorded path, whatever is commanded, with the motion of the pack on top."""

    source = "ours; motion of the pack: Miller 2010, B.4, D.5"

    def _slips(m) -> SX:
        """Always: the body may lag behind the path."""
        return ca.SX(1)
