"""Carriers of an IMU with known truth: a car, a walker, a dog, and bodies that stand or go in circles.

The truth is made at 100 Hz, as roll, pitch, heading and speed; from it follow what an ideal IMU and a
receiver measure, by rotation matrices. The IMU's samples of a tick are averaged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.recording.attitude import anti_alias
from models.canine_ahrs import CanineAhrs
from models.kit.model import Model

Array = np.ndarray[Any, Any]

RATE = 100  # Hz
TICK_SAMPLES = 4
T = TICK_SAMPLES / RATE
G = 9.81
DEG = np.pi / 180


@dataclass(frozen=True)
class Carrier:
    """A motion at 100 Hz, arrays (n,) in SI and rad; the sensors' errors; and how fixes come.

    Attributes:
        slip: course less heading.
        upward: acceleration, as of a stride.
        swing: acceleration forward of the IMU alone, as of a pack on a dog.
        gyro_bias: rad/s, about forward, right, down.
        fix_period: s.
        by_difference: velocities are differences of positions, known at the later one; these have noise.
        lost: s, from and until when there are no fixes.
    """

    speed: Array
    heading: Array
    roll: Array | float = 0.0
    pitch: Array | float = 0.0
    slip: float = 0.0
    upward: Array | float = 0.0
    swing: Array | float = 0.0
    gyro_bias: tuple[float, float, float] = (0.5 * DEG, -0.3 * DEG, 0.4 * DEG)
    gyro_noise: float = 0.1 * DEG
    accel_noise: float = 0.05
    accel_bias: float = 0.1
    fix_period: float = 0.25
    speed_noise: float = 0.1
    by_difference: bool = False
    position_noise: float = 0.0
    lost: tuple[tuple[float, float], ...] = ()


def seconds(duration: float) -> Array:
    return np.arange(round(duration * RATE)) / RATE


def ramps(t: Array, points: list[tuple[float, float]]) -> Array:
    """Straight lines through (time, value), smoothed over half a second."""
    times, corners = np.array(points).T
    values = np.interp(t, times, corners)
    width = RATE // 2
    return np.convolve(np.pad(values, width, mode="edge"), np.ones(width) / width, mode="same")[width:-width]


def smooth(rng: np.random.Generator, n: int, deviation: float, time: float) -> Array:
    """A random motion (n,) of this deviation, without steps, that changes within `time` s."""
    width = round(time * RATE)
    window = np.hanning(width)
    values = np.convolve(rng.standard_normal(n + 2 * width), window, mode="same")[width:-width]
    return np.asarray(deviation * values / np.sqrt((window**2).sum()))


def rotations(roll: Array, pitch: Array, heading: Array) -> Array:
    """(n, 3, 3): from forward, right, down to north, east, down."""
    (cr, sr), (cp, sp), (ch, sh) = ((np.cos(a), np.sin(a)) for a in (roll, pitch, heading))
    rows = [
        [cp * ch, sr * sp * ch - cr * sh, cr * sp * ch + sr * sh],
        [cp * sh, sr * sp * sh + cr * ch, cr * sp * sh - sr * ch],
        [-sp, sr * cp, cr * cp],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def measured(carrier: Carrier, seed: int = 1) -> dict[str, Array]:
    """What the sensors say on each tick, and the truth as `roll`, `pitch`, `heading`, `acceleration`."""
    rng = np.random.default_rng(seed)
    n = len(carrier.speed)
    roll, pitch, upward, swing = (
        np.broadcast_to(x, n) for x in (carrier.roll, carrier.pitch, carrier.upward, carrier.swing)
    )
    course = carrier.heading + carrier.slip
    rotation = rotations(roll, pitch, carrier.heading)
    velocity = carrier.speed * np.exp(1j * course)
    ahead = swing * np.exp(1j * carrier.heading)
    pushed = np.gradient(velocity) * RATE + ahead
    earth = np.column_stack([pushed.real, pushed.imag, -upward - G])
    force = np.einsum("nij,ni->nj", rotation, earth)
    turn = np.einsum("nij,nik->njk", rotation[:-1], rotation[1:])  # from one sample to the next
    rate = np.column_stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]]
    )
    rate = np.vstack([rate[:1], rate]) * RATE / 2
    force = force + carrier.accel_bias + carrier.accel_noise * rng.normal(size=(n, 3)) * 2
    rate = rate + np.array(carrier.gyro_bias) + carrier.gyro_noise * rng.normal(size=(n, 3)) * 2
    ticks = n // TICK_SAMPLES
    last = np.arange(ticks) * TICK_SAMPLES
    forward = np.gradient(carrier.speed) * RATE + swing * np.cos(carrier.slip)
    truth = np.column_stack([roll, pitch, carrier.heading, carrier.speed, forward])
    t = np.arange(n) / RATE
    filtered = np.hstack(
        [
            anti_alias(t, force, ticks),
            anti_alias(t, rate, ticks, mean=True),
            anti_alias(t, truth, ticks),
        ]
    ).T
    time = np.arange(ticks) * T
    fix = np.floor(time / carrier.fix_period + 1e-9) != np.floor((time - T) / carrier.fix_period + 1e-9)
    for start, end in carrier.lost:
        fix &= (time < start) | (time >= end)
    sensed = np.asarray(velocity[last])
    if carrier.by_difference:
        place = (
            np.cumsum(velocity)[last] / RATE
            + (smooth(rng, n, 1.0, 30.0) + 1j * smooth(rng, n, 1.0, 30.0))[last]
        )
        place = place + carrier.position_noise * (rng.normal(size=ticks) + 1j * rng.normal(size=ticks))
        steps = np.flatnonzero(fix)
        sensed = np.zeros(ticks, dtype=complex)
        sensed[steps[1:]] = np.diff(place[steps]) / (np.diff(steps) * T)
    else:
        sensed = sensed + carrier.speed_noise * (rng.normal(size=ticks) + 1j * rng.normal(size=ticks))
    names = [
        *(f"accel_{axis}" for axis in "xyz"), *(f"gyro_{axis}" for axis in "xyz"),
        "roll", "pitch", "heading", "speed", "acceleration",
    ]  # fmt: skip
    return {
        **dict(zip(names, filtered, strict=True)),
        "time": time,
        "gps_fix": fix.astype(float),
        "gps_speed": np.abs(sensed),
        "gps_course": np.angle(sensed),
        "gps_s_acc": np.full(ticks, 3.0 / carrier.fix_period if carrier.by_difference else 0.15),
    }


def run(signals: dict[str, Array], parameters: dict[str, float] | None = None) -> dict[str, Array]:
    """The block's outputs on each tick."""
    ahrs = Model(CanineAhrs, parameters)
    ahrs.initialize()
    inputs = [name for name in CanineAhrs.flat_names("input") if name in signals]
    table = np.column_stack([signals[name] for name in inputs])
    outputs = np.zeros((len(table), len(CanineAhrs.flat_names("output"))))
    for k, row in enumerate(table):
        for name, value in zip(inputs, row, strict=True):
            ahrs[name] = value
        ahrs.step()
        outputs[k] = ahrs.output
    return dict(zip(CanineAhrs.flat_names("output"), outputs.T, strict=True))


