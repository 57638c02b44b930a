"""The record of the processor in the loop: every word that the onboard program remembers, named.

The words are derived: those of the drivers from the structs of the headers in `onboard/`, those of the blocks
from their declarations. A member that is added there is recorded. From the words come the C that writes the
record, and the names by which it is read. INSTEAD lists the members that are recorded in another form. Of a
block's parameters only the mission is recorded, since the others do not change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from codegen.blocks.expressions import MISSION, member_of
from codegen.firmware.structs import Headers
from models.errors import DeclarationError
from models.kit.block import Block
from models.kit.declaration import Type, Variable

SCALARS = {"bool": Type.BOOLEAN, "float": Type.REAL} | dict.fromkeys(
    ("uint8_t", "uint16_t", "uint32_t", "int16_t", "int32_t"), Type.INTEGER
)
# members, by struct and name, whose own name is not part of their words' names
UNNAMED = frozenset(
    {("radio_link", "scanner"), ("mt", "scanner"), ("ubx", "scanner"), ("link_mission", "waypoints")}
)


@dataclass(frozen=True)
class Entry:
    """Words of the record.

    Attributes:
        c: the place in `onboard` of the value, or of the first element of a vector.
        size: of the vector, 0 for a scalar.
        step: the first element of the array, as C: the value, or the struct that has it.
        form: of a value that is not itself at its place, the rest of its row.
    """

    name: str
    c: str
    type: Type = Type.INTEGER
    size: int = 0
    step: str = ""
    form: str = ""

    @property
    def words(self) -> list[str]:
        """A name for each."""
        return [f"{self.name}[{i}]" for i in range(1, self.size + 1)] if self.size else [self.name]

    @property
    def row(self) -> str:
        """Its row in the table of the record, as C: place, bytes, elements, bytes from one to the next."""
        place = f"&vest.{self.c}"
        if self.form:
            return f"{place}, {self.form}"
        size = f"sizeof(vest.{self.c})"
        return f"{place}, {size}, {self.size or 1}U, {f'sizeof(vest.{self.step})' if self.size else '0U'}"


@dataclass(frozen=True)
class Place:
    """Where a struct lies.

    Attributes:
        name, c: what the names of its members' words, and their C, begin with.
        size: of the array of which it is the first element, or 0.
        element: that element, as C.
    """

    name: str
    c: str
    size: int = 0
    element: str = ""

    @property
    def whole(self) -> str:
        """The struct itself as C."""
        return self.c.removesuffix(".")


def _held(place: Place, headers: Headers) -> Iterator[Entry]:
    """The bytes in use as a sum; the others are what earlier frames left."""
    yield Entry(f"{place.name}held", place.whole, form="HELD, 1U, 0U")


def _quantities(place: Place, headers: Headers) -> Iterator[Entry]:
    """The bytes of a sample as its values."""
    for quantity in headers.enums["mt_quantity"]:
        name = quantity.removeprefix("MT_").lower()
        yield Entry(f"{place.name}{name}", place.whole, Type.REAL, form=f"QUANTITY, 1U, {quantity}")


def _nothing(place: Place, headers: Headers) -> Iterator[Entry]:
    """An address, which differs from processor to processor."""
    return iter(())


# the words in the place of a member, by its struct and name
INSTEAD: Mapping[tuple[str, str], Callable[[Place, Headers], Iterator[Entry]]] = {
    ("scanner", "bytes"): _held,
    ("scanner", "frame"): _nothing,
    ("mt", "values"): _quantities,
}


def drivers(headers: Headers, blocks: Mapping[str, type[Block]]) -> Iterator[Entry]:
    """What stands in `onboard` beside the blocks.

    Args:
        headers: those of `onboard/`.
        blocks: the members of `onboard` that are blocks.

    Raises:
        DeclarationError: a member is neither a scalar, nor a struct of these headers, nor a block, or it is
            an array in an array.
    """
    yield from _members("onboard", Place("", ""), headers, blocks)


def _members(
    struct: str, place: Place, headers: Headers, blocks: Mapping[str, type[Block]]
) -> Iterator[Entry]:
    for member in headers.structs[struct]:
        if member.size and place.size:
            raise DeclarationError(f"{struct}.{member.name} is an array in an array; expected one at most")
        name, size = f"{place.name}{member.name}", member.size or place.size
        c = f"{place.c}{member.name}{'[0]' if member.size else ''}"
        element = c if member.size else place.element
        if (struct, member.name) in INSTEAD:
            yield from INSTEAD[struct, member.name](place, headers)
        elif member.type in SCALARS:
            yield Entry(name, c, SCALARS[member.type], size, element)
        elif member.type in headers.structs:
            inside = place.name if (struct, member.name) in UNNAMED else f"{name}."
            yield from _members(member.type, Place(inside, f"{c}.", size, element), headers, blocks)
        elif member.name not in blocks or blocks[member.name].title() != member.type:
            raise DeclarationError(
                f"{struct}.{member.name} is `{member.type}`; expected a scalar, a struct of onboard/*.h or a "
                "block of the program"
            )


def of_block(member: str, block: type[Block]) -> Iterator[Entry]:
    """What a member of `onboard` that is a block holds."""
    for kind in ("state", "input", "output", "parameter"):
        for variable in block.group(kind):
            if kind != "parameter" or is_mission(variable):
                place = f"{member}.{member_of(variable)}.{variable.name}{'[0]' if variable.size else ''}"
                name = f"{member}.{kind}.{variable.name}"
                yield Entry(name, place, variable.type, variable.size or 0, place)


def words_of(entries: Iterable[Entry]) -> dict[str, Type]:
    """The words of entries by name, in their order, with their types.

    Raises:
        DeclarationError: two words have the same name, so that a reader would count fewer than C writes.
    """
    words: dict[str, Type] = {}
    for entry in entries:
        for word in entry.words:
            if word in words:
                raise DeclarationError(
                    f'record: two words are called "{word}"; expected a name for each; rename a member, or '
                    "take the struct around it out of UNNAMED"
                )
            words[word] = entry.type
    return words


def is_mission(variable: Variable) -> bool:
    """Does a parameter come by radio?"""
    return member_of(variable) == MISSION
