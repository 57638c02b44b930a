"""An FMU alone, whose inputs follow tables: to be checked, or run over a recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt

from harness.cosim.calls import Calls
from harness.cosim.fmu import FmuDescription, FmuInstance, Mark, unmarked
from harness.cosim.layout import Array, Layout
from harness.cosim.recorder import Position
from harness.cosim.ssp import FmuComponent, FmuSystem, StartValue
from harness.cosim.wiring import Wiring, wire

Rows = npt.NDArray[np.uint8]  # (n, bytes): copies of a layout's block


def plan_alone(name: str, fmu: FmuDescription, step: float = 0.0) -> tuple[Wiring, Layout]:
    """How an FMU alone is stepped, and where its values lie.

    Args:
        step: s, the tick; 0 takes the FMU's own step.

    Raises:
        WiringError: its own step is neither a whole multiple nor a whole fraction of the tick.
    """
    values = {variable: StartValue(0.0) for variable in fmu.inputs}
    system = FmuSystem(name, {name: FmuComponent(name, fmu.path, values=values)}, (), tick=step or None)
    wiring = wire(system, {name: fmu})
    return wiring, Layout((), {name: fmu}, wiring, "sequential")


class Alone:
    """One instance whose inputs follow tables. To be closed, or used as a context manager.

    Args:
        name, path, label, mark: as of `FmuInstance`.
        step: s, the tick; 0 takes the FMU's own step.

    Attributes:
        step: s, the tick.
        every: ticks from one step to the next.
        position: gets the tick.

    Raises:
        WiringError: its own step is neither a whole multiple nor a whole fraction of the tick.
        FmuError, ArchiveError, XmlError: it cannot be unpacked, read, loaded or instantiated.
    """

    def __init__(
        self, name: str, path: Path, step: float = 0.0, label: str = "", mark: Mark = unmarked
    ) -> None:
        self.instance, self.name = FmuInstance(name, path, label, mark), name
        try:
            wiring, self.layout = plan_alone(name, self.instance.description, step)
            self._calls = Calls({name: self.instance}, self.layout, wiring, "sequential", mark)
            self.step, self.every, self.position = wiring.step, wiring.rates[name].every, Position()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """As `FmuInstance.close`."""
        self.instance.close()

    def run(self, inputs: Mapping[str, Array], rows: Rows, first: int = 0) -> None:
        """Step it from the tick `first` on, and fill a row for each.

        A row has the inputs and the outputs as those of a `Simulation` have: without feedthrough the outputs
        are those before the step. Where a step takes several ticks, both are held.

        Args:
            first: a tick on which a step begins.
            inputs: by name (ticks,), from tick 0 on; an input that is not there keeps its start value.

        Raises:
            FmuError: a call failed, or its step did not go through.
        """
        calls, ticks = self._calls, first + len(rows)
        tables = []
        for slot in self.layout.inputs:
            table = np.zeros((ticks, len(slot.quantities)), dtype=slot.access.dtype)
            for i, quantity in enumerate(slot.quantities):
                table[:, i] = quantity.start or 0
                if quantity.name in inputs:
                    table[:, i] = inputs[quantity.name][:ticks]
            tables.append((self.layout.view(slot), table))
        calls.clock.position = self.position
        calls.carry_out(calls.first)
        answer, advance = calls.numbered()
        for tick in range(first, ticks):
            self.position.tick = tick
            calls.clock.set(tick * self.step)
            if tick % self.every == 0:
                for view, table in tables:
                    view[:] = table[tick]
                calls.carry_out(calls.free[self.name])
            calls.carry_out([call for _, call in calls.due(answer, tick)])
            rows[tick - first] = self.layout.block
            calls.carry_out([call for _, call in calls.due(advance, tick)])


def outputs_of(layout: Layout, name: str, rows: Rows) -> dict[str, Array]:
    """The outputs in rows of an FMU alone, (n,) each."""
    columns = zip(layout.columns(name), layout.values(rows)[name].T, strict=True)
    return {quantity.name: column for quantity, column in columns if quantity.causality == "output"}
