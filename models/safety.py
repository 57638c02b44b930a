"""The limits of leading: an animal is never over-cued, nor led on without end (rules of SAFETY.md).

They act in the readings that set `guarded`, and are off otherwise.
"""

from __future__ import annotations

from models.commands import Command, Status
from models.kit import casadi as ca
from models.kit.block import Block, moves, triggered
from models.kit.declaration import SX, Boolean, Integer, Output, Parameter, State
from models.kit.geometry import (
    COUNT_MAX,
    LONGEST,
    SHORT_COUNT_MAX,
    all_of,
    any_of,
    at_most,
    clip,
    counted,
    one_of,
    where,
)
from models.kit.timing import TICK, lasted, ticks_within
from models.modes import BEFORE_RECALL, LEADING, RECALLING, Anomaly, Mode

SURVEY = 5  # ticks from a survey to the next: 0.2 s
MOST = SHORT_COUNT_MAX
FAR = 1e6  # m: farther than any target


class Supervised(Block):
    """Base of a controller that is held to the limits: they run behind its own updates.

    The stimuli are counted as issues of LEFT and RIGHT, ticks of vibration and ticks of tone (in this order
    in all vectors). What may be spent is the least that leg, mission and window leave. A window is kept as
    two blocks of its length, of which any interval of that length touches two at most: so what both hold
    together is limited.
    """

    behind = True
    now: State
    ticks: State
    overruled: State
    override: SX
    target_north: State
    target_east: State
    base_north: State
    base_east: State
    anomalies: State
    north: SX
    east: SX
    valid: SX
    distance: Output
    command: Output
    mode: Output
    status: Output
    anomaly: Output
    stop_hold: Parameter

    guarded = Parameter(Boolean, "the limits are on (SAFETY.md)", start=0, structural=True)
    # rule 3: the budget
    leg_issues = Parameter(Integer, "LEFT and RIGHT that may be issued on a leg", start=8, min=0, max=MOST)
    leg_vibration = Parameter("s", "vibration on a leg, at most", start=24, min=0, max=1e5)
    leg_tone = Parameter("s", "tones on a leg, at most", start=300, min=0, max=1e5)
    mission_issues = Parameter(
        Integer, "LEFT and RIGHT issued in a mission, at most", start=60, min=0, max=MOST
    )
    mission_vibration = Parameter("s", "vibration in a mission, at most", start=180, min=0, max=1e5)
    mission_tone = Parameter("s", "tones in a mission, at most", start=1800, min=0, max=1e5)
    window = Parameter("s", "length of the sliding window", start=120, min=TICK, max=LONGEST)
    window_issues = Parameter(Integer, "LEFT and RIGHT issued in any window", start=40, min=0, max=MOST)
    window_vibration = Parameter("s", "vibration in any window, at most", start=80, min=0, max=1e5)
    window_tone = Parameter("s", "tones in any window, at most", start=240, min=0, max=1e5)
    longest_vibration = Parameter(
        "s", "longest LEFT or RIGHT; silent afterwards", start=5, min=0, max=LONGEST
    )
    longest_tone = Parameter(
        "s", "longest FORWARD or RECALL; silent afterwards", start=300, min=0, max=LONGEST
    )
    longest_stop = Parameter("s", "longest STOP of a trial; silent afterwards", start=10, min=0, max=LONGEST)
    # rule 4: standing still, going away, taking too long
    progress_time = Parameter(
        "s", "time under FORWARD or RECALL in which the animal must move on", start=20, min=TICK, max=LONGEST
    )
    progress_distance = Parameter("m", "how far it must move in that time", start=1, min=0, max=1e5)
    departing_distance = Parameter(
        "m", "how much farther from the target than before it may come", start=30, min=0, max=1e5
    )
    leg_time = Parameter("s", "longest leg", start=300, min=TICK, max=LONGEST)
    recall_time = Parameter("s", "longest recall", start=300, min=TICK, max=LONGEST)
    mission_time = Parameter("s", "longest mission, its recall included", start=1800, min=TICK, max=5e3)
    # rule 7: the fence
    fence_radius = Parameter("m", "farthest from home", start=1000, min=0, max=1e5)
    fence_width = Parameter(
        "m", "farthest from the line of the leg, to either side", start=50, min=0, max=1e5
    )
    fence_recall = Parameter(
        Boolean, "outside the fence the animal is recalled once it was stopped; else it is stopped", start=0
    )
    # rule 9
    resume = Parameter(Boolean, "a trial goes on after a lost link; else it ends with the link", start=0)

    cue = State(Command, "command that the limits leave, before it is silenced")
    cue_ticks = State(Integer, "ticks since it is that", min=0, max=MOST)
    spent = State(Integer, "issues, ticks of vibration, ticks of tone since power-up", size=3, max=COUNT_MAX)
    allowance = State(Integer, "what may have been spent, for now", size=3)
    mission_spent = State(Integer, "what was spent when the trial began", size=3)
    leg_spent = State(Integer, "what was spent when the leg began", size=3)
    block_spent = State(Integer, "what was spent when this block of the window began", size=3)
    earlier_spent = State(Integer, "what was spent when the block before it began", size=3)
    window_ticks = State(
        Integer,
        "ticks of this block; the first is over at once",
        start=MOST,
        min=0,
        max=MOST,
    )
    exhausted = State(Boolean, "a budget is spent, until the next trial begins")
    led = State(Boolean, "a trial is under way")
    fresh = State(Boolean, "a trial begins on this tick")
    turned = State(Boolean, "a leg begins on this tick")
    over = State(Boolean, "a block of the window is over")
    surveyed = State(Boolean, "a survey is due on this tick")
    survey_ticks = State(Integer, "ticks since the last survey", min=0, max=SURVEY)
    breach = State(Anomaly, "the limit that is broken on this tick", usual=Anomaly.NONE)
    recalling = State(Boolean, "the animal is recalled once it was stopped")
    towards_north = State("m", "target of the leg")
    towards_east = State("m", "target of the leg")
    from_north = State("m", "where the leg began")
    from_east = State("m", "where the leg began")
    moved_north = State("m", "where the animal was when it last had moved on")
    moved_east = State("m", "where the animal was when it last had moved on")
    still_ticks = State(Integer, "ticks under FORWARD or RECALL since then", min=0, max=MOST)
    leg_ticks = State(Integer, "ticks since the leg began", min=0, max=MOST)
    surveys = State(Integer, "surveys since the trial began", min=0, max=MOST)
    closest = State("m", "least distance to the target on this leg", start=FAR)

    @triggered("guarded", seldom="guarded")
    def attend(m) -> None:
        """Notice that a trial or a leg begins, or that a block of the window is over."""
        led = m.led
        m.led = all_of(m.now > Mode.IDLE, m.now < Mode.SUCCESS)
        m.fresh = all_of(m.led, one_of(m.now, BEFORE_RECALL), ca.logic_not(led))
        turned = any_of(m.target_north != m.towards_north, m.target_east != m.towards_east)
        m.turned = any_of(m.fresh, turned)
        m.window_ticks = _counted(m.window_ticks)
        m.over = lasted(m.window_ticks, m.window, m.sample_time)
        m.survey_ticks = where(m.survey_ticks < SURVEY - 1, m.survey_ticks + 1, 0)
        m.surveyed = all_of(m.led, m.survey_ticks == 0)

    @triggered("fresh", seldom=True)
    def refill(m) -> None:
        """A new trial has a new budget, but the window goes on (rule 3)."""
        m.mission_spent = m.spent
        m.exhausted = m.recalling = m.surveys = 0

    @triggered("turned", seldom=True)
    def begin_leg(m) -> None:
        """A new leg has its own part of the budget, and begins here (rules 3, 4, 7)."""
        m.leg_spent = m.spent
        m.towards_north, m.towards_east = m.target_north, m.target_east
        m.from_north, m.from_east = (where(m._placed(), here, 0) for here in (m.north, m.east))
        m.moved_north, m.moved_east = m.from_north, m.from_east
        m.leg_ticks = m.still_ticks = 0
        m.closest = FAR

    @triggered("over", seldom=True)
    def begin_block(m) -> None:
        """The window moves on by a block (rule 3)."""
        m.earlier_spent, m.block_spent = m.block_spent, m.spent
        m.window_ticks = 0

    @triggered(lambda m: any_of(m.turned, m.over), "`turned` or `over`", seldom=True)
    def allow(m) -> None:
        """What may have been spent at most: the least that leg, mission and window allow (rule 3)."""
        leg, mission, window = (
            ca.vertcat(
                getattr(m, f"{span}_issues"),
                ticks_within(getattr(m, f"{span}_vibration"), m.sample_time),
                ticks_within(getattr(m, f"{span}_tone"), m.sample_time),
            )
            for span in ("leg", "mission", "window")
        )
        m.allowance = at_most(at_most(m.leg_spent + leg, m.mission_spent + mission), m.earlier_spent + window)

    @triggered("guarded", seldom="guarded")
    def meter(m) -> None:
        """Refuse what the budget does not cover, silence what lasts too long, count the rest (3, 12)."""
        obeyed = any_of(m.override == Command.STOP, ca.logic_not(m.exhausted))
        commanded = all_of(m.override > Command.NONE, m.overruled == Anomaly.NONE, obeyed)
        held = lasted(m.ticks - 1, m.stop_hold, m.sample_time)
        command = where(any_of(m.led, commanded), m.command, where(held, Command.NONE, Command.STOP))
        directional = command >= Command.LEFT
        tone = all_of(command > Command.NONE, ca.logic_not(directional))
        issued = all_of(directional, command != m.cue)
        spent = all_of(
            ca.logic_not(m.exhausted),
            any_of(
                all_of(issued, m.spent[0] >= m.allowance[0]),
                all_of(directional, m.spent[1] >= m.allowance[1]),
                all_of(tone, command != Command.STOP, m.spent[2] >= m.allowance[2]),
            ),
        )
        m.exhausted = any_of(m.exhausted, spent)
        lost = all_of(m.overruled == Anomaly.LOST_LINK, m.led, ca.logic_not(m.resume))
        m.breach = where(spent, Anomaly.BUDGET_SPENT, where(lost, Anomaly.LOST_LINK, Anomaly.NONE))
        command = where(all_of(m.exhausted, command > Command.NONE), Command.STOP, command)
        m.cue_ticks = where(command != m.cue, 0, _counted(m.cue_ticks))
        m.cue = command
        stop = where(m.led, m.longest_stop, m.stop_hold)
        longest = where(directional, m.longest_vibration, m.longest_tone)
        longest = where(command == Command.STOP, stop, longest)
        sounds = ca.logic_not(lasted(m.cue_ticks, longest, m.sample_time))
        m.command = where(sounds, command, Command.NONE)
        vibrates = m.command >= Command.LEFT
        plays = all_of(m.command > Command.NONE, ca.logic_not(vibrates))
        issues = all_of(issued, command >= Command.LEFT)
        m.spent = ca.vertcat(*(counted(m.spent[i], c) for i, c in enumerate((issues, vibrates, plays))))

    @triggered("surveyed", seldom="guarded")
    def survey(m) -> None:
        """Does the animal get on, and within the fence (rules 4, 7)? A bad estimate tells no place.

        The time in which the controller is kept from deciding is no time under FORWARD or RECALL.
        """
        good = m._placed()
        m.leg_ticks, m.surveys = _counted(m.leg_ticks, SURVEY), _counted(m.surveys)
        longest = where(m._one_of(RECALLING), m.recall_time, m.leg_time)
        late = any_of(
            lasted(m.leg_ticks, longest, m.sample_time),
            lasted(m.surveys, m.mission_time, SURVEY * m.sample_time),
        )
        moved = _square(m.north - m.moved_north, m.east - m.moved_east) >= m.progress_distance**2
        moved = all_of(good, moved)
        led_on = any_of(m.cue == Command.FORWARD, m.cue == Command.RECALL)
        onward = all_of(led_on, m.override == Command.NONE)
        m.still_ticks = where(moved, 0, _counted(m.still_ticks, where(onward, SURVEY, 0)))
        m.moved_north = where(moved, m.north, m.moved_north)
        m.moved_east = where(moved, m.east, m.moved_east)
        still = lasted(m.still_ticks, m.progress_time, m.sample_time)
        m.closest = where(all_of(good, m.distance < m.closest), m.distance, m.closest)
        departing = all_of(good, m.distance > m.closest + m.departing_distance)
        outside = all_of(good, m._outside(), one_of(m.now, BEFORE_RECALL))
        breach: SX = ca.SX(Anomaly.NONE)
        for broken, anomaly in (
            (still, Anomaly.NO_PROGRESS),
            (departing, Anomaly.DEPARTING),
            (late, Anomaly.TIME_OUT),
            (outside, Anomaly.OUTSIDE_FENCE),
        ):
            breach = where(broken, anomaly, breach)
        m.breach = where(m.breach > Anomaly.NONE, m.breach, breach)

    @triggered("breach", seldom=True)
    @moves({m: Mode.STOPPED if m in LEADING else m for m in Mode})
    def halt(m) -> None:
        """A limit is broken: the trial ends in a stop that is held, and the animal is left alone."""
        fenced = all_of(m.breach == Anomaly.OUTSIDE_FENCE, m.fence_recall)
        m.recalling = all_of(m.led, fenced)
        m.now = where(m.led, Mode.STOPPED, m.now)
        m.ticks = m.cue_ticks = 0
        m.command = m.cue = ca.SX(Command.STOP)
        m.mode, m.led = m.now, 0
        m.status = where(m.now == Mode.STOPPED, Status.STOPPED, m.status)
        m.anomaly = m.breach

    @triggered(lambda m: m.anomaly > Anomaly.NONE, "`anomaly` is not NONE", seldom=True)
    def report(m) -> None:
        """Count each anomaly by its kind."""
        m.anomalies = ca.vertcat(
            *(m.anomalies[a - 1] + (m.anomaly == a) for a in Anomaly if a is not Anomaly.NONE)
        )

    @triggered(
        lambda m: all_of(m.recalling, m.now == Mode.STOPPED, lasted(m.ticks, m.stop_hold, m.sample_time)),
        "`recalling`, in STOPPED, once the stop has lasted `stop_hold`",
        seldom=True,
    )
    @moves({Mode.STOPPED: Mode.FAILURE_RECALL})
    def recall(m) -> None:
        """From outside the fence the animal is called home, if it is to be (rule 7)."""
        m.now, m.ticks, m.recalling = Mode.FAILURE_RECALL, 0, 0
        m.target_north, m.target_east = m.base_north, m.base_east

    def _placed(m) -> SX:
        """Does the estimate tell where the animal is?"""
        return all_of(m.valid, m.within("north", "east", "heading"))

    def _one_of(m, modes: frozenset[Mode]) -> SX:
        return any_of(*(m.now == mode for mode in sorted(modes)))

    def _outside(m) -> SX:
        """Is the animal too far from home, or from the line from where the leg began to its target?"""
        along_north, along_east = m.target_north - m.from_north, m.target_east - m.from_east
        north, east = m.north - m.from_north, m.east - m.from_east
        length = _square(along_north, along_east)
        part = (north * along_north + east * along_east) / where(length > 0, length, 1)
        part = clip(part, 0, 1)
        off = _square(north - part * along_north, east - part * along_east)
        away = _square(m.north - m.base_north, m.east - m.base_east)
        return any_of(off > m.fence_width**2, away > m.fence_radius**2)


def _counted(count: SX, more: SX | float = 1) -> SX:
    return counted(count, more, MOST - SURVEY)


def _square(north: SX, east: SX) -> SX:
    """The squared length of a vector."""
    return north**2 + east**2
