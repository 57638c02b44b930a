"""Pictures of a trial from its log, in the manner of Figures 4.9-4.13, 5.1 and 5.2.

Colours are the dissertation's, in hues that the colour-blind can tell apart: forward green, stop red, recall
black, no command blue, directional commands cyan, waypoints magenta, their circles yellow. Line widths,
beads and markers tell the commands apart too. What disturbed the trial is shaded over time and on the path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from types import MappingProxyType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Circle, Patch, Polygon
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D, Bbox

from harness.drawing import (
    ABOVE,
    CIRCLE_EDGE,
    CIRCLE_FACE,
    ESTIMATE,
    FAULTS,
    GPS,
    GRID,
    LOST_RADIO,
    MAGENTA,
    ORDER,
    OUTAGE,
    TRUTH,
    Style,
    add_legend,
    add_scale_bar,
    band_handle,
    drawable,
    freeze_layout,
    house_style,
    new_figure,
    png_of,
    set_title,
    shade,
)
from harness.log.arrived import arrived, receiver
from harness.log.channel import Array
from harness.log.log import Log, named
from harness.terminal import DEVIATION_THRESHOLD
from harness.trial import disturbances as kinds
from harness.trial.disturbances import Span, disturbances
from harness.trial.labels import place_labels
from harness.trial.summary import position_error, summarize
from models.commands import Command
from models.kit.timing import TICK
from models.modes import Anomaly
from models.system import ESTIMATOR

COLOURS = {
    Command.NONE: "#0072B2",
    Command.FORWARD: "#00A06D",
    Command.STOP: "#D62F1F",
    Command.RECALL: "#111111",
    Command.LEFT: "#35C0E8",
    Command.RIGHT: "#35C0E8",
}
WIDTHS = {Command.STOP: 4.2, Command.RECALL: 1.8, Command.NONE: 3.0}  # points; the others 2.6
DASHES = {Command.STOP: (0, (0.01, 1.25))}  # beads; the others are solid
TRIANGLES = {Command.LEFT: "<", Command.RIGHT: ">"}
TRIANGLE_EDGE: Style = {"markeredgecolor": "#0B5F78", "markeredgewidth": 1.0}
ANOMALY_MARKERS = "vs^DXPo*"
ANOMALY: Style = {
    "linestyle": "", "color": "#8A5A00", "markerfacecolor": "none", "markeredgewidth": 1.7, "clip_on": False,
    "path_effects": [withStroke(linewidth=3.2, foreground="white")], "zorder": 8,
}  # fmt: skip
MANY = 24  # markers of a kind from which they shrink
TRUTH_STYLE: Style = {"label": "truth", "linewidth": 1.6, "color": TRUTH, "zorder": 4}
ESTIMATE_STYLE: Style = {"label": "estimate", "linewidth": 0.9, "color": ESTIMATE, "alpha": 0.55, "zorder": 2}
ON_MAP = ESTIMATE_STYLE | {"linewidth": 1.3, "alpha": 0.8}
PLACE: Style = {
    "color": MAGENTA,
    "markersize": 7,
    "markeredgecolor": "white",
    "markeredgewidth": 0.8,
}
FENCE: Style = {"fill": False, "edgecolor": "#B3261E", "linewidth": 1.4, "linestyle": "--", "zorder": 1}
STREET: Style = {"facecolor": "#DDE3EA", "edgecolor": "none", "zorder": 0.5}
POLE: Style = {
    "marker": "^", "linestyle": "", "color": "#7A4B00", "markersize": 8, "markeredgecolor": "white",
    "markeredgewidth": 0.8,
}  # fmt: skip
FIX_STYLE: Style = {"label": "GPS fix", "marker": ".", "color": GPS, "markersize": 4, "linestyle": ""}
BANDS = {kinds.GPS_OUTAGE: OUTAGE, kinds.ORDER: ORDER, kinds.LOST_RADIO: LOST_RADIO}
NOTHING: Mapping[str, tuple[Style, Sequence[Span]]] = MappingProxyType({})
FAULT_TRAIL = ("#C88CF8", 11.0)  # of any fault
TRAILS = {  # along the path: colour, and points wide
    kinds.GPS_OUTAGE: ("#C3C9D1", 26.0),
    kinds.ORDER: ("#9CC7EA", 21.0),
    kinds.LOST_RADIO: ("#F8BA8B", 16.0),
}
MOST_ROOM = 0.5  # of the truth's extent on each side of a map, for an estimate that is off
MOST_CHANGES = 150  # of the command, from which the lines between commands get thinner
LEAST_VIEW = 10.0  # m, so that an animal that stands still is no magnified point
ARROW = [(-0.05, 0), (0.05, 0), (0.05, 0.5), (0.22, 0.5), (0, 1), (-0.22, 0.5), (-0.05, 0.5), (-0.05, 0)]
ARROW_LENGTH = 26.0  # points


def trial_figure(
    log: Log, title: str = "", more: Mapping[str, tuple[Style, Sequence[Span]]] = NOTHING
) -> Figure:
    """The whole trial: its path on the left, speed, deviation and commands over time on the right.

    Args:
        title: instead of the trial's name and outcome.
        more: further bands over time, by label: style, from and until [s].
    """
    figure = new_figure(11, 7.4)
    grid = figure.add_gridspec(3, 2, width_ratios=(1, 1.1), height_ratios=(1, 1, 1.15))
    path = figure.add_subplot(grid[:, 0])
    disturbed = disturbances(log)
    handles = _draw_path(path, log, disturbed)
    bands = _bands(disturbed) | dict(more)
    _draw_over_time(figure, [figure.add_subplot(grid[row, 1]) for row in range(3)], log, bands)
    handles += [band_handle(label, style) for label, (style, _) in bands.items()]
    add_legend(figure, handles)
    set_title(figure, title or _title(log))
    freeze_layout(figure)
    _draw_names(path, log)
    add_scale_bar(path)
    return figure


def _bands(disturbed: Mapping[str, Sequence[Span]]) -> dict[str, tuple[Style, Sequence[Span]]]:
    """How each kind of disturbance is drawn over time, and when; faults take their styles in turns."""
    styles = cycle(FAULTS)
    return {kind: (BANDS.get(kind) or next(styles), spans) for kind, spans in disturbed.items()}


def _title(log: Log) -> str:
    summary = summarize(log)
    name, seed = (drawable(str(text)) for text in (summary["scenario"] or log.path.name, summary["seed"]))
    time = f"{summary['time_s']:.1f}" if summary["time_s"] >= 1 else f"{summary['time_s']:g}"
    special = summary["estimator"] not in (None, ESTIMATOR)
    by = f", {drawable(summary['estimator'])}" if special else ""
    why = f": {summary['stopped_by']}" if summary["stopped_by"] else ""
    return f"{name}, seed {seed}{by}: {summary['outcome']} after {time} s{why}"


@house_style()
def trial_png(log: Log) -> bytes:
    """The picture of the trial as a PNG; the same log gives the same bytes."""
    return png_of(trial_figure(log))


def _draw_path(axes: Axes, log: Log, disturbed: Mapping[str, Sequence[Span]]) -> list[Line2D | Patch]:
    """Draw the path, east to the right, north up; the truth in the colour of the command in force.

    Returns:
        The handles of its legend.
    """
    handles: list[Line2D | Patch] = []
    if log.ground:
        for outline in log.ground.outlines():
            axes.add_patch(Polygon([(east, north) for north, east in outline], **STREET))
        if log.ground.streets:
            handles.append(Patch(label="street", **STREET))
        for north, east in log.ground.poles:
            axes.plot(east, north, zorder=7, **POLE)
        if log.ground.poles:
            handles.append(Line2D([], [], label="pole", **POLE))
    if log.route:
        *waypoints, (_, home_north, home_east) = log.route.places
        for _, north, east in log.route.places:
            circle: Style = {
                "facecolor": CIRCLE_FACE,
                "edgecolor": CIRCLE_EDGE,
                "linewidth": 1.4,
                "zorder": 1,
            }
            axes.add_patch(Circle((east, north), log.route.radius, **circle))
        for _, north, east in waypoints:
            axes.plot(east, north, "D", zorder=7.5, **PLACE)
        axes.plot(home_east, home_north, "s", zorder=7.5, **PLACE)
        handles += [
            Line2D([], [], marker="D", linestyle="", label="waypoint", **PLACE),
            Line2D([], [], marker="s", linestyle="", label="home", **PLACE),
            Patch(facecolor=CIRCLE_FACE, edgecolor=CIRCLE_EDGE, label=f"within {log.route.radius:g} m"),
        ]
        if log.route.fence:
            axes.add_patch(Polygon([(east, north) for north, east in log.route.fence], **FENCE))
            handles.append(Patch(label="fence", **FENCE))
    gps = receiver(log.channels, log.metadata)
    if f"{gps}.gps_fix" in log:
        fixes = log[f"{gps}.gps_fix"] > 0
        axes.plot(log[f"{gps}.gps_east"][fixes], log[f"{gps}.gps_north"][fixes], **FIX_STYLE, zorder=3)
        handles.append(Line2D([], [], **FIX_STYLE))
    if "estimator.north" in log:
        handles.append(Line2D([], [], **ON_MAP))
    if "plant.north" in log:
        _draw_trails(axes, log, disturbed)
        handles += _draw_commanded_path(axes, log)
        handles += _draw_start(axes, log)
        _draw_anomalies(axes, log, log["plant.east"], log["plant.north"])
    _draw_estimated_path(axes, log)
    _set_view(axes)
    axes.set_title("true path, in the colour of the command", loc="left", fontsize=10)
    axes.set_xlabel("east [m]")
    axes.set_ylabel("north [m]")
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.set_axisbelow(True)
    axes.grid(**GRID)
    return handles


def _draw_estimated_path(axes: Axes, log: Log) -> None:
    """Draw the estimate under the truth; one that runs away leaves the map, and a note says so."""
    if "estimator.north" not in log:
        return
    east, north = log["estimator.east"], log["estimator.north"]
    axes.autoscale_view()
    truth = axes.dataLim.frozen()
    axes.plot(east, north, **ON_MAP)
    if not np.isfinite(truth.extents).all():
        return
    room = MOST_ROOM * max(truth.width, truth.height, LEAST_VIEW)
    view = truth.padded(room)
    outside = (east < view.x0) | (east > view.x1) | (north < view.y0) | (north > view.y1)
    if outside.any():
        axes.dataLim = Bbox.intersection(axes.dataLim, view) or truth
        error = position_error(log)
        far = "" if error is None else f": up to {np.nanmax(error):.0f} m off"
        _note(axes, f"the estimate leaves the map{far}")


def _note(axes: Axes, text: str) -> None:
    """Say in a corner what the panel leaves out."""
    style: Style = {"color": TRUTH, "path_effects": [withStroke(linewidth=2.5, foreground="white")]}
    axes.text(0.02, 0.98, text, transform=axes.transAxes, va="top", zorder=9, **style)


def _set_view(axes: Axes) -> None:
    """Both axes in one scale, with all that is drawn and at least `LEAST_VIEW`."""
    x, y = (axes.dataLim.x0 + axes.dataLim.x1) / 2, (axes.dataLim.y0 + axes.dataLim.y1) / 2
    if np.isfinite([x, y]).all():
        half = LEAST_VIEW / 2
        axes.update_datalim([(x - half, y - half), (x + half, y + half)])
    axes.set_aspect("equal", adjustable="datalim")
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(9, steps=[1, 2, 5, 10]))
    axes.margins(0.08)
    axes.autoscale_view()


def _draw_trails(axes: Axes, log: Log, disturbed: Mapping[str, Sequence[Span]]) -> None:
    """Lay what disturbed the trial under the path, as broad as its kind, so that all of several show."""
    place = np.column_stack([log["plant.east"], log["plant.north"]])
    for kind, spans in disturbed.items():
        color, width = TRAILS.get(kind, FAULT_TRAIL)
        during = [place[(log.time >= start) & (log.time <= end)] for start, end in spans]
        during = [trail for trail in during if len(trail)]
        if not during:  # between two ticks
            continue
        trails = LineCollection(
            during, colors=color, linewidths=width, capstyle="round", zorder=1.5, label=kind
        )
        axes.add_collection(trails)
        begin = np.array([trail[0] for trail in during])  # shows where the animal stood
        dot: Style = {"color": color, "markersize": width, "markeredgewidth": 0, "linestyle": ""}
        axes.plot(begin[:, 0], begin[:, 1], "o", zorder=1.5, **dot)


def _draw_start(axes: Axes, log: Log) -> list[Line2D | Patch]:
    """Draw an arrow where the animal begins, as it looks; a dot if the plant tells no heading."""
    style: Style = {"linestyle": "", "color": TRUTH, "markeredgecolor": "white", "markeredgewidth": 0.8}
    heading = _start_heading(log)
    if heading is None:
        here: Style = {"marker": "o", "markersize": 10}
        entry = Line2D([], [], label="start", **here, **style)
    else:
        turned = Affine2D().rotate(-heading)
        # a marker's path is scaled to reach half its size from the centre
        here = {"marker": MarkerStyle(Path(ARROW), transform=turned), "markersize": 2 * ARROW_LENGTH}
        upright = Path([(x, y - 0.5) for x, y in ARROW])
        entry = Line2D([], [], label="start, looking ahead", marker=upright, markersize=16, **style)
    axes.plot(log["plant.east"][0], log["plant.north"][0], label="start", zorder=5.5, **here, **style)
    return [entry]


def _start_heading(log: Log) -> float | None:
    """Where the animal looks at first, rad; None if the plant does not tell."""
    heading = log["plant.heading"][0] if "plant.heading" in log else np.nan
    return float(heading) if np.isfinite(heading) else None


def _draw_names(axes: Axes, log: Log) -> None:
    """Number the waypoints, off the paths."""
    if not log.route:
        return
    places = [(label.removeprefix("waypoint "), east, north) for label, north, east in log.route.places]
    lines = [
        np.column_stack([log[f"{component}.east"], log[f"{component}.north"]])
        for component in ("plant", "estimator")
        if f"{component}.north" in log
    ]
    place_labels(axes, places, lines, _marked(axes, log), MAGENTA)


def _marked(axes: Axes, log: Log) -> Array:
    """Centres of the markers on the path, (n, 2): east, north; several along the arrow of the start."""
    points = [np.asarray(line.get_xydata()) for line in axes.lines if line.get_marker() != "None"]
    heading = _start_heading(log) if "plant.north" in log else None
    if heading is not None:
        begin = axes.transData.transform((log["plant.east"][0], log["plant.north"][0]))
        ahead = np.array([np.sin(heading), np.cos(heading)]) * axes.figure.get_dpi() / 72
        along = begin + np.linspace(0, ARROW_LENGTH, 5)[:, np.newaxis] * ahead
        points.append(axes.transData.inverted().transform(along))
    return np.concatenate(points) if points else np.empty((0, 2))


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
        line: Style = {"linewidth": WIDTHS.get(code, 2.6), "linestyle": DASHES.get(code, "-")}
        if code in TRIANGLES:
            starts = np.array([stretch[0] for stretch in stretches])
            marker: Style = {"marker": TRIANGLES[code], "color": color, "linestyle": ""}
            marker["markersize"] = _size(11, len(starts))
            axes.plot(starts[:, 0], starts[:, 1], **marker, **TRIANGLE_EDGE, zorder=7)
            handles.append(Line2D([], [], **marker, **TRIANGLE_EDGE, label=code.name.lower()))
        else:
            handles.append(Line2D([], [], color=color, dash_capstyle="round", label=_name(code), **line))
        lines = LineCollection(stretches, colors=color, capstyle="round", zorder=4, **line)
        lines.set_label(code.name)
        axes.add_collection(lines)
    return handles


def _draw_over_time(
    figure: Figure, stack: Sequence[Axes], log: Log, bands: Mapping[str, tuple[Style, Sequence[Span]]]
) -> None:
    draw_speed(stack[0], log)
    draw_deviation(stack[1], log)
    draw_commands(stack[2], log)
    for axes in stack:
        axes.set_xlim(log.time[0], max(log.time[-1], log.time[0] + TICK))
        axes.set_axisbelow(True)
        axes.grid(**GRID)
        for style, spans in bands.values():
            shade(axes, spans, style)
        for time in _reached(log):
            axes.axvline(time, color=MAGENTA, linewidth=1.0, linestyle=":", zorder=1)
    for axes in stack[:-1]:
        axes.sharex(stack[-1])
        axes.tick_params(labelbottom=False)
    stack[-1].set_xlabel("time [s]")
    figure.align_ylabels(list(stack))


def draw_speed(axes: Axes, log: Log) -> None:
    """Draw the speed of the dog over that of the GPS fixes and of the estimate, and V'."""
    signals = arrived(log.channels, log.metadata)
    if "gps_speed" in signals:
        fixes = log[signals["gps_fix"]] > 0
        axes.plot(log.time[fixes], log[signals["gps_speed"]][fixes], **FIX_STYLE, zorder=3)
    if "plant.speed" in log:
        axes.plot(log.time, log["plant.speed"], **TRUTH_STYLE)
    _threshold(axes, "V'", log.parameter("controller.stopped_speed"), "m/s", both=False)
    if "estimator.speed" in log:
        _draw_estimated_speed(axes, log)
    axes.set_ylabel("speed [m/s]")
    _legend(axes)


