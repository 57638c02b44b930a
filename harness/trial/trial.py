"""One trial, from what a user asks for to the files it leaves."""

from __future__ import annotations

import fcntl
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from codegen.firmware.bundle import BLOCKS, TARGETS, find_target, settable
from fmus.archive import pack
from fmus.build import build_all, build_folder, is_current
from harness.cosim.fmu import FmuDescription, describe
from harness.cosim.loop import Array, Simulation, Stop
from harness.cosim.roles import (
    Adapter,
    Fit,
    Rename,
    find_role,
    misfits,
    read_adapter,
    replace_component,
    roles,
)
from harness.cosim.ssp import FmuSystem, open_ssp
from harness.cosim.wiring import Order
from harness.files import make_folder, write_whole
from harness.log.log import Channel, Log, LogWriter, read_log
from harness.onboard.processors import Processor, open_processor
from harness.onboard.stand_in import ROLES, Onboard, commands
from harness.trial.plots import trial_png
from harness.trial.scenario import (
    DEFAULT,
    Interface,
    Plan,
    Scenario,
    ScenarioError,
    interface_of_fmu,
    interfaces_of_system,
    load,
    parse,
    plan,
    values_of,
)
from harness.trial.summary import summarize, write_page, write_summary
from models.commands import ENDS
from models.errors import UsageError
from models.kit.declaration import flatten
from models.kit.link import Values
from models.system import SYSTEMS

PACKAGE, LOG = "system.ssp", "trial.mcap"
SHOWN = ("summary.json", "trial.html", "trial.png")
Start = Callable[[str, Values], Processor]
VERSIONED = ("guided-canine", "fmpy", "casadi", "numpy")


@dataclass(frozen=True)
class Request:
    """What is to be run.

    Attributes:
        scenario: the trial.
        order: of stepping.
        fmi: version of our FMUs.
        swaps: FMUs that take a role's place.
        package: the .ssp if it is not the one of `scenario.system` (that of a log, say).
        log: that it is taken from.
        broken: why that log is not whole, "" if it is.
        onboard: the processor whose firmware takes the place of estimator, controller and command module; ""
            runs their FMUs.
    """

    scenario: Scenario
    order: Order = "sequential"
    fmi: int = 2
    swaps: Mapping[str, Path] = field(default_factory=dict)
    package: Path | None = None
    log: Path | None = None
    broken: str = ""
    onboard: str = ""

    @property
    def ssp(self) -> Path:
        """The package that is run."""
        own = build_folder() / f"{self.scenario.system}.fmi{self.fmi}.ssp"
        return self.package or self.scenario.package or own


@dataclass(frozen=True)
class Changes:
    """What a user wants otherwise than the target says: None and nothing leave it as it is."""

    order: Order | None = None
    fmi: str | None = None
    swaps: Mapping[str, Path | None] = field(default_factory=dict)
    settings: Sequence[str] = ()
    seed: int | None = None
    onboard: str | None = None


@contextmanager
def requested(target: str, changes: Changes) -> Iterator[Request]:
    """What a scenario's file or name, a package, or a log asks for, as long as it is used.

    Raises:
        UsageError, LogError: the target cannot be read, or a setting makes no sense.
    """
    with tempfile.TemporaryDirectory(prefix="canine-") as folder:
        if target.endswith(".mcap"):
            request = _of_log(Path(target), Path(folder))
        elif target.endswith((".ssp", ".ssd")) or (Path(target) / "SystemStructure.ssd").is_file():
            request = _of_package(Path(target).resolve())
        else:
            request = Request(load(target))
        if changes.fmi and request.scenario.system not in SYSTEMS:
            raise UsageError(
                f"--fmi {changes.fmi}: {request.scenario.system} is run with the FMUs that it holds; "
                "leave --fmi out"
            )
        if changes.fmi:
            request = replace(request, fmi=int(changes.fmi), package=None)
        given = {role: path for role, path in changes.swaps.items() if path is not None}
        yield _checked(
            replace(
                request,
                scenario=request.scenario.override(changes.settings, changes.seed),
                order=changes.order or request.order,
                swaps={**request.swaps, **given},
                onboard=request.onboard if changes.onboard is None else _target(changes.onboard),
            )
        )


def _target(onboard: str) -> str:
    """The processor that `--onboard` names, "" for the FMUs.

    Raises:
        UsageError: it names none.
    """
    choices = ["fmu", *(f"pil:{name}" for name in TARGETS)]
    if onboard not in choices:
        raise UsageError(f'--onboard "{onboard}": expected one of {", ".join(choices)}')
    return onboard.removeprefix("pil:").removeprefix("fmu")


