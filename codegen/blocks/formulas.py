"""Traced functions as formulas for the solver z3: a tick of a block, over real numbers in place of floats.

Products, squares and roots of what is not constant are any number that they can be; so what holds of the
formulas holds of the block, but what z3 finds against it must be tried in the model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import casadi as ca

from codegen.blocks.nodes import SELECT, Node, behind, read
from models.errors import CanineError
from models.kit.block import Block
from models.kit.declaration import Type, Variable, flatten
from models.kit.tracing import GROUPS, Table

Value = Any  # z3's expressions carry no types
Values = dict[str, Value]  # by flat name


class SolverError(CanineError):
    """z3 is not installed."""


def solver() -> Any:
    """The module z3.

    Raises:
        SolverError: it is not installed.
    """
    try:
        import z3  # noqa: PLC0415 - 0.2 s, and an optional dependency
    except ImportError:
        raise SolverError(
            'the proofs on the graph need z3, and it is missing: pip install "guided-canine[z3]"'
        ) from None
    return z3


@dataclass
class Tick:
    """What a tick makes of a block's values.

    Attributes:
        values: after the tick, states, inputs, parameters and outputs.
        rows: of each row of its tables, whether it was taken.
        facts: what is known of numbers that stand for products and the like.
    """

    values: Values
    rows: list[Value] = field(default_factory=list)
    facts: list[Value] = field(default_factory=list)


Instead = Mapping[str, Callable[[Values], Values]]  # update -> what it assigns


class Formulas:
    """A block's ticks as formulas."""

    def __init__(self, block: type[Block]) -> None:
        self.z3, self.block = solver(), block
        self.variables: dict[str, Variable] = {}
        for kind in GROUPS:
            self.variables |= dict(flatten(block.group(kind)))
        self.names = {kind: block.flat_names(kind) for kind in GROUPS}

    def free(self, prefix: str, *kinds: str) -> Values:
        """A free value for each variable of these kinds."""
        return {
            name: self.fresh(f"{prefix}{name}", self.variables[name])
            for kind in kinds
            for name in self.names[kind]
        }

    def fresh(self, name: str, variable: Variable) -> Value:
        """A free value of a variable's type."""
        make = {Type.REAL: self.z3.Real, Type.INTEGER: self.z3.Int, Type.BOOLEAN: self.z3.Bool}
        return make[variable.type](name)

    def number(self, value: float, variable: Variable) -> Value:
        """A number of a variable's type."""
        if variable.type is Type.BOOLEAN:
            return self.z3.BoolVal(bool(value))
        if variable.type is Type.INTEGER:
            return self.z3.IntVal(int(value))
        return self.z3.RealVal(Fraction(repr(float(value))))

    def starts(self) -> Values:
        """States and outputs as they start."""
        return {
            name: self.number(value, variable)
            for kind in ("state", "output")
            for variable in self.block.group(kind)
            for name, value in zip(variable.flat_names, variable.start, strict=True)
        }

    def declared(self, values: Values, *kinds: str) -> list[Value]:
        """The values are within their declared ranges."""
        return [
            limit
            for kind in kinds
            for name in self.names[kind]
            for limit in self.limits(values[name], self.variables[name])
        ]

    def limits(self, value: Value, variable: Variable) -> list[Value]:
        """The value is within a variable's declared range."""
        if variable.type is Type.BOOLEAN:
            return []
        low = [] if variable.min is None else [value >= self.number(variable.min, variable)]
        return low + ([] if variable.max is None else [value <= self.number(variable.max, variable)])

    def tick(self, values: Values, instead: Instead | None = None) -> Tick:
        """One tick from these values.

        Args:
            instead: what some updates do, in place of their equations.
        """
        tick = Tick(dict(values))
        for phase in self.block.program().tick:
            guard = (
                self.z3.BoolVal(True)
                if phase.guard is None
                else self._truth(self._results(phase.guard, tick)[0])
            )
            if phase.name in (instead or {}):
                assert instead is not None
                self._assign(tick, guard, instead[phase.name](tick.values))
            elif isinstance(phase, Table):
                self._take_row(tick, guard, phase)
            else:
                self._assign(
                    tick, guard, dict(zip(phase.writes, self._results(phase.function, tick), strict=True))
                )
        return tick

    def _take_row(self, tick: Tick, guard: Value, table: Table) -> None:
        z3, before = self.z3, tick.values[table.mode]
        free, assigned = guard, []
        for row in table.rows:
            holds = z3.And(free, before == row.mode, self._truth(self._results(row.guard, tick)[0]))
            tick.rows.append(holds)
            free = z3.And(free, z3.Not(holds))
            assigned.append((holds, dict(zip(row.writes, self._results(row.function, tick), strict=True))))
        for holds, values in assigned:  # at most one is taken
            self._assign(tick, holds, values)

    def _assign(self, tick: Tick, guard: Value, values: Values) -> None:
        for name, value in values.items():
            new = self._as(self.variables[name].type, value)
            tick.values[name] = self.z3.If(guard, new, tick.values[name])

    def _results(self, function: Any, tick: Tick) -> list[Value]:
        """A function's results, as they are at this point of the tick."""

        def leaf(group: int, element: int) -> Node:
            name = self.names[GROUPS[group]][element]
            return Node(ca.OP_INPUT, field=name, variable=self.variables[name])

        nodes, _ = read(function, leaf)
        made: dict[Node, Value] = {}
        for node in behind(nodes):
            made[node] = self._value(node, [made[operand] for operand in node.operands], tick)
        return [made[node] for node in nodes]

    def _value(self, node: Node, operands: list[Value], tick: Tick) -> Value:
        z3, op = self.z3, node.op
        if op == ca.OP_CONST:
            whole = float(node.value).is_integer()
            return z3.IntVal(int(node.value)) if whole else z3.RealVal(Fraction(repr(node.value)))
        if op == ca.OP_INPUT:
            return tick.values[node.field]
        if op == SELECT:
            yes, no = self._alike(*operands[1:])
            return z3.If(self._truth(operands[0]), yes, no)
        if op in (ca.OP_AND, ca.OP_OR):
            return (z3.And if op == ca.OP_AND else z3.Or)(*map(self._truth, operands))
        if op == ca.OP_NOT:
            return z3.Not(self._truth(operands[0]))
        if op in (ca.OP_EQ, ca.OP_NE):
            a, b = self._alike(*operands)
            return a == b if op == ca.OP_EQ else a != b
        return self._arithmetic(op, [self._numeral(operand) for operand in operands], tick)

    def _arithmetic(self, op: int, operands: list[Value], tick: Tick) -> Value:
        z3, a, b = self.z3, operands[0], operands[-1]
        if op in (ca.OP_LT, ca.OP_LE):
            a, b = self._alike(a, b)
            return a < b if op == ca.OP_LT else a <= b
        if op in (ca.OP_ADD, ca.OP_SUB):
            a, b = self._alike(a, b)
            return a + b if op == ca.OP_ADD else a - b
        if op == ca.OP_NEG:
            return -a
        if op == ca.OP_TWICE:
            return 2 * a
        if op == ca.OP_FABS:
            return z3.If(a >= 0, a, -a)
        a, b = self._real(a), self._real(b)
        if op == ca.OP_FLOOR:
            return z3.ToReal(z3.ToInt(a))
        if op == ca.OP_SQ:
            return self._square(a, tick)
        if op == ca.OP_MUL and (self._is_constant(a) or self._is_constant(b)):
            return a * b
        if op == ca.OP_DIV and self._is_constant(b):
            return a / b
        some = z3.FreshReal("some")
        if op == ca.OP_SQRT:
            tick.facts.append(some >= 0)
        elif op == ca.OP_MUL:
            tick.facts.append(z3.Implies(z3.Or(a == 0, b == 0), some == 0))
        elif op == ca.OP_DIV:
            tick.facts.append(z3.Implies(z3.And(a == 0, b != 0), some == 0))
        return some

    def _square(self, a: Value, tick: Tick) -> Value:
        """A number at least 0, and above or below |a| as the square is."""
        z3 = self.z3
        if self._is_constant(a):
            return a * a
        square, size = z3.FreshReal("square"), z3.If(a >= 0, a, -a)
        tick.facts += [square >= 0, square >= 2 * size - 1, z3.If(size <= 1, square <= size, square >= size)]
        tick.facts.append((square == 0) == (a == 0))
        return square

    def _is_constant(self, a: Value) -> bool:
        return bool(self.z3.is_rational_value(self.z3.simplify(a)))

    def _truth(self, a: Value) -> Value:
        return a if self.z3.is_bool(a) else a != 0

    def _numeral(self, a: Value) -> Value:
        return self.z3.If(a, self.z3.IntVal(1), self.z3.IntVal(0)) if self.z3.is_bool(a) else a

    def _real(self, a: Value) -> Value:
        return self.z3.ToReal(self._numeral(a)) if not self.z3.is_real(a) else a

    def _alike(self, a: Value, b: Value) -> tuple[Value, Value]:
        """Both of one sort."""
        z3 = self.z3
        if z3.is_bool(a) and z3.is_bool(b):
            return a, b
        if z3.is_real(a) or z3.is_real(b):
            return self._real(a), self._real(b)
        return self._numeral(a), self._numeral(b)

    def _as(self, type: Type, a: Value) -> Value:
        """A value as a variable of a type takes it."""
        if type is Type.BOOLEAN:
            return self._truth(a)
        return (
            self._real(a)
            if type is Type.REAL
            else (self.z3.ToInt(a) if self.z3.is_real(a) else self._numeral(a))
        )
