"""Logs and recordings: read, compared, made whole, replayed; what they tell of a dog and of an estimator."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from harness.front_door.arguments import (
    Progress,
    StrPath,
    check_choice,
    check_range,
    name_of,
    named_from_python,
    names_of,
    numbers_of,
    settings_of,
)
from harness.log.compare import LogComparison, Tolerances, compare
from harness.log.log import Log, log_of, read_log
from harness.log.recover import Recovery, recover
from harness.replay import EVERY_S, OUTAGE_S
from harness.trial.scenario import Written
from models.errors import UsageError

TURNED = 1e-3, 90.0  # deg/s


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


@dataclass(frozen=True)
class FitResult:
    """A dog's statistics.

    Attributes:
        folder: with all of its files.
        report: the content of fit.json.
        notes: what the user should know.
    """

    folder: Path
    report: Mapping[str, Any]
    notes: tuple[str, ...] = ()

    @property
    def parameters(self) -> dict[str, float]:
        """The dog as a scenario states it, by `canine.name`; angles in degrees."""
        return dict(self.report["parameters"])

    @property
    def statistics(self) -> dict[str, dict[str, Any]]:
        """By quantity: `n`, `mean`, `sd`, their 95 % intervals, `unit`, and Table 5.1's beside them."""
        return dict(self.report["statistics"])

    @property
    def responses(self) -> dict[str, dict[str, Any]]:
        """By side: how many commands were given and obeyed, the `rate`, and its 95 % interval."""
        return dict(self.report["responses"])

    @property
    def effects(self) -> dict[str, dict[str, Any]]:
        """Of a day, by parameter: `estimate`, 95 % `interval`, and the `verdict`; empty without `rest`."""
        return dict(self.report["day"]["effects"]) if "day" in self.report else {}

    @property
    def report_path(self) -> Path:
        """fit.json."""
        return self.folder / "fit.json"

    @property
    def parameters_path(self) -> Path:
        """fit.toml, the parameters as the end of a scenario."""
        return self.folder / "fit.toml"

    @property
    def page_path(self) -> Path:
        """fit.html."""
        return self.folder / "fit.html"

    @property
    def picture_path(self) -> Path:
        """fit.png."""
        return self.folder / "fit.png"


@dataclass(frozen=True)
class TuneResult:
    """An estimator's noise, fitted to a recording.

    Attributes:
        folder: with all of its files.
        report: the content of tune.json.
        notes: what the user should know.
    """

    folder: Path
    report: Mapping[str, Any]
    notes: tuple[str, ...] = ()

    @property
    def noises(self) -> list[dict[str, Any]]:
        """Each noise that was fitted, with its interval."""
        return list(self.report["noises"])

    @property
    def report_path(self) -> Path:
        """tune.json."""
        return self.folder / "tune.json"

    @property
    def parameters_path(self) -> Path:
        """tune.toml, the parameters as the end of a scenario."""
        return self.folder / "tune.toml"

    @property
    def page_path(self) -> Path:
        """tune.html."""
        return self.folder / "tune.html"

    @property
    def picture_path(self) -> Path:
        """tune.png."""
        return self.folder / "tune.png"


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


@named_from_python
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


@named_from_python
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


@named_from_python
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

    comparison = compare(
        name_of("estimator", estimator, 'a text, "four_state,mine.fmu"'), settings_of(parameters)
    )
    require_attitude(attitude)
    check_range("outage", outage, "s", OUTAGE_S)
    check_range("every", every, "s", EVERY_S)
    source = open_source(Path(recording), attitude)
    chosen = source.outages(outage, every)
    replayed = replay.replay(source, comparison, chosen, progress)
    folder = source.folder if out is None else Path(out)
    return ReplayResult(folder, replay.report(source, comparison, chosen, replayed, folder))


