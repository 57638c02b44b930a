"""The wiring: which output feeds which input, checked before anything runs, and the order of a tick."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from graphlib import CycleError, TopologicalSorter

from models.canine import Canine
from models.canine_ahrs import CanineAhrs
from models.canine_tracker import CanineTracker
from models.cmec import Cmec
from models.command_module import CommandModule
from models.day import CanineAllDay
from models.differential_drive import DifferentialDrive
from models.disturbance import FAULTS, FaultyLink, disturb
from models.errors import UsageError, WiringError, nearest
from models.estimator import Estimator
from models.four_state import FourState
from models.kit.block import Block
from models.kit.declaration import Input, Output, Variable, flatten
from models.kit.link import Link
from models.local_plane import LocalPlane
from models.pedestrian import Pedestrian
from models.profile import Profile
from models.proportional import Proportional
from models.quarter_turn import QuarterTurn
from models.recorded import Recorded
from models.sensors import Sensors
from models.seven_state import SevenState
from models.six_state import SixState
from models.streets import CanineInStreets
from models.two_bias import TwoBias
from models.watchdog import Watchdog


@dataclass(frozen=True)
class System:
    """Components by their role, and the links between them.

    Raises:
        WiringError: a link connects different units, types or sizes, or what does not exist; an input has two
            sources, or neither source nor start value; a loop passes through no plant.
    """

    name: str
    components: dict[str, type[Block]]
    links: tuple[Link, ...]

    def __post_init__(self) -> None:
        sources: dict[tuple[str, str], Link] = {}
        for link in self.links:
            source = self._variable(link, link.source, link.source_variable, Output)
            target = self._variable(link, link.target, link.target_variable, Input)
            ends = self.components[link.source], self.components[link.target]
            is_carried = any(block.transparent for block in ends)
            for what, got, expected in (
                ("type", source.type.value, target.type.value),
                ("unit", source.unit, target.unit),
                ("named values", source.choices, target.choices),
            ):
                if got != expected and (what == "type" or not is_carried):
                    raise WiringError(f'{self.name}: {link}: {what} "{got}", expected "{expected}"')
            key = (link.target, link.target_variable)
            if key in sources:
                raise WiringError(f"{self.name}: {link}: the input has a source already, {sources[key]}")
            sources[key] = link
        for component, block in self.components.items():
            for name, variable in flatten(block.group("input")):
                if not (variable.has_start or (component, name) in sources):
                    raise WiringError(
                        f'{self.name}: input "{component}.{name}" has neither source nor start value'
                    )
        self.order()

    def _variable(self, link: Link, component: str, name: str, kind: type[Variable]) -> Variable:
        if component not in self.components:
            raise WiringError(
                f'{self.name}: {link}: no component "{component}"{nearest(component, self.components)}'
            )
        declared = self.components[component].variables(kind)
        if name in declared and declared[name].size:
            names = declared[name].flat_names
            raise WiringError(
                f'{self.name}: {link}: "{component}.{name}" has size "{len(names)}", expected "1"; '
                f"link its elements, {names[0]} to {names[-1]}"
            )
        known = dict(flatten(list(declared.values())))
        if name not in known:
            kind_name = kind.__name__.lower()
            raise WiringError(
                f'{self.name}: {link}: "{component}" has no {kind_name} "{name}"{nearest(name, known)}'
            )
        return known[name]

    def with_faults(self, faults: Sequence[FaultyLink]) -> System:
        """The system with a block for each fault in the links on which it acts; itself without faults."""
        if not faults:
            return self
        links, placed = disturb(self.links, faults)
        blocks = {name: FAULTS[place.type] for name, place in placed.items()}
        return System(f"{self.name}_faults", self.components | blocks, links)

    def order(self) -> list[str]:
        """The components in data-flow order within a tick; plants, whose outputs wait for no input, last."""
        plants = [c for c, block in self.components.items() if block.moore]
        graph: dict[str, set[str]] = {c: set() for c in self.components if c not in plants}
        for link in self.links:
            if link.target in graph and link.source in graph:
                graph[link.target].add(link.source)
        try:
            return [*TopologicalSorter(graph).static_order(), *plants]
        except CycleError as cycle:
            raise WiringError(f"{self.name}: no plant delays the loop {' -> '.join(cycle.args[1])}") from None


def by_name(
    components: Mapping[str, type[Block]], links: Mapping[str, str | tuple[str, ...]]
) -> tuple[Link, ...]:
    """Link every input to the output of the same name.

    Args:
        links: the source component of each target, or several: the first that has the output feeds the input.
    """
    return tuple(
        Link(source, name, target, name)
        for target, sources in links.items()
        for name in components[target].flat_names("input")
        for source in [
            source
            for source in ((sources,) if isinstance(sources, str) else sources)
            if name in components[source].flat_names("output")
        ][:1]
    )


def full_system(
    plant: type[Block] = Canine,
    estimator: type[Block] = FourState,
    ahrs: type[Block] | None = None,
    controller: type[Block] = Cmec,
) -> System:
    """The whole loop: plant, sensors, estimator, controller, command module.

    Args:
        ahrs: a component between sensors and estimator; what it gives takes the place of the sensors' output
            of the same name.
    """
    between: dict[str, type[Block]] = {} if ahrs is None else {"ahrs": ahrs}
    components: dict[str, type[Block]] = {
        "sensors": Sensors,
        **between,
        "estimator": estimator,
        "controller": controller,
        "command_module": CommandModule,
        "plant": plant,
    }
    links: dict[str, str | tuple[str, ...]] = {
        "sensors": "plant",
        **dict.fromkeys(between, "sensors"),
        "estimator": (*between, "sensors"),
        "controller": "estimator",
        "command_module": "controller",
        "plant": "controller",
    }
    return System("_".join(("full", *between)), components, by_name(components, links))


def trial_simulator(plant: type[Block] = Canine, controller: type[Block] = Cmec) -> System:
    """The trial simulator of Chapter 5 (CTS): the plant's true state goes into the controller."""
    components: dict[str, type[Block]] = {
        "controller": controller,
        "command_module": CommandModule,
        "plant": plant,
    }
    links = {"controller": "plant", "command_module": "controller", "plant": "controller"}
    return System("cts", components, by_name(components, links))


