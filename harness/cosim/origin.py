"""Which FMUs were built here."""

from __future__ import annotations

from pathlib import Path

from fmus.archive import is_sealed
from fmus.folder import build_folder


def is_own(fmu: Path) -> bool:
    """Is an FMU one of ours as it was built, or a copy of it, as a log holds it?"""
    own = build_folder().resolve()
    if own in fmu.resolve().parents and is_sealed(fmu):
        return True
    return bool(_as_large(fmu.stat().st_size)) and is_own_content(fmu.read_bytes())


def is_own_content(content: bytes) -> bool:
    """Are these the bytes of one of our FMUs as it was built?"""
    return any(is_sealed(path) and path.read_bytes() == content for path in _as_large(len(content)))


def _as_large(size: int) -> list[Path]:
    """Our FMUs of so many bytes."""
    return [path for path in build_folder().glob("fmi*/*.fmu") if path.stat().st_size == size]
