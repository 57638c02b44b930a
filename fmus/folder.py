"""The folder of our own FMUs: where it is, and whether what lies there is up to date."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Literal

from codegen.cache import FLOORS, TOOLS, TRACED, sources
from codegen.toolchains.compiler import PLATFORMS, cache_folder, this_platform
from fmus.archive import stamp_of
from models.system import BLOCKS

BUILT_FROM = (*TRACED, "fmus")
STAMP = "built-from"  # in a build folder: the hash of what it was built from
FmiVersion = Literal[2, 3]
VERSIONS: tuple[FmiVersion, ...] = (2, 3)


@cache
def build_folder() -> Path:
    """Where our own FMUs and packages are built, and found again.

    A checkout that can be written keeps them in fmus/build. An installed package keeps them in the
    user's cache, in a folder for each state of the sources.
    """
    here = Path(__file__).parent
    if (FLOORS / "pyproject.toml").is_file() and os.access(here, os.W_OK):
        return here / "build"
    return cache_folder() / "fmus" / origin()[:16]


def is_current(folder: Path | None = None) -> bool:
    """Was all in the folder built from models, generator and shim as they are now, and for this machine?

    Raises:
        CompileError: this machine is none of `codegen.toolchains.compiler.PLATFORMS`.
    """
    folder = folder or build_folder()
    stamp = folder / STAMP
    if not stamp.is_file() or stamp.read_text() != origin():
        return False
    here = PLATFORMS[this_platform()].fmi3
    fmus = (folder / f"fmi{version}" / f"{block.title()}.fmu" for block in BLOCKS for version in VERSIONS)
    return all(here in stamp_of(fmu).split()[1:] for fmu in fmus)


def origin() -> str:
    """A hash of what builds depend on: the files of three floors, and the versions of the tools."""
    return sources(BUILT_FROM, (*TOOLS, "fmpy"))


def digest(files: Mapping[str, bytes], more: Iterable[str] = ()) -> str:
    """A hash of files by their names, and of further texts."""
    parts = [part for name in sorted(files) for part in (name.encode(), files[name])]
    parts += [text.encode() for text in more]
    return hashlib.sha256(b"".join(len(part).to_bytes(8, "big") + part for part in parts)).hexdigest()
