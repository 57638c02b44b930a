"""Sweeps: many trials at each value of one or two parameters, as 5.3.3 varies the deviation threshold h'.

`two` are the text's two-waypoint trials, `three` its four types of three-waypoint trials in turns. The
results are a table with a row for each point, a picture, and a recommendation.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from decimal import Decimal
from itertools import product
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from codegen.batch.batch import Change
from harness.files import replaced, write_whole
from harness.sweep.chunks import Job, Outcomes, Progress, TrialType, pool_at, program, run_all
from harness.sweep.journal import open_journal
from harness.sweep.recommend import number, recommend
from harness.sweep.table import THRESHOLD_COLUMN, TICK_S, Point, csv_of, name_of, plain, table_of
from harness.sweep.tls import Certificates
from harness.terminal import new_table, percent, print_table
from harness.trial.faults import Faults, resolve_faults
from harness.trial.pairs import check_windows, is_paired
from harness.trial.plan import Interface, interfaces_of_system, is_angular, plan, si_value
from harness.trial.scenario import LOST, Scenario, ScenarioError, checked, load, with_estimator
from models.disturbance import Kind, disturb
from models.errors import UsageError, nearest
from models.kit.declaration import Type, Variable
from models.kit.random import MAX_SEED
from models.readings import READING
from models.system import ESTIMATOR, SYSTEMS, find_estimator, find_system

TRIAL_TYPES = {"two": ("two_waypoint",), "three": ("right_90", "left_90", "right_45", "left_45")}
THRESHOLD = "cmec.moving_deviation"
TWO_WAYPOINTS, MORE_WAYPOINTS = "15:90", "15:65"  # deg, 5.3.5 and 5.3.6
MAX_POINTS, MAX_TRIALS = 10_000, 100_000_000
SHOWN = 13  # rows of the table in the terminal
CSV, PICTURE, RECOMMENDATION = "sweep.csv", "sweep.png", "recommendation.json"


class SweepError(UsageError):
    """A sweep's options are invalid."""


@dataclass(frozen=True)
class Axis:
    """A varied parameter.

    Attributes:
        column: its name in the table: its address, or `threshold_deg`.
        unit: of `written`; deg for angles.
        variable: `component.parameter`.
        written: the values as users write them.
        values: the values in SI.
    """

    column: str
    unit: str
    variable: str
    written: tuple[Decimal, ...]
    values: tuple[float, ...]

    @property
    def label(self) -> str:
        """Its name and unit in tables and pictures."""
        return name_of(self.column) + (f" [{self.unit}]" if self.unit else "")


@dataclass(frozen=True)
class Sweep:
    """A sweep, checked and resolved.

    Attributes:
        name: `two`, `three`, or the scenario's.
        axes: one or two; the last varies first from point to point.
        job: the trials as plain data.
        scenarios: one for each type of trial.
        reading: of all scenarios.
        special: what differs from the sweep of the name alone: reading, system, seed, varied parameters.
    """

    name: str
    axes: tuple[Axis, ...]
    job: Job
    scenarios: tuple[Scenario, ...]
    reading: str
    special: tuple[str, ...] = ()

    @property
    def points(self) -> list[tuple[Decimal, ...]]:
        """The varied parameters' values of each point, as written."""
        return list(product(*(axis.written for axis in self.axes)))

    @property
    def about(self) -> str:
        """The sweep in words."""
        ranges = ", ".join(f"{name_of(axis.column)} {_span(axis)}" for axis in self.axes)
        return (
            f"{self.name}: {ranges}, {self.job.trials} trials a point from seed {self.job.seed} on, "
            f"{find_system(self.job.system, self.job.estimator).name}, {self.reading}"
        )

    @property
    def identity(self) -> dict[str, Any]:
        """What tells the sweep from others, as recommendation.json states it."""
        return {
            "sweep": self.name,
            "system": find_system(self.job.system, self.job.estimator).name,
            "reading": self.reading,
            "trials": self.job.trials,
            "seed": self.job.seed,
            "varied": {
                axis.column: {
                    "name": name_of(axis.column),
                    "parameter": axis.variable,
                    "unit": axis.unit,
                    "from": number(axis.written[0]),
                    "to": number(axis.written[-1]),
                    "points": len(axis.written),
                }
                for axis in self.axes
            },
            "scenarios": {scenario.name: _told_by_scenario(scenario) for scenario in self.scenarios},
        }

    @property
    def fingerprint(self) -> str:
        """A hash of everything that decides the results."""
        job = asdict(self.job)
        texts = [scenario.text() for scenario in self.scenarios]
        written = [[axis.column, *map(str, axis.written)] for axis in self.axes]
        everything = json.dumps([program(), texts, written, job], sort_keys=True, default=str)
        return hashlib.sha256(everything.encode()).hexdigest()


