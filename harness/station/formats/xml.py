"""XML from elsewhere, checked before a library reads it."""

from __future__ import annotations

import io
from collections.abc import Callable
from xml.etree import ElementTree
from xml.parsers import expat

from harness.station.draft import MissionFileError
from models.errors import printable

MAX_DEPTH = 32  # elements within elements; those of KML's folders need 10
MAX_ELEMENTS = 5000  # of a mission; a track of a thousand points beside it has 3000
TEXTS = {"coordinates", "name", "type"}  # elements whose texts are read


def plain_xml(
    data: bytes,
    root: str,
    most: float = MAX_ELEMENTS,
    see: Callable[[int, str, dict[str, str]], None] = lambda *_: None,
) -> bytes:
    """XML that a library may read, as UTF-8; an error where it could do harm or be misread.

    A library takes what stands before a comment, an instruction or an element for all of a text. Comments are
    left out; the others are refused.

    Args:
        root: the name of its first element.
        most: elements that it may have; a library takes up to a millisecond for each.
        see: is given line, name and attributes of each element.

    Raises:
        MissionFileError: the data is not XML, has another root, could do harm, or could be misread.
    """
    parser = expat.ParserCreate()
    count = 0
    outer: list[str] = []  # the elements that are open

    def fault(words: str) -> MissionFileError:
        return MissionFileError(f"line {parser.CurrentLineNumber}: {words}")

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal count
        if not outer and name != root:
            raise MissionFileError(f"its first element is <{printable(name)}>, expected <{root}>")
        if outer and outer[-1].rpartition(":")[2] in TEXTS:
            raise fault(f"<{printable(outer[-1])}> has an element <{printable(name)}>, expected text alone")
        outer.append(name)
        count += 1
        if count > most:
            raise fault(f"has more than {most} elements; leave the mission's alone")
        if len(outer) > MAX_DEPTH:
            raise fault(f"elements are nested deeper than {MAX_DEPTH}")
        see(parser.CurrentLineNumber, name, attributes)

    def end(name: str) -> None:
        outer.pop()

    def refuse_doctype(*doctype: object) -> None:
        raise fault("has a document type (<!DOCTYPE), which may define entities; remove it")

    def refuse_instruction(target: str, content: str) -> None:
        if outer:
            raise fault(f"has an instruction (<?{printable(target)}) among the elements; remove it")

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = refuse_doctype
    parser.ProcessingInstructionHandler = refuse_instruction
    try:
        parser.Parse(data, True)
        return ElementTree.canonicalize(from_file=io.BytesIO(data)).encode()
    except ElementTree.ParseError as reason:  # a prefix that is not declared
        raise MissionFileError(f"is no XML ({reason}); save it again") from None
    except expat.ExpatError as reason:
        raise MissionFileError(
            f"line {reason.lineno}: is no XML ({expat.errors.messages[reason.code]}); save it again"
        ) from None
    except (LookupError, ValueError) as reason:  # an encoding that is unknown, or has several bytes
        raise MissionFileError(
            f"is in an encoding that cannot be read ({reason}); save it as UTF-8"
        ) from None
