"""The links of systems: which are refused in which words, the order of a tick, systems in `control`."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any

import control
import numpy as np
import pytest

from models.cmec import Cmec
from models.commands import Command
from models.errors import WiringError
from models.interconnect import interconnect
from models.kit.block import Block
from models.kit.declaration import Boolean, Input, Integer, Output, Parameter
from models.kit.link import Link
from models.kit.model import Model
from models.kit.timing import TICK
from models.pedestrian import Pedestrian
from models.plant import Plant
from models.system import SYSTEMS, System, full_system, trial_simulator

MISSION = {
    "waypoint_count": 2, "waypoint_north[1]": 20.0, "waypoint_north[2]": 20.0, "waypoint_east[2]": 20.0,
}  # fmt: skip


class Colour(IntEnum):
    """Named values other than the commands."""

    RED = 0


class Source(Block):
    """Gives one of each."""

    seconds = Input("s", "time", start=0)
    length = Output("m", "a length")
    speed = Output("m/s", "a speed")
    count = Output(Integer, "a count")
    flag = Output(Boolean, "a flag")
    colour = Output(Colour, "a colour")
    pair = Output("m", "two lengths", size=2)

    def answer(m) -> None:
        """Set them."""
        m.length, m.speed, m.count, m.flag, m.colour, m.pair = m.seconds, 0, 0, 0, 0, 0


class Sink(Block):
    """Takes a length, and needs it."""

    length = Input("m", "a length")
    flag = Input(Boolean, "a flag", start=0)
    command = Input(Command, "a command", start=0)
    later = Output("s", "time")
    gain = Parameter("1", "unused", start=1)

    def answer(m) -> None:
        """Set it."""
        m.later = m.length


LENGTH = Link("source", "length", "sink", "length")


def wire(*links: Link, **components: type[Block]) -> System:
    return System("test", components or {"source": Source, "sink": Sink}, links)


@pytest.mark.parametrize(
    ("link", "message"),
    [
        (
            Link("source", "speed", "sink", "length"),
            'test: source.speed -> sink.length: unit "m/s", expected "m"',
        ),
        (
            Link("source", "count", "sink", "length"),
            'test: source.count -> sink.length: type "Integer", expected "Real"',
        ),
        (
            Link("source", "length", "sink", "flag"),
            'test: source.length -> sink.flag: type "Real", expected "Boolean"',
        ),
        (
            Link("source", "pair", "sink", "length"),
            'test: source.pair -> sink.length: "source.pair" has size "2", expected "1"; link its',
        ),
        (
            Link("sauce", "length", "sink", "length"),
            'test: sauce.length -> sink.length: no component "sauce"; did you mean "source"?',
        ),
        (
            Link("source", "length", "zzz", "length"),
            'test: source.length -> zzz.length: no component "zzz"; known: sink, source',
        ),
        (
            Link("source", "lenght", "sink", "length"),
            'test: source.lenght -> sink.length: "source" has no output "lenght"; did you mean "length"?',
        ),
        (
            Link("source", "length", "sink", "lenght"),
            'test: source.length -> sink.lenght: "sink" has no input "lenght"; did you mean "length"?',
        ),
        (
            Link("source", "seconds", "sink", "length"),  # an input cannot be a source
            'test: source.seconds -> sink.length: "source" has no output "seconds"',
        ),
        (
            Link("source", "length", "sink", "gain"),  # a parameter cannot be a target
            'test: source.length -> sink.gain: "sink" has no input "gain"',
        ),
    ],
    ids=lambda x: str(x) if isinstance(x, Link) else "",
)
def test_a_link_that_does_not_fit_is_refused(link: Link, message: str) -> None:
    with pytest.raises(WiringError) as refusal:
        wire(link)
    assert str(refusal.value).startswith(message)


def test_named_values_must_be_the_same() -> None:
    with pytest.raises(
        WiringError,
        match=r'^test: source\.colour -> sink\.command: named values ".*Colour.*", expected ".*Command',
    ):
        wire(LENGTH, Link("source", "colour", "sink", "command"))


def test_an_input_has_one_source() -> None:
    with pytest.raises(WiringError) as refusal:
        wire(LENGTH, Link("other", "length", "sink", "length"), source=Source, other=Source, sink=Sink)
    assert str(refusal.value) == (
        "test: other.length -> sink.length: the input has a source already, source.length -> sink.length"
    )


def test_an_input_needs_a_source_or_a_start_value() -> None:
    with pytest.raises(WiringError) as refusal:
        wire()
    assert str(refusal.value) == 'test: input "sink.length" has neither source nor start value'


def test_a_loop_needs_a_plant() -> None:
    back = Link("sink", "later", "source", "seconds")
    with pytest.raises(WiringError) as refusal:
        wire(LENGTH, back)
    assert str(refusal.value) in (
        "test: no plant delays the loop source -> sink -> source",
        "test: no plant delays the loop sink -> source -> sink",
    )


def test_a_loop_through_a_plant_is_accepted() -> None:
    # cts is one: the controller commands the plant, the plant feeds the controller
    system = SYSTEMS["cts"]
    assert Link("plant", "north", "controller", "north") in system.links
    assert Link("controller", "command", "plant", "command") in system.links


def test_order_is_data_flow_with_the_plant_last() -> None:
    assert SYSTEMS["full"].order() == ["sensors", "estimator", "controller", "command_module", "plant"]
    assert SYSTEMS["cts"].order() == ["controller", "command_module", "plant"]


def test_order_does_not_depend_on_how_the_components_are_listed() -> None:
    full = SYSTEMS["full"]
    turned = System("turned", dict(reversed(full.components.items())), tuple(reversed(full.links)))
    assert turned.order() == full.order()


def test_links_of_the_shipped_systems_are_those_of_the_roles() -> None:
    """Contract 1."""
    full: dict[tuple[str, str], set[str]] = {(x.source, x.target): set() for x in SYSTEMS["full"].links}
    for x in SYSTEMS["full"].links:
        assert x.source_variable == x.target_variable
        full[x.source, x.target].add(x.target_variable)
    assert full == {
        ("plant", "sensors"): set(Plant.flat_names("output")),
        ("sensors", "estimator"): {
            "accel_x", "pitch_meas", "heading_meas", "gps_fix", "gps_north", "gps_east", "gps_speed",
            "gps_course", "gps_h_acc", "gps_s_acc",
        },
        ("estimator", "controller"): {"north", "east", "speed", "heading", "speed_sd", "valid"},
        ("controller", "command_module"): {"command"},
        ("controller", "plant"): {"command"},
    }  # fmt: skip
    # the inputs that a scenario sets are left free
    fed = {x.target_variable for x in SYSTEMS["full"].links if x.target == "controller"}
    assert set(Cmec.flat_names("input")) - fed == {"start", "override", "link_ok"}


def step_by_hand(
    system: System, parameters: Mapping[str, Mapping[str, float]], ticks: int
) -> dict[str, np.ndarray[Any, Any]]:
    """Models stepped in sequential order; a plant's outputs are those before its step."""
    models = {c: Model(block, parameters.get(c)) for c, block in system.components.items()}
    for model in models.values():
        model.initialize()
    models["controller"]["start"] = 1
    rows = []
    for _ in range(ticks):
        before = models["plant"].output.copy()
        for component in system.order():
            for link in system.links:
                if link.target == component:
                    models[component][link.target_variable] = models[link.source][link.source_variable]
            models[component].step()
        rows.append(np.concatenate([before if c == "plant" else models[c].output for c in system.components]))
    names = [f"{c}_{n}" for c, b in system.components.items() for n in b.flat_names("output")]
    return dict(zip(names, np.array(rows).T, strict=True))


