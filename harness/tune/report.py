"""The results of a tuning: tables, a picture, parameters for a scenario or a replay, and tune.json."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter
from rich.console import Console
from rich.markup import escape
from scipy import stats

from harness.drawing import (
    BELOW,
    ESTIMATES,
    GPS,
    GRID,
    TRUTH,
    Style,
    drawable,
    house_style,
    new_figure,
    png_of,
    set_title,
)
from harness.files import replaced, write_set
from harness.fit.estimate import rounded
from harness.replay.comparison import HELD
from harness.replay.outage import COLUMNS
from harness.report.charts import charts_page
from harness.terminal import new_table, print_table
from harness.trial.units import is_angular
from harness.tune.fit import LEVEL
from harness.tune.tune import AFTER, BEFORE, CONSTANT
from models.kit.declaration import Type
from models.kit.units import DEG
from models.system import ESTIMATORS

IDENTITY = ("recording", "estimator", "held")  # what tells a tuning from others
LIMIT = float(stats.chi2.ppf(LEVEL, 1))  # of twice the loss, at the ends of an interval
COLORS = {BEFORE: ESTIMATES[1], CONSTANT: ESTIMATES[3], AFTER: ESTIMATES[0], HELD: GPS}
DIM: Style = {"style": "dim", "markup": False, "highlight": False, "soft_wrap": True}
ABOUT = "The noise that makes the innovations most likely, and how it judges on the second half"
MOST_TICKS = 4  # of a noise's axis


def default_folder(recording: str) -> Path:
    """Where the results go by default."""
    return Path("out") / f"tune-{recording}"


def fragment(result: Mapping[str, Any]) -> str:
    """tune.toml: the parameters as the end of a scenario's file."""
    variables = ESTIMATORS[result["estimator"]].variables()
    start, end = result["fitted_on_s"]
    lines = [
        f"# The noise of {drawable(result['recording'])}, by `canine tune`: the most likely in "
        f"{start:.1f} to {end:.1f} s.",
        "# tune.json has the confidence intervals. `canine replay --parameters` takes this file. Append it",
        "# to a scenario without [parameters], or copy its lines into these. Angles in degrees.",
        "",
        "[parameters]",
    ]
    for name, value in result["parameters"].items():
        number = rounded(value / DEG if is_angular(variables[name]) else value)
        written = "true" if value else "false"
        is_switch = variables[name].type is Type.BOOLEAN
        lines.append(f'"{result["estimator"]}.{name}" = {written if is_switch else repr(number)}')
    for noise in result["noises"]:
        if noise["interval"][0] == 0 or noise["interval"][1] is None:
            lines.append(f"# the recording sets {_limit(noise)}")
    lines += [f"# {doubt}" for doubt in result["doubts"]]
    return "\n".join(lines) + "\n"


def _limit(noise: Mapping[str, Any]) -> str:
    """What a recording says of a noise whose interval is open."""
    low, high = noise["interval"]
    if low == 0 and high is None:
        return f"no limit to {noise['name']}: its value means nothing"
    return f"no lower limit to {noise['name']}" if low == 0 else f"no upper limit to {noise['name']}"


