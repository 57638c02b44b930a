"""Our own estimator: against an independent filter with a dense P, and what each of its parts is for."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from models.canine_tracker import CanineTracker
from tests.models.motions import Array, Columns, G, T, motion, without_fixes

Make = Callable[..., Any]


def carried(
    speed: Array,
    heading: Array,
    *,
    seed: int,
    lead: float = 0.0,
    offset: float = 0.0,
    swing: float = 1.0,
    shake: float = 0.1,
    hidden: Any = 0.0,
    noise: float = 0.1,
) -> Columns:
    """Signals of a unit whose course leads its heading by `offset` + `lead` * turn rate.

    Its stride of 2 Hz pushes by `swing` [m/s2] and turns it by `shake` [rad/s] while it moves; `hidden`
    [m/s2] is felt although nothing accelerates, as by a wrong pitch.
    """
    rng = np.random.default_rng(seed)
    n = len(speed)
    t = np.arange(n) * T
    rate = np.gradient(np.unwrap(heading)) / T
    course = np.unwrap(heading) + offset + lead * rate
    velocity = speed * np.exp(1j * course)
    push = np.gradient(velocity) / T * np.exp(-1j * heading)  # ahead + 1j * to the right
    stride = np.sin(4 * math.pi * t) * (speed > 0.05)
    signals = motion(speed, course)
    return signals | {
        "accel_x": push.real + swing * stride + hidden + rng.normal(0, 0.02, n),
        "accel_y": push.imag + rng.normal(0, 0.02, n),
        "accel_z": -G + 0.5 * swing * stride + rng.normal(0, 0.02, n),
        "gyro_x": shake * stride + rng.normal(0, 1e-3, n),
        "gyro_y": rng.normal(0, 1e-3, n),
        "gyro_z": rate + rng.normal(0, 1e-3, n),
        "heading_meas": (heading + math.pi) % (2 * math.pi) - math.pi,
        "gps_course": (course + rng.normal(0, noise, n) + math.pi) % (2 * math.pi) - math.pi,
        "gps_speed": np.abs(speed + rng.normal(0, noise, n)),
        "gps_north": signals["gps_north"] + rng.normal(0, 0.2, n),
        "gps_east": signals["gps_east"] + rng.normal(0, 0.2, n),
        "true_north": signals["gps_north"],
        "true_east": signals["gps_east"],
        "true_speed": speed,
    }


def ramps(duration: float, *points: tuple[float, float]) -> Array:
    """Speeds on each tick, straight between (time, speed)."""
    times, speeds = np.array(points).T
    return np.asarray(np.interp(np.arange(round(duration / T)) * T, times, speeds))


def turns(n: int, size: float = 0.8) -> Array:
    """A heading that turns to both sides, by 0.5 rad/s at most for a size of 0.8."""
    t = np.arange(n) * T
    return np.asarray(size * np.sin(0.4 * t) + size * 0.6 * np.sin(0.31 * t + 1))


def as_received(signals: Columns) -> Columns:
    """The values of a fix stand until the next one comes."""
    latest = np.maximum.accumulate(np.where(signals["gps_fix"], np.arange(len(signals["gps_fix"])), 0))
    held = {n: v[latest] for n, v in signals.items() if n.startswith("gps_") and n != "gps_fix"}
    return signals | held


def run(native: Make, signals: Columns, precision: str = "double", **parameters: float) -> Columns:
    inputs = {n: v for n, v in as_received(signals).items() if not n.startswith("true_")}
    out: Columns = native(CanineTracker, precision, parameters).run(**inputs)
    return out


def error(out: Columns, signals: Columns, tick: int = -1) -> float:
    """Of the position [m]."""
    return math.hypot(
        out["north"][tick] - signals["true_north"][tick], out["east"][tick] - signals["true_east"][tick]
    )


class Reference:
    """The filter again: P itself, matrices, no CasADi; values are those of the defaults."""

    def __init__(self) -> None:
        self.x, self.P = np.zeros(4), np.zeros((4, 4))
        self.slip, self.S = np.zeros(2), np.diag([0.3**2, 0.5**2])
        self.sigma, self.T, self.learned_T = 0.4, 0.7, 0.7
        self.age = self.moving = self.counted = 0
        self.means, self.motion = np.zeros((2, 3)), np.zeros(2)
        self.least = np.full(2, 1e6)
        self.errors = np.full(2, self.sigma**2 / 4 * 5)
        self.rehearsal: dict[str, Any] = {}
        self.long_bias, self.long_bias_sd = 0.0, 1.0
        self.started = self.still = False
        self.fix_sd = self.sure = 0.0
        self.fixes_move = False

    def step(self, u: dict[str, float]) -> None:
        roll, pitch, heading = u["roll_meas"], u["pitch_meas"], u["heading_meas"]
        to_level = np.array(
            [[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]]
        )
        to_level = to_level @ np.array(
            [[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]]
        )
        force, rate = (np.array([u[f"{s}_{a}"] for a in "xyz"]) for s in ("accel", "gyro"))
        ahead, right, _ = to_level @ force
        yaw_rate = ((to_level @ rate)[2] + math.sin(pitch) * rate[0]) / math.cos(pitch) ** 2
        beta = float(np.clip(self.slip @ [1, yaw_rate], -1, 1))
        a = ahead * (1 - beta**2 / 2 + beta**4 / 24) + right * (beta - beta**3 / 6)
        self.age += 1
        # at rest?
        for i, sample in enumerate((force, rate)):
            off = sample - self.means[i]
            self.means[i] += T / 0.3 * off
            self.motion[i] += T / 0.3 * (off @ off - self.motion[i])
        quiet = (self.motion < self.least / 4).any() and (self.motion < 2 * self.least).all()
        told = self.age * T < 0.6 and self.fixes_move
        self.still = bool(self.moving >= 40 and quiet and not told)
        for one in self.rehearsal.get("speeds", []):
            one["v"] += T * (a - one["bias"] - (one["v"] - one["mean"]) / one["T"])
        if self.rehearsal:
            self.rehearsal["age"] += 1
        if self.started:
            self.predict(a, heading + beta)
            if self.still:
                self.correct(0, 0.0, 0.05**2)
        if u["gps_fix"]:
            self.fix(u, heading, yaw_rate)

    def predict(self, a: float, course: float) -> None:
        h = T / self.T
        kept, driven = (1.0, 0.0) if self.still else (1 - h + h**2 / 2, T * (1 - h / 2))
        F = np.eye(4)
        F[0] = [kept, -driven, 0, 0]
        after = kept * self.x[0] + driven * (a - self.x[1])
        for i, part in ((2, math.cos(course)), (3, math.sin(course))):
            F[i] += T / 2 * part * (F[0] + np.eye(4)[0])
        step = T / 2 * (self.x[0] + after)
        aside = 2 * self.age * (0.1 * after * T) ** 2 + 1e-12
        self.x = np.array(
            [after, self.x[1], self.x[2] + step * math.cos(course), self.x[3] + step * math.sin(course)]
        )
        Q = [self.sigma**2 * T, 1e-6 + (self.sigma / 4 / self.T) ** 2 * T, aside, aside]
        self.P = F @ self.P @ F.T + np.diag(Q)

    def correct(self, i: int, measured: float, variance: float) -> float:
        expected = self.P[i, i] + variance
        innovation = measured - self.x[i]
        gain = self.P[:, i] / expected
        rest = np.eye(4) - np.outer(gain, np.eye(4)[i])
        self.x = self.x + gain * innovation
        self.P = rest @ self.P @ rest.T + variance * np.outer(gain, gain)
        return float(innovation**2 / expected)

    def fix(self, u: dict[str, float], heading: float, yaw_rate: float) -> None:
        z, course = u["gps_speed"], u["gps_course"]
        r, r_position = max(u["gps_s_acc"], 0.1) ** 2, max(u["gps_h_acc"] / 2, 0.25) ** 2
        if not self.started:
            self.x = np.array([z, -z / 0.7, u["gps_north"], u["gps_east"]])
            self.P = np.diag([0.1 + r, 1, 0.01 + r_position, 0.01 + r_position])
            self.started = True
        else:
            if z > 0.5:
                self.S = self.S + np.diag([0.02**2, 0.005**2]) * self.age * T
                h = np.array([1, yaw_rate])
                off = np.clip(math.remainder(course - heading - self.slip @ h, 2 * math.pi), -1, 1)
                gain = self.S @ h / (h @ self.S @ h + 0.2**2 + r / z**2)
                self.slip = self.slip + gain * off
                self.S = self.S - np.outer(gain, h @ self.S)
                self.moving += 1
                self.least = np.minimum(self.motion, (1.002 if z < 2 else 1) * self.least)
            if self.rehearsal and self.rehearsal["age"] * T > 4.99:
                self.compare(z)
            if self.learned_T != self.T:
                self.T = self.learned_T
                self.x[1] = self.long_bias - self.x[0] / self.T
                self.P[1, :] = self.P[:, 1] = 0
                self.P[1, 1] = self.long_bias_sd**2 + 0.1 / self.T**2
            for i, name in ((0, "gps_speed"), (2, "gps_north"), (3, "gps_east")):
                self.correct(i, u[name], r if i == 0 else r_position)
        self.age, self.fix_sd = 0, math.sqrt(r_position)
        self.sure += (z - 2 * u["gps_s_acc"] - self.sure) / 4
        self.fixes_move = z > 0.5 or self.sure > 0
        if not self.rehearsal:
            v = self.x[0]
            brisk = {"v": v, "T": 0.7, "bias": self.x[1] + v / self.T - v / 0.7, "mean": 0.0}
            long = {"v": v, "T": 60.0, "bias": self.long_bias, "mean": v}
            self.rehearsal = {"age": 0, "from": v, "speeds": [brisk, long]}

    def compare(self, z: float) -> None:
        lasting = self.rehearsal["age"] * T
        if lasting < 6 and max(z, self.rehearsal["from"]) > 0.5:
            off = np.array([z - one["v"] for one in self.rehearsal["speeds"]])
            self.counted += 1
            self.errors += max(1 / (self.counted + 2), 1 / 8) * (off**2 - self.errors)
            self.long_bias -= 0.3 * off[1] / lasting
        good = self.errors[1] * 4 < self.errors[0]
        self.learned_T = 60.0 if good else 0.7
        self.long_bias_sd = math.sqrt(self.errors[1]) / 5
        self.sigma = math.sqrt(4 * max(self.errors[int(good)], (2 * 0.1) ** 2) / 5)
        self.rehearsal = {}


def test_the_tracker_agrees_with_an_independent_filter(native: Make) -> None:
    """Two minutes: walking, standing, driving off; two outages, one of them ends at rest."""
    speed = ramps(
        120,
        (4, 0),
        (6, 1.2),
        (50, 1.4),
        (51, 0),
        (70, 0),
        (73, 8),
        (90, 3),
        (108, 10),
        (113, 0.2),
        (117, 0.2),
        (120, 6),
    )
    signals = carried(speed, turns(len(speed)), seed=1, lead=0.3, offset=0.1, hidden=0.2)
    n = len(speed)
    t = np.arange(n) * T
    roll, pitch = 0.2 * np.sin(0.5 * t), 0.1 + 0.15 * np.sin(0.7 * t)
    tilted = signals | {"roll_meas": roll, "pitch_meas": pitch}
    tilted["accel_x"] = signals["accel_x"] * np.cos(pitch) + G * np.sin(pitch)
    tilted = as_received(without_fixes(without_fixes(tilted, 45, 55), 95, 105))
    out = run(native, tilted, gate=1e6)
    reference = Reference()
    names = [n for n in tilted if not n.startswith(("true_", "mag_"))]
    for k in range(n):
        reference.step({name: float(tilted[name][k]) for name in names})
        assert bool(out["still"][k]) == reference.still, k
        if not reference.started:
            continue
        sd = np.sqrt(np.diag(reference.P))
        x = np.array([out[f"x[{i}]"][k] for i in range(1, 5)])
        assert (np.abs(x - reference.x) < 1e-6 * sd).all(), k
        north_sd, east_sd = (math.hypot(sd[i], reference.fix_sd) for i in (2, 3))
        for name, stated in (("speed", sd[0]), ("north", north_sd), ("east", east_sd)):
            assert out[f"{name}_sd"][k] == pytest.approx(stated, rel=1e-6), (k, name)
        assert [out["slip[1]"][k], out["slip[2]"][k]] == pytest.approx(list(reference.slip), abs=1e-9)
        assert out["accel_bias"][k] == pytest.approx(reference.long_bias, abs=1e-7)
        assert out["accel_bias_sd"][k] == pytest.approx(reference.long_bias_sd, rel=1e-6)
        errors = [out["rehearsal_errors[1]"][k], out["rehearsal_errors[2]"][k]]
        assert errors == pytest.approx(list(reference.errors), rel=1e-6)
        assert out["sigma"][k] == pytest.approx(reference.sigma, rel=1e-7)
        assert out["reversion"][k] == pytest.approx(1 / reference.T)
    assert out["still"].any()
    assert set(np.round(1 / out["reversion"], 1)) == {0.7, 60.0}


# Slip


@pytest.mark.parametrize(("offset", "lead"), [(0.0, 0.45), (0.15, 0.0), (-0.2, 0.3), (0.0, -0.3)])
def test_offset_and_lead_of_the_course_are_learned(native: Make, offset: float, lead: float) -> None:
    speed = np.full(3000, 1.3)
    signals = carried(speed, turns(3000), seed=2, lead=lead, offset=offset)
    out = run(native, signals)
    assert out["slip[1]"][-500:].mean() == pytest.approx(offset, abs=0.03)
    assert out["slip[2]"][-500:].mean() == pytest.approx(lead, abs=0.06)


def test_slip_keeps_place_and_bias_right_in_turns(native: Make) -> None:
    """A unit held 0.6 m ahead feels V * course rate * sin(slip) to the side, which is no bias."""
    signals = carried(np.full(3000, 1.3), turns(3000, 1.6), seed=3, lead=0.45)
    off = {}
    for use in (1, 0):
        ends = []
        for end in range(40, 120, 8):
            ticks = round(end / T)
            cut = without_fixes({n: v[:ticks] for n, v in signals.items()}, end - 10, end)
            ends.append(error(run(native, cut, use_slip=use), signals, ticks - 1))
        off[use] = float(np.mean(ends))
    assert off[1] < 0.7
    assert off[1] < 0.7 * off[0]


@pytest.mark.parametrize("course", [math.nan, math.inf, 100.0])
def test_a_bad_course_teaches_no_slip_but_the_fix_is_used(native: Make, course: float) -> None:
    signals = carried(np.full(500, 1.3), turns(500), seed=4)
    signals["gps_course"] = np.full(500, course)
    out = run(native, signals)
    assert (out["slip[1]"] == 0).all()
    assert (out["slip[2]"] == 0).all()
    assert out["accepted"].sum() == signals["gps_fix"].sum() - 1


def test_a_slow_fix_teaches_no_slip(native: Make) -> None:
    signals = carried(np.full(500, 0.1), turns(500), seed=4, offset=0.5)
    out = run(native, signals, moving_speed=0.6)
    assert (out["slip[1]"] == 0).all()


def test_the_slip_has_a_limit(native: Make) -> None:
    signals = carried(np.full(2000, 1.3), turns(2000, 1.6), seed=3, lead=0.45)
    beta = run(native, signals, largest_slip=0.2)["beta"][1000:]
    assert (beta.min(), beta.max()) == (-0.2, 0.2)


def test_the_slip_across_south_is_learned(native: Make) -> None:
    """Heading and course lie on both sides of +-180 deg."""
    signals = carried(np.full(1500, 1.3), np.full(1500, math.pi - 0.1), seed=21, offset=0.2)
    out = run(native, signals)
    assert out["slip[1]"][-1] == pytest.approx(0.2, abs=0.05)
    assert out["valid"][250:].all()


@pytest.mark.parametrize(("step", "valid"), [(40, True), (120, False), (-170, False)])
def test_a_heading_that_the_courses_contradict_is_unknown(native: Make, step: float, valid: bool) -> None:
    """The reference turns by `step` [deg]: as much as slip can be is learned, and no more."""
    signals = carried(np.full(3000, 1.3), turns(3000), seed=22)
    turned = signals["heading_meas"] + math.radians(step) * (np.arange(3000) * T > 60)
    signals["heading_meas"] = (turned + math.pi) % (2 * math.pi) - math.pi
    out = run(native, signals)
    assert out["valid"][250:1500].all()
    assert np.abs(out["slip[1]"]).max() <= 1
    late = slice(round(80 / T), None)
    assert (out["valid"][late] == valid).all()
    assert out["heading_sd"][late] == pytest.approx(0.1 if valid else math.pi / math.sqrt(3))
    if valid:
        assert out["slip[1]"][-1] == pytest.approx(-math.radians(step), abs=0.1)


def test_a_body_on_end_has_a_finite_yaw_rate(native: Make) -> None:
    """Of Euler's angles, where the cosine of pitch is 0; it is taken for 0.1 at least."""
    signals = carried(np.full(500, 1.3), np.zeros(500), seed=23)
    signals["pitch_meas"] = np.full(500, math.pi / 2)
    signals["gyro_z"] = np.full(500, 0.3)
    assert run(native, signals)["yaw_rate"][-1] == pytest.approx(3)


