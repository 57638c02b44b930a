"""What becomes of a value on its way: conversions of units, linear transformations, tables.

Factors and offsets are exact: on a way through many boundaries the whole is rounded once, at its end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from xml.etree.ElementTree import Element

from harness.cosim.fmu import Unit
from harness.cosim.ssp.document import Document
from models.errors import nearest

LINEAR, BOOLEAN, INTEGER, ENUMERATION = KINDS = (
    "LinearTransformation",
    "BooleanMappingTransformation",
    "IntegerMappingTransformation",
    "EnumerationMappingTransformation",
)
FOR_TYPES = {
    LINEAR: ("Real",),
    BOOLEAN: ("Boolean",),
    INTEGER: ("Integer", "Enumeration"),
    ENUMERATION: ("Enumeration",),
}
Items = Mapping[str, int]  # of an enumeration: its names and their numbers


@dataclass(frozen=True)
class Transformation:
    """target = factor * source + offset; or what a table has for the source's whole number, else that."""

    factor: Fraction = Fraction(1)
    offset: Fraction = Fraction(0)
    table: Mapping[int, int] = field(default_factory=dict)

    @property
    def is_linear(self) -> bool:
        """Does it scale or shift?"""
        return self.factor != 1 or self.offset != 0

    def then(self, after: Transformation) -> Transformation:
        """This one, and another one after it."""
        table = {
            number: after.table.get(replaced := self.table.get(number, number), replaced)
            for number in {**self.table, **after.table}
        }
        return Transformation(
            self.factor * after.factor, after.factor * self.offset + after.offset, without_identity(table)
        )

    def __call__(self, value: float) -> float:
        """A value's target; infinite where no float is as large."""
        if self.table:
            return float(self.table.get(int(value), int(value)))
        try:
            return float(self.factor * exact(value) + self.offset)
        except OverflowError:
            return math.inf


def without_identity(table: Mapping[int, int]) -> dict[int, int]:
    """A table without the numbers that stay."""
    return {number: replaced for number, replaced in table.items() if number != replaced}


def exact(number: float) -> Fraction:
    """A number as it is written in decimals."""
    return Fraction(repr(number))


def are_convertible(source: Unit, target: Unit) -> bool:
    """Are both defined, and does a factor make one of the other?"""
    numbers = (source.factor, source.offset, target.factor, target.offset)
    defined = source.base is not None and target.base is not None and all(map(math.isfinite, numbers))
    return defined and source.measures(target) and 0.0 not in (source.factor, target.factor)


def between(source: Unit, target: Unit) -> Transformation:
    """What makes a value in one unit one in another, if they are convertible."""
    factor = exact(source.factor) / exact(target.factor)
    return Transformation(factor, (exact(source.offset) - exact(target.offset)) / exact(target.factor))


@dataclass(frozen=True)
class Stated:
    """A transformation as an element states it; `kind` is "" where it states none.

    Attributes:
        entries: of an EnumerationMappingTransformation, from item to item.
    """

    document: Document
    what: str
    kind: str = ""
    own: Transformation = field(default_factory=Transformation)
    entries: Mapping[str, str] = field(default_factory=dict)

    def check_type(self, name: str, kind: str | None) -> None:
        """Refuse a transformation of a variable whose type it is not for.

        Raises:
            SspError: it is not.
        """
        if self.kind and kind is not None and kind not in FOR_TYPES[self.kind]:
            types = " or ".join(FOR_TYPES[self.kind])
            raise self.document.fail(f"{self.what}: its {self.kind} is for {types}, {name} is {kind}")

    def between(self, source: Items | None, target: Items | None) -> Transformation:
        """The transformation of numbers, given the enumerations at both ends.

        Raises:
            SspError: an item is unknown at its end.
        """
        if self.kind != ENUMERATION:
            return self.own
        if source is None or target is None:
            end = "start" if source is None else "end"
            raise self.document.fail(
                f"{self.what}: the enumeration at its {end} is unknown; declare it there"
            )
        for ends, items in ((self.entries.keys(), source), (self.entries.values(), target)):
            for item in ends:
                self.check_item(item, items)
        table = {}
        for item, number in source.items():
            replaced = self.entries.get(item, item)
            self.check_item(replaced, target)
            table[number] = target[replaced]
        return Transformation(table=without_identity(table))

    def check_item(self, item: str, items: Items) -> None:
        """Refuse an item that an enumeration lacks.

        Raises:
            SspError: it does.
        """
        if item not in items:
            raise self.document.fail(
                f'{self.what}: the enumeration has no item "{item}"{nearest(item, items)}'
            )


def read_transformation(document: Document, element: Element, what: str) -> Stated:
    """The transformation that a connection or an entry of a mapping states.

    Raises:
        SspError: more than one, or one that cannot be carried out.
    """
    elements = document.children(element, *KINDS)
    if len(elements) > 1:
        raise document.fail(f"{what} holds {' and '.join(elements)}; expected one transformation")
    if not elements:
        return Stated(document, what)
    ((kind, stated),) = elements.items()
    if kind == LINEAR:
        document.children(stated)
        factor, offset = document.number(stated, "factor", "1"), document.number(stated, "offset", "0")
        if factor == 0:
            raise document.fail(f"{what}: a LinearTransformation with factor 0 passes nothing on")
        return Stated(document, what, kind, Transformation(exact(factor), exact(offset)))
    entries: dict[str, str] = {}
    table: dict[int, int] = {}
    for entry in document.listed(stated, "MapEntry"):
        source, target = document.attribute(entry, "source"), document.attribute(entry, "target")
        if kind != ENUMERATION:
            read = document.boolean if kind == BOOLEAN else document.whole
            number = read(entry, "source")
            source = str(number)
            table[number] = read(entry, "target")
        if source in entries:
            raise document.fail(f'{what}: two entries map "{source}"; expected one')
        entries[source] = target
    if not entries:
        raise document.fail(f"{what}: its {kind} without a MapEntry maps nothing")
    return Stated(document, what, kind, Transformation(table=without_identity(table)), entries)
