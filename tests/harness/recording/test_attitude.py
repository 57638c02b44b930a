"""The low-pass filter, the attitude and the heading of a recording, against exact motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy import signal
from scipy.spatial.transform import Rotation

from harness.recording.attitude import CUTOFF_HZ, align_heading, anti_alias, own_attitude
from harness.recording.recording import Fixes, Recording, RecordingError
from harness.recording.signals import OWN, RECORDED, sensor_signals

TICK_S = 0.04
G = 9.81
Array = npt.NDArray[np.float64]

# the filter


def test_the_filter_passes_motion_late_by_its_delay_and_stops_what_would_alias() -> None:
    t = np.arange(0, 20, 0.0065)
    tick = np.arange(500) * TICK_S
    hold = 0.0065 / 2  # the mean age of a held sample
    delay = 2.613 / (2 * np.pi * CUTOFF_HZ)  # 2.613 s at 1 rad/s: a fourth-order Butterworth filter's, slow

    slow = anti_alias(t, np.sin(2 * np.pi * 1.0 * t)[:, None], 500)[:, 0]
    aliasing = anti_alias(t, np.sin(2 * np.pi * 24.0 * t)[:, None], 500)[:, 0]
    level = anti_alias(t, np.full((len(t), 1), 9.8), 500)[:, 0]

    late = np.sin(2 * np.pi * 1.0 * (tick - delay - hold))
    np.testing.assert_allclose(slow[50:], late[50:], atol=0.02)
    assert np.abs(aliasing[50:]).max() < 0.02
    np.testing.assert_allclose(level, 9.8, rtol=1e-12)  # starts settled
    assert delay == pytest.approx(0.052, abs=0.0005)  # s, as the README states


def step_response(t: Array) -> Array:
    """Of a Butterworth filter of order 4 with its -3 dB at 8 Hz, in continuous time."""
    b, a = signal.butter(4, 2 * np.pi * 8.0, analog=True)
    fine = np.arange(0, 2, 1e-4)
    _, response = signal.step((b, a), T=fine)
    return np.asarray(np.interp(t, fine, response, left=0.0), dtype=np.float64)


@pytest.mark.parametrize(
    ("at", "seen"),
    [
        (0.4, 0.4),  # a sample on an instant of the grid counts from there
        (0.4 + 5e-10, 0.4),  # as one does that rounding puts behind it
        (0.4 + 1e-8, 0.401),  # a later one counts from the next on
        (0.4003, 0.401),
    ],
)
def test_the_filter_holds_each_sample_from_its_time_on(at: float, seen: float) -> None:
    # given a step in two signals, of opposite signs
    t = np.array([0.1, at, 1.5])
    filtered = anti_alias(t, np.array([[0.0, 5.0], [1.0, 4.0], [1.0, 4.0]]), 26)
    # then each tick has the step's response
    assert filtered.shape == (26, 2)
    ticks = TICK_S * np.arange(26, dtype=np.float64)
    expected = step_response(ticks - seen + 0.0005)  # the bilinear filter sees its middle
    np.testing.assert_allclose(filtered[:, 0], expected, atol=2e-4)
    np.testing.assert_allclose(filtered[:, 1], 5.0 - expected, atol=2e-4)


def test_the_filter_holds_the_first_sample_before_its_time() -> None:
    filtered = anti_alias(np.array([0.5]), np.array([[7.0]]), 3)
    np.testing.assert_allclose(filtered, np.full((3, 1), 7.0), rtol=1e-12)


def test_the_means_of_the_filter_add_up_to_the_integral() -> None:
    """At 1 rad/s over 2 s, then none: the turn is 2 rad, whenever it ended between two ticks."""
    t = np.arange(0, 4, 0.007)
    rate = np.where(t < 2.009, 1.0, 0.0)[:, None]
    means = anti_alias(t, rate, 100, mean=True)[:, 0]
    late = 2.613 / (2 * np.pi * CUTOFF_HZ) + 0.0035
    assert means.sum() * TICK_S == pytest.approx(
        2.009 + late + TICK_S, abs=0.005
    )  # tick 0 has no tick before


# the attitude


def on_ticks(attitude: Rotation, force: Array, angles: Array) -> Array:
    """The block's angles, unwrapped, where the samples are those of a motion (ticks,) without fixes."""
    rate = np.zeros((len(force), 3))
    rate[1:] = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / TICK_S
    none = np.zeros(len(force))
    estimate = own_attitude(np.hstack([force, rate]), none, none, none, none)
    return np.unwrap(estimate[:, :3], axis=0) - angles


