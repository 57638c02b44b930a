"""Files written whole or not at all: nobody who reads one meanwhile, or after a crash, sees half of it."""

from __future__ import annotations

from pathlib import Path

from codegen.scratch import Scratch


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file in a folder of its own beside its place, then put it there.

    Raises:
        OSError: it cannot be written; what was there before still is.
    """
    with Scratch(beside=path.parent) as folder:
        part = folder / path.name
        part.write_bytes(content)
        return part.replace(path)
