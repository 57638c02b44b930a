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
from dataclasses import asdict, dataclass, field, replace
from decimal import Decimal
from itertools import product
from pathlib import Path
from typing import Any, Protocol, TypeVar

from rich.console import Console
from rich.markup import escape

from codegen.batch.batch import Change
from harness.cosim.stepping import Limits, first_tick, whole_steps
from harness.files import replaced, write_whole
from harness.sweep.cells import Cells
from harness.sweep.chunks import TICK_S, Job, Outcomes, Progress, Trials, TrialType, pool_at, program, run_all
from harness.sweep.components import Components, find_components
from harness.sweep.cosimulated import Cosimulated
from harness.sweep.journal import SWEEP, open_journal
from harness.sweep.recommend import number, recommend
from harness.sweep.table import THRESHOLD_COLUMN, Point, csv_of, name_of, plain, table_of
from harness.sweep.tls import Certificates
from harness.terminal import new_table, percent, print_table
from harness.trial.faults import resolve_faults
from harness.trial.pairs import check_windows, is_paired
from harness.trial.plan import Interface, interfaces_of_system, is_angular, plan, si_value
from harness.trial.scenario import LOST, Scenario, ScenarioError, checked, load, toml_of, with_estimator
from models.disturbance import disturb
from models.errors import UsageError, nearest
from models.kit.declaration import Type, Variable
from models.kit.random import MAX_SEED
from models.readings import READING
from models.system import CONTROLLER, ESTIMATOR, PLANT, SYSTEMS, System, find_system

