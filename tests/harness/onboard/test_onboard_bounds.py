"""The program on board: its bounds and what it forgets; each has a mutant that only its test notices."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from codegen.firmware.telemetry import Flag, Ready, Refusal
from harness.onboard.radio import Mission, Start
from models.modes import Mode
from tests.harness.onboard.vest import Vest, place

HOME = place(0, 0)
A = Mission(HOME, (place(50, 0),))


@pytest.fixture
def vest() -> Iterator[Vest]:
    made = Vest()
    yield made
    made.processor.close()


def is_loaded(vest: Vest) -> bool:
    """Does the vest hold a mission, as it tells?"""
    vest.ticks(10)
    return bool(vest.telemetry.flags & Flag.LOADED)


def test_rule_9_a_mission_alone_asks_for_no_start(vest: Vest) -> None:
    vest.ticks(10)
    vest.load(A)
    memory = vest.ticks(10)
    assert memory["controller.output.mode"] == Mode.IDLE
    assert vest.telemetry.refusal == Refusal.NONE


def test_rule_9_a_mission_behind_a_start_undoes_it_without_a_refusal(vest: Vest) -> None:
    # given a mission that is ready
    vest.ticks(10)
    vest.load(A)
    # when it comes again right behind its START
    vest.tick(Start(A.id), A, fix=False)
    memory = vest.ticks(20)
    # then nothing begins, and nothing is refused
    assert memory["controller.output.mode"] == Mode.IDLE
    assert vest.telemetry.refusal == Refusal.NONE


@pytest.mark.parametrize(("pause", "taken"), [(5, True), (6, False)])
def test_a_frame_may_pause_for_five_ticks(vest: Vest, pause: int, taken: bool) -> None:
    # given a frame that comes in two pieces
    frame = vest.encode(A)
    vest.tick(frame[:20], fix=False)
    for _ in range(pause - 1):
        vest.tick(fix=False)
    vest.tick(frame[20:], fix=False)
    # then it is taken if the second comes within five ticks
    assert is_loaded(vest) == taken


def test_a_message_behind_a_frame_that_never_ends_is_obeyed_when_that_is_abandoned(vest: Vest) -> None:
    # given the beginning of a long frame, and a mission behind it
    vest.tick(vest.encode(Mission(HOME, (place(60, 0),) * 16))[:8] + vest.encode(A), fix=False)
    # when the radio is silent for longer than a frame may pause
    for _ in range(7):
        vest.tick(fix=False)
    # then it is held
    assert is_loaded(vest)
    assert vest.telemetry.mission_id == A.id


@pytest.mark.parametrize(
    ("accuracy", "settled"),
    [
        ({"gps_h_acc": 100.0}, 1),
        ({"gps_h_acc": 100.001}, 0),
        ({"gps_h_acc": 100.0, "gps_s_acc": 10.0}, 1),
        ({"gps_s_acc": 10.01}, 0),
    ],
)
def test_a_fix_settles_the_plane_if_it_is_accurate_to_100_m_and_10_m_s(
    vest: Vest, accuracy: dict[str, float], settled: int
) -> None:
    assert vest.tick(fix=True, **accuracy)["local_plane.state.settled"] == settled


@pytest.mark.parametrize("axis", [(1, 0), (0, 1), (-1, 0), (0, -1)])
@pytest.mark.parametrize("far", [0, 1, 2])
@pytest.mark.parametrize(("distance", "missing"), [(99_900.0, ()), (100_100.0, (Ready.REACH,))])
def test_rule_8_every_place_of_a_mission_must_be_in_reach(
    vest: Vest, axis: tuple[int, int], far: int, distance: float, missing: tuple[Ready, ...]
) -> None:
    # given a mission of which one place is far away to one side: home, the first or the last waypoint
    places = [place(20, 20), place(50, 0), place(0, 50)]
    places[far] = place(axis[0] * distance, axis[1] * distance)
    vest.ticks(12)
    vest.tick(Mission(places[0], (places[1], places[2])), fix=False)
    vest.ticks(12)
    # then it is ready if all are in reach
    assert Ready(vest.telemetry.ready).missing == missing
