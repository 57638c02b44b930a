"""The low-pass filter, the attitude and the heading of a recording, against exact motion."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy import signal
from scipy.spatial.transform import Rotation

from harness.recording.attitude import CUTOFF_HZ, align_heading, anti_alias, euler_angles

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


# the attitude


def test_angles_are_nose_up_right_wing_down_and_clockwise() -> None:
    t = np.arange(0, 5, 0.01)
    ones = np.ones_like(t)
    pitch, roll = np.radians(10), np.radians(5)
    up = [np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)]
    still = np.outer(ones, up) * G
    level, right_turn = np.outer(ones, [0, 0, -G]), np.outer(ones, [0, 0, 0.2])

    tilted = euler_angles(t, still, np.full((len(t), 3), 1e-12))
    turned = euler_angles(t, level, right_turn)

    np.testing.assert_allclose(tilted[-1, :2], [roll, pitch], atol=1e-3)
    assert turned[-1, 2] - turned[0, 2] == pytest.approx(0.2 * t[-1], abs=1e-3)


def test_angles_follow_a_motion_about_all_axes() -> None:
    # given 20 s of rolling to 60 deg, pitching to 50 deg and turning through two rounds, at uneven times
    draw = np.random.default_rng(2)
    t = np.cumsum(draw.uniform(0.003, 0.009, 3400))
    roll = np.radians(60) * np.sin(1.1 * (t - t[0]))
    pitch = np.radians(50) * np.sin(0.7 * (t - t[0]))
    heading = 4 * np.pi * (t - t[0]) / (t[-1] - t[0])
    attitude = Rotation.from_euler("ZYX", np.column_stack([heading, pitch, roll]))
    # with the rates of scipy's rotation vectors, and gravity as the only force
    rate = np.zeros((len(t), 3))
    rate[1:] = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / np.diff(t)[:, None]
    force = attitude.inv().apply([0.0, 0.0, -G])
    # then
    angles = euler_angles(t, force, rate)
    np.testing.assert_allclose(angles[:, 0], roll, atol=0.02)  # its steps have 0.033 rad/s
    np.testing.assert_allclose(angles[:, 1], pitch, atol=0.02)
    np.testing.assert_allclose(angles[:, 2] - angles[0, 2], heading, atol=0.03)


def test_a_roll_beyond_half_a_turn_goes_on() -> None:
    t = np.arange(0, 4, 0.005)
    attitude = Rotation.from_rotvec(np.outer(2.0 * t, [1, 0, 0]))
    rate = np.outer(np.ones_like(t), [2.0, 0, 0])
    angles = euler_angles(t, attitude.inv().apply([0.0, 0.0, -G]), rate)
    np.testing.assert_allclose(angles[:, 0], 2.0 * t, atol=0.02)


def test_angles_stay_over_a_hole_of_the_samples() -> None:
    # given a level turn at 0.2 rad/s whose samples are missing from 2 to 8 s, and a knock at the end of that
    t = np.arange(0, 10, 0.01)
    t = t[(t < 2) | (t > 8)]
    force = np.outer(np.ones_like(t), [0, 0, -G])
    rate = np.outer(np.ones_like(t), [0, 0, 0.2])
    force[200] = [3.0, 3.0, 3.0]
    angles = euler_angles(t, force, rate)
    # then it goes on from where it was, and has turned for four of the ten seconds
    np.testing.assert_allclose(angles[:, :2], 0, atol=2e-3)
    assert angles[-1, 2] - angles[0, 2] == pytest.approx(0.2 * 4, abs=0.01)


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
