"""The files of a package: unpacked for as long as they are used, and each one read within it."""

from __future__ import annotations

import os
import posixpath
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

from codegen.scratch import Scratch
from harness.cosim.archive import holder, naming, parse_xml, read_member, read_xml, unpack
from harness.cosim.ssp.document import Document, SspError
from models.errors import printable

DEFAULT = "SystemStructure.ssd"
DESCRIPTION = "modelDescription.xml"  # what makes a folder an FMU


@dataclass(frozen=True)
class Package:
    """A package in a folder.

    Attributes:
        name: how errors call it.
        files: those that were read, by their names in it.
    """

    name: str
    folder: Path
    files: dict[str, Path] = field(default_factory=dict)

    def fail(self, text: str) -> SspError:
        """The error that says this of the package."""
        return SspError(f"{self.name}: {printable(text)}")

    def document(self, source: str, what: str) -> Document:
        """An XML file of the package.

        Raises:
            SspError, XmlError: there is none, or it cannot be read.
        """
        path = self.file(source, what)
        name = f"{self.name}: {path.name}"
        return Document(name, read_xml(path, name))

    def document_in(self, fmu: Path, source: str, what: str) -> Document:
        """An XML file inside an FMU.

        Raises:
            SspError, ArchiveError, XmlError: there is none, or it cannot be read.
        """
        member = posixpath.normpath(unquote(source))
        content = None if member.startswith(("..", "/")) else read_member(fmu, member)
        if content is None:
            raise self.fail(f'{what} has source "{source}", which is not in {fmu.name}')
        name = f"{self.name}: {fmu.name}: {member}"
        return Document(name, parse_xml(content, name))

    def file(self, source: str, what: str) -> Path:
        """A file of the package.

        Raises:
            SspError: there is none, or the source leaves the package.
        """
        path = self._path(source, what)
        if not path.is_file():
            raise self.fail(f'{what} has source "{source}", which is not in the package')
        self.files[path.relative_to(self.folder.resolve()).as_posix()] = path
        return path

    def fmu(self, source: str, what: str) -> Path:
        """An FMU of the package, a file or the folder that one is unpacked in, with its mapping file.

        Raises:
            SspError: there is none, or the source leaves the package.
        """
        path = self._path(source, what)
        mapping = f"{posixpath.splitext(source)[0]}.toml"
        if self._path(mapping, what).is_file():
            self.file(mapping, what)
        if not (path / DESCRIPTION).is_file():
            return self.file(source, what)
        root = self.folder.resolve()
        for part in path.rglob("*"):
            if not os.path.realpath(part).startswith(f"{root}{os.sep}"):
                raise self.fail(f"{what}: {part.relative_to(root)} is a link out of the package")
            if part.is_file():
                self.files[part.relative_to(root).as_posix()] = part
        return path

    def _path(self, source: str, what: str) -> Path:
        root = self.folder.resolve()
        try:
            path = (root / unquote(source)).resolve()
            path.is_file()
        except (OSError, RuntimeError, ValueError) as reason:  # too long a name, a loop of links, a zero byte
            raise self.fail(f'{what} has source "{source:.80}", which is no path ({reason})') from None
        if ":" in source or not path.is_relative_to(root):
            raise self.fail(f'{what} has source "{source}"; expected a path inside the package')
        return path


@contextmanager
def open_package(path: Path) -> Iterator[tuple[Package, Document]]:
    """Unpack a package for as long as it is used; it, and its structure.

    Args:
        path: an .ssp, a folder, an .ssd in either (`toy.ssp/Variant.ssd`).

    Raises:
        SspError, ArchiveError, XmlError: naming the file.
    """
    with Scratch() as temporary, naming(temporary, path):
        held, name = holder(path), path.name if path.suffix == ".ssd" else DEFAULT
        folder = held
        if not held.is_dir():
            folder = temporary
            unpack(held, folder)
        structure = folder / name
        if not structure.is_file():
            others = sorted(other.name for other in folder.glob("*.ssd"))
            hint = (
                f"; it has {', '.join(others)}: run {held}/{others[0]}"
                if others
                else "; is it an SSP package?"
            )
            raise SspError(f"{held}: has no {name}{hint}")
        package = Package(str(path), folder, {DEFAULT: structure})
        yield package, Document(str(path), read_xml(structure, f"{path}: {structure.name}"))
