"""What a foreign FMU calls a role's variable."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Rename:
    """A variable of the FMU for one of the role's, and the linear conversion of its value."""

    name: str
    factor: float = 1.0
    offset: float = 0.0
    mapped: bool = False
