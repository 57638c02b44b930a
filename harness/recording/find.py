"""Finds what a recording consists of: the file of its fixes, that of its samples, and what ties their clocks.

A path is a u-blox stream with ESF messages in it, or a folder. A folder has a `recording.toml`, or one file
for the GPS (`*.ubx`, else `*.pos`) and one for the IMU (`imu*.csv`, or `*.mtb`, an Xsens MT's stream, or
none: the ESF messages in the `.ubx`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from harness.recording import STREAMS, esf, tags
from harness.recording.agreement import gravity
from harness.recording.attitude import Array
from harness.recording.described import (
    DESCRIPTION,
    FileDescription,
    read_columns,
    read_description,
    recorded_attitude,
    require_rate,
)  # fmt: skip
from harness.recording.doubts import doubts
from harness.recording.imu_csv import read_imu_csv
from harness.recording.mounting import rotation
from harness.recording.pos import read_pos
from harness.recording.recording import WEEK_S, FixStream, Recording, RecordingError, SampleStream, join
from harness.recording.ubx import SYNC, read_ubx
from harness.recording.velocity import with_differences
from harness.recording.xsens import read_xsens, timed_by_arrival

LOOK = 1 << 16  # bytes of a file in which a UBX frame must begin
XSENS = ".mtb"
Z_UP = rotation(180, 0, 0)  # forward, left, up
BY_ORDER = "order of the messages in the stream"
RIG = rotation(180, 0, -90)  # of the rig whose folders have `imu*.csv` and time tags


@dataclass(frozen=True)
class Tie:
    """What the samples' clock lacks to GPS time of week [s], and how that is known.

    The streams are without what the tie shows to be wrong, and the clock of the samples is in s.
    """

    fixes: FixStream
    samples: SampleStream
    offset: float
    source: str


@dataclass(frozen=True)
class Parts:
    """What a recording consists of; a part that could not be read is the reason why.

    Attributes:
        name: of the recording.
        mounting: (3, 3) from the axes of the IMU to forward, right, down.
        mounting_source: where the mounting comes from.
        tie: finds the offset of the clocks.
        messages: how many of which message a u-blox stream has.
    """

    name: str
    fixes: FixStream | RecordingError
    samples: SampleStream | RecordingError
    mounting: Array
    mounting_source: str
    tie: Callable[[FixStream, SampleStream], Tie]
    messages: Mapping[str, int] = field(default_factory=dict)

    def streams(self) -> tuple[FixStream, SampleStream]:
        """Both streams.

        Raises:
            RecordingError: one of them could not be read.
        """
        if isinstance(self.fixes, RecordingError):
            raise self.fixes
        if isinstance(self.samples, RecordingError):
            raise self.samples
        return self.fixes, self.samples

    def tied(self) -> Tie:
        """What ties the clocks of both streams.

        Raises:
            RecordingError: one of them could not be read, or nothing ties them.
        """
        return self.tie(*self.streams())

    def join(self) -> Recording:
        """Put both sensors on one clock.

        Raises:
            RecordingError: a part could not be read, or they do not fit each other.
        """
        tied = self.tied()
        joined = join(self.name, tied.fixes, tied.samples, tied.offset, self.mounting)
        tilted = gravity(tied.samples.specific_force, self.mounting).warning
        order = f"clocks are tied by the {tied.source}" if tied.source.startswith(BY_ORDER) else ""
        doubtful = [doubt for doubt in (tilted, *doubts(joined)) if doubt]
        return replace(joined, notes=(order,) if order else (), doubts=tuple(doubtful))


def find_parts(path: Path) -> Parts:
    """Read the parts of a recording.

    Raises:
        RecordingError: the path holds no recording of a known kind.
    """
    if path.is_file() and path.suffix.lower() in STREAMS:
        return _stream(path)
    if not path.exists():
        raise RecordingError(f"{path}: no such folder; expected the folder of a recording")
    if not path.is_dir():
        raise RecordingError(
            f"{path}: expected the folder of a recording, or a u-blox stream ({', '.join(STREAMS)})"
        )
    if (path / DESCRIPTION).is_file():
        return _described(path)
    gps = _only(path, "*.ubx") or _only(path, "*.pos")
    imu = _only(path, "imu*.csv") or _only(path, f"*{XSENS}")
    if gps and not imu and gps.suffix == ".ubx":
        return replace(_stream(gps), name=path.resolve().name)
    if not gps or not imu:
        raise RecordingError(
            f"{path}: got none for {'imu*.csv' if gps else '*.ubx'}, expected one file: a *.ubx or *.pos "
            f"with an imu*.csv or *{XSENS} and their time tags, a *.ubx with ESF messages, or a "
            f"{DESCRIPTION} that says what is there"
        )
    if imu.suffix == XSENS:
        samples = _part(lambda: _timed_by_tag(imu))
        mounting, source = Z_UP, "forward, left, up, as an MT leaves the factory"
    else:
        samples = _part(lambda: read_imu_csv(imu))
        mounting, source = RIG, "roll 180, pitch 0, yaw -90 deg, of the rig that writes such folders"
    return Parts(
        name=path.resolve().name,
        fixes=_part(lambda: _read_fixes(gps)),
        samples=samples,
        mounting=mounting,
        mounting_source=source,
        tie=lambda fixes, samples: _tie_by_tags(gps, fixes, imu, samples),
        messages=esf.message_counts(gps) if gps.suffix == ".ubx" else {},
    )


def recordings_below(path: Path) -> list[Path]:
    """The recording at a path, or those below a folder that is none: folders, and u-blox streams.

    Raises:
        RecordingError: there is none.
    """
    if not path.is_dir() or _is_recording(path):
        return [path]
    recordings: list[Path] = []
    for folder, inner, files in os.walk(path):  # it passes over what vanishes meanwhile, or is another user's
        inner.sort()
        here = [Path(folder, name) for name in inner]
        one = [place for place in here if _is_recording(place)]
        inner[:] = [place.name for place in here if place not in one]
        recordings += [*one, *(place for name in files if _is_stream(place := Path(folder, name)))]
    recordings.sort()
    if not recordings:
        logs = sorted(path.glob("*.mcap"))
        hint = f'; did you mean the log "{logs[0]}"?' if logs else ""
        raise RecordingError(
            f"{path}: got no recording, here or below; expected folders with *.ubx, *.pos or "
            f"{DESCRIPTION}, or u-blox streams ({', '.join(STREAMS)}){hint}"
        )
    return recordings


def _is_recording(folder: Path) -> bool:
    """Is a folder one recording? Several streams in it are several."""
    gps = [*folder.glob("*.ubx")] or [*folder.glob("*.pos")]
    imu = [*folder.glob("imu*.csv"), *folder.glob(f"*{XSENS}")]
    return (folder / DESCRIPTION).is_file() or bool(imu) or len(gps) == 1


def _is_stream(path: Path) -> bool:
    if path.suffix.lower() not in STREAMS or not path.is_file():
        return False
    try:
        with path.open("rb") as stream:
            return SYNC in stream.read(LOOK)
    except OSError:
        return False


def name_below(path: Path, recording: Path) -> str:
    """The name of a recording below a folder: where it lies there."""
    return "-".join(recording.relative_to(path).with_suffix("").parts) or path.resolve().name


def _stream(path: Path) -> Parts:
    """A u-blox stream with the receiver's own IMU in it."""
    return Parts(
        name=path.stem,
        fixes=_part(lambda: read_ubx(path)),
        samples=_part(lambda: esf.read_esf(path)),
        mounting=Z_UP,
        mounting_source="forward, left, up, as u-blox draws it; a recording.toml states another",
        tie=_tie_by_order,
        messages=esf.message_counts(path),
    )