# The speed about its mean


def test_the_speed_reverts_to_its_mean(native: Make) -> None:
    """Pushed by 1 m/s2 that is not there, it comes to rest T * 1 m/s2 above the mean of the fixes."""
    n = 2500
    felt = np.where(np.arange(n) * T < 80, 0.0, 1.0)
    signals = without_fixes(carried(np.full(n, 1.3), np.zeros(n), seed=5, swing=0, hidden=felt), 80, 100)
    for time in (0.7, 1.5):
        out = run(native, signals, rehearse=0, reversion_time=time)
        assert out["speed"][-1] - 1.3 == pytest.approx(time, abs=0.1)
    integrated = run(native, signals, rehearse=0, reversion_time=1e4)
    assert integrated["speed"][-1] - 1.3 == pytest.approx(20, rel=0.1)


def test_a_good_accelerometer_is_believed_for_long_and_one_on_a_swaying_pack_is_not(native: Make) -> None:
    """The car's speed goes up and down by 8 m/s, as the sensors tell; the dog's hardly, but they say so."""
    t = np.arange(3000) * T
    car = carried(10 + 8 * np.sin(0.3 * t), turns(3000, 0.3), seed=6, swing=0.3)
    dog = carried(2 + 0.2 * np.sin(0.5 * t), turns(3000), seed=7, swing=4, hidden=np.sin(1.1 * t))
    assert run(native, car)["reversion"][-1000:] == pytest.approx(1 / 60)
    assert run(native, dog)["reversion"][-1000:] == pytest.approx(1 / 0.7)
    assert run(native, car)["sigma"][-1] < 1
    unlearned = run(native, car, rehearse=0)
    assert unlearned["sigma"][-1] == 0.4
    assert unlearned["reversion"][-1] == 1 / 0.7


