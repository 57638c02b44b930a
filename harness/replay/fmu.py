"""An estimator's FMU over sensor signals: an estimator made elsewhere, and the reference for ours in C."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np

from harness.cosim.calls import ASKS
from harness.cosim.fmu import FmuError, FmuInstance
from harness.cosim.walk import NEARLY
from harness.recording.attitude import TICK_S, Array
from harness.recording.signals import SensorSignals


def run_fmu(
    path: Path, signals: SensorSignals, ticks: int, parameters: Mapping[str, float]
) -> dict[str, Array]:
    """Run an estimator's FMU over the first `ticks` ticks; its outputs by name, (ticks,) each.

    Raises:
        FmuError: the FMU fails, or has an input that is not a sensor signal.
    """
    with FmuInstance("estimator", path) as component:
        inputs, outputs = component.description.inputs.values(), component.description.outputs.values()
        signal_names = {f.name for f in fields(SensorSignals)}
        for quantity in inputs:
            if quantity.name not in signal_names:
                raise FmuError(
                    f'{path}: input "{quantity.name}" is not a sensor signal; it cannot be replayed'
                )
        component.initialize(parameters)
        setters, getters = [], []  # (call, one tick's values, all ticks' values, what it does)
        for access in dict.fromkeys(q.access for q in inputs):
            group = [q for q in inputs if q.access == access]
            table = np.column_stack([getattr(signals, q.name)[:ticks] for q in group]).astype(access.dtype)
            now = np.zeros(len(group), dtype=access.dtype)
            setters.append((component.setting(group, now.ctypes.data), now, table, f"set of {access.fmi}"))
        estimate = {q.name: np.zeros(ticks) for q in outputs}
        for access in dict.fromkeys(q.access for q in outputs):
            group = [q for q in outputs if q.access == access]
            now = np.zeros(len(group), dtype=access.dtype)
            table = np.zeros((ticks, len(group)), dtype=access.dtype)
            getters.append((component.getting(group, now.ctypes.data), now, table, f"get of {access.fmi}"))
            estimate |= {q.name: table[:, i] for i, q in enumerate(group)}
        time, asked = ctypes.c_double(), (ctypes.c_char * ASKS)()
        step = component.stepping(time, TICK_S, ctypes.addressof(asked))
        for tick in range(ticks):
            time.value = tick * TICK_S
            for call, now, table, what in setters:
                now[:] = table[tick]
                component.call(call, what, time.value)
            component.call(step, "doStep", time.value)
            reached = component.reached
            if any(asked.raw) or (reached is not None and reached.value < time.value + NEARLY * TICK_S):
                raise FmuError(
                    f"{path}: its step did not end at t = {time.value + TICK_S:.10g} s: it asks to end the "
                    "simulation or for an event, or returned early"
                )
            for call, now, table, what in getters:
                component.call(call, what, time.value)
                table[tick] = now
    return estimate
