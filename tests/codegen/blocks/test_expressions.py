"""CasADi instructions to C expressions: what is printed for each kind of node."""

from __future__ import annotations

import enum
import inspect
import math
import struct
import sys
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen.blocks.block_c import generate
from codegen.blocks.expressions import Writer, c_name, fields, literal
from codegen.blocks.nodes import read
from codegen.blocks.statements import condition, statements
from models.errors import DeclarationError
from models.kit.block import Block
from models.kit.declaration import Boolean, Input, Integer, Output, Parameter, State, Variable
from models.kit.tracing import GROUPS


class Colour(enum.IntEnum):
    """Its colour."""

    RED = 0
    GREEN = 1


class Sample(Block):
    """One variable of each type."""

    x = Input("m", "a real")
    n = Input(Integer, "an integer")
    on = Input(Boolean, "a Boolean")
    colour = Input(Colour, "an enumeration")
    gain = Parameter("1", "a vector", start=1, size=3)
    memory = State("m", "a vector", size=2)
    count = State(Integer, "an integer")
    shown = State(Colour, "an enumeration")
    y = Output("m", "a real")

    def output(m) -> None:
        """Set the output."""
        m.y = m.x


def traced(expression: Any) -> Any:
    """A function as a block's tracing makes them: `expression(m)` with m's variables as symbols."""
    groups = [Sample.group(kind) for kind in GROUPS]
    symbols = {v.name: ca.SX.sym(v.name, v.width) for group in groups for v in group}
    m = Sample(symbols, set())
    arguments = [ca.vertcat(*(symbols[v.name] for v in group)) for group in groups]
    return ca.Function("f", arguments, [ca.vertcat(expression(m))])


def writer(precision: Any = "double") -> Writer:
    def enum_name(variable: Variable, value: int) -> str:
        assert variable.choices
        return f"COLOUR_{variable.choices(value).name}"

    return Writer(precision, enum_name)


def printed(expression: Any, precision: Any = "double", target: str = "y") -> list[str]:
    return statements(traced(expression), Sample, [target], writer(precision))[0]


@pytest.mark.parametrize(
    ("value", "precision", "text"),
    [
        (0.1, "double", "0.1"),
        (2.0, "double", "2.0"),
        (1e22, "double", "1e+22"),
        (-0.5, "double", "-0.5"),
        (0.1, "float", "0.1f"),
        (2.0, "float", "2.0f"),
        (math.pi, "float", "3.1415927f"),
        (16777217.0, "float", "1.6777216e+07f"),
        (1e-45, "float", "1e-45f"),
    ],
)
def test_a_literal_is_the_shortest_of_its_precision(value: float, precision: Any, text: str) -> None:
    assert literal(value, precision) == text


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_double_literal_reads_back_bit_for_bit(value: float) -> None:
    assert struct.pack("d", float(literal(value, "double"))) == struct.pack("d", value)


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_a_float_literal_reads_back_bit_for_bit_and_is_no_longer_than_needed(value: float) -> None:
    text = literal(value, "float")
    assert text.endswith("f")
    assert struct.pack("f", float(text[:-1])) == struct.pack("f", value)
    digits = len(text.partition("e")[0].rstrip("f").replace(".0", "").replace(".", "").strip("-0"))
    if digits > 1:
        assert np.float32(f"{value:.{digits - 2}e}") != np.float32(value)


def test_if_else_is_a_conditional() -> None:
    assert printed(lambda m: ca.if_else(m.x > 2, m.x, 3)) == ["m->out.y = (m->in.x > 2.0) ? m->in.x : 3.0;"]


def test_if_else_with_a_zero_branch_is_a_conditional() -> None:
    assert printed(lambda m: ca.if_else(m.on, m.x, 0)) == ["m->out.y = m->in.on ? m->in.x : 0.0;"]


def test_if_else_of_two_variables_is_one_conditional_and_no_sum() -> None:
    (line,) = printed(lambda m: ca.if_else(m.on, m.x, m.gain[0]))
    assert line.count("?") == 1
    assert "+" not in line


