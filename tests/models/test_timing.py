"""Times compared with numbers of ticks: exact for whole ticks in float32 as in double."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from models.kit.block import Block
from models.kit.timing import TICK, lasted, ticks_until, ticks_within


def test_a_tick_is_that_of_the_inertial_unit() -> None:
    assert 1 / TICK == 25  # Hz (2.3)
    assert Block.sample_time == TICK


@pytest.mark.parametrize(
    ("time", "within", "until"),
    [
        (0.0, 0, 0),
        (0.039, 1, 1),  # a tenth of a tick's tolerance on either side of a whole number
        (0.035, 0, 1),
        (0.04, 1, 1),
        (0.043, 1, 1),
        (0.045, 1, 2),
        (1.5, 37, 38),  # 37.5 ticks
        (3.0, 75, 75),
    ],
)
def test_ticks_of_a_time_rounded_down_and_up(time: float, within: int, until: int) -> None:
    assert (float(ticks_within(ca.SX(time), TICK)), float(ticks_until(ca.SX(time), TICK))) == (within, until)


def test_whole_numbers_of_ticks_that_were_rounded_to_float32_count_as_many() -> None:
    time, count = ca.SX.sym("time"), ca.SX.sym("count")
    counts = ca.Function("counts", [time], [ticks_within(time, TICK), ticks_until(time, TICK)])
    over = ca.Function("over", [count, time], [lasted(count, time, TICK)])
    for ticks in range(2501):
        # given a decimal as a float32 parameter holds it
        rounded = float(np.float32(round(ticks * TICK, 2)))
        # then
        assert tuple(map(float, counts(rounded))) == (ticks, ticks), rounded
        # and the time is over on its last tick, not on the one before
        assert [float(over(n, rounded)) for n in (ticks - 1, ticks)] == [0, 1], rounded


def test_a_tolerance_may_be_given() -> None:
    assert not float(lasted(ca.SX(24), ca.SX(0.961), TICK, tolerance=1e-6))  # 0.96 s
    assert float(lasted(ca.SX(24), ca.SX(0.961), TICK))
