"""The role of a plant: the variables that every plant has, and the motion of one that is told where to go."""

from __future__ import annotations

from models.commands import Command
from models.kit import casadi as ca
from models.kit.block import Block, triggered
from models.kit.declaration import SX, Input, Output, Parameter, State
from models.kit.geometry import clip, where, wrap
from models.kit.units import DEG


class Plant(Block):
    """The role of a plant: the variables that every plant has."""

    moore = True

    command = Input(Command, "what the animal is told", start=0)

    north = Output("m", "position")
    east = Output("m", "position")
    speed = Output("m/s", "ground speed")
    heading = Output("rad", "heading, clockwise from north, in (-pi, pi]")
    acceleration = Output("m/s2", "longitudinal acceleration of the pack")
    pitch = Output("rad", "pitch of the pack, nose up positive")
    roll = Output("rad", "roll of the pack, right side down positive")
    yaw_rate = Output("rad/s", "yaw rate of the pack, clockwise positive")
    slip = Output("rad", "course less heading")
    slip_acceleration = Output(
        "m/s2", "lateral acceleration by slip, rightwards: beyond speed times yaw rate"
    )

    start_north = Parameter("m", "position at the start", start=0, min=-1e5, max=1e5)
    start_east = Parameter("m", "position at the start", start=0, min=-1e5, max=1e5)
    start_heading = Parameter("rad", "heading at the start", start=0, min=-4, max=4)

    position_north = State("m", "position")
    position_east = State("m", "position")
    velocity = State("m/s", "ground speed")
    body_heading = State("rad", "heading")
    past_velocity = State("m/s", "ground speed a tick ago")
    past_heading = State("rad", "heading a tick ago")
    side_slip = State("rad", "slip that the animal takes: course less heading")
    incline = State("rad", "pitch of the ground, uphill positive")

    def remember(m) -> None:
        """Keep speed and heading: acceleration and yaw rate are differences from them."""
        m.past_velocity, m.past_heading = m.velocity, m.body_heading

    def _place(m) -> None:
        """Put the animal at rest at the start."""
        m.position_north, m.position_east = m.start_north, m.start_east
        m.velocity = m.past_velocity = 0
        m.body_heading = m.past_heading = wrap(m.start_heading)

    def _step(m, course: SX) -> None:
        """Step along the course for one tick, at the mean of the speeds before and after it."""
        step = 0.5 * (m.past_velocity + m.velocity) * m.sample_time
        m.position_north = m.position_north + step * ca.cos(course)  # eq. B.5, D.11
        m.position_east = m.position_east + step * ca.sin(course)

    def _report(m) -> None:
        """The outputs of a pack that moves as the animal's centre, and lies level on it."""
        m.north, m.east = m.position_north, m.position_east
        m.speed, m.heading = m.velocity, m.body_heading
        m.acceleration = (m.velocity - m.past_velocity) / m.sample_time
        m.pitch, m.roll = m.incline, 0
        m.yaw_rate = wrap(m.body_heading - m.past_heading) / m.sample_time
        m.slip, m.slip_acceleration = m._slip(), 0

    def _slip(m) -> SX:
        """Course less heading."""
        return m.side_slip

    def _turned(m) -> SX:
        """The turn over the last tick that slip follows [rad]."""
        return wrap(m.body_heading - m.past_heading)


class Guided(Plant):
    """The motion of a plant that obeys commands."""

    recall_turn_rate = Parameter(
        "rad/s", "turn rate of the body towards the start on RECALL", start=270 * DEG, min=0
    )

    obeyed = State(Command, "command that the animal carries out")
    bearing = State("rad", "bearing of the start, and the course on RECALL")

    def hear(m) -> None:
        """Obey at once."""
        m.obeyed = m.command

    @triggered(lambda m: m.obeyed == Command.RECALL, "RECALL is obeyed")
    def turn_home(m) -> None:
        """On RECALL move straight to the start (5.3.2), and turn the body that way.

        The text has no turn on recall. Here the body turns at a rate that an animal can reach and a gyroscope
        can measure, and the turn takes no time from the trial.
        """
        m.bearing = ca.atan2(m.start_east - m.position_east, m.start_north - m.position_north)
        largest = m.recall_turn_rate * m.sample_time
        m.body_heading = wrap(m.body_heading + clip(wrap(m.bearing - m.body_heading), -largest, largest))

    def _move(m, acceleration: SX, top_speed: SX, turn_rate: SX) -> None:
        """The kinematics of one tick."""
        m.velocity = clip(m.velocity + acceleration * m.sample_time, 0.0, top_speed)  # eq. D.9
        turned = wrap(m.body_heading + turn_rate * m.sample_time)  # eq. D.10
        homing = m.obeyed == Command.RECALL
        m.body_heading = where(homing, m.body_heading, turned)
        course = where(homing, m.bearing, m.body_heading) + m._slip()
        m._step(course)
