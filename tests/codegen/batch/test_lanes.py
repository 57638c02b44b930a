"""The graph: what it simplifies, and what must stay. The ordinary tick of each mode: what is in it."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
import pytest

from codegen.batch.batch import Batch
from codegen.batch.graph import Graph
from codegen.batch.lanes import BatchSystem, Tick, field_name, ordinary_tick
from codegen.blocks.nodes import SELECT, Node, read
from codegen.toolchains.compiler import CompileError
from models.commands import Command
from models.kit.link import Key
from models.modes import COMMANDS, Anomaly, Mode
from models.system import SYSTEMS

STOP = ("controller.status", (2, 3, 4))
RUNNING = {("controller", "start"): 1.0, ("controller", "link_ok"): 1.0, ("controller", "valid"): 1.0}
STILL = {("controller", "override"): 0.0}


SYMBOLS = a, b, c, d = [ca.SX.sym(name) for name in "abcd"]


@pytest.fixture
def graph() -> Graph:
    return Graph()


@pytest.fixture
def x(graph: Graph) -> Node:
    return graph.leaf("x")


@pytest.fixture
def y(graph: Graph) -> Node:
    return graph.leaf("y")


@pytest.fixture
def condition(graph: Graph, x: Node, y: Node) -> Node:
    return graph.make(ca.OP_LT, (x, y))


def is_constant(node: Node, value: float) -> bool:
    """Is it this number, with the sign of zero?"""
    return (
        node.op == ca.OP_CONST
        and node.value == value
        and math.copysign(1.0, node.value) == math.copysign(1.0, value)
    )


def test_the_same_operation_on_the_same_operands_is_one_node(graph: Graph, x: Node, y: Node) -> None:
    assert graph.leaf("x") is x is not y
    assert graph.make(ca.OP_ADD, (x, y)) is graph.make(ca.OP_ADD, (x, y))
    assert graph.make(ca.OP_ADD, (x, y)) is not graph.make(
        ca.OP_ADD, (y, x)
    )  # of two NaNs, the first goes on
    assert graph.constant(2.0) is graph.constant(2)
    assert graph.make(ca.OP_ADD, (x, Node(ca.OP_CONST, value=2.0))) is graph.make(
        ca.OP_ADD, (x, graph.constant(2.0))
    )


def test_zero_and_negative_zero_are_two_constants(graph: Graph) -> None:
    assert graph.constant(0.0) is not graph.constant(-0.0)
    assert is_constant(graph.constant(-0.0), -0.0)
    assert is_constant(graph.constant(0.0), 0.0)


@pytest.mark.parametrize(
    ("op", "a", "b", "value"),
    [
        (ca.OP_ADD, 0.1, 0.2, 0.1 + 0.2), (ca.OP_SUB, 0.3, 0.1, 0.3 - 0.1), (ca.OP_MUL, 0.1, 3.0, 0.1 * 3.0),
        (ca.OP_MUL, 0.0, -1.0, -0.0), (ca.OP_ADD, -0.0, 0.0, 0.0), (ca.OP_ADD, -0.0, -0.0, -0.0),
        (ca.OP_LT, 1.0, 2.0, 1.0), (ca.OP_LT, 2.0, 2.0, 0.0), (ca.OP_LE, 2.0, 2.0, 1.0),
        (ca.OP_EQ, 0.0, -0.0, 1.0), (ca.OP_NE, 0.0, -0.0, 0.0), (ca.OP_NE, 1.0, 2.0, 1.0),
    ],
)  # fmt: skip
def test_operations_on_constants_are_computed_as_in_doubles(
    graph: Graph, op: int, a: float, b: float, value: float
) -> None:
    assert is_constant(graph.make(op, (graph.constant(a), graph.constant(b))), value)


def test_a_choice_with_a_known_condition_is_what_it_chooses(
    graph: Graph, x: Node, y: Node, condition: Node
) -> None:
    assert graph.select(graph.true, x, y) is x
    assert graph.select(graph.false, x, y) is y
    assert graph.select(condition, x, x) is x
    assert graph.select(condition, x, y).op == SELECT


def traced(graph: Graph, expression: Any, *leaves: Node) -> Node:
    """The node of a CasADi expression of a, b, c, d, given their nodes."""
    function = ca.Function("f", [ca.vertcat(*SYMBOLS[: len(leaves)])], [ca.SX(expression)])
    return graph.known(read(function, lambda _, i: leaves[i], graph.make)[0][0])


def test_a_choice_that_casadi_writes_as_a_sum_is_a_choice_again(
    graph: Graph, x: Node, y: Node, condition: Node
) -> None:
    """CasADi writes it as (a ? b : 0) + (!a ? c : 0)."""
    choice = ca.if_else(a, b, c)
    assert "+" in str(choice)
    assert traced(graph, choice, graph.true, x, y) is x
    assert traced(graph, choice, graph.false, x, y) is y
    assert traced(graph, choice, condition, x, y) is graph.select(condition, x, y)
    graph.assume(condition, False)
    assert traced(graph, choice, condition, x, y) is y


@pytest.mark.parametrize("conditions", list(product((0.0, 1.0, 3.0), repeat=2)))
def test_the_sum_of_two_choices_with_different_conditions_stays_a_sum(
    graph: Graph, conditions: tuple[float, float]
) -> None:
    # given (a ? x : 0) + (b ? y : 0), where both conditions are known
    total = ca.if_else(a, b, 0) + ca.if_else(c, d, 0)
    first, second = map(graph.constant, conditions)
    node = traced(graph, total, first, graph.leaf("x"), second, graph.leaf("y"))
    # then it is the sum, with its zeros
    for x, y in product((-0.0, 0.0, 5.0), repeat=2):
        expected = (x if conditions[0] else 0.0) + (y if conditions[1] else 0.0)
        assert bits(evaluated(node, {"x": x, "y": y})) == bits(expected)


def test_logic_with_a_constant_is_decided_or_its_other_operand(
    graph: Graph, x: Node, condition: Node
) -> None:
    for a, b in ((condition, graph.true), (graph.true, condition)):
        assert graph.make(ca.OP_AND, (a, b)) is condition
        assert graph.make(ca.OP_OR, (a, b)) is graph.true
    for a, b in ((condition, graph.false), (graph.false, condition)):
        assert graph.make(ca.OP_AND, (a, b)) is graph.false
        assert graph.make(ca.OP_OR, (a, b)) is condition
    assert graph.make(ca.OP_AND, (condition, condition)) is condition
    assert graph.make(ca.OP_NOT, (graph.false,)) is graph.true
    assert graph.make(ca.OP_NOT, (graph.constant(3.0),)) is graph.false
    # a number becomes a condition
    assert graph.make(ca.OP_AND, (x, graph.true)).ctype == "bool"
    assert graph.make(ca.OP_AND, (x, x)).ctype == "bool"
    assert graph.all_of() is graph.true
    assert graph.any_of() is graph.false


def test_a_condition_in_arithmetic_is_a_choice_of_numbers(graph: Graph, condition: Node) -> None:
    # given 1 - 2 c, as signs are made
    double = graph.make(ca.OP_MUL, (graph.constant(2.0), condition))
    sign = graph.make(ca.OP_SUB, (graph.true, double))
    # then it is a choice of 1 and -1, without arithmetic
    assert sign.op == SELECT
    assert sign.operands[0] is condition
    assert [a.value for a in sign.operands[1:]] == [-1.0, 1.0]
    # and zeros have their signs: -1 * (c ? 1 : 0) is -0.0 where c does not hold
    minus = graph.make(ca.OP_MUL, (graph.constant(-1.0), condition))
    assert is_constant(minus.operands[2], -0.0)


def test_operations_stay_whose_result_depends_on_nan_infinity_or_the_sign_of_zero(
    graph: Graph, x: Node
) -> None:
    """0 * x may be NaN or -0.0, 0 - x differs from -x for x = 0.0, and x == x is false for NaN."""
    for op, a, b in (
        (ca.OP_MUL, x, graph.false), (ca.OP_MUL, graph.false, x), (ca.OP_SUB, graph.false, x),
        (ca.OP_SUB, x, x), (ca.OP_EQ, x, x), (ca.OP_LE, x, x),
    ):  # fmt: skip
        assert graph.make(op, (a, b)).op == op


def test_a_sum_with_zero_is_not_its_other_term(graph: Graph, x: Node) -> None:
    """-0.0 + 0.0 is 0.0."""
    assert graph.make(ca.OP_ADD, (x, graph.constant(0.0))) is not x
    assert graph.make(ca.OP_ADD, (graph.constant(0.0), x)) is not x


# What follows from assumptions


def test_an_assumed_condition_is_known(graph: Graph, x: Node, y: Node, condition: Node) -> None:
    graph.assume(condition, True)
    assert graph.known(condition) is graph.true
    assert graph.make(ca.OP_LT, (x, y)) is graph.true
    assert graph.select(condition, x, y) is x
    assert graph.known(x) is x


def test_both_operands_of_a_true_and_are_true(graph: Graph, x: Node, y: Node) -> None:
    a, b = graph.make(ca.OP_LT, (x, y)), graph.make(ca.OP_LE, (y, graph.constant(3.0)))
    graph.assume(graph.all_of(a, b), True)
    assert graph.known(a) is graph.known(b) is graph.true


def test_both_operands_of_a_false_or_are_false(graph: Graph, x: Node, y: Node) -> None:
    a, b = graph.make(ca.OP_LT, (x, y)), graph.make(ca.OP_LE, (y, graph.constant(3.0)))
    graph.assume(graph.any_of(a, b), False)
    assert graph.known(a) is graph.known(b) is graph.false


@pytest.mark.parametrize(("join", "holds"), [(Graph.all_of, False), (Graph.any_of, True)])
def test_a_false_and_or_a_true_or_decides_neither_operand(
    graph: Graph, x: Node, y: Node, join: Any, holds: bool
) -> None:
    a, b = graph.make(ca.OP_LT, (x, y)), graph.make(ca.OP_LE, (y, graph.constant(3.0)))
    graph.assume(join(graph, a, b), holds)
    assert graph.known(a) is a
    assert graph.known(b) is b


def test_the_operand_of_a_false_not_is_true(graph: Graph, condition: Node) -> None:
    graph.assume(graph.make(ca.OP_NOT, (condition,)), False)
    assert graph.known(condition) is graph.true


@pytest.mark.parametrize(("op", "holds"), [(ca.OP_EQ, True), (ca.OP_NE, False)])
def test_a_node_that_equals_a_number_is_that_number(
    graph: Graph, x: Node, y: Node, op: int, holds: bool
) -> None:
    graph.assume(graph.make(op, (x, graph.constant(3.0))), holds)
    graph.assume(graph.make(op, (graph.constant(4.0), y)), holds)
    assert is_constant(graph.known(x), 3.0)
    assert is_constant(graph.known(y), 4.0)


@pytest.mark.parametrize(("op", "holds"), [(ca.OP_EQ, False), (ca.OP_NE, True)])
def test_a_node_that_differs_from_a_number_stays_unknown(graph: Graph, x: Node, op: int, holds: bool) -> None:
    graph.assume(graph.make(op, (x, graph.constant(3.0))), holds)
    assert graph.known(x) is x


@pytest.mark.parametrize("taken", [0, 1])
def test_a_choice_that_cannot_be_the_one_number_is_the_other_operand(
    graph: Graph, x: Node, condition: Node, taken: int
) -> None:
    # given c ? x : 2, or c ? 2 : x
    options = (graph.constant(2.0), x) if taken == 0 else (x, graph.constant(2.0))
    graph.assume_value(graph.select(condition, *options), 5.0)
    assert is_constant(graph.known(condition), float(taken))
    assert is_constant(graph.known(x), 5.0)


def test_a_choice_that_may_be_either_operand_stays_unknown(graph: Graph, x: Node, condition: Node) -> None:
    graph.assume_value(graph.select(condition, x, graph.constant(2.0)), 2.0)
    assert graph.known(condition) is condition
    assert graph.known(x) is x


# No simplification changes a value

POSITIVE = [0.0, 1.0, 2.0, math.inf, math.nan]
NUMBERS = [-2.0, -0.0, *POSITIVE]
APPLY: dict[int, Callable[..., Any]] = {
    ca.OP_ADD: lambda a, b: a + b, ca.OP_SUB: lambda a, b: a - b, ca.OP_MUL: lambda a, b: a * b,
    ca.OP_LT: lambda a, b: float(a < b), ca.OP_LE: lambda a, b: float(a <= b),
    ca.OP_EQ: lambda a, b: float(a == b), ca.OP_NE: lambda a, b: float(a != b),
    ca.OP_AND: lambda a, b: float(bool(a) and bool(b)), ca.OP_OR: lambda a, b: float(bool(a) or bool(b)),
    ca.OP_NOT: lambda a: float(not a), SELECT: lambda c, a, b: a if c else b, ca.OP_NEG: lambda a: -a,
}  # fmt: skip


def evaluated(node: Node, leaves: dict[str, float]) -> float:
    if node.op == ca.OP_CONST:
        return node.value
    if node.op == ca.OP_INPUT:
        return leaves[node.field]
    result: float = APPLY[node.op](*(evaluated(a, leaves) for a in node.operands))
    return result


def bits(value: float) -> str:
    return "nan" if math.isnan(value) else value.hex()


def test_simplified_operations_have_their_value(graph: Graph, x: Node, y: Node, condition: Node) -> None:
    """All operations on leaves, constants, conditions and choices, for numbers, signed zeros and NaN."""
    atoms = [x, y, condition, graph.select(condition, graph.constant(-0.0), graph.constant(2.0))]
    atoms += [graph.constant(v) for v in (-1.0, -0.0, 0.0, 1.0, 3.0)]
    wrong = []
    for op, apply in APPLY.items():
        for operands in product(atoms, repeat=apply.__code__.co_argcount):
            node = graph.make(op, operands)
            for a, b in product(NUMBERS, repeat=2):
                leaves = {"x": a, "y": b}
                expected = apply(*(evaluated(operand, leaves) for operand in operands))
                if bits(evaluated(node, leaves)) != bits(expected):
                    wrong.append((op, [str(o.field or o.value) for o in operands], a, b))
    assert wrong == []


@pytest.mark.parametrize("holds", [False, True])
def test_an_assumption_that_holds_changes_no_value(holds: bool) -> None:
    """For all conditions two operations deep; the leaves of logic are 0 or 1."""
    comparisons, logic = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE), (ca.OP_AND, ca.OP_OR)
    wrong = []
    for op, *inner in product((*comparisons, *logic), (SELECT, *comparisons), range(4), range(4), range(4)):
        graph = Graph()
        x, y = graph.leaf("x"), graph.leaf("y")
        atoms = [x, y, graph.true, graph.constant(0.0 if op in logic else 2.0)]
        outer, *others = (atoms[i] for i in inner[1:])
        condition = graph.make(ca.OP_LT, (x, y))
        first = condition if inner[0] == SELECT else others[1]
        operand = graph.make(inner[0], (first, *others) if inner[0] == SELECT else tuple(others))
        node = graph.make(op, (outer, operand))
        if node.op == ca.OP_CONST or node.ctype != "bool":
            continue
        graph.assume(node, holds)
        for a, b in product((0.0, 1.0) if op in logic else POSITIVE, repeat=2):
            leaves = {"x": a, "y": b}
            if evaluated(node, leaves) == float(holds):
                for known in (x, y, condition, operand):
                    if bits(evaluated(graph.known(known), leaves)) != bits(evaluated(known, leaves)):
                        wrong.append((op, inner, a, b))
    assert wrong == []


def test_a_node_that_equals_zero_is_not_replaced_since_it_may_be_negative_zero(graph: Graph, x: Node) -> None:
    """The sign would matter in y + x, or where x is stored."""
    graph.assume(graph.equal(x, 0.0), True)
    assert graph.known(x) is x


# The ordinary ticks of the trial simulator


@pytest.fixture(scope="module")
def ticks() -> dict[Mode, Tick]:
    """The trial simulator's ticks by mode, if the status is observed and the threshold varied."""
    batch = Batch(SYSTEMS["cts"], ["controller.moving_deviation"], ["controller.status"], STOP)
    by_mode = batch.ticks((), RUNNING | STILL)
    return {Mode(int(tick.held["controller", "now"])): tick for tick in by_mode}


