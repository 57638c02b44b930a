"""The animal's statistics from logged trials: Table 5.1 for a dog of one's own."""

import io
import json
import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from scipy.stats import binom, truncnorm

from harness.fit.estimate import (
    FitError,
    before_redrawing,
    estimate,
    find_logs,
    interval_of_deviation,
    interval_of_mean,
    pool,
    read_tracks,
)
from harness.fit.report import figure, fragment, show
from harness.fit.tracks import (
    MOTION_SOURCES,
    RATES,
    STATISTICS,
    Track,
    Trial,
    edge,
    measure,
    slope,
    stretches,
)
from harness.log.log import Channel, LogError
from harness.log.writer import LogWriter
from harness.trial import trial
from harness.trial.plan import interfaces_of_system, plan
from harness.trial.prepare import prepared
from harness.trial.request import Changes, build_missing, requested
from harness.trial.scenario import SHIPPED, load
from models.canine import Canine
from models.commands import Command
from models.kit.model import Model
from models.system import SYSTEMS
from tests.harness.command import canine

TICK = 0.04
DEG = math.pi / 180
PLANT, ESTIMATOR = MOTION_SOURCES["plant"], MOTION_SOURCES["estimator"]
Program = list[tuple[Command, float]]  # command, s

# every command once; at rest before it turns; fast enough dogs brake from their cruising speed
SCHOOL: Program = [
    (Command.FORWARD, 8.0),
    (Command.STOP, 5.0),
    (Command.LEFT, 1.0),
    (Command.NONE, 1.0),
    (Command.RIGHT, 1.0),
]


def commands(program: Program) -> np.ndarray:
    """(ticks,), with the tick after the last command, as the logs have it."""
    given = [np.full(round(length / TICK), float(command)) for command, length in program]
    return np.concatenate([*given, [0.0]])


def track(
    command: np.ndarray, speed: np.ndarray, heading: np.ndarray, step: float = TICK, **other: object
) -> Track:
    """A trial of which everything is known."""
    known = np.ones(len(command), dtype=bool)
    time = step * np.arange(len(command))
    return Track("t", time, command, speed, heading, **({"usable": known, "fresh": known} | other))


def motion(command: np.ndarray, dog: dict[str, float]) -> Track:
    """A dog moved tick by tick as 5.2 and D.6 say: here it obeys LEFT and RIGHT; rad, SI."""
    speed, heading = [0.0], [dog.get("start", 0.0)]
    for told in command[:-1]:
        running = told in (Command.FORWARD, Command.RECALL)
        turn = {Command.LEFT: dog.get("left", 0.0), Command.RIGHT: dog.get("right", 0.0)}.get(told, 0.0)
        turn += dog["drift"] if running or speed[-1] > 0 else 0.0
        rate = dog["up"] if running else -dog["down"]
        speed.append(min(max(speed[-1] + rate * TICK, 0.0), dog["cruise"]))
        heading.append(math.remainder(heading[-1] + turn * TICK, 2 * math.pi))
    return track(command, np.array(speed), np.array(heading))


DOG = {
    "cruise": 4.1, "up": 1.7, "down": 2.9, "drift": 2.5 * DEG, "left": -80 * DEG, "right": 50 * DEG,
}  # fmt: skip


def test_a_trial_gives_its_dog_exactly() -> None:
    # given a dog that starts near south, so that its heading wraps
    trial = measure(motion(commands(SCHOOL), {**DOG, "start": 179 * DEG}), PLANT)
    # then
    expected = {
        "cruise_speed": 4.1, "speeding_up": 1.7, "slowing_down": 2.9,
        "drift": 2.5 * DEG, "left_turn_rate": -80 * DEG, "right_turn_rate": 50 * DEG,
    }  # fmt: skip
    assert trial.values == pytest.approx(expected, rel=1e-9)
    assert trial.responses == {"left_success": [True], "right_success": [True]}
    assert trial.left_out == {("start_heading", "the log has no waypoint"): 1}


def test_drift_goes_on_into_a_turn_while_the_dog_still_moves_and_is_taken_out() -> None:
    # given a dog that is told to turn at 4.1 m/s: it moves for 1.41 s of the 2 s of the turn
    moved = motion(commands([(Command.FORWARD, 6.0), (Command.LEFT, 2.0)]), DOG)
    turned = np.unwrap(moved.heading)[150:]
    assert (turned[-1] - turned[0]) / DEG == pytest.approx(-160 + 2.5 * 36 * TICK)  # 36 ticks above 0
    # then the rate is the turn's alone
    assert measure(moved, PLANT).values["left_turn_rate"] / DEG == pytest.approx(-80)


def test_the_body_that_turns_home_on_recall_is_no_drift() -> None:
    command = commands([(Command.FORWARD, 4.0), (Command.RECALL, 4.0)])
    moved = motion(command, DOG)
    moved.heading[110:] += math.pi  # homewards
    assert measure(moved, PLANT).values["drift"] / DEG == pytest.approx(2.5)


def test_a_dog_that_takes_its_time_is_read_the_same() -> None:
    # given the same motion half a second later than the commands: what came before goes on for so long
    command = commands(SCHOOL)
    moved = motion(command, DOG)
    late = round(0.5 / TICK)
    speed = np.concatenate([np.zeros(late), moved.speed[:-late]])
    heading = np.concatenate([np.full(late, moved.heading[0]), moved.heading[:-late]])
    told = measure(track(command, speed, heading), PLANT)
    # then
    prompt = measure(moved, PLANT)
    assert told.values == pytest.approx(prompt.values, rel=1e-9)
    assert told.responses == prompt.responses


