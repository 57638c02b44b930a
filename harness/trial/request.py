"""A request: what a user asks to be run, from a scenario, a package, or the log of an earlier trial."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast, get_args

from codegen.firmware.targets import IN_THE_LOOP
from codegen.scratch import Scratch
from fmus.archive import check_sealed
from fmus.folder import build_folder, is_current
from harness.cosim.archive import holder, naming, read_member
from harness.cosim.stepping import Limits, Loop, Order
from harness.files import nearest_file
from harness.onboard import ROLES
from harness.trial import DEFAULT
from harness.trial.faults import fault_fmus
from harness.trial.replacements import find_replacement
from harness.trial.scenario import Scenario, ScenarioError, checked, load, parse, with_estimator
from models.disturbance import FAULTS
from models.errors import UsageError, printable
from models.readings import ON_BOARD, READING
from models.system import ESTIMATORS, SYSTEMS, find_system

PACKAGE = "system.ssp"  # a log's attachment
SCENARIO = "resources/scenario.toml"  # in a package that was exported from a scenario
SEEDED = ("plant", "sensors")
FAULT_NAMES = {block.title() for block in FAULTS.values()}


@dataclass(frozen=True)
class Request:
    """What is to be run.

    Attributes:
        scenario: what happens in the trial.
        order: of stepping.
        fmi: version of our FMUs.
        swaps: FMUs that take the place of a role's.
        package: the .ssp, where it is another than that of `scenario.system`; a log holds its own.
        log: the log that is run again.
        broken: why that log is not whole; "" if it is.
        onboard: the processor whose firmware takes the place of estimator, controller and command module; ""
            runs their FMUs.
        loop: what makes the calls of a tick; both give the same log. None: `native`; with firmware on board
            `python`, from where the processor is called.
        limits: for FMUs that others built.
    """

    scenario: Scenario
    order: Order = "sequential"
    fmi: int = 2
    swaps: Mapping[str, Path] = field(default_factory=dict)
    package: Path | None = None
    log: Path | None = None
    broken: str = ""
    onboard: str = ""
    loop: Loop | None = None
    limits: Limits = field(default_factory=Limits)

    @property
    def ssp(self) -> Path:
        """The package that is run."""
        return self.package or self.scenario.package or self.own_package

    @property
    def own_package(self) -> Path:
        """Our own of the scenario's system."""
        system = find_system(self.scenario.system, self.scenario.estimator, self.scenario.plant)
        return build_folder() / f"{system.name}.fmi{self.fmi}.ssp"

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know."""
        return (f"{self.log}: the log is not whole, {self.broken}",) if self.broken else ()

    @property
    def default_folder(self) -> Path:
        """Where the results go by default: out/<scenario>-<seed>; those of a log into <its folder>-again."""
        if self.log is not None:
            folder = self.log.resolve().parent
            return folder.with_name(f"{folder.name}-again")
        return Path("out") / f"{self.scenario.name}-{self.scenario.seed}"


@dataclass(frozen=True)
class Changes:
    """Overrides of what the target states; None or empty keeps the target's value.

    Attributes:
        swaps: by role (plant, controller), the name of one of ours, or the path of an FMU.
        estimator: the name of one of ours, or the path of an FMU.
        ahrs: put our AHRS between sensors and estimator.
    """

    order: Order | None = None
    fmi: str | None = None
    swaps: Mapping[str, str | Path | None] = field(default_factory=dict)
    settings: Sequence[str] = ()
    seed: int | None = None
    onboard: str | None = None
    estimator: str | None = None
    ahrs: bool = False
    loop: Loop | None = None
    limits: Limits = field(default_factory=Limits)


@contextmanager
def requested(target: str | Scenario, changes: Changes) -> Iterator[Request]:
    """The request that a target and its changes make. A log's files are there until the context ends.

    Args:
        target: a scenario, its file or its shipped name; a package; or a log.

    Raises:
        UsageError, LogError: the target cannot be read, or a change does not fit it.
    """
    with Scratch() as folder, naming(folder, target):
        request = _request_of(target, folder)
        if changes.fmi and request.scenario.system not in SYSTEMS:
            raise UsageError(
                f"--fmi {changes.fmi}: {request.scenario.system} is run with the FMUs that it holds; "
                "leave --fmi out"
            )
        if changes.fmi:
            request = replace(request, fmi=int(changes.fmi), package=None)
        request = _with_ahrs(_with_estimator(request, changes.estimator), changes.ahrs)
        swaps = {role: _fmu(request, role, fmu) for role, fmu in changes.swaps.items() if fmu is not None}
        onboard = request.onboard if changes.onboard is None else _processor(changes.onboard)
        swaps = {**request.swaps, **swaps}
        request = replace(request, swaps=swaps)
        if changes.seed is not None:
            request = with_seed(request, changes.seed)
        blocks = _blocks_of(swaps) if changes.settings and request.scenario.parameters else {}
        scenario = request.scenario.override(changes.settings, swaps=blocks)
        reading = scenario.reading or (ON_BOARD if onboard else READING)
        yield _checked(
            replace(
                request,
                scenario=replace(scenario, reading=reading),
                order=changes.order or request.order,
                onboard=onboard,
                loop=changes.loop,
                limits=changes.limits,
            )
        )


def with_seed(request: Request, seed: int) -> Request:
    """The request with another seed, also where its package binds one: in the dog, the sensors, and faults.

    Raises:
        ScenarioError: no trial can have the seed.
        CanineError: the package cannot be read.
    """
    (one,) = with_seeds(request, [seed])
    return one


def with_seeds(request: Request, seeds: Iterable[int]) -> Iterator[Request]:
    """As `with_seed`, with each of several; the package is read once."""
    drawing = _drawing(request)
    for seed in seeds:
        scenario = request.scenario.override((), seed)
        if drawing:
            scenario = scenario.override(f"{name}.seed={seed}" for name in drawing)
        yield replace(request, scenario=scenario)


def _drawing(request: Request) -> list[str]:
    """The components whose seed a package of others binds: the dog, the sensors, and faults."""
    is_foreign = request.package is not None or request.scenario.package is not None
    if not is_foreign or not os.path.exists(holder(request.ssp)):  # unlike Path's, it raises nothing
        return []
    from harness.cosim.fmu import describe  # noqa: PLC0415 - fmpy
    from harness.cosim.in_place import adapters_in  # noqa: PLC0415 - fmpy
    from harness.cosim.ssp import open_ssp  # noqa: PLC0415 - fmpy

    with open_ssp(request.ssp) as system:
        mapped = {n: adapter.parameters for n, adapter in adapters_in(system).items()}
        names = {n: own["seed"].name for n, own in mapped.items() if "seed" in own}
        binding = [c for c in system.components.values() if names.get(c.name, "seed") in c.values]
        drawing = [c.name for c in binding if c.name in SEEDED or describe(c.fmu).model in FAULT_NAMES]
    return [name for name in drawing if name not in request.swaps]


def _request_of(target: str | Scenario, folder: Path) -> Request:
    """What the target alone asks for; `folder` takes files of a log or a package."""
    if isinstance(target, Scenario):
        return Request(checked(target))
    if target.endswith(".mcap"):
        return _of_log(Path(target), folder)
    if target.endswith((".ssp", ".ssd")) or os.path.isfile(Path(target) / "SystemStructure.ssd"):
        held = holder(Path(target))
        if not os.path.exists(target if os.path.isdir(held) else held):  # unlike Path's, it raises nothing
            raise UsageError(f'there is no package "{target}"{nearest_file(Path(target))}')
        return _of_package(Path(target).resolve(), folder)
    return Request(load(target))


def _of_package(package: Path, folder: Path) -> Request:
    """The trial of a package, an .ssp, a folder, or the .ssd in one of both: its scenario or the default."""
    held = holder(package)
    written = held / SCENARIO
    if held.is_file() and (text := read_member(held, SCENARIO)) is not None:
        written = folder / written.name
        written.write_bytes(text)
    scenario = load(str(written) if written.is_file() else DEFAULT)
    name = package.stem
    if package.suffix == ".ssd":
        whole = package.parent.name.removesuffix(".ssp")
        name = whole if package.stem == "SystemStructure" else f"{whole}-{package.stem}"
    scenario = replace(scenario, name=name, system=f"{name}.ssp", folder=package.parent)
    return Request(scenario, package=package)


def _of_log(path: Path, folder: Path) -> Request:
    """The trial of a log with its order, FMI version, package and swapped FMUs, unpacked into a folder.

    Raises:
        UsageError, LogError: there is none, it is damaged, or states what no trial of ours could.
    """
    if not path.is_file():
        hint = nearest_file(path) or "; expected the path of a trial.mcap"
        raise UsageError(f'there is no log "{path}"{hint}')
    from harness.cosim.roles import roles  # noqa: PLC0415 - fmpy
    from harness.log.log import read_log  # noqa: PLC0415 - MCAP and protobuf

    log = read_log(path)
    records, run = log.metadata.get("scenario", {}), log.metadata.get("run", {})
    if "toml" not in records or PACKAGE not in log.attachments:
        raise ScenarioError(
            f"{path}: has neither scenario nor package; expected the log of a trial that `canine run` wrote"
        )
    swaps, order, fmi = log.metadata.get("swaps", {}), run.get("order", "sequential"), run.get("fmi", "2")
    known = {PACKAGE, *(f"{role}{suffix}" for role in roles() for suffix in (".fmu", ".toml"))}
    for what, value, expected in [
        *(("attachment", name, known) for name in log.attachments),
        *(("role of a swap", role, roles()) for role in swaps),
        *(("FMU of a swap", name, log.attachments) for name in swaps.values()),
        ("order", order, get_args(Order)),
        ("FMI version", fmi, ("2", "3")),
        ("processor", run.get("onboard", ""), ("", *IN_THE_LOOP)),
    ]:
        if value not in expected:
            names = ", ".join(sorted(filter(None, expected)))
            raise ScenarioError(f'{path}: {what} "{printable(value)}"; expected one of {names}')
    for name, content in log.attachments.items():
        (folder / name).write_bytes(content)
    return Request(
        parse(records["toml"], f"{path}: scenario", folder=path.parent),
        cast("Order", order),
        int(fmi),
        {role: folder / name for role, name in swaps.items()},
        folder / PACKAGE,
        path,
        log.broken,
        run.get("onboard", ""),
    )


def _fmu(request: Request, role: str, fmu: str | Path) -> Path:
    """The FMU that takes a role's place: one of ours by its name, or the one at a path.

    Raises:
        UsageError: it is neither.
    """
    part = find_replacement(role, fmu)
    return part if isinstance(part, Path) else build_folder() / f"fmi{request.fmi}" / f"{part}.fmu"


def _blocks_of(swaps: Mapping[str, Path]) -> dict[str, str]:
    """The names of the blocks in swapped FMUs, by role."""
    from harness.cosim.fmu import describe  # noqa: PLC0415 - fmpy

    # one that is not there is ours, and will be built
    return {r: describe(path).model if os.path.isfile(path) else path.stem for r, path in swaps.items()}


def _with_estimator(request: Request, estimator: str | None) -> Request:
    """The request with one of our estimators, or an FMU, in the estimator's place.

    Raises:
        UsageError: there is no such estimator or FMU, or the system has no place for one.
    """
    if estimator is None:
        return request
    scenario, swaps = request.scenario, dict(request.swaps)
    if estimator not in ESTIMATORS or scenario.system not in SYSTEMS:
        return replace(request, swaps=swaps | {"estimator": _fmu(request, "estimator", estimator)})
    if scenario.system not in with_estimator():
        raise UsageError(
            f'--estimator {estimator}: the system "{scenario.system}" has no estimator; '
            f"expected one of {', '.join(with_estimator())}"
        )
    swaps.pop("estimator", None)
    return replace(request, scenario=replace(scenario, estimator=estimator), swaps=swaps, package=None)


def _with_ahrs(request: Request, ahrs: bool) -> Request:
    """The request with our AHRS between sensors and estimator, if asked for.

    Raises:
        UsageError: it has no place in the system.
    """
    system = request.scenario.system
    if not ahrs or system == "full_ahrs":
        return request
    if system != "full":
        raise UsageError(f'--ahrs: the system "{system}" lacks our sensors and estimator; expected "full"')
    return replace(request, scenario=replace(request.scenario, system="full_ahrs"), package=None)


def _processor(onboard: str) -> str:
    """The processor that `--onboard` names; "" for the FMUs.

    Raises:
        UsageError: there is no such processor.
    """
    choices = ["fmu", *(f"pil:{name}" for name in IN_THE_LOOP)]
    if onboard not in choices:
        raise UsageError(f'onboard "{onboard}": expected one of {", ".join(choices)}')
    return onboard.removeprefix("pil:").removeprefix("fmu")


def _checked(request: Request) -> Request:
    """The request itself, if firmware on board fits the rest of it.

    Raises:
        UsageError: it does not.
    """
    if request.onboard:
        option = f"--onboard pil:{request.onboard}"
        taken = next((role for role in ROLES if role in request.swaps), None)
        if taken == "estimator":
            raise UsageError(
                f"--estimator {request.swaps[taken]}: firmware is made of our own estimators; "
                f"expected one of {', '.join(ESTIMATORS)}"
            )
        if taken:
            raise UsageError(f"{option}: the firmware takes the place of the {taken}; leave --{taken} out")
        if request.order != "sequential":
            raise UsageError(f"{option}: the firmware answers within a tick; expected --order sequential")
        if request.loop == "native":
            raise UsageError(f"{option}: the processor is called from Python; expected --loop python")
        if request.scenario.system not in with_estimator():
            raise UsageError(
                f'{option}: system "{request.scenario.system}" lacks our sensors and estimator; '
                'expected a scenario with system = "full"'
            )
    return request


def build_missing(request: Request, done: Callable[[Path], None] = lambda path: None) -> None:
    """Build our FMUs and packages if those that are requested are missing, or older than the models.

    Raises:
        AlteredError: one has been changed since it was built.
    """
    folder, package = build_folder().resolve(), holder(request.ssp).resolve()
    faults = fault_fmus(request.scenario, build_folder() / f"fmi{request.fmi}")
    fmus = [path.resolve() for path in (*request.swaps.values(), *faults)]
    own = [path for path in (package, *fmus) if folder in path.parents]
    if own and not (all(path.exists() for path in own) and is_current()):
        from fmus.build import build_all  # noqa: PLC0415 - CasADi and templates

        build_all(done=done)
    system = request.scenario.own_system
    if package in own and system and system not in SYSTEMS.values():
        from fmus.build import build_package  # noqa: PLC0415 - CasADi and templates

        done(build_package(system, request.fmi))
    for path in filter(os.path.exists, own):
        check_sealed(path)
