"""The firmware bundle: the onboard program's sources for a microprocessor, from the models and the drivers.

The blocks come from their declarations, in float32. Drivers, main loop and arithmetic are written by hand, in
`onboard/`. Made here is what depends on both: parameters, telemetry, the record of the processor in the loop,
Makefile and README.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from codegen.blocks.block_c import comment, generate, start_literal, write_files
from codegen.firmware.fixes import MESSAGES, limits
from codegen.firmware.key import PRIVATE, SIMULATION_KEY, Key
from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.record import Entry, drivers, is_mission, of_block, words_of
from codegen.firmware.structs import Headers, read_headers
from codegen.firmware.targets import TARGETS, Target
from codegen.firmware.telemetry import FIELDS, NOT_READY, OFFSETS, PAYLOAD, Flag, Ready, Refusal
from codegen.templating import environment
from models.cmec import MAX_WAYPOINTS
from models.errors import UsageError
from models.fence import MAX_CORNERS
from models.kit.block import Block
from models.kit.declaration import Type, Variable
from models.kit.link import Values
from models.readings import ON_BOARD, READINGS
from models.system import ESTIMATORS

SOURCES = Path(__file__).parent / "onboard"
TEMPLATES = environment(Path(__file__).parent / "templates")
KEY_FILE = "key.c"
SUMS = "SHA256SUMS"  # of a bundle's files, as `sha256sum -c` reads it
PORT = "port.c"  # each target's own, by the same name
COSTS = SOURCES / "costs.json"  # by target and estimator, measured by the processor in the loop
DRIVERS = ("link.h", "mt.h", "ubx.h")  # headers of the members of `onboard` that are no blocks
GENERATED = ("models.h", "fixes.h", "telemetry.h", "telemetry.c", "onboard.h", "navigation.h")
# numbers that the program shares with the models
SHARED: dict[str, Any] = {
    "tick_ms": round(1000 * Block.sample_time),
    "max_waypoints": MAX_WAYPOINTS,
    "max_corners": MAX_CORNERS,
}
READINESS: dict[str, Any] = {"ready": list(Ready), "refusals": list(Refusal), "not_ready": NOT_READY}
BLOCKS = DEFAULT.blocks
ENTRIES = ("defaults", "initialize", "step")  # a block's functions


def settable(block: type[Block]) -> dict[str, Variable]:
    """A block's parameters that the firmware has: all but the mission, which comes by radio."""
    return {v.name: v for v in block.group("parameter") if not is_mission(v) and not v.size}


def _guarded(block: type[Block]) -> dict[str, float]:
    """A block's parameters in the reading ON_BOARD."""
    owner = f"{block.title()}."
    return {a.removeprefix(owner): v for a, v in READINGS[ON_BOARD].items() if a.startswith(owner)}


def _chosen(values: Values | None, blocks: Mapping[str, type[Block]]) -> Values:
    """The values of all parameters: those given over start values; without any, the reading ON_BOARD."""
    return {
        member: {n: v.start[0] for n, v in settable(block).items()}
        | (_guarded(block) if values is None else dict(values.get(member, {})))
        for member, block in blocks.items()
    }


def program(navigation: Navigation = DEFAULT) -> dict[str, str]:
    """The sources beside the blocks and parameters, file name to text: by hand, or from tables."""
    files = {path.name: path.read_text() for path in sorted(SOURCES.glob("*.[ch]"))}
    context = SHARED | {"fields": FIELDS, "offsets": OFFSETS, "flags": list(Flag), "size": PAYLOAD.size}
    context |= READINESS
    context |= {"messages": MESSAGES, "limits": limits(), "navigation": navigation}
    context["headers"] = sorted(
        [*DRIVERS, "models.h", *(f"{block.title()}.h" for block in navigation.blocks.values())]
    )
    for name in GENERATED:
        files[name] = TEMPLATES.get_template(f"{name}.jinja").render(context)
    return {name: text for name, text in files.items() if not name.startswith("pil")}


def headers(navigation: Navigation = DEFAULT) -> Headers:
    """The structs and enumerations of `program`."""
    texts = program(navigation)
    return read_headers({name: text for name, text in texts.items() if name.endswith(".h")})


def _record(navigation: Navigation) -> list[Entry]:
    """The record: what stands beside the blocks, then the blocks."""
    blocks = navigation.blocks
    entries = list(drivers(headers(navigation), blocks))
    return entries + [entry for member, block in blocks.items() for entry in of_block(member, block)]


