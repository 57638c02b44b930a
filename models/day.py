"""The dog's day: it tires with the way that it runs, and heeds vibrations less the more of them it felt.

The text names both, and measured neither. A tired dog (5.1.3) is slower: the speeds of Table 5.1 spread
because of its "rising level of fatigue" (5.2). It may respond later (5.3.7.1). After more than two
directional commands since its last reward it "begins ignoring commands" (4.1.4.2). The laws are the smallest
that do this, and all their numbers are assumed. BOUNDS has what is likely at most.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from models.canine import Behaviour
from models.commands import Command
from models.errors import UsageError
from models.kit.block import before, triggered
from models.kit.declaration import SX, Integer, Output, Parameter, State
from models.kit.geometry import all_of, any_of, counted, where
from models.kit.timing import TICK
from models.streets import CanineInStreets

LONGEST_REST = 1e6  # s, between two missions


class Bound(NamedTuple):
    """The largest value of an effect that is likely, and why, in words."""

    most: float
    since: str


FULL = "a larger one would not fit {}, if a day ends at full fatigue"
# Each takes its own cause for the only one. Those of fatigue are of the fall over a day: they bound the
# parameters, which are shares of full fatigue, only if a day ends at full fatigue.
BOUNDS = {
    # speeds of 4.86 +- 1.49 m/s (Table 5.1) that fall evenly over a day fall by 69 %: mean +- sqrt(3) sd
    "fatigue_slows": Bound(0.69, FULL.format("the speeds of Table 5.1")),
    # field trials are up to 3.5 s longer than simulated ones, of which the search takes 3 s (5.3.7.1); of the
    # rest two responses have 0.25 s each, and a delay that grows evenly ends at twice its mean
    "fatigue_delays": Bound(0.5, FULL.format("the times of 5.3.7.1")),
    # a dog with 62 % on the mean of a day (Table 5.1) ends at 24 %, if it obeys always when rested
    "fatigue_disobeys": Bound(
        0.76, FULL.format("the obedience of Table 5.1") + " and the rested dog obeys always"
    ),
    # our sweeps over the gain, held against the counts of Table 4.4 (harness/results/habituation.md)
    "habituation_gain": Bound(0.35, "by our own sweeps, a larger one would not fit the counts of Table 4.4"),
}


class Day(Behaviour):
    """What of an animal lasts beyond a mission: fatigue and habituation, both from 0 to 1.

    Fatigue grows with the way run, towards 1, and fades with time. It takes a share of the speed, delays
    responses, and takes a share of those to vibrations. Habituation grows with each vibration beyond the free
    ones of a mission, by a share of what is missing to 1, and fades with time. It takes its own share of the
    responses to vibrations. Tones are always obeyed (5.2).
    """

    start_fatigue = Parameter("1", "fatigue at the start of the mission", start=0, min=0, max=1)
    start_habituation = Parameter("1", "habituation at the start of the mission", start=0, min=0, max=1)
    fatigue_way = Parameter(
        "m", "way that takes a rested animal to a fatigue of 63 % (assumed)", start=1000, min=1, max=1e7
    )
    fatigue_time = Parameter(
        "s", "time in which a rest leaves 37 % of the fatigue (assumed)", start=3600, min=1, max=1e7
    )
    fatigue_slows = Parameter(
        "1", "share of the cruise speed that full fatigue takes (assumed; at most 0.69 by Table 5.1 if a "
        "day ends at it)",
        start=0.5, min=0, max=0.9,
    )  # fmt: skip
    fatigue_delays = Parameter(
        "s", "by how much full fatigue delays a response (assumed; at most 0.5 by 5.3.7.1 if a day ends at "
        "it)",
        start=0.3, min=0, max=1e3,
    )  # fmt: skip
    fatigue_disobeys = Parameter(
        "1", "share of the responses to vibrations that full fatigue takes (assumed; at most 0.76 if a "
        "day ends at it, and the rested dog obeys always)",
        start=0.3, min=0, max=1,
    )  # fmt: skip
    free_vibrations = Parameter(
        Integer, "vibrations of a mission to which the animal does not habituate (4.1.4.2)",
        start=2, min=0, max=1000,
    )  # fmt: skip
    habituation_gain = Parameter(
        "1", "share of the responses left that a further vibration takes (assumed; at most about 0.35 by our "
        "sweeps)",
        start=0.2, min=0, max=1,
    )  # fmt: skip
    habituation_time = Parameter(
        "s", "time in which a rest leaves 37 % of the habituation (assumed)", start=1800, min=1, max=1e7
    )
    reward_relief = Parameter(
        "1", "share of the habituation that a reward takes, after a success (assumed)",
        start=0.5, min=0, max=1,
    )  # fmt: skip

    fatigue = Output("1", "how tired the animal is, from 0 to 1")
    habituation = Output("1", "how used to vibrations it is, from 0 to 1")

    tired = State("1", "fatigue", min=0, max=1)
    accustomed = State("1", "habituation", min=0, max=1)
    felt = State(Integer, "vibrations felt in this mission")

    def initialize_day(m) -> None:
        """Begin as the last mission and the rest after it have left the animal."""
        m.tired, m.accustomed = m.start_fatigue, m.start_habituation

    @before("hear_right")
    @triggered(
        lambda m: all_of(
            m.command != m.past_command, any_of(m.command == Command.RIGHT, m.command == Command.LEFT)
        ),
        "RIGHT or LEFT is new",
        seldom=True,
    )
    def feel(m) -> None:
        """Habituate to a vibration beyond the free ones; the response to it is less likely already."""
        m.felt = counted(m.felt)
        gain = where(m.felt > m.free_vibrations, m.habituation_gain, 0)
        m.accustomed = m.accustomed + gain * (1 - m.accustomed)

    @before("output")
    def tire(m) -> None:
        """Tire by the way of this tick; both states fade for a tick."""
        way = 0.5 * (m.past_velocity + m.velocity) * m.sample_time
        m.tired = left_over(m.fatigue_time, m.sample_time) * tired_by(m.tired, way, m.fatigue_way)
        m.accustomed = left_over(m.habituation_time, m.sample_time) * m.accustomed

    def _top_speed(m) -> SX:
        """The speed at which it cruises as tired as it is."""
        return m.trial_speed * (1 - m.fatigue_slows * m.tired)

    def _response_time(m) -> SX:
        """The delay of a response by an animal as tired as it is [s]."""
        return m.response_delay + m.fatigue_delays * m.tired

    def _heeds(m, success: SX) -> SX:
        """The probability that it obeys a vibration, from that of a rested and unaccustomed animal."""
        return success * (1 - m.fatigue_disobeys * m.tired) * (1 - m.accustomed)

    def _report(m) -> None:
        """The outputs of the animal, and of its day."""
        super()._report()
        m.fatigue, m.habituation = m.tired, m.accustomed


class CanineAllDay(Day, CanineInStreets):
    """The guided dog through a day of missions, among streets if any: it tires and habituates."""

    source = "ours, after Miller 2010, 4.1.4.2, 5.1.3, 5.2, 5.3.7.1; the dog: as canine_in_streets"


def tired_by(fatigue: Any, way: Any, fatigue_way: Any) -> Any:
    """Fatigue after a short way [m]."""
    return fatigue + (1 - fatigue) * (way / (fatigue_way + way))


def tired_after(fatigue: Any, way: Any, fatigue_way: float) -> Any:
    """Fatigue after a way of any length [m], in closed form; numbers, or arrays of one shape."""
    return 1 - (1 - fatigue) * math.e ** (-way / fatigue_way)


def left_over(time_constant: Any, tick: float) -> Any:
    """What a state with this time constant [s] keeps over a tick [s]."""
    return time_constant / (time_constant + tick)


def faded(time_constant: float, seconds: Any) -> Any:
    """What it keeps over so many seconds: that of as many ticks, in closed form."""
    return left_over(time_constant, TICK) ** (seconds / TICK)


def check_rest(rest: float) -> None:
    """Refuse a rest that no dog has [s].

    Raises:
        UsageError: it is negative, too long or no number.
    """
    if not 0 <= rest <= LONGEST_REST:
        raise UsageError(f"rest is {rest:g} s; expected 0 to {LONGEST_REST:g} s")


def rested(
    fatigue: Any, habituation: Any, rewarded: Any, rest: float, parameters: Mapping[str, float]
) -> tuple[Any, Any]:
    """Fatigue and habituation after a reward, if there was one, and a rest of so many seconds.

    Args:
        fatigue, habituation, rewarded: numbers, or arrays of one shape.
        parameters: of the animal; those left out have their start values.
    """
    starts = {name: variable.start[0] for name, variable in CanineAllDay.variables(Parameter).items()}
    own = starts | dict(parameters)
    relieved = habituation * (1 - own["reward_relief"] * rewarded)
    return faded(own["fatigue_time"], rest) * fatigue, faded(own["habituation_time"], rest) * relieved
