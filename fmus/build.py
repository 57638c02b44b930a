"""Builds FMUs: generated C, the shim, descriptions and binaries; the same block gives the same bytes."""

from __future__ import annotations

import os
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from codegen.blocks.block_c import generate
from codegen.cache import is_edited
from codegen.files import write_whole
from codegen.scratch import Scratch
from codegen.toolchains.compiler import (
    FLAGS,
    PLATFORMS,
    Platform,
    build_library,
    compiler_version,
    find_platform,
    this_platform,
)
from fmus.archive import is_sealed, pack, stamp_of
from fmus.description import block_header, build_description, documentation, model_description
from fmus.folder import BUILT_FROM, STAMP, VERSIONS, FmiVersion, build_folder, digest, origin
from fmus.reference import reference_files
from fmus.ssp import files_of, structure_of
from models.errors import CanineError
from models.kit.block import Block
from models.kit.elementary import Precision
from models.system import BLOCKS, SYSTEMS, System

SHIM = Path(__file__).parent / "shim"
HEADERS: dict[FmiVersion, tuple[str, ...]] = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
TOKEN = "@token@"  # stands for the token in what the token is made of
Generate = Callable[[type[Block], Precision], dict[str, str]]
# both versions of an FMU hold the same C and the same results; mypy takes a class for nothing hashable
_generate: Generate = cache(generate)  # type: ignore[assignment]
_reference_files: Callable[[type[Block]], dict[str, bytes]] = cache(reference_files)  # type: ignore[assignment]


class BuildError(CanineError):
    """An FMU cannot be made here."""


def build_fmu(
    block: type[Block],
    folder: Path,
    version: FmiVersion,
    platforms: Sequence[str] = (),
    precision: Precision = "double",
) -> Path:
    """Build `<block>.fmu` (`<block>_float.fmu` in single precision), unless it lies there as it was built.

    One that is up to date and holds binaries for more platforms than these stays as it is.

    Args:
        platforms: names of `codegen.toolchains.compiler.PLATFORMS`; this machine's by default.

    Raises:
        DeclarationError: the block does not come in this precision.
        CompileError: a platform is unknown, or the compiler refuses the C.
        BuildError: two platforms would lie in the same folder.
    """
    return _prepare(block, folder, version, platforms, precision)()


def build_all(
    folder: Path | None = None,
    platforms: Sequence[str] = (),
    done: Callable[[Path], None] = lambda path: None,
) -> list[Path]:
    """Build `fmi<n>/<block>.fmu` of every block and `<system>.fmi<n>.ssp` of every system, n being 2 and 3.

    FMUs that are up to date stay. The compilers run side by side. This machine's binaries are always among
    them, so that what was built runs here: where FMI 2.0 has one folder for this machine and one asked for
    (x86-64 and ARM), only the FMI 3.0 FMUs hold both.

    Args:
        folder: `build_folder()` by default.
        platforms: names of `codegen.toolchains.compiler.PLATFORMS`, built beside this machine's.
        done: told each file that is ready.

    Raises:
        CompileError: a platform is unknown, or the compiler refuses the C.
        BuildError: two platforms, neither this machine's, would lie in the same folder.
    """
    folder = folder or build_folder()
    built_from = origin()  # before anything is traced: an edit meanwhile makes the folder out of date
    built: dict[tuple[type[Block], FmiVersion], Future[Path]] = {}
    paths = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for block in BLOCKS:
            for version in VERSIONS:
                names = _with_this_machine(platforms, version)
                job = _prepare(block, folder / f"fmi{version}", version, names, "double")
                built[block, version] = pool.submit(job)
        for future in built.values():
            paths.append(future.result())
            done(paths[-1])
    for system in SYSTEMS.values():
        for version in VERSIONS:
            paths.append(build_package(system, version, folder))
            done(paths[-1])
    # models that were imported before an edit are not those of the files
    write_whole(folder / STAMP, b"edited" if is_edited(BUILT_FROM) else built_from.encode())
    return paths


def build_package(system: System, version: int, folder: Path | None = None) -> Path:
    """Pack `<system>.fmi<n>.ssp` of FMUs that `build_all` has built; its path."""
    folder = folder or build_folder()
    fmus = {
        role: folder / f"fmi{version}" / f"{block.title()}.fmu" for role, block in system.components.items()
    }
    return pack(folder / f"{system.name}.fmi{version}.ssp", files_of(structure_of(system, fmus)))


