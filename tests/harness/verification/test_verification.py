"""The verification page: its numbers by other ways, its trial and pictures, and the committed page."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from scipy.stats import beta, binom

from harness.log.channel import Array
from harness.sweep import sweep
from harness.sweep.chunks import Outcomes, pool_at, run_all
from harness.sweep.recommend import Ticks
from harness.sweep.table import Point, table_of
from harness.trial.plots import equal_stretches
from harness.trial.scenario import load
from harness.verification.page import PAGE, RESULTS, write
from harness.verification.page import page as page_of
from harness.verification.published import FIELD, Field, joint_p_value, log_likelihood
from harness.verification.runs import Example, Size, find_example, simulate, time_difference
from harness.verification.tables import time_table
from models.commands import Command

SMALL = Size(curve=40, rate=400, ranked=100, long=40, seeds=60)


@pytest.fixture(scope="module")
def example() -> Example:
    return find_example(SMALL.seeds)


@pytest.fixture(scope="module")
def page(example: Example) -> str:
    return page_of(SMALL, example)


def row(page: str, *first: str) -> list[str]:
    """The cells of the only line whose first cells are these."""
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line[:1] == "|"]
    (match,) = [cells for cells in rows if tuple(cells[: len(first)]) == first]
    return match


# the dissertation's numbers


def test_field_counts_are_those_of_table_4_4() -> None:
    # given the rates and numbers that the table prints
    rates = {
        ("two", 23): 94.3,
        ("two", 30): 97.1,
        ("two", 37): 100.0,
        ("two", 49): 100.0,
        ("three", 37): 77.1,
        ("three", 49): 65.4,
    }
    numbers = {
        ("two", "non-structured"): 105,
        ("two", "structured"): 24,
        ("three", "non-structured"): 35,
        ("three", "structured"): 52,
    }
    # then each count has its rate, the composites are the table's, and so is n
    for field in FIELD:
        assert round(100 * field.successes / field.trials, 1) == rates[field.waypoints, field.threshold]
    for (waypoints, environment), n in numbers.items():
        mine = [f for f in FIELD if (f.waypoints, f.environment) == (waypoints, environment)]
        assert sum(f.trials for f in mine) == n
    for together, composite in ((("two",), 97.7), (("three",), 70.1), (("two", "three"), 86.6)):
        mine = [f for f in FIELD if f.waypoints in together]
        assert round(100 * sum(f.successes for f in mine) / sum(f.trials for f in mine), 1) == composite


@pytest.mark.parametrize(("successes", "trials"), [(34, 52), (33, 35), (35, 35)])
def test_interval_is_clopper_and_pearsons_and_p_is_exact(successes: int, trials: int) -> None:
    field = Field("two", 23, successes, trials, "")
    low, high = field.interval
    assert low == pytest.approx(beta.ppf(0.025, successes, trials - successes + 1))
    assert high == pytest.approx(
        1 if successes == trials else beta.ppf(0.975, successes + 1, trials - successes)
    )
    for rate in (0.3, 0.66, 0.989):
        likelihood = [math.comb(trials, k) * rate**k * (1 - rate) ** (trials - k) for k in range(trials + 1)]
        as_unlikely = sum(p for p in likelihood if p <= likelihood[successes] * (1 + 1e-9))
        assert field.p_value(rate) == pytest.approx(as_unlikely)


def test_likelihoods_are_those_of_the_counts() -> None:
    # given two counts, small enough to list all that could have been
    fields, rates = [Field("two", 23, 2, 3, ""), Field("two", 30, 1, 2, "")], [0.9, 0.8]
    chances = [
        [math.comb(n, k) * r**k * (1 - r) ** (n - k) for k in range(n + 1)] for n, r in ((3, 0.9), (2, 0.8))
    ]
    observed, best = chances[0][2] * chances[1][1], (3 * (2 / 3) ** 2 / 3) * (2 * 0.5**2)
    # then
    assert log_likelihood(fields, rates) == pytest.approx(math.log(observed / best))
    unlikely = sum(p * q for p in chances[0] for q in chances[1] if p * q <= observed * (1 + 1e-9))
    assert joint_p_value(fields, rates) == pytest.approx(unlikely, abs=0.005)


# the trials


def swept(planned: sweep.Sweep) -> Outcomes:
    """The results of `canine sweep`, in chunks that end anywhere."""
    outcomes = Outcomes(planned.job)
    with pool_at(None, planned.job) as pool:
        run_all(outcomes, pool, keep=lambda chunk: None, size=150)
    return outcomes


def test_simulate_runs_the_trials_of_canine_sweep() -> None:
    # given the four types of trials at two thresholds, as `canine sweep` runs them
    planned = sweep.plan_sweep("three", thresholds="37:49:12", trials=202, reading="literal")
    outcomes = swept(planned)
    # then they end on the same ticks, and count the same
    simulated = simulate("three", "37:49:12", 202, "literal")
    assert simulated.ticks.tolist() == outcomes.ticks.tolist()
    assert simulated.table == table_of(planned.points, outcomes)
    assert 0 < simulated.at(49).successes < 202


def test_the_time_difference_of_an_equal_delay_has_no_error() -> None:
    ticks = np.array([100, 0, 140, 180], dtype=np.uint16)
    later, error = time_difference(np.where(ticks > 0, ticks + 25, 0).astype(np.uint16), ticks)
    assert later == pytest.approx(1.0)
    assert error == pytest.approx(0.0)


def test_time_difference_has_the_error_that_the_jackknife_finds() -> None:
    # given dogs with and without a late response, not all of whose trials succeed
    late = simulate("two", "23:23", 2000, settings=("canine.response_delay=0.2",)).ticks[0]
    ticks = simulate("two", "23:23", 2000).ticks[0]
    assert np.count_nonzero(late == 0) > 0
    # when one trial after the other is left out
    later, error = time_difference(late, ticks)

    def means_without(row: Ticks) -> Array:
        seconds = 0.04 * row.astype(np.float64)
        means: Array = (seconds.sum() - seconds) / (np.count_nonzero(row) - (row > 0))
        return means

    without = means_without(late) - means_without(ticks)
    n = len(without)
    # then
    assert later == pytest.approx(0.04 * (late[late > 0].mean() - ticks[ticks > 0].mean()))
    assert error == pytest.approx(math.sqrt((n - 1) / n * np.sum((without - without.mean()) ** 2)), rel=5e-3)


# the trial of Figure 5.2


def test_a_right_command_is_ignored_for_3_s_and_obeyed_after_1_s_of_silence(example: Example) -> None:
    log = example.log
    # when the dog is told to turn right, for DELTHRESH2 and after HEADCOUNTTHRESH again
    assert example.silenced - example.commanded == pytest.approx(3.0)
    assert example.repeated - example.silenced == pytest.approx(1.0)
    assert 0 < example.obeyed - example.repeated < 3.0
    # then it stands still at first, and then turns to within 5 deg, and arrives
    during = (log.time > example.commanded + 0.2) & (log.time <= example.repeated)
    assert np.ptp(log["plant.heading"][during]) < 1e-9
    assert np.degrees(abs(log["controller.deviation"][log.time == example.obeyed][0])) < 5
    assert np.degrees(abs(log["controller.deviation"][log.time == example.repeated][0])) > 20
    assert log["controller.anomaly"][log["controller.anomaly"] > 0].tolist() == [2]  # TURN FAILURE
    assert log["controller.status"][-1] == 2  # SUCCESS
    rights = [
        first for first, _, value in equal_stretches(log["controller.command"]) if value == Command.RIGHT
    ]
    assert log.time[rights].tolist() == [example.commanded, example.repeated]


# the page


def test_the_page_has_the_results_of_canine_sweep(page: str) -> None:
    planned = sweep.plan_sweep("two", thresholds="23:37:7", trials=SMALL.rate)
    for point in table_of(planned.points, swept(planned)):
        half = 1.96 * (point.sd_time or 0) / point.successes**0.5
        cells = row(page, f"{point.written[0]} deg")
        assert cells[1:3] == [f"{100 * point.success_rate:.1f} %", f"{point.mean_time:.2f} ± {half:.2f} s"]
        field = next(f for f in FIELD if (f.waypoints, f.threshold) == ("two", int(point.written[0])))
        cells = row(page, f"two, {field.threshold} deg, non-structured", *_written(field), "calibrated")
        k, n, rate = field.successes, field.trials, point.success_rate
        chances = binom.pmf(np.arange(n + 1), n, rate)
        assert float(cells[6]) == pytest.approx(chances[chances <= chances[k] * (1 + 1e-9)].sum(), rel=0.06)
        assert cells[7] == ("agrees" if float(cells[6]) >= 0.05 else "**differs**")


def test_the_counts_are_held_against_a_reading_and_a_dog(page: str) -> None:
    # given the rates of the trials in the open, as `canine sweep` gives them
    rates: dict[tuple[str, int], Point] = {}
    for target, thresholds in (("two", "23:37:7"), ("three", "37:49:12")):
        planned = sweep.plan_sweep(
            target, thresholds=thresholds, trials=SMALL.rate, reading="field", settings=("canine=table_5_1",)
        )
        rates |= {(target, int(p.written[0])): p for p in table_of(planned.points, swept(planned))}
    # then the page has them, and how likely they make the counts
    cells = row(page, "`field`, dog `table_5_1`")
    points = [rates[f.waypoints, f.threshold] for f in FIELD if f.environment == "non-structured"]
    assert [cells[i] for i in (1, 2, 3, 5)] == [f"{100 * p.success_rate:.1f} %" for p in points]
    smooth = [(p.successes + 0.5) / (p.trials + 1) for p in points]
    chosen = [f for f in FIELD if f.environment == "non-structured"]
    assert cells[7].split(", ")[0] == f"{log_likelihood(chosen, smooth):.1f}"


def test_with_two_waypoints_field_is_calibrated() -> None:
    calibrated, field = (simulate("two", "23:37:7", 400, reading) for reading in ("calibrated", "field"))
    assert calibrated.ticks.tolist() == field.ticks.tolist()


def _written(field: Field) -> tuple[str, str]:
    low, high = field.interval
    share = 100 * field.successes / field.trials
    return f"{field.successes}/{field.trials} = {share:.1f} %", f"{100 * low:.1f} to {100 * high:.1f} %"


def test_the_search_takes_its_3_s_and_the_watch_its_half_and_neither_costs_success(page: str) -> None:
    plain = [cell.split(", ") for cell in row(page, "none")[1:]]
    search = [re.split(" ± |, ", cell) for cell in row(page, "search for the bumper, 1 to 5 s")[1:]]
    watch = [re.split(" ± |, ", cell) for cell in row(page, "watch started 0.5 s early")[1:]]
    for without, searching, early in zip(plain, search, watch, strict=True):
        # the mean search is 3 s, good to 1.15 s / sqrt(400); ticks round up; the dog comes to rest meanwhile
        assert 2.8 < float(searching[0]) < 3.4
        assert 0.5 <= float(early[0]) <= 0.54
        assert searching[2] == early[2] == without[1]


def test_the_mean_dog_fails_in_left_90_only(page: str) -> None:
    dogs = page.split("## What makes trials fail")[1]
    calibrated, literal = dogs.split("Literal:")[0], dogs.split("Literal:")[1].split("\n- ")[0]
    last = row(calibrated, "drift at its mean, no deviations, rates 1")
    assert last[1:6] == ["75.0 %", "100.0 %", "0.0 %", "100.0 %", "100.0 %"]
    # while the turn success rates decide in the literal reading alone (rates good to 3 % of 400 trials)
    for reading, least, most in ((calibrated, -2.0, 4.0), (literal, 15.0, 40.0)):
        plain, obedient = (
            float(row(reading, dog)[1].split()[0]) for dog in ("Table 5.1", "turn success rates 1 and 1")
        )
        assert least < obedient - plain < most


def test_five_waypoints_need_more_turns_than_a_trial_has(page: str) -> None:
    cells = row(page, "5")
    assert cells[1] == "0.0 %, -"
    assert float(cells[2].split()[0]) > 90


def test_the_same_inputs_give_the_same_page_and_pictures(page: str, tmp_path: Path) -> None:
    simulate.cache_clear()
    write(tmp_path, SMALL)
    assert (tmp_path / PAGE).read_text() == page
    shown = set(re.findall(r"!\[.+\]\((.+)\)", page))
    assert {path.name for path in tmp_path.iterdir()} == {PAGE, *shown}
    for name in shown:
        assert imread(tmp_path / name).std() > 0.05


def test_the_committed_page_is_what_a_run_gives(example: Example) -> None:
    committed = (RESULTS / PAGE).read_text()
    assert time_table(Size()) in committed
    assert f"has seed {example.seed};" in committed
    assert "python -m harness.verification\n" in committed
    # with its pictures beside it
    shown = re.findall(r"!\[.+\]\((.+)\)", committed)
    assert len(shown) == 5
    for name in shown:
        assert 10_000 < (RESULTS / name).stat().st_size < 150_000
    for target in re.findall(r"\]\((\.\./[^)#]+)", committed):
        assert (RESULTS / target).is_file()


# the scenarios


@pytest.mark.parametrize(("name", "legs", "turn"), [("four_waypoint", 4, 90), ("five_waypoint", 5, 72)])
def test_more_waypoints_go_round_the_same_122_m(name: str, legs: int, turn: float) -> None:
    places = [(0.0, 0.0), *load(name).waypoints, (0.0, 0.0)]
    steps = [(n2 - n1, e2 - e1) for (n1, e1), (n2, e2) in pairwise(places)]
    assert [math.hypot(*step) for step in steps] == pytest.approx([122 / legs] * legs, abs=5e-3)
    bearings = [math.degrees(math.atan2(east, north)) for north, east in steps]
    assert [(b - a) % 360 for a, b in pairwise(bearings)] == pytest.approx([turn] * (legs - 1), abs=0.02)


def test_distance_100_is_two_waypoint_with_a_longer_leg() -> None:
    near, far = load("two_waypoint"), load("distance_100")
    assert (near.waypoints, far.waypoints) == (((25.0, 0.0),), ((100.0, 0.0),))
    assert near.parameters == far.parameters == {}
    # no trial is cut in which the dog runs 500 m there and back at 4.86 m/s with a stop of 10 s every 20 m
    assert far.duration > 1000 / 4.86 + 1000 / 20 * 10