def _checked(request: Request) -> Request:
    """The request, if what is to be run on board fits the rest of it.

    Raises:
        UsageError: it does not.
    """
    if request.onboard:
        option = f"--onboard pil:{request.onboard}"
        taken = next((role for role in ROLES if role in request.swaps), None)
        if taken:
            raise UsageError(f"{option}: the firmware takes the place of the {taken}; leave --{taken} out")
        if request.order != "sequential":
            raise UsageError(f"{option}: the firmware answers within a tick; expected --order sequential")
        if request.scenario.system != "full":
            raise UsageError(
                f'{option}: system "{request.scenario.system}" has not our sensors and estimator; '
                'expected a scenario with system = "full"'
            )
    return request


def _of_package(package: Path) -> Request:
    """The default trial with a package: an .ssp, a folder, or a folder's .ssd."""
    name = package.parent.name if package.suffix == ".ssd" else package.stem
    scenario = replace(load(DEFAULT), name=name, system=f"{name}.ssp", folder=package.parent)
    return Request(scenario, package=package)


def _of_log(path: Path, folder: Path) -> Request:
    """The trial of a log, with its order, FMI version, package and swapped FMUs, unpacked into a folder."""
    if not path.is_file():
        raise UsageError(f'there is no log "{path}"; expected the path of a trial.mcap')
    log = read_log(path)
    records, run = log.metadata.get("scenario", {}), log.metadata.get("run", {})
    if "toml" not in records or PACKAGE not in log.attachments:
        raise ScenarioError(f"{path}: holds no scenario and package to run again; it is no log of a trial")
    scenario = parse(records["toml"], f"{path}: scenario", folder=path.parent)
    for name, content in log.attachments.items():
        (folder / Path(name).name).write_bytes(content)
    swaps = {role: folder / name for role, name in log.metadata.get("swaps", {}).items()}
    order: Order = "jacobi" if run.get("order") == "jacobi" else "sequential"
    onboard = run.get("onboard", "")
    return Request(
        scenario, order, int(run.get("fmi", "2")), swaps, folder / PACKAGE, path, log.broken, onboard
    )


@dataclass(frozen=True)
class Prepared:
    """A system with its swaps made, and what the scenario sets in it.

    Attributes:
        renames: for swapped components, the role's outputs by the FMU's names.
    """

    system: FmuSystem
    fmus: Mapping[str, FmuDescription]
    parts: Mapping[str, Interface]
    plan: Plan
    renames: Mapping[str, Mapping[str, tuple[str, Rename]]]
    notes: tuple[str, ...]


def interfaces_on_board() -> dict[str, Interface]:
    """What a scenario can set of the onboard program beside the components that it takes the place of."""
    return {
        member: Interface(
            block.title(), dict(flatten(list(settable(block).values()))), {}, f"{member} {block.title()}"
        )
        for member, block in BLOCKS.items()
        if member not in ROLES
    }


def values_on_board(scenario: str, settings: Sequence[str]) -> Values:
    """The firmware's parameters (SI) as a scenario has them.

    Args:
        scenario: a file with any of a scenario's keys, or the name of a shipped one; "" for start values.
        settings: `block.name=value` over it.

    Raises:
        ScenarioError: it cannot be read, or sets what is not there.
        UsageError: a setting is none of the firmware's, or two commands sound alike.
    """
    parts = interfaces_of_system(SYSTEMS["full"]) | interfaces_on_board()
    wanted = (load(scenario, mission=False) if scenario else Scenario("--set")).override(settings)
    values = plan(wanted, parts).values
    for setting in settings:
        owner, _, name = setting.partition("=")[0].strip().partition(".")
        if not any(
            owner in (component, block.title()) and name in settable(block)
            for component, block in BLOCKS.items()
        ):
            raise UsageError(
                f"--set {owner}.{name}: not in the firmware, whose blocks are {', '.join(BLOCKS)}; "
                "waypoints and home come by radio"
            )
    commands(values["command_module"])
    return firmware_values(values)


def firmware_values(values: Mapping[str, Mapping[str, float]]) -> Values:
    """Of all components' values, those that are parameters of the firmware."""
    return {
        component: {n: x for n, x in values.get(component, {}).items() if n in settable(block)}
        for component, block in BLOCKS.items()
    }


def build_missing(request: Request, done: Callable[[Path], None] = lambda path: None) -> None:
    """Build our FMUs and packages if the one that is asked for is missing, or older than the models."""
    if request.ssp.parent == build_folder() and not (request.ssp.exists() and is_current()):
        build_all(done=done)


