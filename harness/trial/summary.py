"""The summary of a trial, from its log alone: summary.json, a table for the terminal, a sentence."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape

from codegen.firmware.telemetry import Refusal
from harness.files import write_whole
from harness.log.channel import Array
from harness.log.events import ANOMALIES, because, cause_of_stop
from harness.log.log import Log, named
from harness.terminal import console_of, new_table, print_table
from harness.trial.disturbances import faults_of
from harness.trial.missions import is_of_station, last_mission, start_of_last
from models.commands import Command, Status
from models.modes import Anomaly
from models.system import ESTIMATOR

OUTCOMES = {Status.SUCCESS: "success", Status.FAILED: "failed", Status.STOPPED: "stopped"}
# the estimator's anomalies: an output, whether it goes up or down, and words (rules of models/SAFETY.md)
DOUBTS = {
    "REJECTED_FIX": ("estimator.rejected_fixes", 1, "the estimator rejected a fix (rule 5)"),
    "JUMP": ("estimator.jumps", 1, "a fix moved the estimate by more than it may (rule 5)"),
    "RECOVERY": ("estimator.recoveries", 1, "the estimator began anew (rule 5)"),
    "CONTRADICTED_HEADING": ("estimator.heading_ok", -1, "courses contradict the heading (rule 6)"),
}
NO_ERROR = "no estimate, or no truth to compare it with"
LAST_HEARD = "it was under way when the vest was last heard"
NOT_BEGUN = "no mission was begun"
STANDING, STOOD_S = 0.01, 10.0  # m/s below which an animal stands, and s from which that is told
LABELS = {
    "scenario": "scenario",
    "seed": "seed",
    "estimator": "estimator",  # shown if it is another than the default
    "outcome": "outcome",
    "stopped_by": "ended by",  # shown if anything did
    "time_s": "time",
    "waypoints_reached": "waypoints reached",
    "directional_commands": "directional commands",
    "anomalies": "anomalies",
    "position_error_m": "position error",
    "ticks": "ticks",
    "real_time_factor": "times real time",
    "log": "log",
}


def summarize(log: Log, real_time_factor: float | None = None, notes: Sequence[str] = ()) -> dict[str, Any]:
    """The content of summary.json.

    - `outcome` follows from the last `status` of the controller: `success`, `failed` or `stopped`. Otherwise
      it is `timeout`, or `stopped` if the log is broken: something else ended the run. A run without a
      controller times out. A station's log is about its last mission, and never a timeout.
    - `stopped_by` says in words which safety rule stopped it (models/SAFETY.md), that the operator did, what
      else ended the run, why the trial failed, why the vest let none begin, or where the animal stood when
      the time was over; None after a success, and if it moved until then.
    - `estimator` names what estimated, with what gave it its attitude; None without an estimator.
    - `time_s` is when the controller took that status, or the end of the run; in the log of a station
      `started_s` is when that mission began, None if none did.
    - `anomalies` counts the ticks that reported each kind, by name: the controller's, then the estimator's.
    - `position_error_m` is the horizontal distance of the estimate from the truth over all ticks on which
      both are finite (all but the last, where an output that is not ended the run); None without an
      estimator, or if there is no such tick.
    - `faults` are the scenario's, as written.

    Args:
        real_time_factor: trial time over elapsed time; a log has no wall-clock time.
        notes: what the user should know; a log has none.
    """
    begun: dict[str, Any] = {}
    if is_of_station(log):
        begun, log = {"started_s": start_of_last(log)}, last_mission(log)
    scenario = log.metadata.get("scenario", {})
    outcome, time = _outcome(log)
    return {
        "scenario": scenario.get("name", ""),
        "seed": _seed(scenario.get("seed", "")),
        "estimator": estimator_of(log),
        "outcome": outcome,
        "stopped_by": stopped_by(log),
        "time_s": time,
        "waypoints_reached": _last(log, "controller.waypoint"),
        "directional_commands": _last(log, "controller.directional_commands"),
        "anomalies": _anomalies(log),
        "position_error_m": _position_error(log),
        "ticks": len(log.time),
        "faults": [asdict(fault) for fault in faults_of(log)],
        "real_time_factor": real_time_factor,
        "log": log.path.name,
        "notes": list(notes),
        **begun,
    }


def estimator_of(log: Log) -> str | None:
    """The estimator of a trial in words; None without one, or if the log does not tell."""
    roles, swaps = log.metadata.get("roles", {}), log.metadata.get("swaps", {})
    if "estimator" not in roles:
        return None
    ahrs = f" with {roles['ahrs']}" if "ahrs" in roles else ""
    return roles["estimator"] + " from an FMU" * ("estimator" in swaps) + ahrs


def _outcome(log: Log) -> tuple[str, float]:
    if "controller.status" in log and log["controller.status"][-1] in OUTCOMES:
        return OUTCOMES[Status(int(log["controller.status"][-1]))], float(log.time[_since(log)])
    return ("stopped" if log.broken or is_of_station(log) else "timeout"), float(log.time[-1])


def _since(log: Log) -> int:
    """The tick on which the controller took the status that it ended with."""
    status = log["controller.status"]
    before = np.flatnonzero(status != status[-1])
    return int(before[-1]) + 1 if before.size else 0


def stopped_by(log: Log) -> str | None:
    """Why a trial did not succeed, in words; None after a success, and if its time was over while it moved.

    If the log is not whole, the reason for that.
    """
    outcome, _ = _outcome(log)
    status = log["controller.status"][-1] if "controller.status" in log else Status.IDLE
    if status in (Status.STOPPED, Status.FAILED):
        return ended_by(log, _since(log))
    if outcome == "stopped" and log.broken:
        return log.broken
    if status == Status.IDLE and "telemetry.refusal" in log:
        refusal = Refusal(int(log["telemetry.refusal"][-1]))
        if refusal:
            return f"START was refused: {refusal.words}"
    if outcome == "stopped":
        return NOT_BEGUN if status == Status.IDLE else LAST_HEARD
    return _stood(log) if outcome == "timeout" else None


def _stood(log: Log) -> str | None:
    """That an animal no longer moved when its time was over, in words; None if it did."""
    signals = [f"plant.{name}" for name in ("north", "east", "speed")]
    if not all(signal in log for signal in (*signals, "controller.command")):
        return None
    north, east, speed = (log[signal] for signal in signals)
    moving = np.flatnonzero(~(np.abs(speed) < STANDING))
    seconds = float(log.time[-1] - log.time[moving[-1] if moving.size else 0])
    if seconds < STOOD_S:
        return None
    command = named(Command, log["controller.command"][-1])
    return (
        f"its time was over, and it had stood for {seconds:.0f} s at {north[-1]:.1f} m north, "
        f"{east[-1]:.1f} m east, last told {command}"
    )


def ended_by(log: Log, row: int) -> str | None:
    """Why a trial was stopped or failed on a row, in words; None for a failure of which nothing is told."""
    code = log["controller.anomaly"][row] if "controller.anomaly" in log else Anomaly.NONE
    if log["controller.status"][row] == Status.FAILED:
        return ANOMALIES[code] if code == Anomaly.TRIAL_FAILURE else None
    return cause_of_stop(code)


def _seed(text: str) -> int | str:
    return int(text) if text.lstrip("-").isdigit() else text


def _last(log: Log, signal: str) -> int:
    return int(log[signal][-1]) if signal in log and math.isfinite(log[signal][-1]) else 0


def _anomalies(log: Log) -> dict[str, int]:
    counted: dict[str, int] = {}
    if "controller.anomaly" in log:
        codes, counts = np.unique(log["controller.anomaly"], return_counts=True)
        counted = {named(Anomaly, code): int(n) for code, n in zip(codes, counts, strict=True) if code != 0}
    for name, (signal, step, _) in DOUBTS.items():
        if signal in log:
            counted[name] = int((step * np.diff(log[signal]) > 0).sum())
    return {name: count for name, count in counted.items() if count}


def position_error(log: Log) -> Array | None:
    """Horizontal distance of the estimate from the truth at each tick, (ticks,) in m; None without both."""
    signals = [f"{role}.{axis}" for axis in ("north", "east") for role in ("estimator", "plant")]
    if not all(signal in log for signal in signals):
        return None
    north, true_north, east, true_east = (log[signal] for signal in signals)
    error: Array = np.hypot(north - true_north, east - true_east)
    return error


def _position_error(log: Log) -> dict[str, float] | None:
    error = position_error(log)
    error = None if error is None else error[np.isfinite(error)]
    if error is None or not error.size:
        return None
    return {"mean": float(error.mean()), "max": float(error.max()), "final": float(error[-1])}


def write_summary(summary: Mapping[str, Any], path: Path) -> None:
    """Write summary.json. Raises FileError as `write_whole` does."""
    write_whole(path, (json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode())


def words(summary: Mapping[str, Any]) -> dict[str, str]:
    """The summary as text, by label."""
    text = {key: str(summary[key]) for key in LABELS}
    begun = f", {_since_start(summary):.2f} s after its begin" if summary.get("started_s") is not None else ""
    text["time_s"] = f"{summary['time_s']:.2f} s{begun}"
    counts = (f"{name.lower().replace('_', ' ')} {n}" for name, n in summary["anomalies"].items())
    text["anomalies"] = ", ".join(counts) or "none"
    error = summary["position_error_m"]
    text["position_error_m"] = (
        "mean {mean:.2f} m, max {max:.2f} m, final {final:.2f} m".format(**error) if error else NO_ERROR
    )
    factor = summary["real_time_factor"]
    text["real_time_factor"] = "not measured" if factor is None else f"{factor:.0f}"
    if summary["estimator"] in (None, ESTIMATOR):
        del text["estimator"]
    if summary["stopped_by"] is None:
        del text["stopped_by"]
    if summary["seed"] == "":  # nobody drew anything
        del text["seed"]
    return {LABELS[key]: value for key, value in text.items()}


def in_a_sentence(summary: Mapping[str, Any]) -> str:
    """How the trial ended, and why."""
    lasted = _since_start(summary)
    time = f"{lasted:.1f}".removesuffix(".0") if lasted >= 1 else f"{lasted:g}"
    waypoints, commands = summary["waypoints_reached"], summary["directional_commands"]
    return (
        f"{summary['outcome'].capitalize()} after {time} s{because(summary['stopped_by'])}. "
        f"{waypoints or 'No'} waypoint{'s' * (waypoints != 1)} reached, with "
        f"{commands or 'no'} directional command{'s' * (commands != 1)}."
    )


def _since_start(summary: Mapping[str, Any]) -> float:
    """How long a trial lasted, or the last mission of a station's log, s."""
    return float(summary["time_s"] - (summary.get("started_s") or 0.0))


def show(summary: Mapping[str, Any], console: Console | None = None) -> None:
    """Print the summary as a table."""
    colour = {"success": "green", "failed": "red"}.get(summary["outcome"], "yellow")
    table = new_table(header=False)
    for label, text in words(summary).items():
        table.add_row(label, f"[bold {colour}]{text}[/]" if label == "outcome" else escape(text))
    print_table(table, console or console_of())
