"""The tree of a package: systems, the components in them, and the connections between their connectors."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from harness.cosim.fmu import FmuDescription, describe
from harness.cosim.ssp.parameters import Binding
from harness.cosim.ssp.system import Connector
from harness.cosim.ssp.transformation import Stated

Port = tuple[str, str]  # an element's path and its connector


@dataclass(eq=False)
class Part:
    """An element of the tree.

    Attributes:
        path: its name after those of the systems around it, `sub.plant`; "" for the outermost system.
    """

    path: str
    connectors: dict[str, Connector]
    bindings: list[Binding]

    @property
    def title(self) -> str:
        """How messages call it."""
        return "the system"


@dataclass(eq=False)
class ComponentPart(Part):
    """A component."""

    fmu: Path = Path()

    @property
    def title(self) -> str:
        return f'component "{self.path}"'

    @cached_property
    def description(self) -> FmuDescription:
        """What its FMU says; it is read only where the SSD does not say enough."""
        return describe(self.fmu)

    def knows(self, name: str) -> bool:
        """Has it a variable of this name?"""
        if name in self.connectors:
            return True
        return name in self.description.quantities or name in self.description.refused


@dataclass(eq=False)
class SystemPart(Part):
    """A system: what is in it, by name."""

    elements: dict[str, Part] = field(default_factory=dict)

    @property
    def title(self) -> str:
        return f'system "{self.path}"' if self.path else "the system"


@dataclass(frozen=True, eq=False)
class Hop:
    """A connection, in the direction of its values."""

    source: Port
    target: Port
    stated: Stated
    suppressed: bool


def dotted(port: Port) -> str:
    """A port in messages: `sub.plant.speed`."""
    return ".".join(part for part in port if part)
