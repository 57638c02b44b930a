"""SSP packages, 1.0 and 2.0: a SystemStructure.ssd that wires FMUs, read into a description of the system.

Read are FMI co-simulation components, nested systems, connections with their transformations and conversions
of units, and parameter bindings with their mappings. Anything else in an SSD is refused by name: a system
runs as its package states it, or not at all.

`document` reads elements of one file, `package` finds the files, `units` and `transformation` are what
becomes of values, `parameters` reads bindings, `tree` the structure, made of `parts`; `flatten` makes of it
a `system`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from harness.cosim.ssp.document import SspError
from harness.cosim.ssp.flatten import Flattened
from harness.cosim.ssp.package import open_package
from harness.cosim.ssp.system import Connector, FmuComponent, FmuSystem, ScaledLink, StartValue
from harness.cosim.ssp.tree import Tree

__all__ = ["Connector", "FmuComponent", "FmuSystem", "ScaledLink", "SspError", "StartValue", "open_ssp"]


@contextmanager
def open_ssp(path: Path) -> Iterator[FmuSystem]:
    """Unpack a package (see `open_package`) for as long as it is used; the system that it describes.

    Raises:
        SspError, ArchiveError, XmlError, FmuError: naming the file and the element.
    """
    with open_package(path) as (package, document):
        yield Flattened(Tree(package, document)).system()
