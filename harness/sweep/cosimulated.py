"""Trials with FMUs that others built, without a log: in a worker process, one trial after the other.

A worker carries out many trials, since it takes a second to start. Each trial loads the FMUs anew. One that
crashes, hangs or fails ends its own trial, as a fault that names it; the next trial gets a new worker.
"""

from __future__ import annotations

import hashlib
import math
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from codegen.scratch import Scratch
from harness.cosim.stepping import Limits
from harness.sweep.chunks import ANOMALIES, SUMS, TICK_S, Chunk, FmuFailure, index_type
from harness.trial.scenario import Scenario
from models.commands import ENDS, Status
from models.errors import CanineError, UsageError

if TYPE_CHECKING:  # fmpy: sweeps of our own blocks do without
    from harness.cosim.worker.contained import Contained
    from harness.cosim.worker.process import WorkerProcess
    from harness.trial.prepare import Prepared
    from harness.trial.request import Request

PROBE = 25  # trials in a chunk; the first chunk of a point tells whether the others are worth while
MOST_FAILURES = 5  # of FMUs in the first chunk; with so many a point is given up
Array = npt.NDArray[np.float64]

_building = threading.Lock()
_ending = threading.Event()
_workers: set[WorkerProcess] = set()


@dataclass(frozen=True)
class ForeignFmu:
    """An FMU that others built, and its mapping file.

    Attributes:
        path: where it is on the machine that asks for the trials.
        digest: of both files.
        content, mapping: both files, where they must travel to other machines.
    """

    path: Path
    digest: str
    content: bytes | None = None
    mapping: bytes | None = None

    @classmethod
    def of(cls, path: Path) -> ForeignFmu:
        """The FMU at a path."""
        return cls(path.resolve(), _digest(path.read_bytes(), _mapping_of(path)))

    def packed(self) -> ForeignFmu:
        """With its files in it."""
        return replace(self, content=self.path.read_bytes(), mapping=_mapping_of(self.path))

    def place(self) -> Path:
        """The FMU on this machine.

        Raises:
            UsageError: it has changed since the trials were planned.
        """
        if self.content is not None:
            return _placed(self)
        if _digest(self.path.read_bytes(), _mapping_of(self.path)) != self.digest:
            raise UsageError(f"{self.path}: has changed since the trials began; give the command again")
        return self.path


def _mapping_of(fmu: Path) -> bytes | None:
    mapping = fmu.with_suffix(".toml")
    return mapping.read_bytes() if mapping.is_file() else None


def _digest(content: bytes, mapping: bytes | None) -> str:
    return hashlib.sha256(b"%d " % len(content) + content + (mapping or b"")).hexdigest()


_scratch: list[Scratch] = []  # holds the FMUs that came from another machine until this process ends


@cache
def _placed(fmu: ForeignFmu) -> Path:
    _scratch.append(Scratch())
    path = _scratch[-1].path / fmu.path.name
    path.write_bytes(fmu.content or b"")
    if fmu.mapping is not None:
        path.with_suffix(".toml").write_bytes(fmu.mapping)
    return path


@dataclass(frozen=True)
class Cosimulated:
    """The trials of one point with FMUs that others built.

    Attributes:
        scenarios: types of trials, which take turns.
        swaps: by role, one of ours by its name, or an FMU.
        seed: of the first trial.
    """

    scenarios: tuple[Scenario, ...]
    swaps: Mapping[str, str | ForeignFmu]
    trials: int
    seed: int
    limits: Limits

    @property
    def type_names(self) -> tuple[str, ...]:
        """The names of the types of trials."""
        return tuple(scenario.name for scenario in self.scenarios)

    @property
    def dtype(self) -> type[np.unsignedinteger[Any]]:
        """The smallest integer type that holds the index of any tick."""
        return index_type(max(math.floor(one.duration / TICK_S + 1e-9) for one in self.scenarios))

    @property
    def foreign(self) -> dict[str, ForeignFmu]:
        """The FMUs by role."""
        return {role: fmu for role, fmu in self.swaps.items() if isinstance(fmu, ForeignFmu)}

    def packed(self) -> Cosimulated:
        """With the files of its FMUs in it, for other machines."""
        return replace(self, swaps={**self.swaps, **{r: fmu.packed() for r, fmu in self.foreign.items()}})

    def request(self, scenario: Scenario) -> AbstractContextManager[Request]:
        """What `canine run` would make of one of its scenarios."""
        from harness.trial.request import Changes, requested  # noqa: PLC0415 - builds and firmware

        swaps = {
            role: fmu.place() if isinstance(fmu, ForeignFmu) else fmu for role, fmu in self.swaps.items()
        }
        estimator = swaps.pop("estimator", None)
        changes = Changes(
            swaps=swaps, estimator=None if estimator is None else str(estimator), limits=self.limits
        )
        return requested(scenario, changes)

    @contextmanager
    def ready(
        self, scenario: Scenario, built: Callable[[Path], None] = lambda path: None
    ) -> Iterator[Prepared]:
        """One of its scenarios made ready; our own FMUs are built if they are missing.

        Raises:
            CanineError: an FMU, or the scenario, does not fit.
        """
        from harness.trial.prepare import prepared  # noqa: PLC0415 - fmpy
        from harness.trial.request import build_missing  # noqa: PLC0415 - as above

        with self.request(scenario) as request:
            with _building:
                build_missing(request, built)
            with prepared(request) as ready:
                yield ready

    def run(self, start: int, stop: int) -> Chunk:
        """Run the trials start <= k < stop; the first chunk ends early with MOST_FAILURES failures.

        Raises:
            CanineError: a fault that is not an FMU's.
        """
        from harness.cosim.worker.process import WorkerProcess  # noqa: PLC0415 - fmpy

        ticks: list[int] = []
        notes: list[str] = []
        sums = np.zeros((1, len(SUMS)), dtype=np.int64)
        failures: list[FmuFailure] = []
        gave_up = False
        with ExitStack() as stack:
            process = stack.enter_context(WorkerProcess(self.limits))
            _workers.add(process)
            stack.callback(_workers.discard, process)
            types = [stack.enter_context(self.ready(scenario)) for scenario in self.scenarios]
            for number in range(start, stop):
                turn = number % len(types)
                scenario = replace(self.scenarios[turn], seed=self.seed + number)
                result = _trial(
                    types[turn].planned(scenario), scenario, process, notes if number == 0 else []
                )
                if _ending.is_set():
                    raise CanineError("the trials were ended")
                if isinstance(result, FmuFailure):
                    ticks.append(0)
                    failures.append(replace(result, number=number))
                else:
                    ticks.append(result.success_tick)
                    sums += result.sums()
                gave_up = start == 0 and len(failures) == MOST_FAILURES
                if gave_up:
                    break
        ran = start + len(ticks)
        return Chunk(
            start, ran, np.array(ticks, dtype=self.dtype), sums, tuple(failures), gave_up, tuple(notes)
        )


