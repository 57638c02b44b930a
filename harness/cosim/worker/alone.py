"""The jobs of a worker that has an FMU alone: run it over tables, or see whether it lives as FMI promises."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness.cosim.alone import Alone, outputs_of, plan_alone
from harness.cosim.fmu import FmuDescription
from harness.cosim.layout import Array
from harness.cosim.life import live
from harness.cosim.worker.job import Worker
from harness.cosim.worker.process import Subject, WorkerProcess
from harness.cosim.worker.shared import Sizes


@dataclass(frozen=True)
class AloneJob:
    """Run an FMU over tables; the rows stay in the memory."""

    sizes: Sizes
    name: str
    path: Path
    label: str
    step: float
    inputs: Mapping[str, Array]
    parameters: Mapping[str, float] = field(default_factory=dict)

    def carry_out(self, worker: Worker, stack: ExitStack) -> Any:
        """As `Job`."""
        alone = self.open(worker, stack)
        alone.instance.initialize(self.parameters)
        worker.tell("ready")
        alone.run(self.inputs, worker.memory.recorder.rows)

    def open(self, worker: Worker, stack: ExitStack) -> Alone:
        """The FMU, which the stack frees."""
        alone = Alone(self.name, self.path, self.step, self.label, worker.mark)
        alone.position = worker.memory.recorder.position
        return stack.enter_context(alone)


class LifeJob(AloneJob):
    """See whether it lives as FMI promises, over as many ticks as the memory has rows."""

    def carry_out(self, worker: Worker, stack: ExitStack) -> list[str]:
        """As `Job`; what it was seen to do."""
        alone = self.open(worker, stack)
        worker.tell("ready")
        return live(alone, self.inputs, self.sizes.room)


def run_alone(
    process: WorkerProcess,
    name: str,
    fmu: FmuDescription,
    *,
    inputs: Mapping[str, Array],
    ticks: int,
    step: float = 0.0,
    parameters: Mapping[str, float] | None = None,
) -> dict[str, Array]:
    """Run an FMU in a worker over tables of its inputs.

    Args:
        name: its place, for errors.
        inputs: by name (ticks,); an input that is not there keeps its start value.
        step: s; 0 takes the FMU's own.

    Returns:
        its outputs by name, (ticks,) each.

    Raises:
        FmuError: it failed, or ended, stopped or filled the worker.
    """
    _, layout = plan_alone(name, fmu, step)
    sizes, label = Sizes(len(layout.block), 0, ticks), f"{name} {fmu.path.name}"
    job = AloneJob(sizes, name, fmu.path.resolve(), label, step, inputs, parameters or {})
    _have_done(process, job, fmu)
    return outputs_of(layout, name, process.memory.recorder.rows)


def live_alone(
    process: WorkerProcess,
    name: str,
    fmu: FmuDescription,
    *,
    inputs: Mapping[str, Array],
    ticks: int,
    step: float = 0.0,
) -> list[str]:
    """See in a worker whether an FMU keeps what FMI promises; as `live`."""
    job = LifeJob(Sizes(8, 0, ticks), name, fmu.path.resolve(), f"{name} {fmu.path.name}", step, inputs)
    done: list[str] = _have_done(process, job, fmu)
    return done


def _have_done(process: WorkerProcess, job: AloneJob, fmu: FmuDescription) -> Any:
    """Have a worker do a job; its answer."""
    wiring, _ = plan_alone(job.name, fmu, job.step)
    subject = Subject({job.name: job.label}, {job.name: fmu.path.name}, wiring.step)
    limits = process.limits
    try:
        process.begin(job, subject)
        answer = process.hear("done", limit=limits.call)["answer"]
        process.check_memory()
        process.hear("closed", limit=limits.free)
    except BaseException:
        process.end_early()
        raise
    return answer
