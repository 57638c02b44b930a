"""Files written whole or not at all: nobody who reads one meanwhile, or after a crash, sees half of it."""

from __future__ import annotations

from pathlib import Path

from codegen.scratch import Scratch


def write_whole(path: Path, content: bytes, mode: int | None = None) -> Path:
    """Write a file in a folder of its own beside its place, then put it there.

    Args:
        mode: of the file, as chmod takes it, from before it has content; None for the process's own.

    Raises:
        OSError: it cannot be written; what was there before still is.
    """
    with Scratch(beside=path.parent) as folder:
        part = folder / path.name
        if mode is not None:
            part.touch(mode)
            part.chmod(mode)  # `touch` leaves out what the process's mask forbids
        part.write_bytes(content)
        return part.replace(path)
