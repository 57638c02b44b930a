"""Whether a foreign FMU fits a role, and how it takes the role's place in a system.

It fits if it gives the outputs that other components consume, by name or through a mapping file (TOML):

    [outputs]
    north = "x"                                              # the role's name = the FMU's
    speed = { name = "v", factor = 0.2777777777777778 }      # m/s = factor * km/h + offset
    [inputs]
    command = "cmd"                                          # the FMU's = factor * the role's + offset
    [parameters]                                             # those that a scenario states by its own keys
    start_heading = { name = "psi0", factor = 57.29577951308232 }    # deg = factor * rad

`dog.toml` beside `dog.fmu` is its mapping file. Units are never converted without it; an output that
declares no unit is taken to have the role's. The FMU may lack inputs of the role.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from harness.cosim.fmu import BASE, FmuDescription, Quantity, Unit
from harness.cosim.rename import Rename
from harness.cosim.ssp import FmuComponent, FmuSystem, ScaledLink, StartValue
from harness.toml_file import TomlError, parse_toml, read_toml
from models.errors import CanineError, UsageError, nearest
from models.kit.declaration import Input, Output, Parameter, Type, Variable, flatten
from models.kit.units import UNITS
from models.sensors import Sensors
from models.system import SYSTEMS

OPTIONAL = {"plant": frozenset({"acceleration", "pitch", "roll", "yaw_rate", "slip", "slip_acceleration"})}
# parameters that a scenario sets by keys of its own: seed, waypoints, start, fence
MISSION = {
    "plant": frozenset({"seed", "start_north", "start_east", "start_heading", "start_heading_deviation"}),
    "sensors": frozenset({"seed"}),
    "controller": frozenset(
        {
            *("waypoint_count", "waypoint_north", "waypoint_east", "home_north", "home_east"),
            *("fence_count", "fence_north", "fence_east"),
        }
    ),
}


TOLERANCE = 1e-3  # of a mapping's factor, as people round it


class RoleError(CanineError):
    """An FMU does not fit a role, or a mapping file is wrong: one line for each problem."""


@dataclass(frozen=True)
class Role:
    """What a role is: outputs that others consume, those of them that may be absent, inputs, parameters.

    Attributes:
        inputs: what it may take; an estimator all that the sensors give.
        usual: the inputs that our block has.
        parameters: those that a scenario sets by keys of its own.
        block: our block's name, and `own` all its parameters: an FMU that bears the name has to mean them.
    """

    name: str
    needs: Mapping[str, Variable]
    optional: frozenset[str]
    inputs: Mapping[str, Variable]
    usual: frozenset[str]
    parameters: Mapping[str, Variable]
    block: str
    own: Mapping[str, Variable]


@dataclass(frozen=True)
class Adapter:
    """A mapping file: for names of the role, what the FMU has."""

    path: Path
    outputs: Mapping[str, Rename] = field(default_factory=dict)
    inputs: Mapping[str, Rename] = field(default_factory=dict)
    parameters: Mapping[str, Rename] = field(default_factory=dict)


@dataclass(frozen=True)
class Fit:
    """How an FMU fits a role: what stands for what, what is wrong, and notes for the user."""

    outputs: Mapping[str, Rename]
    inputs: Mapping[str, Rename]
    parameters: Mapping[str, Rename]
    problems: tuple[str, ...]
    notes: tuple[str, ...]


def roles() -> dict[str, Role]:
    """The roles of the full system, by name."""
    system = SYSTEMS["full"]
    by_name = {}
    for name, block in system.components.items():
        parameters = dict(flatten(list(block.variables(Parameter).values())))
        mission = MISSION.get(name, frozenset())
        consumed = {link.source_variable for link in system.links if link.source == name}
        inputs = dict(flatten(list(block.variables(Input).values())))
        offered = _SENSED if name == "estimator" else {}
        by_name[name] = Role(
            name,
            {n: v for n, v in flatten(list(block.variables(Output).values())) if v.name in consumed},
            OPTIONAL.get(name, frozenset()),
            {**offered, **inputs},
            frozenset(inputs),
            {n: v for n, v in parameters.items() if v.name in mission},
            block.title(),
            parameters,
        )
    return by_name


def find_role(name: str) -> Role:
    """The role of this name.

    Raises:
        UsageError: there is none.
    """
    known = roles()
    if name not in known:
        raise UsageError(f'there is no role "{name}"{nearest(name, known)}')
    return known[name]


def read_adapter(fmu: Path, role: Role) -> Adapter:
    """The mapping file beside an FMU (empty if there is none), with its names checked against the role.

    Raises:
        RoleError: no TOML, an unknown key, or a wrong type.
    """
    path = fmu.with_suffix(".toml")
    if not path.is_file():
        return Adapter(path)
    try:
        table = parse_toml(read_toml(path))
    except TomlError as reason:
        raise RoleError(f"{path.name}: {reason}") from None
    except OSError as reason:
        raise RoleError(f"{path.name}: cannot be read ({reason.strerror})") from None
    known: dict[str, Iterable[str]] = {
        "outputs": role.needs,
        "inputs": role.inputs,
        "parameters": role.parameters,
    }
    for key, value in table.items():
        if key not in known or not isinstance(value, dict):
            raise RoleError(
                f'{path.name}: unknown key "{key}"; expected the tables [outputs], [inputs], [parameters]'
            )
        for name in value:
            if name not in known[key]:
                raise RoleError(
                    f'{path.name}: [{key}] the {role.name} role has no "{name}"{nearest(name, known[key])}'
                )
    groups = ({n: _rename(path, n, v) for n, v in table.get(key, {}).items()} for key in known)
    return Adapter(path, *groups)


def _rename(path: Path, name: str, value: Any) -> Rename:
    if isinstance(value, str):
        return Rename(value, mapped=True)
    if isinstance(value, dict) and isinstance(value.get("name", name), str) and value:
        numbers = {key: value[key] for key in value.keys() - {"name"}}
        good = all(
            isinstance(x, int | float) and not isinstance(x, bool) and abs(x) <= sys.float_info.max
            for x in numbers.values()
        )
        if good and numbers.keys() <= {"factor", "offset"} and numbers.get("factor", 1) != 0:
            factor, offset = float(numbers.get("factor", 1.0)), float(numbers.get("offset", 0.0))
            return Rename(value.get("name", name), factor, offset, mapped=True)
    raise RoleError(
        f'{path.name}: "{name}" is {value}; '
        'expected a name, or { name = "...", factor = 1.0, offset = 0.0 } with finite numbers, factor not 0'
    )


def fit(fmu: FmuDescription, role: Role, adapter: Adapter, consumed: Iterable[str] | None = None) -> Fit:
    """Check an FMU against a role.

    Args:
        consumed: the role's outputs that the system at hand consumes; by default what the full system does.
    """
    checker = _Checker(fmu, role, adapter)
    needs = role.needs if consumed is None else {n: v for n, v in role.needs.items() if n in set(consumed)}
    outputs = {name: rename for name, v in needs.items() if (rename := checker.output(name, v))}
    inputs = {name: rename for name, v in role.inputs.items() if (rename := checker.input(name, v))}
    parameters, wrong = _parameters(checker)
    checker.problems += wrong.values()
    absent = [name for name in needs if name in role.optional and name not in outputs]
    ignored = [name for name in role.inputs if name in role.usual and name not in inputs]
    if absent and not checker.problems:
        checker.note(f"has no output {', '.join(absent)}; taken as zero")
    if ignored and not checker.problems:
        checker.note(f"has no input {', '.join(ignored)}; does not receive the role's values of it")
    for what, names in (("output", outputs), ("parameter", parameters)):
        for shared, own in _shared(names).items():
            checker.note(
                f'{" and ".join(own)} are {"both" if len(own) == 2 else "all"} its {what} "{shared}"'
            )
    if role.name == "plant" and fmu.feedthrough and not checker.problems:
        checker.note(
            "says that its outputs depend on its inputs within a step; it is stepped last all the same"
        )
    return Fit(outputs, inputs, parameters, tuple(checker.problems), tuple(checker.notes))


def _shared(renames: Mapping[str, Rename]) -> dict[str, list[str]]:
    """The FMU's variables that stand for several of a role's, with those."""
    stands_for: dict[str, list[str]] = {}
    for own, rename in renames.items():
        stands_for.setdefault(rename.name, []).append(own)
    return {name: several for name, several in stands_for.items() if len(several) > 1}


def misfits(fmu: FmuDescription, role: Role) -> dict[str, str]:
    """What is wrong with the parameters that a package's FMU has by the role's names, by name."""
    return _parameters(_Checker(fmu, role, Adapter(fmu.path), "give it a value in the package"))[1]


def _parameters(checker: _Checker) -> tuple[dict[str, Rename], dict[str, str]]:
    """The role's parameters that the FMU has, and what is wrong with the others that it has."""
    fmu, role = checker.fmu, checker.role
    known = {**role.own, **role.parameters} if fmu.model == role.block else role.parameters
    renames, wrong = {}, {}
    for name, declared in known.items():
        checking = _Checker(fmu, role, checker.adapter, checker.cure)
        if rename := checking.parameter(name, declared):
            renames[name] = rename
            checker.notes += checking.notes
        elif checking.problems:
            wrong[name] = checking.problems[0]
    return renames, wrong