ESTIMATORS: dict[str, type[Estimator]] = {
    block.title(): block for block in (FourState, SixState, SevenState, TwoBias, CanineTracker)
}
ESTIMATOR = FourState.title()  # by default
PLANT, CONTROLLER = Canine.title(), Cmec.title()  # by default
CONTROLLERS: dict[str, type[Block]] = {block.title(): block for block in (Cmec, QuarterTurn, Proportional)}
PLANTS: dict[str, type[Block]] = {
    block.title(): block
    for block in (Canine, CanineInStreets, CanineAllDay, Pedestrian, DifferentialDrive, Profile)
}
SYSTEMS: dict[str, System] = {
    "full": full_system(),
    "full_ahrs": full_system(ahrs=CanineAhrs),
    "cts": trial_simulator(),
}
DEFAULTS = {"estimator": ESTIMATOR, "plant": PLANT, "controller": CONTROLLER}  # by role
BLOCKS: tuple[type[Block], ...] = tuple(
    dict.fromkeys(
        [
            *(block for system in SYSTEMS.values() for block in system.components.values()),
            *ESTIMATORS.values(),
            *CONTROLLERS.values(),
            *PLANTS.values(),
            CanineAhrs,
            Recorded,
            *FAULTS.values(),
            LocalPlane,  # these two work beside the estimator and the controller on board
            Watchdog,
        ]
    )
)


def names_of(block: str) -> tuple[str, ...]:
    """The names by which parameters of a block are set: its own; the dog's too of a dog with more to it."""
    return (block, PLANT) if block in (CanineInStreets.title(), CanineAllDay.title()) else (block,)


@cache
def find_system(
    name: str, estimator: str = ESTIMATOR, plant: str = PLANT, controller: str = CONTROLLER
) -> System:
    """A system by its name, with the blocks of these names in it.

    Raises:
        UsageError: there is no such system or block, or the system has no place for an estimator.
    """
    if name not in SYSTEMS:
        raise UsageError(f'there is no system "{name}"{nearest(name, SYSTEMS)}')
    system, filter_block = SYSTEMS[name], find_estimator(estimator)
    chosen = {"estimator": estimator, "plant": plant, "controller": controller}
    others = [block for role, block in chosen.items() if block != DEFAULTS[role]]
    if not others:
        return system
    for role, known in (("plant", PLANTS), ("controller", CONTROLLERS)):
        if chosen[role] not in known:
            raise UsageError(f'there is no {role} "{chosen[role]}"{nearest(chosen[role], known)}')
    if "estimator" in system.components:
        ahrs = system.components.get("ahrs")
        made = full_system(PLANTS[plant], filter_block, ahrs, CONTROLLERS[controller])
    elif estimator == ESTIMATOR:
        made = trial_simulator(PLANTS[plant], CONTROLLERS[controller])
    else:
        raise UsageError(f'system "{name}" has no estimator; {estimator} needs the system "full"')
    return replace(made, name="_".join((name, *others)))


def find_estimator(name: str) -> type[Estimator]:
    """An estimator by its name.

    Raises:
        UsageError: there is none.
    """
    if name == CanineAhrs.title():
        raise UsageError(
            f'"{name}" is no estimator, it gives one its attitude; expected one of {", ".join(ESTIMATORS)}, '
            "in trials and on board with --ahrs, in replays with --attitude own"
        )
    if name not in ESTIMATORS:
        raise UsageError(f'there is no estimator "{name}"{nearest(name, ESTIMATORS)}')
    return ESTIMATORS[name]


def find_block(name: str) -> type[Block]:
    """A block by its name, or by that of its component in the full system: `cmec`, `controller`.

    Raises:
        UsageError: there is none.
    """
    blocks = {**SYSTEMS["full"].components, **{block.title(): block for block in BLOCKS}}
    if name not in blocks:
        raise UsageError(f'there is no block "{name}"{nearest(name, blocks)}')
    return blocks[name]