def test_sums_that_only_look_like_if_else_stay_sums() -> None:
    # (on ? x : 0) + (!(n < 1) ? x : 0): two different conditions
    (line,) = printed(lambda m: ca.if_else(m.on, m.x, 0) + ca.if_else(m.n < 1, 0, m.x))
    assert line.count("?") == 2
    assert "+" in line


def test_integers_are_computed_as_integers() -> None:
    assert printed(lambda m: m.count + 1, target="count") == ["m->state.count = m->state.count + 1;"]
    (line,) = printed(lambda m: m.n * 0.5)
    assert line == "m->out.y = 0.5 * (double)m->in.n;"
    (line,) = printed(lambda m: ca.if_else(m.n < 3, 1, 2), target="count")
    assert line == "m->state.count = (m->in.n < 3) ? 1 : 2;"


def test_an_integer_compared_with_a_fraction_is_compared_as_a_real() -> None:
    (line,) = printed(lambda m: ca.if_else(m.n < 2.5, m.x, 0))
    assert "((double)m->in.n < 2.5)" in line


def test_conditions_in_float_have_suffixed_literals_and_calls() -> None:
    (line,) = printed(lambda m: ca.if_else(ca.logic_and(m.on, m.x < 0.1), ca.sqrt(m.x), 0), "float")
    assert line == "m->out.y = (m->in.on && (m->in.x < 0.1f)) ? sqrtf(m->in.x) : 0.0f;"


def test_library_calls_are_those_of_the_precision() -> None:
    assert printed(lambda m: ca.floor(m.x)) == ["m->out.y = floor(m->in.x);"]
    assert printed(lambda m: ca.fabs(m.x), "float") == ["m->out.y = fabsf(m->in.x);"]


def test_enumerations_are_compared_and_assigned_by_name() -> None:
    assert printed(lambda m: ca.if_else(m.colour == Colour.GREEN, m.x, 0)) == [
        "m->out.y = (m->in.colour == COLOUR_GREEN) ? m->in.x : 0.0;"
    ]
    assert printed(lambda m: ca.SX(Colour.GREEN), target="shown") == ["m->state.shown = COLOUR_GREEN;"]


@pytest.mark.parametrize("value", [7, -1, 0.5])
def test_an_enumeration_compared_with_a_number_outside_of_it_is_compared_with_the_number(
    value: float,
) -> None:
    (line,) = printed(lambda m: ca.if_else(m.colour > value, m.x, 0))
    assert "COLOUR" not in line
    assert str(value).lstrip("-") in line


def test_indices_count_from_1_in_names_and_from_0_in_c() -> None:
    assert c_name("waypoint_north[1]") == "waypoint_north[0]"
    assert c_name("waypoint_north[16]") == "waypoint_north[15]"
    assert c_name("speed") == "speed"
    assert printed(lambda m: m.gain[2] + m.memory[0]) == ["m->out.y = m->par.gain[2] + m->state.memory[0];"]


def test_a_result_that_reads_a_field_stored_before_it_gets_a_local() -> None:
    # given a swap, when it is printed, then the second result is read before the first is stored
    lines, _ = statements(
        traced(lambda m: ca.vertcat(m.memory[1], m.memory[0])), Sample, ["memory[1]", "memory[2]"], writer()
    )
    assert lines == [
        "const double next_memory_2 = m->state.memory[0];",
        "m->state.memory[0] = m->state.memory[1];",
        "m->state.memory[1] = next_memory_2;",
    ]


def test_a_value_used_twice_gets_one_local() -> None:
    lines = printed(lambda m: ca.sqrt(m.x + 1) * ca.fabs(ca.sqrt(m.x + 1)))
    assert sum("sqrt(" in line for line in lines) == 1


