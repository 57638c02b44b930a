"""Which FMUs were built here."""

from __future__ import annotations

from pathlib import Path

from fmus.archive import is_sealed
from fmus.folder import build_folder


def is_own(fmu: Path) -> bool:
    """Is an FMU one of ours as it was built, or a copy of it, as a log holds it?"""
    own = build_folder().resolve()
    return (own in fmu.resolve().parents and is_sealed(fmu)) or is_own_content(fmu.read_bytes())


def is_own_content(content: bytes) -> bool:
    """Are these the bytes of one of our FMUs as it was built?"""
    same = (p for p in build_folder().glob("fmi*/*.fmu") if p.stat().st_size == len(content))
    return any(is_sealed(path) and path.read_bytes() == content for path in same)
