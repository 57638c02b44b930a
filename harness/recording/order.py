"""Puts records in the order of their clocks: what was repeated or came late is dropped and counted."""

from __future__ import annotations

from bisect import bisect_left, bisect_right

import numpy as np
import numpy.typing as npt

Mask = npt.NDArray[np.bool_]


def longest_rise(clock: npt.NDArray[np.float64], *, strict: bool) -> Mask:
    """The most records (n,) whose clock rises from each to the next, as a mask.

    So a record that came late is dropped and not those before it, and of a clock that was set the shorter
    part. With `strict` a clock that stands counts as late, too.
    """
    steps = np.diff(clock)
    if bool(np.all(steps > 0) if strict else np.all(steps >= 0)):
        return np.ones(len(clock), dtype=np.bool_)
    place = bisect_left if strict else bisect_right
    ends: list[float] = []  # the least clock with which a rise of each length can end
    last: list[int] = []  # the record with that clock
    before = np.full(len(clock), -1)
    for i, now in enumerate(clock.tolist()):
        length = place(ends, now)
        before[i] = last[length - 1] if length else -1
        ends[length : length + 1], last[length : length + 1] = [now], [i]
    rising = np.zeros(len(clock), dtype=np.bool_)
    i = last[-1]
    while i >= 0:
        rising[i] = True
        i = int(before[i])
    return rising


def late_run(clock: npt.NDArray[np.float64], rising: Mask) -> tuple[int, int] | None:
    """The first and the last record of the longest run that `longest_rise` left out between two of its own.

    None if it left out none there.
    """
    kept = np.flatnonzero(rising)
    gaps = np.diff(kept)
    if not len(gaps) or gaps.max() == 1:
        return None
    i = int(gaps.argmax())
    return int(kept[i]) + 1, int(kept[i + 1]) - 1


def repeats(rows: npt.NDArray[np.float64]) -> Mask:
    """Which rows (n, m), a clock first, are the same as an earlier one."""
    if (np.diff(rows[:, 0]) > 0).all():
        return np.zeros(len(rows), dtype=np.bool_)
    _, first = np.unique(rows, axis=0, return_index=True)
    again = np.ones(len(rows), dtype=np.bool_)
    again[first] = False
    return again
