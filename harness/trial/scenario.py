"""Scenarios: what happens in a trial, as a TOML file, and what that means for each component.

    system = "full"                          # or "cts", or the path of an .ssp
    reading = "calibrated"                   # or "literal"
    seed = 1
    duration = 300.0                         # s
    waypoints = [[35.73, 0.0], [35.73, 35.73]]   # north, east in m
    origin = { latitude = 32.6, longitude = -85.5 }          # deg, of north = east = 0: for maps
    start = { north = 0.0, east = 0.0, heading = 0.0 }       # m, m, deg: where the animal starts, and home

    [parameters]                             # by block.name or component.name
    "cmec.moving_deviation" = 37             # deg, since its unit is rad
    "sensors.outage_start" = [12.0, 30.0]    # the first elements of a vector

    [[set]]                                  # an input that nothing feeds, from a time on (until another)
    at = 10.0
    until = 12.0
    "controller.override" = "STOP"

Of several `[[set]]` for one input, the one that started last holds, of those that started together the last
listed; where none does, the input is what it was at the start.

Whatever has rad in its unit is in degrees here, and in rad everywhere else. What wins: the reading, over it
the mission (seed, start, waypoints), over it what the package binds, over it `parameters`.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from harness.cosim.fmu import FmuDescription, Quantity
from harness.cosim.loop import DURATION, Event
from harness.cosim.roles import Fit, Rename, Role
from models.canine import Canine
from models.cmec import MAX_WAYPOINTS
from models.errors import UsageError, nearest
from models.kit.declaration import Type, Variable, flatten
from models.kit.units import UNITS
from models.readings import READINGS, start_heading_deviation
from models.system import SYSTEMS, System

Written = bool | int | float | str | list[Any]
SHIPPED = Path(__file__).parents[1] / "scenarios"
MAX_SEED = int(Canine.seed.max or 0)
MAX_DURATION = 86_400.0  # s: a day
MAX_COORDINATE = Canine.start_north.max or 0.0  # m
ORIGIN = (32.6062, -85.4877)  # deg: Auburn, Alabama, where the trials were
DEFAULT = "three_waypoint"


class ScenarioError(UsageError):
    """A scenario that cannot be read, or asks for what is not there."""


@dataclass(frozen=True)
class Setting:
    """An input's value, as written, from `at` [s] (until `until`)."""

    variable: str
    value: Written
    at: float
    until: float | None = None


@dataclass(frozen=True)
class Scenario:
    """A trial as it is written: angles in degrees, addresses unresolved. `folder` is where its file lies."""

    name: str
    system: str = "full"
    reading: str = "calibrated"
    seed: int = 1
    duration: float = DURATION
    waypoints: tuple[tuple[float, float], ...] = ()
    origin: tuple[float, float] = ORIGIN
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    parameters: Mapping[str, Written] = field(default_factory=dict)
    sets: tuple[Setting, ...] = ()
    folder: Path = field(default=Path(), compare=False)

    @property
    def package(self) -> Path | None:
        """The .ssp that it runs, if it is none of ours."""
        return None if self.system in SYSTEMS else self.folder / self.system

    def text(self) -> str:
        """The scenario as TOML, the same text for the same scenario; it reads back to the same scenario."""
        north, east, heading = self.start
        lines = [
            f"name = {_toml(self.name)}",
            f"system = {_toml(self.system)}",
            f"reading = {_toml(self.reading)}",
            f"seed = {self.seed}",
            f"duration = {_toml(self.duration)}",
            f"waypoints = {_toml([list(w) for w in self.waypoints])}",
            f"origin = {{ latitude = {_toml(self.origin[0])}, longitude = {_toml(self.origin[1])} }}",
            f"start = {{ north = {_toml(north)}, east = {_toml(east)}, heading = {_toml(heading)} }}",
        ]
        if self.parameters:
            lines += ["", "[parameters]"]
            lines += [f"{_toml(name)} = {_toml(value)}" for name, value in self.parameters.items()]
        for setting in self.sets:
            lines += ["", "[[set]]", f"at = {_toml(setting.at)}"]
            if setting.until is not None:
                lines.append(f"until = {_toml(setting.until)}")
            lines.append(f"{_toml(setting.variable)} = {_toml(setting.value)}")
        return "\n".join(lines) + "\n"

    def override(self, settings: Iterable[str], seed: int | None = None) -> Scenario:
        """The scenario with `block.name=value` settings, and another seed, over its own.

        Raises:
            ScenarioError: a setting without "=".
        """
        parameters = dict(self.parameters)
        for setting in settings:
            name, equals, text = setting.partition("=")
            if not equals or not name.strip() or not text.strip():
                raise ScenarioError(
                    f'--set {setting}: expected block.name=value, as in "cmec.moving_deviation=37"'
                )
            parameters.pop(name.strip(), None)
            parameters[name.strip()] = _literal(text.strip())
        return replace(self, parameters=parameters, seed=self.seed if seed is None else seed)


