"""ZIP archives and XML from elsewhere, checked before they can do harm."""

from __future__ import annotations

import os
import shutil
import stat
import struct
import time
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree
from xml.parsers import expat

from harness.files import is_pipe
from models.errors import CanineError, printable

MAX_BYTES = 512 * 2**20  # unpacked; our largest package is 2 MiB, an FMU with a simulator inside 200 MiB
MAX_MEMBERS = 10_000
MAX_TIME = 60.0  # s; 512 MiB take 5 s
MAX_XML = 32 * 2**20  # bytes: a description of 100,000 variables, of which up to ten times that is built
MAX_PARTS = 2_000_000  # elements and attributes of an XML file: 100,000 variables have about 1,000,000
MAX_DEPTH = 100  # of XML elements; a description needs 6, lxml takes 256
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # of FMI 2.0, 2.1.1; others may ask for GiB of memory
SHOWN = 80  # characters of a name in messages

# what zipfile raises for a damaged archive
UNREADABLE = (
    zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError, struct.error,
)  # fmt: skip


class ArchiveError(CanineError):
    """A package cannot be unpacked, or is not safe to unpack."""


class XmlError(CanineError):
    """An XML file is malformed, or holds a DTD or entities."""


def holder(package: Path) -> Path:
    """The file or folder that a package is in: of `toy.ssp/Variant.ssd`, toy.ssp."""
    return package.parent if package.suffix == ".ssd" else package


def unpack(path: Path, folder: Path) -> None:
    """Unpack a ZIP archive (.fmu, .ssp) into `folder`; one that is unpacked in a folder is copied.

    Raises:
        ArchiveError: not a ZIP archive, damaged, too large or too slow; a member leaves the folder, or is a
            link.
    """
    try:
        if path.is_dir():
            shutil.copytree(path, folder, dirs_exist_ok=True)
            return
        with _opened(path) as archive:
            started = time.monotonic()
            for member in archive.infolist():
                if time.monotonic() - started > MAX_TIME:
                    raise ArchiveError(
                        f"{path}: is not unpacked within {MAX_TIME:g} s; put it, or TMPDIR, on a faster disk"
                    )
                _extract(path, archive, member, folder)
    except UNREADABLE as reason:
        raise _unreadable(path, reason) from None
    except OSError as reason:
        raise _unreadable(path, reason.strerror or reason) from None


def _opened(path: Path) -> zipfile.ZipFile:
    """A ZIP archive whose table of contents is sound.

    Raises:
        ArchiveError, OSError, UNREADABLE: it is not.
    """
    if is_pipe(path):
        raise ArchiveError(f"{path}: is no file; expected a package")
    archive = zipfile.ZipFile(path)
    try:
        _check(path, archive)
    except BaseException:
        archive.close()
        raise
    return archive


def read_member(path: Path, name: str) -> bytes | None:
    """One file of a ZIP archive, or of the folder that one is unpacked in; None if it has none of that name.

    Raises:
        ArchiveError: as `unpack` does.
    """
    try:
        if path.is_dir():
            return _read_file(path / name) if (path / name).is_file() else None
        with _opened(path) as archive:
            if name not in archive.namelist():
                return None
            if (size := archive.getinfo(name).file_size) > MAX_XML:
                raise ArchiveError(
                    f"{path}: {name} has {size / 2**20:.0f} MiB; at most {MAX_XML // 2**20} MiB are read"
                )
            return archive.read(name)
    except UNREADABLE as reason:
        raise _unreadable(path, reason) from None
    except OSError as reason:
        raise _unreadable(path, reason.strerror or reason) from None


def _read_file(path: Path) -> bytes:
    """A file's content, or so much of it that `parse_xml` refuses it."""
    with path.open("rb") as file:
        return file.read(MAX_XML + 1)


@contextmanager
def naming(folder: Path, package: object) -> Iterator[None]:
    """Errors from within name the package in the place of the folder that it is unpacked in."""
    try:
        yield
    except CanineError as error:
        error.args = tuple(str(part).replace(f"{folder}{os.sep}", f"{package}: ") for part in error.args)
        raise