def plan_sweep(
    target: str | Scenario,
    *,
    thresholds: str | None = None,
    vary: Sequence[str] = (),
    trials: int = 1000,
    system: str = "cts",
    reading: str | None = None,
    seed: int | None = None,
    settings: Sequence[str] = (),
    estimator: str | None = None,
    ahrs: bool = False,
    note: Callable[[str], None] = lambda text: None,
) -> Sweep:
    """Resolve the options of `canine sweep` to a sweep.

    Args:
        target: `two`, `three`, a scenario, its file or name; `system` overrides the scenario's.
        thresholds: `a`, `a:b` or `a:b:step` [deg] of h'. By default, if `vary` is empty, 15:90 with one
            waypoint beyond the start and 15:65 with more.
        vary: `block.name=a:b:step`, in users' units.
        trials: at each point.
        system: name of one of SYSTEMS.
        reading: overrides the scenario's.
        seed: of the first trial at each point; overrides the scenario's.
        settings: `block.name=value`; override the scenario's parameters.
        estimator: of ours; by default the scenario's where the system has one.
        ahrs: put our AHRS between sensors and estimator of the system full.
        note: called with a line for the user.

    Raises:
        ScenarioError: the scenario or a setting is invalid, or a value is out of its range.
        SweepError: a range, or the number of points, trials or seeds is invalid.
    """
    if system not in SYSTEMS:
        raise SweepError(f"--system {system}: there is no such system{nearest(system, SYSTEMS)}")
    if ahrs and system not in ("full", "full_ahrs"):
        raise SweepError(f"--ahrs: the system {system} has no sensors; sweep with --system full")
    system = "full_ahrs" if ahrs else system
    if estimator is not None:
        find_estimator(estimator)
        if system not in with_estimator():
            raise SweepError(
                f"--estimator {estimator}: the system {system} gives the controller the true state; "
                "sweep with --system full"
            )
    targets = (target,) if isinstance(target, Scenario) else TRIAL_TYPES.get(target, (target,))
    scenarios = [_adapted(one, (system, estimator), reading, seed, settings) for one in targets]
    first = scenarios[0]
    interfaces = interfaces_of_system(find_system(system, first.estimator))
    ranges = [_split(text) for text in vary]
    if thresholds is not None or not ranges:
        default = TWO_WAYPOINTS if len(first.waypoints) == 1 else MORE_WAYPOINTS
        ranges.insert(0, ("--thresholds", THRESHOLD, default if thresholds is None else thresholds))
    if len(ranges) > 2:
        raise SweepError(
            f"{len(ranges)} parameters are varied ({', '.join(name for _, name, _ in ranges)}); "
            "expected one or two"
        )
    axes = tuple(_axis(option, address, text, first, interfaces) for option, address, text in ranges)
    if len({axis.variable for axis in axes}) < len(axes):
        raise SweepError(f"{axes[0].variable} is varied twice; vary it once")
    for setting in settings:
        for axis in axes:
            if axis.variable in _variables(setting.partition("=")[0].strip(), interfaces):
                raise SweepError(f"--set {setting}: the parameter is varied; leave out one of the two")
    job = Job(
        system,
        tuple(axis.variable for axis in axes),
        tuple(product(*(axis.values for axis in axes))),
        tuple(_trial_type(scenario, interfaces, axes, note) for scenario in scenarios),
        trials,
        first.seed,
        estimator=first.estimator,
        faults=_faults(first, interfaces).links,
    )
    _check_size(job)
    own = targets[0] if isinstance(targets[0], Scenario) else load(targets[0])
    columns = tuple(axis.column for axis in axes)
    chosen = first.reading or READING
    special = (
        *([chosen] if chosen != (own.reading or READING) else []),
        *([system] if system != "cts" else []),
        *([first.estimator] if first.estimator != ESTIMATOR else []),
        *([f"seed{first.seed}"] if first.seed != own.seed else []),
        *(columns if columns != (THRESHOLD_COLUMN,) else ()),
    )
    name = target if isinstance(target, str) and target in TRIAL_TYPES else first.name
    return Sweep(name, axes, job, tuple(scenarios), chosen, special)


