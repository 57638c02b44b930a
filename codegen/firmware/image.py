"""The onboard program compiled for a target, with the processor-in-the-loop mailbox in its board's place."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from codegen.blocks.block_c import write_files
from codegen.firmware.bundle import SOURCES
from codegen.firmware.targets import Target
from codegen.toolchains.compiler import (
    NUMERICS,
    WARNINGS,
    build_library,
    cache_folder,
    compiler_version,
    this_platform,
)

BOARD = ("main.c", "port.c")  # for which the processor in the loop has its own


@dataclass(frozen=True)
class Footprint:
    """Bytes that the onboard program takes: without mailbox, record and board.

    Attributes:
        code: instructions, with the arithmetic and start-up that they need.
        constants: tables and literals that are not in the instructions.
        ram: what it remembers, static data of its arithmetic included; without the stack.
    """

    code: int
    constants: int
    ram: int


@dataclass(frozen=True)
class Image:
    """What a simulated processor runs.

    Attributes:
        path: the file that it loads.
        symbols: addresses by C name.
        footprint: None on the host, where it tells nothing.
    """

    path: Path
    symbols: Mapping[str, int]
    footprint: Footprint | None = None


def own_files(target: Target) -> dict[str, str]:
    """A target's own sources, headers and scripts but its board's; those named pil* are not for one."""
    folder = SOURCES / target.folder
    return {path.name: path.read_text() for path in sorted(folder.iterdir()) if path.name not in BOARD}


def image_folder(target: Target, files: Mapping[str, str], toolchain: str) -> Path:
    """Where the image of these sources is kept: the same sources and toolchain, the same folder."""
    digest = hashlib.sha256("\0".join([toolchain, *(f"{n}\0{t}" for n, t in sorted(files.items()))]).encode())
    return cache_folder() / "firmware" / target.name / digest.hexdigest()[:24]


def host_image(target: Target, files: Mapping[str, str]) -> Image:
    """A shared library for this machine, whose functions pil_start and pil_tick are the processor.

    Raises:
        CompileError: with the compiler's own words.
    """
    flags = (*NUMERICS, *WARNINGS, "-fno-sanitize=all", "-g0")
    folder = image_folder(target, files, " ".join([compiler_version(), this_platform(), *flags]))
    path = folder / "onboard.so"
    if not path.exists():
        with tempfile.TemporaryDirectory() as scratch:
            write_files(dict(files), Path(scratch))
            sources = [n for n in files if n.endswith(".c") and n not in (*BOARD, "pil_main.c")]
            build_library(Path(scratch), sources, path, what="onboard", flags=flags)
    return Image(path, {})
