"""Parameter bindings: sets of values (SSV), and the mappings (SSM) that rename and transform them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from harness.cosim.fmu import Unit
from harness.cosim.ssp.document import IGNORED, SSM, SSV, Document, tag_of
from harness.cosim.ssp.package import Package
from harness.cosim.ssp.transformation import (
    ENUMERATION,
    INTEGER,
    Items,
    Stated,
    Transformation,
    are_convertible,
    between,
    read_transformation,
)
from harness.cosim.ssp.units import read_enumerations, read_units
from models.errors import nearest

SET_TYPE, MAPPING_TYPE = "application/x-ssp-parameter-set", "application/x-ssp-parameter-mapping"
NUMBER = re.compile("-?[0-9]{1,15}")  # of an enumeration's item
WHOLE = [f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)]
TYPES = {  # of SSP 1.0, and those that SSP 2.0 added
    **dict.fromkeys(("Real", "Float64", "Float32"), "Real"),
    **dict.fromkeys(("Integer", *WHOLE), "Integer"),
    **{name: name for name in ("Boolean", "Enumeration", "String", "Binary", "Clock")},
}


@dataclass(frozen=True)
class Value:
    """A parameter's value as a set states it.

    Attributes:
        number: of a Real, Integer or Boolean.
        text: as it is written; an Enumeration's item.
        items: of its enumeration, where the set defines it.
    """

    document: Document
    name: str
    type: str
    text: str
    number: float = 0.0
    unit: Unit | None = None
    items: Items | None = None

    def in_items(self, item: str, items: Items | None) -> float:
        """The number of an Enumeration's item, given the enumeration that it is set in.

        Raises:
            SspError: it has no such item, or nobody says what its items are.
        """
        items = self.items if items is None else items
        if items is not None and item in items:
            return float(items[item])
        if NUMBER.fullmatch(item) and (items is None or int(item) in items.values()):
            return float(item)  # some tools write the number
        if items is None:
            raise self.document.fail(
                f'parameter "{self.name}" is "{item}" of an enumeration that nobody defines; '
                "name the enumeration and define it in Enumerations"
            )
        raise self.document.fail(
            f'parameter "{self.name}" is "{item}", which its enumeration lacks{nearest(item, items)}'
        )


@dataclass(frozen=True)
class Assignment:
    """What a binding gives to a name, as its element's parameters and those inside it are called.

    Attributes:
        mapping: what its entry of a mapping makes of the value; None without a mapping.
        converts: the entry lets units be converted.
    """

    name: str
    value: Value
    mapping: Stated | None = None
    converts: bool = False

    def number(self, target: Unit | None, items: Items | None) -> tuple[float, Unit | None]:
        """The number to set, and its unit, given unit and enumeration of what it is set to.

        Raises:
            SspError: it is none, or cannot be transformed.
        """
        value, mapping, unit = self.value, self.mapping, self.value.unit
        if value.type not in ("Real", "Integer", "Boolean", "Enumeration"):
            raise value.document.fail(
                f'parameter "{value.name}" holds a {value.type}; '
                "expected Real, Integer, Boolean or Enumeration"
            )
        number = value.number
        if value.type == "Enumeration":
            item = value.text
            if mapping is not None and mapping.kind == ENUMERATION:
                item = mapping.entries.get(item, item)
            number = value.in_items(item, value.items if mapping and mapping.kind == INTEGER else items)
        if unit is not None and target is not None and unit.equals(target):
            unit = target
        if mapping is None:
            return number, unit
        mapping.check_type(f'parameter "{value.name}"', value.type)
        conversion = Transformation()
        if self.converts and unit is not None and target is not None and unit is not target:
            if not are_convertible(unit, target):
                raise value.document.fail(
                    f'{mapping.what}: unit "{unit.name}" cannot become "{target.name}"; '
                    'define both, or state suppressUnitConversion="true"'
                )
            conversion, unit = between(unit, target), target
        elif not self.converts:
            unit = target
        return conversion.then(mapping.own)(number), unit


@dataclass(frozen=True)
class Binding:
    """One ParameterBinding.

    Attributes:
        what: how messages call it.
        assignments: what it gives.
        lacking: parameters that its mapping names and its set lacks.
    """

    what: str
    assignments: tuple[Assignment, ...]
    lacking: tuple[str, ...] = ()


@dataclass(frozen=True)
class BindingReader:
    """Reads the bindings of an element.

    Attributes:
        document: the SSD.
        what: the element, for messages.
        fmu: of a component, in which a source may lie.
    """

    package: Package
    document: Document
    what: str
    fmu: Path | None = None

    def read(self, parent: Element | None) -> list[Binding]:
        """The bindings in their order; later ones win.

        Raises:
            SspError, ArchiveError, XmlError: a file cannot be read, or holds what is not supported.
        """
        return [self._binding(b) for b in self.document.listed(parent, "ParameterBinding")]

    def _binding(self, binding: Element) -> Binding:
        parts = self.document.children(binding, "ParameterValues", "ParameterMapping")
        what = f"{self.what}: parameter binding"
        document, element = self._content(binding, parts.get("ParameterValues"), SET_TYPE, what)
        document.check_element(element, f"{SSV}ParameterSet", f"{what}: its content")
        prefix = binding.get("prefix", "")
        values = {prefix + value.name: value for value in ParameterSet(document, element, what).values()}
        if (mapping := parts.get("ParameterMapping")) is None:
            return Binding(what, tuple(Assignment(name, value) for name, value in values.items()))
        what = f"{self.what}: parameter mapping"
        document, element = self._content(mapping, mapping, MAPPING_TYPE, what)
        document.check_element(element, f"{SSM}ParameterMapping", f"{what}: its content")
        entries = list(_map(document, element, values))
        lacking = tuple(entry for entry in entries if isinstance(entry, str))
        return Binding(what, tuple(entry for entry in entries if not isinstance(entry, str)), lacking)

    def _content(
        self, stating: Element, inline: Element | None, type: str, what: str
    ) -> tuple[Document, Element]:
        """The set or mapping that an element names as its source, or holds; and the file that it is in."""
        document = self.document
        if (stated := stating.get("type", type)) not in ("", type):
            raise document.fail(f'{what} has type "{stated}"; expected "{type}"')
        base = stating.get("sourceBase", "SSD")
        if base not in ("SSD", "component"):
            raise document.fail(f'{what} has sourceBase "{base}"; expected SSD or component')
        source, held = stating.get("source"), [e for e in inline or () if tag_of(e) not in IGNORED]
        if source is None:
            if len(held) != 1:
                raise document.fail(
                    f"{what} has no source and holds {len(held)} sets or mappings; expected one"
                )
            return document, held[0]
        if held:
            raise document.fail(f'{what} has source "{source}" and content of its own; expected one of both')
        if base == "SSD":
            read = self.package.document(source, what)
        elif self.fmu is None:
            raise document.fail(
                f'{what} has sourceBase "component"; expected SSD, for it belongs to a system'
            )
        else:
            read = self.package.document_in(self.fmu, source, what)
        return read, read.root


class ParameterSet:
    """A set of values, with the units and enumerations that it defines.

    Raises:
        SspError: it holds what is not supported.
    """

    def __init__(self, document: Document, element: Element, what: str) -> None:
        parts = document.children(element, "Parameters", "Enumerations", "Units")
        self._document, self._what, self._parameters = document, what, parts.get("Parameters")
        self._units = read_units(document, parts.get("Units"))
        self._enumerations = read_enumerations(document, parts.get("Enumerations"))

    def values(self) -> list[Value]:
        """Its values.

        Raises:
            SspError: one is there twice, or is none.
        """
        values: dict[str, Value] = {}
        for parameter in self._document.listed(self._parameters, "Parameter"):
            value = self._value(parameter)
            if value.name in values:
                raise self._document.fail(f'{self._what}: parameter "{value.name}" is there twice')
            values[value.name] = value
        return list(values.values())

    def _value(self, parameter: Element) -> Value:
        document = self._document
        name = document.attribute(parameter, "name")
        typed = document.children(parameter, *TYPES, "Dimension")
        if "Dimension" in typed:
            raise document.fail(f'{self._what}: parameter "{name}" is an array, which is not supported')
        if len(typed) != 1:
            kinds = " and ".join(typed) or "nothing"
            raise document.fail(f'{self._what}: parameter "{name}" holds {kinds}; expected one typed value')
        ((tag, stated),) = typed.items()
        type, number, unit = TYPES[tag], 0.0, stated.get("unit")
        if type == "Real":
            number = document.number(stated, "value")
        elif type == "Integer":
            whole = document.whole(stated, "value")
            number = float(whole)
            if int(number) != whole:
                raise document.fail(f'{self._what}: parameter "{name}" is {whole}, which no double holds')
        elif type == "Boolean":
            number = float(document.boolean(stated, "value"))
        known = None if unit is None else self._units.get(unit, Unit(unit, None))
        items = self._enumerations.get(stated.get("name", ""))
        return Value(document, name, type, stated.get("value", ""), number, known, items)


def _map(document: Document, mapping: Element, values: Mapping[str, Value]) -> Iterator[Assignment | str]:
    """What a mapping makes of values, and names that they lack; values that it does not name are not set."""
    targets: set[str] = set()
    for entry in document.listed(mapping, "MappingEntry"):
        source, target = document.attribute(entry, "source"), document.attribute(entry, "target")
        what = f'mapping of "{source}" to "{target}"'
        if target in targets:
            raise document.fail(f"{what}: another entry maps to it; expected one")
        targets.add(target)
        stated = read_transformation(document, entry, what)
        suppressed = document.boolean(entry, "suppressUnitConversion", "false")
        if source in values:
            yield Assignment(target, values[source], stated, converts=not suppressed)
        else:
            yield source
