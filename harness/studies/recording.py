"""All our estimators on a recording: outages that end in motion and standing still, halves, innovations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console

from harness.drawing import BELOW, ESTIMATES, GPS, GRID, TRUTH, drawable, house_style, new_figure
from harness.replay.comparison import ALL, BASELINES, HELD, Configuration, compare
from harness.replay.outage import COLUMNS, Outage, disjoint
from harness.replay.replay import apart, not_used, replay, statistics
from harness.replay.source import ReplaySource, open_source
from harness.studies.innovations import innovations_of, observed
from harness.studies.published import OUTAGE_S
from harness.studies.study import Options, Progress, Result
from harness.terminal import new_table, print_table
from models.errors import UsageError
from models.system import ESTIMATORS

TAKES = frozenset({"recording"})
EVERY_S = 5.0
NIS_BAND = (1.0, 9.0)  # of three scalars: what a builder would call consistent (the expected value is 3)
TITLES = {COLUMNS[0]: "position error [m]", COLUMNS[1]: "speed error [m/s]"}


def run(options: Options, progress: Progress) -> Result:
    """Replay with every estimator, whole and by halves, and take the innovations of a run without outage.

    Raises:
        UsageError: no recording is named.
        RecordingError: there is no outage to judge.
    """
    if options.recording is None:
        raise UsageError("study recording: expected a recording, as in `canine study recording ../walk`")
    source, comparison = open_source(options.recording), compare(ALL)
    chosen = source.outages(OUTAGE_S, EVERY_S)
    number = max(1, len(chosen.windows))
    replayed = replay(source, comparison, chosen, lambda done: progress(90 * done / number))
    outages = replayed.outages
    middle = (outages[0].start + outages[-1].end) / 2
    halves = {
        "first": [outage for outage in outages if outage.end <= middle],
        "second": [outage for outage in outages if outage.start >= middle],
    }
    innovations = {
        configuration.name: nis_of(source, configuration, middle)
        for configuration in comparison.usable(source)
        if configuration.estimator in ESTIMATORS and configuration.name in outages[0].errors
    }
    progress(100)
    return {
        "recording": source.name,
        "outage_s": OUTAGE_S,
        "every_s": EVERY_S,
        "middle_s": middle,
        "dropped": dict(source.dropped),
        "left_out": replayed.left_out,
        "notes": [*source.notes, *comparison.notes(source), *replayed.notes],
        **statistics(outages),
        **apart(outages),
        "halves": {
            half: {"all": statistics(part), **apart(part), "separate": len(disjoint(part))} if part else None
            for half, part in halves.items()
        },
        "innovations": innovations,
        "separate": {
            "all": len(disjoint(outages)),
            "moving": len(disjoint([outage for outage in outages if not outage.standing])),
        },
        "outages": [_as_json(outage) for outage in outages],
    }


def _as_json(outage: Outage) -> dict[str, Any]:
    return {
        "start_s": outage.start,
        "end_s": outage.end,
        "standing": outage.standing,
        "errors": {name: dict(zip(COLUMNS, errors, strict=True)) for name, errors in outage.errors.items()},
    }


def nis_of(source: ReplaySource, configuration: Configuration, middle: float) -> dict[str, Any]:
    """How well a filter's innovations are as large as it says, over all fixes and by halves.

    Args:
        middle: s, between the halves.
    """
    block, title = ESTIMATORS[configuration.estimator], configuration.estimator
    signals = source.signals([])
    names = [name.removeprefix(f"{title}.") for name in observed(block, innovations_only=True)]
    rows = configuration.run(signals, len(signals.t), names)
    innovations = innovations_of(block, {f"{title}.{name}": values for name, values in rows.items()})
    halves = {
        "all": innovations,
        "first": innovations.between(-np.inf, middle),
        "second": innovations.between(middle, np.inf),
    }
    result: dict[str, Any] = {"fixes": int(signals.gps_fix.sum()), "accepted": len(innovations.time)}
    for half, part in halves.items():
        known = len(part.time) > 0
        result[half] = {
            "nis": float(part.nis.mean()) if known else None,
            "median": float(np.median(part.nis)) if known else None,
            "expected": part.freedom if known else None,
        }
    return result


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the errors with their tests, those of standing outages apart, the halves, the innovations."""
    moving, standing = result["moving"], result["standing"]
    if moving and standing:
        _show_errors("moving at the end", moving, result["separate"]["moving"], console)
        _show_errors("standing still at the end", standing, None, console)
    _show_errors("all", result, result["separate"]["all"], console)
    if lines := not_used(result):
        console.print(lines, markup=False, highlight=False)
    for note in result["notes"]:
        console.print(f"note: {note}", markup=False, highlight=False, soft_wrap=True)
    _show_halves(result, console)


