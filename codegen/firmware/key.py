"""The radio key of a vest: 128 bits that laptop and vest share, and nobody else may know (rule 11)."""

from __future__ import annotations

import os
import re
import secrets
from dataclasses import dataclass, field
from pathlib import Path

from models.errors import UsageError

SIZE = 16  # bytes
PRIVATE = 0o600  # mode of a file that holds a key
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


def read(path: Path) -> Key:
    """The key in a file: 32 hexadecimal digits; lines that begin with # are comments.

    Raises:
        UsageError: it cannot be read, or holds no key, or the one that everybody knows.
    """
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError) as reason:
        raise UsageError(f"--key {path}: cannot be read: {getattr(reason, 'strerror', 'no text')}") from None
    words = [line.strip() for line in lines if line.strip() and not line.startswith("#")]
    if len(words) != 1 or not re.fullmatch(rf"[0-9a-fA-F]{{{2 * SIZE}}}", words[0]):
        raise UsageError(
            f"--key {path}: expected one line of {2 * SIZE} hexadecimal digits beside comments; "
            "make a key by `canine keygen`"
        )
    key = Key(bytes.fromhex(words[0]))
    if key == SIMULATION_KEY or len(set(key.data)) == 1:
        raise UsageError(f"--key {path}: everybody knows this key; make one by `canine keygen`")
    return key
