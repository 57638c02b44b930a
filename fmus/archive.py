"""Zip archives (.fmu, .ssp) written whole or not at all, the same bytes for the same content.

Each ends with a seal, a hash of all bytes before it: a file that another tool has written anew has none, or a
wrong one, whatever its date says.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

from codegen.files import write_whole
from models.errors import CanineError

SEAL = hashlib.sha256().digest_size * 2  # characters, at the end of the archive's comment


class AlteredError(CanineError):
    """A file that was built here has been changed since."""


def pack(path: Path, files: Mapping[str, bytes], stamp: str = "") -> Path:
    """Write a zip archive, whole or not at all; arguments as of `packed`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_whole(path, packed(files, stamp))


def packed(files: Mapping[str, bytes], stamp: str = "") -> bytes:
    """A zip archive; the same files give the same bytes.

    Args:
        stamp: kept in the archive's comment, before the seal.
    """
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.comment = f"{stamp} {'0' * SEAL}".lstrip().encode()
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.create_system = 3  # Unix, wherever this runs, for the access rights
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            compression = zipfile.ZIP_STORED if name.endswith(".fmu") else zipfile.ZIP_DEFLATED
            archive.writestr(entry, files[name], compression)
    content = stream.getvalue()[:-SEAL]
    return content + _seal(content)


def is_sealed(path: Path) -> bool:
    """Has a file there the very bytes that `packed` made?"""
    try:
        return is_sealed_content(path.read_bytes())
    except OSError:
        return False


def is_sealed_content(content: bytes) -> bool:
    """Are these the very bytes that `packed` made?"""
    return content[-SEAL:] == _seal(content[:-SEAL])


def check_sealed(path: Path) -> None:
    """Refuse a file of ours that has been changed since it was built.

    Raises:
        AlteredError: it has.
    """
    if not is_sealed(path):
        raise AlteredError(
            f"{path}: is not as it was built here: another tool has written it anew, or replaced it; "
            "`canine build` builds it again; to run it as it is, copy it into another folder"
        )


def _seal(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()


def stamp_of(path: Path) -> str:
    """What an FMU that lies there was built from, and its seal; empty if it is absent or damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.comment.decode(errors="replace")
    except (OSError, zipfile.BadZipFile):
        return ""
