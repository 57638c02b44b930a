"""A SystemStructure.ssd, read as the tree that it is."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from harness.cosim.fmu import Unit
from harness.cosim.ssp.document import SSD, Document, tag_of
from harness.cosim.ssp.package import Package
from harness.cosim.ssp.parameters import TYPES, BindingReader
from harness.cosim.ssp.parts import ComponentPart, Hop, Part, Port, SystemPart, dotted
from harness.cosim.ssp.system import Connector
from harness.cosim.ssp.transformation import Items, read_transformation
from harness.cosim.ssp.units import read_enumerations, read_units
from models.errors import nearest

FMU_TYPES = ("", "application/x-fmu-sharedlibrary")
CONNECTORS = {
    "input", "output", "inout", "local", "unspecified",
    "constant", "parameter", "calculatedParameter", "structuralParameter",
}  # fmt: skip
CONSTANT = ("parameter", "structuralParameter")
# what a connection may come from and go to: by whether the connector is the enclosing system's own
SOURCES = {True: ("input", *CONSTANT), False: ("output",)}
TARGETS = {True: ("output",), False: ("input", *CONSTANT)}
MOST_TIME = 1e6  # s; beyond, the steps that a double can tell apart grow coarse


class Tree:
    """The tree of one SSD.

    Raises:
        SspError, ArchiveError, XmlError: it contradicts itself, or uses a feature that is not supported.
    """

    def __init__(self, package: Package, document: Document) -> None:
        self.package, self.document = package, document
        self.parts: dict[str, Part] = {}
        self.hops: dict[Port, list[Hop]] = {}
        self.feeds: dict[Port, Hop] = {}  # by what they lead to
        document.check_element(document.root, f"{SSD}SystemStructureDescription", "the root")
        parts = document.children(document.root, "System", "DefaultExperiment", "Units", "Enumerations")
        if "System" not in parts:
            raise document.fail("has no System")
        self.units = read_units(document, parts.get("Units"))
        self.enumerations = read_enumerations(document, parts.get("Enumerations"))
        self.start, self.stop = self._experiment(parts.get("DefaultExperiment"))
        self.root = self._system(parts["System"], "")
        self._check_circles()

    def _experiment(self, experiment: Element | None) -> tuple[float, float | None]:
        """Start and stop, s."""
        if experiment is None:
            return 0.0, None
        self.document.children(experiment)
        start = self.document.number(experiment, "startTime", "0")
        if abs(start) > MOST_TIME:
            raise self.document.fail(
                f"the experiment starts at {start:g} s; expected {-MOST_TIME:g} to {MOST_TIME:g} s"
            )
        if "stopTime" not in experiment.attrib:
            return start, None
        stop = self.document.number(experiment, "stopTime")
        if stop <= start:
            raise self.document.fail(f"the experiment starts at {start:g} s and stops at {stop:g} s")
        return start, stop

    def _system(self, element: Element, path: str) -> SystemPart:
        parts = self.document.children(element, "Connectors", "Elements", "Connections", "ParameterBindings")
        system = SystemPart(path, {}, [])
        self._add(system)
        system.connectors = self._connectors(parts.get("Connectors"), system)
        for inner in self.document.listed(parts.get("Elements"), "Component", "System"):
            name = self.document.attribute(inner, "name")
            if not name:
                raise self.document.fail(f"{system.title} has a {tag_of(inner)} without a name")
            if name in system.elements:
                raise self.document.fail(f'{system.title} has two elements named "{name}"')
            read = self._component if tag_of(inner) == "Component" else self._system
            system.elements[name] = read(inner, f"{path}.{name}" if path else name)
        for connection in self.document.listed(parts.get("Connections"), "Connection"):
            self._connect(system, connection)
        bindings = parts.get("ParameterBindings")
        system.bindings = BindingReader(self.package, self.document, system.title).read(bindings)
        return system

    def _component(self, element: Element, path: str) -> ComponentPart:
        document, what = self.document, f'component "{path}"'
        kind, source = element.get("type", ""), document.attribute(element, "source")
        if kind not in FMU_TYPES:
            raise document.fail(f'{what} has type "{kind}"; expected "{FMU_TYPES[1]}"')
        implementation = element.get("implementation", "any")
        if implementation not in ("any", "CoSimulation"):
            raise document.fail(f"{what} is for {implementation}; only CoSimulation is run")
        parts = document.children(element, "Connectors", "ParameterBindings")
        component = ComponentPart(path, {}, [], self.package.fmu(source, what))
        self._add(component)
        component.connectors = self._connectors(parts.get("Connectors"), component)
        bindings = parts.get("ParameterBindings")
        component.bindings = BindingReader(self.package, document, what, component.fmu).read(bindings)
        return component

    def _add(self, part: Part) -> None:
        if part.path in self.parts:
            raise self.document.fail(
                f"{self.parts[part.path].title} and {part.title} have the same full name; give each its own"
            )
        self.parts[part.path] = part

    def _connectors(self, parent: Element | None, part: Part) -> dict[str, Connector]:
        document, connectors = self.document, dict[str, Connector]()
        for element in document.listed(parent, "Connector"):
            name, kind = document.attribute(element, "name"), document.attribute(element, "kind")
            if kind not in CONNECTORS:
                hint = nearest(kind, CONNECTORS)
                raise document.fail(f'{part.title}: connector "{name}" has kind "{kind}"{hint}')
            if name in connectors:
                raise document.fail(f'{part.title} has two connectors "{name}"')
            stated = list(document.listed(element, *TYPES, "Dimension"))
            types = [typed for typed in stated if tag_of(typed) in TYPES]
            if len(types) > 1:
                names = " and ".join(map(tag_of, types))
                raise document.fail(f'{part.title}: connector "{name}" is {names}; expected one type')
            typed = types[0] if types else None
            tag = None if typed is None else tag_of(typed)
            enumeration = typed.get("name") if typed is not None and tag == "Enumeration" else None
            kind_of_value = "array" if len(stated) > len(types) else None if tag is None else TYPES[tag]
            unit = None if typed is None else typed.get("unit")
            connectors[name] = Connector(name, kind, kind_of_value, unit, enumeration)
        return connectors

    def _connect(self, system: SystemPart, element: Element) -> None:
        """Read a connection of a system, from whichever of its ends gives the value."""
        document = self.document
        ends = [self._end(system, element, side) for side in ("start", "end")]
        are_own = [port[0] == system.path for port in ends]
        kinds = [self._connector(port).kind for port in ends]
        first = 0 if kinds[0] in SOURCES[are_own[0]] else 1
        last = 1 - first
        if kinds[first] not in SOURCES[are_own[first]]:
            raise document.fail(
                f'a connection starts at {dotted(ends[0])}, whose kind is "{kinds[0]}"; '
                f'expected "{SOURCES[are_own[0]][0]}"'
            )
        if kinds[last] not in TARGETS[are_own[last]]:
            raise document.fail(
                f'a connection ends at {dotted(ends[last])}, whose kind is "{kinds[last]}"; '
                f'expected "{TARGETS[are_own[last]][0]}"'
            )
        source, target = ends[first], ends[last]
        if kinds[last] in CONSTANT and kinds[first] not in CONSTANT:
            raise document.fail(
                f"a connection ends at the parameter {dotted(target)}; bind its value instead"
            )
        what = f"connection {dotted(source)} -> {dotted(target)}"
        for name in ("startIndices", "endIndices"):
            if name in element.attrib:
                raise document.fail(f"{what} has {name}; elements of arrays are not supported")
        for port in ends:
            if self._connector(port).type in ("array", "String", "Binary", "Clock"):
                raise document.fail(
                    f"{what}: {dotted(port)} is of type {self._connector(port).type}; "
                    "expected Real, Integer, Boolean or Enumeration"
                )
        suppressed = document.boolean(element, "suppressUnitConversion", "false")
        hop = Hop(source, target, read_transformation(document, element, what), bool(suppressed))
        if target in self.feeds:
            other = dotted(self.feeds[target].source)
            raise document.fail(f"{dotted(target)} is fed twice: by {other} and {dotted(source)}")
        self.feeds[target] = hop
        self.hops.setdefault(source, []).append(hop)

    def _end(self, system: SystemPart, element: Element, side: str) -> Port:
        """One end of a connection."""
        owner, name = element.get(f"{side}Element"), self.document.attribute(element, f"{side}Connector")
        if owner and owner not in system.elements:
            hint = nearest(owner, system.elements)
            raise self.document.fail(f'a connection names component "{owner}", which does not exist{hint}')
        part = system.elements[owner] if owner else system
        if name not in part.connectors:
            hint = nearest(name, part.connectors)
            raise self.document.fail(f'a connection names connector "{name}", which {part.title} lacks{hint}')
        return part.path, name

    def _check_circles(self) -> None:
        """Refuse connectors of systems that lead to themselves, with no component between."""
        sound: set[Port] = set()
        for port in self.feeds:
            way: dict[Port, None] = {}
            at = port
            while at in self.feeds and at not in sound:
                if at in way:
                    names = " -> ".join(dotted(p) for p in reversed(list(way)))
                    raise self.document.fail(f"connections go round without a component: {names}")
                way[at] = None
                at = self.feeds[at].source
            sound |= way.keys()

    def _connector(self, port: Port) -> Connector:
        return self.parts[port[0]].connectors[port[1]]

    def type_of(self, port: Port) -> str | None:
        """Real, Integer, Boolean, Enumeration or another; None where nobody says."""
        path, name = port
        part = self.parts[path]
        declared = part.connectors[name].type if name in part.connectors else None
        if declared is not None or not isinstance(part, ComponentPart):
            return declared
        if part.description.items(name) is not None:
            return "Enumeration"
        quantity = part.description.quantities.get(name)
        return None if quantity is None else quantity.type.value

    def unit_of(self, port: Port) -> Unit | None:
        """The unit that the SSD declares, or else the FMU; None where nobody does."""
        path, name = port
        part = self.parts[path]
        connector = part.connectors.get(name)
        declared = None if connector is None else connector.unit
        if declared is not None and declared in self.units:
            return self.units[declared]
        if isinstance(part, ComponentPart) and (connector is None or connector.type in (None, "Real")):
            quantity = part.description.quantities.get(name)
            of_fmu = None if quantity is None else part.description.unit(quantity)
            if declared is None or (of_fmu is not None and of_fmu.name == declared):
                return of_fmu
        return None if declared is None else Unit(declared, None)

    def items_of(self, port: Port) -> Items | None:
        """The enumeration that the SSD declares, or else the FMU; None where nobody does."""
        path, name = port
        part = self.parts[path]
        connector = part.connectors.get(name)
        if connector is not None and connector.enumeration in self.enumerations:
            return self.enumerations[connector.enumeration]
        if isinstance(part, ComponentPart) and (connector is None or connector.type in (None, "Enumeration")):
            return part.description.items(name)
        return None
