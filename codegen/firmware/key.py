"""The radio key of a vest: 128 bits that laptop and vest share, and nobody else may know (rule 11)."""

from __future__ import annotations

import os
import re
import secrets
import stat
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from models.errors import UsageError

SIZE = 16  # bytes
PRIVATE = 0o600  # mode of a file that holds a key
OTHERS_READ, OTHERS_WRITE = 0o044, 0o022  # bits of a mode: the group and everybody
HEAD = "# radio key of a vest, made by `canine keygen`. SECRET: whoever reads it can command the vest\n"


@dataclass(frozen=True)
class Key:
    """SIZE bytes. Neither `repr` nor `str` shows them, so that no log or message does."""

    data: bytes = field(repr=False)

    def __post_init__(self) -> None:
        if len(self.data) != SIZE:
            raise UsageError(f"a key has {SIZE} bytes, got {len(self.data)}")


# of the papers' test vectors, and known to everybody: trials on simulated vests are signed with it
SIMULATION_KEY = Key(bytes(range(SIZE)))


def write_new(path: Path) -> None:
    """Draw a key and write it into a new file that only its owner may read.

    Raises:
        UsageError: the file exists, or cannot be written.
    """
    text = f"{HEAD}{secrets.token_hex(SIZE)}\n"
    try:
        with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE), "w") as file:
            file.write(text)
    except FileExistsError:
        raise UsageError(
            f"--out {path}: exists and is not overwritten, since a vest may have that key; name a new file"
        ) from None
    except OSError as reason:
        raise UsageError(f"--out {path}: cannot be written: {reason.strerror}") from None


def read(path: Path, note: Callable[[str], None] = lambda text: None) -> Key:
    """The key in a file: 32 hexadecimal digits; lines that begin with # are comments.

    Args:
        path: the file.
        note: is told if users beside the owner may read it.

    Raises:
        UsageError: it cannot be read, others may change it, it holds no key, or the one that everybody knows.
    """
    try:
        with path.open(encoding="ascii") as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            lines = file.read().splitlines()
    except (OSError, UnicodeDecodeError) as reason:
        raise UsageError(f"--key {path}: cannot be read: {getattr(reason, 'strerror', 'no text')}") from None
    if mode & OTHERS_WRITE:
        raise UsageError(
            f"--key {path}: its mode is {mode:04o}, so users beside its owner can put their key there; "
            f"expected {PRIVATE:04o}. Make a new key by `canine keygen`, or if you know this one to be "
            f"yours: chmod {PRIVATE:o} {path}"
        )
    words = [line.strip() for line in lines if line.strip() and not line.startswith("#")]
    if len(words) != 1 or not re.fullmatch(rf"[0-9a-fA-F]{{{2 * SIZE}}}", words[0]):
        raise UsageError(
            f"--key {path}: expected one line of {2 * SIZE} hexadecimal digits beside comments; "
            "make a key by `canine keygen`"
        )
    key = Key(bytes.fromhex(words[0]))
    if key == SIMULATION_KEY or len(set(key.data)) == 1:
        raise UsageError(f"--key {path}: everybody knows this key; make one by `canine keygen`")
    if mode & OTHERS_READ:
        note(
            f"--key {path}: its mode is {mode:04o}, so users beside its owner can read the key and command "
            f"the vest: chmod {PRIVATE:o} {path}; if one may have read it, make a new key by `canine keygen`"
        )
    return key
