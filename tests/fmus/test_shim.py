"""What an FMU does: the reference's numbers bit by bit, its states, and what it refuses."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest

from fmus.build import build_fmu
from fmus.folder import FmiVersion
from models.disturbance import Kind, RealFault
from models.kit.block import Block
from models.kit.declaration import Parameter
from models.kit.model import Model
from tests.fmus.instance import Instance, Refused, bits, run, run_model, stimulus, watched
from tests.fmus.pulse import Pulse, Scale, Slide

Unpacked = Callable[[type[Block]], Path]
TICKS = 200


def parameters_of(block: type[Block]) -> dict[str, float]:
    return {"seed": 7.0} if "seed" in block.variables(Parameter) else {}


def test_every_tick_has_the_bits_of_the_reference(block: type[Block], unpacked: Unpacked) -> None:
    rows = stimulus(block, TICKS)
    expected = run_model(block, parameters_of(block), rows)
    with Instance(unpacked(block)) as unit:
        got = run(unit.start(parameters_of(block)), block, rows)
    assert got == expected


def test_a_saved_state_continues_with_the_same_bits(block: type[Block], unpacked: Unpacked) -> None:
    # given an FMU in mid-run whose state was saved, also in bytes
    rows = stimulus(block, 2 * TICKS)
    with Instance(unpacked(block)) as unit, Instance(unpacked(block)) as other:
        run(unit.start(parameters_of(block)), block, rows[:TICKS])
        state = unit.state()
        saved = unit.to_bytes(state)
        expected = run(unit, block, rows[TICKS:], first=TICKS)
        # when it goes back, and when another instance that was never started takes it
        unit.restore(state)
        other.restore(other.from_bytes(saved))
        # then both continue alike, time included
        assert run(unit, block, rows[TICKS:], first=TICKS) == expected
        assert run(other, block, rows[TICKS:], first=TICKS) == expected
        unit.free(state)


def test_reset_equals_a_fresh_instance(block: type[Block], unpacked: Unpacked) -> None:
    rows = stimulus(block, 50)
    with Instance(unpacked(block)) as unit:
        run(unit.start(parameters_of(block)), block, stimulus(block, 50, seed=8))
        unit.slave.reset()
        again = run(unit.start(), block, rows)  # the seed is back at its start, too
    with Instance(unpacked(block)) as fresh:
        assert run(fresh.start(), block, rows) == again


def test_instances_are_independent(unpacked: Unpacked) -> None:
    rows = stimulus(Pulse, TICKS)
    with Instance(unpacked(Pulse)) as one, Instance(unpacked(Pulse)) as two:
        one.start({"seed": 1})
        two.start({"seed": 2})
        interleaved: list[list[str]] = []
        for tick, row in enumerate(rows):
            interleaved += run(one, Pulse, [row], first=tick)
            run(two, Pulse, [row], first=tick)
        assert interleaved == run_model(Pulse, {"seed": 1}, rows)
        assert interleaved != run_model(Pulse, {"seed": 2}, rows)


def test_simulate_fmu_gives_the_reference(tmp_path: Path, version: FmiVersion) -> None:
    # given fmpy's own master, which holds discrete inputs between rows
    path = build_fmu(Pulse, tmp_path, version)
    time = np.arange(100) * 0.04
    push = np.sin(time)
    signal = np.array(list(zip(time, push, strict=True)), dtype=[("time", float), ("push", float)])
    # when it simulates
    result = fmpy.simulate_fmu(
        str(path), stop_time=100 * 0.04, step_size=0.04, input=signal, output=["place"]
    )
    # then row n+1 holds the answer to the input of row n
    model = Model(Pulse)
    model.initialize()
    expected = []
    for value in push:
        model["push"] = value
        model.step()
        expected.append(model["place"])
    assert bits(result["place"][1:101]) == bits(expected)


@pytest.mark.parametrize("ticks", [2, 3, 7, 64])
def test_a_step_of_several_ticks_is_as_many_steps_with_held_inputs(
    block: type[Block], unpacked: Unpacked, ticks: int
) -> None:
    # given inputs that change every few ticks, and the reference that makes each tick by itself
    held = stimulus(block, 192 // ticks)
    made = 1 if block.transparent else ticks  # in a step
    reference = run_model(block, parameters_of(block), [row for row in held for _ in range(made)])
    first = 1 if block.moore else 0
    with Instance(unpacked(block)) as unit:
        # when one step of the FMU spans them
        unit.start(parameters_of(block))
        for number, row in enumerate(held):
            for name, value in row.items():
                unit[name] = value
            unit.step(number * ticks, ticks * 0.04)
            # then outputs and states are those after the last of them, and the time is there too
            assert bits(unit.values(watched(block))) == reference[first + (number + 1) * made - 1]
            if unit.version == 3:
                point, size = number * ticks * 0.04, ticks * 0.04
                assert unit["time"] == (point + size if block.transparent else (number + 1) * ticks * 0.04)


def test_simulate_fmu_over_a_minute_doubles_its_interval(tmp_path: Path, version: FmiVersion) -> None:
    # given fmpy's own master, which never makes more than a thousand steps
    path = build_fmu(Pulse, tmp_path, version)
    # when it simulates 1500 ticks by steps of two
    result = fmpy.simulate_fmu(
        str(path), stop_time=60.0, start_values={"push": 0.3, "kick": True}, output=["place"]
    )
    # then each row has the bits of the ticks up to it
    model = Model(Pulse)
    model.initialize()
    model["push"], model["kick"] = 0.3, True
    single = []
    for _ in range(1500):
        model.step()
        single.append(model["place"])
    assert list(result["time"][:3]) == [0.0, 0.08, 0.16]
    assert len(result) == 751
    assert bits(result["place"][1:]) == bits(single[1::2])


def test_a_plant_shows_its_initial_outputs_while_parameters_still_change(unpacked: Unpacked) -> None:
    with Instance(unpacked(Slide)) as unit:
        unit["begin"] = 3.0
        unit.enter()
        assert unit["place"] == 3.0
        unit["begin"] = 4.0
        assert unit["place"] == 4.0
        unit.slave.exitInitializationMode()
        unit["push"] = 1.0
        unit.step(0)
        assert unit["place"] == 4.0 + 0.04


def test_time_is_a_multiple_of_the_sample_time_never_a_sum(unpacked: Unpacked) -> None:
    # given a master that adds up steps (after 3000 of them the sum is off by 1e-12)
    with Instance(unpacked(Pulse)) as unit:
        unit.start()
        time = 0.0
        for _ in range(3000):
            unit.slave.doStep(time, 0.04)
            time += 0.04
        assert time != 120.0
        if unit.version == 3:
            assert unit["time"] == 120.0
        unit.slave.doStep(120.0, 0.04)


def test_a_trial_may_start_at_another_time(unpacked: Unpacked) -> None:
    with Instance(unpacked(Slide)) as unit:
        unit.start(time=8.0)
        unit["push"] = 1.0
        unit.slave.doStep(8.0, 0.04)
        assert unit["place"] == 0.04


def test_a_step_of_nothing_does_nothing(unpacked: Unpacked) -> None:
    with Instance(unpacked(Slide)) as unit:
        unit.start()
        unit["push"] = 1.0
        unit.slave.doStep(0.0, 4e-8)
        assert unit["place"] == 0.0
        unit.slave.doStep(0.0, 0.04)
        assert unit["place"] == 0.04


def test_a_transparent_block_takes_one_tick_in_a_step_of_any_length(unpacked: Unpacked) -> None:
    with Instance(unpacked(RealFault)) as unit:
        unit.start({"kind": Kind.STUCK, "first": 1, "after": 3})
        arrived = []
        for number, (point, size) in enumerate([(0.0, 0.001), (0.001, 0.5), (0.501, 0.25), (0.751, 0.04)]):
            unit["signal"] = number
            unit.slave.doStep(point, size)
            arrived.append(unit["disturbed"])
        assert arrived == [0, 0, 0, 3]
        for size in (-0.04, math.nan, math.inf):
            with pytest.raises(Refused):
                unit.slave.doStep(0.791, size)


@pytest.mark.parametrize(
    ("point", "size", "text"),
    [
        (0.08, 0.05, "communication step size: expected a multiple of 0.04, got 0.05"),
        (0.08, 0.02, "communication step size: expected a multiple of 0.04, got 0.02"),
        (0.08, 0.4 + 8e-8, "communication step size: expected a multiple of 0.04, got 0.40000008"),
        (0.08, -0.04, "communication step size: expected a multiple of 0.04, got -0.04"),
        (0.08, math.nan, "communication step size: expected a multiple of 0.04, got nan"),
        (0.08, math.inf, "communication step size: expected a multiple of 0.04, got inf"),
        (0.08, 1e300, "communication step size: expected a multiple of 0.04, got 1e+300"),
        (0.12, 0.04, "communication point: expected 0.08, got 0.12"),
        (0.04, 0.04, "communication point: expected 0.08, got 0.04"),
        (math.nan, 0.04, "communication point: expected 0.08, got nan"),
    ],
)
def test_a_wrong_step_is_refused_with_both_numbers(
    point: float, size: float, text: str, unpacked: Unpacked
) -> None:
    # given an FMU at t = 0.08
    with Instance(unpacked(Slide)) as unit:
        unit.start()
        unit["push"] = 1.0
        unit.step(0)
        unit.step(1)
        before = unit["place"]
        # when a step does not fit
        with pytest.raises(Refused):
            unit.slave.doStep(point, size)
        # then it is refused with both numbers, nothing has moved, and the right step still works
        assert unit.messages == [f"fmi{unit.version}DoStep: {text}"]
        assert unit["place"] == before
        unit.step(2)


def test_a_step_beyond_the_stop_time_is_refused(unpacked: Unpacked) -> None:
    with Instance(unpacked(Slide)) as unit:
        if unit.version == 2:
            unit.slave.setupExperiment(startTime=0.0, stopTime=0.04)
            unit.slave.enterInitializationMode()
        else:
            unit.slave.enterInitializationMode(startTime=0.0, stopTime=0.04)
        unit.slave.exitInitializationMode()
        unit.step(0)
        with pytest.raises(Refused):
            unit.step(1)
        assert unit.messages[-1].endswith(
            "communication step to 0.08; expected none beyond the stop time 0.04"
        )


def refusal(unit: Instance, what: str, kind: str, reference: int, *values: float) -> str:
    with pytest.raises(Refused):
        unit.call(what, kind)([reference], *([list(values)] if values else []))
    return unit.messages[-1]


def test_unknown_references_and_wrong_types_are_refused_by_name(unpacked: Unpacked) -> None:
    with Instance(unpacked(Pulse)) as unit:
        real, integer = {2: ("Real", "Integer"), 3: ("Float64", "Int32")}[unit.version]
        last = max(v.valueReference for v in unit.variables.values())
        place, seed = (unit.variables[n].valueReference for n in ("place", "seed"))
        fmi = f"fmi{unit.version}"
        assert refusal(unit, "get", real, 999) == (
            f"{fmi}Get{real}: value reference 999 is unknown; pulse has 0 to {last}"
        )
        assert refusal(unit, "get", integer, place) == (
            f"{fmi}Get{integer}: value reference {place} (place) is a Real, not an Integer"
        )
        assert refusal(unit, "set", "Boolean", seed, 1) == (
            f"{fmi}SetBoolean: value reference {seed} (seed) is an Integer, not a Boolean"
        )


def test_what_may_not_be_set_is_refused_by_name(unpacked: Unpacked) -> None:
    with Instance(unpacked(Pulse)) as unit:
        real = {2: "Real", 3: "Float64"}[unit.version]
        place, position, gain = (unit.variables[n].valueReference for n in ("place", "position", "gain"))
        head = f"fmi{unit.version}Set{real}: value reference"
        assert refusal(unit, "set", real, place, 1.0) == (
            f"{head} {place} (place) is an output, which only pulse itself sets"
        )
        assert refusal(unit, "set", real, position, 1.0) == (
            f"{head} {position} (position) is a state, which only pulse itself sets"
        )
        assert refusal(unit, "set", real, gain, 11.0) == f"{head} {gain} (gain): got 11, expected 0 to 10"
        assert (
            refusal(unit, "set", real, gain, math.nan) == f"{head} {gain} (gain): got nan, expected 0 to 10"
        )
        unit.start()
        assert refusal(unit, "set", real, gain, 1.0) == (
            f"{head} {gain} (gain) is a fixed parameter; "
            "expected it to be set before the end of initialization"
        )
        unit["offset[2]"] = 8.0  # tunable: the block says when it reads it
        unit.step(0)
        assert unit["place"] == 8.0


def test_functions_out_of_turn_are_refused(unpacked: Unpacked) -> None:
    with Instance(unpacked(Slide)) as unit:
        with pytest.raises(Refused):
            unit.step(0)
        assert unit.messages[-1] == (
            f'fmi{unit.version}DoStep: slide is in mode "instantiated", which does not allow it'
        )
        unit.start()
        unit.slave.terminate()
        with pytest.raises(Refused):
            unit.step(0)
        assert '"terminated"' in unit.messages[-1]
        assert unit["place"] == 0.0  # results can still be read


def test_the_state_of_another_block_is_refused(unpacked: Unpacked) -> None:
    with Instance(unpacked(Slide)) as slide, Instance(unpacked(Pulse)) as pulse:
        foreign = pulse.to_bytes(pulse.start().state())
        own = slide.to_bytes(slide.start().state())
        with pytest.raises(Refused):
            slide.from_bytes(foreign)
        assert f"got {len(foreign)} bytes, a state of slide has {len(own)}" in slide.messages[-1]
        with pytest.raises(Refused):
            slide.from_bytes(b"x" + own[1:])
        assert "got the state of another unit, expected one of slide {" in slide.messages[-1]


def test_a_wrong_token_is_refused_with_both(unpacked: Unpacked) -> None:
    with Instance(unpacked(Slide)) as unit:
        unit.slave.guid = "100 %s"
        with pytest.raises(Exception, match="instantiate"):
            unit.slave.instantiate(**unit._logger())
        assert re.search(
            r'slide expected the token "\{[0-9a-f-]{36}\}" of its own model description, got "100 %s"$',
            unit.messages[-1],
        )
        unit.slave.guid = unit.description.guid
        unit.slave.instantiate()


def test_what_is_not_supported_says_so(unpacked: Unpacked) -> None:
    with Instance(unpacked(Slide)) as unit:
        unit.start()
        lacking = unit.slave.getString if unit.version == 2 else unit.slave.getInt8
        with pytest.raises(Refused):
            lacking([0])
        name = {2: "fmi2GetString", 3: "fmi3GetInt8"}[unit.version]
        assert unit.messages[-1] == (
            f"{name}: slide does not support it; see the capabilities in its model description"
        )


def test_single_precision_computes_in_floats(tmp_path: Path, version: FmiVersion) -> None:
    # given a block in single precision
    path = build_fmu(Scale, tmp_path, version, precision="float")
    assert path.name == "scale_float.fmu"
    folder = tmp_path / "unpacked"
    fmpy.extract(str(path), str(folder))
    with Instance(folder) as unit:
        unit.start({"factor": 0.1})
        unit["value"] = 0.3
        # when it steps
        unit.step(0)
        # then the product of the floats came out; what is too large for a float is infinite on board
        assert unit["scaled"] == float(np.float32(0.1) * np.float32(0.3)) != 0.1 * 0.3
        unit["value"] = 1e300
        unit.step(1)
        assert unit["scaled"] == math.inf