def test_each_mode_of_a_running_trial_has_a_tick(ticks: dict[Mode, Tick]) -> None:
    # the others are those before the start and those after the end
    not_running = {Mode.IDLE, Mode.FAILURE_RECALL, Mode.SUCCESS, Mode.FAILED, Mode.STOPPED}
    assert set(ticks) == set(Mode) - not_running


def test_the_command_is_held_throughout_a_mode(ticks: dict[Mode, Tick]) -> None:
    for mode, tick in ticks.items():
        assert tick.held["controller", "overruled"] == Anomaly.NONE
        assert tick.held["plant", "past_command"] == COMMANDS.get(mode, Command.NONE), mode


def test_a_tick_neither_reads_nor_writes_held_states(ticks: dict[Mode, Tick]) -> None:
    for tick in ticks.values():
        assert not tick.held.keys() & (tick.reads | tick.writes)
        assert not tick.always_departs


def test_a_tick_reads_and_writes_what_its_mode_needs(ticks: dict[Mode, Tick]) -> None:
    motion = {("plant", n) for n in ("position_north", "position_east", "velocity", "body_heading")}
    for mode, tick in ticks.items():
        assert ("controller", "ticks") in tick.writes
        assert motion - {("plant", "body_heading")} <= tick.writes, mode
    # the threshold differs between trials, and matters while the animal runs
    threshold = ("controller", "moving_deviation")
    assert threshold in ticks[Mode.FORWARD].reads
    assert threshold not in ticks[Mode.RECALL].reads
    # a turn reads the rate of its side only
    right, left = ("plant", "trial_right_rate"), ("plant", "trial_left_rate")
    assert (right in ticks[Mode.RIGHT].reads, left in ticks[Mode.RIGHT].reads) == (True, False)
    assert (right in ticks[Mode.LEFT].reads, left in ticks[Mode.LEFT].reads) == (False, True)
    # only on recall the animal turns home
    for mode, tick in ticks.items():
        assert (("plant", "start_north") in tick.reads | tick.common) is (mode is Mode.RECALL)


