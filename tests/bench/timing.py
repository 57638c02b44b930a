"""How long work takes, and how many times as long as other work: in turns, because machines are noisy."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

ROUNDS = 15


def paired(
    first: Callable[[], float], second: Callable[[], float], rounds: int = ROUNDS
) -> tuple[float, float, float]:
    """Median seconds of both, run in turns, and the median of their ratios second / first."""
    pairs = [(first(), second()) for _ in range(rounds)]
    a, b = zip(*pairs, strict=True)
    return statistics.median(a), statistics.median(b), statistics.median(y / x for x, y in pairs)


def timed(work: Callable[[], object]) -> float:
    """Seconds that it takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
