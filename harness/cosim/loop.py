"""The co-simulation master: instances of FMUs stepped together, tick by tick.

Time is tick * step, never summed. All components have one communication step. **Sequential**: within a tick
every component is given its inputs and stepped in data-flow order, so that it answers to what its sources
answered in the same tick; plants, whose outputs do not depend on their inputs within a step, are stepped
last. **Jacobi**: all inputs are exchanged, then all are stepped; every link delays one tick. The row of tick
k holds the plants' outputs at t_k and everybody else's answer to it.

A tick is a list of C calls whose arguments are made once. All values lie in one block of memory: an output
is set as another's input from where its get call has put it, and a row of the log is one copy of the block.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Protocol, Self

import numpy as np
import numpy.typing as npt

from harness.cosim.fmu import Access, Call, FmuDescription, FmuError, FmuInstance, Quantity
from harness.cosim.ssp import FmuSystem, ScaledLink
from harness.cosim.stepping import DURATION, Order
from harness.cosim.wiring import Wiring, wire
from models.errors import ParameterError, nearest
from models.kit.link import Values

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]
Record = Callable[[Array, dict[str, Array]], None]

_REALS = ("float64", "float32")
ROWS = 25  # rows that are handed over together: a second's at 25 Hz

# memmove by its address, without argument types and as a function of nothing: no status, no checks
_copy = ctypes.PYFUNCTYPE(None)(ctypes.cast(ctypes.memmove, ctypes.c_void_p).value or 0)


class Instance(Protocol):
    """What the loop asks of a component: an instance of an FMU, or what stands in for one."""

    label: str
    description: FmuDescription

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...

    def initialize(self, values: Mapping[str, float]) -> None: ...

    def setting(self, quantities: Sequence[Quantity], address: int) -> Call: ...

    def getting(self, quantities: Sequence[Quantity], address: int) -> Call: ...

    def stepping(self, time: ctypes.c_double, step: float, ended: int) -> Call: ...

    def check(self, status: int, what: str, time: float) -> None: ...


@dataclass(frozen=True)
class Event:
    """From the first tick at or after `time` [s] the free input has this value (SI)."""

    time: float
    component: str
    variable: str
    value: float


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


@dataclass(eq=False)
class _Slot:
    """Consecutive values of one type in the block: `access.dtype` times the quantities of one component."""

    component: str
    access: Access
    quantities: list[Quantity]
    offset: int = 0

    @property
    def type(self) -> str:
        return np.dtype(self.access.dtype).name

    @property
    def size(self) -> int:
        return np.dtype(self.access.dtype).itemsize

    def address(self, base: int, index: int = 0) -> int:
        return base + self.offset + index * self.size


@dataclass(eq=False)
class _Transfer:
    """Values for inputs of one type of a component from one slot of another's outputs."""

    source: _Slot
    picked: list[int]
    target: str
    quantities: list[Quantity]
    links: list[ScaledLink]
    slot: _Slot | None = None  # where they lie for the target, unless it reads them from the source's slot

    @property
    def is_run(self) -> bool:
        """Do they lie one after the other, as they are?"""
        first = self.picked[0]
        return (
            self.picked == list(range(first, first + len(self.picked)))
            and self.source.access.dtype == self.quantities[0].access.dtype
            and not any(link.converts for link in self.links)
        )