def test_an_ordinary_tick_sets_nothing_that_changes_seldom(ticks: dict[Mode, Tick]) -> None:
    # no draw, no count of waypoints or turns, no latch
    seldom = {"obeys_right", "right_stream[1]", "reached", "turns", "issued", "now", "route_north[1]", "told"}
    for tick in ticks.values():
        assert not {name for _, name in tick.writes} & seldom
        assert tick.lines[-len(tick.writes) - 1].startswith("const bool departs = ")


def test_a_tick_by_mode_takes_fewer_operations_than_the_tick_of_all_modes(ticks: dict[Mode, Tick]) -> None:
    batch = Batch(SYSTEMS["cts"], ["controller.moving_deviation"], ["controller.status"], STOP)
    varying = frozenset({("controller", "moving_deviation")})
    keep = {c: batch.keep.get(c, frozenset()) for c in SYSTEMS["cts"].components}
    whole = ordinary_tick(
        BatchSystem(
            SYSTEMS["cts"], keep, varying, RUNNING | STILL, (("controller", "status"), frozenset(STOP[1]))
        ),
        {},
    )
    assert max(tick.operations for tick in ticks.values()) < whole.operations
    # in the tick of all modes no state is held
    assert not whole.held
    assert ("plant", "past_command") in whole.writes


