"""Packages from elsewhere: refused by name before they can do harm."""

import stat
import zipfile
from pathlib import Path

import pytest

from harness.cosim import archive
from harness.cosim.archive import ArchiveError, XmlError, parse_xml, unpack

NO_PLACE = "; export it again, or make room for temporary files"


def pack(path: Path, members: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", method) as packed:
        for name, data in members.items():
            packed.writestr(name, data)
    return path


def refusal(path: Path) -> str:
    """Why a package is not unpacked, without its path."""
    with pytest.raises(ArchiveError) as caught:
        unpack(path, path.parent / "unpacked")
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    return text.removeprefix(f"{path}: ")


def xml_refusal(text: bytes) -> str:
    with pytest.raises(XmlError) as caught:
        parse_xml(text, "dog.fmu: modelDescription.xml")
    return str(caught.value).removeprefix("dog.fmu: modelDescription.xml: ")


def test_members_are_unpacked_with_their_folders(tmp_path: Path) -> None:
    path = pack(tmp_path / "a.ssp", {"a.txt": b"1", "deep/er/b.txt": b"2"})
    unpack(path, tmp_path / "out")
    assert (tmp_path / "out" / "a.txt").read_bytes() == b"1"
    assert (tmp_path / "out" / "deep" / "er" / "b.txt").read_bytes() == b"2"


@pytest.mark.parametrize("name", ["../evil", "/evil", "a/../../evil", "c:evil", "a\\..\\evil"])
def test_a_member_that_leaves_the_archive_is_refused(tmp_path: Path, name: str) -> None:
    path = pack(tmp_path / "a.ssp", {"good": b"", name: b"x"})
    assert refusal(path) == f'member "{name}" leaves the archive; it must have a relative path inside'
    assert not (tmp_path / "unpacked").exists()
    assert not (tmp_path / "evil").exists()


def test_a_link_in_the_archive_is_refused(tmp_path: Path) -> None:
    path = pack(tmp_path / "a.ssp", {"good": b""})
    link = zipfile.ZipInfo("link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(path, "a") as packed:
        packed.writestr(link, "/etc/passwd")
    assert refusal(path) == 'member "link" is a symbolic link; pack the file itself'
    assert not (tmp_path / "unpacked").exists()


def test_a_zip_bomb_is_refused_before_it_is_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given 3 MiB of zeros in 3 kB, and a limit of 2 MiB
    monkeypatch.setattr(archive, "MAX_BYTES", 2 * 2**20)
    path = pack(tmp_path / "a.ssp", {"zeros": bytes(3 * 2**20)}, zipfile.ZIP_DEFLATED)
    assert path.stat().st_size < 4096
    assert refusal(path) == "3 MiB unpacked; at most 2 MiB are accepted"
    assert not (tmp_path / "unpacked").exists()


def test_too_many_members_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_MEMBERS", 3)
    unpack(pack(tmp_path / "three.ssp", dict.fromkeys("abc", b"")), tmp_path / "out")
    assert refusal(pack(tmp_path / "four.ssp", dict.fromkeys("abcd", b""))) == (
        "4 files; at most 3 are unpacked"
    )


def test_an_archive_that_takes_too_long_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_TIME", -1.0)
    path = pack(tmp_path / "a.ssp", {"a": b"a"})
    assert refusal(path) == "is not unpacked within -1 s; put it, or TMPDIR, on a faster disk"


def test_a_damaged_member_is_refused(tmp_path: Path) -> None:
    # given one member of 10 kB, its packed data overwritten
    path = pack(tmp_path / "a.ssp", {"data": bytes(k * k % 251 for k in range(10_000))}, zipfile.ZIP_DEFLATED)
    data = bytearray(path.read_bytes())
    start = 30 + len("data")  # after the local header
    data[start + 9 : start + 60] = b"\xff" * 51
    path.write_bytes(data)
    # when, then
    assert refusal(path).endswith(("; export it again", NO_PLACE))


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
    assert refusal(pack(tmp_path / "a.ssp", dict.fromkeys(names, b"x"))) == f"{text}{NO_PLACE}"


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ssp"
    path.write_text("hello")
    assert refusal(path) == "not a readable ZIP archive (File is not a zip file); export it again"


def test_a_root_element_is_read() -> None:
    assert parse_xml(b'<?xml version="1.0"?><a b="1"/>', "a").get("b") == "1"


@pytest.mark.parametrize(
    ("xml", "text"),
    [
        (
            b'<!DOCTYPE x [<!ENTITY a "a">]><x>&a;</x>',
            "holds a document type definition (DTD), which is not accepted; remove it",
        ),
        (b"<a><b></a>", "malformed XML (mismatched tag: line 1, column 8)"),
        (b"", "malformed XML (no element found: line 1, column 0)"),
        (b'<?xml version="1.0" encoding="ebcdic-x"?><a/>', "malformed XML (unknown encoding: ebcdic-x)"),
    ],
)
def test_xml_that_is_malformed_or_defines_entities_is_refused(xml: bytes, text: str) -> None:
    assert xml_refusal(xml) == text
