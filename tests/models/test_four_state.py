"""The four-state estimator: against the textbook in dense matrices, in float32, on trials, under faults."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

from models.canine import Canine
from models.commands import Command
from models.four_state import FourState
from models.kit.model import Model
from models.sensors import Sensors
from tests.models.motions import fix_ticks, motion, noisy, run_in_circles, walk, without_fixes

Array = np.ndarray[Any, Any]
Columns = dict[str, Array]
Make = Callable[..., Any]

T = FourState.sample_time
G = 9.81
INPUTS = [variable.name for variable in FourState.group("input") if not variable.has_start]
OUTPUTS = FourState.flat_names("output")
BOTH = pytest.mark.parametrize("precision", ["double", "float"])


def dense(packed: Any) -> Array:
    """P in the order of eq. 3.9 from the packed factors of north, east, speed, bias: D, then U by rows."""
    packed = np.asarray(packed, dtype=float)
    U = np.eye(4)
    U[np.triu_indices(4, 1)] = packed[4:]
    return (U @ np.diag(packed[:4]) @ U.T)[np.ix_([2, 3, 0, 1], [2, 3, 0, 1])]


def vectors(out: Columns, name: str, size: int) -> Array:
    """(ticks, size) of a vector state."""
    return np.column_stack([out[f"{name}[{i}]"] for i in range(1, size + 1)])


def covariances(out: Columns, rows: Any) -> list[Array]:
    return [dense(packed) for packed in vectors(out, "covariance", 10)[rows]]


def transition(heading: float) -> Array:
    """exp(F T) with F of eq. 3.12 in the order of eq. 3.9 (CHOICES.md 1); F^3 = 0."""
    F = np.zeros((4, 4))
    F[0, 1], F[2, 0], F[3, 0] = -1, math.cos(heading), math.sin(heading)
    return np.eye(4) + F * T + F @ F * T**2 / 2


def textbook(
    inputs: Columns, sigma: Array, x: Array, P: Array, kind: Any = np.float64
) -> list[tuple[Array, Array]]:
    """The filter of 3.2 in dense matrices from the tick after the first on: (x, P) of every tick."""
    results = []
    C = np.eye(4, dtype=kind)[[0, 2, 3]]
    for k in range(1, len(sigma)):
        heading = inputs["heading_meas"][k]
        force = inputs["accel_x"][k] - G * math.sin(inputs["pitch_meas"][k])
        phi = transition(heading).astype(kind)
        way = np.array([T, 0, T**2 / 2 * math.cos(heading), T**2 / 2 * math.sin(heading)])
        x = phi @ x + (way * force).astype(kind)
        Q = np.diag([sigma[k] ** 2 * T, 1e-3**2, 1e-6**2, 1e-6**2])
        P = (phi @ P @ phi.T + Q.astype(kind)).astype(kind)
        if inputs["gps_fix"][k]:
            r = (0.5 * inputs["gps_h_acc"][k]) ** 2
            R = np.diag([inputs["gps_s_acc"][k] ** 2, r, r]).astype(kind)
            y = np.array([inputs[f"gps_{n}"][k] for n in ("speed", "north", "east")], dtype=kind)
            L = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)  # eq. 3.1
            x = x + L @ (y - C @ x)  # eq. 3.2
            P = (np.eye(4, dtype=kind) - L @ C) @ P  # eq. 3.3
        results.append((x, P))
    return results


# The equations


def test_the_first_fix_sets_the_state_and_p0() -> None:
    """P0 of eq. 3.17 with 1 for the bias (CHOICES.md 1), and the fix's own variance (eq. 3.15)."""
    m = Model(FourState)
    m.initialize()
    m.step()
    assert (m["started"], m["valid"]) == (0, 0)
    for name, value in {"gps_fix": 1, "gps_north": 7, "gps_east": -8, "gps_speed": 1.5}.items():
        m[name] = value
    m["gps_h_acc"], m["gps_s_acc"] = 3.5, 0.1
    m.step()
    assert [m[f"x[{i}]"] for i in (1, 2, 3, 4)] == [1.5, 0, 7, -8]
    P = dense([m[f"covariance[{i}]"] for i in range(1, 11)])
    assert pytest.approx(np.diag([0.1 + 0.1**2, 1, 0.01 + 1.75**2, 0.01 + 1.75**2])) == P
    assert (m["valid"], m["speed"], m["north"], m["east"]) == (1, 1.5, 7, -8)
    assert m["accel_bias_sd"] == 1
    assert m["north_sd"] == pytest.approx(math.hypot(0.1, 1.75))


