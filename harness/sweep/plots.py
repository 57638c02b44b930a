"""Pictures of a sweep, like Figures 5.3 and 5.5: success rate and mean time over the varied parameters."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.polynomial import Polynomial

from harness.drawing import BELOW, BESIDE, FAILURE, GRID, Style, drawable, house_style, new_figure, png_of
from harness.log.channel import Array
from harness.sweep.recommend import LEAST
from harness.sweep.table import Z_95, Point, plain

Varied = tuple[str, Sequence[Decimal]]  # label with unit, values
SUCCESS, TIME, TREND, BEST, FRONTS = "#0072B2", "#7B3FB5", "#111111", "#00A06D", "#D7263D"
TYPE_COLOURS = ("#D55E00", "#E69F00", "#009E73", "#CC79A7")
# The text does not define its trend lines. A polynomial of this degree, cut at 100 %, has the R2 of its
# two-waypoint trials (89.1 %); the R2 of its three-waypoint trials (95.4 %) is that of a straight line.
DEGREE = 4
FEW = 10  # values up to which each gets a tick of its axis
FRONT = "Pareto front"
NO_TIME = "#E3E6EA"
TITLE = 130  # characters in a line of the title
RINGS: dict[str, Any] = {
    "linestyle": "none", "marker": "o", "markersize": 9, "markerfacecolor": "none", "markeredgecolor": FRONTS,
    "markeredgewidth": 1.5, "clip_on": False, "path_effects": [withStroke(linewidth=3, foreground="white")],
}  # fmt: skip
FAULTY: dict[str, Any] = {
    "linestyle": "none", "marker": "X", "markersize": 9, "color": FAILURE, "markeredgecolor": "white",
    "zorder": 4, "clip_on": False,
}  # fmt: skip
STAR: dict[str, Any] = {
    "linestyle": "none", "marker": "*", "color": "white", "markeredgecolor": "black", "markersize": 15,
    "clip_on": False,
}  # fmt: skip
OUTLINE: dict[str, Any] = {
    "snap": False,
    "color": "white",
    "linewidth": 2.5,
    "path_effects": [withStroke(linewidth=4, foreground="black")],
}
DASHES: dict[str, Any] = {"color": "#00D68F", "linewidth": 2.0, "linestyle": (0, (3, 1.5))}


@house_style()
def sweep_png(axes: Sequence[Varied], table: Sequence[Point], result: Mapping[str, Any], title: str) -> bytes:
    """The picture of a sweep over one or two parameters as a PNG.

    Args:
        axes: label with unit, and values of each varied parameter.
        table: a row for each point.
        result: as `recommend` returns it.
    """
    return png_of(sweep_figure(axes, table, result, title))


def sweep_figure(
    axes: Sequence[Varied], table: Sequence[Point], result: Mapping[str, Any], title: str
) -> Figure:
    """The figure of `sweep_png`: curves over one parameter, maps over two."""
    figure = _curves(axes[0], table, result) if len(axes) == 1 else _maps(axes, table, result)
    figure.suptitle(textwrap.fill(drawable(title, 3 * TITLE), TITLE), fontsize=11)
    return figure


def trend(x: Array, rate: Array) -> tuple[Callable[[Array], Array], float] | None:
    """The least-squares polynomial through success rates, cut at 0 and 1, and its R2.

    None if there are too few points, or if all rates are equal.
    """
    if len(x) < DEGREE + 2 or np.ptp(rate) == 0.0:  # not by the variance: it may exceed 0 by rounding
        return None
    spread = float(np.sum((rate - rate.mean()) ** 2))
    fitted = Polynomial.fit(x, rate, DEGREE)

    def line(at: Array) -> Array:
        rates: Array = np.clip(fitted(at), 0.0, 1.0)
        return rates

    return line, 1 - float(np.sum((rate - line(x)) ** 2)) / spread


def _curves(varied: Varied, table: Sequence[Point], result: Mapping[str, Any]) -> Figure:
    """Success rate above, mean time below, over one parameter."""
    label, values = varied
    x = np.array([float(value) for value in values])
    figure = new_figure(12, 8)
    success, time = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1))
    _draw_success(success, x, table)
    _draw_time(time, x, table)
    for axes, ordinate in ((success, "success_rate"), (time, "mean_time_s")):
        front = [(_place(point, 1), point[ordinate]) for point in result["pareto"]["points"]]
        if front:
            axes.plot([x for (x,), _ in front], [y for _, y in front], label=FRONT, zorder=3, **RINGS)
    for axes, key, words in (
        (success, "success", "best for success"),
        (time, "time", "shortest time"),
        (time, "both", "fastest of the best for success"),
    ):
        _draw_range(axes, x, result[key], words, hatch="///" if key == "both" else "")
        axes.grid(**GRID)
        axes.set_axisbelow(True)
        axes.legend(**BESIDE)
    time.set_xlabel(label)
    time.set_xlim(x[0] - (len(x) == 1), x[-1] + (len(x) == 1))
    _set_ticks(time.xaxis, values)
    figure.align_ylabels([success, time])
    return figure


def _draw_success(axes: Axes, x: Array, table: Sequence[Point]) -> None:
    """Success rates with their intervals, the trend, and a curve for each type of trial."""
    rate = np.array([point.success_rate for point in table])
    low, high = np.array([point.interval for point in table]).T
    axes.fill_between(x, low, high, color=SUCCESS, alpha=0.18, linewidth=0, label="95 % interval (Wilson)")
    axes.plot(x, rate, "o-", color=SUCCESS, markersize=3.5, linewidth=1.2, label="success rate")
    fitted = trend(x, rate)
    if fitted is not None:
        line, r_squared = fitted
        fine = np.linspace(x[0], x[-1], 400)
        label = f"trend (degree {DEGREE}),\n$R^2$ = {100 * r_squared:.1f} %"
        axes.plot(fine, line(fine), color=TREND, linewidth=1.2, linestyle=(0, (5, 2)), label=label)
    ended = np.array([bool(point.fmu_failures) for point in table])
    if ended.any():
        axes.plot(x[ended], rate[ended], label="trials ended by\nfaults of an FMU", **FAULTY)
    drawn = [low.min(), high.max()]
    for color, trial_type in zip(TYPE_COLOURS, table[0].trial_types, strict=False):
        own = _numbers([point.rate_of(trial_type) for point in table])
        axes.plot(x, own, color=color, linewidth=1.1, label=trial_type.replace("_", " "))
        drawn += [np.nanmin(own), np.nanmax(own)] if np.isfinite(own).any() else []
    margin = 0.05 * (max(drawn) - min(drawn)) + 0.005
    axes.set_ylim(max(-0.02, min(drawn) - margin), min(1.02, max(drawn) + margin))
    axes.yaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda rate, _: f"{100 * rate:.4g} %"))
    axes.set_ylabel("success rate")


def _draw_time(axes: Axes, x: Array, table: Sequence[Point]) -> None:
    """Mean time of the successful trials with its interval."""
    mean = _numbers([point.mean_time for point in table])
    error = _numbers([None if p.sd_time is None else Z_95 * p.sd_time / p.successes**0.5 for p in table])
    axes.fill_between(
        x, mean - error, mean + error, color=TIME, alpha=0.18, linewidth=0, label="95 % interval"
    )
    axes.plot(
        x, mean, "o-", color=TIME, markersize=3.5, linewidth=1.2, label="mean time of\nsuccessful trials"
    )
    axes.set_ylabel("time [s]")
    if not np.isfinite(mean).any():
        axes.set_yticks([])
        axes.text(0.5, 0.5, "no trial succeeded", transform=axes.transAxes, ha="center", va="center")


def _draw_range(axes: Axes, x: Array, recommended: Mapping[str, Any], words: str, hatch: str) -> None:
    """Shade the recommended values."""
    if not _is_shown(recommended):
        return
    half = 0.5 * float(np.diff(x).mean()) if len(x) > 1 else 0.5
    style: dict[str, Any] = {"facecolor": BEST, "alpha": 0.12, "linewidth": 0}
    if hatch:
        style = {"facecolor": "none", "edgecolor": BEST, "alpha": 0.5, "hatch": hatch, "linewidth": 0}
    named = np.isin(x, [float(value) for value in recommended["points"]])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], named, [False]])))
    for first, after in edges.reshape(-1, 2):
        axes.axvspan(x[first] - half, x[after - 1] + half, zorder=0, label=words, **style)
        words = ""  # one entry in the legend


def _maps(axes: Sequence[Varied], table: Sequence[Point], result: Mapping[str, Any]) -> Figure:
    """Maps of success rate and mean time over two parameters; the best cells outlined, the front ringed."""
    (label, values), (other_label, others) = axes
    x, y = (np.array([float(v) for v in written]) for written in (values, others))
    figure = new_figure(14, 7)
    rate = _numbers([point.success_rate for point in table])
    time = _numbers([point.mean_time if point.successes >= LEAST else None for point in table])
    front = [_place(point, 2) for point in result["pareto"]["points"]]
    scales: tuple[Style, Style] = ({"cmap": "cividis", "vmin": 0, "vmax": 100}, {"cmap": "plasma_r"})
    for panel, numbers, key, scale, words in zip(
        figure.subplots(1, 2, sharey=True),
        (100 * rate, time),
        ("success", "time"),
        scales,
        ("success rate [%]", "mean time of successful trials [s]"),
        strict=True,
    ):
        field = numbers.reshape(len(x), len(y)).T
        mesh = panel.pcolormesh(_edges(x), _edges(y), field, **scale)
        figure.colorbar(mesh, ax=panel, label=words, pad=0.02)
        panel.set_facecolor(NO_TIME)
        legend: list[Line2D | Patch] = []
        for best_for, style, named in (
            (key, OUTLINE, {"success": "best for success", "time": "shortest time"}[key]),
            ("both", DASHES, "fastest of the best for success"),
        ):
            if not _is_shown(result[best_for]):
                legend.append(Line2D([], [], linestyle="none", label=f"{named}: no optimum shown"))
                continue
            named_points = {tuple(map(float, place)) for place in result[best_for]["points"]}
            mask = np.array([[(float(v), float(w)) in named_points for v in values] for w in others])
            _outline(panel, _edges(x), _edges(y), mask, style)
            legend.append(Line2D([], [], label=named, **style))
        if _is_shown(result[key]):
            panel.plot(*_place(result[key]["best"], 2), **STAR)
            legend.append(Line2D([], [], label="did best", **STAR))
        if front:
            panel.plot(
                [x for x, _ in front], [y for _, y in front], label=FRONT, **RINGS | {"markersize": 19}
            )
            legend.append(Line2D([], [], label=FRONT, **RINGS))
        else:
            legend.append(Line2D([], [], linestyle="none", label=f"{FRONT}: empty"))
        ended = [np.array(point.written, dtype=float) for point in table if point.fmu_failures]
        if ended:
            panel.plot(*np.array(ended).T, **FAULTY)
            legend.append(Line2D([], [], label="trials ended by faults of an FMU", **FAULTY))
        if np.isnan(numbers).any():
            legend.append(Patch(facecolor=NO_TIME, edgecolor=TREND, label=f"fewer than {LEAST} successes"))
        panel.set_xlabel(label)
        _set_ticks(panel.xaxis, values)
        _set_ticks(panel.yaxis, others)
        panel.set_title(words.partition(" [")[0])
        place: Any = f"outside lower {'left' if key == 'success' else 'right'}"
        figure.legend(handles=legend, loc=place, ncols=2, title=panel.get_title(), **BELOW)
    figure.axes[0].set_ylabel(other_label)
    return figure


def _is_shown(recommended: Mapping[str, Any]) -> bool:
    """Whether some points are shown to be better than others."""
    return "points" in recommended and not recommended["flat"]


def _place(point: Mapping[str, Any], axes: int) -> tuple[float, ...]:
    """A recommended point's varied parameters, which are the first values of its row."""
    return tuple(map(float, list(point.values())[:axes]))


