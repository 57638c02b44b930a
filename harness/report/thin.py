"""Long logs on a screen: of each stretch the rows with the extremes stay, so that no spike is lost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from harness.log.channel import Array

MOST_ROWS = 12_000  # 8 minutes of 25 Hz: shown as they are
BUCKETS = 1000  # about a pixel each


def rows_to_show(
    lines: Sequence[Array],
    marked: npt.NDArray[np.bool_],
    points: Sequence[Array] = (),
    most: int = MOST_ROWS,
    buckets: int = BUCKETS,
) -> npt.NDArray[np.intp]:
    """The rows to draw: all, or of each of some stretches those with the least and greatest value.

    The first and last row stay, and those where a line begins or ceases to be finite.

    Args:
        lines, points: (rows,) each, what is drawn so.
        marked: (rows,), those that stay in any case.
        most: rows up to which all stay.
        buckets: the stretches.
    """
    rows = len(marked)
    if rows <= most:
        return np.arange(rows)
    edges = np.linspace(0, rows, buckets + 1).astype(np.intp)
    starts = edges[:-1]
    bucket = np.repeat(np.arange(buckets), np.diff(edges))
    kept = marked.copy()
    kept[[0, -1]] = True
    for line in lines:
        finite = np.isfinite(line)
        kept[1:] |= finite[1:] != finite[:-1]
    for column in (*lines, *points):
        finite = np.isfinite(column)
        for extreme, none in ((np.minimum, np.inf), (np.maximum, -np.inf)):
            filled = np.where(finite, column, none)
            at = np.flatnonzero(finite & (filled == extreme.reduceat(filled, starts)[bucket]))
            _, first = np.unique(bucket[at], return_index=True)
            kept[at[first]] = True
    return np.flatnonzero(kept)