@pytest.mark.parametrize("links", [400, 5000])
def test_a_chain_of_operations_may_be_longer_than_python_calls_are_deep(links: int) -> None:
    # given x halved and raised by x, over and over
    def chain(m: Any) -> Any:
        value = m.x
        for _ in range(links):
            value = 0.5 * value + m.x
        return value

    function = traced(chain)
    # when it is written
    lines, operations = statements(function, Sample, ["y"], writer())
    # then no line is long, and the lines, read as Python, give the traced function's bits
    assert operations == 2 * links
    assert max(map(len, lines)) < 140
    script = "\n".join(line.removeprefix("const double ") for line in lines)
    values: dict[str, float] = {}
    exec(script.replace("m->in.x", "1.1").replace("m->out.y", "y").replace(";", ""), values)
    inputs = [1.1 if name == "x" else 0.0 for name in Sample.flat_names("input")]
    blank = [[0.0] * len(Sample.flat_names(kind)) for kind in GROUPS]
    blank[GROUPS.index("input")] = inputs
    assert values["y"] == float(function(*blank))


def test_a_chain_of_choices_may_be_longer_than_python_calls_are_deep() -> None:
    # given 500 choices, and calls that reach 300 deeper than this one
    def chain(m: Any) -> Any:
        value = ca.SX(Colour.RED)
        for limit in range(500):
            value = ca.if_else(m.x > limit, Colour.GREEN if limit % 2 else Colour.RED, value)
        return value

    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(len(inspect.stack(0)) + 300)
    try:
        lines = printed(chain, target="shown")
    finally:
        sys.setrecursionlimit(limit)
    # then all are written, but for the first: it is between RED and RED
    assert sum(line.count("?") for line in lines) == 499
    assert sum(line.count("COLOUR_GREEN") for line in lines) == 250


def test_a_product_and_a_sum_are_two_operations() -> None:
    assert read(traced(lambda m: m.x * 3 + 1), fields(Sample))[1] == 2


def test_a_guard_is_one_condition() -> None:
    text, operations = condition(traced(lambda m: ca.logic_and(m.on, m.n > 2)), Sample, writer())
    assert text == "m->in.on && (m->in.n > 2)"
    assert operations == 2


def test_an_operation_without_c_is_refused() -> None:
    with pytest.raises(DeclarationError, match=r"^f: operation \d+ has no C without a library$"):
        read(traced(lambda m: ca.exp(m.x)), fields(Sample))


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_a_constant_that_c_cannot_write_is_refused(value: float) -> None:
    with pytest.raises(DeclarationError, match=r"^f: constant (-?inf|nan) has no C literal$"):
        printed(lambda m: ca.if_else(m.on, m.x, value))


def test_a_constant_too_large_for_float_is_refused_in_float_and_printed_in_double() -> None:
    assert "1e+300" in printed(lambda m: m.x * 1e300)[0]
    with pytest.raises(DeclarationError, match=r"1e\+300"):
        printed(lambda m: m.x * 1e300, "float")


def test_the_sample_blocks_output_is_in_its_c() -> None:
    assert "m->out.y = m->in.x;" in generate(Sample)["sample.c"]


class Route(Block):
    """Vectors, and an index into one."""

    wish = Parameter("m", "a vector", start=0, size=6)
    other = Parameter("m", "a vector", start=0, size=6)
    latched = State("m", "a copy", size=6)
    too = State("m", "a copy", size=6)
    doubled = State("m", "twice a copy", size=6)
    index = State(Integer, "which element")
    chosen = State("m", "that element")

    def double(m) -> None:
        m.doubled = 2 * m.latched
        m.latched = m.wish

    def copy(m) -> None:
        m.latched, m.too = m.wish, m.other

    def choose(m) -> None:
        value = m.latched[0]
        for i in range(1, 6):
            value = ca.if_else(m.index == i, m.latched[i], value)
        m.chosen = value


def body(update: str) -> str:
    """The lines of an update of Route, joined."""
    text = generate(Route)["route.c"].split(f"route_{update}(route *m)\n{{")[1].split("\n}\n")[0]
    return " ".join(text.split())


