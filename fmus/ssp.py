"""SSP 1.0 packages: a system's FMUs, their wiring and start values, for this harness and any other tool."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fmus.description import STOP_TIME, TOOL, add_units, base_units, scalars, text_of, to_bytes
from models.kit.block import Block
from models.kit.declaration import Type
from models.kit.link import Link
from models.system import System

NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
}
VALUES = "initialValues"  # the name of each component's parameter set: some tools apply the sets of one name


@dataclass(frozen=True)
class Connector:
    """A variable of a component; `kind` is input, output or parameter."""

    name: str
    kind: str
    type: Type
    unit: str = ""


@dataclass(frozen=True)
class Component:
    """An FMU, its variables, and the values with which some of them start (in its units)."""

    fmu: Path
    connectors: Sequence[Connector]
    values: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Connection:
    """A link whose target gets factor * source + offset."""

    link: Link
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Structure:
    """What a package describes.

    Attributes:
        units: the exponents of the base units, factor and offset of each unit, as XML writes them.
        stop_time: s.
    """

    name: str
    components: Mapping[str, Component]
    connections: Sequence[Connection]
    units: Mapping[str, Mapping[str, str]]
    stop_time: float = STOP_TIME


def structure_of(system: System, fmus: Mapping[str, Path]) -> Structure:
    """The structure of a system of ours.

    Args:
        fmus: the FMU of each role.
    """
    components = {
        role: Component(fmus[role], _connectors(block)) for role, block in system.components.items()
    }
    units = {connector.unit for part in components.values() for connector in part.connectors} - {""}
    return Structure(system.name, components, list(_connections(system)), base_units(sorted(units)))


def files_of(structure: Structure) -> dict[str, bytes]:
    """What is in the package: SystemStructure.ssd, and each FMU once in resources/."""
    sources = sources_of(structure)
    fmus = {sources[name]: part.fmu.read_bytes() for name, part in structure.components.items()}
    return {"SystemStructure.ssd": describe(structure), **fmus}


def describe(structure: Structure) -> bytes:
    """SystemStructure.ssd: components by role, connectors with types and units, connections, values."""
    namespaces = {f"xmlns:{prefix}": uri for prefix, uri in NAMESPACES.items()}
    root = ET.Element(
        "ssd:SystemStructureDescription",
        {**namespaces, "version": "1.0", "name": structure.name, "generationTool": TOOL},
    )
    whole = ET.SubElement(root, "ssd:System", name=structure.name)
    elements = ET.SubElement(whole, "ssd:Elements")
    sources = sources_of(structure)
    for name, part in structure.components.items():
        component = ET.SubElement(
            elements, "ssd:Component", name=name, type="application/x-fmu-sharedlibrary",
            source=sources[name], implementation="CoSimulation",
        )  # fmt: skip
        connectors = ET.SubElement(component, "ssd:Connectors")
        for connector in part.connectors:
            element = ET.SubElement(connectors, "ssd:Connector", name=connector.name, kind=connector.kind)
            _typed(element, "ssc", connector)
        if part.values:
            _bind(component, part)
    _connect(ET.SubElement(whole, "ssd:Connections"), structure.connections)
    add_units(ET.SubElement(root, "ssd:Units"), structure.units, "ssc:")
    ET.SubElement(root, "ssd:DefaultExperiment", startTime="0.0", stopTime=repr(structure.stop_time))
    return to_bytes(root)


def _connectors(block: type[Block]) -> list[Connector]:
    return [
        Connector(scalar.name, scalar.kind, scalar.declared.type, scalar.declared.unit)
        for scalar in scalars(block)
        if scalar.kind != "state"
    ]


def _connections(system: System) -> Iterable[Connection]:
    for link in system.links:
        source = system.components[link.source].variables()[link.source_variable]
        target = system.components[link.target].variables()[link.target_variable]
        for start, end in zip(source.flat_names, target.flat_names, strict=True):
            yield Connection(Link(link.source, start, link.target, end))


def sources_of(structure: Structure) -> dict[str, str]:
    """Where each component's FMU is in the package; of two files with one name the second gets its own."""
    sources: dict[str, str] = {}
    places: dict[str, Path] = {}
    for name, part in structure.components.items():
        source = f"resources/{part.fmu.name}"
        if places.setdefault(source, part.fmu) != part.fmu:
            source = f"resources/{name}-{part.fmu.name}"
        sources[name] = source
    return sources


def _bind(component: ET.Element, part: Component) -> None:
    binding = ET.SubElement(ET.SubElement(component, "ssd:ParameterBindings"), "ssd:ParameterBinding")
    bound = ET.SubElement(binding, "ssd:ParameterValues")
    into = ET.SubElement(
        ET.SubElement(bound, "ssv:ParameterSet", version="1.0", name=VALUES), "ssv:Parameters"
    )
    for connector in part.connectors:
        if connector.name in part.values:
            parameter = ET.SubElement(into, "ssv:Parameter", name=connector.name)
            _typed(parameter, "ssv", connector, value=text_of(connector.type, part.values[connector.name]))


def _typed(parent: ET.Element, prefix: str, connector: Connector, **attributes: str) -> None:
    if connector.unit:
        attributes["unit"] = connector.unit
    ET.SubElement(parent, f"{prefix}:{connector.type.value}", attributes)


def _connect(parent: ET.Element, connections: Iterable[Connection]) -> None:
    for connection in connections:
        link = connection.link
        element = ET.SubElement(
            parent, "ssd:Connection",
            startElement=link.source, startConnector=link.source_variable,
            endElement=link.target, endConnector=link.target_variable,
        )  # fmt: skip
        if (connection.factor, connection.offset) != (1.0, 0.0):  # which converts the units, too
            element.set("suppressUnitConversion", "true")
            factors = {"factor": repr(connection.factor), "offset": repr(connection.offset)}
            ET.SubElement(element, "ssc:LinearTransformation", factors)
