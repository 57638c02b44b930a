"""The descriptions in an FMU, from the declaration: model and build description, and a page to read."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.blocks.block_c import VERSION
from codegen.blocks.expressions import c_name, member_of
from codegen.templating import environment
from codegen.toolchains.compiler import NUMERICS
from fmus.dependencies import Known, initial_dependencies, tick_dependencies
from fmus.folder import FmiVersion
from models.errors import DeclarationError
from models.kit.block import Block
from models.kit.declaration import LARGEST, Parameter, Type, Variable
from models.kit.elementary import Precision
from models.kit.units import UNITS

CAUSALITY = {"input": "input", "output": "output", "parameter": "parameter", "state": "local"}  # by reference
FMI3_TYPES = {Type.REAL: "Float64", Type.INTEGER: "Int32", Type.BOOLEAN: "Boolean"}
STOP_TIME = 300.0  # s, at which a trial is cut
ALONE_TIME = 40.0  # s, of a default experiment of one FMU: importers lengthen steps beyond a thousand of them
TOOL = f"guided-canine generator {VERSION}"
TEMPLATES = environment(Path(__file__).parent / "templates")


@dataclass(frozen=True)
class Scalar:
    """One variable of an FMU: an element of a declared one.

    Attributes:
        reference: its value reference: its place among inputs, outputs, parameters and states.
        start: its start value, in the unit of `declared`.
    """

    name: str
    reference: int
    declared: Variable
    start: float

    @property
    def kind(self) -> str:
        """Input, output, parameter or state."""
        return self.declared.kind

    @property
    def causality(self) -> str:
        """As FMI names the kind: a state is `local`."""
        return CAUSALITY[self.kind]

    @property
    def variability(self) -> str:
        """`discrete`: it changes at ticks; a parameter is `fixed`, or `tunable` if the block latches it."""
        if isinstance(self.declared, Parameter):
            return "tunable" if self.declared.latched else "fixed"
        return "discrete"

    @property
    def description(self) -> str:
        """The meaning, with the named values of an enumeration."""
        if not self.declared.choices:
            return self.declared.meaning
        return f"{self.declared.meaning}: {', '.join(f'{int(c)} {c.name}' for c in self.declared.choices)}"

    @property
    def attributes(self) -> dict[str, str]:
        """Unit, range and, where the environment may set it, start: as XML writes them."""
        attributes = {"unit": self.declared.unit} if self.declared.unit else {}
        if self.declared.type is not Type.BOOLEAN:
            bounds = {"min": self.declared.min, "max": self.declared.max}
            attributes |= {key: self.text(bound) for key, bound in bounds.items() if bound is not None}
        if self.kind in ("input", "parameter"):
            attributes["start"] = self.text(self.start)
        return attributes

    def text(self, value: float) -> str:
        """A value as XML writes it for this type."""
        return text_of(self.declared.type, value)

    @property
    def field(self) -> str:
        """Its member of the block's C struct."""
        return f"{member_of(self.declared)}.{c_name(self.name)}"

    @property
    def role(self) -> str:
        """What the shim calls the kind."""
        return (self.variability if self.kind == "parameter" else self.kind).upper()

    @property
    def limits(self) -> tuple[float, float]:
        """The range that the shim holds a parameter to; the range of an input is the block's matter."""
        if self.kind != "parameter":
            return 0.0, 0.0
        low, high = (-LARGEST, LARGEST) if self.declared.type is Type.REAL else (-(2.0**31), 2.0**31 - 1)
        low = low if self.declared.min is None else float(self.declared.min)
        return low, high if self.declared.max is None else float(self.declared.max)


def text_of(kind: Type, value: float) -> str:
    """A value as XML writes it for a type."""
    if kind is Type.BOOLEAN:
        return "true" if value else "false"
    return str(int(value)) if kind is Type.INTEGER else repr(float(value))


def scalars(block: type[Block]) -> list[Scalar]:
    """The variables of a block's FMU in the order of their value references.

    Raises:
        DeclarationError: a variable is called `time`, which FMI 3.0 has of its own.
    """
    flat: list[Scalar] = []
    for kind in CAUSALITY:
        for variable in block.group(kind):
            if variable.name == "time":
                raise DeclarationError(f'{block.title()}: variable "time"; FMI 3.0 adds its own, rename it')
            for name, start in zip(variable.flat_names, variable.start, strict=True):
                flat.append(Scalar(name, len(flat), variable, start))
    return flat


def block_header(block: type[Block], version: FmiVersion, precision: Precision, token: str) -> str:
    """sources/block_fmu.h: what the shim knows of the block."""
    return TEMPLATES.get_template("block_fmu.h.jinja").render(
        block=block.title(),
        token=token,
        sample_time=repr(block.sample_time),
        transparent=block.transparent,
        variables=scalars(block),
        single=precision == "float",
        version=version,
    )


def documentation(block: type[Block], version: FmiVersion) -> str:
    """documentation/index.html: what the block is, and a table of its variables."""
    return TEMPLATES.get_template("index.html.jinja").render(
        block=block.title(),
        doc=block.summary(),
        source=block.source,
        version=version,
        tool=TOOL,
        sample_time=repr(block.sample_time),
        moore=block.moore,
        options=" ".join(NUMERICS),
        variables=scalars(block),
    )


