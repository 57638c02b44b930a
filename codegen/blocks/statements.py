"""An update's results as C statements: locals, then a store for each result; stores that repeat as loops."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from codegen.blocks.expressions import Writer, bare, c_name, fields, member_of
from codegen.blocks.nodes import (
    SELECT,
    Node,
    Nodes,
    behind,
    count_uses,
    ctype_of,
    name_values,
    operations_behind,
    read,
)
from models.errors import DeclarationError
from models.kit.block import Block
from models.kit.declaration import flatten

SHORTEST_LOOP = 4  # stores


@dataclass(frozen=True)
class Store:
    """An assignment of an expression to a field, both as C writes them."""

    field: str
    text: str
    is_real: bool = False

    @property
    def vector(self) -> str:
        """The vector of which the field is an element; the field itself if it is none."""
        return _vector(self.field)

    @property
    def index(self) -> int | None:
        """Which element of the vector the field is."""
        _, bracket, index = self.field.partition("[")
        return int(index[:-1]) if bracket else None

    def in_loop(self, named: Mapping[str, int]) -> tuple[str, ...]:
        """The statement for any element, if it is the same for all; also with named values that count on."""
        text = self.text.replace(f"[{self.index}]", "[i]")
        counting = text
        for name, value in named.items():
            ahead = value - (self.index or 0)
            other = f"(i {'+' if ahead > 0 else '-'} {abs(ahead)})" if ahead else "i"
            counting = re.sub(rf"\b{name}\b", other, counting)
        return tuple(f"{self.vector}[i] = {each};" for each in dict.fromkeys((text, counting)))


def statements(
    function: Any,
    block: type[Block],
    writes: Sequence[str],
    writer: Writer,
    keep: Collection[str] | None = None,
) -> tuple[list[str], int]:
    """The body of an update: C lines that compute every result, then store them; and its operation count.

    Args:
        keep: the variables that matter, all by default; others are neither computed nor stored.
    """
    nodes = Nodes()
    results, _ = read(function, nodes.leaf(fields(block, writer.precision, writer.constants)), nodes.make)
    writes, results = kept(writes, results, keep)
    operations = operations_behind(results)
    assign(writes, results, block, writer)
    return writer.lines, operations


def kept(
    writes: Sequence[str], results: Sequence[Node], keep: Collection[str] | None
) -> tuple[list[str], list[Node]]:
    """The variables that matter, and their results."""
    pairs = [(name, node) for name, node in zip(writes, results, strict=True) if keep is None or name in keep]
    return [name for name, _ in pairs], [node for _, node in pairs]


def assign(writes: Sequence[str], results: Sequence[Node], block: type[Block], writer: Writer) -> None:
    """Write what sets each variable to its result.

    A result is stored at once if no other result reads the field. The others get locals where they are
    computed, and are stored behind all. Two measurements decided this:

    - Locals in the order of the results let x86 compilers choose without a branch: 4 % of a batch's time.
    - Each of several Real outputs has a local, since SDCC then computes the field's address behind the
      arithmetic, which has more registers till then: 300 clocks in `local_plane`.
    """
    declared = dict(flatten([v for kind in ("state", "output") for v in block.group(kind)]))
    targets = [f"m->{member_of(declared[name])}.{c_name(name)}" for name in writes]
    for name, node in zip(writes, results, strict=True):
        if node.op == SELECT and declared[name].choices:
            node.enumeration = declared[name]
    name_values(behind(results))
    count_uses(results)
    hinted = [(n, _next(name)) for name, n in zip(writes, results, strict=True) if not (n.hint or n.name)]
    for node, hint in hinted:
        node.hint = hint
    reads = [_reads(node) for node in results]
    late = [  # fields that other results read
        any(not reads[j].isdisjoint((target, _vector(target))) for j in range(len(reads)) if j != k)
        for k, target in enumerate(targets)
    ]
    at_once: list[Store] = []  # not written yet: those in a row may become a loop
    at_the_end: list[Store] = []
    for k, (name, target, node) in enumerate(zip(writes, targets, results, strict=True)):
        if node.field == target:  # it stays what it is
            continue
        variable, written = declared[name], len(writer.lines)
        ctype = ctype_of(variable, writer.precision)
        if ctype == "short" and node.ctype != "real" and not node.is_short:
            raise DeclarationError(
                f"{block.title()}: {name} can become {_range(node)}; expected -32768 to 32767, since its "
                "declared range fits 16 bits. Let it stop at its max (`counted`), or leave its max out"
            )
        is_real_output = variable.kind == "output" and node.ctype == "real" and len(results) > 1
        if node.op == ca.OP_CONST and variable.choices and node.value in list(variable.choices):
            text = writer.enum_name(variable, int(node.value))
        else:
            if node.operands:
                needs_local = node.uses > 1 or late[k] or is_real_output
            else:  # a field
                needs_local = any(node.field == store.field for store in at_the_end)
            if needs_local and not node.name:
                writer.name(node, ctype)
            text = writer.write_whole(node, ctype)
        if len(writer.lines) > written:
            writer.lines[written:written] = store_lines(_in_order(at_once), writer.enum_values)
            at_once = []
        (at_the_end if late[k] else at_once).append(Store(target, text, ctype == "real"))
    for node, _ in hinted:
        node.hint = ""
    for stores in (at_once, at_the_end):
        writer.lines += store_lines(_in_order(stores), writer.enum_values)


def _range(node: Node) -> str:
    low, high = node.range
    return f"{low:g} to {high:g}" if math.isfinite(high - low) else "any number of 32 bits"


def _in_order(stores: Sequence[Store]) -> list[Store]:
    """Reals first: between stores of one literal, copies of reals make SDCC 4.5 forget it (rabbit4000.py)."""
    return sorted(stores, key=lambda store: not store.is_real)


def _next(name: str) -> str:
    """The local of a variable's next value."""
    return "next_" + re.sub(r"\W", "_", name).rstrip("_")


