"""What commands print: consoles, rates, and tables of which nothing is ever cut.

A pipe or a file gets lines as long as they are. On a terminal too narrow for a table, headings and texts wrap
at words; where that is not enough, whole columns are left out from the right, and a note names them.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from rich.cells import cell_len

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Column, Table

DEVIATION_THRESHOLD = "deviation threshold h'"  # what a reader calls cmec.moving_deviation
UNLIMITED = 1 << 16  # columns of a pipe or a file


def console_of(*, stderr: bool = False) -> Console:
    """Standard output or standard error: as wide as the terminal, or unlimited in a pipe or a file."""
    from rich.console import Console  # noqa: PLC0415 - commands that print plain lines need no rich

    stream = sys.stderr if stderr else sys.stdout
    return Console(stderr=stderr, width=None if stream.isatty() else UNLIMITED)


def percent(rate: float) -> str:
    """A rate with one digit after the point; never rounds to 0 or 100 % unless exact."""
    text = f"{100 * rate:.1f}"
    if 0 < rate < 1 and text in ("0.0", "100.0"):
        return "< 0.1 %" if rate < 0.5 else "> 99.9 %"
    return f"{text} %"


def new_table(*columns: str | Column, header: bool = True, gap: int = 2) -> Table:
    """An empty table in the style of all tables; its cells are texts, in which [ marks a style (rich).

    Args:
        gap: spaces between columns.
    """
    from rich.table import Table  # noqa: PLC0415 - as above

    return Table(*columns, box=None, padding=(0, gap, 0, 0), header_style="bold", show_header=header)


def print_table(table: Table, console: Console) -> None:
    """Print a table so that no cell or heading is cut; a note names the columns that find no room."""
    left_out = _fit(table, console)
    console.print(table)
    if left_out:
        text = f"note: no room for {', '.join(left_out)}; widen the terminal, or send the output to a file"
        console.print(text, style="dim", markup=False)


def _fit(table: Table, console: Console) -> list[str]:
    """Set the columns' widths, and leave columns out from the right; the headings of those left out."""
    sizes = [_sizes(column, table.show_header, console) for column in table.columns]
    gap, count = table.padding[1], len(sizes)
    while count > 1 and sum(least + gap for least, _ in sizes[:count]) > console.width:
        count -= 1
    room = console.width - gap * count
    widths = [full for _, full in sizes[:count]]
    while sum(widths) > room:
        slack, widest = max((widths[i] - sizes[i][0], i) for i in range(count))
        if slack <= 0:  # a single column, wider than the terminal: its words are folded
            widths = [room]
            break
        widths[widest] -= 1
    left_out = table.columns[count:]
    table.columns = table.columns[:count]
    for column, width in zip(table.columns, widths, strict=True):
        column.width, column.no_wrap, column.overflow = width, False, "fold"
    return [" ".join(_plain(column.header, console).split()) for column in left_out]


def _sizes(column: Column, header: bool, console: Console) -> tuple[int, int]:
    """The width below which a column would be cut, and its full width.

    Headings wrap at words, and so do texts. Numbers, in columns that are justified to the right, and columns
    with `no_wrap` do not.
    """
    heading = _plain(column.header, console) if header else ""
    cells = [_plain(cell, console) for cell in column.cells]
    wraps = column.justify == "left" and not column.no_wrap
    parts = [heading.split(), *(cell.split() if wraps else cell.split("\n") for cell in cells)]
    lines = [text.split("\n") for text in (heading, *cells)]
    least, full = (
        max((cell_len(part) for some in each for part in some), default=0) for each in (parts, lines)
    )
    return least, full


def _plain(cell: object, console: Console) -> str:
    """A cell's text without its styles."""
    return console.render_str(str(cell)).plain
