"""Packages that are damaged, or made to do harm: an error of ours in one line, in bounded time and memory."""

import io
import os
import re
import struct
import subprocess
import sys
import warnings
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen import cache
from harness.cosim import archive
from harness.cosim.archive import ArchiveError, XmlError, parse_xml, read_member, unpack
from harness.cosim.fmu import FmuError, describe
from harness.cosim.ssp import SspError, open_ssp
from harness.log.log import read_log
from models.errors import CanineError
from tests.harness.cosim.ssp.test_flat import package
from tests.harness.cosim.tiny_fmu import V, tiny_fmu
from tests.memory import PRINT_PEAK


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What fmpy finds in broken descriptions does not go into the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setattr(cache, "cache_folder", lambda: folder)
        yield


@pytest.fixture(scope="module")
def ssp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    linear = '<ssc:LinearTransformation factor="0.001" offset="3"/></ssd:Connection>'
    connection = '<ssd:Connection startElement="a" startConnector="y" endElement="b" endConnector="u"/>'
    return package(
        tmp_path_factory.mktemp("ssp") / "toy.ssp", connections=connection.replace("/>", f">{linear}")
    )


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    variables = [V("u", "input", unit="m"), V("k", "parameter", start="2"), V("y", unit="km/h")]
    folder = tmp_path_factory.mktemp("fmu")
    return {
        version: tiny_fmu(folder / f"dog{version}.fmu", variables, version=version, step_size=0.04)
        for version in (2, 3)
    }


def member(name: str = "a", **changes: Any) -> zipfile.ZipInfo:
    made = zipfile.ZipInfo(name)
    for key, value in changes.items():
        setattr(made, key, value)
    return made


def pack(path: Path, *members: tuple[zipfile.ZipInfo | str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as packed, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # zipfile warns of duplicate names
        for name, data in members:
            packed.writestr(name, data)
    return path


def patched(path: Path, signature: bytes, offset: int, value: bytes) -> Path:
    """A ZIP archive whose first record of a kind has other bytes at an offset."""
    data = bytearray(path.read_bytes())
    at = data.index(signature) + offset
    data[at : at + len(value)] = value
    path.write_bytes(data)
    return path


CENTRAL, END = b"PK\1\2", b"PK\5\6"


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda p: pack(p, ("a", b"1"), ("a", b"2")), 'member "a" is there twice; pack it once'),
        (lambda p: pack(p, ("d/a", b"1"), ("d//a", b"2")), 'member "d//a" is there twice; pack it once'),
        (lambda p: patched(pack(p, ("a", b"1")), CENTRAL, 8, b"\1"), 'member "a" is encrypted; pack it'),
        (
            lambda p: pack(p, (member(compress_type=zipfile.ZIP_LZMA), b"1")),
            'member "a" has compression method 14; expected stored or deflated',
        ),
        (lambda p: pack(p, ("a\nb\x1b", b"1"), ("../x", b"")), 'member "../x" leaves the archive'),
        (lambda p: pack(p, ("../a\n", b"1")), 'member "../a\\n" leaves the archive'),
        # sizes that lie: more than there is, less than there is
        (
            lambda p: patched(pack(p, ("a", b"1")), CENTRAL, 24, struct.pack("<I", 9)),
            "has 1 bytes, 9 are stated",
        ),
        (lambda p: patched(pack(p, ("a", b"12")), CENTRAL, 20, struct.pack("<II", 1, 1)), "Bad CRC-32"),
        (
            lambda p: patched(pack(p, ("a", b"1")), CENTRAL, 24, struct.pack("<I", 2**32 - 2)),
            "4096 MiB unpacked; at most 512 MiB are accepted",
        ),
        (
            lambda p: patched(pack(p, ("a", b"1")), CENTRAL, 42, struct.pack("<I", 2**31)),
            "Truncated file header",
        ),
        (lambda p: patched(pack(p, ("a", b"1")), END, 16, struct.pack("<I", 2**31)), "(Invalid argument)"),
        (lambda p: patched(pack(p, ("a", b"1")), END, 12, struct.pack("<I", 2**31)), "not a readable ZIP"),
    ],
)
def test_what_is_wrong_in_a_crafted_archive_is_named(
    make: Callable[[Path], Path], text: str, tmp_path: Path
) -> None:
    path = make(tmp_path / "a.ssp")
    with pytest.raises(ArchiveError) as caught:
        unpack(path, tmp_path / "out")
    assert text in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
    assert str(caught.value).isprintable()
    assert not (tmp_path / "x").exists()