FENCED = {"guarded": 1.0, "fence_count": 4.0}


def starts(batch: Batch) -> dict[tuple[str, str], float]:
    """The start values of its structural parameters."""
    return {key: parameter.start[0] for key, parameter in batch.structural.items()}


def test_what_a_structural_parameter_turns_on_is_in_the_ordinary_tick() -> None:
    # given the limits of leading, which are on in each tick of a trial
    batch = Batch(SYSTEMS["cts"], ["controller.moving_deviation"], ["controller.status"], STOP)
    assert starts(batch) == {("controller", "guarded"): 0.0, ("controller", "fence_count"): 0.0}
    ticks = batch.ticks((), RUNNING | STILL | starts(batch) | {("controller", "guarded"): 1.0})
    by_mode = {Mode(int(tick.held["controller", "now"])): tick for tick in ticks}
    for mode in (Mode.FORWARD, Mode.STOP_TO_TURN, Mode.LEFT, Mode.RIGHT, Mode.RECALL):
        tick = by_mode[mode]
        # then stimuli are counted in lanes; so are surveys; the command, which may be silenced, is not held
        assert {("controller", f"spent[{i}]") for i in (1, 2, 3)} <= tick.writes
        assert ("controller", "still_ticks") in tick.writes
        assert tick.held.get(("plant", "past_command"), COMMANDS[mode]) == COMMANDS[mode]
        assert ("controller", "guarded") not in tick.common
        assert ("controller", "edge") not in tick.writes
        assert not tick.always_departs
    # and with a fence the place is held against its edges there, which is on every tick
    for tick in batch.ticks((), RUNNING | STILL | {("controller", n): v for n, v in FENCED.items()}):
        if tick.held["controller", "now"] in (Mode.FORWARD, Mode.RECALL):
            assert {("controller", "edge"), ("controller", "inside")} <= tick.writes
            assert not tick.always_departs
    # and without them nothing of them is there
    for tick in batch.ticks((), RUNNING | STILL | starts(batch)):
        assert not tick.writes & {("controller", "led"), ("controller", "cue_ticks")}
        assert ("controller", "guarded") not in tick.common


