"""ZIP archives and XML from elsewhere, checked before they can do harm."""

from __future__ import annotations

import lzma
import os
import stat
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree
from xml.parsers import expat

from models.errors import CanineError

MAX_BYTES = 512 * 2**20  # unpacked; our largest package is 2 MiB, an FMU with a simulator inside 200 MiB
MAX_MEMBERS = 10_000


# what zipfile raises for a damaged archive
UNREADABLE = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, RuntimeError, ValueError,
)  # fmt: skip


class ArchiveError(CanineError):
    """A package cannot be unpacked, or is not safe to unpack."""


class XmlError(CanineError):
    """An XML file is malformed, or holds a DTD or entities."""


def unpack(path: Path, folder: Path) -> None:
    """Unpack a ZIP archive (.fmu, .ssp) into `folder`.

    Raises:
        ArchiveError: not a ZIP archive, damaged or too large; a member leaves the folder or is a link.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            _check(path, archive)
            for member in archive.infolist():
                _extract(path, archive, member, folder)
    except UNREADABLE as reason:
        raise _unreadable(path, reason) from None


def read_member(path: Path, name: str) -> bytes | None:
    """One file of a ZIP archive, None if it has none of that name.

    Raises:
        ArchiveError: as `unpack` does.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            _check(path, archive)
            return archive.read(name) if name in archive.namelist() else None
    except UNREADABLE as reason:
        raise _unreadable(path, reason) from None


@contextmanager
def naming(folder: Path, package: object) -> Iterator[None]:
    """Errors from within name the package in the place of the folder that it is unpacked in."""
    try:
        yield
    except CanineError as error:
        error.args = tuple(str(part).replace(f"{folder}{os.sep}", f"{package}: ") for part in error.args)
        raise


def _unreadable(path: Path, reason: Exception) -> ArchiveError:
    return ArchiveError(f"{path}: not a readable ZIP archive ({reason}); export it again")


def _extract(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo, folder: Path) -> None:
    try:
        archive.extract(member, folder)
    except OSError as reason:  # a file where a folder is needed, too long a name, a full disk, bad bzip2 data
        raise ArchiveError(
            f'{path}: member "{member.filename:.80}" cannot be unpacked ({reason.strerror or reason}); '
            "export it again, or make room for temporary files"
        ) from None


def _check(path: Path, archive: zipfile.ZipFile) -> None:
    members = archive.infolist()
    if len(members) > MAX_MEMBERS:
        raise ArchiveError(f"{path}: {len(members)} files; at most {MAX_MEMBERS} are unpacked")
    size = sum(member.file_size for member in members)  # zipfile extracts no more than is stated here
    if size > MAX_BYTES:
        raise ArchiveError(
            f"{path}: {size / 2**20:.0f} MiB unpacked; at most {MAX_BYTES // 2**20} MiB are accepted"
        )
    for member in members:
        name = member.orig_filename
        pure = PurePosixPath(name)
        if "\\" in name or ":" in name or pure.is_absolute() or ".." in pure.parts:
            raise ArchiveError(
                f'{path}: member "{name}" leaves the archive; it must have a relative path inside'
            )
        if stat.S_ISLNK(member.external_attr >> 16):
            raise ArchiveError(f'{path}: member "{name}" is a symbolic link; pack the file itself')


def parse_xml(data: bytes, what: str) -> ElementTree.Element:
    """The root element of an XML file's content; `what` names it in errors.

    Raises:
        XmlError: malformed, or holds a document type definition (which could define entities).
    """

    def refuse(*_: object) -> None:
        raise XmlError(f"{what}: holds a document type definition (DTD), which is not accepted; remove it")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
        return ElementTree.fromstring(data)
    except (expat.ExpatError, ElementTree.ParseError, ValueError, LookupError) as reason:  # no such encoding
        raise XmlError(f"{what}: malformed XML ({reason})") from None
