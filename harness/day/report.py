"""The results of a day: table, day.csv, day.json, day.png, and day.html, a page that needs no other file."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from harness.day.missions import Result
from harness.day.picture import day_figure
from harness.drawing import house_style, png_of
from harness.files import replaced, write_set
from harness.report.charts import charts_page
from harness.terminal import new_table, percent, print_table

if TYPE_CHECKING:
    from rich.console import Console

CSV, PICTURE, PAGE, REPORT = "day.csv", "day.png", "day.html", "day.json"


def default_folder(result: Result) -> Path:
    """The folder of the results by default."""
    return Path("out") / f"day-{result.planned.scenario.name}"


def facts(result: Result) -> dict[str, Any]:
    """The content of day.json."""
    return {
        **result.planned.identity,
        "notes": result.planned.notes,
        "curves": [row for curve in result.curves for row in curve.rows],
    }


@house_style()
def write(result: Result, folder: Path, note: Callable[[str], None] = lambda text: None) -> None:
    """Write the files, which are never beside some of other days.

    Args:
        note: called with a line for the user if they replace those of other days.

    Raises:
        UsageError: the folder cannot be made or written into.
        FileError: a file cannot be written.
    """
    text = json.dumps(facts(result), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    figure = day_figure(result)
    title = f"A day of {result.planned.scenario.name}"
    page = charts_page(title, about(result), {"day": figure}, lambda console: show(result, console))
    if others := replaced(folder / REPORT, result.planned.identity):
        note(f"{folder}: has the results of another day, which these replace ({others})")
    write_set(folder, {CSV: _csv(result), PICTURE: png_of(figure), PAGE: page, REPORT: text.encode()})


def about(result: Result) -> str:
    """What was run, in words."""
    planned = result.planned
    asked, scenario = planned.asked, planned.scenario
    return (
        f"{scenario.name}: {asked.missions} missions in a row, {asked.days} days from seed {scenario.seed} "
        f"on, {scenario.system}, {scenario.reading}; fatigue and habituation by assumed laws"
    )


def _csv(result: Result) -> bytes:
    """The content of day.csv: a row for each controller, rest and mission."""
    rows = [row for curve in result.curves for row in curve.rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def show(result: Result, console: Console) -> None:
    """Print a row for each controller, rest and mission, and what the results rest on."""
    table = new_table("controller")
    headings = ("rest [s]", "mission", "success", "95 % interval", "fatigue", "habituation", "time [s]")
    for heading in headings:
        table.add_column(escape(heading), justify="right")
    for row in (row for curve in result.curves for row in curve.rows):
        table.add_row(
            row["controller"],
            f"{row['rest_s']:g}",
            str(row["mission"]),
            percent(row["success_rate"]),
            f"{100 * row['ci_low']:.1f}-{100 * row['ci_high']:.1f}",
            f"{row['mean_fatigue']:.3f}",
            f"{row['mean_habituation']:.3f}",
            "-" if row["mean_time_s"] is None else f"{row['mean_time_s']:.1f}",
        )
    print_table(table, console)
    for key, ending in (("timeouts", "cut when their time was up"), ("stopped", "stopped on the way")):
        if count := sum(row[key] for curve in result.curves for row in curve.rows):
            console.print(f"{count} of {result.planned.total} missions were {ending}", soft_wrap=True)
    for line in result.planned.notes:
        console.print(f"note: {line}", style="dim", soft_wrap=True, markup=False)