def later(command: np.ndarray, dog: dict[str, float], delay: float) -> Track:
    """A dog that obeys each command a while after it is given, s."""
    late = round(delay / TICK)
    moved = motion(np.concatenate([np.zeros(late), command[: len(command) - late]]), dog)
    return track(command, moved.speed, moved.heading)


@pytest.mark.parametrize("delay", [0.32, 0.52, 1.0])
@pytest.mark.parametrize("run", [2.0, 2.3, 6.0])  # s: STOP comes while it speeds up, shortly before, after
def test_a_late_dog_that_still_speeds_up_on_stop_is_read_exactly(run: float, delay: float) -> None:
    command = commands([(Command.FORWARD, run), (Command.STOP, 4.0)])
    told = measure(later(command, DOG, delay), PLANT)
    assert told.values["slowing_down"] == pytest.approx(2.9, rel=1e-9)
    assert told.values["speeding_up"] == pytest.approx(1.7, rel=1e-9)


def test_a_late_dog_that_still_slows_down_when_told_to_run_is_read_exactly() -> None:
    # given a dog at 0.4 m/s as FORWARD comes, which stands 0.14 s later and starts after 0.52 s
    program = [(Command.FORWARD, 4.0), (Command.STOP, 1.8), (Command.FORWARD, 4.0)]
    late = later(commands(program), DOG, 0.52)
    assert 0.1 < late.speed[145] < 0.5
    told = measure(late, PLANT)
    assert told.values["speeding_up"] == pytest.approx(1.7, rel=1e-9)
    assert told.values["cruise_speed"] == pytest.approx(4.1, rel=1e-9)


def test_a_stop_that_ends_before_a_late_dog_brakes_tells_no_deceleration() -> None:
    # given STOP for 0.4 s and dogs that obey after 0.52 s: one still speeds up, the other cruises
    for run in (2.0, 6.0):
        told = measure(later(commands([(Command.FORWARD, run), (Command.STOP, 0.4)]), DOG, 0.52), PLANT)
        assert "slowing_down" not in told.values
        assert told.left_out["slowing_down", "ended before it slowed down"] == 1


def test_what_was_not_obeyed_and_what_turned_the_wrong_way() -> None:
    # given three LEFTs: ignored, turned to the right, turned by 3 deg/s
    program = [(Command.LEFT, 2.0), (Command.NONE, 1.0)]
    still = commands([*program, *program, *program])
    rates = np.zeros(len(still))
    rates[75:125], rates[150:200] = 40 * DEG, -3 * DEG
    heading = np.concatenate([[0.0], np.cumsum(rates[:-1]) * TICK])
    moved = track(still, np.zeros(len(still)), heading)
    # then the truth tells 3 deg/s from nothing, and the estimate does not
    assert measure(moved, PLANT).responses["left_success"] == [False, True, True]
    assert measure(moved, PLANT).values["left_turn_rate"] / DEG == pytest.approx((40 - 3) / 2)
    assert measure(moved, ESTIMATOR).responses["left_success"] == [False, True, False]
    assert measure(moved, ESTIMATOR).values["left_turn_rate"] / DEG == pytest.approx(40)


def test_a_standing_dog_that_looks_south_does_not_turn_round() -> None:
    # given a heading of 180 deg, good to 1 deg: it jumps from 180 to -180 and back
    still = commands([(Command.LEFT, 3.0)])
    heading = np.pi + DEG * np.random.default_rng(1).standard_normal(len(still))
    wrapped = np.array([math.remainder(h, 2 * math.pi) for h in heading])
    told = measure(track(still, np.zeros(len(still)), wrapped), ESTIMATOR)
    assert told.responses["left_success"] == [False]


def test_a_dog_that_is_asked_on_and_on_counts_three_times() -> None:
    still = commands([(Command.RIGHT, 3.0), (Command.NONE, 1.0)] * 7)
    told = measure(track(still, np.zeros(len(still)), np.zeros(len(still))), PLANT)
    assert told.responses["right_success"] == [False] * 3
    assert told.left_out["right_success", "after the first 3 of a trial"] == 4


def test_what_cannot_be_told_is_left_out_with_its_reason() -> None:
    # given a run of 1.2 s, on and off again, and a dog that is called back at once
    program = [
        (Command.FORWARD, 1.2), (Command.STOP, 0.2), (Command.FORWARD, 1.2), (Command.STOP, 0.2),
        (Command.RECALL, 0.2), (Command.STOP, 2.0), (Command.FORWARD, 0.2), (Command.STOP, 2.0),
    ]  # fmt: skip
    told = measure(motion(commands(program), DOG), PLANT)
    # then it gathers 2.04, 3.5 (not from rest), and 0.34 m/s
    assert "cruise_speed" not in told.values
    assert told.left_out["cruise_speed", "ended before 1 s of steady speed"] == 3
    assert told.left_out["cruise_speed", "came to less than 1 m/s"] == 1
    assert told.left_out["speeding_up", "not from rest"] == 1
    assert told.left_out["speeding_up", "came to less than 1 m/s"] == 1
    assert told.left_out["drift", "under way for less than 1 s"] == 2
    assert told.values["speeding_up"] == pytest.approx(1.7)
    assert told.values["slowing_down"] == pytest.approx(2.9)


