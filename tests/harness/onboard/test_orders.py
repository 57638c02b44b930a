"""The operator's orders to the program on board, in the sequences that a radio makes of them."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from itertools import count
from typing import Any

import pytest

from codegen.firmware.telemetry import FIELDS, Flag, Telemetry
from harness.log.geodesy import TangentPlane
from harness.onboard.instruments import InertialUnit, Receiver
from harness.onboard.memory import Memory
from harness.onboard.processors import Received, open_processor
from harness.onboard.radio import Abort, Decoder, Heartbeat, Mission, Position, Start, encode
from models.cmec import Mode
from models.commands import Command

PLANE = TangentPlane(math.radians(32.6), math.radians(-85.49))
RUNNING = {Mode.FORWARD, Mode.STOP_TO_TURN, Mode.LEFT, Mode.RIGHT, Mode.DEAD}


def place(north: float, east: float) -> Position:
    latitude, longitude = PLANE.from_plane(north, east)
    return Position(math.degrees(latitude), math.degrees(longitude))


HOME = place(0, 0)
A, B = Mission(HOME, (place(50, 0),)), Mission(HOME, (place(0, 50),))


NO_TELEMETRY = Telemetry(*[0] * len(FIELDS))


class Vest:
    """The program on this machine, at rest at home: ticks with or without a fix, and the memory after it."""

    def __init__(self) -> None:
        self.processor, self.numbers, self.decoder = open_processor("host"), count(1), Decoder()
        self.k = 0
        self.telemetry = NO_TELEMETRY

    def tick(self, *messages: Any, fix: bool | None = None, **sensed: float) -> Memory:
        """One tick: messages (or bytes) in one piece; a fix on each sixth tick unless `fix` says so."""
        signals = {f"{n}_{a}": 0.0 for n in ("accel", "gyro", "mag") for a in "xyz"}
        signals |= {
            "roll_meas": 0.0,
            "pitch_meas": 0.0,
            "heading_meas": 0.0,
            "gps_fix": 1.0,
            "gps_north": 0.0,
        }
        signals |= {"gps_east": 0.0, "gps_speed": 0.0, "gps_course": 0.0, "gps_h_acc": 3.5, "gps_s_acc": 0.1}
        signals |= sensed
        due = self.k % 6 == 5 if fix is None else fix
        reply = self.processor.tick(
            Received(
                Receiver(PLANE).fix(0.04 * self.k, signals) if due else b"",
                InertialUnit().sample(self.k, signals),
                b"".join(m if isinstance(m, bytes) else encode(m, next(self.numbers)) for m in messages),
            )
        )
        self.k += 1
        for telemetry in self.decoder.receive(reply.sent):
            self.telemetry = telemetry
        return Memory(reply.record)

    def ticks(self, number: int, *messages: Any, **sensed: float) -> Memory:
        """So many ticks, with heartbeats (or these messages) on every fifth."""
        for i in range(number):
            memory = self.tick(*(messages or (Heartbeat(),)) if i % 5 == 0 else (), fix=None, **sensed)
        return memory


@pytest.fixture
def vest() -> Iterator[Vest]:
    made = Vest()
    yield made
    made.processor.close()


def target(memory: Memory) -> tuple[float, float]:
    return tuple(round(memory[f"controller.state.target_{axis}"]) for axis in ("north", "east"))  # type: ignore[return-value]


def test_abort_and_another_start_in_one_piece_end_the_one_and_begin_the_other(vest: Vest) -> None:
    # given a trial under way
    vest.ticks(10)
    vest.tick(A, Start(A.id))
    memory = vest.ticks(10)
    assert memory["controller.output.mode"] in RUNNING
    assert target(memory) == (50, 0)
    # when an abort, another mission and its start come in the same tick
    memory = vest.tick(Abort(), B, Start(B.id))
    memory = vest.tick()
    # then the first one is stopped, the telemetry says that the other waits, and it begins after the stop
    assert memory["controller.output.mode"] == Mode.STOPPED
    vest.ticks(10)
    assert Flag.WAITING in Flag(vest.telemetry.flags)
    assert Flag.STARTED not in Flag(vest.telemetry.flags)
    memory = vest.ticks(60)
    assert memory["controller.output.mode"] in RUNNING
    assert target(memory) == (0, 50)
    assert vest.telemetry.mission_id == B.id


def test_rule_10_an_abort_stops_within_a_fifth_of_a_second_whatever_bytes_came_before(vest: Vest) -> None:
    # given a full line: 57600 baud are 230 bytes a tick
    draw = random.Random(10)
    vest.ticks(10)
    vest.tick(A)
    for k in range(40):
        memory = vest.ticks(60, Start(A.id))
        assert memory["controller.output.command"] not in (Command.NONE, Command.STOP)
        # when noise or the beginning of a long frame comes, and an ABORT in the middle of a tick's bytes
        begin = b"\xa5\x5a" + bytes([1, k, draw.randrange(20, 139)])
        before = draw.choice([begin, begin + draw.randbytes(9), draw.randbytes(draw.randrange(450))])
        pieces = [before[i : i + 230] for i in range(0, len(before), 230)]
        for piece in pieces[:-1]:
            vest.tick(piece)
        memories = [vest.tick(pieces[-1], Abort()), vest.tick()]
        # then it is obeyed on its tick, or on the next if a fix makes the radio wait: within 0.08 s
        assert Mode.STOPPED in [memory["controller.output.mode"] for memory in memories]
        assert memories[-1]["controller.output.command"] == Command.STOP
        vest.ticks(60)


def test_a_mission_that_comes_while_another_is_under_way_changes_nothing(vest: Vest) -> None:
    vest.ticks(10)
    vest.tick(A, Start(A.id))
    memory = vest.ticks(20, B, Start(B.id))
    # it is held, but the trial and the telemetry stay with the first
    assert target(memory) == (50, 0)
    assert vest.telemetry.mission_id == A.id
    assert Flag.STARTED in Flag(vest.telemetry.flags)
    assert Flag.WAITING not in Flag(vest.telemetry.flags)


def answers(vest: Vest, *messages: Any) -> bool:
    """A tick without a fix: is there telemetry?"""
    before = vest.telemetry
    vest.tick(*messages, fix=False)
    return vest.telemetry != before


def test_telemetry_that_is_due_as_a_mission_begins_comes_a_tick_later(vest: Vest) -> None:
    # given telemetry on every fifth tick
    vest.ticks(10)
    while not answers(vest):
        pass
    assert [answers(vest) for _ in range(9)] == [k == 4 for k in range(9)]
    # when a mission begins on the fifth
    memory = vest.tick(A, Start(A.id), fix=False)
    # then the telemetry of that tick comes on the next, and the one after it is on time
    assert target(memory) == (50, 0)
    assert vest.telemetry.received == 2  # the heartbeats
    assert [answers(vest) for _ in range(5)] == [True, False, False, False, True]
    assert Flag.STARTED in Flag(vest.telemetry.flags)


def test_starts_on_every_tick_of_a_mission_out_of_range_do_not_silence_the_telemetry(vest: Vest) -> None:
    vest.ticks(10)
    far = Mission(HOME, (place(2e5, 0),))
    answers(vest, far)
    # then each telemetry waits for one tick at most
    assert [answers(vest, Start(far.id)) for _ in range(30)].count(True) == 6
    assert Flag.STARTED not in Flag(vest.telemetry.flags)


def test_a_start_that_waits_is_cancelled_by_another_mission(vest: Vest) -> None:
    # given a start before the first fix
    for _ in range(5):
        vest.tick(A, Start(A.id), fix=False)
    # when another mission comes, and then the fix
    vest.tick(B, fix=False)
    vest.tick(fix=True)
    memory = vest.ticks(20)
    # then nothing begins until that one is started
    assert memory["controller.output.mode"] == Mode.IDLE
    vest.tick(Start(B.id), fix=False)
    assert target(vest.ticks(5)) == (0, 50)


def test_a_start_that_waits_is_cancelled_by_a_lost_link(vest: Vest) -> None:
    vest.tick(A, Start(A.id), fix=False)
    for _ in range(60):  # 2.4 s
        vest.tick(fix=False)
    vest.tick(fix=True)
    memory = vest.ticks(20)
    assert memory["controller.output.mode"] == Mode.IDLE
    assert memory["controller.output.command"] == Command.NONE


def test_a_start_soon_after_an_abort_begins_when_the_stop_has_been_held(vest: Vest) -> None:
    vest.ticks(10)
    vest.tick(A, Start(A.id))
    vest.ticks(10)
    vest.tick(Abort(), fix=False)
    memory = vest.ticks(10, Start(A.id))
    assert memory["controller.output.mode"] == Mode.STOPPED
    assert vest.ticks(60)["controller.output.mode"] in RUNNING


@pytest.mark.parametrize("sensed", [{"accel_x": math.nan}, {"heading_meas": math.inf}, {"accel_x": 1e4}])
def test_an_inertial_unit_whose_samples_are_out_of_range_counts_as_silent(
    vest: Vest, sensed: dict[str, float]
) -> None:
    vest.ticks(10)
    vest.tick(A, Start(A.id))
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
        memory = vest.tick(Heartbeat(), fix=False)
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


def test_a_vest_carried_far_away_settles_the_plane_again_before_a_trial(vest: Vest) -> None:
    assert vest.ticks(12)["estimator.output.valid"] == 1
    far = vest.ticks(60, gps_north=150_000.0)
    assert far["estimator.output.valid"] == 1
    assert abs(far["estimator.output.north"]) < 1
    # but not in one: there it is a fix that cannot be
    vest.tick(Mission(place(150_000, 0), (place(150_050, 0),)), fix=False)
    vest.tick(Start(Mission(place(150_000, 0), (place(150_050, 0),)).id), fix=False, gps_north=150_000.0)
    assert vest.ticks(2, gps_north=150_000.0)["controller.output.mode"] in RUNNING
    origin = far["local_plane.state.origin_latitude"]
    memory = vest.ticks(30, gps_north=0.0)
    assert memory["local_plane.state.origin_latitude"] == origin
    assert memory["estimator.state.bad_fixes"] > 0
