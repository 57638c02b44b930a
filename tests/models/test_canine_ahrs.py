"""The attitude reference: on carriers with known truth, at rest, with bad samples, and in float32."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from models.canine_ahrs import CanineAhrs
from models.kit.model import Model
from tests.models.carriers import (
    DEG,
    Array,
    G,
    T,
    car,
    circle,
    dog,
    measured,
    run,
    slope_of_levelled_force,
    standing,
    walker,
)

NEVER = ((0.0, 1e9),)
AXES = "xyz"


def error(outputs: Mapping[str, Array], signals: Mapping[str, Array], angle: str, after: float) -> Array:
    """Estimate less truth [deg], from a time [s] on."""
    difference = outputs[f"{angle}_meas"] - signals[angle]
    wrapped = np.angle(np.exp(1j * difference)) / DEG
    return np.asarray(wrapped[signals["time"] > after])


def rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


def bias_errors(outputs: Mapping[str, Array], bias: tuple[float, float, float]) -> Array:
    """Of the bias at the end, (3,) deg/s."""
    return np.array([(outputs[f"gyro_bias_{a}"][-1] - b) / DEG for a, b in zip(AXES, bias, strict=True)])


# Carriers


@pytest.mark.parametrize(("seed", "gain"), [(3, 0.03), (6, 0.05), (7, 0.04)])
def test_a_cars_acceleration_stays_in_the_levelled_force(seed: int, gain: float) -> None:
    """A slope of 1 is right. A fixed step of 0.033 rad/s (Madgwick) gives 0.28 to 0.35 on these drives."""
    carrier = car(seed=seed)
    signals = measured(carrier)
    outputs = run(signals, {"gain": gain})
    moving = signals["time"] > 20
    assert slope_of_levelled_force(signals, outputs["pitch_meas"], moving) == pytest.approx(1, abs=0.05)
    assert rms(error(outputs, signals, "pitch", 20)) < 1.0
    assert rms(error(outputs, signals, "roll", 20)) < 1.0
    assert rms(error(outputs, signals, "heading", 60)) < 1.5
    assert np.abs(bias_errors(outputs, carrier.gyro_bias)).max() < 0.05


def test_velocities_from_noisy_positions_hide_no_rest() -> None:
    """0.1 m at 4 Hz are 0.57 m/s of velocity, at rest too; the accuracy that is stated says so."""
    carrier = car(fix_period=0.25, by_difference=True, position_noise=0.1)
    signals = measured(carrier)
    outputs = run(signals)
    assert np.abs(bias_errors(outputs, carrier.gyro_bias)).max() < 0.05
    assert rms(error(outputs, signals, "pitch", 20)) < 1.0
    believed = run({**signals, "gps_s_acc": 0 * signals["gps_s_acc"]})
    assert rms(error(believed, signals, "pitch", 20)) > 1.3 * rms(error(outputs, signals, "pitch", 20))


def test_a_car_without_fixes_swallows_more_of_its_acceleration() -> None:
    """What the fixes are for: the same drive with and without them."""
    pitch = {}
    for name, lost in (("fixes", ()), ("none", NEVER)):
        signals = measured(car(lost=lost))
        pitch[name] = rms(error(run(signals), signals, "pitch", 20))
    assert pitch["none"] > 3 * pitch["fixes"]


def test_a_cars_pitch_stays_through_outages_of_half_the_time() -> None:
    """Where fixes have stopped, the gyro is trusted for longer: braking would tilt it."""
    signals = measured(car(lost=tuple((start, start + 10.0) for start in range(30, 300, 20))))
    outputs = run(signals)
    slope = slope_of_levelled_force(signals, outputs["pitch_meas"], signals["time"] > 20)
    assert slope == pytest.approx(1, abs=0.05)
    pitch = rms(error(outputs, signals, "pitch", 20))
    assert pitch < 0.8
    assert rms(error(run(signals, {"alone_share": 1}), signals, "pitch", 20)) > 1.3 * pitch


def test_an_offset_of_the_mounting_goes_into_the_heading() -> None:
    """The course leads the body by 0.1 rad; the pitch does not suffer."""
    signals = measured(car(slip=0.1))
    outputs = run(signals)
    assert error(outputs, signals, "heading", 60).mean() == pytest.approx(0.1 / DEG, abs=0.5)
    assert rms(error(outputs, signals, "pitch", 20)) < 1.0


def test_a_walker_in_tight_turns() -> None:
    carrier = walker()
    signals = measured(carrier)
    outputs = run(signals)
    assert rms(error(outputs, signals, "pitch", 20)) < 0.6
    assert rms(error(outputs, signals, "roll", 20)) < 0.6
    assert rms(error(outputs, signals, "heading", 20)) < 3.0
    assert np.abs(bias_errors(outputs, carrier.gyro_bias)).max() < 0.05


def test_a_dogs_strides_average_out() -> None:
    """Swings of +-5 m/s2 forward and +-6 m/s2 upward; the accelerometers' bias of 0.1 m/s2 is 0.6 deg."""
    signals = measured(dog(gyro_bias=(0, 0, 0)))
    outputs = run(signals, {"bias_gain": 0})
    assert rms(error(outputs, signals, "pitch", 20)) < 0.9
    assert rms(error(outputs, signals, "roll", 20)) < 0.9
    assert rms(error(outputs, signals, "heading", 20)) < 3.0