def _draw_estimated_speed(axes: Axes, log: Log) -> None:
    """Draw the estimate under the truth; one that runs away leaves the panel, and a note says so."""
    truth = axes.dataLim.frozen()
    speed = log["estimator.speed"]
    axes.plot(log.time, speed, **ESTIMATE_STYLE)
    if not np.isfinite(truth.extents).all():
        return
    room = max(truth.height, 1.0)
    low, high = truth.y0 - room, truth.y1 + room
    furthest = speed[np.nanargmax(np.maximum(speed - high, low - speed))] if np.isfinite(speed).any() else 0.0
    if not low <= furthest <= high:
        axes.dataLim = Bbox.intersection(axes.dataLim, Bbox([(truth.x0, low), (truth.x1, high)])) or truth
        _note(axes, f"the estimate leaves the panel: {furthest:.4g} m/s")


def draw_deviation(axes: Axes, log: Log) -> None:
    """Draw the orientation deviation from the waypoint in degrees, and h' and h'' on both sides."""
    if "controller.deviation" in log:
        deviation = np.degrees(log["controller.deviation"])
        wrapped = np.abs(np.diff(deviation, prepend=deviation[0])) > 180
        axes.plot(log.time, np.where(wrapped, np.nan, deviation), **TRUTH_STYLE | {"label": "h"})
    for label, name, style in (
        (DEVIATION_THRESHOLD, "moving_deviation", "--"),
        ("h''", "stop_deviation", ":"),
    ):
        value = log.parameter(f"controller.{name}")
        degrees = None if value is None else float(np.degrees(value))
        _threshold(axes, label, degrees, "deg", both=True, style=style)
    axes.set_ylabel("deviation h [deg]")
    axes.set_yticks([-180, -90, 0, 90, 180])
    axes.set_ylim(-190, 190)
    _legend(axes)


