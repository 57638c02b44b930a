"""A vest that is open: its program, its animal and its instruments run in a thread, paced by the clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from codegen.firmware.key import Key
from codegen.firmware.targets import find_target
from harness.cosim.loop import Array, Record, Simulation
from harness.log.log import FILE
from harness.log.writer import LogWriter
from harness.onboard import IN_FIRMWARE
from harness.onboard.processors import Resettable, open_processor
from harness.onboard.stand_in import by_name
from harness.trial import DEFAULT
from harness.trial.contents import LogRows, metadata
from harness.trial.instances import is_foreign, open_as, simulate_here
from harness.trial.prepare import Prepared, prepared
from harness.trial.request import Changes, Request, build_missing, requested
from harness.trial.scenario import Scenario
from harness.trial.trial import alone_in
from harness.vest import BY_CLOCK, SPEEDS, TARGETS
from harness.vest.host_process import open_host_process
from harness.vest.pace import Pace
from harness.vest.port import Port, wire
from harness.vest.worn import Worn
from models.commands import Command
from models.errors import UsageError
from models.kit.timing import TICK
from models.readings import ON_BOARD

ENDLESS = 1e8  # s: it ends when it is stopped
UNKNOWN = {*IN_FIRMWARE} - {"command_module"}  # whose signals a program that runs alone keeps to itself
ORDERS = ("controller.start", "controller.override")  # of a scenario, which an operator gives by radio

Sleep = Callable[[threading.Event, float], object]


@dataclass(frozen=True)
class State:
    """What is true of a vest on a tick.

    Attributes:
        time: s of the trial.
        north, east, heading, speed: of the animal itself; m, m, rad clockwise from north, m/s.
        command: what is played on it.
        ticks, missed, latest, lost: see `Pace`; s of the clock.
        resets: of the program.
        dropped: bytes that came faster than the radio carries.
    """

    time: float = 0.0
    north: float = 0.0
    east: float = 0.0
    heading: float = 0.0
    speed: float = 0.0
    command: Command = Command.NONE
    ticks: int = 0
    missed: int = 0
    latest: float = 0.0
    lost: float = 0.0
    resets: int = 0
    dropped: int = 0

    def account(self) -> str:
        """What became of the ticks, in words."""
        parts = [f"{self.ticks:,} ticks", f"{self.missed:,} deadlines missed"]
        parts.append(f"{1000 * self.latest:.1f} ms late at most")
        if self.lost:
            parts.append(f"{self.lost:.1f} s left out")
        if self.dropped:
            parts.append(f"{self.dropped:,} bytes came faster than the radio carries")
        if self.resets:
            parts.append(f"{self.resets} reset{'s' * (self.resets > 1)}")
        return ", ".join(parts)


class StoppedError(Exception):
    """The vest was stopped, in the middle of its loop."""


class Vest:
    """A vest that runs in a thread until it is stopped; `open_vest` makes one.

    Args:
        port: the laptop's end of the radio.
        origin: latitude and longitude of north = east = 0, deg.
        speed: trial time over the clock's.
        now: gives the clock's time, s.
        sleep: waits for so many s, or until the event is set.

    Attributes:
        state: of the last tick that began.
        fault: what ended it, if anything but `stop` did.
    """

    def __init__(
        self,
        port: Port,
        origin: tuple[float, float],
        speed: float,
        now: Callable[[], float] = time.monotonic,
        sleep: Sleep = threading.Event.wait,
    ) -> None:
        self.port, self.origin = port, origin
        self.state = State()
        self.fault: BaseException | None = None
        self._stopped, self._to_be_reset = threading.Event(), threading.Event()
        self._ended = threading.Event()  # a thread whose `join` Ctrl-C interrupts counts as ended, and is not
        self._pace = Pace(TICK / speed, now=now, sleep=lambda s: sleep(self._stopped, s))
        self._thread: threading.Thread | None = None

    @property
    def is_running(self) -> bool:
        """Has it been started, and nothing ended it yet?"""
        return self._thread is not None and not self._ended.is_set()

    def reset(self) -> None:
        """Have the program begin anew with the next tick: without a mission, in another session."""
        self._to_be_reset.set()

    def stop(self) -> None:
        """End it, and wait for that. Twice does no harm."""
        self._stopped.set()
        if self._thread is not None:
            self._ended.wait()
            self._thread.join()

    def wait(self, seconds: float) -> None:
        """Wait so long for its end."""
        self._ended.wait(seconds)

    def start(
        self, simulation: Simulation, worn: Worn, ready: Prepared, record: Record, duration: float
    ) -> None:
        """Run it for so many s of the trial; rows go to `record` as from `Simulation.run`."""
        self._worn, self._plant = worn, simulation.outputs("plant")

        def run() -> None:
            try:
                simulation.run(ready.plan.events, duration=duration, record=record)
            except StoppedError:
                pass
            except BaseException as reason:  # told by `fault`: nobody waits for this thread
                self.fault = reason
            finally:
                self._ended.set()

        self._thread = threading.Thread(target=run, name="vest", daemon=True)
        self._thread.start()

    def begin_tick(self, time: float) -> None:
        """Wait until a tick's time has come.

        Raises:
            StoppedError: it never will.
        """
        self._pace.wait()
        if self._stopped.is_set():
            raise StoppedError
        if self._to_be_reset.is_set():
            self._to_be_reset.clear()
            self._worn.reset()
        pace, plant = self._pace, by_name(self._plant)
        self.state = State(
            time,
            plant["north"],
            plant["east"],
            plant["heading"],
            plant["speed"],
            self._worn.command,
            pace.ticks,
            pace.missed,
            pace.latest,
            pace.lost,
            self._worn.resets,
            self._worn.dropped,
        )


@contextmanager
def open_vest(
    scenario: str | Scenario = DEFAULT,
    *,
    seed: int | None = None,
    settings: Sequence[str] = (),
    target: str = "host",
    speed: float = 1.0,
    key: Key | None = None,
    radio: Port | None = None,
    in_process: bool = True,
    duration: float | None = None,
    out: Path | None = None,
    now: Callable[[], float] = time.monotonic,
    sleep: Sleep = threading.Event.wait,
    note: Callable[[str], None] = lambda text: None,
    built: Callable[[Path], None] = lambda path: None,
) -> Iterator[Vest]:
    """A vest that runs, until the context ends.

    Args:
        scenario: its animal, sensors, faults, parameters; not its mission and orders, which come by radio.
        seed, settings: over the scenario's.
        target: the processor that runs its program, one of TARGETS.
        speed: trial time over the clock's.
        key: of its radio; None makes a program that verifies nothing, and says so in its telemetry.
        radio: the vest's end of the line, in the place of the one to `Vest.port`.
        in_process: the program for `host` runs in this process, whose time it shares; what it remembers is in
            the log. Otherwise it is the one that is shipped, as a process of its own.
        duration: s of the trial after which it ends; None for no end.
        out: a folder that gets its log.
        now, sleep: the clock (see `Vest`).
        note: is told what the user should know.
        built: is told of each file of the FMUs that is made.

    Raises:
        CanineError: it cannot be opened, or a fault ended it; raised at the end then.
    """
    _check(target, speed)
    laptop, own = wire()
    processor = find_target(target).same_processor_as or target
    changes = Changes(settings=settings, seed=seed, onboard=f"pil:{processor}")
    with ExitStack() as stack:
        request = stack.enter_context(requested(scenario, changes))
        request = replace(request, onboard=target, scenario=guarded(request.scenario, note))
        build_missing(request, built)
        if is_foreign(request):
            raise UsageError(
                f"{request.scenario.name}: has an FMU that was not built here; "
                "a vest in real time runs our own, so that nothing holds it up"
            )
        ready = stack.enter_context(prepared(request))
        for text in (*request.notes, *ready.notes, *_notes(request.scenario)):
            note(text)
        vest = Vest(laptop, request.scenario.origin, speed, now, sleep)
        kind = partial(Worn, radio=radio or own, before=vest.begin_tick)
        open_alone = _alone(target, in_process=in_process)
        start = partial(open_alone or open_processor, key=key)
        worn = open_as(kind, request, ready, start)
        simulation = simulate_here(request, ready, worn, stack)
        rows = LogRows(simulation, ready, worn, UNKNOWN if open_alone else ())
        record = stack.enter_context(_recorder(request, ready, rows, out)) if out else _forgetting(worn)
        stack.callback(vest.stop)
        vest.start(simulation, worn, ready, record, ENDLESS if duration is None else duration)
        yield vest
        vest.stop()
        if vest.fault is not None:
            raise vest.fault


def _check(target: str, speed: float) -> None:
    if target not in TARGETS:
        raise UsageError(
            f"--target {target}: runs no vest in real time; expected one of {', '.join(TARGETS)}"
        )
    low, high = SPEEDS
    if not low <= speed <= high:
        raise UsageError(f"--speed {speed:g}: expected {low:g} to {high:g} times the clock's time")
    if target in BY_CLOCK and speed != 1.0:
        raise UsageError(f"--speed {speed:g}: a simulated {target} runs by the clock; expected 1")


def _alone(target: str, *, in_process: bool) -> Callable[..., Resettable] | None:
    """What opens a program that keeps its memory to itself; None for one whose memory can be read."""
    if target == "stm32f405":
        from harness.vest.board_on_lines import open_stm32f405  # noqa: PLC0415 - only its users need it

        return open_stm32f405
    return None if in_process or target != "host" else open_host_process


def guarded(scenario: Scenario, note: Callable[[str], None]) -> Scenario:
    """The scenario in the reading with the safety rules: nobody knows who will command the vest.

    Args:
        note: is told if the scenario states another reading.
    """
    if scenario.reading not in (None, ON_BOARD):
        note(
            f'{scenario.name}: its reading "{scenario.reading}" is without the safety rules; the vest is '
            f'"{ON_BOARD}", with them'
        )
    return replace(scenario, reading=ON_BOARD)


def _notes(scenario: Scenario) -> Iterator[str]:
    """What of a scenario is not given to the vest."""
    if scenario.waypoints:
        yield f"{scenario.name}: its waypoints are not on board; the operator's MISSION sends a mission"
    if orders := sorted({setting.variable for setting in scenario.sets} & set(ORDERS)):
        yield f"{scenario.name}: [[set]] of {', '.join(orders)} does nothing; the operator orders by radio"


def _forgetting(worn: Worn) -> Record:
    """What drops rows."""
    return lambda times, _: worn.forget(times.tolist())


@contextmanager
def _recorder(request: Request, ready: Prepared, rows: LogRows, out: Path) -> Iterator[Record]:
    """What writes rows to the log in a folder; a log without a row is removed."""
    written = 0
    with (
        alone_in(out),
        LogWriter(
            out / FILE,
            rows.channels,
            origin=request.scenario.origin,
            metadata=metadata(request, ready),
            attachments={},
        ) as log,
    ):

        def record(times: Array, values: Mapping[str, Array]) -> None:
            nonlocal written
            written += len(times)
            rows.write(log, times, values)

        yield record
        if not written:
            log.abort("it was stopped before its first tick")