def test_motion_shows_the_bias_of_a_dog_that_never_rests() -> None:
    """0.5 deg/s forward alone would tilt the attitude by 0.5 deg/s / gain = 12 deg."""
    carrier = dog(400)
    signals = measured(carrier)
    left, taken = (run(signals, {"bias_gain": gain}) for gain in (0, 0.01))
    for angle in ("pitch", "roll"):
        assert rms(error(taken, signals, angle, 100)) < 0.8 * rms(error(left, signals, angle, 100))
    assert abs(bias_errors(taken, carrier.gyro_bias)[2]) < 0.1


def test_a_circle_with_velocities_from_positions() -> None:
    """The pitch's offset is the accelerometers'. The course is half a second late: 2.9 deg, and noise."""
    carrier = circle()
    signals = measured(carrier)
    outputs = run(signals)
    assert rms(error(outputs, signals, "pitch", 20)) < 0.8
    assert rms(error(outputs, signals, "roll", 20)) < 0.8
    assert rms(error(outputs, signals, "heading", 70)) < 5.0
    assert np.abs(bias_errors(outputs, carrier.gyro_bias)).max() < 0.05


# At rest


@pytest.mark.parametrize("noise", [0.005, 0.05, 1.0])
@pytest.mark.parametrize("lost", [(), NEVER])
def test_at_rest_the_bias_is_found_whatever_the_accelerometers_noise(
    noise: float, lost: tuple[tuple[float, float], ...]
) -> None:
    carrier = standing(accel_bias=0.0, accel_noise=noise, lost=lost)
    signals = measured(carrier)
    outputs = run(signals)
    assert np.abs(bias_errors(outputs, carrier.gyro_bias)).max() < 0.03
    tolerance = 0.3 + 6 * noise / G / DEG / math.sqrt(25 * 10)
    assert abs(error(outputs, signals, "pitch", 20)).max() < tolerance
    assert abs(error(outputs, signals, "roll", 20)).max() < tolerance
    late = outputs["heading_meas"][signals["time"] > 20]
    assert abs(late[-1] - late[0]) / DEG < 1.0  # 40 s of 0.03 deg/s


def test_a_turn_at_a_steady_rate_is_not_taken_for_a_bias() -> None:
    """5.7 deg/s on a smooth circle without fixes: more than the bias of any gyro."""
    carrier = circle(gyro_bias=(0, 0, 0), lost=NEVER)
    still = replace(carrier, pitch=0.0, upward=0.0)
    assert abs(run(measured(still))["gyro_bias_z"][-1]) / DEG < 0.05


def test_a_steady_drive_is_not_rest_while_fixes_show_it() -> None:
    """2 deg/s at 10 m/s, with as little vibration as at rest."""
    carrier = standing()
    n = len(carrier.speed)
    drive = replace(
        carrier, speed=np.full(n, 10.0), heading=np.arange(n) * 0.02 * DEG, roll=0.0, gyro_bias=(0, 0, 0)
    )
    assert abs(run(measured(drive))["gyro_bias_z"][-1]) / DEG < 0.2
    assert run(measured(replace(drive, lost=NEVER)))["gyro_bias_z"][-1] / DEG == pytest.approx(2, abs=0.2)


