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


def plain_xml(
    data: bytes,
    root: str,
    most: float = MAX_ELEMENTS,
    see: Callable[[int, str, dict[str, str]], None] = lambda *_: None,
) -> bytes:
    """Such XML without what is harmful, or misread; UTF-8.

    Comments are left out: libraries take what stands before one for all of a text.

    Args:
        most: elements that it may have; a library takes up to a millisecond for each.
        see: is given line, name and attributes of each element.

    Raises:
        MissionFileError: it is no such XML, or could do harm.
    """
    parser = expat.ParserCreate()
    depth = count = 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        if not depth and name != root:
            raise MissionFileError(f"its first element is <{printable(name)}>, expected <{root}>")
        depth, count = depth + 1, count + 1
        if count > most:
            raise MissionFileError(
                f"line {parser.CurrentLineNumber}: has more than {most} elements; leave the mission's alone"
            )
        if depth > MAX_DEPTH:
            raise MissionFileError(
                f"line {parser.CurrentLineNumber}: elements are nested deeper than {MAX_DEPTH}"
            )
        see(parser.CurrentLineNumber, name, attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1

    def refuse(*doctype: object) -> None:
        raise MissionFileError(
            f"line {parser.CurrentLineNumber}: has a document type (<!DOCTYPE), which may define entities; "
            "remove it"
        )

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = refuse
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
