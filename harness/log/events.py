"""What happens in a trial, in words: changes of the controller's outputs."""

from __future__ import annotations

from collections.abc import Mapping

from harness.log.log import named
from models.commands import Command, Status
from models.modes import Anomaly

OUTPUTS = ("status", "command", "waypoint", "anomaly")
STATUSES: Mapping[float, str] = {
    Status.IDLE: "no trial is under way",
    Status.RUNNING: "the trial has begun",
    Status.SUCCESS: "the trial has succeeded",
    Status.FAILED: "the trial has failed",
    Status.STOPPED: "the trial was stopped",
}
ANOMALIES: Mapping[float, str] = {  # with the name in Table 4.3, or the rule of models/SAFETY.md
    Anomaly.FORWARD_FAILURE: "the animal did not go forward when told to (forward failure)",
    Anomaly.TURN_FAILURE: "the animal did not turn as far as told in time (turn failure)",
    Anomaly.DIRECTION_SWITCH: "the animal turned too far, and is turned back (direction switch)",
    Anomaly.NO_COMMAND: "another command became right in the no-command period (no command)",
    Anomaly.TRIAL_FAILURE: "another directional command was needed, after MAXTURN of them",
    Anomaly.LOST_LINK: "the radio link was lost (rule 9)",
    Anomaly.INVALID_ESTIMATE: "the estimate cannot be trusted (rules 5 and 6)",
    Anomaly.BAD_INPUT: "what the controller is given is no number, or out of range (rule 1)",
    Anomaly.BUDGET_SPENT: "the budget of stimuli was spent (rule 3)",
    Anomaly.NO_PROGRESS: "the animal did not move on (rule 4)",
    Anomaly.DEPARTING: "the animal went away from its target (rule 4)",
    Anomaly.TIME_OUT: "the time for a leg, a recall or the mission was over (rule 4)",
    Anomaly.OUTSIDE_FENCE: "the animal was outside the fence (rule 7)",
}
ENDS_A_TRIAL = frozenset(a for a in Anomaly if a >= Anomaly.BUDGET_SPENT or a is Anomaly.LOST_LINK)
OPERATOR = "the operator"


def because(why: str | None) -> str:
    """What ended a trial, as it follows "stopped after 9 s"; "" for None."""
    return "" if why is None else f" by {why}" if why == OPERATOR else f": {why}"


def cause_of_stop(anomaly: float) -> str:
    """What stopped a trial, in words, by the anomaly that came with its end.

    One that ends no trial, such as an invalid estimate, came then by chance: the operator stopped it.
    """
    ends = anomaly in ENDS_A_TRIAL or anomaly not in set(Anomaly)
    return in_words("anomaly", anomaly) if ends else OPERATOR


def in_words(output: str, value: float) -> str:
    """What the new value of one of `OUTPUTS` means; "" if it only returns to none.

    A foreign controller may tell a number that has no name: the number is told.
    """
    match output:
        case "command":
            return f"command {named(Command, value)}"
        case "status":
            return STATUSES.get(value, f"the status of the trial is {value:g}")
        case "waypoint" if value:
            return f"waypoint {value:g} reached"
        case "anomaly" if value:
            return ANOMALIES.get(value, f"anomaly {value:g}")
        case _:
            return ""
