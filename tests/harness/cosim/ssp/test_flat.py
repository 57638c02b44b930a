"""SSP packages: what is read, and what is refused by name."""

import io
import zipfile
from pathlib import Path

import pytest

from harness.cosim.archive import ArchiveError, XmlError
from harness.cosim.ssp import ScaledLink, SspError, StartValue, open_ssp
from tests.harness.cosim.tiny_fmu import V, description

NAMESPACES = " ".join(
    f'xmlns:{prefix}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for prefix, name in (("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"))
)
A = """<ssd:Component name="a" type="application/x-fmu-sharedlibrary" source="resources/a.fmu">
  <ssd:Connectors><ssd:Connector name="y" kind="output"><ssc:Real unit="m"/></ssd:Connector>
  <ssd:Connector name="k" kind="parameter"><ssc:Real/></ssd:Connector></ssd:Connectors>{a}</ssd:Component>"""
B = """<ssd:Component name="b" source="resources/b.fmu"><ssd:Connectors>
  <ssd:Connector name="u" kind="input"/><ssd:Connector name="w" kind="input"/></ssd:Connectors></ssd:Component>"""  # noqa: E501
with io.BytesIO() as stream:
    with zipfile.ZipFile(stream, "w") as archive:
        variables = [V("u", "input"), V("w", "input"), V("k", "parameter", unit="m"), V("y", unit="m")]
        archive.writestr("modelDescription.xml", description(variables))
    FMU = stream.getvalue()
CONNECTION = '<ssd:Connection startElement="a" startConnector="y" endElement="b" endConnector="u"/>'


def package(
    path: Path, *, a: str = "", elements: str = "", connections: str = CONNECTION, system: str = "", head: str = "",  # noqa: E501
    **files: str,
) -> Path:  # fmt: skip
    text = (
        f'<?xml version="1.0"?>{head}<ssd:SystemStructureDescription {NAMESPACES} version="1.0" name="toy">'
        f'<ssd:System name="toy">{system}<ssd:Elements>{A.format(a=a)}{B}{elements}</ssd:Elements>'
        f"<ssd:Connections>{connections}</ssd:Connections></ssd:System></ssd:SystemStructureDescription>"
    )
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("SystemStructure.ssd", text)
        for name in ("resources/a.fmu", "resources/b.fmu"):
            packed.writestr(name, FMU)
        for name, content in files.items():
            packed.writestr(name.replace("__", "."), content)
    return path


def refusal(path: Path) -> str:
    with pytest.raises((SspError, ArchiveError, XmlError)) as caught, open_ssp(path):
        pass
    return str(caught.value).removeprefix(f"{path}: ")


def test_reads_components_links_and_conversion(tmp_path: Path) -> None:
    # given a connection that turns m into km and shifts by 3
    linear = CONNECTION.replace(
        "/>", '><ssc:LinearTransformation factor="0.001" offset="3"/></ssd:Connection>'
    )
    # when
    with open_ssp(package(tmp_path / "toy.ssp", connections=linear)) as system:
        # then
        assert system.name == "toy"
        assert system.components["a"].fmu.name == "a.fmu"
        assert set(system.files) == {"SystemStructure.ssd", "resources/a.fmu", "resources/b.fmu"}
        assert system.components["a"].connectors["y"].unit == "m"
        assert system.links == (ScaledLink("a", "y", "b", "u", 0.001, 3.0, settled=True),)


def test_parameters_come_from_the_package_inline_and_beside_and_from_the_system(tmp_path: Path) -> None:
    # given a value for k inline, one for w through the system's own connector, and one by a file
    values = (
        '<ssv:ParameterSet {} version="1.0" name="s"><ssv:Parameters>{}</ssv:Parameters></ssv:ParameterSet>'
    )
    k = '<ssv:Parameter name="k"><ssv:Real value="2.5" unit="m"/></ssv:Parameter>'
    w = '<ssv:Parameter name="outside"><ssv:Boolean value="true"/></ssv:Parameter>'
    bind = "<ssd:ParameterBindings>{}</ssd:ParameterBindings>"
    inline = "<ssd:ParameterBinding><ssd:ParameterValues>{}</ssd:ParameterValues></ssd:ParameterBinding>"
    path = package(
        tmp_path / "toy.ssp",
        a=bind.format(inline.format(values.format("", k))),
        system='<ssd:Connectors><ssd:Connector name="outside" kind="input"/></ssd:Connectors>'
        + bind.format('<ssd:ParameterBinding source="more.ssv"/>'),
        connections=CONNECTION + '<ssd:Connection startConnector="outside" endElement="b" endConnector="w"/>',
        more__ssv=values.format(NAMESPACES, w),
    )
    # when
    with open_ssp(path) as system:
        # then
        assert system.components["a"].values == {"k": StartValue(2.5, "m")}
        assert system.components["b"].values == {"w": StartValue(1.0, None)}
        assert len(system.links) == 1


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            {"elements": '<ssd:SignalDictionaryReference name="bus" dictionary="d"/>'},
            'Elements holds a SignalDictionaryReference "bus", which is not supported',
        ),
        (
            {"elements": '<ssd:Component name="c" type="application/x-ssp-definition" source="c.ssd"/>'},
            'component "c" has type "application/x-ssp-definition"; expected "application/x-fmu-sharedlibrary"',  # noqa: E501
        ),
        (
            {"elements": '<ssd:Component name="c" implementation="ModelExchange" source="resources/a.fmu"/>'},
            'component "c" is for ModelExchange; only CoSimulation is run',
        ),
        (
            {"elements": '<ssd:Component name="c" source="../c.fmu"/>'},
            'component "c" has source "../c.fmu"; expected a path inside the package',
        ),
        (
            {"elements": '<ssd:Component name="c" source="c.fmu"/>'},
            'component "c" has source "c.fmu", which is not in the package',
        ),
        ({"elements": B.replace('"b"', '"a"')}, 'the system has two elements named "a"'),
        (
            {"connections": CONNECTION.replace('"b"', '"bb"')},
            'a connection names component "bb", which does not exist; did you mean "b"?',
        ),
        (
            {"connections": CONNECTION.replace('"u"', '"uu"')},
            'a connection names connector "uu", which component "b" lacks; did you mean "u"?',
        ),
        (
            {"connections": CONNECTION.replace('startConnector="y"', 'startConnector="k"')},
            'a connection starts at a.k, whose kind is "parameter"; expected "output"',
        ),
        (
            {"connections": CONNECTION.replace("/>", "><ssc:BooleanMappingTransformation/></ssd:Connection>")},  # noqa: E501
            "connection a.y -> b.u: its BooleanMappingTransformation without a MapEntry maps nothing",
        ),
        (
            {"system": "<ssd:SignalDictionaries/>"},
            'System "toy" holds a SignalDictionaries, which is not supported',
        ),
        (
            {"head": '<!DOCTYPE x [<!ENTITY a "a">]>'},
            "SystemStructure.ssd: holds a document type definition (DTD), which is not accepted; remove it",
        ),
    ],
)  # fmt: skip
def test_refuses_by_name(tmp_path: Path, change: dict[str, str], text: str) -> None:
    assert refusal(package(tmp_path / "toy.ssp", **change)) == text
