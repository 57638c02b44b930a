"""A comparison of two logs as it is printed."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape

from harness.files import in_words
from harness.log.compare import LogComparison
from harness.terminal import new_table, print_table
from models.errors import printable

SIDES = ("a", "b")


def show(comparison: LogComparison, console: Console) -> None:
    """Print what differs, and whether the logs agree."""

    def line(text: str) -> None:
        console.print(printable(text), soft_wrap=True, markup=False, highlight=False)

    if first := comparison.first:
        others = first.signals - 1
        more = f", and {others} more signal{'s' * (others > 1)}" if others else ""
        unit = f" {first.unit}" if first.unit else ""
        line(f"first difference: tick {first.tick}, {first.time_s:g} s, {first.signal}{more}")
        line(f"  A {first.a!s}{unit}")
        line(f"  B {first.b!s}{unit}")
    others = False
    for side in SIDES:
        others |= bool(comparison.rows_of_one[side] or comparison.signals_of_one[side])
        if rows := comparison.rows_of_one[side]:
            line(f"rows that only {side.upper()} has: {rows.rows}, from {rows.from_s:g} to {rows.to_s:g} s")
        if signals := comparison.signals_of_one[side]:
            line(f"signals that only {side.upper()} has: {', '.join(signals)}")
    if comparison.signals:
        _show_signals(comparison, console)
    if comparison.statements:
        _show_statements(comparison, console)
    only_stated = not (comparison.agree or comparison.signals or others)
    verdict = "agree" if comparison.agree else "differ"
    hint = "; --values-only compares the rows alone" * only_stated
    line(f"{comparison.a} and {comparison.b} {verdict}: {sentence(comparison)}{hint}")


def sentence(comparison: LogComparison) -> str:
    """In how much the logs differ."""
    until = "" if comparison.until_s is None else f" up to {comparison.until_s:g} s"
    differing = f"{len(comparison.signals)} of {comparison.signals_compared} signals differ"
    return f"{differing} in {comparison.rows} rows{until}"


def _show_signals(comparison: LogComparison, console: Console) -> None:
    table = new_table()
    table.add_column("signal")
    for heading in ("unit", "rows", "not finite", "largest", "at tick", "at s", "mean", "tolerance"):
        table.add_column(heading, justify="left" if heading == "unit" else "right")
    for signal in comparison.signals:
        table.add_row(
            escape(printable(signal.signal)),
            escape(printable(signal.unit)),
            str(signal.rows),
            str(signal.not_finite or ""),
            _number(signal.max),
            str(signal.tick),
            f"{signal.time_s:g}",
            _number(signal.mean),
            "bits" if signal.tolerance is None else f"{signal.tolerance:g}",
        )
    print_table(table, console)


def _show_statements(comparison: LogComparison, console: Console) -> None:
    table = new_table("stated differently", "A", "B")
    for statement in comparison.statements:
        cells = (statement.name, in_words(statement.a), in_words(statement.b))
        table.add_row(*(escape(printable(cell)) for cell in cells))
    print_table(table, console)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