def test_the_first_attitude_is_an_average_until_it_moves() -> None:
    """With 1 m/s2 of noise one sample is off by some deg, the average over 8 s by 0.5 deg."""
    carrier = standing(8.0, accel_noise=1.0, accel_bias=0.0, gyro_bias=(0, 0, 0), lost=NEVER)
    errors = [
        error(run(signals), signals, "pitch", -1) for signals in (measured(carrier, s) for s in range(1, 9))
    ]
    assert rms(np.array([pitch[0] for pitch in errors])) > 2.0
    assert rms(np.array([pitch[-1] for pitch in errors])) < 1.0


def test_a_carrier_that_moves_from_the_first_sample_on_is_averaged_over_the_start_time() -> None:
    """A stride of a dog swings the force, so that one sample may be off by 10 deg and more."""
    dogs = [measured(dog(8, seed, accel_bias=0.0, lost=NEVER)) for seed in range(8)]
    errors = [error(run(signals), signals, "pitch", -1) for signals in dogs]
    first, averaged = (rms(np.array([pitch[k] for pitch in errors])) for k in (0, 75))
    assert first > 8
    assert averaged < 0.5 * first


# The magnetometer


@pytest.mark.parametrize("heading", [-3.0, 0.5, 1.6])
def test_the_magnetometer_gives_the_heading_of_a_tilted_body(heading: float) -> None:
    """A field of 24 uT north and 43 uT down, turned into the body by hand; declination 8 deg east."""
    roll, pitch, declination = -12 * DEG, 8 * DEG, 8 * DEG
    carrier = replace(standing(), heading=np.full(6000, heading), accel_bias=0.0)
    signals = measured(carrier)
    magnetic = heading - declination
    forward, right = 24e-6 * math.cos(magnetic), -24e-6 * math.sin(magnetic)
    level = math.cos(pitch) * 43e-6 + math.sin(pitch) * forward
    field = (
        math.cos(pitch) * forward - math.sin(pitch) * 43e-6,
        math.cos(roll) * right + math.sin(roll) * level,
        math.cos(roll) * level - math.sin(roll) * right,
    )
    for axis, value in zip(AXES, field, strict=True):
        signals[f"mag_{axis}"] = np.full(len(signals["time"]), value)
    signals["mag_x"][500:600] = np.nan  # is skipped
    outputs = run(signals, {"use_magnetometer": 1, "declination": declination})
    assert abs(error(outputs, signals, "heading", 5)).max() < 0.7


def test_a_magnetometer_that_is_not_there_is_counted_and_turns_nothing() -> None:
    ahrs = at_rest({"use_magnetometer": 1})
    for _ in range(50):
        ahrs.step()
    assert ahrs["bad_fields"] == 50
    assert ahrs["heading_meas"] == 0


# Samples and fixes that are wrong


def at_rest(parameters: dict[str, float] | None = None) -> Model:
    ahrs = Model(CanineAhrs, parameters)
    ahrs.initialize()
    ahrs["accel_z"] = -G
    return ahrs


@pytest.mark.parametrize("name", ["accel_x", "gyro_z"])
@pytest.mark.parametrize("value", [math.nan, math.inf, 1e4])
def test_a_bad_sample_is_skipped_held_and_counted(name: str, value: float) -> None:
    signals = measured(walker(40.0))
    outputs = run(signals)
    bad = {**signals, name: signals[name].copy()}
    bad[name][600:603] = value
    held = run(bad)
    assert all(np.isfinite(values).all() for values in held.values())
    assert held["roll_meas"][602] == pytest.approx(
        held["roll_meas"][599], abs=1e-3
    )  # a fix moves it a little
    # 0.12 s unseen of a walk is some deg, and they go: the heading's by the courses
    assert abs(held["pitch_meas"][-1] - outputs["pitch_meas"][-1]) / DEG < 3
    ahrs = at_rest()
    ahrs.step()
    ahrs[name] = value
    ahrs.step()
    assert ahrs["bad_samples"] == 1


