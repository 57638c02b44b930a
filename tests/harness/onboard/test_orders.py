"""The operator's orders to the program on board, in the sequences that a radio makes of them."""

from __future__ import annotations

import ctypes
import math
import random
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from codegen.firmware.telemetry import Flag, Ready, Refusal
from harness.onboard.memory import Memory
from harness.onboard.processors import open_processor
from harness.onboard.radio import Abort, Mission, Override, Start
from models.commands import Command, Status
from models.modes import Anomaly, Mode
from models.readings import ON_BOARD, READINGS
from tests.harness.onboard.vest import HERE, Vest, place

RUNNING = {Mode.FORWARD, Mode.STOP_TO_TURN, Mode.LEFT, Mode.RIGHT, Mode.DEAD}
HOME = place(0, 0)
A, B = Mission(HOME, (place(50, 0),)), Mission(HOME, (place(0, 50),))


@pytest.fixture
def vest() -> Iterator[Vest]:
    made = Vest()
    yield made
    made.processor.close()


def board(vest: Vest, battery: int, temperature: int = -32768) -> None:
    """From now on the board tells a battery [mV] and a temperature [0.1 deg C]."""
    program = vest.processor._library  # type: ignore[attr-defined]
    ctypes.c_uint16.in_dll(program, "pil_battery_mv").value = battery
    ctypes.c_int16.in_dll(program, "pil_temperature").value = temperature


def target(memory: Memory) -> tuple[float, float]:
    return tuple(round(memory[f"controller.state.target_{axis}"]) for axis in ("north", "east"))  # type: ignore[return-value]


def test_rule_9_a_start_right_behind_an_abort_is_refused_and_not_remembered(vest: Vest) -> None:
    # given a trial under way
    vest.ticks(10)
    vest.begin(A)
    memory = vest.ticks(10)
    assert memory["controller.output.mode"] in RUNNING
    assert target(memory) == (50, 0)
    # when an abort, another mission and its start come in the same tick
    vest.tick(Abort(), B, Start(B.id))
    memory = vest.ticks(10)
    # then the first one is stopped, the other is held, and the telemetry says why it was not begun
    assert memory["controller.output.mode"] == Mode.STOPPED
    assert vest.telemetry.mission_id == B.id
    assert vest.telemetry.refusal == Refusal.NOT_IDLE
    # when the stop is over, then nothing begins
    assert vest.ticks(100)["controller.output.mode"] == Mode.IDLE
    # until it is started again
    memory = vest.ticks(10, Start(B.id))
    assert memory["controller.output.mode"] in RUNNING
    assert target(memory) == (0, 50)
    assert vest.telemetry.refusal == Refusal.NONE


def test_rule_10_an_abort_stops_within_a_fifth_of_a_second_whatever_bytes_came_before(vest: Vest) -> None:
    # given a full line: 57600 baud are 230 bytes a tick
    draw = random.Random(10)
    vest.ticks(10)
    vest.tick(A)
    for _ in range(40):
        memory = vest.ticks(60, Start(A.id))
        assert memory["controller.output.command"] not in (Command.NONE, Command.STOP)
        # when noise or the beginning of a long frame comes, and an ABORT in the middle of a tick's bytes
        begin = b"\xa5\x5a" + bytes([1, draw.randrange(20, 139)])
        before = draw.choice([begin, begin + draw.randbytes(9), draw.randbytes(draw.randrange(450))])
        pieces = [before[i : i + 230] for i in range(0, len(before), 230)]
        for piece in pieces[:-1]:
            vest.tick(piece)
        memories = [vest.tick(pieces[-1], Abort()), vest.tick()]
        # then it is obeyed on its tick, or on the next if a fix makes the radio wait: within 0.08 s
        assert Mode.STOPPED in [memory["controller.output.mode"] for memory in memories]
        assert memories[-1]["controller.output.command"] == Command.STOP
        vest.ticks(60)


