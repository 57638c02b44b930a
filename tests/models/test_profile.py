"""The Canine Motion Simulator: its profiles against the integrals of D.9 to D.11, by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from models.canine import Canine
from models.commands import Command
from models.kit.timing import TICK as TS
from models.profile import PROFILES, SEGMENTS, Profile

DEG = math.pi / 180
OMEGA = 90 * DEG  # rad/s, the turn of D.6.1

Make = Callable[..., Any]


def run(native: Make, seconds: float, **parameters: float) -> dict[str, np.ndarray[Any, Any]]:
    """Outputs after each tick; after second t stands in row 25 t - 1."""
    ticks = round(seconds / TS)
    columns: dict[str, np.ndarray[Any, Any]] = native(Profile, "double", parameters).run(
        command=np.full(ticks, Command.STOP)
    )
    return columns


def after(columns: dict[str, np.ndarray[Any, Any]], seconds: float, *names: str) -> list[float]:
    return [float(columns[name][round(seconds / TS) - 1]) for name in names]


def test_the_simulator_moves_as_the_integrals_of_its_profile(native: Make) -> None:
    """D.6.1, eq. D.9-D.11, with the turn's integrals in closed form."""
    way = run(native, 19.0)
    # given 1 m/s2 for 3 s: 3 m/s after 4.5 m to the north, level
    assert after(way, 3, "north", "east", "speed", "heading", "pitch") == pytest.approx([4.5, 0, 3, 0, 0])
    # then for 1 s speed 3 - t, heading w t: integrals 2/w + 1/w^2 and 3/w - 1/w^2
    north, east = 4.5 + 2 / OMEGA + 1 / OMEGA**2, 3 / OMEGA - 1 / OMEGA**2
    assert after(way, 4, "north", "east") == pytest.approx([north, east], abs=1e-3)
    assert after(way, 4, "speed", "heading", "pitch") == pytest.approx([2, 90 * DEG, 0])
    assert after(way, 4, "acceleration", "yaw_rate") == pytest.approx([-1, OMEGA])
    # then 15 s to the east at 2 m/s, up an incline of 10 deg
    assert after(way, 19, "north", "east") == pytest.approx([north, east + 30], abs=1e-3)
    assert after(way, 19, "speed", "heading", "pitch") == pytest.approx([2, 90 * DEG, 10 * DEG])
    assert after(way, 4.04, "pitch", "acceleration", "yaw_rate") == pytest.approx([10 * DEG, 0, 0], abs=1e-12)


def test_the_other_reading_goes_on_at_three_metres_a_second(native: Make) -> None:
    way = run(native, 19.0, **PROFILES["simulator_fast"])
    # then the turn is a quarter of a circle of radius 3/w
    assert after(way, 4, "north", "east") == pytest.approx([4.5 + 3 / OMEGA, 3 / OMEGA], abs=1e-3)
    assert after(way, 19, "speed", "east") == pytest.approx([3, 3 / OMEGA + 45], abs=1e-3)


def test_after_the_last_segment_the_animal_goes_on_as_it_was(native: Make) -> None:
    way = run(native, 30.0)
    assert after(way, 30, "speed", "heading", "pitch", "yaw_rate") == pytest.approx(
        [2, 90 * DEG, 10 * DEG, 0], abs=1e-12
    )


@pytest.mark.parametrize(
    ("name", "directions"),
    [("l", [(1, 0), (0, 1), (0, -1), (-1, 0)]), ("box", [(0, 1), (1, 0), (0, -1), (-1, 0)])],
)
def test_the_walks_of_b_2_lead_in_their_directions(
    native: Make, name: str, directions: list[tuple[int, int]]
) -> None:
    # given a walk of four legs of 7 s at 1.5 m/s, each before a second of turning
    way = run(native, 34.0, **PROFILES[name])
    # then each leg leads for 10.5 m in its direction
    for leg, direction in enumerate(directions):
        begin, end = (after(way, 1 + 8 * leg + t, "north", "east") for t in (0, 7))
        assert np.subtract(end, begin) == pytest.approx(np.multiply(direction, 10.5), abs=1e-9)
    # and the animal stands at last
    assert after(way, 34, "speed", "yaw_rate", "pitch") == pytest.approx([0, 0, 0], abs=1e-12)


