"""How often the dog succeeds in the four trials of Figure 4.8 at h' = 49 deg, calibrated reading.

The expected rates are those of an independent implementation (right 90 71 %, left 90 41 %, right 45 75 %,
left 45 80 %; 50,000 trials each, so exact to 0.2 %).
"""

from __future__ import annotations

import ctypes
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom

from models.canine import Canine
from models.cmec import Cmec
from models.commands import Status
from models.four_state import FourState
from models.kit.block import Block
from models.kit.model import Model
from models.readings import READINGS, start_heading_deviation
from models.sensors import Sensors
from tests.codegen.compiled import QUICKEST, Build, Library

SCENARIOS = Path(__file__).parents[3] / "harness" / "scenarios"
TRIALS = 1000
EXPECTED = {"right_90": 0.71, "left_90": 0.41, "right_45": 0.75, "left_45": 0.80}
Outcomes = np.ndarray[Any, Any]


def parameters(scenario: str, reading: str = "calibrated") -> dict[type[Block], dict[str, float]]:
    """The values that a shipped scenario and a reading set, by block."""
    written = tomllib.loads((SCENARIOS / f"{scenario}.toml").read_text())
    assert written["reading"] == "calibrated"
    waypoints = written["waypoints"]
    mission: dict[str, float] = {"waypoint_count": len(waypoints)}
    for i, (north, east) in enumerate(waypoints, 1):
        mission |= {f"waypoint_north[{i}]": north, f"waypoint_east[{i}]": east}
    controller = {n.partition(".")[2]: v for n, v in READINGS[reading].items() if n.startswith("cmec.")}
    return {
        Cmec: mission | controller,
        Canine: {"start_heading_deviation": start_heading_deviation(reading, len(waypoints))},
        Sensors: {},
        FourState: {},
    }


def run(library: Library, wiring: str, scenario: str, seeds: range, shaking: bool) -> Outcomes:
    """Trials in C: (seeds, 3) of status, ticks, directional commands."""
    blocks = {"cts": (Canine, Cmec), "full": (Canine, Sensors, FourState, Cmec)}[wiring]
    values = parameters(scenario)
    values[Canine] = values[Canine] | {"shaking": shaking}
    records = [library.records(block, 1, values[block]) for block in blocks]
    outcomes = np.zeros((len(seeds), 3), dtype=np.int32)
    pointers = [ctypes.c_void_p(r.ctypes.data) for r in records]
    for i, seed in enumerate(seeds):
        outcome = ctypes.c_void_p(outcomes[i:].ctypes.data)
        getattr(library.c, wiring)(*pointers, ctypes.c_int32(seed), ctypes.c_int32(7500), outcome)
    return outcomes


@pytest.fixture(scope="module")
def library(libraries: Callable[[Build, str], Library]) -> Library:
    return libraries(QUICKEST, "double")


@pytest.fixture(scope="module")
def simulated(library: Library) -> Mapping[str, Outcomes]:
    """The true state into the controller, seeds 1 to 1000."""
    return {s: run(library, "cts", s, range(1, TRIALS + 1), shaking=False) for s in EXPECTED}


def success(outcomes: Outcomes) -> float:
    return float(np.mean(outcomes[:, 0] == Status.SUCCESS))


@pytest.mark.parametrize("scenario", EXPECTED)
def test_success_rate_lies_within_the_99_percent_interval(
    scenario: str, simulated: Mapping[str, Outcomes]
) -> None:
    low, high = binom.interval(0.99, TRIALS, EXPECTED[scenario])
    rate = success(simulated[scenario])
    print(f"{scenario}: {100 * rate:.1f} %, expected {100 * EXPECTED[scenario]:.0f} %")
    assert low <= TRIALS * rate <= high


def test_trials_take_as_long_as_expected(simulated: Mapping[str, Outcomes]) -> None:
    """CHOICES.md: mean time of the successful three-waypoint trials at 49 deg 37.6 s."""
    ticks = np.concatenate([o[o[:, 0] == Status.SUCCESS, 1] for o in simulated.values()])
    assert ticks.mean() * 0.04 == pytest.approx(37.6, abs=4 * ticks.std() * 0.04 / np.sqrt(len(ticks)) + 0.05)


@pytest.mark.parametrize("scenario", EXPECTED)
def test_success_rate_through_sensors_and_estimator(
    scenario: str, library: Library, simulated: Mapping[str, Outcomes]
) -> None:
    # given the same dogs, with their true state and with the estimate into the controller
    estimated = success(run(library, "full", scenario, range(1, TRIALS + 1), shaking=True))
    true = success(simulated[scenario])
    print(f"{scenario}: {100 * estimated:.1f} % through sensors and estimator, {100 * true:.1f} % without")
    assert abs(estimated - true) < 0.04  # of the same seeds


@pytest.mark.parametrize("scenario", EXPECTED)
def test_a_trial_in_c_ends_as_the_same_seed_does_in_python(
    scenario: str, simulated: Mapping[str, Outcomes]
) -> None:
    for seed in (1, 2, 3) if scenario != "right_90" else (1,):
        # given a trial stepped in Python
        values = parameters(scenario)
        plant = Model(Canine, values[Canine] | {"seed": seed, "shaking": 0})
        controller = Model(Cmec, values[Cmec])
        for model in (plant, controller):
            model.initialize()
        controller["start"] = 1
        tick = 0
        while tick < 7500:
            for name in ("north", "east", "speed", "heading"):
                controller[name] = plant[name]
            controller.step()
            if controller["status"] >= Status.SUCCESS:
                break
            plant["command"] = controller["command"]
            plant.step()
            tick += 1
        # then it ended as in C, on the same tick, after as many commands
        ended = (controller["status"], tick, controller["directional_commands"])
        assert ended == tuple(simulated[scenario][seed - 1])
