"""Pictures of a trial from its log, in the manner of Figures 4.9-4.13, 5.1 and 5.2.

Colours are the dissertation's, in hues that the colour-blind can tell apart: forward green, stop red, recall
black, no command blue, directional commands cyan, waypoints magenta, their circles yellow. Line widths and
markers tell the commands apart too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from harness.drawing import (
    BELOW,
    BESIDE,
    CIRCLE_EDGE,
    CIRCLE_FACE,
    ESTIMATE,
    GPS,
    GRID,
    MAGENTA,
    TRUTH,
    Style,
    new_figure,
    png_of,
)
from harness.log.log import Array, Log, named
from harness.trial.summary import summarize
from models.cmec import Anomaly
from models.commands import Command

COLOURS = {
    Command.NONE: "#0072B2",
    Command.FORWARD: "#00A06D",
    Command.STOP: "#D62F1F",
    Command.RECALL: "#111111",
    Command.LEFT: "#35C0E8",
    Command.RIGHT: "#35C0E8",
}
WIDTHS = {Command.STOP: 3.6, Command.RECALL: 1.8, Command.NONE: 3.0}  # points; the others 2.6
ANOMALY_MARKERS = "vs^DXPo*"
TRIANGLES = {Command.LEFT: "<", Command.RIGHT: ">"}
ESTIMATE_STYLE: Style = {"label": "estimate", "linewidth": 1.2, "color": ESTIMATE, "linestyle": (0, (4, 1.5))}


def trial_figure(log: Log) -> Figure:
    """The whole trial: its path on the left, speed, deviation and commands over time on the right."""
    figure = new_figure(14, 7.6)
    grid = figure.add_gridspec(3, 2, width_ratios=(1, 1.15), height_ratios=(1, 1, 1.1))
    handles = draw_path(figure.add_subplot(grid[:, 0]), log)
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), **BELOW)
    _draw_over_time(figure, [figure.add_subplot(grid[row, 1]) for row in range(3)], log)
    summary = summarize(log)
    name = summary["scenario"] or log.path.name
    figure.suptitle(
        f"{name}, seed {summary['seed']}: {summary['outcome']} after {summary['time_s']:.1f} s", fontsize=13
    )
    return figure


def trial_png(log: Log) -> bytes:
    """The picture of the trial as a PNG; the same log gives the same bytes."""
    return png_of(trial_figure(log))


def draw_path(axes: Axes, log: Log) -> list[Line2D | Patch]:
    """Draw the path, east to the right, north up; the truth in the colour of the command in force.

    Returns:
        The handles of its legend.
    """
    handles: list[Line2D | Patch] = []
    if log.route:
        *waypoints, (_, home_north, home_east) = log.route.places
        for _, north, east in log.route.places:
            circle: Style = {
                "facecolor": CIRCLE_FACE,
                "edgecolor": CIRCLE_EDGE,
                "linewidth": 1.6,
                "zorder": 1,
            }
            axes.add_patch(Circle((east, north), log.route.radius, **circle))
        for label, north, east in waypoints:
            axes.plot(east, north, "D", color=MAGENTA, markersize=8, zorder=6)
            _label(axes, label.removeprefix("waypoint "), east, north)
        axes.plot(home_east, home_north, "s", color=MAGENTA, markersize=8, zorder=6)
        _label(axes, "home", home_east, home_north)
        handles += [
            Line2D([], [], marker="D", color=MAGENTA, linestyle="", label="waypoint"),
            Line2D([], [], marker="s", color=MAGENTA, linestyle="", label="home"),
            Patch(facecolor=CIRCLE_FACE, edgecolor=CIRCLE_EDGE, label=f"within {log.route.radius:g} m"),
        ]
    if "sensors.gps_fix" in log:
        fixes = log["sensors.gps_fix"] > 0
        style: Style = {"marker": ".", "color": GPS, "markersize": 4, "linestyle": ""}
        axes.plot(log["sensors.gps_east"][fixes], log["sensors.gps_north"][fixes], **style, zorder=3)
        handles.append(Line2D([], [], **style, label="GPS fix"))
    if "estimator.north" in log:
        axes.plot(log["estimator.east"], log["estimator.north"], **ESTIMATE_STYLE, zorder=5)
        handles.append(Line2D([], [], **ESTIMATE_STYLE))
    if "plant.north" in log:
        handles += _draw_commanded_path(axes, log)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    axes.margins(0.06)
    axes.set_xlabel("east [m]")
    axes.set_ylabel("north [m]")
    axes.set_axisbelow(True)
    axes.grid(**GRID)
    return handles


def _draw_commanded_path(axes: Axes, log: Log) -> list[Line2D | Patch]:
    """Draw the true path: stretches in their command's colour, a triangle where a LEFT or RIGHT began."""
    east, north = log["plant.east"], log["plant.north"]
    command = _command(log)
    handles: list[Line2D | Patch] = []
    for code, color in COLOURS.items():
        stretches = [
            np.column_stack([east[first : last + 1], north[first : last + 1]])
            for first, last, value in equal_stretches(command)
            if value == code and last > first
        ]
        if not stretches:
            continue
        width = WIDTHS.get(code, 2.6)
        if code in TRIANGLES:
            starts = np.array([stretch[0] for stretch in stretches])
            marker: Style = {"marker": TRIANGLES[code], "color": color, "markersize": 11, "linestyle": ""}
            edge: Style = {"markeredgecolor": "#0B5F78", "markeredgewidth": 1.0}
            axes.plot(starts[:, 0], starts[:, 1], **marker, **edge, zorder=7)
            handles.append(Line2D([], [], **marker, **edge, label=code.name.lower()))
        else:
            handles.append(Line2D([], [], color=color, linewidth=width, label=_name(code)))
        lines = LineCollection(stretches, colors=color, linewidths=width, capstyle="round", zorder=4)
        lines.set_label(code.name)
        axes.add_collection(lines)
    return handles


