"""Replays a recording through the estimator's FMU, with simulated GPS outages (3.3.6, D.7).

For each outage the estimator runs from the start of the recording to the end of the outage, as on board. Its
error is measured there, against the last withheld fix. `speed held` is dead reckoning without a filter: after
the last fix its speed continues along the measured heading.
"""

from __future__ import annotations

import ctypes
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from scipy import stats

from fmus.build import build_fmu
from fmus.folder import build_folder
from harness.cosim.fmu import FmuError, FmuInstance
from harness.files import make_folder, write_whole
from harness.recording.attitude import TICK_S, Array
from harness.recording.recording import RecordingError
from harness.recording.signals import SensorSignals
from harness.replay.plots import Track, replay_picture
from harness.replay.source import ESTIMATORS, ReplaySource
from harness.replay.windows import SETTLE, Outages
from harness.terminal import new_table, print_table
from models.errors import UsageError, nearest
from models.kit.block import Block

HELD = "speed held"
CONFIGURATIONS: dict[str, dict[str, dict[str, float]]] = {
    "four_state": {
        "no pitch": {"use_pitch": 0, "fuzzy": 0},
        "pitch": {"use_pitch": 1, "fuzzy": 0},
        "fuzzy": {"use_pitch": 1, "fuzzy": 1},
    }
}
COLUMNS = ("position_error_m", "velocity_error_m_s")
NO_SPREAD = 1e-9  # of paired differences, relative: a t-test would divide by nothing


def find_estimator(name: str) -> type[Block]:
    """The estimator's block of this name.

    Raises:
        UsageError: there is none.
    """
    if name not in ESTIMATORS:
        raise UsageError(f'there is no estimator "{name}"{nearest(name, ESTIMATORS)}')
    return ESTIMATORS[name]


def run_fmu(
    path: Path, signals: SensorSignals, ticks: int, parameters: Mapping[str, float]
) -> dict[str, Array]:
    """Run an estimator's FMU over the first `ticks` ticks; its outputs by name, (ticks,) each.

    Raises:
        FmuError: the FMU fails, has an input that is not a sensor signal, or answers no finite number.
    """
    with FmuInstance("estimator", path) as component:
        inputs, outputs = component.description.inputs.values(), component.description.outputs.values()
        signal_names = {f.name for f in fields(SensorSignals)}
        for quantity in inputs:
            if quantity.name not in signal_names:
                raise FmuError(
                    f'{path}: input "{quantity.name}" is not a sensor signal; it cannot be replayed'
                )
        component.initialize(parameters)
        setters, getters = [], []  # (call, one tick's values, all ticks' values, what it does)
        for access in dict.fromkeys(q.access for q in inputs):
            group = [q for q in inputs if q.access == access]
            table = np.column_stack([getattr(signals, q.name)[:ticks] for q in group]).astype(access.dtype)
            now = np.zeros(len(group), dtype=access.dtype)
            setters.append((component.setting(group, now.ctypes.data), now, table, f"set of {access.fmi}"))
        estimate = {q.name: np.zeros(ticks) for q in outputs}
        for access in dict.fromkeys(q.access for q in outputs):
            group = [q for q in outputs if q.access == access]
            now = np.zeros(len(group), dtype=access.dtype)
            table = np.zeros((ticks, len(group)), dtype=access.dtype)
            getters.append((component.getting(group, now.ctypes.data), now, table, f"get of {access.fmi}"))
            estimate |= {q.name: table[:, i] for i, q in enumerate(group)}
        time, ended = ctypes.c_double(), ctypes.c_char()
        step = component.stepping(time, TICK_S, ctypes.addressof(ended))
        for tick in range(ticks):
            time.value = tick * TICK_S
            for call, now, table, what in setters:
                now[:] = table[tick]
                component.call(call, what, time.value)
            component.call(step, "doStep", time.value)
            for call, now, table, what in getters:
                component.call(call, what, time.value)
                table[tick] = now
    for name, values in estimate.items():
        for tick in np.flatnonzero(~np.isfinite(values))[:1]:
            raise FmuError(
                f'{path}: output "{name}" is {values[tick]} at t = {tick * TICK_S:.10g} s; '
                "expected a finite number"
            )
    return estimate


def hold_speed(signals: SensorSignals, ticks: int) -> dict[str, Array]:
    """Dead reckoning without a filter, (ticks,) each: after the last fix its speed along the heading.

    A heading that is not finite is bridged by the one before it, as the estimators do.
    """
    north, east, speed = (
        getattr(signals, f"gps_{name}")[:ticks].copy() for name in ("north", "east", "speed")
    )
    last = int(np.flatnonzero(signals.gps_fix[:ticks])[-1])
    finite = np.isfinite(signals.heading_meas[:ticks])
    latest = np.maximum.accumulate(np.where(finite, np.arange(ticks), 0))
    steps = speed[last] * TICK_S * np.exp(1j * signals.heading_meas[latest][last + 1 :])
    way = np.cumsum(steps)
    north[last + 1 :], east[last + 1 :] = north[last] + way.real, east[last] + way.imag
    speed[last + 1 :] = speed[last]
    return {"north": north, "east": east, "speed": speed}


@dataclass(frozen=True, eq=False)
class Outage:
    """One simulated outage, with each configuration's error at the last withheld fix."""

    start: float  # s
    end: float  # s
    path_m: float  # length of the path during the outage
    errors: dict[str, tuple[float, float]]  # configuration -> position [m], velocity [m/s]
    estimates: dict[str, tuple[Array, Array]]  # configuration -> north, east during the outage
    time: Array  # s, of the estimates