@pytest.mark.parametrize(("size", "bounds"), [(0.1, (0.2, 4)), (0.8, (0.2, 4))])
def test_the_stated_deviation_at_the_end_of_an_outage_is_that_of_the_errors(
    native: Make, size: float, bounds: tuple[float, float]
) -> None:
    """Mean of error^2 / variance over outages, of a speed that wanders little or much: a factor of 4."""
    rng = np.random.default_rng(8)
    n = 6000
    smooth = np.convolve(rng.normal(size=n + 200), np.hanning(200), mode="same")[100:-100]
    speed = np.maximum(2 + size * smooth / smooth.std(), 0.2)
    drift = np.convolve(rng.normal(size=n + 100), np.hanning(100), mode="same")[50:-50]
    signals = carried(speed, turns(n), seed=9, hidden=0.5 * drift / drift.std())
    squares = []
    for end in range(60, 240, 10):
        ticks = round(end / T)
        out = run(native, without_fixes({m: v[:ticks] for m, v in signals.items()}, end - 10, end))
        squares.append((out["speed"][-1] - speed[ticks - 1]) ** 2 / out["speed_sd"][-1] ** 2)
    assert bounds[0] < np.mean(squares) < bounds[1]


def test_a_speed_foretold_exactly_is_uncertain_by_the_receivers_noise(native: Make) -> None:
    """Mean square errors of 0 count as (2 * 0.1)^2 in 5 s: sigma^2 is 4 times their growth."""
    signals = carried(np.full(3000, 1.3), np.zeros(3000), seed=16, swing=0, noise=0)
    assert run(native, signals)["sigma"][-1] == pytest.approx(math.sqrt(4 * 0.2**2 / 5))


