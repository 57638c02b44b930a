"""An estimator's FMU over sensor signals: an estimator made elsewhere, and the reference for ours in C."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path

import numpy as np

from harness.cosim.alone import Alone, outputs_of
from harness.cosim.fmu import FmuError, describe
from harness.cosim.origin import is_own
from harness.cosim.worker.alone import run_alone
from harness.cosim.worker.process import WorkerProcess
from harness.recording.attitude import TICK_S, Array
from harness.recording.signals import SensorSignals

NAME = "estimator"


def run_fmu(
    path: Path,
    signals: SensorSignals,
    ticks: int,
    parameters: Mapping[str, float],
    process: WorkerProcess | None = None,
) -> dict[str, Array]:
    """Run an estimator's FMU over the first `ticks` ticks; its outputs by name, (ticks,) each.

    Args:
        process: the worker in which it runs, if it was not built here; by default one of its own.

    Raises:
        FmuError: the FMU fails, or has an input that is not a sensor signal.
        WiringError: its step fits no tick.
    """
    fmu = describe(path)
    signal_names = {f.name for f in fields(SensorSignals)}
    for name in fmu.inputs:
        if name not in signal_names:
            raise FmuError(f'{path}: input "{name}" is not a sensor signal; it cannot be replayed')
    inputs = {name: np.asarray(getattr(signals, name)[:ticks], np.float64) for name in fmu.inputs}
    if is_own(path):
        with Alone(NAME, path, TICK_S) as alone:
            alone.instance.initialize(parameters)
            rows = np.zeros((ticks, len(alone.layout.block)), np.uint8)
            alone.run(inputs, rows)
            return outputs_of(alone.layout, NAME, rows)
    with ExitStack() as stack:
        process = process or stack.enter_context(WorkerProcess())
        return run_alone(process, NAME, fmu, inputs=inputs, ticks=ticks, step=TICK_S, parameters=parameters)
