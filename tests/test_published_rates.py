"""Success rates and times of both readings against those of an independent implementation, jointly.

The expected numbers are the tables of that implementation (numpy, another generator of random numbers), which
led to the two readings (models/CHOICES.md). At each threshold h' it ran 40,000 trials, three-waypoint trials
of the four types of Figure 4.8 in equal parts. Success is in %, the mean time of successful trials in s.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from codegen.batch.batch import Batch
from harness.sweep.trials import TRIAL_TYPES
from harness.trial.plan import interfaces_of_system, plan
from harness.trial.scenario import load
from models.commands import Status
from models.readings import PUBLISHED
from models.system import SYSTEMS

TRIALS = 40_000
LONGEST = 7500  # ticks: 300 s
STEP = 0.04  # s
TABLES = {
    ("calibrated", "two"): {
        15: (86.8, "15.7"), 17: (92.8, "15.4"), 20: (97.4, "15.1"), 23: (98.9, "14.7"), 26: (99.5, "14.4"),
        30: (99.7, "14.3"), 37: (99.9, "13.9"), 49: (99.8, "13.9"), 90: (99.9, "15.0"),
    },
    ("calibrated", "three"): {
        15: (24.3, "35.3"), 20: (31.0, "35.3"), 25: (38.3, "35.6"), 30: (46.0, "36.4"), 37: (55.8, "36.6"),
        40: (59.1, "37.0"), 45: (64.2, "37.3"), 49: (66.4, "37.6"), 55: (69.2, "37.9"), 65: (72.9, "38.7"),
    },
    ("literal", "two"): {
        15: (39.8, "22.4"), 17: (42.5, "18.5"), 20: (46.4, "11.2"), 23: (57.4, "11.5"), 26: (67.8, "11.8"),
        30: (78.5, "12.1"), 37: (89.0, "12.4"), 49: (92.9, "12.6"), 90: (92.5, "13.5"),
    },
    ("literal", "three"): {
        15: (8.7, "115"), 20: (3.4, "29.8"), 25: (8.6, "30.7"), 30: (15.0, "31.6"), 37: (24.1, "32.2"),
        40: (26.9, "32.3"), 45: (30.7, "32.8"), 49: (33.1, "33.1"), 55: (35.7, "33.5"), 65: (37.1, "34.3"),
    },
}  # fmt: skip
Array = np.ndarray[Any, Any]


def outcomes(runner: Batch, reading: str, target: str, seed: int) -> tuple[Array, Array]:
    """Whether and when [s] each trial succeeded, (thresholds, trials) each; seeds count from `seed` on."""
    thresholds = np.radians([[float(h)] for h in TABLES[reading, target]])
    names = TRIAL_TYPES[target]
    each = TRIALS // len(names)
    successes, times = [], []
    for name in names:
        scenario = replace(load(name), system="cts", reading=reading)
        values = plan(scenario, interfaces_of_system(SYSTEMS["cts"])).values
        seeds = np.arange(seed, seed + each * len(thresholds), dtype=np.int32)
        seed += len(seeds)
        points = np.repeat(np.arange(len(thresholds), dtype=np.int32), each)
        done = runner.run(values, thresholds, points, seeds, LONGEST)
        successes.append((done.values[:, 0] == Status.SUCCESS).reshape(len(thresholds), each))
        times.append((done.ticks * STEP).reshape(len(thresholds), each))
    return np.hstack(successes), np.hstack(times)


@pytest.fixture(scope="module")
def deviations() -> dict[str, Array]:
    """The differences of rates and mean times from the tables', in their standard deviations.

    These include the sampling of both sides and the rounding of the tables. No dog is in two trials, so the
    differences are independent.
    """
    runner = Batch(
        SYSTEMS["cts"],
        ["controller.moving_deviation"],
        ["controller.status"],
        ("controller.status", (Status.SUCCESS, Status.FAILED, Status.STOPPED)),
    )
    seeds = {key: 1 + i * 10 * TRIALS for i, key in enumerate(TABLES)}
    with ThreadPoolExecutor(2) as pool:
        results = pool.map(lambda key: outcomes(runner, key[0], key[1], seeds[key]), TABLES)
    z: dict[str, list[float]] = {"rate": [], "time": []}
    for (reading, target), (success, time) in zip(TABLES, results, strict=True):
        rows = zip(TABLES[reading, target].items(), success, time, strict=True)
        for (h, (percent, printed)), succeeded, seconds in rows:
            published, rate = percent / 100, succeeded.mean()
            common = (rate + published) / 2
            variance = 2 * common * (1 - common) / TRIALS + 0.001**2 / 12
            z["rate"].append((rate - published) / np.sqrt(variance))
            ours = seconds[succeeded]
            digit = 0.1 if "." in printed else 1.0
            variance = ours.var() * (1 / len(ours) + 1 / (TRIALS * published)) + digit**2 / 12
            z["time"].append((ours.mean() - float(printed)) / np.sqrt(variance))
            print(
                f"{reading} {target} h' {h:2d}: {100 * rate:6.2f} % (published {percent}), z "
                f"{z['rate'][-1]:5.2f}; {ours.mean():7.3f} s ({printed}), z {z['time'][-1]:5.2f}"
            )
    return {what: np.array(values) for what, values in z.items()}


def test_the_tables_are_of_both_published_readings() -> None:
    assert {reading for reading, _ in TABLES} == set(PUBLISHED)
    assert sum(map(len, TABLES.values())) == 38


@pytest.mark.parametrize("what", ["rate", "time"])
def test_all_numbers_agree_jointly(deviations: dict[str, Array], what: str) -> None:
    z = deviations[what]
    total = float(z @ z)
    p = float(chi2.sf(total, len(z)))
    print(f"{what}: sum of z^2 {total:.1f} of {len(z)}, p {p:.3f}, largest {abs(z).max():.2f}")
    assert len(z) == 38
    assert p > 0.001
    assert abs(z).max() < 4
    # and the deviations scatter to both sides
    assert abs(z.sum()) / np.sqrt(len(z)) < 4
