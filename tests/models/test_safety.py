"""The limits of leading, rule by rule of SAFETY.md; stimuli are counted from the commands alone."""

from __future__ import annotations

import math
from itertools import groupby, pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.cmec import Cmec
from models.commands import Command, Status
from models.modes import Anomaly, Mode
from tests.models.leading import Trial

SECOND = 25  # ticks
DIRECTIONS = (Command.LEFT, Command.RIGHT)
TONES = (Command.FORWARD, Command.STOP, Command.RECALL)
LIMITS = {"guarded": 1, "reset_turns": 1}
FREE = dict.fromkeys(
    (f"{span}_{what}" for span in ("leg", "mission", "window") for what in ("issues", "vibration", "tone")),
    3e4,
)  # s, issues: so much that nothing is spent


def guarded(**parameters: Any) -> Trial:
    """A trial with the limits on, all of them wide but those that are set."""
    return Trial(**(LIMITS | FREE | parameters))


def vibrating(commands: list[Command]) -> int:
    """Ticks of vibration."""
    return sum(command in DIRECTIONS for command in commands)


def sounding(commands: list[Command]) -> int:
    """Ticks of tone."""
    return sum(command in TONES for command in commands)


def issues(commands: list[Command]) -> int:
    """How often LEFT or RIGHT begins."""
    return sum(b in DIRECTIONS and b != a for a, b in pairwise([Command.NONE, *commands]))


def reported(trial: Trial, anomaly: Anomaly) -> list[int]:
    """The ticks on which an anomaly was reported."""
    return [tick for tick, other in trial.anomalies if other == anomaly]


def walk(trial: Trial, north: float, to: float, speed: float = 1.0) -> None:
    """Move from a place on the meridian to another, tick by tick, until the command is no longer FORWARD."""
    way = 0.0
    while way < abs(to - north) and trial.commands[-1:] in ([], [Command.FORWARD]):
        trial.tick(north=north + math.copysign(way, to - north), speed=speed)
        way += speed / SECOND


# Rule 2: a cue of direction to an animal at rest alone


@pytest.mark.parametrize("speed", [0.31, -0.31, -1.5])
def test_rule_2_an_animal_that_moves_either_way_gets_no_direction(speed: float) -> None:
    trial = Trial()
    trial.tick(h=60, speed=speed)
    assert trial.tick(10 * SECOND) == Command.STOP
    assert vibrating(trial.commands) == 0


def test_rule_2_an_animal_whose_speed_is_not_sure_gets_no_direction() -> None:
    trial = Trial(rest_speed_sd=1.0)
    trial.tick(h=60, speed=0, speed_sd=1.01)
    assert trial.tick(10 * SECOND) == Command.STOP
    assert trial.tick(speed_sd=1.0) == Command.RIGHT


# Rule 3: the budget


def test_rule_3_an_animal_that_ignores_its_turn_is_vibrated_for_no_longer_than_a_leg_allows() -> None:
    # given an animal that stands at 60 deg and never turns
    trial = Trial(**LIMITS)
    trial.tick(h=60, speed=0)
    # when ten minutes pass
    trial.tick(100 * SECOND)
    # then: 8 issues of 3 s, which end in a stop that is held for 1.5 s, and in silence
    assert vibrating(trial.commands) == 24 * SECOND
    assert issues(trial.commands) == 8
    (end,) = reported(trial, Anomaly.BUDGET_SPENT)
    assert trial.commands[end : end + 38] == [Command.STOP] * 38
    assert set(trial.commands[end + 38 :]) == {Command.NONE}
    assert (trial.mode, trial.status) == (Mode.STOPPED, Status.STOPPED)


@pytest.mark.parametrize("span", ["leg", "mission", "window"])
@pytest.mark.parametrize(("what", "limit"), [("issues", 3), ("vibration", 7.0), ("tone", 11.0)])
def test_rule_3_each_span_limits_each_stimulus_to_the_tick(span: str, what: str, limit: float) -> None:
    # given one limit in force
    trial = guarded(**{f"{span}_{what}": limit}, forward_timeout=1e3, progress_time=1e3)
    # when the animal stands still, under FORWARD or before a turn
    if what == "tone":
        trial.tick(40 * SECOND, speed=0)
    else:
        trial.tick(h=60, speed=0)
        trial.tick(40 * SECOND)
    # then
    spent = {"issues": issues, "vibration": vibrating, "tone": sounding}[what](trial.commands)
    held = 38 if what == "tone" else 0  # the stop at the end is a tone, too
    assert spent == limit * (1 if what == "issues" else SECOND) + held
    assert len(reported(trial, Anomaly.BUDGET_SPENT)) == 1
    assert trial.commands[-1] == Command.NONE


