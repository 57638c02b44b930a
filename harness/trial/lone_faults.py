"""Each fault alone: a trial with it beside one without, and what the controller did."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape

from harness.files import write_set
from harness.log.log import Log, named, read_log
from harness.terminal import new_table, print_table
from harness.trial import trial
from harness.trial.prepare import prepared
from harness.trial.request import Request, build_missing
from harness.trial.scenario import ARROW, Disturbance, ScenarioError
from models.commands import Command, Status
from models.errors import UsageError
from models.modes import Anomaly, Mode

REFERENCE = "no fault"
JSON, CSV = "faults.json", "faults.csv"
COLUMNS = (
    *("fault", "from_s", "until_s", "outcome", "verdict", "stopped_within_ticks"),
    *("first", "first_after_ticks", "time_s", "folder"),
)
NOTICED = frozenset(a for a in Anomaly if a >= Anomaly.LOST_LINK)  # by which a controller stops the animal
SIGNALS = {"anomaly": Anomaly, "command": Command, "mode": Mode, "status": Status}  # of the controller

# What is tried on a system without faults of its own: signals, and kinds with their values
Kinds = Mapping[str, float | None]
GPS: Kinds = {"stuck": None, "offset": 5.0, "noise": 5.0, "delay": 1.0, "jump": 20.0, "nan": None}
RATE: Kinds = {"off": None, "stuck": None, "offset": 20.0, "noise": 30.0, "dropouts": 0.5, "nan": None}
FORCE: Kinds = {"off": None, "stuck": None, "offset": 3.0, "scale": 2.0, "noise": 10.0, "nan": None}
ANGLE: Kinds = {"stuck": None, "offset": 30.0, "noise": 20.0, "delay": 0.4, "jump": 90.0, "nan": None}
PLACE: Kinds = {"stuck": None, "offset": 5.0, "jump": 20.0, "nan": None}
STALL: Kinds = {"stall": None}  # of what is worn: an animal does not stand still in the air
CATALOGUE: tuple[tuple[tuple[str, ...], Kinds], ...] = (
    (("sensors.gps_north", "sensors.gps_east"), GPS),
    (("sensors.gps_speed",), {"off": None, "stuck": None, "offset": 2.0, "noise": 1.0, "nan": None}),
    (("sensors.gps_fix",), {"off": None, "dropouts": 0.5, "delay": 0.4}),
    (("sensors.accel_x",), FORCE),
    (("sensors.gyro_z",), RATE),
    (("sensors.pitch_meas",), ANGLE),
    (("sensors.heading_meas",), ANGLE),
    (("estimator.north -> controller.north", "estimator.east -> controller.east"), PLACE),
    (("estimator.speed -> controller.speed",), {"off": None, "stuck": None, "nan": None}),
    (("estimator.heading -> controller.heading",), ANGLE),
    (("estimator.valid -> controller.valid",), {"off": None, "dropouts": 0.5}),
    (("plant.north -> controller.north", "plant.east -> controller.east"), PLACE),
    (("plant.speed -> controller.speed",), {"off": None, "stuck": None, "nan": None}),
    (("plant.heading -> controller.heading",), ANGLE),
    (("controller.command -> plant.command",), {"off": None, "stuck": None, "delay": 0.4, "dropouts": 0.5}),
    (("sensors",), STALL),
    (("ahrs",), STALL),
    (("estimator",), STALL),
    (("controller",), STALL),
    (("command_module",), STALL),
    (("radio",), {"lost": None, "garbage": 0.3}),
    (("gps",), {"garbage": 0.3}),
    (("imu",), {"garbage": 0.3}),
)


@dataclass(frozen=True)
class Case:
    """What is tried in one trial: a fault, or one of a group of signals."""

    faults: tuple[Disturbance, ...]

    def words(self, units: Mapping[str, str]) -> str:
        """The case in a table: `stuck of estimator.north, estimator.east -> controller`.

        Args:
            units: of the signals, by `component.output`.
        """
        first, *others = self.faults
        if not others:
            return first.words(units)
        ends = [fault.signal.partition(ARROW) for fault in self.faults]
        to = {f" {arrow}{end.partition('.')[0]}" if arrow else "" for _, arrow, end in ends}
        signals = ", ".join(fault.output for fault in self.faults) + "".join(sorted(to))
        return first.words(units, signals)

    @property
    def span(self) -> tuple[float, float | None]:
        """From and until [s]."""
        return self.faults[0].at, self.faults[0].until


def shipped_cases(at: float, until: float) -> list[Case]:
    """The catalogue, each case from and until [s]; what a system lacks is left out later."""
    return [
        Case(tuple(Disturbance(signal, kind, at, until, value) for signal in signals))
        for signals, kinds in CATALOGUE
        for kind, value in kinds.items()
    ]


def build_cases(
    request: Request,
    at: float,
    until: float,
    *,
    built: Callable[[Path], None] = lambda path: None,
    note: Callable[[str], None] = lambda text: None,
) -> list[Case]:
    """What is tried, with its FMUs built: the scenario's own faults, or those of the catalogue that fit.

    Args:
        at, until: s, of the catalogue's.
        built: is told of each FMU that had to be built.
        note: called with a line for the user.

    Raises:
        UsageError: none of the catalogue fits.
        CanineError: what is asked for cannot be run.
    """
    own = [Case((fault,)) for fault in request.scenario.faults]
    cases = own or shipped_cases(at, until)
    build_missing(with_faults(request, tuple(fault for case in cases for fault in case.faults)), built)
    with prepared(request) as ready:
        for text in (*request.notes, *ready.notes):
            note(text)
    if not own:
        cases = fitting(request, cases)
    if not cases:
        raise UsageError(
            f"faults {request.scenario.name}: no fault of the catalogue fits; state some as [[fault]]"
        )
    return cases


def fitting(request: Request, cases: Iterable[Case]) -> list[Case]:
    """The cases that the requested system can have."""
    fits = []
    for case in cases:
        try:
            with prepared(with_faults(request, case.faults)):
                fits.append(case)
        except ScenarioError:
            continue
    return fits


def with_faults(request: Request, faults: tuple[Disturbance, ...]) -> Request:
    return replace(request, scenario=replace(request.scenario, faults=faults))


def default_folder(request: Request) -> Path:
    """Where the trials go by default: out/<scenario>-faults."""
    return request.default_folder.with_name(f"{request.scenario.name}-faults")


def run_cases(request: Request, cases: Sequence[Case], out: Path) -> Generator[dict[str, Any]]:
    """Run a trial without faults into out/0, then one with each case into out/1, ...; yields the results.

    However it ends, faults.json and faults.csv have the trials that are done.

    Raises:
        UsageError: a folder cannot be made, or others write into it.
        CanineError: a fault in what was run without faults.
        KeyboardInterrupt: the user ended it.
    """
    with trial.alone_in(out):
        write_set(out, {}, (JSON, CSV))  # an earlier run's go
        results: list[dict[str, Any]] = []
        try:
            reference: Log | None = None
            for number, case in enumerate([None, *cases]):
                folder = out / str(number)
                summary, error = _fly(with_faults(request, case.faults if case else ()), folder)
                if error is not None and case is None:
                    raise error
                log = read_log(folder / trial.LOG)
                reference = reference or log
                results.append(judge(case, summary, reference, log, error) | {"folder": str(number)})
                yield results[-1]
        finally:
            if results:
                text = json.dumps(results, indent=2, ensure_ascii=False) + "\n"
                write_set(out, {JSON: text.encode(), CSV: csv_of(results)})


def _fly(request: Request, folder: Path) -> tuple[dict[str, Any], trial.EndedByFaultError | None]:
    """A trial's summary, and what ended it before its time."""
    with prepared(request) as ready:
        try:
            return trial.run(request, ready, folder), None
        except trial.EndedByFaultError as error:
            return error.summary, error


