"""The sensor suite: the truth when noise is off, and the stated errors when it is on."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from models.canine import Canine
from models.kit.model import Model
from models.sensors import Sensors

DEG = math.pi / 180
TICK = Sensors.sample_time
DECLINATION, HORIZONTAL, DOWN = -3.5 * DEG, 2.4e-5, 4.3e-5  # as declared

QUIET = {
    "gps_wander": 0, "gps_position_noise": 0, "gps_speed_noise": 0, "accel_noise": 0, "gyro_noise": 0,
    "attitude_noise": 0, "heading_noise": 0, "mag_noise": 0,
    **{f"{kind}_bias[{i}]": 0 for kind in ("accel", "gyro") for i in (1, 2, 3)},
}  # fmt: skip

ATTITUDES = [
    {"pitch": p * DEG, "roll": r * DEG, "heading": h * DEG}
    for p, r, h in ((0, 0, 0), (30, 0, 90), (0, 30, 180), (-20, 15, -90), (40, -35, 123), (-8.5, 5, -179))
]

Make = Callable[..., Any]


def answer(parameters: dict[str, float], **inputs: float) -> Model:
    """The sensors' answer to the first tick's inputs."""
    sensors = Model(Sensors, parameters)
    sensors.initialize()
    for name, value in inputs.items():
        sensors[name] = value
    sensors.step()
    return sensors


def axes(sensors: Model, name: str) -> np.ndarray[Any, Any]:
    return np.array([sensors[f"{name}_{axis}"] for axis in "xyz"])


def to_body(attitude: dict[str, float], vector: list[float]) -> np.ndarray[Any, Any]:
    """A vector (north, east, down) in body axes (forward, right, down), by scipy's rotations."""
    angles = [attitude["heading"], attitude["pitch"], attitude["roll"]]
    return np.asarray(Rotation.from_euler("ZYX", angles).inv().apply(vector))


def tilt_compensated_heading(sensors: Model, pitch: float, roll: float) -> float:
    """Eq. C.3 with atan2, after turning the field back to the horizontal plane by hand."""
    x, y, z = axes(sensors, "mag")
    level = y * math.sin(roll) + z * math.cos(roll)
    forward = x * math.cos(pitch) + level * math.sin(pitch)
    right = y * math.cos(roll) - z * math.sin(roll)
    return math.atan2(-right, forward) + DECLINATION


def angle_between(a: Any, b: Any) -> Any:
    return np.abs((np.asarray(a) - np.asarray(b) + np.pi) % (2 * np.pi) - np.pi)


# Without noise


def test_the_accelerometers_read_gravity_as_computed_by_hand() -> None:
    """Eq. D.17: A + sin(-theta)(-g), so nose up by 30 deg at rest reads +g/2 forward."""
    assert axes(answer({"noisy": 0}), "accel") == pytest.approx([0, 0, -9.81])
    assert axes(answer({"noisy": 0}, pitch=30 * DEG), "accel") == pytest.approx(
        [4.905, 0, -9.81 * math.sqrt(0.75)]
    )
    assert axes(answer({"noisy": 0}, roll=30 * DEG), "accel") == pytest.approx(
        [0, -4.905, -9.81 * math.sqrt(0.75)]
    )
    assert axes(answer({"noisy": 0}, acceleration=1.5), "accel") == pytest.approx([1.5, 0, -9.81])
    turning_right = answer({"noisy": 0}, speed=3, yaw_rate=0.5)
    assert axes(turning_right, "accel") == pytest.approx([0, 1.5, -9.81])


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_specific_force_is_acceleration_less_gravity_in_body_axes(attitude: dict[str, float]) -> None:
    sensors = answer({"noisy": 0}, acceleration=0.7, speed=2.0, yaw_rate=-0.4, **attitude)
    expected = np.array([0.7, -0.8, 0]) - to_body(attitude, [0, 0, 9.81])
    assert axes(sensors, "accel") == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_the_magnetometer_sees_the_field_of_the_earth(attitude: dict[str, float]) -> None:
    sensors = answer({"noisy": 0}, **attitude)
    north = [HORIZONTAL * math.cos(DECLINATION), HORIZONTAL * math.sin(DECLINATION), DOWN]
    assert axes(sensors, "mag") == pytest.approx(to_body(attitude, north), abs=1e-18)


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_heading_comes_back_from_the_magnetometer(attitude: dict[str, float]) -> None:
    sensors = answer({"noisy": 0}, **attitude)
    heading = tilt_compensated_heading(sensors, attitude["pitch"], attitude["roll"])
    assert angle_between(heading, attitude["heading"]) < 1e-12


