"""The onboard computer in the closed loop: the operator's laptop, the vest's answers, and whole trials."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from codegen.firmware.bundle import recorded
from codegen.firmware.key import SIMULATION_KEY
from codegen.firmware.telemetry import FIELDS, Flag, Ready, Refusal, Telemetry
from harness.cosim.fmu import Call, FmuDescription, FmuError, Quantity
from harness.cosim.loop import Outcome, Simulation
from harness.cosim.stepping import Event
from harness.log.geodesy import TangentPlane
from harness.log.log import Log, read_log
from harness.onboard import radio
from harness.onboard.memory import Memory
from harness.onboard.operator import RESEND, Operator
from harness.onboard.processors import Processor, ProcessorError, Reply, open_processor
from harness.onboard.radio import Decoder, Link, Mission, Position, Seal, encode
from harness.onboard.stand_in import Onboard, StandIn
from harness.trial import trial
from harness.trial.instances import open_onboard
from harness.trial.prepare import Prepared, prepared
from harness.trial.request import Changes, Request, build_missing, requested
from harness.trial.scenario import Scenario, load
from harness.trial.summary import position_error, summarize
from models.cmec import Cmec
from models.command_module import CommandModule
from models.commands import ENDS, Command, Status
from models.errors import UsageError
from models.four_state import FourState
from models.kit.timing import TICK
from models.modes import Anomaly, Mode
from tests.harness.cosim.tiny_fmu import V, tiny_fmu
from tests.harness.onboard.frames import SESSION

ORIGIN = (32.6, -85.49)  # deg
MISSION = Mission(Position(32.6, -85.49), (Position(32.601, -85.49),))
START = {"start": 1.0}

# --- the operator's laptop ---


def types(sent: bytes) -> list[Any]:
    """The messages of which the bytes are whole frames, by their classes."""
    known = {m.type: m for m in (radio.Mission, radio.Start, radio.Override, radio.Abort, radio.Heartbeat)}
    messages = []
    while sent:
        kind, length = sent[2], sent[3]
        assert radio.crc16(sent[2 : length + 18]) == 0
        messages.append(known[kind])
        sent = sent[length + 18 :]
    return messages


def overrides(sent: bytes) -> list[int]:
    """The commands of the OVERRIDE frames in the bytes: type 3, a payload of one byte."""
    return [sent[i + 8] for i in range(len(sent) - 8) if sent[i : i + 3] == b"\xa5\x5a\x03"]


numbers = count(1)  # of telemetry


def telemetry_frame(session: int = SESSION, nonce: int = 1, **fields: Any) -> bytes:
    """Telemetry as a frame, all zeros but these; it answers the laptop's first nonce."""
    values = dict.fromkeys(FIELDS, 0) | {"session": session, "nonce": nonce} | fields
    return encode(Telemetry(**values), next(numbers), Seal(SIMULATION_KEY, session))


def stranger() -> Operator:
    """A laptop that has heard nothing yet; its nonces are 1, 2 and so on."""
    return Operator(MISSION, Link(SIMULATION_KEY, count(1).__next__))


def greeted() -> Operator:
    """A laptop that a vest without a mission has answered."""
    operator = stranger()
    operator.receive(telemetry_frame())
    return operator


def test_mission_and_start_are_sent_again_until_the_telemetry_shows_them() -> None:
    operator = greeted()
    # given a wish: all of it goes out at once
    assert types(operator.send(0.0, True, Command.NONE, True))[:2] == [radio.Mission, radio.Start]
    # when nothing comes back, then nothing is sent for 0.4 s, and all again
    assert RESEND == 0.4
    for tick in range(1, 10):
        assert operator.send(tick * TICK, True, Command.NONE, True) == b""
    assert types(operator.send(10 * TICK, True, Command.NONE, True))[:2] == [radio.Mission, radio.Start]
    # when the telemetry tells another mission, then both again
    operator.receive(telemetry_frame(mission_id=MISSION.id ^ 1, flags=Flag.LOADED))
    assert types(operator.send(0.8, True, Command.NONE, True))[:2] == [radio.Mission, radio.Start]
    # when it tells the mission, then START alone
    held = {"mission_id": MISSION.id, "flags": Flag.LOADED}
    operator.receive(telemetry_frame(**held, received=operator.link.counter))
    assert types(operator.send(1.2, True, Command.NONE, True))[0] is radio.Start
    # when it says that the trial is under way, then neither; the vest still gets a message
    begun = {"mission_id": MISSION.id, "flags": Flag.LOADED | Flag.STARTED}
    operator.receive(telemetry_frame(**begun, received=operator.link.counter))
    sent = types(operator.send(1.6, True, Command.NONE, True))
    assert sent
    assert not {radio.Mission, radio.Start, radio.Abort} & set(sent)


def test_rule_9_a_vest_that_was_reset_gets_its_mission_again_but_no_start_without_a_new_wish() -> None:
    # given a trial under way: the START is the laptop's second message
    operator = greeted()
    assert types(operator.send(0.0, True, Command.NONE, True))[1] is radio.Start
    operator.receive(
        telemetry_frame(mission_id=MISSION.id, flags=Flag.STARTED, received=operator.link.counter)
    )
    operator.send(0.4, True, Command.NONE, True)
    # when the vest has begun anew (its battery), and answers
    operator.receive(telemetry_frame(session=2))
    assert types(operator.send(0.6, True, Command.NONE, True)) == [radio.Heartbeat, radio.Override]
    operator.receive(telemetry_frame(session=2, nonce=2))
    # then
    for k in range(2, 6):
        assert types(operator.send(k * RESEND, True, Command.NONE, True)) == [radio.Mission, radio.Override]
    # when the operator takes the wish back and wishes again
    assert radio.Abort in types(operator.send(2.4, False, Command.NONE, True))
    assert radio.Start in types(operator.send(2.8, True, Command.NONE, True))