def _reads(node: Node) -> set[str]:
    """The fields that a node's text reads; of vectors whose elements it chooses from, the vector."""
    return {inner.field for inner in behind([node]) if inner.field and not inner.name}


def _vector(field: str) -> str:
    return field.partition("[")[0]


def store_lines(stores: Iterable[Store], named: Mapping[str, int] | None = None) -> list[str]:
    """The stores as C, in their order; those that differ by their index alone as loops.

    Args:
        named: the named values that may stand in their texts.
    """
    runs: list[list[Store]] = []
    bodies: list[list[str]] = []  # of each run: the statements that do all of it
    for store in stores:
        last, ways = runs[-1][-1] if runs else None, store.in_loop(named or {})
        if last is not None and last.index is not None and store.index == last.index + 1:
            common = [way for way in bodies[-1] if way in ways]
            if common:
                runs[-1].append(store)
                bodies[-1] = common
                continue
        runs.append([store])
        bodies.append(list(ways))
    in_loop = {run[0]: body[0] for run, body in zip(runs, bodies, strict=True)}
    loops: list[tuple[range, list[list[Store]]]] = []  # of each: which elements, and the runs that it does
    for run in runs:
        first = run[0].index
        if first is None or len(run) < SHORTEST_LOOP:
            loops.append((range(0), [run]))
            continue
        elements = range(first, first + len(run))
        if loops and loops[-1][0] == elements and _independent([*loops[-1][1], run]):
            loops[-1][1].append(run)
        else:
            loops.append((elements, [run]))
    lines = []
    for elements, repeated in loops:
        if not elements:
            lines += [f"{store.field} = {store.text};" for run in repeated for store in run]
            continue
        lines.append(f"for (int i = {elements.start}; i < {elements.stop}; i++) {{")
        lines += [f"    {in_loop[run[0]]}" for run in repeated]
        lines.append("}")
    return lines


def _independent(runs: Sequence[Sequence[Store]]) -> bool:
    """May these runs of stores be done element by element? Yes, if none reads what another stores."""
    return not any(re.search(rf"{re.escape(a[0].vector)}\b", b[0].text) for a in runs for b in runs)


def condition(function: Any, block: type[Block], writer: Writer) -> tuple[str, int]:
    """A guard as one C expression, and its operation count."""
    nodes = Nodes()
    (node,), _ = read(function, nodes.leaf(fields(block, writer.precision, writer.constants)), nodes.make)
    name_values(behind([node]))
    count_uses([node])
    return bare(writer.write(node, "bool", locals_allowed=False)), operations_behind([node])