def _toml(value: Written) -> str:
    """A value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return f"[{', '.join(_toml(v) for v in value)}]"
    if isinstance(value, str):
        special = {'"': '\\"', "\\": "\\\\"}
        return (
            '"' + "".join(special.get(c, c if c.isprintable() else f"\\U{ord(c):08x}") for c in value) + '"'
        )
    return repr(value)


def _literal(text: str) -> Written:
    """What is written behind `--set name=`: a TOML value, or else a name."""
    try:
        value: Written = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
    return value


def shipped() -> list[str]:
    """The names of the scenarios that come with the project."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


def load(target: str, *, mission: bool = True) -> Scenario:
    """The scenario of a file, or the shipped one of a bare name; with a mission, it must have waypoints.

    Raises:
        ScenarioError: naming file and key.
    """
    path = Path(target)
    if not path.is_file() and not path.suffix and target in shipped():
        path = SHIPPED / f"{target}.toml"
    try:
        text = path.read_text()
    except FileNotFoundError:
        raise ScenarioError(f'there is no scenario "{target}"{nearest(target, shipped())}') from None
    except (OSError, UnicodeDecodeError) as reason:
        raise ScenarioError(f"{target}: cannot be read ({reason})") from None
    scenario = parse(text, str(target), default_name=path.stem, folder=path.parent)
    if mission and scenario.system in SYSTEMS and not scenario.waypoints:
        raise ScenarioError(
            f"{target}: waypoints is []; expected 1 to {MAX_WAYPOINTS} pairs [north, east] in m"
        )
    return scenario


def parse(text: str, where: str, default_name: str = "scenario", folder: Path = Path()) -> Scenario:
    """A scenario from its TOML text; `where` names it in errors.

    Raises:
        ScenarioError: no TOML, an unknown key, a wrong type, or a value out of its range.
    """
    try:
        table = _TomlTable(tomllib.loads(text), where)
    except tomllib.TOMLDecodeError as reason:
        raise ScenarioError(f"{where}: {reason}") from None
    origin = table.table("origin")
    start = table.table("start")
    scenario = Scenario(
        name=table.plain("name", default_name),
        system=table.word("system", "full"),
        reading=table.word("reading", "calibrated", READINGS),
        seed=int(table.number("seed", 1, 0, MAX_SEED, whole=True)),
        duration=table.number("duration", DURATION, 0, MAX_DURATION),
        waypoints=table.points("waypoints"),
        origin=(
            origin.number("latitude", ORIGIN[0], -90, 90),
            origin.number("longitude", ORIGIN[1], -180, 180),
        ),
        start=(
            start.number("north", 0.0, -MAX_COORDINATE, MAX_COORDINATE),
            start.number("east", 0.0, -MAX_COORDINATE, MAX_COORDINATE),
            start.number("heading", 0.0, -180, 180),
        ),
        parameters=table.table("parameters").all(),
        sets=tuple(setting for part in table.tables("set") for setting in part.settings()),
        folder=folder,
    )
    if scenario.system not in SYSTEMS and not scenario.system.endswith(".ssp"):
        hint = nearest(scenario.system, SYSTEMS)
        raise ScenarioError(
            f'{where}: system is "{scenario.system}"; expected the path of an .ssp, or{hint[1:]}'
        )
    for part in (table, origin, start):
        part.finish()
    return scenario