def test_angles_follow_a_motion_about_all_axes() -> None:
    # given 20 s of rolling to 60 deg, pitching to 50 deg and turning through two rounds
    t = np.arange(500) * TICK_S
    roll, pitch = np.radians(60) * np.sin(1.1 * t), np.radians(50) * np.sin(0.7 * t)
    heading = 4 * np.pi * t / t[-1]
    attitude = Rotation.from_euler("ZYX", np.column_stack([heading, pitch, roll]))
    # with the rates of scipy's rotation vectors, and gravity as the only force
    force = attitude.inv().apply([0.0, 0.0, -G])
    errors = on_ticks(attitude, force, np.column_stack([roll, pitch, heading]))
    np.testing.assert_allclose(errors, 0, atol=0.01)


def test_angles_are_nose_up_right_wing_down_and_clockwise() -> None:
    pitch, roll = np.radians(10), np.radians(5)
    up = [np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)]
    none = np.zeros(100)
    still = np.outer(np.ones(100), np.append(np.multiply(up, G), [0, 0, 0]))
    tilted = own_attitude(still, none, none, none, none)
    np.testing.assert_allclose(tilted[-1], [roll, pitch, 0, 500], atol=1e-6)  # no course: any heading


def recording(**changes: object) -> Recording:
    """60 s at 2 m/s, straight for 6 s and then in turns, with fixes at 4 Hz and an IMU at 100 Hz."""
    imu_t = np.arange(-0.5, 60.5, 0.01)
    yaw_rate = np.where(imu_t > 6, 0.6 * np.sin(0.8 * imu_t), 0.0)
    heading = 1.0 + np.cumsum(yaw_rate) * 0.01
    t = np.arange(0, 60, 0.25)
    course = np.interp(t, imu_t, heading)
    force = np.column_stack([0 * imu_t, 2.0 * yaw_rate, 0 * imu_t - G])
    zeros, ones = np.zeros(len(t)), np.ones(len(t))
    fixes = Fixes(t, zeros, zeros, zeros, 2 * np.cos(course), 2 * np.sin(course), ones, 0.1 * ones)
    rate = np.column_stack([0 * imu_t, 0 * imu_t, yaw_rate])
    return replace(Recording("made up", fixes, imu_t, force, rate, {}), **changes)  # type: ignore[arg-type]


def test_the_heading_of_a_recording_is_that_of_its_courses() -> None:
    signals = sensor_signals(recording())
    late = 2.613 / (2 * np.pi * CUTOFF_HZ)
    truth = np.interp(signals.t - late, recording().imu_t, 1.0 + np.cumsum(recording().rate[:, 2]) * 0.01)
    np.testing.assert_allclose(signals.heading_meas[25:], truth[25:], atol=0.03)
    np.testing.assert_allclose(signals.roll_meas, 0, atol=0.01)


@pytest.mark.parametrize("attitude", [OWN, RECORDED])
def test_fixes_of_an_outage_never_reach_the_attitude(attitude: str) -> None:
    # given a recording, and the same with other velocities at the fixes of an outage
    whole = recording(attitude=np.zeros((6100, 3)))
    hidden = (whole.fixes.t >= 30) & (whole.fixes.t <= 40)
    fixes = replace(whole.fixes, velocity_north=np.where(hidden, -7.0, whole.fixes.velocity_north))
    others = replace(whole, fixes=fixes)
    # when the outage hides them, then the attitude is the same on every tick
    seen, unseen = (sensor_signals(r, [(30, 40)], attitude) for r in (whole, others))
    for name in ("roll_meas", "pitch_meas", "heading_meas"):
        np.testing.assert_array_equal(getattr(seen, name), getattr(unseen, name))
    # and without the outage it is not
    assert np.abs(sensor_signals(others, [], attitude).heading_meas - seen.heading_meas).max() > 0.1


def test_over_a_hole_of_the_samples_the_attitude_stays_and_the_next_course_gives_the_heading() -> None:
    whole = recording()
    there = (whole.imu_t < 20) | (whole.imu_t > 26)
    holed = replace(
        whole, imu_t=whole.imu_t[there], specific_force=whole.specific_force[there], rate=whole.rate[there]
    )
    signals = sensor_signals(holed)
    inside = (signals.t > 20.1) & (signals.t < 26)
    assert np.ptp(signals.heading_meas[inside]) < 1e-9
    after = (signals.t > 26.6) & (signals.t < 28)
    expected = sensor_signals(whole).heading_meas
    np.testing.assert_allclose(signals.heading_meas[after], expected[after], atol=0.12)


