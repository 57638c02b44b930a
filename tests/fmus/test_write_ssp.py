"""The package of a system: valid SSP 1.0 that holds the wiring of the declaration."""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy.ssp
import pytest
from lxml import etree

from fmus.ssp import NAMESPACES, structure, write_ssp
from models.errors import ParameterError
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
    document = etree.fromstring(
        structure(system, fmus, {"plant.start_north": 1.0, "controller.waypoint_count": 2})
    )
    schema.assertValid(document)
    assert document.get("version") == "1.0"


def test_the_package_holds_the_wiring(system: System, fmus: dict[str, Path], tmp_path: Path) -> None:
    # when a system is packed
    path = write_ssp(system, fmus, tmp_path / "x.ssp")
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


def test_the_same_system_gives_the_same_bytes(system: System, fmus: dict[str, Path], tmp_path: Path) -> None:
    one, two = (write_ssp(system, fmus, tmp_path / name) for name in ("one.ssp", "two.ssp"))
    assert one.read_bytes() == two.read_bytes()


def test_parameters_are_bound_inside(system: System, fmus: dict[str, Path], tmp_path: Path) -> None:
    path = write_ssp(system, fmus, tmp_path / "x.ssp", {"controller.waypoint_north[2]": 1.5, "plant.seed": 3})
    values = {
        (c.get("name"), p.get("name")): (p[0].tag.split("}")[1], p[0].get("value"), p[0].get("unit"))
        for c in read(path).iterfind("ssd:System/ssd:Elements/ssd:Component", NAMESPACES)
        for p in c.iterfind(".//ssv:Parameter", NAMESPACES)
    }
    assert values == {
        ("controller", "waypoint_north[2]"): ("Real", "1.5", "m"),
        ("plant", "seed"): ("Integer", "3", None),
    }


def test_wrong_parameters_are_refused(system: System, fmus: dict[str, Path], tmp_path: Path) -> None:
    path = tmp_path / "x.ssp"
    with pytest.raises(ParameterError, match=r'has no parameter "plant.sead"; did you mean "plant.seed"'):
        write_ssp(system, fmus, path, {"plant.sead": 3})
    with pytest.raises(ParameterError, match=r"plant\.seed is -1; expected a whole number from 0"):
        write_ssp(system, fmus, path, {"plant.seed": -1})
    assert not path.exists()