def test_stretches_without_a_valid_estimate_are_left_out() -> None:
    moved = motion(commands(SCHOOL), DOG)
    usable = moved.usable.copy()
    usable[50] = False  # within FORWARD
    told = measure(track(moved.command, moved.speed, moved.heading, usable=usable), PLANT)
    assert told.left_out["drift", "the motion is not known throughout"] == 1
    assert set(told.values) == {"slowing_down", "right_turn_rate", "left_turn_rate"}


def test_the_start_is_held_against_the_bearing_of_the_first_waypoint() -> None:
    # given a waypoint to the south, and a dog at 175 deg, then at -170 deg: off by -5 and by 10
    for start, off in ((175, -5.0), (-170, 10.0)):
        moved = motion(commands(SCHOOL), {**DOG, "start": start * DEG})
        aimed = track(moved.command, moved.speed, moved.heading, aim=math.pi)
        assert measure(aimed, PLANT).values["start_heading"] / DEG == pytest.approx(off)


def test_a_finer_sample_time_is_read_the_same() -> None:
    # given 1 ms: a ramp of 2 m/s2 to 4 m/s, and 3 s of cruising
    time = 0.001 * np.arange(5001)
    command = np.where(time < 5, float(Command.FORWARD), 0.0)
    told = measure(track(command, np.minimum(2 * time, 4), 0.1 * time, step=0.001), PLANT)
    assert told.values == pytest.approx({"cruise_speed": 4, "speeding_up": 2, "drift": 0.1}, rel=1e-9)


def test_edges_lie_where_they_were_put() -> None:
    y = np.array([1, 1, 1, 2, 3, 4, 5, 5, 5, 5], dtype=float)
    first, last = edge(np.arange(10.0), y, 1, 9)
    assert slope([(np.arange(first, last + 1.0), y[first : last + 1])]) == pytest.approx(1)
    assert (first, last) in {(2, 6), (2, 5), (3, 6), (3, 5)}  # the corners are on both sides
    assert edge(np.arange(10.0), np.arange(10.0) ** 2, 9, 99) == (0, 9)  # no shorter than the least


def test_lines_share_a_slope_by_least_squares() -> None:
    # given two lines of 2 and 3 points: slope = (Sxy1 + Sxy2) / (Sxx1 + Sxx2) = (0.5 * 1 + 2 * 4) / (0.5 + 2)
    short = np.array([0.0, 1.0]), np.array([7.0, 8.0])
    long = np.array([0.0, 1.0, 2.0]), np.array([0.0, 4.0, 8.0])
    assert slope([short, long]) == pytest.approx((0.5 * 1 + 2 * 4) / 2.5)


def test_stretches_end_on_the_first_tick_of_the_next() -> None:
    assert stretches(np.array([1, 1, 2, 4, 4, 0.0])) == [(1, 0, 2), (2, 2, 3), (4, 3, 5), (0, 5, 5)]


# the estimate's noise


def test_noise_of_the_estimate_is_averaged_out() -> None:
    # given a speed good to 0.05 m/s at fixes, which swings by 3 m/s between, and a heading good to 1 deg
    draw = np.random.default_rng(5)
    errors: dict[str, list[float]] = {}
    for _ in range(30):
        moved = motion(commands(SCHOOL), DOG)
        ticks = np.arange(len(moved.time))
        fresh = np.isin(ticks, np.ceil(np.arange(0, ticks[-1] * TICK, 0.25) / TICK - 1e-9))
        noise = np.where(fresh, 0.05, 3.0) * draw.standard_normal(len(ticks))
        heading = moved.heading + DEG * draw.standard_normal(len(ticks))
        told = measure(track(moved.command, moved.speed + noise, heading, fresh=fresh), ESTIMATOR)
        truth = measure(moved, PLANT)
        assert told.responses == truth.responses
        for key, value in truth.values.items():
            errors.setdefault(key, []).append(told.values[key] - value)
    # then it is off by what least squares make of it: s sqrt(12 / n) / T of a slope, s / sqrt(n) of a mean
    expected = {
        "cruise_speed": 0.05 / math.sqrt(22),  # 22 fixes
        "speeding_up": 0.05 * math.sqrt(12 / 9) / 2.25,
        "slowing_down": 0.05 * math.sqrt(12 / 5) / 1.25,
        "drift": DEG * math.sqrt(12 / 185) / 7.4,
        "left_turn_rate": DEG * math.sqrt(12 / 25) / 1.0,
        "right_turn_rate": DEG * math.sqrt(12 / 25) / 1.0,
    }
    for key, off in errors.items():
        rms = math.sqrt(np.mean(np.square(off)))
        assert rms < 2 * expected[key], key  # the edges are found from the same noise
        assert abs(np.mean(off)) < 1.0 * expected[key], key