def test_rule_9_a_mission_is_refused_until_the_one_under_way_is_aborted(vest: Vest) -> None:
    vest.ticks(10)
    vest.begin(A)
    # when another comes with its start
    memory = vest.ticks(20, B, Start(B.id))
    # then trial, mission and telemetry stay with the first
    assert target(memory) == (50, 0)
    assert memory["controller.output.mode"] in RUNNING
    assert memory["radio.mission.id"] == vest.telemetry.mission_id == A.id
    assert Flag.STARTED in Flag(vest.telemetry.flags)
    assert vest.telemetry.refusal == Refusal.OTHER_MISSION
    # when that is aborted and its stop is over, then the other can be led
    vest.tick(Abort(), B)
    vest.ticks(60)
    assert target(vest.ticks(5, Start(B.id))) == (0, 50)


def test_rule_9_a_mission_behind_its_start_undoes_it(vest: Vest) -> None:
    vest.ticks(10)
    vest.load(A)
    memory = vest.tick(Start(A.id), B, fix=False)
    assert memory["controller.output.mode"] == Mode.IDLE
    assert vest.ticks(20)["controller.output.mode"] == Mode.IDLE
    # the same one again as well, and an abort
    for behind in (B, Abort()):
        vest.load(B)
        assert vest.tick(Start(B.id), behind, fix=False)["controller.output.mode"] == Mode.IDLE
        assert vest.ticks(20)["controller.output.mode"] == Mode.IDLE


def test_a_start_that_is_repeated_changes_nothing(vest: Vest) -> None:
    # given a laptop that repeats mission and start until the telemetry shows them
    vest.ticks(10)
    vest.begin(A)
    memory = vest.ticks(30, A, Start(A.id))
    assert memory["controller.output.mode"] in RUNNING
    assert vest.telemetry.refusal == Refusal.NONE


def test_rule_9_a_trial_that_has_ended_is_not_begun_again_before_an_abort(vest: Vest) -> None:
    # given an animal that has been at the waypoint and is home again
    vest.ticks(10)
    vest.begin(A)
    vest.ticks(300, gps_north=50.0)
    vest.ticks(300)
    assert vest.telemetry.status == Status.SUCCESS
    # when it is started again, then it is refused
    memory = vest.ticks(20, Start(A.id))
    assert memory["controller.output.mode"] not in RUNNING
    assert vest.telemetry.refusal == Refusal.NOT_IDLE
    assert Flag.STARTED in Flag(vest.telemetry.flags)
    # and behind an abort it begins
    vest.tick(Abort())
    vest.ticks(60)
    assert vest.ticks(5, Start(A.id))["controller.output.mode"] in RUNNING


def answers(vest: Vest, *messages: Any) -> bool:
    """A tick without a fix: is there telemetry?"""
    before = vest.telemetry
    vest.tick(*messages, fix=False)
    return vest.telemetry != before


def wait_for_answer(vest: Vest) -> None:
    assert any(answers(vest) for _ in range(10)), "no telemetry in ten ticks"


def test_telemetry_that_is_due_as_a_mission_comes_is_a_tick_later(vest: Vest) -> None:
    # given telemetry on every fifth tick
    vest.ticks(10)
    wait_for_answer(vest)
    assert [answers(vest) for _ in range(9)] == [k == 4 for k in range(9)]
    # when a mission comes on the fifth
    heard = vest.counter
    memory = vest.tick(A, fix=False)
    # then the telemetry of that tick comes on the next, and the one after it is on time
    assert memory["radio.mission.id"] == A.id
    assert vest.telemetry.received == heard  # the last heartbeat
    assert [answers(vest) for _ in range(5)] == [True, False, False, False, True]
    assert vest.telemetry.mission_id == A.id


def test_telemetry_that_is_due_as_a_mission_comes_before_any_fix_is_a_tick_later(vest: Vest) -> None:
    wait_for_answer(vest)
    assert [answers(vest) for _ in range(4)] == [False] * 4
    assert [answers(vest, A), answers(vest)] == [False, True]


FULL = Mission(HOME, tuple(place(50, 20 * i) for i in range(16)))


