"""What a vest plays, measured tick by tick from its tones and vibrators alone."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby, pairwise

from models.commands import Command
from models.kit.timing import TICK

DIRECTIONS = (Command.LEFT, Command.RIGHT)
TONES = (Command.FORWARD, Command.STOP, Command.RECALL)


def seconds(played: Sequence[Command], *commands: Command) -> float:
    """How long these were played."""
    return sum(command in commands for command in played) * TICK


def issues(played: Sequence[Command]) -> int:
    """How often a vibration begins, or goes to the other side."""
    return sum(after in DIRECTIONS and after != before for before, after in pairwise([Command.NONE, *played]))


def longest(played: Sequence[Command], *commands: Command) -> float:
    """The longest of these at a stretch [s]."""
    lasts = (sum(1 for _ in same) for command, same in groupby(played) if command in commands)
    return max(lasts, default=0) * TICK


def most_within(window: float, played: Sequence[Command], *commands: Command) -> float:
    """The most of these in any interval of that length [s]."""
    length, most, now = round(window / TICK), 0, 0
    for k, command in enumerate(played):
        now += command in commands
        if k >= length:
            now -= played[k - length] in commands
        most = max(most, now)
    return most * TICK


def silent_from(played: Sequence[Command]) -> float:
    """The time after which nothing is played any more [s]."""
    return max((k + 1 for k, command in enumerate(played) if command), default=0) * TICK


def phases(played: Sequence[Command]) -> list[tuple[str, float]]:
    """The commands in turn, and how long each lasts [s]."""
    return [(command.name, round(sum(1 for _ in same) * TICK, 2)) for command, same in groupby(played)]