def test_the_gyroscopes_see_the_rates_of_the_euler_angles(native: Make) -> None:
    """Given a nodding, rolling, turning pack, when Euler's kinematics are inverted, its rates come back."""
    t = np.arange(200) * TICK
    pitch, roll, yaw_rate = 0.4 * np.sin(3 * t) - 0.1, 0.3 * np.cos(2 * t), 1.2 * np.sin(t)
    out = native(Sensors, "double", {"noisy": 0}).run(pitch=pitch, roll=roll, yaw_rate=yaw_rate)
    p, q, r = out["gyro_x"], out["gyro_y"], out["gyro_z"]
    # each rate is the mean over its tick, in which the body is half way between two attitudes
    roll_half, pitch_half = (np.convolve(angle, [0.5, 0.5])[:-1] for angle in (roll, pitch))
    roll_half[0], pitch_half[0] = roll[0], pitch[0]
    turning = (q * np.sin(roll_half) + r * np.cos(roll_half)) / np.cos(pitch_half)
    assert turning == pytest.approx(yaw_rate, abs=1e-12)
    nodding = q * np.cos(roll_half) - r * np.sin(roll_half)
    assert nodding[1:] == pytest.approx(np.diff(pitch) / TICK, abs=1e-12)
    assert (p + turning * np.sin(pitch_half))[1:] == pytest.approx(np.diff(roll) / TICK, abs=1e-12)
    still = answer({"noisy": 0}, pitch=0.5, roll=0.5)  # the first tick has no rate, whatever the attitude
    assert axes(still, "gyro").tolist() == [0, 0, 0]


def moving(ticks: int) -> dict[str, np.ndarray[Any, Any]]:
    t = np.arange(ticks) * TICK
    return {
        "north": 3 * t,
        "east": -2 * t,
        "speed": np.hypot(3, 2) + 0.1 * np.sin(t),
        "heading": 4 * np.sin(0.3 * t),
        "acceleration": 2 * np.cos(5 * t),
        "pitch": 0.2 * np.sin(4 * t),
        "roll": 0.1 * np.cos(4 * t),
        "yaw_rate": 0.8 * np.sin(2 * t),
    }


def test_without_noise_the_sensors_return_the_truth(native: Make) -> None:
    truth = moving(300)
    out = native(Sensors, "double", {"noisy": 0}).run(**truth)
    assert np.array_equal(out["pitch_meas"], truth["pitch"])
    assert np.array_equal(out["roll_meas"], truth["roll"])
    assert angle_between(out["heading_meas"], truth["heading"]).max() < 1e-14
    assert np.abs(out["heading_meas"]).max() <= math.pi
    fix = out["gps_fix"] == 1
    assert fix.sum() == 48
    for name in ("north", "east", "speed"):
        assert np.array_equal(out[f"gps_{name}"][fix], truth[name][fix])
    assert angle_between(out["gps_course"][fix], truth["heading"][fix]).max() < 1e-14
    assert set(out["gps_h_acc"]) == {3.5}
    assert set(out["gps_s_acc"]) == {0.1}


