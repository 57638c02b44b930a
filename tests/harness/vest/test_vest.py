"""A vest in this process obeys whoever commands it by radio, and nobody else."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.firmware.key import SIMULATION_KEY, SIZE, Key
from codegen.firmware.telemetry import Flag
from harness.log.log import FILE, Log, read_log
from harness.onboard.processors import open_processor
from harness.onboard.processors.processor import Received, Reply
from harness.onboard.radio import Decoder
from harness.trial.scenario import Disturbance, Scenario, Setting, load
from harness.vest.vest import State, Vest, open_vest
from models.commands import Command, Status
from models.errors import CanineError, UsageError
from tests.harness.vest.leading import Leading, Steps, mission_of

SCENARIO = "two_waypoint"
KEY, OTHER = Key(bytes([7] * (SIZE - 1) + [1])), Key(bytes([8] * (SIZE - 1) + [1]))
RAN = 250  # ticks within which an operator who is heard has begun the mission

Open = Callable[..., tuple[Vest, Steps]]


@pytest.fixture
def opened() -> Iterator[Open]:
    """Opens vests on clocks that the test lets go on; they are closed behind it."""
    with ExitStack() as stack:

        def open_(scenario: object = SCENARIO, **options: object) -> tuple[Vest, Steps]:
            steps = Steps()
            vest = open_vest(scenario, now=steps.now, sleep=steps.sleep, **options)  # type: ignore[arg-type]
            return stack.enter_context(vest), steps

        yield open_


@pytest.fixture(scope="module")
def led(tmp_path_factory: pytest.TempPathFactory) -> tuple[Leading, Log, list[str], Vest]:
    """A mission that was led by radio: the operator, the vest's log, notes, the vest."""
    out, steps = tmp_path_factory.mktemp("led"), Steps()
    notes: list[str] = []
    with open_vest(SCENARIO, seed=1, out=out, now=steps.now, sleep=steps.sleep, note=notes.append) as vest:
        operator = Leading(vest.port, mission_of(SCENARIO))
        steps.lead(vest, operator)
    return operator, read_log(out / FILE), notes, vest


def test_an_operator_at_the_port_leads_the_animal_to_success(
    led: tuple[Leading, Log, list[str], Vest],
) -> None:
    operator, _, _, vest = led
    assert operator.status == Status.SUCCESS
    assert operator.told[-1].waypoint == len(operator.operator.mission.waypoints)
    assert math.hypot(vest.state.north, vest.state.east) < 12  # back home
    assert Flag.INSECURE in Flag(operator.told[-1].flags)
    assert not vest.is_running


def test_the_safety_rules_hold_whatever_reading_the_scenario_states(
    led: tuple[Leading, Log, list[str], Vest],
) -> None:
    operator, _, notes, _ = led
    assert operator.told[-1].issues_left < 65_535  # rule 3's budget
    assert f'{SCENARIO}: its reading "calibrated" is without the safety rules; the vest is "guarded", ' in (
        "\n".join(notes)
    )


def test_the_log_of_a_vest_has_the_animal_what_was_played_and_the_telemetry(
    led: tuple[Leading, Log, list[str], Vest],
) -> None:
    operator, log, _, vest = led
    assert log.broken == ""
    assert len(log.time) == vest.state.ticks
    assert log["plant.north"][-1] == vest.state.north
    assert log["controller.status"][-1] == Status.SUCCESS
    assert {Command.FORWARD, Command.RECALL} <= {int(c) for c in log["plant.command"]}
    assert log["telemetry.waypoint"][-1] == operator.told[-1].waypoint
    assert np.any(log["sensors.gps_fix"])


def test_an_operators_left_is_felt_on_the_left(opened: Open) -> None:
    vest, steps = opened()
    operator = Leading(vest.port, mission_of(SCENARIO))
    operator.start, operator.override = False, Command.LEFT
    steps.ticks(vest, 100, operator)
    assert vest.state.command is Command.LEFT
    felt = [vest._worn.output("command_module", f"vibrate_{side}") for side in ("left", "right")]
    assert felt == [1.0, 0.0]


def test_mission_and_orders_of_the_scenario_are_not_on_board(
    opened: Open, led: tuple[Leading, Log, list[str], Vest]
) -> None:
    notes: list[str] = []
    ordered = replace(load(SCENARIO), sets=(Setting("controller.override", "FORWARD", 1.0),))
    vest, steps = opened(ordered, note=notes.append)

    steps.ticks(vest, 100)

    assert vest.state.speed == 0.0
    assert vest.state.command in (Command.STOP, Command.NONE)  # nobody is heard
    assert any("waypoints are not on board" in note for note in notes)
    assert any("[[set]] of controller.override does nothing" in note for note in notes)
    assert not any("[[set]]" in note for note in led[2])


