"""An XML file of a package: its elements and attributes, with errors that name the file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from harness.cosim.archive import plain
from models.errors import CanineError, printable

SSP = "{http://ssp-standard.org/SSP1/SystemStructure"  # SSP 2.0 kept the names of 1.0
SSD, SSV, SSM = f"{SSP}Description}}", f"{SSP}ParameterValues}}", f"{SSP}ParameterMapping}}"
VERSIONS = ("1.0", "2.0")
BOOLEANS = {"true": 1, "1": 1, "false": 0, "0": 0}
IGNORED = {  # decoration, and what says nothing about how a system runs
    "Annotations", "ConnectionGeometry", "ConnectorGeometry", "ElementGeometry", "GraphicalElements",
    "MetaData", "Signature", "SystemGeometry",
}  # fmt: skip


class SspError(CanineError):
    """A package is not SSP 1.0 or 2.0, contradicts itself, or uses a feature that is not supported."""


@dataclass(frozen=True)
class Document:
    """One file; `name` is how errors call it."""

    name: str
    root: Element

    def fail(self, text: str) -> SspError:
        """The error that says this of the file."""
        return SspError(f"{self.name}: {printable(text)}")

    def check_element(self, element: Element, tag: str, what: str) -> None:
        """Refuse another element than `tag` of SSP 1.0 or 2.0.

        Raises:
            SspError: it is another.
        """
        if element.tag != tag:
            expected = tag.rpartition("}")[2]
            raise self.fail(f"{what} is {element.tag}; expected an SSP 1.0 or 2.0 {expected}")
        if (version := element.get("version")) not in VERSIONS:
            raise self.fail(f'{what} is of SSP version "{version}"; expected "1.0" or "2.0"')

    def attribute(self, element: Element, name: str) -> str:
        """A required attribute."""
        value = element.get(name)
        if value is None:
            raise self.fail(f'a {tag_of(element)} lacks its attribute "{name}"')
        return value

    def number(self, element: Element, name: str, default: str | None = None) -> float:
        """An attribute that is a finite number."""
        text = self.attribute(element, name) if default is None else element.get(name, default)
        try:
            value = float(plain(text))
        except ValueError:
            raise self.fail(f'{titled(element)} has {name}="{text}"; expected a number') from None
        if not math.isfinite(value):
            raise self.fail(f'{titled(element)} has {name}="{text}"; expected a finite number')
        return value

    def whole(self, element: Element, name: str) -> int:
        """An attribute that is a whole number of 64 bits."""
        text = self.attribute(element, name)
        try:
            value = int(plain(text))
        except ValueError:
            value = 2**63
        if not -(2**63) <= value < 2**63:
            raise self.fail(f'{titled(element)} has {name}="{text}"; expected a whole number')
        return value

    def boolean(self, element: Element, name: str, default: str | None = None) -> int:
        """An attribute that is true (1) or false (0)."""
        text = self.attribute(element, name) if default is None else element.get(name, default)
        if text not in BOOLEANS:
            raise self.fail(f'{titled(element)} has {name}="{text}"; expected true or false')
        return BOOLEANS[text]

    def children(self, element: Element, *known: str) -> dict[str, Element]:
        """The children by tag; decoration is left out, any other is refused, and so are two of a kind."""
        elements: dict[str, Element] = {}
        for child in self.listed(element, *known):
            tag = tag_of(child)
            if tag in elements:
                raise self.fail(f"{titled(element)} holds two {tag}; expected one")
            elements[tag] = child
        return elements

    def listed(self, element: Element | None, *known: str) -> Iterator[Element]:
        """The children of these tags; decoration is left out, any other is refused."""
        for child in element if element is not None else ():
            tag = tag_of(child)
            if tag in known:
                yield child
            elif tag not in IGNORED:
                raise self.fail(f"{titled(element)} holds a {titled(child)}, which is not supported")


def tag_of(element: Element) -> str:
    """An element's name without its namespace."""
    return element.tag.rpartition("}")[2]


def titled(element: Element | None) -> str:
    """An element in messages: its tag and, where it has one, its name."""
    if element is None:
        return ""
    name = element.get("name")
    return tag_of(element) if name is None else f'{tag_of(element)} "{name}"'
