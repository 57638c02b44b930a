"""The animal: the canine behaviour statistical model (CBSM), kinematics, gait (5.2, 5.3, D.6)."""

from __future__ import annotations

import math

from models.commands import Command
from models.kit import casadi as ca
from models.kit.block import Block, triggered
from models.kit.declaration import SX, Boolean, Input, Integer, Output, Parameter, State, Stream
from models.kit.geometry import all_of, any_of, clip, where, wrap
from models.kit.random import MAX_SEED, normal, normals, uniform
from models.kit.timing import ticks_until
from models.kit.units import DEG

REDRAWS = 4  # draws of a speed or an acceleration, then its floor: all fall below it in 5 of 10^6 trials


class Plant(Block):
    """The role of a plant: the variables that every plant has, and the kinematics that ours share."""

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

    start_north = Parameter("m", "position at the start", start=0, min=-1e5, max=1e5)
    start_east = Parameter("m", "position at the start", start=0, min=-1e5, max=1e5)
    start_heading = Parameter("rad", "heading at the start", start=0, min=-4, max=4)

    recall_turn_rate = Parameter(
        "rad/s", "turn rate of the body towards the start on RECALL", start=270 * DEG, min=0
    )

    obeyed = State(Command, "command that the animal carries out")
    position_north = State("m", "position")
    position_east = State("m", "position")
    velocity = State("m/s", "ground speed")
    body_heading = State("rad", "heading")
    bearing = State("rad", "bearing of the start, and the course on RECALL")
    past_velocity = State("m/s", "ground speed a tick ago")
    past_heading = State("rad", "heading a tick ago")

    def _place(m) -> None:
        """Put the animal at rest at the start."""
        m.position_north, m.position_east = m.start_north, m.start_east
        m.velocity = m.past_velocity = 0
        m.body_heading = m.past_heading = wrap(m.start_heading)

    def hear(m) -> None:
        """Obey at once."""
        m.obeyed = m.command

    def remember(m) -> None:
        """Keep speed and heading: acceleration and yaw rate are differences from them."""
        m.past_velocity, m.past_heading = m.velocity, m.body_heading

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
        course = where(homing, m.bearing, m.body_heading)
        step = 0.5 * (m.past_velocity + m.velocity) * m.sample_time
        m.position_north = m.position_north + step * ca.cos(course)  # eq. B.5, D.11
        m.position_east = m.position_east + step * ca.sin(course)


