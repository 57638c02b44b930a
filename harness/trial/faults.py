"""Faults that a scenario states: of signals, resolved to blocks in a system's links; of bytes; of components.

A lost radio is no signal's fault: `plan` takes `controller.link_ok` away, as `[[set]]` does.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from harness.cosim.rename import Rename
from harness.cosim.stepping import Ticks, first_tick
from harness.onboard.garbage import STREAMS, Garbage
from harness.trial.plan import Interface, address_of, split_address
from harness.trial.scenario import (
    ARROW,
    FAULT_KINDS,
    FAULTS,
    GARBAGE,
    LOST,
    STALL,
    Disturbance,
    Scenario,
    ScenarioError,
)
from harness.trial.units import is_angular
from models.disturbance import FAULTS as BLOCKS
from models.disturbance import LONGEST_DELAY, MAX_FAULTS, FaultyLink, Kind, Placed
from models.errors import nearest
from models.kit.declaration import Type, Variable
from models.kit.geometry import COUNT_MAX
from models.kit.link import Link

WHOLE = (-(2**31), 2**31 - 1)  # what the block of an Integer's fault holds


@dataclass(frozen=True)
class Faults:
    """The faults in a system.

    Attributes:
        links: where those of signals act.
        values: of their blocks' parameters, one mapping for each fault.
        garbage: of the bytes that the firmware on board receives.
        stalls: when components are not stepped.
    """

    links: tuple[FaultyLink, ...] = ()
    values: tuple[Mapping[str, float], ...] = ()
    garbage: tuple[Garbage, ...] = ()
    stalls: Mapping[str, tuple[Ticks, ...]] = field(default_factory=dict)

    def values_of(self, placed: Mapping[str, Placed]) -> dict[str, dict[str, float]]:
        """The parameters of the blocks, by component."""
        return {name: dict(self.values[place.fault]) for name, place in placed.items()}


def resolve_faults(
    scenario: Scenario,
    interfaces: Mapping[str, Interface],
    links: Sequence[Link],
    step: float,
    *,
    renames: Mapping[str, Mapping[str, Rename]] | None = None,
    inside: Collection[str] = (),
) -> Faults:
    """Resolve a scenario's faults against a system.

    Args:
        step: of the system, s.
        renames: of swapped components' outputs, by component and the role's name.
        inside: components of the firmware on board: what links them, and the sensors with them, lies in it.

    Raises:
        ScenarioError: there is no such signal, link or component, the kind does not fit the signal, or a
            value is out of its range.
    """
    resolver = _Resolver(interfaces, links, step, renames or {}, inside)
    placed: list[tuple[FaultyLink, dict[str, float]]] = []
    garbage: list[Garbage] = []
    stalls: dict[str, tuple[Ticks, ...]] = {}
    for number, fault in enumerate(scenario.faults, start=1):
        where = f"{scenario.name}: [[fault]] {number}"
        if fault.kind == LOST:
            if fault.signal != "radio":
                raise ScenarioError(f'{where}: signal is "{fault.signal}"; what is lost is the "radio"')
            continue
        if fault.kind == GARBAGE:
            _check_stream(fault, where, is_onboard=bool(inside))
            first, after = _window(fault, step)
            share = fault.value or 0.0
            garbage.append(Garbage(fault.signal, share, first, after, scenario.seed, number))
            continue
        if fault.kind == STALL:
            resolver.check_component(fault.signal, where)
            stalls[fault.signal] = (*stalls.get(fault.signal, ()), _window(fault, step))
            continue
        link, values = resolver.resolve(fault, where)
        placed.append((link, values | {"seed": float(scenario.seed), "number": float(len(placed))}))
    if len(placed) > MAX_FAULTS:
        raise ScenarioError(f"{scenario.name}: has {len(placed)} faults; expected up to {MAX_FAULTS}")
    return Faults(
        tuple(link for link, _ in placed), tuple(values for _, values in placed), tuple(garbage), stalls
    )


def _check_stream(fault: Disturbance, where: str, *, is_onboard: bool) -> None:
    """Refuse garbage of what is no stream of bytes."""
    if fault.signal not in STREAMS:
        expected = f"one of {', '.join(STREAMS)}{nearest(fault.signal, STREAMS)}"
        raise ScenarioError(f'{where}: signal is "{fault.signal}"; expected {expected}')
    if not is_onboard:
        raise ScenarioError(
            f'{where}: garbage of "{fault.signal}": only firmware on board receives bytes; run with --onboard'
        )


def _window(fault: Disturbance, step: float) -> Ticks:
    """The first tick on which a fault acts, and the first on which it is over."""
    after = int(COUNT_MAX) if fault.until is None else first_tick(fault.until, step)
    return first_tick(fault.at, step), after


@dataclass(frozen=True)
class _Resolver:
    """Finds where faults act; the attributes are those of `resolve_faults`."""

    interfaces: Mapping[str, Interface]
    links: Sequence[Link]
    step: float
    renames: Mapping[str, Mapping[str, Rename]]
    inside: Collection[str]

    def resolve(self, fault: Disturbance, where: str) -> tuple[FaultyLink, dict[str, float]]:
        """Where a fault acts, and the values of its block."""
        output, arrow, end = (part.strip() for part in fault.signal.partition(ARROW))
        component, variable = self.output(output, where)
        if variable.type not in FAULTS[fault.kind].types:
            kinds = ", ".join(kind for kind, what in FAULTS.items() if variable.type in what.types)
            raise ScenarioError(
                f'{where}: kind is "{fault.kind}", and {output} is {variable.type.value}; '
                f"expected one of {kinds}"
            )
        if variable.type is Type.INTEGER and not (
            WHOLE[0] <= (variable.min or 0) <= (variable.max or 0) <= WHOLE[1]
        ):
            raise ScenarioError(
                f"{where}: {output} is {variable.expected()}; a fault is of an Integer from {WHOLE[0]} up to "
                f"{WHOLE[1]}: export it as an Int32, or with such a min and max"
            )
        name = split_address(output, self.interfaces)[1]
        place = whole = FaultyLink(variable.type, component, name)
        if arrow:
            target, input_name = split_address(end, self.interfaces)
            if target in self.interfaces:
                input_name = self.interfaces[target].renames.get(input_name, Rename(input_name)).name
            place = replace(whole, target=target, target_variable=input_name)
        self.check_links(place, whole, where, fault.signal)
        values = self.values(fault, variable, where)
        if "value" in values:
            values["value"] *= self.scale(Kind[fault.kind.upper()], place, where)
        return place, values

    def address(self, link: Link) -> str:
        """A link as a scenario names it."""
        return address_of(link, self.interfaces)

    def output(self, address: str, where: str) -> tuple[str, Variable]:
        """An output's component and variable."""
        component, name = split_address(address, self.interfaces)
        if component not in self.interfaces:
            raise ScenarioError(f'{where}: no component "{component}"{nearest(component, self.interfaces)}')
        interface = self.interfaces[component]
        if name not in interface.outputs:
            hint = nearest(name, interface.outputs)
            named = self.renames.get(component, {}).items()
            if by_role := [f'"{component}.{own}"' for own, rename in named if rename.name == name]:
                hint = f"; as its role calls it: {', '.join(by_role)}"
            if not name:
                example = f'such as "{component}.{next(iter(interface.outputs), "output")}"'
                hint = f'; name one, {example}, or state kind = "{STALL}"'
            if name in interface.inputs:
                hint = "; it is an input: disturb the output that feeds it, or set it by [[set]]"
            raise ScenarioError(f'{where}: {interface.label} has no output "{name}"{hint}')
        return component, interface.outputs[name]

    def check_component(self, name: str, where: str) -> None:
        """Refuse a stall of what is no component, and of one in the firmware."""
        if name not in self.interfaces:
            owner = split_address(name, self.interfaces)[0]
            known = [component for component in self.interfaces if component not in self.inside]
            hint = f'; did you mean "{owner}"?' if owner in known else nearest(name, known)
            raise ScenarioError(f'{where}: signal is "{name}", kind is "{STALL}"; expected a component{hint}')
        if name in self.inside:
            raise ScenarioError(
                f"{where}: {name} is in the firmware on board, which goes on as a whole; "
                "stall the sensors or the plant, or run without --onboard"
            )

    def check_links(self, place: FaultyLink, whole: FaultyLink, where: str, signal: str) -> None:
        """Refuse a fault of no link, and one of a link in the firmware.

        What the sensors give is disturbed before it is sent there.
        """
        links = [link for link in self.links if place.holds(link)]
        others = [link for link in self.links if whole.holds(link)]
        is_sensed = bool(self.inside) and place.source == "sensors"
        if not links and not (is_sensed and place == whole):
            there = (
                f"its links are {', '.join(map(self.address, others))}" if others else "it feeds nothing here"
            )
            raise ScenarioError(f'{where}: there is no link "{signal}"; {there}')
        for link in links:
            if link.target in self.inside and (link.source in self.inside or (is_sensed and place != whole)):
                outside = [self.address(other) for other in others if other.target not in self.inside]
                instead = f"{place.source}.{place.source_variable}" if is_sensed else ", ".join(outside)
                raise ScenarioError(
                    f'{where}: the link "{self.address(link)}" lies in the firmware on board; disturb '
                    f'"{instead or "a signal of the sensors or the plant"}", or run without --onboard'
                )

    def scale(self, kind: Kind, place: FaultyLink, where: str) -> float:
        """What a value in the signal's unit is multiplied by, for a block behind what its links convert."""
        mapping = self.renames.get(place.source, {}).get(place.source_variable, Rename(place.source_variable))
        links = {link: link.factor / mapping.factor for link in self.links if place.holds(link)}
        scales = set(links.values()) or {1.0}
        if kind is Kind.SCALE:
            for link, scale in links.items():
                if not math.isclose(link.offset, scale * mapping.offset, rel_tol=1e-9):
                    raise ScenarioError(
                        f'{where}: the link "{self.address(link)}" adds {link.offset:g} on the way, and a '
                        'scale would act on that too; expected another kind, such as "offset"'
                    )
        if FAULT_KINDS[kind].unit is not None:
            return 1.0
        if len(scales) > 1:
            raise ScenarioError(
                f"{where}: the links of {place.source}.{place.source_variable} convert it differently; "
                f"disturb one: {', '.join(map(self.address, links))}"
            )
        scale = scales.pop()
        return abs(scale) if kind is Kind.NOISE else scale

    def values(self, fault: Disturbance, variable: Variable, where: str) -> dict[str, float]:
        """The values of a fault's block."""
        kind, step = Kind[fault.kind.upper()], self.step
        first, after = _window(fault, step)
        values = {"kind": float(kind), "first": float(first), "after": float(after)}
        if fault.value is None:
            return values
        if kind is Kind.DELAY:
            ticks = round(fault.value / step)
            if not 1 <= ticks <= LONGEST_DELAY:
                expected = f"a delay from {step:g} to {LONGEST_DELAY * step:g} s"
                raise ScenarioError(f"{where}: value is {fault.value:g}; expected {expected}")
            return values | {"delay": float(ticks)}
        is_angle = FAULT_KINDS[kind].unit is None and is_angular(variable)
        return values | {"value": math.radians(fault.value) if is_angle else fault.value}


def fault_fmus(scenario: Scenario, folder: Path) -> list[Path]:
    """The FMUs of the blocks that a scenario's faults need."""
    if not any(FAULTS[fault.kind].types for fault in scenario.faults):
        return []
    return [folder / f"{block.title()}.fmu" for block in BLOCKS.values()]