@named_from_python
def run_fit(
    logs: StrPath | Sequence[StrPath],
    *,
    source: Literal["plant", "estimator"] | None = None,
    turned: float | None = None,
    rest: float | Sequence[float] | None = None,
    parameters: Mapping[str, Written] | None = None,
    out: StrPath | None = None,
    progress: Callable[[int], None] | None = None,
) -> FitResult:
    """Estimate a dog's statistics (Table 5.1) from the logs of trials, and how it tires over a day.

    >>> from harness import run_fit, run_trial
    >>> trials = [run_trial("right_45", seed=seed, out=f"out/dog/{seed}") for seed in (1, 2)]
    >>> fit = run_fit("out/dog", out="out/fitted")
    >>> fit.statistics["cruise_speed"]["n"], round(fit.parameters["canine.cruise_speed"], 2)
    (2, 4.86)
    >>> again = run_trial("left_45", parameters=fit.parameters, out="out/my-dog")

    Args:
        logs: paths of logs, and of folders with logs anywhere in them. With `rest` each folder's logs are one
            day's missions, and so are logs that are named in a row.
        source: whose motion is read; by default the plant's where it is logged, else the estimator's.
        turned: deg/s from which on a LEFT or RIGHT was obeyed; by default each source's own.
        rest: s between two missions of a day: one for all, or one for each.
        parameters: with `rest`, what of a day's laws is taken as given, `{"canine.fatigue_time": 1800}`.
        out: the folder of the results; by default out/fit.
        progress: called with the number of logs read.

    Raises:
        UsageError: a path or a value does not fit, or there is nothing to estimate from.
        CanineError: no log can be read.
    """
    from harness.fit import day, report  # noqa: PLC0415 - scipy.stats, which trials need not wait for
    from harness.fit import estimate as statistics  # noqa: PLC0415

    check_choice("source", source, ("plant", "estimator"))
    if turned is not None:
        check_range("turned", turned, "deg/s", TURNED)
    listed = [logs] if isinstance(logs, str | Path) else logs
    paths = [Path(name) for name in names_of("logs", listed, '["monday", "tuesday"]')]
    settings = settings_of(parameters)
    days = None
    if rest is not None:
        days = day.Days(statistics.days_of(paths), numbers_of("rest", rest, "s"), day.laws_given(settings))
    elif settings:
        raise UsageError(
            f"parameters is {parameters!r}; expected rest with them: they are of the laws of a day"
        )
    reading = statistics.read_tracks(statistics.find_logs(paths), source, progress)
    result = statistics.estimate(reading, None if turned is None else math.radians(turned), days)
    folder = report.FOLDER if out is None else Path(out)
    notes: list[str] = []
    report.report(result, folder, notes.append)
    return FitResult(folder, result, (*notes, *result["notes"]))


@named_from_python
def run_tune(
    recording: StrPath,
    *,
    estimator: str = "four_state",
    hold: Sequence[str] = (),
    out: StrPath | None = None,
    progress: Progress | None = None,
) -> TuneResult:
    """Fit an estimator's noise to a recording: the noise that makes its first half's innovations most likely.

    >>> from harness import run_trial, run_tune
    >>> trial = run_trial("three_waypoint", out="out/to-tune")
    >>> tuned = run_tune(trial.log_path, hold=["sigma_bias"], out="out/tuned")
    >>> "sigma_bias" in {noise["name"] for noise in tuned.noises}
    False

    Args:
        recording: a log of a trial with sensors, or a recording (see harness/recording/README.md).
        estimator: one of ours.
        hold: noises that stay as declared.
        out: the folder of the results; by default out/tune-<recording>.
        progress: called with the percentage that is done.

    Raises:
        UsageError: there is no such estimator or noise.
        CanineError: the recording cannot be read, or is too short.
    """
    from harness.replay.source import open_source  # noqa: PLC0415 - scipy, which trials need not wait for
    from harness.tune import report  # noqa: PLC0415
    from harness.tune.tune import tune  # noqa: PLC0415
    from models.system import find_estimator  # noqa: PLC0415

    block = find_estimator(name_of("estimator", estimator, 'a name, "four_state"'))
    held = names_of("hold", hold, '["sigma_bias"]')
    source = open_source(Path(recording))
    result = tune(source, block, held, progress)
    folder = report.default_folder(source.name) if out is None else Path(out)
    notes = list(source.notes)
    report.report(result, folder, notes.append)
    return TuneResult(folder, result, tuple(notes))
