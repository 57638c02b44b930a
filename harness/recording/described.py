"""Reads what a `recording.toml` describes: which files a folder's recording has, and what is in them.

[gps]
file = "gps.csv"                  # or a .ubx or a .pos, which need no columns
rate = 4                          # Hz, if it shall be checked

[gps.columns]
time = { column = "t", unit = "s" }
latitude = { column = "lat", unit = "deg" }
longitude = { column = "lon", unit = "deg" }
speed = { column = "speed", unit = "km/h" }
course = { column = "course", unit = "deg" }
h_acc = { value = 3, unit = "m" }     # one value for all lines
s_acc = { value = 0.5, unit = "m/s" }

[imu]
file = "imu.csv"                  # or an Xsens MT's .mtb, or a .ubx with ESF messages
mounting = { roll = 180, pitch = 0, yaw = -90 }     # deg, or a matrix; see `mounting`

[imu.columns]
time = { column = 1, unit = "ms" }    # a number counts from 1
accel_x = { column = 2, unit = "g" }
...
heading = { column = 8, unit = "deg", sense = -1 }  # an attitude of its own; counter-clockwise in the file

[clock]
imu_offset = 0.0                  # s, what the time of the IMU lacks to that of the GPS
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from harness.recording import STREAMS
from harness.recording.attitude import Array
from harness.recording.mounting import fault_of_rotation, rotation, rotations
from harness.recording.recording import Index, RecordingError, as_number, read_file
from harness.toml_file import TomlError, parse_toml, read_toml
from models.errors import nearest, printable

DESCRIPTION = "recording.toml"
DEGREE = math.pi / 180
G = 9.80665  # m/s2
UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "rad": {"rad": 1, "deg": DEGREE, "1e-7 deg": 1e-7 * DEGREE, "1e-5 deg": 1e-5 * DEGREE},
    "m": {"m": 1, "cm": 1e-2, "mm": 1e-3},
    "m/s": {"m/s": 1, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1 / 3.6, "kn": 1852 / 3600},
    "m/s2": {"m/s2": 1, "g": G, "mg": 1e-3 * G},
    "rad/s": {"rad/s": 1, "deg/s": DEGREE, "mdeg/s": 1e-3 * DEGREE, "mrad/s": 1e-3},
    "": {"": 1},
}  # SI unit -> unit that a file may have -> factor
IMU_COLUMNS = {"time": "s"} | {f"accel_{a}": "m/s2" for a in "xyz"} | {f"gyro_{a}": "rad/s" for a in "xyz"}
EULER = ("roll", "pitch", "heading")  # of the body, by the IMU's own AHRS
QUATERNION = ("q_w", "q_x", "q_y", "q_z")  # turns vectors in the axes of the IMU into those of the earth
ATTITUDE_COLUMNS = dict.fromkeys(EULER, "rad") | dict.fromkeys(QUATERNION, "")
EARTHS: dict[str, list[list[float]]] = {
    "NED": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "ENU": [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
    "NWU": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
}  # axes of the earth -> north, east, down in them
GPS_COLUMNS = {
    "time": "s", "latitude": "rad", "longitude": "rad", "height": "m", "h_acc": "m", "velocity_north": "m/s",
    "velocity_east": "m/s", "speed": "m/s", "course": "rad", "s_acc": "m/s", "fix": "",
}  # fmt: skip
LARGEST_STRETCH = 0.1  # by which the length of a quaternion may differ from 1
RATE_SLACK = 0.1  # part by which the rate of a file may differ from the one stated


@dataclass(frozen=True)
class Column:
    """Where a quantity of a csv is: its column by name or number from 1, or one value for all lines."""

    column: str | int | None
    value: float
    factor: float  # to SI


@dataclass(frozen=True)
class FileDescription:
    """One file of a recording.

    Attributes:
        rate: Hz as stated; None if it is not.
        fixes: values of the column `fix` that make a fix.
        earth: (3, 3) turns vectors in the axes of the earth that a quaternion has into north, east, down.
    """

    path: Path
    columns: Mapping[str, Column]
    separator: str = ","
    rate: float | None = None
    fixes: tuple[float, ...] = ()
    earth: Array | None = None


@dataclass(frozen=True)
class Description:
    """A recording as its recording.toml describes it."""

    gps: FileDescription
    imu: FileDescription
    mounting: Array  # (3, 3) from the axes of the IMU to forward, right, down
    imu_offset: float | None  # s


def read_description(path: Path) -> Description:
    """Read a recording.toml.

    Raises:
        RecordingError: it cannot be read, or has an unknown key, a wrong value, or too few of them.
    """
    try:
        table = parse_toml(read_toml(path))
    except TomlError as reason:
        raise RecordingError(f"{path}: {reason}") from None
    except OSError as reason:
        raise RecordingError(f"{path}: cannot be read ({reason.strerror or reason})") from None
    _known(path, "", table, ("gps", "imu", "clock"))
    gps, imu = (_table(path, name, table.get(name)) for name in ("gps", "imu"))
    clock = _table(path, "clock", table.get("clock", {}))
    _known(path, "clock.", clock, ("imu_offset",))
    _known(path, "gps.", gps, ("file", "rate", "separator", "columns", "fixes"))
    _known(path, "imu.", imu, ("file", "rate", "separator", "columns", "mounting", "earth"))
    offset = _number(path, "clock.imu_offset", clock["imu_offset"]) if "imu_offset" in clock else None
    return Description(
        gps=_file(path, "gps", gps, GPS_COLUMNS),
        imu=_file(path, "imu", imu, IMU_COLUMNS | ATTITUDE_COLUMNS),
        mounting=_mounting(path, imu.get("mounting")),
        imu_offset=offset,
    )


def _file(path: Path, part: str, table: Mapping[str, Any], quantities: Mapping[str, str]) -> FileDescription:
    name = table.get("file")
    if not isinstance(name, str) or not name or "\0" in name:
        raise RecordingError(
            f'{path}: {part}.file is {name!r}, expected the name of a file, as in "{part}.csv"'
        )
    file = path.parent / name
    if not file.is_file():
        raise RecordingError(f"{path}: {part}.file is {name!r}, but {file} is not there")
    written = _table(path, f"{part}.columns", table.get("columns", {}))
    _known(path, f"{part}.columns.", written, quantities)
    columns = {
        quantity: _column(path, f"{part}.columns.{quantity}", column, quantities[quantity])
        for quantity, column in written.items()
    }
    separator = table.get("separator", ",")
    if not isinstance(separator, str) or len(separator) != 1:
        raise RecordingError(f'{path}: {part}.separator is {separator!r}, expected one character, as in ";"')
    rate = None
    if "rate" in table:
        rate = _number(path, f"{part}.rate", table["rate"])
        if not 0 < rate <= 100_000:
            raise RecordingError(f"{path}: {part}.rate is {rate:g} Hz, expected above 0 and at most 100000")
    values = table.get("fixes", [])
    if not isinstance(values, list):
        raise RecordingError(
            f"{path}: {part}.fixes is {values!r}, expected the values of a fix, as in [3, 4]"
        )
    fixes = tuple(_number(path, f"{part}.fixes", value) for value in values)
    if bool(fixes) != ("fix" in columns) and part == "gps":
        raise RecordingError(f"{path}: expected gps.fixes and gps.columns.fix together, got one of both")
    places = [column.column for column in columns.values() if column.column is not None]
    for quantity, column in columns.items():
        if column.column is not None and places.count(column.column) > 1:
            raise RecordingError(
                f"{path}: {part}.columns.{quantity} is column {column.column!r}, as another is; "
                "expected a column for each"
            )
    _require_columns(path, part, file, columns, rate)
    return FileDescription(file, columns, separator, rate, fixes, _earth(path, table.get("earth"), columns))


def _earth(path: Path, written: Any, columns: Collection[str]) -> Array | None:
    if (written is None) == any(name in columns for name in QUATERNION) or (
        written is not None and written not in EARTHS
    ):
        raise RecordingError(
            f"{path}: imu.earth is {written!r}, expected one of {', '.join(EARTHS)} with a quaternion in "
            "imu.columns, and nothing without"
        )
    return None if written is None else np.array(EARTHS[written], dtype=np.float64)


def _require_columns(
    path: Path, part: str, file: Path, columns: Mapping[str, Column], rate: float | None
) -> None:
    """A csv needs its columns, and other files have none to name."""
    if file.suffix.lower() in (*STREAMS, ".pos", ".mtb"):
        if columns:
            raise RecordingError(f"{path}: {part}.columns are for a csv, but {part}.file is {file.name}")
        return
    if part == "imu":
        needed = [name for name in IMU_COLUMNS if name != "time" or rate is None]
        for group in (EULER, QUATERNION):
            needed += [name for name in group if any(other in columns for other in group)]
    else:
        needed = ["time", "latitude", "longitude", "h_acc"]
        if "velocity_north" in columns or "velocity_east" in columns:
            needed += ["velocity_north", "velocity_east", "s_acc"]
        elif "speed" in columns or "course" in columns:
            needed += ["speed", "course", "s_acc"]
    missing = [name for name in needed if name not in columns]
    if missing:
        unit = (IMU_COLUMNS | ATTITUDE_COLUMNS | GPS_COLUMNS)[missing[0]]
        instead = " (or imu.rate in Hz)" if "time" in missing and part == "imu" else ""
        raise RecordingError(
            f"{path}: {part}.columns.{missing[0]}{instead} is missing; say where it is, as in "
            f'{missing[0]} = {{ column = 1, unit = "{unit}" }}'
        )


def _column(path: Path, where: str, written: Any, si: str) -> Column:
    table = _table(path, where, written)
    turns = where.rpartition(".")[2] in ATTITUDE_COLUMNS
    _known(path, f"{where}.", table, ("column", "value", "unit", *(["sense"] if turns else [])))
    sense = table.get("sense", 1)
    if sense not in (1, -1) or isinstance(sense, bool):
        raise RecordingError(f"{path}: {where}.sense is {sense!r}, expected 1, or -1 for the reverse")
    unit = table.get("unit", "" if si == "" else None)
    if unit not in UNITS[si]:
        raise RecordingError(f"{path}: {where}.unit is {unit!r}, expected one of {', '.join(UNITS[si])}")
    column, value = table.get("column"), table.get("value")
    if (column is None) == (value is None):
        raise RecordingError(f"{path}: {where} expected either a column or one value for all lines")
    if value is not None:
        number = _number(path, f"{where}.value", value)
        if where.endswith("_acc") and number <= 0:
            raise RecordingError(f"{path}: {where}.value is {number:g}, expected an accuracy above 0")
        return Column(None, number, sense * UNITS[si][unit])
    if (
        isinstance(column, bool)
        or not isinstance(column, (str, int))
        or (isinstance(column, int) and column < 1)
    ):
        raise RecordingError(f"{path}: {where}.column is {column!r}, expected its name or its number from 1")
    return Column(column, math.nan, sense * UNITS[si][unit])


def _mounting(path: Path, written: Any) -> Array:
    if isinstance(written, Mapping):
        _known(path, "imu.mounting.", written, ("roll", "pitch", "yaw"))
        angles = {name: _number(path, f"imu.mounting.{name}", angle) for name, angle in written.items()}
        if len(angles) == 3:
            return rotation(angles["roll"], angles["pitch"], angles["yaw"])
    if isinstance(written, list) and [len(row) if isinstance(row, list) else 0 for row in written] == [
        3,
        3,
        3,
    ]:
        matrix = [[_number(path, "imu.mounting", value) for value in row] for row in written]
        fault = fault_of_rotation(matrix)
        if not fault:
            return np.array(matrix)
        raise RecordingError(
            f"{path}: imu.mounting is no rotation, {fault}; expected the rows forward, right, down"
        )
    got = "missing" if written is None else str(written)[:60]
    raise RecordingError(
        f"{path}: imu.mounting is {got}, expected how the IMU sits in the body: "
        f"{{ roll = 0, pitch = 0, yaw = 0 }} in deg or a matrix of three rows"
    )


def read_columns(file: FileDescription) -> tuple[dict[str, Array], Index, Counter[str]]:
    """The columns of a csv in SI, (n,) each; the position behind each line; lines dropped, by cause.

    Lines that begin with # or % are comments, and the first line may be a header. Without a column
    for it, the time of the first line is 0, and that of the others follows from the rate stated.

    Raises:
        RecordingError: a column that was named is not in the header, or no line has numbers.
    """
    lines = read_file(file.path).split(b"\n")
    ends = np.cumsum([len(line) + 1 for line in lines])
    separator = file.separator.encode()
    content = [
        (number, [field.strip() for field in line.split(separator)])
        for number, line in enumerate(lines)
        if line.strip() and line.lstrip()[:1] not in (b"#", b"%")
    ]
    names = [name.decode("utf-8", "replace").strip('"\ufeff') for name in content[0][1]] if content else []
    places = {
        quantity: _place(file, quantity, column, names)
        for quantity, column in file.columns.items()
        if column.column is not None
    }
    dropped: Counter[str] = Counter()
    rows, kept, indices = [], [], []
    for index, (number, fields) in enumerate(content):
        try:
            row = [as_number(fields[place]) for place in places.values()]
        except (ValueError, IndexError):
            row = [math.nan]
        if all(map(math.isfinite, row)):
            rows.append(row)
            kept.append(int(ends[number]))
            indices.append(index)
        else:
            dropped["lines without their numbers"] += index > 0
    if not rows:
        raise RecordingError(
            f"{file.path}: got {len(lines)} lines, none with numbers in the columns that {DESCRIPTION} names"
        )
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(places))
    values = {name: table[:, i] * file.columns[name].factor for i, name in enumerate(places)}
    for quantity, column in file.columns.items():
        if column.column is None:
            values[quantity] = np.full(len(rows), column.value * column.factor)
    if "time" not in values and file.rate:
        lines_before = np.array(indices) - min(indices[0], 1)  # with those that are dropped, without a header
        values["time"] = lines_before / file.rate
    return values, np.array(kept, dtype=np.int64), dropped


def recorded_attitude(file: FileDescription, values: Mapping[str, Array], mounting: Array) -> Array | None:
    """The attitudes (n, 3, 3) in a csv: from the axes of the IMU to north, east, down. None without one.

    Angles are of the body, in which the IMU has a mounting (3, 3); a quaternion is of the IMU. One that is
    far from a length of 1 is no attitude: NaN.
    """
    if EULER[0] in values:
        return rotations(*(values[name] for name in EULER)) @ mounting
    if QUATERNION[0] not in values:
        return None
    assert file.earth is not None
    quaternion = np.column_stack([values[name] for name in (*QUATERNION[1:], QUATERNION[0])])
    length = np.linalg.norm(quaternion, axis=1)
    wrong = ~(np.abs(length - 1) < LARGEST_STRETCH)
    quaternion[wrong] = [0.0, 0.0, 0.0, 1.0]
    attitude = file.earth @ Rotation.from_quat(quaternion).as_matrix()
    attitude[wrong] = np.nan
    return np.asarray(attitude, dtype=np.float64)


def _place(file: FileDescription, quantity: str, column: Column, names: list[str]) -> int:
    if isinstance(column.column, int):
        return column.column - 1
    if column.column not in names:
        raise RecordingError(
            f'{file.path}: got no column "{column.column}" for {quantity} in the first line'
            f"{nearest(str(column.column), [name for name in names if re.search('[A-Za-z]', name)])}"
        )
    if names.count(column.column) > 1:
        raise RecordingError(
            f'{file.path}: {names.count(column.column)} columns are called "{column.column}"; '
            f"give that of {quantity} by its number"
        )
    return names.index(column.column)


def require_rate(file: FileDescription, clock: Array) -> None:
    """The rate of a file is the one stated.

    Raises:
        RecordingError: it is not.
    """
    if file.rate is None or len(clock) < 2:
        return
    step = float(np.median(np.diff(clock)))
    rate = 1 / step if step > 0 else 0.0
    if abs(rate / file.rate - 1) > RATE_SLACK:
        raise RecordingError(
            f"{file.path}: its clock runs at {rate:.4g} lines a second, {DESCRIPTION} says {file.rate:g} Hz; "
            "is the unit of time right?"
        )


def _table(path: Path, where: str, written: Any) -> Mapping[str, Any]:
    if not isinstance(written, dict):
        got = "missing" if written is None else repr(written)[:40]
        raise RecordingError(f"{path}: [{where}] is {got}, expected a table")
    return written


def _known(path: Path, where: str, table: Mapping[str, Any], known: Collection[str]) -> None:
    for key in table:
        if key not in known:
            raise RecordingError(f"{path}: unknown key {where}{printable(key)}{nearest(key, known)}")


def _number(path: Path, where: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e300:
        raise RecordingError(f"{path}: {where} is {str(value)[:40]}, expected a number")
    return float(value)
