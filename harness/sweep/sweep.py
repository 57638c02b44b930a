"""Sweeps: many trials at each value of one or two parameters, as 5.3.3 varies the deviation threshold h'.

`two` are the text's two-waypoint trials, `three` its four types of three-waypoint trials in turns. What comes
out is a table with a row for each point, its picture, and what it recommends.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from decimal import Decimal
from itertools import product
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from codegen.batch.batch import Change
from harness.files import write_whole
from harness.sweep.chunks import Job, Outcomes, Progress, TrialType, pool_at, program, run_all
from harness.sweep.journal import open_journal
from harness.sweep.plots import sweep_png
from harness.sweep.recommend import number, recommend
from harness.sweep.table import TICK_S, Point, csv_of, plain, table_of
from harness.trial.plan import Interface, interfaces_of_system, is_angular, plan, si_value
from harness.trial.scenario import MAX_SEED, Scenario, ScenarioError, load
from models.errors import UsageError, nearest
from models.kit.declaration import Type, Variable
from models.system import SYSTEMS

TRIAL_TYPES = {"two": ("two_waypoint",), "three": ("right_90", "left_90", "right_45", "left_45")}
THRESHOLD, THRESHOLD_COLUMN = "cmec.moving_deviation", "threshold_deg"
TWO_WAYPOINTS, MORE_WAYPOINTS = "15:90", "15:65"  # deg, 5.3.5 and 5.3.6
MAX_POINTS, MAX_TRIALS = 10_000, 100_000_000
SHOWN = 13  # rows of the table that the terminal gets
CSV, PICTURE, RECOMMENDATION = "sweep.csv", "sweep.png", "recommendation.json"


class SweepError(UsageError):
    """A sweep that makes no sense."""


@dataclass(frozen=True)
class Axis:
    """A varied parameter.

    Attributes:
        column: what the table calls it: its address, or `threshold_deg`.
        unit: in which it is written, deg for angles.
        label: for pictures and texts.
        variable: `component.parameter`.
        written: the values as users write them.
        values: the values in SI.
    """

    column: str
    unit: str
    label: str
    variable: str
    written: tuple[Decimal, ...]
    values: tuple[float, ...]


@dataclass(frozen=True)
class Sweep:
    """What is to be swept.

    Attributes:
        name: `two`, `three`, or the scenario's.
        axes: one or two; the second varies first from point to point.
        job: the same as plain data.
        scenarios: what each type_ is made of.
        reading: of all of them.
    """

    name: str
    axes: tuple[Axis, ...]
    job: Job
    scenarios: tuple[Scenario, ...]
    reading: str

    @property
    def points(self) -> list[tuple[Decimal, ...]]:
        """The varied parameters' values of each point, as written."""
        return list(product(*(axis.written for axis in self.axes)))

    @property
    def about(self) -> str:
        """The sweep in words."""
        ranges = ", ".join(f"{axis.column} {_span(axis.written)}" for axis in self.axes)
        return (
            f"{self.name}: {ranges}, {self.job.trials} trials a point from seed {self.job.seed} on, "
            f"{self.job.system}, {self.reading}"
        )

    @property
    def fingerprint(self) -> str:
        """A hash of all that decides the results."""
        job = asdict(self.job)
        texts = [scenario.text() for scenario in self.scenarios]
        written = [[axis.column, *map(str, axis.written)] for axis in self.axes]
        everything = json.dumps([program(), texts, written, job], sort_keys=True)
        return hashlib.sha256(everything.encode()).hexdigest()


