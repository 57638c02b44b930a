"""Logs of trials that are laid out by hand."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from harness.log.channel import Channel
from harness.log.log import Log

COMMANDS = [1, 1, 1, 2, 2, 4, 4, 0, 0, 5, 5, 1, 1, 3, 3]
TICKS = len(COMMANDS)


def channel(component: str, *names: str) -> Channel:
    blank = ("",) * len(names)
    return Channel(component, component, names, blank, ("Real",) * len(names), blank)


def trial(*, sensors: bool = True) -> Log:
    """A walk north-east at 1 m a tick of 1 s, with one of every command, a waypoint and a turn failure.

    The operator orders STOP from 3 to 5 s; the radio is lost from 6 to 9 s; fixes come at 0, 5 and 10 s.
    """
    steps = np.arange(TICKS, dtype=float)
    deviation, anomaly = np.linspace(-1, 1, TICKS), (steps == 7) * 2
    controller = [COMMANDS, [1] * 14 + [2], steps >= 10, deviation, anomaly, 0 * steps]
    controller += [steps >= 0, 2 * ((steps >= 3) & (steps < 5)), (steps < 6) | (steps > 8)]
    channels = [
        channel("plant", "north", "east", "speed", "heading"),
        channel(
            "controller", "command", "status", "waypoint", "deviation", "anomaly", "directional_commands",
            "start", "override", "link_ok",
        ),
    ]  # fmt: skip
    heading = np.full(TICKS, np.arctan2(2, 1))
    values = {
        "plant": np.column_stack([steps, 2 * steps, steps, heading]),
        "controller": np.column_stack(controller),
    }
    if sensors:
        channels += [
            channel("sensors", "gps_fix", "gps_north", "gps_east", "gps_speed"),
            channel("estimator", "north", "east", "speed"),
        ]
        values["sensors"] = np.column_stack([steps % 5 == 0, steps + 0.5, 2 * steps, steps])
        values["estimator"] = np.column_stack([steps + 0.1, 2 * steps, steps])
    parameters = {
        "waypoint_count": "2", "waypoint_north[1]": "10.0", "waypoint_east[1]": "20.0",
        "waypoint_north[2]": "0.0", "waypoint_east[2]": "30.0", "home_north": "0.0", "home_east": "1.0",
        "capture_radius": "7.0",
        "moving_deviation": "0.8552113334772214", "stop_deviation": "0.3490658503988659",
    }  # fmt: skip
    metadata = {
        "scenario": {"name": "three", "seed": "1"},
        "parameters": {f"controller.{name}": value for name, value in parameters.items()},
    }
    metadata["parameters"]["sensors.gps_period"] = "5.0"
    return Log(Path("trial.mcap"), tuple(channels), metadata, {}, steps, values)


def with_signal(log: Log, signal: str, values: ArrayLike) -> Log:
    """The log with other values of a signal, one or (ticks,)."""
    component, name = signal.split(".")
    [column] = [c.names.index(name) for c in log.channels if c.component == component]
    log.values[component][:, column] = np.asarray(values)
    return log


def without_signal(log: Log, signal: str) -> Log:
    """The log as a component that lacks the signal would leave it."""
    component, name = signal.split(".")
    [column] = [c.names.index(name) for c in log.channels if c.component == component]
    channels = tuple(
        channel(component, *(n for n in c.names if n != name)) if c.component == component else c
        for c in log.channels
    )
    values = log.values | {component: np.delete(log.values[component], column, axis=1)}
    return Log(log.path, channels, log.metadata, {}, log.time, values)