def test_without_an_operator_the_animal_is_stopped_and_the_vest_tells_what_is_missing(opened: Open) -> None:
    vest, steps = opened()
    decoder = Decoder(None)

    steps.ticks(vest, 100)

    told = [telemetry for _, telemetry in decoder.receive(vest.port.read())]
    assert len(told) == 100 // 5
    assert {t.command for t in told} == {Command.STOP, Command.NONE}  # rule 3 ends the tone
    assert not Flag(told[-1].flags) & (Flag.LINK_OK | Flag.LOADED)
    assert vest.state.speed == 0.0
    vest.wait(0.001)  # no longer than that
    assert vest.is_running


def test_with_a_key_the_vest_obeys_its_owner_and_not_a_stranger(opened: Open) -> None:
    vest, steps = opened(key=KEY)
    stranger = Leading(vest.port, mission_of(SCENARIO), None)
    steps.ticks(vest, RAN, stranger)
    forger = Leading(vest.port, mission_of(SCENARIO), OTHER)
    steps.ticks(vest, RAN, forger)
    assert stranger.told == forger.told == []  # neither is answered
    assert vest.state.speed == 0.0

    owner = Leading(vest.port, mission_of(SCENARIO), KEY)
    steps.ticks(vest, RAN, owner)

    assert owner.told[-1].link_forged > 0  # the stranger's
    assert owner.status == Status.RUNNING
    assert Flag.INSECURE not in Flag(owner.told[-1].flags)
    assert vest.state.speed > 0.0


def test_a_reset_ends_the_mission_and_begins_another_session(opened: Open) -> None:
    vest, steps = opened()
    operator = Leading(vest.port, mission_of(SCENARIO))
    steps.ticks(vest, RAN, operator)
    assert operator.status == Status.RUNNING
    before, origin = operator.told[-1].session, vest._worn._origin()
    moved = vest.state

    vest.reset()
    operator.start = False
    steps.ticks(vest, 60, operator)

    after = operator.told[-1]
    assert vest.state.resets == 1
    assert after.session != before
    assert after.time_ms < 60 * 40
    assert after.status == Status.IDLE
    assert vest.state.command in (Command.NONE, Command.STOP)
    assert vest.state.time > moved.time  # the animal's time goes on
    assert vest._worn._origin() != origin  # that of its first fix since
    vest.reset()
    steps.ticks(vest, 2)
    assert vest.state.resets == 2


def test_every_vest_begins_a_session_of_its_own(opened: Open) -> None:
    sessions = set()
    for _ in range(2):
        vest, steps = opened()
        steps.ticks(vest, 10)
        sessions |= {t.session for _, t in Decoder(None).receive(vest.port.read())}
    assert len(sessions) == 2


def test_a_lost_radio_brings_nothing_either_way_and_the_vest_stops_the_animal(opened: Open) -> None:
    scenario = replace(load(SCENARIO), faults=(Disturbance("radio", "lost", 8.0, 14.0),))
    vest, steps = opened(scenario)
    operator = Leading(vest.port, mission_of(SCENARIO))
    steps.ticks(vest, 200, operator)
    assert operator.status == Status.RUNNING
    heard = len(operator.told)

    steps.ticks(vest, 150, operator)

    assert len(operator.told) <= heard + 1
    assert vest.state.command in (Command.STOP, Command.NONE)
    assert vest.state.speed == 0.0
    steps.ticks(vest, 20, operator)
    assert operator.told[-1].time_ms > 14_000
    assert operator.operator.link.lost > 20  # telemetry of those 6 s


def test_bytes_that_come_faster_than_the_radio_carries_harm_nobody(opened: Open) -> None:
    vest, steps = opened()
    for _ in range(50):
        vest.port.write(b"\xa5\x5a" * 10_000)
        steps.ticks(vest, 1)
    operator = Leading(vest.port, mission_of(SCENARIO))

    steps.ticks(vest, RAN, operator)

    assert operator.status == Status.RUNNING
    assert vest.state.dropped > 500_000
    assert "bytes came faster than the radio carries" in vest.state.account()


