"""The ordinary tick of a wired system as one expression graph, for many trials in the lanes of a vector.

All blocks' updates are joined to a single tick without branches. What happens seldom (a transition of a
table, a `seldom` update, the end of a trial) is not in it: there is a node that says that it happens, and the
trial then takes that one tick through the blocks' own step functions. The joined tick is specialized for each
mode of a state machine: what a mode does not need is gone.

Operations are only left out or moved, never rearranged, so a lane has the bits of the blocks' own C.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

import casadi as ca

from codegen.blocks.expressions import Writer
from codegen.blocks.nodes import SELECT, Node, count_uses, read
from models.kit.declaration import Type, flatten
from models.kit.tracing import GROUPS, Phase, Table
from models.system import System

Key = tuple[str, str]  # component, flat name
LATENCY = {  # cycles, of operations that take more than one, on the x86-64 of today
    ca.OP_ADD: 3, ca.OP_SUB: 3, ca.OP_MUL: 3, ca.OP_SQ: 3, ca.OP_TWICE: 3, ca.OP_FLOOR: 8, ca.OP_DIV: 13,
    ca.OP_SQRT: 20,
}  # fmt: skip
LOGICAL = (ca.OP_AND, ca.OP_OR, ca.OP_NOT)
ARITHMETIC: dict[int, Callable[[float, float], float]] = {
    ca.OP_ADD: operator.add, ca.OP_SUB: operator.sub, ca.OP_MUL: operator.mul,
    ca.OP_LT: operator.lt, ca.OP_LE: operator.le, ca.OP_EQ: operator.eq, ca.OP_NE: operator.ne,
}  # fmt: skip


class Graph:
    """Makes nodes: each value once, and what is known beforehand folded, without changing a bit."""

    def __init__(self) -> None:
        self._known: dict[tuple[object, ...], Node] = {}
        self._assumed: dict[Node, Node] = {}
        self._whole: set[Node] = set()
        self._truths: set[Node] = set()
        self.true, self.false = self.constant(1.0), self.constant(0.0)

    def constant(self, value: float) -> Node:
        """A number; 0.0 and -0.0 are two."""
        return self._once(
            (ca.OP_CONST, value, math.copysign(1.0, value)), lambda: Node(ca.OP_CONST, value=value)
        )

    def leaf(self, text: str, type: Type = Type.REAL) -> Node:
        """What is read from memory, as C writes it."""
        node = self._once((ca.OP_INPUT, text), lambda: Node(ca.OP_INPUT, field=text))
        if type is not Type.REAL:
            self._whole.add(node)  # has no -0.0
        if type is Type.BOOLEAN:
            self._truths.add(node)  # 0 or 1
        return node

    def make(self, op: int, operands: tuple[Node, ...]) -> Node:
        """An operation, or what it comes to."""
        operands = tuple(self.known(self.constant(a.value) if a.op == ca.OP_CONST else a) for a in operands)
        if op not in LOGICAL:
            operands = (
                (operands[0], *map(self.number, operands[1:]))
                if op == SELECT
                else tuple(map(self.number, operands))
            )
        folded = self._folded(op, operands)
        return folded or self.known(self._once((op, *map(id, operands)), lambda: _real(op, operands)))

    def number(self, node: Node) -> Node:
        """A truth as the number that it is: a select of two constants, which is what vectors are best at."""
        return self.make(SELECT, (node, self.true, self.false)) if node.ctype == "bool" else node

    def known(self, node: Node) -> Node:
        """The constant that a node is assumed to be, or the node."""
        return self._assumed.get(node, node)

    def assume(self, condition: Node, holds: bool) -> None:
        """From here on the condition holds, or does not, and what follows from that for its operands."""
        a = condition.operands
        if condition.ctype == "bool" or condition in self._truths:
            self._assumed[condition] = self.constant(float(holds))
        elif not holds:  # a number that is no truth is not 0, or is
            self.assume_value(condition, 0.0)
        if condition.op == ca.OP_NOT:
            self.assume(a[0], not holds)
        elif condition.op == (ca.OP_AND if holds else ca.OP_OR):
            for operand in a:
                self.assume(operand, holds)
        elif condition.op == (ca.OP_EQ if holds else ca.OP_NE):
            for x, other in (a, a[::-1]):
                if other.op == ca.OP_CONST:
                    self.assume_value(x, other.value)

    def assume_value(self, node: Node, value: float) -> None:
        """From here on the node has this value, and what follows from that for its operands."""
        if node.ctype == "bool":
            if value in (0.0, 1.0):
                self.assume(node, bool(value))
            return
        if node.op != ca.OP_CONST and (value or self._is_whole(node)):  # what equals 0.0 may be -0.0
            self._assumed[node] = self.constant(value)
        if node.op == SELECT:
            condition, yes, no = node.operands
            for holds, one, other in ((True, yes, no), (False, no, yes)):
                if other.op == ca.OP_CONST and other.value != value:
                    self.assume(condition, holds)
                    self.assume_value(one, value)

    def select(self, condition: Node, yes: Node, no: Node) -> Node:
        return self.make(SELECT, (condition, yes, no))

    def any_of(self, *conditions: Node) -> Node:
        return reduce(lambda a, b: self.make(ca.OP_OR, (a, b)), conditions, self.false)

    def all_of(self, *conditions: Node) -> Node:
        return reduce(lambda a, b: self.make(ca.OP_AND, (a, b)), conditions, self.true)

    def equal(self, a: Node, value: float) -> Node:
        return self.make(ca.OP_EQ, (a, self.constant(value)))

    def _is_whole(self, node: Node) -> bool:
        if node.op == SELECT:
            return all(map(self._is_whole, node.operands[1:]))
        if node.op == ca.OP_CONST:
            return node.value != 0 or math.copysign(1.0, node.value) > 0
        return node.ctype == "bool" or node in self._whole

    def _once(self, key: tuple[object, ...], make: Callable[[], Node]) -> Node:
        if key not in self._known:
            self._known[key] = make()
        return self._known[key]

    def _folded(self, op: int, a: tuple[Node, ...]) -> Node | None:
        constants = [x.op == ca.OP_CONST for x in a]
        if op in ARITHMETIC and all(constants):
            return self.constant(float(ARITHMETIC[op](a[0].value, a[1].value)))
        for i in (0, 1):
            if op in (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL) and constants[1 - i] and _is_choice(a[i]):
                chosen = [self.make(op, (x, a[1]) if i == 0 else (a[0], x)) for x in a[i].operands[1:]]
                return self.select(a[i].operands[0], *chosen)
        if op == ca.OP_NOT and constants[0]:
            return self.constant(float(not a[0].value))
        if op == SELECT:
            if constants[0]:
                return a[1] if a[0].value else a[2]
            return a[1] if a[1] is a[2] else None
        if op in (ca.OP_AND, ca.OP_OR):
            for x, other in (a, a[::-1]):
                if x.op == ca.OP_CONST:
                    if bool(x.value) is (op == ca.OP_OR):
                        return self.constant(float(op == ca.OP_OR))
                    return other if other.ctype == "bool" else self.make(ca.OP_NE, (other, self.false))
            return a[0] if a[0] is a[1] and a[0].ctype == "bool" else None
        return None


@dataclass(frozen=True)
class Tick:
    """The ordinary tick in one mode.

    Attributes:
        holds: the states with which it begins and ends, and their values: the mode, and what goes with it.
        reads: the lane's fields that it reads.
        writes: those that it changes.
        common: what it reads of what all trials have in common.
        lines: its C, from locals to lane `l` of `to` and the local `departs`.
        operations: how many there are.
        departs: it never is the ordinary one.
    """

    holds: Mapping[Key, float]
    reads: frozenset[Key]
    writes: frozenset[Key]
    common: frozenset[Key]
    lines: tuple[str, ...]
    operations: int
    departs: bool


@dataclass(frozen=True)
class BatchSystem:
    """A wired system as its joined tick needs it.

    Attributes:
        keep: the states and outputs that matter, by component.
        own: parameters and free inputs that each trial has for itself; others are common to all.
        fixed: values of free inputs that never change.
        stop: an output, and the values of it that end a trial.
    """

    system: System
    keep: Mapping[str, frozenset[str]]
    own: frozenset[Key]
    fixed: Mapping[Key, float]
    stop: tuple[Key, frozenset[int]] | None

    @cached_property
    def sources(self) -> dict[Key, Key]:
        """Where each connected input comes from."""
        return {(k.target, k.target_variable): (k.source, k.source_variable) for k in self.system.links}

    def enumerated(self) -> dict[Key, float]:
        """The states with named values that matter, and what they start with."""
        return {
            (component, name): variable.start[0]
            for component, block in self.system.components.items()
            for name, variable in flatten(block.group("state"))
            if variable.choices and name in self.keep[component]
        }


def ordinary_tick(batch_system: BatchSystem, mode: Mapping[Key, float]) -> Tick:
    """The ordinary tick, given the values of some states.

    A state with named values that an ordinary tick would set is held as well: at the value that it is set to,
    if there is but one, else at its start value. So is one that can have but one value in an ordinary tick.
    A change of it departs from the ordinary.
    """
    holds = dict(mode)
    enumerated = batch_system.enumerated() if mode else {}
    while True:
        joining = _Joining(batch_system, holds)
        joining.join()
        more = joining.settled(enumerated)
        if not more:
            return joining.tick()
        holds |= more


class _Joining:
    """Joins the blocks' updates to one tick, in the order in which they are carried out."""

    def __init__(self, batch_system: BatchSystem, holds: Mapping[Key, float]) -> None:
        self.batch_system, self.holds, self.graph = batch_system, holds, Graph()
        self.values: dict[Key, Node] = {}  # of the states and outputs set so far
        self.leaves: dict[str, Key] = {}  # the lane's fields, by their C
        self.shared: dict[str, Key] = {}  # what all trials have in common
        self.departs = self.graph.false

    def join(self) -> None:
        system = self.batch_system.system
        plants = [c for c, block in system.components.items() if block.moore]
        for component in plants:  # its outputs stand for its states before the tick
            self.phase(component, system.components[component].program().tick[-1])
        for component in system.order():
            phases = system.components[component].program().tick
            for phase in phases[:-1] if component in plants else phases:
                self.phase(component, phase)
            if self.batch_system.stop and self.batch_system.stop[0][0] == component:
                output, ends = self.batch_system.stop
                self.depart(
                    self.graph.any_of(*(self.graph.equal(self.values[output], v) for v in sorted(ends)))
                )

    def depart(self, condition: Node) -> None:
        """The tick is not ordinary if the condition holds; so it does not in what follows."""
        if condition is self.graph.true or self.departs is self.graph.false:
            self.departs = condition
        elif condition is not self.graph.false and self.departs is not self.graph.true:
            self.departs = Node(
                ca.OP_OR, (self.departs, condition)
            )  # not by the graph, which assumes neither
        self.graph.assume(condition, False)

    def phase(self, component: str, phase: Phase) -> None:
        graph, keep = self.graph, self.batch_system.keep[component]
        rows = phase.rows if isinstance(phase, Table) else (phase,)
        if all(keep.isdisjoint(row.writes) for row in rows):
            return
        guard = self.nodes(component, phase.guard)[0] if phase.guard is not None else graph.true
        if guard is graph.false:
            return
        if isinstance(phase, Table):
            mode = self.value(component, "state", phase.mode)
            fires = [
                graph.all_of(in_mode, self.nodes(component, row.guard)[0])
                for row in phase.rows
                if (in_mode := graph.equal(mode, row.mode)) is not graph.false
            ]
            self.depart(graph.all_of(guard, graph.any_of(*fires)))
        elif phase.seldom:
            self.depart(guard)
        else:
            results = self.nodes(component, phase.function)
            for name, new in zip(phase.writes, results, strict=True):
                if name in keep:
                    self.set((component, name), new, guard)

    def set(self, key: Key, new: Node, guard: Node) -> None:
        if guard is not self.graph.true:
            new = self.graph.select(guard, new, self.value(key[0], "state", key[1]))
        if key in self.holds:
            same = self.graph.equal(new, self.holds[key])
            if same is not self.graph.true:
                self.depart(self.graph.make(ca.OP_NOT, (same,)))
            new = self.graph.constant(self.holds[key])
        self.values[key] = new

    def nodes(self, component: str, function: Any) -> list[Node]:
        block = self.batch_system.system.components[component]
        names = [block.flat_names(kind) for kind in GROUPS]

        def leaf(group: int, element: int) -> Node:
            return self.value(component, GROUPS[group], names[group][element])

        return [self.graph.known(node) for node in read(function, leaf, self.graph.make)[0]]

    def value(self, component: str, kind: str, name: str) -> Node:
        """What a variable is now."""
        key = (component, name)
        if kind in ("state", "output"):
            if key in self.values:
                return self.graph.known(self.values[key])
            return self.graph.constant(self.holds[key]) if key in self.holds else self.lane(key)
        if key in self.batch_system.sources:
            source = self.batch_system.sources[key]
            return (
                self.graph.known(self.values[source]) if source in self.values else self.graph.leaf("unused")
            )
        if key in self.batch_system.fixed:
            return self.graph.constant(self.batch_system.fixed[key])
        if key in self.batch_system.own:
            return self.lane(key)
        return self.graph.leaf(_remember(self.shared, field_name(key), key))

    def lane(self, key: Key) -> Node:
        component, name = key
        variables = self.batch_system.system.components[component].variables().values()
        variable = next(v for v in variables if name in v.flat_names)
        return self.graph.leaf(_remember(self.leaves, field_name(key), key), variable.type)

    def settled(self, enumerated: Mapping[Key, float]) -> dict[Key, float]:
        """One more state that can be held, if there is one; the next may follow from it.

        Args:
            enumerated: the states that may be held, with their start values.
        """
        for key, node in self.writes().items():
            if key in enumerated:
                outcomes = _outcomes(node) - {self.lane(key)}
                return {key: next(iter(outcomes)).value if len(outcomes) == 1 else enumerated[key]}
        for key in enumerated:
            known = self.graph.known(self.lane(key))
            if key not in self.holds and known.op == ca.OP_CONST:
                return {key: known.value}
        return {}

    def writes(self) -> dict[Key, Node]:
        """The states that the tick changes."""
        return {
            (component, name): node
            for (component, name), node in self.values.items()
            if name in self.batch_system.system.components[component].flat_names("state")
            and (component, name) not in self.holds
            and node is not self.lane((component, name))
        }

    def tick(self) -> Tick:
        writes = self.writes()
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
            frozenset(known[node.field] for node in nodes if node.field in known)
            for known in (self.leaves, self.shared)
        )
        operations = sum(bool(node.operands) for node in nodes)
        always = self.departs is self.graph.true
        return Tick(self.holds, reads, frozenset(writes), common, (*writer.lines, *lines), operations, always)


def field_name(key: Key) -> str:
    """The C field of a component's variable: `controller_route_north_3`."""
    return f"{key[0]}_{key[1]}".replace("[", "_").replace("]", "")


def _is_choice(node: Node) -> bool:
    """Is it one of two constants?"""
    return node.op == SELECT and all(x.op == ca.OP_CONST for x in node.operands[1:])


def _real(op: int, operands: tuple[Node, ...]) -> Node:
    """An operation, in doubles where the blocks' own C takes integers: a lane holds nothing else."""
    node = Node(op, operands)
    if node.ctype != "bool":
        node.ctype = "real"
    return node


def _outcomes(node: Node) -> set[Node]:
    """What selects may come to."""
    return set().union(*map(_outcomes, node.operands[1:])) if node.op == SELECT else {node}


def _remember(known: dict[str, Key], text: str, key: Key) -> str:
    known[text] = key
    return text


def _by_readiness(results: Sequence[Node]) -> list[Node]:
    """All nodes behind the results, in the order in which they can be had if nothing waits for anything else.

    Chains of operations that do not wait for each other are interleaved by that, as a processor likes it.
    """
    ready: dict[Node, int] = {}
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
