"""Results in files: folders that are made, files that are written whole or not at all."""

from __future__ import annotations

import os
from difflib import get_close_matches
from pathlib import Path

from codegen import files
from models.errors import CanineError, UsageError

SHOWN_FILES = 5  # at most, in a hint


class FileError(CanineError):
    """A file of results that cannot be written."""


def make_folder(out: Path) -> None:
    """Make the folder for results.

    Raises:
        UsageError: it cannot be made, or written into.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"--out {out}: the folder cannot be made ({error.strerror}); choose another folder"
        ) from error
    if not os.access(out, os.W_OK | os.X_OK):
        raise UsageError(f"--out {out}: the folder cannot be written into; choose another folder")


def write_whole(path: Path, data: bytes) -> None:
    """Write a file whole or not at all.

    Raises:
        FileError: it cannot be written; what was there before still is.
    """
    try:
        files.write_whole(path, data)
    except OSError as error:
        raise FileError(
            f"{path}: cannot be written ({error.strerror}); make room, or choose another folder"
        ) from error


def nearest_file(path: Path) -> str:
    """A hint at the files of a missing one's kind that are in its folder; "" if none is."""
    if not path.parent.is_dir():
        return f'; there is no folder "{path.parent}"'
    try:
        names = sorted(p.name for p in path.parent.iterdir() if p.suffix == path.suffix)
    except OSError:
        return ""
    close = get_close_matches(path.name, names, n=1) or (names if len(names) == 1 else [])
    if close:
        return f'; did you mean "{path.with_name(close[0])}"?'
    more = ", ..." if len(names) > SHOWN_FILES else ""
    return f"; there are {', '.join(names[:SHOWN_FILES])}{more}" if names and path.suffix else ""