@cache
def recorded(navigation: Navigation = DEFAULT) -> Mapping[str, Type]:
    """The words of the record by name, such as `controller.output.distance`, with their types.

    Raises:
        DeclarationError: two words have the same name.
    """
    return words_of(_record(navigation))


def library(
    values: Values | None = None,
    navigation: Navigation = DEFAULT,
    *,
    constants: bool = False,
    addressed: bool = False,
    banked: bool = False,
    key: Key | None = SIMULATION_KEY,
) -> dict[str, str]:
    """The sources that are the same for every target, file name to text.

    Args:
        values: of parameters (SI), over their start values; None for those of the reading ON_BOARD.
        navigation: the program's estimator, and what comes before it.
        constants: parameters are macros of the blocks' headers instead of fields.
        addressed: the blocks' functions know where their block lies (see `Target`).
        banked: the estimator's are called by way of banks.s (see `Target`).
        key: of the radio; None: frames are not verified.
    """
    files: dict[str, str] = {}
    blocks = navigation.blocks
    chosen = _chosen(values, blocks)
    for member, block in blocks.items():
        files |= generate(
            block,
            "float",
            constants=chosen[member] if constants else None,
            instance=f"vest.{member}" if addressed else "",
            preset=True,
        )
    files |= program(navigation) | key_files(key)
    if banked:
        estimator = navigation.estimator.title()
        functions = [f"{estimator}_{name}" for name in ENTRIES]
        files["banks.s"] = TEMPLATES.get_template("banks.s.jinja").render(functions=functions)
        files[f"{estimator}.c"] = (
            TEMPLATES.get_template("banked.c.jinja").render(functions=functions) + files[f"{estimator}.c"]
        )
    context = {
        "tables": [] if constants else list(_tables(blocks, chosen)),
        "guarded": chosen["controller"]["guarded"],
    }
    files["parameters.c"] = TEMPLATES.get_template("parameters.c.jinja").render(context)
    return files


def key_files(key: Key | None) -> dict[str, str]:
    """The radio's key as C, file name to text; KEY_FILE is secret."""
    context = {"key": list(key.data) if key else [], "simulation": key == SIMULATION_KEY}
    names = ("key.h", KEY_FILE) if key else ("key.h",)
    return {name: TEMPLATES.get_template(f"{name}.jinja").render(context) for name in names}


def _tables(blocks: Mapping[str, type[Block]], chosen: Values) -> Iterator[dict[str, Any]]:
    """Of each block that has some, the values of its parameters."""
    for member, block in blocks.items():
        if settable(block):
            yield {
                "member": member,
                "block": block.title(),
                "rows": [
                    {
                        "name": name,
                        "value": start_literal(variable, chosen[member][name], "float"),
                        "comment": comment(variable) + _limits(variable),
                    }
                    for name, variable in settable(block).items()
                ],
            }


def _limits(variable: Variable) -> str:
    """The range that a number must keep, for an engineer who changes it."""
    if variable.type is Type.BOOLEAN or (variable.min is None and variable.max is None):
        return ""
    low, high = (bound if bound is None else f"{bound:.4g}" for bound in (variable.min, variable.max))
    return f"; {low} to {high}" if low and high else f"; from {low}" if low else f"; up to {high}"


def added(target: Target) -> dict[str, str]:
    """The hand-written sources, headers and scripts that a target adds to the program, file name to text."""
    folders = [SOURCES / name for name in (target.shared, target.folder) if name]
    return {path.name: path.read_text() for folder in folders for path in sorted(folder.iterdir())}


def bundle(
    target: Target,
    values: Values | None = None,
    navigation: Navigation = DEFAULT,
    *,
    constants: bool = False,
    key: Key | None = SIMULATION_KEY,
) -> dict[str, str]:
    """A processor's project except its board, file name to text (see `library`)."""
    files = library(
        values, navigation, constants=constants, addressed=target.addressed, banked=target.banked, key=key
    )
    files |= {name: text for name, text in added(target).items() if not name.startswith("pil")}
    chosen = _chosen(values, navigation.blocks)
    measured = target.same_processor_as or target.name
    context = (
        SHARED
        | READINESS
        | {
            "target": target,
            "constants": constants,
            "key": key,
            "sources": sorted(name for name in files if name.endswith(".c")),
            "assembly": sorted(name for name in files if name.endswith(".s")),
            "navigation": navigation,
            "default": DEFAULT,
            "estimators": ESTIMATORS,
            "guarded": chosen["controller"]["guarded"],
            "confronted": chosen["estimator"]["heading_limit"] <= math.pi,  # above it nothing contradicts
            "measured": measured,
            "costs": json.loads(COSTS.read_text()).get(measured, {}).get(navigation.name),
        }
    )
    files["Makefile"] = TEMPLATES.get_template(f"{target.shared or target.folder}.mk.jinja").render(context)
    files["README.md"] = TEMPLATES.get_template("firmware.md.jinja").render(context)
    return files


