"""The package of a system: valid SSP 1.0 that holds the wiring of the declaration."""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy.ssp
import pytest
from lxml import etree

from fmus.archive import pack, packed
from fmus.ssp import NAMESPACES, Component, Structure, describe, files_of, structure_of
from models.kit.block import Block
from models.system import SYSTEMS, System

Fmu = Callable[[type[Block]], Path]


@pytest.fixture(params=list(SYSTEMS))
def system(request: pytest.FixtureRequest) -> System:
    return SYSTEMS[request.param]


@pytest.fixture
def fmus(system: System, fmu: Fmu) -> dict[str, Path]:
    return {role: fmu(block) for role, block in system.components.items()}


def read(path: Path) -> ET.Element:
    with zipfile.ZipFile(path) as archive:
        return ET.fromstring(archive.read("SystemStructure.ssd"))


def test_the_structure_is_valid(system: System, fmus: dict[str, Path]) -> None:
    schema = etree.XMLSchema(
        etree.parse(str(Path(fmpy.ssp.__file__).parent / "schema" / "SystemStructureDescription.xsd"))
    )
    document = etree.fromstring(describe(structure_of(system, fmus)))
    schema.assertValid(document)
    assert document.get("version") == "1.0"


def test_the_package_holds_the_wiring(system: System, fmus: dict[str, Path], tmp_path: Path) -> None:
    # when a system is packed
    path = pack(tmp_path / "x.ssp", files_of(structure_of(system, fmus)))
    root = read(path)
    # then each role is a component whose FMU is in the package
    components = root.findall("ssd:System/ssd:Elements/ssd:Component", NAMESPACES)
    assert [c.get("name") for c in components] == list(system.components)
    with zipfile.ZipFile(path) as archive:
        for component in components:
            content = archive.read(component.get("source") or "")
            assert content == fmus[component.get("name") or ""].read_bytes()
    # then every connector has the declared type and unit
    for component in components:
        declared = system.components[component.get("name") or ""].variables()
        connectors = component.findall("ssd:Connectors/ssd:Connector", NAMESPACES)
        assert len(connectors) == sum(v.width for v in declared.values() if v.kind != "state")
        for connector in connectors:
            variable = declared[(connector.get("name") or "").split("[")[0]]
            assert connector.get("kind") == variable.kind
            assert connector[0].tag == f"{{{NAMESPACES['ssc']}}}{variable.type.value}"
            assert connector[0].get("unit", "") == variable.unit
    # then every scalar of every link is connected once
    links = [
        tuple(c.get(key) for key in ("startElement", "startConnector", "endElement", "endConnector"))
        for c in root.findall("ssd:System/ssd:Connections/ssd:Connection", NAMESPACES)
    ]
    assert len(set(links)) == len(links)
    for link in system.links:
        assert (link.source, link.source_variable, link.target, link.target_variable) in links
    # then a trial lasts 300 s
    experiment = root.find("ssd:DefaultExperiment", NAMESPACES)
    assert experiment is not None
    assert float(experiment.get("stopTime") or 0) == 300.0


def test_the_same_system_gives_the_same_bytes(system: System, fmus: dict[str, Path]) -> None:
    one, two = (packed(files_of(structure_of(system, fmus))) for _ in range(2))
    assert one == two


def test_two_fmus_of_one_name_are_both_in_the_package(tmp_path: Path) -> None:
    # given FMUs of the same name in two folders, one of them in two places
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "x.fmu").write_text(folder)
    places = {"one": "a", "two": "b", "three": "a"}
    components = {name: Component(tmp_path / folder / "x.fmu", ()) for name, folder in places.items()}
    # when, then
    files = files_of(Structure("s", components, (), {}))
    assert {name: files[name] for name in sorted(files)[1:]} == {
        "resources/two-x.fmu": b"b",
        "resources/x.fmu": b"a",
    }
    sources = [e.get("source") for e in ET.fromstring(files["SystemStructure.ssd"]).iter() if e.get("source")]
    assert sources == ["resources/x.fmu", "resources/two-x.fmu", "resources/x.fmu"]
