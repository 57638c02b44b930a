"""What a command prints, for a page: its tables whole, and the lines between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rich.console import Console

from harness.terminal import UNLIMITED


@dataclass(frozen=True)
class PrintedTable:
    """A table as it was printed.

    Attributes:
        heads: the columns' headings; a line break stands where one was printed.
        numeric: the columns that are justified to the right.
        rows: the cells' texts.
    """

    heads: tuple[str, ...]
    numeric: tuple[bool, ...]
    rows: tuple[tuple[str, ...], ...]


Printed = PrintedTable | str  # str: lines of words


def printed(show: Callable[[Console], None]) -> list[Printed]:
    """All that a function prints on a console, in its order."""
    console = _Recorder()
    show(console)
    return [part for part in console.parts if part]


class _Recorder(Console):
    """A console that keeps what it is given, and shows nothing."""

    def __init__(self) -> None:
        super().__init__(width=UNLIMITED, color_system=None, quiet=True)
        self.parts: list[Printed] = []

    def print(self, *objects: Any, sep: str = " ", markup: bool | None = None, **how: Any) -> None:
        if len(objects) == 1 and hasattr(objects[0], "columns"):
            self.parts.append(self._table(objects[0]))
            return
        text = sep.join(map(str, objects))
        self.parts.append((text if markup is False else self._plain(text)).strip())

    def _table(self, table: Any) -> PrintedTable:
        return PrintedTable(
            tuple(self._plain(column.header) for column in table.columns),
            tuple(column.justify == "right" for column in table.columns),
            tuple(zip(*([self._plain(cell) for cell in c.cells] for c in table.columns), strict=True)),
        )

    def _plain(self, marked: object) -> str:
        return self.render_str(str(marked)).plain
