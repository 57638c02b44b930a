"""Cells: jobs of a point each, such as those of a matrix, which run as one under one numbering of trials."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.sweep import cosimulated
from harness.sweep.chunks import Chunk, Job, Outcomes, Piece, chunk_size
from harness.sweep.cosimulated import PROBE, Cosimulated


@dataclass(frozen=True)
class Cells:
    """The trials of several cells; number k is trial k mod `trials` of cell k div `trials`.

    Attributes:
        cells: each with as many trials, and the seed of its first.
        first: index of `cells[0]` among all cells, if this is a part.
    """

    cells: tuple[Job | Cosimulated, ...]
    first: int = 0

    @property
    def trials(self) -> int:
        """Number of trials of each cell."""
        return self.cells[0].trials

    @property
    def point_count(self) -> int:
        """Number of cells."""
        return len(self.cells)

    @property
    def has_fmus(self) -> bool:
        """Does a cell run FMUs?"""
        return any(isinstance(cell, Cosimulated) for cell in self.cells)

    @property
    def total(self) -> int:
        """Number of trials."""
        return len(self.cells) * self.trials

    @property
    def type_names(self) -> tuple[str, ...]:
        """The types of trials that take turns in each cell."""
        return self.cells[0].type_names

    @property
    def dtype(self) -> type[np.unsignedinteger[Any]]:
        """The smallest integer type that holds the index of any tick."""
        return max((cell.dtype for cell in self.cells), key=lambda dtype: np.dtype(dtype).itemsize)

    def part(self, start: int, stop: int) -> Cells:
        """The same with only the cells that the trials start <= k < stop need."""
        first, last = start // self.trials, (stop - 1) // self.trials
        return Cells(self.cells[first : last + 1], first)

    def rounds(self, outcomes: Outcomes, width: int) -> Iterator[Iterable[Piece]]:
        """The trials that `outcomes` lacks; first a probe of each cell that others' FMUs may spoil."""
        probes = {
            k * self.trials: min(PROBE, self.trials)
            for k, cell in enumerate(self.cells)
            if isinstance(cell, Cosimulated)
        }
        yield [
            (start, start + probes[start]) for start, stop in self._pieces(outcomes, width) if start in probes
        ]
        yield self._pieces(outcomes, width)

    def _pieces(self, outcomes: Outcomes, width: int) -> Iterator[Piece]:
        """What is missing, cut at the same places however often the work was interrupted."""
        for start, stop in outcomes.missing():
            while start < stop:
                index, number = divmod(start, self.trials)
                cell = self.cells[index]
                size = PROBE if isinstance(cell, Cosimulated) else chunk_size(cell, self.trials, width)
                end = min(stop, index * self.trials + min(self.trials, (number // size + 1) * size))
                yield start, end
                start = end  # noqa: PLW2901

    def run(self, start: int, stop: int) -> Chunk:
        """Run the trials start <= k < stop, all of one cell."""
        index = start // self.trials
        before = index * self.trials
        chunk = self.cells[index - self.first].run(start - before, stop - before)
        return replace(chunk, start=chunk.start + before, stop=chunk.stop + before)

    def packed(self) -> Cells:
        """With the files of the FMUs in it."""
        return replace(self, cells=tuple(cell.packed() for cell in self.cells))

    def prepare(self) -> None:
        """Let trials run; each cell makes what it needs when its first trials do."""
        cosimulated.begin()

    def abandon(self) -> None:
        """End what runs."""
        cosimulated.abandon()
