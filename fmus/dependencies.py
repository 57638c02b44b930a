"""Which of a block's outputs depend on which inputs and parameters: structure, whatever the values.

Tools order a system of FMUs by it; without it every output counts as depending on every input, and a loop
through a plant looks algebraic.
"""

from __future__ import annotations

from typing import Any

from models.kit.block import Block
from models.kit.tracing import GROUPS, Phase, Table

Known = frozenset[str]
NOTHING: Known = frozenset()


def tick_dependencies(block: type[Block]) -> dict[str, Known]:
    """The inputs that each output's answer of a tick depends on; a plant's depend on its states alone."""
    outputs = block.flat_names("output")
    if block.moore:
        return dict.fromkeys(outputs, NOTHING)
    known = {name: frozenset([name]) for name in block.flat_names("input")}
    for phase in block.program().tick:
        _carry_out(block, phase, known)
    return {name: known.get(name, NOTHING) for name in outputs}


def initial_dependencies(block: type[Block]) -> dict[str, Known]:
    """The parameters that each output depends on at initialization; none, except in a plant."""
    known = {name: frozenset([name]) for name in block.flat_names("parameter")}
    for stream in block.streams():
        known |= dict.fromkeys(stream.flat_names, frozenset(["seed"]))
    for phase in block.program().initialize:
        _carry_out(block, phase, known)
    return {name: known.get(name, NOTHING) for name in block.flat_names("output")}


def _carry_out(block: type[Block], phase: Phase, known: dict[str, Known]) -> None:
    """Add what an update writes; what it may leave as it is keeps what it depended on."""
    before = dict(known)

    def reads(function: Any, element: int) -> Known:
        """What an element of a function's result depends on, through the function's arguments."""
        rows = [
            before.get(block.flat_names(kind)[column], NOTHING)
            for argument, kind in enumerate(GROUPS)
            for row, column in zip(*function.jac_sparsity(0, argument).get_triplet(), strict=True)
            if row == element
        ]
        return NOTHING.union(*rows)

    if isinstance(phase, Table):
        guards = [reads(row.guard, 0) for row in phase.rows]
        condition = before.get(phase.mode, NOTHING).union(*guards)
        writes = [(name, row.function, i) for row in phase.rows for i, name in enumerate(row.writes)]
    else:
        condition = NOTHING if phase.guard is None else reads(phase.guard, 0)
        writes = [(name, phase.function, i) for i, name in enumerate(phase.writes)]
        if phase.guard is None:
            known |= dict.fromkeys(phase.writes, NOTHING)
    for name, function, i in writes:
        known[name] = known.get(name, NOTHING) | condition | reads(function, i)
