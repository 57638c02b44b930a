"""Two logs compared: the first difference, then signals, rows and metadata that differ.

Rows are compared where both logs have a tick of the same time, signals by component and name. Without a
tolerance two values agree if they have the same bits: 0.0 is not -0.0, and NaN is NaN (a log has only one).
With a tolerance they agree if they differ by no more, or are the same infinity or both NaN.

A difference is in the signal's unit, as in the log (angles in rad). An angle, a signal in rad or deg, differs
by the shorter way round: pi and -pi by nothing. One whose name ends in `_sd` is a deviation, a number as any
other. Bits know no angles.

A log of a run that did not come to its end is compared as far as it goes: what another log has after that
does not count.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from harness.files import changes
from harness.log.channel import Array
from harness.log.log import Log
from harness.toml_file import TomlError, parse_toml
from models.errors import UsageError, nearest

TURN = {"rad": 2 * math.pi, "deg": 360.0}  # a whole one, by unit
Value = float | int | bool | str  # a signal's; NaN and infinities are texts, as in a log


@dataclass(frozen=True)
class Tolerances:
    """How far values may differ.

    Attributes:
        overall: for all signals without one of their own; None compares bits.
        own: by signal `component.name`, or by component for all of its signals.

    Raises:
        UsageError: one is not a number from 0 on.
    """

    overall: float | None = None
    own: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in {"": self.overall, **self.own}.items():
            if value is not None and not (isinstance(value, Real) and value >= 0):
                raise UsageError(
                    f"--tolerance {name}{'=' * bool(name)}{value}: expected a number from 0 on, "
                    "as in 1e-9 or estimator.north=0.01"
                )

    @classmethod
    def parse(cls, texts: Sequence[str]) -> Tolerances:
        """From `1e-9` for all, and `estimator.north=0.01` or `estimator=0.01`.

        Raises:
            UsageError: one is not a number from 0 on, or is given twice.
        """
        values: dict[str, Any] = {}
        for text in texts:
            name, _, number = text.rpartition("=")
            if name in values:
                raise UsageError(f"--tolerance {text}: {name or 'one for all signals'} is given already")
            values[name] = number
            with suppress(ValueError):
                values[name] = float(number)
        return cls(values.pop("", None), values)

    def of(self, component: str, name: str) -> float | None:
        """The tolerance of a signal."""
        return self.own.get(f"{component}.{name}", self.own.get(component, self.overall))


@dataclass(frozen=True)
class SignalDifference:
    """How a signal differs.

    Attributes:
        tolerance: that held; None for bits.
        rows: in which it differs.
        not_finite: of them, those in which a value is NaN or infinite.
        max: the largest absolute difference, of those in which both are finite; None if there are none.
        tick, time_s: of that row, or of the first that differs if there is none; the tick is that of A.
        mean: absolute difference, over all rows in which both are finite; None if there are none.
    """

    signal: str
    unit: str
    tolerance: float | None
    rows: int
    not_finite: int
    max: float | None
    tick: int
    time_s: float
    mean: float | None


@dataclass(frozen=True)
class FirstDifference:
    """The first value that differs, at a tick of A, and how many signals differ on that tick."""

    signal: str
    unit: str
    tick: int
    time_s: float
    a: Value
    b: Value
    signals: int = 1


@dataclass(frozen=True)
class RowsOfOne:
    """Rows that only one log has, and the first and last time [s] of them."""

    rows: int
    from_s: float
    to_s: float


@dataclass(frozen=True)
class Statement:
    """What the logs state differently; None where one does not state it."""

    name: str
    a: Any
    b: Any


@dataclass(frozen=True)
class LogComparison:
    """How two logs, A and B, differ.

    Attributes:
        a, b: their paths.
        rows: compared.
        signals_compared: in both.
        until_s: time of the last row that was compared; None if there is none.
        broken: by log, why its run is not whole; "" if it is.
        first: the first difference of values.
        signals: those that differ, in the order of the log.
        rows_of_one, signals_of_one: by log, what only that one has.
        statements: units and types, scenario, parameters, versions and attachments that differ.
        values_only: do statements count?
    """

    a: str
    b: str
    rows: int
    signals_compared: int
    until_s: float | None
    broken: Mapping[str, str]
    first: FirstDifference | None
    signals: Sequence[SignalDifference]
    rows_of_one: Mapping[str, RowsOfOne | None]
    signals_of_one: Mapping[str, Sequence[str]]
    statements: Sequence[Statement]
    values_only: bool = False

    @property
    def agree(self) -> bool:
        """Do the logs agree?"""
        return not (
            self.signals
            or any(self.rows_of_one.values())
            or any(self.signals_of_one.values())
            or (self.statements and not self.values_only)
        )

    def facts(self) -> dict[str, Any]:
        """For JSON."""
        facts: dict[str, Any] = _plain({"agree": self.agree} | asdict(self))
        return facts


def compare(
    a: Log, b: Log, tolerances: Tolerances | None = None, *, values_only: bool = False
) -> LogComparison:
    """How two logs differ.

    Args:
        tolerances: by default values must have the same bits.
        values_only: metadata, units, types and attachments that differ are told, and do not count.

    Raises:
        UsageError: a tolerance is for a signal that neither log has.
    """
    in_a, in_b = _signals(a), _signals(b)
    tolerances = tolerances or Tolerances()
    _require_known(tolerances, {**in_a, **in_b})
    _, rows_a, rows_b = np.intersect1d(a.time, b.time, assume_unique=True, return_indices=True)
    differences, firsts = [], []
    common = [key for key in in_a if key in in_b]
    for key in common:
        signal, of_a, of_b = in_a[key], in_a[key].values[rows_a], in_b[key].values[rows_b]
        tolerance = tolerances.of(*key)
        errors = _errors(of_a, of_b, signal.turn)
        differs = _differing(of_a, of_b, errors, tolerance)
        if differs.any():
            finite = np.isfinite(of_a) & np.isfinite(of_b)
            row, worst = int(np.argmax(differs)), _worst(errors, differs, finite)
            tick, of_worst = int(rows_a[row]), int(rows_a[worst])
            shown = signal.value(of_a[row]), signal.value(of_b[row])
            firsts.append(FirstDifference(signal.name, signal.unit, tick, float(a.time[tick]), *shown))
            differences.append(
                SignalDifference(
                    signal.name,
                    signal.unit,
                    tolerance,
                    rows=int(differs.sum()),
                    not_finite=int((differs & ~finite).sum()),
                    max=float(errors[worst]) if finite[worst] else None,
                    tick=of_worst,
                    time_s=float(a.time[of_worst]),
                    mean=float(errors[finite].mean()) if finite.any() else None,
                )
            )
    first = min(firsts, key=lambda difference: difference.tick, default=None)
    if first is not None:
        first = replace(first, signals=sum(other.tick == first.tick for other in firsts))
    return LogComparison(
        a=str(a.path),
        b=str(b.path),
        rows=len(rows_a),
        signals_compared=len(common),
        until_s=float(a.time[rows_a[-1]]) if len(rows_a) else None,
        broken={"a": a.broken, "b": b.broken},
        first=first,
        signals=differences,
        rows_of_one={"a": _rows_of_one(a, b), "b": _rows_of_one(b, a)},
        signals_of_one={
            "a": [signal.name for key, signal in in_a.items() if key not in in_b],
            "b": [signal.name for key, signal in in_b.items() if key not in in_a],
        },
        statements=[*_declarations(in_a, in_b), *_statements(a, b)],
        values_only=values_only,
    )


@dataclass(frozen=True)
class _Signal:
    """A signal of a log, its values (ticks,)."""

    name: str
    unit: str
    type: str
    values: Array

    @property
    def turn(self) -> float | None:
        """A whole turn, if the signal is an angle."""
        return None if self.name.endswith("_sd") else TURN.get(self.unit)

    def value(self, number: float) -> Value:
        """A value as its type has it."""
        if not math.isfinite(number):
            return _NOT_FINITE[str(number)]
        value: Value = {"Boolean": bool, "Integer": int}.get(self.type, float)(number)
        return value


_NOT_FINITE = {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}


def _signals(log: Log) -> dict[tuple[str, str], _Signal]:
    """The signals of a log, by component and name."""
    return {
        (channel.component, name): _Signal(
            f"{channel.component}.{name}", unit, kind, np.ascontiguousarray(values)
        )
        for channel in log.channels
        for name, unit, kind, values in zip(
            channel.names, channel.units, channel.types, log.values[channel.component].T, strict=True
        )
    }


def _require_known(tolerances: Tolerances, signals: Mapping[tuple[str, str], _Signal]) -> None:
    known = {signal.name for signal in signals.values()} | {component for component, _ in signals}
    for name in tolerances.own:
        if name not in known:
            raise UsageError(f"--tolerance {name}: neither log has such a signal{nearest(name, known)}")


def _errors(a: Array, b: Array, turn: float | None) -> Array:
    """Absolute differences, (rows,); 0 of the same infinity or two NaN, infinite or NaN of other such."""
    with np.errstate(invalid="ignore", over="ignore"):
        errors = np.abs(a - b)
        if turn is not None:
            wide = np.isinf(errors)  # fmod is exact, and its difference does not overflow
            errors[wide] = np.abs(np.fmod(a[wide], turn) - np.fmod(b[wide], turn))
            errors = np.minimum(errors % turn, turn - errors % turn)
    errors[(a == b) | (np.isnan(a) & np.isnan(b))] = 0.0
    return errors


def _differing(a: Array, b: Array, errors: Array, tolerance: float | None) -> npt.NDArray[np.bool_]:
    """In which rows two signals do not agree, (rows,)."""
    differs: npt.NDArray[np.bool_]
    if tolerance is None:
        differs = (a.view(np.int64) != b.view(np.int64)) & ~(np.isnan(a) & np.isnan(b))
    else:
        differs = ~(errors <= tolerance)
    return differs


def _worst(errors: Array, differs: npt.NDArray[np.bool_], finite: npt.NDArray[np.bool_]) -> int:
    """The row with the largest difference of finite values that differ, or the first that differs."""
    measured = differs & finite
    return int(np.argmax(np.where(measured, errors, -1.0) if measured.any() else differs))


def _rows_of_one(log: Log, other: Log) -> RowsOfOne | None:
    """The rows that the other log lacks, without those after its end if it is not whole."""
    alone = ~np.isin(log.time, other.time)
    if other.broken:
        alone &= log.time <= other.time[-1]
    times = log.time[alone]
    return RowsOfOne(len(times), float(times[0]), float(times[-1])) if len(times) else None


def _declarations(
    in_a: Mapping[tuple[str, str], _Signal], in_b: Mapping[tuple[str, str], _Signal]
) -> Iterator[Statement]:
    """Units and types of signals that differ."""
    for key, a in in_a.items():
        if b := in_b.get(key):
            for what, of_a, of_b in (("unit", a.unit, b.unit), ("type", a.type, b.type)):
                if of_a != of_b:
                    yield Statement(f"{a.name}: {what}", of_a, of_b)


def _statements(a: Log, b: Log) -> Iterator[Statement]:
    """What differs of metadata, attachments and origin."""
    of_a, of_b = ({**log.metadata, "origin": [*log.origin]} for log in (a, b))
    scenarios = [_scenario(log) for log in (a, b)]
    if all(scenarios):
        of_a["scenario"], of_b["scenario"] = scenarios
    for change in changes(of_a, of_b):
        yield Statement(*change)
    for name in {**a.attachments, **b.attachments}:
        files = a.attachments.get(name), b.attachments.get(name)
        if files[0] != files[1]:
            yield Statement(f"file {name}", *map(_file, files))


def _scenario(log: Log) -> dict[str, Any]:
    """A log's scenario key by key; {} if it has none that can be read."""
    record = log.metadata.get("scenario", {})
    try:
        return {"name": record["name"]} | parse_toml(record["toml"])
    except (KeyError, TomlError):
        return {}


def _file(data: bytes | None) -> str | None:
    return None if data is None else f"{len(data)} bytes, CRC-32 {zlib.crc32(data):08x}"


def _plain(value: Any) -> Any:
    """A value for JSON, which has no infinity and no NaN."""
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return _NOT_FINITE.get(str(value), value) if isinstance(value, float) else value
