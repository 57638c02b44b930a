"""A plan: a scenario resolved against a system, every address to a component's variable, every value to SI.

Later values replace earlier ones: the reading's, the mission's (seed, start, waypoints, fence, streets,
poles), those that the package binds, those of `parameters`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from harness.cosim.rename import Rename
from harness.cosim.stepping import Event
from harness.trial.notes import COUNTS, idle_notes
from harness.trial.pairs import check_points, check_windows
from harness.trial.scenario import LOST, Scenario, ScenarioError, Setting, Written, toml_of
from harness.trial.units import is_angular, stated_unit
from models.errors import UsageError, nearest
from models.kit.declaration import Type, Variable, flatten
from models.kit.link import Link
from models.readings import READING, READINGS, start_heading_deviation
from models.sets import find_set
from models.system import BLOCKS, DEFAULTS, ESTIMATORS, SYSTEMS, System, names_of

if TYPE_CHECKING:  # fmpy: sweeps do without
    from harness.cosim.fmu import FmuDescription, Quantity
    from harness.cosim.roles import Fit, Role


@dataclass(frozen=True)
class Interface:
    """The variables of a component that a scenario can set.

    Attributes:
        block: the block's or the FMU's model name.
        parameters, inputs: by flat name; renamed ones by the role's name too.
        outputs: by flat name, or the role's name where they are renamed.
        label: its name in messages, `plant dog.fmu`.
        foreign: swapped in, an FMU or another block of ours.
        renames: by the role's name, the FMU's name and the conversion.
        misfits: parameters with a role's name and another meaning, to what is wrong with them.
    """

    block: str
    parameters: Mapping[str, Variable]
    inputs: Mapping[str, Variable]
    label: str
    foreign: bool = False
    renames: Mapping[str, Rename] = field(default_factory=dict)
    misfits: Mapping[str, str] = field(default_factory=dict)
    outputs: Mapping[str, Variable] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """What addresses may call it, beside the component's name."""
        return names_of(self.block)

    def start(self, name: str, values: Mapping[str, float]) -> float:
        """A parameter's start value by the role's name and unit, given the component's own values."""
        rename = self.renames.get(name, Rename(name))
        own = self.parameters.get(rename.name) or self.inputs.get(rename.name) or self.parameters[name]
        value = values.get(rename.name, start_of(own, rename.name))
        return (value - rename.offset) / rename.factor if rename.mapped else value

    def input_name(self, own: str) -> str:
        """What scenarios call an input: the role's name, where it is renamed."""
        return next((n for n, r in self.renames.items() if r.name == own and n in self.inputs), own)

    def converted(self, name: str, value: float) -> tuple[str, float]:
        """The component's own name and value of a variable, from the role's name and SI value."""
        rename = self.renames.get(name, Rename(name))
        if not rename.mapped:
            return name, value
        variable = self.parameters.get(rename.name) or self.inputs[rename.name]
        converted = rename.factor * value + rename.offset
        return rename.name, converted if variable.type is Type.REAL else float(round(converted))


