"""Trials one by one: a scenario's, and one with each of its faults alone."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

from harness.cosim.stepping import GIB, Limits, Loop, Order
from harness.front_door.arguments import (
    Progress,
    StrPath,
    check_choice,
    check_range,
    limits_of,
    named_from_python,
    settings_of,
    target_of,
    text_of,
)
from harness.log.log import Log, read_log
from harness.trial import DEFAULT, trial
from harness.trial.prepare import prepared
from harness.trial.request import Changes, build_missing, requested
from harness.trial.scenario import Scenario, Written, load, shipped
from models.kit.timing import TICK

LATEST_S = 86_400.0  # s, at which a fault of the catalogue may begin; it may last as long


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
class FaultsResult:
    """Trials with one fault each.

    Attributes:
        folder: with faults.json, faults.csv, and a folder for each trial by its number.
        rows: the content of faults.json: the trial without faults, then one for each fault, with `fault` in
            words, `outcome`, `verdict` (what the controller did: `stopped`, `went on`, `failed`),
            `stopped_within_ticks`, `time_s`, and `folder`.
        notes: what the user should know.
    """

    folder: Path
    rows: list[dict[str, Any]]
    notes: tuple[str, ...] = ()

    @property
    def table_path(self) -> Path:
        """faults.csv."""
        return self.folder / "faults.csv"

    @property
    def report_path(self) -> Path:
        """faults.json."""
        return self.folder / "faults.json"


@named_from_python
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
    check_choice("order", order, get_args(Order))
    check_choice("fmi", fmi, (2, 3))
    check_choice("loop", loop, get_args(Loop))
    limits = limits_of(call_limit, memory_limit)
    changes = Changes(
        order=order,
        fmi=None if fmi is None else str(fmi),
        swaps={"plant": plant, "controller": controller},
        settings=settings_of(parameters),
        seed=seed,
        onboard=onboard,
        estimator=text_of(estimator),
        ahrs=ahrs,
        loop=loop,
        limits=limits,
    )
    with requested(target_of(scenario), changes) as request:
        build_missing(request)
        folder = request.default_folder if out is None else Path(out)
        with prepared(request) as ready:
            others = trial.replaced(request, ready, folder) if out is None else ""
            summary = trial.run(request, ready, folder, progress)
            return TrialResult(folder, summary, (*summary["notes"], *([others] if others else [])))


@named_from_python
def run_faults(
    scenario: StrPath | Scenario,
    *,
    at: float = 3.0,
    lasting: float = 4.0,
    seed: int | None = None,
    parameters: Mapping[str, Written] | None = None,
    plant: StrPath | None = None,
    estimator: StrPath | None = None,
    controller: StrPath | None = None,
    ahrs: bool = False,
    onboard: str | None = None,
    call_limit: float = Limits.call,
    memory_limit: float = Limits.memory / GIB,
    out: StrPath | None = None,
    progress: Progress | None = None,
) -> FaultsResult:
    """Run a trial without faults, and one with each of the scenario's, or of a catalogue if it has none.

    >>> from harness import Disturbance, Scenario, run_faults
    >>> lost = Disturbance("radio", "lost", at=2.0, until=4.0)
    >>> leg = Scenario(name="leg", waypoints=[(20.0, 0.0)], duration=60.0, faults=(lost,))
    >>> faults = run_faults(leg, out="out/lost")
    >>> [(row["fault"], row["verdict"]) for row in faults.rows]
    [('no fault', 'went on'), ('lost radio', 'stopped')]

    Args:
        scenario: a `Scenario`, the name of a shipped one, or the path of a .toml, an .ssp, or a log.
        at, lasting: s at which the faults of the catalogue begin, and that they last.
        seed, parameters, plant, estimator, controller, ahrs, onboard, call_limit, memory_limit: as in
            `run_trial`.
        out: the folder of the results; by default out/<scenario>-faults.
        progress: called with the number of trials done.

    Raises:
        UsageError: a name, a value or a path does not fit, or no fault of the catalogue does.
        CanineError: a fault in what was run without faults.
    """
    from harness.trial import lone_faults  # noqa: PLC0415 - tables: trials need not wait

    check_range("at", at, "s", (0.0, LATEST_S))
    check_range("lasting", lasting, "s", (TICK, LATEST_S))
    changes = Changes(
        swaps={"plant": plant, "controller": controller},
        settings=settings_of(parameters),
        seed=seed,
        onboard=onboard,
        estimator=text_of(estimator),
        ahrs=ahrs,
        limits=limits_of(call_limit, memory_limit),
    )
    notes: list[str] = []
    with requested(target_of(scenario), changes) as request:
        cases = lone_faults.build_cases(request, at, at + lasting, note=notes.append)
        folder = lone_faults.default_folder(request) if out is None else Path(out)
        rows: list[dict[str, Any]] = []
        with closing(lone_faults.run_cases(request, cases, folder)) as results:
            for row in results:
                rows.append(row)
                if progress:
                    progress(len(rows))
    return FaultsResult(folder, rows, tuple(notes))


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