def test_rule_9_a_mission_is_given_although_the_vest_holds_one_of_the_same_id() -> None:
    # given a vest that held a mission before this laptop gave any: another may have the same 16 bits
    operator = stranger()
    operator.receive(telemetry_frame(mission_id=MISSION.id, flags=Flag.LOADED, received=77))
    # then it is given before its START, until the vest has heard it
    for k in range(2):
        assert types(operator.send(k * RESEND, True, Command.NONE, True))[:2] == [radio.Mission, radio.Start]
    held = {"mission_id": MISSION.id, "flags": Flag.LOADED}
    operator.receive(telemetry_frame(**held, received=operator.link.counter))
    assert types(operator.send(2 * RESEND, True, Command.NONE, True))[0] is radio.Start
    # and again in another session
    operator.receive(telemetry_frame(**held, session=2))
    operator.receive(telemetry_frame(**held, session=2, nonce=2))
    assert types(operator.send(3 * RESEND, True, Command.NONE, True))[0] is radio.Mission


def test_telemetry_from_before_a_start_does_not_show_that_it_was_heard() -> None:
    # given an earlier trial, of which the telemetry tells until the vest has heard the ABORT
    operator = greeted()
    operator.send(0.0, True, Command.NONE, True)
    begun = {"mission_id": MISSION.id, "flags": Flag.STARTED, "received": operator.link.counter}
    operator.receive(telemetry_frame(**begun))
    operator.send(0.4, False, Command.NONE, True)
    operator.send(0.8, True, Command.NONE, True)
    # when
    operator.receive(telemetry_frame(**begun))
    # then the START is sent on, until one tells that it began
    assert radio.Start in types(operator.send(1.2, True, Command.NONE, True))
    operator.receive(
        telemetry_frame(mission_id=MISSION.id, flags=Flag.STARTED, received=operator.link.counter)
    )
    assert radio.Start not in types(operator.send(1.6, True, Command.NONE, True))


def counters(sent: bytes) -> list[int]:
    """Those of the frames in the bytes."""
    return [
        int.from_bytes(sent[i + 4 : i + 8], "big") for i in range(len(sent)) if sent[i : i + 2] == radio.SYNC
    ]


def test_rule_11_nothing_is_sent_before_the_vest_is_heard_and_no_mission_before_it_answers() -> None:
    operator = stranger()
    assert operator.send(0.0, True, Command.NONE, True) == b""
    # when it is heard, which a recording may be, then it is asked, with the laptop's nonce
    assert operator.receive(telemetry_frame(nonce=99, mission_id=MISSION.id)) is None
    sent = operator.send(TICK, True, Command.STOP, True)
    assert types(sent) == [radio.Heartbeat, radio.Override]
    assert sent[8:12] == (1).to_bytes(4, "big")
    # when it answers, then all of the wish goes out at once
    assert operator.receive(telemetry_frame(nonce=1)) is not None
    sent = operator.send(2 * TICK, True, Command.STOP, True)
    assert types(sent) == [radio.Mission, radio.Start, radio.Override]


def test_rule_11_the_laptops_counters_grow_and_answer_the_last_telemetry() -> None:
    # given a laptop, and another that is started while the vest goes on
    for operator in (greeted(), greeted()):
        sent = []
        for k in range(4):
            told = int.from_bytes((frame := telemetry_frame())[4:8], "big")
            operator.receive(frame)
            sent.append(counters(operator.send(k * RESEND, True, Command.NONE, True)))
            # then each answers, the first with the least counter that does
            assert sent[-1] == list(range(told << 8, (told << 8) + len(sent[-1])))
    # and many frames that answer one telemetry have counters of their own
    numbers_sent = [counters(operator.link.encode(radio.Abort()))[0] for _ in range(600)]
    assert numbers_sent == list(range(operator.link.counter - 599, operator.link.counter + 1))


def test_abort_is_sent_at_once_and_again_until_the_telemetry_shows_it() -> None:
    # given a mission under way
    operator = greeted()
    operator.receive(telemetry_frame(mission_id=MISSION.id, flags=Flag.STARTED))
    operator.send(0.0, True, Command.NONE, True)
    # when the wish changes a tick later
    assert radio.Abort in types(operator.send(TICK, False, Command.NONE, True))
    # then it is repeated in its turn
    assert operator.send(2 * TICK, False, Command.NONE, True) == b""
    assert radio.Abort in types(operator.send(TICK + RESEND, False, Command.NONE, True))
    # and no more once the vest tells that it has stopped
    operator.receive(telemetry_frame(mission_id=MISSION.id))
    assert radio.Abort not in types(operator.send(TICK + 2 * RESEND, False, Command.NONE, True))


def test_override_is_sent_at_once_and_its_release_is_repeated_as_well() -> None:
    # given a mission under way
    operator = greeted()
    operator.receive(telemetry_frame(mission_id=MISSION.id, flags=Flag.STARTED))
    operator.send(0.0, True, Command.NONE, True)
    # when the operator's command comes, and goes
    sent = [
        operator.send(k * TICK, True, Command.STOP if k < 25 else Command.NONE, True) for k in range(1, 50)
    ]
    # then it goes out on its tick and each 0.4 s from there, and so does the release: one may get lost
    by_tick = {k: overrides(data) for k, data in enumerate(sent, start=1) if data}
    assert by_tick == {1: [2], 11: [2], 21: [2], 25: [0], 35: [0], 45: [0]}


