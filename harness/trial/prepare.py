"""A trial made ready: its package is open, swapped FMUs are in their places, its scenario is resolved."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from fmus.archive import is_sealed
from fmus.folder import build_folder
from harness.cosim.archive import holder
from harness.cosim.fmu import FmuDescription, describe
from harness.cosim.in_place import fit_in_place
from harness.cosim.rename import Rename
from harness.cosim.roles import Fit, find_role, misfits, read_adapter, replace_component, roles
from harness.cosim.ssp import FmuComponent, FmuSystem, ScaledLink, open_ssp
from harness.cosim.stepping import whole_steps
from harness.cosim.wiring import find_rate, find_tick
from harness.files import nearest_file
from harness.onboard import IN_FIRMWARE
from harness.onboard.garbage import Garbage
from harness.trial.faults import Faults, resolve_faults
from harness.trial.plan import Interface, Plan, interface_of_fmu, interfaces_of_system, plan
from harness.trial.request import Request
from harness.trial.scenario import Scenario, ScenarioError
from models.disturbance import FAULTS, FaultyLink, Placed, disturb
from models.system import System


@dataclass(frozen=True)
class Prepared:
    """A system of FMUs with its swaps made, and what the scenario sets in it.

    Attributes:
        system: components and links.
        fmus, interfaces: by component; interfaces of the firmware's own components too, with firmware.
        plan: the scenario in SI.
        fits: how swapped components fit their roles, by role.
        notes: what the user should know.
        garbage: of the bytes that the firmware on board receives.
        connected: inputs that have a source, by component.
    """

    system: FmuSystem
    fmus: Mapping[str, FmuDescription]
    interfaces: Mapping[str, Interface]
    plan: Plan
    fits: Mapping[str, Fit]
    notes: tuple[str, ...]
    garbage: tuple[Garbage, ...] = ()
    connected: Mapping[str, Collection[str]] = field(default_factory=dict)

    def planned(self, scenario: Scenario) -> Prepared:
        """The same with another scenario of the same system, such as another seed.

        Raises:
            ScenarioError: it does not fit.
        """
        resolved = plan(scenario, self.interfaces, _bound_values(self.system), self.connected)
        faults = {name: own for name, own in self.plan.values.items() if name not in self.interfaces}
        values = {name: own | {"seed": float(scenario.seed)} for name, own in faults.items()}
        return replace(self, plan=replace(resolved, values=resolved.values | values))

    @property
    def renames(self) -> dict[str, Mapping[str, Rename]]:
        """By swapped component, the role's name of an output to the FMU's and the conversion."""
        return {role: fit.outputs for role, fit in self.fits.items()}

    @property
    def plants(self) -> list[str]:
        """Swapped plants: they are stepped last, whatever they declare."""
        return [role for role in self.fits if role == "plant"]

    @property
    def values(self) -> dict[str, dict[str, float]]:
        """All values by component: those of the scenario over those of the package."""
        bound = _bound_values(self.system)
        return {name: bound.get(name, {}) | values for name, values in self.plan.values.items()}


@contextmanager
def prepared(request: Request) -> Iterator[Prepared]:
    """Open the package, put swapped FMUs in their places, resolve the scenario.

    Raises:
        CanineError: something does not fit; the class tells what kind.
    """
    scenario = request.scenario
    if not (package := holder(request.ssp)).exists():
        raise ScenarioError(f'{scenario.name}: there is no package "{package}"{nearest_file(package)}')
    with open_ssp(request.ssp) as packaged:
        fmus = {name: describe(component.fmu) for name, component in packaged.components.items()}
        system, fits = fit_in_place(packaged, fmus, request.swaps)
        system = _with_exported_faults(system, fmus)
        notes = _notes(system, scenario)
        notes += [note for fitted in fits.values() for note in fitted.notes]
        for role, path in request.swaps.items():
            fmus[role] = describe(path)
            adapter = read_adapter(path, find_role(role))
            system, fits[role] = replace_component(system, role, fmus[role], adapter, _sources(role, fmus))
            notes += fits[role].notes
        interfaces = _interfaces(scenario.own_system, fmus, fits)
        inside: tuple[str, ...] = ()
        if request.onboard:
            from harness.trial.firmware import interfaces_on_board  # noqa: PLC0415 - the firmware's C

            on_board = interfaces_on_board()
            interfaces |= on_board
            inside = (*IN_FIRMWARE, *on_board)
        connected = {
            name: {link.target_variable for link in system.links if link.target == name} for name in fmus
        }
        resolved = plan(scenario, interfaces, _bound_values(system), connected)
        faults = resolve_faults(
            scenario,
            interfaces,
            system.links,
            find_tick(fmus)[0],
            renames={role: fit.outputs for role, fit in fits.items()},
            inside=inside,
        )
        notes += _idle_stalls(scenario, faults, fmus)
        disturbed, values = _with_faults(
            system, faults, build_folder() / f"fmi{request.fmi}", is_sensed=bool(request.onboard)
        )
        fmus = {name: describe(disturbed.components[name].fmu) for name in values} | fmus
        resolved = replace(resolved, values=resolved.values | values)
        yield Prepared(
            replace(disturbed, stalls=faults.stalls),
            fmus,
            interfaces,
            resolved,
            fits,
            (*notes, *resolved.notes),
            faults.garbage,
            connected,
        )


def _notes(system: FmuSystem, scenario: Scenario) -> list[str]:
    """What the user should know of the package itself."""
    notes = [f"{scenario.system}: {note}" for note in system.notes]
    start, stop = system.start_time, system.stop_time
    if start:
        notes.append(f"{scenario.system}: its FMUs begin at {start:g} s, the trial's time and its log at 0 s")
    if scenario.package is not None and stop is not None and stop - start != scenario.duration:
        notes.append(
            f"{scenario.system}: its experiment takes {stop - start:g} s, the trial {scenario.duration:g} s"
        )
    return notes


def _idle_stalls(scenario: Scenario, faults: Faults, fmus: Mapping[str, FmuDescription]) -> list[str]:
    """Stalls of slow components that never act."""
    tick = find_tick(fmus)[0]
    rates = {name: find_rate(name, fmus[name], tick) for name in faults.stalls}
    return [
        f"{scenario.name}: a stall of {name} from {first * tick:g} to {after * tick:g} s never acts: "
        f"no step of it, one every {rates[name].size(tick):g} s, begins then"
        for name, spans in faults.stalls.items()
        for first, after in spans
        if first < after and not whole_steps([(first, after)], rates[name].every)
    ]


def _interfaces(
    system: System | None, fmus: Mapping[str, FmuDescription], fits: Mapping[str, Fit]
) -> dict[str, Interface]:
    """Each component's interface: our blocks' as declared, other FMUs' as they describe themselves."""
    own = interfaces_of_system(system) if system else {}
    known = roles()
    interfaces = {}
    for name, fmu in fmus.items():
        role, fit = known.get(name), fits.get(name)
        if name in own and fit is None:
            interfaces[name] = own[name]
        else:
            wrong = misfits(fmu, role) if role and fit is None else {}
            interfaces[name] = interface_of_fmu(name, fmu, role, fit, wrong)
    return interfaces