def _draw_over_time(figure: Figure, stack: Sequence[Axes], log: Log) -> None:
    draw_speed(stack[0], log)
    draw_deviation(stack[1], log)
    draw_commands(stack[2], log)
    for axes in stack:
        axes.set_xlim(log.time[0], max(log.time[-1], log.time[0] + 1e-3))
        axes.grid(**GRID)
        for time in _reached(log):
            axes.axvline(time, color=MAGENTA, linewidth=1.0, linestyle=":", zorder=1)
    for axes in stack[:-1]:
        axes.sharex(stack[-1])
        axes.tick_params(labelbottom=False)
    stack[-1].set_xlabel("time [s]")
    figure.align_ylabels(list(stack))


def draw_speed(axes: Axes, log: Log) -> None:
    """Draw the speed of the dog, of the GPS fixes and of the estimate, and V'."""
    if "sensors.gps_speed" in log:
        fixes = log["sensors.gps_fix"] > 0
        speed = log["sensors.gps_speed"][fixes]
        axes.plot(log.time[fixes], speed, ".", color=GPS, markersize=4, label="GPS")
    if "plant.speed" in log:
        axes.plot(log.time, log["plant.speed"], color=TRUTH, linewidth=1.4, label="truth")
    if "estimator.speed" in log:
        axes.plot(log.time, log["estimator.speed"], **ESTIMATE_STYLE)
    _threshold(axes, "V'", log.parameter("controller.stopped_speed"), "m/s", both=False)
    axes.set_ylabel("speed [m/s]")
    _legend(axes)


