"""Replays a recording through estimators, with simulated GPS outages (3.3.6, D.7).

For each outage each configuration runs from the start of the recording to the end of the outage, as on board.
Its error is measured there, against the last withheld fix. `speed held` and `mean speed` are dead reckoning
without a filter: after the last fix its speed, or the mean speed of the last fixes, continues along the
measured heading. Outages that end standing still are judged apart from the others.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from scipy import stats

from harness.cosim.worker.process import WorkerProcess
from harness.files import write_set
from harness.recording.attitude import Array
from harness.recording.recording import RecordingError
from harness.recording.signals import MOVING_M_S
from harness.replay.comparison import BASELINES, HELD, HELD_BY, Comparison, hold_speed
from harness.replay.outage import COLUMNS, Estimate, Outage, Replayed, disjoint
from harness.replay.page import PAGE, replay_page
from harness.replay.plots import Track, replay_picture
from harness.replay.source import ReplaySource
from harness.replay.windows import NOT_VALID, SETTLE, Outages
from harness.terminal import new_table, print_table
from models.errors import CanineError
from models.system import ESTIMATORS

STATISTICS = ("mean", "sd", "median", "p90")
CLASSIC = ("no pitch", "pitch", "fuzzy")  # the text's own comparison: its tests are always shown
LEAST = 3  # outages for a test
SET = " *"  # behind the name of a configuration that --set changes
NO_SPREAD = 1e-9  # of paired differences, relative, and in m or m/s: a t-test would divide by nothing


def replay(
    source: ReplaySource,
    comparison: Comparison,
    chosen: Outages,
    progress: Callable[[int], None] | None = None,
) -> Replayed:
    """Run every configuration through every outage.

    An estimator that says at the start of an outage that it is not valid has nothing to dead reckon from.
    A configuration that is valid at no start is left out; else the outage is, for all, so that pairs stay
    pairs. An FMU that goes wrong in one gets a verdict, and has no part in any.

    Args:
        progress: called with the number of outages done.

    Raises:
        FmuError, EstimateError: the only FMU fails, or it or one of ours answers no finite number.
        CanineError: each of several FMUs fails.
        RecordingError: there are no outages to judge, or no configuration is valid at any.
    """
    if not chosen.windows:
        left_out = f", left out: {counts(chosen.left_out)}" if chosen.left_out else ""
        raise RecordingError(
            f"{source.name}: no outage of {chosen.length:g} s can be judged{left_out}; {chosen.reach}; "
            f"expected {SETTLE:g} s of motion, and {chosen.length:g} s after that with IMU samples and with "
            "fixes at both ends; record longer or take shorter outages"
        )
    configurations = comparison.usable(source)
    outages: list[Outage] = []
    valid: dict[str, list[bool]] = {configuration.name: [] for configuration in configurations}
    verdicts: dict[str, str] = {}
    with WorkerProcess() as process:  # for FMUs that were not built here; it starts with the first of them
        for number, window in enumerate(chosen.windows):
            signals = source.signals([window])
            inside = np.flatnonzero((signals.t >= window[0]) & (signals.t <= window[1]))
            withheld = inside[signals.reference_fix[inside]]
            last = int(withheld[-1])  # where the errors are measured
            ticks = last + 1
            sensed = {name: getattr(signals, name) for name in HELD_BY}
            runs = {name: hold_speed(sensed, ticks, mean_s) for name, mean_s in BASELINES.items()}
            for configuration in configurations:
                if configuration.name in verdicts:
                    continue
                try:
                    runs[configuration.name] = configuration.run(signals, ticks, process=process)
                except CanineError as error:
                    if configuration.estimator in ESTIMATORS or len(configurations) == 1:
                        raise
                    verdicts[configuration.name] = str(error)
                    del valid[configuration.name]
            if not valid:
                raise CanineError("\n".join(verdicts.values()))
            before = max(0, int(inside[0]) - 1)  # the last tick with fixes
            for name, at_starts in valid.items():
                at_starts.append("valid" not in runs[name] or bool(runs[name]["valid"][before] > 0))
            errors = {
                name: (
                    float(
                        np.hypot(
                            run["north"][last] - signals.reference_north[last],
                            run["east"][last] - signals.reference_east[last],
                        )
                    ),
                    float(abs(run["speed"][last] - signals.reference_speed[last])),
                )
                for name, run in runs.items()
            }
            north, east = signals.reference_north[withheld], signals.reference_east[withheld]
            path_m = float(np.hypot(np.diff(north), np.diff(east)).sum())
            during = slice(int(inside[0]), ticks)
            estimates = {name: Estimate.of(run, during) for name, run in runs.items()}
            standing = bool(signals.reference_speed[last] < MOVING_M_S)
            outages.append(Outage(*window, path_m, errors, estimates, signals.t[during], standing))
            if number == len(chosen.windows) - 1:  # the run with the most fixes
                with_fixes = {name: Estimate.of(run, slice(0, during.start)) for name, run in runs.items()}
            if progress:
                progress(number + 1)
        process.end()
        printed = process.take_notes()
    return _judged(source, comparison, chosen, Replayed(outages, {}, printed, verdicts, with_fixes), valid)


def _judged(
    source: ReplaySource,
    comparison: Comparison,
    chosen: Outages,
    replayed: Replayed,
    valid: Mapping[str, Sequence[bool]],
) -> Replayed:
    """What can be judged of all outages, by whether each configuration was valid at the start of each.

    Raises:
        RecordingError: no configuration was valid at the start of any outage, or none has all of them valid.
    """
    outages = replayed.outages
    never = [name for name, at_starts in valid.items() if not any(at_starts)]
    others = [name for name in valid if name not in never]
    starts = f"the start of {'the outage' if len(outages) == 1 else f'any of {len(outages)} outages'}"
    notes = [*replayed.notes, *(f"{name}: left out, since it is not valid at {starts}" for name in never)]
    notes += [
        f"{name}: not valid at the start of {at_starts.count(False)} of {len(outages)} outages"
        for name, at_starts in valid.items()
        if name in others and not all(at_starts)
    ]
    out = [*never, *replayed.verdicts]
    judged = [
        replace(outage, errors=_without(outage.errors, out), estimates=_without(outage.estimates, out))
        for outage, *at_start in zip(outages, *(valid[name] for name in others), strict=True)
        if all(at_start)
    ]
    if not others or not judged:
        none = "all estimators are valid at the start of none" if others else f"none is valid at {starts}"
        why = ". ".join([*replayed.verdicts.values(), *(comparison.notes(source) or notes)])
        raise RecordingError(f"{source.name}: no outage can be judged: {none}; {why}")
    left_out = dict(chosen.left_out)
    if number := len(outages) - len(judged):
        left_out[NOT_VALID] = number
    return Replayed(judged, left_out, notes, replayed.verdicts, replayed.with_fixes)


def _without(values: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name not in names}


def statistics(outages: Sequence[Outage]) -> dict[str, Any]:
    """Mean, standard deviation, median and 90th percentile of the errors, and paired two-tailed t-tests.

    The tests use outages that do not overlap: overlapping ones share fixes, so they are not independent.
    """
    names = list(outages[0].errors)
    table = np.array([[o.errors[name] for name in names] for o in outages])  # (n, configurations, 2)
    configurations: dict[str, dict[str, Any]] = {}
    for i, name in enumerate(names):
        configurations[name] = {"n": len(outages)}
        for j, column in enumerate(COLUMNS):
            values = table[:, i, j]
            configurations[name][column] = {
                "mean": float(values.mean()),
                "sd": float(values.std(ddof=1)) if len(outages) > 1 else None,
                "median": float(np.median(values)),
                "p90": float(np.percentile(values, 90)),
            }
    separate = disjoint(outages)
    apart = [i for i, outage in enumerate(outages) if outage in separate]
    pairs = []
    for i, first in enumerate(names):
        for k in range(i + 1, len(names)):
            pair: dict[str, Any] = {"first": first, "second": names[k], "n": len(apart)}
            for j, column in enumerate(COLUMNS):
                if len(apart) >= LEAST:
                    test = paired_t_test(table[apart, i, j] - table[apart, k, j])
                    pair[column] = (
                        {"t": None, "p": None}
                        if test is None
                        else {"t": float(test.statistic), "p": float(test.pvalue)}
                    )
                else:
                    pair[column] = None
            pairs.append(pair)
    return {"configurations": configurations, "paired_t_tests": pairs}


def apart(outages: Sequence[Outage]) -> dict[str, Any]:
    """The statistics of the outages that end in motion and of those that end standing still.

    Either is None where there is none. A filter without zero-velocity updates runs away while the animal
    stands, so one such outage would outweigh all others.
    """
    groups = {"moving": False, "standing": True}
    parts = {key: [o for o in outages if o.standing == standing] for key, standing in groups.items()}
    return {key: statistics(part) if part else None for key, part in parts.items()}


def paired_t_test(differences: Array) -> Any | None:
    """SciPy's two-tailed t-test of paired differences (n,); None where they have no spread, and so no t."""
    if np.ptp(differences) <= NO_SPREAD * max(1.0, np.abs(differences).max()):
        return None
    return stats.ttest_1samp(differences, 0.0)