def _told_by_scenario(scenario: Scenario) -> dict[str, Any]:
    """A scenario with its settings, without what the sweep states for all."""
    content = tomllib.loads(scenario.text())
    return {
        key: value
        for key, value in content.items()
        if key not in ("name", "system", "estimator", "reading", "seed")
    }


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
    target: str | Scenario,
    chosen: tuple[str, str | None],
    reading: str | None,
    seed: int | None,
    settings: Sequence[str],
) -> Scenario:
    """A type of trial's scenario with the sweep's options: system and estimator, reading, seed, settings."""
    system, estimator = chosen
    scenario = checked(target) if isinstance(target, Scenario) else load(target, known=TRIAL_TYPES)
    if scenario.package is not None:
        raise SweepError(
            f"{scenario.name}: runs the package {scenario.system}; a sweep compiles our own systems, "
            f"{' and '.join(SYSTEMS)}: name one of them as its system, or run it with `canine run`"
        )
    if system not in with_estimator():
        estimator = ESTIMATOR
    scenario = replace(scenario, system=system, estimator=estimator or scenario.estimator)
    scenario = scenario.override(settings, seed)
    scenario = replace(scenario, reading=reading or scenario.reading or READING)
    owners = _owners(interfaces_of_system(find_system(system, scenario.estimator)))
    disturbed = [fault.signal for fault in scenario.faults if fault.kind != LOST]
    for address in [*scenario.parameters, *(s.variable for s in scenario.sets), *disturbed]:
        owner = address.partition(".")[0]
        for other in SYSTEMS:
            if owner not in owners and owner in _owners(interfaces_of_system(SYSTEMS[other])):
                raise SweepError(
                    f'{scenario.name}: {address}: the system "{system}" has no {owner}; '
                    f"sweep with --system {other}, or leave it out"
                )
    return scenario


def _owners(interfaces: Mapping[str, Interface]) -> set[str]:
    """The names of the components and of their blocks."""
    return {*interfaces, *(interface.block for interface in interfaces.values())}


def _variables(address: str, interfaces: Mapping[str, Interface]) -> list[str]:
    """`component.parameter` of an address; a vector's name stands for all its elements."""
    owner, _, name = address.partition(".")
    return [
        f"{component}.{flat}"
        for component, interface in interfaces.items()
        if owner in (component, interface.block)
        for flat in interface.parameters
        if name in (flat, flat.partition("[")[0])
    ]


def _trial_type(
    scenario: Scenario,
    interfaces: Mapping[str, Interface],
    axes: Sequence[Axis],
    note: Callable[[str], None],
) -> TrialType:
    """A scenario resolved against its system, with ticks for times.

    Raises:
        ScenarioError: as `plan` raises it, or the scenario sets an input that is connected.
    """
    resolved = plan(scenario, interfaces, varied=[axis.variable for axis in axes])
    for text in resolved.notes:
        note(f"{scenario.name}: {text}")
    _check_windows(scenario, interfaces, axes, resolved.values)
    connected = {
        (link.target, link.target_variable) for link in find_system(scenario.system, scenario.estimator).links
    }
    changes = []
    for event in resolved.events:
        if (event.component, event.variable) in connected:
            raise ScenarioError(
                f"{scenario.name}: [[set]] {event.component}.{event.variable} is connected; "
                "only free inputs can be set"
            )
        tick = math.ceil(event.time / TICK_S - 1e-9)
        changes.append(Change(tick, event.component, event.variable, event.value))
    last = math.floor(scenario.duration / TICK_S + 1e-9)
    faults = _faults(scenario, interfaces)
    _, placed = disturb(find_system(scenario.system, scenario.estimator).links, faults.links)
    values = resolved.values | faults.values_of(placed)
    return TrialType(scenario.name, values, tuple(changes), last)


def _faults(scenario: Scenario, interfaces: Mapping[str, Interface]) -> Faults:
    """The faults of a scenario's signals.

    Raises:
        ScenarioError: as `resolve_faults` raises it, or a fault ends trials before their time.
    """
    faults = resolve_faults(
        scenario, interfaces, find_system(scenario.system, scenario.estimator).links, TICK_S
    )
    for link, values in zip(faults.links, faults.values, strict=True):
        if values["kind"] == Kind.NAN and link.source == "plant" and "sensors" in interfaces:
            raise ScenarioError(
                f"{scenario.name}: [[fault]] nan of plant.{link.source_variable}: the sensors answer with "
                "what is not finite, which ends a trial; disturb a signal of the sensors"
            )
    return faults


