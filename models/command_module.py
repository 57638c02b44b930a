"""The command module on the vest: commands to tones and vibrations (Table 4.1)."""

from __future__ import annotations

from models.commands import Command
from models.kit.block import Block
from models.kit.declaration import Boolean, Input, Output, Parameter
from models.kit.geometry import where


class CommandModule(Block):
    """Command module: a command to the tone and the vibrators of the vest."""

    source = "Miller 2010, Table 4.1"
    precisions = ("double", "float")

    command = Input(Command, "what the animal is told", start=0)

    tone_hz = Output("Hz", "tone played, 0 for none")
    vibrate_left = Output(Boolean, "vibrator at the back left, ribs")
    vibrate_right = Output(Boolean, "vibrator at the front right, shoulder")

    forward_tone = Parameter("Hz", "tone for FORWARD", start=1500, min=0, max=2e4)
    stop_tone = Parameter("Hz", "tone for STOP", start=3500, min=0, max=2e4)
    recall_tone = Parameter("Hz", "tone for RECALL", start=9500, min=0, max=2e4)

    def answer(m) -> None:
        """Tones are for forward, stop and recall; vibrations for left and right."""
        tone = where(m.command == Command.FORWARD, m.forward_tone, 0)
        tone = where(m.command == Command.STOP, m.stop_tone, tone)
        m.tone_hz = where(m.command == Command.RECALL, m.recall_tone, tone)
        m.vibrate_left = m.command == Command.LEFT
        m.vibrate_right = m.command == Command.RIGHT
