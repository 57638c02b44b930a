"""The ordinary tick: what the graph folds and what it must not, and what the tick of each mode holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import Any

import casadi as ca
import pytest

from codegen.batch.batch import Batch
from codegen.batch.graph import Graph
from codegen.batch.lanes import BatchSystem, Tick, field_name, ordinary_tick
from codegen.blocks.nodes import SELECT, Node, read
from models.cmec import COMMANDS, Anomaly, Mode
from models.commands import Command
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
    """Is it this very number, 0.0 or -0.0 as it is?"""
    return (
        node.op == ca.OP_CONST
        and node.value == value
        and math.copysign(1.0, node.value) == math.copysign(1.0, value)
    )


def test_equal_values_are_one_node(graph: Graph, x: Node, y: Node) -> None:
    assert graph.leaf("x") is x is not y
    assert graph.make(ca.OP_ADD, (x, y)) is graph.make(ca.OP_ADD, (x, y))
    assert graph.make(ca.OP_ADD, (x, y)) is not graph.make(ca.OP_ADD, (y, x))  # which of two NaNs, say
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
def test_constants_are_computed_as_doubles(graph: Graph, op: int, a: float, b: float, value: float) -> None:
    assert is_constant(graph.make(op, (graph.constant(a), graph.constant(b))), value)


def test_a_known_condition_chooses(graph: Graph, x: Node, y: Node, condition: Node) -> None:
    assert graph.select(graph.true, x, y) is x
    assert graph.select(graph.false, x, y) is y
    assert graph.select(condition, x, x) is x
    assert graph.select(condition, x, y).op == SELECT


def traced(graph: Graph, expression: Any, *leaves: Node) -> Node:
    """What a CasADi expression of a, b, c, d comes to, given their nodes."""
    function = ca.Function("f", [ca.vertcat(*SYMBOLS[: len(leaves)])], [ca.SX(expression)])
    return graph.known(read(function, lambda _, i: leaves[i], graph.make)[0][0])


def test_casadis_choice_is_a_choice(graph: Graph, x: Node, y: Node, condition: Node) -> None:
    """CasADi writes it as (a ? b : 0) + (!a ? c : 0)."""
    choice = ca.if_else(a, b, c)
    assert "+" in str(choice)
    assert traced(graph, choice, graph.true, x, y) is x
    assert traced(graph, choice, graph.false, x, y) is y
    assert traced(graph, choice, condition, x, y) is graph.select(condition, x, y)
    graph.assume(condition, 0.0)
    assert traced(graph, choice, condition, x, y) is y


@pytest.mark.parametrize("conditions", list(product((0.0, 1.0, 3.0), repeat=2)))
def test_the_sum_of_two_choices_is_no_choice(graph: Graph, conditions: tuple[float, float]) -> None:
    # given (a ? x : 0) + (b ? y : 0), where both conditions are known
    total = ca.if_else(a, b, 0) + ca.if_else(c, d, 0)
    first, second = map(graph.constant, conditions)
    node = traced(graph, total, first, graph.leaf("x"), second, graph.leaf("y"))
    # then it is the sum, with its zeros
    for x, y in product((-0.0, 0.0, 5.0), repeat=2):
        expected = (x if conditions[0] else 0.0) + (y if conditions[1] else 0.0)
        assert bits(evaluated(node, {"x": x, "y": y})) == bits(expected)


def test_logic_with_a_constant(graph: Graph, x: Node, condition: Node) -> None:
    for a, b in ((condition, graph.true), (graph.true, condition)):
        assert graph.make(ca.OP_AND, (a, b)) is condition
        assert graph.make(ca.OP_OR, (a, b)) is graph.true
    for a, b in ((condition, graph.false), (graph.false, condition)):
        assert graph.make(ca.OP_AND, (a, b)) is graph.false
        assert graph.make(ca.OP_OR, (a, b)) is condition
    assert graph.make(ca.OP_AND, (condition, condition)) is condition
    assert graph.make(ca.OP_NOT, (graph.false,)) is graph.true
    assert graph.make(ca.OP_NOT, (graph.constant(3.0),)) is graph.false
    # a number becomes a truth, not itself
    assert graph.make(ca.OP_AND, (x, graph.true)).ctype == "bool"
    assert graph.make(ca.OP_AND, (x, x)).ctype == "bool"
    assert graph.all_of() is graph.true
    assert graph.any_of() is graph.false


def test_a_truth_in_arithmetic_is_a_choice_of_numbers(graph: Graph, condition: Node) -> None:
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


def test_products_and_differences_with_zero_and_one_stay(graph: Graph, x: Node) -> None:
    """NaN, infinities and -0.0 are why: 0 x is no 0, 0 - x no -x."""
    for op, a, b in (
        (ca.OP_MUL, x, graph.false), (ca.OP_MUL, graph.false, x), (ca.OP_SUB, graph.false, x),
        (ca.OP_SUB, x, x), (ca.OP_EQ, x, x), (ca.OP_LE, x, x),
    ):  # fmt: skip
        assert graph.make(op, (a, b)).op == op


def test_a_sum_with_zero_is_not_its_other_term(graph: Graph, x: Node) -> None:
    """-0.0 + 0.0 is 0.0; -0.0 + -0.0 is -0.0, but nobody writes that."""
    assert graph.make(ca.OP_ADD, (x, graph.constant(0.0))) is not x
    assert graph.make(ca.OP_ADD, (graph.constant(0.0), x)) is not x


# What follows from what is assumed


def test_what_is_assumed_is_known(graph: Graph, x: Node, y: Node, condition: Node) -> None:
    graph.assume(condition, 1.0)
    assert graph.known(condition) is graph.true
    assert graph.make(ca.OP_LT, (x, y)) is graph.true
    assert graph.select(condition, x, y) is x
    assert graph.known(x) is x


def test_of_a_conjunction_that_holds_each_holds(graph: Graph, x: Node, y: Node) -> None:
    a, b = graph.make(ca.OP_LT, (x, y)), graph.make(ca.OP_LE, (y, graph.constant(3.0)))
    graph.assume(graph.all_of(a, b), 1.0)
    assert graph.known(a) is graph.known(b) is graph.true


def test_of_a_disjunction_that_does_not_none_does(graph: Graph, x: Node, y: Node) -> None:
    a, b = graph.make(ca.OP_LT, (x, y)), graph.make(ca.OP_LE, (y, graph.constant(3.0)))
    graph.assume(graph.any_of(a, b), 0.0)
    assert graph.known(a) is graph.known(b) is graph.false


@pytest.mark.parametrize(("join", "value"), [(Graph.all_of, 0.0), (Graph.any_of, 1.0)])
def test_which_of_two_it_is_stays_open(graph: Graph, x: Node, y: Node, join: Any, value: float) -> None:
    a, b = graph.make(ca.OP_LT, (x, y)), graph.make(ca.OP_LE, (y, graph.constant(3.0)))
    graph.assume(join(graph, a, b), value)
    assert graph.known(a) is a
    assert graph.known(b) is b


def test_the_negation_of_what_does_not_hold_does(graph: Graph, condition: Node) -> None:
    graph.assume(graph.make(ca.OP_NOT, (condition,)), 0.0)
    assert graph.known(condition) is graph.true


@pytest.mark.parametrize(("op", "value"), [(ca.OP_EQ, 1.0), (ca.OP_NE, 0.0)])
def test_what_equals_a_number_is_that_number(graph: Graph, x: Node, y: Node, op: int, value: float) -> None:
    graph.assume(graph.make(op, (x, graph.constant(3.0))), value)
    graph.assume(graph.make(op, (graph.constant(4.0), y)), value)
    assert is_constant(graph.known(x), 3.0)
    assert is_constant(graph.known(y), 4.0)


@pytest.mark.parametrize(("op", "value"), [(ca.OP_EQ, 0.0), (ca.OP_NE, 1.0)])
def test_what_differs_from_a_number_stays_open(graph: Graph, x: Node, op: int, value: float) -> None:
    graph.assume(graph.make(op, (x, graph.constant(3.0))), value)
    assert graph.known(x) is x


@pytest.mark.parametrize("taken", [0, 1])
def test_a_choice_that_is_not_the_other_number_is_the_one(
    graph: Graph, x: Node, condition: Node, taken: int
) -> None:
    # given c ? x : 2, or c ? 2 : x
    options = (graph.constant(2.0), x) if taken == 0 else (x, graph.constant(2.0))
    graph.assume_value(graph.select(condition, *options), 5.0)
    assert is_constant(graph.known(condition), float(taken))
    assert is_constant(graph.known(x), 5.0)


def test_a_choice_that_may_be_either_stays_open(graph: Graph, x: Node, condition: Node) -> None:
    graph.assume_value(graph.select(condition, x, graph.constant(2.0)), 2.0)
    assert graph.known(condition) is condition
    assert graph.known(x) is x


# Whatever is folded or assumed: the value stays

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


def test_no_operation_changes_its_value(graph: Graph, x: Node, y: Node, condition: Node) -> None:
    """All operations on leaves, constants, truths and choices, at all numbers, zeros with signs and NaN."""
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


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_no_assumption_changes_a_value_where_it_holds(value: float) -> None:
    """Of conditions two operations deep: what is then known is what it is. Leaves in logic are truths."""
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
        graph.assume(node, value)
        for a, b in product((0.0, 1.0) if op in logic else POSITIVE, repeat=2):
            leaves = {"x": a, "y": b}
            if evaluated(node, leaves) == value:
                for known in (x, y, condition, operand):
                    if bits(evaluated(graph.known(known), leaves)) != bits(evaluated(known, leaves)):
                        wrong.append((op, inner, a, b))
    assert wrong == []


def test_what_equals_zero_may_be_negative_zero(graph: Graph, x: Node) -> None:
    """So x may not be taken for 0.0, where its bits would matter: in y + x, or where it is kept."""
    graph.assume(graph.equal(x, 0.0), 1.0)
    assert graph.known(x) is x


# The ordinary ticks of the trial simulator


@pytest.fixture(scope="module")
def ticks() -> dict[Mode, Tick]:
    """The trial simulator's, by mode, for the outcome of trials at different thresholds."""
    batch = Batch(SYSTEMS["cts"], ["controller.moving_deviation"], ["controller.status"], STOP)
    found = batch.ticks((), RUNNING | STILL)
    return {Mode(int(tick.held["controller", "now"])): tick for tick in found}


