"""What happens in a trial, in words: changes of the controller's outputs."""

from __future__ import annotations

from harness.log.log import named
from models.commands import Command, Status
from models.modes import Anomaly

OUTPUTS = ("status", "command", "waypoint", "anomaly")


def in_words(output: str, value: float) -> str | None:
    """What the new value of one of `OUTPUTS` means; None if it only returns to none."""
    match output:
        case "command":
            return f"command {named(Command, value)}"
        case "status":
            return f"trial {named(Status, value)}"
        case "waypoint" if value:
            return f"waypoint {value:g} reached"
        case "anomaly" if value:
            return f"anomaly {named(Anomaly, value)}"
        case _:
            return None