def _set_ticks(axis: Axis, values: Sequence[Decimal]) -> None:
    """A tick for each value if they are few, such as a switch's two; else ticks at round numbers."""
    if len(values) <= FEW:
        axis.set_ticks([float(value) for value in values], [plain(value) for value in values])
    else:
        axis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10]))


def _outline(axes: Axes, x: Array, y: Array, mask: Any, style: Mapping[str, Any]) -> None:
    """Draw the border of a mask's cells (y, x); x and y are the edges of the cells."""
    padded = np.pad(mask, 1)
    upright = zip(*np.nonzero(padded[:, 1:] != padded[:, :-1]), strict=True)
    level = zip(*np.nonzero(padded[1:, :] != padded[:-1, :]), strict=True)
    lines = [[(x[column], y[row - 1]), (x[column], y[row])] for row, column in upright]
    lines += [[(x[column - 1], y[row]), (x[column], y[row])] for row, column in level]
    axes.add_collection(LineCollection(lines, clip_on=False, **style), autolim=False)


def _edges(centres: Array) -> Array:
    """The edges of the cells around values in equal steps."""
    half = 0.5 * (centres[1] - centres[0]) if len(centres) > 1 else 0.5
    edges: Array = np.append(centres - half, centres[-1] + half)
    return edges


def _numbers(values: Sequence[float | None]) -> Array:
    """An array with NaN for None."""
    return np.array([np.nan if value is None else value for value in values], dtype=float)
