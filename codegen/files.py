"""Files written whole or not at all: nobody who reads one meanwhile, or after a crash, sees half of it."""

from __future__ import annotations

import os
from pathlib import Path


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file beside its place under a name of its own, then put it there.

    Raises:
        OSError: it cannot be written; what was there before still is.
    """
    part = path.with_name(f".{path.name}.{os.urandom(4).hex()}.part")
    try:
        part.write_bytes(content)
        return part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
