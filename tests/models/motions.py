"""Motions that estimators are tested on, as exact or noisy measurements: a column each, a row a tick."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from models.four_state import FourState

Array = np.ndarray[Any, Any]
Columns = dict[str, Array]

T = FourState.sample_time
G = 9.81
FIELD = 2.4e-5  # T, horizontal
DECLINATION = math.radians(-3.5)


def fix_ticks(ticks: int) -> Array:
    """Whether a fix falls on each tick: 4 Hz, on the first tick at or after its time."""
    fix = np.zeros(ticks, dtype=bool)
    fix[[k for n in range(ticks) if (k := -(-25 * n // 4)) < ticks]] = True
    return fix


def without_fixes(inputs: Columns, start: float, end: float) -> Columns:
    time = np.arange(len(inputs["gps_fix"])) * T
    return {**inputs, "gps_fix": inputs["gps_fix"] & ~((time >= start) & (time < end))}


def motion(speed: Array, heading: Array, pitch: Any = 0.0) -> Columns:
    """Exact measurements of a motion whose speed is linear and whose heading is held between ticks."""
    past = np.concatenate([speed[:1], speed[:-1]])
    way = 0.5 * (past + speed) * T
    magnetic = heading - DECLINATION
    rate = np.diff(np.unwrap(heading), prepend=heading[0]) / T
    return {
        "accel_x": (speed - past) / T + G * np.sin(pitch),
        "accel_y": speed * rate,
        "accel_z": np.broadcast_to(-G * np.cos(pitch), speed.shape),
        "gyro_x": np.zeros(speed.shape),
        "gyro_y": np.zeros(speed.shape),
        "gyro_z": rate,
        "mag_x": FIELD * np.cos(magnetic),
        "mag_y": -FIELD * np.sin(magnetic),
        "mag_z": np.full(speed.shape, 4.3e-5),
        "roll_meas": np.zeros(speed.shape),
        "pitch_meas": np.broadcast_to(pitch, speed.shape),
        "heading_meas": heading,
        "heading_meas_sd": np.zeros(speed.shape),
        "gps_course": heading,
        "gps_fix": fix_ticks(len(speed)),
        "gps_north": np.cumsum(way * np.cos(heading)),
        "gps_east": np.cumsum(way * np.sin(heading)),
        "gps_speed": speed,
        "gps_h_acc": np.full(speed.shape, 3.5),
        "gps_s_acc": np.full(speed.shape, 0.1),
    }


def noisy(
    inputs: Columns, seed: int, accel: float = 1.0, position: float = 1.0, speed: float = 0.05
) -> Columns:
    rng = np.random.default_rng(seed)
    n = len(inputs["accel_x"])
    return {
        **inputs,
        "accel_x": inputs["accel_x"] + rng.normal(0, accel, n),
        "gps_north": inputs["gps_north"] + rng.normal(0, position, n),
        "gps_east": inputs["gps_east"] + rng.normal(0, position, n),
        "gps_speed": np.abs(inputs["gps_speed"] + rng.normal(0, speed, n)),
    }


def walk(ticks: int, top: float = 2.0) -> Columns:
    """Speed and heading that keep changing; the speed stays positive."""
    t = np.arange(ticks) * T
    return motion(top * (0.6 + 0.4 * np.sin(0.5 * t)), 2.5 * np.sin(0.2 * t))


def run_in_circles(ticks: int) -> Columns:
    """At the dog's 4.86 m/s, where sigma is 151.7 m/s2; GPS fails for 10 s of every 40."""
    t = np.arange(ticks) * T
    heading = (0.4 * t + np.pi) % (2 * np.pi) - np.pi
    inputs = motion(np.full(ticks, 4.86), heading)
    inputs["gps_fix"] &= t % 40 < 30
    return inputs