@pytest.mark.parametrize("fuzzy", [0, 1])
@pytest.mark.parametrize("top", [2.0, 6.0])
def test_the_estimator_equals_the_textbooks_dense_filter(native: Make, fuzzy: int, top: float) -> None:
    inputs = noisy(walk(1500, top), seed=1)
    inputs["pitch_meas"] = 0.2 * np.sin(np.arange(1500) * 0.1)
    inputs = without_fixes(inputs, 40, 50)
    out = native(FourState, "double", {"fuzzy": fuzzy, "gate": 1e4}).run(**inputs)
    assert out["accepted"].sum() == inputs["gps_fix"].sum() - 1  # the first one starts the filter
    x, P = vectors(out, "x", 4), covariances(out, slice(None))
    if fuzzy:
        assert np.ptp(out["sigma"]) > 0.01
    else:
        assert set(out["sigma"]) == {0.1}
    worst_x = worst_P = 0.0
    for k, (expected_x, expected_P) in enumerate(textbook(inputs, out["sigma"], x[0], P[0]), start=1):
        deviation = np.sqrt(np.diag(expected_P))
        worst_x = max(worst_x, np.abs((x[k] - expected_x) / deviation).max())
        worst_P = max(worst_P, np.abs((P[k] - expected_P) / np.outer(deviation, deviation)).max())
    assert worst_x < 1e-6
    assert worst_P < 1e-6


def test_outputs_are_state_and_deviations(native: Make) -> None:
    out = native(FourState).run(**noisy(walk(400), seed=2))
    x, P = vectors(out, "x", 4), covariances(out, slice(None))
    for i, name in enumerate(("speed", "accel_bias", "north", "east")):
        assert np.array_equal(out[name], x[:, i])
        assert out[f"{name}_sd"] == pytest.approx([math.sqrt(p[i, i]) for p in P], rel=1e-12)
    assert np.array_equal(out["sigma_accel"], out["sigma"])
    assert set(out["heading_sd"]) == {math.radians(3)}


def test_the_estimated_heading_is_wrapped() -> None:
    m = Model(FourState)
    m.initialize()
    m["heading_meas"] = 6.5
    m.step()
    assert m["heading"] == pytest.approx(6.5 - 2 * math.pi)


def test_sigma_is_tuned_by_the_speed_before_the_tick_and_has_a_floor(native: Make) -> None:
    """CHOICES.md 6's values; at rest the tuner gives 0 and the floor holds."""
    for speed, sigma in ((0.0, 0.01), (1.0, 1.0667), (4.86, 151.70)):
        inputs = motion(np.full(60, speed), np.zeros(60))
        out = native(FourState).run(**inputs)
        assert out["sigma_accel"][-1] == pytest.approx(sigma, abs=5e-5 if sigma < 2 else 5e-3)
    constant = native(FourState, "double", {"fuzzy": 0, "sigma_constant": 0.25}).run(**inputs)
    assert set(constant["sigma_accel"]) == {0.25}


def test_the_cap_on_sigma_holds_for_a_runner_and_leaves_a_walker_alone(native: Make) -> None:
    for speed, sigma in ((1.0, 1.0667), (3.1, 1.2), (4.86, 1.2)):
        inputs = motion(np.full(60, speed), np.zeros(60))
        out = native(FourState, "double", {"sigma_cap": 1.2}).run(**inputs)
        assert out["sigma_accel"][-1] == pytest.approx(sigma, abs=5e-5)