def test_bad_samples_leave_a_rehearsal_as_it_is(native: Make) -> None:
    signals = carried(np.full(3000, 1.3), np.zeros(3000), seed=17, swing=0, noise=0)
    signals["accel_x"] = np.where(np.arange(3000) % 3 > 0, math.nan, signals["accel_x"])
    assert run(native, signals)["sigma"][-1] == pytest.approx(math.sqrt(4 * 0.2**2 / 5))


# The stated position


def test_an_error_that_all_fixes_share_is_within_the_stated_deviation(native: Make) -> None:
    """A receiver that wanders in a minute, as far as it states: fixes of 4 Hz do not average that away."""
    squares = []
    for seed in range(20):
        signals = carried(np.full(1000, 1.3), turns(1000), seed=seed)
        common = np.random.default_rng(100 + seed).normal(0, 1.0, 2)
        signals["gps_north"], signals["gps_east"] = (
            signals[f"gps_{axis}"] + error for axis, error in zip(("north", "east"), common, strict=True)
        )
        out = run(native, signals | {"gps_h_acc": np.full(1000, 2.0)})
        for axis in ("north", "east"):
            off = out[axis][-1] - signals[f"true_{axis}"][-1]
            squares.append(off**2 / out[f"{axis}_sd"][-1] ** 2)
    assert 0.5 < np.mean(squares) < 1.5  # 40 of them: 1 with a deviation of 0.22


