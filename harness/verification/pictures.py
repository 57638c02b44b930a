"""The page's pictures, like the dissertation's Figures 5.1 to 5.8."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter

from harness.drawing import BELOW, BESIDE, GRID, Style, new_figure
from harness.sweep.plots import TYPE_COLOURS
from harness.sweep.trials import TRIAL_TYPES
from harness.terminal import DEVIATION_THRESHOLD, percent
from harness.trial.plots import trial_figure
from harness.verification.published import (
    ALL_FROM,
    ALL_FROM_BY_TREND,
    AT_15_ABOVE,
    FIELD,
    FIELD_LATER,
    R_SQUARED,
    TREND_AT_23,
    Field,
)
from harness.verification.runs import (
    ALL_CAUSES,
    CAUSES,
    DIFFERENT,
    DRAWN,
    Example,
    Size,
    mean_time_error,
    simulate,
)
from harness.verification.tables import TYPES

COLOURS = {"calibrated": "#0072B2", "literal": "#D55E00", "field": "#6A51A3"}
HATCHES = {"calibrated": "", "literal": "//", "field": ".."}
THEIRS, FIELD_COLOUR = "#C2338F", "#111111"
INTERVAL: Style = {"alpha": 0.18, "linewidth": 0}
INTERVAL_LABEL, FIELD_LABEL = "95 % intervals", "field, 95 % interval"
THE_TEXT = "dissertation:"
IGNORED: Style = {"facecolor": "#F5E9D3", "edgecolor": "#B98A3A", "hatch": "..."}
WIDTH = 10.5  # in
ABSCISSA = f"{DEVIATION_THRESHOLD} [deg]"
SUCCESS_RATE, MEAN_TIME = "success rate", "mean time of successful trials [s]"


def two_figure(size: Size) -> Figure:
    """Figure 5.3."""
    figure, success, _ = _curves("two", "15:90", size.curve)
    style: Style = {"color": THEIRS, "linestyle": "", "zorder": 6}
    success.plot([], [], label=THE_TEXT, **style)
    success.plot([15], [AT_15_ABOVE], marker="^", markersize=9, label="above 85 % at 15 deg", **style)
    success.plot([23], [TREND_AT_23], marker="D", markersize=6, label="95 % at 23 deg (trend)", **style)
    success.plot([ALL_FROM, 90], [1, 1], color=THEIRS, alpha=0.3, linewidth=6, label="100 % from 23 deg on")
    label = f"by trend from 26 deg on;\n$R^2$ = {percent(R_SQUARED['two'])}"
    success.plot([ALL_FROM_BY_TREND], [1], marker="|", markersize=16, markeredgewidth=2, label=label, **style)
    success.legend(**BESIDE)
    figure.suptitle("Two waypoints, as Figure 5.3: ours, and the dissertation's statements")
    return figure


def three_figure(size: Size) -> Figure:
    """Figure 5.5, with the field trials of Figure 5.8 and of Table 4.4."""
    figure, success, time = _curves("three", "15:65", size.curve)
    for field in FIELD:
        if field.waypoints == "three":
            _draw_field(success, field.threshold, field)
    success.plot([], [], linestyle="", label=f"dissertation: $R^2$ = {percent(R_SQUARED['three'])}")
    success.legend(**BESIDE)
    success.set_ylim(0, 1)
    time.set_ylim(28, 42)
    time.text(20.3, 41.5, "literal, 15 to 19 deg: off the scale (see the text)", va="top", fontsize=9)
    figure.suptitle("Three waypoints, as Figure 5.5: ours in each reading, and the field trials")
    return figure


def _curves(target: str, thresholds: str, trials: int) -> tuple[Figure, Axes, Axes]:
    """Success rate above, mean time below, over h', in each reading that differs."""
    figure = new_figure(WIDTH, 7.5)
    success, time = figure.subplots(2, 1, sharex=True, height_ratios=(1.4, 1))
    for reading in DIFFERENT[target]:
        colour = COLOURS[reading]
        simulated = simulate(target, thresholds, trials, reading)
        x, table = simulated.thresholds, simulated.table
        low, high = np.array([point.interval for point in table]).T
        success.fill_between(x, low, high, color=colour, **INTERVAL)
        success.plot(x, simulated.rates, "o", color=colour, markersize=3.5, label=f"ours, {reading}")
        line, r_squared = simulated.trend
        fine = np.linspace(x[0], x[-1], 400)
        label = f"trend, $R^2$ = {percent(r_squared)}"
        success.plot(fine, line(fine), color=colour, linewidth=1.2, linestyle=(0, (5, 2)), label=label)
        mean = np.array([point.mean_time or np.nan for point in table])
        error = np.array([mean_time_error(point) for point in table])
        time.fill_between(x, mean - error, mean + error, color=colour, **INTERVAL)
        time.plot(x, mean, "o-", color=colour, markersize=3.5, linewidth=1.0, label=f"ours, {reading}")
    _percents(success)
    time.set_ylabel(MEAN_TIME)
    time.set_xlabel(ABSCISSA)
    time.set_xlim(x[0] - 1, x[-1] + 1)
    for axes in (success, time):
        axes.fill_between([], [], color=FIELD_COLOUR, label=INTERVAL_LABEL, **INTERVAL)
    time.legend(**BESIDE)
    for axes in (success, time):
        axes.grid(**GRID)
        axes.set_axisbelow(True)
    figure.align_ylabels([success, time])
    return figure, success, time


def _percents(axes: Axes) -> None:
    axes.yaxis.set_major_formatter(FuncFormatter(lambda rate, _: f"{100 * rate:.4g} %"))
    axes.set_ylabel(SUCCESS_RATE)