def test_modes_that_last_have_a_tick_of_their_own(ticks: dict[Mode, Tick]) -> None:
    # in which a trial neither has not begun nor has ended
    ended = {Mode.IDLE, Mode.FAILURE_RECALL, Mode.SUCCESS, Mode.FAILED, Mode.STOPPED}
    assert set(ticks) == set(Mode) - ended


def test_a_mode_fixes_the_command(ticks: dict[Mode, Tick]) -> None:
    for mode, tick in ticks.items():
        assert tick.held["controller", "overruled"] == Anomaly.NONE
        assert tick.held["plant", "past_command"] == COMMANDS.get(mode, Command.NONE), mode


def test_what_a_tick_holds_it_neither_reads_nor_writes(ticks: dict[Mode, Tick]) -> None:
    for tick in ticks.values():
        assert not tick.held.keys() & (tick.reads | tick.writes)
        assert not tick.always_departs


def test_a_tick_reads_and_writes_what_its_mode_needs(ticks: dict[Mode, Tick]) -> None:
    motion = {("plant", n) for n in ("position_north", "position_east", "velocity", "body_heading")}
    for mode, tick in ticks.items():
        assert ("controller", "ticks") in tick.writes
        assert motion - {("plant", "body_heading")} <= tick.writes, mode
    # the threshold is each trial's own, and matters while the animal runs
    threshold = ("controller", "moving_deviation")
    assert threshold in ticks[Mode.FORWARD].reads
    assert threshold not in ticks[Mode.RECALL].reads
    # a turn takes its side's rate alone
    right, left = ("plant", "trial_right_rate"), ("plant", "trial_left_rate")
    assert (right in ticks[Mode.RIGHT].reads, left in ticks[Mode.RIGHT].reads) == (True, False)
    assert (right in ticks[Mode.LEFT].reads, left in ticks[Mode.LEFT].reads) == (False, True)
    # only on recall the animal turns home
    for mode, tick in ticks.items():
        assert (("plant", "start_north") in tick.reads | tick.common) is (mode is Mode.RECALL)