def test_noise_does_not_bias_the_braking_of_a_late_dog() -> None:
    # given 100 dogs that speed up for 0.52 s of STOP; the speed is good to 0.05 m/s at fixes every 0.24 s
    draw = np.random.default_rng(7)
    late = later(commands([(Command.FORWARD, 2.0), (Command.STOP, 4.0)]), DOG, 0.52)
    ticks = np.arange(len(late.time))
    off = []
    for k in range(100):
        speed = late.speed + 0.05 * draw.standard_normal(len(ticks))
        given = track(late.command, speed, late.heading, fresh=ticks % 6 == k % 6)
        off.append(measure(given, ESTIMATOR).values["slowing_down"] - 2.9)
    # then the mean is off by no more than 3 of its errors: s sqrt(12 / n) / T of 4 fixes, by the root of 100
    expected = 0.05 * math.sqrt(12 / 4) / 0.96
    assert math.sqrt(np.mean(np.square(off))) < 2 * expected
    assert abs(np.mean(off)) < 3 * expected / math.sqrt(100)


def test_a_stray_fix_while_the_dog_stands_is_not_where_it_brakes_from() -> None:
    moved = motion(commands([(Command.FORWARD, 6.0), (Command.STOP, 6.0)]), DOG)
    moved.speed[250] = 6.0  # 4 s after STOP; it stands since 2.6 s
    assert measure(moved, ESTIMATOR).values["slowing_down"] == pytest.approx(2.9, rel=1e-2)


# many trials of a known animal

Trials = Callable[[dict[str, float], range], list[Trial]]


@pytest.fixture
def school(native: Callable[..., object]) -> Trials:
    """The model's dogs, in C, through SCHOOL."""
    command = commands(SCHOOL)

    def run(parameters: dict[str, float], seeds: range) -> list[Trial]:
        trials = []
        for seed in seeds:
            dog = native(Canine, parameters={"shaking": 0, **parameters, "seed": seed})
            begin = dog["body_heading"]
            columns = dog.run(command=command[:-1])
            speed, heading = (
                np.concatenate([[s], columns[n]]) for s, n in ((0, "speed"), (begin, "heading"))
            )
            trials.append(measure(track(command, speed, heading, aim=0.0), PLANT))
        return trials

    return run


def test_known_statistics_lie_in_their_intervals_as_often_as_these_claim(school: Trials) -> None:
    # given 20 batches of 30 trials of a dog unlike Table 5.1's, whose draws are practically never redrawn
    known = {
        "cruise_speed": (3.6, 0.6), "speeding_up": (2.2, 0.4), "slowing_down": (3.1, 0.5),
        "right_turn_rate": (60 * DEG, 12 * DEG), "left_turn_rate": (-75 * DEG, 15 * DEG),
        "drift": (-1.5 * DEG, 1.1 * DEG), "start_heading": (20 * DEG, 6 * DEG),
    }  # fmt: skip
    rates = {"left_success": 0.8, "right_success": 0.35}
    parameters = rates | {key: mean for key, (mean, _) in known.items()}
    parameters |= {f"{key}_deviation": deviation for key, (_, deviation) in known.items()}
    trials = school(parameters, range(1, 601))
    batches = [pool(trials[i : i + 30], PLANT.turned) for i in range(0, 600, 30)]
    # when it is counted how often the known value lies in the interval
    covered: dict[str, int] = {}
    for statistic in STATISTICS:
        mean, deviation = (statistic.scale * value for value in known[statistic.key])
        rows = [batch["statistics"][statistic.key] for batch in batches]
        covered[f"{statistic.key} mean"] = sum(within(mean, row["mean_interval"]) for row in rows)
        covered[f"{statistic.key} sd"] = sum(within(deviation, row["sd_interval"]) for row in rows)
    for name, rate in rates.items():
        covered[name] = sum(within(rate, batch["responses"][name]["interval"]) for batch in batches)
    # then each of the 16 does so in as many of 20 batches as is likely at 95 %, and all together no more
    assert len(covered) == 16
    assert min(covered.values()) >= binom.ppf(1e-4, 20, 0.95), covered
    low, high = binom.interval(0.999, 16 * 20, 0.95)
    assert low <= sum(covered.values()) <= high, covered


def within(value: float, interval: tuple[float, float]) -> bool:
    return interval[0] <= value <= interval[1]


def test_what_the_model_draws_again_is_undone_in_the_parameters(school: Trials) -> None:
    # given decelerations as wide as Table 5.1's: the model draws 5 % of them again, below 0.2 of the mean
    mean, deviation = 2.72, 1.31
    trials = school({"slowing_down_deviation": deviation}, range(1, 401))
    result = pool(trials, PLANT.turned)
    # then what it draws is that of the normal distribution cut off there (scipy's), not Table 5.1's
    cut = truncnorm((0.2 - 1) * mean / deviation, np.inf, mean, deviation)
    row = result["statistics"]["slowing_down"]
    assert cut.mean() == pytest.approx(2.859, abs=1e-3)
    assert row["mean"] == pytest.approx(cut.mean(), abs=4 * cut.std() / math.sqrt(400))
    # and the parameters are the model's own, to 3 standard errors and more: less than what was seen
    assert result["parameters"]["canine.slowing_down"] < row["mean"] - 0.05
    assert result["parameters"]["canine.slowing_down"] == pytest.approx(mean, rel=0.1)
    assert result["parameters"]["canine.slowing_down_deviation"] == pytest.approx(deviation, rel=0.15)


@pytest.mark.parametrize(("mean", "deviation"), [(2.72, 1.31), (4.86, 1.49), (3.0, 0.1), (1.0, 2.0)])
def test_redrawing_is_undone_exactly(mean: float, deviation: float) -> None:
    cut = truncnorm((0.2 - 1) * mean / deviation, np.inf, mean, deviation)
    assert before_redrawing(cut.mean(), cut.std()) == pytest.approx((mean, deviation), rel=1e-6)