def test_a_fix_is_believed_no_better_than_the_floors(native: Make) -> None:
    """As if the receiver itself stated 1 m and 0.3 m/s; a floor below what it states changes nothing."""
    inputs = noisy(walk(300), seed=11)
    inputs["gps_h_acc"], inputs["gps_s_acc"] = np.full(300, 0.02), np.full(300, 0.01)
    stated = {**inputs, "gps_h_acc": np.full(300, 1.0), "gps_s_acc": np.full(300, 0.3)}
    floors = {"position_sd_floor": 0.5, "speed_sd_floor": 0.3}
    out, expected = native(FourState, "double", floors).run(**inputs), native(FourState).run(**stated)
    low = native(FourState, "double", {"position_sd_floor": 0.4, "speed_sd_floor": 0.2}).run(**stated)
    assert expected["north_sd"][-1] != native(FourState).run(**inputs)["north_sd"][-1]
    for name in OUTPUTS:
        assert np.array_equal(out[name], expected[name]), name
        assert np.array_equal(low[name], expected[name]), name


def test_the_innovations_of_the_last_accepted_fix_are_states(native: Make) -> None:
    """In turn speed, north, east: their squares over their variances sum to the joint NIS."""
    inputs = noisy(walk(200), seed=12)
    out = native(FourState).run(**inputs)
    k = int(np.flatnonzero(out["accepted"])[-1])
    way = np.array([T, 0, *(T**2 / 2 * f(inputs["heading_meas"][k]) for f in (math.cos, math.sin))])
    phi = transition(inputs["heading_meas"][k])
    prior = phi @ vectors(out, "x", 4)[k - 1] + way * inputs["accel_x"][k]
    Q = np.diag([out["sigma"][k] ** 2 * T, 1e-6, 1e-12, 1e-12])
    P = phi @ covariances(out, [k - 1])[0] @ phi.T + Q
    measured = [0, 2, 3]
    S = P[np.ix_(measured, measured)] + np.diag([0.01, 1.75**2, 1.75**2])
    joint = np.array([inputs[f"gps_{n}"][k] for n in ("speed", "north", "east")]) - prior[measured]
    innovation, variance = vectors(out, "innovation", 3), vectors(out, "innovation_variance", 3)
    assert innovation[k, 0] == pytest.approx(joint[0], abs=1e-9)
    assert variance[k, 0] == pytest.approx(S[0, 0], rel=1e-9)
    nis = (innovation[k] ** 2 / variance[k]).sum()
    assert nis == pytest.approx(joint @ np.linalg.solve(S, joint), rel=1e-7)
    assert np.array_equal(innovation[-1], innovation[k])  # kept until the next one


def test_the_model_in_python_is_the_compiled_one(native: Make) -> None:
    inputs = without_fixes(noisy(walk(300, 5.0), seed=3), 5, 7)
    inputs["accel_x"][50], inputs["gps_north"][[125, 132]] = np.nan, 1e4
    out = native(FourState).run(**inputs)
    m = Model(FourState)
    m.initialize()
    for k in range(300):
        for name in INPUTS:
            m[name] = inputs[name][k]
        m.step()
        assert m.output.tolist() == [out[name][k] for name in OUTPUTS]
    assert out["bad_samples"][-1] == 1


def test_the_float_estimate_equals_the_double_one_up_to_rounding(native: Make) -> None:
    inputs = without_fixes(noisy(walk(1500), seed=4), 30, 40)
    single, double = native(FourState, "float").run(**inputs), native(FourState).run(**inputs)
    for name, tolerance in {"north": 1e-4, "east": 1e-4, "speed": 1e-5, "accel_bias": 1e-5}.items():
        assert np.abs(single[name] - double[name]).max() < tolerance, name
        assert single[f"{name}_sd"] == pytest.approx(double[f"{name}_sd"], rel=2e-3), name


# The covariance in float32