TRIAL_TYPES = {"two": ("two_waypoint",), "three": ("right_90", "left_90", "right_45", "left_45")}
THRESHOLD = "cmec.moving_deviation"
TWO_WAYPOINTS, MORE_WAYPOINTS = "15:90", "15:65"  # deg, 5.3.5 and 5.3.6
MAX_POINTS, MAX_TRIALS = 10_000, 100_000_000
Results = TypeVar("Results")
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
        settings: the values as a scenario's settings, `cmec.guarded=true`.
    """

    column: str
    unit: str
    variable: str
    written: tuple[Decimal, ...]
    values: tuple[float, ...]
    settings: tuple[str, ...]

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
        work: the trials as plain data.
        scenarios: one for each type of trial.
        reading: of all scenarios.
        system: its name, with those of the blocks in it that are not the usual ones.
        seed: of the first trial at each point.
        swaps: FMUs of others by role, as they were named.
        special: what differs from the sweep of the name alone: reading, system, seed, varied parameters.
    """

    name: str
    axes: tuple[Axis, ...]
    work: Job | Cells
    scenarios: tuple[Scenario, ...]
    reading: str
    system: str
    seed: int
    swaps: Mapping[str, str] = field(default_factory=dict)
    special: tuple[str, ...] = ()

    @property
    def job(self) -> Job:
        """The trials of a sweep of our own blocks."""
        if not isinstance(self.work, Job):
            raise TypeError(f"{self.name}: runs FMUs, {', '.join(self.swaps.values())}")
        return self.work

    @property
    def has_fmus(self) -> bool:
        """Does it run FMUs of others?"""
        return bool(self.swaps)

    @property
    def points(self) -> list[tuple[Decimal, ...]]:
        """The varied parameters' values of each point, as written."""
        return list(product(*(axis.written for axis in self.axes)))

    @property
    def about(self) -> str:
        """The sweep in words."""
        ranges = ", ".join(f"{name_of(axis.column)} {_span(axis)}" for axis in self.axes)
        return (
            f"{self.name}: {ranges}, {self.work.trials} trials a point from seed {self.seed} on, "
            f"{self.system}, {self.reading}"
            + "".join(f", {role} {name}" for role, name in self.swaps.items())
        )

    @property
    def identity(self) -> dict[str, Any]:
        """What tells the sweep from others, as recommendation.json states it."""
        return {
            "sweep": self.name,
            "system": self.system,
            **self.swaps,
            "reading": self.reading,
            "trials": self.work.trials,
            "seed": self.seed,
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
        job = asdict(self.work)
        texts = [scenario.text() for scenario in self.scenarios]
        written = [[axis.column, *map(str, axis.written)] for axis in self.axes]
        everything = json.dumps(
            [program(has_fmus=self.has_fmus), texts, written, job], sort_keys=True, default=str
        )
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
    plant: str | None = None,
    controller: str | None = None,
    limits: Limits = Limits(),  # noqa: B008 - it is frozen
    note: Callable[[str], None] = lambda text: None,
    built: Callable[[Path], None] = lambda path: None,
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
        estimator: of ours by name, or the path of an FMU; by default the scenario's where the system has one.
        ahrs: put our AHRS between sensors and estimator of the system full.
        plant, controller: of ours by name, or the path of an FMU.
        limits: for FMUs of others.
        note: called with a line for the user.
        built: called with each of our FMUs that had to be built.

    Raises:
        ScenarioError: the scenario or a setting is invalid, or a value is out of its range.
        SweepError: a range, or the number of points, trials or seeds is invalid.
    """
    components = find_components(estimator=estimator, plant=plant, controller=controller)
    options = Options(system, estimator, ahrs, reading, seed)
    targets = (target,) if isinstance(target, Scenario) else TRIAL_TYPES.get(target, (target,))
    scenarios = [adapted(one, options, settings, components) for one in targets]
    first = scenarios[0]
    if components.foreign:
        cell = Cosimulated(tuple(scenarios), components.swaps, trials, first.seed, limits)
        with cell.ready(first, built) as ready:
            interfaces = ready.interfaces
    else:
        interfaces = interfaces_of_system(components.system(first))
    ranges = [_split(text) for text in vary]
    if thresholds is not None or not ranges:
        default = TWO_WAYPOINTS if len(first.waypoints) == 1 else MORE_WAYPOINTS
        ranges.insert(0, ("--thresholds", THRESHOLD, default if thresholds is None else thresholds))
        if interfaces["controller"].block != CONTROLLER:
            raise SweepError(
                f"--thresholds: h' is {THRESHOLD}, which {interfaces['controller'].label} does not have; "
                "vary a parameter of its own with --vary, or compare controllers with `canine matrix`"
            )
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
    job: Job | Cells
    if components.foreign:
        job = Cells(tuple(_cell_at(point, cell, axes) for point in product(*(a.written for a in axes))))
        check_size(job, first.seed)
        _check_cells(job, note)
    else:
        job = native_job(scenarios, components, axes, trials, note)
        check_size(job, first.seed)
    own = targets[0] if isinstance(targets[0], Scenario) else load(targets[0])
    columns = tuple(axis.column for axis in axes)
    chosen = first.reading or READING
    special = (
        *([chosen] if chosen != (own.reading or READING) else []),
        *([first.system] if first.system != "cts" else []),
        *([first.estimator] if first.estimator != ESTIMATOR else []),
        *(Path(str(swap)).stem for swap in (plant, controller) if swap not in (None, PLANT, CONTROLLER)),
        *([Path(components.names["estimator"]).stem] if "estimator" in components.fmus else []),
        *([f"seed{first.seed}"] if first.seed != own.seed else []),
        *(columns if columns != (THRESHOLD_COLUMN,) else ()),
    )
    name = target if isinstance(target, str) and target in TRIAL_TYPES else first.name
    return Sweep(
        name, axes, job, tuple(scenarios), chosen, components.system(first).name, first.seed,
        components.fmus, special,
    )  # fmt: skip


def native_job(
    scenarios: Sequence[Scenario],
    components: Components,
    axes: Sequence[Axis],
    trials: int,
    note: Callable[[str], None],
) -> Job:
    """The trials of our own blocks; the scenarios take turns."""
    first, wired = scenarios[0], components.system(scenarios[0])
    faults = resolve_faults(first, interfaces_of_system(wired), wired.links, TICK_S)
    return Job(
        first.system,
        tuple(axis.variable for axis in axes),
        tuple(product(*(axis.values for axis in axes))),
        tuple(trial_type(scenario, wired, axes, note) for scenario in scenarios),
        trials,
        first.seed,
        estimator=first.estimator,
        plant=components.block("plant") or PLANT,
        controller=components.block("controller") or CONTROLLER,
        faults=faults.links,
        stalls={name: whole_steps(spans, 1) for name, spans in faults.stalls.items()},
    )


def _cell_at(point: Sequence[Decimal], cell: Cosimulated, axes: Sequence[Axis]) -> Cosimulated:
    """The trials at a point of a sweep with FMUs."""
    scenarios, blocks = cell.scenarios, {r: part for r, part in cell.swaps.items() if isinstance(part, str)}
    for axis, value in zip(axes, point, strict=True):
        setting = axis.settings[axis.written.index(value)]
        scenarios = tuple(scenario.override([setting], swaps=blocks) for scenario in scenarios)
    return replace(cell, scenarios=scenarios)


def _check_cells(job: Cells, note: Callable[[str], None]) -> None:
    """Resolve the first trial of each point, so that what does not fit is told before the first one runs."""
    notes: dict[str, None] = {}  # in order, each once
    for turn in range(len(job.cells[0].type_names)):
        cells = [cell for cell in job.cells if isinstance(cell, Cosimulated)]
        with cells[0].ready(cells[0].scenarios[turn]) as ready:
            for cell in cells:
                notes |= dict.fromkeys(ready.planned(cell.scenarios[turn]).notes)
    for text in notes:
        note(text)


def _told_by_scenario(scenario: Scenario) -> dict[str, Any]:
    """A scenario with its settings, without what the sweep states for all."""
    content = tomllib.loads(scenario.text())
    return {
        key: value
        for key, value in content.items()
        if key not in ("name", "system", "estimator", "reading", "seed")
    }


def check_size(job: Trials, seed: int) -> None:
    """Refuse more trials than can be run, or than there are seeds.

    Raises:
        SweepError: there are.
    """
    if job.trials < 1:
        raise SweepError(f"--trials {job.trials}: expected at least 1")
    if job.point_count > MAX_POINTS:
        raise SweepError(f"{job.point_count} points; expected at most {MAX_POINTS}: take larger steps")
    if seed + job.trials - 1 > MAX_SEED:
        raise SweepError(
            f"--trials {job.trials}: the last would have seed {seed + job.trials - 1}, expected at most "
            f"{MAX_SEED}; take at most {MAX_SEED - seed + 1} trials, or a smaller --seed"
        )
    if job.total > MAX_TRIALS:
        raise SweepError(
            f"{job.point_count} points of {job.trials} trials are {job.total} trials; expected at most "
            f"{MAX_TRIALS}: take at most {MAX_TRIALS // job.point_count} a point, or fewer points"
        )


@dataclass(frozen=True)
class Options:
    """What overrides scenarios; None keeps the scenario's own.

    Attributes:
        system: name of one of SYSTEMS.
        estimator: of ours by name, or the path of an FMU.
        ahrs: put our AHRS between sensors and estimator of the system full.

    Raises:
        SweepError: the system does not exist, or has no place for the estimator or the AHRS.
    """

    system: str | None = None
    estimator: str | None = None
    ahrs: bool = False
    reading: str | None = None
    seed: int | None = None

    def __post_init__(self) -> None:
        if self.system is not None and self.system not in SYSTEMS:
            raise SweepError(
                f"--system {self.system}: there is no such system{nearest(self.system, SYSTEMS)}"
            )
        if self.system is not None:
            self.system_of(self.system)

    def system_of(self, own: str) -> str:
        """The system that a scenario of the system `own` is run with."""
        system = self.system or own
        if self.ahrs and system not in ("full", "full_ahrs"):
            raise SweepError(f"--ahrs: the system {system} has no sensors; sweep with --system full")
        if self.estimator is not None and system not in with_estimator():
            raise SweepError(
                f"--estimator {self.estimator}: the system {system} gives the controller the true state; "
                "sweep with --system full"
            )
        return "full_ahrs" if self.ahrs else system


def adapted(
    target: str | Scenario,
    options: Options,
    settings: Sequence[str],
    components: Components,
) -> Scenario:
    """A type of trial's scenario with the options over it.

    Args:
        settings: `block.name=value`.
        components: what takes the places of plant, controller and estimator.

    Raises:
        ScenarioError, SweepError: the scenario cannot be read, or an option or a setting does not fit it.
    """
    scenario = checked(target) if isinstance(target, Scenario) else load(target, known=TRIAL_TYPES)
    if scenario.package is not None:
        raise SweepError(
            f"{scenario.name}: runs the package {scenario.system}; a sweep compiles our own systems, "
            f"{' and '.join(SYSTEMS)}: name one of them as its system, or run it with `canine run`"
        )
    system = options.system_of(scenario.system)
    own = scenario.estimator if system in with_estimator() else ESTIMATOR
    scenario = replace(scenario, system=system, estimator=components.block("estimator") or own)
    scenario = scenario.override(settings, options.seed, components.blocks)
    scenario = replace(scenario, reading=options.reading or scenario.reading or READING)
    owners = _owners(find_system(system, scenario.estimator)) | _owners(components.system(scenario))
    disturbed = [fault.signal for fault in scenario.faults if fault.kind != LOST]
    for address in [*scenario.parameters, *(s.variable for s in scenario.sets), *disturbed]:
        owner = address.partition(".")[0]
        for other in SYSTEMS:
            if owner not in owners and owner in _owners(SYSTEMS[other]):
                raise SweepError(
                    f'{scenario.name}: {address}: the system "{system}" has no {owner}; '
                    f"sweep with --system {other}, or leave it out"
                )
    for fault in scenario.faults:
        if fault.kind == "nan" and fault.signal.startswith("plant.") and "sensors" in owners:
            raise ScenarioError(
                f"{scenario.name}: [[fault]] nan of {fault.signal}: the sensors answer with what is not "
                "finite, which ends a trial; disturb a signal of the sensors"
            )
    return scenario


def _owners(system: System) -> set[str]:
    """The names of the components and of their blocks."""
    return {*system.components, *(block.title() for block in system.components.values())}


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


def trial_type(
    scenario: Scenario,
    system: System,
    axes: Sequence[Axis] = (),
    note: Callable[[str], None] = lambda text: None,
) -> TrialType:
    """A scenario resolved against its system, with ticks for times.

    Raises:
        ScenarioError: as `plan` raises it, or the scenario sets an input that is connected.
    """
    interfaces = interfaces_of_system(system)
    resolved = plan(scenario, interfaces, varied=[axis.variable for axis in axes])
    for text in resolved.notes:
        note(f"{scenario.name}: {text}")
    _check_windows(scenario, interfaces, axes, resolved.values)
    connected = {(link.target, link.target_variable) for link in system.links}
    changes = []
    for event in resolved.events:
        if (event.component, event.variable) in connected:
            raise ScenarioError(
                f"{scenario.name}: [[set]] {event.component}.{event.variable} is connected; "
                "only free inputs can be set"
            )
        tick = first_tick(event.time, TICK_S)
        changes.append(Change(tick, event.component, event.variable, event.value))
    last = math.floor(scenario.duration / TICK_S + 1e-9)
    faults = resolve_faults(scenario, interfaces, system.links, TICK_S)
    _, placed = disturb(system.links, faults.links)
    values = resolved.values | faults.values_of(placed)
    return TrialType(scenario.name, values, tuple(changes), last)


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
    is_threshold = variables == _variables(THRESHOLD, interfaces)
    unit = variable.unit.replace("rad", "deg") if is_angular(variable) else variable.unit
    column = THRESHOLD_COLUMN if is_threshold else address
    settings = tuple(f"{variables[0]}={toml_of(_as_written(value, variable))}" for value in written)
    return Axis(column, "" if unit == "1" else unit, variables[0], written, values, settings)


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
    return run_trials(
        sweep,
        folder,
        lambda outcomes: report(sweep, outcomes, folder),
        address,
        what=SWEEP,
        files=(CSV, PICTURE, RECOMMENDATION),
        certificates=certificates,
        progress=progress,
        note=note,
    )


class Asked(Protocol):
    """What asks for trials: a sweep or a matrix."""

    @property
    def work(self) -> Trials: ...

    @property
    def about(self) -> str: ...

    @property
    def identity(self) -> dict[str, Any]: ...

    @property
    def fingerprint(self) -> str: ...


def run_trials(
    asked: Asked,
    folder: Path,
    report: Callable[[Outcomes], Results],
    address: str | None,
    *,
    what: str,
    files: tuple[str, str, str],
    certificates: Certificates,
    progress: Progress | None,
    note: Callable[[str], None],
) -> Results:
    """Run the trials that the folder's journal lacks, and report on them; the rest is as of `run`.

    Args:
        what: is run, a sweep or a matrix.
        files: the names of the results; the last one holds the identity.
        report: writes the results.
    """
    for name in files:
        if os.path.isdir(folder / name):  # unlike Path.is_dir, it raises nothing
            raise SweepError(f"{folder / name}: is a folder; remove it, or choose another one with --out")
    job, identity = asked.work, asked.identity
    with open_journal(folder, job, asked.fingerprint, asked.about, identity, what=what) as journal:
        others = replaced(folder / files[-1], identity)
        if others:
            note(f"{folder}: has the results of another {what}, which these replace ({others})")
        outcomes = Outcomes(job if address is None else job.packed())
        for chunk in journal.chunks:
            outcomes.add(chunk)
        if journal.dropped:
            lines = f"{journal.dropped} damaged line{'s' * (journal.dropped > 1)}"
            note(f"{journal.path}: {lines} left out; those trials run again")
        if outcomes.done:
            note(f"{outcomes.done} of {job.total} trials are there from before; going on")
            if progress:
                progress(outcomes.done)
        try:
            if outcomes.done < job.total:
                with pool_at(address, job, note, certificates) as pool:
                    run_all(outcomes, pool, journal.append, progress)
        except BaseException:
            if journal.empty:
                journal.remove()
            raise
        for text in dict.fromkeys(text for notes in outcomes.notes.values() for text in notes):
            note(f"in the first of many trials, {text}")
        results = report(outcomes)
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
    labels = [tuple(map(plain, point)) for point in sweep.points]
    rows = csv_of([axis.column for axis in sweep.axes], labels, table, has_fmus=sweep.has_fmus)
    for name, content in ((CSV, rows), (PICTURE, picture), (RECOMMENDATION, recommendation)):
        write_whole(folder / name, content)
    return table, result


def fmu_failures_of(sweep: Sweep, table: Sequence[Point]) -> list[str]:
    """What FMUs did wrong, a line for each point at which one did."""
    lines = []
    for point in table:
        if point.verdict:
            values = zip(sweep.axes, point.written, strict=True)
            lines.append(f"{', '.join(f'{a.column} {plain(v)}' for a, v in values)}: {point.verdict}")
    return lines


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
