"""Dogs whose motion is known, for tests: moved tick by tick, as 5.2 and D.6 say."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from harness.fit.tracks import MOTION_SOURCES, Track
from harness.log.channel import Array, Channel
from harness.log.writer import LogWriter
from models.commands import Command
from models.kit.units import DEG

TICK = 0.04
PLANT, ESTIMATOR = MOTION_SOURCES["plant"], MOTION_SOURCES["estimator"]
Mask = npt.NDArray[np.bool_]
Program = list[tuple[Command, float]]  # command, s

# each command once; at rest before it turns; fast enough dogs brake from their cruising speed
SCHOOL: Program = [
    (Command.FORWARD, 8.0),
    (Command.STOP, 5.0),
    (Command.LEFT, 1.0),
    (Command.NONE, 1.0),
    (Command.RIGHT, 1.0),
]


def commands(program: Program) -> Array:
    """(ticks,), with the tick after the last command, as the logs have it."""
    held = [np.full(round(length / TICK), float(command)) for command, length in program]
    return np.concatenate([*held, [0.0]])


def times(count: int) -> Array:
    """The times of so many ticks, s."""
    return TICK * np.arange(count, dtype=np.float64)


def track(
    command: Array,
    speed: Array,
    heading: Array,
    step: float = TICK,
    *,
    usable: Mask | None = None,
    fresh: Mask | None = None,
    aim: float | None = None,
) -> Track:
    """A trial of which everything is known; all ticks are usable and fresh by default."""
    every = np.ones(len(command), dtype=bool)
    time = step * np.arange(len(command), dtype=np.float64)
    usable, fresh = (every if mask is None else mask for mask in (usable, fresh))
    return Track("t", time, command, speed, heading, usable, fresh, aim)


def motion(command: Array, dog: dict[str, float]) -> Track:
    """A dog moved tick by tick as 5.2 and D.6 say: here it obeys LEFT and RIGHT; rad, SI."""
    speed, heading = [0.0], [dog.get("start", 0.0)]
    turns = {Command.LEFT: dog.get("left", 0.0), Command.RIGHT: dog.get("right", 0.0)}
    for order in command[:-1]:
        running = order in (Command.FORWARD, Command.RECALL)
        turn = turns.get(Command(int(order)), 0.0)
        turn += dog["drift"] if running or speed[-1] > 0 else 0.0
        rate = dog["up"] if running else -dog["down"]
        speed.append(min(max(speed[-1] + rate * TICK, 0.0), dog["cruise"]))
        heading.append(math.remainder(heading[-1] + turn * TICK, 2 * math.pi))
    return track(command, np.array(speed), np.array(heading))


DOG = {
    "cruise": 4.1, "up": 1.7, "down": 2.9, "drift": 2.5 * DEG, "left": -80 * DEG, "right": 50 * DEG,
}  # fmt: skip


def later(command: Array, dog: dict[str, float], delay: float) -> Track:
    """A dog that obeys each command a while after it is given, s."""
    late = round(delay / TICK)
    moved = motion(np.concatenate([np.zeros(late), command[: len(command) - late]]), dog)
    return track(command, moved.speed, moved.heading)


def write(
    path: Path,
    columns: dict[str, Array],
    step: float = TICK,
    seed: str = "1",
    *,
    blocks: Mapping[str, str] | None = None,
    parameters: Mapping[str, str] | None = None,
    attachments: Mapping[str, bytes] | None = None,
) -> Path:
    """A log with columns by component.signal; a component's block has its name, or that of `blocks`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    components = dict.fromkeys(name.partition(".")[0] for name in columns)
    names = {c: [n.partition(".")[2] for n in columns if n.startswith(f"{c}.")] for c in components}
    channels = [
        Channel(c, (blocks or {}).get(c, c), tuple(n), ("",) * len(n), ("Real",) * len(n), ("",) * len(n))
        for c, n in names.items()
    ]
    metadata = {"parameters": {"plant.seed": seed, **(parameters or {})}}
    with LogWriter(
        path, channels, origin=(0, 0), metadata=metadata, attachments=dict(attachments or {})
    ) as log:
        at = step * np.arange(len(next(iter(columns.values()))), dtype=np.float64)
        log.write_rows(at, {c: np.column_stack([columns[f"{c}.{n}"] for n in names[c]]) for c in components})
    return path


def columns(dog: dict[str, float] = DOG, component: str = "plant") -> dict[str, Array]:
    moved = motion(commands(SCHOOL), dog)
    zero = np.zeros(len(moved.time))
    return {
        "controller.command": moved.command,
        f"{component}.speed": moved.speed,
        f"{component}.heading": moved.heading,
        f"{component}.north": zero,
        f"{component}.east": zero,
    }