class Canine(Plant):
    """The guided dog: obeys tones always, vibrations by chance, drifts, and shakes its pack."""

    source = "Miller 2010, 5.2-5.3, Table 5.1, eq. 5.1-5.5, B.5, D.9-D.11; motion: B.4, D.5; delays: 5.3.7.1"

    seed = Parameter(Integer, "trial number: selects the random streams", start=1, min=0, max=MAX_SEED)
    start_heading_deviation = Parameter(
        "rad", "standard deviation of the heading at the start", start=0, min=0
    )
    # Table 5.1
    cruise_speed = Parameter("m/s", "Velocity, mean", start=4.86, min=0)
    cruise_speed_deviation = Parameter(
        "m/s", "Velocity, standard deviation (Table 5.1: 1.49)", start=0, min=0
    )
    speeding_up = Parameter("m/s2", "Acceleration, mean", start=1.78, min=0)
    speeding_up_deviation = Parameter(
        "m/s2", "Acceleration, standard deviation (Table 5.1: 0.67)", start=0, min=0
    )
    slowing_down = Parameter("m/s2", "Deceleration, mean of its magnitude", start=2.72, min=0)
    slowing_down_deviation = Parameter(
        "m/s2", "Deceleration, standard deviation (Table 5.1: 1.31)", start=0, min=0
    )
    right_turn_rate = Parameter("rad/s", "Right Turn Rate, mean", start=57.92 * DEG)
    right_turn_rate_deviation = Parameter(
        "rad/s", "Right Turn Rate, standard deviation", start=37.66 * DEG, min=0
    )
    left_turn_rate = Parameter("rad/s", "Left Turn Rate, mean", start=-77.67 * DEG)
    left_turn_rate_deviation = Parameter(
        "rad/s", "Left Turn Rate, standard deviation", start=41.13 * DEG, min=0
    )
    drift = Parameter("rad/s", "Heading Drift, mean", start=2.62 * DEG)
    drift_deviation = Parameter("rad/s", "Heading Drift, standard deviation", start=1.62 * DEG, min=0)
    left_success = Parameter("1", "Left Success Rate", start=0.64, min=0, max=1)
    right_success = Parameter("1", "Right Success Rate", start=0.6, min=0, max=1)
    # why trials take longer in the field (5.3.7.1): all off
    response_delay = Parameter(
        "s",
        "time from a command to its obedience; until then the one before is obeyed",
        start=0,
        min=0,
        max=1e4,
    )
    bumper_search_min = Parameter(
        "s", "shortest search for the bumper before the first RECALL is obeyed (1)", start=0, min=0, max=1e4
    )
    bumper_search_max = Parameter(
        "s", "longest search for the bumper (5), at least the shortest", start=0, min=0, max=1e4
    )
    start_delay = Parameter(
        "s", "hand timing: time on the watch before the first command acts", start=0, min=0, max=1e4
    )
    # motion when walking (detection mode) and when running: B.4, D.5
    shaking = Parameter(
        Boolean, "the pack shakes with the stride; off: it moves as the animal's centre", start=1
    )
    walk_stride = Parameter("Hz", "strides per second, walking", start=2.0, min=0, max=10)
    run_stride = Parameter("Hz", "strides per second, running", start=2.9, min=0, max=10)
    walk_acceleration_swing = Parameter("m/s2", "peak to peak, walking (10 to 20)", start=15, min=0)
    run_acceleration_swing = Parameter("m/s2", "peak to peak, running (40 to 50)", start=45, min=0)
    walk_pitch_swing = Parameter(
        "rad", "peak to peak, walking (5 to 10 deg)", start=7.5 * DEG, min=0, max=1.5
    )
    run_pitch_swing = Parameter("rad", "peak to peak, running (40 to 60 deg)", start=50 * DEG, min=0, max=1.5)
    pitch_mean = Parameter("rad", "mean pitch of the pack on the dog's back", start=-8.5 * DEG, min=-1, max=1)
    roll_swing = Parameter("rad", "peak to peak", start=10 * DEG, min=0, max=1.5)
    yaw_rate_swing = Parameter("rad/s", "peak to peak (70 to either side)", start=140 * DEG, min=0)
    jerk_deviation = Parameter("m/s2", "spike of a jerk of the pack, standard deviation", start=8, min=0)
    jerk_rate = Parameter("1", "probability of a jerk in a stride", start=0.3, min=0, max=1)

    trial_drift = State("rad/s", "heading drift of this trial")
    trial_right_rate = State("rad/s", "right turn rate of this trial")
    trial_left_rate = State("rad/s", "left turn rate of this trial")
    trial_speed = State("m/s", "cruise speed of this trial")
    trial_speeding_up = State("m/s2", "acceleration of this trial")
    trial_slowing_down = State("m/s2", "deceleration of this trial")
    past_command = State(Command, "command a tick ago")
    commanded = State(Boolean, "the first command has been given")
    recalled = State(Boolean, "the first RECALL has been given")
    wait = State(Integer, "ticks until the command is obeyed", min=0)
    obeys_right = State(Boolean, "the response drawn for RIGHT")
    obeys_left = State(Boolean, "the response drawn for LEFT")
    stride = State("rad", "phase of the stride", min=0)
    jerk = State("m/s2", "jerk of the pack on this tick")
    jerk_due = State(Boolean, "a stride began on this tick")
    temper_stream = Stream("traits of the dog in this trial", substream=0)
    right_stream = Stream("responses to RIGHT", substream=1)
    left_stream = Stream("responses to LEFT", substream=2)
    jerk_stream = Stream("jerks of the pack", substream=3)
    search_stream = Stream("search for the bumper", substream=4)

    def initialize(m) -> None:
        """Draw start heading, drift and turn rates of the trial (eq. 5.1, 5.2, 5.5)."""
        draws, m.temper_stream = normals(m.temper_stream, 4)
        m._place()
        m.body_heading = wrap(m.start_heading + m.start_heading_deviation * draws[0])  # eq. 5.1
        m.past_heading = m.body_heading
        m.trial_drift = m.drift + m.drift_deviation * draws[1]  # eq. 5.2
        m.trial_right_rate = m.right_turn_rate + m.right_turn_rate_deviation * draws[2]  # eq. 5.5
        m.trial_left_rate = m.left_turn_rate + m.left_turn_rate_deviation * draws[3]
        m.trial_speed = m.cruise_speed
        m.trial_speeding_up, m.trial_slowing_down = m.speeding_up, m.slowing_down

    @triggered(
        lambda m: any_of(
            m.cruise_speed_deviation > 0, m.speeding_up_deviation > 0, m.slowing_down_deviation > 0
        ),
        "a speed or an acceleration has a deviation",
    )
    def initialize_speeds(m) -> None:
        """Draw speed and accelerations of the trial."""
        draws, m.temper_stream = normals(m.temper_stream, 3 * REDRAWS)
        speeds, ups, downs = draws[:REDRAWS], draws[REDRAWS : 2 * REDRAWS], draws[2 * REDRAWS :]
        m.trial_speed = _redrawn(m.cruise_speed, m.cruise_speed_deviation, speeds)
        m.trial_speeding_up = _redrawn(m.speeding_up, m.speeding_up_deviation, ups)
        m.trial_slowing_down = _redrawn(m.slowing_down, m.slowing_down_deviation, downs)

    @triggered(
        lambda m: any_of(m.command != m.past_command, m.command != m.obeyed),
        "the command is new, or not obeyed yet",
        seldom=True,
    )
    def hear(m) -> None:
        """Obey a command after its delay (5.3.7.1).

        The dog searches for the bumper once, on the first RECALL. A hand that starts the watch early delays
        the first command.
        """
        new = m.command != m.past_command
        searching = all_of(new, m.command == Command.RECALL, ca.logic_not(m.recalled))
        draw, stream = uniform(m.search_stream)
        m.search_stream = where(searching, stream, m.search_stream)
        longest = where(m.bumper_search_max < m.bumper_search_min, m.bumper_search_min, m.bumper_search_max)
        search = m.bumper_search_min + draw * (longest - m.bumper_search_min)
        time = m.response_delay + where(m.commanded, 0, m.start_delay) + where(searching, search, 0)
        wait = where(new, ticks_until(time, m.sample_time), m.wait)
        m.commanded, m.recalled = 1, any_of(m.recalled, searching)
        m.obeyed = where(wait > 0, m.obeyed, m.command)
        m.wait = where(wait > 0, wait - 1, 0)

    @triggered(
        lambda m: all_of(m.command == Command.RIGHT, m.past_command != Command.RIGHT),
        "RIGHT is new",
        seldom=True,
    )
    def hear_right(m) -> None:
        """Draw the response to a RIGHT just issued (eq. 5.3, 5.4)."""
        draw, m.right_stream = uniform(m.right_stream)
        m.obeys_right = draw <= m.right_success

    @triggered(
        lambda m: all_of(m.command == Command.LEFT, m.past_command != Command.LEFT),
        "LEFT is new",
        seldom=True,
    )
    def hear_left(m) -> None:
        """Draw the response to a LEFT just issued."""
        draw, m.left_stream = uniform(m.left_stream)
        m.obeys_left = draw <= m.left_success

    def move(m) -> None:
        """Run on FORWARD and RECALL, which are always obeyed, and brake on any other command."""
        m.past_command = m.command
        running = any_of(m.obeyed == Command.FORWARD, m.obeyed == Command.RECALL)
        drift = where(any_of(running, m.velocity > 0), m.trial_drift, 0)
        turn = where(all_of(m.obeyed == Command.RIGHT, m.obeys_right), m.trial_right_rate, 0)
        turn = where(all_of(m.obeyed == Command.LEFT, m.obeys_left), m.trial_left_rate, turn)
        m._move(where(running, m.trial_speeding_up, -m.trial_slowing_down), m.trial_speed, drift + turn)

    @triggered("shaking")
    def swing(m) -> None:
        """Advance the stride."""
        walk, run = m._gait()
        rate = walk * m.walk_stride + run * m.run_stride
        phase = m.stride + 2 * math.pi * rate * m.sample_time
        m.jerk_due = phase >= 2 * math.pi
        m.stride = phase - where(m.jerk_due, 2 * math.pi, 0)
        m.jerk = 0

    @triggered(lambda m: all_of(m.shaking, m.jerk_due), "`shaking`, and a stride began on this tick")
    def shake(m) -> None:
        """By chance, once a stride, the pack hits the back: a spike, sometimes over 20 m/s2 (B.4)."""
        chance, stream = uniform(m.jerk_stream)
        size, m.jerk_stream = normal(stream)
        m.jerk = where(chance <= m.jerk_rate, m.jerk_deviation * size, 0)
        m.jerk_due = 0

    def output(m) -> None:
        """The animal's motion; acceleration, attitude and yaw rate are those of the pack on its back.

        The heading is the animal's. The gyroscope turns with the pack, which swings about it (B.4).
        """
        m.north, m.east = m.position_north, m.position_east
        m.speed, m.heading = m.velocity, m.body_heading
        walk, run = m._gait()
        sine, cosine = ca.sin(m.stride), ca.cos(m.stride)
        moving = where(m.shaking, walk + run, 0)
        forward = walk * m.walk_acceleration_swing + run * m.run_acceleration_swing
        nodding = walk * m.walk_pitch_swing + run * m.run_pitch_swing
        m.acceleration = (m.velocity - m.past_velocity) / m.sample_time + where(
            m.shaking, 0.5 * forward * cosine + m.jerk, 0
        )
        m.pitch = where(m.shaking, m.pitch_mean + 0.5 * nodding * sine, 0)
        m.roll = moving * 0.5 * m.roll_swing * cosine
        m.yaw_rate = (
            wrap(m.body_heading - m.past_heading) / m.sample_time + moving * 0.5 * m.yaw_rate_swing * sine
        )

    def _gait(m) -> tuple[SX, SX]:
        """Shares of walking and of running in the gait, by speed, with the breakpoints of eq. 3.19."""
        run = clip(m.velocity - 3.0, 0.0, 1.0)
        return clip(m.velocity / 0.5, 0.0, 1.0) * (1 - run), run


def _redrawn(mean: SX, deviation: SX, draws: list[SX]) -> SX:
    """The first of some draws from N(mean, deviation) that is at least 0.2 of the mean, else that floor."""
    floor = 0.2 * mean
    value = floor
    for draw in reversed(draws):
        candidate = mean + deviation * draw
        value = where(candidate >= floor, candidate, value)
    return value
