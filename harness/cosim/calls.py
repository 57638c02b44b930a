"""A tick as a list of C calls whose arguments are made once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from harness.cosim.fmu import (
    OK,
    WARNING,
    Call,
    Clock,
    Fault,
    FmuDescription,
    FmuError,
    Mark,
    Quantity,
    limits_of,
    unmarked,
)
from harness.cosim.layout import Cast, Layout, Transfer
from harness.cosim.stepping import Order, Ticks
from harness.cosim.wiring import Wiring

Numbered = tuple[int, Call]  # a call, and its place among those of a tick


class Instance(Protocol):
    """What the loop asks of a component: an instance of an FMU, or what stands in for one."""

    label: str
    description: FmuDescription

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...

    def initialize(self, values: Mapping[str, float]) -> None: ...

    def setting(self, quantities: Sequence[Quantity], address: int) -> Call: ...

    def getting(self, quantities: Sequence[Quantity], address: int) -> Call: ...

    def stepping(self, clock: Clock, size: float, count: int = 1) -> Call: ...

    def check(self, status: int, what: str, time: float) -> None: ...


@dataclass(frozen=True)
class Turn:
    """When a call is made: on tick k where k modulo `every` is `phase`, but not on ticks of `stalls`."""

    every: int = 1
    phase: int = 0
    stalls: tuple[Ticks, ...] = ()

    def is_due(self, tick: int) -> bool:
        """Is the call made on this tick?"""
        return tick % self.every == self.phase and not any(
            first <= tick < after for first, after in self.stalls
        )

    def lag(self, tick: int) -> int:
        """By how many ticks the component's own time is late, since stalls were before."""
        return sum(after - first for first, after in self.stalls if after <= tick)


@dataclass(eq=False)
class OwnTime:
    """The step of a component that stalls: a step begins where its last one ended, as FMI asks for.

    Attributes:
        step: the call of it; `tick`: s.
    """

    step: Call
    turn: Turn
    clock: Clock
    tick: float

    def __call__(self) -> int:
        (function, arguments), clock = self.step, self.clock
        time, tick = clock.time, clock.position.tick
        clock.set(time, (tick - self.turn.lag(tick)) * self.tick)
        status: int = function(*arguments) or OK
        if status in (OK, WARNING):
            clock.set(time)
        return status


class Calls:
    """The calls of a system's components.

    Attributes:
        first: get all outputs, before the first tick.
        answer: everything up to the row of a tick: all components but the plants.
        advance: what follows the row: the plants step to the next tick.
        free: by component, set the inputs that no link feeds.
        clock: what every step reads.
        tick: `answer` and `advance`: where a walk is in it, its recorder says.
        turns: when those calls of `tick` are made that are not made on each, by their place.
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
        self._casts: dict[int, Transfer] = {}
        self.clock = Clock(wiring.start)
        gathers: dict[str, list[Call]] = {name: [] for name in components}
        sets: dict[str, list[Call]] = {name: [] for name in components}
        for transfer in layout.transfers:
            if gather := layout.gather(transfer):
                gathers[transfer.target].append(gather)
                self._whose[id(gather)] = (transfer.target, "copy of its inputs")
                self._casts[id(gather)] = transfer
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
        for name, component in components.items():
            rate = wiring.rates[name]
            step = component.stepping(self.clock, rate.size(wiring.step), rate.substeps)
            if stalls := wiring.stalls.get(name):
                step = OwnTime(step, Turn(stalls=stalls), self.clock, wiring.step), ()
            steps[name] = step
            self._whose[id(steps[name])] = (name, f"fmi{component.description.version}DoStep")
        turns: dict[int, Turn] = {}
        for name, rate in wiring.rates.items():
            stalls = wiring.stalls.get(name, ())
            if rate.every > 1 or stalls:
                begin = Turn(rate.every, 0, stalls)
                turns |= {id(call): begin for call in (*gathers[name], *sets[name], steps[name])}
                phase = rate.every - 1 if name in wiring.late else 0
                turns |= {id(call): Turn(rate.every, phase, stalls) for call in gets[name]}
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
        self.turns = {place: turns[id(call)] for place, call in enumerate(self.tick) if id(call) in turns}
        self.first = [call for name in wiring.order for call in gets[name]]

    def _named(self, call: Call, name: str, verb: str, quantities: Sequence[Quantity]) -> Call:
        """Store the call's name, for messages."""
        version = self._components[name].description.version
        names = ", ".join(q.name for q in quantities[:3]) + (", ..." if len(quantities) > 3 else "")
        what = f"fmi{version}{verb}{quantities[0].access.fmi} of {names}"
        self._whose[id(call)] = (name, what)
        return call

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

    def numbered(self) -> tuple[list[Numbered], list[Numbered]]:
        """The calls up to a tick's row, and those after it."""
        places = list(enumerate(self.tick))
        return places[: len(self.answer)], places[len(self.answer) :]

    def due(self, numbered: Sequence[Numbered], tick: int) -> Sequence[Numbered]:
        """Those of the calls that are made on this tick."""
        if not self.turns:
            return numbered
        turns = [self.turns.get(place) for place, _ in numbered]
        return [n for n, turn in zip(numbered, turns, strict=True) if turn is None or turn.is_due(tick)]

    def whose(self, call: Call) -> tuple[str, str]:
        """A call's component, and its function with the variables."""
        return self._whose[id(call)]

    def fail(self, status: int, call: Call) -> None:
        """Accept a warning; for any other status raise an error that names the call.

        Raises:
            FmuError: naming component, function, status and time; or an output that no input's type holds.
        """
        if isinstance(call[0], Cast):
            raise self._out_of_range(call[0], self._casts[id(call)])
        name, what = self.whose(call)
        self._components[name].check(status, what, self.clock.time)

    def _out_of_range(self, cast: Cast, transfer: Transfer) -> FmuError:
        """The error of the first value that its target's type does not hold."""
        values = cast.values()
        place = int(np.argmin(cast.fit(values)))
        link, time, target = transfer.links[place], self.clock.time, cast.target.dtype
        source, output = self._components[link.source], f'output "{link.source_variable}"'
        low, high = limits_of(target)
        return FmuError(
            f"{source.label}: {output} gives {values[place]} to "
            f"{link.target}.{link.target_variable} at t = {time:.10g} s; expected {low:.10g} to {high:.10g} "
            f"({target.name})",
            Fault("out of range", link.source, source.description.path.name, output, time),
        )
