"""Where the sensor signals of a replay come from: a recording, or the log of a trial."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from harness.log.arrived import READER, SENSORS, arrived, disturbed
from harness.log.log import Log, log_of, read_log
from harness.recording.attitude import ANGLES, SAMPLES, TICK_S, own_attitude
from harness.recording.holes import HOLE_OF_IMU_S, Hole, holes, holes_of_imu
from harness.recording.read import read_recording
from harness.recording.recording import RecordingError
from harness.recording.signals import (
    MOVING_M_S,
    OWN,
    RECORDED,
    SensorSignals,
    recording_attitude,
    sensor_signals,
)
from harness.replay.windows import Outages, Window, choose
from models.system import ESTIMATOR, ESTIMATORS


@dataclass(frozen=True)
class ReplaySource:
    """A recording of real sensors, or the log of a trial, as a source of sensor signals.

    Attributes:
        name: of the recording or trial, for the results.
        signals: gives the estimator's inputs with the fixes in some windows withheld.
        imu_holes: start and end [s] of each time without inertial samples.
        dropped: what was not used, cause -> number.
        attitude: OWN or RECORDED, which one the signals have.
        broken: why the recording is incomplete; "" if it is complete.
        notes: what a result rests on, and what looks wrong.
    """

    name: str
    signals: Callable[[Sequence[Window]], SensorSignals]
    imu_holes: Sequence[Hole] = ()
    dropped: Mapping[str, int] = field(default_factory=dict)
    attitude: str = RECORDED
    broken: str = ""
    notes: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        """The folder of the results by default."""
        return Path("out") / f"replay-{self.name}"

    def outages(self, length: float, every: float) -> Outages:
        """Outages of `length` [s], one every `every` [s], from the first motion on."""
        signals = self.signals([])
        fixes = signals.t[signals.reference_fix]
        moving = signals.t[signals.reference_fix & (signals.reference_speed > MOVING_M_S)]
        return choose(fixes, moving, self.imu_holes, length=length, every=every)


def recorded_at(path: Path) -> Path:
    """The recording or log at a path: of the folder of a run its log."""
    log = log_of(path)
    return log if os.path.isfile(log) else path  # unlike Path's, it raises nothing


def open_source(path: Path, attitude: str = "") -> ReplaySource:
    """Open a recording, a trial.mcap, or that in the folder of a run.

    Args:
        attitude: OWN or RECORDED; by default as recorded, if the recording has one.

    Raises:
        RecordingError, LogError: the path is neither, or is damaged, or has no attitude to take.
    """
    path = recorded_at(path)
    return _of_log(path, attitude) if path.suffix == ".mcap" else _of_recording(path, attitude)


def _of_recording(folder: Path, attitude: str) -> ReplaySource:
    recording = read_recording(folder)
    attitude = recording_attitude(recording, attitude)
    choice = [] if recording.attitude is None else [f"the attitude is {attitude}, by --attitude another"]
    return ReplaySource(
        recording.name,
        lambda windows: sensor_signals(recording, windows, attitude),
        holes_of_imu(recording.imu_t),
        recording.dropped,
        attitude=attitude,
        notes=(*recording.notes, *recording.doubts, *choice),
    )


def _of_log(path: Path, attitude: str) -> ReplaySource:
    log = read_log(path)
    inputs = ESTIMATORS[ESTIMATOR].group("input")
    needed = {*(input.name for input in inputs if not input.has_start), "gps_course"}
    needed |= set(SAMPLES) if attitude == OWN else set()
    missing = [s for s in (f"sensors.{name}" for name in sorted(needed)) if s not in log]
    if missing:
        raise RecordingError(
            f'{path}: the log has no signal "{missing[0]}"; expected a trial with sensors, such as '
            "`canine run three_waypoint` makes"
        )
    _require_ticks(path, log)
    taken = {name: log[signal] for name, signal in arrived(log.channels, log.metadata).items()}
    gps = [f.name for f in fields(SensorSignals) if f.name.startswith("gps_")]
    finite_fix = np.all([np.isfinite(taken[name]) for name in gps if name in taken], axis=0)
    names = {name for block in ESTIMATORS.values() for name in block.flat_names("input")}
    imu = [name for name in names if not name.startswith("gps_") and name in taken]
    finite_sample = np.all([np.isfinite(taken[name]) for name in imu], axis=0)
    fixes = taken["gps_fix"] > 0
    received = fixes & finite_fix

    def signals_without(windows: Sequence[Window]) -> SensorSignals:
        used = received.copy()
        for start, end in windows:
            used &= (log.time < start) | (log.time > end)
        latest = np.maximum.accumulate(np.where(used, np.arange(len(used)), 0))  # tick of the held fix
        columns: dict[str, Any] = {}
        for name in (f.name for f in fields(SensorSignals)):
            logged = taken.get(name, np.zeros(len(used)))
            columns[name] = logged[latest] if name.startswith("gps_") else logged
        for name in ("north", "east", "speed", "course"):
            columns[f"reference_{name}"] = log[f"sensors.gps_{name}"]
        columns |= {"t": log.time, "gps_fix": used, "reference_fix": received}
        if attitude == OWN:
            samples = np.column_stack([columns[name] for name in SAMPLES])
            of_fix = (columns[f"gps_{name}"] for name in ("speed", "course", "s_acc"))
            angles = own_attitude(samples, used.astype(np.float64), *of_fix)
            columns |= dict(zip(ANGLES, angles.T, strict=True))
        columns |= {"origin_latitude": log.origin[0], "origin_longitude": log.origin[1]}
        return SensorSignals(**columns)

    dropped = {
        "fixes with a value that is not finite": int((fixes & ~finite_fix).sum()),
        "IMU samples with a value that is not finite": int((~finite_sample).sum()),
    }
    scenario = log.metadata.get("scenario", {})
    return ReplaySource(
        f"{scenario.get('name', path.stem)}-{scenario.get('seed', '')}".strip("-"),
        signals_without,
        holes(np.array([-TICK_S, *log.time[finite_sample], len(log.time) * TICK_S]), HOLE_OF_IMU_S),
        {cause: number for cause, number in dropped.items() if number},
        attitude=attitude or RECORDED,
        broken=log.broken,
        notes=_notes_of_faults(log),
    )


def _notes_of_faults(log: Log) -> tuple[str, ...]:
    """Which faults of the trial its estimators have here too, and which they have not."""
    signals = arrived(log.channels, log.metadata)
    names = sorted(signal.removeprefix("sensors.") for signal in disturbed(log.metadata))
    within = [name for name in names if signals.get(name) == f"{READER}.{name}"]
    without = [name for name in names if name in ("gps", "imu") or signals.get(name) == f"{SENSORS}.{name}"]
    notes = []
    if within:
        notes.append(f"the trial's faults of {', '.join(within)} are in the signals, not in the reference")
    if without:
        others = f"the trial's faults of {', '.join(without)} are not in the signals"
        notes.append(f"{others}: the log does not have what arrived")
    return tuple(notes)


def _require_ticks(path: Path, log: Log) -> None:
    """The estimator steps by ticks: rows of another step or start would be taken for others."""
    for tick in np.flatnonzero(np.abs(log.time - np.arange(len(log.time)) * TICK_S) > TICK_S / 2)[:1]:
        raise RecordingError(
            f"{path}: row {tick + 1} is of {log.time[tick]:g} s, expected {tick * TICK_S:g} s: a row for "
            f"each tick of {TICK_S:g} s from 0 s on; run the trial again"
        )
