"""Results in files: folders that are made, files that are written whole or not at all."""

from __future__ import annotations

from pathlib import Path

from codegen import files
from models.errors import CanineError, UsageError


class FileError(CanineError):
    """A file of results that cannot be written."""


def make_folder(out: Path) -> None:
    """Make the folder for results.

    Raises:
        UsageError: it cannot be made.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"--out {out}: the folder cannot be made ({error.strerror}); choose another folder"
        ) from error


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
