"""A tree flattened to components, links and start values.

A link is a way from a component's output to another's input, through the connectors of any systems between.
What its connections do to a value is put together exactly, and rounded once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from harness.cosim.fmu import Unit
from harness.cosim.ssp.parameters import Assignment
from harness.cosim.ssp.parts import ComponentPart, Hop, Part, Port, SystemPart, dotted
from harness.cosim.ssp.system import FmuComponent, FmuSystem, ScaledLink, StartValue
from harness.cosim.ssp.transformation import Items, Transformation, are_convertible, between
from harness.cosim.ssp.tree import Tree

SHOWN = 5  # names in a note


@dataclass(frozen=True)
class Carried:
    """What has become of a value so far on its way, and the unit and enumeration that it is in now."""

    unit: Unit | None
    items: Items | None
    done: Transformation = field(default_factory=Transformation)


class Flattened:
    """The links, values and notes that a tree comes to."""

    def __init__(self, tree: Tree) -> None:
        self.tree, self.document = tree, tree.document
        self.notes: list[str] = []

    def system(self) -> FmuSystem:
        """The components and links of the whole tree.

        Raises:
            SspError, ArchiveError, XmlError: units, types or values do not fit.
        """
        tree, links = self.tree, tuple(self._links())
        values: dict[str, dict[str, StartValue]] = {}
        self._bind(tree.root, values)
        components = {
            path: FmuComponent(path, part.fmu, part.connectors, values.get(path, {}))
            for path, part in tree.parts.items()
            if isinstance(part, ComponentPart)
        }
        name = self.document.attribute(self.document.root, "name")
        notes = tuple(dict.fromkeys(self.notes))
        return FmuSystem(name, components, links, tree.start, tree.stop, tree.package.files, notes)

    def _links(self) -> Iterator[ScaledLink]:
        """The ways from each component's output to the inputs of others."""
        tree = self.tree
        for source in [port for port in tree.hops if isinstance(tree.parts[port[0]], ComponentPart)]:
            start = Carried(tree.unit_of(source), tree.items_of(source))
            for target, carried in self._follow(source, start):
                way = f"connection {dotted(source)} -> {dotted(target)}"
                done = carried.done
                if done.table and done.is_linear:
                    raise self.document.fail(f"{way} is both scaled and replaced by a table; expected one")
                try:
                    factor, offset = float(done.factor), float(done.offset)
                except OverflowError:
                    factor = 0.0
                if factor == 0.0:
                    raise self.document.fail(f"{way}: its factor leaves the range of a double")
                table = tuple(done.table.items())
                yield ScaledLink(*source, *target, factor, offset, table, settled=True)

    def _follow(self, start: Port, carried: Carried) -> Iterator[tuple[Port, Carried]]:
        """All component connectors that a connector leads to."""
        left = [(start, carried)]
        while left:
            port, carried = left.pop()
            if port != start and isinstance(self.tree.parts[port[0]], ComponentPart):
                yield port, carried
                continue
            hops = reversed(self.tree.hops.get(port, ()))
            left += [(hop.target, self._across(hop, carried)) for hop in hops]

    def _across(self, hop: Hop, carried: Carried) -> Carried:
        """What a value becomes on a connection: converted to its end's unit, then transformed."""
        for port in (hop.source, hop.target):
            if hop.stated.kind:
                hop.stated.check_type(dotted(port), self.tree.type_of(port))
        unit, items = self.tree.unit_of(hop.target), self.tree.items_of(hop.target)
        done = carried.done.then(self._conversion(hop, carried.unit, unit))
        done = done.then(hop.stated.between(carried.items, items))
        return Carried(unit or carried.unit, items or carried.items, done)

    def _conversion(self, hop: Hop, source: Unit | None, target: Unit | None) -> Transformation:
        """What makes a value in the source's unit one in the target's."""
        if source is None or target is None or source.equals(target):
            return Transformation()
        what = hop.stated.what
        if hop.suppressed:
            if hop.stated.kind == "":
                self.notes.append(
                    f'{what}: "{source.name}" is taken as "{target.name}" as it is (suppressUnitConversion)'
                )
            return Transformation()
        if not are_convertible(source, target):
            undefined = [f'"{unit.name}"' for unit in (source, target) if unit.base is None]
            why = f"nobody defines {undefined[0]}" if undefined else "no factor makes one of the other"
            raise self.document.fail(
                f'{what}: unit "{source.name}" cannot become "{target.name}": {why}; '
                'connect equal units, or state suppressUnitConversion="true"'
            )
        conversion = between(source, target)
        besides = ", in addition to its LinearTransformation" if hop.stated.kind else ""
        self.notes.append(
            f'{what}: "{source.name}" is converted to "{target.name}", times {float(conversion.factor):.6g}'
            f"{f' plus {float(conversion.offset):.6g}' if conversion.offset else ''}{besides}"
        )
        return conversion

    def _bind(self, part: Part, values: dict[str, dict[str, StartValue]]) -> None:
        """Apply the bindings of a part and of all that is in it: later over earlier, outer over inner."""
        if isinstance(part, SystemPart):
            for inner in part.elements.values():
                self._bind(inner, values)
        for binding in part.bindings:
            unknown = list(binding.lacking)
            for assignment in binding.assignments:
                targets = list(self._targets(part, assignment.name, assignment))
                for (component, variable), value in targets:
                    values.setdefault(component, {})[variable] = value
                if not targets:
                    unknown.append(assignment.name)
            if unknown:
                more = ", ..." if len(unknown) > SHOWN else ""
                self.notes.append(
                    f"{binding.what}: {len(unknown)} names belong to nothing and are not set: "
                    f"{', '.join(unknown[:SHOWN])}{more}"
                )

    def _targets(self, part: Part, name: str, assignment: Assignment) -> Iterator[tuple[Port, StartValue]]:
        """The variables that a name means in a part, each with the value for it."""
        if isinstance(part, ComponentPart):
            if part.knows(name):
                number, unit = self._number(assignment, (part.path, name))
                yield (part.path, name), self._start(assignment, number, unit)
            return
        assert isinstance(part, SystemPart)
        if name in part.connectors:
            port = part.path, name
            if self.tree.hops.get(port):
                number, unit = self._number(assignment, port)
                own = self.tree.unit_of(port)
                if unit is not None and own is not None and not unit.equals(own):
                    raise assignment.value.document.fail(
                        f'parameter "{assignment.value.name}" is given in "{unit.name}", connector '
                        f'{dotted(port)} is in "{own.name}"; give it in that unit, or map it'
                    )
                for target, carried in self._follow(port, Carried(unit or own, self.tree.items_of(port))):
                    yield target, self._start(assignment, carried.done(number), carried.unit)
        at = name.find(".")
        while at >= 0:
            if (inner := part.elements.get(name[:at])) is not None:
                yield from self._targets(inner, name[at + 1 :], assignment)
            at = name.find(".", at + 1)

    def _start(self, assignment: Assignment, number: float, unit: Unit | None) -> StartValue:
        if not math.isfinite(number):
            value = assignment.value
            raise value.document.fail(f'parameter "{value.name}" leaves the range of a double on its way')
        return StartValue(number, None if unit is None else unit.name)

    def _number(self, assignment: Assignment, port: Port) -> tuple[float, Unit | None]:
        unit = self.tree.unit_of(port) if assignment.value.unit is not None else None
        items = self.tree.items_of(port) if assignment.value.type == "Enumeration" else None
        return assignment.number(unit, items)
