"""The check before anything runs: do the links of a system fit, in which order is it stepped, and how often?

A component whose step is fixed may make several in a tick, or one in several ticks; all others make one in
each. Units are never converted silently: both ends must have the same unit (however spelled, if the FMUs
define it), or the link must carry the conversion. An end that declares no unit fits any. The links of a
package have been settled by what it declares (`ssp`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from harness.cosim.fmu import FmuDescription, FmuError, Quantity
from harness.cosim.ssp import FmuSystem, ScaledLink, SspError
from harness.cosim.stepping import Order, Ticks, whole_steps
from models.errors import WiringError
from models.kit.declaration import Type
from models.kit.timing import TICK

STEP_TOLERANCE = 1e-6  # of the step


@dataclass(frozen=True)
class Rate:
    """How often a component is stepped.

    Attributes:
        every: ticks from one step to the next; inputs are taken on the first of them, outputs are held.
        substeps: steps in a tick, during which inputs are held; the outputs are those after the last.
    """

    every: int = 1
    substeps: int = 1

    def size(self, tick: float) -> float:
        """Of a step, s."""
        return tick * self.every / self.substeps

    def __str__(self) -> str:
        if self.substeps > 1:
            return f"{self.substeps} steps a tick"
        return f"every {self.every} ticks" if self.every > 1 else "every tick"


@dataclass(frozen=True)
class Delay:
    """Ticks from the source's step to the target's that uses it; up to `most`, while a value is held."""

    least: int
    most: int

    def __str__(self) -> str:
        if self.least < self.most:
            return f"{self.least} to {self.most} ticks"
        return {0: "none", 1: "1 tick"}.get(self.least, f"{self.least} ticks")


@dataclass(frozen=True)
class Wiring:
    """A checked system.

    Attributes:
        order: components in the order in which they are stepped, plants last.
        plants: those whose outputs do not depend on their inputs within a step.
        step: s, the tick.
        start: s, the time that the FMUs begin at.
        rates: by component.
        late: those whose outputs are read when their step has ended; the others' are the answer to the
            inputs with which it begins.
        delays: of each link.
        free: inputs that nothing feeds, by component.
        faults: components that disturb a link: they delay nothing, and may give what is not finite.
        stalls: by component, ticks on which it is not stepped: apart, in their order, whole steps of its own.
    """

    order: tuple[str, ...]
    plants: frozenset[str]
    step: float
    rates: dict[str, Rate]
    late: frozenset[str]
    delays: tuple[tuple[ScaledLink, Delay], ...]
    free: dict[str, tuple[str, ...]]
    start: float = 0.0
    faults: frozenset[str] = frozenset()
    stalls: Mapping[str, tuple[Ticks, ...]] = field(default_factory=dict)


def wire(
    system: FmuSystem,
    fmus: Mapping[str, FmuDescription],
    order: Order = "sequential",
    plants: Iterable[str] = (),
) -> Wiring:
    """Check a system's links against what its FMUs declare, and order its components.

    Args:
        system: what to wire.
        fmus: what each component's FMU says.
        order: `sequential` or `jacobi`.
        plants: components to be stepped last whatever they declare.

    Raises:
        WiringError: types or units that do not fit, an input fed twice or not at all, a cycle without a
            plant, steps that do not agree.
        SspError: package and FMU declare a variable differently.
        FmuError: a link or value names a variable that the FMU lacks.
    """
    fed: dict[tuple[str, str], ScaledLink] = {}
    for link in system.links:
        _check_link(link, fmus)
        target = (link.target, link.target_variable)
        if target in fed:
            raise WiringError(
                f"{link.target}.{link.target_variable} is fed twice: by {fed[target]} and {link}"
            )
        fed[target] = link
    _check_values(system, fmus, fed)
    _check_connectors(system, fmus)
    free = {name: tuple(v for v in fmu.inputs if (name, v) not in fed) for name, fmu in fmus.items()}
    for name, variables in free.items():
        for variable in variables:
            start = fmus[name].inputs[variable].start
            if (start is None or not math.isfinite(start)) and variable not in system.components[name].values:
                lacking = "a start value" if start is None else f"a finite start value, but {start}"
                raise WiringError(f"input {name}.{variable} has neither a source nor {lacking}; connect it")
    last = frozenset(name for name, fmu in fmus.items() if not fmu.feedthrough) | frozenset(plants)
    answering = [name for name in fmus if name not in last]
    links = [link for link in system.links if link.source in answering and link.target in answering]
    if order == "sequential":
        answering = _data_flow(answering, links)
    step, whose = (system.tick, "of our blocks") if system.tick else find_tick(fmus)
    rates = {name: find_rate(f"{name} {fmu.path.name}", fmu, step, whose) for name, fmu in fmus.items()}
    late = (frozenset(fmus) if order == "jacobi" else last) - frozenset(system.faults)
    return Wiring(
        order=(*answering, *(name for name in fmus if name in last)),
        plants=last,
        step=step,
        rates=rates,
        late=late,
        delays=tuple((link, _delay(link, rates, late)) for link in system.links),
        free=free,
        start=system.start_time,
        faults=frozenset(system.faults),
        stalls={
            name: spans for name, of in system.stalls.items() if (spans := whole_steps(of, rates[name].every))
        },
    )


def _check_link(link: ScaledLink, fmus: Mapping[str, FmuDescription]) -> None:
    try:
        source = fmus[link.source].find(link.source_variable, "output")
        target = fmus[link.target].find(link.target_variable, "input")
    except FmuError as reason:
        raise WiringError(f"link {link}: {reason}") from None
    if source.type is not target.type:
        raise WiringError(
            f"link {link}: the source is {source.type.value}, the target {target.type.value}; "
            "connect equal types"
        )
    _check_table(link, source, target)
    from_unit, to_unit = fmus[link.source].unit(source), fmus[link.target].unit(target)
    if from_unit is None or to_unit is None or link.settled:
        return
    if not from_unit.measures(to_unit):
        raise WiringError(f'link {link}: unit "{from_unit.name}" cannot become "{to_unit.name}"')
    if not link.converts and not from_unit.equals(to_unit):
        raise WiringError(
            f'link {link}: the source has unit "{from_unit.name}", the target "{to_unit.name}"; '
            "give the connection a LinearTransformation, or export the same unit"
        )


def _check_table(link: ScaledLink, source: Quantity, target: Quantity) -> None:
    """A table's numbers must be those of what they are given to; what the source cannot give is no matter."""
    if link.table and Type.REAL in (source.type, target.type):
        raise WiringError(f"link {link}: its table replaces whole numbers, the source is Real")
    for _, replaced in link.table:
        if not target.holds(replaced):
            raise WiringError(f"link {link}: its table gives {replaced}, the target is {target.type_name}")