class _Checker:
    def __init__(self, fmu: FmuDescription, role: Role, adapter: Adapter, cure: str = "") -> None:
        self.fmu, self.role, self.adapter = fmu, role, adapter
        self.cure = cure
        self.problems: list[str] = []
        self.notes: list[str] = []

    def wrong(self, text: str) -> None:
        self.problems.append(f"{self.role.name} {self.fmu.path.name}: {text}")

    def note(self, text: str) -> None:
        self.notes.append(f"{self.role.name} {self.fmu.path.name}: {text}")

    def output(self, name: str, needed: Variable) -> Rename | None:
        rename = self.adapter.outputs.get(name, Rename(name))
        if not rename.mapped and name in self.role.optional and not self._is_there(name):
            return None
        return self._checked("output", rename, needed)

    def input(self, name: str, needed: Variable) -> Rename | None:
        rename = self.adapter.inputs.get(name, Rename(name))
        if not rename.mapped and name not in self.fmu.inputs:
            return None
        return self._checked("input", rename, needed)

    def parameter(self, name: str, declared: Variable) -> Rename | None:
        rename = self.adapter.parameters.get(name, Rename(name))
        if not rename.mapped and name not in self.fmu.parameters:
            return None
        return self._checked("parameter", rename, declared)

    def _is_there(self, name: str) -> bool:
        return name in self.fmu.quantities or name in self.fmu.refused

    def _checked(self, kind: str, rename: Rename, needed: Variable) -> Rename | None:
        """The rename if the FMU's variable of that name serves; else None, with the problem noted."""
        if problem := self._problem(kind, rename, needed):
            self.wrong(problem)
            return None
        quantity = self.fmu.quantities[rename.name]
        return rename if self._unit_fits(kind, quantity, rename, needed) else None

    def _problem(self, kind: str, rename: Rename, needed: Variable) -> str:
        toml, need = self.adapter.path.name, f"the {self.role.name} role needs"
        quantity = self.fmu.quantities.get(rename.name)
        if rename.name in self.fmu.refused:
            return f'{kind} "{rename.name}" {self.fmu.refused[rename.name].reason}'
        if quantity is None:
            hint = _near(rename.name, self.fmu.group(kind))
            if rename.mapped:
                return f'has no {kind} "{rename.name}", which {toml} names{hint}'
            what = f"{needed.type.value}, {needed.unit}" if needed.unit else needed.type.value
            return (
                f'has no {kind} "{rename.name}" ({what}), which {need}{hint}; map it in {toml} or export it'
            )
        if self.fmu.group(*_CAUSALITIES.get(kind, (kind,))).get(rename.name) is None:
            return f'"{rename.name}" has causality {quantity.causality}; {need} {kind}, export it as such'
        whole_as_real = kind == "parameter" and (quantity.type, needed.type) == (
            Type.REAL,
            Type.INTEGER,
        )  # a seed, say: nothing is lost
        if quantity.type is not needed.type and not whole_as_real:
            return (
                f'{kind} "{rename.name}" is {quantity.type.value}, {need} {needed.type.value}; '
                f"export it as {needed.type.value}"
            )
        return ""

    def _unit_fits(self, kind: str, quantity: Quantity, rename: Rename, needed: Variable) -> bool:
        unit = self.fmu.unit(quantity)
        if unit is None or not needed.unit:
            return True
        ours = Unit(needed.unit, tuple(UNITS[needed.unit].get(name, 0) for name in BASE))
        got = (
            f'{kind} "{quantity.name}" has unit "{unit.name}", the {self.role.name} role needs "{ours.name}"'
        )
        if not unit.measures(ours):
            self.wrong(f"{got}; no factor makes one of the other")
            return False
        # outputs are converted to the role's unit, all else to the FMU's
        factor, offset = unit.factor, unit.offset
        if kind != "output":
            factor, offset = 1 / unit.factor, -unit.offset / unit.factor
        if (rename.factor, rename.offset) != (1.0, 0.0) or unit.equals(ours):
            # a sign or an offset may be meant: another way round, another zero
            if unit.base is not None and not math.isclose(abs(rename.factor), factor, rel_tol=TOLERANCE):
                ends = (unit.name, ours.name) if kind == "output" else (ours.name, unit.name)
                self.note(
                    f'{kind} "{quantity.name}" is mapped with factor {rename.factor:g}; '
                    f'from "{ends[0]}" to "{ends[1]}" it is {factor:g}'
                )
            return True
        conversion = f"factor = {factor!r}" + (f", offset = {offset!r}" if offset else "")
        cure = self.cure or f"map it in {self.adapter.path.name}" + f" ({conversion})" * (
            unit.base is not None
        )
        self.wrong(f"{got}; {cure} or export it in {ours.name}")
        return False


