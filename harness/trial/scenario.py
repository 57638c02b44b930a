"""A scenario: what happens in a trial, as a user writes it, in a TOML file or in Python.

    system = "full"                          # or "full_ahrs", "cts", or the path of an .ssp
    estimator = "four_state"                 # or another of ours
    reading = "calibrated"                   # or "literal", "field", "guarded"
    seed = 1
    duration = 300.0                         # s
    waypoints = [[35.73, 0.0], [35.73, 35.73]]   # north, east in m
    fence = [[-20.0, -20.0], [60.0, -20.0], [60.0, 60.0], [-20.0, 60.0]]   # its 3 to 7 corners (rule 7)
    origin = { latitude = 32.6, longitude = -85.5 }          # deg, of north = east = 0: for maps
    start = { north = 0.0, east = 0.0, heading = 0.0 }       # m, m, deg: where the animal starts, and home

    [parameters]                             # by block.name or component.name
    canine = "table_5_1"                     # a set of parameters by its name; the lines below win over it
    "cmec.moving_deviation" = 37             # deg, since its unit is rad
    "sensors.outage_start" = [12.0, 30.0]    # the first elements of a vector

    [[set]]                                  # an input without a source, from a time on (until another)
    at = 10.0
    until = 12.0
    "controller.override" = "STOP"

    [[street]]                               # up to 16 hold the dog: what lies within half_width of a line
    from = [0.0, 0.0]                        # north, east in m
    to = [71.46, 0.0]
    half_width = 1.0                         # m

    [[pole]]                                 # up to 8, the goal and decoys, which the dog may fancy
    at = [35.73, 0.0]                        # north, east in m

    [[fault]]                                # of an output on all its links, or on one: "a.x -> b.y"
    signal = "sensors.gps_north"
    kind = "offset"
    at = 10.0
    until = 12.0
    value = 5.0

Of several `[[set]]` for one input, the one that started last holds; of those that started together, the one
listed last. Where none holds, the input has its value of the start.

Quantities with rad in their unit are in degrees here, and in rad everywhere else; `plan` resolves them to SI.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from difflib import get_close_matches
from itertools import takewhile
from numbers import Integral
from os.path import isdir, isfile  # unlike Path's, they raise nothing
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from harness.cosim.stepping import DURATION
from harness.files import nearest_file
from harness.toml_file import TomlError, parse_toml, read_toml
from harness.trial.units import stated_unit
from models.canine import Canine
from models.cmec import MAX_WAYPOINTS
from models.disturbance import LONGEST_DELAY, Kind
from models.errors import UsageError, nearest
from models.fence import MAX_CORNERS, fault_of
from models.kit.declaration import Type
from models.kit.random import MAX_SEED
from models.readings import READINGS
from models.streets import MAX_POLES, MAX_STREETS, CanineInStreets
from models.system import ESTIMATOR, ESTIMATORS, PLANT, SYSTEMS, System, find_system, names_of

ARROW = "->"  # of a signal's link
LOST, GARBAGE, STALL = "lost", "garbage", "stall"  # of the radio, of bytes for the firmware, of a component
Written = bool | int | float | str | list[Any]
SHIPPED = Path(__file__).parents[1] / "scenarios"
MAX_DURATION = 86_400.0  # s: a day
MAX_COORDINATE = Canine.start_north.max or 0.0  # m
STREET_WIDTHS = (
    CanineInStreets.street_half_width.min or 0.0,
    CanineInStreets.street_half_width.max or 0.0,
)  # m
TARGETS = "a scenario (.toml), a package (.ssp) or a log (.mcap)"
ORIGIN = (32.6062, -85.4877)  # deg: Auburn, Alabama, where the trials were


class ScenarioError(UsageError):
    """A scenario cannot be read, or something in it does not exist or is out of range."""


@dataclass(frozen=True)
class Setting:
    """The value of an input as written, from `at` to `until` [s]; None is the end of the trial."""

    variable: str
    value: Written
    at: float
    until: float | None = None


@dataclass(frozen=True)
class Disturbance:
    """A fault as written, from `at` to `until` [s]; None is the end of the trial.

    Attributes:
        signal: `component.output`, or one link of it, `component.output -> component.input`; of some kinds
            a stream of bytes, or a component.
        kind: one of `FAULTS`.
        value: in the signal's unit, angles in degrees; of some kinds something else (`FAULTS`).
    """

    signal: str
    kind: str
    at: float
    until: float | None = None
    value: float | None = None

    @property
    def output(self) -> str:
        """The signal without the link: `component.output`."""
        return self.signal.partition(ARROW)[0].strip()

    def words(self, units: Mapping[str, str], signal: str = "") -> str:
        """What it is, for tables and legends: `offset of 5 m in sensors.gps_north`.

        Args:
            units: of outputs, by `component.output`.
            signal: what it is said of, where that is more than its own.
        """
        signal = signal or self.signal
        if self.kind == LOST:
            return f"lost {signal}"
        if self.value is None:
            return f"{self.kind} of {signal}"
        unit = FAULTS[self.kind].unit
        if unit is None:
            unit = stated_unit(units.get(self.output, ""))
        return f"{self.kind} of {f'{self.value:.6g} {unit}'.rstrip()} in {signal}"


@dataclass(frozen=True)
class FaultKind:
    """What a kind of fault takes.

    Attributes:
        means: its `value`; "" if it takes none.
        low, high: the range of that.
        unit: of that; None for the signal's.
        types: of the signals that it fits; none for what is no signal.
        ends: it needs an `until`.
    """

    means: str = ""
    low: float = -math.inf
    high: float = math.inf
    unit: str | None = ""
    types: frozenset[Type] = frozenset(Type)
    ends: bool = False


@dataclass(frozen=True)
class Street:
    """A street that holds the dog: what lies within `half_width` of a line between two places [m]."""

    start: tuple[float, float]
    end: tuple[float, float]
    half_width: float

    def outside(self, place: tuple[float, float]) -> float:
        """How far a place is outside of it [m]; negative inside."""
        (north, east), (end_north, end_east) = self.start, self.end
        way, away = (end_north - north, end_east - east), (place[0] - north, place[1] - east)
        square = way[0] ** 2 + way[1] ** 2
        along = (away[0] * way[0] + away[1] * way[1]) / square if square else 0.0
        share = min(max(along, 0.0), 1.0)
        closest = (north + share * way[0], east + share * way[1])
        return math.dist(place, closest) - self.half_width


REALS = frozenset({Type.REAL})
FAULT_KINDS = {
    Kind.OFF: FaultKind(),
    Kind.STUCK: FaultKind(),
    Kind.OFFSET: FaultKind("what is added, in the signal's unit", unit=None, types=REALS),
    Kind.SCALE: FaultKind("the factor", types=REALS),
    Kind.NOISE: FaultKind("the standard deviation, in the signal's unit", 0, unit=None, types=REALS),
    Kind.DELAY: FaultKind(f"the delay in s, up to {LONGEST_DELAY} ticks", 0, unit="s"),
    Kind.DROPOUTS: FaultKind("the share of samples that are lost", 0, 1),
    Kind.JUMP: FaultKind("what the signal jumps by, in its unit", unit=None, types=REALS, ends=True),
    Kind.NAN: FaultKind(types=REALS),
}
FAULTS = {kind.name.lower(): what for kind, what in FAULT_KINDS.items()} | {
    LOST: FaultKind(types=frozenset()),
    GARBAGE: FaultKind("the share of bytes that arrive as others", 0, 1, types=frozenset()),
    STALL: FaultKind(types=frozenset()),
}


@dataclass(frozen=True)
class Scenario:
    """A trial as it is written: angles in degrees, addresses unresolved.

    Attributes:
        name: of the folder of the results.
        system: one of ours, or the path of an .ssp.
        reading: one of READINGS; None for READING, or ON_BOARD where the firmware leads.
        duration: s, at which a trial times out.
        waypoints: north and east, m.
        origin: latitude and longitude of north = east = 0, deg.
        start: north and east, m; heading, deg.
        parameters: by `block.name` or `component.name`; the name of a set by `block` or `component`.
        sets: changes of inputs by time.
        faults: of signals, by time.
        fence: the corners of a polygon that the animal may not leave, north and east, m; none for no fence.
        estimator: which of ours a system with one has.
        streets: they hold the dog.
        poles: which the dog may fancy, north and east, m.
        folder: where its file is; the path of an .ssp starts there.
    """

    name: str = "scenario"
    system: str = "full"
    reading: str | None = None
    seed: int = 1
    duration: float = DURATION
    waypoints: Sequence[tuple[float, float]] = ()
    origin: tuple[float, float] = ORIGIN
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    parameters: Mapping[str, Written] = field(default_factory=dict)
    sets: tuple[Setting, ...] = ()
    faults: tuple[Disturbance, ...] = ()
    estimator: str = ESTIMATOR
    fence: Sequence[tuple[float, float]] = ()
    streets: tuple[Street, ...] = ()
    poles: Sequence[tuple[float, float]] = ()
    folder: Path = field(default=Path(), compare=False)

    @property
    def package(self) -> Path | None:
        """The .ssp that it runs; None for a system of ours."""
        return None if self.system in SYSTEMS else self.folder / self.system

    @property
    def own_system(self) -> System | None:
        """The system of ours that it runs; None for a package."""
        return find_system(self.system, self.estimator, self.plant) if self.system in SYSTEMS else None

    @property
    def plant(self) -> str:
        """The plant of a system of ours: the dog, or the dog in streets where there are streets or poles."""
        return CanineInStreets.title() if self.streets or self.poles else PLANT

    def _component_of(self, address: str, swaps: Mapping[str, str]) -> str:
        """An address by its component's name, where its block's name is given."""
        owner, dot, name = address.partition(".")
        own = self.own_system.components if self.own_system else {}
        blocks = {**{component: block.title() for component, block in own.items()}, **swaps}
        return f"{next((c for c, block in blocks.items() if owner in names_of(block)), owner)}{dot}{name}"

    def text(self) -> str:
        """The scenario as TOML. Equal scenarios have equal texts, and a text reads back to its scenario."""
        for key, value, size in (("start", self.start, 3), ("origin", self.origin, 2)):
            if len(value) != size:
                raise ScenarioError(f"{self.name}: {key} is {value!r}; expected {size} numbers")
        for key, entries, kind in (
            ("sets", self.sets, Setting),
            ("faults", self.faults, Disturbance),
            ("streets", self.streets, Street),
        ):
            if not all(isinstance(entry, kind) for entry in entries):
                raise ScenarioError(f"{self.name}: {key} is {entries!r}; expected `{kind.__name__}`s")
        north, east, heading = self.start
        lines = [
            f"name = {toml_of(self.name)}",
            f"system = {toml_of(self.system)}",
            *([f"estimator = {toml_of(self.estimator)}"] if self.estimator != ESTIMATOR else []),
            *([f"reading = {toml_of(self.reading)}"] if self.reading else []),
            f"seed = {toml_of(self.seed)}",
            f"duration = {toml_of(self.duration)}",
            f"waypoints = {toml_of(self.waypoints)}",
            *([f"fence = {toml_of(self.fence)}"] if self.fence else []),
            f"origin = {{ latitude = {toml_of(self.origin[0])}, longitude = {toml_of(self.origin[1])} }}",
            f"start = {{ north = {toml_of(north)}, east = {toml_of(east)}, heading = {toml_of(heading)} }}",
        ]
        if self.parameters:
            lines += ["", "[parameters]"]
            lines += [f"{toml_of(name)} = {toml_of(value, name)}" for name, value in self.parameters.items()]
        for setting in self.sets:
            lines += ["", "[[set]]", f"at = {toml_of(setting.at)}"]
            if setting.until is not None:
                lines.append(f"until = {toml_of(setting.until)}")
            lines.append(f"{toml_of(setting.variable)} = {toml_of(setting.value, setting.variable)}")
        for street in self.streets:
            lines += ["", "[[street]]", f"from = {toml_of(street.start)}", f"to = {toml_of(street.end)}"]
            lines.append(f"half_width = {toml_of(street.half_width)}")
        for pole in self.poles:
            lines += ["", "[[pole]]", f"at = {toml_of(pole)}"]
        for fault in self.faults:
            lines += ["", "[[fault]]"]
            lines += [
                f"{key} = {toml_of(value, key)}" for key, value in asdict(fault).items() if value is not None
            ]
        return "\n".join(lines) + "\n"

    def override(
        self, settings: Iterable[str], seed: int | None = None, swaps: Mapping[str, str] | None = None
    ) -> Scenario:
        """The scenario with `block.name=value` settings over its parameters, and another seed.

        Args:
            swaps: by component, the name of the block that takes the place of the system's own.

        Raises:
            ScenarioError: a setting without "=", a parameter set twice, or a seed that no trial can have.
        """
        if seed is not None and (not isinstance(seed, Integral) or not 0 <= seed <= MAX_SEED):
            raise ScenarioError(f"seed is {seed!r}; expected a whole number from 0 to {MAX_SEED}")
        parameters = dict(self.parameters)
        settings_by_name: dict[str, str] = {}
        for setting in settings:
            name, equals, text = setting.partition("=")
            if not equals or not name.strip() or not text.strip():
                raise ScenarioError(
                    f'--set {setting}: expected block.name=value, as in "cmec.moving_deviation=37"'
                )
            name = name.strip()
            address = self._component_of(name, swaps or {})
            same = {other for other in parameters if self._component_of(other, swaps or {}) == address}
            twice = next((settings_by_name[other] for other in same if other in settings_by_name), None)
            if twice is not None:
                raise ScenarioError(f"--set {setting}: --set {twice} is the same parameter; set it once")
            for other in same:
                del parameters[other]
            parameters[name], settings_by_name[name] = _literal(text.strip()), setting
        return replace(self, parameters=parameters, seed=self.seed if seed is None else seed)


def toml_of(value: Written | Sequence[Any], name: str = "the value") -> str:
    """A value as TOML.

    Raises:
        ScenarioError: a scenario cannot hold it; `name` is what it was meant for.
    """
    if hasattr(value, "tolist"):  # NumPy's scalars and arrays
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(toml_of(v) for v in value)}]"
    if isinstance(value, str):
        special = {'"': '\\"', "\\": "\\\\"}
        return (
            '"' + "".join(special.get(c, c if c.isprintable() else f"\\U{ord(c):08x}") for c in value) + '"'
        )
    raise ScenarioError(f"{name} is {value!r}; expected a number, a bool, a text or a list")


def _literal(text: str) -> Written:
    """The value behind `--set name=`: a TOML value, else a name."""
    try:
        table = parse_toml(f"value = {text}")
    except TomlError:
        return text
    value: Written = table["value"]
    return value if len(table) == 1 else text  # else a line break is in it


def with_estimator() -> list[str]:
    """The systems of ours that have an estimator."""
    return [name for name, system in SYSTEMS.items() if "estimator" in system.components]


def shipped() -> list[str]:
    """The names of the scenarios that come with the project."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