def _check_values(
    system: FmuSystem, fmus: Mapping[str, FmuDescription], fed: Mapping[tuple[str, str], ScaledLink]
) -> None:
    """The package's own start values."""
    for name, component in system.components.items():
        for variable, value in component.values.items():
            quantity = fmus[name].find(variable, "parameter", "structuralParameter", "input")
            if (name, variable) in fed:
                raise WiringError(
                    f"input {name}.{variable} is given a value, but is fed by {fed[name, variable]}"
                )
            unit = fmus[name].unit(quantity)
            if value.unit is not None and unit is not None and value.unit != unit.name:
                raise SspError(
                    f'{name}.{variable} is given in "{value.unit}", the FMU declares "{unit.name}"; '
                    "give the value in the FMU's unit, or map it with a ParameterMapping, which converts it"
                )
            if not quantity.holds(value.value):
                raise SspError(
                    f"{name}.{variable} is given {value.value:g}, the FMU declares {quantity.type_name}; "
                    "give one of those"
                )


def _check_connectors(system: FmuSystem, fmus: Mapping[str, FmuDescription]) -> None:
    """What the package says of its FMUs' variables: an end that declares no type or unit fits any."""
    for name, component in system.components.items():
        for connector in component.connectors.values():
            quantity = fmus[name].quantities.get(connector.name)
            if quantity is None:
                continue
            unit = fmus[name].unit(quantity)
            of_fmu = quantity.type.value
            declared = {"Enumeration": "Integer"}.get(connector.type or of_fmu, connector.type or of_fmu)
            if declared != of_fmu:
                got, expected = f"type {connector.type}", f"type {of_fmu}"
            elif connector.unit and unit is not None and connector.unit != unit.name:
                got, expected = f'unit "{connector.unit}"', f'unit "{unit.name}"'
            else:
                continue
            raise SspError(
                f"connector {name}.{connector.name} has {got}, {component.fmu.name} declares {expected}; "
                "write into the package what the FMU declares"
            )