_CAUSALITIES = {"parameter": ("parameter", "structuralParameter")}


def _near(name: str, known: Iterable[str]) -> str:
    hint = nearest(name, known)
    return hint if "did you mean" in hint else ""


def replace_component(
    system: FmuSystem,
    role_name: str,
    fmu: FmuDescription,
    adapter: Adapter,
    sources: Mapping[str, str] | None = None,
) -> tuple[FmuSystem, Fit]:
    """The system with an FMU in a role's place, and how it fits.

    Args:
        sources: the components that give what the FMU may take, by the role's name of the input; what the
            system does not link to the role yet is linked from there.

    Raises:
        RoleError: the FMU does not fit, or the system has a link of the role that no other FMU can have.
        UsageError: the system has no such component.
    """
    if role_name not in system.components:
        hint = nearest(role_name, system.components)
        raise UsageError(f'system "{system.name}" has no component "{role_name}"{hint}')
    consumed = {link.source_variable for link in system.links if link.source == role_name}
    fitted = fit(fmu, find_role(role_name), adapter, consumed)
    if fitted.problems:
        raise RoleError("\n".join(fitted.problems))
    components = dict(system.components)
    components[role_name] = FmuComponent(role_name, fmu.path)
    links, untold = [], []
    for link in system.links:
        _check_swap(link, role_name)
        source = fitted.outputs.get(link.source_variable) if link.source == role_name else _AS_IT_IS
        target = fitted.inputs.get(link.target_variable) if link.target == role_name else _AS_IT_IS
        if source is not None and target is not None:
            links.append(_adapted(link, source, target))
        elif target is not None:  # an optional output that the FMU lacks
            part = components[link.target]
            components[link.target] = replace(
                part, values=part.values | {link.target_variable: StartValue(0.0)}
            )
        elif link.target_variable not in find_role(role_name).inputs:
            untold.append(link.target_variable)
    if untold:
        note = f"{role_name} {fmu.path.name}: does not receive {', '.join(untold)}, which the package gives"
        fitted = replace(fitted, notes=(*fitted.notes, note))
    linked = {link.target_variable for link in system.links if link.target == role_name}
    for name, source_component in (sources or {}).items():
        if name in fitted.inputs and name not in linked:
            link = ScaledLink(source_component, name, role_name, name)
            links.append(_adapted(link, _AS_IT_IS, fitted.inputs[name]))
    return replace(system, components=components, links=tuple(links)), fitted


