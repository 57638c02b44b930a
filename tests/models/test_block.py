"""Tracing: the program of a block's equations, and which blocks are refused in which words."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from models.errors import DeclarationError
from models.kit.block import Block, Row, before, moves, table, triggered
from models.kit.declaration import Boolean, Input, Integer, Output, Parameter, State, Stream
from models.kit.tracing import Condition, Table, Update

traced: list[str] = []


class Base(Block):
    """A base with an update that stands first."""

    u = Input("m", "input")
    total = State("m", "sum of the inputs")

    def add(m) -> None:
        """Sum."""
        traced.append(m.precision)
        m.total = m.total + m.u


class LongName(Base):
    """Updates, a table, a trigger, in order."""

    gain = Parameter("1", "gain", start=2)
    ready = State(Boolean, "ready")
    mode = State(Integer, "mode")
    pair = State("m", "two", size=2)
    y = Output("m", "answer")

    def initialize(m) -> None:
        m.total = 10 * m.gain

    @triggered("ready")
    def jump(m) -> None:
        m.pair = m.pair + 1

    @table("mode")
    def machine(m) -> list[Row]:
        return [Row(0, m.total > 5, 1, {"ready": 1}), Row(1, m.total < 0, 0)]

    def output(m) -> None:
        m.y = m.gain * m.total


def block(*bases: type[Block], **members: Any) -> type[Block]:
    return type("Faulty", bases or (Block,), members)


def test_title_groups_and_order() -> None:
    program = LongName.program()
    assert LongName.title() == "long_name"
    assert [v.name for v in LongName.group("state")] == ["total", "ready", "mode", "pair"]
    assert LongName.flat_names("state") == ["total", "ready", "mode", "pair[1]", "pair[2]"]
    assert [p.name for p in program.initialize] == ["initialize"]
    assert [p.name for p in program.tick] == ["add", "jump", "machine", "output"]
    jump, machine = program.tick[1], program.tick[2]
    assert isinstance(jump, Update)
    assert jump.writes == ("pair[1]", "pair[2]")
    assert jump.guard is not None
    assert isinstance(machine, Table)
    assert [(row.mode, row.next, row.writes) for row in machine.rows] == [
        (0, 1, ("mode", "ready")),
        (1, 0, ("mode",)),
    ]
    assert len(list(program.functions)) == 1 + 1 + 2 + 4 + 1


def test_guards_keep_their_words_and_updates_their_transitions() -> None:
    class Lamp(Block):
        """Goes on and off."""

        key = Input(Boolean, "key")
        power = Input("1", "power")
        mode = State(Integer, "mode")

        @triggered("key")
        @moves({1: 0, 0: 1})
        def switch(m) -> None:
            m.mode = 1 - m.mode

        @triggered(lambda m: m.power < 1, "too little power")
        @table("mode")
        def fail(m) -> list[Row]:
            on, off = Condition(m.key, "key on"), Condition(m.power <= 0, "no power")
            return [Row(1, on & off, 0), Row(1, m.power < 0, 0)]

    switch, fail = Lamp.program().tick
    assert isinstance(switch, Update)
    assert isinstance(fail, Table)
    assert (switch.when, switch.edges) == ("`key`", ((0, 1), (1, 0)))
    assert (fail.when, [row.when for row in fail.rows]) == ("too little power", ["key on, no power", ""])
    assert [float(fail.rows[0].guard([1], u, [], [])) for u in ([1, 0], [0, 0], [1, 1])] == [1, 0, 0]


def test_updates_of_a_subclass_stand_before_the_one_that_they_name() -> None:
    class First(Base):
        """Two before `add`, one after everything."""

        @before("add")
        def one(m) -> None:
            m.total = 1

        def last(m) -> None:
            m.total = 2

        @before("add")
        @triggered(lambda m: m.u > 0, "going on")
        def two(m) -> None:
            m.total = 3

    assert list(First.updates()) == ["one", "two", "add", "last"]
    assert [phase.when for phase in First.program().tick] == ["", "going on", "", ""]

    class Wrong(Base):
        """Before an update that there is not."""

        @before("ad")
        def early(m) -> None:
            m.total = 1

    with pytest.raises(DeclarationError, match=r'Wrong\.early is before "ad", .*; did you mean "add"'):
        Wrong.updates()


def test_a_summary_is_the_first_line_of_the_docstring() -> None:
    class Long(Block):
        """
        Says much.

        And more.
        """

    class Silent(Long):
        pass

    assert LongName.summary() == "Updates, a table, a trigger, in order."
    assert Long.summary() == "Says much."
    assert Silent.summary() == ""


def test_a_program_is_traced_once_per_precision() -> None:
    double = LongName.program()
    count = traced.count("double")
    assert LongName.program("double") is double
    assert traced.count("double") == count
    single = LongName.program("float")
    assert single is not double
    assert (double.precision, single.precision) == ("double", "float")
    assert LongName.program("float") is single
    assert traced.count("float") == 1


def test_an_update_sees_what_earlier_assignments_in_it_made() -> None:
    class Twice(Block):
        """Assigns twice."""

        x = State("1", "x", start=1)
        y = Output("1", "y")

        def grow(m) -> None:
            m.x = m.x + 1
            m.x = m.x * 10
            m.y = m.x

    (grow,) = Twice.program().tick
    assert isinstance(grow, Update)
    assert np.array(grow.function([1.0], [], [], [0.0])).ravel().tolist() == [20.0, 20.0]


def test_within_asks_for_every_element() -> None:
    class Guarded(Block):
        """Checks."""

        a = Input("m", "a", min=0, max=1)
        v = Input("m", "v", size=2, min=-1, max=1)
        y = Output(Boolean, "good")

        def check(m) -> None:
            m.y = m.within("a", "v")

    (check,) = Guarded.program().tick
    assert isinstance(check, Update)

    def good(*inputs: float) -> float:
        return float(check.function([], list(inputs), [], [0]))

    assert good(0.5, -1, 1) == 1
    assert [good(1.1, 0, 0), good(0.5, 2, 0), good(0.5, 0, -2), good(float("nan"), 0, 0)] == [0, 0, 0, 0]


def set_y(m: Any) -> None:
    m.y = 1


def set_y_seldom(m: Any) -> None:
    m.y = 1


def read_and_set_z(m: Any) -> None:
    m.y = m.z
    m.z = 0


Y = Output("1", "answer")
FAULTS: dict[str, dict[str, Any]] = {
    'Faulty: output "y" is read before it is set': {
        "y": Y,
        "x": State("1", "x"),
        "first": lambda m: setattr(m, "x", m.y),
        "second": set_y,
    },
    "Faulty: y, z not set on every tick": {
        "y": Y,
        "z": Output("1", "z"),
        "w": Output("1", "w"),
        "on": Input(Boolean, "on"),
        "first": triggered("on")(set_y_seldom),
        "second": lambda m: setattr(m, "w", 1),
    },
    'Faulty: input "u" is assigned': {"u": Input("1", "u"), "first": lambda m: setattr(m, "u", 1)},
    'Faulty: parameter "p" is assigned': {
        "p": Parameter("1", "p", start=0),
        "first": lambda m: setattr(m, "p", 1),
    },
    "Faulty.x has 3 elements, got 2": {
        "x": State("1", "x", size=3),
        "first": lambda m: setattr(m, "x", m.x[:2]),
    },
    'Faulty: stream "s" needs a parameter "seed"': {"s": Stream("s", substream=0)},
    'Faulty.first: mode "phase" is not a state': {
        "phase": Input(Integer, "phase"),
        "first": table("phase")(lambda m: []),
    },
    'Faulty.first: row assigns unknown "speling"': {
        "phase": State(Integer, "phase"),
        "first": table("phase")(lambda m: [Row(0, 1, 0, {"speling": 1})]),
    },
    'Faulty.first: row assigns unknown "anomaly"': {
        "phase": State(Integer, "phase"),
        "first": table("phase")(lambda m: [Row(0, 1, 0, anomaly=3)]),
    },
    'Faulty.first: guard "never" is not a variable': {
        "x": State("1", "x"),
        "first": triggered("never")(lambda m: setattr(m, "x", 1)),
    },
    'Faulty.first: seldom "on" does not name a structural parameter': {
        "on": Parameter(Boolean, "on", start=0),
        "x": State("1", "x"),
        "first": triggered("on", seldom="on")(lambda m: setattr(m, "x", 1.0)),
    },
    "Faulty.first: operation exp would call libm": {
        "x": State("1", "x"),
        "first": lambda m: setattr(m, "x", ca.exp(m.x)),
    },
}


@pytest.mark.parametrize("message", FAULTS)
def test_a_faulty_block_is_refused_in_these_words(message: str) -> None:
    with pytest.raises(DeclarationError) as error:
        block(**FAULTS[message]).program()
    assert message in str(error.value)


def test_an_output_set_by_a_triggered_update_alone_may_not_be_read() -> None:
    faulty = block(
        y=Y,
        on=Input(Boolean, "on"),
        x=State("1", "x"),
        first=triggered("on")(set_y_seldom),
        second=lambda m: setattr(m, "x", m.y),
    )
    with pytest.raises(DeclarationError, match='output "y" is read before it is set'):
        faulty.program()


# Plants: outputs depend on states and parameters alone.
PLANT: dict[str, Any] = {"moore": True, "u": Input("1", "u"), "x": State("1", "x"), "y": Y}


def move(m: Any) -> None:
    m.x = m.u


MOORE_FAULTS: dict[str, dict[str, Any]] = {
    "Faulty.output depends on inputs; a moore block's may not": {
        "output": lambda m: setattr(m, "y", m.u + m.x)
    },
    "Faulty: the last update of a moore block is `output`": {"output": set_y, "after": lambda m: None},
    "Faulty: a moore block sets z in `output` alone": {
        "z": Output("1", "z"),
        "move": lambda m: setattr(m, "z", m.u),
        "output": set_y,
    },
    "Faulty.output depends on outputs; a moore block's may not": {
        "z": Output("1", "z"),
        "move": lambda m: setattr(m, "z", m.u),
        "output": read_and_set_z,
    },
}


@pytest.mark.parametrize("message", MOORE_FAULTS)
def test_a_plant_whose_outputs_depend_on_more_than_states_is_refused(message: str) -> None:
    with pytest.raises(DeclarationError) as error:
        block(**{**PLANT, **MOORE_FAULTS[message]}).program()
    assert str(error.value) == message


def test_a_comparison_with_an_input_counts_as_dependence() -> None:
    with pytest.raises(DeclarationError, match="depends on inputs"):
        block(**PLANT, output=lambda m: setattr(m, "y", ca.if_else(m.u > 0, 1, 2))).program()


def test_a_sound_plant_initializes_its_outputs() -> None:
    sound = block(**PLANT, move=move, output=lambda m: setattr(m, "y", 2 * m.x))
    assert [p.name for p in sound.program().initialize] == ["output"]
    assert [p.name for p in sound.program().tick] == ["move", "output"]
