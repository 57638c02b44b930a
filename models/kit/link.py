"""Links between the components of a system, and values of the components' variables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Key = tuple[str, str]  # component, flat name
Values = Mapping[str, Mapping[str, float]]  # by component and flat name, SI


@dataclass(frozen=True)
class Link:
    """One link: `source_variable` of component `source` feeds `target_variable` of component `target`.

    The target gets factor * source + offset; what a system of ours links is not converted.
    """

    source: str
    source_variable: str
    target: str
    target_variable: str
    factor = 1.0
    offset = 0.0

    @property
    def signal(self) -> str:
        """What scenarios call the source's variable."""
        return self.source_variable

    def __str__(self) -> str:
        return f"{self.source}.{self.source_variable} -> {self.target}.{self.target_variable}"