def test_vectors_are_copied_in_a_loop() -> None:
    assert body("copy") == (
        "for (int i = 0; i < 6; i++) "
        "{ m->state.latched[i] = m->par.wish[i]; m->state.too[i] = m->par.other[i]; }"
    )


def test_loops_are_not_joined_if_one_reads_what_the_other_stores() -> None:
    assert body("double") == (
        "for (int i = 0; i < 6; i++) { m->state.doubled[i] = 2.0 * m->state.latched[i]; } "
        "for (int i = 0; i < 6; i++) { m->state.latched[i] = m->par.wish[i]; }"
    )


class Fruit(enum.IntEnum):
    """What it bears."""

    NOTHING = 0
    APPLES = 1
    PEARS = 2
    PLUMS = 3
    QUINCES = 4


class Orchard(Block):
    """Counts by named values."""

    fruit = Input(Fruit, "what is picked", start=0)
    trees = State(Integer, "of each kind", size=4)
    odd = State(Integer, "in another order", size=4)
    kinds = State(Integer, "of each kind, of none first", size=5)

    def pick(m) -> None:
        m.trees = ca.vertcat(*(m.trees[f - 1] + (m.fruit == f) for f in list(Fruit)[1:]))

    def pick_any(m) -> None:
        m.kinds = ca.vertcat(*(m.kinds[f] + (m.fruit == f) for f in Fruit))

    def shuffle(m) -> None:
        m.odd = ca.vertcat(*(m.odd[i] + (m.fruit == f) for i, f in enumerate((1, 3, 2, 4))))


def test_named_values_that_count_on_with_the_elements_are_counted_in_a_loop() -> None:
    text = generate(Orchard)["orchard.c"]
    assert "m->state.trees[i] = m->state.trees[i] + (int32_t)(m->in.fruit == (i + 1));" in text
    assert "m->state.kinds[i] = m->state.kinds[i] + (int32_t)(m->in.fruit == i);" in text
    # and others are not
    assert "m->state.odd[1] = m->state.odd[1] + (int32_t)(m->in.fruit == ORCHARD_FRUIT_PLUMS);" in text


def test_an_element_is_chosen_by_a_checked_index() -> None:
    assert body("choose") == (
        "m->state.chosen = "
        "m->state.latched[((m->state.index >= 1) && (m->state.index < 6)) ? m->state.index : 0];"
    )


def test_a_chain_that_leaves_out_an_element_stays_a_chain() -> None:
    # given gain[2] if n == 2, else gain[0]: gain[1] is never chosen
    (line,) = printed(lambda m: ca.if_else(m.n == 2, m.gain[2], m.gain[0]))
    assert line == "m->out.y = (m->in.n == 2) ? m->par.gain[2] : m->par.gain[0];"


def test_a_choice_between_named_values_compared_with_an_enumeration_has_their_names() -> None:
    (line,) = printed(lambda m: ca.if_else(m.colour == ca.if_else(m.on, 1, 0), m.x, 0))
    assert line == "m->out.y = (m->in.colour == (m->in.on ? COLOUR_GREEN : COLOUR_RED)) ? m->in.x : 0.0;"


def test_what_changes_stands_left_of_a_parameter_it_is_compared_with() -> None:
    (line,) = printed(lambda m: ca.if_else(2 * m.gain[0] < m.x, m.x, 0))
    assert line == "m->out.y = (m->in.x > (2.0 * m->par.gain[0])) ? m->in.x : 0.0;"


def test_a_choice_of_a_choice_with_the_same_condition_is_one_choice() -> None:
    (line,) = printed(lambda m: ca.if_else(m.on, ca.if_else(m.on, m.x, 1), 2))
    assert line == "m->out.y = m->in.on ? m->in.x : 2.0;"


class Counts(Block):
    """Whole numbers that fit 16 bits, and others."""

    precisions = ("double", "float")

    asked = Input(Integer, "set by others", min=0, max=10)
    limit = Parameter(Integer, "set by others", start=3, min=0, max=1000)
    few = State(Integer, "up to 30,000", min=0, max=30_000)
    many = State(Integer, "up to 32,767", min=0, max=32_767)
    open = State(Integer, "without a max", min=0)
    on = State(Boolean, "a Boolean")
    part = State("1", "a real")