class _TomlTable:
    """A TOML table whose keys are taken one by one; `finish` refuses what is left."""

    def __init__(self, values: dict[str, Any], where: str) -> None:
        self.left, self.where = dict(values), where
        self.known: list[str] = []

    def take(self, key: str, default: Any) -> Any:
        self.known.append(key)
        return self.left.pop(key, default)

    def fail(self, key: str, value: object, expected: str) -> ScenarioError:
        shown = _toml(value) if isinstance(value, bool | int | float | str) else str(value)
        return ScenarioError(f"{self.where}: {key} is {shown}; expected {expected}")

    def word(self, key: str, default: str, known: Collection[str] = ()) -> str:
        value = self.take(key, default)
        if not isinstance(value, str) or not value:
            raise self.fail(key, value, "a text")
        if known and value not in known:
            raise self.fail(key, value, f"one of {', '.join(sorted(known))}{nearest(value, known)}")
        return value

    def plain(self, key: str, default: str) -> str:
        """A name that is one part of a path: results lie in a folder of that name."""
        name = self.word(key, default)
        is_one = name == PurePosixPath(name).name == PureWindowsPath(name).name
        if not is_one or name == ".." or not name.isprintable():
            raise self.fail(key, name, "a plain name, without / and \\")
        return name

    def number(self, key: str, default: float, low: float, high: float, whole: bool = False) -> float:
        value = self.take(key, default)
        expected = f"a {'whole ' if whole else ''}number from {low:g} to {high:.10g}"
        if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
            raise self.fail(key, value, expected)
        if not low <= value <= high:
            raise self.fail(key, value, expected)
        return value if whole else float(value)

    def points(self, key: str) -> tuple[tuple[float, float], ...]:
        value = self.take(key, [])
        expected = f"up to {MAX_WAYPOINTS} pairs [north, east] in m, each within {MAX_COORDINATE:g}"
        if not isinstance(value, list) or len(value) > MAX_WAYPOINTS:
            raise self.fail(key, value, expected)
        points = []
        for point in value:
            if not isinstance(point, list) or len(point) != 2:
                raise self.fail(key, point, expected)
            for x in point:
                good = isinstance(x, int | float) and not isinstance(x, bool) and abs(x) <= MAX_COORDINATE
                if not good:
                    raise self.fail(key, point, expected)
            points.append((float(point[0]), float(point[1])))
        return tuple(points)

    def table(self, key: str) -> _TomlTable:
        value = self.take(key, {})
        if not isinstance(value, dict):
            raise self.fail(key, value, "a table")
        return _TomlTable(value, f"{self.where}: [{key}]")

    def tables(self, key: str) -> list[_TomlTable]:
        value = self.take(key, [])
        if not isinstance(value, list) or not all(isinstance(part, dict) for part in value):
            raise self.fail(key, value, f"tables [[{key}]]")
        return [_TomlTable(part, f"{self.where}: [[{key}]] {i + 1}") for i, part in enumerate(value)]

    def all(self) -> dict[str, Written]:
        """Every key, whatever it is; they are resolved against the system later."""
        for key, value in self.left.items():
            if not isinstance(value, bool | int | float | str | list):
                raise self.fail(key, value, 'a value; a key with a dot is quoted: "block.name" = value')
        return self.left

    def settings(self) -> list[Setting]:
        if "at" not in self.left:
            raise ScenarioError(f'{self.where}: lacks "at", the time in s')
        at = self.number("at", 0.0, 0, MAX_DURATION)
        until = self.number("until", at, at, MAX_DURATION) if "until" in self.left else None
        if not self.left:
            raise ScenarioError(f'{self.where}: sets nothing; expected "component.input" = value')
        return [Setting(variable, value, at, until) for variable, value in self.all().items()]

    def finish(self) -> None:
        for key in self.left:
            raise ScenarioError(f'{self.where}: unknown key "{key}"{nearest(key, self.known)}')


