"""Every element and attribute of a package counts: changed, the system changes, or it is refused."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import pytest

from harness.cosim.ssp import FmuSystem, open_ssp
from models.errors import CanineError
from tests.harness.cosim.ssp.packages import (
    bind,
    binding,
    component,
    connection,
    entry,
    enumerations,
    fmu,
    linear,
    mapping,
    parameters,
    ssd,
    system,
    table,
    units,
)
from tests.harness.cosim.tiny_fmu import V

VALUES = ("", "x", "-3", "1e999", "nan", "a.b", "../..", "true", "9" * 400)
# what is for people, or states the default anew, or what the FMU says too
UNITS = "SystemStructureDescription/Units/Unit"
OWN = "System/Connectors/Connector"  # of a system's connector the type is only compared
SAME = {
    "SystemStructureDescription@version",
    "SystemStructureDescription/System@name",
    "ParameterSet@version",
    "ParameterSet@name",
    "ParameterMapping@version",
    "Elements/Component@type",
    "Elements/Component@implementation",
    "Connections/Connection@suppressUnitConversion",
    "ParameterMapping/MappingEntry@suppressUnitConversion",
    f"{UNITS}@name",
    f"{UNITS}-0",
    f"{OWN}/Real-0",
    f"{OWN}/Integer-0",
    "ParameterBindings/ParameterBinding-2",
}


def tag(element: Element) -> str:
    return element.tag.rpartition("}")[2]


@pytest.fixture(scope="module")
def rich(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package in a folder, with all that is read."""
    folder = tmp_path_factory.mktemp("rich")
    side = enumerations(E={"LEFT": 1, "RIGHT": 2}, F={"L": 3, "R": 4})
    inner = system(
        "inner",
        component("b", "u input Real m", "e input Enumeration F", "n input Integer", "k parameter Real"),
        ports="u input Real km, e input Enumeration F, n input Integer, k parameter Real",
        links=connection("u", "b.u", linear(2, 1)) + connection("n", "b.n", table("Integer", _1=5))
        + connection("e", "b.e") + connection("k", "b.k", linear(3, 1)),
    )  # fmt: skip
    turned = table("Enumeration", LEFT="R", RIGHT="L")
    beside = '<ssd:ParameterMapping source="map.ssm"/>'
    root = system(
        "root",
        component("a", "y output Real m", "e output Enumeration E", "n output Integer", "k parameter Real m",
                  more='type="application/x-fmu-sharedlibrary" implementation="CoSimulation"',
                  bindings=bind(binding(source="set.ssv", mapped=beside))),
        inner,
        links=connection("a.y", "inner.u", "", 'suppressUnitConversion="false"')
        + connection("a.e", "inner.e", turned) + connection("a.n", "inner.n", table("Integer", _2=1)),
        bindings=bind(binding(parameters(k="Real 2"), more='prefix="inner."')),
    )  # fmt: skip
    structure = ssd(root, side, units("m", "km"), '<ssd:DefaultExperiment startTime="1" stopTime="2"/>')
    files = {
        "SystemStructure.ssd": structure,
        "set.ssv": parameters(units("km", prefix="ssv"), long="Real 1.5 km", other="Integer 3"),
        "map.ssm": mapping(
            entry("long", "k", linear(4, 1), 'suppressUnitConversion="false"'),
            entry("other", "m", table("Integer", _3=8)),
        ),
    }
    for name, text in files.items():
        (folder / name).write_text(text)
    for name, variables in {
        "a": [V("k", "parameter", unit="m"), V("m", "parameter", "Integer"), V("y", unit="m"),
              V("e", type="Integer"), V("n", type="Integer")],
        "b": [V("u", "input", unit="m"), V("e", "input", "Integer"), V("n", "input", "Integer"),
              V("k", "parameter")],
    }.items():  # fmt: skip
        unpacked = folder / "resources" / f"{name}.fmu"
        unpacked.mkdir(parents=True)
        (unpacked / "modelDescription.xml").write_bytes(fmu(*variables))
    return folder


def outcome(folder: Path) -> FmuSystem | str:
    try:
        with open_ssp(folder) as system:
            return system
    except CanineError as error:
        return str(error)


def variants(root: Element) -> Iterator[tuple[str, Element]]:
    """The document with one attribute left out or another, or one element left out or twice; what changed."""
    above = {child: parent for parent in root.iter() for child in parent}

    def path(element: Element) -> str:
        return f"{path(above[element])}/{tag(element)}" if element in above else tag(element)

    for index, element in enumerate(root.iter()):
        for name, stated in element.attrib.items():
            for value in (None, *VALUES):
                if value != stated:
                    changed = deepcopy(root)
                    attributes = list(changed.iter())[index].attrib
                    del attributes[name]
                    if value is not None:
                        attributes[name] = value
                    yield f"{path(element)}@{name}", changed
        for at, child in enumerate(element):
            for times in (0, 2):
                changed = deepcopy(root)
                parent = list(changed.iter())[index]
                del parent[at]
                for _ in range(times):
                    parent.insert(at, deepcopy(child))
                yield f"{path(child)}-{times}", changed


@pytest.mark.parametrize("name", ["SystemStructure.ssd", "set.ssv", "map.ssm"])
def test_nothing_in_a_package_is_ignored_quietly(rich: Path, name: str) -> None:
    path = rich / name
    text = path.read_text()
    whole = outcome(rich)
    assert isinstance(whole, FmuSystem)
    assert len(whole.links) == 3
    try:
        for what, changed in variants(ElementTree.fromstring(text)):
            path.write_bytes(ElementTree.tostring(changed))
            assert outcome(rich) != whole or what.endswith(tuple(SAME)), ElementTree.tostring(changed)
    finally:
        path.write_text(text)
