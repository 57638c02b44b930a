"""Dogs for missions whose outcome must be sure, however busy the machine is."""

from __future__ import annotations

from pathlib import Path

TURN = [[35.73, 0.0], [35.73, 35.73]]  # m: that of three_waypoint
NEAR = [[15.0, 0.0]]  # there and back within half a minute

# A dog as in Table 5.1 obeys LEFT and RIGHT in six of ten cases. At 20 times real time the 2 s after which a
# vest ends a mission that it hears nobody for are 0.1 s of the clock, less than a busy machine pauses for.
SCENARIO = """
waypoints = {waypoints}
[parameters]
"canine.left_success" = {obeys}
"canine.right_success" = {obeys}
"canine.left_turn_rate_deviation" = 0.0
"canine.right_turn_rate_deviation" = 0.0
"canine.drift" = 0.0
"canine.drift_deviation" = 0.0
"watchdog.link_timeout" = {patience}
"""


def obedient(
    folder: Path, waypoints: list[list[float]] = TURN, patience: float = 40.0, obeys: float = 1.0
) -> Path:
    """A scenario whose dog always obeys, or LEFT and RIGHT as often as told; its vest waits so many s for its
    operator."""
    path = folder / "obedient.toml"
    path.write_text(SCENARIO.format(waypoints=waypoints, patience=patience, obeys=obeys))
    return path
