"""The units and enumerations that a file of a package defines; they hold in that file alone."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from harness.cosim.fmu import BASE, Unit
from harness.cosim.ssp.document import Document
from harness.cosim.ssp.transformation import Items


def read_units(document: Document, units: Element | None) -> dict[str, Unit]:
    """The units by name.

    Raises:
        SspError: one is defined twice, or badly.
    """
    known: dict[str, Unit] = {}
    for element in document.listed(units, "Unit"):
        name = document.attribute(element, "name")
        if name in known:
            raise document.fail(f'unit "{name}" is defined twice')
        base = document.children(element, "BaseUnit").get("BaseUnit")
        if base is None:
            raise document.fail(f'unit "{name}" has no BaseUnit')
        factor, offset = document.number(base, "factor", "1"), document.number(base, "offset", "0")
        if factor == 0:
            raise document.fail(f'unit "{name}" has the factor 0')
        exponents = tuple(document.whole(base, name) if name in base.attrib else 0 for name in BASE)
        known[name] = Unit(name, exponents, factor, offset)
    return known


def read_enumerations(document: Document, enumerations: Element | None) -> dict[str, Items]:
    """The enumerations by name.

    Raises:
        SspError: one, or an item of one, is defined twice, or badly.
    """
    known: dict[str, Items] = {}
    for element in document.listed(enumerations, "Enumeration"):
        name = document.attribute(element, "name")
        if name in known:
            raise document.fail(f'enumeration "{name}" is defined twice')
        items: dict[str, int] = {}
        for item in document.listed(element, "Item"):
            if (label := document.attribute(item, "name")) in items:
                raise document.fail(f'enumeration "{name}" has two items "{label}"')
            items[label] = document.whole(item, "value")
        known[name] = items
    return known