def judge(
    case: Case | None,
    summary: Mapping[str, Any],
    reference: Log,
    log: Log,
    error: trial.EndedByFaultError | None = None,
) -> dict[str, Any]:
    """What the controller did about a fault.

    - `stopped`: it commanded STOP, or ended the mission, since it noticed something (a lost link, an invalid
      estimate, a bad input, a limit), where it does not without the fault; `stopped_within_ticks` of the
      fault's beginning.
    - `failed`: it did not, and the trial was no success, or something else ended it.
    - `went on`: it did not, and the trial was a success.

    `first` is what of its signals differed first from the trial without faults, `first_after_ticks`.
    """
    at, until = case.span if case else (None, None)
    result: dict[str, Any] = {
        "fault": case.words(log.units) if case else REFERENCE,
        "faults": [asdict(fault) for fault in case.faults] if case else [],
        "from_s": at,
        "until_s": until,
        "outcome": summary["outcome"],
        "time_s": summary["time_s"],
        "stopped_by": summary["stopped_by"],
        "position_error_m": summary["position_error_m"],
        "error": None if error is None else str(error),
    }
    start = None if at is None else int(np.searchsorted(log.time, at - 1e-9))
    first, after = (None, None) if start is None else _first_difference(reference, log, start)
    within = None if start is None else _stopped_within(reference, log, start)
    if within is not None:
        verdict = "stopped"
    else:
        verdict = "went on" if error is None and summary["outcome"] == "success" else "failed"
    return result | {
        "verdict": verdict,
        "stopped_within_ticks": within,
        "first": first,
        "first_after_ticks": after,
    }


