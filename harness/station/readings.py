"""What a telemetry tells, in the units of the log and of the screen."""

from __future__ import annotations

from codegen.firmware.telemetry import FIELDS, Flag, Telemetry
from harness.log.log import Log


def values_of(telemetry: Telemetry) -> dict[str, float | int]:
    """The telemetry's fields in SI, by the names of the log; those without a unit are whole numbers."""
    values: dict[str, float | int] = {}
    for name, wire in FIELDS.items():
        number = getattr(telemetry, name)
        values[_logged(name)] = number * wire.factor if wire.si else number
    return values


def position_of(telemetry: Telemetry) -> tuple[float, float] | None:
    """Latitude and longitude of the estimate, deg; None before the first fix."""
    if Flag.FIXED not in Flag(telemetry.flags):
        return None
    return telemetry.latitude * 1e-7, telemetry.longitude * 1e-7


def telemetry_of(log: Log, row: int) -> Telemetry:
    """The telemetry in a log's row, as it was sent."""
    numbers = (log[f"telemetry.{_logged(name)}"][row] / wire.factor for name, wire in FIELDS.items())
    return Telemetry(*map(round, numbers))


def _logged(name: str) -> str:
    return name.removesuffix("_ms")