def test_rule_8_one_place_of_a_mission_is_projected_on_a_tick_unless_it_is_that_of_a_fix(vest: Vest) -> None:
    vest.ticks(10)
    # when a mission of 17 places comes, and a fix on the fourth tick behind it
    assert vest.tick(FULL, fix=False)["place"] == 0
    places = [vest.tick(fix=k == 3)["place"] for k in range(18)]
    # then
    assert places == [1, 2, 3, 3, *range(4, 18)]
    assert vest.tick(fix=False)["place"] == 17


@pytest.mark.parametrize("ticks", [0, 15, 16])
def test_rule_9_a_start_before_all_places_are_projected_is_refused_as_such_and_not_remembered(
    vest: Vest, ticks: int
) -> None:
    # given a mission of 17 places, the last of which is projected on the 17th tick behind it
    vest.ticks(30)
    vest.tick(FULL, *[Start(FULL.id)] * (ticks == 0), fix=False)
    # when START comes with it, or up to a tick before that
    for k in range(1, 17):
        vest.tick(*[Start(FULL.id)] * (k == ticks), fix=False)
    # then nothing begins, and the reason is told
    memory = vest.ticks(30)
    assert memory["controller.output.mode"] == Mode.IDLE
    assert vest.telemetry.refusal == Refusal.NOT_PLANNED
    assert Ready(vest.telemetry.ready).missing == ()


def test_rule_9_a_start_on_the_tick_of_the_last_place_begins_with_it(vest: Vest) -> None:
    vest.ticks(30)
    vest.tick(FULL, fix=False)
    for _ in range(16):
        assert vest.tick(fix=False)["planned"] == 0
    memory = vest.tick(Start(FULL.id), fix=False)
    assert memory["controller.output.mode"] == Mode.FORWARD
    for axis, last in (("north", 50), ("east", 300)):
        assert memory[f"controller.state.route_{axis}[16]"] == pytest.approx(last, abs=0.1)


def test_a_mission_held_is_projected_behind_the_first_fix(vest: Vest) -> None:
    # given a mission held, and telemetry that is due on the second tick from here
    vest.tick(A, fix=False)
    wait_for_answer(vest)
    assert [answers(vest) for _ in range(3)] == [False] * 3
    # when the first fix comes on the next, which takes long by itself
    assert vest.tick(fix=True)["place"] == 0
    # then the places follow, and the telemetry does not wait for them
    before = vest.telemetry
    assert vest.tick(fix=False)["planned"] == 0
    assert vest.telemetry != before
    assert Ready(vest.telemetry.ready).missing == (Ready.PLANNED,)
    assert vest.tick(fix=False)["planned"] == 1


def test_telemetry_waits_for_missions_on_every_tick_for_two_ticks_and_no_longer(vest: Vest) -> None:
    # given telemetry on every fifth tick from here
    vest.ticks(10)
    wait_for_answer(vest)
    # when missions come that cannot be started
    far = Mission(HOME, (place(2e5, 0),))
    answered = [k for k in range(1, 17) if answers(vest, far, Start(far.id))]
    # then that of the fifth comes on the seventh, and so on
    assert answered == [7, 12]
    assert Flag.STARTED not in Flag(vest.telemetry.flags)


def test_rule_9_a_start_before_the_first_fix_is_refused_and_not_remembered(vest: Vest) -> None:
    # when a start comes before the first fix
    for _ in range(6):
        vest.tick(A, Start(A.id), fix=False)
    # then that is told
    assert vest.telemetry.refusal == Refusal.NO_FIX
    assert Flag.STARTED not in Flag(vest.telemetry.flags)
    # and with the fix nothing begins until it is started again
    vest.tick(fix=True)
    assert vest.ticks(20)["controller.output.mode"] == Mode.IDLE
    assert vest.telemetry.refusal == Refusal.NO_FIX
    assert Ready(vest.telemetry.ready).missing == ()
    assert target(vest.ticks(5, Start(A.id))) == (50, 0)


# --- rule 8: ready to start ---

