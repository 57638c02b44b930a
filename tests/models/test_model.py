"""The reference in Python: parameters, ticks, triggers, tables, and the same block as a `control` system."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

import casadi as ca
import numpy as np
import pytest

from models.canine import Canine
from models.errors import DeclarationError, ParameterError
from models.four_state import FourState
from models.interconnect import control_system
from models.kit.block import Block, Row, table, triggered
from models.kit.declaration import Boolean, Input, Integer, Output, Parameter, State, Stream
from models.kit.model import Model
from models.kit.random import start_state
from models.sensors import Sensors


class Color(IntEnum):
    """Of a traffic light."""

    RED = 0
    GREEN = 1
    AMBER = 2


class Light(Block):
    """Counts, has a triggered update and a table."""

    go = Input(Boolean, "go")
    gain = Parameter("1", "gain", start=2, min=0, max=10)
    offsets = Parameter("m", "offsets", start=(1, 2), size=2)
    seed = Parameter(Integer, "seed", start=5, min=0, max=100)
    ticks = State(Integer, "ticks")
    going = State(Integer, "ticks with go")
    color = State(Color, "color", start=0)
    log = State(Integer, "which row was carried out")
    stream = Stream("unused", substream=7)
    seen = Output(Integer, "ticks with go")
    sum = Output("m", "sum")

    def initialize(m) -> None:
        m.going = 100 * m.gain

    def count(m) -> None:
        m.ticks = m.ticks + 1

    @triggered("go")
    def note(m) -> None:
        m.going = m.going + 1

    @table("color")
    def change(m) -> list[Row]:
        return [
            Row(Color.RED, m.ticks >= 3, Color.GREEN, {"log": m.ticks}),
            Row(Color.RED, m.ticks >= 2, Color.AMBER, {"log": 10 * m.ticks}),
            Row(Color.AMBER, m.go, Color.AMBER, {"log": -1}),
            Row(Color.AMBER, m.ticks > 5, Color.RED, {"log": m.log + 1000}),
        ]

    def output(m) -> None:
        m.seen = m.going
        m.sum = m.gain * (m.offsets[0] + 10 * m.offsets[1])


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"gian": 1}, 'light has no parameter "gian"; did you mean "gain"?'),
        ({"zzz": 1}, 'light has no parameter "zzz"; known: gain, offsets[1], offsets[2], seed'),
        ({"offsets": 1}, 'light has no parameter "offsets"; did you mean "offsets['),
        ({"go": 1}, 'light has no parameter "go"'),
        ({"gain": 11}, "light.gain is 11; expected a number from 0 up to 10"),
        ({"gain": math.nan}, "light.gain is nan; expected a finite number"),
        ({"offsets[2]": math.inf}, "light.offsets[2] is inf; expected a finite number"),
        ({"seed": 1.5}, "light.seed is 1.5; expected a whole number from 0 up to 100"),
    ],
)
def test_a_wrong_parameter_is_named(parameters: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError) as error:
        Model(Light, parameters)
    assert message in str(error.value)


def test_parameters_arrive_and_others_start_as_declared() -> None:
    light = Model(Light, {"offsets[2]": 0.5})
    light.initialize()
    light.step()
    assert light.parameter.tolist() == [2, 1, 0.5, 5]
    assert light["sum"] == 2 * (1 + 5)


def test_initialize_starts_states_streams_and_then_the_block() -> None:
    light = Model(Light, {"gain": 3})
    light.initialize()
    light["go"] = 1
    light.step()
    assert light["going"] == 301
    light.initialize()
    assert (light["going"], light["ticks"]) == (300, 0)
    assert [light[f"stream[{i}]"] for i in range(1, 7)] == list(start_state(5, 7))


def test_a_triggered_update_runs_on_its_ticks_only() -> None:
    light = Model(Light)
    light.initialize()
    seen = []
    for go in (0, 1, 1, 0, 1, 0):
        light["go"] = go
        light.step()
        seen.append(light["seen"])
    assert seen == [200, 201, 202, 202, 203, 203]


def test_in_a_table_the_first_match_of_the_mode_wins_and_no_match_stays() -> None:
    light = Model(Light)
    light.initialize()
    history = []
    for go in (0, 0, 0, 1, 1, 1, 0, 0):
        light["go"] = go
        light.step()
        history.append((Color(int(light["color"])).name, light["log"]))
    assert history == [
        ("RED", 0),  # tick 1: no row
        ("AMBER", 20),  # tick 2: the second row of RED
        ("AMBER", 20),  # no row; rows of RED do not count any more
        ("AMBER", -1),
        ("AMBER", -1),
        ("AMBER", -1),  # tick 6: both rows of AMBER hold
        ("RED", 999),
        ("GREEN", 8),  # both rows of RED hold
    ]


def test_replace_gives_the_functions_that_are_called() -> None:
    """Given a replacement that doubles every result of `output`, when it runs, then outputs are doubled."""
    names = []

    def replace(function: Any) -> Any:
        names.append(function.name())
        if function.name() != "light_output":
            return function
        arguments = [ca.SX.sym(f"a{i}", function.size1_in(i)) for i in range(4)]
        return ca.Function("doubled", arguments, [2 * function(*arguments)])

    light = Model(Light, replace=replace)
    light.initialize()
    light.step()
    assert light["sum"] == 2 * 2 * 21
    assert sorted(names) == sorted(f.name() for f in Light.program().functions)


def test_two_models_of_a_block_share_nothing() -> None:
    first, second = Model(Light, {"gain": 1}), Model(Light, {"gain": 4})
    first.initialize()
    second.initialize()
    first.step()
    assert (first["ticks"], second["ticks"], second["gain"]) == (1, 0, 4)


INPUTS: dict[type[Block], dict[str, float]] = {
    FourState: {
        "accel_x": 0.3, "pitch_meas": 0.1, "heading_meas": 1.0, "gps_north": 2.0, "gps_east": -1.0,
        "gps_speed": 0.5, "gps_h_acc": 3.5, "gps_s_acc": 0.1,
    },
    Sensors: {"north": 3.0, "east": 4.0, "speed": 1.0, "heading": 0.4, "pitch": -0.1},
    Canine: {"command": 1},
}  # fmt: skip


@pytest.mark.parametrize("block", INPUTS)
def test_a_control_system_is_the_model_step_by_step(block: type[Block]) -> None:
    """A plant's output is of the state; every other block's, the answer to the same tick's input."""
    parameters = {"seed": 4.0} if "seed" in block.flat_names("parameter") else {}
    model = Model(block, parameters)
    model.initialize()
    system = control_system(block, "it", parameters)
    x = system.initial_state
    assert np.array_equal(x, model.state)
    assert (system.dt, system.name) == (block.sample_time, "it")
    assert system.input_labels == block.flat_names("input")
    assert system.output_labels == block.flat_names("output")
    assert system.state_labels == block.flat_names("state")
    rng = np.random.default_rng(1)
    u = np.array([INPUTS[block].get(name, 0.0) for name in block.flat_names("input")])
    for k in range(60):
        if block is FourState:
            u[0] = rng.normal()
            u[block.flat_names("input").index("gps_fix")] = k % 6 == 0
        t = k * block.sample_time
        if block.moore:
            assert np.array_equal(system.output(t, x, u), model.output)
        model.input[:] = u
        model.step()
        if not block.moore:
            assert np.array_equal(system.output(t, x, u), model.output)
        x = system.dynamics(t, x, u)
        assert np.array_equal(x, model.state)
    assert model.output.any()
    if block.moore:  # of the state that is asked for, not of the last one
        model.initialize()
        assert np.array_equal(system.output(0.0, system.initial_state, u), model.output)


def test_a_plant_is_observed_without_a_step() -> None:
    # given a dog that is put elsewhere
    plant = Model(Canine)
    plant.initialize()
    before = plant.state.copy()
    plant["position_north"] = before[Canine.flat_names("state").index("position_north")] + 3.0
    # when it is observed, then its outputs are of the states as they are, and time stands still
    plant.observe()
    assert plant["north"] == plant["position_north"]
    assert np.count_nonzero(plant.state != before) == 1
    # but what answers to its inputs cannot be
    with pytest.raises(DeclarationError, match="four_state is not a moore block: its outputs need a step"):
        Model(FourState).observe()