def _check_windows(
    scenario: Scenario,
    interfaces: Mapping[str, Interface],
    axes: Sequence[Axis],
    values: Mapping[str, Mapping[str, float]],
) -> None:
    """Refuse a point of the sweep at which a window ends before it starts."""
    owners = [axis.variable.partition(".") for axis in axes]
    if not any(is_paired(interfaces[component].block, name) for component, _, name in owners):
        return
    for point in product(*(axis.values for axis in axes)):
        at_point = {component: dict(own) for component, own in values.items()}
        for (component, _, name), value in zip(owners, point, strict=True):
            at_point[component][name] = value
        for component, interface in interfaces.items():
            check_windows(interface.block, at_point[component], scenario.name)


def _split(text: str) -> tuple[str, str, str]:
    """The option's text, the address and the range of `--vary`."""
    address, equals, values = text.partition("=")
    if not equals or not address.strip() or not values.strip():
        raise SweepError(f"--vary {text}: expected block.name=a:b:step, as in cmec.capture_radius=3:10:0.5")
    return f"--vary {text}", address.strip(), values.strip()


def _axis(
    option: str, address: str, text: str, scenario: Scenario, interfaces: Mapping[str, Interface]
) -> Axis:
    """A varied parameter, each of whose values is checked as `--set` checks one."""
    what = option if option.startswith("--vary") else f"--thresholds {text}"
    written = _range(what, text)
    variables = _variables(address, interfaces)
    if len(variables) != 1:
        if len(variables) > 1:
            raise SweepError(f"{what}: is a vector; vary one element, as in {address}[1]")
        alone = replace(scenario, name=what, parameters={address: float(written[0])}, sets=())
        plan(alone, interfaces)  # raises an error that names the nearest address
        raise SweepError(f"{what}: there is nothing to vary")
    component, _, name = variables[0].partition(".")
    variable = interfaces[component].parameters[name]
    if name == "seed":
        raise SweepError(f"{what}: each trial has its own seed; choose the first with --seed")
    try:
        values = tuple(si_value(_as_written(value, variable), variable, what) for value in written)
    except ScenarioError:
        for end, field in zip(("start", "end"), text.split(":"), strict=False):
            si_value(_as_written(_number(what, field), variable), variable, f"{what}: its {end}")
        raise
    is_threshold = variables[0] == _variables(THRESHOLD, interfaces)[0]
    unit = variable.unit.replace("rad", "deg") if is_angular(variable) else variable.unit
    column = THRESHOLD_COLUMN if is_threshold else address
    return Axis(column, "" if unit == "1" else unit, variables[0], written, values)


def _as_written(value: Decimal, variable: Variable) -> bool | int | float:
    """A value of a range as a scenario states it: 0 and 1 of a Boolean are false and true."""
    if variable.type is Type.BOOLEAN and value in (0, 1):
        return bool(value)
    return int(value) if value == int(value) else float(value)


def _range(what: str, text: str) -> tuple[Decimal, ...]:
    """The values of `a`, `a:b` or `a:b:step`, b too if a step falls on it.

    They are decimals, so that 0.1:0.3:0.1 has 0.3.
    """
    fields = text.split(":")
    if not text or len(fields) > 3:
        raise SweepError(f"{what}: expected a:b:step, as in 15:90:5")
    numbers = [_number(what, field) for field in fields]
    first, last, step = numbers[0], (*numbers, numbers[0])[1], (*numbers[2:], Decimal(1))[0]
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
    raise SweepError(f'{what}: "{text}" is not a number; expected a:b:step, as in 15:90:5')


def _span(axis: Axis) -> str:
    first, last = axis.written[0], axis.written[-1]
    step = f" in steps of {plain(axis.written[1] - first)}" if len(axis.written) > 1 else ""
    return f"{plain(first)} to {plain(last)} {axis.unit}".rstrip() + step


def default_folder(sweep: Sweep) -> Path:
    """The folder of the results by default: its name carries reading, system, seed and what is varied."""
    name = "-".join(("sweep", sweep.name, *sweep.special))
    return Path("out") / name.translate({ord("["): None, ord("]"): None})