NEAR = Mission(HOME, (place(6.5, 0),))
CLOSE = Mission(HOME, (place(50, 0), place(50, 6.5)))
CLOSE_EAST = Mission(HOME, (place(0, 50), place(6.5, 50)))
CLOSE_FIRST = Mission(HOME, (place(50, 0), place(50, 6.5), place(50, 50)))
FAR = Mission(HOME, (place(50, 0), place(1.1e5, 0)))
FAR_HOME = Mission(place(0, -1.1e5), (place(50, 0),))
# a notch from the east between home and the waypoint
NOTCHED = tuple(place(*c) for c in ((-20, -20), (-20, 20), (20, 20), (25, -5), (30, 20), (70, 20), (70, -20)))
FENCED = Mission(HOME, (place(50, 0), place(60, -15)), NOTCHED)
WAYPOINT_OUT = replace(FENCED, waypoints=(place(50, 0), place(60, -21)))
FIRST_OUT = replace(FENCED, waypoints=(place(25, 5), place(60, -15)))
HOME_OUT = replace(FENCED, home=place(71, 0))


@pytest.mark.parametrize(
    ("mission", "sensed", "missing", "refusal"),
    [
        (A, {}, (), Refusal.NONE),
        (A, {"gps_h_acc": 7.0}, (), Refusal.NONE),
        (A, {"gps_h_acc": 7.001}, (Ready.ACCURACY,), Refusal.NOT_ACCURATE),
        (A, {"accel_x": math.nan}, (Ready.IMU, Ready.ESTIMATE), Refusal.NO_IMU),
        (NEAR, {}, (Ready.FIRST_LEG,), Refusal.SHORT_FIRST_LEG),
        (CLOSE, {}, (Ready.LEGS,), Refusal.SHORT_LEG),
        (CLOSE_EAST, {}, (Ready.LEGS,), Refusal.SHORT_LEG),
        (CLOSE_FIRST, {}, (Ready.LEGS,), Refusal.SHORT_LEG),
        (FAR, {}, (Ready.REACH,), Refusal.OUT_OF_REACH),
        (FAR_HOME, {}, (Ready.REACH,), Refusal.OUT_OF_REACH),
        (FENCED, {}, (), Refusal.NONE),
        (WAYPOINT_OUT, {}, (Ready.FENCE,), Refusal.OUTSIDE_FENCE),
        (FIRST_OUT, {}, (Ready.FENCE,), Refusal.OUTSIDE_FENCE),
        (HOME_OUT, {}, (Ready.FENCE,), Refusal.OUTSIDE_FENCE),
        (FENCED, {"gps_north": -25.0}, (Ready.INSIDE,), Refusal.ANIMAL_OUTSIDE),
        (FENCED, {"gps_north": 25.0, "gps_east": 10.0}, (Ready.INSIDE,), Refusal.ANIMAL_OUTSIDE),
        (FENCED, {"gps_north": 25.0, "gps_east": -10.0}, (), Refusal.NONE),
        (Mission(HOME, (place(7.5, 0),)), {}, (), Refusal.NONE),
        (Mission(HOME, (place(50, 0), place(50, 7.5))), {}, (), Refusal.NONE),
    ],
)  # fmt: skip
def test_rule_8_a_start_is_refused_with_the_first_thing_that_is_missing(
    vest: Vest, mission: Mission, sensed: dict[str, float], missing: tuple[Ready, ...], refusal: Refusal
) -> None:
    # given a vest that holds a mission
    vest.ticks(30, **sensed)
    vest.tick(mission, fix=False)
    vest.ticks(20, **sensed)
    # then the telemetry lists what is missing before any START
    assert Ready(vest.telemetry.ready).missing == missing
    # when it is started, then it begins at once, or the reason is told
    memory = vest.ticks(12, Start(mission.id), **sensed)
    assert vest.telemetry.refusal == refusal
    assert memory["controller.output.mode"] in (RUNNING if refusal is Refusal.NONE else {Mode.IDLE})


