"""The two readings of the controller and the simulator: parameters where the text leaves a choice.

The text taken literally (`literal`) does not reproduce its own success rates; `calibrated` nearly does.
"""

from __future__ import annotations

from models.kit.units import DEG

READINGS: dict[str, dict[str, float]] = {
    "calibrated": {
        "cmec.turn_end_deviation": 5 * DEG,
        "cmec.limit_stop_deviation": True,
        "cmec.count_reissue": False,
        "cmec.reset_turns": False,
    },
    "literal": {
        "cmec.turn_end_deviation": 20 * DEG,
        "cmec.limit_stop_deviation": False,
        "cmec.count_reissue": True,
        "cmec.reset_turns": True,
    },
}


def start_heading_deviation(reading: str, waypoints: int) -> float:
    """Standard deviation [rad] of the heading at the start of a trial, by its number of waypoints.

    5.3.3 gives 10 deg for the two-waypoint trials; the calibrated reading has none in longer ones.
    """
    return 10 * DEG if reading == "literal" or waypoints == 1 else 0.0