def draw_deviation(axes: Axes, log: Log) -> None:
    """Draw the orientation deviation from the waypoint in degrees, and h' and h'' on both sides."""
    if "controller.deviation" in log:
        deviation = np.degrees(log["controller.deviation"])
        wrapped = np.abs(np.diff(deviation, prepend=deviation[0])) > 180
        axes.plot(log.time, np.where(wrapped, np.nan, deviation), color=TRUTH, linewidth=1.4, label="h")
    for label, name, style in (("h'", "moving_deviation", "--"), ("h''", "stop_deviation", ":")):
        value = log.parameter(f"controller.{name}")
        degrees = None if value is None else float(np.degrees(value))
        _threshold(axes, label, degrees, "deg", both=True, style=style)
    axes.set_ylabel("deviation [deg]")
    axes.set_yticks([-180, -90, 0, 90, 180])
    axes.set_ylim(-190, 190)
    _legend(axes)


def draw_commands(axes: Axes, log: Log) -> None:
    """Draw the commands as steps, and above them a mark for each tick that reported an anomaly."""
    command = _command(log)
    axes.step(log.time, command, where="post", color="#B4BAC1", linewidth=1.0, zorder=2)
    for code, color in COLOURS.items():
        held = [
            [(log.time[first], code), (log.time[last], code)]
            for first, last, value in equal_stretches(command)
            if value == code
        ]
        axes.add_collection(LineCollection(held, colors=color, linewidths=5, zorder=3, label=code.name))
    if "controller.anomaly" in log:
        anomaly = log["controller.anomaly"]
        for code in np.unique(anomaly[anomaly != 0]):
            times = log.time[anomaly == code]
            label = named(Anomaly, code).lower().replace("_", " ")
            marker = ANOMALY_MARKERS[int(code) % len(ANOMALY_MARKERS)]
            axes.plot(times, np.full(times.size, 5.65), marker, color="#8A5A00", markersize=6, label=label)
    for time in _reached(log)[:1]:
        axes.plot([time], [np.nan], color=MAGENTA, linewidth=1.0, linestyle=":", label="waypoint\nreached")
    axes.set_yticks([code.value for code in Command], [code.name.lower() for code in Command])
    axes.set_ylim(-0.6, 6.2)
    axes.set_ylabel("controller output")
    handles, labels = axes.get_legend_handles_labels()
    kept = [(h, t) for h, t in zip(handles, labels, strict=True) if not isinstance(h, LineCollection)]
    if kept:
        axes.legend(*zip(*kept, strict=True), **BESIDE)


def _command(log: Log) -> Array:
    for signal in ("controller.command", "plant.command"):
        if signal in log:
            return log[signal]
    return np.zeros(len(log.time))


def equal_stretches(values: Array) -> list[tuple[int, int, float]]:
    """Stretches of equal values: first tick, first tick of the next (or the last tick), value."""
    starts = [0, *(np.flatnonzero(np.diff(values)) + 1)]
    ends = [*starts[1:], len(values) - 1]
    return [(int(first), int(last), float(values[first])) for first, last in zip(starts, ends, strict=True)]


def _reached(log: Log) -> Array:
    """The times at which waypoints were reached, s."""
    if "controller.waypoint" not in log:
        return np.empty(0)
    times: Array = log.time[1:][np.diff(log["controller.waypoint"]) > 0]
    return times


def _threshold(
    axes: Axes, label: str, value: float | None, unit: str, *, both: bool, style: str = "--"
) -> None:
    if value is None:
        return
    for sign in (1, -1) if both else (1,):
        text = f"{label} = {value:g} {unit}" if sign == 1 else None
        axes.axhline(sign * value, color="#D55E00", linewidth=1.0, linestyle=style, label=text, zorder=1)


def _legend(axes: Axes) -> None:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(**BESIDE)


def _label(axes: Axes, text: str, east: float, north: float) -> None:
    axes.annotate(
        text, (east, north), (8, 8), textcoords="offset points", color=MAGENTA, fontweight="bold", zorder=8
    )


def _name(code: Command) -> str:
    return "no command" if code is Command.NONE else code.name.lower()
