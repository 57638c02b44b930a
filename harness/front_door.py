"""Guided Canine from Python; `from harness import run_trial` and so on come from here.

Each function does what the command of its name does, and leaves the same files. Angles are in degrees, as in
scenarios; logs and results are in SI. Errors that a user can cause are `models.errors.CanineError`.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from harness.cosim.stepping import CALL_LIMIT_S, GIB, MEMORY_LIMIT_GIB, Limits, Loop, Order
from harness.log.compare import LogComparison, Tolerances, compare
from harness.log.log import Log, log_of, read_log
from harness.log.recover import Recovery, recover
from harness.replay import EVERY_S, OUTAGE_S
from harness.trial import DEFAULT, ReadingName, trial
from harness.trial.prepare import prepared
from harness.trial.request import Changes, build_missing, requested
from harness.trial.scenario import Disturbance, Scenario, Setting, Written, load, shipped, toml_of
from harness.trial.trial import EndedByFaultError
from models.errors import UsageError
from models.readings import READINGS

if TYPE_CHECKING:
    from harness.sweep.tls import Certificates

__all__ = [
    "Disturbance",
    "EndedByFaultError",
    "Log",
    "LogComparison",
    "MatrixResult",
    "Recovery",
    "ReplayResult",
    "Scenario",
    "Setting",
    "StudyResult",
    "SweepResult",
    "TrialResult",
    "compare_logs",
    "load_scenario",
    "open_log",
    "recover_log",
    "run_matrix",
    "run_replay",
    "run_study",
    "run_sweep",
    "run_trial",
    "scenarios",
]

Progress = Callable[[float], None]
StrPath = str | Path


@dataclass(frozen=True)
class TrialResult:
    """A trial that was run.

    Attributes:
        folder: with all of its files.
        summary: the content of summary.json.
        notes: what the user should know: what could not act, parameters that a foreign FMU lacks, a log that
            is not whole.
    """

    folder: Path
    summary: Mapping[str, Any]
    notes: tuple[str, ...] = ()

    @property
    def outcome(self) -> Literal["success", "failed", "timeout", "stopped"]:
        """How the trial ended."""
        outcome: Literal["success", "failed", "timeout", "stopped"] = self.summary["outcome"]
        return outcome

    @property
    def time_s(self) -> float:
        """s until the trial ended."""
        return float(self.summary["time_s"])

    @property
    def waypoints_reached(self) -> int:
        """Waypoints reached, without the way home."""
        return int(self.summary["waypoints_reached"])

    @property
    def directional_commands(self) -> int:
        """LEFT and RIGHT commands issued."""
        return int(self.summary["directional_commands"])

    @property
    def anomalies(self) -> dict[str, int]:
        """Ticks that reported each kind of anomaly, by name."""
        return dict(self.summary["anomalies"])

    @property
    def position_error_m(self) -> dict[str, float] | None:
        """`mean`, `max` and `final` distance of the estimate from the truth, m; None without an estimator."""
        error: dict[str, float] | None = self.summary["position_error_m"]
        return error

    @property
    def log_path(self) -> Path:
        """trial.mcap."""
        return self.folder / trial.LOG

    @property
    def summary_path(self) -> Path:
        """summary.json."""
        return self.folder / trial.SUMMARY

    @property
    def page_path(self) -> Path:
        """trial.html."""
        return self.folder / trial.PAGE

    @property
    def picture_path(self) -> Path:
        """trial.png; not written for a system without a plant."""
        return self.folder / trial.PICTURE

    @cached_property
    def log(self) -> Log:
        """The log, read when it is first asked for."""
        return read_log(self.log_path)


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
class ReplayResult:
    """A recording that was replayed with simulated outages.

    Attributes:
        folder: with all of its files.
        report: the content of outages.json.
    """

    folder: Path
    report: Mapping[str, Any]

    @property
    def outages(self) -> list[dict[str, Any]]:
        """Each outage: `start_s`, `end_s`, `path_m`, and the `errors` of each configuration at its end."""
        return list(self.report["outages"])

    @property
    def statistics(self) -> dict[str, dict[str, Any]]:
        """By configuration: `n`, and `mean`, `sd`, `median` and `p90` of the position and velocity errors."""
        return dict(self.report["configurations"])

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know: what the results rest on, and how a log that is not whole ends."""
        broken = self.report["broken"]
        return (*self.report["notes"], *([f"the log is not whole, {broken}"] if broken else []))

    @property
    def dropped(self) -> dict[str, int]:
        """What of the recording was not used: cause -> number."""
        return dict(self.report["dropped"])

    @property
    def left_out(self) -> dict[str, int]:
        """Outages that could not be judged: cause -> number."""
        return dict(self.report["left_out"])

    @property
    def verdicts(self) -> dict[str, str]:
        """FMUs that went wrong, of which nothing is judged: configuration -> how, with call and time."""
        return dict(self.report["verdicts"])

    @property
    def paired_t_tests(self) -> list[dict[str, Any]]:
        """The tests of each pair of configurations, over outages that do not overlap."""
        return list(self.report["paired_t_tests"])

    @property
    def report_path(self) -> Path:
        """outages.json."""
        return self.folder / "outages.json"

    @property
    def picture_path(self) -> Path:
        """replay.png."""
        return self.folder / "replay.png"


