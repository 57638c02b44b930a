"""What a sweep recommends, on curves whose best points are known."""

from __future__ import annotations

import re
from decimal import Decimal
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest, ttest_rel

from harness.cosim.fmu import Fault
from harness.sweep.chunks import FmuFailure, Job, Outcomes, TrialType
from harness.sweep.recommend import LEAST, best_for_success, best_for_time, pareto, recommend
from harness.sweep.table import Point, table_of

Numbers = np.ndarray[Any, Any]


def outcomes(ticks: Numbers) -> Outcomes:
    """Points of one parameter, whose trials succeeded on these ticks (0: failed)."""
    points, trials = ticks.shape
    trial_type = TrialType("straight", {}, (), 7500)
    job = Job("cts", ("x",), tuple((float(p),) for p in range(points)), (trial_type,), trials, 1)
    done = Outcomes(job)
    done.ticks[:] = ticks
    return done


def recommended(ticks: Numbers, *values: list[int]) -> dict[str, Any]:
    grids = [[Decimal(v) for v in part] for part in values] or [[Decimal(p) for p in range(len(ticks))]]
    written = list(product(*grids))
    axes = [(name, "deg", grid) for name, grid in zip("xy", grids, strict=False)]
    return recommend(axes, table_of(written, outcomes(ticks)), ticks)


def simulated(rates: Numbers, times: Numbers, trials: int = 2000, seed: int = 0) -> Numbers:
    """Trials with common random numbers: one that succeeds at a rate succeeds at higher ones, mostly."""
    rng = np.random.default_rng(seed)
    luck = 0.9 * rng.random(trials) + 0.1 * rng.random((len(rates), trials))
    lengths = (
        times[:, None] + 40 * rng.standard_normal(trials) + 10 * rng.standard_normal((len(rates), trials))
    )
    quantile = np.sort(0.9 * rng.random(200_000) + 0.1 * rng.random(200_000))
    limit = np.quantile(quantile, rates)
    return np.where(luck < limit[:, None], np.maximum(lengths, 1), 0).astype(np.uint16)


X = np.arange(21.0)
LEVEL = np.full(21, 500.0)


def test_a_rate_that_rises_to_the_end_has_no_optimum_inside() -> None:
    advice = recommended(simulated(0.3 + 0.025 * X, LEVEL))["success"]
    assert advice["best"]["x"] == 20
    assert advice["range"]["x"][1] == 20
    assert advice["range"]["x"][0] >= 18  # 5 % less would show
    assert (advice["interior_optimum"], advice["flat"], advice["range_ends"]) == (False, False, {"x": "end"})
    assert "ends: no optimum inside is shown, larger values may do better" in advice["text"]


def test_a_rate_that_falls_from_the_start_has_no_optimum_inside() -> None:
    advice = recommended(simulated(0.8 - 0.025 * X, LEVEL))["success"]
    assert advice["range"]["x"][0] == advice["best"]["x"] == 0
    assert (advice["interior_optimum"], advice["range_ends"]) == (False, {"x": "start"})
    assert "begins: no optimum inside is shown, smaller values may do better" in advice["text"]


def test_a_hill_has_its_optimum_inside() -> None:
    advice = recommended(simulated(0.9 - 0.004 * (X - 8) ** 2, LEVEL))["success"]
    first, last = advice["range"]["x"]
    assert first <= 8 <= last
    assert (first, last) == pytest.approx((8, 8), abs=3)
    assert (advice["interior_optimum"], advice["range_ends"]) == (True, {"x": "inside"})
    assert "no optimum" not in advice["text"]


def test_a_flat_curve_is_called_flat_however_noisy_it_is() -> None:
    for seed in range(5):
        advice = recommended(simulated(np.full(21, 0.6), LEVEL, trials=300, seed=seed))
        for key in ("success", "time"):
            assert advice[key]["flat"]
            assert not advice[key]["interior_optimum"]
            assert "flat, no optimum" in advice[key]["text"]
            assert len(advice[key]["points"]) == 21


def test_at_least_19_of_20_flat_sweeps_are_called_flat() -> None:
    called = np.zeros(2)
    for seed in range(100):
        ticks = simulated(np.full(12, 0.6), np.full(12, 500.0), trials=400, seed=seed)
        in_time = best_for_time(ticks)
        assert in_time is not None
        called += best_for_success(ticks).named.all(), in_time.named.all()
    assert (called >= 95).all()


def test_all_points_of_a_plateau_are_named() -> None:
    rates = np.minimum(0.99, 0.5 + 0.07 * X)  # from 7 on it is 0.99
    advice = recommended(simulated(rates, LEVEL))["success"]
    assert advice["range"]["x"] == [7, 20]
    assert advice["range_ends"] == {"x": "end"}


