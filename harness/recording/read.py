"""Reads a recording, whatever its format."""

from __future__ import annotations

from pathlib import Path

from harness.recording.find import find_parts
from harness.recording.recording import Recording


def read_recording(path: Path) -> Recording:
    """Read a recording: a folder, or a u-blox stream with inertial samples.

    Raises:
        RecordingError: a file is missing, damaged, or does not fit the others.
    """
    return find_parts(path).join()