def report(result: Mapping[str, Any], out: Path, note: Callable[[str], None] = lambda text: None) -> None:
    """Write tune.json, tune.toml, tune.png and tune.html, a page that needs no other file.

    Args:
        note: called with a line for the user if they replace those of another recording or estimator.

    Raises:
        UsageError: the folder cannot be made.
        FileError: they cannot be written.
    """
    if others := replaced(out / "tune.json", {key: result[key] for key in IDENTITY}):
        note(f"{out}: has another tuning, which this replaces ({others})")
    text = json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False)
    picture = figure(result)
    title = f"{result['recording']}: the noise of {result['estimator']}"
    page = charts_page(title, ABOUT, {"tune": picture}, lambda console: show(result, console))
    write_set(
        out,
        {
            "tune.json": (text + "\n").encode(),
            "tune.toml": fragment(result).encode(),
            "tune.png": png_of(picture),
            "tune.html": page,
        },
    )


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the noises with their intervals, then how both judge on the second half."""
    table = new_table()
    start, end = result["fitted_on_s"]
    table.add_column(escape(f"{result['estimator']}, fitted on {start:.1f} to {end:.1f} s"))
    for heading in (BEFORE, AFTER, f"{100 * result['level']:.0f} %"):
        table.add_column(heading, justify="right")
    for noise in result["noises"]:
        unit = "" if noise["unit"] == "1" else f" [{noise['unit']}]"
        low, high = noise["interval"]
        interval = f"{low:.3g}..{'' if high is None else format(high, '.3g')}"
        before = f"{noise['before']:.3g}" if noise["in_force_before"] else f"({noise['before']:.3g})"
        table.add_row(escape(noise["name"] + unit), before, f"{noise['value']:.3g}", interval)
    print_table(table, console)
    if idle := [noise["name"] for noise in result["noises"] if not noise["in_force_before"]]:
        text = f"{BEFORE}, {idle[0]} is not in force: fuzzy rules set sigma by the speed; tuned, they are off"
        console.print(text, **DIM)
    if not result["settled"]:
        console.print("the search found no clear maximum of the likelihood: the values mean little", **DIM)
    table = new_table()
    start, end = result["judged_on_s"]
    table.add_column(f"judged on {start:.1f} to {end:.1f} s")
    for heading in ("NIS\n ", "bounds\n95 %", "log-likelihood\nper fix", "lag 1\n ", "bounds\n95 %"):
        table.add_column(heading, justify="right")
    for name, row in result["judged"].items():
        table.add_row(
            name,
            f"{row['nis']:.4g}",
            "..".join(f"{bound:.2f}" for bound in row["nis_bounds"]),
            f"{row['log_likelihood_per_fix']:.2f}",
            f"{row['autocorrelation'][0]:+.2f}",
            f"±{row['autocorrelation_bound']:.2f}",
        )
    print_table(table, console)
    tuned = result["judged"][AFTER]
    if abs(tuned["autocorrelation"][0]) > tuned["autocorrelation_bound"]:
        console.print(
            "the intervals presume white innovations; lag 1 is outside its bounds: they are too narrow",
            **DIM,
        )  # fmt: skip
    for doubt in result["doubts"]:
        console.print(doubt, markup=False, highlight=False, soft_wrap=True)
    outages = result["outages"]
    if outages is None:
        text = f"no outage of {result['outage_s']:g} s can be judged in the second half"
        console.print(text, **DIM)
        return
    table = new_table()
    table.add_column(f"{len(outages['starts_s'])} outages of {result['outage_s']:g} s there")
    for heading in ("position [m]\nmean", "\nmedian", "speed [m/s]\nmean", "\nmedian"):
        table.add_column(escape(heading), justify="right")
    for name, row in outages["ways"].items():
        table.add_row(name, *(f"{row[column][key]:.2f}" for column in COLUMNS for key in ("mean", "median")))
    print_table(table, console)
    for column, what in zip(COLUMNS, ("position", "speed"), strict=True):
        for name, p in outages[f"{column}_p"].items():
            if p is not None:
                text = f"{what}, {name} against {AFTER}: p = {p:.2g} (paired, n = {outages['apart']})"
                console.print(text, **DIM)


@house_style()
def figure(result: Mapping[str, Any]) -> Figure:
    """NIS in time, whiteness, errors in outages, and the profile likelihood of each noise."""
    noises = result["noises"]
    picture = new_figure(14, 8.4)
    above, below = picture.subfigures(2, 1, squeeze=False)[:, 0]
    time, white, errors = above.subplots(1, 3, width_ratios=(2, 1, 1))
    for name, row in result["nis"].items():
        time.semilogy(row["time_s"], np.maximum(row["nis"], 1e-4), ".", color=COLORS[name], markersize=3)
        correlation = result["judged"][name]["autocorrelation"]
        white.plot(range(1, len(correlation) + 1), correlation, "o-", color=COLORS[name], markersize=3)
    time.axhline(result["judged"][AFTER]["nis_expected"], color=TRUTH, linewidth=1.0)
    time.axvline(result["judged_on_s"][0], color=TRUTH, linewidth=1.0, linestyle=":")
    time.set_xlabel("time [s]; judged behind the dotted line")
    time.set_ylabel("NIS of each fix")
    bound = result["judged"][AFTER]["autocorrelation_bound"]
    white.axhspan(-bound, bound, color="#D3D7DD", zorder=0.5)
    white.set_xlabel("lag [fixes]")
    white.set_ylabel("autocorrelation, judged part")
    if result["outages"]:
        for i, (name, row) in enumerate(result["outages"]["ways"].items()):
            each = row[COLUMNS[0]]["each"]
            errors.plot(
                np.full(len(each), i) + np.linspace(-0.2, 0.2, len(each)), each, "o", color=COLORS[name]
            )
            errors.plot([i - 0.3, i + 0.3], [row[COLUMNS[0]]["mean"]] * 2, color=COLORS[name])
        shown = [name.replace(" ", "\n") for name in result["outages"]["ways"]]
        errors.set_xticks(range(len(shown)), shown)
        errors.set_xlim(-0.6, len(shown) - 0.4)
        errors.set_ylim(bottom=0)
    else:
        text = f"no outage of {result['outage_s']:g} s\ncan be judged here"
        errors.text(0.5, 0.5, text, ha="center", va="center", transform=errors.transAxes)
        errors.set(xticks=[], yticks=[])
    errors.set_ylabel(f"position error after {result['outage_s']:g} s [m]")
    for i, (axes, noise) in enumerate(zip(below.subplots(1, len(noises)), noises, strict=True)):
        values, losses = np.array(noise["profile"]).T
        axes.semilogx(values, losses, "o-", color=COLORS[AFTER], markersize=3)
        axes.axhline(LIMIT, color=TRUTH, linewidth=1.0)
        before = COLORS[BEFORE] if noise["in_force_before"] else COLORS[CONSTANT]
        axes.axvline(noise["before"], color=before, linewidth=1.0)
        axes.set_ylim(0, 3 * LIMIT)
        unit = "" if noise["unit"] == "1" else f" [{noise['unit']}]"
        axes.set_xlabel(noise["name"] + unit, fontsize=9)
        axes.set_xticks(ticks := _ticks(*axes.get_xlim()), [f"{tick:g}" for tick in ticks])
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(**GRID)
        if i == 0:
            axes.set_ylabel("twice the loss of log-likelihood")
    for axes in (time, white, errors):
        axes.grid(**GRID)
    ways = result["outages"]["ways"] if result["outages"] else result["ways"]
    handles = [Line2D([], [], color=COLORS[way], marker="o", linestyle="", label=way) for way in ways]
    picture.legend(handles=handles, loc="outside lower center", ncols=len(handles), **BELOW)
    set_title(picture, f"{drawable(result['recording'])}: the noise of {result['estimator']}")
    return picture


def _ticks(low: float, high: float) -> list[float]:
    """A few round values between two: powers of ten, or 1, 2 and 5 times them where few are inside."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for digits in ((1,), (1, 2, 5), range(1, 10)):
        inside = [v for power in powers for digit in digits if low <= (v := digit * 10.0**power) <= high]
        if len(inside) > 1:
            return inside[:: math.ceil(len(inside) / MOST_TICKS)]
    return [low, high]