def test_nothing_is_sent_without_a_link_and_the_wish_is_sent_when_it_is_back() -> None:
    # given a mission under way
    operator = greeted()
    operator.receive(telemetry_frame(mission_id=MISSION.id, flags=Flag.STARTED))
    operator.send(0.0, True, Command.NONE, True)
    # when the link is lost and the operator wants it to end
    assert [operator.send(k * TICK, False, Command.RECALL, False) for k in range(1, 100)] == [b""] * 99
    # then it goes out on the first tick with a link
    sent = operator.send(100 * TICK, False, Command.RECALL, True)
    assert radio.Abort in types(sent)
    assert overrides(sent) == [Command.RECALL]


def test_laptop_keeps_the_last_telemetry_even_when_it_comes_in_pieces() -> None:
    operator = greeted()
    frames = telemetry_frame(time_ms=40) + telemetry_frame(time_ms=80)
    assert operator.receive(frames[:10]) is None
    last = operator.receive(frames[10:])
    assert last is not None
    assert last.time_ms == 80


# --- the vest, driven tick by tick ---

STILL = dict.fromkeys(
    [f"{n}_{a}" for n in ("accel", "gyro", "mag") for a in "xyz"]
    + ["roll_meas", "pitch_meas", "heading_meas", "gps_north", "gps_east", "gps_speed", "gps_course"],
    0.0,
) | {"accel_z": -9.81, "gps_h_acc": 3.5, "gps_s_acc": 0.1}
NO_MISSION = {"controller": {"waypoint_count": 1, "waypoint_north[1]": 100.0}}


class Silent:
    """A processor whose wires are cut from a tick on."""

    def __init__(self, processor: Processor) -> None:
        self.processor, self.image, self.start = processor, processor.image, processor.start
        self.cut: set[str] = set()

    def tick(self, received: Any) -> Reply:
        return self.processor.tick(replace(received, **dict.fromkeys(self.cut, b"")))

    def stack(self) -> int | None:
        return None

    def close(self) -> None:
        self.processor.close()


class Walk:
    """An onboard computer on a standing animal; each call is one tick, with a fix on every seventh."""

    def __init__(
        self, origin: tuple[float, float] = ORIGIN, values: Any = NO_MISSION, **firmware: Any
    ) -> None:
        self.wires = Silent(open_processor("host", firmware))
        self.onboard = Onboard(self.wires, origin, values)
        self.decoder, self.telemetry = Decoder(SIMULATION_KEY), list[Telemetry]()

    def __call__(self, wishes: Mapping[str, float] = START, signals: Mapping[str, float] = STILL) -> Memory:
        tick = self.onboard.tick
        reply = self.onboard.step(tick * TICK, {**signals, "gps_fix": tick % 7 == 0}, wishes)
        self.telemetry += [telemetry for _, telemetry in self.decoder.receive(reply.sent)]
        return self.onboard.memory

    def until(self, mode: Mode, wishes: Mapping[str, float] = START, most: int = 100) -> int:
        """Tick until the controller is in a mode; how many ticks that took."""
        for k in range(1, most + 1):
            if self(wishes)["controller.output.mode"] == mode:
                return k
        raise AssertionError(f"{mode.name} was not reached in {most} ticks")

    def commands(self, ticks: int, wishes: Mapping[str, float] = START) -> list[Command]:
        """The commands of so many ticks."""
        commands = []
        for _ in range(ticks):
            self(wishes)
            commands.append(self.onboard.command)
        return commands


@pytest.fixture
def walk() -> Iterator[Callable[..., Walk]]:
    """`walk(origin, values, **parameters by member)`: an onboard computer, stopped at the end."""
    made: list[Walk] = []

    def make(*arguments: Any, **firmware: Any) -> Walk:
        made.append(Walk(*arguments, **firmware))
        return made[-1]

    yield make
    for one in made:
        one.onboard.close()


def heard_last(vest: Walk, wishes: Mapping[str, float]) -> int:
    """Tick until the operator has just been heard; the number of ticks since then is 0."""
    for _ in range(20):
        if vest(wishes)["watchdog.state.link_age"] == 0:
            return 0
    raise AssertionError("the operator was not heard in 20 ticks")


def test_animal_stands_until_the_trial_starts(walk: Callable[..., Walk]) -> None:
    vest = walk()
    # given no start: the link comes up, and nothing is commanded from then on
    assert vest.commands(50, {})[5:] == [Command.NONE] * 45
    # when started, then forward, 1500 Hz (Table 4.1), at most two ticks later: a fix makes the radio wait
    assert vest.until(Mode.FORWARD) <= 2
    assert vest.onboard.command is Command.FORWARD


def test_lost_link_stops_the_animal_2_s_after_the_last_message(walk: Callable[..., Walk]) -> None:
    # given an animal that goes, and a message on this very tick
    vest = walk()
    vest.until(Mode.FORWARD)
    heard_last(vest, START)
    # when the link is lost, then it goes on for 2 s, 50 ticks, and stops on the next
    commands = vest.commands(60, START | {"link_ok": 0.0})
    assert commands.index(Command.STOP) == 50
    assert set(commands[50:]) == {Command.STOP}
    assert vest.onboard.memory["controller.state.overruled"] == Anomaly.LOST_LINK
    # and nothing was told to the operator meanwhile
    row = dict(zip(FIELDS, vest.onboard.row((vest.onboard.tick - 1) * TICK), strict=True))
    assert row["time_ms"] <= (vest.onboard.tick - 60) * TICK
    # when it is back, then it stops to turn, at least 1.5 s (Table 4.2), and goes on
    assert vest.until(Mode.FORWARD) >= 1.5 / TICK


