"""Days of missions: each mission is a trial that begins as the last one and a rest have left the dog.

A mission ends when the dog is home again, also after a failure. One that ends elsewhere, as when its time is
up, has failed, and the dog goes home straight. A success is a reward. Mission k of day d has the seed `seed`
+ k * days + d, so that all controllers and all rests meet the same chance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.batch.batch import Batch
from harness.fit.stated import FITTED, stated_and_assumed
from harness.sweep.axis import SweepError
from harness.sweep.chunks import TICK_S, Job, cores
from harness.sweep.components import find_components
from harness.sweep.table import wilson
from harness.sweep.trials import MAX_TRIALS, Options, adapted, native_job, without
from harness.trial.scenario import Scenario
from models.day import BOUNDS, CanineAllDay, Day, check_rest, rested, tired_after
from models.errors import UsageError
from models.kit.declaration import Parameter
from models.kit.random import MAX_SEED
from models.modes import ENDED, Mode
from models.system import CONTROLLER

PLANT = CanineAllDay.title()
STARTS = ("plant.start_fatigue", "plant.start_habituation")
OBSERVED = ("controller.mode", "plant.fatigue", "plant.habituation", "plant.north", "plant.east")
PIECE = 256  # days of a piece: a thread carries them through all missions
MOST_MISSIONS = 1000
ASSUMED = "fatigue and habituation are assumed: nobody measured how they grow, fade and act"
RESTED = (
    "the dog of Table 5.1 is taken for the rested one, though its means are of dogs that were tired by then"
)

Reals = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Asked:
    """What a day is asked for with.

    Attributes:
        target: a scenario, its file or name: each mission.
        controllers: of ours, by name.
        rests: between two missions [s]; several give several curves.
        days: how often the day is simulated.
        system, estimator, reading, seed: override the scenario's.
        settings: `block.name=value`; one of a controller acts where that one leads.
    """

    target: str | Scenario
    controllers: Sequence[str] = (CONTROLLER,)
    rests: Sequence[float] = (600.0,)
    missions: int = 8
    days: int = 1000
    system: str = "cts"
    estimator: str | None = None
    reading: str | None = None
    seed: int | None = None
    settings: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class Curve:
    """The days of one controller with one rest; the arrays are (missions, days).

    Attributes:
        controller: its name.
        rest: s.
        ticks: the tick on which a mission succeeded, 0 if it failed.
        timeouts: was the mission's time up before the dog was home?
        stopped: did a limit or the operator end the mission where the dog was?
        fatigue, habituation: with which the dog began the mission.
    """

    controller: str
    rest: float
    ticks: npt.NDArray[np.int32]
    timeouts: npt.NDArray[np.bool_]
    stopped: npt.NDArray[np.bool_]
    fatigue: Reals
    habituation: Reals

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """A row for each mission, as day.csv has it."""
        return [self._row(number) for number in range(len(self.ticks))]

    def _row(self, number: int) -> dict[str, Any]:
        ticks = self.ticks[number]
        successes = int(np.count_nonzero(ticks))
        low, high = wilson(successes, ticks.size)
        return {
            "controller": self.controller,
            "rest_s": self.rest,
            "mission": number + 1,
            "trials": ticks.size,
            "successes": successes,
            "success_rate": successes / ticks.size,
            "ci_low": low,
            "ci_high": high,
            "mean_fatigue": float(self.fatigue[number].mean()),
            "mean_habituation": float(self.habituation[number].mean()),
            "mean_time_s": TICK_S * float(ticks[ticks > 0].mean()) if successes else None,
            "timeouts": int(np.count_nonzero(self.timeouts[number])),
            "stopped": int(np.count_nonzero(self.stopped[number])),
        }


@dataclass(frozen=True)
class Days:
    """Days that are asked for, resolved.

    Attributes:
        scenarios: the mission, as each controller has it, by its name.
        jobs: the same as plain data.
    """

    asked: Asked
    scenarios: dict[str, Scenario]
    jobs: dict[str, Job]

    @property
    def scenario(self) -> Scenario:
        """The mission, as the first controller has it."""
        return next(iter(self.scenarios.values()))

    def seed(self, mission: int, day: Any) -> Any:
        """The seed of a mission of a day, or of each of some days; all are counted from 0."""
        return self.scenario.seed + mission * self.asked.days + day

    @property
    def animal(self) -> dict[str, float]:
        """The parameters of the animal's day in force, SI."""
        own = next(iter(self.jobs.values())).trial_types[0].values["plant"]
        declared = {n: v for n, v in Day.variables(Parameter).items() if n in vars(Day)}
        return {name: own.get(name, variable.start[0]) for name, variable in declared.items()}

    @property
    def notes(self) -> list[str]:
        """What the results rest on."""
        beyond = [
            f"canine.{name} is {self.animal[name]:g}, beyond the bound of about {bound.most:g}: {bound.since}"
            for name, bound in BOUNDS.items()
            if self.animal[name] > bound.most
        ]
        return [self._of(ASSUMED, list(self.animal)), self._of(RESTED, FITTED), *beyond]

    def _of(self, note: str, names: Sequence[str]) -> str:
        """A note on what is assumed of parameters, with those that the scenario states, and the others."""
        stated, assumed = stated_and_assumed(self.scenario.parameters, {PLANT}, names)
        rest = ", ".join(assumed) or "the laws alone"
        return f"{note}; stated: {', '.join(stated)}; still assumed: {rest}" if stated else note

    @property
    def identity(self) -> dict[str, Any]:
        """What tells these days from others, as day.json states it."""
        return {
            "scenario": self.scenario.name,
            "system": self.scenario.system,
            "estimator": self.asked.estimator,
            "reading": self.scenario.reading,
            "controllers": list(self.asked.controllers),
            "rests_s": list(self.asked.rests),
            "missions": self.asked.missions,
            "days": self.asked.days,
            "seed": self.scenario.seed,
            "parameters": dict(self.scenario.parameters),
            "settings": list(self.asked.settings),
            "animal": self.animal,
        }

    @property
    def total(self) -> int:
        """Number of trials."""
        return len(self.jobs) * len(self.asked.rests) * self.asked.missions * self.asked.days


