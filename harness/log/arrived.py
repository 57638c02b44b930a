"""The sensors' signals as they arrived: a fault disturbs what is read, not what the sensors give."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence

from harness.log.channel import Channel

SENSORS, READER = "sensors", "estimator"
POSITION = ("gps_fix", "gps_north", "gps_east")
OF_AHRS = ("roll_meas", "pitch_meas", "heading_meas", "heading_meas_sd")  # where a system has one


def disturbed(metadata: Mapping[str, Mapping[str, str]]) -> set[str]:
    """What the faults of a log's scenario disturb, such as `sensors.gps_north`; none if it does not tell."""
    try:
        faults = tomllib.loads(metadata["scenario"]["toml"]).get("fault", [])
        return {fault["signal"].partition("->")[0].strip() for fault in faults}
    except (KeyError, TypeError, AttributeError, tomllib.TOMLDecodeError):
        return set()


def arrived(channels: Sequence[Channel], metadata: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """By the name of a sensors' signal, the log's signal of what arrived of it.

    It is the sensors' own. In a trial with faults of the sensors it is the estimator's input of this name and
    unit, if there is one.
    """
    units = {c.component: dict(zip(c.names, c.units, strict=True)) for c in channels}
    own, read = units.get(SENSORS, {}), units.get(READER, {})
    if not any(signal.startswith(f"{SENSORS}.") for signal in disturbed(metadata)):
        read = {}
    others = OF_AHRS if "ahrs" in units else ()
    return {
        name: f"{READER if read.get(name) == unit and name not in others else SENSORS}.{name}"
        for name, unit in own.items()
    }


def receiver(channels: Sequence[Channel], metadata: Mapping[str, Mapping[str, str]]) -> str:
    """The component whose signals are the positions of the GPS fixes that arrived."""
    signals = arrived(channels, metadata)
    return READER if all(signals.get(name) == f"{READER}.{name}" for name in POSITION) else SENSORS