def read_xml(path: Path, what: str) -> ElementTree.Element:
    """The root element of an XML file; `what` names it in errors.

    Raises:
        XmlError: as `parse_xml` does, or the file cannot be read.
    """
    try:
        data = _read_file(path)
    except OSError as reason:
        raise XmlError(f"{what}: cannot be read ({reason.strerror})") from None
    return parse_xml(data, what)


def _unreadable(path: Path, reason: object) -> ArchiveError:
    return ArchiveError(f"{path}: not a readable ZIP archive ({printable(reason)}); export it again")


def _extract(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo, folder: Path) -> None:
    try:
        size = Path(archive.extract(member, folder)).stat().st_size
    except OSError as reason:  # a file where a folder is needed, too long a name, a full disk, bad bzip2 data
        raise ArchiveError(
            f'{path}: member "{_shown(member.filename)}" cannot be unpacked ({reason.strerror or reason}); '
            "export it again, or make room for temporary files"
        ) from None
    if size != member.file_size and not member.is_dir():
        raise ArchiveError(
            f'{path}: member "{_shown(member.filename)}" has {size} bytes, '
            f"{member.file_size} are stated; export it again"
        )


def _check(path: Path, archive: zipfile.ZipFile) -> None:
    members = archive.infolist()
    if len(members) > MAX_MEMBERS:
        raise ArchiveError(f"{path}: {len(members)} files; at most {MAX_MEMBERS} are unpacked")
    size = sum(member.file_size for member in members)  # zipfile extracts no more than is stated here
    if size > MAX_BYTES:
        raise ArchiveError(
            f"{path}: {size / 2**20:.0f} MiB unpacked; at most {MAX_BYTES // 2**20} MiB are accepted"
        )
    names: set[PurePosixPath] = set()
    for member in members:
        pure = PurePosixPath(member.orig_filename)
        if fault := _fault(member, pure) or ("is there twice; pack it once" if pure in names else ""):
            raise ArchiveError(f'{path}: member "{_shown(member.orig_filename)}" {fault}')
        names.add(pure)


def _fault(member: zipfile.ZipInfo, pure: PurePosixPath) -> str:
    """What forbids to unpack a member, "" if nothing does."""
    name = member.orig_filename
    if "\\" in name or ":" in name or pure.is_absolute() or ".." in pure.parts:
        return "leaves the archive; it must have a relative path inside"
    if "\0" in name:
        return "has a name with a zero byte; export it again"
    if stat.S_ISLNK(member.external_attr >> 16):
        return "is a symbolic link; pack the file itself"
    if member.flag_bits & 1:
        return "is encrypted; pack it without a password"
    if member.compress_type not in METHODS:
        return f"has compression method {member.compress_type}; expected stored or deflated"
    return ""


def _shown(name: str) -> str:
    return printable(name)[:SHOWN]


def plain(text: str) -> str:
    """The text of a number as XML has them; Python's `float` and `int` take `1_000` and foreign digits, too.

    Raises:
        ValueError: it has an underscore, or a character that is not ASCII.
    """
    if "_" in text or not text.isascii():
        raise ValueError(text)
    return text


def parse_xml(data: bytes, what: str) -> ElementTree.Element:
    """The root element of an XML file's content; `what` names it in errors.

    Raises:
        XmlError: malformed, too large, or holds a document type definition (which could define entities).
    """

    def refuse(*_: object) -> None:
        raise XmlError(f"{what}: holds a document type definition (DTD), which is not accepted; remove it")

    if len(data) > MAX_XML:
        raise XmlError(f"{what}: has more than {MAX_XML // 2**20} MiB, the most that is read")
    depth = parts = 0

    def start(name: str, attributes: list[str]) -> None:
        nonlocal depth, parts
        depth, parts = depth + 1, parts + 1 + len(attributes) // 2
        if depth > MAX_DEPTH:
            raise XmlError(f"{what}: line {parser.CurrentLineNumber}: more than {MAX_DEPTH} elements nested")
        if parts > MAX_PARTS:
            raise XmlError(
                f"{what}: has more than {MAX_PARTS} elements and attributes, the most that are read"
            )

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.ordered_attributes = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
        return ElementTree.fromstring(data)
    except (expat.ExpatError, ElementTree.ParseError, ValueError, LookupError) as reason:  # no such encoding
        raise XmlError(f"{what}: malformed XML ({printable(reason)})") from None