def run_trial(
    scenario: StrPath | Scenario = DEFAULT,
    *,
    seed: int | None = None,
    parameters: Mapping[str, Written] | None = None,
    plant: StrPath | None = None,
    estimator: StrPath | None = None,
    controller: StrPath | None = None,
    ahrs: bool = False,
    order: Order | None = None,
    fmi: Literal[2, 3] | None = None,
    onboard: str | None = None,
    loop: Loop | None = None,
    call_limit: float = Limits.call,
    memory_limit: float = Limits.memory / GIB,
    out: StrPath | None = None,
    progress: Progress | None = None,
) -> TrialResult:
    """Run a trial; the FMUs are built first if they are missing.

    >>> from harness import Scenario, run_trial
    >>> result = run_trial("two_waypoint", seed=3, parameters={"cmec.moving_deviation": 37}, out="out/mine")
    >>> result.outcome, result.waypoints_reached
    ('success', 1)
    >>> float(result.log["plant.north"].max()) > 15
    True

    The same with a scenario of one's own, one leg of 20 m to the east:

    >>> leg = Scenario(name="leg", waypoints=[(0.0, 20.0)], start=(0.0, 0.0, 90.0), duration=60.0)
    >>> run_trial(leg).folder.as_posix()
    'out/leg-1'

    Args:
        scenario: a `Scenario`, the name of a shipped one, or the path of a .toml, an .ssp, or a log.
        seed: the trial's number; by default the scenario's.
        parameters: values over the scenario's, by `block.name`; angles in degrees.
        plant, estimator, controller: what takes the places of ours: another one of ours by its name, such as
            "six_state", or an FMU; a mapping file may be beside it.
        ahrs: put our AHRS between sensors and estimator; canine_tracker then leads less often
            (`canine study leading`).
        order: of stepping; by default `sequential`.
        fmi: version of our FMUs; by default 2.
        onboard: `pil:host`, `pil:cortex-m4f` or `pil:rabbit4000` puts the firmware into the loop.
        loop: `native`, the loop in C, or `python`, its reference with the same log; by default `native`,
            with `onboard` `python`.
        call_limit: s that one call of an FMU made elsewhere may take.
        memory_limit: GiB that all FMUs may take, if one was made elsewhere.
        out: the folder of the results; by default out/<scenario>-<seed>.
        progress: called with the trial's time [s] as it runs.

    Raises:
        UsageError: a name, a value or a path does not fit.
        EndedByFaultError: an FMU went wrong after the first tick; `summary` is that of the trial up to there.
        CanineError: another fault in what was run.
    """
    _check_choice("order", order, get_args(Order))
    _check_choice("fmi", fmi, (2, 3))
    _check_choice("loop", loop, get_args(Loop))
    limits = _limits(call_limit, memory_limit)
    changes = Changes(
        order=order,
        fmi=None if fmi is None else str(fmi),
        swaps={"plant": plant, "controller": controller},
        settings=_settings(parameters),
        seed=seed,
        onboard=onboard,
        estimator=_text(estimator),
        ahrs=ahrs,
        loop=loop,
        limits=limits,
    )
    target = scenario if isinstance(scenario, Scenario) else str(scenario)
    with requested(target, changes) as request:
        build_missing(request)
        folder = request.default_folder if out is None else Path(out)
        with prepared(request) as ready:
            others = trial.replaced(request, ready, folder) if out is None else ""
            summary = trial.run(request, ready, folder, progress)
            return TrialResult(folder, summary, (*summary["notes"], *([others] if others else [])))


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

    _check_type("thresholds", thresholds, str, 'a text, "15:90" or "15:90:5"')
    _check_type("vary", vary, Mapping, 'a mapping, {"cmec.capture_radius": "3:10:0.5"}')
    _check_type("trials", trials, Integral, "a whole number")
    _check_choice("reading", reading, tuple(READINGS))
    limits = _limits(call_limit, memory_limit)
    notes: list[str] = []
    planned = sweep.plan_sweep(
        target if isinstance(target, Scenario) else str(target),
        thresholds=thresholds,
        vary=[f"{name}={values}" for name, values in (vary or {}).items()],
        trials=trials,
        system=system,
        reading=reading,
        seed=seed,
        settings=_settings(parameters),
        estimator=_text(estimator),
        ahrs=ahrs,
        plant=_text(plant),
        controller=_text(controller),
        limits=limits,
        note=notes.append,
    )
    folder = sweep.default_folder(planned) if out is None else Path(out)
    table, recommendation = sweep.run(
        planned,
        folder,
        dask,
        certificates=_certificates(dask_ca, dask_cert, dask_key),
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

    for what, names in (("controllers", controllers), ("plants", plants), ("scenarios", scenarios)):
        if names is not None and (isinstance(names, str) or not isinstance(names, Sequence)):
            raise UsageError(f'{what} is {names!r}; expected a list, ["cmec", "mine.fmu"]')
    _check_type("trials", trials, Integral, "a whole number")
    _check_choice("reading", reading, tuple(READINGS))
    limits = _limits(call_limit, memory_limit)
    notes: list[str] = []
    planned = matrix.plan_matrix(
        None if controllers is None else [str(name) for name in controllers],
        None if plants is None else [str(name) for name in plants],
        [one if isinstance(one, Scenario) else str(one) for one in scenarios],
        trials=trials,
        system=system,
        reading=reading,
        seed=seed,
        settings=_settings(parameters),
        estimator=_text(estimator),
        ahrs=ahrs,
        limits=limits,
        note=notes.append,
    )
    folder = matrix.default_folder(planned) if out is None else Path(out)
    result = matrix.run(
        planned,
        folder,
        dask,
        certificates=_certificates(dask_ca, dask_cert, dask_key),
        progress=progress,
        note=notes.append,
    )
    return MatrixResult(folder, result.facts(), tuple(notes), tuple(result.fmu_failures()))


def run_replay(
    recording: StrPath,
    *,
    estimator: str = "four_state",
    parameters: Mapping[str, Written] | None = None,
    outage: float = 10.0,
    every: float = 5.0,
    attitude: str = "",
    out: StrPath | None = None,
    progress: Callable[[int], None] | None = None,
) -> ReplayResult:
    """Run estimators over a recording with simulated GPS outages.

    >>> from harness import run_replay, run_trial
    >>> trial = run_trial("three_waypoint", out="out/recorded")
    >>> replay = run_replay(trial.log_path, outage=5, every=10, out="out/replayed")
    >>> len(replay.outages)
    2
    >>> replay.statistics["pitch"]["n"], list(replay.statistics)
    (2, ['speed held', 'mean speed', 'no pitch', 'pitch', 'fuzzy', 'pitch, floor', 'fuzzy, floor, cap'])

    Args:
        recording: a log of a trial with sensors, or a recording (see harness/recording/README.md).
        estimator: one of ours, several with commas between, or `all`; paths of FMUs too.
        parameters: values by `six_state.name`, or `estimator.name` for all; angles in degrees.
        outage: s without GPS.
        every: s from the start of one outage to the start of the next.
        attitude: own (of the Canine AHRS) or recorded; by default as recorded, where it is.
        out: the folder of the results; by default out/replay-<recording>.
        progress: called with the number of outages done.

    Raises:
        UsageError: there is no such estimator.
        CanineError: the recording cannot be read or is too short, or all FMUs fail.
    """
    from harness.recording.signals import require_attitude  # noqa: PLC0415
    from harness.replay import replay  # noqa: PLC0415 - scipy.stats, which trials need not wait for
    from harness.replay.comparison import compare  # noqa: PLC0415
    from harness.replay.source import open_source  # noqa: PLC0415

    comparison = compare(estimator, _settings(parameters))
    require_attitude(attitude)
    _check_range("outage", outage, "s", OUTAGE_S)
    _check_range("every", every, "s", EVERY_S)
    source = open_source(Path(recording), attitude)
    chosen = source.outages(outage, every)
    replayed = replay.replay(source, comparison, chosen, progress)
    folder = source.folder if out is None else Path(out)
    return ReplayResult(folder, replay.report(source, comparison, chosen, replayed, folder))


@dataclass(frozen=True)
class StudyResult:
    """A study that was carried out.

    Attributes:
        folder: with the pictures and the result as JSON.
        result: all that tables and pictures show.
        notes: what the user should know.
    """

    folder: Path
    result: dict[str, Any]
    notes: tuple[str, ...] = ()


def run_study(
    name: str,
    *,
    seeds: int | None = None,
    set_name: str | None = None,
    recording: StrPath | None = None,
    out: StrPath | None = None,
    progress: Callable[[float], None] | None = None,
) -> StudyResult:
    """Carry out a study of Chapter 3 or Appendices B to D.

    >>> from harness import run_study
    >>> study = run_study("pitch", seeds=3, out="out/pitch")
    >>> round(study.result["asymptote_m_s2"], 2)
    1.8

    Args:
        name: as `canine study` lists them.
        seeds: trials of each kind, 2 to 5,000; by default the study's own number.
        set_name: of sensors and pack, one of `models.sets.SETS`.
        recording: a folder or a log, for a study of one.
        out: the folder for the results; by default out/study-<name>.
        progress: called with the percentage that is done.

    Raises:
        UsageError: there is no such study, or it has no use for an option.
    """
    from harness.studies import study  # noqa: PLC0415 - imports scipy and the models

    _check_type("seeds", seeds, Integral, "a whole number")
    options = study.Options(seeds, set_name, None if recording is None else Path(recording))
    result = study.run_study(name, options, progress)
    folder = Path("out", f"study-{name}") if out is None else Path(out)
    notes: list[str] = []
    study.report(name, result, folder, notes.append)
    return StudyResult(folder, result, tuple(notes))


def open_log(path: StrPath) -> Log:
    """Read a log that a trial wrote; of a damaged one all up to there, and `broken` says why.

    >>> from harness import open_log, run_trial
    >>> log = open_log(run_trial("two_waypoint", out="out/logged").log_path)
    >>> float(log.time[1])
    0.04
    >>> log.arrays()["controller"]["mode"].dtype
    dtype('int64')
    >>> plant = log.frames()["plant"]
    >>> plant.index.name, plant.attrs["units"]["speed"]
    ('time', 'm/s')

    Raises:
        LogError: it cannot be read.
    """
    return read_log(Path(path))


def compare_logs(
    a: StrPath,
    b: StrPath,
    *,
    tolerance: float | None = None,
    tolerances: Mapping[str, float] | None = None,
    values_only: bool = False,
) -> LogComparison:
    """Compare two logs, or the logs in two folders of runs.

    >>> from harness import compare_logs, run_trial
    >>> one, two = (run_trial("two_waypoint", seed=seed, out=f"out/seed-{seed}") for seed in (1, 2))
    >>> comparison = compare_logs(one.folder, two.folder, tolerance=1e-9)
    >>> comparison.agree, comparison.first.signal
    (False, 'sensors.heading')
    >>> compare_logs(one.log_path, one.log_path).agree
    True

    Args:
        tolerance: largest difference that still agrees, in the signal's unit (angles in rad, by the shorter
            way round); by default values must have the same bits.
        tolerances: the same for one signal, `{"estimator.north": 0.01}`, or all of a component.
        values_only: metadata, units and attachments may differ.

    Raises:
        UsageError: a tolerance is not a number from 0 on, or for a signal that neither log has.
        LogError: a log cannot be read.
    """
    logs = read_log(log_of(Path(a))), read_log(log_of(Path(b)))
    return compare(*logs, Tolerances(tolerance, tolerances or {}), values_only=values_only)


def recover_log(path: StrPath, out: StrPath | None = None) -> Recovery:
    """Make a log whole that was cut, in a new file; one that is whole is not written anew.

    >>> from pathlib import Path
    >>> from harness import open_log, recover_log, run_trial
    >>> whole = run_trial("two_waypoint", out="out/whole").log_path
    >>> recover_log(whole).out is None
    True
    >>> _ = Path("out/cut.mcap").write_bytes(whole.read_bytes()[:400_000])
    >>> recovery = recover_log("out/cut.mcap")
    >>> recovery.out.as_posix(), recovery.is_complete
    ('out/cut-recovered.mcap', False)
    >>> len(open_log(recovery.out).time) == recovery.messages["/plant"]
    True

    Args:
        path: the log, or the folder of its run.
        out: the new file; by default <log>-recovered.mcap beside the log.

    Raises:
        UsageError: there is something at `out` already.
        LogError: the log cannot be read or has no tick, or the file cannot be written.
    """
    return recover(log_of(Path(path)), None if out is None else Path(out))


def load_scenario(target: StrPath) -> Scenario:
    """Read a scenario's file, or the shipped scenario of a name.

    >>> from dataclasses import replace
    >>> from harness import load_scenario
    >>> short = replace(load_scenario("three_waypoint"), name="short", duration=10.0)
    >>> short.waypoints
    ((35.73, 0.0), (35.73, 35.73))

    Raises:
        ScenarioError: it cannot be read, or something in it does not exist or is out of range.
    """
    return load(str(target))


def scenarios() -> list[str]:
    """The names of the shipped scenarios.

    >>> from harness import scenarios
    >>> "three_waypoint" in scenarios()
    True
    """
    return shipped()


def _check_choice(name: str, value: object, choices: Sequence[object]) -> None:
    if value is not None and value not in choices:
        raise UsageError(f"{name} is {value!r}; expected one of {', '.join(map(repr, choices))}")


def _check_type(name: str, value: object, kind: type, expected: str) -> None:
    if value is not None and not isinstance(value, kind):
        raise UsageError(f"{name} is {value!r}; expected {expected}")


def _check_range(name: str, value: object, unit: str, bounds: tuple[float, float]) -> None:
    low, high = bounds
    if not isinstance(value, Real) or not low <= float(value) <= high:
        shown = f"{float(value):g} {unit}" if isinstance(value, Real) else repr(value)
        raise UsageError(f"{name} is {shown}; expected a number from {low:g} to {high:g} {unit}")


def _settings(parameters: Mapping[str, Written] | None) -> Sequence[str]:
    """Parameters as `--set` has them."""
    _check_type("parameters", parameters, Mapping, 'a mapping, {"cmec.moving_deviation": 37}')
    return [f"{name}={toml_of(value, name)}" for name, value in (parameters or {}).items()]


def _text(name: StrPath | None) -> str | None:
    return None if name is None else str(name)


def _limits(call: float, memory: float) -> Limits:
    """The limits for FMUs of others, checked."""
    _check_range("call_limit", call, "s", CALL_LIMIT_S)
    _check_range("memory_limit", memory, "GiB", MEMORY_LIMIT_GIB)
    return Limits(call=call, memory=int(memory * GIB))


def _certificates(*paths: StrPath | None) -> Certificates:
    """The authority's certificate, this machine's, and its key."""
    from harness.sweep.tls import Certificates  # noqa: PLC0415 - as above

    return Certificates(*(None if path is None else Path(path) for path in paths))