def _check_swap(link: ScaledLink, role_name: str) -> None:
    """Refuse what a package states of the FMU that it has in a role, and what no other can be asked for."""
    if role_name not in (link.source, link.target):
        return
    if link.settled and link.converts:
        raise RoleError(
            f"link {link}: the package converts ({link.conversion}) what its own {role_name} gives or takes, "
            f"and nobody knows whether that suits another; leave --{role_name} out, or the conversion"
        )
    role = find_role(role_name)
    if link.source == role_name and link.source_variable not in role.needs:
        raise RoleError(
            f'link {link}: the {role_name} role has no output "{link.source_variable}"'
            f"{nearest(link.source_variable, role.needs)}; an FMU takes the place of one that gives the "
            "role's outputs alone"
        )


_AS_IT_IS = Rename("")
_SENSED = dict(flatten(Sensors.group("output")))


def _adapted(link: ScaledLink, source: Rename, target: Rename) -> ScaledLink:
    """The link by the FMU's names: the source's conversion, the link's own, then the target's."""
    name = source.name or link.source_variable
    factor = target.factor * link.factor * source.factor
    offset = target.factor * (link.factor * source.offset + link.offset) + target.offset
    return replace(
        link,
        source_variable=name,
        target_variable=target.name or link.target_variable,
        factor=factor,
        offset=offset,
        settled=False,
        output="" if name == link.signal else link.signal,
    )