def carried(vest: Vest, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """So many bytes the radio brings from now on, on each tick on which it brings any."""
    processor, brought = vest._worn.processor, []
    tick = processor.tick

    def noted(received: Received) -> Reply:
        if received.radio:
            brought.append(len(received.radio))
        return tick(received)

    monkeypatch.setattr(processor, "tick", noted)
    return brought


def test_the_radio_brings_what_it_carries_and_its_modem_holds_so_much(
    opened: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    vest, steps = opened()
    steps.ticks(vest, 1)
    brought = carried(vest, monkeypatch)

    vest.port.write(bytes(10_000))
    steps.ticks(vest, 25)

    assert brought == [230] * 18 + [186]  # 40 ms at 57600 baud, then what 4096 bytes of a buffer held
    assert vest.state.dropped == 10_000 - 230 - 4096

    # a reset empties it
    brought.clear()
    vest.port.write(bytes(1000))
    steps.ticks(vest, 1)
    vest.reset()
    steps.ticks(vest, 10)
    assert brought == [230]


def test_what_waits_while_the_radio_is_lost_is_lost(opened: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    vest, steps = opened(replace(load(SCENARIO), faults=(Disturbance("radio", "lost", 0.4, 0.8),)))
    steps.ticks(vest, 8)
    brought = carried(vest, monkeypatch)

    vest.port.write(bytes(1000))
    steps.ticks(vest, 7)
    vest.port.write(bytes(100))  # while it is lost
    steps.ticks(vest, 23)

    assert 0 < sum(brought) < 1000
    assert brought == [230] * len(brought)


def test_the_account_tells_what_became_of_the_ticks() -> None:
    state = State(ticks=1234, missed=2, latest=0.0123, lost=1.25, resets=1, dropped=7000)
    assert state.account() == (
        "1,234 ticks, 2 deadlines missed, 12.3 ms late at most, 1.2 s left out, "
        "7,000 bytes came faster than the radio carries, 1 reset"
    )
    assert State(resets=2).account() == "0 ticks, 0 deadlines missed, 0.0 ms late at most, 2 resets"


def run_until_it_ends(scenario: Scenario) -> None:
    """A vest that nobody stops."""
    steps = Steps()
    with open_vest(scenario, now=steps.now, sleep=steps.sleep) as vest:
        with pytest.raises(AssertionError, match="the vest has ended"):
            steps.ticks(vest, 100)
        assert isinstance(vest.fault, CanineError)


def test_a_fault_that_ends_the_loop_is_raised_where_the_vest_is_closed() -> None:
    scenario = replace(load(SCENARIO), faults=(Disturbance("plant.speed", "nan", 1.0),))
    with pytest.raises(CanineError, match="expected a finite number"):
        run_until_it_ends(scenario)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"speed": 0.0}, "--speed 0: expected 0.05 to 100"),
        ({"speed": math.nan}, "--speed nan"),
        ({"target": "rabbit4000"}, "--target rabbit4000: runs no vest in real time; expected one of host, "),
    ],
)
def test_what_no_vest_can_do_is_refused(opened: Open, options: dict[str, object], text: str) -> None:
    with pytest.raises(UsageError, match=text):
        opened(**options)


@pytest.mark.parametrize("target", ["host", "cortex-m4f"])
def test_a_processor_that_is_reset_begins_the_session_asked_for_and_signs_by_its_key(target: str) -> None:
    processor = open_processor(target, key=KEY)
    try:
        first = processor.start
        for _ in range(7):
            processor.tick(Received())
        processor.reset(0xC0FFEE)  # type: ignore[attr-defined]
        assert processor.start != first  # the session stands in it
        sent = b"".join(processor.tick(Received()).sent for _ in range(7))
    finally:
        processor.close()

    told = [telemetry for _, telemetry in Decoder(KEY).receive(sent)]
    assert [(t.session, t.time_ms) for t in told] == [(0xC0FFEE, 0), (0xC0FFEE, 200)]
    known = Decoder(SIMULATION_KEY)
    assert known.receive(sent) == []
    assert known.forged == len(told)


def test_a_vest_that_is_stopped_before_its_first_tick_leaves_no_log(tmp_path: Path) -> None:
    steps = Steps()
    with open_vest(SCENARIO, out=tmp_path / "out", now=steps.now, sleep=steps.sleep):
        pass
    assert not list(tmp_path.iterdir())


def test_ctrl_c_while_its_end_is_waited_for_does_not_hide_that_it_runs() -> None:
    with open_vest(SCENARIO) as vest:
        main = threading.main_thread().ident
        threading.Timer(0.2, signal.pthread_kill, [main, signal.SIGINT]).start()
        with pytest.raises(KeyboardInterrupt):
            vest.wait(60.0)
        assert vest.is_running
    assert not vest.is_running
