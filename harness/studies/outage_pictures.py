"""The pictures of the study of outages: mean errors of all configurations, and a trial over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from harness.drawing import (
    ABOVE,
    BELOW,
    ESTIMATES,
    GPS,
    GRID,
    OUTAGE,
    TRUTH,
    new_figure,
    shade,
)  # fmt: skip

DETECTION = "detection"  # the gait of the text's tables
FILTERS, TEXT = ESTIMATES[0], ESTIMATES[1]
GROUP_COLORS = (GPS, ESTIMATES[4])
SAMPLE_COLORS = (ESTIMATES[1], ESTIMATES[0], ESTIMATES[2], ESTIMATES[4])


def figure_of_means(
    sets: Mapping[str, Mapping[str, Any]],
    published: Mapping[str, Mapping[str, Any]],
    groups: Mapping[str, Sequence[str]],
) -> Figure:
    """For each set and gait a panel: mean position errors with their confidence, and the text's.

    Args:
        groups: configurations with a colour of their own, by what the legend calls them.
    """
    panels = [(s, g, values["configurations"]) for s, gaits in sets.items() for g, values in gaits.items()]
    titles = list(panels[0][2])
    colors = {t: c for c, members in zip(GROUP_COLORS, groups.values(), strict=True) for t in members}
    columns = len(panels) // len(sets)
    figure = new_figure(13, 1.2 + len(sets) * (0.5 + 0.22 * len(titles)))
    grid = figure.subplots(len(sets), columns, squeeze=False, sharex=True, sharey=True)
    for axes, (set_name, gait, configurations) in zip(grid.flat, panels, strict=True):
        for place, title in enumerate(titles):
            error = configurations[title]["position_error_m"]
            axes.barh(place, error["mean"], color=colors.get(title, FILTERS), alpha=0.8, height=0.66)
            axes.plot([error["mean_low"], error["mean_high"]], [place, place], color=TRUTH, linewidth=1.6)
            if title in published and gait == DETECTION:  # the text's gait
                axes.plot(published[title]["position"], place, "D", color=TEXT, markersize=6, zorder=3)
        axes.set_title(f"set {set_name}, {gait}", fontsize=11)
        axes.set_yticks(range(len(titles)), titles, fontsize=9)
        axes.set_xscale("log")
        axes.tick_params(labelbottom=True)
        axes.grid(axis="x", **GRID)
        axes.set_axisbelow(True)
    grid[0, 0].invert_yaxis()
    for axes in grid[-1]:
        axes.set_xlabel("mean position error at the end [m]")
    shown = {"filters of the text, and 6.2's": FILTERS, **dict(zip(groups, GROUP_COLORS, strict=True))}
    handles: list[Artist] = [
        *(Patch(color=color, alpha=0.8, label=label) for label, color in shown.items()),
        Line2D([], [], color=TRUTH, linewidth=1.6, label="95 % interval of the mean"),
    ]
    if any(gait == DETECTION for _, gait, _ in panels):
        label = "the dissertation's mean"
        handles.append(Line2D([], [], color=TEXT, marker="D", linestyle="", label=label))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=10, **BELOW)
    return figure


def figure_of_trial(sample: Mapping[str, Any], outage: float, title: str) -> Figure:
    """A trial as in Figures 3.6 to 3.8: map, position error, speed, bias.

    Args:
        outage: its length [s], at the end.
    """
    figure = new_figure(13, 7)
    axes = figure.subplot_mosaic([["map", "error"], ["map", "speed"], ["map", "bias"]], width_ratios=[1, 1.2])
    time = np.array(sample["time_s"])
    begin = time[-1] - outage
    chart: Axes = axes["map"]
    truth, gps, during = sample["truth"], sample["gps"], time >= begin
    chart.plot(gps["east"], gps["north"], ".", color=GPS, markersize=4, label="GPS")
    chart.plot(truth["east"], truth["north"], color=TRUTH, linewidth=1.2, label="truth")
    for (name, estimate), color in zip(sample["estimates"].items(), SAMPLE_COLORS, strict=True):
        style: dict[str, Any] = {"color": color, "linewidth": 1.2}
        chart.plot(
            np.array(estimate["east"])[during], np.array(estimate["north"])[during], label=name, **style
        )
        axes["error"].plot(time, estimate["position_error_m"], **style)
        axes["speed"].plot(time, estimate["speed"], **style)
        axes["bias"].plot(time, estimate["accel_bias"], **style)
    axes["speed"].plot(time, truth["speed"], color=TRUTH, linewidth=1.2)
    for name, label in (("error", "position error [m]"), ("speed", "speed [m/s]"), ("bias", "bias [m/s2]")):
        axes[name].set_ylabel(label)
        axes[name].set_xlim(0, time[-1])
        shade(axes[name], [(begin, time[-1])], OUTAGE)
        axes[name].grid(**GRID)
    axes["error"].set_title(f"{title}; without GPS in the last {outage:g} s", fontsize=11)
    axes["bias"].set_xlabel("time [s]")
    chart.set(xlabel="east [m]", ylabel="north [m]")
    chart.set_aspect("equal", adjustable="datalim")
    chart.grid(**GRID)
    chart.legend(fontsize=9, ncols=3, **ABOVE)
    return figure
