"""A block or a system over arrays: the bits of the models in Python; any wired system; errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from codegen.batch.series import Series
from models.canine import Canine
from models.errors import CanineError, DeclarationError, ParameterError, WiringError
from models.four_state import FourState
from models.kit.block import Block
from models.kit.declaration import Input, Integer, Output, Parameter, State
from models.kit.link import Link
from models.kit.model import Model
from models.sensors import Sensors
from models.system import SYSTEMS, System
from tests.codegen.compiled import QUICKEST, CompiledModel, Library

TICKS = 600
MISSION = {
    "controller": {"waypoint_count": 1.0, "waypoint_north[1]": 30.0},
    "plant": {"seed": 3.0},
    "sensors": {"seed": 3.0, "outage_start[1]": 8.0, "outage_end[1]": 12.0},
}


class Count(Block):
    """Counts up from a start and gives the sum with its input."""

    step_by = Parameter("1", "step", start=1)
    term = Input("1", "what is added")
    whole = Input(Integer, "whole number", start=7, min=0, max=100)
    total = Output("1", "sum")
    count = State("1", "ticks so far", start=-1)

    def add(m) -> None:
        """Count."""
        m.count = m.count + m.step_by
        m.total = m.count + m.term + m.whole


class Started(Count):
    """A count that needs no source."""

    term = Input("1", "what is added", start=0)


def walk(ticks: int = TICKS) -> dict[str, Any]:
    """Inputs of the estimator: a walk with a fix each quarter of a second, a bad sample, an outage."""
    rng = np.random.default_rng(1)
    tick = np.arange(ticks)
    fix = np.floor(tick * 0.16) != np.floor((tick - 1) * 0.16)
    accel = rng.normal(0, 2, ticks)
    accel[50] = np.nan
    return {
        "accel_x": accel,
        "pitch_meas": rng.normal(0, 0.1, ticks),
        "heading_meas": 0.01 * tick,
        "gps_fix": fix & ((tick < 200) | (tick > 400)),
        "gps_north": 0.06 * tick + rng.normal(0, 0.3, ticks),
        "gps_east": rng.normal(0, 0.3, ticks),
        "gps_speed": np.abs(rng.normal(1.5, 1.5, ticks)),
        "gps_h_acc": 3.5,
        "gps_s_acc": 0.1,
    }


def by_component(signals: Mapping[str, Any], component: str) -> dict[str, Any]:
    return {f"{component}.{name}": values for name, values in signals.items()}


def stepped(model: Model | CompiledModel, signals: Mapping[str, Any], names: list[str]) -> Any:
    """(names, ticks) from a model that is stepped in Python."""
    rows = []
    for k in range(TICKS):
        for name, values in signals.items():
            model[name] = values if np.ndim(values) == 0 else values[k]
        model.step()
        rows.append([model[name] for name in names])
    return np.transpose(rows)


def states_and_outputs(block: type[Block]) -> list[str]:
    return [*block.flat_names("state"), *block.flat_names("output")]


def test_a_block_alone_has_the_bits_of_its_model() -> None:
    names = states_and_outputs(FourState)
    parameters = {"sigma_bias": 0.01, "gate": 50.0}
    series = Series(FourState, [f"four_state.{name}" for name in names])
    rows = series.run(by_component(walk(), "four_state"), {"four_state": parameters})
    model = Model(FourState, parameters)
    model.initialize()
    expected = stepped(model, walk(), names)
    assert rows["four_state.bad_samples"][-1] == 1
    assert np.array_equal(expected[names.index("speed")], rows["four_state.speed"])
    for name, want in zip(names, expected, strict=True):
        assert rows[f"four_state.{name}"].tobytes() == want.tobytes(), name


def test_a_block_in_float_has_the_bits_of_its_c(libraries: Callable[..., Library]) -> None:
    names = states_and_outputs(FourState)
    rows = Series(FourState, [f"four_state.{name}" for name in names], "float").run(
        by_component(walk(), "four_state")
    )
    model = CompiledModel(libraries(QUICKEST, "float"), FourState)
    model.initialize()
    for name, want in zip(names, stepped(model, walk(), names), strict=True):
        assert rows[f"four_state.{name}"].tobytes() == want.tobytes(), name


def test_a_system_has_the_bits_of_its_blocks_stepped_in_python() -> None:
    system = SYSTEMS["full"]
    observe = [f"{c}.{name}" for c, block in system.components.items() for name in states_and_outputs(block)]
    rows = Series(system, observe).run({"controller.start": 1}, MISSION, TICKS)
    models = {c: Model(block, MISSION.get(c)) for c, block in system.components.items()}
    for model in models.values():
        model.initialize()
    models["controller"]["start"] = 1

    def step(component: str) -> None:
        for link in system.links:
            if link.target == component:
                models[component][link.target_variable] = models[link.source][link.source_variable]
        models[component].step()

    for k in range(TICKS):
        for component in ("sensors", "estimator", "controller", "command_module"):
            step(component)
        for name in observe:
            component, _, variable = name.partition(".")
            got, want = rows[name][k], models[component][variable]
            assert got == want or (np.isnan(got) and np.isnan(want)), (name, k)
        step("plant")
    assert rows["plant.north"].max() > 20
    assert rows["sensors.gps_fix"].sum() == 80  # 24 s at 4 Hz, 4 s of them without


def test_runs_in_threads_are_those_of_one_after_another() -> None:
    series = Series(System("dog", {"plant": Canine}, ()), ["plant.speed", "plant.heading", "plant.jerk"])

    def run(seed: int) -> bytes:
        rows = series.run({"plant.command": 1}, {"plant": {"seed": seed}}, TICKS)
        return b"".join(row.tobytes() for row in rows.values())

    alone = [run(seed) for seed in range(8)]
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(run, range(8))) == alone
    assert len(set(alone)) == 8


def test_blocks_of_other_modules_run_too_and_two_of_them_stay_apart() -> None:
    links = (Link("first", "total", "second", "term"),)
    series = Series(
        System("counts", {"second": Started, "first": Started}, links),
        ["second.total", "first.count"],
    )
    rows = series.run({"first.term": [1.0, 2.0, 4.0], "second.whole": 0}, {"first": {"step_by": 10}})
    # first: count 9, 19, 29, with the term and 7: 17, 28, 40; second: count 0, 1, 2
    assert rows["first.count"].tolist() == [9, 19, 29]
    assert rows["second.total"].tolist() == [17, 29, 42]


def test_a_plants_row_is_from_before_its_step() -> None:
    rows = Series(Canine, ["canine.north", "canine.velocity"]).run(
        {"canine.command": [1, 1, 1]}, {"canine": {"start_north": 5.0, "shaking": 0}}
    )
    # 1.78 m/s2 from rest, in ticks of 0.04 s
    assert rows["canine.velocity"] == pytest.approx([0, 0.0712, 0.1424])
    assert rows["canine.north"] == pytest.approx([5, 5.001424, 5.005696])


@pytest.mark.parametrize(
    ("signals", "parameters", "message"),
    [
        ({"count.total": 1}, {}, 'count count has no input "total"'),
        ({"counts.term": 1}, {}, 'count: no component "counts"; did you mean "count"?'),
        ({}, {}, 'count: input "count.term" has neither source, signal nor start value'),
        ({"count.term": [1, 2], "count.whole": [1, 2, 3]}, {}, "count.term has shape (2,); expected (3,)"),
        ({"count.term": [[1.0]]}, {}, "count.term has shape (1, 1); expected (1,), a value per tick"),
        ({"count.term": 1, "count.whole": [1, 2.5]}, {}, "expected a whole number from 0 up to 100"),
        ({"count.term": 1, "count.whole": [1, np.nan]}, {}, "count.whole has values that are not whole"),
        ({"count.term": 1}, {"count": {"step_buy": 1}}, 'no parameter "step_buy"; did you mean "step_by"?'),
        ({"count.term": 1}, {}, "count: no signal has a value per tick; expected one, or `ticks`"),
        ({"count.term": 1}, {"count": {"step_by": np.inf}}, "count.step_by is inf; expected a finite number"),
    ],
)
def test_wrong_signals_and_parameters_are_refused(
    signals: dict[str, Any], parameters: dict[str, dict[str, float]], message: str
) -> None:
    with pytest.raises(CanineError) as error:
        Series(Count).run(signals, parameters)
    assert message in str(error.value)


def test_a_signal_for_a_connected_input_is_refused() -> None:
    with pytest.raises(ParameterError, match=r'full: input "estimator.accel_x" is connected'):
        Series(SYSTEMS["full"]).run({"estimator.accel_x": 1.0})


def test_unknown_variables_to_observe_are_refused() -> None:
    with pytest.raises(ParameterError, match='plant canine has no state or output "norht"'):
        Series(SYSTEMS["full"], ["plant.norht"])
    with pytest.raises(WiringError, match='no component "dog"'):
        Series(SYSTEMS["full"], ["dog.north"])


def test_a_precision_in_which_a_block_does_not_come_is_refused() -> None:
    with pytest.raises(DeclarationError, match="sensors comes in double precision, not in float"):
        Series(Sensors, precision="float").run(dict.fromkeys(by_component(dict.fromkeys(
            ("north", "east", "speed", "heading")), "sensors"), 0.0), ticks=1)  # fmt: skip