def test_the_plain_covariance_of_the_textbook_turns_indefinite_in_float32() -> None:
    """The reason for the factors: the same sequence, eq. 3.1-3.5 with P itself; in double it holds."""
    inputs = noisy(run_in_circles(1100), seed=5)
    sigma = np.full(1100, 151.7)
    x = np.array([4.86, 0, 0, 0])
    P = np.diag([0.11, 1, 3.0725, 3.0725])
    single = textbook(inputs, sigma, x.astype(np.float32), P.astype(np.float32), np.float32)
    double = textbook(inputs, sigma, x, P)
    assert min(np.diag(p).min() for _, p in single) < 0
    assert min(np.linalg.eigvalsh((p + p.T) / 2).min() for _, p in double) > 0


# Trials


def a_dogs_trial(native: Make, seed: int = 1, **sensors: float) -> tuple[Columns, Columns]:
    """A dog without shaking pack that runs, turns, stops, is recalled: (truth, measurements)."""
    script = [
        (Command.FORWARD, 5.0), (Command.RIGHT, 1.5), (Command.FORWARD, 6.0), (Command.STOP, 4.0),
        (Command.LEFT, 1.2), (Command.FORWARD, 8.0), (Command.RECALL, 8.0), (Command.STOP, 6.0),
    ]  # fmt: skip
    command = np.concatenate([np.full(round(seconds / T), float(c)) for c, seconds in script])
    parameters = {"seed": seed, "shaking": 0, "right_success": 1, "left_success": 1, "start_heading": 0.4}
    dog = native(Canine, "double", parameters)
    names = Canine.flat_names("output")
    start = [dog[name] for name in names]
    out = dog.run(command=command)
    truth = {name: np.concatenate([[s], out[name][:-1]]) for name, s in zip(names, start, strict=True)}
    return truth, native(Sensors, "double", {"seed": seed, **sensors}).run(**truth)


def estimator_inputs(measurements: Columns) -> Columns:
    return {name: measurements[name] for name in INPUTS}


@BOTH
def test_without_noise_the_estimate_of_a_dogs_trial_is_the_truth(native: Make, precision: str) -> None:
    """The dog moves as the filter predicts, so the error is rounding alone."""
    truth, measurements = a_dogs_trial(native, noisy=0)
    assert truth["speed"].max() == pytest.approx(4.86)
    assert np.ptp(truth["heading"]) > 2
    out = native(FourState, precision).run(**estimator_inputs(measurements))
    tolerance = 1e-9 if precision == "double" else 2e-4
    way_out = slice(0, round(25.7 / T))  # on RECALL the dog slips while its body turns
    for name in ("north", "east", "speed"):
        assert np.abs(out[name] - truth[name])[way_out].max() < tolerance, name
    assert np.abs(out["accel_bias"])[way_out].max() < tolerance
    assert out["heading"] == pytest.approx(truth["heading"], abs=1e-6)
    assert out["valid"].all()
    # and the error that the slip leaves decays
    off = np.hypot(out["north"] - truth["north"], out["east"] - truth["east"])
    assert off.max() > 0.1
    assert off[-1] < 0.5 * off.max()


def profile(seconds: float, incline: float = math.radians(10)) -> tuple[Columns, Array]:
    """D.6.1: 3 s at 1 m/s2, a turn of 90 deg at -1 m/s2 in 1 s, then east at 2 m/s up an incline."""
    t = np.arange(round((4 + seconds) / T)) * T
    speed = np.clip(np.minimum(t, np.maximum(6 - t, 2)), 0, 3)
    heading = np.clip((t - 3) * math.pi / 2, 0, math.pi / 2)
    pitch = np.where(t > 4 + T / 2, incline, 0.0)
    return motion(speed, heading, pitch), t


