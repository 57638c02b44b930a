"""One trial: it is run, logged, and reported into a folder."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

from harness.cosim.fmu import FmuError
from harness.cosim.loop import Array, Simulation, Stop
from harness.cosim.worker.contained import Contained
from harness.files import differences, make_folder, write_whole
from harness.log.channel import Channel
from harness.log.live import Viewers
from harness.log.log import FILE, Log, LogError, read_log
from harness.log.writer import LogWriter
from harness.onboard.processors import open_processor
from harness.toml_file import parse_toml
from harness.trial.contents import LogRows, attachments, metadata
from harness.trial.instances import OpenProcessor, open_simulation
from harness.trial.notes import late_notes, nan_notes
from harness.trial.page import write_page
from harness.trial.plots import trial_png
from harness.trial.prepare import Prepared
from harness.trial.request import Request
from harness.trial.summary import summarize, write_summary
from harness.trial.vest_notes import radio_notes, refusal_notes
from models.commands import ENDS
from models.errors import UsageError

Records = Mapping[str, Mapping[str, str]]
Place = tuple[float, float]  # latitude and longitude, deg
LOG, SUMMARY, PAGE, PICTURE = FILE, "summary.json", "trial.html", "trial.png"


class EndedByFaultError(FmuError):
    """An FMU ended the trial; `summary` is what was written of it."""

    def __init__(self, error: FmuError, summary: dict[str, Any]) -> None:
        super().__init__(str(error), error.fault)
        self.summary = summary


class Audience(Protocol):
    """Who watches a trial while it runs."""

    def begin(self, channels: Sequence[Channel], origin: Place, records: Records) -> None:
        """What the rows will be, and the log's metadata; returns when the trial may begin."""

    def take(self, times: Array, rows: Mapping[str, Array]) -> None:
        """Rows of the log; returns when their time has come."""


@dataclass
class RunState:
    """How a run goes.

    Attributes:
        is_logged: its log has been opened, and has a tick.
        real_time_factor: trial time over elapsed time; None until it has ended.
    """

    notes: list[str] = field(default_factory=list)
    is_logged: bool = False
    real_time_factor: float | None = None


def run(
    request: Request,
    ready: Prepared,
    out: Path,
    progress: Callable[[float], None] | None = None,
    start: OpenProcessor = open_processor,
    *,
    viewers: Viewers | None = None,
    audience: Audience | None = None,
) -> dict[str, Any]:
    """Run a trial and write log, summary, page and picture; the summary.

    An FMU that goes wrong ends the trial: log, summary, page and picture tell of it up to there. Another
    error, or the user, may end it too: then only the log is kept. An earlier trial's files stay until the new
    log is opened; a log without a tick is removed.

    Args:
        out: the folder, made if need be.
        progress: called with the trial's time [s].
        start: opens the processor of `request.onboard`, given the firmware's parameters.
        viewers: are shown the trial; it begins when one of them asks for a topic.
        audience: is shown the rows, and says how fast they go.

    Raises:
        UsageError: the folder cannot be made, holds the log that is read, or another trial writes into it.
        CanineError: a fault in what was run; it names the component.
        KeyboardInterrupt: the user ended the trial.
    """
    if request.log is not None and (out / LOG).resolve() == request.log.resolve():
        raise UsageError(f"--out {out}: holds the log that is read, {request.log}; choose another folder")
    with alone_in(out):
        state = RunState()
        fault: FmuError | None = None
        try:
            _simulate(
                request, ready, out, start, state, progress=progress, viewers=viewers, audience=audience
            )
        except FmuError as error:
            if error.fault is None or not state.is_logged:
                raise
            fault = error
        log = read_log(out / LOG)
        late = late_notes(request.scenario, ready.interfaces, ready.values, float(log.time[-1]))
        late += refusal_notes(log) + radio_notes(log)
        if fault is not None and fault.fault is not None:
            late += nan_notes(request.scenario, fault.fault)
        summary = _report(
            log, out, state.real_time_factor, (*request.notes, *ready.notes, *state.notes, *late), fault
        )
        if fault is not None:
            raise EndedByFaultError(fault, summary) from fault
        return summary


