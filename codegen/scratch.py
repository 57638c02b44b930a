"""Temporary folders that do not outlive their run: the next run removes those that a killed one left.

The owner holds a lock on its folder. The system releases the lock however the process ends, and knows it in
every container of this machine, where the number of a process means nothing. What is removed has our name and
mode, is this user's, and is not locked.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import stat
import tempfile
import weakref
from contextlib import suppress
from functools import cache
from pathlib import Path

PREFIX = "canine-scratch-"
NAME = re.compile(rf"\.?{PREFIX}[a-z0-9_]{{8}}")  # as tempfile.mkdtemp makes it
PRIVATE = 0o700  # the mode that it gives


class Scratch:
    """A temporary folder, removed with all that is in it. To be closed, or used as a context manager.

    Args:
        beside: the folder that holds it, for files to be moved elsewhere there; by default TMPDIR or /tmp.

    Raises:
        OSError: it cannot be made.
    """

    def __init__(self, beside: Path | None = None) -> None:
        parent = tempfile.gettempdir() if beside is None else str(beside)
        _remove_abandoned(parent)
        while True:
            self.path = Path(
                tempfile.mkdtemp(prefix="." * (beside is not None) + PREFIX, dir=parent)
            ).absolute()
            try:
                handle = os.open(self.path, os.O_RDONLY)
            except FileNotFoundError:  # another process removed it before it was locked
                continue
            with suppress(OSError):  # a file system without locks: nobody else gets one there, either
                fcntl.flock(handle, fcntl.LOCK_SH)
            self.close = weakref.finalize(self, _remove, self.path, handle)  # at exit, too
            if is_there(handle, self.path):  # else it went in between
                return
            self.close()

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.close()


def _remove(path: Path, handle: int) -> None:
    shutil.rmtree(path, ignore_errors=True)
    os.close(handle)


@cache
def _remove_abandoned(parent: str) -> None:
    """Remove what killed runs left in a folder; once a process."""
    with suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if NAME.fullmatch(entry.name):
                with suppress(OSError):
                    _remove_if_abandoned(Path(entry.path))


def _remove_if_abandoned(path: Path) -> None:
    """Remove a folder that is this user's and that no process holds.

    Raises:
        OSError: a process holds it, or it is gone.
    """
    handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        status = os.fstat(handle)
        if status.st_uid == os.geteuid() and stat.S_IMODE(status.st_mode) == PRIVATE:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(path, ignore_errors=True)
    finally:
        os.close(handle)


def is_there(handle: int, path: Path) -> bool:
    """Is an open file or folder still what the path names? Another process may have removed it."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False
