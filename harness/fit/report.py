"""The results of a fit: a table, a picture, parameters for a scenario, and fit.json."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from rich.console import Console
from rich.markup import escape
from scipy import stats

from harness.drawing import BELOW, ESTIMATES, GRID, TRUTH, house_style, new_figure, png_of
from harness.files import replaced, write_set
from harness.fit.estimate import reasons, rounded, settled
from harness.log.channel import Array
from harness.report.charts import charts_page
from harness.terminal import new_table, print_table

FOLDER = Path("out/fit")
ABOUT = "The statistics of Table 5.1, estimated from trials"
BEYOND = "beyond what the model takes: it stays as the model has it"
IDENTITY = ("logs", "sources", "plants", "turned_deg_s")  # what tells a fit from others


def fragment(result: Mapping[str, Any]) -> str:
    """fit.toml: the parameters as the end of a scenario's file."""
    lines = [
        f"# The animal of {_trials(result)}, by `canine fit`; fit.json has the confidence intervals.",
        "# Append it to a scenario without [parameters], or copy its lines into these. Angles in degrees.",
        "",
        "[parameters]",
        *(f'"{name}" = {value!r}' for name, value in result["parameters"].items()),
    ]
    rows = {**result["statistics"], **result["responses"]}
    for key, row in rows.items():
        if row["n"] == 0:
            lines.append(f"# the trials do not show canine.{key}: it stays as the model has it")
        elif f"canine.{key}" not in result["parameters"] and key != "start_heading":
            lines.append(f"# the trials' canine.{key} is {BEYOND}")
        elif row["n"] == 1 and key in result["statistics"]:
            lines.append(f"# one value does not show canine.{key}_deviation: it stays as the model has it")
    start = result["statistics"]["start_heading"]
    if start["sd"] is not None:
        lines += [
            f"# By the handler: the start was {start['mean']:.3g} deg off the first waypoint on average.",
            f'# "canine.start_heading_deviation" = {rounded(settled(start["sd"], start["mean"]))!r}',
        ]
    if "day" in result:
        day = result["day"]
        lines.append(
            "# Of a day, for `canine day` and --plant canine_all_day; what is not here was not shown:"
        )
        for key, effect in day["effects"].items():
            if (name := f"canine.{key}") in day["parameters"]:
                lines.append(f'# "{name}" = {day["parameters"][name]!r}')
            elif effect["verdict"] == "shown":
                lines.append(f"# {name} was shown, {BEYOND}")
    return "\n".join(lines) + "\n"