def test_sensors_with_deviations_of_zero_return_the_truth(native: Make) -> None:
    truth = moving(300)
    quiet = native(Sensors, "double", QUIET).run(**truth)
    exact = native(Sensors, "double", {"noisy": 0}).run(**truth)
    for name in Sensors.flat_names("output"):
        assert np.array_equal(quiet[name], exact[name]), name


# Fixes and outages


def fixes(out: dict[str, np.ndarray[Any, Any]]) -> list[int]:
    return np.flatnonzero(out["gps_fix"]).tolist()


def test_a_fix_falls_on_the_first_tick_at_or_after_its_time(native: Make) -> None:
    out = native(Sensors).run(north=np.zeros(100_000))
    assert fixes(out)[:9] == [0, 7, 13, 19, 25, 32, 38, 44, 50]
    assert fixes(out) == [-(-25 * k // 4) for k in range(16_000)]  # 0.25 s / 0.04 s = 25/4 ticks


@pytest.mark.parametrize(
    ("period", "expected"),
    [(0.04, [0, 1, 2, 3, 4]), (0.1, [0, 3, 5, 8, 10]), (0.2, [0, 5, 10, 15, 20]), (1.0, [0, 25, 50, 75])],
)
def test_fixes_follow_the_period(native: Make, period: float, expected: list[int]) -> None:
    out = native(Sensors, "double", {"gps_period": period}).run(north=np.zeros(expected[-1] + 1))
    assert fixes(out) == expected


def test_an_outage_has_no_fix_from_its_start_until_before_its_end(native: Make) -> None:
    windows = {"outage_start[1]": 1.0, "outage_end[1]": 2.0, "outage_start[8]": 3.01, "outage_end[8]": 4.0}
    out = native(Sensors, "double", windows).run(north=np.zeros(126))
    all_fixes = [-(-25 * k // 4) for k in range(21)]
    assert fixes(out) == [k for k in all_fixes if not 25 <= k < 50 and not 75.25 <= k < 100]
    assert {19, 50, 75, 100} <= set(fixes(out))


def test_during_an_outage_the_receiver_holds_its_last_fix(native: Make) -> None:
    windows = {"outage_start[1]": 1.0, "outage_end[1]": 11.0}
    out = native(Sensors, "double", windows).run(**moving(300))
    for name in ("gps_north", "gps_east", "gps_speed", "gps_course"):
        held = out[name][25:275]
        assert (held == out[name][19]).all(), name
        assert out[name][275] != held[0]


def test_an_outage_does_not_shift_later_draws(native: Make) -> None:
    truth = moving(600)
    without = native(Sensors).run(**truth)
    with_one = native(Sensors, "double", {"outage_end[1]": 10.0}).run(**truth)
    for name in Sensors.flat_names("output"):
        assert np.array_equal(with_one[name][250:], without[name][250:]), name


def test_noisy_accelerometers_and_gyroscopes_saturate(native: Make) -> None:
    rates = np.array([0.0, 100.0, -100.0])
    force = np.array([0.0, 80.0, -80.0])
    out = native(Sensors).run(acceleration=force, yaw_rate=rates)
    assert out["accel_x"][1:].tolist() == [50, -50]
    assert out["gyro_z"][1:] == pytest.approx([300 * DEG, -300 * DEG])
    assert abs(out["accel_x"][0]) < 5
    exact = native(Sensors, "double", {"noisy": 0}).run(acceleration=force, yaw_rate=rates)
    assert exact["accel_x"].tolist() == [0, 80, -80]


# Statistics, at a significance of 0.01 over the few tests below and with fixed seeds

N = 50_000
CHANNELS = {
    "accel_x": (0.1, 1.0), "accel_y": (0.1, 1.0), "accel_z": (0.1 - 9.81, 1.0),
    "gyro_x": (0.1 * DEG, 0.1 * DEG), "gyro_y": (0.1 * DEG, 0.1 * DEG), "gyro_z": (0.1 * DEG, 0.1 * DEG),
    "mag_x": (HORIZONTAL * math.cos(DECLINATION), 5e-7), "mag_y": (HORIZONTAL * math.sin(DECLINATION), 5e-7),
    "mag_z": (DOWN, 5e-7), "roll_meas": (0, 0.5 * DEG), "pitch_meas": (0, 0.5 * DEG),
    "heading_meas": (0, 1.0 * DEG),
}  # fmt: skip


def assert_white(error: np.ndarray[Any, Any], deviation: float) -> None:
    """Mean 0, the stated standard deviation, normal, and no correlation from one to the next."""
    z = error / deviation
    assert stats.ttest_1samp(z, 0).pvalue > 1e-3
    assert 5e-4 < stats.chi2.cdf((z**2).sum(), z.size) < 1 - 5e-4
    assert stats.kstest(z, "norm").pvalue > 1e-3
    lag = (z[1:] * z[:-1]).mean()
    assert abs(lag) < stats.norm.isf(5e-4) / math.sqrt(z.size)


@pytest.fixture(scope="module")
def standing(native: Make) -> Any:
    """Measurements of an animal that walks at 2 m/s without moving on."""
    return native(Sensors, "double", {"seed": 21, "gps_wander": 0}).run(speed=np.full(N, 2.0), heading=0.0)


@pytest.mark.parametrize("name", CHANNELS)
def test_imu_and_attitude_noise_is_white_about_truth_and_bias(name: str, standing: Any) -> None:
    mean, deviation = CHANNELS[name]
    assert_white(standing[name] - mean, deviation)


def test_no_two_channels_are_correlated(standing: Any) -> None:
    correlation = np.corrcoef([standing[name] for name in CHANNELS])
    worst = max(abs(correlation[i, j]) for i, j in combinations(range(len(CHANNELS)), 2))
    assert worst < stats.norm.isf(0.01 / 66 / 2) / math.sqrt(N)


@pytest.mark.parametrize(
    ("name", "mean", "deviation"),
    [("gps_north", 0, 0.3), ("gps_east", 0, 0.3), ("gps_speed", 2.0, 0.05), ("gps_course", 0, 0.05 / 2.0)],
)
def test_gps_noise_is_white_about_the_truth(name: str, mean: float, deviation: float, standing: Any) -> None:
    """Eq. D.12 and D.15; the course's deviation is that of the speed over the speed, in radians."""
    assert_white(standing[name][standing["gps_fix"] == 1] - mean, deviation)


def test_the_course_noise_has_a_ceiling_at_rest(native: Make) -> None:
    out = native(Sensors, "double", {"seed": 22, "gps_speed_noise": 0.02}).run(speed=np.zeros(N))
    assert_white(out["gps_course"][out["gps_fix"] == 1], 0.02 / 0.1)
    assert out["gps_speed"].min() >= 0


def test_the_slow_error_has_its_deviation_and_correlation_time(native: Make) -> None:
    """A first-order process of 1 s sampled every 0.25 s keeps 1/(1 + 0.25) = 0.8 from fix to fix."""
    parameters = {**QUIET, "seed": 23, "gps_wander": 2.0, "gps_wander_time": 1.0}
    out = native(Sensors, "double", parameters).run(north=np.full(N, 7.0), east=-3.0)
    fix = out["gps_fix"] == 1
    kept = 0.8
    for error in (out["gps_north"][fix] - 7, out["gps_east"][fix] + 3):
        innovations = error[1:] - kept * error[:-1]
        assert_white(innovations, 2.0 * math.sqrt(1 - kept**2))
        independent = error.size * (1 - kept**2) / (1 + kept**2)
        assert error.std() == pytest.approx(2.0, rel=3.3 / math.sqrt(2 * independent))
    correlation = np.corrcoef(out["gps_north"][fix], out["gps_east"][fix])[0, 1]
    assert abs(correlation) < 3.3 / math.sqrt(fix.sum() * (1 - kept**2) / (1 + kept**2))


def test_the_slow_error_starts_with_its_steady_deviation(native: Make) -> None:
    """Over trials, the first fix errs by wander and white noise together: 1.0 and 0.3 m."""
    starts = []
    for seed in range(400):
        out = native(Sensors, "double", {"seed": seed}).run(north=0.0)
        starts += [out["gps_north"][0], out["gps_east"][0]]
    z = np.array(starts) / math.hypot(1.0, 0.3)
    assert stats.kstest(z, "norm").pvalue > 0.01
    assert 0.005 < stats.chi2.cdf((z**2).sum(), z.size) < 0.995


def test_equal_seeds_repeat_the_noise_and_others_do_not(native: Make) -> None:
    truth = moving(50)
    first, again, other = (native(Sensors, "double", {"seed": seed}).run(**truth) for seed in (7, 7, 8))
    for name in Sensors.flat_names("output"):
        assert np.array_equal(first[name], again[name]), name
    for name in (*CHANNELS, "gps_north", "gps_east", "gps_speed", "gps_course"):
        assert (first[name] != other[name]).any(), name


# What AHRS and receiver do not know


def test_an_ahrs_that_leans_takes_its_share_of_the_acceleration_for_gravity(native: Make) -> None:
    # given a level animal that speeds up by 2 m/s2 at 3 m/s while it turns by 0.5 rad/s, and a share of 0.4
    lean = QUIET | {"attitude_lean": 0.4, "attitude_lean_time": 0.46}
    out = native(Sensors, "double", lean).run(
        **{n: np.full(200, v) for n, v in (("acceleration", 2.0), ("speed", 3.0), ("yaw_rate", 0.5))}
    )
    # then pitch and roll follow the tilt of the force, of which a tick keeps 0.46/0.5; they lag by a tick
    follows = 1 - (0.46 / 0.5) ** np.arange(200)
    assert out["pitch_meas"] == pytest.approx(0.4 * math.atan2(2.0, 9.81) * follows)
    # and a force to the right looks as if the right side were up
    assert out["roll_meas"] == pytest.approx(-0.4 * math.atan2(1.5, 9.81) * follows)


def test_a_tilted_ahrs_that_does_not_accelerate_does_not_lean(native: Make) -> None:
    out = native(Sensors, "double", QUIET | {"attitude_lean": 1.0}).run(
        pitch=np.full(100, 0.3), roll=np.full(100, -0.2)
    )
    assert out["pitch_meas"] == pytest.approx(0.3)
    assert out["roll_meas"] == pytest.approx(-0.2)


def test_reflected_fixes_begin_at_their_rate_and_last_their_time(native: Make) -> None:
    # given reflections of 10 m, one in 10 s, that last 5 s, and 16,000 fixes without other errors
    reflecting = QUIET | {"multipath": 10.0, "multipath_rate": 0.1, "multipath_time": 5.0}
    out = native(Sensors, "double", reflecting).run(north=np.zeros(100_000))
    fix = out["gps_fix"] > 0
    off = np.column_stack([out["gps_north"][fix], out["gps_east"][fix]])
    assert len(off) == 16_000
    # then 0.025 of the fixes begin one: 400, within 4 deviations (p = 6e-5)
    begin = np.flatnonzero(np.any(np.diff(off, axis=0), axis=1) & np.any(off[1:], axis=1)) + 1
    assert len(begin) == pytest.approx(400, abs=4 * math.sqrt(400))
    # and their errors are N(0, 10 m) to the north and to the east, independent of each other
    assert off[begin].std(axis=0) == pytest.approx(10, rel=4 / math.sqrt(800))
    assert np.corrcoef(off[begin].T)[0, 1] == pytest.approx(0, abs=4 / math.sqrt(400))
    # and a fix is reflected with p/(p + (1 - p) q): p = 0.025 begins one, q = 0.05 ends one
    share = 0.025 / (0.025 + 0.975 * 0.05)
    assert np.any(off, axis=1).mean() == pytest.approx(share, abs=0.06)
    # and the receiver states what it always states
    assert set(out["gps_h_acc"]) == {3.5}


def test_a_slipping_animal_is_seen_by_course_and_lateral_force() -> None:
    # given an animal that slips by 0.3 rad at 2 m/s and turns by 0.5 rad/s
    slipping = {"heading": 1.0, "speed": 2.0, "yaw_rate": 0.5, "slip": 0.3, "slip_acceleration": -0.2}
    sensors = answer({"noisy": 0}, **slipping)
    # then the course is off by the slip, and heading and compass are not
    assert sensors["gps_course"] == pytest.approx(1.3)
    assert sensors["heading_meas"] == pytest.approx(1.0)
    assert sensors["accel_y"] == pytest.approx(2.0 * 0.5 - 0.2)


def test_by_default_neither_ahrs_nor_receiver_err_in_these_ways(native: Make) -> None:
    out = native(Sensors, "double", {}).run(**moving(500))
    for name in ("leaning_pitch", "leaning_roll", "reflected_north", "reflected_east"):
        assert not out[name].any(), name
    # nor where noise is off
    on = {"noisy": 0, "attitude_lean": 1.0, "multipath_rate": 10.0}
    out = native(Sensors, "double", on).run(**moving(500))
    for name in ("leaning_pitch", "leaning_roll", "reflected_north", "reflected_east"):
        assert not out[name].any(), name


def test_for_equal_seeds_plant_and_sensors_draw_from_different_streams() -> None:
    starts = []
    for block in (Canine, Sensors):
        model = Model(block, {"seed": 5})
        model.initialize()
        starts += [tuple(model[f"{s.name}[{i}]"] for i in range(1, 7)) for s in block.streams()]
    assert len(starts) == len(set(starts)) == 13


def test_the_model_in_python_is_the_compiled_one(native: Make) -> None:
    truth = moving(60)
    out = native(Sensors, "double", {"seed": 3}).run(**truth)
    model = Model(Sensors, {"seed": 3})
    model.initialize()
    for k in range(60):
        for name, column in truth.items():
            model[name] = column[k]
        model.step()
        assert model.output.tolist() == [out[name][k] for name in Sensors.flat_names("output")]


def test_a_frozen_inertial_unit_repeats_its_sample_and_the_receiver_goes_on() -> None:
    # given a body that turns and gathers speed, whose inertial unit freezes from 1 s to 2 s
    sensors = Model(Sensors, {"frozen_start": 1.0, "frozen_time": 1.0})
    sensors.initialize()
    names = [*(f"{k}_{a}" for k in ("accel", "gyro", "mag") for a in "xyz"), "roll_meas", "pitch_meas"]
    rows = []
    for tick in range(75):
        sensors["speed"] = sensors["north"] = 0.04 * tick
        sensors["heading"] = 0.02 * tick
        sensors.step()
        rows.append([*(sensors[name] for name in (*names, "heading_meas", "gps_fix")), sensors["gps_north"]])
    samples, fixes = np.array(rows)[:, :12], np.array(rows)[:, 12:]
    # then all of it repeats the sample at 1 s, until 2 s
    assert (samples[25:50] == samples[25]).all()
    assert (np.diff(samples, axis=0)[[*range(25), *range(49, 74)]] != 0).all()
    assert fixes[25:50, 0].sum() == 4
    assert np.unique(fixes[25:50, 1]).size > 3


def test_an_error_of_the_heading_is_in_the_ahrs_alone_noisy_or_not() -> None:
    for noisy in (0, 1):
        wrong = answer({"heading_error": 2.0, "noisy": noisy}, heading=2.0)
        right = answer({"noisy": noisy}, heading=2.0)
        assert math.remainder(wrong["heading_meas"] - right["heading_meas"] - 2.0, 2 * math.pi) == (
            pytest.approx(0, abs=1e-12)
        )
        assert (axes(wrong, "mag") == axes(right, "mag")).all()
