"""A recording through the estimator FMU, with the GPS taken away for a while wherever that fits (3.3.6, D.7).

For each simulated outage the estimator runs from the start of the recording to the end of the outage, as on
board, and is compared there with the fixes that were kept from it. `speed held` is dead reckoning without a
filter: the last fix, then its speed along the measured heading.
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
from rich.table import Table
from scipy import stats

from fmus.build import build_fmu, build_folder
from harness.cosim.fmu import FmuError, FmuInstance
from harness.files import make_folder, write_whole
from harness.log.log import read_log
from harness.replay.attitude import TICK_S, Array
from harness.replay.plots import replay_picture
from harness.replay.recording import MOVING_M_S, RecordingError, SensorSignals, read_recording, sensor_signals
from models.errors import UsageError, nearest
from models.four_state import FourState
from models.kit.block import Block

Window = tuple[float, float]  # s, start and end of an outage

HELD = "speed held"
SETTLE = 10.0  # s that the estimator has before the first outage
ESTIMATORS: dict[str, type[Block]] = {block.title(): block for block in (FourState,)}
CONFIGURATIONS: dict[str, dict[str, dict[str, float]]] = {
    "four_state": {
        "no pitch": {"use_pitch": 0, "fuzzy": 0},
        "pitch": {"use_pitch": 1, "fuzzy": 0},
        "fuzzy": {"use_pitch": 1, "fuzzy": 1},
    }
}
COLUMNS = ("position_error_m", "velocity_error_m_s")


@dataclass(frozen=True)
class ReplaySource:
    """What can be replayed: a recording of real sensors, or the log of a trial.

    Attributes:
        signals: what the estimator gets when the fixes within some windows are withheld.
        broken: why the recording is not whole, "" if it is.
    """

    name: str
    signals: Callable[[Sequence[Window]], SensorSignals]
    broken: str = ""

    @property
    def folder(self) -> Path:
        """Where the results go if nobody says."""
        return Path("out") / f"replay-{self.name}"

    def windows(self, length: float, every: float, settle: float = SETTLE) -> list[Window]:
        """Outages of `length` [s], every `every` [s], from `settle` [s] after the first moving fix."""
        given = self.signals([])
        moving = given.t[given.reference_fix & (given.reference_speed > MOVING_M_S)]
        if not len(moving):
            return []
        fixes = given.t[given.reference_fix]
        starts = np.arange(np.ceil(moving[0] + settle), fixes[-1] - length + 1e-9, every)
        # without a fix inside, there is nothing to judge by
        return [
            (float(start), float(start + length))
            for start in starts
            if ((fixes >= start) & (fixes <= start + length)).any()
        ]


def find_estimator(name: str) -> type[Block]:
    """The estimator's block of this name.

    Raises:
        UsageError: there is none.
    """
    if name not in ESTIMATORS:
        raise UsageError(f'there is no estimator "{name}"{nearest(name, ESTIMATORS)}')
    return ESTIMATORS[name]


def open_source(path: Path) -> ReplaySource:
    """A folder with a recording, or a trial.mcap.

    Raises:
        RecordingError, LogError: it is neither, or is damaged.
    """
    if path.suffix == ".mcap":
        return _of_log(path)
    recording = read_recording(path)
    return ReplaySource(path.resolve().name, lambda chosen: sensor_signals(recording, chosen))


def _of_log(path: Path) -> ReplaySource:
    log = read_log(path)
    needed = {name for block in ESTIMATORS.values() for name in block.flat_names("input")} | {"gps_course"}
    missing = [s for s in (f"sensors.{name}" for name in sorted(needed)) if s not in log]
    if missing:
        raise RecordingError(
            f'{path}: the log has no signal "{missing[0]}"; expected a trial with sensors, such as '
            "`canine run three_waypoint` makes"
        )
    fixed = log["sensors.gps_fix"] > 0

    def masked(chosen: Sequence[Window]) -> SensorSignals:
        used = fixed.copy()
        for start, end in chosen:
            used &= (log.time < start) | (log.time > end)
        latest = np.maximum.accumulate(np.where(used, np.arange(len(used)), 0))  # fix that is held
        given: dict[str, Any] = {}
        for name in (f.name for f in fields(SensorSignals)):
            recorded = log[f"sensors.{name}"] if f"sensors.{name}" in log else np.zeros(len(used))
            given[name] = recorded[latest] if name.startswith("gps_") else recorded
        for name in ("north", "east", "speed", "course"):
            given[f"reference_{name}"] = log[f"sensors.gps_{name}"]
        given |= {"t": log.time, "gps_fix": used, "reference_fix": fixed}
        given |= {"origin_latitude": log.origin[0], "origin_longitude": log.origin[1]}
        return SensorSignals(**given)

    scenario = log.metadata.get("scenario", {})
    name = f"{scenario.get('name', path.stem)}-{scenario.get('seed', '')}".strip("-")
    return ReplaySource(name, masked, log.broken)


def run_fmu(
    path: Path, given: SensorSignals, ticks: int, parameters: Mapping[str, float]
) -> dict[str, Array]:
    """An estimator's FMU over the first `ticks` ticks: the estimate, arrays (ticks,) by output.

    Raises:
        FmuError: the FMU fails, or has inputs that are no signals.
    """
    with FmuInstance("estimator", path) as component:
        inputs, outputs = component.description.inputs.values(), component.description.outputs.values()
        known = {f.name for f in fields(SensorSignals)}
        for quantity in inputs:
            if quantity.name not in known:
                raise FmuError(f'{path}: input "{quantity.name}" is no sensor signal; cannot be replayed')
        component.initialize(parameters)
        feeds, keeps = [], []  # (call, its values, all ticks' values, what it does)
        for access in dict.fromkeys(q.access for q in inputs):
            chosen = [q for q in inputs if q.access == access]
            table = np.column_stack([getattr(given, q.name)[:ticks] for q in chosen]).astype(access.dtype)
            now = np.zeros(len(chosen), dtype=access.dtype)
            feeds.append((component.setting(chosen, now.ctypes.data), now, table, f"set of {access.fmi}"))
        estimate = {q.name: np.zeros(ticks) for q in outputs}
        for access in dict.fromkeys(q.access for q in outputs):
            chosen = [q for q in outputs if q.access == access]
            now = np.zeros(len(chosen), dtype=access.dtype)
            table = np.zeros((ticks, len(chosen)), dtype=access.dtype)
            keeps.append((component.getting(chosen, now.ctypes.data), now, table, f"get of {access.fmi}"))
            estimate |= {q.name: table[:, i] for i, q in enumerate(chosen)}
        time, ended = ctypes.c_double(), ctypes.c_char()
        step = component.stepping(time, TICK_S, ctypes.addressof(ended))
        for tick in range(ticks):
            time.value = tick * TICK_S
            for call, now, table, what in feeds:
                now[:] = table[tick]
                component.call(call, what, time.value)
            component.call(step, "doStep", time.value)
            for call, now, table, what in keeps:
                component.call(call, what, time.value)
                table[tick] = now
    return estimate


def hold_speed(given: SensorSignals, ticks: int) -> dict[str, Array]:
    """Dead reckoning without a filter: from the last fix on its speed along the heading, (ticks,) each."""
    north, east, speed = (getattr(given, f"gps_{name}")[:ticks].copy() for name in ("north", "east", "speed"))
    last = int(np.flatnonzero(given.gps_fix[:ticks])[-1])
    steps = speed[last] * TICK_S * np.exp(1j * given.heading_meas[last + 1 : ticks])
    way = np.cumsum(steps)
    north[last + 1 :], east[last + 1 :] = north[last] + way.real, east[last] + way.imag
    speed[last + 1 :] = speed[last]
    return {"north": north, "east": east, "speed": speed}


@dataclass(frozen=True, eq=False)
class Outage:
    """One simulated outage: what each configuration was off by at the fix that ends it."""

    start: float  # s
    end: float  # s
    path_m: float  # length of the way gone meanwhile
    errors: dict[str, tuple[float, float]]  # configuration -> position [m], velocity [m/s]
    estimates: dict[str, tuple[Array, Array]]  # configuration -> north, east over the outage
    time: Array  # s, of the estimates


def replay(
    source: ReplaySource,
    estimator: str,
    chosen: Sequence[Window],
    progress: Callable[[int], None] | None = None,
) -> list[Outage]:
    """Run every configuration through every outage.

    Raises:
        FmuError: the FMU fails.
        RecordingError: there is no outage to run through.
    """
    if not chosen:
        raise RecordingError(
            f"{source.name}: no outage fits; expected fixes, {SETTLE:g} s of motion before the first outage, "
            "and its length after that; record longer or take shorter outages"
        )
    path = build_fmu(find_estimator(estimator), build_folder() / "fmi2", 2)
    found = []
    for number, window in enumerate(chosen):
        given = source.signals([window])
        inside = np.flatnonzero((given.t >= window[0]) & (given.t <= window[1]))
        judged = int(inside[given.reference_fix[inside]][-1])  # the last fix that was kept from it
        ticks = judged + 1
        runs = {HELD: hold_speed(given, ticks)}
        for name, parameters in CONFIGURATIONS[estimator].items():
            runs[name] = run_fmu(path, given, ticks, parameters)
        away = {
            name: (
                float(
                    np.hypot(
                        run["north"][judged] - given.reference_north[judged],
                        run["east"][judged] - given.reference_east[judged],
                    )
                ),
                float(abs(run["speed"][judged] - given.reference_speed[judged])),
            )
            for name, run in runs.items()
        }
        fixes = inside[given.reference_fix[inside]]
        gone = np.hypot(np.diff(given.reference_north[fixes]), np.diff(given.reference_east[fixes])).sum()
        shown = slice(int(inside[0]), ticks)
        found.append(
            Outage(
                *window, float(gone), away,
                {name: (run["north"][shown], run["east"][shown]) for name, run in runs.items()},
                given.t[shown],
            )
        )  # fmt: skip
        if progress:
            progress(number + 1)
    return found


def statistics(found: Sequence[Outage]) -> dict[str, Any]:
    """Mean, standard deviation, median and 90th percentile of the errors, and paired two-tailed t-tests.

    The tests are of outages that do not overlap: others share what they are judged by.
    """
    names = list(found[0].errors)
    table = np.array([[outage.errors[name] for name in names] for outage in found])  # (n, configurations, 2)
    of: dict[str, dict[str, Any]] = {}
    for i, name in enumerate(names):
        of[name] = {"n": len(found)}
        for j, column in enumerate(COLUMNS):
            values = table[:, i, j]
            of[name][column] = {
                "mean": float(values.mean()),
                "sd": float(values.std(ddof=1)) if len(found) > 1 else None,
                "median": float(np.median(values)),
                "p90": float(np.percentile(values, 90)),
            }
    separate = disjoint(found)
    apart = [i for i, outage in enumerate(found) if outage in separate]
    pairs = []
    for i, first in enumerate(names):
        for k in range(i + 1, len(names)):
            pair: dict[str, Any] = {"first": first, "second": names[k], "n": len(apart)}
            for j, column in enumerate(COLUMNS):
                if len(apart) > 1:
                    test = stats.ttest_rel(table[apart, i, j], table[apart, k, j])
                    pair[column] = {"t": _number(test.statistic), "p": _number(test.pvalue)}
                else:
                    pair[column] = None
            pairs.append(pair)
    return {"configurations": of, "paired_t_tests": pairs}


def disjoint(found: Sequence[Outage]) -> list[Outage]:
    """Those of the outages, by time, that do not overlap with one before."""
    chosen: list[Outage] = []
    for outage in found:
        if not chosen or outage.start >= chosen[-1].end:
            chosen.append(outage)
    return chosen


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def report(source: ReplaySource, estimator: str, found: Sequence[Outage], out: Path) -> dict[str, Any]:
    """Write outages.json and replay.png; what the JSON holds.

    Raises:
        UsageError: the folder cannot be made.
        FileError: they cannot be written.
    """
    make_folder(out)
    result = {
        "recording": source.name,
        "estimator": estimator,
        **statistics(found),
        "outages": [
            {
                "start_s": outage.start,
                "end_s": outage.end,
                "path_m": outage.path_m,
                "errors": {
                    name: dict(zip(COLUMNS, values, strict=True)) for name, values in outage.errors.items()
                },
            }
            for outage in found
        ],
    }
    write_whole(out / "outages.json", (json.dumps(result, indent=2) + "\n").encode())
    given = source.signals([])
    fixes = given.reference_fix
    shown = disjoint(found)  # overlapping ones would hide each other
    replay_picture(
        out / "replay.png",
        (given.t[fixes], given.reference_north[fixes], given.reference_east[fixes]),
        [(name, *_joined(shown, name)) for name in found[0].errors],
        [(outage.start, outage.end) for outage in shown],
        f"{source.name}: {estimator} through outages of {found[0].end - found[0].start:g} s",
    )
    return result


def _joined(shown: Sequence[Outage], name: str) -> tuple[Array, Array, Array]:
    """Time, north and east of a configuration over the outages, NaN between them."""
    gap = np.array([np.nan])
    parts = [np.stack([o.time, *o.estimates[name]]) for o in shown]
    time, north, east = np.hstack([np.hstack([part, np.tile(gap, (3, 1))]) for part in parts])
    return time, north, east


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the table of errors at the ends of the outages, and the t-tests."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("off at the end of the outage")
    for heading in ("n", "position [m]\nmean", "\nsd", "\nmedian", "\np90"):
        table.add_column(heading, justify="right")
    for heading in ("speed [m/s]\nmean", "\nsd", "\nmedian", "\np90"):
        table.add_column(heading, justify="right")
    for name, values in result["configurations"].items():
        cells = [values[column][key] for column in COLUMNS for key in ("mean", "sd", "median", "p90")]
        table.add_row(name, str(values["n"]), *("-" if cell is None else f"{cell:.2f}" for cell in cells))
    console.print(table)
    for pair in result["paired_t_tests"]:
        test = pair[COLUMNS[0]]
        if test and test["t"] is not None:
            console.print(
                f"position, {pair['first']} against {pair['second']}: "
                f"t = {test['t']:+.2f}, p = {test['p']:.2g} (paired, n = {pair['n']})",
                style="dim",
            )
