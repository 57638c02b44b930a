"""Routes: trials whose areas are watched on every tick, beside the same trials without."""

from __future__ import annotations

import statistics

import numpy as np

from codegen.batch.areas import Areas
from codegen.batch.batch import Batch
from harness.routes.problem import Asked, prepare
from harness.routes.score import OBSERVED, OVER
from tests.bench.sweeps import Row, core_seconds_of, million

ROUNDS = 5
TRIALS = 400  # of each candidate
LEAST = 15e6  # ticks/s on one core


def rows() -> tuple[list[Row], list[str]]:
    """The table's row, and the result if it falls short of what is expected."""
    problem = prepare(Asked("five_buildings", "home", "goal"))
    scorer = problem.scorer
    types = [scorer.trial_type(candidate) for candidate in problem.candidates]
    points = np.array([[each.flat.get(name, 0.0) for name in scorer.own] for each in types])
    point = np.repeat(np.arange(len(points), dtype=np.int32), TRIALS)
    seed = np.tile(np.arange(1, TRIALS + 1, dtype=np.int32), len(points))

    def rate(batch: Batch, areas: Areas | None) -> float:
        def run() -> int:
            results = batch.run(
                types[0].values, points, point, seed, types[0].ticks, changes=types[0].changes, areas=areas
            )
            return int(results.ticks.sum())

        ticks = run()  # which compiles
        return ticks / min(core_seconds_of(run) for _ in range(ROUNDS))

    plain = Batch(scorer.system, scorer.own, OBSERVED, ("controller.mode", OVER))
    pairs = [(rate(scorer.batch, scorer.areas), rate(plain, None)) for _ in range(2)]
    watched, unwatched = (statistics.median(rates) for rates in zip(*pairs, strict=True))
    what = (
        f"{len(point):,} trials of routes round five buildings, on one core, areas watched, against unwatched"
    )
    short = (
        []
        if watched >= LEAST
        else [f"watched trials do {million(watched)} on a core; expected {million(LEAST)}"]
    )
    return [(what, million(watched), million(unwatched), f"{watched / unwatched:.2f}")], short