def _draw_field(axes: Axes, x: float, field: Field) -> None:
    """Draw a field rate with its interval, and its count beside it."""
    rate, (low, high) = field.successes / field.trials, field.interval
    label = "" if FIELD_LABEL in axes.get_legend_handles_labels()[1] else FIELD_LABEL
    axes.errorbar(
        x, rate, [[rate - low], [high - rate]], color=FIELD_COLOUR, marker="s", markersize=6, capsize=4,
        linestyle="", zorder=5, label=label,
    )  # fmt: skip
    axes.annotate(
        f"{field.successes}/{field.trials}", (x, rate), (8, -3), textcoords="offset points", va="top",
        zorder=7,
        path_effects=[withStroke(linewidth=2.5, foreground="white")],
    )  # fmt: skip


def two_field_figure(size: Size) -> Figure:
    """Figures 5.6 and 5.7."""
    figure = new_figure(WIDTH, 5)
    success, time = figure.subplots(1, 2)
    thresholds = np.array([23.0, 30.0, 37.0])
    for shift, reading in zip((-0.7, 0.7), DIFFERENT["two"], strict=True):
        colour = COLOURS[reading]
        table = simulate("two", "23:37:7", size.rate, reading).table
        rates = [point.success_rate for point in table]
        success.plot(thresholds + shift, rates, "o", color=colour, markersize=8, label=f"ours, {reading}")
        means = np.array([point.mean_time for point in table], dtype=float)
        time.plot(thresholds, means, "o-", color=colour, markersize=8, label=f"ours, {reading}")
        if reading == "calibrated":
            low, high = FIELD_LATER
            label = "field: 3 to 3.5 s above\nsimulated (on calibrated)"
            time.fill_between(
                thresholds, means + low, means + high, color=FIELD_COLOUR, alpha=0.2, label=label
            )
    for cause, marker in (("search for the bumper, 1 to 5 s", "v"), (ALL_CAUSES, "^")):
        table = simulate("two", "23:37:7", size.rate, settings=CAUSES[cause]).table
        means = np.array([point.mean_time for point in table], dtype=float)
        label = "calibrated, all causes" if cause == ALL_CAUSES else "calibrated, search for the bumper"
        time.plot(thresholds, means, marker, color="#009E73", markersize=8, label=label)
    for field in FIELD[:3]:
        _draw_field(success, field.threshold, field)
    success.plot(thresholds, [1, 1, 1], "_", color=THEIRS, markersize=22, markeredgewidth=3,
                 label="dissertation's simulation")  # fmt: skip
    ring: Style = {"markerfacecolor": "none", "markersize": 11, "markeredgewidth": 2}  # round the field's
    success.plot([23], [TREND_AT_23], "D", color=THEIRS, label="dissertation's trend", zorder=6, **ring)
    _percents(success)
    time.set_ylabel(MEAN_TIME)
    for axes in (success, time):
        axes.set_xticks(thresholds)
        axes.set_xlim(20, 40)
        axes.set_xlabel(ABSCISSA)
        axes.grid(**GRID)
        axes.set_axisbelow(True)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2, **BELOW)
    figure.suptitle("Two waypoints against the field, as Figures 5.6 and 5.7")
    return figure


def three_field_figure(size: Size) -> Figure:
    """Figure 5.8, and beside it each type of trial, which the figure does not show."""
    figure = new_figure(WIDTH, 5)
    whole, types = figure.subplots(1, 2, sharey=True, width_ratios=(1, 1.6))
    names = list(TRIAL_TYPES["three"])
    for shift, (reading, colour) in zip((-0.27, 0.0, 0.27), COLOURS.items(), strict=True):
        simulated = simulate("three", "37:49:12", size.rate, reading)
        whole.plot(
            np.arange(2) + shift, simulated.rates, "o", color=colour, markersize=8, label=f"ours, {reading}"
        )
        point = simulated.at(49)
        rates = [point.rate_of(name) or 0.0 for name in names]
        hatch = HATCHES[reading]
        types.bar(np.arange(4) + shift, rates, 0.25, color=TYPE_COLOURS, alpha=0.85 if not hatch else 0.4,
                  hatch=hatch, edgecolor="white")  # fmt: skip
        for x, rate in zip(np.arange(4) + shift, rates, strict=True):
            types.text(x, rate + 0.01, f"{100 * rate:.0f} %", ha="center", fontsize=9)
    drawn = simulate("three", "37:49:12", size.rate, "field", DRAWN).rates
    colour, label = COLOURS["field"], "ours, field, dog table_5_1"
    whole.plot(np.arange(2) + 0.27, drawn, "^", color=colour, markersize=8, label=label)
    for x, field in enumerate(field for field in FIELD if field.waypoints == "three"):
        _draw_field(whole, x, field)
    whole.set_xticks([0, 1], ["37\nfield not structured", "49\nfield structured"])
    whole.set_xlim(-0.6, 1.6)
    types.set_xticks(np.arange(4), TYPES)
    types.set_title("by type at h' = 49 deg; full: calibrated, hatched: literal, dotted: field", fontsize=10)
    types.set_xlabel("type of trial (turn and its angle [deg])")
    whole.set_xlabel(ABSCISSA)
    _percents(whole)
    whole.set_ylim(0, 1.03)
    for axes in (whole, types):
        axes.grid(**GRID)
        axes.set_axisbelow(True)
    whole.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, **BELOW)
    figure.suptitle("Three waypoints against the field, as Figure 5.8")
    return figure


def example_figure(example: Example) -> Figure:
    """Figures 5.1 and 5.2."""
    title = f"right_90, seed {example.seed}, as Figures 5.1 and 5.2: a right command is ignored"
    ignored = (IGNORED, [(example.commanded, example.silenced)])
    return trial_figure(example.log, title, {"right command ignored": ignored})