def test_after_samples_were_missing_the_attitude_is_kept_and_the_heading_found_anew() -> None:
    """2 s are missing, in which the carrier turned: the next course sets the heading."""
    signals = measured(walker(60.0, speed_noise=0.0))
    gone = {**signals, "gyro_x": signals["gyro_x"].copy()}
    gone["gyro_x"][750:800] = np.nan
    outputs = run(gone)
    assert outputs["roll_meas"][799] == outputs["roll_meas"][750]
    after = signals["time"] > 33
    assert abs(np.angle(np.exp(1j * (outputs["heading_meas"] - signals["heading"])))[after]).max() / DEG < 10
    assert rms(error(outputs, signals, "pitch", 33)) < 3


def fix(ahrs: Model, speed: float, course: float = 0.0, accuracy: float = 0.1) -> None:
    """A tick with a fix."""
    ahrs["gps_fix"], ahrs["gps_speed"], ahrs["gps_course"], ahrs["gps_s_acc"] = 1, speed, course, accuracy
    ahrs.step()
    ahrs["gps_fix"] = 0


def steps(ahrs: Model, ticks: int) -> None:
    for _ in range(ticks):
        ahrs.step()


def test_the_heading_is_as_uncertain_as_the_courses_that_showed_it() -> None:
    ahrs = at_rest()
    ahrs.step()
    assert ahrs["heading_meas_sd"] == 500
    # when two courses come, each off by a slip of 0.5 rad and 0.1 of 2 m/s
    for courses in (1, 2):
        fix(ahrs, 2.0, course=1.0)
        expected = math.sqrt((0.5**2 + 0.05**2) / courses)
        assert ahrs["heading_meas_sd"] == pytest.approx(expected, rel=0.01)
        assert ahrs["heading_meas"] == pytest.approx(1.0, abs=1e-3)
    # then a gap in which it may turn
    ahrs["gyro_x"] = math.nan
    steps(ahrs, 6)
    assert ahrs["heading_meas_sd"] < 1
    ahrs.step()
    assert ahrs["heading_meas_sd"] == 500


def test_until_a_course_shows_the_heading_the_magnetometer_does_as_well_as_one() -> None:
    ahrs, off = at_rest({"declination": 0.1}), at_rest({"start_by_magnetometer": 0})
    for model in (ahrs, off):
        model["mag_x"], model["mag_y"] = 2e-5 * math.cos(0.9), -2e-5 * math.sin(0.9)
        steps(model, 2)
    assert ahrs["heading_meas"] == pytest.approx(1.0)
    assert ahrs["heading_meas_sd"] == pytest.approx(0.5, rel=1e-3)
    assert (off["heading_meas"], off["heading_meas_sd"]) == (0, 500)
    # then the first course counts, and no field does
    ahrs["mag_x"] = -2e-5
    steps(ahrs, 10)
    assert ahrs["heading_meas"] == pytest.approx(1.0)
    fix(ahrs, 5.0, course=1.4)
    assert ahrs["heading_meas"] == pytest.approx(1.4, abs=1e-3)


def test_a_speed_from_before_a_gap_is_not_used() -> None:
    ahrs = at_rest()
    ahrs.step()
    fix(ahrs, 3.0)
    ahrs["gyro_x"] = math.nan
    steps(ahrs, 6)
    assert (ahrs["speed"], ahrs["moving"]) == (3, 1)
    ahrs.step()
    assert (ahrs["speed"], ahrs["moving"]) == (0, 0)


def test_an_old_fix_tells_of_no_motion() -> None:
    ahrs = at_rest({"hold_time": 1})
    ahrs.step()
    fix(ahrs, 3.0)
    steps(ahrs, 25)
    assert ahrs["moving"]
    ahrs.step()
    assert not ahrs["moving"]


def test_a_bad_fix_tells_no_course() -> None:
    ahrs = at_rest()
    ahrs.step()
    fix(ahrs, 3.0, course=1.0)
    fix(ahrs, 3.0, course=2.0, accuracy=math.nan)
    assert ahrs["heading_meas"] == pytest.approx(1.0, abs=1e-3)


def test_a_change_of_speed_counts_among_the_forces_of_the_window() -> None:
    """1 m/s in a tick, in g."""
    ahrs = at_rest()
    ahrs.step()
    fix(ahrs, 2.0)
    before = ahrs["force_sum[1]"]
    fix(ahrs, 3.0)
    assert ahrs["force_sum[1]"] - before == pytest.approx(1 / (G * T))


