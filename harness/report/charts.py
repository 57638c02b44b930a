"""The page of a study, a fit or a tuning: its pictures as charts that answer, and the tables it printed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from matplotlib.figure import Figure
from rich.console import Console

from harness.report.figures import MOST_POINTS, charts_of, legend_of, title_of
from harness.report.page import render
from harness.report.tables import printed


def charts_page(
    title: str, sentence: str, figures: Mapping[str, Figure], show: Callable[[Console], None]
) -> bytes:
    """The page as UTF-8.

    Args:
        title: of the page; `sentence` stands below it.
        figures: by the names of their pictures, without `.png`.
        show: prints the tables.

    Raises:
        TypeError: a figure draws what no chart has.
    """
    drawn: list[dict[str, Any]] = [
        {"title": own if own != title else "", "legend": legend_of(figure), "grids": charts_of(figure)}
        for own, figure in ((title_of(figure), figure) for figure in figures.values())
    ]
    marks = [mark for figure in drawn for grid in figure["grids"] for c in grid for mark in c["marks"]]
    return render(
        "charts.html.jinja",
        title,
        {"figures": drawn},
        ("charts.js",),
        styles=("series.css", "charts.css"),
        maps=False,
        sentence=sentence,
        pictures=", ".join(f"{name}.png" for name in figures),
        thinned=MOST_POINTS if any(mark.get("thinned") for mark in marks) else None,
        printed=printed(show),
    )
