"""The picture of a day: success, fatigue and habituation by mission, a curve for each controller and rest."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator

from harness.day.missions import Curve, Result
from harness.drawing import ESTIMATES, GRID, add_legend, drawable, new_figure, set_title

DASHES: tuple[Any, ...] = ("-", "--", ":", "-.")  # by rest, in turns
SIGNS = "osD^v"  # by controller, in turns; colours, too


def day_figure(result: Result) -> Figure:
    """Three panels over the missions: success with its interval, and the dog's state at the start."""
    asked = result.planned.asked
    figure = new_figure(11, 9)
    success, *states = figure.subplots(3, 1, sharex=True, height_ratios=(1.6, 1, 1))
    handles = []
    for curve in result.curves:
        style = _style(curve, result)
        _draw(success, curve, "success_rate", style, interval=True)
        for axes, key in zip(states, ("mean_fatigue", "mean_habituation"), strict=True):
            _draw(axes, curve, key, style)
        label = drawable(f"{curve.controller}, rest {curve.rest:g} s")
        handles.append(Line2D([], [], label=label, **style))
    success.yaxis.set_major_formatter(FuncFormatter(lambda rate, _: f"{100 * rate:.4g} %"))
    for axes, label in zip(
        (success, *states),
        ("success rate, with 95 % intervals", "fatigue at the start", "habituation at the start"),
        strict=True,
    ):
        axes.set_ylabel(label)
        axes.grid(**GRID)
        axes.set_axisbelow(True)
    for axes in (success, *states):
        axes.set_ylim(bottom=0)
    states[-1].set_xlabel("mission of the day")
    states[-1].set_xlim(0.5, asked.missions + 0.5)
    states[-1].xaxis.set_major_locator(MaxNLocator(12, integer=True))
    figure.align_ylabels([success, *states])
    add_legend(figure, handles)
    set_title(
        figure,
        drawable(
            f"{result.planned.scenario.name}: {asked.days} days of {asked.missions} missions; assumed laws"
        ),
    )
    return figure


def _style(curve: Curve, result: Result) -> dict[str, Any]:
    asked = result.planned.asked
    controller = list(asked.controllers).index(curve.controller)
    rest = list(asked.rests).index(curve.rest)
    return {
        "color": ESTIMATES[controller % len(ESTIMATES)],
        "marker": SIGNS[controller % len(SIGNS)],
        "markersize": 4,
        "linewidth": 1.3,
        "linestyle": DASHES[rest % len(DASHES)],
    }


def _draw(axes: Any, curve: Curve, key: str, style: dict[str, Any], *, interval: bool = False) -> None:
    mission = np.arange(1, len(curve.rows) + 1)
    values = np.array([row[key] for row in curve.rows])
    axes.plot(mission, values, **style)
    if interval:
        low, high = (np.array([row[name] for row in curve.rows]) for name in ("ci_low", "ci_high"))
        axes.vlines(mission, low, high, color=style["color"], linewidth=1)
