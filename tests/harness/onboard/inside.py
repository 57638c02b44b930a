"""The memory of the program on this machine, to read and to change."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from functools import cache
from typing import Any

from codegen.blocks.block_c import generate
from codegen.firmware.bundle import headers
from codegen.firmware.navigation import DEFAULT
from tests.codegen.compiled import struct_members
from tests.codegen.firmware.onboard_drivers import STRUCTS, TYPES


def _struct(name: str, fields: Iterable[tuple[str, Any, int | None]]) -> Any:
    laid = [(member, kind * size if size else kind) for member, kind, size in fields]
    return type(name, (ctypes.Structure,), {"_fields_": laid})


@cache
def _blocks() -> dict[str, Any]:
    """The structs of the program's blocks, by their types in C."""
    return {
        block.title(): _struct(
            block.title(),
            [
                (member, _struct(member, [(n, TYPES[c], size) for c, n, size in fields]), None)
                for member, fields in struct_members(
                    generate(block, "float", preset=True)[f"{block.title()}.h"]
                ).items()
            ],
        )
        for block in DEFAULT.blocks.values()
    }


@cache
def _onboard() -> Any:
    kinds = TYPES | STRUCTS | _blocks()
    return _struct("onboard", [(m.name, kinds[m.type], m.size) for m in headers().structs["onboard"]])


def inside(library: ctypes.CDLL) -> Any:
    """`vest` of onboard.h in a library of the program: a struct whose members may be set."""
    return _onboard().in_dll(library, "vest")