def test_an_operator_who_never_sends_stops_the_animal(walk: Callable[..., Walk]) -> None:
    # given an animal that goes, and a link that the laptop takes for good: the vest's receiver is deaf
    vest = walk()
    vest.until(Mode.FORWARD)
    heard_last(vest, START)
    vest.wires.cut = {"radio"}
    # then
    assert vest.commands(60).index(Command.STOP) == 50
    # and the telemetry says so
    assert not vest.telemetry[-1].flags & Flag.LINK_OK


def test_link_timeout_is_a_parameter_of_the_firmware(walk: Callable[..., Walk]) -> None:
    vest = walk(watchdog={"link_timeout": 0.8})
    vest.until(Mode.FORWARD)
    heard_last(vest, START)
    assert vest.commands(60, START | {"link_ok": 0.0}).index(Command.STOP) == 20


def test_silent_inertial_unit_stops_the_animal_after_a_fifth_of_a_second(walk: Callable[..., Walk]) -> None:
    # given an animal that goes
    vest = walk()
    vest.until(Mode.FORWARD)
    # when
    vest.wires.cut = {"imu"}
    commands = vest.commands(20)
    # then 0.2 s are 5 ticks without a sample
    assert commands.index(Command.STOP) == 5
    assert set(commands[5:]) == {Command.STOP}
    assert vest.onboard.memory["controller.state.overruled"] == Anomaly.INVALID_ESTIMATE
    assert not vest.telemetry[-1].flags & Flag.IMU_OK
    # and the estimator skipped what did not come
    assert vest.onboard.memory["estimator.state.bad_samples"] == 20
    # when samples come again, then it goes on after the stop
    vest.wires.cut = set()
    assert vest.until(Mode.FORWARD) >= 1.5 / TICK


def test_silent_receiver_stops_the_animal_when_the_last_fix_is_too_old(walk: Callable[..., Walk]) -> None:
    # given an estimate that is trusted for 3 s, and a fix on this tick
    vest = walk(estimator={"max_age": 3.0})
    vest.until(Mode.FORWARD)
    while (vest.onboard.tick - 1) % 7:
        vest()
    assert vest.onboard.memory["estimator.state.age"] == 0
    # when no more fixes come to an animal that walks north at 1 m/s as far as it knows
    vest.wires.cut = {"gps"}
    memories = [vest() for _ in range(90)]
    # then: 75 ticks are 3 s
    overruled = [m["controller.state.overruled"] for m in memories]
    assert overruled.index(Anomaly.INVALID_ESTIMATE) == 75
    assert vest.onboard.command is Command.STOP
    assert not vest.telemetry[-1].flags & Flag.VALID
    # when a fix comes again, then it is trusted at once
    vest.wires.cut = set()
    for _ in range(8):
        memory = vest()
    assert memory["controller.state.overruled"] == Anomaly.NONE


def test_receiver_is_trusted_for_15_s_by_default(walk: Callable[..., Walk]) -> None:
    vest = walk()
    for _ in range(8):  # fixes on ticks 0 and 7
        vest()
    vest.wires.cut = {"gps"}
    valid = [bool(vest()["estimator.output.valid"]) for _ in range(380)]
    assert valid == [True] * 375 + [False] * 5


def test_no_trial_starts_before_the_first_fix(walk: Callable[..., Walk]) -> None:
    # given a receiver that is silent
    vest = walk()
    vest.wires.cut = {"gps"}
    # when the operator starts
    vest.commands(30)
    # then the mission is held, and the start is refused
    memory = vest.onboard.memory
    assert (memory["radio.mission.count"], memory["controller.output.mode"]) == (1, Mode.IDLE)
    assert vest.telemetry[-1].refusal == Refusal.NO_FIX
    assert vest.telemetry[-1].flags & (Flag.LOADED | Flag.FIXED | Flag.STARTED) == Flag.LOADED
    # when a fix comes, then it begins with the next START
    vest.wires.cut = set()
    assert vest.until(Mode.FORWARD, most=20)
    vest.commands(6)
    assert vest.telemetry[-1].refusal == Refusal.NONE


@pytest.mark.parametrize(("far", "begins"), [(99_900.0, True), (100_100.0, False)])
def test_a_mission_too_far_away_is_not_started(walk: Callable[..., Walk], far: float, begins: bool) -> None:
    # given a waypoint about 100 km east, the controller's range
    mission = {"waypoint_count": 2, "waypoint_east[1]": 50.0, "waypoint_east[2]": far}
    vest = walk(ORIGIN, {"controller": mission})
    # when
    vest.commands(30)
    # then it is started or refused as a whole, and the operator is told
    assert (vest.onboard.memory["controller.output.mode"] != Mode.IDLE) == begins
    assert bool(vest.telemetry[-1].flags & Flag.STARTED) == begins
    assert vest.telemetry[-1].flags & Flag.LOADED
    assert vest.telemetry[-1].refusal == (Refusal.NONE if begins else Refusal.OUT_OF_REACH)


