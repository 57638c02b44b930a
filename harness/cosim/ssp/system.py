"""A wired system of FMUs, as a package describes it and the harness runs it: components and links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from harness.cosim.stepping import Ticks
from models.disturbance import FaultyLink
from models.kit.link import Link


@dataclass(frozen=True)
class Connector:
    """A variable as the SSD declares it; type, unit and enumeration only where it does."""

    name: str
    kind: str
    type: str | None = None
    unit: str | None = None
    enumeration: str | None = None


@dataclass(frozen=True)
class StartValue:
    """A start value: of a parameter, or of an input that nothing feeds."""

    value: float
    unit: str | None = None


@dataclass(frozen=True)
class FmuComponent:
    """One FMU of the system."""

    name: str
    fmu: Path
    connectors: dict[str, Connector] = field(default_factory=dict)
    values: dict[str, StartValue] = field(default_factory=dict)


@dataclass(frozen=True)
class ScaledLink(Link):
    """A link whose target gets factor * source + offset, or what a table has for the source's whole number.

    Attributes:
        table: pairs of a whole number and the one that replaces it; others stay.
        settled: its package has compared the units of both ends, and the link is what it asks for.
        output: the role's name of the source's variable, where a swapped FMU has another.
    """

    factor: float = 1.0
    offset: float = 0.0
    table: tuple[tuple[int, int], ...] = ()
    settled: bool = False
    output: str = ""

    @property
    def signal(self) -> str:
        """The role's name of the source's variable."""
        return self.output or self.source_variable

    @property
    def converts(self) -> bool:
        """Does the value change on the way?"""
        return (self.factor, self.offset) != (1.0, 0.0) or bool(self.table)

    @property
    def conversion(self) -> str:
        """What becomes of the value, for people; "" if nothing does."""
        if self.table:
            return ", ".join(f"{number} as {replaced}" for number, replaced in self.table)
        scaled = f"* {self.factor:g}" if self.factor != 1.0 else ""
        shifted = f"{'+' if self.offset > 0 else '-'} {abs(self.offset):g}" if self.offset else ""
        return f"{scaled} {shifted}".strip()


@dataclass(frozen=True)
class FmuSystem:
    """A wired system of FMUs: what the harness runs.

    Attributes:
        components: by name; in a nested system its name is before that, `sub.plant`.
        start_time, stop_time: s, of the package's experiment; FMUs begin at the first.
        files: the package's, by their names there.
        notes: what the package makes of itself that the user should know.
        faults: what the components that disturb links act on.
        tick: s; None for the one that follows from its FMUs.
        stalls: when components are not stepped, ticks from and to before.
    """

    name: str
    components: dict[str, FmuComponent]
    links: tuple[ScaledLink, ...]
    start_time: float = 0.0
    stop_time: float | None = None
    files: Mapping[str, Path] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    faults: Mapping[str, FaultyLink] = field(default_factory=dict)
    tick: float | None = None
    stalls: Mapping[str, tuple[Ticks, ...]] = field(default_factory=dict)