def car(duration: float = 300.0, seed: int = 3, **errors: Any) -> Carrier:
    """Stands 10 s, then accelerates and brakes between 0 and 25 m/s, with turns, on a hilly road."""
    rng = np.random.default_rng(seed)
    t = seconds(duration)
    points, at, speed = [(0.0, 0.0), (10.0, 0.0)], 10.0, 0.0
    while at < duration:
        then = float(rng.uniform(0, 25)) if rng.random() > 0.2 else 0.0
        at += max(abs(then - speed) / float(rng.uniform(1, 3)), 0.5)
        points.append((at, then))
        at += float(rng.uniform(2, 15))
        points.append((at, then))
        speed = then
    v = np.maximum(ramps(t, points), 0)
    sideways = smooth(rng, len(t), 1.5, 6.0)  # m/s2, most of which a driver takes
    yaw_rate = np.where(v > 1, np.clip(sideways / np.maximum(v, 1), -0.6, 0.6), 0) * np.clip(v - 1, 0, 1)
    heading = 1.0 + np.cumsum(yaw_rate) / RATE
    way = np.cumsum(v) / RATE
    slope = np.interp(
        way, np.arange(0, way[-1] + 1), smooth(rng, int(way[-1]) + 2, 2 * DEG, 5.0)
    )  # 5 * 100 m
    dive = -0.5 * DEG * np.gradient(v) * RATE
    shaken = np.where(v > 0.1, 1.0, 0.05)
    return Carrier(
        speed=v,
        heading=heading,
        roll=0.5 * DEG * v * yaw_rate + shaken * smooth(rng, len(t), 0.3 * DEG, 0.3),
        pitch=slope + dive + shaken * smooth(rng, len(t), 0.3 * DEG, 0.3),
        upward=shaken * smooth(rng, len(t), 0.4, 0.15),
        **errors,
    )