def test_start_of_another_mission_is_refused(walk: Callable[..., Walk]) -> None:
    # given a vest that holds a mission
    vest = walk()
    vest.commands(10, {})
    assert vest.onboard.memory["radio.mission.count"] == 1
    # when another is started
    held = vest.onboard.operator.mission
    another = vest.onboard.operator.link.encode(radio.Start(held.id ^ 0x8000))
    vest.onboard.operator.send = lambda *_: another  # type: ignore[method-assign]
    for _ in range(6):
        vest({})
    # then it says why, and stands
    assert vest.onboard.memory["controller.output.mode"] == Mode.IDLE
    assert vest.telemetry[-1].refusal == Refusal.OTHER_MISSION


def test_an_aborted_trial_stops_the_animal_and_can_be_started_again(walk: Callable[..., Walk]) -> None:
    # given an animal that goes
    vest = walk()
    vest.until(Mode.FORWARD)
    # when it is aborted, then it is stopped at once (two ticks: a fix makes the radio wait)
    assert vest.until(Mode.STOPPED, {}) <= 2
    assert vest.onboard.command is Command.STOP
    # and the stop is held 1.5 s (Table 4.2)
    held = vest.until(Mode.IDLE, {})
    assert held == pytest.approx(1.5 / TICK, abs=1)
    assert not vest.telemetry[-1].flags & Flag.STARTED
    # when started again, then it goes
    assert vest.until(Mode.FORWARD) <= 2


def test_override_beats_the_controller_and_is_released(walk: Callable[..., Walk]) -> None:
    # given an animal that goes
    vest = walk()
    vest.until(Mode.FORWARD)
    # when
    for command in (Command.RECALL, Command.LEFT, Command.RIGHT, Command.STOP):
        commands = vest.commands(3, START | {"override": float(command)})
        # then within two ticks
        assert commands[-1] is command
    # when released, then the stop is the controller's own, before it goes on
    vest.commands(2)
    assert vest.onboard.memory["radio.override"] == Command.NONE
    assert vest.until(Mode.FORWARD) >= 1.5 / TICK - 2


def test_a_message_on_a_tick_with_a_fix_is_obeyed_on_the_next(walk: Callable[..., Walk]) -> None:
    # given an animal that goes, and a fix on the next tick
    vest = walk()
    vest.until(Mode.FORWARD)
    while vest.onboard.tick % 7:
        vest()
    # when the operator's command is sent on it
    commands = vest.commands(2, START | {"override": float(Command.RECALL)})
    # then it is not lost
    assert commands == [Command.FORWARD, Command.RECALL]


@pytest.mark.parametrize(
    "origin", [(0.0, 180.0), (0.0, -180.0), (-16.5, -179.9999), (60.0, 179.9999), (-89.0, 12.0)]
)
def test_vest_works_far_from_home_and_across_the_date_line(
    walk: Callable[..., Walk], origin: tuple[float, float]
) -> None:
    # given a mission of four waypoints around the origin, and an animal a little off it
    places = [(30.0, 40.0), (30.0, -40.0), (-30.0, -40.0), (-30.0, 40.0)]
    mission = {"waypoint_count": 4, "home_north": 5.0, "home_east": -5.0}
    for i, (north, east) in enumerate(places, start=1):
        mission |= {f"waypoint_north[{i}]": north, f"waypoint_east[{i}]": east}
    vest = walk(origin, {"controller": mission})
    here = STILL | {"gps_north": 3.0, "gps_east": -12.0}
    # when it starts
    for _ in range(40):
        memory = vest(START, here)
    # then the waypoints lie where they should, as seen from the first fix; a unit is 1.1 cm, twice
    got = [
        (memory[f"controller.state.route_north[{i}]"], memory[f"controller.state.route_east[{i}]"])
        for i in range(1, 5)
    ]
    expected = [(north - 3, east + 12) for north, east in places]
    np.testing.assert_allclose(got, expected, atol=0.025)
    assert memory["controller.state.base_north"] == pytest.approx(2.0, abs=0.025)
    # and the estimate is back in the sensors' frame, and as the telemetry has it
    assert vest.onboard.output("estimator", "north") == pytest.approx(3.0, abs=0.025)
    assert vest.onboard.output("estimator", "east") == pytest.approx(-12.0, abs=0.025)
    plane = TangentPlane(*map(math.radians, origin))
    latitude, longitude = (math.degrees(x) for x in plane.from_plane(3.0, -12.0))
    last = vest.telemetry[-1]
    assert last.latitude / 1e7 == pytest.approx(latitude, abs=2e-7)
    assert abs(last.longitude) <= 1_800_000_000
    unit = 1e-7 / math.cos(math.radians(origin[0]))  # a cm of east in deg
    assert abs((last.longitude / 1e7 - longitude + 180) % 360 - 180) <= 2 * unit
    # the 30 m north and 52 m east of the first waypoint
    assert last.distance == pytest.approx(10 * math.hypot(27, 52), abs=1)


def test_a_sound_without_a_command_ends_the_trial() -> None:
    # given a vest that plays a sound without a meaning
    reply = Reply(open_processor("host").start, b"", 440, False, False)
    image = SimpleNamespace(path=Path("vest.elf"))
    processor: Any = SimpleNamespace(image=image, start=reply.record, tick=lambda received: reply)
    onboard = Onboard(processor, ORIGIN, NO_MISSION)
    # then
    with pytest.raises(
        ProcessorError, match=r"vest.elf: the vest plays 440 Hz, left False, right False at t = 0.2 s"
    ):
        onboard.step(0.2, STILL | {"gps_fix": 0.0}, {})


