"""Structs of C headers by name: what the record of the processor in the loop is derived from.

Plain C alone is read: `typedef struct { type name[size]; ... } name;`, macros that are whole numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from models.errors import DeclarationError

COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
MACRO = re.compile(r"^#define (\w+) (\d+)U?\s*$", re.MULTILINE)
STRUCT = re.compile(r"typedef struct \{(.*?)\} (\w+);", re.DOTALL)
ENUM = re.compile(r"typedef enum \{(.*?)\} (\w+);", re.DOTALL)
MEMBER = re.compile(r"(?:const |volatile )*(?P<type>\w+ \*?)(?P<name>\w+)(?:\[(?P<size>[\w *]+)\])?")
FUNCTION = re.compile(r".*\(\*(?P<name>\w+)\)\(.*\)", re.DOTALL)


@dataclass(frozen=True)
class Member:
    """A member of a struct.

    Attributes:
        type: without const and volatile; a pointer's ends in `*`.
        size: elements of an array, 0 for a single value.
    """

    type: str
    name: str
    size: int = 0


@dataclass(frozen=True)
class Headers:
    """What some headers declare.

    Attributes:
        structs: the members of each struct, in their order.
        enums: the names of each enumeration, in their order.
    """

    structs: Mapping[str, tuple[Member, ...]]
    enums: Mapping[str, tuple[str, ...]]


def read_headers(texts: Mapping[str, str]) -> Headers:
    """The structs and enumerations of headers, file name to text.

    Raises:
        DeclarationError: a member is not plain C, or its size is not stated there.
    """
    code = COMMENT.sub("", "\n".join(texts.values()))
    macros = {name: int(value) for name, value in MACRO.findall(code)}
    return Headers(
        {
            name: tuple(_member(name, words, macros) for words in body.split(";") if words.strip())
            for body, name in STRUCT.findall(code)
        },
        {
            name: tuple(words.split("=")[0].strip() for words in body.split(",") if words.strip())
            for body, name in ENUM.findall(code)
        },
    )


def _member(struct: str, words: str, macros: Mapping[str, int]) -> Member:
    text = " ".join(words.split())
    if match := MEMBER.fullmatch(text):
        factors = [factor.strip().removesuffix("U") for factor in (match["size"] or "0").split("*")]
        if all(factor.isdigit() or factor in macros for factor in factors):
            size = math.prod(macros.get(factor) or int(factor) for factor in factors)
            return Member(match["type"].strip(), match["name"], size)
    elif match := FUNCTION.fullmatch(text):
        return Member("function *", match["name"])
    raise DeclarationError(
        f"{struct}: `{text}` is not read; expected `type name;` or `type name[size];`, "
        "the size a whole number, a macro of these headers, or a product"
    )