@contextmanager
def prepared(request: Request) -> Iterator[Prepared]:
    """Open the package, put swapped FMUs in their places, resolve the scenario.

    Raises:
        CanineError: of the kind of whatever does not fit.
    """
    if not request.ssp.exists():
        raise ScenarioError(f'{request.scenario.name}: there is no package "{request.ssp}"')
    with open_ssp(request.ssp) as system:
        fmus = {name: describe(part.fmu) for name, part in system.components.items()}
        notes: list[str] = []
        fits: dict[str, Fit] = {}
        for role, path in request.swaps.items():
            fmus[role] = describe(path)
            adapter = read_adapter(path, find_role(role))
            system, fits[role] = replace_component(system, role, fmus[role], adapter)  # noqa: PLW2901
            notes += fits[role].notes
        renames = {
            role: {rename.name: (name, rename) for name, rename in fit.outputs.items()}
            for role, fit in fits.items()
        }
        own = (
            interfaces_of_system(SYSTEMS[request.scenario.system])
            if request.scenario.system in SYSTEMS
            else {}
        )
        known = roles()
        parts = {}
        for name, fmu in fmus.items():
            if name in own and name not in fits:
                parts[name] = own[name]
            else:
                wrong = misfits(fmu, known[name]) if name in known and name not in fits else {}
                parts[name] = interface_of_fmu(name, fmu, known.get(name), fits.get(name), wrong)
        if request.onboard:
            parts |= interfaces_on_board()
        bound = {n: {v: x.value for v, x in part.values.items()} for n, part in system.components.items()}
        fed = {name: {k.target_variable for k in system.links if k.target == name} for name in fmus}
        found = plan(request.scenario, parts, bound, fed)
        yield Prepared(system, fmus, parts, found, renames, (*notes, *found.notes))


def run(
    request: Request,
    ready: Prepared,
    out: Path,
    progress: Callable[[float], None] | None = None,
    start: Start = open_processor,
) -> dict[str, Any]:
    """Run a trial; its summary. The log is kept up to where a fault or the user ends it.

    Args:
        start: makes the processor of `request.onboard` with the firmware's parameters.

    Raises:
        UsageError: it would overwrite the log that it is taken from, or one that is being written; the folder
            cannot be made.
        CanineError: a fault in what was run, with its name.
        KeyboardInterrupt: the user ended it.
    """
    if request.log is not None and (out / LOG).resolve() == request.log.resolve():
        raise UsageError(f"--out {out}: holds the log that is read, {request.log}; choose another folder")
    make_folder(out)
    with _alone_in(out):
        for name in SHOWN:  # of an earlier trial: they would not belong to this log
            with suppress(FileNotFoundError):
                (out / name).unlink()
        real_time_factor = _simulate(request, ready, out / LOG, progress, start)
        return _report(read_log(out / LOG), out, real_time_factor)


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Keep other trials from writing into a folder meanwhile; the lock ends with the process."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(
                f"{folder}: another trial is being written there; choose another folder with --out"
            ) from None
        yield
    finally:
        os.close(handle)


def _onboard(request: Request, ready: Prepared, start: Start) -> Onboard:
    """The onboard computer with the scenario's parameters in its firmware."""
    values = _all_values(ready)
    processor = start(request.onboard, firmware_values(values))
    try:
        return Onboard(processor, request.scenario.origin, values, pvt=find_target(request.onboard).pvt)
    except BaseException:
        processor.close()
        raise


def _simulate(
    request: Request, ready: Prepared, path: Path, progress: Callable[[float], None] | None, start: Start
) -> float:
    """Run the trial and write its log; how many times as fast as real time it ran."""
    scenario = request.scenario
    with ExitStack() as stack:
        onboard = _onboard(request, ready, start) if request.onboard else None
        stand_ins = {}
        if onboard is not None:
            stack.callback(onboard.close)
            stand_ins = onboard.stand_ins(ready.fmus)
        simulation = stack.enter_context(
            Simulation(
                ready.system, ready.plan.values, request.order, plants=plants(ready), stand_ins=stand_ins
            )
        )
        if onboard is not None:
            onboard.connect(simulation.outputs("sensors"))
        table = _LogRows(simulation, ready, onboard)
        with LogWriter(
            path,
            table.channels,
            origin=scenario.origin,
            metadata=_metadata(request, ready),
            attachments=_attachments(request, ready),
        ) as log:
            started = time.perf_counter()
            outcome = simulation.run(
                ready.plan.events,
                duration=scenario.duration,
                stop=_stop(simulation),
                record=lambda times, values: table.write(log, times, values),
                progress=progress,
            )
            elapsed = time.perf_counter() - started
    return (outcome.ticks - 1) * simulation.wiring.step / elapsed


def plants(ready: Prepared) -> list[str]:
    """A plant made elsewhere is stepped last, whatever it declares."""
    return [role for role in ready.renames if role == "plant"]


def _stop(simulation: Simulation) -> Stop | None:
    controller = simulation.fmus.get("controller")
    return Stop("controller", "status", ENDS) if controller and "status" in controller.outputs else None


