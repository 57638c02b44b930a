"""Rows of a state machine as nested decisions: the same row is carried out, by fewer questions."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
from hypothesis import given
from hypothesis import strategies as st

from codegen.blocks.decisions import Decision, Row, decide, questions, write_decisions
from codegen.blocks.expressions import Writer
from codegen.blocks.nodes import Node, Nodes

NAMES = "abcd"
NODES = {name: Node(ca.OP_LT, (Node(ca.OP_INPUT, field=name), Node(ca.OP_CONST))) for name in NAMES}


def rows(*asked: str) -> list[Row]:
    """A row for each text, which asks the questions of its letters."""
    return [Row(tuple(NODES[name] for name in text), (), lambda: None) for text in asked]


def shape(decisions: Sequence[Decision], all_rows: Sequence[Row]) -> list[object]:
    """The decisions as (questions, number of the row, or the decisions inside)."""
    names = {node: name for name, node in NODES.items()}
    bodies = {id(row.write): k for k, row in enumerate(all_rows)}
    return [
        (
            "".join(names[q] for q in d.questions),
            bodies[id(d.then.write)] if isinstance(d.then, Row) else shape(d.then, all_rows),
        )
        for d in decisions
    ]


def carried_out(decisions: Sequence[Decision], answers: set[Node]) -> Row | None:
    """The row that C carries out, given the questions whose answer is yes."""
    for decision in decisions:
        if answers.issuperset(decision.questions):
            return decision.then if isinstance(decision.then, Row) else carried_out(decision.then, answers)
    return None


def test_rows_at_the_end_that_share_a_question_stand_behind_it() -> None:
    table = rows("a", "bc", "bd", "b")
    assert shape(decide(table), table) == [("a", 0), ("b", [("c", 1), ("d", 2), ("", 3)])]


def test_rows_in_between_stand_together_only_if_one_of_them_is_carried_out() -> None:
    # given two rows that share b and a third that does not
    open_ended, closed = rows("bc", "bd", "a"), rows("bc", "b", "a")
    # then they stand together only if the second asks nothing else
    assert shape(decide(open_ended), open_ended) == [("bc", 0), ("bd", 1), ("a", 2)]
    assert shape(decide(closed), closed) == [("b", [("c", 0), ("", 1)]), ("a", 2)]


def test_a_row_that_always_holds_is_the_last() -> None:
    table = rows("a", "", "b")
    assert shape(decide(table), table) == [("a", 0), ("", 1)]


@given(
    st.lists(st.sets(st.sampled_from(NAMES)).map(lambda names: "".join(sorted(names))), max_size=8),
    st.sets(st.sampled_from(NAMES)),
)
def test_the_first_row_whose_guard_holds_is_carried_out(asked: list[str], yes: set[str]) -> None:
    table = rows(*asked)
    row = carried_out(decide(table), {NODES[name] for name in yes})
    expected = next((k for k, text in enumerate(asked) if yes.issuperset(text)), None)
    assert (None if row is None else [id(r.write) for r in table].index(id(row.write))) == expected


def test_a_guard_asks_each_question_once_in_order() -> None:
    nodes = Nodes()
    a, b = (NODES[name] for name in "ab")
    both = nodes.make(ca.OP_AND, (a, b))
    assert questions(nodes.make(ca.OP_AND, (both, a))) == (a, b)
    assert questions(nodes.constant(1.0)) == ()
    assert questions(nodes.constant(0.0)) == (nodes.constant(0.0),)


def less(nodes: Nodes, left: Node, right: str) -> Node:
    return nodes.make(
        ca.OP_LT, (left, nodes.leaf(lambda _, i: Node(ca.OP_INPUT, field=right))(0, ord(right)))
    )


def printed(table: Sequence[tuple[Node, ...]]) -> list[str]:
    """The C of rows whose bodies are their numbers."""
    writer = Writer("double")

    def row(number: int, asked: tuple[Node, ...]) -> Row:
        return Row(asked, (), lambda: writer.lines.append(f"{number};"))

    write_decisions(decide([row(k, asked) for k, asked in enumerate(table)]), writer)
    return writer.lines


def test_what_two_rows_compute_in_any_case_is_computed_once_before() -> None:
    nodes = Nodes()
    size = nodes.make(ca.OP_FABS, (Node(ca.OP_INPUT, field="x"),))
    assert printed([(less(nodes, size, "p"),), (less(nodes, size, "q"),)]) == [
        "const double t0 = fabs(x);",
        "if (t0 < p) {",
        "    0;",
        "} else if (t0 < q) {",
        "    1;",
        "}",
    ]


def test_what_a_question_before_it_may_skip_is_not_computed_before() -> None:
    # given a square root that each row needs only if another question is answered by yes
    nodes = Nodes()
    root = nodes.make(ca.OP_SQRT, (Node(ca.OP_INPUT, field="x"),))
    lines = printed([(NODES["a"], less(nodes, root, "p")), (NODES["b"], less(nodes, root, "q"))])
    # then it stands behind that question
    assert lines[0] == "if ((a < 0.0) && (sqrt(x) < p)) {"
    assert "} else if ((b < 0.0) && (sqrt(x) < q)) {" in lines


def test_the_last_rows_question_with_locals_of_its_own_is_asked_behind_the_others() -> None:
    # given a question about (x + y) squared behind another
    nodes = Nodes()
    total = nodes.make(ca.OP_ADD, (Node(ca.OP_INPUT, field="x"), Node(ca.OP_INPUT, field="y")))
    assert printed([(NODES["a"], less(nodes, nodes.make(ca.OP_SQ, (total,)), "p"))]) == [
        "if (a < 0.0) {",
        "    const double t0 = x + y;",
        "    if ((t0 * t0) < p) {",
        "        0;",
        "    }",
        "}",
    ]