def test_rule_3_a_new_leg_has_a_budget_of_its_own_and_the_mission_has_one() -> None:
    # given two legs of 5 s of vibration, of which the mission allows 8 s
    trial = guarded(
        leg_vibration=5.0,
        mission_vibration=8.0,
        max_turns=100,
        route={"waypoint_count": 2, "waypoint_north[1]": 0.0, "waypoint_north[2]": 1000.0},
    )
    trial.tick(h=0, north=-20.0, speed=0)
    trial.tick(h=60)
    trial.tick(7 * SECOND)
    first = vibrating(trial.commands)
    assert 3 * SECOND <= first < 5 * SECOND
    # when the first waypoint is won and the second leg begins
    trial.tick(3 * SECOND, north=0.0)
    assert trial.model["waypoint"] == 1
    trial.tick(40 * SECOND)
    # then
    assert vibrating(trial.commands) == 8 * SECOND


def test_rule_3_the_window_forgets() -> None:
    # given 4 s of vibration in any 10 s, and an operator who holds LEFT for 3 s in every 20
    trial = guarded(window=10.0, window_vibration=4.0)
    for _ in range(4):
        trial.tick(3 * SECOND, override=Command.LEFT)
        trial.tick(17 * SECOND, override=Command.NONE, north=trial.model["north"] + 2)
    # then
    assert reported(trial, Anomaly.BUDGET_SPENT) == []
    assert vibrating(trial.commands) >= 12 * SECOND


def test_rule_3_a_trial_that_begins_with_a_turn_has_its_budget_too() -> None:
    # given a spent budget, and an animal that looks aside when it is begun anew: FORWARD is never told
    trial = Trial(**LIMITS)
    trial.tick(h=60, speed=0)
    trial.tick(45 * SECOND)
    assert trial.status == Status.STOPPED
    trial.tick(2 * SECOND, start=0)
    before = vibrating(trial.commands)
    trial.tick(120 * SECOND, start=1)  # when the window has forgotten some
    # then
    assert vibrating(trial.commands) == before + 24 * SECOND


def test_rule_3_a_new_start_does_not_empty_the_window() -> None:
    # given a window that is spent
    trial = guarded(window=40.0, window_vibration=4.0)
    trial.tick(4 * SECOND, override=Command.LEFT)
    # when the trial is begun anew within it, and the animal looks aside
    trial.tick(2 * SECOND, override=Command.NONE, start=0)
    trial.tick(start=1, h=60, speed=0)
    trial.tick(5 * SECOND)
    # then
    assert vibrating(trial.commands) == 4 * SECOND
    assert len(reported(trial, Anomaly.BUDGET_SPENT)) == 1


def test_rule_3_a_direction_that_the_operator_holds_falls_silent() -> None:
    trial = Trial(**LIMITS)
    trial.tick(60 * SECOND, override=Command.LEFT)
    assert vibrating(trial.commands) == 5 * SECOND
    assert set(trial.commands[5 * SECOND :]) == {Command.NONE}


@pytest.mark.parametrize("start", [0, 1])
def test_rule_3_an_operator_who_repeats_a_direction_spends_the_budget_too(start: int) -> None:
    # given a vest with a trial under way, or switched on alone
    trial = Trial(**LIMITS)
    trial.tick(start=start)
    # when LEFT and RIGHT are sent in turn, a second each
    for _ in range(60):
        trial.tick(SECOND, override=Command.LEFT)
        trial.tick(SECOND, override=Command.RIGHT)
    # then eight are issued, then STOP, which the operator cannot beat
    assert issues(trial.commands) == 8
    assert set(trial.commands[8 * SECOND + 1 + 38 :]) == {Command.NONE}
    assert len(reported(trial, Anomaly.BUDGET_SPENT)) == 1
    # and STOP is always obeyed, for as long as it is held
    trial.tick(2, override=Command.NONE)
    trial.tick(10 * SECOND, override=Command.STOP)
    assert trial.phases()[-2:] == [("STOP", 38), ("NONE", 10 * SECOND - 38)]


@pytest.mark.parametrize("start", [0, 1])
def test_rule_3_a_refused_command_is_answered_by_one_stop_however_often_it_is_sent(start: int) -> None:
    # given an operator who sends LEFT for a second in every two
    trial = Trial(**LIMITS)
    trial.tick(start=start)
    for _ in range(60):
        trial.tick(SECOND, override=Command.LEFT)
        trial.tick(SECOND, override=Command.NONE)
    # then: the ninth is refused on its first tick, and the stop that ends all is held
    (end,) = reported(trial, Anomaly.BUDGET_SPENT)
    assert end == 8 * 2 * SECOND + 1
    assert trial.commands[end : end + 38] == [Command.STOP] * 38
    assert set(trial.commands[end + 38 :]) == {Command.NONE}