def test_time_has_an_optimum_of_its_own_and_both_takes_the_fastest_of_the_best_for_success() -> None:
    # given success from 8 on, and time shortest at 5
    rates = np.where(X < 8, 0.5, 0.9)
    advice = recommended(simulated(rates, 400 + 4 * (X - 5) ** 2))
    assert advice["success"]["range"]["x"] == [8, 20]
    assert advice["time"]["range"]["x"] == pytest.approx([5, 5], abs=1)
    assert advice["time"]["interior_optimum"]
    assert advice["both"]["best"]["x"] == 8
    assert advice["both"]["range"]["x"][1] <= 9


def test_the_truly_best_point_is_named_in_at_least_95_percent_of_sweeps() -> None:
    rates = 0.7 - 0.001 * (np.arange(9) - 4.0) ** 2
    times = 500 + 0.5 * (np.arange(9) - 4.0) ** 2
    named = np.zeros(2)
    for seed in range(100):
        ticks = simulated(rates, times, trials=400, seed=seed)
        in_time = best_for_time(ticks)
        assert in_time is not None
        named += best_for_success(ticks).named[4], in_time.named[4]
    assert (named >= 95).all()


def test_success_is_judged_by_mcnemars_exact_test() -> None:
    # given 9 trials that only the first point wins, 1 that only the second wins: p = 11 / 1024
    ticks = np.zeros((2, 20), dtype=np.uint16)
    ticks[:, 10:] = 100
    ticks[0, :9], ticks[1, 9] = 100, 100
    assert binomtest(9, 10, alternative="greater").pvalue == pytest.approx(11 / 1024)
    assert best_for_success(ticks).named.tolist() == [True, False]
    # when three points are compared, each of six pairs has a sixth of 5 %: 0.0083, which is less
    for others, expected in ((0, False), (1, True)):
        more = np.vstack([ticks, *[np.zeros(20, dtype=np.uint16)] * others])
        assert best_for_success(more).named[1] == expected


def test_two_trials_show_no_difference() -> None:
    ticks = np.array([[100, 100], [0, 0]], dtype=np.uint16)
    assert best_for_success(ticks).named.all()
    assert best_for_time(ticks) is None


def test_time_is_judged_by_the_paired_t_test_where_all_succeed() -> None:
    rng = np.random.default_rng(5)
    common = 500 + 100 * rng.standard_normal(60)
    for shift in (0.0, 1.0, 2.0, 4.0, 8.0):
        ticks = np.array([common, common + shift + 8 * rng.standard_normal(60)]).astype(np.uint16)
        slower, faster = sorted(ticks.astype(float), key=np.mean, reverse=True)
        finding = best_for_time(ticks)
        assert finding is not None
        p = ttest_rel(slower, faster, alternative="greater").pvalue
        assert finding.named.all() == (p >= 0.025)  # either might have been the slower one


def test_times_are_compared_sharply_though_half_of_the_trials_fail() -> None:
    # given half of the trials failing at either point, others at each; means 20 apart, deviation 20
    rng = np.random.default_rng(1)
    ticks = np.rint(np.array([[500], [520]]) + 20 * rng.standard_normal((2, 1000))).astype(np.uint16)
    ticks[rng.random((2, 1000)) < 0.5] = 0
    # then the difference is 16 times its error, 20 sqrt(2 / 500)
    finding = best_for_time(ticks)
    assert finding is not None
    assert finding.named.tolist() == [True, False]


def test_a_few_lucky_trials_are_not_the_fastest() -> None:
    # given a point where 29 of 1000 succeed, in no time, and two others
    ticks = np.full((3, 1000), 500, dtype=np.uint16)
    ticks[0] = 0
    ticks[0, : LEAST - 1] = 10
    ticks[1] = 400
    advice = recommended(ticks)["time"]
    assert advice["best"]["x"] == 1
    assert advice["points"] == [1]
    # then what lies beyond the best is not known: no optimum inside
    assert advice["range_ends"] == {"x": "start"}
    assert "too few successes to judge 0" in advice["text"]
    assert (
        "x 1 deg (best at 1: 16.00 s); below the stretch nothing could be judged: no optimum"
        in advice["text"]
    )
    assert "begins" not in advice["text"]


