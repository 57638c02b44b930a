"""The paths of trials: where an animal goes that searches, or runs; the pack's motion is the plant's."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from models.kit.timing import TICK

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Gait:
    """How an animal goes: all of it is ours, but for what names its place in the text.

    Attributes:
        speed, speed_deviation: mean and standard deviation [m/s].
        speed_time: correlation time of the speed [s].
        start: acceleration from rest [m/s2].
        turn: a turn's mean angle [rad]; its angle varies by a fifth, its side by chance.
        between: shortest and longest time from one turn to the next [s].
        length: shortest and longest trial [s].
    """

    speed: float
    speed_deviation: float
    speed_time: float
    start: float
    turn: float
    between: tuple[float, float] = (6.0, 9.0)
    length: tuple[float, float] = (40.0, 45.0)  # 3.3.6


TURNING = 1.5  # s that a turn takes
SLOWEST = 0.1  # of the mean speed
# a dog led at a walk, which is how the text has it search (D.3); turns of a box (B.2)
SEARCHING = Gait(1.0, 0.25, 2.0, 1.0, math.radians(90))
RUNNING = Gait(4.86, 0.6, 3.0, 1.78, math.radians(60))  # Table 5.1: 4.86 m/s, 1.78 m/s2
PEDESTRIAN = Gait(1.4, 0.15, 2.0, 1.0, math.radians(90))
GAITS = {"detection": SEARCHING, "running": RUNNING}  # of dogs


@dataclass(frozen=True, eq=False)
class Path:
    """Positions, one a tick [m]: (ticks,) each."""

    north: Array
    east: Array


def walk(gait: Gait, seed: int) -> Path:
    """A trial's path: straight on at a speed that wanders, and turns to either side."""
    rng = np.random.default_rng(seed)
    length = rng.uniform(*gait.length)
    ticks = round(length / TICK)
    kept = math.exp(-TICK / gait.speed_time)
    draws = rng.normal(0, gait.speed_deviation * math.sqrt(1 - kept * kept), ticks)
    draws[0] = rng.normal(0, gait.speed_deviation)
    speed = np.maximum(gait.speed + lfilter([1], [1, -kept], draws), SLOWEST * gait.speed)
    speed = np.minimum(speed, gait.start * TICK * np.arange(ticks))
    rate = np.zeros(ticks)
    turn_ticks = round(TURNING / TICK)
    begin = rng.uniform(*gait.between)
    while begin < length:
        angle = gait.turn * rng.uniform(0.8, 1.2) * rng.choice([-1, 1])
        rate[round(begin / TICK) :][:turn_ticks] += angle / TURNING
        begin += rng.uniform(*gait.between)
    course = rng.uniform(-math.pi, math.pi) + np.cumsum(rate) * TICK
    return Path(np.cumsum(speed * np.cos(course)) * TICK, np.cumsum(speed * np.sin(course)) * TICK)