def replaced(request: Request, ready: Prepared, out: Path) -> str:
    """A note on another trial in a folder, which the new one replaces; "" if there is none."""
    if not (out / LOG).is_file():
        return ""
    try:
        before = _identity(read_log(out / LOG).metadata)
    except (LogError, KeyError, ValueError):  # no log of a trial
        return f"{out}: has a log that cannot be read, which this replaces"
    now = _identity(metadata(request, ready))
    others = ", ".join(differences(before, now))
    return others and f"{out}: has another trial, which this replaces ({others})"


def _identity(records: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    """What tells a trial from others, of its log's metadata."""
    stated = {key: value for key, value in records.items() if key in ("roles", "run", "swaps")}
    return parse_toml(records["scenario"]["toml"]) | stated


def has_begun(out: Path) -> bool:
    """Does the folder hold the log of a trial that was not reported, because it ended early?"""
    return (out / LOG).exists() and not (out / SUMMARY).exists()


def what_is_left(out: Path) -> str:
    """What is left of a trial that the user ended, in words."""
    return f"the log up to there is {out / LOG}" if has_begun(out) else "nothing was logged"


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Make a folder, and lock it, so that no other trial writes into it.

    The lock ends with the process at the latest. Folders that were made, and into which nothing was written,
    are removed at the end.

    Raises:
        UsageError: the folder cannot be made, or another trial writes into it.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    make_folder(folder)
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
        with suppress(OSError):  # the first that holds something stays, and so do those around it
            for path in made:
                path.rmdir()


def _simulate(
    request: Request,
    ready: Prepared,
    out: Path,
    start: OpenProcessor,
    state: RunState,
    *,
    progress: Callable[[float], None] | None,
    viewers: Viewers | None,
    audience: Audience | None,
) -> None:
    """Run the trial and write its log; `state` tells how that goes, however it ends."""
    scenario = request.scenario
    with ExitStack() as stack:
        simulation, onboard = open_simulation(request, ready, start, stack, state.notes)
        rows = LogRows(simulation, ready, onboard)
        for name in (SUMMARY, PAGE, PICTURE):  # an earlier trial's: they would not belong to this log
            with suppress(FileNotFoundError):
                (out / name).unlink()
        with LogWriter(
            out / LOG,
            rows.channels,
            origin=scenario.origin,
            metadata=metadata(request, ready),
            attachments=attachments(request, ready),
            viewers=viewers,
        ) as log:
            if viewers is not None:
                viewers.wait()
            if audience is not None:
                audience.begin(rows.channels, scenario.origin, metadata(request, ready))

            def record(times: Array, values: Mapping[str, Array]) -> None:
                state.is_logged = True
                logged = rows.logged(times, values)
                log.write_rows(times, logged)
                if audience is not None:
                    audience.take(times, logged)

            started = time.perf_counter()
            outcome = simulation.run(
                ready.plan.events,
                duration=scenario.duration,
                stop=stop_of(simulation),
                record=record,
                progress=progress,
            )
            elapsed = time.perf_counter() - started
    state.real_time_factor = (outcome.ticks - 1) * simulation.wiring.step / elapsed


def stop_of(simulation: Simulation | Contained) -> Stop | None:
    """What ends a trial before its duration: the status of its controller, if it has one."""
    controller = simulation.fmus.get("controller")
    return Stop("controller", "status", ENDS) if controller and "status" in controller.outputs else None


def _report(
    log: Log, out: Path, real_time_factor: float | None, notes: Sequence[str], error: FmuError | None
) -> dict[str, Any]:
    """Write page, picture and summary of a log; the summary."""
    has_place = "plant.north" in log and "plant.east" in log
    if not has_place:
        notes = (*notes, "no picture: the log lacks plant.north and plant.east")
    summary = summarize(log, real_time_factor and round(real_time_factor, 1), notes)
    if error is not None and error.fault is not None:
        summary["fault"] = {"text": str(error), **asdict(error.fault)}
    if has_place:
        write_whole(out / PICTURE, trial_png(log))
    write_page(log, summary, out / PAGE)
    write_summary(summary, out / SUMMARY)
    return summary
