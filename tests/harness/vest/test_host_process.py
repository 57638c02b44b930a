"""The program that is shipped leads the animal in its own process, by whoever speaks to its radio."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from codegen.firmware.key import SIZE, Key
from codegen.firmware.navigation import DEFAULT
from codegen.firmware.telemetry import Flag
from harness.log.log import FILE, read_log
from harness.onboard.processors import ProcessorError, Received
from harness.onboard.radio import Decoder
from harness.vest.host_process import HostProcess, open_host_process
from harness.vest.port import Port
from harness.vest.pty_port import Pty
from harness.vest.tcp_port import TcpPort
from harness.vest.vest import Vest, open_vest
from models.commands import Command, Status
from tests.harness.vest.devices import Connection, Device
from tests.harness.vest.leading import Leading, Steps, mission_of

SCENARIO = "two_waypoint"
KEY, OTHER = Key(bytes([7] * (SIZE - 1) + [1])), Key(bytes([8] * (SIZE - 1) + [1]))


@contextmanager
def alone(radio: Port, **options: object) -> Iterator[tuple[Vest, Steps]]:
    """A vest whose program is a process of its own, on a clock that the test lets go on."""
    steps = Steps()
    with open_vest(
        SCENARIO,
        radio=radio,
        in_process=False,
        now=steps.now,
        sleep=steps.sleep,
        **options,  # type: ignore[arg-type]
    ) as vest:
        yield vest, steps


def test_an_operator_at_the_serial_device_leads_the_animal_to_success(tmp_path: Path) -> None:
    with (
        closing(Pty()) as radio,
        alone(radio, out=tmp_path) as (vest, steps),
        Device(radio.address) as laptop,
    ):
        operator = Leading(laptop, mission_of(SCENARIO))
        steps.lead(vest, operator)

        assert operator.status == Status.SUCCESS
        assert Flag.INSECURE in Flag(operator.told[-1].flags)
        assert abs(vest.state.north) < 12
        vest.reset()
        steps.ticks(vest, 60, operator)
        assert operator.operator.link.sessions == 2

    log = read_log(tmp_path / FILE)
    components = {channel.component for channel in log.channels}
    assert {"plant", "sensors", "command_module", "telemetry"} <= components
    assert not {"estimator", "controller"} & components  # the program keeps them to itself
    assert {Command.FORWARD, Command.RECALL} <= {int(c) for c in log["plant.command"]}
    assert (log["command_module.tone_hz"][log["plant.command"] == Command.FORWARD] == 1500).all()
    assert Status.SUCCESS in log["telemetry.status"]


def test_over_tcp_the_owner_leads_to_success_and_a_stranger_does_nothing() -> None:
    with closing(TcpPort()) as radio, alone(radio, key=KEY) as (vest, steps):
        for key in (None, OTHER):
            with Connection(radio.address) as stranger:
                intruder = Leading(stranger, mission_of(SCENARIO), key)
                steps.ticks(vest, 150, intruder)
                assert intruder.told == []
                assert vest.state.speed == 0.0

        with Connection(radio.address) as laptop:
            owner = Leading(laptop, mission_of(SCENARIO), KEY)
            steps.lead(vest, owner)

        assert owner.status == Status.SUCCESS
        assert Flag.INSECURE not in Flag(owner.told[-1].flags)
        assert owner.told[-1].link_forged > 0


@pytest.fixture(scope="module")
def program() -> Iterator[HostProcess]:
    """The program in its own process."""
    with closing(open_host_process("host", {}, DEFAULT, None)) as process:
        process.reset(0)
        yield process


def told(program: HostProcess, ticks: int, received: Callable[[int], Received]) -> list[int]:
    """The times [ms] of the telemetry that comes in so many ticks."""
    decoder = Decoder(None)
    times = []
    for tick in range(ticks):
        times += [t.time_ms for _, t in decoder.receive(program.tick(received(tick)).sent)]
    return times


def test_the_program_makes_each_tick_of_its_clock_however_fast_that_runs(program: HostProcess) -> None:
    times = told(program, 200, lambda tick: Received())

    assert times
    assert all(later - earlier == 200 for earlier, later in pairwise(times))
    assert times[-1] > 190 * 40


def test_bytes_that_the_program_cannot_take_harm_nobody(program: HostProcess) -> None:
    flood = Received(bytes(20_000), bytes(20_000), bytes(20_000))

    assert told(program, 50, lambda tick: flood if tick < 10 else Received())


def test_a_program_that_is_reset_begins_its_time_anew(program: HostProcess) -> None:
    told(program, 20, lambda tick: Received())
    program.reset(0)
    assert program._clock.now == 0
    assert told(program, 20, lambda tick: Received())[0] < 20 * 40


def test_a_program_that_ends_by_itself_is_named(program: HostProcess) -> None:
    program.reset(0)
    assert program._process
    os.kill(program._process.pid, signal.SIGKILL)

    program._process.wait()

    with pytest.raises(ProcessorError, match="the program ended by itself, status -9"):
        program.tick(Received())
    program.reset(0)
    assert told(program, 20, lambda tick: Received())


def test_a_program_that_cannot_start_says_why(program: HostProcess) -> None:
    program._environment["VEST_CLOCK"] = "/nowhere/clock"
    with pytest.raises(ProcessorError, match="VEST_CLOCK: /nowhere/clock: No such file"):
        program.reset(0)