def wanted(
    target: str,
    *,
    thresholds: str | None = None,
    vary: Sequence[str] = (),
    trials: int = 1000,
    system: str = "cts",
    reading: str | None = None,
    seed: int | None = None,
    settings: Sequence[str] = (),
) -> Sweep:
    """What the command line asks for.

    Args:
        target: `two`, `three`, a scenario's file or name; its `system` is not heeded.
        thresholds: `a:b` or `a:b:step` [deg] of h'; by default, unless `vary` says otherwise, 15:90 with one
            waypoint beyond the start, 15:65 with more.
        vary: `block.name=a:b:step` in the units in which users write.
        reading: over that of the scenario.
        seed: of the first trial of each point, over that of the scenario.
        settings: `block.name=value`, over the scenario's parameters.

    Raises:
        ScenarioError: the scenario or a setting makes no sense, or a value is out of its range.
        SweepError: a range, or the number of points, trials or seeds makes no sense.
    """
    if system not in SYSTEMS:
        raise SweepError(f"--system {system}: there is no such system{nearest(system, SYSTEMS)}")
    scenarios = [
        _adapted(name, system, reading, seed, settings) for name in TRIAL_TYPES.get(target, (target,))
    ]
    first = scenarios[0]
    parts = interfaces_of_system(SYSTEMS[system])
    ranges = [_split(text) for text in vary]
    if thresholds is not None or not ranges:
        default = TWO_WAYPOINTS if len(first.waypoints) == 1 else MORE_WAYPOINTS
        ranges.insert(0, ("--thresholds", THRESHOLD, thresholds or default))
    if len(ranges) > 2:
        raise SweepError(
            f"{len(ranges)} parameters are varied ({', '.join(name for _, name, _ in ranges)}); "
            "expected one or two"
        )
    axes = tuple(_axis(option, address, text, first, parts) for option, address, text in ranges)
    if len({axis.variable for axis in axes}) < len(axes):
        raise SweepError(f"{axes[0].variable} is varied twice; vary it once")
    for setting in settings:
        for axis in axes:
            if axis.variable in _variables(setting.partition("=")[0].strip(), parts):
                raise SweepError(f"--set {setting}: the parameter is varied; leave out one of both")
    job = Job(
        system,
        tuple(axis.variable for axis in axes),
        tuple(product(*(axis.values for axis in axes))),
        tuple(_trial_type(scenario, parts) for scenario in scenarios),
        trials,
        first.seed,
    )
    _check_size(job)
    return Sweep(target if target in TRIAL_TYPES else first.name, axes, job, tuple(scenarios), first.reading)


def _check_size(job: Job) -> None:
    if job.trials < 1:
        raise SweepError(f"--trials {job.trials}: expected at least 1")
    if len(job.points) > MAX_POINTS:
        raise SweepError(f"{len(job.points)} points; expected at most {MAX_POINTS}: take larger steps")
    if job.seed + job.trials - 1 > MAX_SEED:
        raise SweepError(
            f"--trials {job.trials}: the last would have seed {job.seed + job.trials - 1}, expected at most "
            f"{MAX_SEED}; take at most {MAX_SEED - job.seed + 1} trials, or a smaller --seed"
        )
    if job.total > MAX_TRIALS:
        raise SweepError(
            f"{len(job.points)} points of {job.trials} trials are {job.total} trials; expected at most "
            f"{MAX_TRIALS}: take at most {MAX_TRIALS // len(job.points)} a point, or fewer points"
        )


def _adapted(
    target: str, system: str, reading: str | None, seed: int | None, settings: Sequence[str]
) -> Scenario:
    """The scenario as it is swept."""
    scenario = load(target)
    if scenario.package is not None:
        raise SweepError(
            f"{target}: runs the package {scenario.system}; a sweep compiles our own systems, "
            f"{' and '.join(SYSTEMS)}: name one of them as its system, or run it with `canine run`"
        )
    scenario = replace(scenario.override(settings, seed), system=system)
    if reading is not None:
        scenario = replace(scenario, reading=reading)
    here = _owners(interfaces_of_system(SYSTEMS[system]))
    for address in [*scenario.parameters, *(s.variable for s in scenario.sets)]:
        owner = address.partition(".")[0]
        for other in SYSTEMS:
            if owner not in here and owner in _owners(interfaces_of_system(SYSTEMS[other])):
                raise SweepError(
                    f'{scenario.name}: {address}: the system "{system}" has no {owner}; '
                    f"sweep with --system {other}, or leave it out"
                )
    return scenario


def _owners(parts: Mapping[str, Interface]) -> set[str]:
    """The names of components and of their blocks."""
    return {*parts, *(part.block for part in parts.values())}


def _variables(address: str, parts: Mapping[str, Interface]) -> list[str]:
    """`component.parameter` of an address; a vector's name stands for its elements."""
    owner, _, name = address.partition(".")
    return [
        f"{component}.{flat}"
        for component, part in parts.items()
        if owner in (component, part.block)
        for flat in part.parameters
        if name in (flat, flat.partition("[")[0])
    ]


