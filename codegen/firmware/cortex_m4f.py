"""The onboard program compiled for the ARM Cortex-M4F, as it lies in a board's memory: the firmware's image.

Compiled without a C library: `onboard/arm` has the few functions that the program needs, the start-up
and the linker's sections. The compiler is pip's; arm-none-eabi-gcc takes the same sources and flags.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from elftools.elf.elffile import ELFFile

from codegen.blocks.block_c import write_files
from codegen.cache import stored
from codegen.firmware.image import BOARD, Footprint, Image, own_files
from codegen.firmware.targets import Target
from codegen.scratch import Scratch
from codegen.toolchains.compiler import WARNINGS, compiler_version, zig

TRIPLE = ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m4+vfp4d16sp")  # `cortex_m4` has no FPU
# -O2 takes 15 % more code than -Os and 2 to 4 % fewer instructions, and there is room
PORTABLE = (
    "-std=c99", "-O2", "-ffp-contract=off", "-ffreestanding", "-nostdlib", "-fomit-frame-pointer",
    "-fno-unwind-tables", "-fno-asynchronous-unwind-tables", "-ffunction-sections", "-fdata-sections",
)  # fmt: skip
LINKING = ("-Wl,--gc-sections", "-Wl,-e,Reset_Handler")
# the threshold saves 2 % of the instructions for 4 % of code
FLAGS = (
    *TRIPLE, *PORTABLE, *WARNINGS, "-mllvm", "-inline-threshold=450",
    "-fno-sanitize=all", "-g", "-I.", *LINKING,
)  # fmt: skip
STATE = "vest"  # the program's memory, which counts although pil.c declares it


def cortex_m4f_image(target: Target, files: Mapping[str, str]) -> Image:
    """An ELF file of the program and its start-up, from address 0 on; symbols without the bit for Thumb.

    Args:
        files: of the program and the processor in the loop; they replace the target's own of the same name.

    Raises:
        CompileError: with the compiler's own words.
    """
    files = {name: text for name, text in (own_files(target) | dict(files)).items() if name not in BOARD}
    return _image(target, files, "onboard.elf")


def board_image(target: Target, files: Mapping[str, str]) -> Image:
    """An ELF file of a bundle, with its own main and port: what a board is flashed with.

    Args:
        files: of the bundle, by the simulation's key or none (see `image.with_key`).

    Raises:
        CompileError: with the compiler's own words.
    """
    return _image(target, files, "board.elf")


def _image(target: Target, files: Mapping[str, str], name: str) -> Image:
    def make(path: Path) -> None:
        with Scratch(path.parent) as scratch:
            folder = scratch.resolve()
            write_files(dict(files), folder)
            sources = sorted(n for n in files if n.endswith(".c"))
            options = (f"-Wl,-T,{target.script}", f"-ffile-prefix-map={folder}=.")
            zig(["cc", *FLAGS, *options, "-o", path.name, *sources], "onboard for the Cortex-M4F", folder)
            (folder / path.name).replace(path)

    asked = (compiler_version(), FLAGS, target.script, sorted(files.items()))
    path = stored(f"firmware/{target.name}/{name}", asked, make)
    with path.open("rb") as file:
        elf = ELFFile(file)
        symbols = {s.name: s["st_value"] & ~_thumb(s) for s in _table(elf) if s.name}
        return Image(path, symbols, _footprint(elf, {n for n in files if n.startswith("pil")}))


def _table(elf: Any) -> list[Any]:
    return list(elf.get_section_by_name(".symtab").iter_symbols())


def _thumb(symbol: Any) -> int:
    return 1 if symbol["st_info"]["type"] == "STT_FUNC" else 0


def _footprint(elf: Any, entries: set[str]) -> Footprint:
    """Sections without the symbols that the entries' compilation units define.

    Padding between symbols counts for the program; vectors count as constants.
    """
    own = _defined(elf, entries) - {STATE}
    sizes = {section.name: section["sh_size"] for section in elf.iter_sections()}
    for symbol in _table(elf):
        if symbol.name in own and isinstance(symbol["st_shndx"], int):
            sizes[elf.get_section(symbol["st_shndx"]).name] -= symbol["st_size"]
    data = sizes[".data"]
    return Footprint(
        code=sizes[".text"], constants=sizes[".vectors"] + sizes[".rodata"] + data, ram=data + sizes[".bss"]
    )


def _defined(elf: Any, entries: set[str]) -> set[str]:
    """Names of functions and variables of these source files, by the debug information."""
    names = set()
    for unit in elf.get_dwarf_info().iter_CUs():
        top = unit.get_top_DIE()
        if Path(top.get_full_path()).name in entries:
            for entry in top.iter_children():
                here = "DW_AT_name" in entry.attributes and "DW_AT_declaration" not in entry.attributes
                if here and entry.tag in ("DW_TAG_subprogram", "DW_TAG_variable"):
                    name = entry.attributes["DW_AT_name"].value.decode()
                    names.add(name)
                    names |= {f"{name}.{v}" for v in _variables_in(entry)}
    return names


def _variables_in(function: Any) -> set[str]:
    """Names of a function's variables; Clang calls a static one `function.variable`."""
    return {
        entry.attributes["DW_AT_name"].value.decode()
        for entry in function.iter_children()
        if entry.tag == "DW_TAG_variable" and "DW_AT_name" in entry.attributes
    }