@pytest.mark.parametrize(
    ("limits", "command"),
    [
        ({"window_issues": 1}, Command.LEFT),
        ({"window_vibration": 0.8}, Command.RIGHT),
        ({"window_tone": 0.8}, Command.RECALL),
    ],
)
def test_rule_8_no_trial_begins_until_the_window_leaves_something(
    limits: dict[str, float], command: Command
) -> None:
    # given an operator who has spent what a window of 4 s allows, without a trial
    guarded = {n.removeprefix("cmec."): x for n, x in READINGS[ON_BOARD].items() if n.startswith("cmec.")}
    values = guarded | {"window": 4.0} | limits
    vest = Vest(open_processor("host", {"controller": values}))
    vest.ticks(60)
    vest.load(A)
    vest.ticks(250)
    assert Ready(vest.telemetry.ready).missing == ()
    for _ in range(2):
        vest.tick(Override(command), fix=False)
        vest.ticks(12)
    vest.tick(Override(Command.NONE), fix=False)
    vest.ticks(6)
    # when
    assert Ready(vest.telemetry.ready).missing == (Ready.BUDGET,)
    vest.tick(Start(A.id), fix=False)
    vest.ticks(6)
    # then it is refused, until two blocks of the window are over
    assert vest.telemetry.refusal == Refusal.WINDOW_SPENT
    vest.ticks(205)
    assert Ready(vest.telemetry.ready).missing == ()
    vest.processor.close()


def test_rule_8_a_start_needs_a_last_fix_that_the_estimator_has_not_rejected(vest: Vest) -> None:
    # given an animal at rest at home, and a fix 500 m away
    vest.ticks(36)
    vest.load(A)
    vest.tick(fix=True, gps_north=500.0)
    # when
    for _ in range(6):
        memory = vest.tick(Start(A.id), fix=False)
    # then
    assert vest.telemetry.rejected_fixes == 1
    assert vest.telemetry.refusal == Refusal.FIX_REJECTED
    assert Ready(vest.telemetry.ready).missing == (Ready.AGREEMENT,)
    assert memory["controller.output.mode"] == Mode.IDLE
    # and with a fix at home again
    vest.tick(fix=True)
    assert vest.ticks(6, Start(A.id))["controller.output.mode"] in RUNNING
    assert (vest.telemetry.refusal, Ready(vest.telemetry.ready).missing) == (Refusal.NONE, (Ready.IDLE,))


NOT_TOLD = -32768
BATTERY, TEMPERATURE = (Ready.BATTERY,), (Ready.TEMPERATURE,)


@pytest.mark.parametrize(
    ("battery", "temperature", "missing", "refusal"),
    [
        (0, NOT_TOLD, (), Refusal.NONE),
        (3500, NOT_TOLD, (), Refusal.NONE),
        (3499, NOT_TOLD, BATTERY, Refusal.LOW_BATTERY),
        (1, NOT_TOLD, BATTERY, Refusal.LOW_BATTERY),
        (65535, -200, (), Refusal.NONE),
        (0, -201, TEMPERATURE, Refusal.BAD_TEMPERATURE),
        (0, 600, (), Refusal.NONE),
        (0, 601, TEMPERATURE, Refusal.BAD_TEMPERATURE),
        (3499, 601, BATTERY + TEMPERATURE, Refusal.LOW_BATTERY),
    ],
)
def test_rule_8_a_start_needs_a_battery_and_a_temperature_within_limits_if_the_board_tells_them(
    vest: Vest, battery: int, temperature: int, missing: tuple[Ready, ...], refusal: Refusal
) -> None:
    # given a board that tells, or does not
    board(vest, battery, temperature)
    vest.ticks(30)
    vest.load(A)
    vest.ticks(6)
    # then the telemetry has what it tells, and what is missing
    assert (vest.telemetry.battery, vest.telemetry.temperature) == (battery, temperature)
    assert Ready(vest.telemetry.ready).missing == missing
    # when
    memory = vest.ticks(12, Start(A.id))
    assert vest.telemetry.refusal == refusal
    assert memory["controller.output.mode"] in (RUNNING if refusal is Refusal.NONE else {Mode.IDLE})


