"""Sweeps: many trials at each value of one or two parameters, as 5.3.3 varies the deviation threshold h'.

`two` are the text's two-waypoint trials, `three` its four types of three-waypoint trials in turns. The
results are a table with a row for each point, a picture, and a recommendation.
"""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from decimal import Decimal
from itertools import product
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from harness.cosim.stepping import Limits
from harness.files import write_set
from harness.sweep.axis import THRESHOLD, Axis, SweepError, axis_of, span_of, split_option, variables_at
from harness.sweep.cells import Cells
from harness.sweep.chunks import Job, Outcomes, Progress, program
from harness.sweep.components import find_components
from harness.sweep.cosimulated import Cosimulated
from harness.sweep.journal import SWEEP
from harness.sweep.recommend import number, recommend
from harness.sweep.run import run_trials
from harness.sweep.table import THRESHOLD_COLUMN, Point, csv_of, name_of, plain, table_of
from harness.sweep.tls import Certificates
from harness.sweep.trials import TRIAL_TYPES, Options, adapted, check_size, native_job
from harness.terminal import new_table, percent, print_table
from harness.trial.plan import interfaces_of_system
from harness.trial.scenario import Scenario, load
from models.readings import READING
from models.system import CONTROLLER, ESTIMATOR, PLANT, find_system

TWO_WAYPOINTS, MORE_WAYPOINTS = "15:90", "15:65"  # deg, 5.3.5 and 5.3.6
SHOWN = 13  # rows of the table in the terminal
CSV, PICTURE, PAGE, RECOMMENDATION = "sweep.csv", "sweep.png", "sweep.html", "recommendation.json"


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
        named: what was named for plant, controller and estimator, by role.
        blocks: our blocks among them, by role.
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
    named: Mapping[str, str] = field(default_factory=dict)
    blocks: Mapping[str, str] = field(default_factory=dict)

    @property
    def job(self) -> Job:
        """The trials of a sweep of our own blocks."""
        if not isinstance(self.work, Job):
            raise TypeError(f"{self.name}: runs FMUs, {', '.join(self.swaps.values())}")
        return self.work

    @property
    def points(self) -> list[tuple[Decimal, ...]]:
        """The varied parameters' values of each point, as written."""
        return list(product(*(axis.written for axis in self.axes)))

    @property
    def settings(self) -> list[tuple[str, ...]]:
        """The same values as a scenario's settings."""
        return settings_of(self.axes)

    @property
    def about(self) -> str:
        """The sweep in words."""
        ranges = ", ".join(f"{name_of(axis.column)} {span_of(axis)}" for axis in self.axes)
        return (
            f"{self.name}: {ranges}, {self.work.trials} trials a point from seed {self.seed} on, "
            f"{self.system_in_words}, {self.reading}"
            + "".join(f", {role} {name}" for role, name in self.swaps.items())
        )

    @property
    def system_in_words(self) -> str:
        """The system, and which blocks in it are not the usual ones."""
        first = self.scenarios[0]
        plant, controller = self.blocks.get("plant", first.plant), self.blocks.get("controller", CONTROLLER)
        own = find_system(first.system, first.estimator, plant, controller).components
        usual = find_system(first.system).components
        others = [block.title() for place, block in own.items() if usual[place] is not block]
        return first.system + f" with {' and '.join(others)}" * bool(others)

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
            [program(has_fmus=self.work.has_fmus), texts, written, job], sort_keys=True, default=str
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
    ranges = [split_option(text) for text in vary]
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
    axes = tuple(axis_of(option, address, text, first, interfaces) for option, address, text in ranges)
    if len({axis.variable for axis in axes}) < len(axes):
        raise SweepError(f"{axes[0].variable} is varied twice; vary it once")
    for setting in settings:
        for axis in axes:
            if axis.variable in variables_at(setting.partition("=")[0].strip(), interfaces):
                raise SweepError(f"--set {setting}: the parameter is varied; leave out one of the two")
    job: Job | Cells
    if components.foreign:
        job = Cells(tuple(_cell_with(values, cell, components.blocks) for values in settings_of(axes)))
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
        components.fmus, special, components.names, components.blocks,
    )  # fmt: skip


def settings_of(axes: Sequence[Axis]) -> list[tuple[str, ...]]:
    """What a scenario sets at each point; the last axis varies first."""
    return list(product(*(axis.settings for axis in axes)))


def _cell_with(settings: Sequence[str], cell: Cosimulated, blocks: Mapping[str, str]) -> Cosimulated:
    """The trials at a point of a sweep with FMUs."""
    return replace(cell, scenarios=tuple(s.override(settings, swaps=blocks) for s in cell.scenarios))


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
        files=(CSV, PICTURE, PAGE, RECOMMENDATION),
        certificates=certificates,
        progress=progress,
        note=note,
    )


def report(sweep: Sweep, outcomes: Outcomes, folder: Path) -> tuple[list[Point], dict[str, Any]]:
    """Write the table, picture, page and recommendation, which are never beside some of another sweep.

    Raises:
        FileError: they cannot be written.
    """
    from harness.sweep.page import sweep_page  # noqa: PLC0415 - jinja2
    from harness.sweep.plots import sweep_png  # noqa: PLC0415 - matplotlib takes half of a short sweep

    table = table_of(sweep.points, outcomes)
    axes = [(axis.column, axis.unit, axis.written) for axis in sweep.axes]
    result = {**sweep.identity, **recommend(axes, table, outcomes.ticks)}
    recommendation = (json.dumps(result, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()
    picture = sweep_png([(axis.label, axis.written) for axis in sweep.axes], table, result, sweep.about)
    labels = [tuple(map(plain, point)) for point in sweep.points]
    rows = csv_of([axis.column for axis in sweep.axes], labels, table, has_fmus=sweep.work.has_fmus)
    page = sweep_page(sweep, table, outcomes, result["advice"])
    write_set(folder, {CSV: rows, PICTURE: picture, PAGE: page, RECOMMENDATION: recommendation})
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
    if sweep.work.has_fmus:
        printed.add_column("FMU failures", justify="right")
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
            *([f"{len(point.fmu_failures)} of {point.trials}"] if sweep.work.has_fmus else []),
        )
    print_table(printed, console)
    if step > 1:
        console.print(f"1 row of every {step}; all {len(table)} are in {CSV}", style="dim")
    for text in result["advice"] or ["one point: nothing to compare"]:
        console.print(escape(text), soft_wrap=True)