def test_what_happens_seldom_is_not_in_it(ticks: dict[Mode, Tick]) -> None:
    # no draw, no count of waypoints or turns, no latch
    seldom = {"obeys_right", "right_stream[1]", "reached", "turns", "issued", "now", "route_north[1]", "told"}
    for tick in ticks.values():
        assert not {name for _, name in tick.writes} & seldom
        assert tick.lines[-len(tick.writes) - 1].startswith("const bool departs = ")


def test_a_mode_takes_less_than_all_modes(ticks: dict[Mode, Tick]) -> None:
    batch = Batch(SYSTEMS["cts"], ["controller.moving_deviation"], ["controller.status"], STOP)
    own = frozenset({("controller", "moving_deviation")})
    keep = {c: batch.keep.get(c, frozenset()) for c in SYSTEMS["cts"].components}
    whole = ordinary_tick(
        BatchSystem(
            SYSTEMS["cts"], keep, own, RUNNING | STILL, (("controller", "status"), frozenset(STOP[1]))
        ),
        {},
    )
    assert max(tick.operations for tick in ticks.values()) < whole.operations
    # all modes at once hold nothing
    assert not whole.held
    assert ("plant", "past_command") in whole.writes


def test_a_trial_that_has_not_begun_waits_in_an_ordinary_tick_of_its_own() -> None:
    # given no start signal: nothing happens in mode IDLE
    batch = Batch(SYSTEMS["cts"], ["controller.moving_deviation"], ["controller.status"], STOP)
    idle = RUNNING | STILL | {("controller", "start"): 0.0}
    found = {int(tick.held["controller", "now"]): tick for tick in batch.ticks((), idle)}
    assert Mode.IDLE in found
    assert Mode.FORWARD not in found  # the mission ends there at once


def test_fields_are_named_by_component_and_variable() -> None:
    assert field_name(("controller", "route_north[3]")) == "controller_route_north_3"
