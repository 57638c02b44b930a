"""What the log of a trial holds: rows by the roles' names, metadata, and the files to run it again."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np

from codegen.scratch import Scratch
from fmus.archive import pack
from harness.cosim.fmu import Quantity
from harness.cosim.loop import Array, Simulation
from harness.cosim.roles import Fit, Role, find_role
from harness.cosim.worker.contained import Contained
from harness.log.channel import Channel
from harness.log.writer import LogWriter
from harness.trial.instances import Telemetry
from harness.trial.plan import values_of
from harness.trial.prepare import Prepared
from harness.trial.request import PACKAGE, Request

VERSIONED = ("guided-canine", "fmpy", "casadi", "numpy")


class LogRows:
    """A simulation's rows for the log; what of a swapped component its role has is by its names and units.

    Args:
        unknown: components whose signals nobody knows.
    """

    def __init__(
        self,
        simulation: Simulation | Contained,
        ready: Prepared,
        onboard: Telemetry | None,
        unknown: Collection[str] = (),
    ) -> None:
        self.channels: list[Channel] = []
        self.onboard = onboard
        self.scales: dict[str, tuple[list[int], Array]] = {}
        for name in simulation.components:
            if name in ready.system.faults or name in unknown:
                continue  # what a fault is given and what it gives are signals of others
            named = _Named(find_role(name), ready.fits[name]) if name in ready.fits else None
            columns, picked = [], []
            for place, quantity in enumerate(simulation.columns(name)):
                several = _columns(quantity, named)
                columns += several
                picked += [place] * len(several)
            scales = [(*column.from_input, *column.from_output) for column in columns]
            if any(scale != (1.0, 0.0, 1.0, 0.0) for scale in scales) or len(picked) != len(set(picked)):
                self.scales[name] = (picked, np.array(scales).T)
            self.channels.append(
                Channel(
                    name,
                    simulation.fmus[name].model,
                    tuple(column.name for column in columns),
                    tuple(column.unit for column in columns),
                    tuple(column.type for column in columns),
                    tuple(column.meaning for column in columns),
                )
            )
        if onboard is not None:
            self.channels.append(onboard.channel())

    def by_roles(self, values: Mapping[str, Array]) -> dict[str, Array]:
        """Rows in the roles' units, with the columns of `channels`; as `Simulation.run` hands them over."""
        rows = dict(values)
        for name, (picked, (in_factor, in_offset, out_factor, out_offset)) in self.scales.items():
            rows[name] = (values[name][:, picked] - in_offset) / in_factor * out_factor + out_offset
        return rows

    def logged(self, times: Array, values: Mapping[str, Array]) -> dict[str, Array]:
        """The log's rows of those that `Simulation.run` hands over."""
        rows = self.by_roles(values)
        if self.onboard is not None:
            rows["telemetry"] = np.array([self.onboard.row(time) for time in times.tolist()])
        return rows

    def write(self, log: LogWriter, times: Array, values: Mapping[str, Array]) -> None:
        """Write rows as `Simulation.run` hands them over."""
        log.write_rows(times, self.logged(times, values))


@dataclass(frozen=True)
class _Named:
    """The names of a swapped component."""

    role: Role
    fit: Fit


@dataclass(frozen=True)
class _Column:
    """One signal in the log.

    Attributes:
        from_output: factor and offset that make of an output the role's value.
        from_input: those that made of the role's value an input.
    """

    name: str
    unit: str
    type: str
    meaning: str
    from_output: tuple[float, float] = (1.0, 0.0)
    from_input: tuple[float, float] = (1.0, 0.0)


def _columns(quantity: Quantity, named: _Named | None) -> list[_Column]:
    """A component's variable in the log: more than once, if it stands for more than one output of a role.

    A swapped component's outputs and renamed inputs get the role's names and units. Another variable of it
    that bears the name of one of those is marked "(FMU)".
    """
    name, unit = quantity.name, quantity.unit or ""
    kind, meaning = quantity.type.value, quantity.meaning
    if named is None:
        return [_Column(name, unit, kind, meaning)]
    role, outputs = named.role, named.fit.outputs
    inputs = {own: rename for own, rename in named.fit.inputs.items() if rename.mapped}
    columns = []
    if quantity.causality == "output":
        columns = [
            _Column(own, role.needs[own].unit, kind, meaning, from_output=(r.factor, r.offset))
            for own, r in outputs.items()
            if r.name == name
        ]
    elif quantity.causality == "input":
        columns = [
            _Column(own, role.inputs[own].unit, kind, meaning, from_input=(r.factor, r.offset))
            for own, r in inputs.items()
            if r.name == name
        ]
    mark = " (FMU)" if name in outputs or name in inputs else ""
    return columns or [_Column(f"{name}{mark}", unit, kind, meaning)]


def metadata(request: Request, ready: Prepared) -> dict[str, dict[str, str]]:
    """The records of a log: scenario, parameters, roles, how it was run, versions; text to text."""
    scenario = request.scenario
    return {
        "scenario": {"name": scenario.name, "seed": str(scenario.seed), "toml": scenario.text()},
        "parameters": values_of(ready.interfaces, ready.values),
        "roles": {name: fmu.model for name, fmu in ready.fmus.items() if name not in ready.system.faults},
        "run": {"order": request.order, "fmi": str(request.fmi)}
        | ({"onboard": request.onboard} if request.onboard else {}),
        "swaps": {role: f"{role}.fmu" for role in request.swaps},
        "versions": {name: version(name) for name in VERSIONED},
    }


def attachments(request: Request, ready: Prepared) -> dict[str, bytes]:
    """The files that it takes to run the trial again: package, swapped FMUs and their mapping files."""
    files = {PACKAGE: _package(request, ready)}
    for role, path in request.swaps.items():
        files[f"{role}.fmu"] = path.read_bytes()
        mapping = path.with_suffix(".toml")
        if mapping.is_file():
            files[f"{role}.toml"] = mapping.read_bytes()
    return files


def _package(request: Request, ready: Prepared) -> bytes:
    """The package. One that is unpacked in a folder is packed: the .ssd and the files that it names."""
    if request.ssp.is_file() and request.ssp.suffix == ".ssp":
        return request.ssp.read_bytes()
    files = {name: path.read_bytes() for name, path in ready.system.files.items()}
    with Scratch() as folder:
        return pack(folder / PACKAGE, files).read_bytes()
