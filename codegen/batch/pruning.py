"""Which states and outputs of a wired system decide the observed ones; the others need not be computed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import casadi as ca

from models.kit.block import Block
from models.kit.tracing import GROUPS, Phase, Table
from models.system import System


def needed(system: System, observed: Iterable[tuple[str, str]]) -> Mapping[str, frozenset[str]]:
    """The states and outputs of each component on which the observed ones depend, now or later.

    No needed result depends on one that is not, so a step without the others gives the same bits.

    Args:
        observed: states and outputs, as (component, flat name).
    """
    sources = {(k.target, k.target_variable): (k.source, k.source_variable) for k in system.links}
    needs: dict[str, set[str]] = {component: set() for component in system.components}
    dependencies = {
        component: [_dependencies(block, phase) for phase in _phases(block)]
        for component, block in system.components.items()
    }
    left = list(observed)
    while left:
        component, name = left.pop()
        if name in needs[component]:
            continue
        needs[component].add(name)
        for phase in dependencies[component]:
            for kind, other in phase.get(name, ()):
                if kind in ("state", "output"):
                    left.append((component, other))
                elif kind == "input" and (component, other) in sources:
                    left.append(sources[component, other])
    return {component: frozenset(names) for component, names in needs.items()}


Reads = frozenset[tuple[str, str]]  # variables as (group, flat name)


def _phases(block: type[Block]) -> Iterable[Phase]:
    program = block.program()
    return (*program.initialize, *program.tick)


def _dependencies(block: type[Block], phase: Phase) -> dict[str, Reads]:
    """The variables that decide each variable which a phase may set."""
    guard = _reads(block, phase.guard)[0] if phase.guard is not None else frozenset()
    reads_of: dict[str, Reads] = {}
    if isinstance(phase, Table):
        rows = phase.rows
        guard |= {("state", phase.mode)}.union(*(_reads(block, row.guard)[0] for row in rows))
    else:
        rows = (phase,)  # type: ignore[assignment]
    for row in rows:
        for name, reads in zip(row.writes, _reads(block, row.function), strict=True):
            reads_of[name] = reads_of.get(name, frozenset()) | reads | guard
    return reads_of


def _reads(block: type[Block], function: Any) -> list[Reads]:
    """The variables on which each result of a traced function depends."""
    names = [block.flat_names(kind) for kind in GROUPS]
    work: dict[int, Reads] = {}
    results: list[Reads] = [frozenset()] * int(function.numel_out(0))
    for k in range(function.n_instructions()):
        op, into, of = (
            function.instruction_id(k),
            function.instruction_output(k),
            function.instruction_input(k),
        )
        if op == ca.OP_INPUT:
            work[into[0]] = frozenset({(GROUPS[of[0]], names[of[0]][of[1]])})
        elif op == ca.OP_OUTPUT:
            results[into[1]] = work[of[0]]
        else:
            work[into[0]] = frozenset().union(*(work[i] for i in of)) if op != ca.OP_CONST else frozenset()
    return results
