"""The dog: its draws, responses, kinematics and delays, and the shaking of its pack."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.canine import Canine
from models.cmec import Cmec
from models.commands import Command, Status
from models.errors import ParameterError
from models.kit.model import Model
from models.kit.random import start_state, uniform
from models.kit.timing import TICK as TS
from models.pedestrian import Pedestrian

DEG = math.pi / 180
SEEDS = range(1, 2001)
CALM = {
    "shaking": 0, "drift": 0.0, "drift_deviation": 0.0, "right_turn_rate_deviation": 0.0,
    "left_turn_rate_deviation": 0.0, "left_success": 1.0, "right_success": 1.0,
}  # fmt: skip
SPREAD = {"cruise_speed_deviation": 1.49, "speeding_up_deviation": 0.67, "slowing_down_deviation": 1.31}


def dog(**parameters: float) -> Model:
    model = Model(Canine, parameters)
    model.initialize()
    return model


def tell(model: Model, command: Command, ticks: int = 1) -> dict[str, np.ndarray[Any, Any]]:
    """Outputs after each of so many ticks under a command."""
    model["command"] = command
    rows = []
    for _ in range(ticks):
        model.step()
        rows.append(model.output.copy())
    return dict(zip(Canine.flat_names("output"), np.array(rows).T, strict=True))


# Draws


@pytest.fixture(scope="module")
def draws(native: Callable[..., Any]) -> dict[str, np.ndarray[Any, Any]]:
    """The draws of 2,000 trials."""
    parameters = {"start_heading_deviation": 10 * DEG, **SPREAD}
    names = [
        "body_heading", "trial_drift", "trial_right_rate", "trial_left_rate", "trial_speed",
        "trial_speeding_up", "trial_slowing_down",
    ]  # fmt: skip
    rows = []
    for seed in SEEDS:
        model = native(Canine, "double", parameters | {"seed": seed})
        rows.append([model[name] for name in names])
    return dict(zip(names, np.array(rows).T, strict=True))


@pytest.mark.parametrize(
    ("name", "mean", "deviation"),
    [
        ("body_heading", 0, 10 * DEG),  # 5.3.3
        ("trial_drift", 2.62 * DEG, 1.62 * DEG),  # Table 5.1
        ("trial_right_rate", 57.92 * DEG, 37.66 * DEG),
        ("trial_left_rate", -77.67 * DEG, 41.13 * DEG),
    ],
)
def test_draws_have_their_stated_mean_and_deviation(
    draws: Any, name: str, mean: float, deviation: float
) -> None:
    # given n draws, the mean lies within 4 deviations/sqrt(n), the deviation within 4/sqrt(2 n)
    drawn, n = draws[name], len(SEEDS)
    assert abs(drawn.mean() - mean) < 4 * deviation / math.sqrt(n)
    assert abs(drawn.std() / deviation - 1) < 4 / math.sqrt(2 * n)
    # and a normal distribution has 68.27 % within one deviation
    assert np.mean(np.abs(drawn - mean) < deviation) == pytest.approx(0.6827, abs=4 * 0.0104)


@pytest.mark.parametrize(
    ("name", "sign", "share"), [("trial_right_rate", 1, 0.062), ("trial_left_rate", -1, 0.0295)]
)
def test_some_dogs_turn_the_wrong_way(draws: Any, name: str, sign: int, share: float) -> None:
    """CHOICES.md: 6.2 % of right, 3.0 % of left rates have the other sign."""
    wrong = np.mean(sign * draws[name] < 0)
    assert wrong == pytest.approx(share, abs=3.5 * math.sqrt(share * (1 - share) / len(SEEDS)))


@pytest.mark.parametrize(
    ("name", "mean", "deviation"),
    [("trial_speed", 4.86, 1.49), ("trial_speeding_up", 1.78, 0.67), ("trial_slowing_down", 2.72, 1.31)],
)
def test_speeds_below_a_fifth_of_their_mean_are_drawn_again(
    draws: Any, name: str, mean: float, deviation: float
) -> None:
    drawn = draws[name]
    assert drawn.min() > 0.2 * mean
    # given a normal distribution cut at a = (0.2 mean - mean)/deviation: mean + deviation phi(a)/(1 - Phi(a))
    a = -0.8 * mean / deviation
    above = 0.5 * math.erfc(a / math.sqrt(2))
    hazard = math.exp(-a * a / 2) / math.sqrt(2 * math.pi) / above
    spread = deviation * math.sqrt(1 + a * hazard - hazard**2)
    assert drawn.mean() == pytest.approx(mean + deviation * hazard, abs=4 * spread / math.sqrt(len(SEEDS)))


def test_a_speed_is_its_floor_when_every_draw_lies_below_it() -> None:
    # given a deviation so large that half of the draws fail, then some of 200 dogs take the floor: 1 in 2^4
    speeds = [dog(seed=s, cruise_speed_deviation=1e6)["trial_speed"] for s in range(1, 121)]
    assert min(speeds) == 0.2 * 4.86
    assert 1 <= sum(v == 0.2 * 4.86 for v in speeds) <= 20


def test_draws_are_independent_of_each_other(draws: Any) -> None:
    matrix = np.corrcoef(np.array(list(draws.values())))
    assert np.abs(matrix - np.eye(len(matrix))).max() < 4.5 / math.sqrt(len(SEEDS))


def test_the_same_seed_draws_the_same_and_another_seed_another() -> None:
    first, again, other = dog(seed=3), dog(seed=3), dog(seed=4)
    assert first.state.tobytes() == again.state.tobytes()
    assert first["trial_drift"] != other["trial_drift"]


def test_by_default_speed_and_accelerations_are_the_means() -> None:
    model = dog(seed=9)
    assert (model["trial_speed"], model["trial_speeding_up"], model["trial_slowing_down"]) == (
        4.86,
        1.78,
        2.72,
    )


# Responses


def stream(model: Model, side: str) -> tuple[float, ...]:
    return tuple(model[f"{side}_stream[{i}]"] for i in range(1, 7))


def test_a_response_is_drawn_once_for_each_directional_command() -> None:
    model = dog(seed=1)
    for command, draws_right, draws_left in [
        (Command.NONE, False, False),
        (Command.RIGHT, True, False),  # issued
        (Command.RIGHT, False, False),  # still on
        (Command.NONE, False, False),
        (Command.RIGHT, True, False),  # issued again
        (Command.LEFT, False, True),
        (Command.LEFT, False, False),
        (Command.RIGHT, True, False),
        (Command.STOP, False, False),
        (Command.FORWARD, False, False),
        (Command.RECALL, False, False),
        (Command.LEFT, False, True),
    ]:
        right, left = stream(model, "right"), stream(model, "left")
        tell(model, command)
        assert (stream(model, "right") != right, stream(model, "left") != left) == (draws_right, draws_left)


@pytest.mark.parametrize(
    ("command", "response", "rate"),
    [(Command.RIGHT, "obeys_right", 0.6), (Command.LEFT, "obeys_left", 0.64)],
)
def test_responses_have_their_success_rates(
    command: Command, response: str, rate: float, native: Callable[..., Any]
) -> None:
    """Table 5.1."""
    model = native(Canine, "double", {"seed": 5})
    n = 4000
    obeys = model.run(command=np.tile([command, Command.NONE], n))[response][::2]
    assert obeys.mean() == pytest.approx(rate, abs=3.5 * math.sqrt(rate * (1 - rate) / n))


@pytest.mark.parametrize(("rate", "turned"), [(0.0, 0.0), (1.0, 57.92 * DEG * TS * 10)])
def test_a_standing_dog_turns_on_a_command_only_if_it_obeys(rate: float, turned: float) -> None:
    model = dog(**CALM | {"right_success": rate})
    outputs = tell(model, Command.RIGHT, 10)
    assert outputs["heading"][-1] == pytest.approx(turned, rel=1e-12)
    assert not outputs["speed"].any()
    assert not outputs["north"].any()


@pytest.mark.parametrize(("command", "rate"), [(Command.RIGHT, 57.92), (Command.LEFT, -77.67)])
def test_the_dog_turns_at_its_rate_while_the_command_is_on(command: Command, rate: float) -> None:
    model = dog(**CALM)
    assert tell(model, command, 25)["heading"][-1] == pytest.approx(rate * DEG, rel=1e-12)
    assert tell(model, Command.NONE, 25)["heading"][-1] == pytest.approx(rate * DEG, rel=1e-12)


# Kinematics


def test_the_dogs_speed_and_path_are_those_computed_by_hand() -> None:
    """Eq. D.9-D.11: the speed is a ramp up to cruise, the way its trapezoids."""
    # given a dog without drift that heads 30 deg, runs for 3 s and is stopped
    model = dog(**CALM, start_north=10.0, start_east=-20.0, start_heading=30 * DEG)
    assert (model["north"], model["east"], model["speed"]) == (10, -20, 0)  # outputs before the first tick
    speeds = [0.0]
    for k in range(200):
        speeds.append(min(speeds[-1] + 1.78 * TS, 4.86) if k < 75 else max(speeds[-1] - 2.72 * TS, 0.0))
    way = np.cumsum([(a + b) / 2 * TS for a, b in pairwise(speeds)])
    go, stop = tell(model, Command.FORWARD, 75), tell(model, Command.STOP, 125)
    speed, north, east, acceleration = (
        np.concatenate([go[n], stop[n]]) for n in ("speed", "north", "east", "acceleration")
    )
    # then it speeds up by 1.78 m/s2 (2.73 s to cruise), cruises, and brakes by 2.72 m/s2, tick by tick
    assert speed == pytest.approx(speeds[1:], abs=1e-12)
    assert north == pytest.approx(10 + way * math.cos(30 * DEG), abs=1e-12)
    assert east == pytest.approx(-20 + way * math.sin(30 * DEG), abs=1e-12)
    assert acceleration == pytest.approx(np.diff(speeds) / TS, abs=1e-10)
    # the whole: 4.86^2/2/1.78 m to cruise, the rest of 3 s at cruise, 4.86^2/2/2.72 m to stand
    by_hand = 4.86**2 / 2 / 1.78 + 4.86 * (3 - 4.86 / 1.78) + 4.86**2 / 2 / 2.72
    assert way[-1] == pytest.approx(by_hand, abs=0.01)
    assert speed[-1] == 0


def test_heading_drifts_only_while_the_dog_moves() -> None:
    model = dog(**CALM | {"drift": 0.1})
    assert not tell(model, Command.NONE, 50)["heading"].any()
    assert tell(model, Command.FORWARD, 50)["heading"][-1] == pytest.approx(50 * TS * 0.1)
    # braking takes 50 * 1.78 / 2.72 ticks, 32.7: it drifts in 33
    stopped = tell(model, Command.STOP, 100)
    assert np.count_nonzero(stopped["speed"]) == 32
    assert stopped["heading"][-1] == pytest.approx((50 + 33) * TS * 0.1)


@pytest.mark.parametrize("command", [Command.NONE, Command.STOP, Command.LEFT, Command.RIGHT])
def test_the_dog_brakes_to_a_stop_on_any_command_except_forward_and_recall(command: Command) -> None:
    model = dog(**CALM)
    tell(model, Command.FORWARD, 100)
    speed = tell(model, command, 60)["speed"]
    assert speed[0] == pytest.approx(4.86 - 2.72 * TS)
    assert np.count_nonzero(speed) == math.ceil(4.86 / 2.72 / TS) - 1
    assert speed[-1] == 0


def test_on_recall_the_dog_runs_straight_to_its_start() -> None:
    # given a dog 30 m north, 40 m east of its start
    model = dog(**CALM | {"drift": 0.1}, start_north=5.0, start_east=6.0)
    model["position_north"], model["position_east"] = 35.0, 46.0
    way = tell(model, Command.RECALL, 250)
    # then its body turns that way at 270 deg/s, and its distance falls by the way it runs, in spite of drift
    home = math.atan2(-40, -30)
    assert way["heading"][0] == pytest.approx(-270 * DEG * TS, rel=1e-12)
    assert way["heading"][math.ceil(abs(home) / (270 * DEG * TS)) :] == pytest.approx(home, rel=1e-12)
    assert np.abs(way["yaw_rate"]).max() == pytest.approx(270 * DEG)
    distance = np.hypot(way["north"] - 5, way["east"] - 6)
    run = np.cumsum(np.concatenate([[way["speed"][0] / 2], (way["speed"][1:] + way["speed"][:-1]) / 2]) * TS)
    assert distance == pytest.approx(50 - run, abs=1e-9)


def test_heading_stays_within_minus_pi_and_pi() -> None:
    model = dog(**CALM, start_heading=170 * DEG)
    heading = tell(model, Command.RIGHT, 100)["heading"]
    assert heading.min() > -math.pi
    assert heading.max() <= math.pi
    assert heading[-1] == pytest.approx((170 + 4 * 57.92 - 360) * DEG)


def test_yaw_rate_does_not_jump_where_the_heading_wraps() -> None:
    model = dog(**CALM, start_heading=170 * DEG)
    assert tell(model, Command.RIGHT, 50)["yaw_rate"] == pytest.approx(57.92 * DEG, rel=1e-9)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31 - 1),
    commands=st.lists(st.tuples(st.sampled_from(Command), st.integers(1, 60)), min_size=1, max_size=10),
)
def test_speed_is_never_negative_nor_above_cruise(seed: int, commands: list[tuple[Command, int]]) -> None:
    model = dog(seed=seed, **SPREAD)
    for command, ticks in commands:
        outputs = tell(model, command, ticks)
        assert outputs["speed"].min() >= 0
        assert outputs["speed"].max() <= model["trial_speed"]
        assert all(np.isfinite(column).all() for column in outputs.values())
        assert np.abs(outputs["heading"]).max() <= math.pi


# Why trials take longer in the field (5.3.7.1)

LATE = {"response_delay": 0.2}  # 5 ticks
DELAYS = ["response_delay", "bumper_search_min", "bumper_search_max", "start_delay"]


def search_ticks(seed: int, shortest: float, longest: float) -> int:
    """By hand: the time drawn, rounded up to ticks with a tolerance of a tenth."""
    draw, _ = uniform(ca.DM(start_state(seed, 4)))
    return math.ceil((shortest + (longest - shortest) * float(draw)) / TS - 0.1)


def trial(plant: Model) -> np.ndarray[Any, Any]:
    """Outputs after every tick of a closed loop to two waypoints and back, successful."""
    mission = {"waypoint_count": 2, "waypoint_north[1]": 35.73, "waypoint_north[2]": 35.73}
    controller = Model(Cmec, mission | {"waypoint_east[2]": 35.73})
    controller.initialize()
    controller["start"] = 1
    rows: list[np.ndarray[Any, Any]] = []
    while controller["status"] <= Status.RUNNING and len(rows) < 3000:
        for name in ("north", "east", "speed", "heading"):
            controller[name] = plant[name]
        controller.step()
        plant["command"] = controller["command"]
        plant.step()
        rows.append(plant.output.copy())
    assert controller["status"] == Status.SUCCESS
    return np.array(rows)


def test_a_dog_without_delays_obeys_at_once_as_the_pedestrian_does() -> None:
    # given a dog without chance and drift, and a person of its speeds
    calm = dog(**CALM | {"left_turn_rate": -1.0, "right_turn_rate": 1.0, "slowing_down": 1.78})
    person = Model(Pedestrian, {"walking_speed": 4.86, "walking_acceleration": 1.78, "turning_rate": 1.0})
    person.initialize()
    # then both make the same trial, to the bit
    assert np.array_equal(trial(calm), trial(person))


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_every_command_is_obeyed_later_by_the_response_delay(seed: int) -> None:
    # given commands, each on for longer than the delay of 5 ticks
    commands = [
        (Command.FORWARD, 60), (Command.STOP, 60), (Command.RIGHT, 25), (Command.NONE, 6),
        (Command.LEFT, 25), (Command.FORWARD, 9), (Command.STOP, 50), (Command.RECALL, 20),
        (Command.LEFT, 8), (Command.FORWARD, 9), (Command.RECALL, 30), (Command.STOP, 6),
    ]  # fmt: skip
    prompt, late = dog(seed=seed, shaking=0), dog(seed=seed, shaking=0, **LATE)
    rows = [
        np.hstack([np.array(list(tell(model, *c).values())) for c in commands]) for model in (prompt, late)
    ]
    # then it stands for 5 ticks, and does the same 5 ticks later
    assert rows[0][2, 0] == pytest.approx(1.78 * TS)
    assert not rows[1][:2, :5].any()
    assert not rows[1][2, :5].any()
    assert np.array_equal(rows[1][:, 5:], rows[0][:, :-5])


@pytest.mark.parametrize(
    ("delay", "ticks"),
    [(0.0, 0), (0.0039, 0), (0.0041, 1), (0.04, 1), (0.0439, 1), (0.0441, 2), (0.2, 5), (0.28, 7), (12, 300)],
)
def test_a_delay_is_rounded_up_to_ticks_with_a_tolerance_of_a_tenth(delay: float, ticks: int) -> None:
    model = dog(**CALM, response_delay=delay)
    assert np.count_nonzero(tell(model, Command.FORWARD, ticks + 2)["speed"]) == 2


def test_a_late_dog_brakes_and_turns_later_and_for_the_time_commanded() -> None:
    # given a dog that runs, by hand
    model = dog(**CALM, **LATE)
    assert list(tell(model, Command.FORWARD, 7)["speed"]) == pytest.approx([0] * 5 + [0.0712, 0.1424])
    tell(model, Command.FORWARD, 93)
    # when stopped: 5 ticks at cruise before the first of 4.86 - 2.72 * 0.04
    assert list(tell(model, Command.STOP, 6)["speed"]) == pytest.approx([4.86] * 5 + [4.7512])
    tell(model, Command.STOP, 60)
    # when commanded to turn for 10 ticks: 5 of them, and 5 after
    assert np.ptp(tell(model, Command.RIGHT, 5)["heading"]) == 0
    assert tell(model, Command.RIGHT, 5)["heading"][-1] == pytest.approx(5 * TS * 57.92 * DEG)
    assert tell(model, Command.NONE, 20)["heading"][-1] == pytest.approx(10 * TS * 57.92 * DEG)


@pytest.mark.parametrize(("on", "run"), [(1, 0), (5, 0), (6, 6), (9, 9)])
def test_a_command_withdrawn_within_its_delay_is_never_obeyed(on: int, run: int) -> None:
    model = dog(**CALM, **LATE)
    go = tell(model, Command.FORWARD, on)
    stop = tell(model, Command.NONE, 30)
    accelerating = np.diff(np.concatenate([[0.0], go["speed"], stop["speed"]])) > 0
    assert np.flatnonzero(accelerating).tolist() == list(range(5, 5 + run))


def test_each_command_has_a_delay_of_its_own() -> None:
    # given a stop for 3 ticks and then a recall, while the dog runs north: it obeys the recall alone
    model = dog(**CALM, **LATE)
    tell(model, Command.FORWARD, 100)
    speed = np.concatenate([tell(model, Command.STOP, 3)["speed"], tell(model, Command.RECALL, 5)["speed"]])
    assert speed == pytest.approx(4.86)
    assert tell(model, Command.RECALL)["heading"][0] == pytest.approx(270 * DEG * TS)


def test_a_late_dogs_response_is_drawn_when_the_command_is_issued() -> None:
    model = dog(**LATE)
    for command, side in ((Command.RIGHT, "right"), (Command.LEFT, "left")):
        changes = []
        for _ in range(8):
            before = stream(model, side)
            tell(model, command)
            changes.append(stream(model, side) != before)
        assert changes == [True] + [False] * 7


@pytest.mark.parametrize(
    ("first", "second", "rate"),
    [(Command.RIGHT, Command.LEFT, 57.92), (Command.LEFT, Command.RIGHT, -77.67)],
)
@pytest.mark.parametrize("obeyed", [0, 1])
def test_a_new_command_does_not_change_the_response_to_the_one_still_obeyed(
    first: Command, second: Command, rate: float, obeyed: int
) -> None:
    # given a dog that obeys one side alone, and a command to one side and then to the other
    right = float((first == Command.RIGHT) == bool(obeyed))
    model = dog(**CALM | {"right_success": right, "left_success": 1 - right}, **LATE)
    tell(model, first, 10)
    # then for 5 ticks more it turns by its response to the first
    assert tell(model, second, 5)["heading"][-1] == pytest.approx(obeyed * 10 * TS * rate * DEG)


@pytest.mark.parametrize("seed", range(1, 9))
def test_the_dog_searches_for_the_bumper_before_it_obeys_the_first_recall(seed: int) -> None:
    # given a dog that has been stopped 20 m away, and finds the bumper in 1 to 5 s
    model = dog(**CALM, seed=seed, bumper_search_min=1.0, bumper_search_max=5.0)
    model["position_north"] = 20.0
    ticks = search_ticks(seed, 1.0, 5.0)
    assert 25 <= ticks <= 125
    assert tell(model, Command.FORWARD)["speed"][0] > 0  # no other command waits
    assert tell(model, Command.STOP)["speed"][0] == 0
    # when recalled it stands until it has found the bumper, then goes
    searching = tell(model, Command.RECALL, ticks)
    assert not searching["speed"].any()
    assert not searching["heading"].any()
    assert tell(model, Command.RECALL)["speed"][0] == pytest.approx(1.78 * TS)
    # when recalled again it goes at once, and nothing is drawn
    after_search = stream(model, "search")
    tell(model, Command.STOP, 10)
    assert tell(model, Command.RECALL)["speed"][0] == pytest.approx(1.78 * TS)
    assert stream(model, "search") == after_search != start_state(seed, 4)


def test_after_a_recall_withdrawn_during_the_search_the_next_needs_no_search() -> None:
    model = dog(**CALM, bumper_search_min=2.0, bumper_search_max=2.0)
    assert not tell(model, Command.RECALL, 20)["speed"].any()
    assert not tell(model, Command.STOP)["speed"].any()
    assert tell(model, Command.RECALL)["speed"][0] > 0


@pytest.mark.parametrize("longest", [0.0, 1.9, 2.0])
def test_a_longest_search_below_the_shortest_is_the_shortest(longest: float) -> None:
    model = dog(**CALM, seed=6, bumper_search_min=2.0, bumper_search_max=longest)
    assert np.flatnonzero(tell(model, Command.RECALL, 52)["speed"]).tolist() == [50, 51]


def test_a_watch_started_early_delays_the_first_command_alone() -> None:
    # given half a second on the watch, 12.5 ticks, before the first command acts
    prompt, late = dog(**CALM), dog(**CALM, start_delay=0.5)
    # then it stands for 13 ticks, and makes the same trial after them
    rows = trial(late)
    assert not rows[:13].any()
    assert np.array_equal(rows[13:], trial(prompt))


def test_the_delays_of_a_command_add_up() -> None:
    # given 0.48 s on the watch, 0.2 s to respond and the search: 12 and 5 ticks, 1 to 3 s
    slow = {"start_delay": 0.48, "bumper_search_min": 1.0, "bumper_search_max": 3.0}
    model = dog(**CALM, **LATE, **slow, seed=4)
    draw, _ = uniform(ca.DM(start_state(4, 4)))
    ticks = math.ceil((0.48 + 0.2 + 1 + 2 * float(draw)) / TS - 0.1)
    assert np.flatnonzero(tell(model, Command.RECALL, ticks + 1)["speed"]).tolist() == [ticks]


@pytest.mark.parametrize("name", DELAYS)
@pytest.mark.parametrize("value", [-0.01, 10001.0, math.nan, math.inf])
def test_delays_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=rf"canine\.{name} is .*; expected a "):
        dog(**{name: value})


@pytest.mark.parametrize("name", DELAYS)
def test_delays_are_off_by_default(name: str) -> None:
    assert dog()[name] == 0


# The pack


def gait(speed: float, **parameters: float) -> dict[str, np.ndarray[Any, Any]]:
    """20 s at a constant speed."""
    model = dog(**CALM | {"shaking": 1, "cruise_speed": speed} | parameters)
    tell(model, Command.FORWARD, 200)
    return tell(model, Command.FORWARD, 500)


@pytest.mark.parametrize(
    ("speed", "acceleration", "pitch"),
    [(1.5, (10, 20), (5, 10)), (4.86, (40, 50), (40, 60))],
    ids=["walking", "running"],
)
def test_swings_of_the_pack_lie_in_the_ranges_of_appendix_b(
    speed: float, acceleration: tuple[float, float], pitch: tuple[float, float]
) -> None:
    """B.4, D.5: peak to peak, m/s2 and deg; the jerks of the pack come on top."""
    motion = gait(speed, jerk_rate=0.0)
    low, high = acceleration
    assert low <= np.ptp(motion["acceleration"]) <= high
    assert pitch[0] <= np.ptp(motion["pitch"]) / DEG <= pitch[1]
    assert motion["pitch"].mean() / DEG == pytest.approx(-8.5, abs=1.0)
    assert motion["yaw_rate"].max() / DEG == pytest.approx(70, abs=5)
    assert motion["yaw_rate"].min() / DEG == pytest.approx(-70, abs=5)


@pytest.mark.parametrize(("speed", "strides"), [(1.5, 2.0 * 20), (4.86, 2.9 * 20)])
def test_the_dog_takes_its_stated_number_of_strides(speed: float, strides: float) -> None:
    pitch = gait(speed)["pitch"] + 8.5 * DEG
    assert np.count_nonzero((pitch[1:] >= 0) & (pitch[:-1] < 0)) == pytest.approx(strides, abs=1)


def test_jerks_of_the_pack_sometimes_exceed_20_m_s2() -> None:
    """B.4: spikes over 20 m/s2 from the pack, though the walk itself stays within 7.5."""
    calm = gait(1.5, jerk_rate=0.0)["acceleration"]
    walks = [gait(1.5, seed=seed)["acceleration"] for seed in range(1, 11)]
    assert np.abs(calm).max() <= 7.5
    # in 200 s of walking 120 jerks of N(0, 8): 8 % beyond 12.5, which on top of the walk may pass 20
    assert max(np.abs(walk).max() for walk in walks) > 20
    # one chance of 0.3 a stride, 40 strides in 20 s: 12 +- 2.9
    assert all(3 <= np.count_nonzero(walk - calm) <= 22 for walk in walks)


@pytest.mark.parametrize("speed", [1.5, 4.86])
def test_the_pack_is_still_when_shaking_is_off(speed: float) -> None:
    motion = gait(speed, shaking=0)
    for name in ("acceleration", "pitch", "roll", "yaw_rate"):
        assert not motion[name].any(), name


def test_the_pack_is_still_while_the_dog_stands() -> None:
    model = dog(**CALM | {"shaking": 1, "jerk_rate": 1.0})
    tell(model, Command.FORWARD, 100)
    tell(model, Command.STOP, 60)
    still = tell(model, Command.STOP, 50)
    for name in ("acceleration", "roll", "yaw_rate"):
        assert not still[name].any(), name
    assert set(still["pitch"]) == {-8.5 * DEG}


def test_shaking_does_not_change_the_dogs_path() -> None:
    ways = []
    for shaking in (0, 1):
        model = dog(seed=8, shaking=shaking)
        ways.append(
            [tell(model, c, 60) for c in (Command.FORWARD, Command.RIGHT, Command.FORWARD, Command.RECALL)]
        )
    for still, shaken in zip(*ways, strict=True):
        for name in ("north", "east", "speed", "heading"):
            assert still[name].tobytes() == shaken[name].tobytes()