def _timed_by_tag(path: Path) -> SampleStream:
    samples = read_xsens(path, rate_hz=1.0)
    return timed_by_arrival(samples, tags.arrival(path, samples.ends))


def _tie_by_tags(gps: Path, fixes: FixStream, imu: Path, samples: SampleStream) -> Tie:
    """By the tag of the IMU's file. That of a receiver's stream shows late fixes; a solution has none."""
    if gps.suffix.lower() in STREAMS:
        fixes = tags.timely_fixes(gps, fixes)
    samples, offset = tags.timed_samples(imu, samples)
    return Tie(fixes, samples, offset, f"time tag {tags.tag_of(imu).name}")


def _tie_by_order(fixes: FixStream, samples: SampleStream) -> Tie:
    tied, offset, known_to = esf.tie(fixes, samples)
    return Tie(fixes, tied, offset, f"{BY_ORDER}, to {known_to:.2f} s")


def _described(folder: Path) -> Parts:
    description = read_description(folder / DESCRIPTION)
    gps, imu = description.gps, description.imu
    offset = description.imu_offset
    of_receiver = imu.path.suffix.lower() in STREAMS

    def tie(fixes: FixStream, samples: SampleStream) -> Tie:
        if of_receiver:
            tied = _tie_by_order(fixes, samples)
            return tied if offset is None else replace(tied, offset=tied.offset + offset)
        if offset is not None:
            return Tie(fixes, samples, offset, f"clock.imu_offset in {DESCRIPTION}")
        tag = tags.tag_of(imu.path)
        if not tag.is_file():
            raise RecordingError(
                f"{folder / DESCRIPTION}: nothing ties the clocks; give clock.imu_offset in s (0 where both "
                f"files have one clock), or put the time tag {tag.name} beside {imu.path.name}"
            )
        return _tie_by_tags(gps.path, fixes, imu.path, samples)

    return Parts(
        name=folder.resolve().name,
        fixes=_part(lambda: _described_fixes(gps)),
        samples=_part(lambda: _described_samples(imu, description.mounting)),
        mounting=description.mounting,
        mounting_source=f"imu.mounting in {DESCRIPTION}",
        tie=tie,
        messages=esf.message_counts(gps.path) if gps.path.suffix.lower() in STREAMS else {},
    )