def test_no_normal_distribution_cut_off_so_spreads_wider_than_its_mean() -> None:
    assert before_redrawing(1.0, 0.9) is None
    told = [Trial("t", {"speeding_up": value}) for value in (0.1, 0.1, 5.0)]
    result = pool(told, PLANT.turned)
    assert result["parameters"]["canine.speeding_up"] == pytest.approx(5.2 / 3, rel=1e-5)  # as it is
    assert any(note.startswith("acceleration: spread too widely for the model") for note in result["notes"])


# intervals and the rest of pooling


def test_intervals_are_those_of_the_books() -> None:
    # t(0.975, 4) = 2.776, chi2(0.025, 4) = 0.4844, chi2(0.975, 4) = 11.143; s^2 = 2.5
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    half = 2.776 * math.sqrt(2.5 / 5)
    assert interval_of_mean(values) == pytest.approx((3 - half, 3 + half), abs=1e-3)
    assert interval_of_deviation(values) == pytest.approx(
        (math.sqrt(10 / 11.143), math.sqrt(10 / 0.4844)), rel=1e-4
    )
    assert interval_of_mean(values[:1]) is None
    assert interval_of_deviation(values[:1]) is None


def test_rates_have_wilsons_interval() -> None:
    # given 29 of 45, which is Table 5.1's 0.64; Wilson 1927: centre and half width by hand
    told = [Trial("t", {}, {"left_success": [i < 29], "right_success": []}) for i in range(45)]
    row = pool(told, PLANT.turned)["responses"]["left_success"]
    z, n, p = 1.959964, 45, 29 / 45
    centre, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    assert row["interval"] == pytest.approx(
        [(centre - half) / (1 + z * z / n), (centre + half) / (1 + z * z / n)]
    )
    assert (row["n"], row["obeyed"], row["rate"]) == (45, 29, p)
    assert pool(told, PLANT.turned)["responses"]["right_success"]["interval"] is None


def test_table_5_1_is_what_the_model_starts_with() -> None:
    declared = Canine.variables()
    for statistic in STATISTICS[:-1]:
        assert statistic.published is not None
        assert declared[statistic.key].start[0] * statistic.scale == pytest.approx(statistic.published[0])
    for name, (rate, _) in RATES.items():
        assert declared[name].start[0] == rate


def test_turns_too_slow_to_tell_are_noted_by_their_share() -> None:
    # given turn rates of 20 +- 10 deg/s: P(-5 < X < 5) = Phi(-1.5) - Phi(-2.5) = 0.0668 - 0.0062
    told = [Trial("t", {"right_turn_rate": rate * DEG}) for rate in (20 - 10, 20.0, 20 + 10)]
    notes = pool(told, 5 * DEG)["notes"]
    assert len(notes) == 1
    assert notes[0].startswith(
        "right turn: by its distribution 6.1 % of the turns are slower than 5 deg/s and"
    )
    assert pool(told, 0.1 * DEG)["notes"] == []


def test_runs_that_end_too_early_make_the_mean_low_and_are_noted() -> None:
    # given legs of 3 s: a dog of 1.7 m/s2 that cruises at 3.2 m/s does so for 1.1 s, one of 4.1 m/s for 0.6
    told = [
        measure(motion(commands([(Command.FORWARD, 3.0), (Command.STOP, 3.0)]), {**DOG, "cruise": v}), PLANT)
        for v in (3.2, 4.1)
    ]
    result = pool(told, PLANT.turned)
    assert result["statistics"]["cruise_speed"]["mean"] == pytest.approx(3.2)
    assert result["notes"][0].startswith("velocity: 1 of 2 trials never had 1 s of steady speed")


def test_nothing_to_estimate_from_says_why_for_each_statistic() -> None:
    told = measure(motion(commands([(Command.FORWARD, 0.4)]), DOG), PLANT)
    with pytest.raises(FitError) as caught:
        pool([told], PLANT.turned)
    assert str(caught.value) == (
        "no trial has a stretch to estimate from (velocity: came to less than 1 m/s (1); acceleration: "
        "came to less than 1 m/s (1); deceleration: no STOP of a moving animal; right turn: no RIGHT; left "
        "turn: no LEFT; heading drift: under way for less than 1 s (1); start heading: the log has no "
        "waypoint (1)); give longer trials"
    )


# what a scenario takes


def test_the_fragment_appended_to_a_scenario_gives_that_dog(tmp_path: Path) -> None:
    # given three trials, with one RIGHT among them that was obeyed
    dogs = [{**DOG, "cruise": v, "drift": d * DEG} for v, d in ((3.0, 1.0), (4.0, 2.0), (5.0, 3.0))]
    told = [measure(motion(commands(SCHOOL[: 3 if i else 5]), dog), PLANT) for i, dog in enumerate(dogs)]
    result = pool(told, PLANT.turned)
    # when it is appended to a shipped scenario
    written = tmp_path / "mine.toml"
    written.write_text((SHIPPED / "two_waypoint.toml").read_text() + fragment(result))
    values = plan(load(str(written)), interfaces_of_system(SYSTEMS["full"])).values["plant"]
    # then the plant has it in SI; the deviation of one value is left to the model
    assert values["cruise_speed"] == pytest.approx(4.0, rel=0.01)  # redrawing: 3.99
    assert values["drift"] == pytest.approx(2 * DEG, rel=1e-5)
    assert values["drift_deviation"] == pytest.approx(1 * DEG, rel=1e-5)
    assert values["left_turn_rate"] == pytest.approx(-80 * DEG, rel=1e-5)
    assert values["right_turn_rate"] == pytest.approx(50 * DEG, rel=1e-5)
    assert values["right_success"] == 1
    assert "right_turn_rate_deviation" not in values
    assert "# one value does not show canine.right_turn_rate_deviation: it stays" in written.read_text()