def counts(causes: Mapping[str, int]) -> str:
    """Numbers and causes, in words."""
    return ", ".join(f"{number} × {cause}" for cause, number in causes.items())


def identity(source: ReplaySource, comparison: Comparison, chosen: Outages) -> dict[str, Any]:
    """What tells a replay from others, as outages.json states it."""
    return {
        "recording": source.name,
        "estimator": comparison.name,
        "settings": ", ".join(comparison.settings),
        "outage_s": chosen.length,
        "attitude": source.attitude,
    }


def report(
    source: ReplaySource, comparison: Comparison, chosen: Outages, replayed: Replayed, out: Path
) -> dict[str, Any]:
    """Write outages.json, replay.png and replay.html; returns the content of the JSON.

    Raises:
        UsageError: the folder cannot be made.
        FileError: they cannot be written.
    """
    signals, outages = source.signals([]), replayed.outages
    judged = list(outages[0].errors)
    names = _marked(judged, [c.name for c in comparison.configurations if c.settings])
    estimators = dict.fromkeys(c.estimator for c in comparison.configurations if c.name in judged)
    result = {
        **identity(source, comparison, chosen),
        "dropped": dict(source.dropped),
        "left_out": replayed.left_out,
        "broken": source.broken,
        "notes": [*source.notes, *comparison.notes(source), *replayed.notes],
        "verdicts": replayed.verdicts,
        "set": {
            c.name: list(c.settings) for c in comparison.configurations if c.settings and c.name in judged
        },
        **statistics(outages),
        **apart(outages),
        "outages": [
            {
                "start_s": outage.start,
                "end_s": outage.end,
                "path_m": outage.path_m,
                "standing": outage.standing,
                "errors": {
                    name: dict(zip(COLUMNS, values, strict=True)) for name, values in outage.errors.items()
                },
            }
            for outage in outages
        ],
    }
    text = json.dumps(result, indent=2, ensure_ascii=False, allow_nan=False)
    fixes = signals.reference_fix
    title = f"{source.name}: {', '.join(estimators)} through outages of {chosen.length:g} s"
    picture = replay_picture(
        Track(signals.t[fixes], signals.reference_north[fixes], signals.reference_east[fixes]),
        {names[name]: [Track(o.time, *o.estimates[name][:2]) for o in outages] for name in judged},
        {names[name]: values[COLUMNS[0]] for name, values in result["configurations"].items()},
        on_map=[outages.index(outage) for outage in disjoint(outages)],
        title=title,
        not_used="\n".join(
            filter(
                None,
                [
                    not_used(result),
                    *replayed.verdicts.values(),
                    f"not whole: {source.broken}" if source.broken else "",
                    _set(result),
                ],
            )
        ),
    )
    sentence = f"{len(outages)} outages; the attitude is {source.attitude}" + (
        f"; the recording is not whole: {source.broken}" if source.broken else ""
    )
    page = replay_page(
        signals, replayed, names, lambda console: show(result, console),
        title=title, sentence=sentence, notes=result["notes"],
    )  # fmt: skip
    write_set(out, {"outages.json": (text + "\n").encode(), "replay.png": picture, PAGE: page})
    return result