def test_an_archive_that_is_not_there_is_an_error_of_ours(tmp_path: Path) -> None:
    with pytest.raises(ArchiveError, match="No such file or directory"):
        unpack(tmp_path / "a.ssp", tmp_path)
    with pytest.raises(ArchiveError, match="No such file or directory"):
        read_member(tmp_path / "a.fmu", "modelDescription.xml")


@pytest.mark.parametrize(
    ("xml", "text"),
    [
        (b"<a>" * 101, "line 1: more than 100 elements nested"),
        (b"<a>\n" + b"<b/>" * 300, "has more than 200 elements and attributes, the most that are read"),
        (
            b"<a " + b" ".join(b'b%d=""' % k for k in range(300)) + b"/>",
            "has more than 200 elements",
        ),
        (b"<a>" + b" " * 5000 + b"</a>", "has more than 0 MiB, the most that is read"),
        (b'<!DOCTYPE a [<!ENTITY b "b">]><a/>', "holds a document type definition"),
    ],
)
def test_xml_has_limits(xml: bytes, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_PARTS", 200)
    monkeypatch.setattr(archive, "MAX_XML", 5000)
    with pytest.raises(XmlError) as caught:
        parse_xml(xml, "dog.fmu")
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ("a&#10;b", 'has source "a\\nb", which is not in the package'),
        ("../../etc/passwd", "expected a path inside the package"),
        ("loop/a.fmu", "which is no path (Symlink loop"),
    ],
)
def test_the_source_of_a_component_is_checked(source: str, text: str, ssp: Path, tmp_path: Path) -> None:
    # given a package as a folder, with a link that leads to itself
    unpack(ssp, tmp_path)
    (tmp_path / "loop").symlink_to("loop")
    structure = tmp_path / "SystemStructure.ssd"
    structure.write_text(structure.read_text().replace("resources/a.fmu", source))
    with pytest.raises(SspError) as caught, open_ssp(tmp_path):
        pass
    assert text in str(caught.value)
    assert str(caught.value).isprintable()


def test_a_pipe_is_refused_before_it_is_opened(tmp_path: Path) -> None:
    # given pipes that nobody writes into, which would wait for ever
    for name in ("dog.fmu", "trial.mcap"):
        os.mkfifo(tmp_path / name)
    # then
    with pytest.raises(CanineError, match=r"dog\.fmu: is no file; expected a package"):
        describe(tmp_path / "dog.fmu")
    with pytest.raises(CanineError, match=r"log .*trial\.mcap: is no file"):
        read_log(tmp_path / "trial.mcap")


def test_bombs_cost_bounded_time_and_memory(tmp_path: Path) -> None:
    # given an XML of 40 MB, one of elements alone as large as is read, one nested deep, and entities
    bombs = {
        "large": b"<fmiModelDescription>" + b" " * 40_000_000,
        "wide": b"<fmiModelDescription>" + b"<a/>" * 8_000_000,
        "deep": b"<fmiModelDescription>" + b"<a>" * 1_000_000,
        "entities": b'<!DOCTYPE a [<!ENTITY a "%s">]><a>&a;</a>' % (b"a" * 1000),
    }
    for name, xml in bombs.items():
        with zipfile.ZipFile(tmp_path / f"{name}.fmu", "w", zipfile.ZIP_DEFLATED) as packed:
            packed.writestr("modelDescription.xml", xml)
        with zipfile.ZipFile(tmp_path / f"{name}.ssp", "w", zipfile.ZIP_DEFLATED) as packed:
            packed.writestr("SystemStructure.ssd", xml)
    code = (
        "import sys; from pathlib import Path\n"
        "from harness.cosim.fmu import describe; from harness.cosim.ssp import open_ssp\n"
        "from models.errors import CanineError\n"
        "for path in sorted(Path(sys.argv[1]).iterdir()):\n"
        "    try: describe(path) if path.suffix == '.fmu' else open_ssp(path).__enter__()\n"
        "    except CanineError as error: print(str(error).removeprefix(str(path)))\n"
        f"{PRINT_PEAK}"
    )
    # when they are read, in a process of their own
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        capture_output=True, check=True, text=True, timeout=60, cwd=Path(__file__).parents[3],
    )  # fmt: skip
    # then each is refused in a line, and the process has stayed below 600 MiB
    *lines, mebibytes = done.stdout.splitlines()
    assert len(lines) == 8, lines
    assert int(mebibytes) < 600


