"""Where a system's values lie: one block of memory, which the calls of all components share.

An output lies where its get call puts it, and is set as another's input from there. A transfer copies a value
first, into a slot of the input, if the link converts it, if the input's values do not lie side by side, if
the source replaces it before it is read, or if the target holds it for several ticks. A row of the log is one
copy of the block.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from harness.cosim.fmu import OK, Access, Call, FmuDescription, Quantity, limits_of
from harness.cosim.ssp import ScaledLink
from harness.cosim.stepping import Order
from harness.cosim.wiring import Wiring
from models.kit.declaration import Type

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]

REALS = ("float64", "float32")
OUTSIDE = -(2**31) + 1  # what a `Cast` returns in the place of a status when its target cannot hold a value

# memmove by its address, without argument types and as a function of nothing: no status, no checks
copy = ctypes.PYFUNCTYPE(None)(ctypes.cast(ctypes.memmove, ctypes.c_void_p).value or 0)


@dataclass(frozen=True, eq=False)
class Cast:
    """Makes values of one type values of another. A call gives a status: `OUTSIDE` if one does not fit.

    A whole number must be one of the target's type, and a finite real must not become infinite.

    Attributes:
        target: (n,), where they go.
        source: (m,), where they come from; its places `picked` (n,).
        is_boolean: they are Booleans, true unless 0.
    """

    target: npt.NDArray[Any]
    source: npt.NDArray[Any]
    picked: Places
    is_boolean: bool = field(default=False, kw_only=True)

    def __call__(self) -> int:
        values = self.values()
        if not self._holds_all and not self.fit(values).all():
            return OUTSIDE
        self.target[:] = values
        return OK

    def values(self) -> npt.NDArray[Any]:
        """What goes to the target, (n,), before it has the target's type."""
        values = self.source[self.picked]
        return values != 0 if self.is_boolean else values

    def fit(self, values: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
        """Which of the values the target's type holds."""
        kind = self.target.dtype
        if kind.kind == "f":
            with np.errstate(over="ignore"):
                fits = ~np.isfinite(values) | np.isfinite(values.astype(kind))
        else:
            low, high = limits_of(kind)
            fits = (values >= low) & (values <= high)
        return np.asarray(fits, dtype=np.bool_)

    @cached_property
    def _holds_all(self) -> bool:
        """Does the target's type hold all values of the source's?"""
        return np.can_cast(bool if self.is_boolean else self.source.dtype, self.target.dtype)


@dataclass(frozen=True, eq=False)
class Conversion(Cast):
    """Gives factor (n,) * source + offset (n,). Whole numbers are rounded and stay within their type."""

    factor: Array
    offset: Array

    def values(self) -> npt.NDArray[Any]:
        """As `Cast`."""
        values = super().values() * self.factor + self.offset
        return values if self.target.dtype.kind == "f" else np.clip(np.rint(values), *self.bounds)

    @cached_property
    def _holds_all(self) -> bool:
        return self.target.dtype.name != "float32"

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """The least and the largest float64 that the target's type holds."""
        if self.target.dtype.kind == "f":
            return -math.inf, math.inf
        low, high = limits_of(self.target.dtype)
        return float(low), float(high) if int(float(high)) <= high else math.nextafter(high, 0.0)


@dataclass(frozen=True, eq=False)
class Replacement(Cast):
    """Replaces whole numbers by the tables (n,) of the values; what a table lacks stays."""

    tables: Sequence[Mapping[int, int]]

    def values(self) -> npt.NDArray[Any]:
        """As `Cast`, of Python's numbers: no type holds all that a table and its source may have."""
        values = zip(super().values().tolist(), self.tables, strict=True)
        return np.array([table.get(value, value) for value, table in values], dtype=object)

    @cached_property
    def _holds_all(self) -> bool:
        return False


@dataclass(eq=False)
class Slot:
    """Consecutive values of one type in the block: `access.dtype` times the quantities of one component."""

    component: str
    access: Access
    quantities: list[Quantity]
    offset: int = 0  # bytes

    @property
    def type(self) -> str:
        """The name of the type: `float64`."""
        return np.dtype(self.access.dtype).name

    @property
    def size(self) -> int:
        """Of one value, bytes."""
        return np.dtype(self.access.dtype).itemsize

    @property
    def end(self) -> int:
        """Where the next slot may begin."""
        return self.offset + self.size * len(self.quantities)


@dataclass(eq=False)
class Transfer:
    """Values for inputs of one type of a component, from one slot of another's outputs."""

    source: Slot
    picked: list[int]  # places in the source
    target: str
    quantities: list[Quantity]
    links: list[ScaledLink]
    slot: Slot | None = None  # where they lie for the target, unless it reads them from the source

    @property
    def is_run(self) -> bool:
        """Do they lie one after the other, as the target takes them?"""
        first = self.picked[0]
        return (
            self.picked == list(range(first, first + len(self.picked)))
            and self.source.access.dtype == self.quantities[0].access.dtype
            and not any(link.converts for link in self.links)
        )

    @property
    def place(self) -> tuple[Slot, list[int]]:
        """Where the target reads its values."""
        return (self.source, self.picked) if self.slot is None else (self.slot, [*range(len(self.picked))])


class Layout:
    """The block of memory of a system.

    Attributes:
        outputs: slots of what the components give; the reals lie together.
        inputs: slots of the inputs that no link feeds.
        transfers: what the links carry.
        block: (bytes,) the memory.
    """

    def __init__(
        self, links: Sequence[ScaledLink], fmus: Mapping[str, FmuDescription], wiring: Wiring, order: Order
    ) -> None:
        self._fmus = fmus
        self.outputs = _outputs(links, fmus, wiring)
        self.inputs = [
            slot
            for name, variables in wiring.free.items()
            for slot in _slots(name, [fmus[name].inputs[v] for v in variables])
        ]
        self.transfers = self._plan(links)
        stepped = {name: position for position, name in enumerate(wiring.order)}
        for transfer in self.transfers:
            source, target = transfer.source.component, transfer.target
            replaced = source not in wiring.plants and (
                order == "jacobi" or stepped[source] >= stepped[target]
            )
            is_held = wiring.rates[target].every > 1 or target in wiring.stalls
            if replaced or is_held or not transfer.is_run:
                transfer.slot = Slot(target, transfer.quantities[0].access, transfer.quantities)
        copies = [t.slot for t in self.transfers if t.slot is not None]
        self._faults = wiring.faults
        self.outputs.sort(key=self._rank)
        end = 0
        for slot in [*self.outputs, *self.inputs, *copies]:
            slot.offset = -(-end // slot.size) * slot.size
            end = slot.end
        self.block = np.zeros(max(8, -(-end // 8) * 8), dtype=np.uint8)
        self._columns = self._arrange()

    def _rank(self, slot: Slot) -> int:
        """Where an output lies: the reals that must be finite side by side."""
        is_checked = slot.type in REALS and slot.component not in self._faults
        return REALS.index(slot.type) if is_checked else len(REALS)

    def _plan(self, links: Sequence[ScaledLink]) -> list[Transfer]:
        """One transfer for each source, target and type, in the order in which the source's values lie."""
        place = {(s.component, q.name): (s, i) for s in self.outputs for i, q in enumerate(s.quantities)}
        transfers: dict[tuple[int, str, Access, bool], Transfer] = {}
        for link in sorted(links, key=lambda k: place[k.source, k.source_variable][1]):
            slot, index = place[link.source, link.source_variable]
            quantity = self._fmus[link.target].inputs[link.target_variable]
            key = (id(slot), link.target, quantity.access, bool(link.table))
            transfer = transfers.setdefault(key, Transfer(slot, [], link.target, [], []))
            transfer.picked.append(index)
            transfer.quantities.append(quantity)
            transfer.links.append(link)
        return list(transfers.values())

    def address(self, slot: Slot, index: int = 0) -> int:
        """Of one value of a slot."""
        return int(self.block.ctypes.data) + slot.offset + index * slot.size

    def view(self, slot: Slot) -> npt.NDArray[Any]:
        """A slot's values, where they lie."""
        return self.block[slot.offset : slot.end].view(slot.access.dtype)

    def reals(self) -> list[npt.NDArray[Any]]:
        """All real outputs that must be finite, where they lie: an array for each type that there is."""
        arrays = []
        for rank, kind in enumerate(REALS):
            if slots := [slot for slot in self.outputs if self._rank(slot) == rank]:
                start, end = min(s.offset for s in slots), max(s.end for s in slots)
                arrays.append(self.block[start:end].view(kind))
        return arrays

    def gather(self, transfer: Transfer) -> Call | None:
        """What brings a transfer's values into its own slot; None if it has none."""
        if transfer.slot is None:
            return None
        target = self.view(transfer.slot)
        if transfer.is_run:
            start = ctypes.c_void_p(self.address(transfer.source, transfer.picked[0]))
            size = ctypes.c_size_t(target.nbytes)
            return copy, (ctypes.c_void_p(self.address(transfer.slot)), start, size)
        parts = target, self.view(transfer.source), np.array(transfer.picked)
        is_boolean = transfer.quantities[0].type is Type.BOOLEAN
        if not any(link.converts for link in transfer.links):
            return Cast(*parts, is_boolean=is_boolean), ()
        if transfer.links[0].table:
            tables = [dict(link.table) for link in transfer.links]
            return Replacement(*parts, tables, is_boolean=is_boolean), ()
        factor = np.array([link.factor for link in transfer.links])
        offset = np.array([link.offset for link in transfer.links])
        return Conversion(*parts, factor, offset, is_boolean=is_boolean), ()

    def columns(self, component: str) -> list[Quantity]:
        """What the rows of a component hold: its inputs, then its outputs."""
        fmu = self._fmus[component]
        return [*fmu.inputs.values(), *fmu.outputs.values()]

    def values(self, rows: npt.NDArray[np.uint8]) -> dict[str, Array]:
        """The values in copies of the block.

        Args:
            rows: (n, bytes).

        Returns:
            by component (n, columns).
        """
        table = np.empty((sum(self._widths.values()), len(rows)))
        for kind, columns, places in self._columns:
            table[columns] = rows.view(kind).T[places]
        values, start = {}, 0
        for name, width in self._widths.items():
            values[name] = table[start : start + width].T
            start += width
        return values

    def _arrange(self) -> list[tuple[str, Places, Places]]:
        """For each type: columns of all components' rows, and their places in a row of that type."""
        self._widths = {name: len(self.columns(name)) for name in self._fmus}
        names = [(name, quantity.name) for name in self._fmus for quantity in self.columns(name)]
        position = {name: i for i, name in enumerate(names)}
        sources = [
            (slot.component, slot.quantities, slot, [*range(len(slot.quantities))])
            for slot in [*self.outputs, *self.inputs]
        ]
        sources += [(t.target, t.quantities, *t.place) for t in self.transfers]
        places: dict[str, tuple[list[int], list[int]]] = {}
        for component, quantities, slot, picked in sources:
            columns, at = places.setdefault(slot.type, ([], []))
            columns += [position[component, quantity.name] for quantity in quantities]
            at += [slot.offset // slot.size + index for index in picked]
        return [(kind, np.array(columns), np.array(at)) for kind, (columns, at) in places.items()]


def _outputs(links: Sequence[ScaledLink], fmus: Mapping[str, FmuDescription], wiring: Wiring) -> list[Slot]:
    """Slots for all outputs: what the same components read lies together, so that it is set from there."""
    readers: dict[tuple[str, str], list[str]] = {}
    for link in links:
        readers.setdefault((link.source, link.source_variable), []).append(link.target)
    slots = []
    for name in wiring.order:
        quantities = sorted(fmus[name].outputs.values(), key=lambda q: readers.get((name, q.name), []))
        slots += _slots(name, quantities)
    return slots


def _slots(component: str, quantities: Iterable[Quantity]) -> list[Slot]:
    """One slot for each type of the quantities, which keep their order."""
    by_type: dict[Access, list[Quantity]] = {}
    for quantity in quantities:
        by_type.setdefault(quantity.access, []).append(quantity)
    return [Slot(component, access, members) for access, members in by_type.items()]