def about(name: str) -> str:
    """What a shipped scenario is: the first sentence of its file's comment."""
    lines = (SHIPPED / f"{name}.toml").read_text().splitlines()
    comment = takewhile(lambda line: line.startswith("#"), lines)
    sentence, *_ = " ".join(line.lstrip("# ") for line in comment).split(". ")
    return sentence.rstrip(".")


def load(target: str, *, mission: bool = True, known: Collection[str] = ()) -> Scenario:
    """The scenario of a file, or the shipped one of this name.

    Args:
        mission: must it have waypoints?
        known: names that the caller knows beside the shipped ones, for hints.

    Raises:
        ScenarioError: it cannot be read; the message names file and key.
    """
    path = Path(target)
    if not isfile(path) and not path.suffix and target in shipped():
        path = SHIPPED / f"{target}.toml"
    scenario = parse(_text_of(path, target, known), target, default_name=path.stem, folder=path.parent)
    if mission:
        _check_mission(scenario, target)
    return scenario


def _text_of(path: Path, target: str, known: Collection[str]) -> str:
    """The text of a scenario's file.

    Raises:
        ScenarioError: there is none; the message says what there is, and what to type.
    """
    if not target:
        raise ScenarioError(f'the scenario is ""; expected the path of a .toml{nearest("", shipped())}')
    if isdir(path):
        log = path / "trial.mcap"
        hint = f'; did you mean "{log}"?' if isfile(log) else nearest_file(path / "scenario.toml")
        raise ScenarioError(f"{target}: is a folder; expected {TARGETS}{hint}")
    if path.suffix == ".fmu" and isfile(path):
        raise ScenarioError(
            f"{target}: is an FMU; expected {TARGETS}: `canine run --plant {target}` puts it into a trial, "
            f"`canine check {target}` looks at it"
        )
    if path.suffix in (".mcap", ".ssp") and isfile(path):
        what = "a log" if path.suffix == ".mcap" else "a package"
        raise ScenarioError(
            f"{target}: is {what}; expected a scenario (.toml) or the name of a shipped one; "
            f"`canine run {target}` runs it"
        )
    if not isfile(path):
        raise ScenarioError(_missing(path, target, known))
    try:
        return read_toml(path)
    except TomlError as reason:
        raise ScenarioError(f"{target}: {reason}") from None
    except OSError as reason:
        raise ScenarioError(f"{target}: cannot be read ({reason.strerror}); expected {TARGETS}") from None


