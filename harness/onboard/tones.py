"""What the vest plays for each command: by it the animal's command is read in the loop."""

from __future__ import annotations

from collections.abc import Mapping

from codegen.firmware.bundle import BLOCKS, settable
from models.commands import Command
from models.errors import UsageError

TONES = {"forward_tone": Command.FORWARD, "stop_tone": Command.STOP, "recall_tone": Command.RECALL}


def commands(values: Mapping[str, float]) -> dict[tuple[int, bool, bool], Command]:
    """What the vest plays for each command.

    Raises:
        UsageError: two commands sound alike, or one is no whole number of Hz.
    """
    found = {(0, False, False): Command.NONE, (0, True, False): Command.LEFT, (0, False, True): Command.RIGHT}
    declared = settable(BLOCKS["command_module"])
    for name, command in TONES.items():
        tone = values.get(name, declared[name].start[0])
        played = (int(tone), False, False)
        if played in found or tone != played[0]:
            wrong = f"as for {found[played].name}" if played in found else "no whole number"
            raise UsageError(
                f"command_module.{name} is {tone:g} Hz, {wrong}; "
                "expected a tone of its own, since the animal hears nothing else"
            )
        found[played] = command
    return found
