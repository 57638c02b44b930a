"""What the fullest mission costs: it is projected place by place, so no tick is long."""

from __future__ import annotations

import math
import os
from typing import Any

import pytest

from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.telemetry import Refusal
from codegen.toolchains import sdcc
from harness.onboard.processors import open_processor
from harness.onboard.radio import Mission, Start
from models.canine_ahrs import CanineAhrs
from models.canine_tracker import CanineTracker
from models.errors import CanineError
from models.modes import Mode
from tests.harness.onboard.vest import HERE, Vest, place

CORNERS = ((-60, -60), (0, -70), (60, -60), (60, 400), (10, 340), (-60, 400), (-70, 100))
FULL = Mission(
    place(0, 0),
    tuple(place(40 + 7.5 * (i % 2), 20 * i) for i in range(16)),
    tuple(place(*corner) for corner in CORNERS),
)
OURS = Navigation(CanineTracker, CanineAhrs)
CLOCKS_PER_MS = 58_980


def costs_of_full_mission(target: str, navigation: Navigation) -> tuple[int, list[int], list[int]]:
    """Clocks or instructions of the tick that takes it, of those that project it, of those behind."""
    vest = Vest(open_processor(target, navigation=navigation), navigation)

    def tick(*messages: Any) -> bool:
        """One tick with a shaken sample; have all places been projected?"""
        sensed = {"accel_z": -9.81, "mag_x": 2.4e-5, "mag_z": 4.2e-5}
        sensed |= {"gyro_z": 0.1 * math.sin(vest.k), "accel_x": 0.3 * math.cos(vest.k)}
        memory = vest.tick(*messages, *[HERE] * (vest.k % 10 == 0), fix=None, **sensed)
        return bool(memory["planned"])

    try:
        while vest.k < 33:
            tick()
        taken = vest.k  # a tick without a fix
        tick(FULL)
        while not tick():
            pass
        planned = vest.k
        tick(Start(FULL.id))
        while vest.k < planned + 50:
            tick()
    finally:
        vest.processor.close()
    assert vest.telemetry.refusal == Refusal.NONE
    assert vest.telemetry.mode > Mode.IDLE
    assert planned - taken > 24  # places
    costs = [cost.clocks or cost.instructions for cost in vest.costs if cost is not None]
    return costs[taken], costs[taken + 1 : planned], costs[planned:]


@pytest.mark.parametrize(("target", "navigation"), [("cortex-m4f", OURS), ("rabbit4000", DEFAULT)])
def test_no_tick_that_projects_a_place_of_the_fullest_mission_is_longer_than_others(
    target: str, navigation: Navigation
) -> None:
    if target == "rabbit4000" and os.environ.get("CI") != "true":
        try:
            sdcc.home()
        except CanineError as missing:
            pytest.skip(f"sdcc 4.5: {missing}")
    taking, projecting, leading = costs_of_full_mission(target, navigation)
    assert max(projecting) <= 1.05 * max(leading)
    assert max(taking, *leading) <= (12 * CLOCKS_PER_MS if target == "rabbit4000" else 8_000)
