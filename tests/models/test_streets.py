"""The dog among streets and poles: walls that hold and never trap, crossings, and what it fancies."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.canine import Canine
from models.commands import Command
from models.kit.model import Model
from models.kit.random import start_state, uniform
from models.kit.timing import TICK as TS
from models.streets import MAX_STREETS, CanineInStreets
from models.system import BLOCKS, PLANTS

DEG = math.pi / 180
CALM = {
    "shaking": 0, "drift": 0.0, "drift_deviation": 0.0, "right_turn_rate_deviation": 0.0,
    "left_turn_rate_deviation": 0.0, "left_success": 1.0, "right_success": 1.0,
}  # fmt: skip
Segment = tuple[float, float, float, float, float]  # north, east, end north, end east, half-width
NORTH: Segment = (0.0, 0.0, 200.0, 0.0, 1.0)
CROSSED = (NORTH, (30.0, -50.0, 30.0, 50.0, 1.0))  # by a street from west to east, 30 m north


def laid(*streets: Segment) -> dict[str, float]:
    """The parameters of some streets."""
    names = ("north", "east", "end_north", "end_east", "half_width")
    return {"street_count": float(len(streets))} | {
        f"street_{name}[{i}]": value
        for i, street in enumerate(streets, start=1)
        for name, value in zip(names, street, strict=True)
    }


def stood(*poles: tuple[float, float]) -> dict[str, float]:
    """The parameters of some poles."""
    return {"pole_count": float(len(poles))} | {
        f"pole_{name}[{i}]": value
        for i, pole in enumerate(poles, start=1)
        for name, value in zip(("north", "east"), pole, strict=True)
    }


def dog(**parameters: float) -> Model:
    model = Model(CanineInStreets, CALM | parameters)
    model.initialize()
    return model


def tell(model: Model, command: Command, seconds: float) -> None:
    model["command"] = command
    for _ in range(round(seconds / TS)):
        model.step()


def beyond(north: Any, east: Any, streets: Sequence[Segment]) -> Any:
    """How far a place is outside of the union of the streets, by plane geometry; negative inside."""
    place, outside = np.asarray(north) + 1j * np.asarray(east), []
    for n, e, end_n, end_e, half_width in streets:
        start, way = complex(n, e), complex(end_n - n, end_e - e)
        share = np.clip(((place - start) / way).real, 0, 1) if way else 0.0
        outside.append(np.abs(place - start - share * way) - half_width)
    return np.min(outside, axis=0)


def test_without_streets_and_poles_it_is_the_dog_itself(native: Callable[..., Any]) -> None:
    # given the dog and the dog in streets that there are not, with all that draws
    drawing = {
        "seed": 7, "start_heading_deviation": 0.2, "cruise_speed_deviation": 1.49, "slip_wander": 0.1,
        "jolt_rate": 0.3, "stride_deviation": 0.1, "bumper_search_max": 3,
    }  # fmt: skip
    commands = np.repeat([1, 2, 5, 1, 2, 4, 1, 3], 60).astype(float)
    plain, other = (
        native(block, "double", drawing).run(command=commands) for block in (Canine, CanineInStreets)
    )
    # then all outputs have the same bits
    for name in Canine.flat_names("output"):
        assert plain[name].tobytes() == other[name].tobytes(), name
    assert CanineInStreets in BLOCKS
    assert PLANTS["canine_in_streets"] is CanineInStreets


@pytest.mark.parametrize("drift", [-40, -20, 5, 20, 40])
def test_a_dog_with_a_strong_drift_stays_in_its_street_and_arrives(
    native: Callable[..., Any], drift: float
) -> None:
    # given a dog whose heading drifts, in a street of 4 m that goes north
    street = (0.0, 0.0, 100.0, 0.0, 2.0)
    drifting, ahead = {"drift": drift * DEG, "drift_deviation": 0}, np.full(1000, float(Command.FORWARD))
    # when it runs for 40 s
    rows = native(CanineInStreets, "double", drifting | laid(street)).run(command=ahead)
    # then it is never farther out than rounding, leans on the wall by drift / gain, and comes to the end
    assert np.max(beyond(rows["north"], rows["east"], [street])) < 1e-9
    assert rows["north"].max() > 100
    assert rows["heading"][400] == pytest.approx(drift * DEG / 2, rel=1e-3)
    # while in the open it would go round in circles
    free = native(CanineInStreets, "double", drifting).run(command=ahead)
    assert free["north"].max() < 1.1 * 4.86 / (abs(drift) * DEG) + 5 < 100


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(-40, 40)] * 4, st.floats(0.3, 5)), min_size=1, max_size=MAX_STREETS),
    st.integers(0, 2**31 - 1),
    st.floats(-math.pi, math.pi),
    st.lists(st.sampled_from([1, 2, 4, 5]), min_size=1, max_size=8),
)
def test_no_command_leads_it_out_of_any_streets(
    native: Callable[..., Any], streets: list[Segment], seed: int, heading: float, commands: list[int]
) -> None:
    start = {"start_north": streets[0][0], "start_east": streets[0][1], "start_heading": heading}
    model = native(CanineInStreets, "double", {"seed": seed, "drift": 0.3} | start | laid(*streets))
    rows = model.run(command=np.repeat(commands, 75).astype(float))
    assert np.max(beyond(rows["north"], rows["east"], streets)) < 1e-9
    assert all(np.isfinite(rows[name]).all() for name in CanineInStreets.flat_names("output"))
    # and no step is longer than that of the faster of the speeds before and after it
    step = np.hypot(np.diff(rows["north"]), np.diff(rows["east"]))
    assert np.all(step <= (np.maximum(rows["speed"][1:], rows["speed"][:-1]) + 1.78 * TS) * TS + 1e-9)


@pytest.mark.parametrize("degrees", [*range(-180, 181, 15), 90.001, 89.999])
@pytest.mark.parametrize("side", [-1.0, 0.0, 1.0])
def test_a_wall_never_traps_it(degrees: float, side: float) -> None:
    # given a dog that stands in a long street, at a wall or between the walls, whatever it looks at
    street = (-500.0, 0.0, 500.0, 0.0, 1.0)
    model = dog(start_east=side, start_heading=degrees * DEG, **laid(street))
    # when it runs for 6 s: in the open 4.86 m/s is reached in 2.7 s, and it comes 22.5 m far
    tell(model, Command.FORWARD, 6)
    # then it has come along the street by all but what turning took
    assert abs(model["north"]) > 15
    assert model["speed"] == pytest.approx(4.86, rel=0.02)


def test_at_a_wall_it_keeps_the_speed_along_the_wall() -> None:
    # given a dog that does not turn by itself, runs 30 deg off the street's direction, and meets the wall
    model = dog(start_heading=30 * DEG, street_gain=0, speeding_up=200, **laid(NORTH))
    tell(model, Command.FORWARD, TS)
    model["speeding_up"] = model["trial_speeding_up"] = 1.78
    assert model["speed"] == pytest.approx(4.86)
    while model["east"] < 1 - 1e-12:
        tell(model, Command.FORWARD, TS)
    # then the wall leaves it its own part of the speed, and from the next tick on the course is the wall's
    assert model["speed"] == pytest.approx(4.86 * math.cos(30 * DEG))
    for _ in range(10):
        north = model["north"]
        tell(model, Command.FORWARD, TS)
        assert model["speed"] == pytest.approx(4.86 * math.cos(30 * DEG))
        assert model["north"] - north == pytest.approx(4.86 * math.cos(30 * DEG) * TS, rel=0.01)
        assert model["slip"] == pytest.approx(-30 * DEG)
        assert model["heading"] == pytest.approx(30 * DEG)
        assert model["east"] == pytest.approx(1, abs=1e-12)


def test_an_accelerometer_feels_the_wall_once() -> None:
    # given a dog that drifts to the left; it slides along the right wall and then runs on between the walls
    model = dog(start_east=0.8, start_heading=70 * DEG, drift=-5 * DEG, **laid(NORTH))
    felt, slipped = [], []
    for _ in range(200):
        tell(model, Command.FORWARD, TS)
        felt.append(model["slip_acceleration"])
        slipped.append(model["slip"])
    # then it slips while it slides; two ticks after the last slip nothing is left of its acceleration
    sliding = np.flatnonzero(slipped)
    assert len(sliding) > 3
    assert np.flatnonzero(felt).min() == sliding.min()
    assert np.flatnonzero(felt).max() <= sliding.max() + 1
    assert slipped[-1] == felt[-1] == 0


@pytest.mark.parametrize(
    ("degrees", "rate"),
    [
        (10, -20),
        (-10, 20),
        (25, -50),
        (40, -60),
        (-40, 60),
        (44, -60),
        (170, 20),
        (-175, -10),
        (60, -60),
        (100, 60),
    ],
)
def test_it_turns_towards_a_street_in_proportion_up_to_a_bound(degrees: float, rate: float) -> None:
    # given a wide street to the north, gain 2 1/s, bound 60 deg/s, and a dog in its middle
    model = dog(start_north=100, start_heading=degrees * DEG, **laid((0, 0, 200, 0, 50)))
    tell(model, Command.STOP, TS)
    assert model["heading"] == pytest.approx(degrees * DEG)  # at rest it does not turn
    tell(model, Command.FORWARD, TS)
    assert model["yaw_rate"] == pytest.approx(rate * DEG, abs=1e-9)


@pytest.mark.parametrize(
    ("degrees", "north", "east"), [(60, 30, 20), (120, 30, 20), (-60, 30, -20), (40, 50, 0)]
)
def test_in_a_crossing_it_goes_where_it_looks(degrees: float, north: float, east: float) -> None:
    # given a dog that stands in the crossing and looks within 45 deg of one of the streets' ways
    model = dog(start_north=30, start_heading=degrees * DEG, **laid(*CROSSED))
    tell(model, Command.FORWARD, 6)
    # then it goes there, within the street
    assert abs(model["north"] - north) < 5
    assert abs(model["east"] - east) < 5
    assert beyond(model["north"], model["east"], CROSSED) < 1e-9
    assert not (model["north"] > 35 and model["east"] > 5)


@pytest.mark.parametrize("stopped", [28.0, 32.5])
def test_a_stop_before_or_beyond_a_crossing_misses_it(stopped: float) -> None:
    # given a dog that sits 2 m before, or 2.5 m beyond the middle of a crossing 1 m wide to either side
    model = dog(start_north=stopped, start_heading=0, right_turn_rate=90 * DEG, **laid(*CROSSED))
    # when it is turned by 90 deg to the right, and sent ahead
    tell(model, Command.RIGHT, 1 + TS)
    assert model["heading"] > 85 * DEG
    tell(model, Command.FORWARD, 5)
    # then it faces a wall, and goes along it instead
    assert abs(model["east"]) <= 1
    assert abs(model["north"] - stopped) > 10


def test_it_runs_straight_through_a_crossing_whatever_the_drift() -> None:
    model = dog(drift=5 * DEG, **laid(*CROSSED))
    tell(model, Command.FORWARD, 12)
    assert model["north"] > 45
    assert abs(model["east"]) <= 1


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("half_width", [1.0, 3.0])
def test_streets_end_to_end_are_run_as_one(half_width: float, turned: bool) -> None:
    # given a street in two parts, the second written from either end, and the same in one
    second = (200.0, 0.0, 30.0, 0.0, half_width) if turned else (30.0, 0.0, 200.0, 0.0, half_width)
    parts = laid((0.0, 0.0, 30.0, 0.0, half_width), second)
    whole = laid((0.0, 0.0, 200.0, 0.0, half_width))
    models = [dog(drift=5 * DEG, start_heading=3 * DEG, **streets) for streets in (parts, whole)]
    # when it runs along it and back
    for turn, seconds in ((0.0, 12), (180 * DEG, 10)):
        for model in models:
            model["body_heading"] += turn
        for _ in range(round(seconds / TS)):
            for model in models:
                tell(model, Command.FORWARD, TS)
            # then the joint changes nothing, but for two ticks by the wall of the first one's round end
            for name in ("north", "east", "heading", "speed"):
                assert models[0][name] == pytest.approx(models[1][name], abs=0.05)
        assert (models[0]["north"] > 50) == (turn == 0)
    assert models[0]["north"] < 20


@pytest.mark.parametrize("half_width", [1.0, 3.0])
@pytest.mark.parametrize("bend", [-60, -45, -20, 0, 20, 45, 60])
def test_a_bend_within_the_cone_and_a_little_more_is_taken_at_a_run(bend: float, half_width: float) -> None:
    # given two streets whose directions differ where one ends and the other begins
    end = (30 + 100 * math.cos(bend * DEG), 100 * math.sin(bend * DEG))
    streets = ((0.0, 0.0, 30.0, 0.0, half_width), (30.0, 0.0, *end, half_width))
    model = dog(start_heading=0, **laid(*streets))
    tell(model, Command.FORWARD, 4)
    slowest, was_in = model["speed"], [model["street"]]
    for _ in range(200):
        tell(model, Command.FORWARD, TS)
        slowest = min(slowest, model["speed"])
        was_in.append(model["street"])
        assert beyond(model["north"], model["east"], streets) < 1e-9
    # then it loses no more than a wall takes of its speed
    assert slowest > 0.99 * model["cruise_speed"] * math.cos(bend * DEG)
    assert math.hypot(model["north"] - 30, model["east"]) > 20
    # and it changes once
    assert np.count_nonzero(np.diff(was_in)) == 1


@pytest.mark.parametrize("bend", [70, 90])
def test_a_bend_beyond_that_is_waited_at(bend: float) -> None:
    end = (30 + 100 * math.cos(bend * DEG), 100 * math.sin(bend * DEG))
    model = dog(start_heading=0, **laid((0.0, 0.0, 30.0, 0.0, 1.0), (30.0, 0.0, *end, 1.0)))
    tell(model, Command.FORWARD, 12)
    assert math.hypot(model["north"] - 30, model["east"]) < 1.001
    assert model["speed"] < 0.5
    # until it is turned
    tell(model, Command.RIGHT, 1)
    tell(model, Command.FORWARD, 6)
    assert math.hypot(model["north"] - 30, model["east"]) > 10


@pytest.mark.parametrize("turn", [0, 15, 40])
@pytest.mark.parametrize("radius", [6, 12, 30])
@pytest.mark.parametrize("corners", [6, 8])
def test_a_round_of_streets_is_run_again_and_again(corners: int, radius: float, turn: float) -> None:
    # given a regular polygon of streets, whose bends of 60 or 45 deg are wider than the cone or as wide
    places = [radius * np.exp(1j * (i * 360 / corners + turn) * DEG) for i in range(corners + 1)]
    streets = tuple((a.real, a.imag, b.real, b.imag, 1.0) for a, b in itertools.pairwise(places))
    middle, way = (places[0] + places[1]) / 2, places[1] - places[0]
    model = dog(
        start_north=middle.real, start_east=middle.imag, start_heading=float(np.angle(way)), **laid(*streets)
    )
    # when it runs for more than a round
    tell(model, Command.FORWARD, 2)
    angles, was_in = [], []
    for _ in range(1250):
        tell(model, Command.FORWARD, TS)
        angles.append(math.atan2(model["east"], model["north"]))
        was_in.append(model["street"])
        assert model["speed"] > 0.1 * model["cruise_speed"]
    # then it never stands, and goes from each street into the next
    assert np.unwrap(angles)[-1] - angles[0] > 2 * math.pi
    assert set(np.diff(was_in) % corners) == {0, 1}


def test_a_crossing_street_beyond_the_cone_is_not_gone_into_while_its_own_goes_on() -> None:
    # given a dog that does not turn, 65 deg off its own street and 55 deg off one that crosses it obliquely
    aside = 100 * math.tan(60 * DEG)
    streets = ((-200.0, 0.0, 200.0, 0.0, 1.0), (100.0, -aside, -100.0, aside, 1.0))
    model = dog(start_north=12, start_heading=-115 * DEG, street_gain=0, **laid(*streets))
    # when it slides along the wall across that one
    for _ in range(400):
        tell(model, Command.FORWARD, TS)
        assert model["street"] == 1
    assert model["north"] < -5


def test_a_street_that_ends_here_is_not_gone_into() -> None:
    # given a dog in a street, and in the end of another, which it looks along
    streets = ((0.0, 0.0, 200.0, 0.0, 3.0), (20.0, -10.0, 30.0, 0.0, 3.0))
    model = dog(start_north=31, start_heading=40 * DEG, **laid(*streets))
    # when it runs, then it stays in its own, which goes on
    for _ in range(100):
        tell(model, Command.FORWARD, TS)
        assert model["street"] == 1
    assert model["north"] > 40


def test_recall_takes_it_home_straight_through_the_walls() -> None:
    # given a dog round a corner: 30 m north, then east
    model = dog(start_north=30, start_east=40, start_heading=90 * DEG, **laid(*CROSSED))
    model["start_north"], model["start_east"] = 0.0, 0.0
    # when it is recalled, then it comes by the straight line
    for _ in range(200):
        tell(model, Command.RECALL, TS)
        north, east = model["north"], model["east"]
        assert north * 40 == pytest.approx(east * 30, abs=1e-6)
    assert beyond(north, east, CROSSED) > 1
    # and sent ahead out there it is free, until it comes into a street
    tell(model, Command.FORWARD, 0.4)
    assert beyond(model["north"], model["east"], CROSSED) > 1


def test_a_dog_that_starts_outside_is_held_from_where_it_enters() -> None:
    model = dog(start_north=20, start_east=30, start_heading=10 * DEG, **laid(CROSSED[1]))
    tell(model, Command.FORWARD, TS)
    assert (model["north"], model["east"]) == pytest.approx((20, 30), abs=0.01)  # it was not moved
    tell(model, Command.FORWARD, 8)
    assert beyond(model["north"], model["east"], CROSSED[1:]) < 1e-9


# Poles


def fancied(seed: int, poles: dict[str, float], **parameters: float) -> int:
    """The pole that a dog fancies when it sets out."""
    model = dog(seed=seed, **poles, **parameters)
    tell(model, Command.FORWARD, TS)
    return int(model["fancied"])


def test_it_fancies_by_chance_one_of_those_that_it_sees(native: Callable[..., Any]) -> None:
    # given poles ahead, one behind, one too far away and one 31 deg off, and a chance of 0.6
    poles = stood((10, 0), (-10, 0), (26, 0), (10, -5), (10, 10 * math.tan(31 * DEG)), (20, 11))
    counts = np.zeros(7)
    for seed in range(1, 3001):
        model = native(CanineInStreets, "double", CALM | poles | {"seed": seed, "pole_chance": 0.6})
        model.run(command=[1.0])
        counts[int(model["fancied"])] += 1
    # then none with 0.4, else each of the three in sight with 0.2: all within four standard errors
    assert counts[[2, 3, 5]].tolist() == [0, 0, 0]
    for number, share in ((0, 0.4), (1, 0.2), (4, 0.2), (6, 0.2)):
        assert counts[number] / 3000 == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / 3000))


def test_what_it_fancies_is_drawn_from_a_stream_of_its_own() -> None:
    # given two poles, and a chance of 1: the first half of draws means the first
    poles = stood((20, 3), (20, -3))
    for seed in range(1, 20):
        draw, _ = uniform(start_state(seed, 14))
        assert fancied(seed, poles, pole_chance=1) == (1 if float(draw) < 0.5 else 2)
        assert fancied(seed, poles, pole_chance=0) == 0


def test_poles_shift_no_other_draw() -> None:
    # given the same dog with and without poles that it looks at again and again
    free, drawn = (
        dog(seed=5, left_success=0.5, right_success=0.5, **poles)
        for poles in ({}, stood((300, 1), (5, 5)) | {"pole_chance": 0.1, "pole_range": 1e3})
    )
    for command in (1, 5, 1, 4, 1, 5, 1, 4, 2, 3):
        for model in (free, drawn):
            tell(model, Command(command), 3)
        # then it obeys the same commands, and all other streams are where they were
        for name in CanineInStreets.flat_names("state"):
            if ("stream" in name and "fancy" not in name) or name.startswith("obeys"):
                assert free[name] == drawn[name], name
    assert drawn["fancy_stream[1]"] != free["fancy_stream[1]"]


def test_it_heads_for_a_pole_in_proportion_up_to_a_bound() -> None:
    # given a pole 20 deg to the right at a gain of 1 1/s, and another dog's at 2 1/s: bound 30 deg/s
    pole = stood((20 * math.cos(20 * DEG), 20 * math.sin(20 * DEG)))
    for gain, rate in ((1, 20), (2, 30)):
        model = dog(pole_chance=1, pole_gain=gain, speeding_up=0, **pole)
        tell(model, Command.FORWARD, TS)
        assert model["yaw_rate"] == pytest.approx(rate * DEG)
    # when it runs, then it comes to the pole, and fancies nothing that is behind it
    model = dog(pole_chance=1, **pole)
    nearest = 20.0
    for _ in range(200):
        tell(model, Command.FORWARD, TS)
        nearest = min(
            nearest, math.dist((model["north"], model["east"]), (pole["pole_north[1]"], pole["pole_east[1]"]))
        )
    assert nearest < 0.3
    assert model["fancied"] == 0


def test_another_command_ends_a_fancy_and_it_looks_up_again_when_it_sets_out() -> None:
    model = dog(pole_chance=1, **stood((20, 3)))
    tell(model, Command.FORWARD, 1)
    assert model["fancied"] == 1
    tell(model, Command.STOP, TS)
    assert model["fancied"] == 0
    tell(model, Command.FORWARD, TS)
    assert model["fancied"] == 1


def test_it_looks_up_every_so_often() -> None:
    # given a pole that comes into its range of 25 m after 1 m, and a look every 2 s
    model = dog(pole_chance=1, **stood((26, 0)))
    seen = []
    for _ in range(120):
        tell(model, Command.FORWARD, TS)
        seen.append(model["fancied"])
    # then it fancies it at the second look, 50 ticks after the first
    assert seen.index(1) == 50