def test_rule_8_a_battery_that_runs_low_and_a_pack_that_heats_up_in_a_trial_are_told_and_do_not_end_it(
    vest: Vest,
) -> None:
    vest.ticks(30)
    vest.begin(A)
    vest.ticks(6)
    assert Ready(vest.telemetry.ready).missing == (Ready.IDLE,)
    # when
    board(vest, 3100, 655)
    vest.ticks(6)
    # then
    assert (vest.telemetry.battery, vest.telemetry.temperature) == (3100, 655)
    assert Ready(vest.telemetry.ready).missing == (Ready.IDLE, *BATTERY, *TEMPERATURE)
    assert vest.ticks(25)["controller.output.mode"] in RUNNING


def test_rule_8_the_board_is_asked_once_for_each_telemetry_from_the_first_tick_on(vest: Vest) -> None:
    # given a board that tells another value on each tick
    asked = []
    for battery in range(3001, 3017):
        board(vest, battery)
        asked.append(vest.tick(fix=False)["battery_mv"])
    # then the program has that of the first tick, and from there on of each fifth
    assert asked == [3001] * 5 + [3006] * 5 + [3011] * 5 + [3016]


def test_rule_7_a_polygon_that_came_by_radio_stops_the_animal_outside(vest: Vest) -> None:
    vest.ticks(30)
    memory = vest.begin(FENCED)
    assert memory["controller.state.corners"] == 7
    for axis, last in (("north", 70.0), ("east", -20.0)):
        assert memory[f"controller.state.corner_{axis}[7]"] == pytest.approx(last, abs=0.1)
    # when it walks east at 1.5 m/s, past the edge at 20 m
    east, outside = 0.0, []
    while memory["controller.output.mode"] != Mode.STOPPED:
        east += 0.06
        walking = {"gps_east": east, "gps_speed": 1.5, "gps_course": math.pi / 2, "heading_meas": math.pi / 2}
        memory = vest.ticks(1, **walking)
        outside.append(memory["estimator.output.east"] > 20)
    # then it is stopped within 0.48 s of the first estimate outside, and told
    assert 6 <= sum(outside) - 1 <= 12
    assert vest.played[-1] == Command.STOP
    assert memory["controller.output.anomaly"] == Anomaly.OUTSIDE_FENCE
    vest.ticks(6, **walking)
    assert Ready.INSIDE in Ready(vest.telemetry.ready).missing


def test_rule_8_a_start_without_a_mission_or_of_another_is_refused(vest: Vest) -> None:
    vest.ticks(12, Start(A.id))
    assert vest.telemetry.refusal == Refusal.NO_MISSION
    # and no bit of a mission's is on, wherever the animal is
    vest.ticks(60, gps_north=20.0)
    assert Ready(vest.telemetry.ready).missing == (
        Ready.MISSION, Ready.REACH, Ready.LEGS, Ready.FIRST_LEG, Ready.PLANNED, Ready.FENCE, Ready.INSIDE,
    )  # fmt: skip
    vest.tick(B, fix=False)
    vest.ticks(12, Start(A.id), gps_north=20.0)
    assert vest.telemetry.refusal == Refusal.OTHER_MISSION
    assert Ready(vest.telemetry.ready).missing == ()


def test_rule_8_no_trial_begins_on_an_estimate_that_is_too_old(vest: Vest) -> None:
    # given a receiver that falls silent: a fix is trusted for 15 s
    vest.ticks(12)
    vest.tick(A)
    for k in range(400):
        vest.tick(*([HERE] if k % 10 == 0 else []), fix=False)
    vest.tick(Start(A.id), fix=False)
    for _ in range(10):
        memory = vest.tick(fix=False)
    assert Ready(vest.telemetry.ready).missing == (Ready.ESTIMATE,)
    assert vest.telemetry.refusal == Refusal.NO_ESTIMATE
    assert memory["controller.output.mode"] == Mode.IDLE


