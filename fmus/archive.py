"""Zip archives (.fmu, .ssp) written whole or not at all, the same bytes for the same content."""

from __future__ import annotations

import os
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path


def pack(path: Path, files: Mapping[str, bytes], stamp: str = "") -> Path:
    """Write a zip archive, whole or not at all; the same files give the same bytes.

    Args:
        stamp: kept as the archive's comment.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, part = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        with os.fdopen(descriptor, "wb") as stream, zipfile.ZipFile(stream, "w") as archive:
            archive.comment = stamp.encode()
            for name in sorted(files):
                entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
                entry.create_system = 3  # Unix, wherever this runs, for the access rights
                entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
                compression = zipfile.ZIP_STORED if name.endswith(".fmu") else zipfile.ZIP_DEFLATED
                archive.writestr(entry, files[name], compression)
        Path(part).chmod(0o644)
        return Path(part).replace(path)
    except BaseException:
        Path(part).unlink(missing_ok=True)
        raise


def stamp_of(path: Path) -> str:
    """What an FMU that lies there was built from; empty if it is absent or damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.comment.decode(errors="replace")
    except (OSError, zipfile.BadZipFile):
        return ""