@pytest.mark.parametrize("use_pitch", [1, 0])
@pytest.mark.parametrize("fuzzy", [1, 0])
def test_without_noise_the_profile_is_tracked_exactly_on_the_flat(
    native: Make, use_pitch: int, fuzzy: int
) -> None:
    inputs, _ = profile(15, incline=0)
    out = native(FourState, "double", {"use_pitch": use_pitch, "fuzzy": fuzzy}).run(**inputs)
    for name in ("north", "east", "speed"):
        assert np.abs(out[name] - inputs[f"gps_{name}"]).max() < 1e-9
    assert inputs["gps_speed"][-1] == 2  # CHOICES.md 12


def test_with_pitch_the_incline_changes_nothing(native: Make) -> None:
    inputs, _ = profile(15)
    out = native(FourState).run(**inputs)
    assert np.abs(out["east"] - inputs["gps_east"]).max() < 1e-9
    assert np.abs(out["accel_bias"]).max() < 1e-9


@pytest.mark.parametrize("bias", [0.3, -1.2])
def test_a_wrong_start_converges_to_the_truth_without_noise(native: Make, bias: float) -> None:
    inputs = walk(5000)
    inputs["accel_x"] = inputs["accel_x"] + bias
    out = native(FourState).run(**inputs)
    error = np.abs(out["accel_bias"] - bias)
    assert error[-1] < 0.01 * abs(bias)
    assert error[-1] < 0.5 * error[2500] < 0.25 * error[0]
    assert np.abs(out["speed"] - inputs["gps_speed"])[-500:].max() < 1e-2
    assert np.abs(out["north"] - inputs["gps_north"])[-500:].max() < 2e-2