@pytest.mark.parametrize(
    ("tones", "message"),
    [
        ({"stop_tone": 1500.0}, "command_module.stop_tone is 1500 Hz, as for FORWARD"),
        (
            {"recall_tone": 3500.4},
            "command_module.recall_tone is 3500.4 Hz, as for STOP",
        ),  # whole Hz are played
        ({"forward_tone": 0.0}, "command_module.forward_tone is 0 Hz, as for NONE"),
    ],
)
def test_commands_with_the_same_tone_are_refused(tones: dict[str, float], message: str) -> None:
    processor: Any = SimpleNamespace(start=bytes(4 * len(recorded())))
    with pytest.raises(UsageError, match=message):
        Onboard(processor, ORIGIN, {"command_module": tones})


# --- whole trials ---


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Log:
    """The log of three_waypoint, seed 1, through bytes."""
    return fly(load("three_waypoint"), tmp_path_factory.mktemp("onboard"))


def fly(scenario: Scenario, folder: Path, onboard: str = "host") -> Log:
    request = Request(scenario, onboard=onboard)
    build_missing(request)
    with prepared(request) as ready:
        trial.run(request, ready, folder)
    return read_log(folder / trial.LOG)


def test_default_trial_through_bytes_succeeds_from_start_to_recall(flown: Log) -> None:
    # then both waypoints, the recall, and home
    summary = summarize(flown)
    assert (summary["outcome"], summary["waypoints_reached"]) == ("success", 2)
    assert flown["controller.command"][-2] == Command.RECALL
    assert flown["controller.status"][-1] == Status.SUCCESS
    assert math.hypot(flown["plant.north"][-1], flown["plant.east"][-1]) < 7 + 3  # d' and the error
    assert flown.metadata["run"]["onboard"] == "host"
    # and the command module's log is what the vest played (Table 4.1)
    tones = {0: 0, 1: 1500, 2: 3500, 3: 9500, 4: 0, 5: 0}
    played = [tones[int(c)] for c in flown["controller.command"]]
    assert flown["command_module.tone_hz"].tolist() == played
    assert flown["command_module.vibrate_right"].tolist() == (flown["controller.command"] == 5).tolist()


def test_estimate_in_the_log_is_in_the_frame_of_the_sensors(flown: Log, tmp_path: Path) -> None:
    # given the same trial with the FMUs
    by_fmus = fly(load("three_waypoint"), tmp_path, "")
    onboard_error, fmu_error = position_error(flown), position_error(by_fmus)
    assert onboard_error is not None
    assert fmu_error is not None
    # then the errors are of one size: GPS wanders by 1 m (gps_wander); a frame that is off by the first fix's
    # error would add about as much
    assert onboard_error.mean() == pytest.approx(fmu_error.mean(), abs=0.3)
    assert onboard_error.max() < fmu_error.max() + 0.7
    # and right behind a fix, the estimate is as near to it as the filter brings it, first tick included
    assert flown["estimator.north"][0] == pytest.approx(flown["sensors.gps_north"][0], abs=0.012)
    assert flown["estimator.east"][0] == pytest.approx(flown["sensors.gps_east"][0], abs=0.012)


def test_telemetry_in_the_log_has_the_programs_values(flown: Log) -> None:
    # given the rows on which telemetry came
    sent = flown["telemetry.time"]
    rows = np.flatnonzero(np.diff(sent, prepend=0.0) > 0)
    # then 5 a second
    assert len(rows) == pytest.approx(len(sent) / 5, abs=2)
    # and each is of the tick on which it came, within half a unit of the radio's
    np.testing.assert_allclose(sent[rows], flown.time[rows], atol=1e-9)
    plane = TangentPlane(*map(math.radians, flown.origin))
    north, east = plane.to_plane(flown["telemetry.latitude"], flown["telemetry.longitude"])
    for name, got, unit in (
        ("estimator.north", north, 0.0112), ("estimator.east", east, 0.0112), ("estimator.speed", None, 1e-2),
        ("controller.distance", None, 1e-1), ("controller.deviation", None, 1e-4),
        ("estimator.heading", None, 1e-4), ("estimator.speed_sd", None, 1e-2), ("controller.status", None, 0),
        ("controller.command", None, 0), ("controller.mode", None, 0), ("controller.waypoint", None, 0),
        ("controller.directional_commands", None, 0), ("estimator.rejected_fixes", None, 0),
        ("estimator.jumps", None, 0), ("estimator.recoveries", None, 0),
    ):  # fmt: skip
        values = flown[f"telemetry.{name.split('.')[1]}"] if got is None else got
        assert np.abs(values[rows] - flown[name][rows]).max() <= 0.51 * unit + (unit == 0.0112) * 0.0112, name
    # the first START came with its mission; what one needs was there as the second came; then the controller
    # was idle no more
    refusals, begun = flown["telemetry.refusal"][rows], flown["telemetry.mode"][rows] > Mode.IDLE
    assert set(refusals) == {Refusal.NONE, Refusal.NOT_PLANNED}
    assert not refusals[begun].any()
    unloaded = (
        Ready.MISSION, Ready.REACH, Ready.LEGS, Ready.FIRST_LEG, Ready.PLANNED, Ready.FENCE, Ready.INSIDE,
    )  # fmt: skip
    ready = [Ready(int(x)).missing for x in flown["telemetry.ready"][rows]]
    assert {x for x, on in zip(ready, begun, strict=True) if not on} <= {
        (), (Ready.PLANNED,), unloaded,
    }  # fmt: skip
    assert {x for x, on in zip(ready, begun, strict=True) if on} == {
        (Ready.IDLE,), (Ready.FIRST_LEG, Ready.IDLE),
    }  # fmt: skip
    # on every tick of the trial a sample came, and on every fourth of a second a fix
    assert flown["telemetry.imu_frames"][rows[-1]] == rows[-1] + 1
    assert flown["telemetry.gps_frames"][rows[-1]] == 3 * (math.floor(sent[rows[-1]] / 0.25) + 1)
    assert not flown["telemetry.gps_errors"].any()
    assert not flown["telemetry.imu_errors"].any()
    assert not flown["telemetry.link_errors"].any()