def contents(block: type[Block], version: FmiVersion, precision: Precision = "double") -> dict[str, bytes]:
    """An FMU without its binaries: path in the archive to content.

    The token (GUID) is a hash of all of it, so that a binary and a description that differ never meet.

    Raises:
        DeclarationError: the block does not come in this precision.
    """
    files = {f"sources/{name}": text.encode() for name, text in _generate(block, precision).items()}
    for name in ("shim.h", "shim.c", f"fmi{version}.c"):
        files[f"sources/{name}"] = (SHIM / name).read_bytes()
    for name in HEADERS[version]:
        files[f"sources/{name}"] = (_headers() / name).read_bytes()
    files["sources/block_fmu.h"] = block_header(block, version, precision, TOKEN).encode()
    sources = _sources(files)
    if version == 3:
        files["sources/buildDescription.xml"] = build_description(block, sources)
    files["modelDescription.xml"] = model_description(block, version, TOKEN, sources)
    files["documentation/index.html"] = documentation(block, version).encode()
    if precision == "double":
        files |= _reference_files(block)
    token = f"{{{uuid.UUID(hex=digest(files)[:32])}}}"
    return {name: content.replace(TOKEN.encode(), token.encode()) for name, content in files.items()}


def _folder_of(platform: Platform, version: FmiVersion) -> str:
    return platform.fmi2 if version == 2 else platform.fmi3


def _with_this_machine(platforms: Sequence[str], version: FmiVersion) -> list[str]:
    """The platforms and this machine, without what would lie in its folder."""
    here = this_platform()
    taken = _folder_of(PLATFORMS[here], version)
    return [here, *(name for name in platforms if _folder_of(find_platform(name), version) != taken)]


def _prepare(
    block: type[Block], folder: Path, version: FmiVersion, platforms: Sequence[str], precision: Precision
) -> Callable[[], Path]:
    """Everything that traces equations; what is returned only compiles and packs, in any thread."""
    path = folder / f"{block.title()}{'_float' if precision == 'float' else ''}.fmu"
    chosen = [find_platform(name) for name in platforms or (this_platform(),)]
    folders = [_folder_of(p, version) for p in chosen]
    if len(set(folders)) < len(folders):
        machines = ", ".join(p.fmi3 for p in chosen)
        raise BuildError(
            f"{block.title()} for {machines}: FMI {version}.0 keeps them in folders {', '.join(folders)}; "
            "build one of each name"
        )
    files = contents(block, version, precision)
    targets = sorted(" ".join([p.target, *p.flags]) for p in PLATFORMS.values())
    built_from = digest(files, [compiler_version(), *FLAGS, *targets])
    held = {p.fmi3 for p in chosen}  # as FMI 3.0 names them: FMI 2.0's folders do not tell ARM

    def build() -> Path:
        stamp = stamp_of(path).split()
        if stamp[:1] == [built_from] and held <= set(stamp[1:]) and is_sealed(path):
            return path
        binaries: dict[str, bytes] = {}
        for platform in chosen:
            binaries |= _binary(block, version, platform, files)
        return pack(path, files | binaries, " ".join([built_from, *sorted(held)]))

    return build


def _binary(
    block: type[Block], version: FmiVersion, platform: Platform, files: Mapping[str, bytes]
) -> dict[str, bytes]:
    with Scratch() as scratch:
        sources = scratch / "sources"
        sources.mkdir()
        for name, content in files.items():
            if name.startswith("sources/"):
                (scratch / name).write_bytes(content)
        library = build_library(
            sources, _sources(files), scratch / f"{block.title()}{platform.suffix}",
            what=f"{block.title()} (FMI {version}.0, {platform.fmi3})", target=platform.target,
            flags=(*FLAGS, *platform.flags),
        )  # fmt: skip
        return {f"binaries/{_folder_of(platform, version)}/{library.name}": library.read_bytes()}


def _sources(files: Iterable[str]) -> list[str]:
    """The C files to compile, named relative to the sources folder."""
    return sorted(name.removeprefix("sources/") for name in files if name.endswith(".c"))


def _headers() -> Path:
    """The official headers, which come with fmpy."""
    spec = find_spec("fmpy")
    for folder in (spec.submodule_search_locations if spec else None) or ():
        if (Path(folder) / "c-code" / "fmi3Functions.h").exists():
            return Path(folder) / "c-code"
    raise BuildError("the installed fmpy has no c-code/fmi3Functions.h; install the version of the lock file")