@dataclass(frozen=True)
class Interface:
    """What a component lets a scenario set.

    Attributes:
        block: the block's or the FMU's model name.
        parameters, inputs: by flat name; what a mapping file renames, by the role's name too.
        label: how messages call it, `plant dog.fmu`.
        foreign: swapped in.
        renames: for the role's names, what the FMU has.
        misfits: the role's parameters that it has otherwise than the role means them, to what is wrong.
    """

    block: str
    parameters: Mapping[str, Variable]
    inputs: Mapping[str, Variable]
    label: str
    foreign: bool = False
    renames: Mapping[str, Rename] = field(default_factory=dict)
    misfits: Mapping[str, str] = field(default_factory=dict)

    def own(self, name: str) -> str:
        """The component's own name of a variable."""
        return self.renames[name].name if name in self.renames else name

    def start(self, name: str, variable: Variable, values: Mapping[str, float]) -> float:
        """The value (as the role has it) with which a variable starts, given the component's own values."""
        rename = self.renames.get(name, Rename(name))
        own = (self.parameters if rename.name in self.parameters else self.inputs).get(rename.name, variable)
        value = values.get(rename.name, _start(own, rename.name))
        return (value - rename.offset) / rename.factor if rename.mapped else value

    def converted(self, name: str, value: float) -> tuple[str, float]:
        """The component's own name and value for a variable's name and value (SI)."""
        rename = self.renames.get(name, Rename(name))
        if not rename.mapped:
            return name, value
        variable = self.parameters.get(rename.name) or self.inputs[rename.name]
        converted = rename.factor * value + rename.offset
        return rename.name, converted if variable.type is Type.REAL else float(round(converted))


def interfaces_of_system(system: System) -> dict[str, Interface]:
    """The parts of a system of ours, by component."""
    return {
        name: Interface(
            block.title(),
            dict(flatten(block.group("parameter"))),
            dict(flatten(block.group("input"))),
            f"{name} {block.title()}",
        )
        for name, block in system.components.items()
    }


def interface_of_fmu(
    name: str,
    fmu: FmuDescription,
    role: Role | None = None,
    fit: Fit | None = None,
    misfits: Mapping[str, str] | None = None,
) -> Interface:
    """An FMU as a part, by what it declares; swapped in if it is known how it fits the role."""
    parameters = {n: _variable(fmu, q) for n, q in fmu.parameters.items()}
    inputs = {n: _variable(fmu, q) for n, q in fmu.inputs.items()}
    renames: dict[str, Rename] = {}
    if role is not None and fit is not None:
        renames = {n: r for n, r in {**fit.inputs, **fit.parameters}.items() if r.mapped}
        parameters |= {n: role.parameters[n] for n in fit.parameters if n in renames}
        inputs |= {n: role.inputs[n] for n in fit.inputs if n in renames}
    label = f"{name} {fmu.path.name}"
    return Interface(fmu.model, parameters, inputs, label, fit is not None, renames, misfits or {})


def _variable(fmu: FmuDescription, quantity: Quantity) -> Variable:
    variable = Variable(quantity.type, quantity.meaning)
    variable.name, variable.unit = quantity.name, quantity.unit or ""
    variable.min, variable.max = quantity.min, quantity.max
    variable.start = (quantity.start or 0.0,)
    return variable


@dataclass(frozen=True)
class Plan:
    """What a scenario means for a system.

    Attributes:
        values: start values (SI) of parameters and free inputs, by component and flat name.
        events: changes of inputs.
        notes: what a foreign component lacks, for the user to read.
    """

    values: dict[str, dict[str, float]]
    events: tuple[Event, ...]
    notes: tuple[str, ...]


def plan(
    scenario: Scenario,
    parts: Mapping[str, Interface],
    bound: Mapping[str, Mapping[str, float]] | None = None,
    fed: Mapping[str, Collection[str]] | None = None,
) -> Plan:
    """Resolve a scenario's addresses and values against a system.

    Args:
        bound: the values that the package itself gives, which the reading and the mission leave alone.
        fed: inputs that are connected.

    Raises:
        ScenarioError: an unknown component, block, parameter or input, a wrong type, or a value out of range.
    """
    return _Planner(scenario, parts, bound or {}, fed or {}).plan()


