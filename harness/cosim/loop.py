"""The co-simulation master: instances of FMUs stepped together, tick by tick.

Time is tick * step, never summed; FMUs are given that after their package's start time. **Sequential**:
within a tick every component gets its inputs and is stepped in data-flow order, so that it answers to what
its sources answered in the same tick; plants, whose outputs do not depend on their inputs within a step, are
stepped last. **Jacobi**: all inputs are exchanged, then all are stepped; every link delays one tick. The row
of tick k holds the plants' outputs at t_k and the other components' answer to it.

A component may make several steps in a tick, with its inputs held. Or it makes one in n ticks, on ticks 0, n,
2n and so on. Then its inputs are those of that tick, as its rows show. An answer is there at once and held; a
plant's outputs, and in jacobi order all, are read when the step has ended, n ticks on.

A component that stalls takes no inputs, makes no steps and holds its outputs for a while. Then it goes on
from where it was, also in the time that it is given.

A tick is a list of C calls whose arguments are made once (`calls`) on one block of memory (`layout`); a walk
makes them (`walk`), in C or in Python, and leaves the rows in a recorder's memory (`recorder`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from time import perf_counter as clock
from typing import Any

import numpy as np
import numpy.typing as npt

from harness.cosim.calls import Calls, Instance
from harness.cosim.fmu import Fault, FmuDescription, FmuError, FmuInstance, Mark, Quantity, unmarked
from harness.cosim.layout import REALS, Array, Layout
from harness.cosim.recorder import Memory, Recorder, recorder_size
from harness.cosim.ssp import FmuSystem
from harness.cosim.stepping import DURATION, Event, Loop, Order, first_tick
from harness.cosim.walk import MANY, Guard, Native, NativeWalk, NotNativeError, Pause, Walk, Watched
from harness.cosim.wiring import Wiring, wire
from harness.interrupts import held_interrupts, holdable_interrupts
from models.errors import ParameterError, nearest
from models.kit.link import Values

__all__ = ["Array", "Instance", "Outcome", "Record", "Simulation", "Stop"]

BATCH = 25  # rows that are handed over together: a second's at 25 Hz
QUICK = 0.01  # s in which a batch runs and is written for the next to be as long as there is room

Record = Callable[[Array, dict[str, Array]], None]
Changes = dict[int, dict[str, dict[str, float]]]  # values by tick, component and free input


@dataclass(frozen=True)
class Stop:
    """The trial ends with the tick on which an output has one of these values."""

    component: str
    variable: str
    values: frozenset[int]


@dataclass(frozen=True)
class Outcome:
    """How a run ended: after so many rows, at the time of the last, and with what stop value (None: cut)."""

    ticks: int
    time: float
    stopped_by: int | None


class Simulation:
    """A system's instances, initialized and ready to run once. A context manager: it frees them.

    Args:
        system: what to run.
        values: start values (SI) by component and variable, over those of the package.
        order: `sequential` or `jacobi`.
        plants: components to be stepped last whatever they declare.
        labels: how errors call a component, where not `component file.fmu`.
        stand_ins: what runs in the place of a component's FMU.
        loop: `native`, the loop in C, or `python`, its reference, which gives the same bits.
        mark: told which call is being made, outside of the loop.
        guard: what restores how sums are rounded behind each call of the loop.

    Attributes:
        notes: why the loop is Python's where `native` was asked for.

    Raises:
        WiringError: the links do not fit (see `wire`).
        FmuError: an FMU cannot be loaded, or refuses to start.
        ParameterError: an input with a value is connected, or a value is none of its variable's type.
    """

    def __init__(
        self,
        system: FmuSystem,
        values: Values | None = None,
        order: Order = "sequential",
        plants: Iterable[str] = (),
        labels: Mapping[str, str] | None = None,
        *,
        stand_ins: Mapping[str, Instance] | None = None,
        loop: Loop = "native",
        mark: Mark = unmarked,
        guard: Guard | None = None,
    ) -> None:
        self._guard, self._faults = guard, system.faults
        self._stack = ExitStack()
        try:
            self.components: dict[str, Instance] = {}
            for name, part in system.components.items():
                stand_in = (stand_ins or {}).get(name)
                label = (labels or {}).get(name, "")
                component = stand_in or FmuInstance(name, part.fmu, label, mark, system.start_time)
                self.components[name] = self._stack.enter_context(component)
            self.fmus: dict[str, FmuDescription] = {n: c.description for n, c in self.components.items()}
            self.wiring: Wiring = wire(system, self.fmus, order, plants)
            self._free = self._initialize(system, values or {})
            self._layout = Layout(system.links, self.fmus, self.wiring, order)
            self._calls = Calls(self.components, self._layout, self.wiring, order, mark)
            self.notes: list[str] = []
            self._native = self._find_native() if loop == "native" else None
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free all instances."""
        self._stack.close()

    @property
    def call_names(self) -> list[tuple[str, str]]:
        """Component and function of each call of a tick; a recorder's position counts them."""
        return [self._calls.whose(call) for call in self._calls.tick]

    def recorder_size(self, room: int) -> int:
        """Bytes of memory in which `run` keeps so many rows."""
        return recorder_size(len(self._layout.block), room)

    def columns(self, name: str) -> list[Quantity]:
        """What the rows of a component hold: its inputs, then its outputs."""
        return self._layout.columns(name)

    def outputs(self, name: str) -> list[tuple[list[str], npt.NDArray[Any]]]:
        """A component's outputs: names, and the values where they lie, which change as it is stepped.

        Behind them come those that faults disturb, again.
        """
        layout = self._layout
        slots = {slot.component: slot for slot in layout.outputs}
        return [
            ([q.name for q in slot.quantities], layout.view(slot))
            for slot in layout.outputs
            if slot.component == name
        ] + [
            ([fault.source_variable], layout.view(slots[component]))
            for component, fault in self._faults.items()
            if fault.source == name and not fault.target
        ]

    def _find_native(self) -> Native | None:
        try:
            return Native(self._calls)
        except NotNativeError as reason:
            self.notes.append(f"the loop is Python's, a tenth as fast: {reason}")
            return None

    def _initialize(self, system: FmuSystem, values: Values) -> dict[str, dict[str, float]]:
        """Bring all instances to time 0; the values of the free inputs by component."""
        free: dict[str, dict[str, float]] = {}
        for name, component in self.components.items():
            of_package = {n: v.value for n, v in system.components[name].values.items()}
            start = of_package | dict(values.get(name, {}))
            inputs = self.fmus[name].inputs
            for variable in start:
                if variable in inputs and variable not in self.wiring.free[name]:
                    raise ParameterError(f"input {name}.{variable} is connected; only free inputs can be set")
            free[name] = {v: start.get(v, inputs[v].start or 0.0) for v in self.wiring.free[name]}
            component.initialize(start)
        return free

    def run(
        self,
        events: Sequence[Event] = (),
        *,
        duration: float = DURATION,
        stop: Stop | None = None,
        record: Record | None = None,
        progress: Callable[[float], None] | None = None,
        memory: Memory | None = None,
    ) -> Outcome:
        """Run from t = 0 until the stop condition holds or t = duration; both ends have a row.

        Args:
            events: changes of free inputs.
            duration: s.
            stop: ends the trial earlier.
            record: is given rows, some at a time: times (n,) in s, and by component (n, columns) of
                float64 in SI. It gets all rows that were finished, also when the run fails or Ctrl-C ends it,
                which acts before or after a call.
            progress: called with the time [s] after each call of `record`.
            memory: gets the position and the last rows (see `Recorder`), `recorder_size` bytes or more.

        Raises:
            FmuError: an FMU failed, or gave a value that is not finite.
            ParameterError: the variable of an event is not a free input, or its type does not hold the value.
        """
        step, calls = self.wiring.step, self._calls
        last = math.floor(duration / step + 1e-9)
        changes = self._schedule(events)
        watched = self._find(stop) if stop else (np.zeros(1), frozenset[int]())
        recorder = Recorder(len(self._layout.block), memory)
        parts, guard = (calls, self._layout, step, recorder, watched), self._guard
        native = self._native
        walk = NativeWalk(*parts, native=native, guard=guard) if native else Walk(*parts, guard=guard)
        calls.clock.set(0.0)
        with held_interrupts():
            for name, values in self._free.items():
                self._set(name, values)
            calls.carry_out(calls.first)
        handed, batch, position = 0, BATCH, recorder.position
        reason: int | None = None
        with holdable_interrupts() as hold:
            walk.hold = hold
            started = clock()
            try:
                while reason is None and (tick := position.rows) <= last:
                    calls.clock.set(tick * step)
                    with hold:
                        for name, values in changes.pop(tick, {}).items():
                            self._set(name, values)
                    full = handed + min(batch, recorder.room - handed % recorder.room)
                    pause = walk.run(tick, min(last + 1, full, *changes), last)
                    if pause is Pause.NOT_FINITE:
                        self._report_not_finite()
                    if pause is Pause.STOPPED:
                        reason = int(watched[0].item())
                    if position.rows == full:
                        with hold:
                            first, handed = handed, full
                            self._hand_over(first, recorder, record, progress)
                        ended = clock()
                        batch = MANY if ended - started < QUICK else BATCH
                        started = ended
            finally:
                with hold:
                    self._hand_over(handed, recorder, record, progress)
        ticks = position.rows
        return Outcome(ticks, (ticks - 1) * step, reason)

    def _set(self, component: str, values: Mapping[str, float]) -> None:
        """Set free inputs of a component."""
        for slot in self._layout.inputs:
            if slot.component == component:
                view = self._layout.view(slot)
                for index, quantity in enumerate(slot.quantities):
                    if quantity.name in values:
                        view[index] = values[quantity.name]
        self._calls.carry_out(self._calls.free[component])

    def _schedule(self, events: Sequence[Event]) -> Changes:
        """The values that free inputs take, by the tick at which they do: the component begins a step."""
        changes: Changes = {}
        for event in sorted(events, key=lambda e: e.time):
            if event.component not in self.components:
                hint = nearest(event.component, self.components)
                raise ParameterError(f'no component "{event.component}"{hint}')
            free = self.wiring.free[event.component]
            if event.variable not in free:
                wrong = f"is not an input{nearest(event.variable, free)}"
                if event.variable in self.fmus[event.component].inputs:
                    wrong = "is connected; only free inputs can be set"
                raise ParameterError(f"{event.component}.{event.variable} {wrong}")
            quantity = self.fmus[event.component].inputs[event.variable]
            if not quantity.holds(event.value):
                raise ParameterError(
                    f"{event.component}.{event.variable} is set to {event.value:.10g}, the FMU declares "
                    f"{quantity.type_name}; give one of those"
                )
            every = self.wiring.rates[event.component].every
            tick = every * math.ceil(first_tick(event.time, self.wiring.step) / every)
            for first, after in self.wiring.stalls.get(event.component, ()):
                tick = after if first <= tick < after else tick
            by_component = changes.setdefault(tick, {})
            by_component.setdefault(event.component, {})[event.variable] = event.value
        return changes

    def _find(self, stop: Stop) -> Watched:
        """The output that a stop condition is about, where it lies, and the condition's values."""
        for slot in self._layout.outputs:
            for index, quantity in enumerate(slot.quantities):
                if (slot.component, quantity.name) == (stop.component, stop.variable):
                    return self._layout.view(slot)[index : index + 1], stop.values
        raise ParameterError(f"there is no output {stop.component}.{stop.variable} to stop by")

    def _report_not_finite(self) -> None:
        order, plants = self.wiring.order, self.wiring.plants
        outputs, faults = self._layout.outputs, self._faults
        slots = [slot for slot in outputs if slot.type in REALS and slot.component not in faults]
        # a plant's value of this tick comes before the answers to it
        for slot in sorted(slots, key=lambda s: (s.component not in plants, order.index(s.component))):
            for quantity, value in zip(slot.quantities, self._layout.view(slot), strict=True):
                if not math.isfinite(value):
                    name, time, output = slot.component, self._calls.clock.time, f'output "{quantity.name}"'
                    raise FmuError(
                        f"{self.components[name].label}: {output} is {value} at t = {time:.10g} s; "
                        "expected a finite number",
                        Fault("not finite", name, self.fmus[name].path.name, output, time),
                    )

    def _hand_over(
        self,
        first: int,
        recorder: Recorder,
        record: Record | None,
        progress: Callable[[float], None] | None,
    ) -> None:
        """Give the rows from tick `first` on, which lie together, to `record`."""
        count = recorder.position.rows - first
        if not count:
            return
        times = np.arange(first, first + count, dtype=np.float64) * self.wiring.step
        if record is not None:
            at = first % recorder.room
            record(times, self._layout.values(recorder.rows[at : at + count]))
        if progress is not None:
            progress(float(times[-1]))