def _data_flow(names: list[str], links: list[ScaledLink]) -> list[str]:
    """The names, every source before its targets; free choices keep the order of the list."""
    done: list[str] = []
    left = list(names)
    while left:
        ready = next((n for n in left if not any(k.target == n and k.source in left for k in links)), None)
        if ready is None:
            raise WiringError(
                f"cycle without a delay: {_cycle(left, links)}; "
                "sequential stepping needs a component in it whose outputs do not depend on its inputs "
                "(a plant; its ModelStructure must say so), --order jacobi delays every link"
            )
        left.remove(ready)
        done.append(ready)
    return done


def _cycle(left: list[str], links: list[ScaledLink]) -> str:
    """One cycle among the components that are left, as text."""
    path = [left[0]]
    while True:  # every component left has a source that is left
        source = next(k.source for k in links if k.target == path[-1] and k.source in left)
        if source in path:
            cycle = path[path.index(source) :][::-1]
            return " -> ".join([*cycle, cycle[0]])
        path.append(source)


def find_tick(fmus: Mapping[str, FmuDescription]) -> tuple[float, str]:
    """The tick, s, and whose step it is.

    It is that of our blocks if a component has it, or else the shortest fixed step, or else the longest that
    an FMU states.
    """
    fixed = {name: fmu.step for name, fmu in fmus.items() if fmu.step and fmu.fixed}
    if any(math.isclose(step, TICK, rel_tol=STEP_TOLERANCE) for step in fixed.values()):
        return TICK, "of our blocks"
    if fixed:
        name = min(fixed, key=fixed.__getitem__)
        return fixed[name], f"of {name}"
    return max((fmu.step for fmu in fmus.values() if fmu.step), default=TICK), "of all others"


def find_rate(label: str, fmu: FmuDescription, tick: float, whose: str = "of our blocks") -> Rate:
    """How often an FMU is stepped; one that varies its steps makes one in each tick.

    Args:
        label: what errors call it.
        tick: s; `whose` it is, for errors.

    Raises:
        WiringError: its step is neither a whole multiple nor a whole fraction of the tick.
    """
    if not fmu.fixed or not fmu.step:
        return Rate()
    every, substeps = max(1, round(fmu.step / tick)), max(1, round(tick / fmu.step))
    if not math.isclose(fmu.step * substeps, tick * every, rel_tol=STEP_TOLERANCE):
        if fmu.step > tick:
            fitting = [tick * math.floor(fmu.step / tick), tick * math.ceil(fmu.step / tick)]
        else:
            fitting = [tick / math.ceil(tick / fmu.step), tick / math.floor(tick / fmu.step)]
        raise WiringError(
            f"{label} has a fixed step of {fmu.step:.10g} s; expected a whole multiple or fraction of the "
            f"tick of {tick:.10g} s {whose}: export it with {fitting[0]:.6g} or {fitting[1]:.6g} s"
        )
    return Rate(every, substeps)


def _delay(link: ScaledLink, rates: Mapping[str, Rate], late: frozenset[str]) -> Delay:
    """A step on tick k has its outputs read from then on, or from its end on, until the next step's are."""
    source, target = rates[link.source].every, rates[link.target].every
    least = source if link.source in late else 0
    return Delay(least, least + source - math.gcd(source, target))
