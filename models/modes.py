"""What the controller is doing, and what it reports: its modes, their commands, the anomalies."""

from __future__ import annotations

from enum import IntEnum

from models.commands import Command, Status


class Mode(IntEnum):
    """What the controller is doing (Figure 4.2, and the dead period of 4.1.4.3)."""

    IDLE = 0
    FORWARD = 1
    STOP_TO_TURN = 2
    LEFT = 3
    RIGHT = 4
    DEAD = 5
    STOP_AT_WAYPOINT = 6
    RECALL = 7
    FAILURE_RECALL = 8
    SUCCESS = 9
    FAILED = 10
    STOPPED = 11


class Anomaly(IntEnum):
    """How the animal disobeys (Table 4.3), what keeps the controller from deciding, what ends a trial."""

    NONE = 0
    FORWARD_FAILURE = 1
    TURN_FAILURE = 2
    DIRECTION_SWITCH = 3
    NO_COMMAND = 4
    TRIAL_FAILURE = 5
    LOST_LINK = 6
    INVALID_ESTIMATE = 7
    BAD_INPUT = 8
    # the limits of models/safety.py
    BUDGET_SPENT = 9
    NO_PROGRESS = 10
    DEPARTING = 11
    TIME_OUT = 12
    OUTSIDE_FENCE = 13


COMMANDS = {
    Mode.FORWARD: Command.FORWARD,
    Mode.STOP_TO_TURN: Command.STOP,
    Mode.LEFT: Command.LEFT,
    Mode.RIGHT: Command.RIGHT,
    Mode.STOP_AT_WAYPOINT: Command.STOP,
    Mode.RECALL: Command.RECALL,
    Mode.FAILURE_RECALL: Command.RECALL,
    Mode.STOPPED: Command.STOP,
}
STATUSES = {
    Mode.IDLE: Status.IDLE,
    Mode.SUCCESS: Status.SUCCESS,
    Mode.FAILURE_RECALL: Status.FAILED,
    Mode.FAILED: Status.FAILED,
    Mode.STOPPED: Status.STOPPED,
}
BEFORE_RECALL = frozenset(
    {
        Mode.IDLE,
        Mode.FORWARD,
        Mode.STOP_TO_TURN,
        Mode.LEFT,
        Mode.RIGHT,
        Mode.DEAD,
        Mode.STOP_AT_WAYPOINT,
    }
)
ENDED = frozenset({Mode.SUCCESS, Mode.FAILED, Mode.STOPPED})
LEADING = frozenset(Mode) - ENDED - {Mode.IDLE}
RECALLING = frozenset({Mode.RECALL, Mode.FAILURE_RECALL})