def test_a_stretch_between_points_that_cannot_be_judged_does_not_span_the_range() -> None:
    # given ten points of which 4 and 5 alone have successes enough, and are alike
    ticks = np.zeros((10, 1000), dtype=np.uint16)
    ticks[:, : LEAST - 1] = 10
    ticks[4:6] = 500 + np.arange(1000) % 7
    advice = recommended(ticks)["time"]
    assert (advice["points"], advice["range_ends"]) == ([4, 5], {"x": "both"})
    assert "; below and above the stretch nothing could be judged: no optimum inside" in advice["text"]
    assert "spans" not in advice["text"]
    # when nothing below is judged, and it goes on to the end
    ticks[4:] = ticks[4]
    advice = recommended(ticks)["time"]
    assert "; it goes on to where the range ends: no optimum inside is shown, larger" in advice["text"]
    assert "; below the stretch nothing could be judged: no optimum" in advice["text"]


def test_a_sweep_without_a_success_says_so() -> None:
    advice = recommended(np.zeros((3, 50), dtype=np.uint16))
    assert advice["success"]["text"] == "best success rate: no trial succeeded at any point"
    assert "too few successes" in advice["time"]["text"]
    assert advice["pareto"] == {
        "text": "Pareto front of success rate and time: empty, no trial succeeded",
        "points": [],
        "unjudged": [],
    }
    # and no point counts as the best
    assert set(advice["success"]) == {"text"}


def with_failures(ticks: Numbers, failures: dict[int, list[int]], ran: list[int]) -> dict[str, Any]:
    """A recommendation where FMUs ended these trials by point, after which points of fewer trials stopped."""
    done = outcomes(ticks)
    fault = Fault("crash", "plant", "dog.fmu", "fmi2DoStep", 1.0)
    done.fmu_failures = {
        point: [FmuFailure(trial, fault, "dog.fmu crashed") for trial in numbers]
        for point, numbers in failures.items()
    }
    done.ran = ran
    grid = [Decimal(point) for point in range(len(ticks))]
    return recommend([("x", "deg", grid)], table_of([(value,) for value in grid], done), ticks)


def test_trials_that_never_ran_are_no_failures_of_the_dog() -> None:
    # given a point that was given up after 25 trials, of which the dog won all that no FMU ended
    ticks = np.full((3, 1000), 500, np.uint16)
    ticks[1, 20:] = 0
    # when
    advice = with_failures(ticks, {1: [20, 21, 22, 23, 24]}, [1000, 25, 1000])
    # then nothing is said against it
    for key in ("success", "time", "both", "pareto"):
        assert advice[key]["unjudged"] == [1]
        assert "; not judged, since FMUs failed: 1" in advice[key]["text"]
    assert advice["success"]["points"] == [0, 2]
    # and without any point that is judged nothing is recommended
    advice = with_failures(ticks[1:2], {0: [20, 21, 22, 23, 24]}, [25])
    assert advice["success"] == {
        "text": "best success rate: no trial succeeded; not judged, since FMUs failed: 0"
    }


def test_a_trial_that_an_fmu_ended_is_no_failure_of_the_dog() -> None:
    # given a dog that wins all, of which an FMU ended 20 trials at one point
    ticks = np.full((2, 1000), 500, np.uint16)
    ticks[1, 30:50] = 0
    # when
    advice = with_failures(ticks, {1: list(range(30, 50))}, [1000, 1000])
    # then no point is better
    assert advice["success"]["flat"]
    assert advice["success"]["text"].endswith("; without the trials that FMUs ended at 1")
    assert [point["success_rate"] for point in advice["pareto"]["points"]] == [1.0, 1.0]
    # but the same lost by the dog show that it is
    lost = with_failures(ticks, {}, [1000, 1000])
    assert lost["success"]["points"] == [0]
    assert "FMU" not in lost["success"]["text"]


def test_a_sweep_of_one_point_compares_nothing() -> None:
    advice = recommended(np.full((1, 50), 300, dtype=np.uint16))["success"]
    assert advice["text"] == "best success rate: one point, nothing to compare (x 0 deg: 100.0 %)"


def test_a_sweep_over_two_parameters_has_a_region_around_its_best_point() -> None:
    # given a hill at (3, 2) of a 7 x 5 grid, and as good a place apart from it at (0, 0)
    i, j = np.meshgrid(np.arange(7.0), np.arange(5.0), indexing="ij")
    rates = 0.9 - 0.1 * np.hypot(i - 3, j - 2)
    rates[0, 0] = 0.9
    advice = recommended(
        simulated(rates.ravel(), np.full(35, 500.0), seed=3), list(range(10, 80, 10)), list(range(5))
    )["success"]
    assert sorted(advice["points"]) == [[10, 0], [40, 2]]
    assert advice["range"] in ({"x": [40, 40], "y": [2, 2]}, {"x": [10, 10], "y": [0, 0]})
    assert "; besides (" in advice["text"]


