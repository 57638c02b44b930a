"""The pedestrian obeys at once and leaves nothing to chance."""

from __future__ import annotations

import math

import pytest

from models.commands import Command
from models.kit.declaration import Stream
from models.kit.model import Model
from models.kit.timing import TICK as TS
from models.pedestrian import Pedestrian


def person(**parameters: float) -> Model:
    model = Model(Pedestrian, parameters)
    model.initialize()
    return model


def tell(model: Model, command: Command, ticks: int) -> None:
    model["command"] = command
    for _ in range(ticks):
        model.step()


def test_the_pedestrian_walks_from_the_first_tick_and_brakes_to_a_stand() -> None:
    model = person()
    tell(model, Command.FORWARD, 1)
    assert model["speed"] == pytest.approx(2.0 * TS)
    assert model["acceleration"] == pytest.approx(2.0)
    tell(model, Command.FORWARD, 49)
    assert model["speed"] == 1.4
    # 2 s: 0.7 s of ramp make 0.49 m, 1.3 s at 1.4 m/s make 1.82 m
    assert model["north"] == pytest.approx(0.49 + 1.82, abs=1e-3)
    assert model["east"] == 0
    for command in (Command.STOP, Command.NONE):
        tell(model, Command.FORWARD, 50)
        tell(model, command, 18)
        assert model["speed"] == 0
        assert model["acceleration"] == pytest.approx(-1.0)  # the last 0.04 m/s in the 18th tick


@pytest.mark.parametrize(("command", "sign"), [(Command.RIGHT, 1), (Command.LEFT, -1)])
def test_the_pedestrian_turns_at_once_and_only_while_commanded(command: Command, sign: int) -> None:
    model = person()
    tell(model, command, 1)
    assert model["heading"] == pytest.approx(sign * math.radians(60) * TS)
    assert model["yaw_rate"] == pytest.approx(sign * math.radians(60))
    tell(model, command, 24)
    assert model["heading"] == pytest.approx(sign * math.radians(60))
    tell(model, Command.STOP, 10)
    assert model["heading"] == pytest.approx(sign * math.radians(60))
    assert (model["north"], model["east"], model["yaw_rate"]) == (0, 0, 0)


def test_on_recall_the_pedestrian_walks_back_to_the_start() -> None:
    model = person(start_east=3.0, start_heading=math.pi / 2)
    tell(model, Command.FORWARD, 100)
    tell(model, Command.STOP, 20)
    away = model["east"]
    tell(model, Command.RECALL, 50)
    assert abs(model["heading"]) == pytest.approx(math.pi / 2)
    assert model["heading"] < 0
    assert model["east"] == pytest.approx(away - (0.49 + 1.82), abs=1e-3)


def test_the_pedestrian_has_a_level_pack_and_draws_nothing() -> None:
    model = person()
    tell(model, Command.FORWARD, 30)
    assert (model["pitch"], model["roll"]) == (0, 0)
    assert not [v for v in Pedestrian.variables().values() if isinstance(v, Stream)]
