"""A mutant: one small change of one source file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Mutant:
    """One change of a file.

    Attributes:
        file: relative to the root of the project.
        number: of the line, from 1.
        was, becomes: the changed lines, without indentation.
        text: the whole file with the change.
    """

    file: str
    number: int
    was: str
    becomes: str
    text: str

    @property
    def key(self) -> tuple[str, str, str]:
        """What tells it from others, wherever its line stands."""
        return self.file, self.was, self.becomes

    def __str__(self) -> str:
        return f"{self.file}:{self.number}\n    - {self.was}\n    + {self.becomes}"


def changed(file: str, source: str, start: int, end: int, new: str) -> Mutant:
    """The mutant in which source[start:end] is `new`."""
    return compared(file, source, source[:start] + new + source[end:])


def compared(file: str, source: str, text: str) -> Mutant:
    """The mutant whose whole text is given."""
    before, after = source.split("\n"), text.split("\n")
    first = next((i for i, (a, b) in enumerate(zip(before, after, strict=False)) if a != b), 0)
    same = 0  # lines at the end
    while same < min(len(before), len(after)) - first and before[-1 - same] == after[-1 - same]:
        same += 1
    return Mutant(
        file,
        first + 1,
        _joined(before[first : len(before) - same]),
        _joined(after[first : len(after) - same]),
        text,
    )


def distinct(mutants: Iterable[Mutant]) -> list[Mutant]:
    """Each text once, by line; not that which is as before."""
    different = {mutant.text: mutant for mutant in mutants if mutant.was != mutant.becomes}
    return sorted(different.values(), key=lambda m: (m.number, m.becomes))


def _joined(lines: list[str]) -> str:
    return " ".join(" ".join(lines).split())