@house_style()
def report(result: Mapping[str, Any], out: Path, note: Callable[[str], None] = lambda text: None) -> None:
    """Write fit.json, fit.toml, fit.png and fit.html, a page that needs no other file.

    Args:
        note: called with a line for the user if they replace those of other logs.

    Raises:
        UsageError: the folder cannot be made.
        FileError: they cannot be written.
    """
    others = replaced(out / "fit.json", {key: result[key] for key in IDENTITY if key in result})
    if others:
        note(f"{out}: has another fit, which this replaces ({others})")
    pictures = {"fit": figure(result)} | ({"fit-day": day_figure(result["day"])} if "day" in result else {})
    title = f"The animal of {_trials(result)}"
    page = charts_page(title, ABOUT, pictures, lambda console: show(result, console))
    files = {
        "fit.json": (json.dumps(result, indent=2, ensure_ascii=False) + "\n").encode(),
        "fit.toml": fragment(result).encode(),
        "fit.html": page,
    }
    drawn = {f"{name}.png": png_of(picture) for name, picture in pictures.items()}
    write_set(out, files | drawn, ("fit-day.png",))


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the statistics beside Table 5.1, the stretches left out, and the notes."""
    table = new_table(gap=1)
    table.add_column(f"{_trials(result)} ({', '.join(result['sources'])})")
    for heading in ("n", "mean ± sd", "mean, 95 %", "sd, 95 %", "Table 5.1", "n"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in result["statistics"].values():
        published = row["published"]
        spread = "" if row["sd"] is None else f" ± {_number(row['sd'])}"
        table.add_row(
            escape(f"{row['label']} [{row['unit']}]"),
            str(row["n"]),
            _number(row["mean"]) + spread,
            _range(row["mean_interval"]),
            _range(row["sd_interval"]),
            *((f"{published['mean']:g} ± {published['sd']:g}", str(published["n"])) if published else ()),
        )
    for row in result["responses"].values():
        published = (f"{row['published']['rate']:g}", str(row["published"]["n"]))
        rate, interval = _number(row["rate"]), _range(row["interval"])
        table.add_row(row["label"], str(row["n"]), rate, interval, "", *published)
    print_table(table, console)
    for row in (*result["statistics"].values(), *result["responses"].values()):
        if row["left_out"]:
            text = f"left out, {row['label']}: {reasons(row['left_out'])}"
            console.print(text, style="dim", markup=False, soft_wrap=True)
    for note in result["notes"]:
        console.print(f"note: {note}", style="dim", markup=False, soft_wrap=True)
    if "day" in result:
        _show_day(result["day"], console)


def _show_day(day: Mapping[str, Any], console: Console) -> None:
    """Print the effects of fatigue and habituation, and what they rest on."""
    table = new_table(gap=1)
    table.add_column(_missions(day))
    for heading in ("n", "estimate", "95 %", "rested"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("")
    for name, effect in day["effects"].items():
        unit = {"1": ""}.get(effect["unit"], f" [{effect['unit']}]")
        rested = "" if effect["rested"] is None else _number(effect["rested"])
        estimate, interval = _number(effect["estimate"]), _range(effect["interval"])
        table.add_row(escape(name + unit), str(effect["n"]), estimate, interval, rested, effect["verdict"])
    print_table(table, console)
    assumed = ", ".join(f"{name} {value:g}" for name, value in day["given"].items())
    notes = [f"taken as given: {assumed}"]
    if day["seconds_unknown"]:
        notes.append(
            f"the motion is not known in {day['seconds_unknown']:.1f} of {day['seconds']:.1f} s; the last "
            "known speed is held there, so the way run and the fatigue are less exact"
        )
    for note in notes:
        console.print(f"note: {note}", style="dim", markup=False, soft_wrap=True)


def _trials(result: Mapping[str, Any]) -> str:
    count, left_out = len(result["trials"]), result.get("left_out_logs", 0)
    without = f", {left_out} log{'s' * (left_out != 1)} left out" if left_out else ""
    return f"{count} trial{'s' * (count != 1)}{without}"


def _missions(day: Mapping[str, Any]) -> str:
    return f"{day['missions']} missions of {day['days']} day{'s' * (day['days'] != 1)}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.{1 if abs(value) >= 10 else 2}f}"


def _range(interval: Sequence[float] | None) -> str:
    return "-" if interval is None else f"{_number(interval[0])}..{_number(interval[1])}"


def figure(result: Mapping[str, Any]) -> Figure:
    """A histogram of each statistic, with the fitted normal distribution and that of Table 5.1."""
    picture = new_figure(14, 7)
    *panels, last = picture.subplots(2, 4).flat
    for axes, (key, row) in zip(panels, result["statistics"].items(), strict=True):
        values = np.array([trial[key] for trial in result["trials"] if key in trial])
        _draw_statistic(axes, row, values)
    _draw_responses(last, result["responses"].values())
    for axes in (*panels, last):
        axes.set_axisbelow(True)
        axes.grid(**GRID)
    legend: dict[str, Any] = {}
    for axes in (*panels, last):
        legend |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    picture.legend(legend.values(), legend.keys(), loc="outside lower center", ncols=len(legend), **BELOW)
    picture.suptitle(f"The animal of {_trials(result)}", fontsize=13)
    return picture


def day_figure(day: Mapping[str, Any]) -> Figure:
    """Speed of the missions and delay of the responses over fatigue, with their lines."""
    picture = new_figure(11, 4.5)
    for axes, name, key, label in zip(
        picture.subplots(1, 2),
        ("fatigue_slows", "fatigue_delays"),
        ("speeds", "delays"),
        ("cruising speed [m/s]", "delay of FORWARD [s]"),
        strict=True,
    ):
        effect, points = day["effects"][name], np.array(day[key]).reshape(-1, 2)
        axes.plot(*points.T, "o", color=ESTIMATES[0], markersize=4, label="missions")
        if effect["estimate"] is not None:
            ends = np.array([points[:, 0].min(), points[:, 0].max()])
            slope = -effect["rested"] if name == "fatigue_slows" else 1.0
            line = effect["rested"] + slope * effect["estimate"] * ends
            axes.plot(ends, line, color=TRUTH, linewidth=1.6, label="least squares")
        estimate = "no estimate" if effect["estimate"] is None else _number(effect["estimate"])
        interval = "" if effect["interval"] is None else f", 95 % {_range(effect['interval'])}"
        axes.set_title(f"{name} {estimate}{interval}: {effect['verdict']}", fontsize=10)
        axes.set_xlabel("fatigue, by the assumed law")
        axes.set_ylabel(label)
        axes.set_axisbelow(True)
        axes.grid(**GRID)
    picture.suptitle(_missions(day), fontsize=13)
    return picture


def _draw_statistic(axes: Axes, row: Mapping[str, Any], values: Array) -> None:
    """A histogram with its curves, which are scaled to it; values without spread give one bar."""
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlabel(f"{row['label']} [{row['unit']}]")
    axes.set_ylabel("trials")
    axes.set_title(f"n = {row['n']}", fontsize=10)
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    if not len(values):
        axes.set_xticks([])
        axes.set_ylim(0, 1)
        return
    spread = row["sd"] is not None and row["sd"] > 1e-6 * (1 + abs(row["mean"]))
    published = row["published"]
    if not spread:
        width = 0.1 * (1 + abs(row["mean"]))
        axes.bar(row["mean"], len(values), width / 10, color=ESTIMATES[0], alpha=0.45, label="trials")
        axes.set_xlim(row["mean"] - width, row["mean"] + width)
        return
    _, edges, _ = axes.hist(values, bins="auto", color=ESTIMATES[0], alpha=0.45, label="trials")
    area = len(values) * (edges[1] - edges[0])
    low, high = values.min(), values.max()
    x = np.linspace(low - 0.15 * (high - low), high + 0.15 * (high - low), 200)
    y = area * stats.norm.pdf(x, row["mean"], row["sd"])
    axes.plot(x, y, color=TRUTH, linewidth=1.6, label="normal, fitted")
    if published:
        y = area * stats.norm.pdf(x, published["mean"], published["sd"])
        axes.plot(x, y, color=ESTIMATES[1], linewidth=1.4, linestyle="--", label="Table 5.1")


def _draw_responses(axes: Axes, rates: Sequence[Mapping[str, Any]]) -> None:
    """Success rates with their intervals."""
    for place, row in enumerate(rates):
        axes.plot(
            [place],
            [100 * row["published"]["rate"]],
            "D",
            color=ESTIMATES[1],
            zorder=3,
            label="Table 5.1, rate",
        )
        if row["rate"] is not None:
            low, rate, high = (100 * value for value in (row["interval"][0], row["rate"], row["interval"][1]))
            axes.bar(place, rate, 0.6, color=ESTIMATES[0], alpha=0.45, label="trials")
            error = [[rate - low], [high - rate]]
            axes.errorbar(place, rate, yerr=error, color=TRUTH, capsize=5, label="95 % interval (Wilson)")
    names = [f"{name}, n = {row['n']}" for name, row in zip(("LEFT", "RIGHT"), rates, strict=True)]
    axes.set_xticks([0, 1], names)
    axes.set_xlim(-0.6, 1.6)
    axes.set_ylim(0, 100)
    axes.set_xlabel("command")
    axes.set_ylabel("success rate [%]")
