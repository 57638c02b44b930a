"""Faults of signals: what each kind makes of a signal, and where the blocks stand in a system."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from models.disturbance import (
    FAULTS,
    BooleanFault,
    Fault,
    FaultyLink,
    IntegerFault,
    Kind,
    Placed,
    RealFault,
    disturb,
)
from models.errors import WiringError
from models.kit.declaration import Type
from models.kit.link import Link
from models.kit.model import Model
from models.system import SYSTEMS, System

FIRST, AFTER, TICKS = 3, 7, 10
RAMP = [float(k + 1) for k in range(TICKS)]


def passed(block: type[Fault], signal: Sequence[float], **parameters: float) -> list[float]:
    """What arrives of a signal, disturbed on the ticks 3 to 6 unless the parameters say otherwise."""
    model = Model(block, {"first": FIRST, "after": AFTER} | parameters)
    model.initialize()
    arrived = []
    for value in signal:
        model["signal"] = value
        model.step()
        arrived.append(model["disturbed"])
    return arrived


@pytest.mark.parametrize(
    ("kind", "parameters", "expected"),
    [
        (Kind.OFF, {}, [0, 0, 0, 0]),
        (Kind.STUCK, {}, [3, 3, 3, 3]),
        (Kind.OFFSET, {"value": -0.5}, [3.5, 4.5, 5.5, 6.5]),
        (Kind.SCALE, {"value": 2}, [8, 10, 12, 14]),
        (Kind.DELAY, {"delay": 2}, [2, 3, 4, 5]),
        (Kind.DROPOUTS, {"value": 1}, [3, 3, 3, 3]),
        (Kind.JUMP, {"value": 8}, [4 + 8, 5 + 6, 6 + 4, 7 + 2]),
    ],
)
def test_a_real_signal_is_disturbed_in_the_window_alone(
    kind: Kind, parameters: dict[str, float], expected: list[float]
) -> None:
    arrived = passed(RealFault, RAMP, kind=kind, **parameters)
    assert arrived == [*RAMP[:FIRST], *expected, *RAMP[AFTER:]]


def test_nan_arrives_in_the_window_alone() -> None:
    arrived = passed(RealFault, RAMP, kind=Kind.NAN)
    assert [math.isnan(value) for value in arrived] == [FIRST <= k < AFTER for k in range(TICKS)]


@pytest.mark.parametrize("block", FAULTS.values())
@pytest.mark.parametrize("kind", Kind)
def test_every_kind_that_a_type_can_have_changes_the_signal(kind: Kind, block: type[Fault]) -> None:
    # given a signal that is never 0 for long, and changes on each tick
    signal = [float(k % 2 == 0) for k in range(TICKS)] if block is BooleanFault else RAMP
    # when
    arrived = passed(block, signal, kind=kind, value=0.7, delay=1)
    # then
    assert arrived[:FIRST] == signal[:FIRST]
    is_changed = any(a != b for a, b in zip(arrived, signal, strict=True))
    suits_all = {Kind.OFF, Kind.STUCK, Kind.DELAY, Kind.DROPOUTS}
    assert is_changed == (block is RealFault or kind in suits_all)


def test_a_fault_that_begins_with_the_trial_knows_the_first_value() -> None:
    assert passed(IntegerFault, RAMP[:3], kind=Kind.STUCK, first=0) == [1, 1, 1]
    assert passed(IntegerFault, RAMP[:4], kind=Kind.DELAY, first=0, delay=2) == [1, 1, 1, 2]
    assert passed(RealFault, RAMP[:2], kind=Kind.DROPOUTS, first=0, value=1) == [1, 1]


def test_the_longest_delay_is_50_ticks() -> None:
    ramp = [float(k) for k in range(60)]
    assert passed(RealFault, ramp, kind=Kind.DELAY, delay=50, first=55, after=60)[55:] == [5, 6, 7, 8, 9]


def test_a_boolean_that_drops_out_is_false_and_a_command_stays() -> None:
    assert passed(BooleanFault, [1.0] * 8, kind=Kind.DROPOUTS, value=1) == [1, 1, 1, 0, 0, 0, 0, 1]
    assert passed(IntegerFault, [1, 1, 4, 4, 2, 2, 1, 1], kind=Kind.DROPOUTS, value=1) == [
        1, 1, 4, 4, 4, 4, 4, 1
    ]  # fmt: skip


def test_noise_is_normal_and_drop_outs_have_their_share() -> None:
    # given 4000 ticks of 5
    signal, always = [5.0] * 4000, {"first": 0, "after": 4000}
    # when
    noise = np.array(passed(RealFault, signal, kind=Kind.NOISE, value=2, **always)) - 5
    ramp = [float(k) for k in range(4000)]
    lost = np.array(passed(RealFault, ramp, kind=Kind.DROPOUTS, value=0.3, **always)) != ramp
    # then, within four standard errors
    assert abs(noise.mean()) < 4 * 2 / math.sqrt(4000)
    assert abs(noise.std() - 2) < 4 * 2 / math.sqrt(8000)
    assert abs(lost.mean() - 0.3) < 4 * math.sqrt(0.3 * 0.7 / 4000)


def draws(**parameters: float) -> list[float]:
    return passed(RealFault, [0.0] * 5, kind=Kind.NOISE, value=1, first=0, after=5, **parameters)


def test_two_faults_of_a_trial_draw_differently_and_the_same_one_alike() -> None:
    assert draws(seed=7, number=1) == draws(seed=7, number=1)
    assert not set(draws(seed=7, number=1)) & set(draws(seed=7, number=2))
    assert not set(draws(seed=7, number=1)) & set(draws(seed=8, number=1))


def test_the_same_number_in_c_draws_the_same(native: Callable[..., Any]) -> None:
    parameters = {"kind": Kind.NOISE, "value": 1, "first": 0, "after": 5, "seed": 7, "number": 63}
    c = native(RealFault, "double", parameters).run(signal=np.zeros(5))
    assert c["disturbed"].tolist() == draws(seed=7, number=63)


LINKS = (Link("a", "x", "b", "u"), Link("a", "x", "c", "u"), Link("a", "y", "b", "v"))


def test_a_fault_of_an_output_stands_in_all_its_links() -> None:
    links, placed = disturb(LINKS, [FaultyLink(Type.REAL, "a", "x")])
    assert placed == {"fault_1": Placed(0, Type.REAL)}
    assert set(map(str, links)) == {
        "a.x -> fault_1.signal", "fault_1.disturbed -> b.u", "fault_1.disturbed -> c.u", "a.y -> b.v"
    }  # fmt: skip


def test_a_later_fault_acts_on_what_the_earlier_one_gives() -> None:
    faults = [FaultyLink(Type.REAL, "a", "x"), FaultyLink(Type.REAL, "a", "x", "c", "u")]
    links, _ = disturb(LINKS, faults)
    assert set(map(str, links)) == {
        "a.x -> fault_1.signal", "fault_1.disturbed -> b.u",
        "fault_1.disturbed -> fault_2.signal", "fault_2.disturbed -> c.u", "a.y -> b.v",
    }  # fmt: skip


def test_an_output_whose_links_have_parted_gets_a_block_for_each_with_the_same_draws() -> None:
    faults = [FaultyLink(Type.REAL, "a", "x", "c", "u"), FaultyLink(Type.REAL, "a", "x")]
    links, placed = disturb(LINKS, faults)
    assert placed == {
        name: Placed(n, Type.REAL) for name, n in (("fault_1", 0), ("fault_2", 1), ("fault_3", 1))
    }
    assert "fault_1.disturbed -> fault_3.signal" in map(str, links)


def test_a_system_with_faults_is_wired_whatever_the_unit_but_not_whatever_the_type() -> None:
    system = SYSTEMS["full"]
    faults = [
        FaultyLink(Type.REAL, "sensors", "pitch_meas"),
        FaultyLink(Type.INTEGER, "controller", "command"),
    ]
    disturbed = system.with_faults(faults)
    assert disturbed.components["fault_1"] is RealFault
    assert disturbed.components["fault_2"] is IntegerFault
    order = disturbed.order()
    assert order.index("sensors") < order.index("fault_1") < order.index("estimator")
    assert order.index("controller") < order.index("fault_2") < order.index("plant")
    assert system.with_faults([]) is system
    with pytest.raises(WiringError, match='type "Real", expected "Boolean"'):
        system.with_faults([FaultyLink(Type.REAL, "sensors", "gps_fix")])


def test_blocks_beside_faults_keep_their_units_apart() -> None:
    links = (Link("plant", "speed", "controller", "heading"),)
    with pytest.raises(WiringError, match='unit "m/s", expected "rad"'):
        System("wrong", {n: SYSTEMS["cts"].components[n] for n in ("controller", "plant")}, links)