def write(
    target: Target,
    folder: Path,
    values: Values | None = None,
    navigation: Navigation = DEFAULT,
    *,
    key: Key | None,
    constants: bool = False,
) -> list[Path]:
    """Write the bundle into a folder, which is made if need be; the files written, each whole or not at all.

    It takes the place of an earlier bundle for the same target, whose files that it lacks are removed. SUMS
    tells them from the engineer's: a file that was changed since it was made, or that was not made here, is
    neither overwritten nor removed.

    Raises:
        UsageError: the folder cannot be written, holds another target's bundle, or has such a file by a name
            of the bundle's. Then nothing is written.
    """
    files = bundle(target, values, navigation, constants=constants, key=key)
    files[SUMS] = "".join(f"{_digest(text.encode())}  {name}\n" for name, text in sorted(files.items()))
    try:
        made, there = _made_here(folder), _contents(folder)
        for other in _targets_in(made, there):
            if other is not target:
                raise UsageError(
                    f"--out {folder}: holds firmware for {other.name}, and that for {target.name} would mix "
                    "with it; nothing is written. Choose another folder, or empty this one"
                )
        unchanged = {name for name, content in there.items() if _digest(content) == made.get(name)}
        foreign = [
            n for n in files if n in there.keys() - unchanged - {SUMS} and files[n].encode() != there[n]
        ]
        if foreign:
            raise UsageError(
                f"--out {folder}: changed after being made, or not made here: {', '.join(foreign)}; "
                "nothing is written. Move them away, or choose another folder"
            )
        secret = {name: text for name, text in files.items() if name == KEY_FILE}
        paths = write_files({n: t for n, t in files.items() if n not in secret}, folder)
        paths += write_files(secret, folder, PRIVATE)
        for name in unchanged - files.keys():
            (folder / name).unlink()
        return paths
    except OSError as reason:
        raise UsageError(f"--out {folder}: cannot be written: {reason.strerror}") from None


def _made_here(folder: Path) -> dict[str, str]:
    """The digests of the files that the last bundle in a folder had, by name."""
    if not (folder / SUMS).is_file():
        return {}
    lines = (line.split("  ", 1) for line in (folder / SUMS).read_text(errors="replace").splitlines())
    return {parts[1]: parts[0] for parts in lines if len(parts) == 2}


def _contents(folder: Path) -> dict[str, bytes]:
    """The files in a folder by name."""
    return (
        {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
        if folder.is_dir()
        else {}
    )


def _targets_in(made: Mapping[str, str], there: Mapping[str, bytes]) -> Iterator[Target]:
    """The targets whose bundle, or whose own sources, a folder holds."""
    plain = bool(made)  # a bundle without sources that only one target has is the one for `host`
    for target in TARGETS.values():
        own = _own_sources(target)
        listed = bool(own.keys() & made.keys())
        plain &= not listed
        if listed or any(there.get(name) == content for name, content in own.items()):
            yield target
    if plain:
        yield TARGETS["host"]


def _own_sources(target: Target) -> dict[str, bytes]:
    """The sources that a target's bundle alone has, by name."""
    return {
        path.name: path.read_bytes()
        for path in (SOURCES / target.folder).iterdir()
        if path.name != PORT and not path.name.startswith("pil")
    }


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def processor_in_the_loop(navigation: Navigation = DEFAULT) -> dict[str, str]:
    """The sources in the board's place when the program is compared between processors."""
    files = {source.name: source.read_text() for source in sorted(SOURCES.glob("pil*.c"))}
    context = {"entries": _record(navigation), "words": len(recorded(navigation))}
    files["pil.h"] = TEMPLATES.get_template("pil.h.jinja").render(context)
    files["pil_record.c"] = TEMPLATES.get_template("pil.c.jinja").render(context)
    return files
