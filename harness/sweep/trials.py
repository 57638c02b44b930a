"""What is asked for resolved to trials: scenarios with options over them, in systems of our blocks."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

from codegen.batch.batch import Change
from harness.cosim.stepping import first_tick, whole_steps
from harness.sweep.axis import MAX_POINTS, Axis, SweepError
from harness.sweep.chunks import TICK_S, Job, Trials, TrialType
from harness.sweep.components import Components
from harness.trial.faults import resolve_faults
from harness.trial.pairs import check_windows, is_paired
from harness.trial.plan import Interface, interfaces_of_system, plan
from harness.trial.scenario import LOST, Scenario, ScenarioError, checked, load, with_estimator
from models.disturbance import disturb
from models.errors import nearest
from models.kit.random import MAX_SEED
from models.readings import READING
from models.system import CONTROLLER, ESTIMATOR, SYSTEMS, System, find_system

TRIAL_TYPES = {"two": ("two_waypoint",), "three": ("right_90", "left_90", "right_45", "left_45")}
MAX_TRIALS = 100_000_000


@dataclass(frozen=True)
class Options:
    """What overrides scenarios; None keeps the scenario's own.

    Attributes:
        system: name of one of SYSTEMS.
        estimator: of ours by name, or the path of an FMU.
        ahrs: put our AHRS between sensors and estimator of the system full.

    Raises:
        SweepError: the system does not exist, or has no place for the estimator or the AHRS.
    """

    system: str | None = None
    estimator: str | None = None
    ahrs: bool = False
    reading: str | None = None
    seed: int | None = None

    def __post_init__(self) -> None:
        if self.system is not None and self.system not in SYSTEMS:
            raise SweepError(f"system {self.system}: there is no such system{nearest(self.system, SYSTEMS)}")
        if self.system is not None:
            self.system_of(self.system)

    def system_of(self, own: str) -> str:
        """The system that a scenario of the system `own` is run with."""
        system = self.system or own
        if self.ahrs and system not in ("full", "full_ahrs"):
            raise SweepError(f"--ahrs: the system {system} has no sensors; sweep with --system full")
        if self.estimator is not None and system not in with_estimator():
            raise SweepError(
                f"--estimator {self.estimator}: the system {system} gives the controller the true state; "
                "sweep with --system full"
            )
        return "full_ahrs" if self.ahrs else system


def adapted(
    target: str | Scenario,
    options: Options,
    settings: Sequence[str],
    components: Components,
) -> Scenario:
    """A type of trial's scenario with the options over it.

    Args:
        settings: `block.name=value`.
        components: what takes the places of plant, controller and estimator.

    Raises:
        ScenarioError, SweepError: the scenario cannot be read, or an option or a setting does not fit it.
    """
    scenario = checked(target) if isinstance(target, Scenario) else load(target, known=TRIAL_TYPES)
    if scenario.package is not None:
        raise SweepError(
            f"{scenario.name}: runs the package {scenario.system}; a sweep compiles our own systems, "
            f"{' and '.join(SYSTEMS)}: name one of them as its system, or run it with `canine run`"
        )
    system = options.system_of(scenario.system)
    own = scenario.estimator if system in with_estimator() else ESTIMATOR
    scenario = replace(scenario, system=system, estimator=components.block("estimator") or own)
    scenario = scenario.override(settings, options.seed, components.blocks)
    scenario = replace(scenario, reading=options.reading or scenario.reading or READING)
    owners = _owners(find_system(system, scenario.estimator)) | _owners(components.system(scenario))
    disturbed = [fault.signal for fault in scenario.faults if fault.kind != LOST]
    for address in [*scenario.parameters, *(s.variable for s in scenario.sets), *disturbed]:
        owner = address.partition(".")[0]
        for other in SYSTEMS:
            if owner not in owners and owner in _owners(SYSTEMS[other]):
                raise SweepError(
                    f'{scenario.name}: {address}: the system "{system}" has no {owner}; '
                    f"sweep with --system {other}, or leave it out"
                )
    for fault in scenario.faults:
        if fault.kind == "nan" and fault.signal.startswith("plant.") and "sensors" in owners:
            raise ScenarioError(
                f"{scenario.name}: [[fault]] nan of {fault.signal}: the sensors answer with what is not "
                "finite, which ends a trial; disturb a signal of the sensors"
            )
    return scenario


def _owners(system: System) -> set[str]:
    """The names of the components and of their blocks."""
    return {*system.components, *(block.title() for block in system.components.values())}


def without(settings: Sequence[str], blocks: Collection[str | None]) -> list[str]:
    """The settings that are not of these blocks, `block.name=value`."""
    return [text for text in settings if text.partition("=")[0].partition(".")[0].strip() not in blocks]


def native_job(
    scenarios: Sequence[Scenario],
    components: Components,
    axes: Sequence[Axis],
    trials: int,
    note: Callable[[str], None],
) -> Job:
    """The trials of our own blocks; the scenarios take turns."""
    first, wired = scenarios[0], components.system(scenarios[0])
    faults = resolve_faults(first, interfaces_of_system(wired), wired.links, TICK_S)
    return Job(
        first.system,
        tuple(axis.variable for axis in axes),
        tuple(product(*(axis.values for axis in axes))),
        tuple(trial_type(scenario, wired, axes, note) for scenario in scenarios),
        trials,
        first.seed,
        estimator=first.estimator,
        plant=components.block("plant") or first.plant,
        controller=components.block("controller") or CONTROLLER,
        faults=faults.links,
        stalls={name: whole_steps(spans, 1) for name, spans in faults.stalls.items()},
    )


def trial_type(
    scenario: Scenario,
    system: System,
    axes: Sequence[Axis] = (),
    note: Callable[[str], None] = lambda text: None,
) -> TrialType:
    """A scenario resolved against its system, with ticks for times.

    Raises:
        ScenarioError: as `plan` raises it, or the scenario sets an input that is connected.
    """
    interfaces = interfaces_of_system(system)
    resolved = plan(scenario, interfaces, varied=[axis.variable for axis in axes])
    for text in resolved.notes:
        note(f"{scenario.name}: {text}")
    _check_windows(scenario, interfaces, axes, resolved.values)
    connected = {(link.target, link.target_variable) for link in system.links}
    changes = []
    for event in resolved.events:
        if (event.component, event.variable) in connected:
            raise ScenarioError(
                f"{scenario.name}: [[set]] {event.component}.{event.variable} is connected; "
                "only free inputs can be set"
            )
        tick = first_tick(event.time, TICK_S)
        changes.append(Change(tick, event.component, event.variable, event.value))
    last = math.floor(scenario.duration / TICK_S + 1e-9)
    faults = resolve_faults(scenario, interfaces, system.links, TICK_S)
    _, placed = disturb(system.links, faults.links)
    values = resolved.values | faults.values_of(placed)
    return TrialType(scenario.name, values, tuple(changes), last)


def _check_windows(
    scenario: Scenario,
    interfaces: Mapping[str, Interface],
    axes: Sequence[Axis],
    values: Mapping[str, Mapping[str, float]],
) -> None:
    """Refuse a point of the sweep at which a window ends before it starts."""
    owners = [axis.variable.partition(".") for axis in axes]
    if not any(is_paired(interfaces[component].block, name) for component, _, name in owners):
        return
    for point in product(*(axis.values for axis in axes)):
        at_point = {component: dict(own) for component, own in values.items()}
        for (component, _, name), value in zip(owners, point, strict=True):
            at_point[component][name] = value
        for component, interface in interfaces.items():
            check_windows(interface.block, at_point[component], scenario.name)


def check_size(job: Trials, seed: int) -> None:
    """Refuse more trials than can be run, or than there are seeds.

    Raises:
        SweepError: there are.
    """
    if job.trials < 1:
        raise SweepError(f"--trials {job.trials}: expected at least 1")
    if job.point_count > MAX_POINTS:
        raise SweepError(f"{job.point_count} points; expected at most {MAX_POINTS}: take larger steps")
    if seed + job.trials - 1 > MAX_SEED:
        raise SweepError(
            f"--trials {job.trials}: the last would have seed {seed + job.trials - 1}, expected at most "
            f"{MAX_SEED}; take at most {MAX_SEED - seed + 1} trials, or a smaller --seed"
        )
    if job.total > MAX_TRIALS:
        raise SweepError(
            f"{job.point_count} points of {job.trials} trials are {job.total} trials; expected at most "
            f"{MAX_TRIALS}: take at most {MAX_TRIALS // job.point_count} a point, or fewer points"
        )
