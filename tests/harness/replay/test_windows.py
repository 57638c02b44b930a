"""Which outages can be judged, and which are left out and counted: times worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from harness.log.channel import Array
from harness.replay.windows import (
    NO_FIX_AT_THE_END,
    NO_FIXES_BEFORE,
    NO_SAMPLES,
    Outages,
    Window,
    choose,
)

FIXES = np.arange(0, 60.1, 0.25)  # s; it moves from 4 s on, so outages of 5 s start at 14, 19, .. 54 s


def without(*hole: Window) -> Array:
    """The fixes without those in some times, both ends excluded."""
    missing = np.zeros(len(FIXES), dtype=bool)
    for start, end in hole:
        missing |= (start < FIXES) & (end > FIXES)
    return FIXES[~missing]


def outages(fixes: Array = FIXES, imu: tuple[Window, ...] = (), moving_from: float = 4.0) -> Outages:
    return choose(fixes, fixes[fixes >= moving_from], imu, length=5, every=5)


def starts(chosen: Outages) -> list[float]:
    return [start for start, _ in chosen.windows]


def test_a_whole_recording_has_an_outage_every_five_seconds() -> None:
    chosen = outages()
    assert starts(chosen) == [14, 19, 24, 29, 34, 39, 44, 49, 54]
    assert chosen.windows[0] == (14, 19)
    assert chosen.left_out == {}


def test_outages_that_end_in_a_hole_of_fixes_or_soon_follow_it_are_left_out() -> None:
    # given no fix from 32 to 38 s: the outage from 29 to 34 s ends in the hole; the one from 34 s begins in
    # it; at 39 s the fixes are back for one of the six seconds for which they were away
    chosen = outages(without((32, 38)))
    assert starts(chosen) == [14, 19, 24, 44, 49, 54]
    assert chosen.left_out == {NO_FIX_AT_THE_END: 1, NO_FIXES_BEFORE: 2}


def test_a_hole_of_fixes_inside_an_outage_changes_nothing() -> None:
    # given no fix from 29.9 to 31.1 s; the outage from 29 to 34 s withholds those fixes anyway
    assert outages(without((29.9, 31.1))) == outages()


def test_a_single_lost_fix_is_no_hole() -> None:
    chosen = outages(without((33.9, 34.1), (38.6, 38.8)))
    assert starts(chosen) == starts(outages())


def test_two_lost_fixes_at_the_end_leave_the_outage_out() -> None:
    # given the fixes at 33.75 and 34 s lost: the last one before 34 s is half a second old
    assert outages(without((33.6, 34.1))).left_out[NO_FIX_AT_THE_END] == 1


def test_after_a_long_hole_of_fixes_ten_seconds_are_enough() -> None:
    # given no fix for 16 s from 24 s on
    assert starts(outages(without((24, 40)))) == [14, 19, 54]


def test_a_fix_at_the_start_of_an_outage_does_not_judge_it() -> None:
    # given a fix a second and outages of one second; the fix of 15 s is lost
    fixes = np.delete(np.arange(0, 20.0), 15)
    chosen = choose(fixes, fixes[4:], [], length=1, every=1)
    assert starts(chosen) == [15, 16, 17, 18]
    assert chosen.left_out == {NO_FIX_AT_THE_END: 1}


def test_outages_over_and_soon_after_a_hole_of_the_imu_are_left_out() -> None:
    # given no samples from 26 to 27 s: the outage from 24 to 29 s has the hole, and the heading is found anew
    # in the ten seconds of motion up to 37 s
    chosen = outages(imu=((26, 27),))
    assert starts(chosen) == [14, 19, 39, 44, 49, 54]
    assert chosen.left_out == {NO_SAMPLES: 3}


def test_the_estimator_settles_only_in_motion_after_a_hole_of_the_imu() -> None:
    # given the same hole, after which the animal stands until 35 s
    moving = FIXES[((FIXES >= 4) & (FIXES < 26)) | (FIXES >= 35)]
    chosen = choose(FIXES, moving, [(26, 27)], length=5, every=5)
    assert starts(chosen) == [14, 19, 49, 54]


def test_no_outage_follows_a_hole_of_the_imu_to_the_end() -> None:
    assert starts(outages(imu=((26, 61),))) == [14, 19]


@pytest.mark.parametrize(
    ("fixes", "moving_from", "reach"),
    [
        (FIXES[:0], 0, "it has no fix"),
        (FIXES, 99, "it never moves"),
        (FIXES[:40], 4, "it moves from 4.0 s on and has its last fix at 9.8 s"),
    ],
)
def test_a_recording_without_room_for_an_outage_says_why(
    fixes: Array, moving_from: float, reach: str
) -> None:
    chosen = outages(fixes, moving_from=moving_from)
    assert chosen.windows == ()
    assert chosen.left_out == {}
    assert chosen.reach == reach
