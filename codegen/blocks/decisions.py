"""The rows of a state machine's mode as nested decisions: what several rows ask is asked once.

The first row whose guard holds is carried out. A guard asks questions, and holds if the answer to all is yes.
Rows at the end that share a question stand together behind one `if`:

    rest and near       ->  a               if (rest) {
    rest and late       ->  b                   if (near) { a } else if (late) { b }
                                            }

Rows in between that share a question do so too if the last of them asks no other: then one of them is carried
out, and no later row gets its turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from codegen.blocks.expressions import Writer, bare
from codegen.blocks.nodes import LOGIC, Node, behind, count_uses

Body = Callable[[], None]  # writes the body of a row


@dataclass(frozen=True)
class Row:
    """One row: the questions that its guard asks, what its body computes, and how the body is written."""

    questions: tuple[Node, ...]
    results: tuple[Node, ...]
    write: Body


@dataclass(frozen=True)
class Decision:
    """If the answer to all questions is yes: a row's body, or the first of more decisions that holds."""

    questions: tuple[Node, ...]
    then: Row | tuple[Decision, ...]

    def results(self) -> list[Node]:
        """What is computed once the questions are answered."""
        if isinstance(self.then, Row):
            return list(self.then.results)
        return [n for inner in self.then for n in (*inner.questions, *inner.results())]


def questions(guard: Node) -> tuple[Node, ...]:
    """The conditions that must all hold, each once, in order; none if the guard always holds."""
    if guard.op == ca.OP_AND:
        return tuple(dict.fromkeys((*questions(guard.operands[0]), *questions(guard.operands[1]))))
    return () if guard.op == ca.OP_CONST and guard.value else (guard,)


def decide(rows: Sequence[Row]) -> tuple[Decision, ...]:
    """The rows as decisions, of which the first that holds is carried out."""
    decisions: list[Decision] = []
    while rows:
        end, shared = _together(rows)
        group, rows = rows[:end], rows[end:]
        if len(group) > 1:
            inner = tuple(
                Row(tuple(q for q in row.questions if q not in shared), row.results, row.write)
                for row in group
            )
            decisions.append(Decision(shared, decide(inner)))
            continue
        decisions.append(_single(group[0], last=not rows))
        if not shared:  # it always holds
            break
    return tuple(decisions)


def _together(rows: Sequence[Row]) -> tuple[int, tuple[Node, ...]]:
    """How many rows from the first one on stand together, and the questions that they share."""
    best = 1, rows[0].questions
    shared = rows[0].questions
    for end in range(2, len(rows) + 1):
        shared = tuple(q for q in shared if q in rows[end - 1].questions)
        if shared and (end == len(rows) or len(rows[end - 1].questions) == len(shared)):
            best = end, shared
    return best


def _single(row: Row, last: bool) -> Decision:
    """One row; in the last row, a question that needs locals of its own is asked behind the others."""
    for k, question in enumerate(row.questions if last else ()):
        if k and _repeats(question):
            inner = Row(row.questions[k:], row.results, row.write)
            return Decision(row.questions[:k], (Decision(inner.questions, inner),))
    return Decision(row.questions, row)


def _repeats(question: Node) -> bool:
    """Does the question's text compute something twice?"""
    return any(times > 1 and _is_worth_a_local(node) for node, times in _occurrences([question]).items())


def write_decisions(decisions: Sequence[Decision], writer: Writer) -> None:
    """Write decisions: `if`, `else if`, `else`; before them the locals that they share."""
    shared = _shared(decisions)
    count_uses([operand for node in shared for operand in node.operands])
    for node in shared:
        node.uses = 2  # has a local
    for node in shared:
        if not node.name:
            writer.name(node, node.ctype)
    keyword = "if"
    for decision in decisions:
        if decision.questions:
            texts = [writer.write(q, "bool", locals_allowed=False) for q in decision.questions]
            text = bare(texts[0]) if len(texts) == 1 else " && ".join(texts)
            writer.lines.append(f"{keyword} ({text}) {{")
        elif keyword == "if":  # the only one, and it always holds
            _write_inside(decision, writer)
            return
        else:
            writer.lines.append("} else {")
        with writer.braces():
            _write_inside(decision, writer)
        keyword = "} else if"
    writer.lines.append("}")


def _write_inside(decision: Decision, writer: Writer) -> None:
    if isinstance(decision.then, Row):
        decision.then.write()
    else:
        write_decisions(decision.then, writer)


def _shared(decisions: Sequence[Decision]) -> list[Node]:
    """The nodes that get a local before the decisions, operands first.

    Such a node is used twice or more, and it is computed in any case when no decision holds. That is so on
    most ticks, and the local costs them nothing.
    """
    asked = [q for decision in decisions for q in decision.questions]
    always = {n for d in decisions if d.questions for n in _always(d.questions[0])}
    chosen: list[Node] = []
    while True:
        inside = [set(behind(decision.results(), chosen)) for decision in decisions]
        times = _occurrences([*asked, *(a for node in chosen for a in node.operands)], hidden=chosen)
        candidates = [
            node
            for node in behind(asked)
            if node in times
            and node in always
            and node not in chosen
            and _is_worth_a_local(node)
            and times[node] + sum(node in nodes for nodes in inside) > 1
        ]
        if not candidates:
            return [node for node in behind(asked) if node in chosen]
        covered = {inner for node in candidates for inner in behind(node.operands)}
        chosen += [node for node in candidates if node not in covered]


def _is_worth_a_local(node: Node) -> bool:
    """Is it an operation, and more than a negated field?"""
    trivial = node.op == ca.OP_NOT and not node.operands[0].operands
    return bool(node.operands) and not node.name and not trivial


def _occurrences(roots: Sequence[Node], hidden: Sequence[Node] = ()) -> dict[Node, int]:
    """How often the roots' texts compute each node; hidden nodes and locals are computed before."""
    order = behind(roots)
    times = dict.fromkeys(order, 0)
    for node in roots:
        times[node] += 1
    for node in reversed(order):
        for operand in () if node.name or node in hidden else node.printed_operands:
            times[operand] += times[node]
    return {node: n for node, n in times.items() if n}


def _always(question: Node) -> set[Node]:
    """The nodes that are computed whatever the answer: not those that `&&`, `||` and `?` may skip."""
    reached = {question}
    left = [question]
    while left:
        node = left.pop()
        skips = node.op != ca.OP_NOT and node.op in LOGIC
        certain = node.operands[:1] if skips or _chooses(node) else node.operands
        left += [operand for operand in certain if operand not in reached]
        reached.update(certain)
    return reached


def _chooses(node: Node) -> bool:
    return len(node.operands) == 3
