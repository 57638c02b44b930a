"""Mutants of models: comparisons, arithmetic, numbers, and the logic of models, which is made of calls.

Models say `all_of(a, b)` and `ca.logic_not(a)` where Python says `a and b` and `not a`. So an operand is left
out, a choice is made one way, an assignment or a row of a table is dropped, a named value becomes the next.
Declarations are left alone: tests/models/test_document.py compares them with the page.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from enum import IntEnum

from models.commands import Command, Status
from models.modes import Anomaly, Mode
from tests.mutants.mutant import Mutant, changed, distinct

COMPARISONS = {
    ast.Lt: ("<", "<=", ">="), ast.LtE: ("<=", "<", ">"), ast.Gt: (">", ">=", "<="),
    ast.GtE: (">=", ">", "<"), ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.Is: ("is", "is not"),
}  # fmt: skip
ARITHMETIC = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"), ast.Pow: ("**", "*"),
    ast.BitAnd: ("&", "|"),
}  # fmt: skip
OPPOSITES = {
    "all_of": "any_of", "any_of": "all_of", "one_of": "none_of", "none_of": "one_of", "at_least": "at_most",
    "at_most": "at_least",
}  # fmt: skip
JOINS = ("all_of", "any_of")
UNARY = ("logic_not", "fabs", "wrap", "floor")
ENUMERATIONS: dict[str, type[IntEnum]] = {e.__name__: e for e in (Mode, Command, Status, Anomaly)}

Change = tuple[int, int, str]


class _Text:
    """A source and the places of its nodes."""

    def __init__(self, source: str) -> None:
        self.source, self.lines = source, source.split("\n")
        self.starts = [0]
        for line in self.lines:
            self.starts.append(self.starts[-1] + len(line) + 1)

    def _place(self, line: int, column: int) -> int:
        return self.starts[line - 1] + len(self.lines[line - 1].encode()[:column].decode())

    def span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        """Where a node begins and ends."""
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._place(node.lineno, node.col_offset), self._place(node.end_lineno, node.end_col_offset)

    def of(self, node: ast.expr | ast.stmt) -> str:
        """A node's text."""
        start, end = self.span(node)
        return self.source[start:end]

    def between(self, left: ast.expr, right: ast.expr, old: str, new: str) -> Change:
        """The operator between two nodes becomes another."""
        start = self.source.index(old, self.span(left)[1], self.span(right)[0])
        return start, start + len(old), new


def mutants(file: str, source: str) -> list[Mutant]:
    """The mutants of a model's file."""
    text = _Text(source)
    changes = (change for node in _equations(ast.parse(source)) for change in _changes(text, node))
    return distinct(changed(file, source, *change) for change in changes)


def _equations(module: ast.Module) -> Iterator[ast.AST]:
    """What computes, and does not declare: bodies of functions, the conditions in decorators, constants."""
    for node in ast.walk(module):
        if isinstance(node, ast.FunctionDef):
            for statement in node.body:
                yield from ast.walk(statement)
            for decorator in node.decorator_list:
                for part in ast.walk(decorator):
                    if isinstance(part, ast.Lambda):
                        yield from ast.walk(part.body)
    for constant in module.body:
        if isinstance(constant, ast.Assign):
            yield from ast.walk(constant.value)


def _changes(text: _Text, node: ast.AST) -> Iterator[Change]:
    """The changes at a node."""
    if isinstance(node, ast.Compare):
        for left, op, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            old, *others = COMPARISONS.get(type(op), ("",))
            for new in others:
                yield text.between(left, right, old, new)
    elif isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC:
        yield text.between(node.left, node.right, *ARITHMETIC[type(node.op)])
    elif isinstance(node, ast.UnaryOp):
        yield *text.span(node), text.of(node.operand)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        for other in (node.value + 1, node.value - 1):
            yield *text.span(node), f"({other!r})" if other < 0 else repr(other)
    elif isinstance(node, ast.Call):
        yield from _of_call(text, node)
    elif isinstance(node, ast.Attribute):
        yield from _next_value(text, node)
    elif isinstance(node, ast.Dict):
        for key, value in zip(node.keys, node.values, strict=True):
            if key is not None:
                end = text.span(value)[1]
                yield text.span(key)[0], end + text.source[end:].startswith(","), ""
    elif isinstance(node, ast.Assign) and "m." in ",".join(map(text.of, node.targets)):
        yield *text.span(node), "pass"
    elif isinstance(node, ast.Yield | ast.YieldFrom):
        yield *text.span(node), "yield from ()"


def _of_call(text: _Text, node: ast.Call) -> Iterator[Change]:
    """A joint with the other's name, or without one operand; a choice made one way; a function left out."""
    function = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    arguments = [text.of(argument) for argument in node.args]
    start, end = text.span(node)
    if function in OPPOSITES:
        yield *text.span(node.func), OPPOSITES[function]
    if function in JOINS and len(arguments) > 1:
        for left_out in range(len(arguments)):
            rest = ", ".join(a for k, a in enumerate(arguments) if k != left_out)
            yield start, end, f"{function}({rest})"
    elif function == "where" and len(arguments) == 3:
        for choice in arguments[1:]:
            yield start, end, f"ca.SX({choice})"
    elif function in UNARY and len(arguments) == 1:
        yield start, end, f"({arguments[0]})"


def _next_value(text: _Text, node: ast.Attribute) -> Iterator[Change]:
    """Mode.LEFT becomes Mode.RIGHT, the last member the first."""
    enumeration = ENUMERATIONS.get(getattr(node.value, "id", ""))
    if enumeration is not None and node.attr in enumeration.__members__:
        members = list(enumeration)
        other = members[(enumeration[node.attr] + 1) % len(members)]
        yield *text.span(node), f"{enumeration.__name__}.{other.name}"