def test_the_box_ends_beside_its_begin(native: Make) -> None:
    """By hand: legs cancel; quarter circles of radius r, and 0.75 m to start and to stop, do not."""
    way, radius = run(native, 34.0, **PROFILES["box"]), 1.5 / OMEGA
    assert after(way, 34, "north", "east") == pytest.approx([radius - 0.75, 0.75 - radius], abs=1e-3)


@pytest.mark.parametrize(
    ("duration", "ticks"), [(1.0, 25), (0.99, 25), (0.965, 25), (0.961, 24), (0.96, 24), (0.04, 1), (0.0, 0)]
)
def test_a_segment_lasts_its_time_rounded_up_to_ticks(native: Make, duration: float, ticks: int) -> None:
    profile = {f"duration[{i + 1}]": 0.0 for i in range(SEGMENTS)} | {"duration[1]": duration}
    assert np.count_nonzero(run(native, 4.0, **profile)["acceleration"]) == ticks


def test_every_segment_has_its_acceleration_yaw_rate_and_pitch(native: Make) -> None:
    # given twelve segments of one tick, each with numbers of its own
    n = np.arange(1, SEGMENTS + 1)
    profile = {
        f"{name}[{i}]": float(value)
        for name, values in (
            ("duration", np.full(SEGMENTS, TS)),
            ("acceleration_profile", n / 10),
            ("yaw_rate_profile", n / 20),
            ("pitch_profile", n / 30),
        )
        for i, value in zip(n, values, strict=True)
    }
    way = run(native, SEGMENTS * TS, **profile)
    assert way["acceleration"] == pytest.approx(n / 10)
    assert way["yaw_rate"] == pytest.approx(n / 20)
    assert way["pitch"] == pytest.approx(n / 30)


def test_a_profile_may_begin_in_motion_and_never_runs_backwards(native: Make) -> None:
    profile = {"start_speed": 2.0, "acceleration_profile[1]": -1.0, "start_heading": 30 * DEG}
    way = run(native, 3.0, **profile)
    assert way["acceleration"][0] == pytest.approx(-1)
    assert way["speed"].min() == 0
    assert np.hypot(way["north"], way["east"])[-1] == pytest.approx(2.0)
    assert np.arctan2(way["east"], way["north"])[-1] == pytest.approx(30 * DEG)


def test_a_profile_moves_where_heading_and_slip_point(native: Make) -> None:
    # given a walk to the north whose course is 20 deg off its heading
    way = run(native, 10.0, **PROFILES["l"] | {"slip_mean": 20 * DEG, "duration[2]": 100.0})
    assert np.arctan2(way["east"], way["north"]) == pytest.approx(20 * DEG)
    assert way["slip"] == pytest.approx(20 * DEG)
    assert way["heading"] == pytest.approx(0)


def test_commands_do_not_move_the_simulator(native: Make) -> None:
    ways = [
        native(Profile, "double", {}).run(command=np.full(100, command))["north"]
        for command in (Command.NONE, Command.FORWARD, Command.RECALL)
    ]
    assert ways[0].tobytes() == ways[1].tobytes() == ways[2].tobytes()


def test_the_pack_of_a_profile_shakes_as_the_dogs(native: Make) -> None:
    # given a dog and a profile that both speed up by 1.78 m/s2 to 4.86 m/s, with everything of the pack on
    pack = {"pitch_wander": 0.07, "jolt_rate": 0.5, "pitch_shift_rate": 0.2, "seed": 4.0, "shaking": 1.0}
    dog = native(Canine, "double", pack | {"drift": 0, "drift_deviation": 0}).run(
        command=np.full(75, Command.FORWARD)
    )
    speeding = {"duration[1]": 10.0, "acceleration_profile[1]": 1.78}
    simulated = run(native, 3.0, **pack | speeding)
    n = 68  # ticks before the dog's cruise speed
    for name in ("acceleration", "pitch", "roll", "yaw_rate", "speed"):
        assert simulated[name][:n] == pytest.approx(dog[name][:n], abs=1e-12), name