class _Planner:
    def __init__(
        self,
        scenario: Scenario,
        parts: Mapping[str, Interface],
        bound: Mapping[str, Mapping[str, float]],
        fed: Mapping[str, Collection[str]],
    ) -> None:
        self.scenario, self.parts, self.bound, self.fed = scenario, parts, bound, fed
        self.values: dict[str, dict[str, float]] = {name: {} for name in parts}
        self.notes: list[str] = []

    def plan(self) -> Plan:
        for address, value in READINGS[self.scenario.reading].items():
            block, _, name = address.partition(".")
            for component, part in self.parts.items():
                if part.block == block and name in part.parameters:
                    self.put(component, name, float(value))
        for component, values in self.mission.items():
            self.give(component, values)
        for address, written in self.scenario.parameters.items():
            where = f"{self.scenario.name}: {address}"
            for component, name in self.find(address, "parameters"):
                known = self.parts[component].parameters
                for flat, value in _converted(name, written, known, where).items():
                    self.values[component] |= [self.parts[component].converted(flat, value)]
        return Plan(self.values, tuple(self.events()), tuple(self.notes))

    @cached_property
    def mission(self) -> dict[str, dict[str, float]]:
        """The roles' parameters (SI) that the scenario states by keys of its own."""
        scenario = self.scenario
        north, east, heading = scenario.start
        spread = start_heading_deviation(scenario.reading, len(scenario.waypoints))
        controller: dict[str, float] = {"home_north": north, "home_east": east}
        if scenario.waypoints:
            controller["waypoint_count"] = len(scenario.waypoints)
        for i, (waypoint_north, waypoint_east) in enumerate(scenario.waypoints, start=1):
            controller |= {f"waypoint_north[{i}]": waypoint_north, f"waypoint_east[{i}]": waypoint_east}
        return {
            "plant": {
                "seed": scenario.seed,
                "start_north": north,
                "start_east": east,
                "start_heading": math.radians(heading),
                "start_heading_deviation": spread,
            },
            "sensors": {"seed": scenario.seed},
            "controller": controller,
        }

    def give(self, role: str, values: Mapping[str, float]) -> None:
        """Set what the component of a role has, and note what it lacks."""
        part = self.parts.get(role)
        lacking = [name for name in values if part is None or name not in part.parameters]
        names = ", ".join(dict.fromkeys(name.partition("[")[0] for name in lacking))
        if part is None:
            if self.scenario.package is not None:
                self.notes.append(f"{self.scenario.system}: has no component {role}; {names} not set")
            return
        if role == "controller" and "start" in part.inputs:
            self.put(role, "start", 1.0)  # the trial is on from the first tick
        for name in values:
            if name in part.parameters:
                self.put(role, name, values[name])
        if lacking:
            self.notes.append(f"{part.label}: has no parameter {names}; not set")

    def put(self, component: str, name: str, value: float) -> None:
        """Give a parameter or free input its value (SI), unless the package has one for it."""
        part = self.parts[component]
        own, converted = part.converted(name, value)
        if own in self.bound.get(component, ()) or own in self.fed.get(component, ()):
            return
        if name in part.misfits:
            raise ScenarioError(f"{self.scenario.name}: {part.misfits[name]}")
        self.values[component][own] = converted

    def find(self, address: str, kind: str) -> list[tuple[str, str]]:
        """The components that an address names by their name or their block's, with the variable's name."""
        owner, _, name = address.partition(".")
        where = f"{self.scenario.name}: {address}"
        owners = {n: {n, part.block} for n, part in self.parts.items()}
        found = [n for n, names in owners.items() if owner in names]
        if not found and (foreign := self.replaced(owner)):
            self.notes.append(f"{address}: not set, since {foreign} takes the place of {owner}")
            return []
        if not found or not name:
            hint = nearest(owner, set().union(*owners.values()))
            raise ScenarioError(f'{where}: no block or component "{owner}"{hint}')
        for component in found:
            known: Mapping[str, Variable] = getattr(self.parts[component], kind)
            if name not in known and f"{name}[1]" not in known:
                bases = {n.partition("[")[0] for n in known} if "[" not in name else known
                what = f"{self.parts[component].label} has no {kind[:-1]}"
                raise ScenarioError(f'{where}: {what} "{name}"{nearest(name, bases)}')
        return [(component, name) for component in found]

    def replaced(self, block: str) -> str:
        """The foreign part that stands where our system has this block."""
        for system in SYSTEMS.values():
            for role, own in system.components.items():
                if own.title() == block and role in self.parts and self.parts[role].foreign:
                    return self.parts[role].label
        return ""

    def events(self) -> Iterable[Event]:
        """The changes of inputs: at each time holds the entry that started last, of those the last listed."""
        entries: dict[tuple[str, str], list[tuple[float, float, float]]] = {}
        for setting in self.scenario.sets:
            where = f"{self.scenario.name}: [[set]] {setting.variable}"
            until = math.inf if setting.until is None else setting.until
            for component, name in self.find(setting.variable, "inputs"):
                part = self.parts[component]
                for flat, value in _converted(name, setting.value, part.inputs, where).items():
                    own, converted = part.converted(flat, value)
                    entries.setdefault((component, own), []).append((setting.at, until, converted))
        for (component, own), spans in entries.items():
            values = {**self.bound.get(component, {}), **self.values[component]}
            at_rest = values.get(own, _start(self.parts[component].inputs[own], own))
            for time in sorted({t for at, until, _ in spans for t in (at, until)} - {math.inf}):
                active = [(at, i) for i, (at, until, _) in enumerate(spans) if at <= time < until]
                yield Event(time, component, own, spans[max(active)[1]][2] if active else at_rest)


