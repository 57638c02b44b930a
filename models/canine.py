"""The animal: the canine behaviour statistical model (CBSM), on the pack's kinematics (5.2, 5.3, D.6)."""

from __future__ import annotations

from models.commands import Command
from models.kit import casadi as ca
from models.kit.block import before, triggered
from models.kit.declaration import SX, Boolean, Integer, Parameter, State, Stream
from models.kit.geometry import all_of, any_of, where, wrap
from models.kit.random import MAX_SEED, normals, uniform
from models.kit.timing import ticks_until
from models.kit.units import DEG
from models.pack import PackMotion
from models.plant import Guided

REDRAWS = 4  # draws of a speed or an acceleration, then its floor: all fall below it in 5 of 10^6 trials


class Behaviour(Guided):
    """The part of the dog that decides and moves: its draws, responses and delays."""

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
    drift_redrawn = Parameter(Boolean, "the drift is drawn anew with each FORWARD, not once a trial", start=0)
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
    temper_stream = Stream("traits of the dog in this trial", substream=0)
    right_stream = Stream("responses to RIGHT", substream=1)
    left_stream = Stream("responses to LEFT", substream=2)
    search_stream = Stream("search for the bumper", substream=4)
    drift_stream = Stream("drift of each run", substream=13)

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
        lambda m: any_of(
            m.command != m.past_command,
            all_of(m.command != m.obeyed, any_of(m.command != Command.RECALL, m.wait <= 0)),
        ),
        "the command is new, or not obeyed yet, but not while a RECALL waits",
        seldom=True,
    )
    def hear(m) -> None:
        """Obey a command after its delay (5.3.7.1).

        The dog searches for the bumper once, on the first RECALL. A hand that starts the watch early delays
        the first command.
        """
        new = m.command != m.past_command
        recall = m.command == Command.RECALL
        searching = all_of(new, recall, ca.logic_not(m.recalled))
        draw, stream = uniform(m.search_stream)
        m.search_stream = where(searching, stream, m.search_stream)
        longest = where(m.bumper_search_max < m.bumper_search_min, m.bumper_search_min, m.bumper_search_max)
        search = m.bumper_search_min + draw * (longest - m.bumper_search_min)
        time = m._response_time() + where(m.commanded, 0, m.start_delay) + where(searching, search, 0)
        wait = where(new, ticks_until(time, m.sample_time), m.wait)
        m.commanded, m.recalled = 1, any_of(m.recalled, searching)
        m.obeyed = where(wait > 0, m.obeyed, m.command)
        m.wait = where(recall, wait, wait - (wait > 0))

    @before("turn_home")
    @triggered(lambda m: m.command == Command.RECALL, "on RECALL")
    def await_recall(m) -> None:
        """Count down RECALL's delay. It may last seconds, so it is not part of `hear`, a rare update."""
        m.wait = m.wait - (m.wait > 0)

    @triggered(
        lambda m: all_of(m.command == Command.RIGHT, m.past_command != Command.RIGHT),
        "RIGHT is new",
        seldom=True,
    )
    def hear_right(m) -> None:
        """Draw the response to a RIGHT just issued (eq. 5.3, 5.4)."""
        draw, m.right_stream = uniform(m.right_stream)
        m.obeys_right = draw <= m._heeds(m.right_success)

    @triggered(
        lambda m: all_of(m.command == Command.LEFT, m.past_command != Command.LEFT),
        "LEFT is new",
        seldom=True,
    )
    def hear_left(m) -> None:
        """Draw the response to a LEFT just issued."""
        draw, m.left_stream = uniform(m.left_stream)
        m.obeys_left = draw <= m._heeds(m.left_success)

    @triggered(
        lambda m: all_of(m.drift_redrawn, m.command == Command.FORWARD, m.past_command != Command.FORWARD),
        "`drift_redrawn`, FORWARD is new",
        seldom=True,
    )
    def hear_forward(m) -> None:
        """Draw the drift of the run that begins."""
        draws, m.drift_stream = normals(m.drift_stream, 1)
        m.trial_drift = m.drift + m.drift_deviation * draws[0]

    def move(m) -> None:
        """Run on FORWARD and RECALL, which are always obeyed, and brake on any other command."""
        m.past_command = m.command
        running = any_of(m.obeyed == Command.FORWARD, m.obeyed == Command.RECALL)
        drift = where(any_of(running, m.velocity > 0), m.trial_drift, 0)
        turn = where(all_of(m.obeyed == Command.RIGHT, m.obeys_right), m.trial_right_rate, 0)
        turn = where(all_of(m.obeyed == Command.LEFT, m.obeys_left), m.trial_left_rate, turn)
        m._move(where(running, m.trial_speeding_up, -m.trial_slowing_down), m._top_speed(), drift + turn)

    def _top_speed(m) -> SX:
        """The speed at which it cruises [m/s]."""
        return m.trial_speed

    def _response_time(m) -> SX:
        """The delay of a response [s]."""
        return m.response_delay

    def _heeds(m, success: SX) -> SX:
        """The probability that it obeys a vibration, from the success rate of its side."""
        return success


class Canine(PackMotion, Behaviour):
    """The guided dog: obeys tones always, vibrations by chance, drifts, and shakes its pack."""

    source = "Miller 2010, 5.2-5.3, Table 5.1, eq. 5.1-5.5, B.5, D.9-D.11; motion: B.4, D.5; delays: 5.3.7.1"


def _redrawn(mean: SX, deviation: SX, draws: list[SX]) -> SX:
    """The first of some draws from N(mean, deviation) that is at least 0.2 of the mean, else that floor."""
    floor = 0.2 * mean
    value = floor
    for draw in reversed(draws):
        candidate = mean + deviation * draw
        value = where(candidate >= floor, candidate, value)
    return value