def test_the_fragment_says_what_it_lacks_and_what_is_the_handlers() -> None:
    told = [Trial("t", {"drift": d, "start_heading": d}) for d in (1 * DEG, 3 * DEG)]
    text = fragment(pool(told, PLANT.turned))
    assert tomllib.loads(text)["parameters"] == {
        "canine.drift": pytest.approx(2), "canine.drift_deviation": pytest.approx(math.sqrt(2), rel=1e-5)
    }  # fmt: skip
    assert "# the trials do not show canine.cruise_speed: it stays as the model has it" in text
    assert '# "canine.start_heading_deviation" = 1.41421' in text
    assert "the start was 2 deg off the first waypoint on average" in text


def test_round_off_is_written_as_zero() -> None:
    # given values that differ in their last digits: 4.1 m/s, no drift; and decelerations that do vary
    told = [
        Trial("t", {"cruise_speed": 4.1 + d, "drift": d, "slowing_down": 2.9 + 1e7 * d, "start_heading": d})
        for d in (0.0, 2e-15, -2e-15)
    ]
    text = fragment(pool(told, PLANT.turned))
    parameters = tomllib.loads(text)["parameters"]
    # then
    assert parameters["canine.cruise_speed"] == pytest.approx(4.1)
    assert parameters["canine.cruise_speed_deviation"] == 0.0
    assert parameters["canine.drift"] == 0.0
    assert parameters["canine.drift_deviation"] == 0.0
    assert '# "canine.start_heading_deviation" = 0.0' in text
    assert parameters["canine.slowing_down_deviation"] == pytest.approx(2e-8, rel=1e-3)


# logs


def write(path: Path, columns: dict[str, np.ndarray], step: float = TICK, seed: str = "1") -> Path:
    """A log with columns by component.signal."""
    path.parent.mkdir(parents=True, exist_ok=True)
    components = dict.fromkeys(name.partition(".")[0] for name in columns)
    names = {c: [n.partition(".")[2] for n in columns if n.startswith(f"{c}.")] for c in components}
    channels = [
        Channel(c, c, tuple(n), ("",) * len(n), ("Real",) * len(n), ("",) * len(n)) for c, n in names.items()
    ]
    metadata = {"parameters": {"plant.seed": seed}}
    with LogWriter(path, channels, origin=(0, 0), metadata=metadata, attachments={}) as log:
        times = np.arange(len(next(iter(columns.values())))) * step
        log.write_rows(
            times, {c: np.column_stack([columns[f"{c}.{n}"] for n in names[c]]) for c in components}
        )
    return path


def columns(dog: dict[str, float] = DOG, component: str = "plant") -> dict[str, np.ndarray]:
    moved = motion(commands(SCHOOL), dog)
    zero = np.zeros(len(moved.time))
    return {
        "controller.command": moved.command,
        f"{component}.speed": moved.speed,
        f"{component}.heading": moved.heading,
        f"{component}.north": zero,
        f"{component}.east": zero,
    }


def test_a_log_without_truth_is_read_by_its_estimate(tmp_path: Path) -> None:
    # given a real trial's log: no plant; invalid while it brakes; between fixes the speed is off by 5 m/s
    given = columns(component="estimator")
    ticks = len(given["controller.command"])
    given["estimator.valid"] = np.where((np.arange(ticks) > 200) & (np.arange(ticks) < 220), 0.0, 1.0)
    given["estimator.gps_fix"] = (np.arange(ticks) % 6 == 0).astype(float)
    given["estimator.speed"] = given["estimator.speed"] + 5 * (1 - given["estimator.gps_fix"])
    reading = read_tracks([write(tmp_path / "field.mcap", given)])
    # then
    result = estimate(reading)
    assert result["sources"] == ["estimator"]
    assert result["turned_deg_s"] == pytest.approx(5)
    assert result["statistics"]["cruise_speed"]["mean"] == pytest.approx(4.1)
    assert result["statistics"]["speeding_up"]["mean"] == pytest.approx(1.7)
    assert result["statistics"]["left_turn_rate"]["mean"] == pytest.approx(-80, rel=2e-3)  # drift of 0.3 m/s
    assert result["statistics"]["slowing_down"]["left_out"] == {"the motion is not known throughout": 1}
    # and a threshold of one's own
    assert estimate(reading, turned=60 * DEG)["responses"]["right_success"]["obeyed"] == 0


def test_what_the_plant_was_told_counts_before_what_the_controller_said(tmp_path: Path) -> None:
    # given a log in jacobi order: the command reaches the dog a tick later
    given = columns()
    given["plant.command"] = given["controller.command"]
    given["controller.command"] = np.append(given["plant.command"][1:], 0.0)
    (read, _), *_ = read_tracks([write(tmp_path / "t.mcap", given)]).tracks
    np.testing.assert_array_equal(read.command, given["plant.command"])


