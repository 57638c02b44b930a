"""What `canine check` says of an FMU: what it cannot exchange, whether it fits a role, and how it lives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from harness.cosim.alone import Alone, plan_alone
from harness.cosim.fmu import FmuDescription, describe
from harness.cosim.layout import Array
from harness.cosim.life import live
from harness.cosim.origin import is_own
from harness.cosim.rename import Rename
from harness.cosim.roles import find_role, fit, read_adapter
from harness.cosim.wiring import find_rate
from harness.cosim.worker.alone import live_alone
from harness.cosim.worker.process import WorkerProcess
from models.commands import Command
from models.errors import CanineError, WiringError
from models.kit.declaration import Type
from models.kit.timing import TICK

TRY_OUT_S, MOST_TICKS = 60.0, 100_000  # for which it is run
SHOWN = 3  # names of variables in a note
EXCHANGED = {"input": "inputs", "output": "outputs", "parameter": "parameters"}


def check_fmu(path: Path, role: str | None, note: Callable[[str], None]) -> str:
    """Look at an FMU, and run it alone: with each command in turn, if it takes commands.

    One that was not built here runs in a worker.

    Args:
        role: the place that it should fit.
        note: gets what the user should know.

    Returns:
        what it is and does, in a line.

    Raises:
        UsageError: there is no such role.
        CanineError: it cannot be read, does not fit the role, or goes wrong.
    """
    place = find_role(role) if role is not None else None
    description = describe(path)
    for warning in description.warnings:
        note(f"{path.name}: {warning}")
    for line in not_exchanged(description):
        note(f"{path.name}: {line}")
    inputs: Mapping[str, Rename] = {"command": Rename("command")}
    if place is not None:
        fitted = fit(description, place, read_adapter(path, place))
        for line in fitted.notes:
            note(line)
        if fitted.problems:
            raise CanineError("\n".join(fitted.problems))
        inputs = fitted.inputs
    steps = _steps(description, role, note)
    done = _try_out(description, role or "fmu", inputs.get("command"), note)
    fits = f"; fits the {role} role" if role else ""
    return (
        f"{path.name}: FMI {description.version} co-simulation, {_counts(description)}; {steps}; {done}{fits}"
    )


def _steps(fmu: FmuDescription, role: str | None, note: Callable[[str], None]) -> str:
    """The FMU's step, and how it is stepped beside our blocks.

    Raises:
        WiringError: it cannot be stepped beside them, and has the role of one.
    """
    size = f" of {fmu.step:.6g} s" if fmu.step else ""
    step = f"a fixed step{size}" if fmu.fixed else "any step"
    try:
        rate = find_rate(" ".join(filter(None, [role, fmu.path.name])), fmu, TICK)
    except WiringError as reason:
        if role is not None:
            raise
        note(str(reason))
        return step
    return f"{step}: {rate} of {TICK:g} s"


def _try_out(
    description: FmuDescription, name: str, command: Rename | None, note: Callable[[str], None]
) -> str:
    step = 0.0 if description.fixed else TICK
    wiring, _ = plan_alone(name, description, step)
    ticks = max(1, min(MOST_TICKS, round(TRY_OUT_S / wiring.step)))
    tables: dict[str, Array] = {}
    if command is not None and (taken := description.inputs.get(command.name)):
        turns = np.arange(ticks) * len(Command) // ticks
        values = command.factor * np.array([float(c) for c in Command])[turns] + command.offset
        tables[taken.name] = values if taken.type is Type.REAL else np.rint(values)
    if is_own(description.path):
        with Alone(name, description.path, step) as alone:
            return ", ".join(live(alone, tables, ticks))
    with WorkerProcess() as process:
        try:
            done = live_alone(process, name, description, inputs=tables, ticks=ticks, step=step)
        finally:
            process.end()
            for line in process.take_notes():
                note(line)
    return ", ".join(done)


def not_exchanged(description: FmuDescription) -> list[str]:
    """The inputs, outputs and parameters that cannot be exchanged, and why, a line for each kind."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, refused in description.refused.items():
        if refused.causality in EXCHANGED:
            groups.setdefault((refused.causality, refused.reason), []).append(name)
    lines = []
    for (causality, reason), names in groups.items():
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        many = EXCHANGED[causality] if len(names) > 1 else causality
        lines.append(f"{len(names)} {many} not exchanged, {', '.join(names[:SHOWN])}{more}: {reason}")
    return lines


def _counts(description: FmuDescription) -> str:
    counts = []
    for causality, many in EXCHANGED.items():
        taken = len(getattr(description, many))
        left = sum(refused.causality == causality for refused in description.refused.values())
        what = causality if taken == 1 else many
        counts.append(f"{taken} {what}" + (f" and {left} not exchanged" if left else ""))
    return ", ".join(counts)
