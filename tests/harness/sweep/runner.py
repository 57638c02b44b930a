"""Batch runners that simulate nothing: the result of each trial is known beforehand."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from codegen.batch.batch import Results
from harness.sweep import chunks
from models.commands import Status

Trial = tuple[Status, int, int, Mapping[int, int]]  # status, tick, directional commands, anomaly -> ticks


class Runner:
    """Calls `outcome(h' in deg, seed, own)` for each trial, and keeps the seeds that it ran.

    `own` are the start values that differ between the types of trials, by `component.name`.
    """

    def __init__(self, outcome: Callable[[int, int, Any], Trial], pause: float = 0.0) -> None:
        self.outcome, self.pause = outcome, pause
        self.seeds: list[int] = []

    def run(  # noqa: PLR0917 - as the batch runner's
        self, by_type: tuple[str, ...], values: Any, points: Any, point: Any, seed: Any, ticks: int,
        changes: Any = (), stalls: Any = (),
    ) -> Results:  # fmt: skip
        time.sleep(self.pause)
        self.seeds += seed.tolist()
        last, observed = np.zeros(len(seed), np.int32), np.zeros((len(seed), len(chunks.OBSERVED)))
        for k, (row, number) in enumerate(zip(point, seed, strict=True)):
            own = dict(zip(by_type, points[row, points.shape[1] - len(by_type) :], strict=True))
            status, tick, commands, anomalies = self.outcome(
                round(np.degrees(points[row, 0])), int(number), own
            )
            last[k] = min(tick, ticks)
            observed[k, :2] = status, commands
            for anomaly, count in anomalies.items():
                observed[k, 1 + anomaly] = count
        return Results(last, observed)


def install(patch: pytest.MonkeyPatch, runner: Runner) -> Runner:
    """Make sweeps in this process use this runner."""
    patch.setattr(chunks, "batch_of", lambda job: SimpleNamespace(run=partial(runner.run, job.by_type)))
    return runner


def dog(threshold: int, seed: int, own: object) -> Trial:
    """Results that depend on threshold and seed: success, time, commands, anomalies, a few timeouts."""
    mixed = seed * 2654435761 % 997
    if mixed % 50 == 0:
        return Status.RUNNING, 10**6, 1, {1: 2}
    status = Status.SUCCESS if mixed % 100 < 30 + threshold else Status.FAILED
    return (
        status,
        200 + mixed % 83 + (threshold - 30) ** 2,
        mixed % 4,
        {2: mixed % 3, 5: int(status == Status.FAILED)},
    )
