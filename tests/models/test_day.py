"""The dog through its day: what tires it, what it gets used to, what rest and reward give back."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.canine import Canine
from models.commands import Command
from models.day import BOUNDS, CanineAllDay, rested
from models.kit.model import Model
from models.kit.random import start_state, uniform
from models.kit.timing import TICK as TS
from models.streets import CanineInStreets
from models.system import BLOCKS, PLANTS

FOR_EVER = 1e7  # s: nothing fades
UNAFFECTED = {"fatigue_slows": 0, "fatigue_delays": 0, "fatigue_disobeys": 0, "habituation_gain": 0}
STRAIGHT = {"shaking": 0, "drift": 0.0, "drift_deviation": 0.0}
LASTING = {"fatigue_time": FOR_EVER, "habituation_time": FOR_EVER}


def dog(**parameters: float) -> Model:
    model = Model(CanineAllDay, STRAIGHT | parameters)
    model.initialize()
    return model


def tell(model: Model, command: Command, ticks: int = 1) -> None:
    model["command"] = command
    for _ in range(ticks):
        model.step()


@pytest.mark.parametrize("plain", [Canine, CanineInStreets])
def test_a_day_without_effects_is_of_the_dog_itself(native: Callable[..., Any], plain: Any) -> None:
    # given the dog, and the dog of a day that neither fatigue nor habituation changes, with all that draws
    drawing = {
        "seed": 7, "start_heading_deviation": 0.2, "cruise_speed_deviation": 1.49, "slip_wander": 0.1,
        "jolt_rate": 0.3, "response_delay": 0.1, "bumper_search_max": 3,
    }  # fmt: skip
    commands = np.repeat([1, 2, 5, 1, 2, 4, 1, 3], 60).astype(float)
    tired = {"start_fatigue": 0.5}
    rows, unaffected, affected = (
        native(block, "double", parameters).run(command=commands)
        for block, parameters in (
            (plain, drawing),
            (CanineAllDay, drawing | tired | UNAFFECTED),
            (CanineAllDay, drawing | tired),
        )
    )
    # then all outputs have the same bits, which they have not with the effects
    for name in plain.flat_names("output"):
        assert rows[name].tobytes() == unaffected[name].tobytes(), name
    assert rows["north"].tobytes() != affected["north"].tobytes()
    assert PLANTS["canine_all_day"] is CanineAllDay in BLOCKS


def test_fatigue_grows_by_the_way_run() -> None:
    # given a dog of which 200 m take 63 %, when it runs for 40 s without fading
    model = dog(fatigue_way=200.0, fatigue_slows=0.0, **LASTING)
    tell(model, Command.FORWARD, 1000)
    # then what is missing to 1 falls exponentially with its way; steps of 0.2 m err by 0.05 %
    way = model["north"]
    assert way == pytest.approx(187.8, abs=0.1)
    assert 1 - model["fatigue"] == pytest.approx(math.exp(-way / 200), rel=1e-3)


def test_a_tired_dog_is_slower() -> None:
    model = dog(start_fatigue=0.6, fatigue_slows=0.5, fatigue_way=1e7, **LASTING)
    tell(model, Command.FORWARD, 200)
    assert model["speed"] == pytest.approx(4.86 * (1 - 0.5 * 0.6), rel=1e-4)


def test_a_tired_dog_responds_later() -> None:
    # given a delay of 0.1 s and half of 0.36 s more: 0.28 s are 7 ticks
    model = dog(start_fatigue=0.5, response_delay=0.1, fatigue_delays=0.36, **LASTING)
    tell(model, Command.FORWARD, 7)
    assert model["speed"] == 0
    tell(model, Command.FORWARD, 2)
    assert model["speed"] > 0


def test_it_obeys_a_vibration_with_the_shares_that_fatigue_and_habituation_leave() -> None:
    # given what is left of a success rate of 0.6
    left = 0.6 * (1 - 0.5 * 0.4) * (1 - 0.25)
    obeyed = 0
    for seed in range(1, 120):
        model = dog(
            seed=seed, start_fatigue=0.4, start_habituation=0.25, fatigue_disobeys=0.5, right_success=0.6,
            **LASTING,
        )  # fmt: skip
        tell(model, Command.RIGHT)
        # then it obeys exactly when its draw is below that
        draw, _ = uniform(start_state(seed, 1))
        assert model["obeys_right"] == (float(draw) <= left), seed
        obeyed += int(model["obeys_right"])
    assert 25 < obeyed < 65


def test_it_gets_used_to_vibrations_beyond_the_free_ones() -> None:
    # given a gain of 0.4 and two free vibrations
    model = dog(habituation_gain=0.4, free_vibrations=2, **LASTING)
    left = []
    for command in (Command.RIGHT, Command.LEFT, Command.RIGHT, Command.LEFT):
        tell(model, command, 10)
        tell(model, Command.STOP, 5)
        left.append(1 - model["habituation"])
    # then the third is obeyed by 0.6 of those that would have obeyed, the fourth by 0.36
    assert left == pytest.approx([1, 1, 0.6, 0.36], rel=1e-4)


def test_a_vibration_that_goes_on_is_one_vibration() -> None:
    model = dog(free_vibrations=0)
    tell(model, Command.RIGHT, 75)
    assert model["felt"] == 1


def test_rest_is_what_the_ticks_of_a_dog_that_stands_do() -> None:
    # given a tired dog that stands for a minute
    model = dog(start_fatigue=0.7, start_habituation=0.3, fatigue_time=100.0, habituation_time=40.0)
    tell(model, Command.STOP, 1500)
    # then it is as the closed form says; the outputs of a tick are of its beginning
    times = {"fatigue_time": 100.0, "habituation_time": 40.0}
    assert (model["tired"], model["accustomed"]) == pytest.approx(
        rested(0.7, 0.3, 0, 1500 * TS, times), rel=1e-11
    )
    # and the rest of e^(-time / constant), but for the length of a tick
    assert model["tired"] == pytest.approx(0.7 * math.exp(-60 / 100), rel=1e-3)
    assert model["accustomed"] == pytest.approx(0.3 * math.exp(-60 / 40), rel=1e-3)


def test_a_reward_takes_its_share_of_the_habituation_of_those_that_get_it() -> None:
    fatigue, habituation = rested(
        np.array([0.5, 0.5]), np.array([0.4, 0.4]), np.array([True, False]), 0.0, {"reward_relief": 0.75}
    )
    assert fatigue.tolist() == [0.5, 0.5]
    assert habituation == pytest.approx([0.1, 0.4])


def test_rest_of_an_animal_without_parameters_is_that_of_the_declared_ones() -> None:
    times = {"fatigue_time": 3600.0, "habituation_time": 1800.0, "reward_relief": 0.5}
    assert rested(0.5, 0.4, 1, 600, {}) == rested(0.5, 0.4, 1, 600, times)


def test_the_bound_of_the_slowing_is_the_published_spread() -> None:
    # given speeds that fall evenly: a uniform distribution, whose half-width is sqrt(3) deviations
    half = math.sqrt(3) * 1.49
    assert BOUNDS["fatigue_slows"].most == pytest.approx(1 - (4.86 - half) / (4.86 + half), abs=0.005)
    # and of the disobedience: from 100 % evenly to what makes a mean of 62 %
    assert BOUNDS["fatigue_disobeys"].most == pytest.approx(1 - (2 * 0.62 - 1), abs=0.005)
    # all defaults are within their bounds
    for name, bound in BOUNDS.items():
        assert 0 < CanineAllDay.variables()[name].start[0] <= bound.most, name


@settings(max_examples=40, deadline=None)
@given(
    st.dictionaries(st.sampled_from(["start_fatigue", "start_habituation"]), st.floats(0, 1)),
    st.tuples(st.floats(1, 1e7), st.floats(0, 1), st.floats(0, 1e3)),
    st.lists(st.integers(0, 5), min_size=1, max_size=30),
)
def test_no_day_takes_its_states_out_of_their_range(
    native: Callable[..., Any],
    start: dict[str, float],
    drawn: tuple[float, float, float],
    commands: list[int],
) -> None:
    names = ("fatigue_way", "habituation_gain", "cruise_speed")
    parameters = dict(zip(names, drawn, strict=True)) | {"free_vibrations": 0}
    model = native(CanineAllDay, "double", start | parameters)
    rows = model.run(command=np.repeat(np.array(commands, dtype=float), 25))
    for name in ("fatigue", "habituation", "tired", "accustomed"):
        assert np.all((rows[name] >= 0) & (rows[name] <= 1)), name
    assert all(np.isfinite(rows[name]).all() for name in CanineAllDay.flat_names("output"))
