"""Which FMUs were built here."""

from __future__ import annotations

from pathlib import Path

from fmus.archive import is_sealed_content
from fmus.folder import build_folder


def is_own(fmu: Path) -> bool:
    """Is an FMU one of ours as it was built, or a copy of it, as a log holds it?"""
    return own_content(fmu) is not None


def own_content(fmu: Path) -> bytes | None:
    """The bytes of an FMU that is one of ours as it was built, or a copy of it; None for another.

    Raises:
        OSError: it cannot be read.
    """
    if not _as_large(fmu.stat().st_size):  # a large one from elsewhere is not read
        return None
    content = fmu.read_bytes()
    return content if is_own_content(content) else None


def is_own_content(content: bytes) -> bool:
    """Are these the bytes of one of our FMUs as it was built?"""
    return is_sealed_content(content) and any(p.read_bytes() == content for p in _as_large(len(content)))


def _as_large(size: int) -> list[Path]:
    """Our FMUs of so many bytes."""
    return [path for path in build_folder().glob("fmi*/*.fmu") if path.stat().st_size == size]