def draw_commands(axes: Axes, log: Log) -> None:
    """Draw the commands as steps, the operator's round them, and above a mark for each anomaly reported."""
    command = _command(log)
    changes = int(np.count_nonzero(np.diff(command)))
    style: Style = {"color": "#B4BAC1", "linewidth": float(np.clip(MOST_CHANGES / (changes + 1), 0.1, 1.0))}
    axes.step(log.time, command, where="post", zorder=2, **style)
    for code, color in COLOURS.items():
        held = [
            [(log.time[first], code), (log.time[last], code)]
            for first, last, value in equal_stretches(command)
            if value == code
        ]
        axes.add_collection(LineCollection(held, colors=color, linewidths=5, zorder=3, label=code.name))
    if "controller.override" in log:
        ordered = [
            [(log.time[first], value), (log.time[last], value)]
            for first, last, value in equal_stretches(log["controller.override"])
            if value != Command.NONE
        ]
        around: Style = {"color": ORDER["edgecolor"], "linewidths": 10, "zorder": 2.5, "label": kinds.ORDER}
        axes.add_collection(LineCollection(ordered, **around), autolim=False)
    _draw_anomalies(axes, log, log.time, np.full(len(log.time), 5.65))
    for time in _reached(log)[:1]:
        axes.plot([time], [np.nan], color=MAGENTA, linewidth=1.0, linestyle=":", label="waypoint reached")
    axes.set_yticks([code.value for code in Command], [code.name.lower() for code in Command])
    axes.set_ylim(-0.6, 6.2)
    axes.set_ylabel("command")
    _legend(axes, columns=3)