@dataclass(frozen=True)
class Result:
    """The days that were run."""

    planned: Days
    curves: list[Curve] = field(default_factory=list)

    def missions_of(self, curve: Curve, day: int) -> list[Scenario]:
        """The missions of a day as scenarios, each with the dog as it begins them."""
        scenario = self.planned.scenarios[curve.controller]
        return [
            scenario.override(
                [
                    f"{PLANT}.start_fatigue={float(curve.fatigue[mission, day])!r}",
                    f"{PLANT}.start_habituation={float(curve.habituation[mission, day])!r}",
                ],
                self.planned.seed(mission, day),
                {"plant": PLANT},
            )
            for mission in range(self.planned.asked.missions)
        ]


def plan_days(asked: Asked, note: Callable[[str], None] = lambda text: None) -> Days:
    """Resolve what is asked for.

    Args:
        note: called with a line for the user.

    Raises:
        ScenarioError: the scenario or a setting is invalid.
        SweepError: a number or a list is out of its range.
        UsageError: a rest is, there is no such controller or estimator, or it is an FMU.
    """
    _check(asked)
    notes: dict[str, None] = {}  # in order, each once
    scenarios, jobs = {}, {}
    for controller in asked.controllers:
        components = find_components(controller=controller, plant=PLANT, estimator=asked.estimator)
        if components.fmus:
            role, name = next(iter(components.fmus.items()))
            raise UsageError(
                f"{role} {name}: is an FMU made elsewhere; a day runs our own blocks, "
                "`canine matrix` compares FMUs with them"
            )
        options = Options(asked.system, asked.estimator, reading=asked.reading, seed=asked.seed)
        settings = without(asked.settings, set(asked.controllers) - {controller})
        scenario = adapted(asked.target, options, settings, components)
        job = native_job([scenario], components, (), asked.days * asked.missions, notes.setdefault)
        scenarios[controller], jobs[controller] = scenario, job
    for text in notes:
        note(text)
    planned = Days(asked, scenarios, jobs)
    last = planned.seed(asked.missions - 1, asked.days - 1)
    if last > MAX_SEED:
        raise SweepError(
            f"days is {asked.days}: the last mission would have seed {last}; expected at most {MAX_SEED}"
        )
    if planned.total > MAX_TRIALS:
        raise SweepError(
            f"{len(planned.jobs)} controllers, {len(asked.rests)} rests, {asked.missions} missions and "
            f"{asked.days} days are {planned.total} trials; expected at most {MAX_TRIALS}: take fewer days"
        )
    return planned


