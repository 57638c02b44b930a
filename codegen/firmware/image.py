"""The onboard program compiled for a target, with the processor-in-the-loop mailbox in its board's place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from codegen.blocks.block_c import write_files
from codegen.cache import stored
from codegen.firmware.bundle import added
from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.firmware.targets import Target
from codegen.scratch import Scratch
from codegen.toolchains.compiler import (
    NUMERICS,
    PLATFORMS,
    WARNINGS,
    CompileError,
    build_library,
    compiler_version,
    this_platform,
    zig,
)

# of Linux; zig's headers have those of the newest glibc, which the functions of an older one refuse
BAUD_RATES = ("-DGPS_BAUD=0000017U", "-DIMU_BAUD=0010002U", "-DRADIO_BAUD=0010001U")
BOARD = ("main.c", "port.c")  # the processor in the loop has its own


@dataclass(frozen=True)
class Footprint:
    """Bytes of the onboard program, without mailbox, record and board.

    Attributes:
        code: instructions, with arithmetic and start-up.
        constants: tables and literals outside the instructions.
        ram: the program's memory, static data of its arithmetic included; without the stack.
    """

    code: int
    constants: int
    ram: int


@dataclass(frozen=True)
class Image:
    """A program that a processor runs.

    Attributes:
        path: the file to load.
        symbols: addresses by C name.
        footprint: None on the host, where it means little.
    """

    path: Path
    symbols: Mapping[str, int]
    footprint: Footprint | None = None


def own_files(target: Target) -> dict[str, str]:
    """What a target adds to the program, without its board's; pil* are for the mailbox."""
    return {name: text for name, text in added(target).items() if name not in BOARD}


def host_image(target: Target, files: Mapping[str, str]) -> Image:
    """A shared library for this machine, whose functions pil_start and pil_tick are the processor.

    Raises:
        CompileError: with the compiler's own words.
    """
    flags = (*NUMERICS, *WARNINGS, "-fno-sanitize=all", "-g0")

    def make(path: Path) -> None:
        with Scratch() as scratch:
            write_files(dict(files), scratch)
            sources = [n for n in files if n.endswith(".c") and n not in (*BOARD, "pil_main.c")]
            build_library(scratch, sources, path, what="onboard", flags=flags)

    asked = (compiler_version(), this_platform(), flags, sorted(files.items()))
    return Image(stored(f"firmware/{target.name}/onboard.so", asked, make), {})


def host_program(target: Target, files: Mapping[str, str]) -> Image:
    """The bundle's program for this machine, as its Makefile makes it of its sources, by pip's compiler.

    Args:
        files: of a bundle for `host` (see `bundle.bundle`).

    Raises:
        CompileError: with the compiler's own words.
    """
    sources = sorted(name for name in files if name.endswith(".c"))
    system = PLATFORMS[this_platform()].target
    rates = BAUD_RATES if "-linux-gnu" in system else ()
    flags = ("-target", system, *rates, *NUMERICS, *WARNINGS, "-fno-sanitize=all", "-g0")

    def make(path: Path) -> None:
        with Scratch() as folder:
            write_files(dict(files), folder)
            prefix = f"-ffile-prefix-map={folder}=."
            zig(["cc", *flags, prefix, "-o", str(path), *sources, "-lm"], "onboard for this machine", folder)

    code = sorted((name, text) for name, text in files.items() if name.endswith((".c", ".h")))
    return Image(stored(f"firmware/{target.name}/onboard", (compiler_version(), flags, code), make), {})


def with_key(image: Image, key: Key, folder: Path) -> Image:
    """The image with this key in the place of the simulation's: no compiler and no cache sees a secret.

    Args:
        image: of a program that was made with SIMULATION_KEY.
        folder: gets the file; nobody else may read it.

    Raises:
        CompileError: the key's bytes do not stand in the image's file once.
    """
    if key == SIMULATION_KEY:
        return image
    content = image.path.read_bytes()
    if (found := content.count(SIMULATION_KEY.data)) != 1:
        raise CompileError(f"{image.path.name}: has {found} places for a key, expected one")
    path = folder / image.path.name
    path.write_bytes(content.replace(SIMULATION_KEY.data, key.data))
    return replace(image, path=path)
