"""A station is opened: its port, or a simulated vest; what is known of the vest; its log and summary."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from codegen.firmware.bundle import settable
from codegen.firmware.key import Key
from harness.log.ground import Ground
from harness.log.live import Viewers
from harness.log.log import FILE, LogError, read_log
from harness.station.formats.scenario import of_scenario
from harness.station.ports import Port, PortError, open_port
from harness.station.session import About, Session
from harness.station.shown import world_of
from harness.station.sink import Sink
from harness.trial.firmware import firmware_values, interfaces_on_board, navigation_of
from harness.trial.page import write_page
from harness.trial.plan import Interface, ground_values, interfaces_of_system, plan, values_of
from harness.trial.scenario import Scenario, load
from harness.trial.summary import summarize, write_summary
from harness.trial.trial import PAGE, SUMMARY, alone_in
from harness.vest.vest import Vest, guarded, open_vest
from models.errors import UsageError
from models.kit.declaration import flatten
from models.readings import ON_BOARD
from models.system import find_system

Note = Callable[[str], None]


@dataclass(frozen=True)
class Request:
    """What a station is to be.

    Attributes:
        port: a serial device, or tcp://host:port; "" for a simulated vest.
        simulate: the scenario of a simulated vest.
        speed: trial time over the clock's, of a simulated vest.
        key: of the vest; None for one that was built without.
        out: the folder of the log; None for the default one.
        viewers: who are shown what is logged.
    """

    port: str = ""
    simulate: str = ""
    speed: float = 1.0
    seed: int | None = None
    key: Key | None = None
    out: Path | None = None
    viewers: Viewers | None = None

    @cached_property
    def folder(self) -> Path:
        """Of the log: a simulated vest's is written over, another one's has a name of its own."""
        if self.out is not None:
            return self.out
        if self.simulate:
            return Path("out") / f"station-{Path(self.simulate).stem}"
        return Path("out") / f"station-{datetime.now():%Y%m%d-%H%M%S}"


class SimulatedPort:
    """The radio of a vest in this process; it is closed by its owner."""

    def __init__(self, vest: Vest) -> None:
        self._vest = vest

    def read(self) -> bytes:
        """As `Port`."""
        if not self._vest.is_running:
            raise PortError(f"the simulated vest has ended: {self._vest.fault or 'its scenario is over'}")
        return self._vest.port.read()

    def write(self, data: bytes) -> None:
        """As `Port`."""
        self._vest.port.write(data)

    def close(self) -> None:
        """As `Port`."""


@contextmanager
def opened(
    request: Request, note: Note, built: Callable[[Path], None] = lambda path: None
) -> Iterator[Session]:
    """A station at work; at the end a mission that is under way is aborted, and the log is closed.

    Args:
        note: is told what the user should know.
        built: is told of each FMU of a simulated vest that had to be built.

    Raises:
        UsageError: the port cannot be opened, the scenario or the folder cannot be used.
        CanineError: the simulated vest failed.
    """
    folder = request.folder
    with ExitStack() as stack:
        stack.enter_context(alone_in(folder))
        if request.port and (folder / FILE).exists():
            raise UsageError(
                f"--out {folder}: holds a log, {FILE}, and a real vest's is never written over; "
                "choose another folder"
            )
        scenario = _scenario(request, note)
        about = _about(request, scenario)
        port: Port
        reopen: Callable[[], Port] | None = None
        if scenario:
            vest = stack.enter_context(
                open_vest(scenario, speed=request.speed, key=request.key, note=note, built=built)
            )
            port = SimulatedPort(vest)
        else:
            port, reopen = open_port(request.port, note), lambda: open_port(request.port)
        origin = scenario.origin if scenario else None
        metadata = _metadata(about, scenario)
        for name in (SUMMARY, PAGE):  # an earlier station's: they would not belong to this log
            with suppress(FileNotFoundError):
                (folder / name).unlink()
        sink = Sink(folder, metadata, speed=request.speed, origin=origin, viewers=request.viewers)
        session = Session(port, request.key, sink, about, reopen=reopen)
        try:
            yield session
        finally:
            session.close()


def _scenario(request: Request, note: Note) -> Scenario | None:
    """What a simulated vest, animal and sensors are; None with a real vest."""
    if not request.simulate:
        return None
    scenario = load(request.simulate)
    seed = scenario.seed if request.seed is None else request.seed
    return replace(guarded(scenario, note), seed=seed)


def _about(request: Request, scenario: Scenario | None) -> About:
    """What is known of the vest."""
    if scenario is None:
        return About(request.port, vest_parameters(Scenario(request.port, reading=ON_BOARD)))
    ground = Ground.of(_animals_world(scenario))
    return About(
        f"simulation of {scenario.name}",
        vest_parameters(scenario),
        of_scenario(scenario),
        world_of(ground, scenario.origin),
    )


def _animals_world(scenario: Scenario) -> dict[str, str]:
    """The streets and poles as a log's parameters state them: the vest has no such parameters."""
    return {f"plant.{name}": repr(float(value)) for name, value in ground_values(scenario).items()}


def vest_parameters(scenario: Scenario) -> dict[str, str]:
    """The parameters of a vest with the firmware of a scenario, `component.name` to its value (SI)."""
    name = "full_ahrs" if scenario.system == "full_ahrs" else "full"
    system = find_system(name, scenario.estimator, scenario.plant)
    navigation = navigation_of(system)
    written = replace(scenario, system=name, waypoints=(), fence=(), sets=(), faults=())
    values = plan(written, interfaces_of_system(system) | interfaces_on_board()).values
    interfaces = {
        component: Interface(block.title(), dict(flatten(list(settable(block).values()))), {}, component)
        for component, block in navigation.blocks.items()
    }
    return values_of(interfaces, firmware_values(values, navigation))


def _metadata(about: About, scenario: Scenario | None) -> dict[str, dict[str, str]]:
    named, parameters = {"name": "station", "seed": ""}, dict(about.parameters)
    if scenario:
        named = {"name": scenario.name, "seed": str(scenario.seed), "toml": scenario.text()}
        parameters |= _animals_world(scenario)
    return {"scenario": named, "parameters": parameters, "run": {"station": about.source}}


def report(folder: Path) -> Mapping[str, Any] | None:
    """Write summary.json, of the last mission, and the page of a log; the summary, None without a log.

    Raises:
        FileError: they cannot be written.
    """
    try:
        log = read_log(folder / FILE)
    except LogError:
        return None
    summary = summarize(log)
    write_summary(summary, folder / SUMMARY)
    write_page(log, summary, folder / PAGE)
    return summary
