"""Rule 11, only the handler: what strangers can send to a vest, through bytes."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from itertools import count

import pytest

from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.firmware.telemetry import Flag
from harness.onboard import radio
from harness.onboard.operator import Operator
from harness.onboard.processors import Received
from harness.onboard.radio import Abort, Heartbeat, Link, Mission, Override, Seal, Start
from models.commands import Command
from models.modes import Mode
from tests.harness.onboard.frames import SESSION
from tests.harness.onboard.vest import HERE, Vest, place

STRANGER = Seal(Key(b"a stranger's key"), SESSION)
NORTH = Mission(place(0, 0), (place(50, 0),))


@pytest.fixture
def vest() -> Iterator[Vest]:
    made = Vest()
    yield made
    made.processor.close()


def switch_on(vest: Vest, session: int) -> None:
    """The vest's battery is taken out and put in again."""
    program = vest.processor._library  # type: ignore[attr-defined]
    ctypes.c_uint32.in_dll(program, "pil_session").value = session
    program.pil_start()
    vest.told = vest.counter = vest.k = 0
    vest.decoder = radio.Decoder(SIMULATION_KEY)


def forged(vest: Vest, message: radio.Message) -> bytes:
    """A frame that is right but for its key: its counter answers the last telemetry."""
    return radio.encode(message, (vest.told << 8) + 255, STRANGER)


def going(vest: Vest) -> None:
    """A trial is under way."""
    vest.ticks(10)
    vest.begin(NORTH)
    assert vest.ticks(10)["controller.output.mode"] == Mode.FORWARD


def test_rule_11_a_strangers_frames_do_nothing_and_are_told(vest: Vest) -> None:
    # given a vest with a mission
    vest.ticks(10)
    vest.load(NORTH)
    other = Mission(place(0, 0), (place(0, 50),))
    # when a stranger sends all that there is
    for message in (other, Start(NORTH.id), Override(Command.LEFT), Heartbeat(9)):
        vest.tick(forged(vest, message))
    memory = vest.ticks(10)
    # then nothing has changed, and the telemetry tells it
    assert (memory["controller.output.mode"], memory["radio.override"]) == (Mode.IDLE, 0)
    assert vest.telemetry.mission_id == NORTH.id
    assert (vest.telemetry.link_forged, vest.telemetry.link_replayed, vest.telemetry.nonce) == (
        4,
        0,
        HERE.nonce,
    )
    # and a stranger's ABORT stops no trial
    vest.tick(Start(NORTH.id), fix=False)
    vest.ticks(10)
    memory = vest.tick(forged(vest, Abort()))
    assert memory["controller.output.mode"] == Mode.FORWARD


def test_rule_11_a_strangers_heartbeats_do_not_keep_the_link(vest: Vest) -> None:
    going(vest)
    # when the handler is gone, and a stranger's heartbeats, and the handler's recorded one, go on for 2.2 s
    recorded = vest.encode(HERE)
    vest.tick(recorded)
    for _ in range(55):
        memory = vest.tick(forged(vest, HERE), recorded)
    # then the link is lost, and the trial has ended
    assert memory["controller.output.mode"] == Mode.STOPPED
    assert vest.played[-1] == Command.STOP
    assert Flag.LINK_OK not in Flag(vest.telemetry.flags)
    assert vest.telemetry.link_forged >= 40
    assert vest.telemetry.link_replayed >= 40


def test_rule_11_what_was_sent_before_acts_no_more(vest: Vest) -> None:
    # given a trial that was started and aborted, and all frames recorded
    going(vest)
    start, left = vest.encode(Start(NORTH.id)), vest.encode(Override(Command.LEFT))
    vest.tick(start, left)
    vest.tick(Abort())
    vest.ticks(60)
    # when they come again, in either order
    for frames in ((start, left), (left, start)):
        vest.tick(*frames)
        memory = vest.ticks(10)
        # then nothing begins
        assert memory["controller.output.mode"] == Mode.IDLE
        assert vest.played[-1] == Command.NONE
    assert vest.telemetry.link_replayed == 4


def test_rule_11_a_recorded_session_starts_nothing_after_a_reset(vest: Vest) -> None:
    # given all that the radio brought in a session
    air = [
        b"".join(map(vest.encode, m)) for m in ((HERE,), (NORTH,), (), (HERE,), (Start(NORTH.id),), (HERE,))
    ]
    for bytes_ in air:
        vest.tick(bytes_, fix=False)
    assert vest.telemetry.session == SESSION
    # when the vest is reset, and the same bytes come on the same ticks
    switch_on(vest, SESSION + 1)
    for bytes_ in air:
        vest.tick(bytes_, fix=False)
    memory = vest.ticks(5)
    # then it holds no mission, and has counted each frame as forged
    assert (memory["radio.mission.count"], memory["controller.output.mode"]) == (0, Mode.IDLE)
    assert vest.telemetry.session == SESSION + 1
    assert (vest.telemetry.link_forged, vest.telemetry.link_replayed) == (5 + 1, 0)


def test_rule_11_a_start_that_is_held_back_is_too_late_and_an_abort_is_not(vest: Vest) -> None:
    vest.ticks(10)
    vest.load(NORTH)
    # given a START and an ABORT that a stranger has kept from the vest, and all others, for 4 s
    start, abort = vest.encode(Start(NORTH.id)), vest.encode(Abort())
    for _ in range(100):
        vest.tick()
    # when they come
    memory = vest.tick(start, fix=False)
    assert memory["controller.output.mode"] == Mode.IDLE
    assert memory["radio.replayed"] == 1
    assert vest.tick(abort, fix=False)["radio.replayed"] == 1


def test_rule_10_a_strangers_aborts_at_the_lines_full_rate_do_not_hold_the_handlers_back(vest: Vest) -> None:
    going(vest)
    # given 57600 baud, 230 bytes a tick, of forged frames
    for _ in range(10):
        vest.tick(forged(vest, Abort()) * 12)
    # when an ABORT is among them
    memories = [vest.tick(forged(vest, Abort()) * 6, Abort(), forged(vest, Abort()) * 5), vest.tick()]
    # then it is obeyed on its tick, or on the next
    assert Mode.STOPPED in [memory["controller.output.mode"] for memory in memories]
    assert vest.played[-1] == Command.STOP


def test_rule_11_a_laptop_that_is_started_anew_leads_on(vest: Vest) -> None:
    def lead(operator: Operator, ticks: int, start: bool) -> None:
        for k in range(ticks):
            sent = operator.send(0.04 * k, start, Command.NONE, True)
            reply = vest.processor.tick(Received(radio=sent))
            operator.receive(reply.sent)

    # given a laptop that has given its mission, and another with the same key
    for nonce in (1, 1000):
        link = Link(SIMULATION_KEY, count(nonce).__next__)
        operator = Operator(NORTH, link)
        lead(operator, 50, start=False)
        # then the vest answers each, and refuses none of its frames
        assert operator._telemetry is not None
        assert operator._telemetry.nonce == nonce
        assert operator._telemetry.mission_id == NORTH.id
        assert (operator._telemetry.link_forged, operator._telemetry.link_replayed) == (0, 0)