def interfaces_of_system(system: System) -> dict[str, Interface]:
    """The interfaces of a system of ours, by component."""
    return {
        name: Interface(
            block.title(),
            dict(flatten(block.group("parameter"))),
            dict(flatten(block.group("input"))),
            f"{name} {block.title()}",
            name in ("plant", "controller") and block.title() != DEFAULTS[name],
            outputs=dict(flatten(block.group("output"))),
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
    """The interface that an FMU declares.

    Args:
        role: the role of its component, if it is one of ours.
        fit: how it fits that role; None if it was not swapped in.
        misfits: as in `Interface`.
    """
    parameters = {n: _variable(fmu, q) for n, q in fmu.parameters.items()}
    inputs = {n: _variable(fmu, q) for n, q in fmu.inputs.items()}
    outputs = {n: _variable(fmu, q) for n, q in fmu.outputs.items()}
    renames: dict[str, Rename] = {}
    if role is not None and fit is not None:
        renames = {n: r for n, r in {**fit.inputs, **fit.parameters}.items() if r.mapped}
        parameters |= {n: role.parameters[n] for n in fit.parameters if n in renames}
        inputs |= {n: role.inputs[n] for n in fit.inputs if n in renames}
        mapped = {rename.name for rename in fit.outputs.values()}
        outputs = {n: v for n, v in outputs.items() if n not in mapped}
        outputs |= {n: role.needs[n] for n in fit.outputs}
    label = f"{name} {fmu.path.name}"
    return Interface(fmu.model, parameters, inputs, label, fit is not None, renames, misfits or {}, outputs)


def _variable(fmu: FmuDescription, quantity: Quantity) -> Variable:
    variable = Variable(quantity.type, quantity.meaning)
    variable.name, variable.unit = quantity.name, quantity.unit or ""
    variable.min, variable.max = quantity.limits
    variable.start = (quantity.start or 0.0,)
    return variable


@dataclass(frozen=True)
class Plan:
    """A scenario resolved against a system.

    Attributes:
        values: start values (SI) of parameters and free inputs, by component and flat name.
        events: changes of inputs.
        notes: parameters that a foreign component lacks, for the user to read.
    """

    values: dict[str, dict[str, float]]
    events: tuple[Event, ...]
    notes: tuple[str, ...]


def plan(
    scenario: Scenario,
    interfaces: Mapping[str, Interface],
    bound: Mapping[str, Mapping[str, float]] | None = None,
    connected: Mapping[str, Collection[str]] | None = None,
    varied: Collection[str] = (),
) -> Plan:
    """Resolve a scenario against the interfaces of a system's components.

    Args:
        bound: values that the package binds; they win over the reading and the mission.
        connected: inputs that have a source, by component.
        varied: `component.parameter` of those whose values a sweep sets later; the caller checks their pairs.

    Raises:
        ScenarioError: an unknown component, block, parameter or input, a wrong type, a value out of range, or
            a window or a point of which half is set.
    """
    return _Planner(scenario, interfaces, bound or {}, connected or {}).plan(varied)


class _Planner:
    def __init__(
        self,
        scenario: Scenario,
        interfaces: Mapping[str, Interface],
        bound: Mapping[str, Mapping[str, float]],
        connected: Mapping[str, Collection[str]],
    ) -> None:
        self.scenario, self.interfaces = scenario, interfaces
        self.bound, self.connected = bound, connected
        self.values: dict[str, dict[str, float]] = {name: {} for name in interfaces}
        self.notes: list[str] = []
        self.kept: dict[str, list[str]] = {}  # by component, what the package binds to another value

    def plan(self, varied: Collection[str]) -> Plan:
        for address, value in READINGS[self.reading].items():
            block, _, name = address.partition(".")
            for component, interface in self.interfaces.items():
                if interface.block == block and name in interface.parameters:
                    self.note_own_start(interface, name, float(value))
                    self.put(component, name, float(value))
        for component, values in self.mission.items():
            self.give(component, values)
        self.take_sets()
        addresses: dict[tuple[str, str], str] = {}
        for address, written in self.scenario.parameters.items():
            if address in self.owners:
                continue
            where = f"{self.scenario.name}: {address}"
            for component, name in self.find(address, "parameters", where):
                own = self.interfaces[component].converted(name, 0.0)[0]
                other = addresses.setdefault((component, own), address)
                if other != address:
                    raise ScenarioError(f"{where}: {other} is the same parameter; set it once")
                known = self.interfaces[component].parameters
                for flat, value in _converted(name, written, known, where).items():
                    self.values[component] |= [self.interfaces[component].converted(flat, value)]
        events = tuple(self.events())
        self.notes += [
            f"{self.interfaces[component].label}: the package binds {_bases(names)}; the scenario's not set"
            for component, kept in self.kept.items()
            if (names := [name for name in kept if not self.sets(component, name)])
        ]
        self.check_pairs(varied)
        self.notes += idle_notes(self.scenario, self.interfaces, self.all_values, varied)
        return Plan(self.values, events, tuple(self.notes))

    @cached_property
    def owners(self) -> set[str]:
        """What an address may begin with: the names of the components and of what is in their places."""
        return {name for c, interface in self.interfaces.items() for name in (c, *interface.names)}

    def take_sets(self) -> None:
        """Set the parameters of whole components by the names of sets; a parameter by its own name wins."""
        addresses: dict[str, str] = {}
        for address, written in self.scenario.parameters.items():
            for component, interface in self.interfaces.items():
                if address not in (component, *interface.names):
                    continue
                where = f"{self.scenario.name}: {address}"
                if not isinstance(written, str):
                    raise ScenarioError(f"{where} is {toml_of(written)}; expected the name of a set")
                if (other := addresses.setdefault(component, address)) != address:
                    raise ScenarioError(f"{where}: {other} is the same component; choose one set for it")
                try:
                    values = find_set(component, written, interface.parameters)
                except UsageError as reason:
                    raise ScenarioError(f"{where}: {reason}") from None
                for name, value in values.items():
                    self.values[component] |= [interface.converted(name, value)]

    def sets(self, component: str, name: str) -> bool:
        """Does the plan set the parameter, over what the package binds?"""
        return self.interfaces[component].converted(name, 0.0)[0] in self.values[component]

    @property
    def reading(self) -> str:
        """The reading of the scenario."""
        return self.scenario.reading or READING

    @property
    def all_values(self) -> dict[str, dict[str, float]]:
        """The values of the plan over those of the package, by component."""
        return {name: {**self.bound.get(name, {}), **values} for name, values in self.values.items()}

    def check_pairs(self, varied: Collection[str]) -> None:
        """Refuse windows and points of which half is set."""
        for component, values in self.all_values.items():
            block, where = self.interfaces[component].block, self.scenario.name
            later = {name.partition(".")[2] for name in varied if name.partition(".")[0] == component}
            check_windows(block, values, where, later)
            check_points(block, {*values, *later}, where)

    def note_own_start(self, interface: Interface, name: str, value: float) -> None:
        """Note that the reading replaces a value with which an FMU of another's starts."""
        block = next((b for b in BLOCKS if b.title() == interface.block), None)
        own = start_of(interface.parameters[name], name)
        if block is not None and own not in (value, dict(flatten(block.group("parameter")))[name].start[0]):
            self.notes.append(
                f'{interface.label}: {name} is {own:.6g}; the reading "{self.reading}" sets it to {value:.6g}'
            )

    @cached_property
    def mission(self) -> dict[str, dict[str, float]]:
        """The parameters (SI) that the scenario's own keys state, by role: seed, start, waypoints, ..."""
        scenario = self.scenario
        north, east, heading = scenario.start
        spread = start_heading_deviation(self.reading, len(scenario.waypoints))
        controller: dict[str, float] = {"home_north": north, "home_east": east}
        for name, places in (("waypoint", scenario.waypoints), ("fence", scenario.fence)):
            if places:
                controller[f"{name}_count"] = len(places)
            for i, (place_north, place_east) in enumerate(places, start=1):
                controller |= {f"{name}_north[{i}]": place_north, f"{name}_east[{i}]": place_east}
        return {
            "plant": {
                "seed": scenario.seed,
                "start_north": north,
                "start_east": east,
                "start_heading": math.radians(heading),
                "start_heading_deviation": spread,
                **ground_values(scenario),
            },
            "sensors": {"seed": scenario.seed},
            "controller": controller,
        }

    def give(self, role: str, values: Mapping[str, float]) -> None:
        """Set those parameters that the component of a role has, and note the others."""
        interface = self.interfaces.get(role)
        lacking = [name for name in values if interface is None or name not in interface.parameters]
        names = _bases(lacking)
        if interface is None:
            if self.scenario.package is not None:
                self.notes.append(f"{self.scenario.system}: has no component {role}; {names} not set")
            return
        if role == "controller" and "start" in interface.inputs:
            self.put(role, "start", 1.0)  # the trial is on from the first tick
        for name in values:
            if name in interface.parameters:
                self.put(role, name, values[name])
        if lacking:
            alone = "; it runs as if there were none of them" if set(lacking) & set(COUNTS) else ""
            self.notes.append(f"{interface.label}: has no parameter {names}; not set{alone}")

    def put(self, component: str, name: str, value: float) -> None:
        """Set a parameter or free input (SI), unless the package binds or connects it."""
        interface = self.interfaces[component]
        own, converted = interface.converted(name, value)
        bound = self.bound.get(component, {})
        count = f"{own.partition('_')[0]}_count"  # waypoints and corners belong to their number
        if own in bound or count in bound:
            if bound.get(own) != converted:
                self.kept.setdefault(component, []).append(name)
            return
        if own in self.connected.get(component, ()):
            return
        if name in interface.misfits:
            raise ScenarioError(f"{self.scenario.name}: {interface.misfits[name]}")
        self.values[component][own] = converted

    def find(self, address: str, kind: str, where: str) -> list[tuple[str, str]]:
        """The components that an address means, by their name or their block's, with the variable's name."""
        owners = {n: {n, *interface.names} for n, interface in self.interfaces.items()}
        owner, name = split_address(address, owners)
        components = [n for n, names in owners.items() if owner in names]
        if not components and (foreign := self.replaced(owner)):
            self.notes.append(f"{address}: not set, since {foreign} takes the place of {owner}")
            return []
        if not components:
            hint = self.of_others(owner) or self.elsewhere(name or owner, kind)
            hint = hint or nearest(owner, set().union(*owners.values()))
            raise ScenarioError(f'{where}: no block or component "{owner}"{hint}')
        for component in components:
            known: Mapping[str, Variable] = getattr(self.interfaces[component], kind)
            if name in known or f"{name}[1]" in known:
                continue
            label, base = self.interfaces[component].label, name.partition("[")[0]
            size = sum(n.startswith(f"{base}[") for n in known)
            if size and base:
                raise ScenarioError(
                    f"{where}: {label} has no element {name[len(base) :]} of {base}; "
                    f"expected {base}[1] to {base}[{size}]"
                )
            bases = {n.partition("[")[0] for n in known}
            hint = self.elsewhere(name, kind) or nearest(name, bases)
            raise ScenarioError(f'{where}: {label} has no {kind[:-1]} "{name}"{hint}')
        return [(component, name) for component in components]

    def of_others(self, owner: str) -> str:
        """A hint at the estimator in force, where the address is of another; "" if it is of none."""
        there = self.interfaces.get("estimator")
        if owner not in ESTIMATORS or there is None:
            return ""
        return f'; the estimator is {there.block}: set "{there.block}.name", or run with --estimator {owner}'

    def elsewhere(self, name: str, kind: str) -> str:
        """A hint at the block that has a variable of this name; "" if none has it, or several have."""
        having = [i.block for i in self.interfaces.values() if name in getattr(i, kind)]
        return f'; did you mean "{having[0]}.{name}"?' if len(having) == 1 else ""

    def replaced(self, block: str) -> str:
        """The foreign component in the place of this block of ours; "" if there is none."""
        for system in SYSTEMS.values():
            for role, own in system.components.items():
                if own.title() == block and role in self.interfaces and self.interfaces[role].foreign:
                    return self.interfaces[role].label
        return ""

    def events(self) -> Iterable[Event]:
        """The changes of inputs. The entry that started last holds; of several, the one listed last."""
        entries: dict[tuple[str, str], list[tuple[float, float, float]]] = {}
        silences = [
            (f"[[fault]] {LOST} radio", Setting("controller.link_ok", False, f.at, f.until))
            for f in self.scenario.faults
            if f.kind == LOST
        ]
        sets = [(f"[[set]] {setting.variable}", setting) for setting in self.scenario.sets]
        for origin, setting in (*sets, *silences):
            where = f"{self.scenario.name}: {origin}"
            until = math.inf if setting.until is None else setting.until
            for component, name in self.find(setting.variable, "inputs", where):
                interface = self.interfaces[component]
                for flat, value in _converted(name, setting.value, interface.inputs, where).items():
                    own, converted = interface.converted(flat, value)
                    entries.setdefault((component, own), []).append((setting.at, until, converted))
        for (component, own), spans in entries.items():
            values = {**self.bound.get(component, {}), **self.values[component]}
            unset = values.get(own, start_of(self.interfaces[component].inputs[own], own))
            for time in sorted({t for at, until, _ in spans for t in (at, until)} - {math.inf}):
                active = [(at, i) for i, (at, until, _) in enumerate(spans) if at <= time < until]
                yield Event(time, component, own, spans[max(active)[1]][2] if active else unset)


def ground_values(scenario: Scenario) -> dict[str, float]:
    """The parameters of the plant (SI) that a scenario's streets and poles state, none without them."""
    values: dict[str, float] = {}
    if scenario.streets:
        values["street_count"] = len(scenario.streets)
    for i, street in enumerate(scenario.streets, start=1):
        values |= {f"street_north[{i}]": street.start[0], f"street_east[{i}]": street.start[1]}
        values |= {f"street_end_north[{i}]": street.end[0], f"street_end_east[{i}]": street.end[1]}
        values[f"street_half_width[{i}]"] = street.half_width
    if scenario.poles:
        values["pole_count"] = len(scenario.poles)
    for i, (north, east) in enumerate(scenario.poles, start=1):
        values |= {f"pole_north[{i}]": north, f"pole_east[{i}]": east}
    return values


def address_of(link: Link, interfaces: Mapping[str, Interface]) -> str:
    """A link as scenarios name it, by the roles' names of its variables."""
    target = interfaces.get(link.target)
    end = target.input_name(link.target_variable) if target else link.target_variable
    return f"{link.source}.{link.signal} -> {link.target}.{end}"


def split_address(address: str, components: Iterable[str]) -> tuple[str, str]:
    """Component and variable of an address; a nested component's name has dots: `sub.plant.speed`."""
    nested = [name for name in components if "." in name and address.startswith(f"{name}.")]
    owner = max(nested, key=len, default=address.partition(".")[0])
    return owner, address[len(owner) + 1 :]


def _bases(names: Iterable[str]) -> str:
    """Flat names as a list, each vector once."""
    return ", ".join(dict.fromkeys(name.partition("[")[0] for name in names))


def _converted(name: str, written: Written, known: Mapping[str, Variable], where: str) -> dict[str, float]:
    """Flat names and SI values of a scalar's written value, or of a vector's first elements."""
    if name in known:
        return {name: si_value(written, known[name], where)}
    if not isinstance(written, list):
        raise ScenarioError(f"{where} is a vector; expected a list, or one element by name: {name}[1]")
    size = sum(flat.partition("[")[0] == name for flat in known)
    if len(written) > size:
        raise ScenarioError(f"{where} has {len(written)} elements; expected up to {size}")
    flat_names = [f"{name}[{i}]" for i in range(1, len(written) + 1)]
    return {
        n: si_value(value, known[n], f"{where}[{i}]")
        for i, (n, value) in enumerate(zip(flat_names, written, strict=True), start=1)
    }


def si_value(written: Written, variable: Variable, where: str) -> float:
    """The SI value of what a user wrote.

    Raises:
        ScenarioError: naming `where`, the value and what was expected.
    """
    value: float | None = None
    if variable.choices is not None and isinstance(written, str):
        named = {choice.name: float(choice) for choice in variable.choices}
        value = named.get(written.upper())
    elif isinstance(written, bool):
        value = float(written) if variable.type is Type.BOOLEAN else None
    elif (
        isinstance(written, int | float)
        and abs(written) <= sys.float_info.max  # no NaN, and no whole number that `float` refuses
        and variable.type is not Type.BOOLEAN
    ):
        value = float(written)
        if variable.type is Type.INTEGER and value != written:
            raise ScenarioError(
                f"{where} is {written}, which no double holds; expected {_expected(variable)}"
            )
    if value is not None:
        value = math.radians(value) if is_angular(variable) else value
        low = -math.inf if variable.min is None else variable.min
        high = math.inf if variable.max is None else variable.max
        whole = variable.type is Type.REAL or value == int(value)
        if whole and low <= value <= high:
            return value
    raise ScenarioError(f"{where} is {toml_of(written)}; expected {_expected(variable)}")


def _expected(variable: Variable) -> str:
    if not is_angular(variable):
        return variable.expected()
    words = "a number"
    if variable.min is not None:
        words += f" from {_inward(math.degrees(variable.min), math.ceil)}"
    if variable.max is not None:
        words += f" up to {_inward(math.degrees(variable.max), math.floor)}"
    return f"{words} {stated_unit(variable.unit)}"


def _inward(limit: float, rounded: Callable[[float], int]) -> str:
    """A limit to a tenth of a degree, within the range."""
    return f"{rounded(round(limit * 10, 6)) / 10:g}"


def values_of(
    interfaces: Mapping[str, Interface], values: Mapping[str, Mapping[str, float]]
) -> dict[str, str]:
    """Every parameter of every component for the log: `component.name` to its value (SI)."""
    return {
        f"{component}.{name}": repr(float(interface.start(name, values.get(component, {}))))
        for component, interface in interfaces.items()
        for name in interface.parameters
    }


def start_of(variable: Variable, name: str) -> float:
    """The start value of a scalar; `name[3]` starts with the third value of its vector."""
    is_element = len(variable.start) > 1
    return variable.start[int(name[name.index("[") + 1 : -1]) - 1 if is_element else 0]