def test_windows_fill_where_every_tick_has_a_fix() -> None:
    ahrs = at_rest()
    for _ in range(28):
        fix(ahrs, 0.0)
    assert ahrs["rested"] == 1


def test_the_quietest_noise_may_rise_by_a_hundredth_in_a_window() -> None:
    ahrs = at_rest()
    steps(ahrs, 25)
    assert ahrs["quiet_rate"] == 1e-6
    for k in range(25):
        ahrs["gyro_z"] = 0.01 * (-1) ** k
        ahrs.step()
    assert ahrs["quiet_rate"] == pytest.approx(1.01e-6)


def test_a_body_that_is_shaken_does_not_rest() -> None:
    ahrs = at_rest()
    steps(ahrs, 50)
    assert ahrs["resting"]
    for k in range(25):
        ahrs["accel_x"] = 0.5 * (-1) ** k
        ahrs.step()
    assert not ahrs["resting"]


def test_gravity_teaches_a_bias_after_the_start_time_and_a_bounded_one() -> None:
    ahrs = at_rest({"bias_gain": 1, "largest_bias": 1e-3})
    ahrs["gyro_x"] = 0.5
    steps(ahrs, 49)
    assert [ahrs[f"bias[{i}]"] for i in (1, 2, 3)] == [0, 0, 0]
    largest = 0.0
    for _ in range(200):
        ahrs.step()
        largest = max(largest, *(abs(ahrs[f"bias[{i}]"]) for i in (1, 2, 3)))
    assert largest == pytest.approx(1e-3)


def test_a_fix_out_of_range_is_counted_and_turns_nothing() -> None:
    ahrs = at_rest()
    ahrs.step()
    ahrs["gps_fix"], ahrs["gps_speed"], ahrs["gps_course"] = 1, math.nan, 1.0
    ahrs.step()
    ahrs["gps_speed"], ahrs["gps_course"] = 3.0, math.inf
    ahrs.step()
    assert ahrs["bad_fixes"] == 2
    assert (ahrs["heading_meas"], ahrs["pitch_meas"]) == (0, 0)


def test_the_outputs_stay_finite_in_any_attitude_and_at_any_rate() -> None:
    """Noise over the whole declared ranges, and then a tumble through upside down."""
    rng = np.random.default_rng(2)
    ahrs = at_rest()
    for k in range(2000):
        for variable in CanineAhrs.group("input"):
            ahrs[variable.name] = rng.uniform(variable.min or 0.0, variable.max or 0.0)
        ahrs["gps_fix"] = k % 3 == 0
        ahrs.step()
        assert np.isfinite(ahrs.output).all()
        assert np.isfinite(ahrs.state).all()
    assert abs(ahrs["pitch_meas"]) <= math.pi / 2


def test_a_full_turn_about_each_axis_comes_back() -> None:
    """A body rolls, and then pitches, once round in 4 s, in steps of 3.6 deg."""
    for axis, across, sign in (("x", "y", -1), ("y", "x", 1)):
        ahrs = at_rest({"largest_bias": 0})
        ahrs.step()
        ahrs[f"gyro_{axis}"] = 90 * DEG
        for k in range(1, 101):
            turned = 90 * DEG * k * T
            ahrs[f"accel_{across}"], ahrs["accel_z"] = sign * G * math.sin(turned), -G * math.cos(turned)
            ahrs.step()
            assert ahrs["pitch_meas"] == pytest.approx(
                0 if axis == "x" else math.asin(math.sin(turned)), abs=0.01
            )
        assert ahrs["roll_meas"] / DEG == pytest.approx(0, abs=0.3)


def test_the_heading_turns_about_the_vertical_and_not_about_the_body() -> None:
    """Rolled by 60 deg, a yaw of 10 deg/s is 5 deg/s about down and 8.66 about right."""
    ahrs = Model(CanineAhrs, {"largest_bias": 0})
    ahrs.initialize()
    ahrs["accel_y"], ahrs["accel_z"] = -G * math.sin(60 * DEG), -G * math.cos(60 * DEG)
    ahrs["gyro_y"], ahrs["gyro_z"] = 10 * DEG * math.sin(60 * DEG), 10 * DEG * math.cos(60 * DEG)
    for _ in range(50):
        ahrs.step()
    assert ahrs["heading_meas"] / DEG == pytest.approx(10 * 50 * T - 10 * T, abs=0.5)
