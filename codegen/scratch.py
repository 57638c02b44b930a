"""Temporary folders that do not outlive their run: the next run removes those that a killed one left.

The owner holds a lock on its folder. The system releases the lock however the process ends, and knows it in
every container of this machine, where the number of a process means nothing. What is removed has our name and
mode, is this user's, and is not locked.
"""

from __future__ import annotations

import fcntl
import os
import re
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
    """Remove an open folder, also one that was given another name."""
    with suppress(OSError):
        os.fchmod(handle, PRIVATE)
        _empty(handle)
        with suppress(OSError):  # Linux knows its name
            path = Path(os.readlink(f"/proc/self/fd/{handle}"))
        path.rmdir()
    os.close(handle)


def _empty(top: int) -> None:
    """Remove all that is in an open folder.

    Folders in folders are first moved up into it: they may lie deeper than paths, calls or open files go.
    """
    folders = _remove_files(top)
    while folders:
        name = folders.pop()
        with suppress(OSError):
            handle = _open_folder(name, top)
            try:
                for inner in _remove_files(handle):
                    unused = os.urandom(8).hex()
                    os.rename(inner, unused, src_dir_fd=handle, dst_dir_fd=top)
                    folders.append(unused)
            finally:
                os.close(handle)
            os.rmdir(name, dir_fd=top)


def _remove_files(folder: int) -> list[str]:
    """Remove all but the folders in an open folder; the folders, which may be moved and removed."""
    folders = []
    with os.scandir(folder) as entries:
        for entry in list(entries):
            with suppress(OSError):
                if entry.is_dir(follow_symlinks=False):
                    os.chmod(entry.name, PRIVATE, dir_fd=folder)
                    folders.append(entry.name)
                else:
                    os.unlink(entry.name, dir_fd=folder)
    return folders


def _open_folder(path: str | Path, beside: int | None = None) -> int:
    return os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=beside)


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
    handle = _open_folder(path)
    try:
        status = os.fstat(handle)
        if status.st_uid == os.geteuid() and stat.S_IMODE(status.st_mode) == PRIVATE:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _empty(handle)
            path.rmdir()
    finally:
        os.close(handle)


def is_there(handle: int, path: Path) -> bool:
    """Is an open file or folder still what the path names? Another process may have removed it."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False
