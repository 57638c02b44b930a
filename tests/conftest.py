"""Blocks as compiled C, for tests that need many ticks: about a thousand times as fast as `Model`."""

from __future__ import annotations

import ctypes
import os
import shutil
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from codegen.blocks.block_c import generate, write_files
from codegen.blocks.expressions import c_name, c_type, member_of, members
from codegen.blocks.nodes import CType, ctype_of
from codegen.toolchains import sdcc
from codegen.toolchains.compiler import NUMERICS, CompileError, build_library
from models.kit.block import Block
from models.kit.declaration import Type, flatten
from tests.browser import browser, open_page  # noqa: F401 (fixtures)

# second opinions beside pip's compiler, and tools that are no Python packages: program -> Debian package
TOOLS = {
    "gcc": "gcc",
    "nm": "binutils",
    "clang": "clang libclang-rt-dev",
    "cppcheck": "cppcheck",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi",
    "qemu-system-arm": "qemu-system-arm",
    "openssl": "openssl",
    "cmake": "cmake",
    "qemu-aarch64": "qemu-user",
    "chromium": "chromium",
}
# libraries of such tools: of ecos, and of programs for ARM in an emulator; file -> Debian package
LIBRARIES = {
    "libtbb.so.12": "libtbb12",
    "/usr/aarch64-linux-gnu/lib/ld-linux-aarch64.so.1": "libc6-arm64-cross",
}


def missing() -> dict[str, str]:
    """What is not here, and how it is had."""
    absent = [(tool, package) for tool, package in TOOLS.items() if not shutil.which(tool)]
    absent += [(library, package) for library, package in LIBRARIES.items() if not _is_there(library)]
    tools = {name: f"apt install {package}" for name, package in absent}
    try:
        sdcc.home()
    except CompileError:
        tools["SDCC 4.5"] = "python -m codegen.toolchains.sdcc"
    return tools


def _is_there(library: str) -> bool:
    if library.startswith("/"):
        return os.path.exists(library)
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


MISSING = missing()
# with tests of minutes: they begin first, since one that begins last leaves the other workers idle
LONG = (
    "test_readme.py", "test_costs.py", "test_leading.py", "test_batch_back_to_back.py", "test_same_bits.py"
)  # fmt: skip
LEFT_OUT = f"left out: tests with {', '.join(MISSING)}; {'; '.join(MISSING.values())}"


def pytest_configure() -> None:
    if MISSING and os.environ.get("CI") == "true":
        raise pytest.UsageError(LEFT_OUT)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.name not in LONG)


def pytest_report_header() -> list[str]:
    return [LEFT_OUT] if MISSING else []


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update", action="store_true", help="write the golden files anew instead of comparing")


Columns = dict[str, np.ndarray[Any, Any]]

DRIVER = """#include "{title}.h"
void run({title} *m, long ticks, const double *u, double *y);
void run({title} *m, long ticks, const double *u, double *y)
{{
    for (long k = 0; k < ticks; k++) {{
{read}
        {title}_step(m);
{write}
    }}
}}
"""


class Native:
    """One instance of a block's generated C; `run` feeds columns of inputs and returns columns."""

    def __init__(
        self, block: type[Block], library: ctypes.CDLL, structure: type, parameters: Mapping[str, float]
    ):
        self.block, self.library = block, library
        self.data = structure()
        self._call("defaults")
        for name, value in parameters.items():
            self[name] = value
        self._call("initialize")

    def _call(self, action: str) -> None:
        getattr(self.library, f"{self.block.title()}_{action}")(ctypes.byref(self.data))

    def _place(self, name: str) -> tuple[Any, Any, Any]:
        variable = next(v for v in self.block.variables().values() if name in v.flat_names)
        group = getattr(self.data, member_of(variable))
        place = group if variable.size is None else getattr(group, variable.name)
        return place, variable, variable.flat_names.index(name)

    def __getitem__(self, name: str) -> float:
        place, variable, i = self._place(name)
        return float(getattr(place, name) if variable.size is None else place[i])

    def __setitem__(self, name: str, value: float) -> None:
        place, variable, i = self._place(name)
        value = float(value) if variable.type is Type.REAL else int(value)
        if variable.size is None:
            setattr(place, name, value)
        else:
            place[i] = value

    def run(self, **inputs: Any) -> Columns:
        """As many ticks as the longest input has rows; inputs not given stay as they are."""
        names = self.block.flat_names("input")
        columns = np.broadcast_arrays(*(np.atleast_1d(inputs.get(n, self[n])) for n in names))
        u = np.ascontiguousarray(np.column_stack(columns), dtype=np.float64)
        written = self.block.flat_names("output") + self.block.flat_names("state")
        y = np.empty((len(u), len(written)))
        double_p = ctypes.POINTER(ctypes.c_double)
        self.library.run(
            ctypes.byref(self.data),
            ctypes.c_long(len(u)),
            u.ctypes.data_as(double_p),
            y.ctypes.data_as(double_p),
        )
        return {name: y[:, i] for i, name in enumerate(written)}


@pytest.fixture(scope="session")
def native(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Native]:
    """`native(block, precision, parameters)`: a new instance of the block's C, initialized."""
    built: dict[tuple[type[Block], str], tuple[ctypes.CDLL, type]] = {}

    def make(
        block: type[Block], precision: str = "double", parameters: Mapping[str, float] | None = None
    ) -> Native:
        if (block, precision) not in built:
            folder = tmp_path_factory.mktemp(f"{block.title()}_{precision}")
            built[block, precision] = _build(block, precision, folder)
        return Native(block, *built[block, precision], parameters or {})

    return make


def _build(block: type[Block], precision: Any, folder: Any) -> tuple[ctypes.CDLL, type]:
    real = {"double": ctypes.c_double, "float": ctypes.c_float}[precision]
    types: dict[CType, Any] = {
        "real": real, "int": ctypes.c_int32, "short": ctypes.c_int16, "bool": ctypes.c_bool
    }  # fmt: skip
    files = generate(block, precision)
    inputs = list(flatten(block.group("input")))
    c_types = [c_type(ctype_of(v, precision), precision) for _, v in inputs]
    written = [(f"m->out.{c_name(n)}") for n in block.flat_names("output")]
    written += [(f"m->state.{c_name(n)}") for n in block.flat_names("state")]
    files["run.c"] = DRIVER.format(
        title=block.title(),
        read="\n".join(
            f"        m->in.{c_name(n)} = ({c_types[i]})u[k * {len(inputs)} + {i}];"
            for i, (n, _) in enumerate(inputs)
        ),
        write="\n".join(f"        y[k * {len(written)} + {i}] = (double){w};" for i, w in enumerate(written)),
    )
    write_files(files, folder)
    library = build_library(
        folder,
        [name for name in files if name.endswith(".c")],
        folder / "native.so",
        what=f"{block.title()} for tests",
        flags=(*NUMERICS, "-fno-sanitize=all"),
    )
    groups = []
    for member, variables in members(block).items():
        scalars = [(v, types[ctype_of(v, precision)]) for v in variables]
        fields = [(v.name, scalar * v.size if v.size else scalar) for v, scalar in scalars]
        groups.append((member, type(member, (ctypes.Structure,), {"_fields_": fields})))
    return ctypes.CDLL(str(library)), type(block.title(), (ctypes.Structure,), {"_fields_": groups})