def _sources(role: str, fmus: Mapping[str, FmuDescription]) -> dict[str, str]:
    """Which component of ours gives an estimator what it may take: an AHRS before the sensors."""
    givers = [name for name in ("sensors", "ahrs") if role == "estimator" and name in fmus]
    return {output: name for name in givers for output in fmus[name].outputs}


def _bound_values(system: FmuSystem) -> dict[str, dict[str, float]]:
    """The values that the package itself binds, by component."""
    return {
        name: {variable: start.value for variable, start in component.values.items()}
        for name, component in system.components.items()
    }


def _with_exported_faults(system: FmuSystem, fmus: Mapping[str, FmuDescription]) -> FmuSystem:
    """A system whose faults are known as such: a package that a trial was exported to holds their blocks."""
    types = {block.title(): type_ for type_, block in FAULTS.items()}
    faults = {}
    for link in system.links:
        name = link.target
        if link.target_variable == "signal" and fmus[name].model in types and is_sealed(fmus[name].path):
            readers = [(k.target, k.target_variable) for k in system.links if k.source == name]
            end = readers[0] if len(readers) == 1 else ("", "")
            faults[name] = FaultyLink(types[fmus[name].model], link.source, link.signal, *end)
    return replace(system, faults=faults)


def _with_faults(
    system: FmuSystem, faults: Faults, folder: Path, *, is_sensed: bool
) -> tuple[FmuSystem, dict[str, dict[str, float]]]:
    """A system with the faults' blocks in its links, and their parameters; without faults the system itself.

    Args:
        folder: where the blocks' FMUs are.
        is_sensed: something reads the sensors' outputs beside the links, the firmware on board.
    """
    if not faults.links:
        return system, {}
    links, placed = disturb(system.links, faults.links)
    if is_sensed:
        ends = {place.fault for place in placed.values()}
        feeders: dict[tuple[str, str], tuple[str, str]] = {}  # by output, what gives it by now
        for number, fault in enumerate(faults.links):
            if number not in ends:
                name, output = f"fault_{len(placed) + 1}", (fault.source, fault.source_variable)
                placed[name] = Placed(number, fault.type)
                links = (*links, ScaledLink(*feeders.get(output, output), name, "signal"))
                feeders[output] = (name, "disturbed")
    blocks = {
        name: FmuComponent(name, folder / f"{FAULTS[place.type].title()}.fmu")
        for name, place in placed.items()
    }
    # they come first: the firmware on board, which no link orders, is stepped after them
    disturbed = replace(
        system,
        components=blocks | system.components,
        links=links,
        faults={**system.faults, **{name: faults.links[place.fault] for name, place in placed.items()}},
    )
    return disturbed, faults.values_of(placed)
