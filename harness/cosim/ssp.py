"""SSP 1.0 packages: a SystemStructure.ssd that wires FMUs, read into a description of the system.

Read are FMI co-simulation components, connections with or without a linear transformation, parameter values
inline or in .ssv files, of components and of the system, and system connectors that pass a value through.
Anything else in an SSD is refused by name: a system runs as its package states it, or not at all.
"""

from __future__ import annotations

import math
import posixpath
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

from codegen.scratch import Scratch
from harness.cosim.archive import naming, read_xml, unpack
from models.errors import CanineError, nearest, printable
from models.kit.link import Link

SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
SSC = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
FMU_TYPES = ("", "application/x-fmu-sharedlibrary")
SSV_TYPES = ("", "application/x-ssp-parameter-set")
IGNORED = {"Annotations", "ElementGeometry", "SystemGeometry", "GraphicalElements", "Enumerations", "Units"}
KINDS = {"input", "output", "inout", "parameter", "calculatedParameter", "structuralParameter", "local"}


class SspError(CanineError):
    """A package is not SSP 1.0, contradicts itself, or uses a feature that is not supported."""


@dataclass(frozen=True)
class Connector:
    """A component's variable as the SSD declares it; type and unit only where it does."""

    name: str
    kind: str
    type: str | None = None
    unit: str | None = None


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
    """

    factor: float = 1.0
    offset: float = 0.0
    table: tuple[tuple[int, int], ...] = ()

    @property
    def converts(self) -> bool:
        """Does the value change on the way?"""
        return (self.factor, self.offset) != (1.0, 0.0) or bool(self.table)


@dataclass(frozen=True)
class FmuSystem:
    """A wired system of FMUs: what the harness runs.

    Attributes:
        start_time, stop_time: s, of the package's experiment; FMUs begin at the first.
        files: the package's, by their names there.
    """

    name: str
    components: dict[str, FmuComponent]
    links: tuple[ScaledLink, ...]
    start_time: float = 0.0
    stop_time: float | None = None
    files: Mapping[str, Path] = field(default_factory=dict)


@contextmanager
def open_ssp(path: Path) -> Iterator[FmuSystem]:
    """Unpack a package (.ssp, a folder, or a folder's .ssd) for as long as it is used.

    Raises:
        SspError, ArchiveError, XmlError: naming the file and the element.
    """
    with Scratch() as temporary, naming(temporary, path):
        folder = temporary
        if path.is_dir():
            folder = path
        elif path.suffix == ".ssd":
            folder = path.parent
        else:
            unpack(path, folder)
        structure = path if path.suffix == ".ssd" else folder / "SystemStructure.ssd"
        if not structure.is_file():
            raise SspError(f"{path}: has no SystemStructure.ssd; is it an SSP package?")
        yield _Reader(path, folder).read(structure)


class _Reader:
    """Reads one SSD."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.path, self.folder = path, folder
        self.components: dict[str, FmuComponent] = {}
        self.files: dict[str, Path] = {}

    def fail(self, text: str) -> SspError:
        return SspError(f"{self.path}: {printable(text)}")

    def attribute(self, element: Element, name: str) -> str:
        value = element.get(name)
        if value is None:
            raise self.fail(f'a {_tag(element)} lacks its attribute "{name}"')
        return value

    def number(self, element: Element, name: str, default: str | None = None) -> float:
        text = element.get(name, default)
        try:
            value = float({"true": "1", "false": "0"}.get(text or "", text or ""))
        except ValueError:
            raise self.fail(f'{_tag(element)} has {name}="{text}"; expected a number') from None
        if not math.isfinite(value):
            raise self.fail(f'{_tag(element)} has {name}="{text}"; expected a finite number')
        return value

    def children(self, element: Element, *known: str) -> dict[str, Element]:
        """The children by tag; any that is neither known nor decoration is refused."""
        elements = {}
        for child in element:
            if _tag(child) in known:
                elements[_tag(child)] = child
            elif _tag(child) not in IGNORED:
                raise self.fail(f"{_tag(element)} holds a {_tag(child)}, which is not supported")
        return elements

    def read(self, structure: Path) -> FmuSystem:
        self.files["SystemStructure.ssd"] = structure
        root = read_xml(structure, f"{self.path}: {structure.name}")
        if root.tag != f"{SSD}SystemStructureDescription":
            raise self.fail(f"the root is {root.tag}; expected an SSP 1.0 SystemStructureDescription")
        if root.get("version") != "1.0":
            raise self.fail(f'SSP version "{root.get("version")}"; expected "1.0"')
        parts = self.children(root, "System", "DefaultExperiment")
        if "System" not in parts:
            raise self.fail("has no System")
        experiment = parts.get("DefaultExperiment")
        stop = None
        if experiment is not None and experiment.get("stopTime") is not None:
            stop = self.number(experiment, "stopTime")
        if experiment is not None and self.number(experiment, "startTime", "0") != 0:
            raise self.fail("the experiment starts at another time than 0 s, which is not supported")
        return self.system(parts["System"], self.attribute(root, "name"), stop)

    def system(self, system: Element, name: str, stop: float | None) -> FmuSystem:
        parts = self.children(system, "Connectors", "Elements", "Connections", "ParameterBindings")
        for element in parts.get("Elements", ()):
            if _tag(element) != "Component":
                named = element.get("name", "")
                raise self.fail(f'element "{named}" is a {_tag(element)}; expected a Component (an FMU)')
            component = self.component(element)
            if component.name in self.components:
                raise self.fail(f'two components are named "{component.name}"')
            self.components[component.name] = component
        boundary = self.connectors(parts.get("Connectors"), "the system")
        links, through = self.connections(parts.get("Connections", ()), boundary)
        for target, value in self.bindings(parts.get("ParameterBindings"), "the system").items():
            for component_name, variable in through.get(target) or [self.address(target)]:
                self.components[component_name].values[variable] = value
        return FmuSystem(name, self.components, links, stop_time=stop, files=self.files)

    def address(self, name: str) -> tuple[str, str]:
        component, _, variable = name.partition(".")
        if component not in self.components or not variable:
            hint = nearest(component, self.components)
            raise self.fail(f'the system\'s parameter "{name}" belongs to no component{hint}')
        return component, variable

    def component(self, element: Element) -> FmuComponent:
        name = self.attribute(element, "name")
        kind, source = element.get("type", ""), self.attribute(element, "source")
        if kind not in FMU_TYPES:
            raise self.fail(f'component "{name}" has type "{kind}"; expected "{FMU_TYPES[1]}"')
        implementation = element.get("implementation", "any")
        if implementation not in ("any", "CoSimulation"):
            raise self.fail(f'component "{name}" is for {implementation}; only CoSimulation is run')
        parts = self.children(element, "Connectors", "ParameterBindings")
        return FmuComponent(
            name,
            self.file(source, f'component "{name}"'),
            self.connectors(parts.get("Connectors"), f'component "{name}"'),
            self.bindings(parts.get("ParameterBindings"), f'component "{name}"'),
        )

    def file(self, source: str, what: str) -> Path:
        """A file of the package."""
        root = self.folder.resolve()
        try:
            path = (root / source).resolve()
            is_file = path.is_file()
        except (OSError, RuntimeError, ValueError) as reason:  # too long a name, a loop of links, a zero byte
            raise self.fail(f'{what} has source "{source:.80}", which is no path ({reason})') from None
        if ":" in source or not path.is_relative_to(root):
            raise self.fail(f'{what} has source "{source}"; expected a path inside the package')
        if not is_file:
            raise self.fail(f'{what} has source "{source}", which is not in the package')
        self.files[posixpath.normpath(source)] = path
        return path

    def connectors(self, parent: Element | None, what: str) -> dict[str, Connector]:
        connectors: dict[str, Connector] = {}
        for element in parent if parent is not None else ():
            name, kind = self.attribute(element, "name"), self.attribute(element, "kind")
            if kind not in KINDS:
                raise self.fail(f'{what}: connector "{name}" has kind "{kind}"{nearest(kind, KINDS)}')
            if name in connectors:
                raise self.fail(f'{what} has two connectors "{name}"')
            types = [child for child in element if child.tag.startswith(SSC)]
            declared = types[0] if types else None
            connectors[name] = Connector(
                name,
                kind,
                None if declared is None else _tag(declared),
                None if declared is None else declared.get("unit"),
            )
        return connectors

    def bindings(self, parent: Element | None, what: str) -> dict[str, StartValue]:
        values: dict[str, StartValue] = {}
        for binding in parent if parent is not None else ():
            prefix = binding.get("prefix", "")
            if binding.get("type", "") not in SSV_TYPES:
                raise self.fail(f'{what}: parameter binding of type "{binding.get("type")}" is not supported')
            parts = self.children(binding, "ParameterValues")
            if "source" in binding.attrib:
                if binding.get("sourceBase", "SSD") != "SSD":
                    raise self.fail(f'{what}: parameter binding with sourceBase "component" is not supported')
                path = self.file(binding.attrib["source"], what)
                sets = [read_xml(path, f"{self.path}: {path.name}")]
            else:
                sets = list(parts.get("ParameterValues", ()))
            for parameter_set in sets:
                if parameter_set.tag != f"{SSV}ParameterSet":
                    raise self.fail(f"{what}: {_tag(parameter_set)} is not an SSP 1.0 ParameterSet")
                for element in parameter_set.iter(f"{SSV}Parameter"):
                    values[prefix + self.attribute(element, "name")] = self.value(element, what)
        return values

    def value(self, element: Element, what: str) -> StartValue:
        name = element.get("name")
        typed = next((child for child in element if child.tag.startswith(SSV)), None)
        if typed is None or _tag(typed) not in ("Real", "Integer", "Boolean", "Enumeration"):
            kind = "nothing" if typed is None else f"a {_tag(typed)}"
            expected = "Real, Integer, Boolean or Enumeration"
            raise self.fail(f'{what}: parameter "{name}" holds {kind}; expected {expected}')
        return StartValue(self.number(typed, "value"), typed.get("unit"))

    def connections(
        self, parent: Element | tuple[()], boundary: dict[str, Connector]
    ) -> tuple[tuple[ScaledLink, ...], dict[str, list[tuple[str, str]]]]:
        """The links between components, and what each of the system's own inputs leads to."""
        links: list[ScaledLink] = []
        through: dict[str, list[tuple[str, str]]] = {}
        for element in parent:
            source = self.end(element, "start", boundary)
            target = self.end(element, "end", boundary)
            factor, offset = self.transformation(element, f"{_dotted(source)} -> {_dotted(target)}")
            if source[0] and target[0]:
                if self.components[target[0]].connectors[target[1]].kind == "parameter":
                    raise self.fail(
                        f"a connection ends at the parameter {_dotted(target)}; bind its value instead"
                    )
                links.append(ScaledLink(*source, *target, factor, offset))
            elif target[0]:
                if (factor, offset) != (1.0, 0.0):
                    raise self.fail(f"system connector {source[1]}: a transformation is not supported here")
                through.setdefault(source[1], []).append(target)
        return tuple(links), through

    def end(self, element: Element, side: str, boundary: dict[str, Connector]) -> tuple[str, str]:
        """One end of a connection: (component, variable), the component "" for the system itself."""
        owner, name = element.get(f"{side}Element", ""), self.attribute(element, f"{side}Connector")
        if owner and owner not in self.components:
            hint = nearest(owner, self.components)
            raise self.fail(f'a connection names component "{owner}", which does not exist{hint}')
        known = self.components[owner].connectors if owner else boundary
        if name not in known:
            what = f'component "{owner}"' if owner else "the system"
            raise self.fail(
                f'a connection names connector "{name}", which {what} lacks{nearest(name, known)}'
            )
        kind = known[name].kind
        inward = (side == "start") == (not owner)  # a system's input is a source for what is inside
        expected = ("input", "parameter") if inward else ("output",)
        if kind not in expected:
            raise self.fail(
                f"a connection {'starts' if side == 'start' else 'ends'} at {_dotted((owner, name))}, "
                f'whose kind is "{kind}"; expected "{expected[0]}"'
            )
        return owner, name

    def transformation(self, element: Element, what: str) -> tuple[float, float]:
        linear = self.children(element, "ConnectionGeometry", "LinearTransformation").get(
            "LinearTransformation"
        )
        if linear is None:
            return 1.0, 0.0
        factor, offset = self.number(linear, "factor", "1"), self.number(linear, "offset", "0")
        if factor == 0:
            raise self.fail(f"connection {what}: a LinearTransformation with factor 0 passes nothing on")
        return factor, offset


def _tag(element: Element) -> str:
    return element.tag.rpartition("}")[2]


def _dotted(end: tuple[str, str]) -> str:
    return ".".join(part for part in end if part)
