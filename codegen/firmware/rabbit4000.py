"""The onboard program compiled for the Rabbit 4000 by SDCC, with the processor in the loop.

Objects are kept: SDCC takes half a minute for all of them, and other parameters change only one file.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from codegen.blocks.block_c import write_files
from codegen.cache import stored
from codegen.firmware.image import BOARD, Footprint, Image, own_files
from codegen.firmware.targets import Target
from codegen.scratch import Scratch
from codegen.toolchains.compiler import CompileError
from codegen.toolchains.sdcc import LANGUAGE, VERSION, assemble, home, sdcc

# by measurement: speed instead of size gives 0.1 % more clocks and 0.6 % more code; 3000 takes twice as long
FLAGS = (
    *("--opt-code-size", "--max-allocs-per-node", "1000"),
    *("--codeseg", "BANK0", "--constseg", "CONST", "--fverbose-asm"),
)
# a condition that a parameter's constant decides: "conditional flow changed by optimizer", "unreachable code"
DECIDED = ("--disable-warning", "110", "--disable-warning", "126")
ASSEMBLER = "-plosgff"
LENGTHENED = ("\tjr\t", "\tjp\t")
# an object depends on these and its sources
TOOLS = (VERSION, ASSEMBLER, *LANGUAGE, *FLAGS, *DECIDED, *LENGTHENED)
# logical addresses, as crt0.s has them
CODE_AT = 0x0080  # behind crt0, which begins at 0
BANKS_AT = 0x6000  # below it, what is never switched out
DATA_AT = 0xE000  # 8 kB with the stack; a board's interrupt vectors come first
BANK1_AT = 0x10000 + BANKS_AT  # physical
LINKING = (
    *("--no-std-crt0", "--code-loc", hex(CODE_AT), "--data-loc", hex(DATA_AT)),
    f"-Wl-b_BANK1={BANK1_AT:#x}",
)
AT_ONCE = 2  # SDCC processes
MAIN = "main.c"  # of a board; the processor in the loop has its own
CODE, CONSTANTS, RAM = (
    ("_CODE", "_HOME", "_BANK0", "_GSINIT", "_GSFINAL", "_BANK1"),
    ("_CONST",),
    ("_DATA", "_INITIALIZED", "_BSS"),
)
Sizes = dict[str, int]  # bytes by area


def rabbit4000_image(target: Target, files: Mapping[str, str]) -> Image:
    """An Intel hex file of the program with its start-up and arithmetic; symbols without C's underscore.

    Args:
        files: of the program and the processor in the loop; they replace the target's own of the same name.

    Raises:
        CompileError: with the compiler's own words, or the program does not fit into the memory.
    """
    files = own_files(target) | dict(files)
    path, linker_map, objects = _linked(target, files)
    areas, symbols = read_map(linker_map)
    return Image(path, symbols, _footprint(areas, objects))


def program_image(target: Target, files: Mapping[str, str]) -> Image:
    """An image of another program, with a main of its own.

    Raises:
        CompileError: as `rabbit4000_image`.
    """
    path, linker_map, _ = _linked(target, own_files(target) | dict(files))
    return Image(path, read_map(linker_map)[1])


def _linked(target: Target, files: Mapping[str, str]) -> tuple[Path, Path, dict[str, Path]]:
    """The image, the linker's map and the objects by their sources."""
    objects = _objects(target, files)
    without_board = [path for name, path in objects.items() if name not in BOARD]
    asked = (TOOLS, LINKING, sorted(files.items()))

    def linked(suffix: str) -> Path:
        return stored(
            f"firmware/{target.name}/onboard{suffix}",
            asked,
            lambda path: link(without_board, path.parent).with_suffix(suffix).replace(path),
        )

    return linked(".ihx"), linked(".map"), objects


def _objects(target: Target, files: Mapping[str, str]) -> dict[str, Path]:
    """The object of each source, start-up first."""
    sources = sorted((n for n in files if n.endswith((".c", ".s"))), key=lambda n: (n != "crt0.s", n))
    with ThreadPoolExecutor(AT_ONCE) as pool:
        # the longest first, so that none is left for the end
        ordered = sorted(sources, key=lambda n: -len(files[n]))
        made = dict(zip(ordered, pool.map(lambda n: build_object(n, target, files), ordered), strict=True))
    return {name: made[name] for name in sources}


def build_object(name: str, target: Target, files: Mapping[str, str]) -> Path:
    """The object of a source, from the cache or made anew.

    Raises:
        CompileError: with the words of compiler or assembler.
    """
    headers = {n: t for n, t in files.items() if n.endswith(".h")} if name.endswith(".c") else {}
    stem = Path(name).stem

    def make(path: Path) -> None:
        with Scratch(path.parent) as folder:
            write_files({name: files[name], **headers}, folder)
            assembly = folder / name
            if name.endswith(".c"):
                assembly = folder / f"{stem}.asm"
                sdcc([*FLAGS, *DECIDED, "-S", name, "-o", assembly.name], name, folder)
                text = assembly.read_text()
                if stale := stale_literals(text):
                    raise CompileError(
                        f"{name}: SDCC {VERSION} stores a wrong value here: {'; '.join(stale)}. "
                        "Store whole numbers behind reals, or use a pointer"
                    )
                assembly.write_text(lengthen(text))
            assemble([ASSEMBLER, f"{stem}.rel", assembly.name], name, folder)
            (folder / f"{stem}.rel").replace(path)

    asked = (TOOLS, name, files[name], sorted(headers.items()))
    return stored(f"firmware/{target.name}/objects/{stem}.rel", asked, make)