def test_fences_of_all_numbers_of_corners_share_a_runner_and_none_has_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # given a batch that says what it would compile
    batch = Batch(SYSTEMS["cts"], observe=["controller.status"], stop=STOP)
    asked = []

    def library(changing: object, fixed: tuple[tuple[Key, float], ...], stalling: object) -> None:
        asked.append(fixed)
        raise CompileError("not compiled")

    monkeypatch.setattr(batch, "_library", library)
    # when trials have fences
    for corners in (0, 3, 4, 7):
        with pytest.raises(CompileError):
            batch.run({"controller": {"fence_count": corners}}, np.zeros((1, 0)), [0], [1], 1)
    # then
    assert asked[0] != asked[1]
    assert asked[1] == asked[2] == asked[3]


def test_the_value_of_a_switch_that_is_on_is_no_constant_of_the_tick() -> None:
    batch = Batch(SYSTEMS["cts"])
    for corners, known in ((0.0, 0.0), (1.0, None), (5.0, None)):
        constants = {("controller", "fence_count"): corners, ("controller", "guarded"): 1.0}
        system = BatchSystem(batch.system, batch.keep, frozenset(), constants, None)
        assert system.constant(("controller", "fence_count")) == known
        assert system.constant(("controller", "guarded")) == 1.0
        assert system.constant(("controller", "start")) is None


def test_a_structural_parameter_that_is_varied_is_none() -> None:
    batch = Batch(SYSTEMS["cts"], ["controller.guarded"], ["controller.status"], STOP)
    assert starts(batch) == {("controller", "fence_count"): 0.0}


def test_a_trial_without_a_start_signal_has_ordinary_ticks_in_mode_idle() -> None:
    # given no start signal
    batch = Batch(SYSTEMS["cts"], ["controller.moving_deviation"], ["controller.status"], STOP)
    idle = RUNNING | STILL | {("controller", "start"): 0.0}
    modes = {int(tick.held["controller", "now"]) for tick in batch.ticks((), idle)}
    assert Mode.IDLE in modes
    assert Mode.FORWARD not in modes  # the mission ends there at once


def test_fields_are_named_by_component_and_variable() -> None:
    assert field_name(("controller", "route_north[3]")) == "controller_route_north_3"
