"""The safety rules through bytes: instruments and radio in; tones, vibrators and telemetry out.

What the vest plays is measured anew from its tones and vibrators, and held against the limits that SAFETY.md
states. In the co-simulation: tests/harness/cosim/test_safety.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import pytest

from codegen.firmware.telemetry import Flag
from harness.onboard.radio import Abort, Mission, Override, Start
from models.commands import Command, Status
from models.kit.timing import TICK
from models.modes import Anomaly, Mode
from models.system import SYSTEMS
from tests.harness.onboard.animal import Animal, Behaviour, Motion, obedient
from tests.harness.onboard.vest import HERE, PLANE, Vest, place
from tests.harness.played import (
    DIRECTIONS,
    TONES,
    issues,
    longest,
    most_within,
    phases,
    seconds,
    silent_from,
)

TEN_MINUTES = 600.0  # s
# the limits that ship (SAFETY.md, rules 3, 4 and 12)
LEG_ISSUES, LEG_VIBRATION, LEG_TONE = 8, 24.0, 300.0  # , s, s
LONGEST_VIBRATION, LONGEST_TONE, LONGEST_STOP = 5.0, 300.0, 10.0  # s
WINDOW, WINDOW_VIBRATION, WINDOW_TONE = 120.0, 80.0, 240.0  # s
TURN = 3.0  # s: DELTHRESH2
HELD = 1.52  # s: a stop lasts 1.5 s, which are 38 ticks
PROGRESS, DEPARTING, FENCE = 20.0, 30.0, 50.0  # s, m, m

HOME = place(0, 0)
NORTH = Mission(HOME, (place(100, 0),))


def still(_: Command) -> Motion:
    """Stands, whatever it is told."""
    return 0.0, 0.0


def walks(_: Command) -> Motion:
    """Walks on, whatever it is told."""
    return 1.5, 0.0


def circles(_: Command) -> Motion:
    """Walks in a circle of 7 m, whatever it is told."""
    return 2.0, 0.3


def ignoring(*ignored: Command) -> Behaviour:
    """Stands at these, and obeys the others."""
    return lambda command: (0.0, 0.0) if command in ignored else obedient(command)


@contextmanager
def begun(mission: Mission = NORTH, heading: float = 0.0) -> Iterator[Animal]:
    """An animal at home that looks so [rad], and a mission that begins."""
    vest = Vest()
    with closing(vest.processor):
        animal = Animal(vest, heading)
        animal.ticks(2.0, still, HERE)
        animal.tick(still, mission, fix=False)
        animal.ticks(1.0, still, HERE)  # the mission is projected place by place
        animal.tick(still, Start(mission.id), fix=False)
        vest.played.clear()
        yield animal


@contextmanager
def alone() -> Iterator[Animal]:
    """An animal at home with a vest that is just switched on."""
    vest = Vest()
    with closing(vest.processor):
        yield Animal(vest)


# --- ten minutes of disobedience: rules 3, 4 and 12 ---


@dataclass(frozen=True)
class Disobedience:
    """What is played in ten minutes to an animal that ignores a command.

    Attributes:
        played: tick by tick.
        status, mode: of the last telemetry.
    """

    played: list[Command]
    status: Status
    mode: Mode


IGNORED: dict[str, tuple[Mission, float, Behaviour]] = {
    "FORWARD": (NORTH, 0.0, still),
    "STOP": (NORTH, 0.0, circles),
    "RECALL": (Mission(HOME, (place(20, 0),)), 0.0, ignoring(Command.RECALL)),
    "LEFT": (NORTH, math.pi / 3, ignoring(Command.LEFT)),
    "RIGHT": (NORTH, -math.pi / 3, ignoring(Command.RIGHT)),
}


@cache
def ignored(command: str) -> Disobedience:
    with begun(*IGNORED[command][:2]) as animal:
        animal.ticks(TEN_MINUTES, IGNORED[command][2], HERE)
        return outcome(animal)


@cache
def overridden(command: Command, under_way: bool, repeated: bool) -> Disobedience:
    """The operator holds a command, or sends it for a second in every two, to an animal that stands."""
    with begun() if under_way else alone() as animal:
        animal.fix_ticks = 25  # where the animal is does not matter
        if not repeated:
            animal.ticks(TEN_MINUTES, still, Override(command))
        for _ in range(round(TEN_MINUTES / 2) if repeated else 0):
            animal.ticks(1.0, still, Override(command))
            animal.ticks(1.0, still, Override(Command.NONE))
        return outcome(animal)


def outcome(animal: Animal) -> Disobedience:
    telemetry = animal.vest.telemetry
    return Disobedience(animal.vest.played, Status(telemetry.status), Mode(telemetry.mode))


@pytest.mark.parametrize(
    ("command", "vibration", "number", "tone", "end"),
    [
        # 3 s of FORWARD in every 4 s, until 20 s of it brought no progress: five pauses; then the stop
        ("FORWARD", 0.0, 0, 20.0 + HELD, 20.0 + 5 * 1.0 + 4 * 0.2 + HELD),
        # at most 10 s at a time; the trial ends with the time for a leg
        ("STOP", 0.0, 0, 3.0 + LONGEST_STOP + HELD, 300.0 + HELD),
        # 13 m at 2 m/s to the waypoint, its stop, 20 s without progress, the last stop
        ("RECALL", 0.0, 0, 6.6 + HELD + PROGRESS + HELD, 6.6 + HELD + PROGRESS + HELD),
        # the stop, 8 turns of 3 s with a second between, the last stop
        ("LEFT", LEG_VIBRATION, LEG_ISSUES, 2 * HELD, 2 * HELD + LEG_VIBRATION + LEG_ISSUES * 1.0),
        ("RIGHT", LEG_VIBRATION, LEG_ISSUES, 2 * HELD, 2 * HELD + LEG_VIBRATION + LEG_ISSUES * 1.0),
    ],
)
def test_rules_3_and_4_an_animal_that_ignores_a_command_for_ten_minutes_is_left_alone(
    command: str, vibration: float, number: int, tone: float, end: float
) -> None:
    ten_minutes = ignored(command)
    played = ten_minutes.played
    assert len(played) == TEN_MINUTES / TICK
    assert issues(played) == number
    assert seconds(played, *DIRECTIONS) == pytest.approx(vibration)
    assert longest(played, *DIRECTIONS) <= TURN
    assert tone - 2.5 <= seconds(played, *TONES) <= tone + 0.2
    assert silent_from(played) <= end + 0.2
    # and that is told
    assert (ten_minutes.status, ten_minutes.mode) == (Status.STOPPED, Mode.STOPPED)


@pytest.mark.parametrize("under_way", [True, False])
@pytest.mark.parametrize("command", [Command.FORWARD, Command.RECALL, *DIRECTIONS])
def test_rule_3_what_the_operator_holds_or_repeats_ends_within_the_budget(
    command: Command, under_way: bool
) -> None:
    for repeated in (False, True):
        played = overridden(command, under_way, repeated).played
        assert issues(played) <= LEG_ISSUES
        assert seconds(played, *DIRECTIONS) <= LEG_VIBRATION
        assert longest(played, *DIRECTIONS) <= LONGEST_VIBRATION
        assert longest(played, Command.FORWARD, Command.RECALL) <= LONGEST_TONE
        assert most_within(WINDOW, played, *DIRECTIONS) <= WINDOW_VIBRATION
        # the tones of the trial count, the stop that ends it and one of the time for a leg come on top
        assert seconds(played, *TONES) <= LEG_TONE + 2 * HELD
        assert silent_from(played) <= (2 if repeated else 1) * LEG_TONE + LONGEST_VIBRATION
        # it was obeyed first, and what is refused is answered by one stop, however often it is sent
        assert command in played[: round(2 / TICK)]
    if command in DIRECTIONS:
        assert issues(played) == LEG_ISSUES
        assert silent_from(played) <= 2.0 * LEG_ISSUES + HELD + 2 * TICK


def test_rule_3_telemetry_tells_what_is_left_of_the_budget_and_what_broke_it() -> None:
    # given an animal that ignores its turn, when it has been turned for a while
    with begun(heading=math.pi / 3) as animal:
        played = animal.ticks(10.0, still, HERE)
        telemetry = animal.vest.telemetry
        # then what is left and what was played make the budget; telemetry comes once a second
        assert 1 <= issues(played) < LEG_ISSUES
        assert telemetry.issues_left == LEG_ISSUES - issues(played)
        assert telemetry.vibration_left / 10 == pytest.approx(
            LEG_VIBRATION - seconds(played, *DIRECTIONS), abs=1.1
        )
        # and the window began with the stop of the power-up
        assert telemetry.tone_left / 10 == pytest.approx(
            WINDOW_TONE - HELD - seconds(played, *TONES), abs=0.2
        )
        assert telemetry.last_anomaly == Anomaly.TURN_FAILURE
        # when it is spent, then nothing is left, and that has ended the trial
        animal.ticks(40.0, still, HERE)
        telemetry = animal.vest.telemetry
        assert (telemetry.issues_left, telemetry.vibration_left) == (0, 0)
        assert telemetry.last_anomaly == Anomaly.BUDGET_SPENT
        # when the mission begins anew, then all of it is there again
        animal.tick(still, Abort(), fix=False)
        animal.ticks(2.0, still, HERE)
        animal.tick(still, Start(NORTH.id), fix=False)
        animal.ticks(1.2, still, HERE)
        telemetry = animal.vest.telemetry
        assert (telemetry.issues_left, telemetry.vibration_left) == (LEG_ISSUES, 10 * LEG_VIBRATION)
        assert telemetry.last_anomaly == Anomaly.NONE


@pytest.mark.parametrize("under_way", [True, False])
def test_rule_3_stop_sounds_whenever_the_operator_sends_it_but_not_for_long(under_way: bool) -> None:
    held = overridden(Command.STOP, under_way, repeated=False).played
    assert phases(held)[0] == ("STOP", LONGEST_STOP if under_way else HELD)
    assert seconds(held, *TONES) <= LONGEST_STOP + HELD
    repeated = overridden(Command.STOP, under_way, repeated=True).played
    assert seconds(repeated, Command.STOP) >= (100 if under_way else 290)
    assert set(repeated) == {Command.STOP, Command.NONE}


def test_rule_3_only_a_start_fills_what_an_animal_spent() -> None:
    # given an animal that ignored its turn, and an operator who has aborted the mission
    with begun(heading=math.pi / 3) as animal:
        animal.ticks(40.0, still, HERE)
        animal.tick(still, Abort(), fix=False)
        animal.ticks(120.0, still, HERE)
        animal.vest.played.clear()
        # when a direction is sent, then it is answered by nothing
        assert set(animal.ticks(3.0, still, Override(Command.LEFT))) == {Command.NONE}
        animal.ticks(2.0, still, Override(Command.NONE))
        # when the mission is started anew, then the animal is turned again, as long as on a first leg
        animal.vest.played.clear()
        animal.ticks(60.0, still, Start(NORTH.id))
        assert seconds(animal.vest.played, *DIRECTIONS) == pytest.approx(LEG_VIBRATION)


@pytest.mark.parametrize("instruments", [True, False])
def test_rule_12_a_vest_that_is_switched_on_alone_plays_one_stop_and_is_silent_for_ten_minutes(
    instruments: bool,
) -> None:
    with alone() as animal:
        if not instruments:
            animal.sensed = {"accel_x": math.nan}
        played = animal.ticks(
            TEN_MINUTES, circles if instruments else still, fix=None if instruments else False
        )
        assert phases(played) == [("STOP", HELD), ("NONE", pytest.approx(TEN_MINUTES - HELD))]


def test_rule_12_after_a_success_the_vest_plays_one_stop_and_is_silent() -> None:
    with begun(Mission(HOME, (place(20, 0),))) as animal:
        played = animal.ticks(60.0, obedient, HERE)
        assert animal.vest.telemetry.status == Status.SUCCESS
        assert [name for name, _ in phases(played)] == ["FORWARD", "STOP", "RECALL", "STOP", "NONE"]
        assert phases(played)[-2] == ("STOP", HELD)


# --- rule 2 ---


@pytest.mark.parametrize("bias", [0.0, -0.4, 0.4])
def test_rule_2_an_animal_that_walks_without_fixes_gets_no_direction(bias: float) -> None:
    # given one that walks at 1.5 m/s away from its course, and an accelerometer that is off by so much
    with begun(heading=0.0) as animal:
        animal.ticks(4.0, walks, HERE)
        animal.sensed = {"accel_x": bias}
        animal.heading = math.pi / 3
        # when no fixes come for 12 s, then its speed is soon wrong
        animal.ticks(12.0, walks, HERE, fix=False)
        assert seconds(animal.vest.played, *DIRECTIONS) == 0
        # when they come again and it stands, then it is turned
        animal.sensed = {}
        animal.ticks(20.0, ignoring(*DIRECTIONS), HERE)
        assert seconds(animal.vest.played, *DIRECTIONS) > 0


def test_rule_2_directions_come_behind_a_held_stop_last_3_s_and_never_follow_each_other() -> None:
    # given an animal that turns too far, to either side
    def overshoots(command: Command) -> Motion:
        speed, _ = obedient(command)
        return speed, {Command.RIGHT: 1.5, Command.LEFT: -1.5}.get(command, 0.0)

    with begun(heading=math.pi) as animal:
        played = animal.ticks(60.0, overshoots, HERE)
    turns = phases(played)
    assert sum(name in ("LEFT", "RIGHT") for name, _ in turns) >= 2
    for before, (name, lasts) in pairwise(turns):
        if name in ("LEFT", "RIGHT"):
            assert before[0] in ("STOP", "NONE")
            assert before[0] != "STOP" or before[1] >= 1.48
            assert lasts <= TURN


def test_the_program_gives_its_blocks_what_the_wiring_says() -> None:
    # given an animal that walks, so that no two of the signals are the same
    with begun() as animal:
        animal.ticks(3.0, walks, HERE)
        _, memory = animal.tick(walks)
    # then each input of the controller and the command module is what it is linked to
    blocks = ("estimator", "controller", "command_module")
    links = [link for link in SYSTEMS["full"].links if link.source in blocks and link.target in blocks]
    assert len(links) >= 7
    for link in links:
        taken = memory[f"{link.target}.input.{link.target_variable}"]
        assert taken == memory[f"{link.source}.output.{link.source_variable}"], str(link)


# --- rule 4 ---


def backwards(speed: float, s_acc: float) -> tuple[float, list[Command], Mode]:
    """A unit that is mounted backwards: at FORWARD the animal goes away from the waypoint, at so many m/s."""
    with begun() as animal:
        animal.course_off, animal.sensed = math.pi, {"gps_s_acc": s_acc}
        animal.ticks(120.0, lambda command: (speed * (command == Command.FORWARD), 0.0), HERE)
        return animal.north, animal.vest.played, Mode(animal.vest.telemetry.mode)


def test_rule_6_an_animal_that_runs_the_wrong_way_is_stopped_in_3_s() -> None:
    north, played, mode = backwards(5.0, 0.1)
    assert -5.0 * 3.6 <= north < 0
    # then its stop falls silent
    assert mode == Mode.STOP_TO_TURN
    assert seconds(played, Command.STOP) == pytest.approx(LONGEST_STOP, abs=0.1)
    assert played[-1] == Command.NONE


def test_rule_4_an_animal_that_runs_the_wrong_way_on_a_course_that_is_not_sure_is_stopped() -> None:
    north, played, mode = backwards(5.0, 2.0)
    # then 30 m, what it runs until it is noticed, and what the estimate lags behind
    assert -DEPARTING - 2 * 0.2 * 5.0 - 8.0 <= north < -DEPARTING
    assert mode == Mode.STOPPED
    assert played[-1] == Command.NONE


def test_rule_4_an_animal_that_sits_down_on_its_way_is_noticed() -> None:
    with begun() as animal:
        animal.ticks(20.0, obedient, HERE)
        assert animal.vest.played[-1] == Command.FORWARD
        played = animal.ticks(60.0, still, HERE)
        # it had come less than the last 5 m when it sat down, at 2 m/s; then comes the stop
        assert PROGRESS - 5.0 / 2.0 + HELD <= silent_from(played) <= PROGRESS + HELD + 1.0
        assert animal.vest.telemetry.mode == Mode.STOPPED


# --- rule 5 ---


@pytest.mark.parametrize("bias", [-0.4, 0.0, 0.4])
@pytest.mark.parametrize("speed", [1.5, 4.9])
def test_rule_5_an_estimate_that_is_far_off_leads_no_animal(speed: float, bias: float) -> None:
    # given an animal that goes north, and an accelerometer that is off by so much
    def goes(_: Command) -> Motion:
        return speed, 0.0

    with begun(Mission(HOME, (place(400, 0),))) as animal:
        animal.ticks(8.0, goes, HERE)
        animal.sensed = {"accel_x": bias}
        led = invalid = 0
        # when there is no fix for 14.9 s, less than a fix may be old
        for k in range(round(14.9 / TICK)):
            command, _ = animal.tick(goes, *([HERE] if k % 5 == 0 else []), fix=False)
            telemetry = animal.vest.telemetry
            north, east = PLANE.to_plane(
                *(math.radians(x / 1e7) for x in (telemetry.latitude, telemetry.longitude))
            )
            off = math.hypot(north - animal.north, east - animal.east) - 0.2 * speed  # telemetry is 0.2 s old
            if Flag.VALID in Flag(telemetry.flags):
                # then what is valid is as good as it says: below 7 m, with three deviations
                assert telemetry.position_sd <= 700
                assert off <= 3 * 7.0
                assert off <= 3 * telemetry.position_sd / 100 + 1.0
            else:
                invalid += 1
                led += command in (Command.FORWARD, *DIRECTIONS)
        # and one that is not leads nobody, but for the tick or two before the telemetry tells
        assert led == 0
        assert invalid > 0


# --- rules 1, 7 and 9 ---


def test_rule_1_a_lost_link_beats_the_operators_last_command() -> None:
    with begun() as animal:
        animal.ticks(4.0, obedient, Override(Command.RECALL))
        assert animal.vest.played[-1] == Command.RECALL
        # when nobody is heard any more: an override ends within 1 s, the link within 2 s
        played = animal.ticks(10.0, still)
        assert played[round(1.1 / TICK)] != Command.RECALL
        assert silent_from(played) <= 2.0 + HELD + TICK
        assert animal.vest.telemetry.mode == Mode.STOPPED


def test_rule_7_an_animal_that_leaves_the_fence_is_stopped() -> None:
    # given one that walks east, whatever it is told, on a leg to the north
    with begun() as animal:
        animal.heading = math.pi / 2
        animal.ticks(30.0, walks, HERE)
        assert animal.vest.telemetry.mode != Mode.STOPPED
        animal.ticks(10.0, walks, HERE)
        # then it is stopped 50 m off, or a fifth of a second farther
        assert animal.vest.telemetry.mode == Mode.STOPPED
        assert animal.vest.telemetry.last_anomaly == Anomaly.OUTSIDE_FENCE
        assert animal.vest.played[-1] == Command.NONE


def test_rule_9_a_start_of_one_mission_never_begins_another() -> None:
    # given no fix, when A is loaded and started, and then B
    east = Mission(HOME, (place(0, 100),))
    with alone() as animal:
        for mission in (NORTH, east):
            animal.ticks(1.0, still, mission, Start(mission.id), fix=False)
        # when fixes come, then nothing begins
        played = animal.ticks(10.0, still, HERE)
        assert Command.FORWARD not in played
        assert animal.vest.telemetry.mode == Mode.IDLE
        # and A's START does not begin B, only its own does: it turns the animal, which looks north
        played = animal.ticks(5.0, still, Start(NORTH.id))
        assert set(played) == {Command.NONE}
        played = animal.ticks(5.0, still, Start(east.id))
        assert Command.RIGHT in played
        assert animal.vest.telemetry.mission_id == east.id