def test_notes_say_what_is_odd_about_the_logs(tmp_path: Path) -> None:
    # given logs: whole, the same again, cut short, with another sample time, of the estimate, no log
    first = write(tmp_path / "a" / "trial.mcap", columns(), seed="1")
    (tmp_path / "b.mcap").write_bytes(first.read_bytes())
    (tmp_path / "c.mcap").write_bytes(first.read_bytes()[:-4000])
    write(tmp_path / "d.mcap", columns({**DOG, "cruise": 4.0}), step=0.05, seed="1")
    write(tmp_path / "e.mcap", columns(component="estimator"), seed="5")
    (tmp_path / "f.mcap").write_text("no log at all")
    write(tmp_path / "g.mcap", {"plant.speed": np.zeros(3), "plant.heading": np.zeros(3)})
    # when
    reading = read_tracks(find_logs([tmp_path, first]))
    # then
    assert [track.name.split("/")[1] for track, _ in reading.tracks] == [
        "trial.mcap",
        "c.mcap",
        "d.mcap",
        "e.mcap",
    ]
    same, cut, foreign, silent, mixed, steps, seeds = reading.notes
    assert same == f"{tmp_path}/b.mcap: the same log as {first}; counted once"
    assert cut.startswith(f"{tmp_path}/c.mcap: the log is not whole, the file ends early, at byte ")
    assert foreign.startswith(f"log {tmp_path}/f.mcap: not an MCAP file")
    assert foreign.endswith("; left out")
    assert silent == (
        f'{tmp_path}/g.mcap: the log has no signal "controller.command"; expected the log of a guided trial, '
        "such as `canine run` writes, with the motion of plant or estimator; left out"
    )
    assert mixed.startswith("the motion is read from plant of 3, estimator of 1 logs")
    assert (
        steps == "the logs have different sample times: 0.04 s in 3, 0.05 s in 1; each is read with its own"
    )
    assert seeds.startswith("2 of the simulated logs have the seed of another, and so the same draws")


def test_what_cannot_be_opened_is_left_out_with_a_note(tmp_path: Path) -> None:
    # given a log among a folder and a broken link, both named as logs are
    good = write(tmp_path / "good.mcap", columns())
    (tmp_path / "folder.mcap").mkdir()
    (tmp_path / "link.mcap").symlink_to(tmp_path / "nowhere")
    reading = read_tracks(find_logs([tmp_path]))
    # then the good one counts
    assert [track.name for track, _ in reading.tracks] == [f"{tmp_path.name}/{good.name}"]
    assert list(reading.notes) == [
        f"{tmp_path}/folder.mcap: cannot be read (Is a directory); expected the log of a trial; left out",
        f"{tmp_path}/link.mcap: cannot be read (No such file or directory); expected the log of a trial; "
        "left out",
    ]
    # and alone it is an error
    with pytest.raises(FitError, match=r"folder\.mcap: cannot be read \(Is a directory\)"):
        read_tracks([tmp_path / "folder.mcap"])


def test_a_log_that_ends_early_is_used_up_to_there(tmp_path: Path) -> None:
    path = write(tmp_path / "t.mcap", columns())
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    (read, source), *_ = read_tracks([path]).tracks
    assert len(read.time) < len(commands(SCHOOL))
    assert measure(read, source).values["cruise_speed"] == pytest.approx(4.1)


def test_errors_name_the_log_and_what_it_lacks(tmp_path: Path) -> None:
    def refused(name: str, given: dict[str, np.ndarray], component: str | None = None) -> str:
        with pytest.raises(FitError) as caught:
            read_tracks([write(tmp_path / name, given)], component)
        return str(caught.value)

    bare = {"plant.speed": np.zeros(3), "plant.heading": np.zeros(3)}
    assert refused("a.mcap", bare).startswith(
        f'{tmp_path}/a.mcap: the log has no signal "controller.command"'
    )
    assert '"estimator.speed"' in refused("b.mcap", columns(), "estimator")
    assert '"plant.speed"' in refused("c.mcap", columns(component="estimator"), "plant")
    single = {name: column[:1] for name, column in columns().items()}
    assert refused("d.mcap", single) == f"{tmp_path}/d.mcap: holds one tick; expected a trial"
    (tmp_path / "empty.mcap").touch()
    with pytest.raises(LogError, match="the file is empty"):
        read_tracks([tmp_path / "empty.mcap"])
    with pytest.raises(FitError, match=r'there is no log ".*nowhere"; expected a trial.mcap, or a folder'):
        find_logs([tmp_path / "nowhere"])
    (tmp_path / "folder").mkdir()
    with pytest.raises(FitError, match=r"folder: the folder holds no .mcap; expected logs of trials"):
        find_logs([tmp_path / "folder"])


# the table and the picture


