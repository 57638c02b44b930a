"""Table 4.1: the tone or the vibration of each command."""

from __future__ import annotations

import pytest

from models.command_module import CommandModule
from models.commands import Command
from models.kit.model import Model


@pytest.mark.parametrize(
    ("command", "tone", "left", "right"),
    [
        (Command.NONE, 0, 0, 0),
        (Command.FORWARD, 1500, 0, 0),
        (Command.STOP, 3500, 0, 0),
        (Command.RECALL, 9500, 0, 0),
        (Command.LEFT, 0, 1, 0),
        (Command.RIGHT, 0, 0, 1),
    ],
)
def test_each_command_has_its_signal(command: Command, tone: float, left: int, right: int) -> None:
    model = Model(CommandModule)
    model.initialize()
    model["command"] = command
    model.step()
    assert (model["tone_hz"], model["vibrate_left"], model["vibrate_right"]) == (tone, left, right)


def test_parameters_give_the_tones_of_appendix_a() -> None:
    """CHOICES.md: App. A has 3500, 9500 and 1500 Hz for forward, stop and recall."""
    model = Model(CommandModule, {"forward_tone": 3500, "stop_tone": 9500, "recall_tone": 1500})
    model.initialize()
    tones = []
    for command in (Command.FORWARD, Command.STOP, Command.RECALL):
        model["command"] = command
        model.step()
        tones.append(model["tone_hz"])
    assert tones == [3500, 9500, 1500]


@pytest.mark.parametrize("command", [-1, 6, 1000])
def test_an_unknown_command_is_silent(command: int) -> None:
    model = Model(CommandModule)
    model.initialize()
    model["command"] = command
    model.step()
    assert not model.output.any()
