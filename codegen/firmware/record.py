"""The record of the processor in the loop: every word that the onboard program remembers, named.

What a struct of `onboard/` or a block holds stands here once: from it come the C that writes the
record, and the names by which it is read. Left out are copies (where a frame lies in a buffer) and what does
not change, parameters but the mission.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from models.kit.block import Block
from models.kit.declaration import Parameter, Type, Variable

FIX = ("time_ms", "latitude", "longitude", "h_acc", "speed", "course", "s_acc")
SCANNER = ("start", "count", "needed", "length", "frames", "errors", "skipped")
QUANTITIES = (
    *(f"{n}_{axis}" for n in ("ACCEL", "GYRO", "MAG") for axis in "XYZ"),
    "ROLL",
    "PITCH",
    "HEADING",
)


@dataclass(frozen=True)
class Entry:
    """Words of the record.

    Attributes:
        c: the value as C, of element `i` of a vector.
        size: of the vector, 0 for a scalar.
    """

    name: str
    c: str
    type: Type = Type.INTEGER
    size: int = 0

    @property
    def words(self) -> list[str]:
        """A name for each."""
        return [f"{self.name}[{i}]" for i in range(1, self.size + 1)] if self.size else [self.name]

    @property
    def value(self) -> str:
        """The word as C."""
        return {
            Type.REAL: f"bits({self.c})",
            Type.INTEGER: f"(uint32_t)({self.c})",
            Type.BOOLEAN: f"({self.c}) ? 1U : 0U",
        }[self.type]


def drivers() -> Iterator[Entry]:
    """What stands in `onboard` beside the blocks."""
    for name in ("time_ms", "pause", "mission_id", "sequence"):
        yield Entry(name, f"m->{name}")
    for name in ("start_wanted", "busy", "reporting"):
        yield Entry(name, f"m->{name}", Type.BOOLEAN)
    for driver in ("gps", "imu", "radio"):
        for name in SCANNER:
            yield Entry(f"{driver}.{name}", f"m->{driver}.scanner.{name}")
        yield Entry(f"{driver}.held", f"held(&m->{driver}.scanner)")
    for part in ("fix", "epoch"):
        for name in FIX:
            yield Entry(f"gps.{part}.{name}", f"m->gps.{part}.{name}")
    for name in ("fixed", "good"):
        yield Entry(f"gps.{name}", f"m->gps.{name}", Type.BOOLEAN)
    for name in ("parts", "refused"):
        yield Entry(f"gps.{name}", f"m->gps.{name}")
    for quantity in QUANTITIES:
        yield Entry(f"imu.{quantity.lower()}", f"mt_value(&m->imu, MT_{quantity})", Type.REAL)
    for name in ("z_up", "sampled"):
        yield Entry(f"imu.{name}", f"m->imu.{name}", Type.BOOLEAN)
    for name in ("counter", "lost"):
        yield Entry(f"imu.{name}", f"m->imu.{name}")
    for name in ("override", "sequence", "refused", "unknown", "mission.id", "mission.count"):
        yield Entry(f"radio.{name}", f"m->radio.{name}")
    for name in ("latitude", "longitude"):
        yield Entry(f"radio.mission.home.{name}", f"m->radio.mission.home.{name}")
        yield Entry(f"radio.mission.{name}", f"m->radio.mission.waypoints[i].{name}", size=16)


def of_block(member: str, block: type[Block]) -> Iterator[Entry]:
    """What a member of `onboard` that is a block holds."""
    for kind, field in (("state", "state"), ("input", "in"), ("output", "out"), ("parameter", "par")):
        for variable in block.group(kind):
            if kind != "parameter" or is_mission(variable):
                place = f"m->{member}.{field}.{variable.name}{'[i]' if variable.size else ''}"
                yield Entry(f"{member}.{kind}.{variable.name}", place, variable.type, variable.size or 0)


def is_mission(variable: Variable) -> bool:
    """Does a parameter come by radio?"""
    return isinstance(variable, Parameter) and variable.latched
