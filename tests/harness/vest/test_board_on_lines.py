"""What an STM32F405 is flashed with leads the animal, on QEMU, over its three serial lines."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from codegen.firmware.key import SIZE, Key
from harness.vest.vest import open_vest
from models.errors import UsageError
from tests.harness.vest.devices import require_qemu
from tests.harness.vest.leading import PATIENCE, Leading, mission_of

SCENARIO = "two_waypoint"
KEY = Key(bytes([7] * (SIZE - 1) + [1]))


def test_the_board_is_commanded_by_radio_and_moves_the_animal_after_a_reset_too() -> None:
    require_qemu()
    with open_vest(SCENARIO, target="stm32f405", key=KEY) as vest:
        operator = Leading(vest.port, mission_of(SCENARIO), KEY)

        def lead_until(condition: Callable[[], bool]) -> None:
            end = time.monotonic() + PATIENCE
            while not condition():
                assert time.monotonic() < end
                assert vest.is_running, vest.fault
                operator.turn(vest.state.time)
                time.sleep(0.005)

        lead_until(lambda: vest.state.speed > 0.5)
        vest.reset()
        operator.start = False  # after a reset START needs to be wished anew
        lead_until(lambda: operator.operator.link.sessions == 2 and vest.state.speed == 0.0)
        operator.start = True
        lead_until(lambda: vest.state.speed > 0.5)
        assert vest.state.resets == 1


def test_the_board_runs_by_the_clock_alone() -> None:
    with (
        pytest.raises(UsageError, match="--speed 2: a simulated stm32f405 runs by the clock; expected 1"),
        open_vest(SCENARIO, target="stm32f405", speed=2.0),
    ):
        pass
