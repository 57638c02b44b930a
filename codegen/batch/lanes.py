"""The ordinary tick of a wired system: what a tick does when nothing seldom happens, for trials side by side.

A vector of the processor holds a variable of several trials, one in each lane. All lanes take the same
operations, so a tick in lanes has no branches. Most of a block's C is seldom needed, though: a transition of
a state machine, an update that the model calls `seldom`, the end of a trial. So these are not in the
ordinary tick. In their place stands the condition `departs`: something seldom is due, and this trial
*departs* from the ordinary tick. The runner then discards the lane's results and takes this one tick through
the blocks' own step functions.

The ordinary tick is made as follows.

1. *Joining.* The updates of all blocks are joined to one expression graph, in the order in which a tick
   carries them out. A link becomes the node of the output that it comes from.
2. *Departures as assumptions.* After a departure is recorded, the rest of the tick may assume that its
   condition is false: if it is true, the results are discarded. The graph (`graph.py`) simplifies by what it
   may assume.
3. *Specializing.* The tick is made anew for each mode of the largest state machine. The mode is a constant
   then, and what only other modes need disappears: on recall, the direction to the waypoint. States that
   have one value throughout a mode, such as the command in force, become constants too: they are *held*. A
   trial belongs to the tick (the *bin*, in the runner) whose held values are its own; a tick that would
   change a held state departs.

Operations are left out or moved, never rearranged, so a lane has the bits of the blocks' own C.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from codegen.batch.graph import Graph
from codegen.blocks.expressions import Writer
from codegen.blocks.nodes import SELECT, Node, count_uses, read
from models.kit.declaration import Parameter, State, Type, flatten
from models.kit.link import Key
from models.kit.tracing import GROUPS, Phase, Table, Update
from models.system import System

LATENCY = {  # cycles from operands to result where it is more than one, on today's x86-64
    ca.OP_ADD: 3, ca.OP_SUB: 3, ca.OP_MUL: 3, ca.OP_SQ: 3, ca.OP_TWICE: 3, ca.OP_FLOOR: 8, ca.OP_DIV: 13,
    ca.OP_SQRT: 20,
}  # fmt: skip


@dataclass(frozen=True)
class Tick:
    """An ordinary tick, as C.

    Attributes:
        held: states that are constants in this tick, with their values: the mode, and what goes with it.
        reads: variables of each trial that it reads.
        writes: states of each trial that it changes.
        common: variables that it reads and that are the same in all trials.
        lines: its C; at the end it sets lane `l` of `to` and the local `departs`.
        operations: how many operations it takes.
        always_departs: there is no ordinary tick with these held values.
    """

    held: Mapping[Key, float]
    reads: frozenset[Key]
    writes: frozenset[Key]
    common: frozenset[Key]
    lines: tuple[str, ...]
    operations: int
    always_departs: bool


@dataclass(frozen=True)
class BatchSystem:
    """A wired system, and what of it is the same in all trials.

    Attributes:
        keep: the states and outputs that matter, by component.
        varying: parameters and free inputs that differ from trial to trial.
        constants: values of free inputs that never change, and of structural parameters; of a switch that is
            on, any value but 0.
        stop: an output, and the values of it that end a trial.
    """

    system: System
    keep: Mapping[str, frozenset[str]]
    varying: frozenset[Key]
    constants: Mapping[Key, float]
    stop: tuple[Key, frozenset[int]] | None

    @cached_property
    def sources(self) -> dict[Key, Key]:
        """The output that each connected input comes from."""
        return {(k.target, k.target_variable): (k.source, k.source_variable) for k in self.system.links}

    def constant(self, key: Key) -> float | None:
        """The one value of a variable, if it is known when the runner is compiled."""
        value, (component, name) = self.constants.get(key), key
        variable = self.system.components[component].variables().get(name)
        return None if value and isinstance(variable, Parameter) and variable.switch else value

    def enumerations(self) -> dict[Key, float | None]:
        """The states with named values that matter, and the values that they usually have, if declared."""
        return {
            (component, name): variable.usual
            for component, block in self.system.components.items()
            for name, variable in flatten(block.group("state"))
            if isinstance(variable, State) and variable.choices and name in self.keep[component]
        }

    def type_of(self, key: Key) -> Type:
        """The type of a variable."""
        component, name = key
        variables = self.system.components[component].variables().values()
        return next(v.type for v in variables if name in v.flat_names)


def ordinary_tick(batch_system: BatchSystem, mode: Mapping[Key, float]) -> Tick:
    """The ordinary tick while some states have these values.

    Given a mode, states with named values are held too, one after the other, since the value of one may
    follow from another's: those that can have one value only, and those that the tick would change. The
    latter are held at the value that the tick gives them, or at their usual value if there are several. To
    change a held state is to depart.
    """
    held = dict(mode)
    may_be_held = batch_system.enumerations() if mode else {}
    while True:
        joined = _Joined(batch_system, held)
        more = joined.one_more_held(may_be_held)
        if not more:
            return joined.tick()
        held |= more


class _Joined:
    """The updates of all blocks, joined to one graph in the order in which a tick carries them out."""

    def __init__(self, batch_system: BatchSystem, held: Mapping[Key, float]) -> None:
        self.batch_system, self.held, self.graph = batch_system, held, Graph()
        self.values: dict[Key, Node] = {}  # of states and outputs that the tick has set so far
        self.lane_fields: dict[str, Key] = {}  # by their name in C
        self.common_fields: dict[str, Key] = {}
        self.departs = self.graph.false
        self._join()

    def _join(self) -> None:
        system = self.batch_system.system
        plants = [component for component, block in system.components.items() if block.moore]
        for component in plants:  # a plant's outputs follow from its states before the tick
            self._add(component, system.components[component].program().tick[-1])
        for component in system.order():
            phases = system.components[component].program().tick
            for phase in phases[:-1] if component in plants else phases:
                self._add(component, phase)
            if self.batch_system.stop and self.batch_system.stop[0][0] == component:
                output, ends = self.batch_system.stop
                ended = (self.graph.equal(self.values[output], value) for value in sorted(ends))
                self._depart_if(self.graph.any_of(*ended))

    def _depart_if(self, condition: Node) -> None:
        """If the condition is true the trial departs; what follows assumes that it is false."""
        if condition is self.graph.true or self.departs is self.graph.false:
            self.departs = condition
        elif condition is not self.graph.false and self.departs is not self.graph.true:
            # not made by the graph, which assumes that both conditions are false
            self.departs = Node(ca.OP_OR, (self.departs, condition))
        self.graph.assume(condition, False)

    def _add(self, component: str, phase: Phase) -> None:
        """Add an update, or the departure for a transition or a seldom update."""
        graph, keep = self.graph, self.batch_system.keep[component]
        rows = phase.rows if isinstance(phase, Table) else (phase,)
        if all(keep.isdisjoint(row.writes) for row in rows):
            return
        guard = self._results(component, phase.guard)[0] if phase.guard is not None else graph.true
        if guard is graph.false:
            return
        if isinstance(phase, Table):
            mode = self._current(component, "state", phase.mode)
            transitions = [
                graph.all_of(in_mode, self._results(component, row.guard)[0])
                for row in phase.rows
                if (in_mode := graph.equal(mode, row.mode)) is not graph.false
            ]
            self._depart_if(graph.all_of(guard, graph.any_of(*transitions)))
        elif self._is_seldom(component, phase):
            self._depart_if(guard)
        else:
            results = self._results(component, phase.function)
            for name, value in zip(phase.writes, results, strict=True):
                if name in keep:
                    self._set((component, name), value, guard)

    def _is_seldom(self, component: str, update: Update) -> bool:
        """Is the update seldom, with the structural parameters as they are?"""
        if isinstance(update.seldom, bool):
            return update.seldom
        return not self.batch_system.constants.get((component, update.seldom))

    def _set(self, key: Key, value: Node, guard: Node) -> None:
        """Give a variable its value where the guard holds; a held state departs if that changes it."""
        if guard is not self.graph.true:
            value = self.graph.select(guard, value, self._current(key[0], "state", key[1]))
        if key in self.held:
            unchanged = self.graph.equal(value, self.held[key])
            if unchanged is not self.graph.true:
                self._depart_if(self.graph.make(ca.OP_NOT, (unchanged,)))
            value = self.graph.constant(self.held[key])
        self.values[key] = value

    def _results(self, component: str, function: Any) -> list[Node]:
        """The nodes of a traced function's results, from the variables as they are now."""
        block = self.batch_system.system.components[component]
        names = [block.flat_names(kind) for kind in GROUPS]

        def leaf(group: int, element: int) -> Node:
            return self._current(component, GROUPS[group], names[group][element])

        return [self.graph.known(node) for node in read(function, leaf, self.graph.make)[0]]

    def _current(self, component: str, kind: str, name: str) -> Node:
        """The value of a variable at this place of the tick."""
        key = (component, name)
        if kind in ("state", "output"):
            if key in self.values:
                return self.graph.known(self.values[key])
            return self.graph.constant(self.held[key]) if key in self.held else self._lane_field(key)
        if key in self.batch_system.sources:
            source = self.batch_system.sources[key]
            # an output is missing here if it does not matter: then nothing that reads it matters either
            return (
                self.graph.known(self.values[source]) if source in self.values else self.graph.leaf("unused")
            )
        if (constant := self.batch_system.constant(key)) is not None:
            return self.graph.constant(constant)
        if key in self.batch_system.varying:
            return self._lane_field(key)
        self.common_fields[field_name(key)] = key
        return self.graph.leaf(field_name(key))

    def _lane_field(self, key: Key) -> Node:
        """The value that a variable of each trial has before the tick."""
        self.lane_fields[field_name(key)] = key
        return self.graph.leaf(field_name(key), self.batch_system.type_of(key))

    def one_more_held(self, may_be_held: Mapping[Key, float | None]) -> dict[Key, float]:
        """One more state to hold, and its value; empty if there is none.

        Args:
            may_be_held: states, and their usual values.
        """
        for key, node in self._writes().items():
            if key in may_be_held:
                new, usual = _choices(node) - {self._lane_field(key)}, may_be_held[key]
                if len(new) == 1:
                    return {key: new.pop().value}
                if usual is not None:
                    return {key: float(usual)}
        for key in may_be_held:
            value = self.graph.known(self._lane_field(key))
            if key not in self.held and value.op == ca.OP_CONST:
                return {key: value.value}
        return {}

    def _writes(self) -> dict[Key, Node]:
        """The states that the tick changes, and their values after it."""
        return {
            (component, name): node
            for (component, name), node in self.values.items()
            if name in self.batch_system.system.components[component].flat_names("state")
            and (component, name) not in self.held
            and node is not self._lane_field((component, name))
        }

    def tick(self) -> Tick:
        """The joined tick as C: a local for each operation, then what is stored."""
        writes = self._writes()
        results = [self.departs, *writes.values()]
        nodes = _by_readiness(results)
        count_uses(results)
        writer = Writer("double", branchless=True)
        for node in nodes:
            if node.operands:
                writer.name(node, node.ctype)
        lines = [f"const bool departs = {writer.write(self.departs, 'bool')};"]
        lines += [f"to->{field_name(key)}[l] = {writer.write(node, 'real')};" for key, node in writes.items()]
        reads, common = (
            frozenset(keys[node.field] for node in nodes if node.field in keys)
            for keys in (self.lane_fields, self.common_fields)
        )
        return Tick(
            held=self.held,
            reads=reads,
            writes=frozenset(writes),
            common=common,
            lines=(*writer.lines, *lines),
            operations=sum(bool(node.operands) for node in nodes),
            always_departs=self.departs is self.graph.true,
        )


def field_name(key: Key) -> str:
    """The C field of a component's variable: `controller_route_north_3`."""
    return f"{key[0]}_{key[1]}".replace("[", "_").replace("]", "")


def _choices(node: Node) -> set[Node]:
    """The nodes that a chain of choices chooses from; of other nodes, the node."""
    return set().union(*map(_choices, node.operands[1:])) if node.op == SELECT else {node}


def _by_readiness(results: Sequence[Node]) -> list[Node]:
    """All nodes behind the results, in the order in which a processor with unlimited units would have them.

    So chains of operations that do not wait for each other are interleaved, which keeps the real units busy.
    """
    ready: dict[Node, int] = {}  # in cycles
    left = list(results)
    while left:
        node = left[-1]
        missing = [operand for operand in node.operands if operand not in ready]
        if missing:
            left += missing
        else:
            left.pop()
            latency = LATENCY.get(node.op, 1) if node.operands else 0
            ready[node] = latency + max((ready[operand] for operand in node.operands), default=0)
    return sorted(ready, key=ready.__getitem__)