def counts(expression: Any, target: str = "few", precision: Any = "float") -> list[str]:
    """The C that sets a state of Counts to an expression of its variables."""

    class Sum(Counts):
        """Counts with an update."""

        def add(m) -> None:
            """Set one."""
            setattr(m, target, expression(m))

    text = generate(Sum, precision)["sum.c"]
    return [line.strip() for line in text.split("static void sum_add")[1].split("}")[0].splitlines()[2:]]


def test_whole_numbers_whose_range_fits_have_16_bits_in_float_alone() -> None:
    class Held(Counts):
        """Counts that stay."""

        def stay(m) -> None:
            """Nothing changes."""
            m.part = 0

    def types(precision: Any) -> list[str]:
        header = generate(Held, precision)["held.h"]
        return [line.split()[0] for line in header.splitlines() if "_t " in line]

    assert types("float") == ["int16_t", "int16_t", "int32_t", "int16_t", "int16_t"]
    assert types("double") == ["int32_t"] * 5


@pytest.mark.parametrize(
    ("expression", "target", "line"),
    [
        (lambda m: m.few + 1, "few", "m->state.few = (int16_t)(m->state.few + 1);"),
        (lambda m: m.few + m.on, "few", "m->state.few = (int16_t)(m->state.few + (int16_t)m->state.on);"),
        # a number of 32 bits has room for a sum that may leave 16
        (lambda m: m.many + 1, "open", "m->state.open = (int32_t)m->state.many + 1;"),
        (lambda m: m.few + m.many, "open", "m->state.open = (int32_t)m->state.few + (int32_t)m->state.many;"),
        (lambda m: m.few + m.open, "open", "m->state.open = (int32_t)m->state.few + m->state.open;"),
        # what others set may have any value of its type
        (lambda m: m.asked - 1, "open", "m->state.open = (int32_t)m->in.asked - 1;"),
        (lambda m: m.limit - 1, "open", "m->state.open = (int32_t)m->par.limit - 1;"),
        (lambda m: -m.few, "open", "m->state.open = -(int32_t)m->state.few;"),
        (lambda m: m.few < m.limit, "on", "m->state.on = m->state.few < m->par.limit;"),
        (lambda m: m.few < 40_000, "on", "m->state.on = (int32_t)m->state.few < 40000;"),
        (lambda m: m.few < m.open, "on", "m->state.on = (int32_t)m->state.few < m->state.open;"),
        (lambda m: m.few + 1 < m.many, "on", "m->state.on = (int16_t)(m->state.few + 1) < m->state.many;"),
        (lambda m: m.many + 1 < 5, "on", "m->state.on = ((int32_t)m->state.many + 1) < 5;"),
        (lambda m: 0.5 * m.few, "part", "m->state.part = 0.5f * (float)m->state.few;"),
    ],
)
def test_a_whole_number_is_computed_in_16_bits_where_it_cannot_leave_them(
    expression: Any, target: str, line: str
) -> None:
    assert counts(expression, target) == [line]


@pytest.mark.parametrize(
    ("expression", "target", "range_"),
    [
        (lambda m: m.many + 1, "many", "1 to 32768"),
        (lambda m: m.few + m.many, "few", "0 to 62767"),
        (lambda m: m.asked + 1, "few", "-32767 to 32768"),
        (lambda m: m.open + 1, "few", "any number of 32 bits"),
        (lambda m: ca.if_else(m.on, 2e9, m.few), "few", "0 to 2e\\+09"),
    ],
)
def test_what_may_leave_the_16_bits_of_its_variable_is_refused(
    expression: Any, target: str, range_: str
) -> None:
    with pytest.raises(
        DeclarationError, match=f"^sum: {target} can become {range_}; expected -32768 to 32767"
    ):
        counts(expression, target)
    # in double all have 32 bits
    assert counts(expression, target, "double")