def _missing(path: Path, target: str, known: Collection[str]) -> str:
    """What to say about a scenario that is not there."""
    if path.name == target and not path.suffix:
        beside = f'; did you mean "{target}.toml"?' if isfile(f"{target}.toml") else ""
        return f'there is no scenario "{target}"{beside or nearest(target, {*known, *shipped()})}'
    hint = f'; did you mean "{path.stem}"?' if path.stem in shipped() else nearest_file(path)
    return f'there is no file "{target}"{hint}'


def checked(scenario: Scenario) -> Scenario:
    """A scenario made in Python, checked as if it were read from a file.

    Raises:
        ScenarioError: a wrong type, or a value out of its range.
    """
    where = scenario.name or "scenario"
    result = parse(scenario.text(), where, folder=scenario.folder)
    _check_mission(result, where)
    return result


def _check_mission(scenario: Scenario, where: str) -> None:
    if scenario.system in SYSTEMS and not scenario.waypoints:
        raise ScenarioError(
            f"{where}: waypoints is []; expected 1 to {MAX_WAYPOINTS} pairs [north, east] in m"
        )


def parse(text: str, where: str, default_name: str = "scenario", folder: Path = Path()) -> Scenario:
    """A scenario from its TOML text; `where` names it in errors.

    Raises:
        ScenarioError: broken TOML, an unknown key, a wrong type, or a value out of its range.
    """
    try:
        table = _TomlTable(parse_toml(text), where)
    except TomlError as reason:
        raise ScenarioError(f"{where}: {reason}") from None
    origin = table.table("origin")
    start = table.table("start")
    scenario = Scenario(
        name=table.plain("name", default_name),
        system=table.word("system", "full"),
        reading=table.optional("reading", READINGS),
        seed=int(table.number("seed", 1, 0, MAX_SEED, whole=True)),
        duration=table.number("duration", DURATION, 0, MAX_DURATION, unit="s"),
        waypoints=table.points("waypoints", MAX_WAYPOINTS),
        fence=table.points("fence", MAX_CORNERS),
        origin=(
            origin.number("latitude", ORIGIN[0], -90, 90, unit="deg"),
            origin.number("longitude", ORIGIN[1], -180, 180, unit="deg"),
        ),
        start=(
            start.number("north", 0.0, -MAX_COORDINATE, MAX_COORDINATE, unit="m"),
            start.number("east", 0.0, -MAX_COORDINATE, MAX_COORDINATE, unit="m"),
            start.number("heading", 0.0, -180, 180, unit="deg"),
        ),
        parameters=table.table("parameters").all(),
        sets=tuple(setting for entry in table.tables("set") for setting in entry.settings()),
        faults=tuple(entry.fault() for entry in table.tables("fault")),
        streets=tuple(entry.street() for entry in table.tables("street", MAX_STREETS)),
        poles=tuple(entry.pole() for entry in table.tables("pole", MAX_POLES)),
        estimator=table.word("estimator", ESTIMATOR, ESTIMATORS),
        folder=folder,
    )
    if scenario.system not in SYSTEMS and not scenario.system.endswith((".ssp", ".ssd")):
        hint = nearest(scenario.system, SYSTEMS)
        raise ScenarioError(
            f'{where}: system is "{scenario.system}"; expected the path of an .ssp, or{hint[1:]}'
        )
    if scenario.estimator != ESTIMATOR and scenario.system not in with_estimator():
        raise ScenarioError(
            f'{where}: estimator is "{scenario.estimator}", and the system "{scenario.system}" takes none of '
            f"ours; expected one of {', '.join(with_estimator())}"
        )
    if scenario.fence and (fault := fault_of(scenario.fence)):
        raise ScenarioError(
            f"{where}: fence is no polygon: {fault}; list its corners one after another around it"
        )
    for each in (table, origin, start):
        each.finish()
    return scenario