def _first_difference(reference: Log, log: Log, start: int) -> tuple[str | None, int | None]:
    """What of the controller's signals differs first from a tick on, in words, and after how many ticks."""
    differences: list[tuple[int, str]] = []
    for name, names in SIGNALS.items():
        signal = f"controller.{name}"
        if signal in log and signal in reference:
            count = min(len(log.time), len(reference.time))
            differs = np.flatnonzero(log[signal][start:count] != reference[signal][start:count])
            if differs.size:
                value = named(names, log[signal][start + differs[0]])
                differences.append((int(differs[0]), f"{name} {value.lower().replace('_', ' ')}"))
    if not differences:
        return None, None
    after, words = min(differences, key=lambda pair: pair[0])  # of several, the anomaly
    return words, after


def _stopped_within(reference: Log, log: Log, start: int) -> int | None:
    """After how many ticks the controller stops the animal for what it noticed; None if it does not."""
    signals = [f"controller.{name}" for name in ("command", "anomaly", "status")]
    if not all(signal in log and signal in reference for signal in signals):
        return None
    command, anomaly, status = (log[signal][start:] for signal in signals)
    usual = reference["controller.command"][start:] == Command.STOP
    stops = (command == Command.STOP) | (status == Status.STOPPED)
    has_noticed = False  # since the animal is stopped; an anomaly is reported once
    for tick, (stop, reported) in enumerate(zip(stops, anomaly, strict=True)):
        has_noticed = stop and (has_noticed or reported in NOTICED)
        if has_noticed and not (tick < len(usual) and usual[tick]):
            return tick
    return None


def csv_of(results: Sequence[Mapping[str, Any]]) -> bytes:
    """The table as CSV: a row for each trial; empty where there is nothing to say."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for result in results:
        writer.writerow("" if result[column] is None else result[column] for column in COLUMNS)
    return text.getvalue().encode()


def did(result: Mapping[str, Any]) -> str:
    """What the controller did, in words."""
    ticks = result["stopped_within_ticks"]
    return result["verdict"] if ticks is None else f"stopped within {_ticks(ticks)}"


def _ticks(count: int) -> str:
    return f"{count} tick{'s' * (count != 1)}"


def show(results: Sequence[Mapping[str, Any]], console: Console) -> None:
    """Print the table."""
    table = new_table()
    for heading in ("fault", "s", "outcome", "controller", "what differed first"):
        table.add_column(heading)
    for result in results:
        until = "" if result["until_s"] is None else f"{result['until_s']:g}"
        span = "" if result["from_s"] is None else f"{result['from_s']:g}-{until}"
        first = result["first"]
        after = result["first_after_ticks"]
        table.add_row(
            escape(result["fault"]),
            span,
            result["outcome"],
            did(result),
            escape(result["error"] or (f"{first} after {_ticks(after)}" if first else "nothing"))
            if span
            else "",
        )
    print_table(table, console)