def test_the_table_stands_beside_table_5_1_in_80_columns() -> None:
    # given five dogs that differ in how they turn to the left
    dogs = [{**DOG, "left": rate * DEG} for rate in (-40, -60, -80, -100, -120)]
    told = [measure(motion(commands(SCHOOL), dog), PLANT) for dog in dogs]
    result = {**pool(told, PLANT.turned), "sources": ["estimator"]}
    console = Console(width=80, record=True, file=io.StringIO())
    show(result, console)
    lines = console.export_text().splitlines()
    # then sd^2 = 1000, t(0.975, 4) = 2.776, chi2(0.025, 4) = 0.4844, chi2(0.975, 4) = 11.143
    heading = "5 trials (estimator) n mean ± sd mean, 95 % sd, 95 % Table 5.1 n"
    assert lines[0].split() == heading.split()
    row = "left turn [deg/s] 5 -80.0 ± 31.6 -119.3..-40.7 18.9..90.9 -77.67 ± 41.13 26"
    assert lines[5].split() == row.split()
    row = "left success rate 5 1.00 0.57..1.00 0.64 45"  # Wilson: 5 / (5 + 1.96^2) = 0.57
    assert lines[8].split() == row.split()
    assert "left out, start heading: the log has no waypoint (5)" in lines


def test_the_picture_has_a_panel_for_each_statistic_and_one_for_the_responses() -> None:
    # given trials with spread, without (one dog's acceleration), and a statistic without a value
    told = [measure(motion(commands(SCHOOL), {**DOG, "cruise": v}), PLANT) for v in (3.0, 3.5, 4.0, 5.0)]
    drawn = figure(pool(told, PLANT.turned))
    # then
    speed, up, *_, start, responses = drawn.axes
    assert [axes.get_xlabel() for axes in drawn.axes][:2] == ["velocity [m/s]", "acceleration [m/s2]"]
    heights = sum(bar.get_height() * bar.get_width() for bar in speed.patches)
    assert heights == pytest.approx(1)  # a density
    fitted, published = speed.lines
    assert fitted.get_xdata()[np.argmax(fitted.get_ydata())] == pytest.approx(3.875, abs=0.02)
    assert published.get_xdata()[np.argmax(published.get_ydata())] == pytest.approx(4.86, abs=0.02)
    assert len(up.patches) == 1
    assert not up.lines
    assert not start.patches
    assert [bar.get_height() for bar in responses.patches] == [1.0, 1.0]


# from trials to the command line


def test_trials_that_were_run_give_the_dogs_that_ran_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial, "trial_png", lambda log: b"")  # drawing takes longest
    # given two trials of the whole system, sensors and all, with dogs that differ
    spread = {"cruise_speed_deviation": 0.7, "speeding_up_deviation": 0.3, "slowing_down_deviation": 0.4}
    settings = [f"canine.{name}={value}" for name, value in spread.items()]
    dogs = []
    for seed in (1, 3):
        with requested("three_waypoint", Changes(settings=settings, seed=seed)) as request:
            build_missing(request)
            with prepared(request) as ready:
                trial.run(request, ready, tmp_path / str(seed))
        dog = Model(Canine, {**spread, "seed": seed})
        dog.initialize()
        dogs.append(dog)
    # when
    status, text, _ = canine(capsys, "fit", tmp_path, "--out", tmp_path / "fit", "--json")
    # then each trial tells what its dog had drawn
    result = json.loads(text)
    assert status == 0
    assert json.loads((tmp_path / "fit" / "fit.json").read_text()) == result
    drawn = {
        "cruise_speed": "trial_speed", "speeding_up": "trial_speeding_up", "drift": "trial_drift",
        "slowing_down": "trial_slowing_down", "left_turn_rate": "trial_left_rate",
        "right_turn_rate": "trial_right_rate",
    }  # fmt: skip
    scales = {statistic.key: statistic.scale for statistic in STATISTICS}
    told = 0
    for seed, dog, row in zip((1, 3), dogs, result["trials"], strict=True):
        assert row["log"] == f"{seed}/trial.mcap"
        for key, state in drawn.items():
            if key in row:
                assert row[key] == pytest.approx(dog[state] * scales[key], rel=1e-6), (seed, key)
                told += 1
    assert told >= 9  # of 12: not every dog was turned to both sides, or cruised
    assert (tmp_path / "fit" / "fit.png").read_bytes().startswith(b"\x89PNG")
    assert tomllib.loads((tmp_path / "fit" / "fit.toml").read_text())["parameters"] == result["parameters"]

    # and the estimate tells nearly the same, in the terminal
    status, text, _ = canine(
        capsys, "fit", tmp_path / "1", "--source", "estimator", "--out", tmp_path / "fit"
    )
    assert status == 0
    assert text.startswith("1 trial (estimator)")
    assert text.splitlines()[-1].endswith("fit.json, fit.png, fit.toml")
    told_by_estimate = json.loads((tmp_path / "fit" / "fit.json").read_text())["trials"][0]
    for key, tolerance in (("cruise_speed", 0.02), ("speeding_up", 0.1), ("drift", 0.1)):
        assert told_by_estimate[key] == pytest.approx(result["trials"][0][key], rel=tolerance)


def test_wrong_use_ends_with_status_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, error = canine(capsys, "fit", tmp_path / "nowhere")
    assert status == 2
    assert error.splitlines()[-1] == (
        f'canine: there is no log "{tmp_path}/nowhere"; expected a trial.mcap, or a folder that holds some'
    )
    assert canine(capsys, "fit")[0] == 2
    assert canine(capsys, "fit", tmp_path, "--source", "gps")[0] == 2


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write(tmp_path / "t.mcap", columns())
    (tmp_path / "file").touch()
    status, _, error = canine(capsys, "fit", log, "--out", tmp_path / "file" / "x")
    assert status == 2
    assert error.splitlines()[-1] == (
        f"canine: --out {tmp_path}/file/x: the folder cannot be made (Not a directory); choose another folder"
    )