def test_rule_8_a_mission_that_comes_before_the_first_fix_is_ready_with_it(vest: Vest) -> None:
    for _ in range(12):
        vest.tick(A, fix=False)
    assert Ready(vest.telemetry.ready).missing == (
        Ready.FIX, Ready.ACCURACY, Ready.ESTIMATE, Ready.PLANNED,
    )  # fmt: skip
    vest.ticks(20)
    assert Ready(vest.telemetry.ready).missing == ()


def test_rule_8_the_readiness_without_a_link_is_told_as_such(vest: Vest) -> None:
    vest.ticks(12)
    vest.tick(A)
    for _ in range(60):
        vest.tick()
    assert Ready(vest.telemetry.ready).missing == (Ready.LINK,)


def test_rule_9_bad_input_that_keeps_a_trial_from_beginning_withdraws_its_start(vest: Vest) -> None:
    # given a fix, and an inertial unit that drives the speed beyond the controller's range
    vest.ticks(12)
    vest.load(A)
    for _ in range(20):
        memory = vest.tick(fix=False, accel_x=199.0)
    assert memory["estimator.output.speed"] > 50
    assert memory["estimator.output.valid"] == 1
    # when
    vest.tick(Start(A.id), fix=False, accel_x=199.0)
    for _ in range(6):
        memory = vest.tick(fix=False)
    # then it is refused and not remembered
    assert vest.telemetry.refusal == Refusal.NO_ESTIMATE
    assert memory["controller.input.start"] == 0
    assert vest.ticks(60)["controller.output.mode"] == Mode.IDLE


# --- rule 9: an override holds while it is renewed ---


def test_rule_9_an_override_ends_a_second_after_it_was_last_sent(vest: Vest) -> None:
    # given an operator who is heard and renews it twice
    vest.ticks(10)
    for _ in range(3):
        vest.tick(Override(Command.LEFT), fix=False)
        for _ in range(9):
            vest.tick(fix=False)
    # when only signs of life come: 25 ticks are 1 s, 9 of which are over
    commands = [vest.tick(HERE, fix=False)["controller.output.command"] for _ in range(30)]
    assert commands == [Command.LEFT] * 16 + [Command.NONE] * 14
    assert Ready.RELEASED not in Ready(vest.telemetry.ready).missing
    # then it does not come back with another message
    assert vest.ticks(20)["controller.output.command"] == Command.NONE
    # but when it is sent again
    assert vest.tick(Override(Command.LEFT), fix=False)["controller.output.command"] == Command.LEFT


def test_rule_9_a_stop_holds_without_being_renewed_until_another_override_comes(vest: Vest) -> None:
    # given a trial that the operator stops once
    vest.ticks(10)
    vest.begin(A)
    vest.tick(Override(Command.STOP), fix=False)
    # when nothing but signs of life comes, for three times as long as other overrides hold
    commands = [vest.tick(HERE, fix=False)["controller.output.command"] for _ in range(75)]
    # then the animal stays stopped, in the trial
    assert set(commands) == {Command.STOP}
    assert Ready.RELEASED not in Ready(vest.telemetry.ready)
    # when it is released, then the trial goes on
    memory = vest.tick(Override(Command.NONE), fix=False)
    assert memory["controller.input.override"] == Command.NONE
    assert memory["controller.input.start"] == 1


def test_rule_9_a_stop_whose_operator_is_lost_ends_in_the_stop_of_the_lost_link(vest: Vest) -> None:
    # given a trial that the operator stops once
    vest.ticks(10)
    vest.begin(A)
    vest.tick(Override(Command.STOP), fix=False)
    # when the laptop is killed: the link is lost after 50 ticks, and ends the trial with a held stop
    memories = [vest.tick(fix=False) for _ in range(60)]
    assert {memory["controller.output.command"] for memory in memories} == {Command.STOP}
    assert memories[-1]["watchdog.output.link_ok"] == 0
    # then whoever comes back is not held up by it
    assert memories[-1]["radio.override"] == Command.NONE
    vest.tick(HERE, fix=False)
    assert Command.FORWARD not in [vest.tick(HERE, fix=False)["controller.output.command"] for _ in range(60)]