def model_description(block: type[Block], version: FmiVersion, token: str, sources: Sequence[str]) -> bytes:
    """modelDescription.xml of FMI 2.0 or 3.0.

    Args:
        token: the GUID (instantiation token) that the binary expects.
        sources: the C files of the sources folder.
    """
    root = ET.Element("fmiModelDescription", fmiVersion=f"{version}.0", modelName=block.title())
    root.attrib |= {
        "guid" if version == 2 else "instantiationToken": token,
        "description": block.summary(),
        "version": VERSION,
        "generationTool": TOOL,
        "variableNamingConvention": "structured",
    }
    _interface(root, block, version, sources)
    units = {v.declared.unit for v in scalars(block)} - {""} | ({"s"} if version == 3 else set())
    if units:
        add_units(ET.SubElement(root, "UnitDefinitions"), base_units(sorted(units)))
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="what was refused, and why")
    experiment = {"startTime": "0.0", "stopTime": repr(ALONE_TIME)}
    if not block.transparent:
        experiment["stepSize"] = repr(block.sample_time)
    ET.SubElement(root, "DefaultExperiment", experiment)
    variables = ET.SubElement(root, "ModelVariables")
    for scalar in scalars(block):
        if version == 2:
            variable = ET.SubElement(variables, "ScalarVariable", _identity(scalar))
            ET.SubElement(variable, scalar.declared.type.value, scalar.attributes)
        else:
            kind = FMI3_TYPES[scalar.declared.type]
            ET.SubElement(variables, kind, _identity(scalar) | scalar.attributes)
    if version == 3:
        clock = {"name": "time", "valueReference": str(len(scalars(block))), "description": "simulation time"}
        clock |= {"causality": "independent", "variability": "continuous", "unit": "s"}
        ET.SubElement(variables, "Float64", clock)
    _structure(ET.SubElement(root, "ModelStructure"), block, version)
    return to_bytes(root)


def build_description(block: type[Block], sources: Sequence[str]) -> bytes:
    """sources/buildDescription.xml of FMI 3.0: how anyone compiles the sources again."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=block.title())
    files = ET.SubElement(configuration, "SourceFileSet", language="C99")
    files.attrib |= {"compiler": "clang", "compilerOptions": " ".join(NUMERICS)}
    for name in sources:
        ET.SubElement(files, "SourceFile", name=name)
    library = {"name": "m", "external": "true", "description": "floor, fabs and sqrt, nothing else"}
    ET.SubElement(configuration, "Library", library)
    return to_bytes(root)


def base_units(units: Sequence[str]) -> dict[str, dict[str, str]]:
    """Units of ours by their SI base units, as XML writes these."""
    return {unit: {base: str(power) for base, power in UNITS[unit].items()} for unit in units}


def add_units(parent: ET.Element, units: Mapping[str, Mapping[str, str]], prefix: str = "") -> None:
    """Define units by their base units; `prefix` is that of the XML names (`ssc:` in SSP)."""
    for unit, base in units.items():
        element = ET.SubElement(parent, f"{prefix}Unit", name=unit)
        ET.SubElement(element, f"{prefix}BaseUnit", dict(base))


def to_bytes(root: ET.Element) -> bytes:
    """An XML document, indented; the same tree gives the same bytes."""
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _interface(root: ET.Element, block: type[Block], version: FmiVersion, sources: Sequence[str]) -> None:
    interface = ET.SubElement(root, "CoSimulation", modelIdentifier=block.title())
    interface.set("canHandleVariableCommunicationStepSize", "true" if block.transparent else "false")
    if version == 3:
        interface.attrib |= {
            "canGetAndSetFMUState": "true",
            "canSerializeFMUState": "true",
            "providesDirectionalDerivatives": "false",
        }
        if not block.transparent:
            interface.set("fixedInternalStepSize", repr(block.sample_time))
        return
    interface.attrib |= {
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "false",
    }
    files = ET.SubElement(interface, "SourceFiles")
    for name in sources:
        ET.SubElement(files, "File", name=name)


def _identity(v: Scalar) -> dict[str, str]:
    attributes = {"name": v.name, "valueReference": str(v.reference), "description": v.description}
    attributes |= {"causality": v.causality, "variability": v.variability}
    if v.kind != "input":
        attributes["initial"] = "exact" if v.kind == "parameter" else "calculated"
    return attributes


def _structure(parent: ET.Element, block: type[Block], version: FmiVersion) -> None:
    """Outputs and initial unknowns with what they depend on: indices from 1 in FMI 2.0, references in 3.0."""
    number = {v.name: v.reference + (1 if version == 2 else 0) for v in scalars(block)}
    lists: tuple[tuple[str, Mapping[str, Known]], ...] = (
        ("Output", tick_dependencies(block)),
        ("InitialUnknown", initial_dependencies(block)),
    )
    for entry, unknowns in lists:
        if version == 2 and not unknowns:
            continue
        into = ET.SubElement(parent, f"{entry}s") if version == 2 else parent
        for name, known in unknowns.items():
            unknown = ET.SubElement(into, "Unknown" if version == 2 else entry)
            unknown.set("index" if version == 2 else "valueReference", str(number[name]))
            unknown.set("dependencies", " ".join(str(n) for n in sorted(number[k] for k in known)))
            unknown.set("dependenciesKind", " ".join(["dependent"] * len(known)))
