"""Traced functions as graphs of nodes: operations on other nodes, down to fields and constants.

A node is made once and used wherever its value is needed. What prints C starts from these graphs.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any, Literal

import casadi as ca

from models.errors import DeclarationError
from models.kit.declaration import Type, Variable
from models.kit.elementary import Precision

CType = Literal["real", "int", "short", "bool", "constant"]
CTYPES: dict[Type, CType] = {Type.REAL: "real", Type.INTEGER: "int", Type.BOOLEAN: "bool"}
SHORT = (-(2.0**15), 2.0**15 - 1)  # what an int16_t holds
UNLIMITED = (-math.inf, math.inf)
COMPARISONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE)
LOGIC = (ca.OP_AND, ca.OP_OR, ca.OP_NOT)
SELECT = -1  # c ? a : b, for which CasADi has no instruction
ELEMENT = -2  # v[i], for which CasADi has none either
PRINTED = {
    SELECT, *COMPARISONS, *LOGIC, ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_NEG, ca.OP_SQ,
    ca.OP_TWICE, ca.OP_INV, ca.OP_SQRT, ca.OP_FLOOR, ca.OP_FABS,
}  # fmt: skip
SHORTEST_VECTOR = 4  # choices between fewer elements than this stay choices


def ctype_of(variable: Variable, precision: Precision) -> CType:
    """What C holds a variable as.

    In float, which is for small processors, a whole number has 16 bits if its declared range lies within 0
    and 32767.
    """
    is_short = (
        precision == "float"
        and variable.type is Type.INTEGER
        and variable.min is not None
        and variable.max is not None
        and 0 <= variable.min <= variable.max <= SHORT[1]
    )
    return "short" if is_short else CTYPES[variable.type]


class Node:
    """One value: an operation on other nodes, a field of the block's struct, or a constant.

    Whole numbers are computed in 16 bits only where no operand can make the result leave them. So a processor
    whose int has 16 bits computes what the others do: none of its operations overflows where theirs do not.

    Attributes:
        ctype: what C computes it as; `constant`: made of constants alone, it takes the type of its use.
        range: of a whole number, what it can be while states and outputs keep their declared ranges; inputs
            and parameters, which others set, can be all that their type holds.
        field: where it is read, as C writes it; of an ELEMENT, the vector.
        uses: by how many operands and results it is used in what is being printed.
        name: of the local that holds it, "" while there is none.
        hint: what a local that holds it should be called, "" for a number.
        held_as: the type of that local.
        steadiness: 2 of a constant, 1 of what parameters alone decide, 0 of what changes from tick to tick.
        enumeration: the variable whose named values it takes, if any.
    """

    def __init__(
        self,
        op: int,
        operands: tuple[Node, ...] = (),
        value: float = 0.0,
        field: str = "",
        variable: Variable | None = None,
        *,
        ctype: CType | None = None,
    ) -> None:
        self.op, self.operands, self.value, self.field = op, operands, value, field
        self.variable = variable
        self.ctype = ctype or (CTYPES[variable.type] if variable is not None else "real")
        self.range = self._range()
        if variable is None:
            self.ctype = self._ctype()
        self.uses = 0
        self.name = self.hint = ""
        self.held_as: CType = "real"
        is_parameter = variable is not None and variable.kind == "parameter"
        leaf = 2 if op == ca.OP_CONST else int(is_parameter)
        self.steadiness: int = min((operand.steadiness for operand in operands), default=leaf)
        self.enumeration = variable if variable is not None and variable.choices else None

    def _ctype(self) -> CType:
        if self.op == ca.OP_CONST:
            return "constant" if self.value == int(self.value) and abs(self.value) < 2**31 else "real"
        if self.op in COMPARISONS or self.op in LOGIC:
            return "bool"
        if self.op in (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_NEG, SELECT):
            values = self.operands[1:] if self.op == SELECT else self.operands
            ctypes = {operand.ctype for operand in values}
            if ctypes == {"constant"}:
                return "constant" if self.op == SELECT else "real"
            if "real" in ctypes:
                return "real"
            return "short" if self.is_short and "short" in ctypes and "int" not in ctypes else "int"
        return "real"

    def _range(self) -> tuple[float, float]:
        if self.op == ca.OP_CONST:
            return self.value, self.value
        if self.variable is not None:
            low, high = self.variable.min, self.variable.max
            if self.ctype != "short" or low is None or high is None:
                return (0.0, 1.0) if self.ctype == "bool" else UNLIMITED
            return (low, high) if self.variable.kind in ("state", "output") else SHORT
        if self.op in COMPARISONS or self.op in LOGIC:
            return 0.0, 1.0
        if self.op == SELECT:
            _, yes, no = (operand.range for operand in self.operands)
            return min(yes[0], no[0]), max(yes[1], no[1])
        if self.op in (ca.OP_ADD, ca.OP_SUB):
            a, b = (operand.range for operand in self.operands)
            return (a[0] + b[0], a[1] + b[1]) if self.op == ca.OP_ADD else (a[0] - b[1], a[1] - b[0])
        return UNLIMITED

    @property
    def is_short(self) -> bool:
        """Does a whole number fit 16 bits?"""
        return SHORT[0] <= self.range[0] and self.range[1] <= SHORT[1]

    @property
    def printed_operands(self) -> tuple[Node, ...]:
        """The operands as often as the node's C names them: a square is x * x."""
        return self.operands * 2 if self.op == ca.OP_SQ else self.operands