def test_samples_before_the_first_fix_show_the_gyros_bias() -> None:
    """A bias of 1 deg/s forward tilts by 1 / 0.04 = 25 deg in the end, unless a rest has shown it."""
    whole = recording()
    bias = np.radians([1.0, 0.0, 0.0])
    before = np.arange(-20, whole.imu_t[0], 0.01)
    force = np.vstack([np.outer(np.ones(len(before)), [0, 0, -G]), whole.specific_force])
    rate = np.vstack([np.zeros((len(before), 3)), whole.rate]) + bias
    rested = replace(whole, imu_t=np.append(before, whole.imu_t), specific_force=force, rate=rate)
    assert np.abs(sensor_signals(rested).roll_meas).max() < np.radians(1)
    assert np.abs(sensor_signals(replace(whole, rate=whole.rate + bias)).roll_meas).max() > np.radians(3)


def test_a_recorded_attitude_is_the_default_and_its_heading_takes_the_offset_of_the_courses() -> None:
    # given an attitude whose heading counts from another zero
    imu_t = recording().imu_t
    heading = 1.0 + np.cumsum(recording().rate[:, 2]) * 0.01
    angles = np.column_stack([0.1 + 0 * imu_t, -0.2 + 0 * imu_t, heading - 2.5])
    recorded = recording(attitude=angles)
    signals = sensor_signals(recorded)
    np.testing.assert_allclose(signals.roll_meas, 0.1, atol=1e-9)
    np.testing.assert_allclose(signals.pitch_meas, -0.2, atol=1e-9)
    expected = sensor_signals(recorded, attitude=OWN).heading_meas
    np.testing.assert_allclose(signals.heading_meas[50:], expected[50:], atol=0.05)


def test_a_recording_without_an_attitude_says_so() -> None:
    with pytest.raises(RecordingError, match=r"made up: no attitude is recorded; .* take --attitude own"):
        sensor_signals(recording(), [], RECORDED)


# the heading


def test_heading_takes_the_offset_of_its_fixes_and_wraps() -> None:
    heading = np.linspace(0, 3, 301)
    ticks = np.arange(50, 301, 25)
    aligned = align_heading(heading, ticks, heading[ticks] + 2.0, time_constant_s=10)
    np.testing.assert_allclose(aligned[:50], heading[:50], atol=1e-12)
    np.testing.assert_allclose(aligned[50:], np.angle(np.exp(1j * (heading[50:] + 2.0))), atol=1e-9)


def test_the_offset_is_the_mean_of_the_first_fixes() -> None:
    # given courses 0.3 to the left and to the right of 1 rad, soon after each other
    courses = np.array([0.7, 1.3, 0.7, 1.3])
    aligned = align_heading(np.zeros(8), np.array([1, 3, 5, 7]), courses, time_constant_s=10)
    means = [0.0, 0.7, 0.7, *(np.angle(np.mean(np.exp(1j * courses[:n]))) for n in (2, 2, 3, 3, 4))]
    np.testing.assert_allclose(aligned, means, atol=1e-12)


def test_the_offset_forgets_older_courses_with_its_time_constant() -> None:
    # given courses of 0 for 60 s, then of 0.1 rad: small, so that the mean of directions is that of angles
    ticks = np.arange(0, 3000, 6)
    courses = np.where(ticks < 1500, 0.0, 0.1)
    aligned = align_heading(np.zeros(3000), ticks, courses, time_constant_s=5.0)
    assert aligned[1499] == 0
    # then 5 s later 1 - 1/e of the way is gone, counted from the last fix with the older course
    later = ticks[ticks >= 1500]
    elapsed = (later - 1494) * TICK_S
    np.testing.assert_allclose(aligned[later], 0.1 * (1 - np.exp(-elapsed / 5.0)), atol=1e-4)


def test_after_a_hole_the_offset_is_found_anew() -> None:
    # given courses of 0 up to tick 40 and, after a hole that ends at tick 50, of 1 rad
    ticks = np.arange(0, 100, 5)
    courses = np.where(ticks < 50, 0.0, 1.0)
    aligned = align_heading(np.zeros(100), ticks, courses, time_constant_s=10, lost=[50])
    assert aligned[49] == 0
    np.testing.assert_allclose(aligned[50:], 1.0, atol=1e-12)