def test_the_receivers_part_is_that_of_the_last_good_fix(native: Make) -> None:
    signals = carried(np.full(1000, 1.3), np.zeros(1000), seed=21)
    accuracy = np.where(np.arange(1000) * T < 20, 2.0, 8.0)
    accuracy[np.arange(1000) * T > 30] = math.nan
    out = run(native, signals | {"gps_h_acc": accuracy})
    assert out["fix_variance"][[1, 400, 700, 999]] == pytest.approx([1, 1, 16, 16])
    assert np.isfinite(out["north_sd"]).all()


# Standing still


def test_a_body_that_stops_in_an_outage_stays_in_its_place(native: Make) -> None:
    speed = ramps(60, (2, 0), (3, 1.3), (40, 1.3), (41, 0), (60, 0))
    signals = without_fixes(carried(speed, turns(len(speed)) * (speed > 0), seed=10, hidden=0.2), 39, 60)
    out = run(native, signals)
    settled = round(43 / T)
    assert out["still"][settled:].all()
    assert np.ptp(out["north"][settled:]) < 0.05
    assert np.ptp(out["east"][settled:]) < 0.05
    assert np.abs(out["speed"][settled:]).max() < 0.05
    assert error(out, signals) < 1
    assert error(run(native, signals, use_stillness=0), signals) > 10