def walker(duration: float = 200.0, seed: int = 4, **errors: Any) -> Carrier:
    """Stands 5 s, then walks at 1.2 m/s in tight turns with steps of 1.8 Hz, a unit in the hand."""
    rng = np.random.default_rng(seed)
    t = seconds(duration)
    going = ramps(t, [(0, 0), (5, 0), (6, 1), (duration, 1)])
    yaw_rate = smooth(rng, len(t), 0.5, 3.0) * going
    step = 2 * np.pi * 1.8 * t
    return Carrier(
        speed=going * (1.2 + smooth(rng, len(t), 0.2, 3.0)),
        heading=2.0 + np.cumsum(yaw_rate) / RATE + going * 3 * DEG * np.sin(step / 2),
        roll=3 * DEG + going * (2 * DEG * np.sin(step / 2) + smooth(rng, len(t), 3 * DEG, 2.0)),
        pitch=5 * DEG + going * (2 * DEG * np.sin(step) + smooth(rng, len(t), 3 * DEG, 2.0)),
        upward=going * 2.0 * np.sin(step + 1),
        swing=going * 1.0 * np.sin(step + 2),
        **errors,
    )


def dog(duration: float = 200.0, seed: int = 5, **errors: Any) -> Carrier:
    """Never stands: walks and trots with strides of 3.6 Hz, swings of 7 m/s2 and pitch that wanders."""
    rng = np.random.default_rng(seed)
    t = seconds(duration)
    v = np.abs(1.8 + smooth(rng, len(t), 1.0, 4.0))
    stride = 2 * np.pi * (3.6 * t + rng.random())
    big = np.clip(v, 0.3, 3) / 1.8
    return Carrier(
        speed=v,
        heading=np.cumsum(smooth(rng, len(t), 0.7, 2.0)) / RATE,
        roll=big * 4 * DEG * np.sin(stride / 2) + smooth(rng, len(t), 3 * DEG, 3.0),
        pitch=10 * DEG + big * 5 * DEG * np.sin(stride + 0.5) + smooth(rng, len(t), 4 * DEG, 3.0),
        upward=big * 6.0 * np.sin(stride + 1),
        swing=big * 5.0 * np.sin(stride + 2),
        **errors,
    )


def circle(duration: float = 200.0, **errors: Any) -> Carrier:
    """Stands 5 s, then goes round a circle in 63 s at 1.3 m/s; 1 Hz fixes without velocities."""
    t = seconds(duration)
    going = ramps(t, [(0, 0), (5, 0), (7, 1), (duration, 1)])
    return Carrier(
        speed=1.3 * going,
        heading=np.cumsum(going * 2 * np.pi / 63) / RATE,
        pitch=4 * DEG + going * 1.5 * DEG * np.sin(2 * np.pi * 1.8 * t),
        upward=going * 1.5 * np.sin(2 * np.pi * 1.8 * t + 1),
        **{"fix_period": 1.0, "by_difference": True} | errors,
    )


def standing(duration: float = 60.0, **errors: Any) -> Carrier:
    n = len(seconds(duration))
    return Carrier(speed=np.zeros(n), heading=np.full(n, 0.5), roll=-12 * DEG, pitch=8 * DEG, **errors)


def slope_of_levelled_force(signals: dict[str, Array], pitch: Array, used: Array) -> float:
    """Of the levelled specific force forward on the true change of speed, both over a second."""
    levelled = signals["accel_x"] - G * np.sin(pitch)
    second = np.ones(25) / 25
    force, truth = (np.convolve(x, second, mode="same")[used] for x in (levelled, signals["acceleration"]))
    return float(np.polyfit(truth, force, 1)[0])
