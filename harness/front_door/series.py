"""Many trials: over parameters, of controllers with plants, and day after day."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from harness.cosim.stepping import GIB, Limits
from harness.files import remove_folder
from harness.front_door.arguments import (
    Progress,
    StrPath,
    certificates_of,
    check_choice,
    check_count,
    check_list,
    check_type,
    limits_of,
    named_from_python,
    names_of,
    numbers_of,
    settings_of,
    target_of,
    text_of,
)
from harness.front_door.trials import run_trial
from harness.trial import DEFAULT, ReadingName
from harness.trial.scenario import Scenario, Written
from models.readings import READINGS
from models.system import CONTROLLER

if TYPE_CHECKING:
    from harness.day.missions import Result as DaysResult


@dataclass(frozen=True)
class SweepResult:
    """A sweep that was run.

    Attributes:
        folder: with all of its files.
        rows: the table, a row for each point by column; None where there is nothing to take a mean of.
        recommendation: the content of recommendation.json.
        notes: what the user should know.
        fmu_failures: what FMUs did wrong, a line for each point at which one did.
    """

    folder: Path
    rows: list[dict[str, float | None]]
    recommendation: Mapping[str, Any]
    notes: tuple[str, ...] = ()
    fmu_failures: tuple[str, ...] = ()

    @property
    def table_path(self) -> Path:
        """sweep.csv."""
        return self.folder / "sweep.csv"

    @property
    def page_path(self) -> Path:
        """sweep.html."""
        return self.folder / "sweep.html"

    @property
    def picture_path(self) -> Path:
        """sweep.png."""
        return self.folder / "sweep.png"

    @property
    def recommendation_path(self) -> Path:
        """recommendation.json."""
        return self.folder / "recommendation.json"


@dataclass(frozen=True)
class MatrixResult:
    """A matrix that was run.

    Attributes:
        folder: with all of its files.
        report: the content of matrix.json.
        notes: what the user should know.
        fmu_failures: what FMUs did wrong, a line for each cell with one; the others are complete.
    """

    folder: Path
    report: Mapping[str, Any]
    notes: tuple[str, ...] = ()
    fmu_failures: tuple[str, ...] = ()

    @property
    def cells(self) -> list[dict[str, Any]]:
        """Each cell: `controller`, `plant`, `scenario`, and its results by the names of matrix.csv."""
        return list(self.report["cells"])

    @property
    def comparisons(self) -> list[dict[str, Any]]:
        """The controllers compared trial by trial, by plant and scenario."""
        return list(self.report["comparisons"])

    @property
    def table_path(self) -> Path:
        """matrix.csv."""
        return self.folder / "matrix.csv"

    @property
    def page_path(self) -> Path:
        """matrix.html."""
        return self.folder / "matrix.html"

    @property
    def picture_path(self) -> Path:
        """matrix.png."""
        return self.folder / "matrix.png"

    @property
    def report_path(self) -> Path:
        """matrix.json."""
        return self.folder / "matrix.json"


@dataclass(frozen=True)
class DayResult:
    """Days of missions that were run.

    Attributes:
        folder: with all of its files.
        report: the content of day.json.
        notes: what the user should know.
    """

    folder: Path
    report: Mapping[str, Any]
    notes: tuple[str, ...] = ()

    @property
    def rows(self) -> list[dict[str, Any]]:
        """A row for each controller, rest and mission, by the names of day.csv."""
        return list(self.report["curves"])

    @property
    def table_path(self) -> Path:
        """day.csv."""
        return self.folder / "day.csv"

    @property
    def page_path(self) -> Path:
        """day.html."""
        return self.folder / "day.html"

    @property
    def picture_path(self) -> Path:
        """day.png."""
        return self.folder / "day.png"

    @property
    def report_path(self) -> Path:
        """day.json."""
        return self.folder / "day.json"


@named_from_python
def run_sweep(
    target: StrPath | Scenario = "two",
    *,
    thresholds: str | None = None,
    vary: Mapping[str, str] | None = None,
    trials: int = 1000,
    system: Literal["cts", "full"] = "cts",
    reading: ReadingName | None = None,
    seed: int | None = None,
    parameters: Mapping[str, Written] | None = None,
    plant: StrPath | None = None,
    estimator: StrPath | None = None,
    controller: StrPath | None = None,
    ahrs: bool = False,
    call_limit: float = Limits.call,
    memory_limit: float = Limits.memory / GIB,
    dask: str | None = None,
    dask_ca: StrPath | None = None,
    dask_cert: StrPath | None = None,
    dask_key: StrPath | None = None,
    out: StrPath | None = None,
    progress: Callable[[int], None] | None = None,
) -> SweepResult:
    """Run many trials at each value of one or two parameters.

    An interrupted sweep goes on where it was when it is called again with the same arguments.

    >>> from harness import run_sweep
    >>> sweep = run_sweep("two", thresholds="30:50:10", trials=20, out="out/three-thresholds")
    >>> [row["threshold_deg"] for row in sweep.rows]
    [30.0, 40.0, 50.0]
    >>> all(0 <= row["ci_low"] <= row["success_rate"] <= row["ci_high"] <= 1 for row in sweep.rows)
    True
    >>> sweep.recommendation["trials"]
    20

    Args:
        target: `two`, `three` (the trials of 5.3.5 and 5.3.6), a `Scenario`, the name of a shipped one, or
            the path of a .toml.
        thresholds: `a`, `a:b` or `a:b:step` of the deviation threshold h', deg.
        vary: any one or two parameters instead or beside, `{"cmec.capture_radius": "3:10:0.5"}`.
        trials: at each point.
        system: `cts` gives the controller the true state, `full` the estimate.
        reading: over the scenario's.
        seed: of the first trial at each point; by default the scenario's.
        parameters: values over the scenario's, by `block.name`; angles in degrees.
        plant, estimator, controller: what takes the places of ours, as in `run_trial`; an estimator in the
            system `full`.
        ahrs: put our AHRS between sensors and estimator.
        call_limit: s that one call of an FMU made elsewhere may take.
        memory_limit: GiB that all FMUs of a trial may take, if one was made elsewhere.
        dask: the address of the scheduler of a Dask cluster; by default this machine's cores.
        dask_ca: certificate (PEM) of the cluster's authority, for an address that begins with tls://.
        dask_cert: this machine's certificate (PEM).
        dask_key: its private key (PEM), if it is not in `dask_cert`.
        out: the folder of the results; by default out/sweep-<name>, and what differs from that plain sweep.
        progress: called with the number of trials done.

    Raises:
        UsageError: a name, a value or a path does not fit.
        CanineError: a fault in what was run; the trials that are done are kept.
    """
    from harness.sweep import sweep  # noqa: PLC0415 - compilers and pictures: trials need not wait

    check_type("thresholds", thresholds, str, 'a text, "15:90" or "15:90:5"')
    check_type("vary", vary, Mapping, 'a mapping, {"cmec.capture_radius": "3:10:0.5"}')
    check_count("trials", trials)
    check_choice("reading", reading, tuple(READINGS))
    limits = limits_of(call_limit, memory_limit)
    certificates = certificates_of(dask, dask_ca, dask_cert, dask_key)
    notes: list[str] = []
    planned = sweep.plan_sweep(
        target_of(target),
        thresholds=thresholds,
        vary=[f"{name}={values}" for name, values in (vary or {}).items()],
        trials=trials,
        system=system,
        reading=reading,
        seed=seed,
        settings=settings_of(parameters),
        estimator=text_of(estimator),
        ahrs=ahrs,
        plant=text_of(plant),
        controller=text_of(controller),
        limits=limits,
        note=notes.append,
    )
    folder = sweep.default_folder(planned) if out is None else Path(out)
    table, recommendation = sweep.run(
        planned,
        folder,
        dask,
        certificates=certificates,
        progress=progress,
        note=notes.append,
    )
    with (folder / sweep.CSV).open(newline="") as lines:
        rows = [
            {name: float(cell) if cell else None for name, cell in row.items() if name != "verdict"}
            for row in csv.DictReader(lines)
        ]
    failures = sweep.fmu_failures_of(planned, table)
    return SweepResult(folder, rows, recommendation, tuple(notes), tuple(failures))


@named_from_python
def run_matrix(
    controllers: Sequence[StrPath] | None = None,
    plants: Sequence[StrPath] | None = None,
    scenarios: Sequence[StrPath | Scenario] = (DEFAULT,),
    *,
    trials: int = 1000,
    system: Literal["cts", "full"] | None = None,
    reading: ReadingName | None = None,
    seed: int | None = None,
    parameters: Mapping[str, Written] | None = None,
    estimator: StrPath | None = None,
    ahrs: bool = False,
    call_limit: float = Limits.call,
    memory_limit: float = Limits.memory / GIB,
    dask: str | None = None,
    dask_ca: StrPath | None = None,
    dask_cert: StrPath | None = None,
    dask_key: StrPath | None = None,
    out: StrPath | None = None,
    progress: Callable[[int], None] | None = None,
) -> MatrixResult:
    """Run many trials of each controller with each plant in each scenario.

    Trial i has the same seed in every cell. An interrupted matrix goes on where it was when it is called
    again with the same arguments.

    >>> from harness import run_matrix
    >>> matrix = run_matrix(["cmec", "quarter_turn"], ["canine"], ["two_waypoint"], system="cts", trials=50)
    >>> [(cell["controller"], cell["trials"]) for cell in matrix.cells]
    [('cmec', 50), ('quarter_turn', 50)]
    >>> matrix.comparisons[0]["better"]
    'cmec'

    Args:
        controllers, plants: blocks of ours by name, or paths of FMUs; by default all of ours that obey
            commands.
        scenarios: `Scenario`s, names of shipped ones, or paths of .toml.
        trials: of each cell.
        system: `cts` gives the controller the true state, `full` the estimate; by default each scenario's.
        reading: over the scenarios'.
        seed: of the first trial of each cell; by default the first scenario's.
        parameters: values over the scenarios', by `block.name`, in the cells that have the block; angles in
            degrees.
        estimator: one of ours by its name, or an FMU.
        ahrs, call_limit, memory_limit, dask, dask_ca, dask_cert, dask_key: as in `run_sweep`.
        out: the folder of the results; by default out/matrix, and what is special.
        progress: called with the number of trials done.

    Raises:
        UsageError: a name, a value or a path does not fit.
        CanineError: no cell can run, or a fault that is not an FMU's; the trials that are done are kept.
    """
    from harness.sweep import matrix  # noqa: PLC0415 - compilers and pictures: trials need not wait

    check_list("scenarios", scenarios, '["two_waypoint", "mine.toml"]')
    check_count("trials", trials)
    check_choice("reading", reading, tuple(READINGS))
    limits = limits_of(call_limit, memory_limit)
    certificates = certificates_of(dask, dask_ca, dask_cert, dask_key)
    notes: list[str] = []
    planned = matrix.plan_matrix(
        None if controllers is None else names_of("controllers", controllers, '["cmec", "mine.fmu"]'),
        None if plants is None else names_of("plants", plants, '["canine", "dog.fmu"]'),
        [target_of(one) for one in scenarios],
        trials=trials,
        system=system,
        reading=reading,
        seed=seed,
        settings=settings_of(parameters),
        estimator=text_of(estimator),
        ahrs=ahrs,
        limits=limits,
        note=notes.append,
    )
    folder = matrix.default_folder(planned) if out is None else Path(out)
    result = matrix.run(
        planned,
        folder,
        dask,
        certificates=certificates,
        progress=progress,
        note=notes.append,
    )
    return MatrixResult(folder, result.facts(), tuple(notes), tuple(result.fmu_failures()))


@named_from_python
def run_day(
    scenario: StrPath | Scenario = DEFAULT,
    *,
    missions: int = 8,
    rest: float | Sequence[float] = 600.0,
    controllers: Sequence[str] = (CONTROLLER,),
    days: int = 1000,
    system: Literal["cts", "full"] = "cts",
    estimator: str | None = None,
    reading: ReadingName | None = None,
    seed: int | None = None,
    parameters: Mapping[str, Written] | None = None,
    logs: int = 0,
    out: StrPath | None = None,
    progress: Progress | None = None,
) -> DayResult:
    """Run days of missions with rests between them: the dog tires and habituates.

    All controllers and rests meet the same seeds. How the dog tires and habituates is assumed: parameters of
    the plant `canine_all_day`.

    >>> from harness import run_day
    >>> day = run_day("three_waypoint", missions=2, rest=[60, 3600], days=50, reading="field", out="out/day")
    >>> [(row["rest_s"], row["mission"], row["trials"]) for row in day.rows]
    [(60.0, 1, 50), (60.0, 2, 50), (3600.0, 1, 50), (3600.0, 2, 50)]
    >>> day.rows[1]["mean_fatigue"] > day.rows[3]["mean_fatigue"]
    True

    Args:
        scenario: each mission: a `Scenario`, the name of a shipped one, or the path of a .toml.
        missions: in a row.
        rest: s between two missions; each of several is a curve.
        controllers: of ours by name; each is a curve.
        days: how often the day is simulated.
        system: `cts` gives the controller the true state, `full` the estimate.
        estimator: one of ours by its name, in the system `full`.
        reading: over the scenario's.
        seed: of the first mission of the first day; by default the scenario's.
        parameters: values over the scenario's, by `block.name`; angles in degrees.
        logs: of so many days each mission is also run alone, with log and page, in
            <controller>-rest<s>/day-<i>/mission-<k>.
        out: the folder of the results; by default out/day-<scenario>.
        progress: called with the number of trials done.

    Raises:
        UsageError: a name, a value or a path does not fit.
        CanineError: a fault in what was run.
    """
    from harness.day import missions as day_of_missions  # noqa: PLC0415 - compilers and pictures
    from harness.day import report  # noqa: PLC0415

    for name, count, least in (("missions", missions, 1), ("days", days, 1), ("logs", logs, 0)):
        check_count(name, count, least)
    check_choice("reading", reading, tuple(READINGS))
    notes: list[str] = []
    planned = day_of_missions.plan_days(
        day_of_missions.Asked(
            target_of(scenario),
            names_of("controllers", controllers, '["cmec", "quarter_turn"]'),
            numbers_of("rest", rest, "s"),
            missions,
            days,
            system,
            text_of(estimator),
            reading,
            seed,
            settings_of(parameters),
        ),
        notes.append,
    )
    result = day_of_missions.run(planned, progress)
    folder = report.default_folder(result) if out is None else Path(out)
    write_days(result, logs, folder, notes.append)
    return DayResult(folder, report.facts(result), (*notes, *planned.notes))


def write_days(
    result: DaysResult,
    logs: int,
    folder: Path,
    note: Callable[[str], None],
    progress: Progress | None = None,
) -> None:
    """Write the files of days, and run the missions of the first ones alone.

    These are in `<controller>-rest<s>/day-<i>/mission-<k>` below `folder`. Logs that an earlier run left
    there are removed first: a fit would take them for missions of this one. If none are run alone, and for
    other controllers and rests, they stay.

    Args:
        logs: number of days whose missions are run alone.
        note: called with a line for the user if something is replaced, or stays from an earlier run.
        progress: called with the number of missions that were run alone.
    """
    from harness.day import report  # noqa: PLC0415 - pictures: trials need not wait
    from harness.day.missions import PLANT  # noqa: PLC0415

    places = {f"{curve.controller}-rest{curve.rest:g}" for curve in result.curves if logs}
    earlier = {log.parent: log.parents[2].name for log in folder.glob("*-rest*/day-*/mission-*/trial.mcap")}
    before = [logged for logged, place in earlier.items() if place in places]
    for logged in before:
        remove_folder(logged)
    if before:
        note(f"{folder}: had {len(before)} logged missions of an earlier run, which these replace")
    if others := len(earlier) - len(before):
        note(f"{folder}: has {others} logged missions of an earlier run, which stay")
    report.write(result, folder, note)
    done = 0
    for curve, day in product(result.curves, range(min(logs, result.planned.asked.days))):
        for number, mission in enumerate(result.missions_of(curve, day), start=1):
            below = f"{curve.controller}-rest{curve.rest:g}/day-{day + 1}/mission-{number}"
            run_trial(mission, plant=PLANT, controller=curve.controller, out=folder / below)
            done += 1
            if progress:
                progress(done)
