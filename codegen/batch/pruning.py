"""What of a wired system matters for what is asked of it: the updates and results that can be left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import casadi as ca

from models.kit.block import Block
from models.kit.tracing import GROUPS, Phase, Table
from models.system import System


def needed(system: System, wanted: Iterable[tuple[str, str]]) -> Mapping[str, frozenset[str]]:
    """The states and outputs of each component on which the wanted ones depend, at whatever time.

    A result that is left out changes no other, so a step without it gives the same bits.

    Args:
        wanted: states and outputs, as (component, flat name).
    """
    sources = {(k.target, k.target_variable): (k.source, k.source_variable) for k in system.links}
    found: dict[str, set[str]] = {component: set() for component in system.components}
    tables = {
        component: [_dependencies(block, phase) for phase in _phases(block)]
        for component, block in system.components.items()
    }
    left = list(wanted)
    while left:
        component, name = left.pop()
        if name in found[component]:
            continue
        found[component].add(name)
        for writes in tables[component]:
            for kind, other in writes.get(name, ()):
                if kind in ("state", "output"):
                    left.append((component, other))
                elif kind == "input" and (component, other) in sources:
                    left.append(sources[component, other])
    return {component: frozenset(names) for component, names in found.items()}


Reads = frozenset[tuple[str, str]]  # variables as (group, flat name)


def _phases(block: type[Block]) -> Iterable[Phase]:
    program = block.program()
    return (*program.initialize, *program.tick)


def _dependencies(block: type[Block], phase: Phase) -> dict[str, Reads]:
    """What a phase reads for each variable that it may set."""
    guard = _reads(block, phase.guard)[0] if phase.guard is not None else frozenset()
    found: dict[str, Reads] = {}
    if isinstance(phase, Table):
        rows = phase.rows
        guard |= {("state", phase.mode)}.union(*(_reads(block, row.guard)[0] for row in rows))
    else:
        rows = (phase,)  # type: ignore[assignment]
    for row in rows:
        for name, reads in zip(row.writes, _reads(block, row.function), strict=True):
            found[name] = found.get(name, frozenset()) | reads | guard
    return found


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
