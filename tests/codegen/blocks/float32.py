"""A block's program executed instruction by instruction in numpy, many instances at once.

The independent reading of what the printed C means: no expressions, no types but the precision's own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from models.kit.block import Block
from models.kit.declaration import Type, flatten
from models.kit.elementary import Precision
from models.kit.tracing import GROUPS, Table, Transition, Update

Array = np.ndarray[Any, Any]

OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_INV: lambda a: 1 / a,
    ca.OP_SQRT: np.sqrt,
    ca.OP_FLOOR: np.floor,
    ca.OP_FABS: np.abs,
    ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal,
    ca.OP_NE: np.not_equal,
    ca.OP_NOT: np.logical_not,
    ca.OP_AND: np.logical_and,
    ca.OP_OR: np.logical_or,
    ca.OP_IF_ELSE_ZERO: lambda c, a: np.where(c != 0, a, np.zeros_like(a)),
}


class Lanes:
    """`count` instances of a block; `values[kind]` is an array (variables, count) of the precision's type."""

    def __init__(
        self,
        block: type[Block],
        precision: Precision,
        count: int,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self.block, self.program = block, block.program(precision)
        self.real = {"double": np.float64, "float": np.float32}[precision]
        self.index = {n: (kind, i) for kind in GROUPS for i, n in enumerate(block.flat_names(kind))}
        self.types = {n: v.type for kind in GROUPS for n, v in flatten(block.group(kind))}
        self.values: dict[str, Array] = {}
        for kind in GROUPS:
            start = [s for v in block.group(kind) for s in v.start]
            self.values[kind] = np.tile(np.array(start, dtype=self.real)[:, None], (1, count))
        for name, value in (parameters or {}).items():
            self[name] = value
        for update in self.program.initialize:
            self._run(update, self._everywhere)

    @property
    def _everywhere(self) -> Array:
        return np.ones(self.values["state"].shape[1], dtype=bool)

    def __getitem__(self, name: str) -> Array:
        kind, i = self.index[name]
        values: Array = self.values[kind][i]
        return values

    def __setitem__(self, name: str, value: Any) -> None:
        self[name][:] = value

    def step(self) -> None:
        """One tick."""
        with np.errstate(all="ignore"):
            for phase in self.program.tick:
                holds = self._everywhere if phase.guard is None else self._evaluate(phase.guard)[0] != 0
                if isinstance(phase, Table):
                    self._choose(phase, holds)
                else:
                    self._run(phase, holds)

    def _choose(self, table: Table, holds: Array) -> None:
        """Carry out the first row of each instance's mode whose guard holds; all rows read the old values."""
        before = {kind: values.copy() for kind, values in self.values.items()}
        undecided = holds
        mode = before[self.index[table.mode][0]][self.index[table.mode][1]]
        for row in table.rows:
            fires = undecided & (mode == row.mode) & (self._evaluate(row.guard, before)[0] != 0)
            self._run(row, fires, before)
            undecided = undecided & ~fires

    def _run(self, update: Update | Transition, where: Array, before: dict[str, Array] | None = None) -> None:
        if not where.any():
            return
        results = self._evaluate(update.function, before)
        for name, result in zip(update.writes, results, strict=True):
            value = result if self.types[name] is Type.REAL else np.trunc(result)
            self[name][where] = value[where]

    def _evaluate(self, function: Any, values: dict[str, Array] | None = None) -> list[Array]:
        arguments = [(values or self.values)[kind] for kind in GROUPS]
        count = len(self._everywhere)
        work: dict[int, Array] = {}
        results = [np.zeros(count, dtype=self.real)] * int(function.numel_out(0))
        for op, into, of, constant in _instructions(function):
            if op == ca.OP_CONST:
                work[into[0]] = np.full(count, self.real(constant))
            elif op == ca.OP_INPUT:
                work[into[0]] = arguments[of[0]][of[1]].copy()
            elif op == ca.OP_OUTPUT:
                results[into[1]] = work[of[0]]
            else:
                result = OPERATIONS[op](*(work[i] for i in of))
                work[into[0]] = np.asarray(result).astype(self.real, copy=False)
        return results


_READ: dict[int, tuple[Any, list[tuple[int, list[int], list[int], float]]]] = {}


def _instructions(function: Any) -> list[tuple[int, list[int], list[int], float]]:
    """(operation, where to, operands, constant) of each instruction, read once."""
    key = function.__hash__()
    if key not in _READ:
        rows = []
        for k in range(function.n_instructions()):
            op = function.instruction_id(k)
            constant = function.instruction_constant(k) if op == ca.OP_CONST else 0.0
            rows.append((op, function.instruction_output(k), function.instruction_input(k), constant))
        _READ[key] = function, rows  # the function is kept, so that no other gets its hash
    return _READ[key][1]
