"""The firmware bundle: the onboard program's sources for a microprocessor, from the models and the drivers.

The blocks come from their declarations, in float32. Drivers, main loop and arithmetic are written by hand, in
`onboard/`. Made here is what depends on both: parameters, telemetry, the record of the processor in the loop,
Makefile and README.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from codegen.blocks.block_c import comment, generate, start_literal, write_files
from codegen.firmware.record import Entry, drivers, is_mission, of_block, words_of
from codegen.firmware.structs import Headers, read_headers
from codegen.firmware.targets import Target
from codegen.firmware.telemetry import FIELDS, OFFSETS, PAYLOAD, Flag
from codegen.templating import environment
from models.cmec import MAX_WAYPOINTS, Cmec
from models.command_module import CommandModule
from models.errors import UsageError
from models.four_state import FourState
from models.kit.block import Block
from models.kit.declaration import Type, Variable
from models.kit.link import Values
from models.local_plane import LocalPlane
from models.watchdog import Watchdog

SOURCES = Path(__file__).parent / "onboard"
TEMPLATES = environment(Path(__file__).parent / "templates")
SUMS = "SHA256SUMS"  # of a bundle's files, as `sha256sum -c` reads it
COSTS = SOURCES / "costs.json"  # by target, measured by the processor in the loop
# numbers that the program shares with the models
SHARED: dict[str, Any] = {"tick_ms": round(1000 * Block.sample_time), "max_waypoints": MAX_WAYPOINTS}
# the members of `onboard` in onboard.h that are blocks
BLOCKS: dict[str, type[Block]] = {
    "local_plane": LocalPlane,
    "estimator": FourState,
    "watchdog": Watchdog,
    "controller": Cmec,
    "command_module": CommandModule,
}


def settable(block: type[Block]) -> dict[str, Variable]:
    """A block's parameters that the firmware has: all but the mission, which comes by radio."""
    return {v.name: v for v in block.group("parameter") if not is_mission(v) and not v.size}


def program() -> dict[str, str]:
    """The sources beside the blocks and parameters, file name to text: by hand, telemetry, models.h."""
    files = {path.name: path.read_text() for path in sorted(SOURCES.glob("*.[ch]"))}
    context = SHARED | {"fields": FIELDS, "offsets": OFFSETS, "flags": list(Flag), "size": PAYLOAD.size}
    for name in ("models.h", "telemetry.h", "telemetry.c"):
        files[name] = TEMPLATES.get_template(f"{name}.jinja").render(context)
    return {name: text for name, text in files.items() if not name.startswith("pil")}


def headers() -> Headers:
    """The structs and enumerations of `program`."""
    return read_headers({name: text for name, text in program().items() if name.endswith(".h")})


def _record() -> dict[str, list[Entry]]:
    """The record by the part of the program that writes it."""
    beside = list(drivers(headers(), BLOCKS))
    return {"drivers": beside} | {m: list(of_block(m, b)) for m, b in BLOCKS.items()}


@cache
def recorded() -> Mapping[str, Type]:
    """The words of the record by name, such as `controller.output.distance`, with their types.

    Raises:
        DeclarationError: two words have the same name.
    """
    return words_of(entry for entries in _record().values() for entry in entries)


def library(values: Values | None = None, *, constants: bool = False) -> dict[str, str]:
    """The sources that are the same for every target, file name to text.

    Args:
        values: of parameters (SI), over their start values.
        constants: parameters are macros of the blocks' headers instead of fields.
    """
    files: dict[str, str] = {}
    chosen = {
        member: {n: (values or {}).get(member, {}).get(n, v.start[0]) for n, v in settable(block).items()}
        for member, block in BLOCKS.items()
    }
    for member, block in BLOCKS.items():
        files |= generate(block, "float", constants=chosen[member] if constants else None)
    files |= program()
    context = {"assignments": [] if constants else list(_assignments(chosen))}
    files["parameters.c"] = TEMPLATES.get_template("parameters.c.jinja").render(context)
    return files


def _assignments(chosen: Values) -> Iterator[dict[str, str]]:
    for member, block in BLOCKS.items():
        for name, variable in settable(block).items():
            yield {
                "field": f"m->{member}.par.{name}",
                "value": start_literal(variable, chosen[member][name], "float"),
                "comment": comment(variable),
            }


def bundle(target: Target, values: Values | None = None, *, constants: bool = False) -> dict[str, str]:
    """A processor's project except its board, file name to text (see `library`)."""
    files = library(values, constants=constants)
    for source in sorted((SOURCES / target.folder).iterdir()):
        if not source.name.startswith("pil"):
            files[source.name] = source.read_text()
    context = SHARED | {
        "target": target,
        "constants": constants,
        "sources": sorted(name for name in files if name.endswith(".c")),
        "assembly": sorted(name for name in files if name.endswith(".s")),
        "blocks": BLOCKS,
        "costs": json.loads(COSTS.read_text()).get(target.name),
    }
    files["Makefile"] = TEMPLATES.get_template(f"{target.folder}.mk.jinja").render(context)
    files["README.md"] = TEMPLATES.get_template("firmware.md.jinja").render(context)
    return files


def write(
    target: Target, folder: Path, values: Values | None = None, *, constants: bool = False
) -> list[Path]:
    """Write the bundle into a folder, which is made if need be; the files written, each whole or not at all.

    A file that was changed since it was made, or that was not made here, is not overwritten: SUMS tells.

    Raises:
        UsageError: the folder cannot be written, or has such a file; then nothing is written.
    """
    files = bundle(target, values, constants=constants)
    files[SUMS] = "".join(f"{_digest(text.encode())}  {name}\n" for name, text in sorted(files.items()))
    try:
        foreign = _not_made_here(folder, files)
        if foreign:
            raise UsageError(
                f"--out {folder}: changed after being made, or not made here: {', '.join(foreign)}; "
                "nothing is written. Move them away, or choose another folder"
            )
        return write_files(files, folder)
    except OSError as reason:
        raise UsageError(f"--out {folder}: cannot be written: {reason.strerror}") from None


def _not_made_here(folder: Path, files: Mapping[str, str]) -> list[str]:
    """Files of these names whose content is neither the new nor an earlier bundle's."""
    made: dict[str, str] = {}
    if (folder / SUMS).is_file():
        lines = (line.split("  ", 1) for line in (folder / SUMS).read_text(errors="replace").splitlines())
        made = {parts[1]: parts[0] for parts in lines if len(parts) == 2}
    there = {
        name: (folder / name).read_bytes() for name in files if name != SUMS and (folder / name).exists()
    }
    return [
        name
        for name, content in there.items()
        if content != files[name].encode() and _digest(content) != made.get(name)
    ]


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def processor_in_the_loop() -> dict[str, str]:
    """The sources in the board's place when the program is compared between processors."""
    files = {source.name: source.read_text() for source in sorted(SOURCES.glob("pil*.c"))}
    context = {"groups": _record(), "words": len(recorded())}
    files["pil.h"] = TEMPLATES.get_template("pil.h.jinja").render(context)
    files["pil_record.c"] = TEMPLATES.get_template("pil.c.jinja").render(context)
    return files
