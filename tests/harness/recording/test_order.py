"""Records in the order of their clocks, against the definition on short lists."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.recording.order import late_run, longest_rise, repeats
from harness.recording.recording import FixStream, RecordingError, SampleStream

clocks = st.lists(st.integers(0, 6).map(float), min_size=1, max_size=8)


@given(clocks, st.booleans())
def test_no_other_choice_of_records_that_rise_is_longer(clock: list[float], strict: bool) -> None:
    def rises(chosen: tuple[float, ...]) -> bool:
        return all(b > a or (b == a and not strict) for a, b in pairwise(chosen))

    kept = longest_rise(np.array(clock), strict=strict)
    assert rises(tuple(np.array(clock)[kept]))
    assert not any(rises(chosen) for chosen in combinations(clock, int(kept.sum()) + 1))


@given(st.lists(st.tuples(*[st.integers(0, 2).map(float)] * 2), min_size=1, max_size=8))
def test_a_row_is_a_repeat_if_it_stands_before(rows: list[tuple[float, float]]) -> None:
    assert repeats(np.array(rows)).tolist() == [row in rows[:i] for i, row in enumerate(rows)]


def test_the_longest_run_left_out_between_two_records_is_found() -> None:
    rising = np.array([0, 1, 0, 1, 0, 0, 1, 0, 0, 0], dtype=np.bool_)
    assert late_run(np.arange(10.0), rising) == (4, 5)
    assert late_run(np.arange(3.0), np.array([False, True, True])) is None


def fixes_at(times: list[float]) -> FixStream:
    rows = np.zeros((len(times), 8))
    rows[:, 6:] = 1.0  # m, m/s
    rows[:, 0] = times
    rows[:, 1] = np.arange(len(times)) * 1e-6  # each at another place: none is a repeat
    return FixStream("x.ubx", rows, np.arange(len(times)))


def test_times_go_on_at_the_end_of_a_week() -> None:
    kept = fixes_at([604_799.5, 604_799.75, 0.0, 0.25]).in_order()
    assert kept.rows[:, 0].tolist() == [604_799.5, 604_799.75, 604_800.0, 604_800.25]
    assert kept.dropped == {}


def test_fixes_before_the_clock_was_set_are_dropped() -> None:
    times = [(k + 8 * (k < 3)) / 4 for k in range(100)]  # the first three are 2 s late
    kept = fixes_at(times).in_order()
    assert kept.rows[:, 0].tolist() == times[3:]
    assert kept.dropped == {"fixes out of order": 3}


def test_a_clock_set_back_amid_the_fixes_is_refused_since_either_part_may_be_right() -> None:
    times = [(k + 8 * (k < 50)) / 4 for k in range(100)]
    with pytest.raises(RecordingError, match=r"x\.ubx: the clock goes back by 1\.750 s near record \d+"):
        fixes_at(times).in_order()


def test_epochs_without_any_message_are_counted_by_the_rate_of_the_others() -> None:
    kept = fixes_at([k / 4 for k in range(100) if k not in (20, 50, 51)]).in_order()
    assert kept.dropped == {"epochs without a message, by the rate of the others": 3}


@pytest.mark.parametrize("value", [np.nan, np.inf, 201.0, -201.0])
def test_a_sample_that_no_such_imu_measures_is_dropped(value: float) -> None:
    force = np.zeros((5, 3))
    force[2, 1] = value
    samples = SampleStream("x.csv", np.arange(5.0), force, np.zeros((5, 3)), np.arange(5))
    kept = samples.in_order()
    assert kept.clock.tolist() == [0, 1, 3, 4]
    assert kept.dropped == {"IMU samples out of range": 1}