def _draw_anomalies(axes: Axes, log: Log, x: Array, y: Array) -> None:
    """Mark the ticks that reported an anomaly at x and y, (ticks,) each; every kind has its marker."""
    if "controller.anomaly" not in log:
        return
    anomaly = log["controller.anomaly"]
    for code in np.unique(anomaly[np.isfinite(anomaly) & (anomaly != 0)]):
        on = anomaly == code
        marker = ANOMALY_MARKERS[int(code) % len(ANOMALY_MARKERS)]
        label = named(Anomaly, code).lower().replace("_", " ")
        axes.plot(x[on], y[on], marker=marker, label=label, markersize=_size(10, on.sum()), **ANOMALY)


def _size(points: float, count: int) -> float:
    """The size of a marker, points: smaller the more there are."""
    return float(points * np.clip(np.sqrt(MANY / count), 0.4, 1.0))


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
        text = f"{label} = {value:.4g} {unit}" if sign == 1 else None
        axes.axhline(sign * value, color="#D55E00", linewidth=1.0, linestyle=style, label=text, zorder=1.8)


def _legend(axes: Axes, columns: int = 4) -> None:
    """Name the curves above the panel; the colours of commands have their names on the axis."""
    handles, labels = axes.get_legend_handles_labels()
    kept = [(h, t) for h, t in zip(handles, labels, strict=True) if not isinstance(h, LineCollection)]
    if kept:
        axes.legend(*zip(*kept, strict=True), ncols=min(len(kept), columns), **ABOVE)


def _name(code: Command) -> str:
    return "no command" if code is Command.NONE else code.name.lower()
