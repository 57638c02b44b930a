"""Tone and vibrators for each command: in the loop the animal's command is read from them."""

from __future__ import annotations

from collections.abc import Mapping

from codegen.firmware.bundle import BLOCKS, settable
from models.commands import Command
from models.errors import UsageError

TONES = {"forward_tone": Command.FORWARD, "stop_tone": Command.STOP, "recall_tone": Command.RECALL}
LIMIT = 2**31  # Hz, beyond which no tone is; NaN is none either


def commands(values: Mapping[str, float]) -> dict[tuple[int, bool, bool], Command]:
    """The command by tone [Hz], left and right vibrator.

    Raises:
        UsageError: two commands sound alike, or a tone is not a whole number of Hz.
    """
    by_sound = {
        (0, False, False): Command.NONE,
        (0, True, False): Command.LEFT,
        (0, False, True): Command.RIGHT,
    }
    declared = settable(BLOCKS["command_module"])
    for name, command in TONES.items():
        tone = values.get(name, declared[name].start[0])
        played = (int(tone) if abs(tone) < LIMIT else -1, False, False)
        if played in by_sound or tone != played[0]:
            wrong = f"as for {by_sound[played].name}" if played in by_sound else "not a whole number"
            raise UsageError(
                f"command_module.{name} is {tone:g} Hz, {wrong}; "
                "expected a tone of its own, by which the animal tells commands apart"
            )
        by_sound[played] = command
    return by_sound
