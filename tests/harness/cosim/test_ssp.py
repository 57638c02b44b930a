"""SSP packages: what is read, and what is refused by name."""

import stat
import zipfile
from pathlib import Path

import pytest

from harness.cosim import archive
from harness.cosim.archive import ArchiveError, XmlError
from harness.cosim.ssp import ScaledLink, SspError, StartValue, open_ssp

NAMESPACES = " ".join(
    f'xmlns:{prefix}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for prefix, name in (("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"))
)
A = """<ssd:Component name="a" type="application/x-fmu-sharedlibrary" source="resources/a.fmu">
  <ssd:Connectors><ssd:Connector name="y" kind="output"><ssc:Real unit="m"/></ssd:Connector>
  <ssd:Connector name="k" kind="parameter"><ssc:Real/></ssd:Connector></ssd:Connectors>{a}</ssd:Component>"""
B = """<ssd:Component name="b" source="resources/b.fmu"><ssd:Connectors>
  <ssd:Connector name="u" kind="input"/><ssd:Connector name="w" kind="input"/></ssd:Connectors></ssd:Component>"""  # noqa: E501
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
            packed.writestr(name, "")
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
        assert system.links == (ScaledLink("a", "y", "b", "u", 0.001, 3.0),)


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
        ({"elements": '<ssd:System name="inner"/>'}, 'element "inner" is a System; expected a Component (an FMU)'),  # noqa: E501
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
        ({"elements": B.replace('"b"', '"a"')}, 'two components are named "a"'),
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
            "Connection holds a BooleanMappingTransformation, which is not supported",
        ),
        (
            {"system": "<ssd:SignalDictionaries/>"},
            "System holds a SignalDictionaries, which is not supported",
        ),
        (
            {"head": '<!DOCTYPE x [<!ENTITY a "a">]>'},
            "SystemStructure.ssd: holds a document type definition (DTD), which is not accepted; remove it",
        ),
    ],
)  # fmt: skip
def test_refuses_by_name(tmp_path: Path, change: dict[str, str], text: str) -> None:
    assert refusal(package(tmp_path / "toy.ssp", **change)) == text


@pytest.mark.parametrize("name", ["../evil", "/evil", "a/../../evil", "c:evil"])
def test_a_member_that_leaves_the_archive_is_refused(tmp_path: Path, name: str) -> None:
    path = package(tmp_path / "toy.ssp")
    with zipfile.ZipFile(path, "a") as packed:
        packed.writestr(name, "x")
    assert refusal(path) == f'member "{name}" leaves the archive; it must have a relative path inside'
    assert not (tmp_path.parent / "evil").exists()


def test_a_link_in_the_archive_is_refused(tmp_path: Path) -> None:
    path = package(tmp_path / "toy.ssp")
    link = zipfile.ZipInfo("link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(path, "a") as packed:
        packed.writestr(link, "/etc/passwd")
    assert refusal(path) == 'member "link" is a symbolic link; pack the file itself'


def test_a_zip_bomb_is_refused_before_it_is_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given 3 MiB of zeros in 3 kB, and a limit of 2 MiB
    monkeypatch.setattr(archive, "MAX_BYTES", 2 * 2**20)
    path = tmp_path / "bomb.ssp"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("SystemStructure.ssd", bytes(3 * 2**20))
    assert path.stat().st_size < 4096
    assert refusal(path) == "3 MiB unpacked; at most 2 MiB are accepted"


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_damaged_member_is_refused(tmp_path: Path, method: int) -> None:
    # given one member of 10 kB that no method can store in place, its packed data overwritten
    path = tmp_path / "toy.ssp"
    with zipfile.ZipFile(path, "w", method) as packed:
        packed.writestr("SystemStructure.ssd", bytes(k * k % 251 for k in range(10_000)))
    data = bytearray(path.read_bytes())
    start = 30 + len("SystemStructure.ssd")  # after the local header
    data[start + 9 : start + 60] = b"\xff" * 51
    path.write_bytes(data)
    # when, then
    assert refusal(path).endswith(
        ("; export it again", "; export it again, or make room for temporary files")
    )


@pytest.mark.parametrize(
    ("names", "text"),
    [
        (("a", "a/b"), 'member "a/b" cannot be unpacked (Not a directory)'),
        (("a/b", "a"), 'member "a" cannot be unpacked (Is a directory)'),
        (("n" * 300,), f'member "{"n" * 80}" cannot be unpacked (File name too long)'),
    ],
)
def test_a_member_for_which_there_is_no_place_is_named(
    tmp_path: Path, names: tuple[str, ...], text: str
) -> None:
    path = package(tmp_path / "toy.ssp")
    with zipfile.ZipFile(path, "a") as packed:
        for name in names:
            packed.writestr(name, "x")
    assert refusal(path) == f"{text}; export it again, or make room for temporary files"


def test_an_unknown_encoding_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "toy.ssp"
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("SystemStructure.ssd", '<?xml version="1.0" encoding="ebcdic-x"?><a/>')
    assert refusal(path) == "SystemStructure.ssd: malformed XML (unknown encoding: ebcdic-x)"


def test_what_is_no_archive_is_said_to_be_none(tmp_path: Path) -> None:
    path = tmp_path / "toy.ssp"
    path.write_text("hello")
    assert refusal(path) == "not a readable ZIP archive (File is not a zip file); export it again"
