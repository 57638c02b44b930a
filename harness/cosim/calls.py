"""A tick as a list of C calls whose arguments are made once."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Protocol, Self

from harness.cosim.fmu import Call, FmuDescription, Mark, Quantity, unmarked
from harness.cosim.layout import Layout
from harness.cosim.stepping import Order
from harness.cosim.wiring import Wiring

ASKS = 3  # bytes in which a component's step says what it asks for: to end, an event, to return early
ENDED, EVENT, EARLY = range(ASKS)
Reached = tuple[ctypes.c_double, int]  # the time that a step reached, s; the byte that becomes 1 if too early


class Instance(Protocol):
    """What the loop asks of a component: an instance of an FMU, or what stands in for one.

    `reached` is the time [s] that its last step reached; None if its steps do not tell.
    """

    label: str
    description: FmuDescription
    reached: ctypes.c_double | None

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...

    def initialize(self, values: Mapping[str, float]) -> None: ...

    def setting(self, quantities: Sequence[Quantity], address: int) -> Call: ...

    def getting(self, quantities: Sequence[Quantity], address: int) -> Call: ...

    def stepping(self, time: ctypes.c_double, step: float, ended: int) -> Call: ...

    def check(self, status: int, what: str, time: float) -> None: ...


class Calls:
    """The calls of a system's components.

    Attributes:
        first: get all outputs, before the first tick.
        answer: everything up to the row of a tick: all components but the plants.
        advance: what follows the row: the plants step to the next tick.
        free: by component, set the inputs that no link feeds.
        ended: `ASKS` bytes for each component; one becomes 1 when its step asks for what this loop lacks.
        reached: the times that steps reached, of `answer` and of `advance`.
        time: s, of the tick; `now`: the same for the FMUs, `start` later, which every step reads.
        tick: `answer` and `advance`: where a walk is in it, its recorder says.
    """

    def __init__(
        self,
        components: Mapping[str, Instance],
        layout: Layout,
        wiring: Wiring,
        order: Order,
        mark: Mark = unmarked,
    ) -> None:
        self._components, self._mark = components, mark
        self._whose: dict[int, tuple[str, str]] = {}
        self.start = wiring.start
        self.time, self.now = ctypes.c_double(0.0), ctypes.c_double(self.start)
        self.ended = (ctypes.c_char * (ASKS * len(components) + 1))()
        gathers: dict[str, list[Call]] = {name: [] for name in components}
        sets: dict[str, list[Call]] = {name: [] for name in components}
        for transfer in layout.transfers:
            if gather := layout.gather(transfer):
                gathers[transfer.target].append(gather)
                self._whose[id(gather)] = (transfer.target, "copy of its inputs")
            slot, places = transfer.place
            call = components[transfer.target].setting(transfer.quantities, layout.address(slot, places[0]))
            sets[transfer.target].append(self._named(call, transfer.target, "Set", transfer.quantities))
        gets: dict[str, list[Call]] = {name: [] for name in components}
        for slot in layout.outputs:
            call = components[slot.component].getting(slot.quantities, layout.address(slot))
            gets[slot.component].append(self._named(call, slot.component, "Get", slot.quantities))
        self.free: dict[str, list[Call]] = {name: [] for name in components}
        for slot in layout.inputs:
            call = components[slot.component].setting(slot.quantities, layout.address(slot))
            self.free[slot.component].append(self._named(call, slot.component, "Set", slot.quantities))
        steps = {}
        self.reached: tuple[list[Reached], list[Reached]] = ([], [])
        for index, (name, component) in enumerate(components.items()):
            asks = ASKS * index
            steps[name] = component.stepping(self.now, wiring.step, ctypes.addressof(self.ended) + asks)
            if component.reached is not None:
                self.reached[name in wiring.plants].append((component.reached, asks + EARLY))
            self._whose[id(steps[name])] = (name, f"fmi{component.description.version}DoStep")
        answering = [name for name in wiring.order if name not in wiring.plants]
        faults = [name for name in answering if name in wiring.faults]
        plants = [name for name in wiring.order if name in wiring.plants]
        self.answer: list[Call] = []
        if order == "jacobi":
            for name in faults:  # before the exchange: a fault adds no delay
                self.answer += [*gathers.pop(name), *sets[name], steps[name], *gets[name]]
                answering.remove(name)
            self.answer += [call for name in wiring.order for call in gathers.pop(name, ())]
        for name in answering:
            self.answer += [*gathers.pop(name, ()), *sets[name], steps[name], *gets[name]]
        self.answer += [call for name in plants for call in gathers.pop(name, ())]
        # plants take each other's outputs at t_k: all get their inputs before any of them is stepped
        self.advance = [call for name in plants for call in sets[name]]
        self.advance += [call for name in plants for call in (steps[name], *gets[name])]
        self.tick = [*self.answer, *self.advance]
        self.first = [call for name in wiring.order for call in gets[name]]

    def _named(self, call: Call, name: str, verb: str, quantities: Sequence[Quantity]) -> Call:
        """Store the call's name, for messages."""
        version = self._components[name].description.version
        names = ", ".join(q.name for q in quantities[:3]) + (", ..." if len(quantities) > 3 else "")
        what = f"fmi{version}{verb}{quantities[0].access.fmi} of {names}"
        self._whose[id(call)] = (name, what)
        return call

    def set_time(self, time: float) -> None:
        """Begin the tick at a time [s]."""
        self.time.value, self.now.value = time, self.start + time

    def carry_out(self, calls: Sequence[Call]) -> None:
        """Make calls, one after the other.

        Raises:
            FmuError: a status other than ok or warning.
        """
        for call in calls:
            self._mark(*self.whose(call))
            function, arguments = call
            if status := function(*arguments):
                self.fail(status, call)
        self._mark("", "")

    def whose(self, call: Call) -> tuple[str, str]:
        """A call's component, and its function with the variables."""
        return self._whose[id(call)]

    def fail(self, status: int, call: Call) -> None:
        """Accept a warning; for any other status raise an error that names the call.

        Raises:
            FmuError: naming component, function, status and time.
        """
        name, what = self.whose(call)
        self._components[name].check(status, what, self.time.value)