Leaf = Callable[[int, int], Node]  # (which of GROUPS, element) -> its node
Make = Callable[[int, tuple[Node, ...]], Node]  # (operation, operands) -> its node


class Nodes:
    """Makes nodes, each value once, and simplifies choices without changing a bit."""

    def __init__(self) -> None:
        self._made: dict[tuple[object, ...], Node] = {}
        self._elements: dict[Node, tuple[Node, str, int]] = {}  # the index, the vector, of how many elements

    def constant(self, value: float) -> Node:
        """A number; 0.0 and -0.0 are two."""
        return self.once(
            (ca.OP_CONST, value, math.copysign(1.0, value)), lambda: Node(ca.OP_CONST, value=value)
        )

    def leaf(self, leaf: Leaf) -> Leaf:
        """The same leaves, each field once."""

        def once(group: int, element: int) -> Node:
            return self.once((ca.OP_INPUT, group, element), lambda: leaf(group, element))

        return once

    def make(self, op: int, operands: tuple[Node, ...]) -> Node:
        """An operation; a choice is made in the simplest way that has the same value."""
        operands = tuple(self.constant(a.value) if a.op == ca.OP_CONST else a for a in operands)
        if op == SELECT:
            condition, yes, no = operands
            if condition.op == ca.OP_NOT:
                return self.make(SELECT, (condition.operands[0], no, yes))
            if yes.op == SELECT and yes.operands[0] is condition:
                yes = yes.operands[1]
            if no.op == SELECT and no.operands[0] is condition:
                no = no.operands[2]
            if yes is no:
                return yes
            operands = condition, yes, no
        node = self.once((op, *map(id, operands)), lambda: Node(op, operands))
        return (self._element(node) if op == SELECT else None) or node

    def once(self, key: tuple[object, ...], make: Callable[[], Node]) -> Node:
        """The node of this key, made when it is first asked for."""
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]

    def _element(self, select: Node) -> Node | None:
        """The ELEMENT that equals `i == n ? v[n] : ... i == 1 ? v[1] : v[0]`, or None."""
        equal, last, rest = select.operands
        vector, k = _place(last)
        if not vector or equal.op != ca.OP_EQ:
            return None
        if k == 1 and _place(rest) == (vector, 0):
            index = next((a for a in equal.operands if a.op != ca.OP_CONST), None)
        else:
            index, *chosen = self._elements.get(rest, (None,))
            if chosen != [vector, k]:
                return None
        if index is None or index.ctype not in ("int", "short") or not _compares(equal, index, k):
            return None
        size, variable, ctype = k + 1, last.variable, last.ctype
        self._elements[select] = index, vector, size
        if size < SHORTEST_VECTOR:
            return None
        checks = (ca.OP_LE, (self.constant(1.0), index)), (ca.OP_LT, (index, self.constant(float(size))))
        inside = self.make(ca.OP_AND, tuple(self.make(*check) for check in checks))
        place = self.make(SELECT, (inside, index, self.constant(0.0)))
        element = self.once(
            (ELEMENT, place, vector), lambda: Node(ELEMENT, (place,), 0.0, vector, variable, ctype=ctype)
        )
        self._elements[element] = index, vector, size
        return element


def _place(node: Node) -> tuple[str, int]:
    """The vector and the index of a field that is an element, ("", 0) of other nodes."""
    element = re.fullmatch(r"(.*)\[(\d+)\]", node.field) if node.op == ca.OP_INPUT else None
    return (element[1], int(element[2])) if element else ("", 0)


