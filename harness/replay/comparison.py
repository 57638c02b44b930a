"""What a replay compares: estimators in their configurations, beside dead reckoning without a filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np

from codegen.batch.series import Series
from harness.cosim.worker.process import WorkerProcess
from harness.files import nearest_file
from harness.recording.attitude import TICK_S, Array
from harness.recording.recording import RecordingError
from harness.recording.signals import SensorSignals
from harness.replay.fmu import run_fmu
from harness.replay.source import ReplaySource
from harness.trial.plan import si_value
from harness.trial.scenario import Scenario, ScenarioError, load
from models.errors import CanineError, UsageError, nearest
from models.kit.block import Block
from models.kit.declaration import Input, Variable, flatten
from models.readings import CAP, FLOORS
from models.seven_state import TUNINGS
from models.system import ESTIMATORS, find_estimator

HELD, MEAN = "speed held", "mean speed"
MEAN_S = 3.0  # s of GPS speed before an outage, of which `mean speed` takes the mean
ALL = "all"
CONFIGURATIONS: dict[str, dict[str, dict[str, float]]] = {
    "four_state": {
        "no pitch": {"use_pitch": 0, "fuzzy": 0},
        "pitch": {"use_pitch": 1, "fuzzy": 0},
        "fuzzy": {"use_pitch": 1, "fuzzy": 1},
        "pitch, floor": {"use_pitch": 1, "fuzzy": 0, **FLOORS},
        "fuzzy, floor, cap": {"use_pitch": 1, "fuzzy": 1, **FLOORS, **CAP},
    },
    "two_bias": {"two_bias": {}, "two_bias, floor, cap": {**FLOORS, **CAP}},
    "seven_state": {
        "seven_state": dict(TUNINGS["canine"]),
        "seven_state, pedestrian": dict(TUNINGS["pedestrian"]),
    },
}


class EstimateError(CanineError):
    """An estimator answered what is no finite number."""


@dataclass(frozen=True)
class Configuration:
    """An estimator with some of its parameters set.

    Attributes:
        estimator: of ours, or the path of an FMU.
        parameters: SI, by flat name.
        settings: those of --set among them, as written.
    """

    name: str
    estimator: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    settings: tuple[str, ...] = ()

    def run(
        self,
        signals: SensorSignals,
        ticks: int,
        observe: Sequence[str] = (),
        process: WorkerProcess | None = None,
    ) -> dict[str, Array]:
        """Run it over the first `ticks` ticks, from the start: each output and observed state, (ticks,).

        Args:
            process: the worker in which an FMU runs that was not built here; by default one of its own.

        Raises:
            FmuError: its FMU fails, or has an input that is no sensor signal.
            EstimateError: it answers no finite number.
        """
        estimate = self._estimate(signals, ticks, observe, process)
        for name, values in estimate.items():
            for tick in np.flatnonzero(~np.isfinite(values))[:1]:
                raise EstimateError(
                    f'{self.name}: output "{name}" is {values[tick]} at t = {tick * TICK_S:.10g} s; '
                    "expected a finite number"
                )
        return estimate

    def _estimate(
        self, signals: SensorSignals, ticks: int, observe: Sequence[str], process: WorkerProcess | None
    ) -> dict[str, Array]:
        if self.estimator not in ESTIMATORS:
            return run_fmu(Path(self.estimator), signals, ticks, self.parameters, process)
        block = ESTIMATORS[self.estimator]
        names = (*block.flat_names("output"), *observe)
        rows = _series(self.estimator, names).run(
            {
                f"{self.estimator}.{name}": np.asarray(getattr(signals, name)[:ticks], np.float64)
                for name in block.flat_names("input")
            },
            {self.estimator: self.parameters},
        )
        return {name: rows[f"{self.estimator}.{name}"] for name in names}


@cache
def _series(estimator: str, names: tuple[str, ...]) -> Series:
    return Series(ESTIMATORS[estimator], [f"{estimator}.{name}" for name in names])


@dataclass(frozen=True)
class Comparison:
    """What a replay compares.

    Attributes:
        estimators: names or paths, as asked for.
        settings: `estimator.name=value`, and files of parameters, as asked for.
        configurations: of all estimators.
    """

    estimators: tuple[str, ...]
    settings: tuple[str, ...]
    configurations: tuple[Configuration, ...]

    @property
    def name(self) -> str:
        """The estimators, in a word for titles and files."""
        return ",".join(self.estimators)

    def usable(self, source: ReplaySource) -> list[Configuration]:
        """The configurations that a recording has the sensors for.

        Raises:
            RecordingError: there is none.
        """
        blind = self._blind(source)
        left = [c for c in self.configurations if c.estimator not in blind]
        if not left:
            raise RecordingError(
                f"{source.name}: has no magnetometer, which {' and '.join(blind)} needs; "
                "choose another estimator"
            )
        return left

    def notes(self, source: ReplaySource) -> list[str]:
        """A note on each estimator that a recording has no sensors for, and on fixes that others refuse."""
        blind = self._blind(source)
        lines = [f"{e}: left out, since the recording has no magnetometer" for e in blind]
        refusals: dict[str, list[str]] = {}
        for estimator in self.estimators:
            if estimator in ESTIMATORS and estimator not in blind:
                refusals.setdefault(refused_fixes(estimator, source.signals([])), []).append(estimator)
        return lines + [f"{', '.join(who)}: {refused}" for refused, who in refusals.items() if refused]

    def _blind(self, source: ReplaySource) -> list[str]:
        takers = [e for e in self.estimators if e in ESTIMATORS and _takes_field(e)]
        signals = source.signals([]) if takers else None
        if signals is None or any(np.any(getattr(signals, f"mag_{axis}")) for axis in "xyz"):
            return []
        return takers


def refused_fixes(estimator: str, signals: SensorSignals) -> str:
    """How many fixes an estimator of ours refuses as out of its declared ranges, and why; "" if none."""
    block = ESTIMATORS[estimator]
    declared, fixes = block.variables(Input), np.asarray(signals.gps_fix, dtype=np.bool_)
    refused, causes = np.zeros(int(fixes.sum()), dtype=np.bool_), []
    for name in block.fix:
        values, of = np.asarray(getattr(signals, name), dtype=np.float64)[fixes], declared[name]
        low, high = -np.inf if of.min is None else of.min, np.inf if of.max is None else of.max
        outside = ~((values >= low) & (values <= high))
        refused |= outside
        if outside.any():
            span = " to ".join(dict.fromkeys(f"{v:.4g}" for v in np.percentile(values[outside], (0, 100))))
            causes.append(f"{name} of {span} {of.unit}, expected {low:g} to {high:g} {of.unit}")
    if not causes:
        return ""
    return f"{refused.sum()} of {len(refused)} fixes refused ({'; '.join(causes)}); are the units right?"


def _takes_field(estimator: str) -> bool:
    """Does it correct itself by the magnetometer?"""
    return "mag_x" in ESTIMATORS[estimator].flat_names("input")


def compare(estimators: str, settings: Sequence[str] = (), parameters: Sequence[Path] = ()) -> Comparison:
    """What to compare, from the options of `canine replay`.

    Args:
        estimators: names of ours and paths of FMUs with commas between; `all` is all of ours.
        settings: `six_state.name=value`, or `estimator.name=value` for all that have the parameter; angles in
            degrees. They hold in every configuration.
        parameters: files of TOML such as tune.toml, whose [parameters] make a further configuration of each
            estimator that they are of.

    Raises:
        UsageError: there is no such estimator or parameter, the value is out of its range, or the parameter
            is what configurations differ by.
    """
    names = [name.strip() for name in estimators.split(",")]
    each = [ESTIMATORS if name == ALL else (name,) for name in names]
    chosen = list(dict.fromkeys(name for some in each for name in some))
    configurations = [c for name in chosen for c in _configurations(name)]
    for path in parameters:
        configurations += _of_file(path, chosen)
    for address, written in Scenario().override(settings).parameters.items():
        owner, _, name = address.partition(".")
        having = _owners(owner, name, chosen, f"--set {address}")
        for i, configuration in enumerate(configurations):
            if configuration.estimator in having:
                own = _parameters(ESTIMATORS[configuration.estimator])
                value = si_value(written, own[name], f"--set {address}")
                configurations[i] = replace(
                    configuration,
                    parameters={**configuration.parameters, name: value},
                    settings=(*configuration.settings, f"{address}={written}"),
                )
    return Comparison(tuple(chosen), (*settings, *map(str, parameters)), tuple(configurations))


def _configurations(name: str) -> list[Configuration]:
    if name.endswith(".fmu"):
        if not Path(name).is_file():
            raise UsageError(f'there is no FMU "{name}"{nearest_file(Path(name))}')
        return [Configuration(Path(name).name, name)]
    find_estimator(name)
    own: Mapping[str, Mapping[str, float]] = CONFIGURATIONS.get(name, {name: {}})
    return [Configuration(label, name, parameters) for label, parameters in own.items()]


def _of_file(path: Path, chosen: Sequence[str]) -> list[Configuration]:
    """A configuration of each estimator that a file has parameters of; those of other blocks are not used."""
    written = load(str(path), mission=False).parameters
    rows: dict[str, dict[str, float]] = {}
    for address, value in written.items():
        owner, _, name = address.partition(".")
        if owner in chosen and owner in ESTIMATORS:
            own, where = _parameters(ESTIMATORS[owner]), f"{path.name}: {address}"
            if name not in own:
                raise ScenarioError(f'{where}: {owner} has no parameter "{name}"{nearest(name, own)}')
            rows.setdefault(owner, {})[name] = si_value(value, own[name], where)
    if not rows:
        raise ScenarioError(
            f"{path}: has no parameter of {' or '.join(chosen)}; "
            'expected [parameters] such as "six_state.sigma_heading" = 1'
        )
    return [Configuration(f"{owner}, {path.stem}", owner, row) for owner, row in rows.items()]


def _owners(owner: str, name: str, chosen: Sequence[str], where: str) -> list[str]:
    """The estimators in which a setting's parameter is."""
    ours = [estimator for estimator in chosen if estimator in ESTIMATORS]
    if not ours:
        raise ScenarioError(
            f"{where}: {' and '.join(chosen)} is an FMU, whose parameters a replay does not set; expected an "
            "estimator of ours, or export the FMU with the value"
        )
    if owner not in (*ours, "estimator"):
        raise ScenarioError(
            f'{where}: no estimator "{owner}" is replayed{nearest(owner, (*ours, "estimator"))}'
        )
    asked = ours if owner == "estimator" else [owner]
    having = [e for e in asked if name in _parameters(ESTIMATORS[e])]
    if not having:
        known = {n for e in asked for n in _parameters(ESTIMATORS[e])}
        raise ScenarioError(f'{where}: {" and ".join(asked)} has no parameter "{name}"{nearest(name, known)}')
    for estimator in having:
        rows = CONFIGURATIONS.get(estimator, {}).values()
        if len(rows) > 1 and all(name in row for row in rows):
            raise ScenarioError(
                f"{where}: the configurations of {estimator} set it themselves, and all are in the table"
            )
    return having