def test_standing_through_a_whole_outage_costs_centimetres(native: Make) -> None:
    speed = ramps(60, (2, 0), (3, 1.3), (30, 1.3), (31, 0), (60, 0))
    signals = without_fixes(carried(speed, turns(len(speed)) * (speed > 0), seed=11, hidden=0.2), 45, 60)
    assert error(run(native, signals), signals) < 0.3


@pytest.mark.parametrize("outage", [False, True])
def test_a_smooth_ride_at_constant_speed_is_no_rest(native: Make, outage: bool) -> None:
    speed = ramps(100, (2, 0), (12, 20), (100, 20))
    signals = carried(speed, turns(len(speed), 0.1), seed=12, swing=0, shake=0)
    if outage:
        signals = without_fixes(signals, 60, 100)
    assert not run(native, signals)["still"][round(3 / T) :].any()


@pytest.mark.parametrize("sensor", ["accel", "gyro"])
def test_a_body_that_one_of_the_sensors_feels_move_does_not_rest(native: Make, sensor: str) -> None:
    """From 40 s on the other one is quiet."""
    speed = np.full(1500, 1.3)
    signals = carried(speed, np.zeros(1500), seed=18)
    moving = np.arange(1500) * T < 40
    for axis in "xyz":
        column = signals[f"{sensor}_{axis}"]
        signals[f"{sensor}_{axis}"] = np.where(moving, column, column.mean() + 3 * (column - column.mean()))
        other = signals[other_name := f"{'gyro' if sensor == 'accel' else 'accel'}_{axis}"]
        quiet = other.mean() + 1e-3 * np.random.default_rng(19).normal(size=1500)
        signals[other_name] = np.where(moving, other, quiet)
    assert not run(native, without_fixes(signals, 40, 60))["still"].any()


@pytest.mark.parametrize("stuck", [("accel",), ("gyro",), ("accel", "gyro")])
def test_a_sensor_that_repeats_its_sample_tells_of_no_rest(native: Make, stuck: tuple[str, ...]) -> None:
    signals = carried(np.full(1500, 1.3), np.zeros(1500), seed=24)
    failed = round(45 / T)
    for name in (f"{sensor}_{axis}" for sensor in stuck for axis in "xyz"):
        signals[name][failed:] = signals[name][failed]
    out = run(native, without_fixes(signals, 44, 60))
    assert out["rate_motion" if "gyro" in stuck else "force_motion"][-1] < 1e-6
    assert not out["still"].any()


@pytest.mark.parametrize("pace", [0.25, 0.35])
def test_fixes_of_a_creeping_body_tell_of_its_motion(native: Make, pace: float) -> None:
    """Slower than `moving_speed`, and as quiet as at rest; the receiver's 0.1 m/s tells it from rest."""
    speed = ramps(160, (2, 0), (3, 1.3), (40, 1.3), (41, 0), (60, 0), (61, pace), (160, pace))
    signals = carried(speed, np.zeros(len(speed)), seed=25, swing=0, shake=0, noise=0.03)
    strides = carried(speed, np.zeros(len(speed)), seed=25)
    walks = np.arange(len(speed)) * T < 41
    for name in (f"{sensor}_{axis}" for sensor in ("accel", "gyro") for axis in "xyz"):
        signals[name] = np.where(walks, strides[name], signals[name])
    out = run(native, signals)
    assert out["still"][round(45 / T) : round(60 / T)].mean() > 0.9
    assert out["still"][round(65 / T) :].mean() < 0.01
    assert error(out, signals) < 0.6
    # without fixes there is nothing that tells it from rest
    assert run(native, without_fixes(signals, 100, 160))["still"][round(101 / T) :].mean() > 0.9