@pytest.mark.parametrize("command", [Command.FORWARD, Command.RECALL, Command.LEFT, Command.RIGHT])
def test_rule_3_only_a_new_start_fills_the_budget(command: Command) -> None:
    # given a spent budget
    trial = Trial(**LIMITS, longest_tone=1e3, leg_tone=5.0)
    for _ in range(20):
        trial.tick(SECOND, override=Command.LEFT)
        trial.tick(override=Command.NONE)
    assert trial.model["mode"] == Mode.STOPPED
    # when the operator lets go, and commands again
    trial.tick(10 * SECOND, override=Command.NONE)
    trial.tick(SECOND, override=command)
    assert command not in trial.commands[-SECOND:]
    # when the start signal is withdrawn and given anew
    trial.tick(3 * SECOND, override=Command.NONE, start=0)
    assert trial.mode == Mode.IDLE
    assert trial.tick(start=1) == Command.FORWARD
    assert trial.tick(override=command) == command


def test_rule_3_a_stop_that_is_ignored_falls_silent() -> None:
    trial = Trial(**LIMITS)
    trial.tick(h=60, speed=2)
    trial.tick(60 * SECOND)
    assert trial.phases()[0] == ("STOP", 10 * SECOND)
    assert set(trial.commands[10 * SECOND :]) == {Command.NONE}


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(1, 3 * SECOND),
            st.sampled_from([Command.NONE, Command.LEFT, Command.RIGHT, Command.FORWARD, Command.RECALL]),
            st.sampled_from([-170.0, -60.0, 0.0, 60.0]),
            st.sampled_from([0.0, 0.2, 2.0]),
        ),
        min_size=5,
        max_size=25,
    )
)
def test_rule_3_holds_whatever_operator_and_animal_do(acts: list[tuple[int, Command, float, float]]) -> None:
    # given
    trial = guarded(
        leg_issues=5, mission_vibration=6.0, window=4.0, window_vibration=3.0, longest_vibration=2.0,
        window_issues=4, max_turns=100,
    )  # fmt: skip
    trial.tick()
    # when
    for ticks, override, h, speed in acts:
        trial.tick(ticks, override=override, h=h, speed=speed)
    # then
    vibration = [command in DIRECTIONS for command in trial.commands]
    assert sum(vibration) <= 6 * SECOND
    windows = [sum(vibration[i : i + 4 * SECOND]) for i in range(len(vibration))]
    assert max(windows) <= 3 * SECOND
    assert issues(trial.commands) <= 5
    longest = max((len(list(g)) for c, g in groupby(trial.commands) if c in DIRECTIONS), default=0)
    assert longest <= 2 * SECOND


def test_rule_3_a_new_start_fills_the_budget_of_the_mission() -> None:
    # given a mission that may vibrate for 4 s, and an animal that never turns
    trial = guarded(mission_vibration=4.0, max_turns=100)
    trial.tick(h=60, speed=0)
    trial.tick(10 * SECOND)
    assert vibrating(trial.commands) == 4 * SECOND
    # when it is begun anew
    trial.tick(2 * SECOND, start=0)
    trial.tick(10 * SECOND, start=1)
    # then
    assert vibrating(trial.commands) == 8 * SECOND


@pytest.mark.parametrize(("tick", "allowed"), [(99, False), (100, True)])
def test_rule_3_the_window_forgets_a_block_to_the_tick(tick: int, allowed: bool) -> None:
    # given blocks of 2 s, and a second of vibration in the first of them
    trial = guarded(window=2.0, window_vibration=1.0)
    trial.tick(10, start=0)
    trial.tick(25, override=Command.LEFT)
    trial.tick(tick - 35, override=Command.NONE)
    # when it is asked for again, then it is forgotten with the end of the second
    assert trial.tick(override=Command.LEFT) == (Command.LEFT if allowed else Command.STOP)


@pytest.mark.parametrize("tone", [Command.FORWARD, Command.RECALL])
def test_rule_3_silence_turns_and_stop_need_none_of_the_budget_of_tones(tone: Command) -> None:
    # given 100 ticks of tone, of which the stop at power-up takes 38
    trial = guarded(leg_tone=4.0)
    trial.tick(38, start=0)
    trial.tick(30, override=tone)
    trial.tick(5, override=Command.NONE)
    trial.tick(5, override=Command.LEFT)
    assert trial.tick(32, override=tone) == tone
    # when the others follow
    for other in (Command.NONE, Command.LEFT, Command.STOP):
        assert trial.tick(10, override=other) == other
    # then the next tone is the first that is refused
    assert reported(trial, Anomaly.BUDGET_SPENT) == []
    assert trial.tick(override=tone) == Command.STOP
    assert reported(trial, Anomaly.BUDGET_SPENT) == [140]