def not_used(result: Mapping[str, Any]) -> str:
    """What was left out and what was dropped, in a line each; "" if all was used."""
    lines = []
    if result["left_out"]:
        number = sum(result["left_out"].values())
        lines.append(f"left out: {number} outage{'s' * (number != 1)}: {counts(result['left_out'])}")
    if result["dropped"]:
        lines.append(f"dropped: {counts(result['dropped'])}")
    return "\n".join(lines)


def _marked(names: Iterable[str], changed: Collection[str]) -> dict[str, str]:
    """The configurations' names as tables and pictures show them."""
    return {name: name + SET * (name in changed) for name in names}


def _set(result: Mapping[str, Any]) -> str:
    """What the mark behind a name means; "" if no configuration was changed."""
    settings = dict.fromkeys(setting for some in result["set"].values() for setting in some)
    return f"{SET.strip()} with --set {' --set '.join(settings)}" if settings else ""


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the table of errors at the ends of the outages, standing ones apart, and the t-tests."""
    parts = {"error at the end of the outage": result}
    if result.get("standing"):
        parts = {
            "error at the end of the outage,\nin motion": result["moving"],
            "error at the end of the outage,\nstanding still": result["standing"],
        }
    parts = {heading: part for heading, part in parts.items() if part}
    names = _marked(result["configurations"], result["set"])
    for heading, part in parts.items():
        _show_errors(heading, part, names, result["verdicts"], console)
    if line := _set(result):
        console.print(line, markup=False, highlight=False)
    if lines := not_used(result):
        console.print(lines, markup=False, highlight=False)
    which = "" if len(parts) == 1 and not result.get("standing") else next(iter(parts)).partition("\n")[2]
    _show_tests(next(iter(parts.values()))["paired_t_tests"], names, which, console)


def _show_errors(
    heading: str,
    part: Mapping[str, Any],
    names: Mapping[str, str],
    failed: Iterable[str],
    console: Console,
) -> None:
    table = new_table()
    table.add_column(heading)
    for column in ("n", "position [m]\nmean", "\nsd", "\nmedian", "\np90"):
        table.add_column(escape(column), justify="right")
    for column in ("speed [m/s]\nmean", "\nsd", "\nmedian", "\np90"):
        table.add_column(escape(column), justify="right")
    for name, values in part["configurations"].items():
        cells = [values[column][key] for column in COLUMNS for key in STATISTICS]
        table.add_row(
            names[name], str(values["n"]), *("-" if cell is None else f"{cell:.2f}" for cell in cells)
        )
    for name in failed:
        table.add_row(name, "failed", *["-"] * len(STATISTICS) * len(COLUMNS))
    print_table(table, console)


def _show_tests(
    pairs: Sequence[Mapping[str, Any]], names: Mapping[str, str], which: str, console: Console
) -> None:
    """The tests against the speed held, and of the text's configurations against each other.

    Args:
        which: of the outages they are of, in words; "" if of all.
    """
    shown = [
        pair
        for pair in pairs
        if any(pair[column] and pair[column]["t"] is not None for column in COLUMNS)
        and (pair["first"] == HELD or {pair["first"], pair["second"]} <= set(CLASSIC))
    ]
    if not shown:
        return
    table = new_table()
    where = f" {which}," if which else ""
    table.add_column(f"paired t-test, n = {shown[0]['n']}:{where}\noutages that do not overlap")
    for column in ("position\nt", "\np", "speed\nt", "\np"):
        table.add_column(column, justify="right")
    for pair in shown:
        cells = []
        for column in COLUMNS:
            test = pair[column]
            known = test and test["t"] is not None
            cells += [f"{test['t']:+.2f}", f"{test['p']:.2g}"] if known else ["-", "-"]
        table.add_row(f"{names[pair['second']]} against {names[pair['first']]}", *cells)
    print_table(table, console)
    console.print(
        "t below 0: the one named first has the larger error", style="dim", markup=False, highlight=False
    )
