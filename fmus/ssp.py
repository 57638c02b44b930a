"""SSP 1.0 packages: a system's FMUs and how they are wired, for this harness and any other tool."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from fmus.archive import pack
from fmus.description import STOP_TIME, TOOL, Scalar, add_units, scalars, to_bytes
from models.errors import ParameterError, nearest
from models.kit.block import Block
from models.system import System

NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
}


def write_ssp(
    system: System, fmus: Mapping[str, Path], path: Path, parameters: Mapping[str, float] | None = None
) -> Path:
    """Pack a system: SystemStructure.ssd, and each FMU once in resources/.

    Args:
        fmus: the FMU of each role.
        parameters: values by `role.name` (flat name, SI units), bound in the package itself.

    Raises:
        ParameterError: a parameter is unknown, of the wrong type or out of its range.
    """
    files = {"SystemStructure.ssd": structure(system, fmus, parameters or {})}
    files |= {f"resources/{fmu.name}": fmu.read_bytes() for fmu in fmus.values()}
    return pack(path, files)


def structure(system: System, fmus: Mapping[str, Path], parameters: Mapping[str, float]) -> bytes:
    """SystemStructure.ssd: components by role, connectors with types and units, connections, parameters."""
    bindings = _bindings(system, parameters)
    root = ET.Element(
        "ssd:SystemStructureDescription",
        {
            **{f"xmlns:{prefix}": uri for prefix, uri in NAMESPACES.items()},
            "version": "1.0",
            "name": system.name,
            "generationTool": TOOL,
        },
    )
    whole = ET.SubElement(root, "ssd:System", name=system.name)
    elements = ET.SubElement(whole, "ssd:Elements")
    for role, block in system.components.items():
        component = ET.SubElement(
            elements, "ssd:Component", name=role, type="application/x-fmu-sharedlibrary",
            source=f"resources/{fmus[role].name}", implementation="CoSimulation",
        )  # fmt: skip
        connectors = ET.SubElement(component, "ssd:Connectors")
        for scalar in scalars(block):
            if scalar.kind != "state":
                connector = ET.SubElement(connectors, "ssd:Connector", name=scalar.name, kind=scalar.kind)
                _typed(connector, "ssc", scalar)
        if bindings[role]:
            _bind(component, role, bindings[role])
    _connect(ET.SubElement(whole, "ssd:Connections"), system)
    units = {v.declared.unit for block in system.components.values() for v in scalars(block)} - {""}
    add_units(ET.SubElement(root, "ssd:Units"), sorted(units), "ssc:")
    ET.SubElement(root, "ssd:DefaultExperiment", startTime="0.0", stopTime=repr(STOP_TIME))
    return to_bytes(root)


def _bindings(system: System, parameters: Mapping[str, float]) -> dict[str, list[tuple[Scalar, float]]]:
    """The values for each role, checked against the declarations."""
    known = {
        f"{role}.{scalar.name}": (role, scalar)
        for role, block in system.components.items()
        for scalar in _parameters(block)
    }
    bindings: dict[str, list[tuple[Scalar, float]]] = {role: [] for role in system.components}
    for name, value in parameters.items():
        if name not in known:
            raise ParameterError(f'system "{system.name}" has no parameter "{name}"{nearest(name, known)}')
        role, scalar = known[name]
        scalar.declared.check(float(value), name)
        bindings[role].append((scalar, float(value)))
    return bindings


def _parameters(block: type[Block]) -> list[Scalar]:
    return [scalar for scalar in scalars(block) if scalar.kind == "parameter"]


def _bind(component: ET.Element, role: str, values: list[tuple[Scalar, float]]) -> None:
    binding = ET.SubElement(ET.SubElement(component, "ssd:ParameterBindings"), "ssd:ParameterBinding")
    bound = ET.SubElement(binding, "ssd:ParameterValues")
    into = ET.SubElement(ET.SubElement(bound, "ssv:ParameterSet", version="1.0", name=role), "ssv:Parameters")
    for scalar, value in values:
        parameter = ET.SubElement(into, "ssv:Parameter", name=scalar.name)
        _typed(parameter, "ssv", scalar, value=scalar.text(value))


def _typed(parent: ET.Element, prefix: str, scalar: Scalar, **attributes: str) -> None:
    if scalar.declared.unit:
        attributes["unit"] = scalar.declared.unit
    ET.SubElement(parent, f"{prefix}:{scalar.declared.type.value}", attributes)


def _connect(parent: ET.Element, system: System) -> None:
    for link in system.links:
        source = system.components[link.source].variables()[link.source_variable]
        target = system.components[link.target].variables()[link.target_variable]
        for start, end in zip(source.flat_names, target.flat_names, strict=True):
            ET.SubElement(
                parent, "ssd:Connection",
                startElement=link.source, startConnector=start, endElement=link.target, endConnector=end,
            )  # fmt: skip