@pytest.mark.parametrize(
    ("system", "ticks", "parameters"),
    [
        (trial_simulator(), 900, {"plant": {"seed": 2}}),
        (trial_simulator(Pedestrian), 2000, {}),
        (
            full_system(),
            900,
            {"plant": {"seed": 2}, "sensors": {"seed": 2, "outage_start[1]": 3, "outage_end[1]": 6}},
        ),
    ],
    ids=["cts", "pedestrian", "full"],
)
def test_the_control_system_gives_the_outputs_of_stepping_by_hand(
    system: System, ticks: int, parameters: dict[str, dict[str, float]]
) -> None:
    # given a trial stepped by hand, up to its end
    parameters = parameters | {"controller": MISSION}
    by_hand = step_by_hand(system, parameters, ticks)
    ended = np.nonzero(by_hand["controller_status"] >= 2)[0]
    assert ended.size, "the trial does not end"
    ticks = int(ended[0]) + 2
    # when the same is run as one system of `control`
    whole = interconnect(system, parameters)
    inputs = np.tile(whole.initial_input[:, None], (1, ticks))
    inputs[whole.input_labels.index("controller_start")] = 1
    time = np.arange(ticks) * TICK
    response = control.input_output_response(whole, time, inputs, whole.initial_state)
    # then every output of every tick is the same (control's matrix product makes 0.0 of -0.0)
    assert set(whole.output_labels) == by_hand.keys()
    for name, row in zip(whole.output_labels, response.outputs, strict=True):
        assert np.array_equal(row, by_hand[name][:ticks]), name


def test_the_control_system_names_its_free_inputs_with_their_start_values() -> None:
    whole = interconnect(SYSTEMS["cts"])
    free = dict(zip(whole.input_labels, whole.initial_input, strict=True))
    assert free == {
        "controller_valid": 1,
        "controller_start": 0,
        "controller_override": 0,
        "controller_link_ok": 1,
        "controller_speed_sd": 0,
    }
    assert whole.dt == TICK
