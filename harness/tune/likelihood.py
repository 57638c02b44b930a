"""The likelihood of an estimator's innovations over a recording, by its noise.

The density of each fix, given those before it, is normal with the innovation's stated variance; their product
is the likelihood of the noise parameters (Schweppe 1965; Bar-Shalom, Li, Kirubarajan 2001, 11.6). Every fix
counts: the gate is open, for a likelihood over fewer fixes cannot be compared with one over more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.batch.series import Series
from harness.recording.signals import SensorSignals
from harness.studies.innovations import Innovations, innovations_of, observed
from models.errors import UsageError, nearest
from models.estimator import Estimator

Array = npt.NDArray[np.float64]

OPEN_GATE = 1e6  # nominal deviations
VARIES = 2.0  # 95th per 5th percentile of a stated accuracy, from which on its changes are believed
NOT_TUNED = ("sigma_floor", "sigma_cap", "sigma_position")  # of the parameters that begin with sigma_


@dataclass(frozen=True)
class Noise:
    """A number that is tuned, above 0.

    Attributes:
        name: a parameter of the estimator; position_sd and speed_sd: of all fixes, whatever they state.
        start: where the search begins.
        before: as declared; the median where fixes differ.
    """

    name: str
    unit: str
    start: float
    before: float


class Tuned:
    """What is tuned of an estimator on a recording, and the parameters that follow from it.

    Where the receiver states much the same accuracy all the time, a scale of it cannot be told from a floor:
    one deviation of all fixes is fitted. It becomes the floor, and a scale that would exceed it is lowered.
    A noise that the estimator learns by itself is not tuned.

    Args:
        signals: of the recording, with all fixes.
        held: names of noises that stay as declared.

    Raises:
        UsageError: there is no noise of such a name, or all are held.
    """

    def __init__(self, block: type[Estimator], signals: SensorSignals, held: Sequence[str] = ()) -> None:
        self.block = block
        self.declared = {v.name: float(v.start[0]) for v in block.group("parameter")}
        self._range = {
            v.name: (v.min or 0.0, np.inf if v.max is None else v.max) for v in block.group("parameter")
        }
        self._stated: dict[str, float] = {}
        self.noises = [
            Noise(name, variable.unit, max(self.declared[name], 1e-4), self.declared[name])
            for name, variable in ((v.name, v) for v in block.group("parameter"))
            if name.startswith("sigma_") and name not in NOT_TUNED and not self._is_learned(name)
        ]
        for kind, unit, accuracy in (
            ("position", "m", signals.gps_h_acc),
            ("speed", "m/s", signals.gps_s_acc),
        ):
            low, middle, high = np.percentile(accuracy[signals.gps_fix], [5, 50, 95])
            scale = self.declared[f"{kind}_sd_scale"]
            sd, floor = float(middle) * scale, self.declared[f"{kind}_sd_floor"]
            if high < VARIES * low:
                self._stated[kind] = float(accuracy[signals.gps_fix].max())
                self.noises.append(Noise(f"{kind}_sd", unit, sd, max(sd, floor)))
            else:
                self.noises.append(Noise(f"{kind}_sd_scale", "1", scale, scale))
                self.noises.append(Noise(f"{kind}_sd_floor", unit, sd, floor))
        names = [noise.name for noise in self.noises]
        for name in held:
            if name not in names:
                raise UsageError(
                    f"hold {name}: no such noise of {block.title()} is tuned here; "
                    f"expected {', '.join(names)}{nearest(name, names)}"
                )
        self.noises = [noise for noise in self.noises if noise.name not in held]
        if not self.noises:
            raise UsageError("hold: all noises are held; leave one that can be tuned")

    @property
    def fixed(self) -> dict[str, float]:
        """Parameters that tuning takes for granted: the process noise is constant."""
        return {"fuzzy": 0.0} if "fuzzy" in self.declared else {}

    @property
    def idle(self) -> tuple[str, ...]:
        """Noises that are not in force as declared: by its fuzzy rules the estimator sets sigma itself."""
        return ("sigma_constant",) if self.declared.get("fuzzy") else ()

    def _is_learned(self, name: str) -> bool:
        """Whether the estimator soon replaces a noise by what it learns from its rehearsals."""
        return name == "sigma_constant" and bool(self.declared.get("rehearse"))

    def parameters(self, values: Sequence[float]) -> dict[str, float]:
        """The estimator's parameters for values of the noises."""
        result = dict(self.fixed)
        for noise, value in zip(self.noises, values, strict=True):
            kind = noise.name.removesuffix("_sd")
            if kind in self._stated:
                scale = min(self.declared[f"{kind}_sd_scale"], value / self._stated[kind])
                result |= {f"{kind}_sd_floor": value, f"{kind}_sd_scale": scale}
            else:
                result[noise.name] = value
        return {name: float(np.clip(value, *self._range[name])) for name, value in result.items()}


class Filter:
    """An estimator's C over the signals of a recording."""

    def __init__(self, block: type[Estimator], signals: SensorSignals) -> None:
        self.block = block
        self.series = Series(block, observe=observed(block, innovations_only=True))
        self.inputs = inputs_of(block, signals)

    def innovations(self, parameters: Mapping[str, float], ticks: int | None = None) -> Innovations:
        """Over the first ticks, all by default; the gate is open."""
        parameters = {**parameters, "gate": OPEN_GATE}
        inputs = {name: values[:ticks] for name, values in self.inputs.items()}
        run = self.series.run(inputs, {self.block.title(): parameters})
        return innovations_of(self.block, run)


def inputs_of(block: type[Estimator], signals: SensorSignals) -> dict[str, Array]:
    """A recording's signals as inputs of an estimator, by their names in a series."""
    return {
        f"{block.title()}.{name}": np.asarray(getattr(signals, name), dtype=np.float64)
        for name in block.flat_names("input")
    }
