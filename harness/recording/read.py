"""Reads a recording, whatever its format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from harness.recording.recording import Recording, RecordingError
from harness.recording.tags import read_tagged


class Format(NamedTuple):
    """A way to keep a recording in a folder."""

    recognised: Callable[[Path], bool]  # is the folder of this format?
    read: Callable[[Path], Recording]


# The first that recognises the folder reads it.
FORMATS = (Format(recognised=lambda _: True, read=read_tagged),)


def read_recording(folder: Path) -> Recording:
    """Read a folder of a recording with the reader of its format.

    Raises:
        RecordingError: a file is missing, damaged, or does not fit the others.
    """
    if not folder.is_dir():
        raise RecordingError(f"{folder}: no such folder; expected the folder of a recording")
    return next(format.read(folder) for format in FORMATS if format.recognised(folder))