def replay(
    source: ReplaySource,
    estimator: str,
    chosen: Outages,
    progress: Callable[[int], None] | None = None,
) -> list[Outage]:
    """Run every configuration of an estimator through every outage.

    Args:
        progress: called with the number of outages done.

    Raises:
        FmuError: the FMU fails, or answers no finite number.
        RecordingError: there are no outages to judge.
    """
    if not chosen.windows:
        left_out = f", left out: {counts(chosen.left_out)}" if chosen.left_out else ""
        raise RecordingError(
            f"{source.name}: no outage of {chosen.length:g} s can be judged{left_out}; {chosen.reach}; "
            f"expected {SETTLE:g} s of motion, and {chosen.length:g} s after that with IMU samples and with "
            "fixes at both ends; record longer or take shorter outages"
        )
    path = build_fmu(find_estimator(estimator), build_folder() / "fmi2", 2)
    outages = []
    for number, window in enumerate(chosen.windows):
        signals = source.signals([window])
        inside = np.flatnonzero((signals.t >= window[0]) & (signals.t <= window[1]))
        withheld = inside[signals.reference_fix[inside]]
        last = int(withheld[-1])  # where the errors are measured
        ticks = last + 1
        runs = {HELD: hold_speed(signals, ticks)}
        for name, parameters in CONFIGURATIONS[estimator].items():
            runs[name] = run_fmu(path, signals, ticks, parameters)
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
        estimates = {name: (run["north"][during], run["east"][during]) for name, run in runs.items()}
        outages.append(Outage(*window, path_m, errors, estimates, signals.t[during]))
        if progress:
            progress(number + 1)
    return outages


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
                if len(apart) > 1:
                    pair[column] = _t_test(table[apart, i, j] - table[apart, k, j])
                else:
                    pair[column] = None
            pairs.append(pair)
    return {"configurations": configurations, "paired_t_tests": pairs}


def _t_test(differences: Array) -> dict[str, float | None]:
    """The paired t-test of differences (n,); without spread they have no t."""
    if np.ptp(differences) <= NO_SPREAD * np.abs(differences).max():
        return {"t": None, "p": None}
    test = stats.ttest_1samp(differences, 0.0)
    return {"t": float(test.statistic), "p": float(test.pvalue)}


def disjoint(outages: Sequence[Outage]) -> list[Outage]:
    """The outages, in the order of time, without those that overlap an earlier one."""
    separate: list[Outage] = []
    for outage in outages:
        if not separate or outage.start >= separate[-1].end:
            separate.append(outage)
    return separate


def counts(causes: Mapping[str, int]) -> str:
    """Numbers and causes, in words."""
    return ", ".join(f"{number} × {cause}" for cause, number in causes.items())


def identity(source: ReplaySource, estimator: str, chosen: Outages) -> dict[str, Any]:
    """What tells a replay from others, as outages.json states it."""
    return {"recording": source.name, "estimator": estimator, "outage_s": chosen.length}


def report(
    source: ReplaySource, estimator: str, chosen: Outages, outages: Sequence[Outage], out: Path
) -> dict[str, Any]:
    """Write outages.json and replay.png; returns the content of the JSON.

    Raises:
        UsageError: the folder cannot be made.
        FileError: they cannot be written.
    """
    make_folder(out)
    result = {
        **identity(source, estimator, chosen),
        "dropped": dict(source.dropped),
        "left_out": dict(chosen.left_out),
        "broken": source.broken,
        "notes": list(source.notes),
        **statistics(outages),
        "outages": [
            {
                "start_s": outage.start,
                "end_s": outage.end,
                "path_m": outage.path_m,
                "errors": {
                    name: dict(zip(COLUMNS, values, strict=True)) for name, values in outage.errors.items()
                },
            }
            for outage in outages
        ],
    }
    write_whole(out / "outages.json", (json.dumps(result, indent=2, ensure_ascii=False) + "\n").encode())
    signals = source.signals([])
    fixes = signals.reference_fix
    replay_picture(
        out / "replay.png",
        Track(signals.t[fixes], signals.reference_north[fixes], signals.reference_east[fixes]),
        {name: [Track(o.time, *o.estimates[name]) for o in outages] for name in outages[0].errors},
        {name: values[COLUMNS[0]] for name, values in result["configurations"].items()},
        on_map=[outages.index(outage) for outage in disjoint(outages)],
        title=f"{source.name}: {estimator} through outages of {chosen.length:g} s",
        not_used="\n".join(
            [not_used(result), f"not whole: {source.broken}" if source.broken else ""]
        ).strip(),
    )
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


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the table of errors at the ends of the outages, and the t-tests."""
    table = new_table()
    table.add_column("error at the end of the outage")
    for heading in ("n", "position [m]\nmean", "\nsd", "\nmedian", "\np90"):
        table.add_column(heading, justify="right")
    for heading in ("speed [m/s]\nmean", "\nsd", "\nmedian", "\np90"):
        table.add_column(heading, justify="right")
    for name, values in result["configurations"].items():
        cells = [values[column][key] for column in COLUMNS for key in ("mean", "sd", "median", "p90")]
        table.add_row(name, str(values["n"]), *("-" if cell is None else f"{cell:.2f}" for cell in cells))
    print_table(table, console)
    if lines := not_used(result):
        console.print(lines, markup=False, highlight=False)
    for pair in result["paired_t_tests"]:
        test = pair[COLUMNS[0]]
        if test and test["t"] is not None:
            console.print(
                f"position, {pair['first']} against {pair['second']}: "
                f"t = {test['t']:+.2f}, p = {test['p']:.2g} (paired, n = {pair['n']})",
                style="dim",
            )