def test_a_trial_on_board_runs_again_from_its_log_to_the_same_log(flown: Log, tmp_path: Path) -> None:
    changes = Changes()
    with requested(str(flown.path), changes) as request, prepared(request) as ready:
        assert request.onboard == "host"
        trial.run(request, ready, tmp_path)
    assert (tmp_path / trial.LOG).read_bytes() == flown.path.read_bytes()


def test_log_of_a_processor_can_be_run_with_fmus(flown: Log) -> None:
    with requested(str(flown.path), Changes(onboard="fmu")) as request:
        assert request.onboard == ""


@pytest.mark.parametrize(("north", "refusal"), [(8.0, None), (6.0, Refusal.SHORT_FIRST_LEG)])
def test_rule_8_a_trial_that_the_vest_refuses_says_why(
    north: float, refusal: Refusal | None, tmp_path: Path
) -> None:
    # given a first waypoint nearer or farther than 7 m, and GPS without error
    exact = {"sensors.gps_wander": 0.0, "sensors.gps_position_noise": 0.0}
    scenario = replace(load("two_waypoint"), waypoints=((north, 0.0),), duration=2.0, parameters=exact)
    request = Request(scenario, onboard="host")
    with prepared(request) as ready:
        # when it has run, then a note tells, and what ended the trial
        summary = trial.run(request, ready, tmp_path)
    refusals = [note for note in summary["notes"] if "refused" in note]
    assert refusals == ([f"the vest refused the last START: {refusal.words}"] if refusal else [])
    assert summary["stopped_by"] == (f"START was refused: {refusal.words}" if refusal else None)


def test_outage_sends_no_fixes_and_the_estimate_ages(tmp_path: Path) -> None:
    # given no GPS from 6 to 9 s
    outage = {"sensors.outage_start": [6.0], "sensors.outage_end": [9.0]}
    scenario = replace(load("three_waypoint"), parameters=outage, duration=12.0)
    log = fly(scenario, tmp_path)
    # then no frame comes in that time (3 a fix, at 0.25 s), and they go on behind it
    frames, time = log["telemetry.gps_frames"], log.time
    at = {t: frames[np.searchsorted(time, t + 1e-9) - 1] for t in (5.96, 8.96, 12.0)}
    assert at == {5.96: 3 * 24, 8.96: 3 * 24, 12.0: 3 * (24 + 12)}
    # the deviation of the position grows, the estimate stays valid (15 s), and falls with the next fix
    deviation = log["estimator.north_sd"]
    assert deviation[time <= 8.99][-1] > 2 * deviation[time < 6][-1]
    assert deviation[-1] < deviation[time <= 8.99][-1]
    assert log["estimator.valid"].all()


DOG = [V("command", "input", "Integer"), V("north", unit="m"), V("east", unit="m"),
       V("heading", unit="rad"), V("v", unit="m/s")]  # fmt: skip


@pytest.mark.parametrize(
    ("does", "ends"),
    [
        ("v[1] = NAN", 'output "north" is nan at t = 1.28 s; expected a finite number'),
        ("v[4] = NAN", 'output "v" is nan at t = 1.28 s; expected a finite number'),
        ("v[1] = 1e8", ""),  # 100 000 km north, 900 deg of latitude: what no receiver can say
        ("v[4] = 1e9", ""),
        ("v[1] = 1e300", ""),
    ],
)
def test_a_dog_beyond_the_instruments_ranges_ends_no_run_with_a_crash(
    tmp_path: Path, does: str, ends: str
) -> None:
    # given a dog that does so from the step to 1.28 s on, when a fix is due
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, f"if (t > 1.23) {does};", depends=False)
    dog.with_suffix(".toml").write_text('[outputs]\nspeed = { name = "v" }')
    scenario = replace(load("two_waypoint"), duration=3.0)
    request = Request(scenario, swaps={"plant": dog}, onboard="host")
    with prepared(request) as ready:
        # when
        if ends:
            # then the loop ends it, and names it
            with pytest.raises(FmuError, match=ends):
                trial.run(request, ready, tmp_path / "out")
        else:
            # then the receiver has no fix, and the trial goes on
            assert trial.run(request, ready, tmp_path / "out")["ticks"] == 76


# --- float32 through direct signals and through bytes ---

ROLES = {"estimator": FourState, "controller": Cmec, "command_module": CommandModule}