def run(
    sweep: Sweep,
    folder: Path,
    address: str | None = None,
    *,
    certificates: Certificates = Certificates(),  # noqa: B008 - it is frozen
    progress: Progress | None = None,
    note: Callable[[str], None] = lambda text: None,
) -> tuple[list[Point], dict[str, Any]]:
    """Run the trials that the folder's journal lacks, and write the results.

    The results of an earlier sweep stay until the new ones replace them.

    Args:
        address: of a Dask scheduler, or None for this machine's cores.
        certificates: for an address that begins with tls://.
        progress: called with the number of trials done.
        note: called with a line for the user.

    Returns:
        The table, and the content of recommendation.json.

    Raises:
        UsageError: the folder is in use, a folder has the name of a result, or no scheduler answers.
        CanineError: a fault in the trials or on the disk; the chunks done before are kept.
        KeyboardInterrupt: the user ended it; the chunks done before are kept.
    """
    for name in (CSV, PICTURE, RECOMMENDATION):
        if os.path.isdir(folder / name):  # unlike Path.is_dir, it raises nothing
            raise SweepError(f"{folder / name}: is a folder; remove it, or choose another one with --out")
    with open_journal(folder, sweep.job, sweep.fingerprint, sweep.about, sweep.identity) as journal:
        others = replaced(folder / RECOMMENDATION, sweep.identity)
        if others:
            note(f"{folder}: has the results of another sweep, which these replace ({others})")
        outcomes = Outcomes(sweep.job)
        for chunk in journal.chunks:
            outcomes.add(chunk)
        if journal.dropped:
            lines = f"{journal.dropped} damaged line{'s' * (journal.dropped > 1)}"
            note(f"{journal.path}: {lines} left out; those trials run again")
        if outcomes.done:
            note(f"{outcomes.done} of {sweep.job.total} trials are there from before; going on")
            if progress:
                progress(outcomes.done)
        try:
            if outcomes.done < sweep.job.total:
                with pool_at(address, sweep.job, note, certificates) as pool:
                    run_all(outcomes, pool, journal.append, progress)
        except BaseException:
            if journal.empty:
                journal.remove()
            raise
        results = report(sweep, outcomes, folder)
        journal.remove()
    return results


def report(sweep: Sweep, outcomes: Outcomes, folder: Path) -> tuple[list[Point], dict[str, Any]]:
    """Write sweep.csv, sweep.png and recommendation.json; all are made before the first is written.

    Raises:
        FileError: they cannot be written.
    """
    from harness.sweep.plots import sweep_png  # noqa: PLC0415 - matplotlib takes half of a short sweep

    table = table_of(sweep.points, outcomes)
    axes = [(axis.column, axis.unit, axis.written) for axis in sweep.axes]
    result = {**sweep.identity, **recommend(axes, table, outcomes.ticks)}
    recommendation = (json.dumps(result, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()
    picture = sweep_png([(axis.label, axis.written) for axis in sweep.axes], table, result, sweep.about)
    rows = csv_of([axis.column for axis in sweep.axes], table)
    for name, content in ((CSV, rows), (PICTURE, picture), (RECOMMENDATION, recommendation)):
        write_whole(folder / name, content)
    return table, result


def show(sweep: Sweep, table: Sequence[Point], result: Mapping[str, Any], console: Console) -> None:
    """Print some rows of the table, and the recommendation in words."""
    printed = new_table()
    for axis in sweep.axes:
        printed.add_column(escape(axis.label), justify="right")
    for heading in ("success", "95 % interval", "time [s]", "sd", "commands", "timeouts"):
        printed.add_column(escape(heading), justify="right")
    step = math.ceil(len(table) / SHOWN)
    for point in table[::step]:
        low, high = point.interval
        means = (point.mean_time, point.sd_time, point.mean_commands)
        printed.add_row(
            *map(plain, point.written),
            percent(point.success_rate),
            f"{100 * low:.1f}-{100 * high:.1f}",
            *("-" if mean is None else f"{mean:.2f}" for mean in means),
            str(point.timeouts),
        )
    print_table(printed, console)
    if step > 1:
        console.print(f"1 row of every {step}; all {len(table)} are in {CSV}", style="dim")
    if len(table) == 1:
        console.print("one point: nothing to compare")
        return
    for key in ("success", "time", "both", "pareto"):
        console.print(escape(result[key]["text"]), soft_wrap=True)