def test_rule_3_a_turn_that_is_refused_is_not_counted_as_spent() -> None:
    # given 25 ticks on a leg and 50 in the window, and a trial that ends by the 26th
    trial = guarded(leg_vibration=1.0, window_vibration=2.0)
    trial.tick()
    trial.tick(26, override=Command.LEFT)
    assert trial.commands[-2:] == [Command.LEFT, Command.STOP]
    # when another begins
    trial.tick(2 * SECOND, override=Command.NONE, start=0)
    trial.tick(start=1)
    trial.tick(30, override=Command.LEFT)
    # then it has its 25
    assert vibrating(trial.commands) == 50


def test_rule_3_an_issue_that_is_refused_is_not_counted_as_spent() -> None:
    # given one issue on a leg and two in the window, and a trial that ends by the second
    trial = guarded(leg_issues=1, window_issues=2)
    trial.tick()
    for override in (Command.LEFT, Command.NONE, Command.LEFT):
        trial.tick(override=override)
    assert trial.commands[-1] == Command.STOP
    # when another begins, then it has its one
    trial.tick(2 * SECOND, override=Command.NONE, start=0)
    trial.tick(start=1)
    assert trial.tick(override=Command.LEFT) == Command.LEFT


def test_rule_3_a_tone_that_is_refused_is_counted_as_the_stop_that_sounds() -> None:
    # given 25 ticks on a leg and 88 in the window, and a trial that ends by the 26th in a stop of 38
    trial = guarded(leg_tone=1.0, window_tone=3.52)
    trial.tick(26)
    trial.tick(3 * SECOND, start=0)
    assert trial.phases() == [("FORWARD", 25), ("STOP", 38), ("NONE", 26 + 3 * SECOND - 25 - 38)]
    # when another begins
    trial.tick(30, start=1)
    # then it has its 25
    assert trial.commands.count(Command.FORWARD) == 50


# Rule 4: standing still, going away, taking too long


def test_rule_4_an_animal_that_never_goes_is_left_alone() -> None:
    trial = Trial(**LIMITS)
    trial.tick(60 * SECOND, speed=0)
    (end,) = reported(trial, Anomaly.NO_PROGRESS)
    assert end <= 27 * SECOND  # 20 s of FORWARD, in pieces of 3 s with a second between
    assert set(trial.commands[end + 38 :]) == {Command.NONE}
    assert len(reported(trial, Anomaly.FORWARD_FAILURE)) >= 5


def test_rule_4_the_time_that_an_animal_stood_is_not_held_against_it_in_the_next_trial() -> None:
    trial = Trial(**LIMITS)
    trial.tick(30 * SECOND, speed=0)
    assert len(reported(trial, Anomaly.NO_PROGRESS)) == 1
    trial.tick(4 * SECOND, start=0)
    # when another begins
    trial.tick(15 * SECOND, start=1)
    # then it has its whole time to go
    assert trial.status == Status.RUNNING


def test_rule_4_an_animal_that_sits_down_on_its_way_is_noticed() -> None:
    # given one that walks for 30 s
    trial = Trial(**LIMITS)
    walk(trial, 0, 30)
    assert trial.commands[-1] == Command.FORWARD
    # when it sits down
    trial.tick(20 * SECOND + 5, speed=0)
    # then: 20 s later
    assert len(reported(trial, Anomaly.NO_PROGRESS)) == 1
    assert trial.status == Status.STOPPED


@pytest.mark.parametrize("mode", [Mode.RECALL, Mode.FAILURE_RECALL])
def test_rule_4_a_recall_that_is_ignored_ends(mode: Mode) -> None:
    trial = Trial(**LIMITS, max_turns=0, route={"waypoint_north[1]": 60.0 if mode is Mode.RECALL else 1000.0})
    trial.tick(north=60.0, h=0, speed=0)
    trial.tick(2 * SECOND, **({} if mode is Mode.RECALL else {"h": 60}))
    trial.tick(2 * SECOND)
    assert trial.mode == mode
    trial.tick(60 * SECOND)
    assert len(reported(trial, Anomaly.NO_PROGRESS)) == 1
    assert trial.commands[-1] == Command.NONE


def test_rule_4_an_animal_that_goes_away_from_its_target_is_stopped() -> None:
    # given an animal whose heading reads as if it looked at the target, and that walks the other way
    trial = Trial(**LIMITS)
    walk(trial, 100, -200, speed=5)
    # then: 30 m later
    (end,) = reported(trial, Anomaly.DEPARTING)
    assert 30 / 5 * SECOND <= end <= 30 / 5 * SECOND + 10  # two surveys


