"""Results that take long to make, kept in the user's cache: written whole, and checked when they are read.

An entry's name holds a hash of all that decides its content. Beside it lies a hash of the content itself: an
entry that is damaged is made anew. Two processes that make the same entry at once write the same content. An
entry that nobody has used for UNUSED_DAYS goes when another is stored beside it.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path

from codegen.files import write_whole
from codegen.scratch import Scratch
from codegen.toolchains.compiler import cache_folder
from models import IMPORTED_AT

FLOORS = Path(__file__).parents[1]
TRACED = ("models", "codegen")  # the floors that decide the C of a model
TOOLS = ("ziglang", "casadi", "jinja2", "python")  # and the packages that do, with Python
SUFFIXES = (".py", ".c", ".h", ".jinja")
UNUSED_DAYS = 90
DAY = 86_400.0  # s
GRAIN = 0.02  # s; a file's time may lag behind the clock by a tick of the system

_made_here: dict[Path, Scratch] = {}  # what holds the files of this process alone


def kept(name: str, asked: object, make: Callable[[Path], object]) -> Path:
    """The file of an entry that depends on the models and the generator too, made if need be.

    If one of their files was edited after this process began to import them, the process runs other equations
    than the files have. It then makes a file of its own, and leaves the cache alone.

    Args:
        name: folder, name and suffix: `batch/cts.so`.
        asked: what is asked for; its `repr` and the sources of models and generator decide the entry.
        make: writes the file.
    """
    if is_edited(TRACED):
        return _made(name, make)
    return _entry(name, (_traced(), asked), make, is_valid=lambda: not is_edited(TRACED))


def stored(name: str, asked: object, make: Callable[[Path], object]) -> Path:
    """The file of an entry that `asked` decides alone, made if it is missing or damaged.

    Args:
        name: folder, name and suffix: `cosim/walk.so`.
        asked: everything that decides the content, by its `repr`.
        make: writes the file.
    """
    return _entry(name, asked, make, is_valid=lambda: True)


def knows(blocks: Iterable[type]) -> bool:
    """Do all these classes come from `models/`? `kept` knows the sources of those only."""
    return all(
        block.__module__.startswith("models.")
        and getattr(sys.modules.get(block.__module__), block.__name__, None) is block
        for block in blocks
    )


def _entry(name: str, asked: object, make: Callable[[Path], object], is_valid: Callable[[], bool]) -> Path:
    """The file of an entry; one of this process alone if it cannot be stored, or is not valid once made."""
    key = hashlib.sha256(repr(asked).encode()).hexdigest()[:20]
    path = cache_folder() / name
    path = path.with_name(f"{path.stem}-{key}{path.suffix}")
    mark = path.with_name(f"{path.name}.sha256")
    if _is_whole(path, mark):
        return path
    made = _made(path.name, make)
    if not is_valid():
        return made
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        content = made.read_bytes()
        write_whole(path, content)
        write_whole(mark, _hash_of(content))
    except OSError:  # a full disk, say: what was made serves this process
        return made
    _made_here.pop(made).close()
    _remove_unused(path.parent)
    return path


def _made(name: str, make: Callable[[Path], object]) -> Path:
    """A file of this process alone, removed at its end."""
    scratch = Scratch()
    path = scratch.path / Path(name).name
    make(path)
    _made_here[path] = scratch
    return path


def _is_whole(path: Path, mark: Path) -> bool:
    """Does the entry have the content that was stored? From now on it is in use."""
    try:
        for file in (path, mark):
            os.utime(file)
        return mark.read_bytes() == _hash_of(path.read_bytes())
    except OSError:
        return False


def _hash_of(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()


def _remove_unused(folder: Path) -> None:
    oldest = time.time() - UNUSED_DAYS * DAY
    with contextlib.suppress(OSError):  # another process may be faster
        for file in folder.iterdir():
            if file.is_file() and file.stat().st_mtime < oldest:
                file.unlink()


@cache
def _traced() -> str:
    return sources(TRACED, TOOLS)


def sources(floors: Iterable[str], packages: Iterable[str]) -> str:
    """A hash of files and versions that decide a result.

    Args:
        floors: folders and files, relative to the root of the project.
        packages: names of distributions, or `python`.
    """
    versions = [f"{p} {platform.python_version() if p == 'python' else _version(p)}" for p in packages]
    digest = hashlib.sha256(" ".join(versions).encode())
    for path in _files(floors):
        content = path.read_bytes()
        digest.update(f"\n{path.relative_to(FLOORS).as_posix()} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def _version(package: str) -> str:
    """The installed version, from the first lines of the metadata: to parse all of it takes milliseconds."""
    from importlib.metadata import distribution, version  # noqa: PLC0415 - not every start needs the caches

    text = distribution(package).read_text("METADATA") or ""
    line = next((line for line in text.splitlines() if line.startswith("Version: ")), None)
    return line.removeprefix("Version: ") if line else version(package)


def is_edited(floors: Iterable[str]) -> bool:
    """Has a file changed since this process began to import the project?"""
    return any(_changed_at(path) > IMPORTED_AT - GRAIN for path in _files(floors))


def _changed_at(path: Path) -> float:
    """When the file came to be as it is, s; a copied or linked one may bring an older time of its own."""
    status = path.stat()
    return status.st_mtime if os.name == "nt" else status.st_ctime


def _files(floors: Iterable[str]) -> Iterator[Path]:
    for floor in floors:
        if (FLOORS / floor).is_file():
            yield FLOORS / floor
        for folder, folders, names in os.walk(FLOORS / floor):
            folders.sort()
            yield from (Path(folder, name) for name in sorted(names) if name.endswith(SUFFIXES))