def damaged(data: st.DataObject, good: bytes, put: st.SearchStrategy[bytes]) -> bytes:
    """Bytes with some cut out, put in or overwritten."""
    result = bytearray(good)
    for _ in range(data.draw(st.integers(1, 3))):
        at, length = data.draw(st.integers(0, len(good))), data.draw(st.integers(0, 12))
        result[at : at + length] = data.draw(put)
    return bytes(result)


def with_member(path: Path, name: str, content: bytes, out: Path) -> Path:
    """A copy of an archive with another content of one member."""
    with zipfile.ZipFile(path) as packed, zipfile.ZipFile(out, "w") as copy:
        for info in packed.infolist():
            copy.writestr(info, content if info.filename == name else packed.read(info.filename))
    return out


def check(read: Callable[[Path], object], path: Path) -> None:
    """Fails on an exception that is not ours, or whose text is not one line with the file's name."""
    try:
        read(path)
    except CanineError as error:
        assert str(error).isprintable(), str(error)  # noqa: PT017
        assert path.name in str(error)  # noqa: PT017


def opened(path: Path) -> None:
    with open_ssp(path):
        pass


PIECES = st.sampled_from([*b'" < > /> &#10; &x; \xff <a/> </a>'.split(), b"", b' a="b"'])
WORDS = (
    b"0 -1 1e999 nan true 99999999999999999999 0.04 a&#10;b ../a / . 2.0 3 \xc3\xa9 a b u y m input output "
    b"independent parameter local Real discrete fixed exact System Unit application/x"
)
VALUES = st.sampled_from([*WORDS.split(), b"", b"1 2", b"x" * 300])


def damaged_archive(
    data: st.DataObject, good: bytes, name: str, write: Callable[[bytes], object], path: Path
) -> None:
    """Write an archive that is damaged, or whose XML is: pieces of it, its values or its names."""
    with zipfile.ZipFile(io.BytesIO(good)) as packed:
        xml = packed.read(name)
    kind = data.draw(st.sampled_from(["bytes", "pieces", "values", "values", "values"]))
    if kind == "bytes":
        path.write_bytes(damaged(data, good, st.binary(max_size=4)))
    elif kind == "pieces":
        write(damaged(data, xml, PIECES))
    else:
        for _ in range(data.draw(st.integers(1, 3))):
            places = [m.span() for m in re.finditer(rb'(?<=")[^"]*(?=")|(?<=[ <:])\w+(?=[ =/>])', xml)]
            start, end = data.draw(st.sampled_from(places))
            xml = xml[:start] + data.draw(VALUES) + xml[end:]
        write(xml)


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_a_damaged_ssp_raises_nothing_but_errors_of_ours(
    data: st.DataObject, ssp: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "dog.ssp"
    name = "SystemStructure.ssd"
    damaged_archive(data, ssp.read_bytes(), name, lambda xml: with_member(ssp, name, xml, path), path)
    check(opened, path)


@settings(max_examples=60, deadline=None)
@given(data=st.data(), version=st.sampled_from([2, 3]))
def test_a_damaged_fmu_raises_nothing_but_errors_of_ours(
    data: st.DataObject, version: int, fmus: dict[int, Path], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "dog.fmu"
    name = "modelDescription.xml"
    good = pack(path, (name, read_member(fmus[version], name) or b"")).read_bytes()
    damaged_archive(data, good, name, lambda xml: pack(path, (name, xml)), path)
    check(describe, path)


def test_the_good_ones_are_read(ssp: Path, fmus: dict[int, Path]) -> None:
    with open_ssp(ssp) as system:
        assert list(system.components) == ["a", "b"]
    for version, path in fmus.items():
        assert describe(path).version == version
    with pytest.raises(FmuError, match="has no modelDescription"):
        describe(ssp)
