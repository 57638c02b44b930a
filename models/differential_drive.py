"""A robot with two driven wheels that obeys the animal's commands; its wheels slip."""

from __future__ import annotations

from models.commands import Command
from models.kit import casadi as ca
from models.kit.block import triggered
from models.kit.declaration import Integer, Parameter, State, Stream
from models.kit.geometry import clip, where, wrap
from models.kit.random import MAX_SEED, normals
from models.kit.units import DEG
from models.plant import Plant

MOST_SLIP = 0.95  # beyond it a wheel spins, and this model says nothing


class DifferentialDrive(Plant):
    """A robot that obeys the commands; each of its two driven wheels slips by a share.

    Both wheels turn alike on FORWARD. On LEFT and RIGHT the outer one turns at `turning_speed`, the inner one
    at `inner_ratio` of it: with equal slip the centre moves on a circle of the radius
    track / 2 * (1 + inner_ratio) / (1 - inner_ratio). Slip is 1 - ground speed / rim speed, the same when
    braking, and drawn once a trial. Unequal slips make the robot drift. On RECALL it drives home by these
    same motions. It stops on STOP, NONE, and what is no command.
    """

    source = "ours; Miller 2010, Table 4.1 for the commands, eq. 5.1 for the heading at the start"

    seed = Parameter(Integer, "trial number: selects the random streams", start=1, min=0, max=MAX_SEED)
    start_heading_deviation = Parameter(
        "rad", "standard deviation of the heading at the start", start=0, min=0
    )
    track = Parameter("m", "distance between the wheels", start=0.5, min=0.1, max=5)
    driving_speed = Parameter("m/s", "rim speed of both wheels on FORWARD", start=1.5, min=0, max=10)
    turning_speed = Parameter(
        "m/s", "rim speed of the outer wheel on LEFT and RIGHT", start=0.7, min=0, max=10
    )
    inner_ratio = Parameter(
        "1",
        "rim speed of the inner wheel over the outer's: 0 turns about the inner wheel, -1 on the spot",
        start=0.25,
        min=-1,
        max=0.9,
    )
    wheel_acceleration = Parameter(
        "m/s2", "greatest change of a rim speed in a second", start=4, min=0.01, max=50
    )
    wheel_slip = Parameter("1", "slip of a wheel, mean", start=0.05, min=0, max=MOST_SLIP)
    wheel_slip_deviation = Parameter(
        "1", "slip of a wheel, standard deviation over trials", start=0.005, min=0, max=1
    )
    home_deviation = Parameter(
        "rad", "deviation from the way home from which it turns on RECALL", start=20 * DEG, min=1 * DEG, max=3
    )

    manoeuvre = State(Command, "what the wheels do: FORWARD, LEFT, RIGHT; else they stop")
    left_rim = State("m/s", "rim speed of the left wheel")
    right_rim = State("m/s", "rim speed of the right wheel")
    left_slip = State("1", "slip of the left wheel in this trial", min=0, max=MOST_SLIP)
    right_slip = State("1", "slip of the right wheel in this trial", min=0, max=MOST_SLIP)
    trial_stream = Stream("slip of the wheels and heading in this trial", substream=12)

    def initialize(m) -> None:
        """Stand at the start, and draw the heading there (eq. 5.1) and the slip of each wheel."""
        draws, m.trial_stream = normals(m.trial_stream, 3)
        m._place()
        m.body_heading = m.past_heading = wrap(m.start_heading + m.start_heading_deviation * draws[2])
        m.left_slip, m.right_slip = (
            clip(m.wheel_slip + m.wheel_slip_deviation * draw, 0, MOST_SLIP) for draw in draws[:2]
        )

    def hear(m) -> None:
        """Obey at once."""
        m.manoeuvre = m.command

    @triggered(lambda m: m.manoeuvre == Command.RECALL, "on RECALL")
    def drive_home(m) -> None:
        """Turn towards the start until it lies ahead, and drive."""
        bearing = ca.atan2(m.start_east - m.position_east, m.start_north - m.position_north)
        off = wrap(bearing - m.body_heading)
        m.manoeuvre = where(off <= -m.home_deviation, Command.LEFT, Command.FORWARD)
        m.manoeuvre = where(off >= m.home_deviation, Command.RIGHT, m.manoeuvre)

    def drive(m) -> None:
        """The rims change as fast as they may; the ground speeds of the wheels move the body for one tick."""
        inner, largest = m.inner_ratio * m.turning_speed, m.wheel_acceleration * m.sample_time
        ground = []
        for rim, slip, outer_on, inner_on in (
            (m.left_rim, m.left_slip, Command.RIGHT, Command.LEFT),
            (m.right_rim, m.right_slip, Command.LEFT, Command.RIGHT),
        ):
            speed = where(m.manoeuvre == Command.FORWARD, m.driving_speed, 0)
            speed = where(m.manoeuvre == outer_on, m.turning_speed, speed)
            speed = where(m.manoeuvre == inner_on, inner, speed)
            reached = rim + clip(speed - rim, -largest, largest)
            ground.append((reached, reached * (1 - slip)))
        (m.left_rim, left), (m.right_rim, right) = ground
        m.velocity = 0.5 * (left + right)
        turn = (left - right) / m.track * m.sample_time
        m._step(m.body_heading + 0.5 * turn)
        m.body_heading = wrap(m.body_heading + turn)

    def output(m) -> None:
        """The robot's motion; it stays level."""
        m._report()
