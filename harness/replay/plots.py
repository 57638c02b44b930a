"""The picture of a replay: the receiver's path, and the estimates during outages."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from harness.drawing import BELOW, CIRCLE_EDGE, CIRCLE_FACE, ESTIMATES, GPS, GRID, new_figure, png_of
from harness.files import write_whole
from harness.log.log import Array


def replay_picture(
    path: Path,
    gps: tuple[Array, Array, Array],
    estimates: Sequence[tuple[str, Array, Array, Array]],
    outages: Sequence[tuple[float, float]],
    title: str = "",
) -> None:
    """Write the picture of a replay: the receiver's path, and the estimates during outages.

    Args:
        path: the PNG.
        gps: time [s], north and east [m] of all fixes, the withheld ones too, (f,) each.
        estimates: label, time [s], north and east [m] of each configuration, (n,) each; NaN breaks the line
            between outages.
        outages: start and end [s] of each; they are shaded.
        title: above the picture.

    Raises:
        FileError: the file cannot be written.
    """
    write_whole(path, png_of(replay_figure(gps, estimates, outages, title)))


def replay_figure(
    gps: tuple[Array, Array, Array],
    estimates: Sequence[tuple[str, Array, Array, Array]],
    outages: Sequence[tuple[float, float]],
    title: str = "",
) -> Figure:
    """The figure of `replay_picture`: paths on the left, distance from the GPS over time on the right."""
    figure = new_figure(14, 6.4)
    paths, errors = figure.subplots(1, 2, width_ratios=(1, 1.15))
    time, north, east = gps
    paths.plot(east, north, ".-", color=GPS, markersize=3, linewidth=0.8, label="GPS", zorder=2)
    for number, (start, end) in enumerate(outages):
        during = (time >= start) & (time <= end)
        label = "" if number else "outage"
        paths.plot(
            east[during], north[during], color=CIRCLE_EDGE, alpha=0.45, linewidth=8, label=label, zorder=1
        )
        errors.axvspan(start, end, color=CIRCLE_FACE, label=label, zorder=0)
    for number, (label, at, estimate_north, estimate_east) in enumerate(estimates):
        color = ESTIMATES[number % len(ESTIMATES)]
        paths.plot(estimate_east, estimate_north, color=color, linewidth=1.6, label=label, zorder=3)
        error = np.hypot(
            estimate_north - np.interp(at, time, north), estimate_east - np.interp(at, time, east)
        )
        errors.plot(at, error, color=color, linewidth=1.4, label=label, zorder=3)
    paths.set_aspect("equal", adjustable="datalim")
    paths.set_xlabel("east [m]")
    paths.set_ylabel("north [m]")
    errors.set_xlabel("time [s]")
    errors.set_ylabel("distance from GPS [m]")
    errors.set_xlim(time[0], time[-1])
    errors.set_ylim(bottom=0)
    for axes in (paths, errors):
        axes.grid(**GRID)
    handles, labels = paths.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), **BELOW)
    if title:
        figure.suptitle(title, fontsize=13)
    return figure
