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
    size = fmu.stat().st_size
    same = (path for path in own.glob("fmi*/*.fmu") if path.stat().st_size == size)
    return any(is_sealed(path) and path.read_bytes() == fmu.read_bytes() for path in same)
