"""The picture of a matrix: a panel for each scenario, in it a square for each controller with each plant."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from harness.drawing import FAILURE, drawable, house_style, new_figure, png_of
from harness.sweep.matrix import Result
from harness.terminal import percent

CELL, SIDE, ABOVE = (2.3, 1.25), 2.2, 1.5  # in: of a square, of what stands beside and above a panel
NONE, DARK = "#E3E6EA", 0.55  # no trials; a success rate below which text is white
LONGEST = 22  # columns of a name
NO_BREAK = "\u00a0"  # a title is broken behind commas only


@house_style()
def matrix_png(result: Result) -> bytes:
    """The picture as a PNG."""
    return png_of(matrix_figure(result))


def matrix_figure(result: Result) -> Figure:
    """Success rates as colours, with intervals, times, commands and failures of FMUs in words."""
    matrix = result.matrix
    scenarios = [scenario.name for scenario in matrix.scenarios]
    across = min(len(scenarios), max(1, 6 // len(matrix.plants)))
    down = math.ceil(len(scenarios) / across)
    width = across * (SIDE + CELL[0] * len(matrix.plants)) + 1.2
    height = down * (ABOVE + CELL[1] * len(matrix.controllers)) + 0.6
    figure = new_figure(max(width, 7.5), height)
    panels = figure.subplots(down, across, squeeze=False).ravel()
    for panel in panels[len(scenarios) :]:
        panel.axis("off")
    for panel, scenario in zip(panels, scenarios, strict=False):
        _draw(panel, result, scenario)
    mesh = panels[0].images[0]
    bar = figure.colorbar(mesh, ax=list(panels), pad=0.02, shrink=0.8)
    bar.set_label("success rate [%]")
    title = drawable(matrix.about, 300).replace(" ", NO_BREAK).replace(f",{NO_BREAK}", ", ")
    figure.suptitle(textwrap.fill(title, max(40, int(width * 9))), fontsize=11)
    return figure


def _draw(panel: Axes, result: Result, scenario: str) -> None:
    controllers, plants = result.matrix.controllers, result.matrix.plants
    rates = np.full((len(controllers), len(plants)), np.nan)
    for row, controller in enumerate(controllers):
        for column, plant in enumerate(plants):
            point = result.table.get((controller, plant, scenario))
            if point is not None:
                rates[row, column] = point.success_rate
    panel.set_facecolor(NONE)
    panel.imshow(100 * rates, cmap="cividis", vmin=0, vmax=100, aspect="auto")
    for row, controller in enumerate(controllers):
        for column, plant in enumerate(plants):
            _write(panel, result, (controller, plant, scenario), column, row)
    panel.set_xticks(range(len(plants)), _names(plants))
    panel.set_yticks(range(len(controllers)), _names(controllers))
    panel.tick_params(length=0)
    panel.set_xlabel("plant")
    panel.set_ylabel("controller")
    panel.set_title(drawable(scenario))
    for edge in ("top", "right", "bottom", "left"):
        panel.spines[edge].set_visible(False)
    panel.set_xticks(np.arange(len(plants) + 1) - 0.5, minor=True)
    panel.set_yticks(np.arange(len(controllers) + 1) - 0.5, minor=True)
    panel.grid(which="minor", color="white", linewidth=2)
    panel.tick_params(which="minor", length=0)


def _write(panel: Axes, result: Result, name: tuple[str, str, str], column: int, row: int) -> None:
    """What stands in a square."""
    point = result.table.get(name)
    if point is None:
        _mark(panel, column, row)
        panel.text(
            column, row, "not run:\nsee matrix.json", ha="center", va="center", fontsize=9, color=FAILURE
        )
        return
    color = "white" if point.success_rate < DARK else "black"
    low, high = point.interval
    panel.text(
        column, row - 0.17, percent(point.success_rate), ha="center", va="center", fontsize=14,
        fontweight="bold", color=color,
    )  # fmt: skip
    lines = [f"{100 * low:.1f} to {100 * high:.1f} %"]
    if point.mean_time is not None:
        lines.append(f"{point.mean_time:.1f} s, {point.mean_commands:.1f} commands")
    panel.text(column, row + 0.13, "\n".join(lines), ha="center", va="center", fontsize=9, color=color)
    if point.fmu_failures:
        _mark(panel, column, row)
        gave_up = ", given up" if point.gave_up else ""
        words = f"{len(point.fmu_failures)} of {point.trials} by a fault{gave_up}"
        panel.text(
            column, row + 0.38, words, ha="center", va="center", fontsize=8,
            color="white", bbox={"facecolor": FAILURE, "edgecolor": "none", "pad": 1.5},
        )  # fmt: skip


def _mark(panel: Axes, column: int, row: int) -> None:
    """A red border: an FMU spoiled trials of this square."""
    panel.add_patch(
        Rectangle((column - 0.47, row - 0.47), 0.94, 0.94, fill=False, edgecolor=FAILURE, linewidth=2)
    )


def _names(names: Sequence[str]) -> list[str]:
    """Names as labels: of a path its file; both ends of paths whose files share a name."""
    files = [Path(name).name for name in names]
    unique = [name if files.count(file) > 1 else file for name, file in zip(names, files, strict=True)]
    return [textwrap.fill(drawable(name, 3 * LONGEST), LONGEST) for name in unique]
