"""Logs as sources of a replay: what they lack is named or counted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.recording.recording import RecordingError
from harness.replay.comparison import HELD, compare
from harness.replay.replay import replay
from harness.replay.source import open_source
from harness.replay.windows import NO_FIX_AT_THE_END, NO_FIXES_BEFORE, NO_SAMPLES, NOT_VALID
from tests.harness.replay.logs import TICK_S, walk, write


def tick(seconds: float) -> int:
    return round(seconds / TICK_S)


def test_a_walk_of_a_log_has_outages_and_nothing_dropped(tmp_path: Path) -> None:
    source = open_source(write(tmp_path / "trial.mcap", walk()))
    chosen = source.outages(5, 5)
    assert chosen.windows == ((15, 20), (20, 25))
    assert chosen.left_out == {} == source.dropped


def test_a_hole_of_fixes_in_a_log_leaves_outages_out(tmp_path: Path) -> None:
    # given no fix from 24 s to the one at 26 s: a simulated outage up to 25 s would end in it
    signals = walk(40)
    signals["gps_fix"][tick(24) : tick(26)] = 0
    chosen = open_source(write(tmp_path / "trial.mcap", signals)).outages(5, 5)
    assert chosen.windows == ((15, 20), (30, 35))
    assert chosen.left_out == {NO_FIX_AT_THE_END: 1, NO_FIXES_BEFORE: 1}


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["gps_north", "gps_speed", "gps_course", "gps_h_acc"])
def test_a_fix_that_is_not_finite_is_dropped_and_counted(tmp_path: Path, name: str, value: float) -> None:
    # given one bad fix at the end of the first outage
    signals = walk()
    signals[name][tick(20)] = value
    source = open_source(write(tmp_path / "trial.mcap", signals))
    # then the outage is judged at the fix before it, 0.2 s earlier
    assert source.dropped == {"fixes with a value that is not finite": 1}
    outages = replay(source, compare("four_state"), source.outages(5, 5)).outages
    assert len(outages) == 2
    assert np.isfinite(list(outages[0].errors.values())).all()
    assert outages[0].time[-1] == pytest.approx(19.8)


def test_a_sample_that_is_not_finite_is_counted_and_bridged(tmp_path: Path) -> None:
    # given one heading that is not a number in the first outage of a walk straight north
    signals = walk()
    signals["heading_meas"][tick(17)] = np.nan
    source = open_source(write(tmp_path / "trial.mcap", signals))
    assert source.dropped == {"IMU samples with a value that is not finite": 1}
    # then holding the speed goes on with the heading before it, and errs by nothing
    outages = replay(source, compare("four_state"), source.outages(5, 5)).outages
    assert outages[0].errors[HELD] == pytest.approx((0, 0), abs=1e-9)
    assert np.isfinite(list(outages[0].errors.values())).all()


def test_samples_that_are_not_finite_for_long_leave_outages_out(tmp_path: Path) -> None:
    # given no specific force for 0.2 s at 17 s
    signals = walk(40)
    signals["accel_x"][tick(17) : tick(17.2)] = np.nan
    source = open_source(write(tmp_path / "trial.mcap", signals))
    # then the outages over it and within ten seconds after it are not judged
    assert source.dropped == {"IMU samples with a value that is not finite": 5}
    chosen = source.outages(5, 5)
    assert chosen.windows == ((30, 35),)
    assert chosen.left_out == {NO_SAMPLES: 3}


def test_the_attitude_of_a_log_is_the_logged_one_or_that_of_the_canine_ahrs(tmp_path: Path) -> None:
    # given a walk to the north whose samples say roll 0, pitch 10 deg, and whose AHRS says otherwise
    signals = walk()
    for name in ("accel_y", "gyro_x", "gyro_y", "gyro_z"):
        signals[name] = np.zeros(len(signals["gps_fix"]))
    signals["accel_x"] = np.full(len(signals["gps_fix"]), 9.81 * np.sin(np.radians(10)))
    signals["accel_z"] = np.full(len(signals["gps_fix"]), -9.81 * np.cos(np.radians(10)))
    signals["pitch_meas"][:], signals["heading_meas"][:] = 0.5, 1.0
    log = write(tmp_path / "trial.mcap", signals)
    # when it is opened with each
    logged, own = (open_source(log, attitude).signals([(15, 20)]) for attitude in ("", "own"))
    # then
    assert (logged.pitch_meas == 0.5).all()
    assert (logged.heading_meas == 1.0).all()
    np.testing.assert_allclose(own.pitch_meas[:100], np.radians(10), atol=1e-6)  # until it moves
    np.testing.assert_allclose(own.heading_meas, 0, atol=1e-9)
    assert open_source(log, "own").attitude == "own"


def test_the_canine_ahrs_needs_all_axes_of_the_imu_in_a_log(tmp_path: Path) -> None:
    log = write(tmp_path / "trial.mcap", walk())
    with pytest.raises(RecordingError, match=r'no signal "sensors\.accel_y"'):
        open_source(log, "own")


@pytest.mark.parametrize("name", ["gps_course", "gps_fix", "heading_meas", "gps_s_acc"])
def test_a_log_without_a_signal_is_refused_by_the_signals_name(tmp_path: Path, name: str) -> None:
    signals = walk()
    del signals[name]
    with pytest.raises(RecordingError, match=f'no signal "sensors.{name}"'):
        open_source(write(tmp_path / "trial.mcap", signals))


def test_a_fault_that_the_log_does_not_have_as_it_arrived_is_noted(tmp_path: Path) -> None:
    toml = '[[fault]]\nsignal = "{}"\n'.format
    records = {"scenario": {"toml": toml("sensors.accel_x") + toml("imu") + toml("controller.command")}}
    source = open_source(write(tmp_path / "trial.mcap", walk(), metadata=records))
    assert source.notes == (
        "the trial's faults of accel_x, imu are not in the signals: the log does not have what arrived",
    )


def test_a_log_with_another_step_is_refused_by_its_row(tmp_path: Path) -> None:
    # given a log with a row every 0.08 s, over which the estimator would step as over 0.04 s
    signals = walk(8)
    path = write(tmp_path / "trial.mcap", signals, np.arange(200, dtype=np.float64) * 0.08)
    with pytest.raises(
        RecordingError, match=r"row 2 is of 0.08 s, expected 0.04 s: a row for each tick of 0.04 s"
    ):
        open_source(path)


def test_an_outage_longer_than_the_log_is_refused(tmp_path: Path) -> None:
    source = open_source(write(tmp_path / "trial.mcap", walk()))
    with pytest.raises(
        RecordingError,
        match=r"no outage of 60 s can be judged; it moves from 4.2 s on and has its last fix at 29.8 s; ",
    ):
        replay(source, compare("four_state"), source.outages(60, 5))


def test_a_log_of_one_tick_has_no_outages(tmp_path: Path) -> None:
    source = open_source(write(tmp_path / "trial.mcap", walk(0.04)))
    with pytest.raises(RecordingError, match="no outage of 5 s can be judged; it never moves"):
        replay(source, compare("four_state"), source.outages(5, 5))


def test_a_refusal_counts_the_outages_that_were_left_out(tmp_path: Path) -> None:
    signals = walk(21)
    signals["accel_x"][tick(16) : tick(17)] = np.nan
    source = open_source(write(tmp_path / "trial.mcap", signals))
    with pytest.raises(RecordingError, match=r"can be judged, left out: 1 × IMU samples missing; "):
        replay(source, compare("four_state"), source.outages(5, 5))


def test_fixes_that_the_estimator_refuses_are_no_reason_for_numbers(tmp_path: Path) -> None:
    # given accuracies in millimetres that are declared in metres: the filter never starts
    signals = walk()
    signals["gps_h_acc"] = np.full(len(signals["gps_fix"]), 1750.0)
    source = open_source(write(tmp_path / "trial.mcap", signals))
    # then it is not judged by its distance from (0, 0), and the values that it refuses are named
    with pytest.raises(
        RecordingError,
        match=r"none is valid at the start of any of 2 outages; four_state: 150 of 150 fixes refused "
        r"\(gps_h_acc of 1750 m, expected 0.001 to 1000 m\); are the units right\?",
    ):
        replay(source, compare("four_state"), source.outages(5, 5))


def test_fixes_refused_are_counted_and_the_others_judged(tmp_path: Path) -> None:
    # given speeds of 60 and 80 m/s in two fixes, which no estimator takes
    signals = walk()
    signals["gps_speed"][tick(12)], signals["gps_speed"][tick(13)] = 60, 80
    source = open_source(write(tmp_path / "trial.mcap", signals))
    # then
    comparison = compare("four_state,six_state")
    assert comparison.notes(source) == [
        "four_state, six_state: 2 of 150 fixes refused (gps_speed of 60 to 80 m/s, expected 0 to 50 m/s); "
        "are the units right?"
    ]
    assert len(replay(source, comparison, source.outages(5, 5)).outages) == 2


def test_an_outage_that_an_estimator_is_not_valid_at_is_left_out_and_counted(tmp_path: Path) -> None:
    # given accuracies that no filter takes from 15.5 s on, and a filter that is valid for 3 s after a fix
    signals = walk()
    signals["gps_h_acc"][tick(15.5) :] = 2000
    source = open_source(write(tmp_path / "trial.mcap", signals))
    chosen = source.outages(5, 5)
    assert chosen.windows == ((15, 20), (20, 25))
    # then the first outage is judged and the second is not: its last good fix is 4.6 s old
    replayed = replay(source, compare("six_state", ["six_state.max_age=3"]), chosen)
    assert [outage.start for outage in replayed.outages] == [15]
    assert replayed.left_out == {NOT_VALID: 1}
    assert replayed.notes == ["six_state: not valid at the start of 1 of 2 outages"]
    # and a configuration that is valid at none stands in no table
    outages = replace(chosen, windows=chosen.windows[1:])
    replayed = replay(source, compare("six_state,two_bias", ["six_state.max_age=3"]), outages)
    assert "six_state" not in replayed.outages[0].errors
    assert "six_state" not in replayed.outages[0].estimates
    assert "two_bias" in replayed.outages[0].errors
    assert replayed.left_out == {}
    assert replayed.notes == ["six_state: left out, since it is not valid at the start of the outage"]


@pytest.mark.parametrize(("speed", "standing"), [(0.45, True), (0.55, False), (0.95, False)])
def test_an_outage_that_ends_below_half_a_metre_per_second_ends_standing(
    tmp_path: Path, speed: float, standing: bool
) -> None:
    signals = walk()
    signals["gps_speed"][tick(19) : tick(21)] = speed
    source = open_source(write(tmp_path / "trial.mcap", signals))
    first, second = replay(source, compare("six_state"), source.outages(5, 5)).outages
    assert (first.standing, second.standing) == (standing, False)
