"""A log as files that other tools read: for each component a CSV or a Parquet file, and units.json.

The first column is `time` in s; the others are the component's signals, inputs then outputs. A signal `time`
of the component's own is in the column `<component>.time`, as in `telemetry.time`. units.json has unit, type
and meaning of each signal by component; in Parquet the metadata of each column has them too.

CSV: one header line; reals with the fewest digits that read back to the same bits; Booleans as 0 and 1; NaN,
Infinity and -Infinity by these names. Parquet: float64 (NaN stays NaN, nothing is null), int64 and bool. As
in `Log.arrays`, an Integer or Boolean column stays float64 if a value is not finite or too large for int64.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import numpy.typing as npt

from harness.files import write_set
from harness.log.channel import Channel
from harness.log.log import Log
from models.errors import UsageError, nearest

TIME = {"unit": "s", "type": "Real", "meaning": "time of the tick"}
UNITS = "units.json"
Columns = list[tuple[str, npt.NDArray[Any]]]


def export(log: Log, to: str, out: Path) -> list[Path]:
    """Write a file for each component, and units.json; their paths.

    Each file is written whole or not at all, and none before the contents of all are made. Those of another
    log that was exported there are removed; the other format stays if units.json is the same.

    Args:
        to: `csv` or `parquet`.
        out: the folder, made if need be.

    Raises:
        UsageError: the format is unknown, its library is not installed, or the folder cannot be made.
        FileError: a file cannot be written.
    """
    if to not in FORMATS:
        raise UsageError(f"--to {to}: expected one of {', '.join(FORMATS)}{nearest(to, FORMATS)}")
    arrays = log.arrays()
    contents: dict[str, bytes] = {}
    for channel in log.channels:
        signals = arrays[channel.component].items()
        columns = [("time", log.time), *((_column(channel, name), values) for name, values in signals)]
        contents[_file(channel.component, to)] = FORMATS[to](channel, columns)
    units = {channel.component: _signals(channel) for channel in log.channels}
    contents[UNITS] = (json.dumps(units, indent=2, ensure_ascii=False) + "\n").encode()
    write_set(out, contents, _earlier(out, to, units))
    return [out / name for name in contents]


def _file(component: str, to: str) -> str:
    """A component's file; a foreign package may call a component anything, "a/b" too."""
    return f"{quote(component, safe=' ')}.{to}"


def _earlier(out: Path, to: str, units: Mapping[str, Any]) -> list[str]:
    """The files of an earlier export to a folder, by its units.json, which are not to stay beside these."""
    try:
        held = json.loads((out / UNITS).read_text())
    except (OSError, ValueError, RecursionError):
        return []
    formats = [to] if held == units else FORMATS
    return [_file(component, of) for component in held for of in formats] if isinstance(held, dict) else []


def _column(channel: Channel, name: str) -> str:
    """A signal's column; `time` is taken by that of the ticks."""
    return f"{channel.component}.{name}" if name == "time" else name


def _signals(channel: Channel) -> dict[str, dict[str, str]]:
    """Unit, type and meaning of each signal."""
    return {
        _column(channel, name): {"unit": unit, "type": kind, "meaning": meaning}
        for name, unit, kind, meaning in zip(
            channel.names, channel.units, channel.types, channel.meanings, strict=True
        )
    }


def _csv(channel: Channel, columns: Columns) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([name for name, _ in columns])
    writer.writerows(zip(*(_cells(values) for _, values in columns), strict=True))
    return text.getvalue().encode()


def _cells(values: npt.NDArray[Any]) -> list[Any]:
    """A column as the CSV writer spells it."""
    if values.dtype == np.bool_:
        return list(values.astype(np.int64).tolist())
    cells: list[Any] = values.tolist()
    for i in np.flatnonzero(~np.isfinite(values)):
        cells[i] = "NaN" if np.isnan(values[i]) else "Infinity" if values[i] > 0 else "-Infinity"
    return cells


def _parquet(channel: Channel, columns: Columns) -> bytes:
    try:
        import pyarrow  # noqa: PLC0415 - an optional extra
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError:
        raise UsageError(
            "--to parquet needs pyarrow, which is not installed; "
            'pip install "guided-canine[parquet]", or take --to csv'
        ) from None
    signals = [TIME, *_signals(channel).values()]
    arrays = [pyarrow.array(values) for _, values in columns]
    fields = [
        pyarrow.field(name, array.type, nullable=False, metadata=about)
        for (name, _), array, about in zip(columns, arrays, signals, strict=True)
    ]
    sink = io.BytesIO()
    parquet.write_table(pyarrow.Table.from_arrays(arrays, schema=pyarrow.schema(fields)), sink)
    return sink.getvalue()


FORMATS: dict[str, Callable[[Channel, Columns], bytes]] = {"csv": _csv, "parquet": _parquet}