def _trial_type(scenario: Scenario, parts: Mapping[str, Interface]) -> TrialType:
    """A scenario resolved against its system, by ticks.

    Raises:
        ScenarioError: as `plan` does; or it sets an input that is connected.
    """
    found = plan(scenario, parts)
    fed = {(link.target, link.target_variable) for link in SYSTEMS[scenario.system].links}
    changes = []
    for event in found.events:
        if (event.component, event.variable) in fed:
            raise ScenarioError(
                f"{scenario.name}: [[set]] {event.component}.{event.variable} is connected; "
                "only free inputs can be set"
            )
        tick = math.ceil(event.time / TICK_S - 1e-9)
        changes.append(Change(tick, event.component, event.variable, event.value))
    return TrialType(
        scenario.name, found.values, tuple(changes), math.floor(scenario.duration / TICK_S + 1e-9)
    )


def _split(text: str) -> tuple[str, str, str]:
    """The option's text, the address and the range of `--vary`."""
    address, equals, values = text.partition("=")
    if not equals or not address.strip() or not values.strip():
        raise SweepError(f"--vary {text}: expected block.name=a:b:step, as in cmec.capture_radius=3:10:0.5")
    return f"--vary {text}", address.strip(), values.strip()


def _axis(option: str, address: str, text: str, scenario: Scenario, parts: Mapping[str, Interface]) -> Axis:
    """A varied parameter, checked as if each value were set."""
    what = option if option.startswith("--vary") else f"--thresholds {text}"
    written = _range(what, text)
    named = replace(scenario, name=what, parameters={address: float(written[0])}, sets=())
    variables = _variables(address, parts)
    if len(variables) != 1:
        if len(variables) > 1:
            raise SweepError(f"{what}: is a vector; vary one element, as in {address}[1]")
        plan(named, parts)  # which says what is wrong
        raise SweepError(f"{what}: there is nothing to vary")
    component, _, name = variables[0].partition(".")
    variable = parts[component].parameters[name]
    if name == "seed":
        raise SweepError(f"{what}: each trial has its seed; choose the first with --seed")
    values = tuple(si_value(_as_written(value, variable), variable, what) for value in written)
    is_threshold = variables[0] == _variables(THRESHOLD, parts)[0]
    unit = variable.unit.replace("rad", "deg") if is_angular(variable) else variable.unit
    label = "orientation deviation threshold" if is_threshold else address
    return Axis(
        THRESHOLD_COLUMN if is_threshold else address,
        "" if unit == "1" else unit,
        label, variables[0], written, values,
    )  # fmt: skip


def _as_written(value: Decimal, variable: Variable) -> bool | int | float:
    """A value of a range as it would stand in a scenario: 0 and 1 are false and true."""
    if variable.type is Type.BOOLEAN and value in (0, 1):
        return bool(value)
    return int(value) if value == int(value) else float(value)


def _range(what: str, text: str) -> tuple[Decimal, ...]:
    """The values of `a:b:step`, with b if a step falls on it; as decimals, so that 0.1:0.3:0.1 has 0.3."""
    fields = text.split(":")
    if len(fields) not in (2, 3):
        raise SweepError(f"{what}: expected a:b:step, as in 15:90:5")
    numbers = [_number(what, field) for field in fields]
    first, last, step = numbers if len(numbers) == 3 else (*numbers, Decimal(1))
    if step <= 0:
        raise SweepError(f"{what}: the step is {step}; expected more than 0")
    if last < first:
        raise SweepError(f"{what}: the range is empty, {first} is more than {last}; expected a:b with a <= b")
    if (last - first) / step >= MAX_POINTS:
        raise SweepError(f"{what}: has more than {MAX_POINTS} points; take larger steps")
    return tuple(first + k * step for k in range(int((last - first) / step) + 1))


def _number(what: str, text: str) -> Decimal:
    try:
        if math.isfinite(float(text)) and abs(float(text)) <= 1e12:
            return Decimal(text.strip())
    except (ValueError, ArithmeticError):
        pass
    raise SweepError(f'{what}: "{text}" is no number; expected a:b:step, as in 15:90:5')


def _span(written: Sequence[Decimal]) -> str:
    step = f" in steps of {plain(written[1] - written[0])}" if len(written) > 1 else ""
    return f"{plain(written[0])} to {plain(written[-1])}{step}"


def default_folder(sweep: Sweep) -> Path:
    """Where the results go if nobody says."""
    return Path("out") / f"sweep-{sweep.name}"