def test_a_fix_tells_of_motion_until_it_is_as_old_as_two_and_more(native: Make) -> None:
    """0.6 s: of 4 Hz, one may be missing. Whatever it feels afterwards is less than it ever felt."""
    n = 1000
    signals = carried(np.full(n, 1.3), np.zeros(n), seed=26)
    inputs = {name: v for name, v in as_received(signals).items() if not name.startswith("true_")}
    end = int(np.flatnonzero(inputs["gps_fix"])[-2]) + 1
    tracker = native(CanineTracker, "double", {})
    tracker.run(**{name: v[:end] for name, v in inputs.items()})
    tracker["least_force_motion"] = tracker["least_rate_motion"] = 1e6
    later = {name: np.repeat(v[end - 1 : end], 20) for name, v in inputs.items()}
    moving = {name: inputs[name][end - 20 : end] for name in inputs if name.startswith(("accel", "gyro"))}
    still = tracker.run(**later | moving | {"gps_fix": np.zeros(20)})["still"]
    assert still.tolist() == [0] * 14 + [1] * 6


def test_after_a_long_run_a_walk_is_no_rest(native: Make) -> None:
    """Running shakes four times as much. In seven minutes the walk is not forgotten."""
    speed = ramps(510, (2, 0), (3, 1), (20, 1), (22, 5), (442, 5), (445, 1), (510, 1))
    heading = np.zeros(len(speed))
    signals, running = (carried(speed, heading, seed=27, swing=s, shake=0.1 * s) for s in (1.0, 4.0))
    for name in (f"{sensor}_{axis}" for sensor in ("accel", "gyro") for axis in "xyz"):
        signals[name] = np.where(speed > 2, running[name], signals[name])
    assert not run(native, without_fixes(signals, 441, 510))["still"].any()


def test_before_motion_is_known_nothing_counts_as_rest(native: Make) -> None:
    speed = ramps(20, (2, 0), (3, 1.3), (10, 1.3), (11, 0), (20, 0))  # 7 s of motion: 28 fixes
    assert not run(native, carried(speed, np.zeros(len(speed)), seed=13))["still"].any()


def test_a_body_that_goes_on_in_an_outage_takes_up_its_speed_again(native: Make) -> None:
    speed = ramps(60, (2, 0), (3, 1.3), (40, 1.3), (41, 0), (46, 0), (47, 1.3), (60, 1.3))
    signals = without_fixes(carried(speed, np.zeros(len(speed)), seed=14), 42, 60)
    out = run(native, signals)
    assert not out["still"][round(48 / T) :].any()
    assert out["speed"][-1] > 0.6


def test_rest_is_told_apart_at_any_noise_of_the_sensors(native: Make) -> None:
    """As the shipped sensors' 1 m/s2, in which a stride is drowned: the gyroscope tells."""
    speed = ramps(60, (2, 0), (3, 1.3), (40, 1.3), (41, 0), (60, 0))
    rng = np.random.default_rng(15)
    signals = carried(speed, turns(len(speed)) * (speed > 0), seed=15)
    for axis in "xyz":
        signals[f"accel_{axis}"] = signals[f"accel_{axis}"] + rng.normal(0, 1, len(speed))
    out = run(native, without_fixes(signals, 39, 60))
    assert out["still"][round(45 / T) :].mean() > 0.9
    assert not out["still"][: round(40 / T)].any()


@pytest.mark.parametrize("value", [math.nan, 300.0])
def test_without_samples_a_body_that_stood_follows_its_fixes(native: Make, value: float) -> None:
    """The inertial unit fails while it stands; it walks off, and the fixes tell so."""
    speed = ramps(60, (2, 0), (3, 1.3), (40, 1.3), (41, 0), (50, 0), (51, 1.3), (60, 1.3))
    signals = carried(speed, np.zeros(len(speed)), seed=19)
    failed = round(45 / T)
    signals["accel_y"][failed:] = value
    out = run(native, signals)
    assert out["still"][failed - 1]
    assert not out["still"][failed:].any()
    assert out["bad_samples"][-1] == len(speed) - failed
    assert np.abs(out["speed"] - speed)[round(52 / T) :].max() < 0.3
    assert error(out, signals) < 0.6


# The recovery


