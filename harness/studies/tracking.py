"""Trials of any estimators at once: a plant, the sensors, and beside each other all configurations, in C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from codegen.batch.series import Series
from harness.replay.comparison import hold_speed
from models.canine_ahrs import CanineAhrs
from models.estimator import Estimator
from models.kit.block import Block
from models.kit.link import Values
from models.kit.timing import TICK
from models.sensors import Sensors
from models.system import System, by_name

Array = npt.NDArray[np.float64]
ESTIMATE = ("north", "east", "speed", "heading", "accel_bias", "sigma_accel")
TRUTH = ("north", "east", "speed", "heading")
SENSED = ("accel_x", "heading_meas", "gps_fix", "gps_north", "gps_east", "gps_speed", "gps_course")


@dataclass(frozen=True)
class Configuration:
    """An estimator with its parameters.

    Attributes:
        ahrs: our attitude reference stands between the sensors and it.
    """

    block: type[Estimator]
    parameters: Mapping[str, float] = field(default_factory=dict)
    ahrs: bool = False


class Tracking:
    """A plant with sensors, and any configurations of estimators that all get the same signals.

    Args:
        configurations: by name.
    """

    def __init__(self, name: str, plant: type[Block], configurations: Mapping[str, Configuration]) -> None:
        self.configurations = configurations
        self._component = {title: _identifier(title) for title in configurations}
        components: dict[str, type[Block]] = {"plant": plant, "sensors": Sensors}
        links: dict[str, str | tuple[str, ...]] = {"sensors": "plant"}
        if any(c.ahrs for c in configurations.values()):
            components["ahrs"], links["ahrs"] = CanineAhrs, "sensors"
        for title, configuration in configurations.items():
            components[self._component[title]] = configuration.block
            links[self._component[title]] = ("ahrs", "sensors") if configuration.ahrs else "sensors"
        observe = [f"plant.{n}" for n in TRUTH] + [f"sensors.{n}" for n in SENSED]
        observe += [f"{component}.{n}" for component in self._component.values() for n in ESTIMATE]
        self.series = Series(System(name, components, by_name(components, links)), observe)

    def run(
        self, ticks: int, seed: int, signals: Mapping[str, npt.ArrayLike], values: Values, outage: float
    ) -> Trial:
        """Run a trial.

        Args:
            signals: of the plant's inputs, by name.
            values: of parameters, by `plant`, `sensors` and, for all estimators that have them, `estimator`.
            outage: its length [s]; it ends with the trial.
        """
        last = ticks - 1
        parameters: dict[str, dict[str, float]] = {
            "plant": {"seed": seed, **values.get("plant", {})},
            "sensors": {"seed": seed, **values.get("sensors", {})},
        }
        if outage:
            parameters["sensors"] |= {
                "outage_start[1]": last * TICK - outage,
                "outage_end[1]": ticks * TICK + 1,
            }
        for title, configuration in self.configurations.items():
            known = configuration.block.flat_names("parameter")
            common = {n: v for n, v in values.get("estimator", {}).items() if n in known}
            parameters[self._component[title]] = {**common, **configuration.parameters}
        plant_signals = {f"plant.{name}": signal for name, signal in signals.items()}
        rows = self.series.run(plant_signals, parameters, ticks)

        def of(component: str, names: Sequence[str]) -> dict[str, Array]:
            return {n: rows[f"{component}.{n}"] for n in names}

        estimates = {title: of(component, ESTIMATE) for title, component in self._component.items()}
        return Trial(of("plant", TRUTH), of("sensors", SENSED), estimates)


@dataclass(frozen=True, eq=False)
class Trial:
    """What came of a trial, (ticks,) each, by name; the estimates by configuration first."""

    truth: Mapping[str, Array]
    sensed: Mapping[str, Array]
    estimates: Mapping[str, Mapping[str, Array]]

    @property
    def time(self) -> Array:
        """Of each tick [s]."""
        return np.asarray(TICK * np.arange(len(self.truth["north"])), np.float64)

    @property
    def last_fix(self) -> int:
        """The tick of the last fix."""
        return int(np.flatnonzero(self.sensed["gps_fix"])[-1])

    def inertial(self) -> dict[str, Array]:
        """Accelerometer and heading alone, integrated from rest at the start (D.7)."""
        speed = np.asarray(TICK * np.cumsum(self.sensed["accel_x"]))
        steps = TICK * speed * np.exp(1j * self.sensed["heading_meas"])
        steps[0] = self.truth["north"][0] + 1j * self.truth["east"][0]
        way = np.cumsum(steps)
        return {"speed": speed, "north": way.real, "east": way.imag}

    def held(self, over: float = 0.0) -> dict[str, Array]:
        """Dead reckoning from the last fix on: at its speed, or the mean over the fixes of a time [s]."""
        return hold_speed(self.sensed, len(self.sensed["gps_fix"]), over)

    def position_error(self, estimate: Mapping[str, Array]) -> Array:
        """Distance from the truth, (ticks,) m."""
        north, east = (estimate[n] - self.truth[n] for n in ("north", "east"))
        return np.asarray(np.hypot(north, east))

    def speed_error(self, estimate: Mapping[str, Array]) -> Array:
        """Difference from the true speed, (ticks,) m/s."""
        return np.abs(estimate["speed"] - self.truth["speed"])


def _identifier(title: str) -> str:
    """A component's name for a configuration's title."""
    return "".join(c if c.isalnum() else "_" for c in title.lower())
