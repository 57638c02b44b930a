"""The readings of the controller and the simulator: parameters where the text leaves a choice.

The text taken literally (`literal`) does not reproduce its own success rates; `calibrated` nearly does.
`field` is `calibrated` with directional commands counted per waypoint, as 4.1.4.3 and Table 4.2 say: the
field trial of 4.2.2.2 is given three of them and succeeds. These are without limits. `guarded` is for
animals: `field`, and the rules of SAFETY.md hold.
"""

from __future__ import annotations

from models.canine_ahrs import CanineAhrs
from models.four_state import FourState
from models.kit.units import DEG
from models.system import ESTIMATORS

# ours: what a receiver with carrier phase states in centimetres is not so good on an animal (slip, pack), and
# a running dog's sigma is cut where the speed's own noise would step it up
FLOORS = {"position_sd_floor": 0.5, "speed_sd_floor": 0.1}  # m, m/s
CAP = {"sigma_cap": 1.2}  # m/s2
# ours: a heading that is wrong by 20 deg must not carry the position away from the fixes
SIDEWAYS = {"sigma_position": 0.2}  # m in a tick
FROZEN = 10  # ticks, 0.4 s
READING = "calibrated"  # by default
ON_BOARD = "guarded"  # by default where the firmware leads
PUBLISHED = ("calibrated", "literal", "field")  # those of the dissertation
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
READINGS["field"] = {**READINGS["calibrated"], "cmec.reset_turns": True}
READINGS[ON_BOARD] = {
    **READINGS["field"],
    "cmec.guarded": True,
    "cmec.progress_distance": 5.0,  # m: with 1 m the wander of the fixes hid for 56 s that it stood
    "cmec.rest_speed_sd": 0.3,  # m/s: V'; a dog that walks at 1.5 m/s is then five deviations from rest
}
READINGS[ON_BOARD][f"{CanineAhrs.title()}.frozen_samples"] = FROZEN
for estimator, block in ESTIMATORS.items():
    READINGS[ON_BOARD] |= {
        f"{estimator}.max_position_sd": 7.0,  # m: d'
        f"{estimator}.max_speed_sd": 2.0,  # m/s: about the animal's, with which it would cross d' in 3 s
        f"{estimator}.recovery_time": 3.0,  # s
        f"{estimator}.recovery_speed": 15.0,  # m/s: faster than a dog runs with a vest
        # a dog's slip, its course ahead of the turning head included (0.45 s of 100 deg/s), stays below
        f"{estimator}.heading_limit": 45 * DEG,
        f"{estimator}.frozen_samples": FROZEN,
    }
    if issubclass(block, FourState):  # so that what it states may be believed
        READINGS[ON_BOARD] |= {f"{estimator}.{name}": v for name, v in (CAP | FLOORS | SIDEWAYS).items()}


def start_heading_deviation(reading: str, waypoints: int) -> float:
    """Standard deviation [rad] of the heading at the start of a trial, by its number of waypoints.

    5.3.3 gives 10 deg for the two-waypoint trials; only the literal reading has them in longer ones.
    """
    return 10 * DEG if reading == "literal" or waypoints == 1 else 0.0