def test_a_bias_far_from_the_truth_is_given_up_with_the_second_beginning(native: Make) -> None:
    inputs = motion(np.full(600, 1.0), np.zeros(600))
    estimator = native(CanineTracker, "double", {"recovery_fixes": 2, "reversion_time": 60})
    estimator.run(**{n: column[:260] for n, column in inputs.items()})
    estimator["x[2]"] = estimator["long_bias"] = 60.0
    out = estimator.run(**{n: column[260:] for n, column in inputs.items()})
    fixes = np.flatnonzero(inputs["gps_fix"][260:])
    assert out["accepted"][fixes].tolist() == [0] * 4 + [1] * (len(fixes) - 4)
    assert out["accel_bias"][fixes[[1, 3]]].tolist() == [60, 0]
    assert abs(out["speed"][-1] - 1) < 0.1


def test_with_a_second_beginning_nothing_is_rehearsed_but_the_carrier_is_known(native: Make) -> None:
    """A car whose long rehearsals were right; the fixes jump by 1 km in the middle of the next one."""
    t = np.arange(2060) * T
    signals = carried(10 + 8 * np.sin(0.3 * t), turns(len(t), 0.3), seed=6, swing=0.3, offset=0.2, hidden=0.3)
    jumped = round(80 / T)
    signals["gps_north"][jumped:] += 1000
    out = run(native, signals)
    begun = np.flatnonzero(out["renewed"])[0]
    before, fixes = begun - 1, signals["gps_fix"][:begun]
    assert out["rehearsing"][before]
    assert out["rehearsed_ticks"][before] > np.diff(np.flatnonzero(fixes))[-1]
    assert out["reversion"][before] == pytest.approx(1 / 60)
    assert out["long_bias"][begun] == out["long_bias"][before] == pytest.approx(0.3, abs=0.1)
    assert out["slip[1]"][begun] == out["slip[1]"][before] == pytest.approx(0.2, abs=0.05)
    assert out["least_force_motion"][begun] == out["least_force_motion"][before] < 1e6
    # as at the first beginning
    expected = {"sigma": 0.4, "reversion": 1 / 0.7, "learned_reversion": 1 / 0.7, "rehearsals": 0}
    expected |= {"long_bias_sd": 1, "accel_bias_sd": 1, "rehearsed_ticks": 0, "rehearsing": 1}
    expected |= {"rehearsal_errors[1]": 0.2, "rehearsal_errors[2]": 0.2}
    assert {name: out[name][begun] for name in expected} == pytest.approx(expected)
    # the rehearsal that begins is of the new speed, the covariance that of the first fix
    speeds = [out[name][begun] for name in ("rehearsed[1]", "rehearsed[2]", "rehearsed_from")]
    assert speeds == [as_received(signals)["gps_speed"][begun]] * 3
    first = np.flatnonzero(out["started"])[0]
    P = [f"covariance[{i}]" for i in range(1, 11)]
    assert [out[name][begun] for name in P] == [out[name][first] for name in P]


def test_after_a_beginning_in_vain_nothing_of_the_earlier_life_is_left(native: Make) -> None:
    """From the third beginning on it does what a filter does that begins there."""
    n, switched = 3000, 1500
    signals = carried(np.full(n, 1.3), turns(n), seed=20, offset=0.3, lead=0.3, hidden=0.4)
    ticks = np.flatnonzero(signals["gps_fix"])
    signals["gps_north"][ticks[ticks >= switched]] += 3000
    signals["gps_north"][ticks[ticks >= switched][:2]] -= 1000
    begins = int(ticks[ticks >= switched][3])
    inputs = {name: v for name, v in as_received(signals).items() if not name.startswith("true_")}
    old = native(CanineTracker, "double", {"recovery_fixes": 2}).run(**inputs)
    assert np.flatnonzero(np.diff(old["renewed"], prepend=0) > 0).size == 1
    assert old["north"][begins] == inputs["gps_north"][begins]
    fresh = native(CanineTracker, "double", {}).run(**{name: v[begins:] for name, v in inputs.items()})
    of_the_samples = {f"{m}[{i}]" for m in ("force_mean", "rate_mean") for i in (1, 2, 3)}
    of_the_samples |= {"force_motion", "rate_motion", "least_force_motion", "least_rate_motion", "still"}
    of_the_samples |= {name for name in fresh if name.startswith("rejected_")} | {"sure_speed"}  # of fixes
    counts = {"rejections", "rejected_fixes", "renewals", "recoveries", "jumped", "jumps"}  # since power-up
    for name in set(fresh) - of_the_samples - counts - {"renewed"}:
        assert old[name][begins + 10 :] == pytest.approx(fresh[name][10:], rel=1e-9, abs=1e-9), name
    for name in ("least_force_motion", "least_rate_motion"):
        assert old[name][begins] == fresh[name][0] == 1e6