def _report(log: Log, out: Path, real_time_factor: float) -> dict[str, Any]:
    """Write what is made of the log; the summary."""
    summary = summarize(log, round(real_time_factor, 1))
    if {"plant.north", "plant.east"} <= {f"{c.component}.{n}" for c in log.channels for n in c.names}:
        picture = trial_png(log)
        write_whole(out / "trial.png", picture)
        write_page(log, summary, picture, out / "trial.html")
    write_summary(summary, out / "summary.json")
    return summary


class _LogRows:
    """The rows of a simulation as the log's: a swapped component's outputs by its role's names and units."""

    def __init__(self, simulation: Simulation, ready: Prepared, onboard: Onboard | None) -> None:
        self.channels = []
        self.onboard = onboard
        self.scales: dict[str, tuple[Array, Array]] = {}
        for name in simulation.components:
            columns = simulation.columns(name)
            renames = ready.renames.get(name, {})
            role = find_role(name) if renames else None
            names, units, factors, offsets = [], [], [], []
            for column in columns:
                own, rename = renames.get(column.name, (column.name, Rename(column.name)))
                mapped = role is not None and column.name in renames and column.causality == "output"
                taken = {n for n, _ in renames.values()} if not mapped else set()
                names.append(
                    own if mapped else f"{column.name} (FMU)" if column.name in taken else column.name
                )
                units.append(role.needs[own].unit if mapped and role else column.unit or "")
                factors.append(rename.factor if mapped else 1.0)
                offsets.append(rename.offset if mapped else 0.0)
            if any(f != 1.0 for f in factors) or any(offsets):
                self.scales[name] = (np.array(factors), np.array(offsets))
            self.channels.append(
                Channel(
                    name,
                    simulation.fmus[name].model,
                    tuple(names),
                    tuple(units),
                    tuple(column.type.value for column in columns),
                    tuple(column.meaning for column in columns),
                )
            )
        if onboard is not None:
            self.channels.append(onboard.channel())

    def write(self, log: LogWriter, times: Array, values: Mapping[str, Array]) -> None:
        """Write rows as `Simulation.run` hands them over."""
        lists = {}
        for name, rows in values.items():
            factor, offset = self.scales.get(name, (None, None))
            lists[name] = (rows if factor is None or offset is None else rows * factor + offset).tolist()
        for i, moment in enumerate(times.tolist()):
            row = {name: rows[i] for name, rows in lists.items()}
            if self.onboard is not None:
                row["telemetry"] = self.onboard.row(moment)
            log.write(moment, row)


def _metadata(request: Request, ready: Prepared) -> dict[str, dict[str, str]]:
    scenario = request.scenario
    return {
        "scenario": {"name": scenario.name, "seed": str(scenario.seed), "toml": scenario.text()},
        "parameters": values_of(ready.parts, _all_values(ready)),
        "roles": {name: fmu.model for name, fmu in ready.fmus.items()},
        "run": {"order": request.order, "fmi": str(request.fmi)}
        | ({"onboard": request.onboard} if request.onboard else {}),
        "swaps": {role: f"{role}.fmu" for role in request.swaps},
        "versions": {name: version(name) for name in VERSIONED},
    }


def _all_values(ready: Prepared) -> dict[str, dict[str, float]]:
    """The scenario's values over those of the package."""
    own = {name: {n: v.value for n, v in c.values.items()} for name, c in ready.system.components.items()}
    return {name: own.get(name, {}) | values for name, values in ready.plan.values.items()}


def _attachments(request: Request, ready: Prepared) -> dict[str, bytes]:
    """The package and the swapped FMUs with their mapping files: what it takes to run the trial again."""
    files = {PACKAGE: _package(request, ready)}
    for role, path in request.swaps.items():
        files[f"{role}.fmu"] = path.read_bytes()
        adapter = Adapter(path.with_suffix(".toml")).path
        if adapter.is_file():
            files[f"{role}.toml"] = adapter.read_bytes()
    return files


def _package(request: Request, ready: Prepared) -> bytes:
    """The package, packed if it lies unpacked in a folder: the .ssd and the files that it names."""
    if request.ssp.is_file() and request.ssp.suffix == ".ssp":
        return request.ssp.read_bytes()
    files = {name: path.read_bytes() for name, path in ready.system.files.items()}
    with tempfile.TemporaryDirectory(prefix="canine-") as folder:
        return pack(Path(folder) / PACKAGE, files).read_bytes()


def default_folder(request: Request) -> Path:
    """Where a trial's files go if nobody says: out/<scenario>-<seed>; a log's, to <its folder>-again."""
    if request.log is not None:
        folder = request.log.resolve().parent
        return folder.with_name(f"{folder.name}-again")
    return Path("out") / f"{request.scenario.name}-{request.scenario.seed}"
