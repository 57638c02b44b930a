"""Polygons on the plane that a batch watches: which of them is a trial's plant in?

The even-odd rule of `models.fence`: a place is inside if the line from it to the north crosses an odd number
of edges; of an edge's two ends the western one belongs to it. An area that the plant runs through between two
ticks is entered too: the straight line between the two places crosses an edge.

A batch asks on every tick of every trial, so a grid answers where it can: a cell is outside all areas, within
one, or near edges. There these edges decide, without a division.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from models.errors import ParameterError

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int32]
Polygon = Sequence[Array]  # rings of (corners, 2): north and east in m

CELLS = 256  # of the grid along its longer side, at most
SMALLEST = 0.5  # m: a cell's side at least
STRIDE = 0.4  # m, less than SMALLEST: for a tick's way up to this a cell answers, for a longer one all edges
MARGIN = 1e-6  # m: a cell is taken for larger than it is, so that rounding puts no place into a wrong one
EDGE = np.dtype(
    [("north", "f8"), ("east", "f8"), ("to_north", "f8"), ("to_east", "f8"), ("area", "i4")], align=True
)


@dataclass(frozen=True, eq=False)
class Areas:
    """Areas with numbers from 1 on; where several overlap, the first counts.

    Attributes:
        polygons: each with its rings; a ring within another one is a hole.

    Raises:
        ParameterError: a ring has fewer than three corners, or a number that is not finite.
    """

    polygons: Sequence[Polygon]

    def __post_init__(self) -> None:
        for number, polygon in enumerate(self.polygons, start=1):
            for ring in polygon:
                shape = np.shape(ring)
                if len(shape) != 2 or shape[0] < 3 or shape[1] != 2 or not np.isfinite(ring).all():
                    raise ParameterError(
                        f"area {number}: a ring has shape {shape}; expected (corners, 2), three finite "
                        "corners at least"
                    )

    @cached_property
    def edges(self) -> npt.NDArray[np.void]:
        """All edges, area by area: both ends, and the area's number."""
        rows = [
            (*a, *b, number)
            for number, polygon in enumerate(self.polygons, start=1)
            for ring in polygon
            for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)
        ]
        return np.array(rows, dtype=EDGE)

    @cached_property
    def side(self) -> float:
        """A cell's side [m]."""
        if not len(self.edges):
            return SMALLEST
        extent = max(float(np.ptp(self.edges[axis])) for axis in ("north", "east"))
        return max(SMALLEST, extent / CELLS)

    @cached_property
    def corner(self) -> tuple[float, float]:
        """The south-western corner of the grid [m]."""
        if not len(self.edges):
            return 0.0, 0.0
        north, east = (float(self.edges[axis].min()) - self.side for axis in ("north", "east"))
        return north, east

    @cached_property
    def _grid(self) -> tuple[Counts, Counts, Counts]:
        """Cells, lists, near edges."""
        if not len(self.edges):
            return np.zeros((1, 1), np.int32), np.zeros(1, np.int32), np.zeros(0, np.int32)
        lines = [
            corner + self.side * (0.5 + np.arange(int(np.ptp(self.edges[axis]) / self.side) + 3))
            for corner, axis in zip(self.corner, ("north", "east"), strict=True)
        ]
        north, east = np.meshgrid(*lines, indexing="ij")
        cells = self.inside(north, east)
        farthest = self.side * 0.5**0.5 + MARGIN  # from a cell's centre to its corners
        reach = farthest + STRIDE
        beside = []  # of each edge: the cells from which a stride may cross it
        for edge in self.edges:
            part = tuple(
                slice(
                    int(np.searchsorted(line, min(edge[axis], edge[f"to_{axis}"]) - reach)),
                    int(np.searchsorted(line, max(edge[axis], edge[f"to_{axis}"]) + reach)),
                )
                for line, axis in zip(lines, ("north", "east"), strict=True)
            )
            within = np.argwhere(_distance(edge, north[part], east[part]) <= reach)
            beside.append((within + [p.start for p in part]) @ [cells.shape[1], 1])
        cell, near = np.concatenate(beside), np.repeat(np.arange(len(beside)), [len(b) for b in beside])
        order = np.argsort(cell, kind="stable")  # area by area within a cell
        listed, first = np.unique(cell[order], return_index=True)
        cells.flat[listed] = -1 - np.arange(len(listed))
        lists = np.append(first, len(cell))
        return np.ascontiguousarray(cells), lists.astype(np.int32), near[order].astype(np.int32)

    @property
    def cells(self) -> Counts:
        """(rows to the north, columns to the east): what each cell says of a stride that ends in it.

        0: it is outside all areas; positive: within that area; -1 - i: the edges of list i decide.
        """
        return self._grid[0]

    @property
    def lists(self) -> Counts:
        """(lists + 1,): where each list begins in `near`, and where the last one ends."""
        return self._grid[1]

    @property
    def near(self) -> Counts:
        """Indices of edges, list by list."""
        return self._grid[2]

    def inside(self, north: Array, east: Array) -> Counts:
        """The number of the first area that each place is in, 0 for none, by the edges alone.

        Args:
            north, east: of the places, m, of one shape.
        """
        numbers = np.zeros(np.shape(north), np.int32)
        for number in range(len(self.polygons), 0, -1):
            odd = np.zeros(numbers.shape, dtype=bool)
            for edge in self.edges[self.edges["area"] == number]:
                along_north, along_east = edge["to_north"] - edge["north"], edge["to_east"] - edge["east"]
                beside = (edge["east"] > east) != (edge["to_east"] > east)
                over = along_north * (east[beside] - edge["east"])
                under = along_east * (north[beside] - edge["north"])
                odd[beside] ^= (over > under) if along_east > 0 else (under > over)
            numbers[odd] = number
        return numbers


def _distance(edge: np.void, north: Array, east: Array) -> Array:
    """From an edge to places [m]."""
    along_north, along_east = edge["to_north"] - edge["north"], edge["to_east"] - edge["east"]
    off_north, off_east = north - edge["north"], east - edge["east"]
    length = along_north**2 + along_east**2
    part = np.clip((off_north * along_north + off_east * along_east) / (length or 1.0), 0.0, 1.0)
    distance: Array = np.hypot(off_north - part * along_north, off_east - part * along_east)
    return distance
