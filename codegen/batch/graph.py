"""A graph of expressions that is evaluated as far as it can be before any C is written (partial evaluation).

Each value is one node. An operation whose operands are known becomes a constant, and a choice whose
condition is known becomes the operand that it chooses. More becomes known by assumptions: `assume(condition,
False)` says that from here on the condition is false, and the graph concludes what it can about the
condition's operands.

A node that replaces another has the same bits for every input for which the assumptions hold. So x + 0 stays
(x may be -0.0), 0 * x stays (x may be infinite), and no sum is rearranged.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from functools import reduce

import casadi as ca

from codegen.blocks.nodes import LOGIC, SELECT, Node
from models.kit.declaration import Type

ARITHMETIC: dict[int, Callable[[float, float], float]] = {
    ca.OP_ADD: operator.add, ca.OP_SUB: operator.sub, ca.OP_MUL: operator.mul,
    ca.OP_LT: operator.lt, ca.OP_LE: operator.le, ca.OP_EQ: operator.eq, ca.OP_NE: operator.ne,
}  # fmt: skip


class Graph:
    """Makes nodes, each value once, and evaluates what is known.

    All values are doubles, as in a lane. A node whose `ctype` is "bool" is a condition, which C computes as
    a mask of the vector; used as a number it is a choice of 1.0 and 0.0.
    """

    def __init__(self) -> None:
        self._made: dict[tuple[object, ...], Node] = {}
        self._assumed: dict[Node, Node] = {}  # node -> the constant that it is assumed to be
        self._never_negative_zero: set[Node] = set()  # leaves that are Integers or Booleans
        self._zero_or_one: set[Node] = set()  # leaves that are Booleans
        self.true, self.false = self.constant(1.0), self.constant(0.0)

    def constant(self, value: float) -> Node:
        """A number; 0.0 and -0.0 are two."""
        return self._once(
            (ca.OP_CONST, value, math.copysign(1.0, value)), lambda: Node(ca.OP_CONST, value=value)
        )

    def leaf(self, text: str, type: Type = Type.REAL) -> Node:
        """A value that is read from memory, as C writes it."""
        node = self._once((ca.OP_INPUT, text), lambda: Node(ca.OP_INPUT, field=text))
        if type is not Type.REAL:
            self._never_negative_zero.add(node)
        if type is Type.BOOLEAN:
            self._zero_or_one.add(node)
        return node

    def make(self, op: int, operands: tuple[Node, ...]) -> Node:
        """The node of an operation: a constant or an operand if the result is known, else the operation."""
        operands = tuple(self.known(self.constant(a.value) if a.op == ca.OP_CONST else a) for a in operands)
        if op == SELECT:
            operands = operands[0], self.number(operands[1]), self.number(operands[2])
        elif op not in LOGIC:
            operands = tuple(map(self.number, operands))
        folded = self._folded(op, operands)
        return folded or self.known(self._once((op, *map(id, operands)), lambda: _in_doubles(op, operands)))

    def number(self, node: Node) -> Node:
        """A condition as the number 1.0 or 0.0: vectors are best at choosing between two constants."""
        return self.make(SELECT, (node, self.true, self.false)) if node.ctype == "bool" else node

    def known(self, node: Node) -> Node:
        """The constant that a node is assumed to be, or the node itself."""
        return self._assumed.get(node, node)

    def assume(self, condition: Node, holds: bool) -> None:
        """From here on the condition is true, or false; conclude what follows for its operands.

        A condition may be a number. It is false exactly when it equals 0.
        """
        operands = condition.operands
        if condition.ctype == "bool" or condition in self._zero_or_one:
            self._assumed[condition] = self.constant(float(holds))
        elif not holds:
            self.assume_value(condition, 0.0)
        if condition.op == ca.OP_NOT:
            self.assume(operands[0], not holds)
        elif condition.op == (ca.OP_AND if holds else ca.OP_OR):
            for operand in operands:
                self.assume(operand, holds)
        elif condition.op == (ca.OP_EQ if holds else ca.OP_NE):
            for operand, other in (operands, operands[::-1]):
                if other.op == ca.OP_CONST:
                    self.assume_value(operand, other.value)

    def assume_value(self, node: Node, value: float) -> None:
        """From here on the node equals this value; conclude what follows for its operands."""
        if node.ctype == "bool":
            if value in (0.0, 1.0):
                self.assume(node, bool(value))
            return
        # -0.0 equals 0.0 too: a node that may be either must not be replaced
        if node.op != ca.OP_CONST and (value or self._is_never_negative_zero(node)):
            self._assumed[node] = self.constant(value)
        if node.op == SELECT:
            condition, yes, no = node.operands
            for holds, chosen, other in ((True, yes, no), (False, no, yes)):
                if other.op == ca.OP_CONST and other.value != value:  # so the other was not chosen
                    self.assume(condition, holds)
                    self.assume_value(chosen, value)

    def select(self, condition: Node, yes: Node, no: Node) -> Node:
        """`yes` where the condition is true, else `no`."""
        return self.make(SELECT, (condition, yes, no))

    def any_of(self, *conditions: Node) -> Node:
        """Is one of the conditions true?"""
        return reduce(lambda a, b: self.make(ca.OP_OR, (a, b)), conditions, self.false)

    def all_of(self, *conditions: Node) -> Node:
        """Are all conditions true?"""
        return reduce(lambda a, b: self.make(ca.OP_AND, (a, b)), conditions, self.true)

    def equal(self, node: Node, value: float) -> Node:
        """Does the node equal this number?"""
        return self.make(ca.OP_EQ, (node, self.constant(value)))

    def _is_never_negative_zero(self, node: Node) -> bool:
        if node.op == SELECT:
            return all(map(self._is_never_negative_zero, node.operands[1:]))
        if node.op == ca.OP_CONST:
            return node.value != 0 or math.copysign(1.0, node.value) > 0
        return node.ctype == "bool" or node in self._never_negative_zero

    def _once(self, key: tuple[object, ...], make: Callable[[], Node]) -> Node:
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]

    def _folded(self, op: int, operands: tuple[Node, ...]) -> Node | None:
        """A simpler node with the same value, or None."""
        constant = [operand.op == ca.OP_CONST for operand in operands]
        if op in ARITHMETIC and all(constant):
            return self.constant(float(ARITHMETIC[op](operands[0].value, operands[1].value)))
        if op in (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL):
            return self._folded_into_choice(op, operands)
        if op == ca.OP_NOT and constant[0]:
            return self.constant(float(not operands[0].value))
        if op == SELECT:
            condition, yes, no = operands
            if constant[0]:
                return yes if condition.value else no
            return yes if yes is no else None
        if op in (ca.OP_AND, ca.OP_OR):
            return self._folded_logic(op, *operands)
        return None

    def _folded_into_choice(self, op: int, operands: tuple[Node, ...]) -> Node | None:
        """`k + (c ? a : b)`, all three of them constants, is `c ? k + a : k + b`; likewise - and *."""
        a, b = operands
        if b.op == ca.OP_CONST and _chooses_constants(a):
            return self.select(a.operands[0], *(self.make(op, (x, b)) for x in a.operands[1:]))
        if a.op == ca.OP_CONST and _chooses_constants(b):
            return self.select(b.operands[0], *(self.make(op, (a, x)) for x in b.operands[1:]))
        return None

    def _folded_logic(self, op: int, a: Node, b: Node) -> Node | None:
        """`and` or `or` with a constant, or of a condition with itself."""
        decisive = op == ca.OP_OR  # true or x is true, false and x is false
        for one, other in ((a, b), (b, a)):
            if one.op == ca.OP_CONST:
                if bool(one.value) is decisive:
                    return self.constant(float(decisive))
                return other if other.ctype == "bool" else self.make(ca.OP_NE, (other, self.false))
        return a if a is b and a.ctype == "bool" else None


def _chooses_constants(node: Node) -> bool:
    return node.op == SELECT and all(operand.op == ca.OP_CONST for operand in node.operands[1:])


def _in_doubles(op: int, operands: tuple[Node, ...]) -> Node:
    """An operation in doubles, also where the blocks' own C computes with integers."""
    node = Node(op, operands)
    if node.ctype != "bool":
        node.ctype = "real"
    return node