def test_rule_9_an_abort_ends_an_override(vest: Vest) -> None:
    # given a trial in which the operator leads
    vest.ticks(10)
    vest.begin(A)
    memory = vest.tick(Override(Command.LEFT), fix=False)
    assert memory["controller.output.command"] == Command.LEFT
    # when
    memory = vest.tick(Abort(), fix=False)
    # then the animal is stopped, then left alone
    assert memory["controller.output.command"] == Command.STOP
    assert memory["radio.override"] == Command.NONE
    assert vest.ticks(60)["controller.output.command"] == Command.NONE


def test_rule_8_no_trial_begins_under_an_override(vest: Vest) -> None:
    vest.ticks(10)
    vest.load(A)
    vest.tick(Override(Command.STOP), fix=False)
    memory = vest.tick(Start(A.id), fix=False)
    assert memory["controller.input.start"] == 0
    vest.ticks(6)
    assert Ready(vest.telemetry.ready).missing == (Ready.RELEASED,)
    assert vest.telemetry.refusal == Refusal.OVERRIDDEN
    # when it is released, then the start is not remembered
    vest.tick(Override(Command.NONE), fix=False)
    assert vest.ticks(20)["controller.output.mode"] == Mode.IDLE


@pytest.mark.parametrize("sensed", [{"accel_x": math.nan}, {"heading_meas": math.inf}, {"accel_x": 1e4}])
def test_an_inertial_unit_whose_samples_are_out_of_range_counts_as_silent(
    vest: Vest, sensed: dict[str, float]
) -> None:
    vest.ticks(10)
    vest.begin(A)
    assert vest.ticks(10)["watchdog.output.imu_ok"] == 1
    # when the unit sends on, but nothing that the estimator takes, then 5 ticks are borne
    assert vest.ticks(5, **sensed)["watchdog.output.imu_ok"] == 1
    memory = vest.ticks(1, **sensed)
    assert memory["watchdog.output.imu_ok"] == 0
    assert memory["controller.output.command"] == Command.STOP


def test_an_inertial_unit_that_repeats_itself_counts_as_silent(vest: Vest) -> None:
    vest.ticks(10)
    for _ in range(6):
        vest.k -= 1  # so the sample has the number of the one before
        memory = vest.tick(HERE, fix=False)
    assert memory["watchdog.output.imu_ok"] == 0


def test_a_bad_first_fix_does_not_settle_the_plane(vest: Vest) -> None:
    # given a first fix that is 150 km off and says so
    memory = vest.tick(fix=True, gps_north=150_000.0, gps_h_acc=5000.0)
    assert memory["local_plane.state.settled"] == 0
    # when good ones come, then it is settled there
    memory = vest.ticks(30)
    assert memory["local_plane.state.settled"] == 1
    assert memory["estimator.output.valid"] == 1
    assert abs(memory["estimator.output.north"]) < 1


def test_rule_8_a_mission_out_of_reach_is_ready_once_the_vest_is_there(vest: Vest) -> None:
    # given a mission 150 km away
    there = Mission(place(150_000, 0), (place(150_050, 0),))
    vest.ticks(12)
    vest.tick(there, fix=False)
    vest.ticks(12)
    assert Ready(vest.telemetry.ready).missing == (Ready.REACH,)
    # when the vest is carried there
    vest.ticks(60, gps_north=150_000.0)
    assert Ready(vest.telemetry.ready).missing == ()


def test_a_vest_carried_far_away_settles_the_plane_again_before_a_trial(vest: Vest) -> None:
    assert vest.ticks(12)["estimator.output.valid"] == 1
    far = vest.ticks(60, gps_north=150_000.0)
    assert far["estimator.output.valid"] == 1
    assert abs(far["estimator.output.north"]) < 1
    # but not in one: there it is a fix that cannot be
    assert vest.begin(Mission(place(150_000, 0), (place(150_050, 0),)))["controller.output.mode"] in RUNNING
    origin = far["local_plane.state.origin_latitude"]
    memory = vest.ticks(30, gps_north=0.0)
    assert memory["local_plane.state.origin_latitude"] == origin
    assert memory["estimator.state.bad_fixes"] > 0
