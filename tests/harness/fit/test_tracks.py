"""The statistics of one trial, read from motion that is known exactly, that is late, and that is noisy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from harness.fit.tracks import RATES, STATISTICS, edge, measure, ramp, slope, stretches
from models.canine import Canine
from models.commands import Command
from models.kit.units import DEG
from tests.harness.fit.dogs import DOG, ESTIMATOR, PLANT, SCHOOL, TICK, commands, later, motion, times, track

# edges and slopes


def test_an_edge_is_found_where_it_was_put() -> None:
    y = np.array([1, 1, 1, 2, 3, 4, 5, 5, 5, 5], dtype=float)
    first, last = edge(np.arange(10.0), y, 1, 9)
    assert slope([(np.arange(first, last + 1.0), y[first : last + 1])]) == pytest.approx(1)
    assert (first, last) in {(2, 6), (2, 5), (3, 6), (3, 5)}  # the corners are on both sides


def test_an_edge_is_no_shorter_than_the_least() -> None:
    assert edge(np.arange(10.0), np.arange(10.0) ** 2, 9, 99) == (0, 9)


@pytest.mark.parametrize("most", [2, 8, 11, 99])
@pytest.mark.parametrize("least", [1, 2, 3])
def test_an_edge_is_the_best_of_all_by_least_squares(least: int, most: int) -> None:
    # given noise on an edge, and the squares of each line and its constants by numpy
    draw = np.random.default_rng(3)
    x = np.sort(draw.uniform(0, 12, 12))
    for _ in range(10):
        y = np.interp(x, [3, 7], [2.0, 6.0]) + 0.7 * draw.standard_normal(12)
        squares = {}
        for first in range(12 - least):
            for last in range(first + least, min(11, max(most, least)) + 1):
                line = np.polynomial.Polynomial.fit(x[first : last + 1], y[first : last + 1], 1)
                errors = [y[first : last + 1] - line(x[first : last + 1])]
                errors += [part - part.mean() for part in (y[:first], y[last + 1 :]) if len(part)]
                squares[first, last] = sum(float(error @ error) for error in errors)
        # then the edge has the least; a line of one interval fits exactly, to rounding
        assert squares[edge(x, y, least, most)] == pytest.approx(min(squares.values()), abs=1e-12)


def test_a_ramp_begins_at_the_extreme_and_ends_by_its_time() -> None:
    # given a speed that falls for 10 s, and rises for 10 s
    time = np.arange(0.0, 40.5, 0.5)
    speed = np.interp(time, [0, 10, 20], [3.0, 1.0, 4.0])
    corners = {(begin, end) for begin in (20, 21) for end in (39, 40)}
    assert ramp(time, speed, rising=True) in corners
    assert ramp(time, 4 - speed, rising=False) in corners
    # and one that rises only after 30 s, which is too late to be an answer
    late = np.interp(time, [31, 35], [1.0, 4.0])
    assert ramp(time, late, rising=True)[1] <= 60


def test_lines_share_a_slope_by_least_squares() -> None:
    # given two lines of 2 and 3 points: slope = (Sxy1 + Sxy2) / (Sxx1 + Sxx2) = (0.5 * 1 + 2 * 4) / (0.5 + 2)
    short = np.array([0.0, 1.0]), np.array([7.0, 8.0])
    long = np.array([0.0, 1.0, 2.0]), np.array([0.0, 4.0, 8.0])
    assert slope([short, long]) == pytest.approx((0.5 * 1 + 2 * 4) / 2.5)


def test_stretches_end_on_the_first_tick_of_the_next_command() -> None:
    assert stretches(np.array([1, 1, 2, 4, 4, 0.0])) == [(1, 0, 2), (2, 2, 3), (4, 3, 5), (0, 5, 5)]


def test_the_last_fresh_speed_is_held_and_is_zero_before_the_first() -> None:
    fresh = np.array([False, True, False, False, True])
    held = track(np.zeros(5), np.array([9.0, 1.0, 8.0, 7.0, 2.0]), np.zeros(5), fresh=fresh).held
    assert held.tolist() == [0, 1, 1, 1, 2]
    fresh = np.array([True, False])
    assert track(np.zeros(2), np.array([3.0, 9.0]), np.zeros(2), fresh=fresh).held.tolist() == [3, 3]


def test_angles_are_shown_in_degrees() -> None:
    shown = {statistic.key: statistic for statistic in STATISTICS}
    assert (shown["cruise_speed"].unit, shown["cruise_speed"].scale) == ("m/s", 1.0)
    assert shown["drift"].unit == "deg/s"
    assert shown["drift"].scale == pytest.approx(180 / math.pi)


def test_table_5_1_is_what_the_model_starts_with() -> None:
    declared = Canine.variables()
    deviations, counts = [], []
    for statistic in STATISTICS[:-1]:
        assert statistic.published is not None
        mean, deviation, count = statistic.published
        assert declared[statistic.key].start[0] * statistic.scale == pytest.approx(mean)
        deviations.append(deviation)
        counts.append(count)
    # which it has of velocity, acceleration, deceleration, right and left turns, and drift
    assert deviations == [1.49, 0.67, 1.31, 37.66, 41.13, 1.62]
    assert counts == [66, 73, 40, 26, 26, 35]
    for name, (rate, _) in RATES.items():
        assert declared[name].start[0] == rate
    assert [count for _, count in RATES.values()] == [45, 35]  # n of left and right


# whole trials


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


def test_drift_leaves_a_turn_alone_while_the_estimate_says_that_the_dog_stands() -> None:
    # given a drift of 30 deg/s, and a dog that turns at rest: its speed is estimated as 0.2, then 0.4 m/s
    for speed, rate in ((0.2, -80), (0.4, -110)):
        moved = motion(commands(SCHOOL), {**DOG, "drift": 30 * DEG})
        turning = moved.command == Command.LEFT
        moved.speed[turning] = speed
        assert measure(moved, ESTIMATOR).values["left_turn_rate"] / DEG == pytest.approx(rate, abs=1.5)


def test_the_body_that_turns_home_on_recall_is_no_drift() -> None:
    command = commands([(Command.FORWARD, 4.0), (Command.RECALL, 4.0)])
    moved = motion(command, DOG)
    moved.heading[110:] += math.pi  # homewards
    assert measure(moved, PLANT).values["drift"] / DEG == pytest.approx(2.5)


def test_a_recall_gives_the_cruising_speed_and_no_acceleration() -> None:
    trial = measure(motion(commands([(Command.RECALL, 5.0)]), DOG), PLANT)
    assert set(trial.values) == {"cruise_speed"}
    assert trial.values["cruise_speed"] == pytest.approx(4.1)
    assert trial.left_out == {("start_heading", "the log has no waypoint"): 1}


def test_stretches_of_all_steady_speeds_are_averaged_by_their_rows() -> None:
    # given 3 s at 4 m/s and 1 s at 2 m/s: rows after the edge's last, 75 and 25 of them
    time = times(round(4.2 / TICK))
    program = [(Command.FORWARD, 4.2), (Command.STOP, 4.0), (Command.FORWARD, 2.2), (Command.STOP, 4.0)]
    command = commands(program)
    speed = np.concatenate([
        np.minimum(4.0, 4 * time), np.maximum(4 - 4 * time[:100], 0),
        np.minimum(2.0, 2 * time[:55]), np.maximum(2 - 4 * time[:101], 0),
    ])  # fmt: skip
    trial = measure(track(command, speed, np.zeros(len(command))), PLANT)
    rows = (80, 30)  # that follow the second of acceleration, with the first of the next command
    assert trial.values["cruise_speed"] == pytest.approx(np.average([4.0, 2.0], weights=rows), abs=0.02)


def test_a_dog_that_takes_its_time_is_read_like_a_prompt_one() -> None:
    # given the same motion half a second later than the commands: what came before goes on for so long
    command = commands(SCHOOL)
    moved = motion(command, DOG)
    late = round(0.5 / TICK)
    speed = np.concatenate([np.zeros(late), moved.speed[:-late]])
    heading = np.concatenate([np.full(late, moved.heading[0]), moved.heading[:-late]])
    slow = measure(track(command, speed, heading), PLANT)
    # then
    prompt = measure(moved, PLANT)
    assert slow.values == pytest.approx(prompt.values, rel=1e-9)
    assert slow.responses == prompt.responses


@pytest.mark.parametrize("delay", [0.32, 0.52, 1.0])
@pytest.mark.parametrize("run", [2.0, 2.3, 6.0])  # s: STOP comes while it speeds up, shortly before, after
def test_a_late_dog_that_still_speeds_up_on_stop_is_read_exactly(run: float, delay: float) -> None:
    command = commands([(Command.FORWARD, run), (Command.STOP, 4.0)])
    trial = measure(later(command, DOG, delay), PLANT)
    assert trial.values["slowing_down"] == pytest.approx(2.9, rel=1e-9)
    assert trial.values["speeding_up"] == pytest.approx(1.7, rel=1e-9)


def test_a_late_dog_that_still_slows_down_when_told_to_run_is_read_exactly() -> None:
    # given a dog at 0.4 m/s as FORWARD comes, which stands 0.14 s later and starts after 0.52 s
    program = [(Command.FORWARD, 4.0), (Command.STOP, 1.8), (Command.FORWARD, 4.0)]
    late = later(commands(program), DOG, 0.52)
    assert 0.1 < late.speed[145] < 0.5
    trial = measure(late, PLANT)
    assert trial.values["speeding_up"] == pytest.approx(1.7, rel=1e-9)
    assert trial.values["cruise_speed"] == pytest.approx(4.1, rel=1e-9)


def test_a_stop_that_ends_before_a_late_dog_brakes_gives_no_deceleration() -> None:
    # given STOP for 0.4 s and dogs that obey after 0.52 s: one still speeds up, the other cruises
    for run in (2.0, 6.0):
        trial = measure(later(commands([(Command.FORWARD, run), (Command.STOP, 0.4)]), DOG, 0.52), PLANT)
        assert "slowing_down" not in trial.values
        assert trial.left_out["slowing_down", "ended before it slowed down"] == 1


def test_a_stop_from_less_than_a_source_can_tell_gives_no_deceleration() -> None:
    # given a dog that is stopped at 0.9 to 2.0 m/s
    for speed, by_truth, by_estimate in ((0.9, 0, 0), (1.0, 1, 0), (1.9, 1, 0), (2.0, 1, 1)):
        moved = motion(commands([(Command.FORWARD, 5.0), (Command.STOP, 3.0)]), {**DOG, "cruise": speed})
        for source, expected in ((PLANT, by_truth), (ESTIMATOR, by_estimate)):
            trial = measure(moved, source)
            assert ("slowing_down" in trial.values) == expected
            why = f"from less than {source.moving:g} m/s"
            assert trial.left_out["slowing_down", why] == 1 - expected


def test_a_loss_of_speed_within_the_estimates_noise_is_not_braking() -> None:
    # given dogs that lose 0.25 and 0.35 m/s under STOP
    for loss, braked in ((0.25, False), (0.35, True)):
        command = commands([(Command.FORWARD, 5.0), (Command.STOP, 4.0)])
        moved = motion(command, DOG)
        stopped = np.arange(len(command)) >= 125
        moved.speed[stopped] = np.maximum(4.1 - 0.2 * times(int(stopped.sum())), 4.1 - loss)
        assert ("slowing_down" in measure(moved, ESTIMATOR).values) == braked


def test_a_start_is_from_rest_below_half_a_metre_per_second() -> None:
    for speed, from_rest in ((0.49, True), (0.51, False)):
        command = commands([(Command.FORWARD, 5.0)])
        moved = track(command, np.minimum(speed + times(126), 4.0), np.zeros(126))
        trial = measure(moved, PLANT)
        assert ("speeding_up" in trial.values) == from_rest
        assert trial.left_out["speeding_up", "not from rest"] == 1 - from_rest
        # and STOP of a dog that was slower is not one of a moving animal
        stopped = track(commands([(Command.STOP, 5.0)]), np.maximum(speed - moved.speed, 0), np.zeros(126))
        stopped.speed[0] = speed
        reason = ("slowing_down", "from less than 1 m/s")
        assert measure(stopped, PLANT).left_out[reason] == 1 - from_rest


def test_half_a_metre_per_second_is_neither_at_rest_nor_moving() -> None:
    started = track(commands([(Command.FORWARD, 5.0)]), np.minimum(0.5 + times(126), 4.0), np.zeros(126))
    assert measure(started, PLANT).left_out["speeding_up", "not from rest"] == 1
    stopped = track(commands([(Command.STOP, 5.0)]), np.maximum(0.5 - times(126), 0.0), np.zeros(126))
    assert measure(stopped, PLANT).left_out == {("start_heading", "the log has no waypoint"): 1}


def test_a_start_must_reach_a_speed_that_the_source_can_tell() -> None:
    for cruise, by_truth, by_estimate in ((0.95, 0, 0), (1.05, 1, 0), (1.95, 1, 0), (2.05, 1, 1)):
        moved = motion(commands([(Command.FORWARD, 6.0)]), {**DOG, "cruise": cruise})
        for source, expected in ((PLANT, by_truth), (ESTIMATOR, by_estimate)):
            trial = measure(moved, source)
            assert ("speeding_up" in trial.values) == expected
            assert trial.left_out["speeding_up", f"came to less than {source.moving:g} m/s"] == 1 - expected
            assert ("cruise_speed" in trial.values) == (cruise > 1)
            assert ("drift" in trial.values) == (cruise > 1)


def test_a_steady_speed_lasts_a_second_and_a_run_for_drift_as_long() -> None:
    # given 1 s of acceleration to 4 m/s; above 1 m/s after 0.28 s
    dog = {**DOG, "up": 4.0, "cruise": 4.0}
    for length, steady, drifting in ((1.24, 0, 0), (1.28, 0, 1), (1.92, 0, 1), (1.96, 1, 1)):
        trial = measure(motion(commands([(Command.FORWARD, length)]), dog), PLANT)
        assert ("cruise_speed" in trial.values) == steady
        assert trial.left_out["cruise_speed", "ended before 1 s of steady speed"] == 1 - steady
        assert ("drift" in trial.values) == drifting
        assert trial.left_out["drift", "under way for less than 1 s"] == 1 - drifting


def test_ignored_and_slow_turns_count_as_not_obeyed_and_wrong_ones_as_obeyed() -> None:
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


def test_a_turn_counts_as_obeyed_from_the_threshold_of_its_source_on() -> None:
    still = commands([(Command.RIGHT, 3.0)])
    for source, threshold in ((PLANT, 0.1), (ESTIMATOR, 5.0)):
        for share, obeyed in ((0.98, False), (1.02, True)):
            heading = share * threshold * DEG * times(len(still))
            trial = measure(track(still, np.zeros(len(still)), heading), source)
            assert trial.responses["right_success"] == [obeyed]


def test_a_turn_shorter_than_the_source_can_tell_is_left_out() -> None:
    # given LEFT for 0.04 to 0.24 s: the estimate needs 0.2 s, the truth a tick
    for length, by_estimate in ((0.04, 0), (0.16, 0), (0.2, 1), (0.24, 1)):
        still = commands([(Command.LEFT, length)])
        moved = track(still, np.zeros(len(still)), -80 * DEG * times(len(still)))
        assert measure(moved, PLANT).responses["left_success"] == [True]
        trial = measure(moved, ESTIMATOR)
        assert trial.responses["left_success"] == [True] * by_estimate
        assert trial.left_out["left_turn_rate", "too short"] == 1 - by_estimate


def test_a_turn_that_begins_after_half_a_minute_is_too_late() -> None:
    # given LEFT for 40 s, obeyed by a quick turn after 10 s or after 32 s
    still = commands([(Command.LEFT, 40.0)])
    for begin in (10.0, 32.0):
        heading = -80 * DEG * np.clip(times(len(still)) - begin, 0, 2)
        trial = measure(track(still, np.zeros(len(still)), heading), PLANT)
        assert (trial.values["left_turn_rate"] / DEG == pytest.approx(-80)) == (begin == 10.0)


def test_a_standing_dog_that_looks_south_does_not_turn_round() -> None:
    # given a heading of 180 deg, good to 1 deg: it jumps from 180 to -180 and back
    still = commands([(Command.LEFT, 3.0)])
    heading = np.pi + DEG * np.random.default_rng(1).standard_normal(len(still))
    wrapped = np.array([math.remainder(h, 2 * math.pi) for h in heading])
    trial = measure(track(still, np.zeros(len(still)), wrapped), ESTIMATOR)
    assert trial.responses["left_success"] == [False]


def test_a_command_given_again_and_again_counts_three_times() -> None:
    still = commands([(Command.RIGHT, 3.0), (Command.NONE, 1.0)] * 7)
    trial = measure(track(still, np.zeros(len(still)), np.zeros(len(still))), PLANT)
    assert trial.responses["right_success"] == [False] * 3
    assert trial.left_out["right_success", "after the first 3 of a trial"] == 4


def test_stretches_that_show_nothing_are_left_out_with_their_reasons() -> None:
    # given a run of 1.2 s, on and off again, and a dog that is called back at once
    program = [
        (Command.FORWARD, 1.2), (Command.STOP, 0.2), (Command.FORWARD, 1.2), (Command.STOP, 0.2),
        (Command.RECALL, 0.2), (Command.STOP, 2.0), (Command.FORWARD, 0.2), (Command.STOP, 2.0),
    ]  # fmt: skip
    trial = measure(motion(commands(program), DOG), PLANT)
    # then it gathers 2.04, 3.5 (not from rest), and 0.34 m/s
    assert "cruise_speed" not in trial.values
    assert trial.left_out["cruise_speed", "ended before 1 s of steady speed"] == 3
    assert trial.left_out["cruise_speed", "came to less than 1 m/s"] == 1
    assert trial.left_out["speeding_up", "not from rest"] == 1
    assert trial.left_out["speeding_up", "came to less than 1 m/s"] == 1
    assert trial.left_out["drift", "under way for less than 1 s"] == 2
    assert trial.values["speeding_up"] == pytest.approx(1.7)
    assert trial.values["slowing_down"] == pytest.approx(2.9)


UNKNOWN = "the motion is not known throughout"


@pytest.mark.parametrize(
    ("tick", "lost"),
    [
        (50, {"drift", "cruise_speed", "speeding_up"}),  # within FORWARD
        (220, {"slowing_down"}),
        (330, {"left_turn_rate"}),
        (385, {"right_turn_rate"}),
        (360, set()),  # within NONE
        (200, {"drift", "cruise_speed", "speeding_up", "slowing_down"}),  # the last of one, first of the next
        (201, {"slowing_down"}),
    ],
)
def test_stretches_without_a_valid_estimate_are_left_out(tick: int, lost: set[str]) -> None:
    moved = motion(commands(SCHOOL), DOG)
    usable = moved.usable.copy()
    usable[tick] = False
    trial = measure(track(moved.command, moved.speed, moved.heading, usable=usable), PLANT)
    assert {key for key, reason in trial.left_out if reason == UNKNOWN} == lost
    everything = {
        "cruise_speed", "speeding_up", "slowing_down", "drift", "left_turn_rate", "right_turn_rate"
    }  # fmt: skip
    assert set(trial.values) == everything - lost


def test_an_unknown_recall_is_a_lost_cruising_speed() -> None:
    moved = motion(commands([(Command.RECALL, 5.0)]), DOG)
    moved.usable[10] = False
    assert measure(moved, PLANT).left_out["cruise_speed", UNKNOWN] == 1


def test_a_command_that_nobody_knows_is_left_alone() -> None:
    moved = motion(commands(SCHOOL), DOG)
    moved.command[moved.command == Command.NONE] = 17.0
    assert measure(moved, PLANT).values.keys() == measure(motion(commands(SCHOOL), DOG), PLANT).values.keys()


def test_the_start_heading_counts_from_the_bearing_of_the_first_waypoint() -> None:
    # given a waypoint to the south, and a dog at 175 deg, then at -170 deg: off by -5 and by 10
    for start, off in ((175, -5.0), (-170, 10.0)):
        moved = motion(commands(SCHOOL), {**DOG, "start": start * DEG})
        aimed = track(moved.command, moved.speed, moved.heading, aim=math.pi)
        assert measure(aimed, PLANT).values["start_heading"] / DEG == pytest.approx(off)


def test_the_start_is_the_first_usable_tick_with_a_command() -> None:
    # given a dog that looks round before the command, whose heading is unknown as the command comes
    command = np.array([0, 0, 1, 1, 1, 0.0])
    heading = np.array([1, 2, 3, 0.25, 0.5, 0.75])
    usable = np.array([True, True, False, True, True, True])
    aimed = track(command, np.zeros(6), heading, usable=usable, aim=0.125)
    assert measure(aimed, PLANT).values["start_heading"] == 0.125
    idle = track(np.zeros(6), np.zeros(6), heading, aim=0.0)
    assert measure(idle, PLANT).values == {}


def test_a_finer_sample_time_gives_the_same_values() -> None:
    # given 1 ms: a ramp of 2 m/s2 to 4 m/s, and 3 s of cruising
    time = 0.001 * np.arange(5001, dtype=np.float64)
    command = np.where(time < 5, float(Command.FORWARD), 0.0)
    trial = measure(track(command, np.minimum(2 * time, 4), 0.1 * time, step=0.001), PLANT)
    assert trial.values == pytest.approx({"cruise_speed": 4, "speeding_up": 2, "drift": 0.1}, rel=1e-9)


def test_a_finer_sample_time_is_read_at_the_models_tick() -> None:
    # given the same, with nonsense between the ticks
    time = 0.001 * np.arange(5001, dtype=np.float64)
    command = np.where(time < 5, float(Command.FORWARD), 0.0)
    on_tick = np.arange(5001) % 40 == 0
    speed, heading = np.where(on_tick, np.minimum(2 * time, 4), 9.0), np.where(on_tick, 0.1 * time, 1.0)
    trial = measure(track(command, speed, heading, step=0.001), PLANT)
    assert trial.values == pytest.approx({"cruise_speed": 4, "speeding_up": 2, "drift": 0.1}, rel=1e-9)


def test_a_turn_shorter_than_the_models_tick_is_read_from_its_ends() -> None:
    # given LEFT for 20 ms, 100 ms after the start of a log of 1 ms
    ticks = np.arange(200, dtype=np.float64)
    command = np.where((ticks >= 100) & (ticks < 120), float(Command.LEFT), 0.0)
    trial = measure(track(command, np.zeros(200), -0.001 * ticks, step=0.001), PLANT)
    assert trial.responses["left_success"] == [True]
    assert trial.values["left_turn_rate"] == pytest.approx(-1.0)


def test_a_command_on_the_last_tick_shows_nothing() -> None:
    command = np.array([0.0, 0.0, Command.LEFT])
    trial = measure(track(command, np.zeros(3), np.zeros(3)), PLANT)
    assert trial.responses == {"left_success": [], "right_success": []}
    assert trial.left_out == {("start_heading", "the log has no waypoint"): 1}


def test_a_turn_on_the_move_without_a_known_drift_is_read_as_it_is() -> None:
    turning = commands([(Command.LEFT, 2.0)])
    heading = -80 * DEG * times(len(turning))
    trial = measure(track(turning, np.full(len(turning), 3.0), heading), PLANT)
    assert trial.values["left_turn_rate"] / DEG == pytest.approx(-80)


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
        estimated = measure(track(moved.command, moved.speed + noise, heading, fresh=fresh), ESTIMATOR)
        truth = measure(moved, PLANT)
        assert estimated.responses == truth.responses
        for key, value in truth.values.items():
            errors.setdefault(key, []).append(estimated.values[key] - value)
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
    errors = []
    for k in range(100):
        speed = late.speed + 0.05 * draw.standard_normal(len(ticks))
        noisy = track(late.command, speed, late.heading, fresh=ticks % 6 == k % 6)
        errors.append(measure(noisy, ESTIMATOR).values["slowing_down"] - 2.9)
    # then the mean is off by no more than 3 of its errors: s sqrt(12 / n) / T of 4 fixes, by the root of 100
    expected = 0.05 * math.sqrt(12 / 4) / 0.96
    assert math.sqrt(np.mean(np.square(errors))) < 2 * expected
    assert abs(np.mean(errors)) < 3 * expected / math.sqrt(100)


def test_a_stray_fix_while_the_dog_stands_is_not_where_it_brakes_from() -> None:
    moved = motion(commands([(Command.FORWARD, 6.0), (Command.STOP, 6.0)]), DOG)
    moved.speed[250] = 6.0  # 4 s after STOP; it stands since 2.6 s
    assert measure(moved, ESTIMATOR).values["slowing_down"] == pytest.approx(2.9, rel=1e-2)


def test_a_stretch_with_one_fix_shows_no_speed() -> None:
    moved = motion(commands([(Command.FORWARD, 0.4)]), DOG)
    fresh = np.arange(len(moved.time)) == 3
    once = track(moved.command, moved.speed, moved.heading, fresh=fresh)
    assert {key for key, _ in measure(once, ESTIMATOR).left_out} == {"drift", "start_heading"}
    # while two tell that it does not run
    fresh[6] = True
    twice = track(moved.command, moved.speed, moved.heading, fresh=fresh)
    assert measure(twice, ESTIMATOR).left_out["cruise_speed", "came to less than 1 m/s"] == 1