class Simulation:
    """A system's instances, initialized and ready to run once. A context manager: it frees them.

    Args:
        system: what to run.
        values: start values (SI) by component and variable, over those of the package.
        order: `sequential` or `jacobi`.
        plants: components to be stepped last whatever they declare.
        labels: how errors call a component, where not `component file.fmu`.
        stand_ins: what runs in the place of a component's FMU.

    Raises:
        WiringError: the links do not fit (see `wire`).
        FmuError: an FMU cannot be loaded, or refuses to start.
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
    ) -> None:
        self._stack = ExitStack()
        self._time = ctypes.c_double(0.0)
        try:
            self.components: dict[str, Instance] = {}
            for name, part in system.components.items():
                stand_in = (stand_ins or {}).get(name)
                component = stand_in or FmuInstance(name, part.fmu, (labels or {}).get(name, ""))
                self.components[name] = self._stack.enter_context(component)
            self.fmus: dict[str, FmuDescription] = {n: c.description for n, c in self.components.items()}
            self.wiring: Wiring = wire(system, self.fmus, order, plants)
            self._start(system, values or {})
            self._lay_out(system.links, order)
            self._compile(order)
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

    def columns(self, name: str) -> list[Quantity]:
        """What the rows of a component hold: its inputs, then its outputs."""
        fmu = self.fmus[name]
        return [*fmu.inputs.values(), *fmu.outputs.values()]

    def _start(self, system: FmuSystem, values: Values) -> None:
        """Initialize all instances, plants first."""
        self._free: dict[str, dict[str, float]] = {}
        for name, component in self.components.items():
            given = {n: v.value for n, v in system.components[name].values.items()} | dict(
                values.get(name, {})
            )
            for variable in given:
                if variable in self.fmus[name].inputs and variable not in self.wiring.free[name]:
                    raise ParameterError(f"input {name}.{variable} is connected; only free inputs can be set")
            self._free[name] = {
                variable: given.get(variable, self.fmus[name].inputs[variable].start or 0.0)
                for variable in self.wiring.free[name]
            }
            component.initialize(given)

    def _lay_out(self, links: Sequence[ScaledLink], order: Order) -> None:
        """Give every value its place in the block of memory."""
        readers: dict[tuple[str, str], list[str]] = {}
        for link in links:
            readers.setdefault((link.source, link.source_variable), []).append(link.target)
        self._outputs: list[_Slot] = []
        for name in self.wiring.order:
            # what the same components read lies together, so that it can be set from where it lies
            outputs = sorted(self.fmus[name].outputs.values(), key=lambda q: readers.get((name, q.name), []))
            self._outputs += _slots(name, outputs)
        self._inputs = [
            slot
            for name, variables in self.wiring.free.items()
            for slot in _slots(name, [self.fmus[name].inputs[v] for v in variables])
        ]
        self._transfers = self._plan(links)
        stepped = {name: position for position, name in enumerate(self.wiring.order)}
        for transfer in self._transfers:
            source, target = transfer.source.component, transfer.target
            early = source not in self.wiring.plants and (
                order == "jacobi" or stepped[source] >= stepped[target]
            )
            if early or not transfer.is_run:  # read before the source is stepped again, or not as it lies
                transfer.slot = _Slot(target, transfer.quantities[0].access, transfer.quantities)
        copies = [t.slot for t in self._transfers if t.slot is not None]
        # real outputs lie together, so that one product tells whether all of them are finite
        self._outputs.sort(key=lambda s: _REALS.index(s.type) if s.type in _REALS else len(_REALS))
        end = 0
        for slot in [*self._outputs, *self._inputs, *copies]:
            slot.offset = -(-end // slot.size) * slot.size
            end = slot.offset + slot.size * len(slot.quantities)
        self._size = -(-end // 8) * 8
        self._block = np.zeros(self._size, dtype=np.uint8)
        self._base = self._block.ctypes.data

    def _plan(self, links: Sequence[ScaledLink]) -> list[_Transfer]:
        """One transfer for each source, target and type, in the order in which the source's values lie."""
        place = {(s.component, q.name): (s, i) for s in self._outputs for i, q in enumerate(s.quantities)}
        found: dict[tuple[int, str, Access], _Transfer] = {}
        for link in sorted(links, key=lambda k: place[k.source, k.source_variable][1]):
            slot, index = place[link.source, link.source_variable]
            quantity = self.fmus[link.target].inputs[link.target_variable]
            key = (id(slot), link.target, quantity.access)
            transfer = found.setdefault(key, _Transfer(slot, [], link.target, [], []))
            transfer.picked.append(index)
            transfer.quantities.append(quantity)
            transfer.links.append(link)
        return list(found.values())

    def view(self, slot: _Slot) -> npt.NDArray[Any]:
        """A slot's values, where they lie."""
        end = slot.offset + slot.size * len(slot.quantities)
        return self._block[slot.offset : end].view(slot.access.dtype)

    def outputs(self, name: str) -> list[tuple[list[str], npt.NDArray[Any]]]:
        """A component's outputs: names, and the values where they lie, which change as it is stepped."""
        return [([q.name for q in s.quantities], self.view(s)) for s in self._outputs if s.component == name]

    def _gather(self, transfer: _Transfer) -> Call | None:
        """What brings a transfer's values into its own slot."""
        if transfer.slot is None:
            return None
        target = self.view(transfer.slot)
        if transfer.is_run:
            size = ctypes.c_size_t(target.nbytes)
            start = ctypes.c_void_p(transfer.source.address(self._base, transfer.picked[0]))
            return _copy, (ctypes.c_void_p(transfer.slot.address(self._base)), start, size)
        source, picked = self.view(transfer.source), np.array(transfer.picked)
        if not any(link.converts for link in transfer.links):
            return partial(_cast, target, source, picked), ()
        factor = np.array([link.factor for link in transfer.links])
        offset = np.array([link.offset for link in transfer.links])
        return partial(_convert, target, source, picked, factor, offset), ()

    def _compile(self, order: Order) -> None:
        """Turn a tick into two lists of calls: up to the row of the tick, and after it."""
        self._whose: dict[int, tuple[str, str]] = {}
        self._ended = (ctypes.c_char * (len(self.components) + 1))()
        gathers: dict[str, list[Call]] = {name: [] for name in self.components}
        sets: dict[str, list[Call]] = {name: [] for name in self.components}
        for transfer in self._transfers:
            if gather := self._gather(transfer):
                gathers[transfer.target].append(gather)
            slot, index = (transfer.slot, 0) if transfer.slot else (transfer.source, transfer.picked[0])
            component = self.components[transfer.target]
            call = component.setting(transfer.quantities, slot.address(self._base, index))
            sets[transfer.target].append(self._named(call, transfer.target, "set", transfer.quantities))
        gets: dict[str, list[Call]] = {name: [] for name in self.components}
        for slot in self._outputs:
            call = self.components[slot.component].getting(slot.quantities, slot.address(self._base))
            gets[slot.component].append(self._named(call, slot.component, "get", slot.quantities))
        steps = {}
        for index, (name, component) in enumerate(self.components.items()):
            ended = ctypes.addressof(self._ended) + index
            call = component.stepping(self._time, self.wiring.step, ended)
            self._whose[id(call[1])] = (name, f"fmi{component.description.version}DoStep")
            steps[name] = call
        self._free_calls: dict[str, list[Call]] = {name: [] for name in self.components}
        for slot in self._inputs:
            call = self.components[slot.component].setting(slot.quantities, slot.address(self._base))
            self._free_calls[slot.component].append(self._named(call, slot.component, "set", slot.quantities))
        answering = [n for n in self.wiring.order if n not in self.wiring.plants]
        plants = [n for n in self.wiring.order if n in self.wiring.plants]
        self._tick: list[Call] = []
        if order == "jacobi":
            self._tick += [call for name in self.wiring.order for call in gathers.pop(name)]
        for name in answering:
            self._tick += [*gathers.pop(name, ()), *sets[name], steps[name], *gets[name]]
        self._tick += [call for name in plants for call in gathers.pop(name, ())]
        # plants take each other's outputs at t_k: all are given their inputs before any of them is stepped
        self._advance = [call for name in plants for call in sets[name]]
        self._advance += [call for name in plants for call in (steps[name], *gets[name])]
        self._first = [call for name in self.wiring.order for call in gets[name]]

    def _named(self, call: Call, name: str, verb: str, quantities: Sequence[Quantity]) -> Call:
        version = self.components[name].description.version
        names = ", ".join(q.name for q in quantities[:3]) + (", ..." if len(quantities) > 3 else "")
        what = f"fmi{version}{verb.title()}{quantities[0].access.fmi} of {names}"
        self._whose[id(call[1])] = (name, what)
        return call

    def _carry_out(self, calls: list[Call]) -> None:
        for function, arguments in calls:
            if status := function(*arguments):
                self._failed(status, arguments)

    def _failed(self, status: int, arguments: tuple[Any, ...]) -> None:
        name, what = self._whose[id(arguments)]
        self.components[name].check(status, what, self._time.value)

    @np.errstate(invalid="ignore")  # the test for finite values multiplies those that are not
    def run(
        self,
        events: Sequence[Event] = (),
        *,
        duration: float = DURATION,
        stop: Stop | None = None,
        record: Record | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Outcome:
        """Run from t = 0 until the stop condition holds or t = duration; both ends have a row.

        Args:
            events: changes of free inputs.
            duration: s.
            stop: ends the trial earlier.
            record: is given rows, some at a time: times (n,) in s, and by component (n, columns) of
                float64 in SI. It gets all rows that were finished, also when the run fails.
            progress: is told the time now and then.

        Raises:
            FmuError: an FMU answered with a status that is no success, or with a value that is not finite.
            ParameterError: an event names no free input.
        """
        step = self.wiring.step
        last = math.floor(duration / step + 1e-9)
        changes = self._schedule(events, step)
        watched = self._watched(stop)
        stops = stop.values if stop else frozenset()
        reals = [values for kind in _REALS if (values := self._block_of(kind)).size]
        tests: list[tuple[Any, Any]] = [(values.dot, np.zeros_like(values)) for values in reals]
        rows = np.zeros((ROWS, self._size), dtype=np.uint8)
        here = ctypes.c_void_p(self._base)
        size = ctypes.c_size_t(self._size)
        saves = [(ctypes.c_void_p(rows[i].ctypes.data), here, size) for i in range(ROWS)]
        answer, advance = self._tick, self._advance
        nobody = bytes(len(self._ended))
        now, ended = self._time, self._ended
        self._apply(0, {0: self._initial()})
        self._carry_out(self._first)
        following = min(changes, default=-1)
        tick = done = handed = 0
        reason: int | None = None
        try:
            for tick in range(last + 1):
                now.value = tick * step
                if tick == following:
                    following = self._apply(tick, changes)
                for function, arguments in answer:
                    if status := function(*arguments):
                        self._failed(status, arguments)
                _copy(*saves[done])
                done += 1
                for dot, zeros in tests:
                    if dot(zeros) != 0.0:  # 0 for all finite numbers, NaN otherwise
                        self._report_not_finite()
                if watched is not None and watched.value in stops:
                    reason = watched.value
                    break
                if ended.raw != nobody:
                    self._report_ended()
                if done == ROWS:
                    first, handed, done = handed, handed + ROWS, 0
                    self._hand_over(first, rows, record, progress)
                if tick < last:
                    for function, arguments in advance:
                        if status := function(*arguments):
                            self._failed(status, arguments)
        finally:
            self._hand_over(handed, rows[:done], record, progress)
        return Outcome(tick + 1, tick * step, reason)

    def _block_of(self, kind: str) -> npt.NDArray[Any]:
        """All outputs of one floating-point type: they lie together."""
        slots = [s for s in self._outputs if s.type == kind]
        if not slots:
            return np.zeros(0)
        start = min(s.offset for s in slots)
        end = max(s.offset + s.size * len(s.quantities) for s in slots)
        return self._block[start:end].view(kind)

    def _initial(self) -> list[Event]:
        return [Event(0.0, n, v, value) for n, values in self._free.items() for v, value in values.items()]

    def _schedule(self, events: Sequence[Event], step: float) -> dict[int, list[Event]]:
        """Events by the tick at which they act."""
        changes: dict[int, list[Event]] = {}
        for event in sorted(events, key=lambda e: e.time):
            if event.component not in self.components:
                hint = nearest(event.component, self.components)
                raise ParameterError(f'no component "{event.component}"{hint}')
            free = self.wiring.free[event.component]
            if event.variable not in free:
                wrong = f"is no input{nearest(event.variable, free)}"
                if event.variable in self.fmus[event.component].inputs:
                    wrong = "is connected; only free inputs can be set"
                raise ParameterError(f"{event.component}.{event.variable} {wrong}")
            changes.setdefault(math.ceil(event.time / step - 1e-9), []).append(event)
        return changes

    def _apply(self, tick: int, changes: dict[int, list[Event]]) -> int:
        """Set the free inputs that change at this tick; the next tick at which some do, or -1."""
        events = changes.pop(tick)
        for event in events:
            for slot in self._inputs:
                if slot.component == event.component:
                    for index, quantity in enumerate(slot.quantities):
                        if quantity.name == event.variable:
                            self.view(slot)[index] = event.value
        for name in {event.component: None for event in events}:
            self._carry_out(self._free_calls[name])
        return min(changes, default=-1)

    def _watched(self, stop: Stop | None) -> Any:
        """The stop condition's value as a ctypes integer that lies in the block."""
        if stop is None:
            return None
        for slot in self._outputs:
            for index, quantity in enumerate(slot.quantities):
                if (slot.component, quantity.name) == (stop.component, stop.variable):
                    kind: Any = np.ctypeslib.as_ctypes_type(np.dtype(slot.access.dtype).str)
                    return kind.from_address(slot.address(self._base, index))
        raise ParameterError(f"there is no output {stop.component}.{stop.variable} to stop by")

    def _report_not_finite(self) -> None:
        order, plants = self.wiring.order, self.wiring.plants
        causes = sorted(self._outputs, key=lambda s: (s.component not in plants, order.index(s.component)))
        for slot in causes:  # a plant's value of this tick comes before everybody's answer to it
            if slot.type in _REALS:
                for quantity, value in zip(slot.quantities, self.view(slot), strict=True):
                    if not math.isfinite(value):
                        raise FmuError(
                            f'{self.components[slot.component].label}: output "{quantity.name}" is {value} '
                            f"at t = {self._time.value:.10g} s; expected a finite number"
                        )

    def _report_ended(self) -> None:
        index = self._ended.raw.index(1)
        label = list(self.components.values())[index].label
        raise FmuError(f"{label}: asks to end the simulation at t = {self._time.value:.10g} s")

    def _hand_over(
        self,
        first: int,
        rows: npt.NDArray[np.uint8],
        record: Record | None,
        progress: Callable[[float], None] | None,
    ) -> None:
        """Give rows, the first of them of tick `first`, to whoever records them."""
        times = np.arange(first, first + len(rows), dtype=np.float64) * self.wiring.step
        if not len(times):
            return
        if record is not None:
            values = {name: np.empty((len(rows), len(self.columns(name)))) for name in self.components}
            for name, dtype, columns, places in self._sources:
                values[name][:, columns] = rows.view(dtype)[:, places]
            record(times, values)
        if progress is not None:
            progress(float(times[-1]))

    @cached_property
    def _sources(self) -> list[tuple[str, npt.DTypeLike, Places, Places]]:
        """Where the rows' columns come from: (component, type, columns, places in a row of the type)."""
        position = {n: {q.name: i for i, q in enumerate(self.columns(n))} for n in self.components}
        places: dict[tuple[str, str], tuple[list[int], list[int]]] = {}

        def add(component: str, quantities: Sequence[Quantity], slot: _Slot, picked: Iterable[int]) -> None:
            columns, sources = places.setdefault((component, slot.type), ([], []))
            columns += [position[component][q.name] for q in quantities]
            sources += [slot.offset // slot.size + i for i in picked]

        for slot in [*self._outputs, *self._inputs]:
            add(slot.component, slot.quantities, slot, range(len(slot.quantities)))
        for transfer in self._transfers:
            slot, picked = (transfer.source, transfer.picked)
            if transfer.slot is not None:
                slot, picked = transfer.slot, list(range(len(transfer.quantities)))
            add(transfer.target, transfer.quantities, slot, picked)
        return [(n, dtype, np.array(columns), np.array(at)) for (n, dtype), (columns, at) in places.items()]


def _slots(component: str, quantities: Sequence[Quantity]) -> list[_Slot]:
    """One slot for each type of the quantities, which keep their order."""
    by_type: dict[Access, list[Quantity]] = {}
    for quantity in quantities:
        by_type.setdefault(quantity.access, []).append(quantity)
    return [_Slot(component, access, members) for access, members in by_type.items()]


def _cast(target: npt.NDArray[Any], source: npt.NDArray[Any], picked: npt.NDArray[np.intp]) -> None:
    target[:] = source[picked]


def _convert(
    target: npt.NDArray[Any],
    source: npt.NDArray[Any],
    picked: npt.NDArray[np.intp],
    factor: Array,
    offset: Array,
) -> None:
    values = source[picked] * factor + offset
    target[:] = values if target.dtype.kind == "f" else np.rint(values)
