"""Success rates and times of the readings against those of an independent implementation, jointly.

The expected numbers are the tables of that implementation (numpy, another generator of random numbers), which
led to the readings (models/CHOICES.md). At each threshold h' it ran 40,000 trials, three-waypoint trials
of the four types of Figure 4.8 in equal parts. Success is in %, the mean time of successful trials in s.
"""

from __future__ import annotations

from collections.abc import Iterable
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
from harness.verification.published import FIELD as FIELD_COUNTS
from models.commands import Status
from models.readings import PUBLISHED
from models.system import SYSTEMS

TRIALS = 40_000
LONGEST = 7500  # ticks: 300 s
STEP = 0.04  # s
OPEN = "non-structured"
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
FIELD = {  # success alone, by the set of the dog: "" for the means
    ("", "three"): {37: 91.1, 49: 94.7},
    ("table_5_1", "two"): {23: 95.3, 30: 98.6, 37: 99.5},
    ("table_5_1", "three"): {37: 83.9, 49: 89.6},
}
Array = np.ndarray[Any, Any]


def outcomes(
    runner: Batch, trial: tuple[str, str], degrees: Iterable[int], seed: int, dog: str = ""
) -> tuple[Array, Array]:
    """Whether and when [s] each trial succeeded, (thresholds, trials) each; seeds count from `seed` on.

    Args:
        trial: reading and target.
    """
    reading, target = trial
    thresholds = np.radians([[float(h)] for h in degrees])
    parameters = {"canine": dog} if dog else {}
    names = TRIAL_TYPES[target]
    each = TRIALS // len(names)
    successes, times = [], []
    for name in names:
        scenario = replace(load(name), system="cts", reading=reading, parameters=parameters)
        values = plan(scenario, interfaces_of_system(SYSTEMS["cts"])).values
        seeds = np.arange(seed, seed + each * len(thresholds), dtype=np.int32)
        seed += len(seeds)
        points = np.repeat(np.arange(len(thresholds), dtype=np.int32), each)
        done = runner.run(values, thresholds, points, seeds, LONGEST)
        successes.append((done.values[:, 0] == Status.SUCCESS).reshape(len(thresholds), each))
        times.append((done.ticks * STEP).reshape(len(thresholds), each))
    return np.hstack(successes), np.hstack(times)


@pytest.fixture(scope="module")
def runner() -> Batch:
    return Batch(
        SYSTEMS["cts"],
        ["controller.moving_deviation"],
        ["controller.status"],
        ("controller.status", (Status.SUCCESS, Status.FAILED, Status.STOPPED)),
    )


@pytest.fixture(scope="module")
def deviations(runner: Batch) -> dict[str, Array]:
    """The differences of rates and mean times from the tables', in their standard deviations.

    These include the sampling of both sides and the rounding of the tables. No dog is in two trials, so the
    differences are independent.
    """
    seeds = {key: 1 + i * 10 * TRIALS for i, key in enumerate(TABLES)}
    with ThreadPoolExecutor(2) as pool:
        results = pool.map(lambda key: outcomes(runner, key, TABLES[key], seeds[key]), TABLES)
    z: dict[str, list[float]] = {"rate": [], "time": []}
    for (reading, target), (success, time) in zip(TABLES, results, strict=True):
        rows = zip(TABLES[reading, target].items(), success, time, strict=True)
        for (h, (percent, printed)), succeeded, seconds in rows:
            published, rate = percent / 100, succeeded.mean()
            z["rate"].append(deviation(rate, published))
            ours = seconds[succeeded]
            digit = 0.1 if "." in printed else 1.0
            variance = ours.var() * (1 / len(ours) + 1 / (TRIALS * published)) + digit**2 / 12
            z["time"].append((ours.mean() - float(printed)) / np.sqrt(variance))
            print(
                f"{reading} {target} h' {h:2d}: {100 * rate:6.2f} % (published {percent}), z "
                f"{z['rate'][-1]:5.2f}; {ours.mean():7.3f} s ({printed}), z {z['time'][-1]:5.2f}"
            )
    return {what: np.array(values) for what, values in z.items()}


def deviation(rate: float, published: float) -> float:
    """The difference of a rate from one to 0.1 %, in its standard deviations."""
    common = (rate + published) / 2
    variance = 2 * common * (1 - common) / TRIALS + 0.001**2 / 12
    return float((rate - published) / np.sqrt(variance))


def test_the_tables_are_of_all_published_readings() -> None:
    assert {reading for reading, _ in TABLES} == {*PUBLISHED} - {"field"}
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


def test_the_field_reading_agrees_jointly_with_the_dog_of_means_and_the_drawn_one(runner: Batch) -> None:
    # given trials that are cut at 300 s, with dogs of means, and with drawn speeds and a search
    z, inside = [], 0
    for i, ((dog, target), rates) in enumerate(FIELD.items()):
        success, _ = outcomes(runner, ("field", target), rates, 1 + (40 + i * 10) * TRIALS, dog)
        # when their rates are held against those of the other implementation
        for (h, percent), succeeded in zip(rates.items(), success, strict=True):
            z.append(deviation(succeeded.mean(), percent / 100))
            print(
                f"{dog or 'means'} {target} h' {h}: {100 * succeeded.mean():.2f} % ({percent}), z {z[-1]:.2f}"
            )
            # then none is off by a point
            assert abs(100 * succeeded.mean() - percent) < 1
            # and with drawn speeds the field's counts in the open have it in their intervals
            for count in FIELD_COUNTS:
                if dog and (count.waypoints, count.threshold, count.environment) == (target, h, OPEN):
                    assert count.interval[0] < succeeded.mean() < count.interval[1]
                    inside += 1
    # and the differences are those of chance
    assert len(z) == 7
    assert inside == 4
    assert chi2.sf(float(np.square(z).sum()), len(z)) > 0.001
    assert max(map(abs, z)) < 4
