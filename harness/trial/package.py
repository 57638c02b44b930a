"""A trial as an SSP package for other tools: FMUs, their wiring, and the values that its scenario sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath

from fmus.archive import packed
from fmus.ssp import Component, Connection, Connector, Structure, files_of, sources_of
from harness.cosim.fmu import BASE, FmuDescription
from harness.cosim.origin import is_own
from harness.cosim.rename import Rename
from harness.cosim.roles import Fit
from harness.files import make_folder, write_whole
from harness.trial.prepare import Prepared
from harness.trial.request import SCENARIO, Request
from harness.trial.scenario import LOST, ScenarioError, toml_of
from models.errors import UsageError
from models.system import ESTIMATOR, SYSTEMS

KINDS = ("input", "output", "parameter")  # of connectors; SSP 1.0 has no others that an FMU of ours needs


def write_package(request: Request, ready: Prepared, path: Path) -> None:
    """Write a trial's package. Our own runs take what SSP has no place for from the scenario in it: its name,
    the seed as it is told, the origin of the map; and from a mapping file beside each FMU of others: which
    role it has taken, and by what names.

    Raises:
        UsageError: the trial has what no package can hold, or the name is not that of a package.
        FileError: it cannot be written.
    """
    _check(request, ready, path)
    # what is in the package is stated twice otherwise
    mission = replace(request.scenario, system="full", estimator=ESTIMATOR, parameters={}, sets=(), faults=())
    structure = structure_of(request, ready)
    sources = sources_of(structure)
    mappings = {
        PurePosixPath(sources[role]).with_suffix(".toml").as_posix(): mapping_of(fit).encode()
        for role, fit in ready.fits.items()
        if not is_own(structure.components[role].fmu) or _is_mapped(fit)
    }
    make_folder(path.parent)
    write_whole(path, packed(files_of(structure) | mappings | {SCENARIO: mission.text().encode()}))


def structure_of(request: Request, ready: Prepared) -> Structure:
    """What a trial's package describes."""
    values = _start_values(ready)
    components = {
        name: Component(part.fmu, _connectors(ready.fmus[name]), values[name])
        for name, part in ready.system.components.items()
    }
    connections = [Connection(link, link.factor, link.offset) for link in ready.system.links]
    name = request.scenario.name
    return Structure(name, components, connections, _units(ready), request.scenario.duration)


def mapping_of(fit: Fit) -> str:
    """The mapping file of an FMU in a role's place: all its outputs, and what else it calls differently."""
    tables: dict[str, Mapping[str, Rename]] = {
        "outputs": fit.outputs,
        "inputs": {name: rename for name, rename in fit.inputs.items() if rename.mapped},
        "parameters": {name: rename for name, rename in fit.parameters.items() if rename.mapped},
    }
    lines = []
    for table, renames in tables.items():
        lines.append(f"[{table}]")
        for own, r in renames.items():
            values = f"name = {toml_of(r.name)}, factor = {toml_of(r.factor)}, offset = {toml_of(r.offset)}"
            lines.append(f"{toml_of(own)} = {{ {values} }}")
    return "\n".join([*lines, ""])


def _is_mapped(fit: Fit) -> bool:
    return any(r.mapped for names in (fit.outputs, fit.inputs, fit.parameters) for r in names.values())


def _check(request: Request, ready: Prepared, path: Path) -> None:
    scenario = request.scenario
    if path.suffix != ".ssp":
        raise UsageError(f"--ssp {path}: expected a name that ends in .ssp")
    if request.onboard:
        raise UsageError(
            f"{request.log}: {request.onboard} led this trial; a package holds FMUs, no firmware: "
            "export the trial of its scenario"
        )
    if scenario.system not in SYSTEMS:
        raise UsageError(
            f"{scenario.name}: {scenario.system} is a package already; expected a system of ours"
        )
    lost = [f"{f.at:g} s" for f in scenario.faults if f.kind == LOST and (f.at > 0 or f.until is not None)]
    if lost:
        raise ScenarioError(
            f"{scenario.name}: [[fault]] loses the radio from {', '.join(lost)} on; a package holds values "
            "of the start alone: leave the lost radio out"
        )
    later = [f"{e.component}.{e.variable} at {e.time:g} s" for e in ready.plan.events if e.time > 0]
    if later:
        raise ScenarioError(
            f"{scenario.name}: [[set]] changes {', '.join(later)}; a package holds values of the start "
            "alone: leave these changes out"
        )
    if ready.system.stalls:
        raise ScenarioError(
            f"{scenario.name}: [[fault]] stalls {', '.join(ready.system.stalls)}; a package cannot say when "
            "a component is not stepped: leave the stalls out"
        )


def _start_values(ready: Prepared) -> dict[str, dict[str, float]]:
    """What the scenario and the package under it set at the start, by component, in the FMU's units."""
    values = ready.values
    for event in ready.plan.events:  # all at 0 s
        values[event.component][event.variable] = event.value
    return values


def _connectors(fmu: FmuDescription) -> list[Connector]:
    units = {q.name: fmu.unit(q) for q in fmu.quantities.values()}
    return [
        Connector(q.name, q.causality, q.type, unit.name if (unit := units[q.name]) and unit.base else "")
        for q in fmu.group(*KINDS).values()
    ]


def _units(ready: Prepared) -> dict[str, dict[str, str]]:
    """The units that the FMUs define, as XML writes them.

    Raises:
        UsageError: two FMUs call different units the same.
    """
    units: dict[str, dict[str, str]] = {}
    for fmu in ready.fmus.values():
        for unit in sorted(fmu.units.values(), key=lambda unit: unit.name):
            if unit.base is None:
                continue
            base = {name: str(power) for name, power in zip(BASE, unit.base, strict=True) if power}
            if unit.factor != 1.0:
                base["factor"] = repr(unit.factor)
            if unit.offset != 0.0:
                base["offset"] = repr(unit.offset)
            if units.setdefault(unit.name, base) != base:
                raise UsageError(
                    f'{fmu.path.name}: its unit "{unit.name}" means another one than in other FMUs'
                )
    return units
