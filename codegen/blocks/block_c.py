"""A block's C: `<block>.h` with its structs, `<block>.c` with its tick, and the shared random streams."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import Any

from codegen.blocks.decisions import Row, decide, questions, write_decisions
from codegen.blocks.expressions import (
    MEMBERS,
    MISSION,
    Writer,
    c_name,
    c_type,
    constant_name,
    fields,
    literal,
    member_of,
    members,
)
from codegen.blocks.layout import HARD_SPACE, fit
from codegen.blocks.nodes import Nodes, behind, ctype_of, name_values, operations_behind, read
from codegen.blocks.statements import Store, assign, condition, kept, statements, store_lines
from codegen.files import write_whole
from codegen.templating import environment
from models.errors import DeclarationError
from models.kit import random
from models.kit.block import Block, first_line
from models.kit.declaration import Type, Variable
from models.kit.elementary import Precision
from models.kit.tracing import Table, Transition, Update

VERSION = "1"  # of the generator: what the banner states
# of a block's struct: what each member holds
CONTENTS = {name: f"{kind}s" for kind, name in MEMBERS.items()} | {MISSION: "parameters that are latched"}
TEMPLATES = environment(Path(__file__).parent / "templates")


@dataclass(frozen=True)
class Routine:
    """One C function of a block's tick."""

    name: str
    doc: str
    lines: list[str]
    operations: int
    guard: str = ""


def generate(
    block: type[Block],
    precision: Precision = "double",
    keep: frozenset[str] | None = None,
    constants: Mapping[str, float] | None = None,
    instance: str = "",
    *,
    preset: bool = False,
) -> dict[str, str]:
    """The C of a block, file name to text; the same block gives the same bytes.

    Args:
        keep: the states and outputs that matter, all by default; the C leaves the others as they are.
        constants: values of scalar parameters that become macros of the header instead of fields.
        instance: the only one, as C, in memory that was cleared: the functions know its address, do not look
            at their pointer, and set no 0.
        preset: others set the parameters that are not latched, from a table: `defaults` leaves them out.

    Raises:
        DeclarationError: the block does not have this precision, or an operation needs a library function.
    """
    if precision not in block.precisions:
        raise DeclarationError(
            f"{block.title()} comes in {' and '.join(block.precisions)} precision, not in {precision}"
        )
    program = block.program(precision)
    constants = constants or {}
    generator = _Generator(block, precision, keep, constants)
    routines = [generator.routine(phase) for phase in program.tick if generator.matters(phase)]
    start = [
        generator.routine(phase)
        for phase in program.initialize
        if phase.name.startswith("initialize") and generator.matters(phase)
    ]
    title = block.title()
    context: dict[str, Any] = {
        "block": title,
        "instance": instance,
        "doc": block.summary(),
        "source_of": block.source,
        "version": VERSION,
        "precision": precision,
        "sample_time": block.sample_time,
        "sample_time_literal": literal(block.sample_time, precision),
        "structs": [
            _Struct(name, variables, precision, constants) for name, variables in members(block).items()
        ],
        "constants": [
            {
                "name": constant_name(block, v.name),
                "value": start_literal(v, constants[v.name], precision),
                "comment": comment(v),
            }
            for v in block.group("parameter")
            if v.name in constants
        ],
        "enums": _enums(block),
        "routines": routines,
        "initialize": start,
        "streams": [v for v in block.streams() if keep is None or not keep.isdisjoint(v.flat_names)],
        "starts": [
            line
            for name, variables in members(block).items()
            if not (instance and name == MEMBERS["state"])  # `initialize` sets them
            if not (preset and name == MEMBERS["parameter"])
            for line in _starts(variables, block, precision, constants, cleared=bool(instance))
        ],
        "state_starts": _starts(block.group("state"), block, precision, cleared=bool(instance)),
        "moore": block.moore,
        "operations": ", ".join(f"{r.name}{HARD_SPACE}{r.operations}" for r in [*start, *routines]),
    }
    files = {
        f"{title}.h": TEMPLATES.get_template("block.h.jinja").render(context),
        f"{title}.c": TEMPLATES.get_template("block.c.jinja").render(context),
    }
    digest = hashlib.sha256("".join(files.values()).encode()).hexdigest()[:16]
    files = {name: fit(text.replace("@hash@", digest)) for name, text in files.items()}
    if block.streams():
        files |= streams_c()
    return files


def streams_c() -> dict[str, str]:
    """The C that starts a random stream, shared by all blocks that draw."""
    context = {
        "random": random,
        "streams": random.jumps(random.STREAM_BITS, random.STREAM_DIGITS),
        "substreams": random.jumps(random.SUBSTREAM_BITS, random.SUBSTREAM_DIGITS),
    }
    return {
        f"mrg32k3a.{kind}": fit(TEMPLATES.get_template(f"mrg32k3a.{kind}.jinja").render(context))
        for kind in "hc"
    }


class _Struct:
    """One struct of the header: a member for each variable."""

    def __init__(
        self, member: str, variables: Sequence[Variable], precision: Precision, constants: Collection[str]
    ) -> None:
        self.member, self.content = member, CONTENTS[member]
        self.fields = [
            {
                "type": c_type(ctype_of(v, precision), precision),
                "name": v.name + (f"[{v.size}]" if v.size else ""),
                "comment": comment(v),
            }
            for v in variables
            if v.name not in constants
        ]