def _compares(equal: Node, index: Node, value: int) -> bool:
    """Does the comparison compare the index with this constant?"""
    return any(a is index and b.op == ca.OP_CONST and b.value == value for a, b in _both_ways(equal.operands))


def _both_ways(pair: tuple[Node, ...]) -> tuple[tuple[Node, ...], tuple[Node, ...]]:
    return pair, pair[::-1]


def read(function: Any, leaf: Leaf, make: Make = Node) -> tuple[list[Node], int]:
    """The nodes of a traced function's results, and how many operations it takes.

    CasADi writes if_else(c, a, b) as (c ? a : 0) + (!c ? b : 0), which becomes one choice again.

    Raises:
        DeclarationError: an operation has no C without a library, or a constant is not finite.
    """
    work: dict[int, Node] = {}  # register -> its node
    results: list[Node] = [Node(ca.OP_CONST)] * int(function.numel_out(0))
    writer: dict[int, int] = {}  # register -> the instruction that wrote it
    negates: dict[int, int] = {}  # negation -> the instruction whose result it negates
    halves: dict[int, tuple[int, Node, Node]] = {}  # (c ? a : 0) -> the instruction that wrote c, then c, a
    operations = 0
    for k in range(function.n_instructions()):
        op, into, of = (
            function.instruction_id(k),
            function.instruction_output(k),
            function.instruction_input(k),
        )
        if op == ca.OP_OUTPUT:
            results[into[1]] = work[of[0]]
            continue
        if op == ca.OP_CONST:
            value = float(function.instruction_constant(k))
            if not math.isfinite(value):
                raise DeclarationError(f"{function.name()}: constant {value} has no C literal")
            node = Node(op, value=value)
        elif op == ca.OP_INPUT:
            node = leaf(of[0], of[1])
        else:
            operations += 1
            operands = tuple(work[i] for i in of)
            if op == ca.OP_IF_ELSE_ZERO:
                halves[k] = (writer[of[0]], operands[0], operands[1])
                op, operands = SELECT, (*operands, Node(ca.OP_CONST))
            elif op == ca.OP_NOT:
                negates[k] = writer[of[0]]
            elif op == ca.OP_ADD:
                for i, j in (of, of[::-1]):
                    yes, no = halves.get(writer[i]), halves.get(writer[j])
                    if yes and no and negates.get(no[0]) == yes[0]:
                        op, operands = SELECT, (*yes[1:], no[2])
            if op not in PRINTED:
                raise DeclarationError(f"{function.name()}: operation {op} has no C without a library")
            node = make(op, operands)
        work[into[0]], writer[into[0]] = node, k
    return results, operations


def behind(results: Iterable[Node], hidden: Collection[Node] = ()) -> list[Node]:
    """Every node behind the results, once, operands first; not those behind a hidden node or a local."""
    order: dict[Node, None] = {}
    left = list(results)[::-1]
    while left:
        node = left[-1]
        missing = (
            []
            if node.name or node in hidden
            else [operand for operand in node.operands if operand not in order]
        )
        if missing:
            left += missing[::-1]
        else:
            order[left.pop()] = None
    return list(order)


def count_uses(results: Sequence[Node]) -> None:
    """Count by how many operands and results each node is used, of the nodes that have no local yet."""
    nodes = behind(results)
    for node in nodes:
        node.uses = 0
    for node in results:
        node.uses += 1
    for node in nodes:
        for operand in () if node.name else node.printed_operands:
            operand.uses += 1


def operations_behind(results: Iterable[Node]) -> int:
    """How many operations the results take together."""
    return sum(bool(node.operands) for node in behind(results))


def name_values(nodes: Iterable[Node]) -> None:
    """Find out which nodes take named values: what becomes, or is compared with, a variable that does."""
    changed = True
    nodes = list(nodes)
    while changed:
        changed = False
        for node in nodes:
            if node.op in COMPARISONS:
                group: tuple[Node, ...] = node.operands
            elif node.op == SELECT and node.ctype != "real":
                group = (node, *node.operands[1:])
            else:
                continue
            variable = next((n.enumeration for n in group if n.enumeration), None)
            for other in group:
                if variable is not None and other.enumeration is None and _is_chosen(other):
                    other.enumeration = variable
                    changed = True


def _is_chosen(node: Node) -> bool:
    return node.op == SELECT and node.ctype != "real"