def _described_fixes(file: FileDescription) -> FixStream:
    if not file.columns:
        fixes = _read_fixes(file.path)
        require_rate(file, fixes.rows[:, 0])
        return fixes
    values, ends, dropped = read_columns(file)
    kinds: dict[str, int] = {}
    keep = np.ones(len(ends), dtype=np.bool_)
    if file.fixes:
        keep = np.isin(values["fix"], file.fixes)
        dropped["lines that are no fix"] += int((~keep).sum())
        kinds = {f"fix = {value:g}": int((values["fix"] == value).sum()) for value in file.fixes}
    zeros = np.zeros(len(ends))
    if "speed" in values:
        values["velocity_north"] = values["speed"] * np.cos(values["course"])
        values["velocity_east"] = values["speed"] * np.sin(values["course"])
    names = (
        "time", "latitude", "longitude", "height", "velocity_north", "velocity_east", "h_acc", "s_acc",
    )  # fmt: skip
    table = np.column_stack([values.get(name, zeros) for name in names])[keep]
    table[:, 0] %= WEEK_S
    require_rate(file, table[:, 0])
    if "velocity_north" not in values:
        table, slow = with_differences(table)
        dropped["fixes without one before them to take a velocity from"] += slow
    if not len(table):
        raise RecordingError(f"{file.path}: got no fix in {len(ends)} lines; are gps.fixes the right values?")
    return FixStream(file.path.name, table, np.arange(len(table)), dropped, kinds or {"lines": len(table)})


def _described_samples(file: FileDescription, mounting: Array) -> SampleStream:
    suffix = file.path.suffix.lower()
    if suffix in STREAMS:
        return esf.read_esf(file.path)
    if suffix == XSENS:
        if file.rate is None:
            raise RecordingError(f"{file.path}: imu.rate is missing; at which rate [Hz] does the MT sample?")
        return read_xsens(file.path, file.rate)
    values, ends, dropped = read_columns(file)
    require_rate(file, values["time"])
    force, rate = (
        np.column_stack([values[f"{name}_{axis}"] for axis in "xyz"]) for name in ("accel", "gyro")
    )
    attitude = recorded_attitude(file, values, mounting)
    return SampleStream(file.path.name, values["time"], force, rate, ends, dropped, attitude=attitude)


def _read_fixes(path: Path) -> FixStream:
    return read_pos(path) if path.suffix.lower() == ".pos" else read_ubx(path)


Stream = TypeVar("Stream", FixStream, SampleStream)


def _part(read: Callable[[], Stream]) -> Stream | RecordingError:
    """What a reader gives, or why it gives nothing."""
    try:
        return read()
    except RecordingError as reason:
        return reason
    except OSError as reason:
        return RecordingError(f"{reason.filename}: {reason.strerror or reason}")


def _only(folder: Path, pattern: str) -> Path | None:
    paths = sorted(path for path in folder.glob(pattern) if path.is_file())
    if len(paths) > 1:
        raise RecordingError(
            f"{folder}: got {', '.join(path.name for path in paths)} for {pattern}, expected one file; keep "
            "one recording in each folder"
        )
    if paths and not paths[0].stat().st_size:
        raise RecordingError(f"{paths[0]}: got an empty file, expected a recording; copy it again")
    return paths[0] if paths else None
