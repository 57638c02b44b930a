"""The parameters that a scenario can set, in the units in which it states them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape

from harness.terminal import new_table, print_table
from harness.toml_file import TomlError, parse_toml
from harness.trial.plan import start_of
from harness.trial.units import is_angular, stated_unit
from models.kit.block import Block
from models.kit.declaration import Type, Variable, flatten
from models.readings import ON_BOARD, READING, READINGS
from models.sensors import Sensors
from models.sets import sets_of
from models.system import BLOCKS, CONTROLLERS, PLANTS

if TYPE_CHECKING:
    from harness.log.log import Log  # mcap: sweeps do without

Number = bool | int | float
MISSION = (  # with what such parameters' names begin
    "waypoint_", "home_", "fence_", "street_count", "street_north", "street_east", "street_end_",
    "street_half_width", "pole_count", "pole_north", "pole_east",
)  # fmt: skip


@dataclass(frozen=True)
class ParameterRow:
    """A parameter as scenarios have it: angles in degrees.

    Attributes:
        name: `block.name`.
        type: Real, Integer or Boolean.
        unit: "" for a number without one.
        size: of a vector; None for a scalar.
        min, max: None where there is no limit.
        default: in the reading asked for; of a vector, the one value of all elements, or the list of them.
        choices: the named values of an enumeration.
    """

    name: str
    type: str
    unit: str
    size: int | None
    min: Number | None
    max: Number | None
    default: Number | list[Number]
    choices: dict[str, int]
    meaning: str


def parameters_of(blocks: Sequence[type[Block]], reading: str = READING) -> list[ParameterRow]:
    """The parameters of blocks, in the order of their declarations, with the defaults of one of READINGS."""
    return [_row(block, variable, reading) for block in blocks for variable in block.group("parameter")]


def sets_for(block: type[Block]) -> list[str]:
    """The names of the sets that a block can take in a component's place."""
    known = {variable.name for variable in block.group("parameter")}
    places: dict[str, Mapping[str, type[Block]]] = {
        "plant": PLANTS,
        "controller": CONTROLLERS,
        Sensors.title(): {Sensors.title(): Sensors},
    }
    return [
        name
        for component, blocks in places.items()
        if block.title() in blocks
        for name, values in sets_of(component).items()
        if values.keys() <= known
    ]


def _row(block: type[Block], variable: Variable, reading: str) -> ParameterRow:
    name = f"{block.title()}.{variable.name}"
    start = (READINGS[reading][name],) if name in READINGS[reading] else variable.start
    starts = [_written(variable, value) for value in start]
    return ParameterRow(
        name,
        variable.type.value,
        stated_unit(variable.unit),
        variable.size,
        None if variable.min is None else _written(variable, variable.min),
        None if variable.max is None else _written(variable, variable.max),
        starts[0] if len(set(starts)) == 1 else starts,
        {choice.name: int(choice) for choice in variable.choices or ()},
        variable.meaning,
    )


@dataclass(frozen=True)
class ChangedParameter:
    """A parameter that a trial had with another value than its default, as scenarios write both."""

    name: str
    unit: str
    value: Number
    default: Number
    meaning: str

    @property
    def texts(self) -> tuple[str, str]:
        """Value and default as they are printed."""
        return _text(self.value), _text(self.default)


def changed(log: Log) -> list[ChangedParameter]:
    """The parameters of a log's blocks of ours that differ from the defaults of its reading.

    Seeds, mission (waypoints, home, fence) and map (streets, poles) are left out: no default is meant for
    them.
    """
    stated = log.metadata.get("parameters", {})
    blocks = {block.title(): block for block in BLOCKS}
    differing = []
    for component, title in log.metadata.get("roles", {}).items():
        for flat, variable in flatten(blocks[title].group("parameter")) if title in blocks else ():
            default = READINGS[_reading(log)].get(f"{title}.{variable.name}", start_of(variable, flat))
            value = log.parameter(f"{component}.{flat}") if f"{component}.{flat}" in stated else None
            if value is None or value == default or variable.name.startswith(MISSION) or flat == "seed":
                continue
            row = _row(blocks[title], variable, READING)
            differing.append(
                ChangedParameter(
                    f"{title}.{flat}",
                    row.unit,
                    _written(variable, value),
                    _written(variable, default),
                    row.meaning,
                )
            )
    return differing


def _reading(log: Log) -> str:
    """The reading of a log's scenario, or the one that it had without a word."""
    default = ON_BOARD if log.metadata.get("run", {}).get("onboard") else READING
    try:
        reading = parse_toml(log.metadata["scenario"]["toml"]).get("reading", default)
    except (KeyError, TomlError):
        return default
    return reading if reading in READINGS else default


def _written(variable: Variable, value: float) -> Number:
    """A value as a scenario states it: 37 for the float next to 37 deg."""
    if variable.type is Type.BOOLEAN:
        return bool(value)
    if variable.type is Type.INTEGER:
        return int(value)
    if not is_angular(variable):
        return value
    rounded = float(f"{math.degrees(value):.12g}")
    return rounded if math.radians(rounded) == value else math.degrees(value)


def as_json(rows: Sequence[ParameterRow]) -> list[dict[str, Any]]:
    """The rows for a program."""
    return [asdict(row) for row in rows]


def show(rows: Sequence[ParameterRow], console: Console) -> None:
    """Print the rows as a table."""
    table = new_table()
    table.add_column("parameter", no_wrap=True)
    table.add_column("unit")
    table.add_column("range", no_wrap=True)
    table.add_column("default", justify="right")
    table.add_column("meaning")
    for row in rows:
        size = "" if row.size is None else f"[1..{row.size}]"
        cells = (f"{row.name}{size}", row.unit, _range(row), _text(row.default), row.meaning)
        table.add_row(*map(escape, cells))
    print_table(table, console)


def _range(row: ParameterRow) -> str:
    if row.choices:
        return ", ".join(row.choices)
    if row.type == "Boolean":
        return "false, true"
    match row.min, row.max:
        case None, None:
            return ""
        case None, high:
            return f"up to {_text(high)}"
        case low, None:
            return f"from {_text(low)}"
        case low, high:
            return f"{_text(low)} to {_text(high)}"


def _text(value: Number | list[Number] | None) -> str:
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value).lower()
