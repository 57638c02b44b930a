"""Results that take long to make, kept in the user's cache: written whole, and checked when they are read.

An entry's name holds a hash of all that decides its content. Beside it lies a hash of the content itself: an
entry that is damaged is made anew. Two processes that make the same entry at once write the same content.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Callable
from functools import cache
from pathlib import Path

from codegen.files import write_whole
from codegen.toolchains.compiler import cache_folder, compiler_version

FLOORS = Path(__file__).parents[1]


def kept(name: str, asked: object, make: Callable[[Path], object]) -> Path:
    """The file of an entry, made if it is missing or damaged.

    Args:
        name: folder, name and suffix: `batch/cts.so`.
        asked: what is asked for; its `repr` and the sources of models and generator decide the entry.
        make: writes the file, whole or not at all.
    """
    key = hashlib.sha256(f"{sources()}\n{asked!r}".encode()).hexdigest()[:20]
    path = cache_folder() / name
    path = path.with_name(f"{path.stem}-{key}{path.suffix}")
    mark = path.with_name(f"{path.name}.sha256")
    if not _is_whole(path, mark):
        path.parent.mkdir(parents=True, exist_ok=True)
        make(path)
        write_whole(mark, _hash_of(path))
    return path


def _is_whole(path: Path, mark: Path) -> bool:
    try:
        return mark.read_bytes() == _hash_of(path)
    except OSError:
        return False


def _hash_of(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).hexdigest().encode()


@cache
def sources() -> str:
    """A hash of what traced models and generated C depend on: models, generator, versions."""
    from importlib.metadata import version  # noqa: PLC0415

    digest = hashlib.sha256(
        f"{compiler_version()} casadi {version('casadi')} python {platform.python_version()}".encode()
    )
    for floor in ("models", "codegen"):
        for folder, folders, names in os.walk(FLOORS / floor):
            folders.sort()
            for name in sorted(names):
                if name.endswith((".py", ".c", ".h", ".jinja")):
                    path = Path(folder, name)
                    content = path.read_bytes()
                    digest.update(
                        f"\n{path.relative_to(FLOORS).as_posix()} {len(content)}\n".encode() + content
                    )
    return digest.hexdigest()
