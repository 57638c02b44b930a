"""The reference: a block run in Python from its CasADi functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from models.errors import DeclarationError, ParameterError, nearest
from models.kit.block import Block
from models.kit.declaration import Stream, flatten
from models.kit.random import start_state
from models.kit.tracing import GROUPS, Table, Transition, Update

Array = npt.NDArray[np.float64]
Replace = Callable[[Any], Any]


class Model:
    """One instance of a block in double precision.

    Attributes:
        state, input, parameter, output: the values now, float64 vectors in the order of declaration.

    Args:
        block: the block's class.
        parameters: values by flat name (`waypoint_north[1]`), others start as declared.
        replace: gives the function to call for each traced one (its compiled form, say); same by default.

    Raises:
        ParameterError: unknown name, wrong type or out of range.
    """

    def __init__(
        self,
        block: type[Block],
        parameters: Mapping[str, float] | None = None,
        replace: Replace = lambda function: function,
    ) -> None:
        self.block = block
        self._program = block.program()
        self._index = {name: (kind, i) for kind in GROUPS for i, name in enumerate(block.flat_names(kind))}
        self.state, self.input, self.parameter, self.output = (
            np.array([s for v in block.group(kind) for s in v.start], dtype=np.float64) for kind in GROUPS
        )
        self._arguments = (self.state, self.input, self.parameter, self.output)
        self._initialize = [self._bind(phase, replace) for phase in self._program.initialize]
        self._tick = [self._bind(phase, replace) for phase in self._program.tick]
        declared = dict(flatten(block.group("parameter")))
        for name, value in (parameters or {}).items():
            if name not in declared:
                raise ParameterError(f'{block.title()} has no parameter "{name}"{nearest(name, declared)}')
            declared[name].check(float(value), f"{block.title()}.{name}")
            self[name] = float(value)

    def __getitem__(self, name: str) -> float:
        kind, i = self._place(name)
        return float(getattr(self, kind)[i])

    def __setitem__(self, name: str, value: float) -> None:
        kind, i = self._place(name)
        getattr(self, kind)[i] = value

    def _place(self, name: str) -> tuple[str, int]:
        if name not in self._index:
            raise ParameterError(f'{self.block.title()} has no variable "{name}"{nearest(name, self._index)}')
        return self._index[name]

    def initialize(self) -> None:
        """Start the random streams, then run the block's `initialize` (and `output`, if it is a plant)."""
        for variable in self.block.group("state"):
            values = (
                start_state(
                    int(self["seed"]),
                    variable.substream + int(self[variable.number] if variable.number else 0),
                )
                if isinstance(variable, Stream)
                else variable.start
            )
            for name, value in zip(variable.flat_names, values, strict=True):
                self[name] = value
        for run in self._initialize:
            run()

    def step(self) -> None:
        """One tick: from the inputs of t_k, a plant goes to t_{k+1}, every other block answers for t_k."""
        for run in self._tick:
            run()

    def observe(self) -> None:
        """Set the outputs of a plant for its states as they are.

        Raises:
            DeclarationError: the block is not a `moore` block: its outputs depend on its inputs.
        """
        if not self.block.moore:
            raise DeclarationError(f"{self.block.title()} is not a moore block: its outputs need a step")
        self._initialize[-1]()

    def _call(self, function: Any) -> tuple[Callable[[], None], Array]:
        """A call without copies: (run, where the result will be)."""
        result = np.zeros(function.numel_out(0))
        buffer, trigger = function.buffer()
        for i, argument in enumerate(self._arguments):
            if argument.size:
                buffer.set_arg(i, memoryview(argument.data))
        if result.size:
            buffer.set_res(0, memoryview(result.data))
        keep = buffer  # the trigger does not hold it

        def run() -> None:
            keep  # noqa: B018
            trigger()

        return run, result

    def _assign(self, update: Update | Transition, replace: Replace) -> Callable[[], None]:
        run, result = self._call(replace(update.function))
        targets = [
            (getattr(self, kind), np.array(to), np.array(of))
            for kind in ("state", "output")
            if (of := [i for i, n in enumerate(update.writes) if self._index[n][0] == kind])
            and (to := [self._index[update.writes[i]][1] for i in of])
        ]

        def assign() -> None:
            run()
            for values, to, of in targets:
                values[to] = result[of]

        return assign

    def _bind(self, phase: Update | Table, replace: Replace) -> Callable[[], None]:
        assign = (
            self._bind_table(phase, replace) if isinstance(phase, Table) else self._assign(phase, replace)
        )
        if phase.guard is None:
            return assign
        test, holds = self._call(replace(phase.guard))

        def update() -> None:
            test()
            if holds[0]:
                assign()

        return update

    def _bind_table(self, table: Table, replace: Replace) -> Callable[[], None]:
        rows: dict[int, list[tuple[Callable[[], None], Array, Callable[[], None]]]] = {}
        for row in table.rows:
            test, holds = self._call(replace(row.guard))
            rows.setdefault(row.mode, []).append((test, holds, self._assign(row, replace)))
        position = self._index[table.mode][1]

        def update() -> None:
            for test, holds, assign in rows.get(int(self.state[position]), ()):
                test()
                if holds[0]:
                    assign()
                    return

        return update
