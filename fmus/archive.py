"""Zip archives (.fmu, .ssp) written whole or not at all, the same bytes for the same content."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

from codegen.files import write_whole


def pack(path: Path, files: Mapping[str, bytes], stamp: str = "") -> Path:
    """Write a zip archive, whole or not at all; the same files give the same bytes.

    Args:
        stamp: kept as the archive's comment.
    """
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.comment = stamp.encode()
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.create_system = 3  # Unix, wherever this runs, for the access rights
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            compression = zipfile.ZIP_STORED if name.endswith(".fmu") else zipfile.ZIP_DEFLATED
            archive.writestr(entry, files[name], compression)
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_whole(path, stream.getvalue())


def stamp_of(path: Path) -> str:
    """What an FMU that lies there was built from; empty if it is absent or damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.comment.decode(errors="replace")
    except (OSError, zipfile.BadZipFile):
        return ""
