"""The commands to the animal and the status of a trial, which blocks exchange."""

from __future__ import annotations

from enum import IntEnum


class Command(IntEnum):
    """What the controller tells the animal (Table 4.1)."""

    NONE = 0
    FORWARD = 1
    STOP = 2
    RECALL = 3
    LEFT = 4
    RIGHT = 5


class Status(IntEnum):
    """How the trial stands."""

    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILED = 3
    STOPPED = 4


ENDS = frozenset({int(Status.SUCCESS), int(Status.FAILED), int(Status.STOPPED)})  # of a trial