class Float32(StandIn):
    """A component's C in float32 in the place of its FMU: the loop's signals come as they are."""

    def __init__(self, native: Any, name: str, description: FmuDescription) -> None:
        self.block, self.native = ROLES[name], native(ROLES[name], "float")
        self.name, self.description, self.label = name, description, f"{name} in float32"
        self._step = getattr(self.native.library, f"{self.block.title()}_step")

    def initialize(self, values: Mapping[str, float]) -> None:
        self.native._call("defaults")
        for name in values.keys() & set(self.block.flat_names("parameter")):
            self.native[name] = values[name]
        self.native._call("initialize")

    def _fields(self, quantities: Sequence[Quantity], address: int) -> tuple[list[Any], Any]:
        kind: Any = np.ctypeslib.as_ctypes_type(np.dtype(quantities[0].access.dtype).str)
        places = [self.native._place(q.name) for q in quantities]
        cast = {"Real": float, "Integer": int, "Boolean": bool}
        fields = [
            (group, q.name, cast[v.type.value]) for q, (group, v, _) in zip(quantities, places, strict=True)
        ]
        return fields, (kind * len(fields)).from_address(address)

    def setting(self, quantities: Sequence[Quantity], address: int) -> Call:
        fields, values = self._fields(quantities, address)

        def set_all(_: Any) -> None:
            for (group, name, cast), value in zip(fields, values, strict=True):
                setattr(group, name, cast(value))

        return set_all, (object(),)

    def getting(self, quantities: Sequence[Quantity], address: int) -> Call:
        fields, values = self._fields(quantities, address)

        def get_all(_: Any) -> None:
            for i, (group, name, _cast) in enumerate(fields):
                values[i] = getattr(group, name)

        return get_all, (object(),)

    def stepping(self, time: Any, size: float, count: int = 1) -> Call:
        return (lambda _: self._step(ctypes.byref(self.native.data))), (time,)


@dataclass
class Flight:
    """How a trial went, and the tick on which the controller began."""

    outcome: Outcome
    began: int


@contextmanager
def simulated(scenario: Scenario, stand_ins: Callable[[Prepared], Mapping[str, Any]]) -> Iterator[Simulation]:
    with (
        prepared(Request(scenario)) as ready,
        Simulation(ready.system, ready.plan.values, stand_ins=stand_ins(ready)) as simulation,
    ):
        yield simulation


def rows_of(simulation: Simulation, scenario: Scenario, events: Sequence[Event] = ()) -> Flight:
    modes: list[float] = []
    column = [q.name for q in simulation.columns("controller")].index("mode")
    outcome = simulation.run(
        events,
        duration=scenario.duration,
        stop=trial.stop_of(simulation),
        record=lambda times, values: modes.extend(values["controller"][:, column]),
    )
    return Flight(outcome, int(np.flatnonzero(modes)[0]))


def through_bytes(scenario: Scenario, pvt: bool = False) -> Flight:
    boards: list[Onboard] = []

    def on_board(ready: Prepared) -> Mapping[str, Any]:
        boards.append(open_onboard(Request(scenario, onboard="host"), ready, open_processor))
        boards[0].receiver = replace(boards[0].receiver, pvt=pvt)
        return boards[0].stand_ins(ready.fmus)

    with simulated(scenario, on_board) as simulation:
        boards[0].connect(simulation.outputs("sensors"))
        try:
            return rows_of(simulation, scenario)
        finally:
            boards[0].close()


def through_signals(scenario: Scenario, native: Any, start: int = 0) -> Flight:
    def in_float32(ready: Prepared) -> Mapping[str, Any]:
        return {name: Float32(native, name, ready.fmus[name]) for name in ROLES}

    with simulated(scenario, in_float32) as simulation:
        events = [Event(0.0, "controller", "start", 0.0), Event(start * TICK, "controller", "start", 1.0)]
        return rows_of(simulation, scenario, events)


def test_default_trial_succeeds_in_float32_through_signals_and_through_bytes(native: Any) -> None:
    scenario = load("three_waypoint")
    assert scenario.seed == 1
    assert through_signals(scenario, native).outcome.stopped_by == Status.SUCCESS
    for pvt in (False, True):
        assert through_bytes(scenario, pvt).outcome.stopped_by == Status.SUCCESS


@pytest.mark.parametrize("seed", range(1, 11))
def test_a_trial_through_bytes_has_the_outcome_of_one_through_signals_from_the_same_tick(
    seed: int, native: Any
) -> None:
    # given a trial through bytes; its start comes by radio: the vest tells its session on the first tick, the
    # laptop greets it on the second, the vest answers on the sixth, and the start comes again once it has
    # projected the mission
    scenario = replace(load("three_waypoint"), seed=seed)
    bytes_ = through_bytes(scenario)
    assert 6 < bytes_.began <= 18
    # when float32 gets the sensors' signals as they are, and the start on that tick
    signals = through_signals(scenario, native, bytes_.began)
    # then it comes to the same; units of 1 cm and 1 cm/s move decisions by some ticks
    assert signals.began == bytes_.began
    assert signals.outcome.stopped_by == bytes_.outcome.stopped_by
    assert signals.outcome.stopped_by in ENDS
    assert signals.outcome.time == pytest.approx(bytes_.outcome.time, abs=1.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_telemetry_across_the_date_line_has_longitudes_within_180_deg(
    walk: Callable[..., Walk], side: float
) -> None:
    # given an origin 5.6 m from it, and an animal that walks 12 m across it at 1.5 m/s
    vest = walk((0.0, side * 179.99995))
    for k in range(200):
        east = side * 1.5 * TICK * k
        going = {"gps_north": 0.0, "gps_east": east, "gps_speed": 1.5, "gps_course": side * math.pi / 2}
        vest(START, STILL | going | {"heading_meas": side * math.pi / 2})
    # then it is seen on the other side
    longitudes = [row.longitude for row in vest.telemetry]
    assert max(map(abs, longitudes)) <= 1_800_000_000
    assert side * longitudes[-1] < 0