class _TomlTable:
    """A TOML table whose keys are taken one by one; `finish` refuses the keys that are left."""

    def __init__(self, values: dict[str, Any], where: str) -> None:
        self.left, self.where = dict(values), where
        self.known: list[str] = []

    def take(self, key: str, default: Any) -> Any:
        self.known.append(key)
        return self.left.pop(key, default)

    def fail(self, key: str, value: object, expected: str) -> ScenarioError:
        shown = toml_of(value) if isinstance(value, bool | int | float | str) else str(value)
        return ScenarioError(f"{self.where}: {key} is {shown}; expected {expected}")

    def word(self, key: str, default: str, known: Collection[str] = ()) -> str:
        value = self.take(key, default)
        if not isinstance(value, str) or not value:
            raise self.fail(key, value, "a text")
        if known and value not in known:
            raise self.fail(key, value, f"one of {', '.join(sorted(known))}{nearest(value, known)}")
        return value

    def optional(self, key: str, known: Collection[str]) -> str | None:
        """One of these words; None if the key is absent."""
        return self.word(key, "", known) if key in self.left else self.take(key, None)

    def plain(self, key: str, default: str) -> str:
        """A name without separators: the results go into a folder of that name."""
        name = self.word(key, default)
        is_plain = name == PurePosixPath(name).name == PureWindowsPath(name).name
        if not is_plain or name == ".." or not name.isprintable():
            raise self.fail(key, name, "a plain name, without / and \\")
        return name

    def number(
        self, key: str, default: float, low: float, high: float, *, whole: bool = False, unit: str = ""
    ) -> float:
        value = self.take(key, default)
        expected = f"a {'whole ' if whole else ''}number from {low:g} to {high:.10g} {unit}".rstrip()
        if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
            raise self.fail(key, value, expected)
        if not low <= value <= high:
            raise self.fail(key, value, expected)
        return value if whole else float(value)

    def points(self, key: str, most: int) -> tuple[tuple[float, float], ...]:
        value = self.take(key, [])
        expected = f"up to {most} pairs [north, east] in m, each within {MAX_COORDINATE:g}"
        if not isinstance(value, list):
            raise self.fail(key, value, expected)
        if len(value) > most:
            raise ScenarioError(f"{self.where}: {key} has {len(value)} elements; expected {expected}")
        return tuple(self._pair(f"{key}[{number}]", point) for number, point in enumerate(value, start=1))

    def point(self, key: str, what: str) -> tuple[float, float]:
        """A pair that must be there."""
        self.needed(key, what)
        return self._pair(key, self.take(key, []))

    def _pair(self, name: str, point: object) -> tuple[float, float]:
        if isinstance(point, list) and len(point) == 2:
            north, east = point
            if all(
                isinstance(x, int | float) and not isinstance(x, bool) and abs(x) <= MAX_COORDINATE
                for x in point
            ):
                return float(north), float(east)
        raise self.fail(
            name, point, f"a pair [north, east] in m, each from {-MAX_COORDINATE:g} to {MAX_COORDINATE:g}"
        )

    def table(self, key: str) -> _TomlTable:
        value = self.take(key, {})
        if not isinstance(value, dict):
            raise self.fail(key, value, "a table")
        return _TomlTable(value, f"{self.where}: [{key}]")

    def tables(self, key: str, most: float = math.inf) -> list[_TomlTable]:
        value = self.take(key, [])
        if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
            raise self.fail(key, value, f"tables [[{key}]]")
        if len(value) > most:
            raise ScenarioError(f"{self.where}: there are {len(value)} [[{key}]]; expected up to {most:g}")
        return [_TomlTable(entry, f"{self.where}: [[{key}]] {i + 1}") for i, entry in enumerate(value)]

    def all(self) -> dict[str, Written]:
        """All keys that are left; `plan` resolves them against the system."""
        for key, value in self.left.items():
            if not isinstance(value, bool | int | float | str | list):
                raise self.fail(key, value, 'a value; a key with a dot is quoted: "block.name" = value')
        return self.left

    def needed(self, key: str, what: str) -> None:
        """Refuse a table without this key."""
        if key not in self.left:
            close = get_close_matches(key, self.left, n=1)
            raise ScenarioError(
                f'{self.where}: lacks "{key}", {what}' + (f'; it has "{close[0]}"' if close else "")
            )

    def span(self) -> tuple[float, float | None]:
        """From and until [s]."""
        self.needed("at", "the time in s")
        at = self.number("at", 0.0, 0, MAX_DURATION, unit="s")
        if "until" not in self.left:
            self.known.append("until")
            return at, None
        return at, self.number("until", at, at, MAX_DURATION, unit="s")

    def fault(self) -> Disturbance:
        self.needed("kind", f"one of {', '.join(FAULTS)}")
        self.needed("signal", 'what it disturbs: "component.output"')
        kind = self.word("kind", "", FAULTS)
        signal, (at, until), what = self.word("signal", ""), self.span(), FAULTS[kind]
        if what.ends and until is None:
            raise ScenarioError(f'{self.where}: lacks "until", the time in s: the {kind} fades until then')
        if what.means:
            self.needed("value", what.means)
        elif "value" in self.left:
            raise ScenarioError(f'{self.where}: value is {self.left["value"]}; the kind "{kind}" takes none')
        value = self.real("value", what.low, what.high, what.means) if what.means else None
        self.known.append("value")
        self.finish()
        return Disturbance(signal, kind, at, until, value)

    def street(self) -> Street:
        start = self.point("from", "one end of the street's middle, [north, east] in m")
        end = self.point("to", "the other end, [north, east] in m")
        self.needed("half_width", "from the street's middle to its wall, in m")
        least, most = STREET_WIDTHS
        half_width = self.number("half_width", 1.0, least, most, unit="m")
        self.finish()
        if start == end:
            raise ScenarioError(f"{self.where}: to is where from is, {list(end)}; expected another place")
        return Street(start, end, half_width)

    def pole(self) -> tuple[float, float]:
        place = self.point("at", "where the pole stands, [north, east] in m")
        self.finish()
        return place

    def real(self, key: str, low: float, high: float, means: str) -> float:
        """A finite number in a range that need not end."""
        value = self.take(key, None)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value) or not low <= value <= high:
            bounds = "" if low == -math.inf else f" from {low:g}"
            bounds += "" if high == math.inf else f" to {high:g}"
            raise self.fail(key, value, f"a number{bounds}: {means}")
        return float(value)

    def settings(self) -> list[Setting]:
        at, until = self.span()
        if not self.left:
            raise ScenarioError(f'{self.where}: sets nothing; expected "component.input" = value')
        return [Setting(variable, value, at, until) for variable, value in self.all().items()]

    def finish(self) -> None:
        for key in self.left:
            raise ScenarioError(f'{self.where}: unknown key "{key}"{nearest(key, self.known)}')