def comment(variable: Variable) -> str:
    """Unit and meaning."""
    unit = f"{variable.unit}: " if variable.unit not in ("", "1") else ""
    return unit + variable.meaning


def _enum_prefix(block: type[Block], choices: type[IntEnum]) -> str:
    return f"{block.title()}_{re.sub(r'(?<=[a-z])(?=[A-Z])', '_', choices.__name__)}".upper()


def _enums(block: type[Block]) -> list[dict[str, Any]]:
    enumerations = dict.fromkeys(v.choices for v in block.variables().values() if v.choices)
    return [
        {
            "doc": first_line(choices),
            "members": [(f"{_enum_prefix(block, choices)}_{c.name}", int(c)) for c in choices],
        }
        for choices in enumerations
        if choices
    ]


def _starts(
    variables: Sequence[Variable],
    block: type[Block],
    precision: Precision,
    constants: Collection[str] = (),
    *,
    cleared: bool = False,
) -> list[str]:
    """Assignments of the declared start values; in memory that is `cleared`, of those that are not 0."""
    stores = []
    for v in variables:
        if v.name not in constants:
            for name, value in zip(v.flat_names, v.start, strict=True):
                if cleared and value == 0:
                    continue
                named = v.choices is not None and value in list(v.choices)
                text = enum_name(block, v, int(value)) if named else start_literal(v, value, precision)
                stores.append(Store(f"m->{member_of(v)}.{c_name(name)}", text))
    return store_lines(stores)


def start_literal(variable: Variable, value: float, precision: Precision) -> str:
    """A value of a variable as C."""
    if variable.type is Type.REAL:
        return literal(value, precision)
    if variable.type is Type.BOOLEAN:
        return "true" if value else "false"
    return str(int(value))


def enum_name(block: type[Block], variable: Variable, value: int) -> str:
    """The C name of a value of an enumeration."""
    assert variable.choices
    return f"{_enum_prefix(block, variable.choices)}_{variable.choices(value).name}"


class _Generator:
    """Writes the routines of one program."""

    def __init__(
        self,
        block: type[Block],
        precision: Precision,
        keep: frozenset[str] | None,
        constants: Collection[str],
    ) -> None:
        self.block, self.precision, self.keep = block, precision, keep
        self.constants = constants

    def matters(self, phase: Update | Table) -> bool:
        """Does the phase set anything that is kept?"""
        rows = phase.rows if isinstance(phase, Table) else (phase,)
        return self.keep is None or any(not self.keep.isdisjoint(row.writes) for row in rows)

    def writer(self) -> Writer:
        return Writer(self.precision, partial(enum_name, self.block), constants=self.constants)

    def routine(self, phase: Update | Table) -> Routine:
        if isinstance(phase, Table):
            lines, operations = self._table(phase)
        else:
            lines, operations = statements(phase.function, self.block, phase.writes, self.writer(), self.keep)
        guard = ""
        if phase.guard is not None:
            guard, guard_operations = condition(phase.guard, self.block, self.writer())
            operations += guard_operations
        return Routine(phase.name, phase.doc, lines, operations, guard)

    def _table(self, table: Table) -> tuple[list[str], int]:
        """A switch over the mode, in each case the decisions of its rows."""
        variable = self.block.variables()[table.mode]
        lines, operations = [f"switch (m->state.{table.mode}) {{"], 0
        modes: dict[int, list[Transition]] = {}
        for row in table.rows:
            modes.setdefault(row.mode, []).append(row)
        for mode, transitions in modes.items():
            name = enum_name(self.block, variable, mode) if variable.choices else str(mode)
            case, case_operations = self._case(transitions)
            has_locals = any(line.startswith("const ") for line in case)
            lines.append(f"case {name}:{' {' if has_locals else ''}")
            lines += [f"    {line}" for line in [*case, "break;"]]
            lines += ["}"] if has_locals else []
            operations += case_operations
        return [*lines, "default:", "    break;", "}"], operations

    def _case(self, transitions: Sequence[Transition]) -> tuple[list[str], int]:
        """The decisions of a mode, and how many operations they take together."""
        nodes, writer, rows = Nodes(), self.writer(), []
        leaf = nodes.leaf(fields(self.block, self.precision, self.constants))
        for transition in transitions:
            (guard,), _ = read(transition.guard, leaf, nodes.make)
            results, _ = read(transition.function, leaf, nodes.make)
            writes, results = kept(transition.writes, results, self.keep)
            body = partial(assign, writes, results, self.block, writer)
            rows.append(Row(questions(guard), tuple(results), body))
        everything = [n for row in rows for n in (*row.questions, *row.results)]
        name_values(behind(everything))
        operations = operations_behind(everything)
        write_decisions(decide(rows), writer)
        return writer.lines, operations


def write_files(files: dict[str, str], folder: Path, mode: int | None = None) -> list[Path]:
    """Write generated files into a folder (made if need be), each whole or not at all.

    Args:
        mode: of the files, as chmod takes it; None for the process's own.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return [write_whole(folder / name, text.encode(), mode) for name, text in files.items()]