def _check(asked: Asked) -> None:
    """Refuse numbers and lists that no day has."""
    for name, count, most in (("missions", asked.missions, MOST_MISSIONS), ("days", asked.days, MAX_TRIALS)):
        if not 1 <= count <= most:
            raise SweepError(f"{name} is {count}; expected 1 to {most}")
    for name, listed in (("controllers", asked.controllers), ("rest", asked.rests)):
        if not listed:
            raise SweepError(f"{name} is empty; expected at least one")
        for i, value in enumerate(listed):
            if value in listed[:i]:
                raise SweepError(f"{name}: {value} is named twice")
    for rest in asked.rests:
        check_rest(rest)


def run(planned: Days, progress: Callable[[float], None] | None = None) -> Result:
    """Run the days on all cores; the results do not depend on their number.

    Args:
        progress: called with the number of trials done.

    Raises:
        CompileError: the compiler refuses a batch runner.
    """
    days, missions = planned.asked.days, planned.asked.missions
    shape = (missions, days)
    curves = [
        Curve(
            controller,
            rest,
            *(np.zeros(shape, kind) for kind in (np.int32, np.bool_, np.bool_, float, float)),
        )
        for controller, rest in product(planned.jobs, planned.asked.rests)
    ]
    runners = {controller: _Runner(planned, job) for controller, job in planned.jobs.items()}

    def run_piece(piece: tuple[Curve, slice]) -> int:
        curve, some = piece
        for mission, begun in enumerate(runners[curve.controller].missions(some, curve.rest)):
            columns: tuple[npt.NDArray[Any], ...] = (
                curve.ticks, curve.timeouts, curve.stopped, curve.fatigue, curve.habituation
            )  # fmt: skip
            for column, values in zip(columns, begun, strict=True):
                column[mission, some] = values
        return missions * len(range(days)[some])

    pieces = product(curves, (slice(first, first + PIECE) for first in range(0, days, PIECE)))
    done = 0
    with ThreadPoolExecutor(cores()) as pool:
        for trials in pool.map(run_piece, pieces):
            done += trials
            if progress:
                progress(done)
    return Result(planned, curves)


class _Runner:
    """Runs the days of one controller; compiled once, before threads share it."""

    def __init__(self, planned: Days, job: Job) -> None:
        self.planned, self.job, self.trial = planned, job, job.trial_types[0]
        stop = ("controller.mode", [int(mode) for mode in ENDED])
        self.batch = Batch(job.wired, STARTS, OBSERVED, stop)
        self._run(np.zeros((0, len(STARTS))), np.zeros(0, np.int32))

    def missions(self, some: slice, rest: float) -> Iterator[tuple[Any, Any, Any, Reals, Reals]]:
        """Some days, mission by mission: success ticks, timeouts, stops; fatigue, habituation before."""
        animal = self.planned.animal
        number = np.arange(self.planned.asked.days)[some]
        fatigue = np.full(number.size, animal["start_fatigue"])
        habituation = np.full(number.size, animal["start_habituation"])
        for mission in range(self.planned.asked.missions):
            results = self._run(np.column_stack([fatigue, habituation]), self.planned.seed(mission, number))
            mode, tired, accustomed, north, east = results.values.T
            success = mode == Mode.SUCCESS
            timeouts = ~np.isin(mode, [int(ended) for ended in ENDED])
            stopped = mode == Mode.STOPPED
            yield np.where(success, results.ticks, 0), timeouts, stopped, fatigue, habituation
            home = self.planned.scenario.start
            way = np.where(
                (mode == Mode.SUCCESS) | (mode == Mode.FAILED), 0.0, np.hypot(north - home[0], east - home[1])
            )
            tired = tired_after(tired, way, animal["fatigue_way"])
            fatigue, habituation = rested(tired, accustomed, success, rest, animal)

    def _run(self, starts: Reals, seed: npt.NDArray[Any]) -> Any:
        return self.batch.run(
            self.trial.values,
            starts,
            np.arange(len(starts), dtype=np.int32),
            seed.astype(np.int32),
            self.trial.ticks,
            changes=self.trial.changes,
            stalls=self.job.stalls,
        )