def _converted(name: str, written: Written, known: Mapping[str, Variable], where: str) -> dict[str, float]:
    """Flat names and SI values of what is written for a variable: a scalar, or a vector's first elements."""
    if name in known:
        return {name: si_value(written, known[name], where)}
    if not isinstance(written, list):
        raise ScenarioError(f"{where} is a vector; expected a list, or one element by name: {name}[1]")
    size = sum(flat.partition("[")[0] == name for flat in known)
    if len(written) > size:
        raise ScenarioError(f"{where} has {len(written)} elements; expected up to {size}")
    flat_names = [f"{name}[{i}]" for i in range(1, len(written) + 1)]
    return {
        n: si_value(value, known[n], f"{where}[{n}]") for n, value in zip(flat_names, written, strict=True)
    }


def is_angular(variable: Variable) -> bool:
    """Is the quantity written in degrees by users?"""
    return UNITS.get(variable.unit, {}).get("rad", 0) == 1


def si_value(written: Written, variable: Variable, where: str) -> float:
    """A value as users write it, in SI.

    Raises:
        ScenarioError: naming `where`, the value and what was expected.
    """
    value: float | None = None
    if variable.choices is not None and isinstance(written, str):
        named = {choice.name: float(choice) for choice in variable.choices}
        value = named.get(written.upper())
    elif isinstance(written, bool):
        value = float(written) if variable.type is Type.BOOLEAN else None
    elif isinstance(written, int | float) and math.isfinite(written) and variable.type is not Type.BOOLEAN:
        value = float(written)
    scale = math.pi / 180 if is_angular(variable) else 1.0
    if value is not None:
        value = math.radians(value) if is_angular(variable) else value
        low = -math.inf if variable.min is None else variable.min
        high = math.inf if variable.max is None else variable.max
        whole = variable.type is Type.REAL or value == int(value)
        if whole and low <= value <= high:
            return value
    raise ScenarioError(f"{where} is {_toml(written)}; expected {_expected(variable, scale)}")


def _expected(variable: Variable, scale: float) -> str:
    if not is_angular(variable):
        return variable.expected()
    words = "a number"
    if variable.min is not None:
        words += f" from {variable.min / scale:.4g}"
    if variable.max is not None:
        words += f" up to {variable.max / scale:.4g}"
    return words + " " + variable.unit.replace("rad", "deg")


def values_of(parts: Mapping[str, Interface], values: Mapping[str, Mapping[str, float]]) -> dict[str, str]:
    """Every parameter of every part as `component.name`: value (SI), for the log."""
    return {
        f"{component}.{name}": repr(float(part.start(name, variable, values.get(component, {}))))
        for component, part in parts.items()
        for name, variable in part.parameters.items()
    }


def _start(variable: Variable, name: str) -> float:
    """The start value of a scalar of a block's or an FMU's variable: of `name[3]`, the vector's third."""
    is_element = len(variable.start) > 1
    return variable.start[int(name[name.index("[") + 1 : -1]) - 1 if is_element else 0]