def begin() -> None:
    """Trials may run in this process."""
    _ending.clear()


def abandon() -> None:
    """End all trials that run in this process: nobody wants their results."""
    _ending.set()
    for process in list(_workers):
        process.abandon()


class Tally:
    """What is counted of a trial's rows: the controller's outputs by the role's names."""

    def __init__(self, simulation: Contained, ready: Prepared) -> None:
        from harness.trial.contents import LogRows  # noqa: PLC0415 - MCAP

        self.by_roles = (rows := LogRows(simulation, ready, None)).by_roles
        channels = {channel.component: channel.names for channel in rows.channels}
        self.columns = {name: i for i, name in enumerate(channels.get("controller", ()))}
        self.step = simulation.wiring.step
        self.stalls = simulation.wiring.stalls.get("controller", ())
        self.rows = 0
        self.status, self.since = math.nan, 0
        self.commands = 0
        self.anomalies = np.zeros(len(ANOMALIES), dtype=np.int64)

    def record(self, times: Array, values: Mapping[str, Array]) -> None:
        """Count rows, as `Contained.run` hands them over."""
        if _ending.is_set():
            raise CanineError("the trials were ended")
        if self.columns:
            controller = self.by_roles(values)["controller"]
            self._count({name: controller[:, i] for name, i in self.columns.items()})
        self.rows += len(times)

    def _count(self, signals: Mapping[str, Array]) -> None:
        if "status" in signals:
            status = signals["status"]
            changed = np.flatnonzero(status != np.concatenate([[self.status], status[:-1]]))
            if changed.size:
                self.since = self.rows + int(changed[-1])
            self.status = float(status[-1])
        if "directional_commands" in signals:
            self.commands = int(signals["directional_commands"][-1])
        if "anomaly" in signals:
            codes = signals["anomaly"].astype(np.int64)
            for first, after in self.stalls:  # what is held is not reported again
                codes[max(0, first - self.rows) : max(0, after - self.rows)] = 0
            known = codes[(codes > 0) & (codes <= len(ANOMALIES))]
            self.anomalies += np.bincount(known - 1, minlength=len(ANOMALIES))

    @property
    def success_tick(self) -> int:
        """The tick on which the trial succeeded, 1 at least; 0 if it did not."""
        succeeded = self.status == Status.SUCCESS
        return max(1, round(self.since * self.step / TICK_S)) if succeeded else 0

    def sums(self) -> npt.NDArray[np.int64]:
        """(SUMS,) what the trial adds to the counts of its point."""
        commands = self.commands if self.success_tick else 0
        return np.array([commands, self.status not in ENDS, *self.anomalies], dtype=np.int64)


def _trial(
    ready: Prepared, scenario: Scenario, process: WorkerProcess, notes: list[str]
) -> Tally | FmuFailure:
    """Run a trial: what it counted, or the fault that ended it; `notes` gets what the user should know."""
    from harness.cosim.fmu import Fault, FmuError  # noqa: PLC0415 - fmpy
    from harness.cosim.worker.contained import Contained  # noqa: PLC0415 - fmpy
    from harness.trial.trial import stop_of  # noqa: PLC0415 - pictures

    simulation = None
    try:
        with Contained(
            ready.system,
            ready.fmus,
            ready.plan.values,
            plants=ready.plants,
            process=process,
        ) as simulation:
            tally = Tally(simulation, ready)
            simulation.run(
                ready.plan.events,
                duration=scenario.duration,
                stop=stop_of(simulation),
                record=tally.record,
            )
            return tally
    except CanineError as error:
        fault = error.fault if isinstance(error, FmuError) else None
        return FmuFailure(0, fault or Fault("refused", "", "", "", 0.0), str(error))
    finally:
        notes += simulation.notes if simulation else ()