def _show_errors(heading: str, part: Mapping[str, Any], separate: int | None, console: Console) -> None:
    """Errors of a group of outages, and the p of each configuration's difference to the baselines."""
    configurations = part["configurations"]
    n = next(iter(configurations.values()))["n"]
    table = new_table()
    table.add_column(f"{n} outages,\n{heading}")
    for column in TITLES.values():
        name, unit = column.split(" error ")
        for cell in (f"{name} {unit}\nmean", "\nsd", "\nmedian", "\np90"):
            table.add_column(cell, justify="right")
    if separate is not None:
        for baseline in BASELINES:
            table.add_column(f"p, {baseline}:\nposition", justify="right")
            table.add_column("\nspeed", justify="right")
    tests = {(pair["first"], pair["second"]): pair for pair in part["paired_t_tests"]}
    for name, values in configurations.items():
        cells = [values[column][key] for column in COLUMNS for key in ("mean", "sd", "median", "p90")]
        row = ["-" if cell is None else f"{cell:.2f}" for cell in cells]
        if separate is not None:
            row += [_p(tests.get((b, name)), column) for b in BASELINES for column in COLUMNS]
        table.add_row(name, *row)
    print_table(table, console)
    if separate is not None:
        console.print(
            f"p of paired t-tests against both baselines, of the {separate} outages that do not overlap",
            style="dim",
        )


def _p(pair: Mapping[str, Any] | None, column: str) -> str:
    test = pair[column] if pair else None
    return f"{test['p']:.2g}" if test and test["p"] is not None else "-"


def _show_halves(result: Mapping[str, Any], console: Console) -> None:
    """Errors and innovations of the halves, and how many fixes each filter took."""
    halves = {half: part for half, part in result["halves"].items() if part}
    second = halves.get("second")
    tests = {(p["first"], p["second"]): p for p in second["all"]["paired_t_tests"]} if second else {}
    table = new_table()
    table.add_column(f"halves, at {result['middle_s']:.0f} s")
    for heading in (
        "position [m]\nfirst", "\nsecond", f"p, {HELD}\nsecond", "speed [m/s]\nfirst", "\nsecond",
        f"p, {HELD}\nsecond", "NIS\nfirst", "\nsecond", "\nexpected", "fixes\ntaken",
    ):  # fmt: skip
        table.add_column(heading, justify="right")
    for name in result["configurations"]:
        row = []
        for column in COLUMNS:
            for half in ("first", "second"):
                known = halves.get(half)
                mean = known and known["all"]["configurations"][name][column]["mean"]
                row.append("-" if mean is None else f"{mean:.2f}")
            row.append(_p(tests.get((HELD, name)), column))
        innovations = result["innovations"].get(name)
        if innovations:
            row += [_number(innovations[half]["nis"]) for half in ("first", "second")]
            row += [
                _number(innovations["all"]["expected"]),
                f"{innovations['accepted']} of {innovations['fixes']}",
            ]
        table.add_row(name, *row)
    print_table(table, console)
    sizes = [halves[h]["all"]["configurations"][HELD]["n"] if h in halves else 0 for h in ("first", "second")]
    tested = second["separate"] if second else 0
    console.print(
        f"{sizes[0]} and {sizes[1]} outages; p of the {tested} of the second half that do not overlap",
        style="dim",
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


@house_style()
def draw(result: Mapping[str, Any]) -> Mapping[str, Figure]:
    """Each outage's errors by configuration, and the innovations."""
    names = list(result["configurations"])
    figure = new_figure(14, 1.6 + 0.42 * len(names))
    panels = figure.subplots(1, 3, sharey=True)
    places = np.arange(len(names))
    for axes, column in zip(panels, COLUMNS, strict=False):
        _errors(axes, result["outages"], names, column)
    _innovations(panels[2], result["innovations"], names)
    panels[0].set_yticks(places, names)
    panels[0].invert_yaxis()
    for axes in panels:
        axes.grid(**GRID)
        axes.set_axisbelow(True)
    handles = [h for axes in panels[::2] for h in axes.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), **BELOW)
    figure.suptitle(
        drawable(f"{result['recording']}: the estimators through outages of {result['outage_s']:g} s")
    )
    return {"recording": figure}


def _errors(axes: Axes, outages: Sequence[Mapping[str, Any]], names: Sequence[str], column: str) -> None:
    """A dot for each outage, and the mean of those that end in motion."""
    for standing, face, label in (
        (False, ESTIMATES[0], "moving at the end"),
        (True, "none", "standing still"),
    ):
        group = [outage for outage in outages if outage["standing"] == standing]
        for place, name in enumerate(names):
            errors = [outage["errors"][name][column] for outage in group]
            axes.plot(
                errors, np.full(len(errors), place), "o", markersize=5, alpha=0.75,
                markerfacecolor=face, markeredgecolor=ESTIMATES[1 if standing else 0],
                label=label if place == 0 else None,
            )  # fmt: skip
            if errors and not standing:
                axes.plot(
                    [np.mean(errors)] * 2, [place - 0.35, place + 0.35], color=TRUTH, linewidth=2,
                    label="mean of those moving" if place == 0 else None,
                )  # fmt: skip
    axes.set_xlabel(TITLES[column])
    axes.set_xlim(left=0)


def _innovations(axes: Axes, innovations: Mapping[str, Any], names: Sequence[str]) -> None:
    """The mean NIS of each filter beside what it should be."""
    axes.axvspan(*NIS_BAND, color="#DCEFE6", zorder=0.3, label="NIS 1 to 9")
    first = True
    for place, name in enumerate(names):
        whole_run = innovations.get(name, {}).get("all", {})
        if whole_run.get("nis") is None:
            continue
        axes.plot(whole_run["nis"], place, "D", color=ESTIMATES[3], label="mean NIS" if first else None)
        axes.plot(
            whole_run["expected"], place, "|", color=GPS, markersize=14, markeredgewidth=2,
            label="expected" if first else None,
        )  # fmt: skip
        first = False
    axes.set_xscale("log")
    axes.set_xlabel("innovations: mean NIS")