@pytest.mark.parametrize("bias", [0.5, -0.3])
def test_the_bias_of_a_noisy_accelerometer_is_estimated(native: Make, bias: float) -> None:
    """Walking at 2 m/s for 400 s with the sensors' own noise; shaking off."""
    n = 10_000
    t = np.arange(n) * T
    heading = 0.5 * np.sin(0.1 * t)
    north, east = (np.cumsum(2.0 * T * f(heading)) for f in (np.cos, np.sin))
    measurements = native(Sensors, "double", {"seed": 6, "accel_bias[1]": bias}).run(
        north=north, east=east, speed=np.full(n, 2.0), heading=heading
    )
    out = native(FourState).run(**estimator_inputs(measurements))
    late = out["accel_bias"][n // 2 :]
    assert late.mean() == pytest.approx(bias, abs=0.03)
    assert np.abs(late - bias).max() < 5 * out["accel_bias_sd"][-1] + 0.05


def incline_trial(native: Make, seconds: float, seed: int, **parameters: float) -> Columns:
    """D.6 with the noise of D.12 and D.14, and an accelerometer bias of 0.1 m/s2; constant Q."""
    inputs, _ = profile(seconds)
    inputs = noisy(inputs, seed, accel=1.0, position=0.1, speed=0.05)
    inputs["accel_x"] = inputs["accel_x"] + 0.1
    inputs["gps_h_acc"], inputs["gps_s_acc"] = (
        np.full(len(inputs["accel_x"]), 0.2),
        np.full(len(inputs["accel_x"]), 0.05),
    )
    out: Columns = native(FourState, "double", {"fuzzy": 0, **parameters}).run(**inputs)
    return out


SETTLED = 0.1 + G * math.sin(math.radians(10))  # 1.803 m/s2


@pytest.mark.parametrize(("use_pitch", "bias"), [(0, SETTLED), (1, 0.1)])
def test_on_an_incline_the_bias_absorbs_gravity_unless_pitch_removes_it(
    native: Make, use_pitch: int, bias: float
) -> None:
    """D.6.4 and CHOICES.md 13: the asymptote, over 600 s with the Q of D.7."""
    out = incline_trial(native, 600, 7, use_pitch=use_pitch)
    assert pytest.approx(1.803, abs=5e-4) == SETTLED
    assert out["accel_bias"][-5000:].mean() == pytest.approx(bias, abs=0.02)


def test_the_bias_settles_within_the_trial_with_the_q_of_choice_13(native: Make) -> None:
    """sigma_A = 0.04 and sigma_b = 0.03 per step; ours is per square root of a second: 0.04 / sqrt(0.04)."""
    fast = {"sigma_constant": 0.2, "sigma_bias": 0.03, "use_pitch": 0}
    means = [incline_trial(native, 15, seed, **fast)["accel_bias"][-125:].mean() for seed in range(20)]
    assert np.mean(means) == pytest.approx(SETTLED, abs=0.05)
    slow = [incline_trial(native, 15, seed, use_pitch=0)["accel_bias"][-125:].mean() for seed in range(20)]
    assert np.mean(slow) == pytest.approx(1.4, abs=0.1)


# Faults


@BOTH
def test_a_bad_first_fix_does_not_start_the_filter(native: Make, precision: str) -> None:
    inputs = walk(20)
    inputs["gps_north"] = np.array(inputs["gps_north"])
    inputs["gps_north"][0] = math.nan
    out = native(FourState, precision).run(**inputs)
    assert out["valid"].tolist() == [0.0] * 7 + [1.0] * 13
    assert all(np.isfinite(out[name]).all() for name in OUTPUTS)


# The gate


def standing_then(
    native: Make, seconds_without: float, jump: float, fixes: int, value: str = "gps_north"
) -> tuple[Columns, list[int]]:
    """After 20 s at a walk GPS fails for a time; then a value is `jump` off: (columns, fixes' ticks)."""
    n = round((20 + seconds_without + 10) / T)
    inputs = motion(np.full(n, 1.0), np.zeros(n))
    inputs = without_fixes(inputs, 20, 20 + seconds_without)
    after = np.flatnonzero(inputs["gps_fix"] & (np.arange(n) * T >= 20 + seconds_without))
    inputs[value] = np.array(inputs[value])
    inputs[value][after[:fixes]] += jump
    return native(FourState).run(**inputs), after.tolist()


def test_the_gate_rejects_a_jump_of_50_m_and_accepts_the_next_fixes(native: Make) -> None:
    out, after = standing_then(native, 0, 50, fixes=2)
    assert out["accepted"][after[:4]].tolist() == [0, 0, 1, 1]
    assert out["rejected"][after[:4]].tolist() == [1, 2, 0, 0]
    truth = np.arange(len(out["north"])) * T
    assert np.abs(out["north"] - truth).max() < 0.1
    assert out["bad_fixes"][-1] == 0


def test_after_an_outage_the_gate_accepts_a_jump_of_50_m(native: Make) -> None:
    """5 sqrt(2 1.75^2 + (1.5 * 10)^2) = 76 m after 10 s; 12 m after 0.25 s."""
    out, after = standing_then(native, 10, 50, fixes=100)
    assert out["accepted"][after[:4]].all()
    near, ticks = standing_then(native, 10, 80, fixes=1)
    assert not near["accepted"][ticks[0]]


@pytest.mark.parametrize("value", ["gps_north", "gps_east"])
@pytest.mark.parametrize(("jump", "accepted"), [(12.0, 1), (13.0, 0), (-12.0, 1), (-13.0, 0)])
def test_the_gate_is_12_55_m_wide_between_fixes(native: Make, jump: float, accepted: int, value: str) -> None:
    """7 ticks after the last: 5 sqrt(2 1.75^2 + (1.5 * 0.28)^2) = 12.55 m."""
    out, after = standing_then(native, 0, jump, fixes=1, value=value)
    assert out["accepted"][after[0]] == accepted


@pytest.mark.parametrize(("seconds_without", "width"), [(0, 4.85), (1, 24.81)])
def test_the_gate_of_the_speed_grows_by_4_m_s_in_a_second(
    native: Make, seconds_without: int, width: float
) -> None:
    """5 sqrt(2 0.1^2 + (4 * 0.24)^2) = 4.85 m/s 6 ticks after the last, and (4 * 1.24)^2 24.81 after 31."""
    for jump, accepted in ((0.97 * width, 1), (1.03 * width, 0)):
        out, after = standing_then(native, seconds_without, jump, fixes=1, value="gps_speed")
        assert out["accepted"][after[0]] == accepted


def test_a_bad_fix_between_rejected_ones_is_not_counted_as_one(native: Make) -> None:
    # given fixes 500 m off, of which the third has an accuracy that no receiver states
    n = 1500
    inputs = motion(np.full(n, 1.0), np.zeros(n))
    away = np.flatnonzero(inputs["gps_fix"] & (np.arange(n) * T >= 40))
    inputs["gps_north"][away] += 500
    inputs["gps_h_acc"][away[2]] = 1e4
    out = native(FourState).run(**inputs)
    # then the filter begins anew with the fifth, the fourth that it rejects
    assert out["rejected"][away[:5]].tolist() == [1, 2, 2, 3, 0]
    assert out["bad_fixes"][-1] == 1
    assert (out["north"][away[3]], out["north"][away[4]]) == (
        pytest.approx(away[3] * T, abs=1), pytest.approx(500 + away[4] * T, abs=1)
    )  # fmt: skip


def test_sigma_does_not_widen_the_gate(native: Make) -> None:
    """At running speed the filter's own deviation grows by 30 m/s a tick; the gate's does not."""
    inputs = motion(np.full(1000, 4.86), np.zeros(1000))
    jump = int(np.flatnonzero(inputs["gps_fix"])[100])
    inputs["gps_speed"] = np.array(inputs["gps_speed"])
    inputs["gps_speed"][jump] += 10
    out = native(FourState).run(**inputs)
    assert out["speed_sd"][jump - 1] > 50
    assert not out["accepted"][jump]


def test_after_enough_rejected_fixes_the_filter_begins_anew_and_keeps_the_bias(native: Make) -> None:
    n = 1500
    inputs = motion(np.full(n, 1.0), np.zeros(n))
    inputs["accel_x"] = inputs["accel_x"] + 0.4
    away = np.flatnonzero(inputs["gps_fix"] & (np.arange(n) * T >= 40))
    inputs["gps_north"][away] += 500
    out = native(FourState).run(**inputs)
    assert out["accepted"][away[:3]].tolist() == [0, 0, 0]
    assert out["rejected"][away[:4]].tolist() == [1, 2, 3, 0]
    assert out["north"][away[3]] == inputs["gps_north"][away[3]]
    assert out["north_sd"][away[3]] == pytest.approx(math.hypot(0.1, 1.75))
    assert out["accel_bias"][away[3]] == out["accel_bias"][away[3] - 1] == pytest.approx(0.4, abs=0.1)
    assert out["accel_bias_sd"][away[3]] == pytest.approx(out["accel_bias_sd"][away[3] - 1], rel=0.05)
    assert out["accepted"][away[4:]].all()
    other = native(FourState, "double", {"recovery_fixes": 1}).run(**inputs)
    assert other["north"][away[0]] == inputs["gps_north"][away[0]]


@BOTH
def test_valid_ends_15_s_after_the_last_fix_and_returns_with_the_next(native: Make, precision: str) -> None:
    n = round(45 / T)
    inputs = without_fixes(motion(np.full(n, 1.0), np.zeros(n)), 10, 40)
    out = native(FourState, precision).run(**inputs)
    last, following = 244, 1000  # ceil(6.25 * 39), 40 s
    assert out["age"][last] == 0
    assert inputs["gps_fix"][following]
    expected = np.ones(n)
    expected[last + 376 : following] = 0  # 375 ticks are 15 s
    assert np.array_equal(out["valid"], expected)


def test_rejected_fixes_do_not_keep_the_estimate_valid(native: Make) -> None:
    n = round(60 / T)
    inputs = motion(np.full(n, 1.0), np.zeros(n))
    far = inputs["gps_fix"] & (np.arange(n) * T >= 20)
    inputs["gps_north"][far] += 5e4
    out = native(FourState, "double", {"recovery_fixes": 1000}).run(**inputs)
    assert not out["accepted"][far].any()
    assert out["valid"][round(34 / T)]
    assert not out["valid"][round(36 / T) :].any()


# Consistency


def matched_run(native: Make, seed: int, ticks: int) -> tuple[Array, Columns, Columns, dict[str, float]]:
    """A truth driven by the very noise that the filter assumes (eq. 3.15, 3.16): (x, inputs, columns, Q)."""
    rng = np.random.default_rng(seed)
    q = {"sigma_constant": 0.3, "sigma_bias": 0.01, "sigma_position": 0.01}
    small = {f"initial_{n}_variance": 1e-9 for n in ("speed", "position")}
    heading = 0.01 * np.arange(ticks)
    h_acc, s_acc = np.full(ticks, 2.0), np.full(ticks, 0.2)
    x = np.zeros((ticks, 4))
    x[0] = [15, rng.normal(), 0, 0]
    accel = x[0, 1] + np.sin(0.05 * np.arange(ticks))  # any force serves; this one keeps the speed high
    noise = rng.normal(size=(ticks, 4)) * [0.3 * math.sqrt(T), 0.01, 0.01, 0.01]
    for k in range(1, ticks):
        c, s = math.cos(heading[k]), math.sin(heading[k])
        way = np.array([T, 0, T**2 / 2 * c, T**2 / 2 * s])
        x[k] = transition(heading[k]) @ x[k - 1] + way * accel[k] + noise[k]
    inputs = {
        "accel_x": accel, "pitch_meas": np.zeros(ticks), "heading_meas": heading, "gps_fix": fix_ticks(ticks),
        "gps_speed": x[:, 0] + 0.2 * rng.normal(size=ticks), "gps_north": x[:, 2] + rng.normal(size=ticks),
        "gps_east": x[:, 3] + rng.normal(size=ticks), "gps_h_acc": h_acc, "gps_s_acc": s_acc,
    }  # fmt: skip
    out = native(FourState, "double", {"fuzzy": 0, "gate": 1e3, **q, **small}).run(**inputs)
    return x, inputs, out, q


RUNS, TICKS = 60, 500


def test_nees_and_nis_are_chi_squared_for_noise_as_the_filter_assumes(native: Make) -> None:
    """60 trials of 20 s: the estimate's error at the end (4 degrees each), all innovations (3 each)."""
    nees, nis = [], []
    for seed in range(RUNS):
        x, inputs, out, q = matched_run(native, seed, TICKS)
        estimate = vectors(out, "x", 4)
        error = estimate[-1] - x[-1]
        nees.append(error @ np.linalg.solve(covariances(out, [-1])[0], error))
        fixes = np.flatnonzero(out["accepted"])
        assert len(fixes) == 79
        before = covariances(out, fixes - 1)
        Q = np.diag(
            [q["sigma_constant"] ** 2 * T, *(q[n] ** 2 for n in ("sigma_bias", *["sigma_position"] * 2))]
        )
        for k, P in zip(fixes, before, strict=True):
            phi = transition(inputs["heading_meas"][k])
            c, s = math.cos(inputs["heading_meas"][k]), math.sin(inputs["heading_meas"][k])
            prior = (
                phi @ estimate[k - 1] + np.array([T, 0, T**2 / 2 * c, T**2 / 2 * s]) * inputs["accel_x"][k]
            )
            S = (phi @ P @ phi.T + Q)[np.ix_([0, 2, 3], [0, 2, 3])] + np.diag([0.04, 1, 1])
            innovation = [inputs[f"gps_{n}"][k] for n in ("speed", "north", "east")] - prior[[0, 2, 3]]
            nis.append(innovation @ np.linalg.solve(S, innovation))
    assert 0.005 < stats.chi2.cdf(sum(nees), 4 * len(nees)) < 0.995
    assert 0.005 < stats.chi2.cdf(sum(nis), 3 * len(nis)) < 0.995
    assert stats.kstest(nees, stats.chi2(4).cdf).pvalue > 0.01
    assert stats.kstest(nis, stats.chi2(3).cdf).pvalue > 0.01
