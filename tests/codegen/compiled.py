"""The blocks' generated C as a library, and its structs as numpy records laid out by the header itself."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from codegen.blocks.block_c import generate, write_files
from codegen.blocks.expressions import member_of
from models.kit.block import Block
from models.kit.declaration import Type, flatten
from models.system import BLOCKS

WARNINGS = (
    "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror",
)  # fmt: skip
ZIG = (sys.executable, "-m", "ziglang", "cc")
CTS = Path(__file__).parent / "blocks" / "cts.c"
TYPES = {"double": "f8", "float": "f4", "int32_t": "i4", "int16_t": "i2", "bool": "?"}
Record = np.ndarray[Any, Any]
# the C of a block, made once for all tests that only read it; mypy takes a class for nothing hashable
generated: Callable[[type[Block], Any], dict[str, str]] = cache(generate)  # type: ignore[assignment]


@dataclass(frozen=True)
class Build:
    """A compiler and how it is called."""

    name: str
    compiler: tuple[str, ...]
    flags: tuple[str, ...]


BUILDS = [
    Build("zig", ZIG, ("-std=c99", "-O2", "-ffp-contract=off", "-fno-sanitize=all", *WARNINGS)),
    *(
        [
            Build("gcc", ("gcc",), ("-std=c99", "-O2", "-ffp-contract=off", *WARNINGS)),
            Build(
                "gcc-O3-native",
                ("gcc",),
                ("-std=c99", "-O3", "-march=native", "-ffp-contract=off", *WARNINGS),
            ),
        ]
        if shutil.which("gcc")
        else []
    ),
]
QUICKEST = BUILDS[1] if len(BUILDS) > 1 else BUILDS[0]


def compile_c(
    build: Build, sources: Sequence[str | Path], folder: Path, output: str, extra: Sequence[str] = ()
) -> Path:
    """Compile in a folder; an error or a warning fails with the compiler's message."""
    command = [*build.compiler, *build.flags, *extra, "-I.", "-o", output, *map(str, sources)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return folder / output


def struct_members(header: str) -> dict[str, list[tuple[str, str, int | None]]]:
    """What a header declares: member of the struct -> (C type, name, size of a vector) of each field."""
    members = {}
    header = re.sub(r"\n {8,}\* ", " ", header)  # comments that take several lines
    structs = re.findall(r"    struct (?:\w+ )?\{ /\* [\w ]+ \*/\n(.*?)\n    \} (\w+);", header, re.DOTALL)
    for body, member in structs:
        fields = re.findall(r"^        (\w+) (\w+)(?:\[(\d+)\])?; /\* .* \*/$", body, re.MULTILINE)
        assert len(fields) == len(body.splitlines()), body
        members[member] = [(c_type, name, int(size) if size else None) for c_type, name, size in fields]
    return members


class Library:
    """All blocks of a precision, compiled together; a block's struct is the numpy type `types[block]`."""

    def __init__(self, build: Build, precision: Any, folder: Path) -> None:
        blocks = [block for block in BLOCKS if precision in block.precisions]
        files: dict[str, str] = {}
        driver = ["#include <stddef.h>"]
        self.types: dict[type[Block], np.dtype[Any]] = {}
        for block in blocks:
            title = block.title()
            files |= generated(block, precision)
            driver += [
                f'#include "{title}.h"',
                f"size_t {title}_size(void);",
                f"size_t {title}_size(void) {{ return sizeof({title}); }}",
                f"void {title}_step_all({title} *m, int n);",
                f"void {title}_step_all({title} *m, int n) {{ for (; n > 0; n--) {{ {title}_step(m++); }} }}",
            ]
            members = struct_members(files[f"{title}.h"])
            self.types[block] = np.dtype(
                [
                    (
                        member,
                        np.dtype(
                            [(n, TYPES[t], (size,)) if size else (n, TYPES[t]) for t, n, size in fields],
                            align=True,
                        ),
                    )
                    for member, fields in members.items()
                ],
                align=True,
            )
        files["driver.c"] = "\n".join(driver) + "\n"
        write_files(files, folder)
        sources: list[str | Path] = [name for name in files if name.endswith(".c")]
        if precision == "double":
            sources.append(CTS)
        self.path = compile_c(build, sources, folder, "blocks.so", ("-shared", "-fPIC", "-lm"))
        self.c = ctypes.CDLL(str(self.path))
        for block in blocks:
            assert self.types[block].itemsize == getattr(self.c, f"{block.title()}_size")()

    def records(
        self, block: type[Block], count: int = 1, parameters: Mapping[str, float] | None = None
    ) -> Record:
        """Instances of a block's struct, initialized with these parameters."""
        records = np.zeros(count, dtype=self.types[block])
        self.each("defaults", block, records)
        for name, value in (parameters or {}).items():
            put(block, records, name, value)
        self.each("initialize", block, records)
        return records

    def each(self, action: str, block: type[Block], records: Record) -> None:
        """Call `<block>_<action>` for each instance."""
        call = getattr(self.c, f"{block.title()}_{action}")
        for i in range(len(records)):
            call(ctypes.c_void_p(records.ctypes.data + i * records.itemsize))

    def step(self, block: type[Block], records: Record) -> None:
        """One tick of every instance."""
        getattr(self.c, f"{block.title()}_step_all")(ctypes.c_void_p(records.ctypes.data), len(records))


def place(block: type[Block], records: Record, flat_name: str) -> tuple[Record, Any]:
    """The array that holds a scalar of every instance, and the index into it."""
    name, bracket, index = flat_name.partition("[")
    member = member_of(block.variables()[name])
    return records[member][name], (slice(None), int(index[:-1]) - 1) if bracket else slice(None)


def put(block: type[Block], records: Record, flat_name: str, value: Any) -> None:
    """Set a scalar of every instance."""
    array, index = place(block, records, flat_name)
    array[index] = value


def get(block: type[Block], records: Record, flat_name: str) -> Record:
    """A scalar of every instance."""
    array, index = place(block, records, flat_name)
    scalar: Record = array[index]
    return scalar


class CompiledModel:
    """One instance in C, used as a `Model` is."""

    def __init__(
        self, library: Library, block: type[Block], parameters: Mapping[str, float] | None = None
    ) -> None:
        self.block, self.library = block, library
        self.records = library.records(block, 1, parameters)
        self._places = {
            n: place(block, self.records, n)
            for kind in ("state", "input", "parameter", "output")
            for n in block.flat_names(kind)
        }

    def initialize(self) -> None:
        self.library.each("initialize", self.block, self.records)

    def step(self) -> None:
        self.library.step(self.block, self.records)

    def __getitem__(self, name: str) -> float:
        array, index = self._places[name]
        return float(array[index][0])

    def __setitem__(self, name: str, value: float) -> None:
        array, index = self._places[name]
        array[index] = value

    def vector(self, kind: str) -> Record:
        """All scalars of a group in their order, as `Model.state` and `Model.output` are."""
        parts = [
            np.ravel(self.records[member_of(v)][v.name]).astype(np.float64) for v in self.block.group(kind)
        ]
        return np.concatenate(parts) if parts else np.zeros(0)


def random_states(block: type[Block], count: int, rng: np.random.Generator) -> dict[str, Any]:
    """States, inputs and parameters from their whole ranges, and as small as they are in trials."""
    drawn: dict[str, Any] = {}
    for kind in ("state", "input", "parameter"):
        for name, v in flatten(block.group(kind)):
            if v.type is Type.BOOLEAN:
                drawn[name] = rng.integers(0, 2, count)
            elif v.type is Type.INTEGER:
                low, high = v.min or 0, 90 if v.max is None or v.max > 90 else v.max
                drawn[name] = rng.integers(int(low), int(high) + 1, count)
            elif name.partition("[")[0] in {s.name for s in block.streams()}:
                drawn[name] = rng.integers(1, 4294944443, count).astype(float)
            else:
                low = -60.0 if v.min is None else max(v.min, -60.0)
                high = 60.0 if v.max is None else min(v.max, 60.0)
                size = rng.choice([1.0, 0.05], count)
                drawn[name] = np.clip(rng.uniform(low, high, count) * size, low, high)
    for name in {"covariance[1]", "covariance[2]", "covariance[3]", "covariance[4]"} & drawn.keys():
        drawn[name] = np.abs(drawn[name]) + 1e-3
    return drawn