@pytest.mark.parametrize(
    ("limit", "at"), [({"leg_time": 12.0}, 12), ({"mission_time": 14.0}, 14), ({"leg_time": 1e3}, None)]
)
def test_rule_4_a_leg_and_a_mission_end_in_time(limit: dict[str, float], at: float | None) -> None:
    trial = guarded(**limit)
    walk(trial, 0, 40)
    assert [(end + 5) // SECOND for end in reported(trial, Anomaly.TIME_OUT)] == ([at] if at else [])


def test_rule_4_a_recall_ends_in_time() -> None:
    # given a recall of at most 6 s, whose animal walks home
    trial = guarded(recall_time=6.0, route={"waypoint_north[1]": 60.0})
    trial.tick(north=60.0, speed=0)
    trial.until(Command.RECALL)
    began = len(trial.commands)
    for k in range(8 * SECOND):
        trial.tick(north=60.0 - k / SECOND, speed=1, heading=math.pi)
    (end,) = reported(trial, Anomaly.TIME_OUT)
    assert 6 * SECOND <= end - began + 5 <= 6 * SECOND + 10


def test_rule_4_a_bad_estimate_is_neither_progress_nor_departure() -> None:
    # given: an operator's FORWARD masks that the estimate is no number
    trial = Trial(**LIMITS, longest_tone=1e3)
    trial.tick(5 * SECOND, override=Command.FORWARD, north=math.nan)
    # when it comes back
    trial.tick(5 * SECOND, override=Command.NONE, north=0.0)
    walk(trial, 0, 20)
    # then
    assert not {Anomaly.DEPARTING, Anomaly.NO_PROGRESS, Anomaly.OUTSIDE_FENCE} & {
        a for _, a in trial.anomalies
    }


@pytest.mark.parametrize(
    ("limit", "anomaly"),
    [
        ("leg_time", Anomaly.TIME_OUT),
        ("mission_time", Anomaly.TIME_OUT),
        ("progress_time", Anomaly.NO_PROGRESS),
    ],
)
def test_rule_4_a_time_is_held_against_the_ticks_at_each_survey(limit: str, anomaly: Anomaly) -> None:
    # given a limit of 6 ticks
    trial = guarded(**{limit: 0.24})
    # when an animal stands, then the second survey, of 10 ticks, is the first that finds it broken
    trial.tick(SECOND, speed=0)
    assert reported(trial, anomaly) == [9]


def test_rule_4_how_long_an_animal_may_stand_does_not_depend_on_the_place() -> None:
    ends = []
    for place in (0.0, 10.0):
        trial = guarded(progress_time=2.0)
        trial.tick(3 * SECOND, north=place, speed=0)
        ends += reported(trial, Anomaly.NO_PROGRESS)
    # 10 surveys of 5 ticks
    assert ends == [49, 49]


@pytest.mark.parametrize("time", [0.84, 1.0])
@pytest.mark.parametrize("along", ["north", "east"])
@pytest.mark.parametrize(("way", "end"), [(2.97, 24), (3.0, 44), (-2.97, 24), (-3.0, 44)])
def test_rule_4_an_animal_moves_on_by_its_distance_from_where_it_last_had(
    time: float, along: str, way: float, end: int
) -> None:
    # given 5 surveys, 21 to 25 ticks, for 3 m; and all directions right
    trial = guarded(
        progress_time=time, progress_distance=3.0, fence_width=1e5, moving_deviation=4.0, stop_deviation=4.0
    )
    # when it moves in two steps, and half as far again
    trial.tick(10, **{along: 50.0}, speed=0)
    trial.tick(5, **{along: 50.0 + way / 2})
    trial.tick(10, **{along: 50.0 + way})
    trial.tick(SECOND, **{along: 50.0 + 1.5 * way} if end > 24 else {})
    # then its time began anew at the survey on tick 19, or never
    assert reported(trial, Anomaly.NO_PROGRESS) == [end]


def test_rule_4_the_time_of_a_stop_is_no_time_under_forward() -> None:
    # given 20 ticks under FORWARD, of 25 without progress
    trial = guarded(progress_time=1.0, stop_hold=0.04)
    trial.tick(20, speed=0)
    # when a stop of a second comes between
    trial.tick(25, override=Command.STOP)
    trial.tick(10, override=Command.NONE)
    # then the survey on tick 49 adds the last five
    assert reported(trial, Anomaly.NO_PROGRESS) == [49]


def test_rule_4_a_command_that_has_fallen_silent_is_still_that_command() -> None:
    # given FORWARD that sounds for 10 of the 20 ticks in which an animal must move
    trial = guarded(progress_time=0.8, longest_tone=0.4, forward_timeout=1e3)
    trial.tick(SECOND, speed=0)
    assert trial.phases()[:2] == [("FORWARD", 10), ("NONE", 9)]
    # then the time in which it is silent counts
    assert reported(trial, Anomaly.NO_PROGRESS) == [19]


def test_rule_4_an_invalid_estimate_tells_no_place() -> None:
    # given a recall
    trial = guarded(progress_time=2.0, recall_time=1e3, route={"waypoint_north[1]": 60.0})
    trial.tick(north=60.0, speed=0)
    trial.until(Command.RECALL)
    trial.tick(10)
    # when places come that may not be trusted
    for k in range(30):
        trial.tick(valid=0, north=60.0 + 5 * k)
    # then the animal has neither departed nor moved on
    assert reported(trial, Anomaly.DEPARTING) == []
    trial.tick(2 * SECOND, valid=1, north=60.0)
    assert len(reported(trial, Anomaly.NO_PROGRESS)) == 1


@pytest.mark.parametrize("keeps", [{"override": Command.STOP}, {"valid": 0}, {"link_ok": 0}])
@pytest.mark.parametrize("mode", [Mode.RECALL, Mode.FAILURE_RECALL])
def test_rule_4_the_time_for_which_a_recall_is_kept_back_is_not_held_against_the_animal(
    mode: Mode, keeps: dict[str, float]
) -> None:
    # given a recall, and an animal that has stood for a second of 2
    recalled = {} if mode is Mode.RECALL else {"h": 60}
    trial = guarded(
        progress_time=2.0, resume=1, max_turns=0,
        route={"waypoint_north[1]": 60.0 if mode is Mode.RECALL else 1000.0},
    )  # fmt: skip
    trial.tick(north=60.0, h=0, speed=0)
    trial.until(Command.RECALL, **recalled)
    trial.tick(SECOND)
    # when the operator, a bad estimate or a lost link keeps it from going on
    trial.tick(5 * SECOND, **keeps)
    # then the trial is not over, and it has the other second
    trial.tick(SECOND - 10, override=Command.NONE, valid=1, link_ok=1)
    assert trial.mode == mode
    assert reported(trial, Anomaly.NO_PROGRESS) == []
    trial.tick(20)
    assert len(reported(trial, Anomaly.NO_PROGRESS)) == 1


def test_rule_4_and_7_a_place_of_an_invalid_estimate_is_not_the_closest_nor_outside() -> None:
    trial = guarded()
    trial.tick(5)
    trial.tick(5, valid=0, north=500.0)
    trial.tick(5, north=0.0, east=60.0)
    trial.tick(5, valid=1, east=0.0)
    assert trial.status == Status.RUNNING


def test_each_anomaly_is_counted_by_its_kind() -> None:
    trial = guarded(progress_time=1e3)
    trial.tick(20 * SECOND, speed=0)
    # 3 s of FORWARD and 1 s without a command, five times
    assert len(reported(trial, Anomaly.FORWARD_FAILURE)) == 5
    assert [trial.model[f"anomalies[{k}]"] for k in range(1, len(Anomaly))] == [5] + [0] * (len(Anomaly) - 2)


def test_a_budget_that_is_spent_without_a_trial_stops_none_and_the_next_may_begin_at_once() -> None:
    trial = guarded(leg_issues=0)
    trial.tick(2 * SECOND, start=0)
    assert trial.tick(override=Command.LEFT) == Command.STOP
    assert reported(trial, Anomaly.BUDGET_SPENT) == [2 * SECOND]
    assert (trial.mode, trial.status) == (Mode.IDLE, Status.IDLE)
    assert trial.tick(override=Command.NONE, start=1) == Command.FORWARD


def test_rule_4_an_animal_departs_by_more_than_30_m_from_its_closest_to_the_target() -> None:
    # given a target 1000 m to the north, and an animal that came as near as 900 m
    trial = guarded(moving_deviation=4.0, stop_deviation=4.0, fence_width=1e5)
    for north in (0.0, 100.0, 90.0, 70.0):
        trial.tick(5, north=north)
    assert reported(trial, Anomaly.DEPARTING) == []
    trial.tick(5, north=69.5)
    assert reported(trial, Anomaly.DEPARTING) == [24]


def test_rule_4_the_next_leg_has_its_time_where_its_target_lies_east_of_the_last() -> None:
    # given legs of at most 8 s, the second due east
    trial = guarded(
        leg_time=8.0, progress_time=1e3, forward_timeout=1e3,
        route={"waypoint_count": 2, "waypoint_north[1]": 0.0, "waypoint_east[2]": 1000.0},
    )  # fmt: skip
    # when the first lasts for 6 s
    trial.tick(6 * SECOND)
    trial.tick(8 * SECOND - 5, speed=0, heading=math.pi / 2)
    # then
    assert trial.model["waypoint"] == 1
    assert reported(trial, Anomaly.TIME_OUT) == []
    trial.tick(10)
    assert len(reported(trial, Anomaly.TIME_OUT)) == 1


def test_rule_4_a_recall_from_outside_the_fence_belongs_to_the_mission() -> None:
    # given a mission of 13 s, 65 surveys, whose animal is outside the fence at the 51st
    trial = guarded(fence_radius=10.0, fence_recall=1, mission_time=13.0)
    walk(trial, 0, 15)
    assert reported(trial, Anomaly.OUTSIDE_FENCE) == [51 * 5 - 1]
    # when it is recalled, and comes no nearer
    trial.until(Command.RECALL)
    began = len(trial.commands)
    trial.tick(4 * SECOND)
    # then there are 14 surveys left
    (end,) = reported(trial, Anomaly.TIME_OUT)
    assert 13 * 5 <= end - began <= 14 * 5


def test_rule_4_a_recall_that_begins_with_a_bad_estimate_sees_the_animal_move() -> None:
    # given a recall from outside the fence, and no number for a place on its first ticks
    trial = guarded(fence_radius=25.0, fence_recall=1, progress_time=2.0)
    walk(trial, 0, 40)
    trial.tick(38)
    trial.tick(5, north=math.nan)
    assert trial.mode == Mode.FAILURE_RECALL
    # when the animal comes home at 1 m/s
    for k in range(4 * SECOND):
        trial.tick(north=25.0 - k / SECOND)
    # then
    assert reported(trial, Anomaly.NO_PROGRESS) == []
    assert trial.commands[-1] == Command.RECALL


# Rule 7: the fence


@pytest.mark.parametrize(
    ("place", "outside"),
    [
        ({"east": 49.9}, False),
        ({"east": 50.1}, True),
        ({"east": -50.1}, True),
        ({"east": 50.0}, False),
        ({"north": 999.0}, False),
        ({"north": 1049.9}, False),
        ({"north": 1050.1}, True),  # beyond the target
        ({"north": -49.0}, False),
        ({"north": -51.0}, True),  # behind the start
    ],
)
def test_rule_7_the_animal_stays_near_the_line_of_its_leg(place: dict[str, float], outside: bool) -> None:
    trial = guarded(departing_distance=1e5, moving_deviation=4.0, stop_deviation=4.0, fence_radius=1e5)
    trial.tick(5)
    trial.tick(10, **place)
    assert bool(reported(trial, Anomaly.OUTSIDE_FENCE)) is outside
    assert (trial.status == Status.STOPPED) is outside


@pytest.mark.parametrize(("off", "outside"), [(49.9, False), (50.1, True)])
def test_rule_7_the_line_of_a_leg_begins_where_the_animal_was(off: float, outside: bool) -> None:
    # given a leg from 300 m north, 400 m east to the origin
    trial = guarded(moving_deviation=4.0, stop_deviation=4.0, route={"waypoint_north[1]": 0.0})
    trial.tick(5, north=300.0, east=400.0)
    # when the animal is beside its middle
    trial.tick(5, north=150.0 + 0.8 * off, east=200.0 - 0.6 * off)
    # then
    assert bool(reported(trial, Anomaly.OUTSIDE_FENCE)) is outside


def test_rule_7_the_animal_stays_near_home() -> None:
    trial = guarded(fence_radius=25.0)
    walk(trial, 0, 40)
    (end,) = reported(trial, Anomaly.OUTSIDE_FENCE)
    assert 25 * SECOND < end <= 25 * SECOND + 6
    # then it is stopped on that tick, and left alone
    assert (trial.commands[-1], trial.status) == (Command.STOP, Status.STOPPED)
    trial.tick(3 * SECOND)
    assert (trial.commands[-1], trial.mode) == (Command.NONE, Mode.STOPPED)


@pytest.mark.parametrize(("east", "outside"), [(50.0, False), (50.1, True)])
def test_rule_7_a_leg_to_where_it_began_has_a_fence_too(east: float, outside: bool) -> None:
    trial = guarded(route={"waypoint_north[1]": 0.0})
    trial.tick(5)
    trial.tick(5, east=east)
    assert bool(reported(trial, Anomaly.OUTSIDE_FENCE)) is outside


@pytest.mark.parametrize(("east", "outside"), [(20.0, False), (20.1, True)])
def test_rule_7_the_radius_is_about_home(east: float, outside: bool) -> None:
    # given a radius of 25 m about 100 m north, 200 m west, and a target there
    trial = guarded(
        fence_radius=25.0, home_north=100.0, home_east=-200.0,
        route={"waypoint_north[1]": 100.0, "waypoint_east[1]": -200.0},
    )  # fmt: skip
    # when the animal is 15 m north of it
    trial.tick(10, north=115.0, east=-200.0 + east)
    assert bool(reported(trial, Anomaly.OUTSIDE_FENCE)) is outside


def test_rule_7_no_other_limit_is_answered_by_a_recall() -> None:
    trial = guarded(leg_time=2.0, fence_recall=1)
    trial.tick(6 * SECOND)
    assert len(reported(trial, Anomaly.TIME_OUT)) == 1
    assert trial.mode == Mode.STOPPED


def test_rule_7_who_withdraws_the_start_is_obeyed_before_and_in_a_recall_from_outside() -> None:
    # given an animal that was stopped outside
    trial = guarded(fence_radius=25.0, fence_recall=1)
    walk(trial, 0, 40)
    # when the start is withdrawn before it is recalled
    trial.tick(4 * SECOND, start=0)
    # then it never is
    assert trial.mode == Mode.IDLE
    assert Command.RECALL not in trial.commands
    # when it is withdrawn in a recall, if for a tick alone
    trial.tick(SECOND, start=1)
    trial.until(Command.RECALL)
    trial.tick(start=0)
    trial.tick(3 * SECOND, start=1)
    # then that is over for good
    assert trial.status == Status.STOPPED


def test_rule_7_it_can_be_recalled_from_outside() -> None:
    # given
    trial = guarded(fence_radius=25.0, fence_recall=1)
    walk(trial, 0, 40)
    assert trial.model["mode"] == Mode.STOPPED
    # when the stop was held
    trial.tick(37)
    assert trial.commands[-38:] == [Command.STOP] * 38
    # then
    assert trial.tick(2) == Command.RECALL
    assert trial.model["mode"] == Mode.FAILURE_RECALL
    assert trial.status == Status.FAILED
    trial.tick(SECOND, north=6.0)
    assert trial.mode == Mode.FAILED
    assert len(reported(trial, Anomaly.OUTSIDE_FENCE)) == 1


# Rule 9: nothing resumes


@pytest.mark.parametrize("resume", [0, 1])
def test_rule_9_a_trial_ends_with_its_link_unless_it_may_resume(resume: int) -> None:
    trial = Trial(**LIMITS, resume=resume)
    walk(trial, 0, 2)
    trial.tick(link_ok=0)
    assert trial.tick(2 * SECOND) == (Command.STOP if resume else Command.NONE)
    trial.tick(3 * SECOND, link_ok=1, speed=0)
    assert (trial.commands[-1] == Command.FORWARD) is bool(resume)
    assert len(reported(trial, Anomaly.LOST_LINK)) == 1
    assert trial.model["anomalies[6]"] == 1


# Rule 12: what the vest plays when nobody leads


def test_rule_12_a_stop_when_switched_on_then_silence() -> None:
    trial = Trial(**LIMITS)
    trial.tick(10 * SECOND, start=0)
    assert trial.phases() == [("STOP", 38), ("NONE", 10 * SECOND - 38)]


@pytest.mark.parametrize("cause", [{"link_ok": 0}, {"valid": 0}, {"north": math.nan}])
def test_rule_12_trouble_before_a_trial_does_not_lengthen_the_stop(cause: dict[str, float]) -> None:
    trial = Trial(**LIMITS)
    trial.tick(10 * SECOND, start=0, **cause)
    assert trial.phases() == [("STOP", 38), ("NONE", 10 * SECOND - 38)]


def test_rule_12_the_stop_when_switched_on_ends_after_its_time_whatever_the_operator_sent_meanwhile() -> None:
    for ticks, then in ((37, Command.STOP), (38, Command.NONE)):
        trial = Trial(**LIMITS)
        trial.tick(ticks, start=0, override=Command.LEFT)
        assert trial.tick(override=Command.NONE) == then


@pytest.mark.parametrize("command", [Command.FORWARD, Command.LEFT, Command.RIGHT, Command.RECALL])
def test_rule_12_the_operator_commands_though_nobody_leads_until_the_link_is_lost(command: Command) -> None:
    trial = Trial(**LIMITS)
    trial.tick(2 * SECOND, start=0)
    assert trial.tick(override=command) == command
    assert trial.tick(link_ok=0) == Command.NONE


def test_rule_12_a_stop_of_the_operator_sounds_though_nobody_leads() -> None:
    trial = Trial(**LIMITS)
    trial.tick(10 * SECOND, start=0)
    assert trial.tick(10 * SECOND, override=Command.STOP) == Command.NONE
    assert trial.phases()[2:] == [("STOP", 38), ("NONE", 10 * SECOND - 38)]


def test_rule_12_after_success_a_stop_then_silence() -> None:
    trial = Trial(**LIMITS, route={"waypoint_north[1]": 5.0})
    trial.tick(5 * SECOND, speed=0)
    assert trial.status == Status.SUCCESS
    assert trial.phases()[-1][0] == "NONE"
    assert [name for name, _ in trial.phases()][-3:] == ["RECALL", "STOP", "NONE"]


def test_without_the_limits_none_of_these_is_reported() -> None:
    trial = Trial(leg_issues=0, leg_vibration=0, progress_time=0.04, fence_width=0, mission_time=0.04)
    trial.tick(h=60, speed=0)
    trial.tick(60 * SECOND, east=70.0)
    assert {a for _, a in trial.anomalies} <= {Anomaly(i) for i in range(1, 9)}
    assert next(v for v in Cmec.group("parameter") if v.name == "guarded").start == (0,)