def points_of(pairs: list[tuple[int, int]]) -> list[Point]:
    """Points by successes (of 60) and mean ticks."""
    return [Point((Decimal(k),), 60, n, n * t, n * t * t, 0, 0, {}, {}) for k, (n, t) in enumerate(pairs)]


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.integers(26, 34), st.integers(1, 5)), min_size=1, max_size=12))
def test_no_point_beats_one_of_the_pareto_front(pairs: list[tuple[int, int]]) -> None:
    def beats(a: tuple[int, int], b: tuple[int, int]) -> bool:
        return a[0] >= b[0] and a[1] <= b[1] and a != b

    judged = [k for k, pair in enumerate(pairs) if pair[0] >= 30]
    expected = [k for k in judged if not any(beats(pairs[other], pairs[k]) for other in judged)]
    assert pareto(points_of(pairs)) == expected


def test_a_point_with_too_few_successes_to_judge_is_not_on_the_pareto_front() -> None:
    # given 29 fast successes, 30 slower ones, and 60 that are slower still
    ticks = np.zeros((3, 60), dtype=np.uint16)
    ticks[0, :29], ticks[1, :30], ticks[2] = 100, 200, 300
    advice = recommended(ticks)
    # then the first is on no list of the best, and both text and data say why
    assert [point["x"] for point in advice["pareto"]["points"]] == [1, 2]
    assert (advice["pareto"]["unjudged"], advice["time"]["unjudged"]) == ([0], [0])
    assert advice["pareto"]["text"] == (
        "Pareto front of success rate and time, as measured: 1 (50.0 %, 8.00 s), 2 (100.0 %, 12.00 s); "
        "too few successes to judge 0"
    )
    # and with such points alone there is no front
    assert recommended(ticks[:1])["pareto"] == {
        "text": "Pareto front of success rate and time: empty, no point has 30 successes",
        "points": [],
        "unjudged": [0],
    }


def test_a_rate_below_100_percent_does_not_read_100_percent() -> None:
    ticks = np.full((2, 4000), 100, dtype=np.uint16)
    ticks[0, 0], ticks[1, :-1] = 0, 0
    advice = recommended(ticks)
    assert advice["success"]["best"]["success_rate"] == 3999 / 4000
    assert "(best at 0: > 99.9 %)" in advice["success"]["text"]


CASES = st.tuples(st.integers(1, 6), st.sampled_from([40, 120]), st.integers(0, 10_000))


@settings(max_examples=150, deadline=None)
@given(CASES)
def test_a_recommendations_text_says_what_its_data_say(case: tuple[int, int, int]) -> None:
    # given any sweep, some of whose points have few successes or none
    points, trials, seed = case
    rng = np.random.default_rng(seed)
    rates = rng.choice([0.0, 0.2, 0.5, 0.9, 1.0], points)
    ticks = np.where(
        rng.random((points, trials)) < rates[:, None], rng.integers(100, 900, (points, trials)), 0
    )
    # when
    advice = recommended(ticks.astype(np.uint16))
    # then each text names the points of its data, with their values
    for key in ("success", "time", "both"):
        data, text = advice[key], advice[key]["text"]
        if "best" not in data:
            assert not re.search(r"best (measured )?at|besides|\d %", text), text
            continue
        value = data["best"]["mean_time_s"] if key != "success" else data["best"]["success_rate"]
        measured = f"{value:.2f} s" if key != "success" else f"{100 * value:.1f} %"
        assert f": {measured})" in text
        place = data["best"]["x"]
        first, last = data["range"]["x"]
        assert (f"x {first} to {last} deg" if first != last else f"x {first} deg") in text
        assert f"at {place}: " in text or points == 1
        connected = [x for x in data["points"] if first <= x <= last]
        assert named(text, "besides") == [x for x in data["points"] if x not in connected]
        assert named(text, "too few successes to judge") == data["unjudged"]
        assert ("flat" in text) == (data["flat"] and points > 1)
        if data["interior_optimum"]:
            assert "no optimum inside is shown" not in text
    front = advice["pareto"]
    shown = re.findall(r"[ ,:](\d+) \((\S+) %, (\S+) s\)", front["text"])
    assert shown == [
        (str(p["x"]), f"{100 * p['success_rate']:.1f}", f"{p['mean_time_s']:.2f}") for p in front["points"]
    ]
    assert named(front["text"], "too few successes to judge") == (front["unjudged"] if shown else [])
    # and nobody is among the best of a comparison that left it out
    assert not {p["x"] for p in front["points"]} & set(front["unjudged"])


def named(text: str, what: str) -> list[int]:
    """The points that a text lists after some words."""
    _, _, rest = text.partition(f"; {what} ")
    return [int(x) for x in rest.partition(";")[0].split(", ") if x]