def run(
    sweep: Sweep,
    folder: Path,
    address: str | None = None,
    *,
    progress: Progress | None = None,
    note: Callable[[str], None] = lambda text: None,
) -> tuple[list[Point], dict[str, Any]]:
    """Run what an earlier process has not, and write the results; table and recommendation.

    Results of an earlier sweep stay until these are there.

    Args:
        address: of a Dask scheduler, or None for this machine's cores.
        progress: is told the number of trials done.
        note: is told what the user should know.

    Raises:
        UsageError: the folder is in use or has folders where results go, or the address answers not.
        CanineError: a fault in what was run, or on the disk; chunks that are done are kept.
        KeyboardInterrupt: the user ended it; chunks that are done are kept.
    """
    for name in (CSV, PICTURE, RECOMMENDATION):
        if os.path.isdir(folder / name):  # which raises nothing
            raise SweepError(f"{folder / name}: is a folder; remove it, or choose another one with --out")
    with open_journal(folder, sweep.job, sweep.fingerprint, sweep.about) as journal:
        outcomes = Outcomes(sweep.job)
        for chunk in journal.found:
            outcomes.add(chunk)
        if journal.dropped:
            lines = f"{journal.dropped} damaged line{'s' * (journal.dropped > 1)}"
            note(f"{journal.path}: {lines} left out; what was in there is run again")
        if outcomes.done:
            note(f"{outcomes.done} of {sweep.job.total} trials are there from before; going on")
            if progress:
                progress(outcomes.done)
        try:
            if outcomes.done < sweep.job.total:
                with pool_at(address, sweep.job) as pool:
                    run_all(outcomes, pool, journal.append, progress)
        except BaseException:
            if journal.empty:
                journal.remove()
            raise
        found = report(sweep, outcomes, folder)
        journal.remove()
    return found


def report(sweep: Sweep, outcomes: Outcomes, folder: Path) -> tuple[list[Point], dict[str, Any]]:
    """Write sweep.csv, sweep.png and recommendation.json over those of an earlier sweep, when all are made.

    Raises:
        FileError: they cannot be written.
    """
    table = table_of(sweep.points, outcomes)
    axes = [(axis.column, axis.unit, axis.written) for axis in sweep.axes]
    result = {
        "sweep": sweep.name,
        "system": sweep.job.system,
        "reading": sweep.reading,
        "trials": sweep.job.trials,
        "seed": sweep.job.seed,
        "varied": {
            axis.column: {
                "parameter": axis.variable,
                "unit": axis.unit,
                "from": number(axis.written[0]),
                "to": number(axis.written[-1]),
                "points": len(axis.written),
            }
            for axis in sweep.axes
        },
        **recommend(axes, table, outcomes.ticks),
    }
    words = (json.dumps(result, indent=2, allow_nan=False) + "\n").encode()
    picture = sweep_png(
        [(axis.label, axis.unit, axis.written) for axis in sweep.axes], table, result, sweep.about
    )
    rows = csv_of([axis.column for axis in sweep.axes], table)
    for name, content in ((CSV, rows), (PICTURE, picture), (RECOMMENDATION, words)):
        write_whole(folder / name, content)
    return table, result


def show(sweep: Sweep, table: Sequence[Point], result: Mapping[str, Any], console: Console) -> None:
    """Print some rows of the table, and the recommendation in words."""
    shown = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for axis in sweep.axes:
        shown.add_column(escape(axis.column), justify="right", no_wrap=True)
    for heading in ("success", "95 % interval", "time [s]", "sd", "commands", "timeouts"):
        shown.add_column(escape(heading), justify="right")
    step = math.ceil(len(table) / SHOWN)
    for point in table[::step]:
        low, high = point.interval
        means = (point.mean_time, point.sd_time, point.mean_commands)
        shown.add_row(
            *map(plain, point.written),
            f"{100 * point.success_rate:.1f} %",
            f"{100 * low:.1f}-{100 * high:.1f}",
            *("-" if mean is None else f"{mean:.2f}" for mean in means),
            str(point.timeouts),
        )
    console.print(shown)
    if step > 1:
        console.print(f"1 in {step} of {len(table)} points", style="dim")
    for key in ("success", "time", "both", "pareto"):
        console.print(escape(result[key]["text"]), soft_wrap=True)