def stale_literals(assembly: str) -> list[str]:
    """The lines of C whose literal SDCC 4.5 takes from HL though a read has changed HL.

    To read a long from a known address it emits `ld hl, (address)`, but goes on as if HL still held the
    literal stored before; a later store of that literal (`fetchPairLong`) then loads nothing, or steps HL by
    one. A comparison of two variables takes from HL what was read.

    Args:
        assembly: with the comments of --fverbose-asm.
    """
    stale: list[str] = []
    source, step, changed = "", "", False
    lines = assembly.splitlines()
    for i, line in enumerate(lines):
        if match := re.match(r";(\S+\.c:\d+: .*)", line):
            source = match[1]
        elif match := re.match(r";\s*(gen\w+)", line):
            step = match[1]
        elif line.startswith(";fetchPairLong") and changed:
            compared = re.sub(r"\(i [+-] \d+\)", "i", source.partition(": ")[2])  # a sum is no literal
            if step == "genCmpEq" and not re.search(r"(?<![\w.])\d", compared):
                continue
            code = next(text for text in lines[i + 1 :] if not text.startswith(";"))
            if not re.match(r"\t(ld\t(hl|bc|de|[bcde]),|bool\thl)", code):
                stale.append(source)
        elif line.endswith(":"):  # a label: it trusts no register
            changed = False
        elif step == "genPointerGet" and re.match(r"\tld\thl, \((#|_)", line):
            changed = True
        elif re.match(r"\t(ld\thl,|bool\thl|call|pop\thl|ex\t)", line):
            changed = False
    return list(dict.fromkeys(stale))


def lengthen(assembly: str) -> str:
    """Long jumps instead of short ones: SDCC's optimizer shortens some whose label is a byte too far."""
    return assembly.replace(*LENGTHENED)


def link(objects: Sequence[Path], output: Path) -> Path:
    """Objects and SDCC's library to onboard.ihx, with onboard.map beside it in the folder `output`.

    Raises:
        CompileError: a symbol is missing, or the program does not fit.
    """
    path = output / "onboard.ihx"
    with Scratch(output) as folder:
        library = [f"-L{home() / 'share' / 'sdcc' / 'lib' / 'r3ka'}", "-lr3ka"]
        messages = sdcc([*LINKING, *library, "-o", path.name, *map(str, objects)], path.stem, folder)
        if messages:
            raise CompileError(f"{path.stem}: SDCC {VERSION} does not link it:\n{messages}")
        areas, _ = read_map(folder / f"{path.stem}.map")
        _check_room(path.stem, areas)
        (folder / f"{path.stem}.map").replace(path.with_suffix(".map"))
        return (folder / path.name).replace(path)


def _check_room(what: str, areas: Sizes) -> None:
    """Each part of the image ends where the next begins.

    Raises:
        CompileError: one does not.
    """
    resident = areas.get("_CODE", 0) + areas.get("_HOME", 0)
    bank = areas.get("_BANK1", 0)
    rest = sum(areas.get(area, 0) for area in (*CODE, *CONSTANTS, "_INITIALIZER")) - bank
    for part, size, room in (
        ("interrupt handlers and arithmetic", resident, BANKS_AT - CODE_AT),
        ("code and constants beside the estimator", rest, DATA_AT - CODE_AT),
        ("the estimator", bank, DATA_AT - BANKS_AT),
    ):
        if size > room:
            raise CompileError(f"{what}: {part}: {size:,} bytes, expected {room:,} at most")


def read_map(path: Path) -> tuple[Sizes, dict[str, int]]:
    """Sizes of the areas and addresses of the global symbols, from the linker's map."""
    text = path.read_text()
    areas = {m[1]: int(m[2], 16) for m in re.finditer(r"^(\w+) +[0-9A-F]{8} +([0-9A-F]{8}) =", text, re.M)}
    symbols = re.finditer(r"^ +([0-9A-F]{8})  (\w+)", text, re.M)
    return areas, {m[2].removeprefix("_"): int(m[1], 16) for m in symbols}


def area_sizes(path: Path) -> Sizes:
    """Sizes of an object's areas."""
    return {m[1]: int(m[2], 16) for m in re.finditer(r"^A (\S+) size ([0-9A-F]+) ", path.read_text(), re.M)}


def _footprint(linked: Sizes, objects: Mapping[str, Path]) -> Footprint:
    """The image's areas, with a board's main in the place of the processor in the loop.

    Routines of SDCC's library count, and main.c's struct is the program's memory.
    """
    sizes = {name: area_sizes(path) for name, path in objects.items()}
    pil = [name for name in sizes if name.startswith("pil")]

    def total(areas: Iterable[str]) -> int:
        return sum(
            linked.get(a, 0) - sum(sizes[name].get(a, 0) for name in pil) + sizes[MAIN].get(a, 0)
            for a in areas
        )

    return Footprint(code=CODE_AT + total(CODE), constants=total(CONSTANTS), ram=total(RAM))