def _parameters(block: type[Block]) -> dict[str, Variable]:
    return dict(flatten(block.group("parameter")))


HELD_BY = ("gps_fix", "gps_north", "gps_east", "gps_speed", "heading_meas")  # all that a held speed needs


def hold_speed(sensed: Mapping[str, Array], ticks: int, mean_s: float = 0.0) -> dict[str, Array]:
    """Dead reckoning without a filter, (ticks,) each: after the last fix its speed along the heading.

    A heading that is not finite is bridged by the one before it, as the estimators do.

    Args:
        sensed: the signals of `HELD_BY`, at least (ticks,) each.
        mean_s: the mean speed of the fixes in that time [s] before the last one, and of it, is held.
    """
    north, east, speed = (sensed[f"gps_{name}"][:ticks].copy() for name in ("north", "east", "speed"))
    fixes = np.flatnonzero(sensed["gps_fix"][:ticks])
    last = int(fixes[-1])
    recent = fixes[fixes >= last - round(mean_s / TICK_S)]
    held = float(speed[recent].mean())
    heading = sensed["heading_meas"][:ticks]
    finite = np.isfinite(heading)
    latest = np.maximum.accumulate(np.where(finite, np.arange(ticks), 0))
    steps = held * TICK_S * np.exp(1j * heading[latest][last + 1 :])
    way = np.cumsum(steps)
    north[last + 1 :], east[last + 1 :] = north[last] + way.real, east[last] + way.imag
    speed[last + 1 :] = held
    return {"north": north, "east": east, "speed": speed}


BASELINES = {HELD: 0.0, MEAN: MEAN_S}  # without a filter: the s of whose fixes the mean speed is held
