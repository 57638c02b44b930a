"""A station is opened: its port, or a simulated vest; what is known of the vest; its log and summary."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from codegen.firmware.bundle import settable
from codegen.firmware.key import Key
from harness.files import make_folder
from harness.log.geodesy import TangentPlane
from harness.log.log import FILE, Log, LogError, read_log
from harness.onboard.radio import Position
from harness.station.draft import Draft
from harness.station.ports import Port, PortError, open_port
from harness.station.session import About, Session
from harness.station.sink import Sink
from harness.trial.firmware import firmware_of
from harness.trial.plan import Interface, values_of
from harness.trial.scenario import Scenario, load
from harness.trial.summary import summarize, write_summary
from harness.trial.trial import SUMMARY, alone_in
from harness.vest.vest import Vest, open_vest
from models.errors import UsageError
from models.kit.declaration import flatten

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
    """

    port: str = ""
    simulate: str = ""
    speed: float = 1.0
    seed: int | None = None
    key: Key | None = None
    out: Path | None = None

    @property
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
def opened(request: Request, note: Note) -> Iterator[Session]:
    """A station at work; at the end a mission that is under way is aborted, and the log is closed.

    Raises:
        UsageError: the port cannot be opened, the scenario or the folder cannot be used.
        CanineError: the simulated vest failed.
    """
    folder = request.folder
    make_folder(folder)
    with ExitStack() as stack:
        stack.enter_context(alone_in(folder))
        if request.port and (folder / FILE).exists():
            raise UsageError(
                f"--out {folder}: holds a log, {FILE}, and a real vest's is never written over; "
                "choose another folder"
            )
        with suppress(FileNotFoundError):
            (folder / SUMMARY).unlink()
        about, origin, scenario = _about(request)
        port: Port
        reopen: Callable[[], Port] | None = None
        if request.simulate:
            vest = stack.enter_context(
                open_vest(
                    request.simulate,
                    seed=request.seed,
                    speed=request.speed,
                    key=request.key,
                    note=note,
                )
            )
            port = SimulatedPort(vest)
        else:
            port, reopen = open_port(request.port, note), lambda: open_port(request.port)
        sink = Sink(folder, _metadata(about, scenario), speed=request.speed, origin=origin)
        session = Session(port, request.key, sink, about, reopen=reopen)
        try:
            yield session
        finally:
            session.close()


def _about(request: Request) -> tuple[About, tuple[float, float] | None, Scenario | None]:
    """What is known of the vest, the origin in degrees and the scenario, where one is simulated."""
    parameters = vest_parameters(request.simulate)
    if not request.simulate:
        return About(request.port, parameters), None, None
    scenario = load(request.simulate)
    if request.seed is not None:
        scenario = replace(scenario, seed=request.seed)
    plane = TangentPlane(*map(math.radians, scenario.origin))

    def places(points: Sequence[Sequence[float]]) -> tuple[Position, ...]:
        return tuple(Position(*plane.place(north, east)) for north, east in points)

    home = places([(scenario.start[0], scenario.start[1])])[0]
    mission = Draft(home, places(scenario.waypoints), places(scenario.fence))
    return About(f"simulation of {scenario.name}", parameters, mission), scenario.origin, scenario


def vest_parameters(scenario: str = "") -> dict[str, str]:
    """The parameters of a vest with the firmware of a scenario, `component.name` to its value (SI)."""
    navigation, values = firmware_of(scenario, ())
    interfaces = {
        component: Interface(block.title(), dict(flatten(list(settable(block).values()))), {}, component)
        for component, block in navigation.blocks.items()
    }
    return values_of(interfaces, values)


def _metadata(about: About, scenario: Scenario | None) -> dict[str, dict[str, str]]:
    named = {"name": "station", "seed": ""}
    if scenario:
        named = {"name": scenario.name, "seed": str(scenario.seed), "toml": scenario.text()}
    return {"scenario": named, "parameters": dict(about.parameters), "run": {"station": about.source}}


def last_mission(log: Log) -> Log:
    """A station's log up to the end of the last mission that was under way; the log itself if none was."""
    rows = np.flatnonzero(log["controller.start"] != 0)
    if not rows.size:
        return log
    until = int(rows[-1]) + 1
    values = {component: table[:until] for component, table in log.values.items()}
    return replace(log, time=log.time[:until], values=values)


def report(folder: Path) -> Mapping[str, Any] | None:
    """Write summary.json of a station's log, of its last mission, and return it; None without a log."""
    try:
        log = read_log(folder / FILE)
    except LogError:
        return None
    mission = last_mission(log)
    started = np.flatnonzero(np.diff(mission["controller.start"], prepend=0.0) > 0)
    began = float(mission.time[started[-1]]) if started.size else None
    summary = summarize(mission) | {"started_s": began}
    write_summary(summary, folder / SUMMARY)
    return summary
