"""How often the dog gets there: candidates tried by simulated trials, the areas watched.

Trial i of each candidate has the same seed, so that chance is common to all. A trial ends when the last
waypoint is reached and the recall begins: on the recall the simulated dog runs straight home, whatever stands
there, which says nothing about the way out. It succeeds if the dog reached the end and was in no area before.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.batch.areas import Areas
from codegen.batch.batch import Batch
from harness.routes.candidates import Candidate
from harness.routes.site import Area, Place, rings_of
from harness.sweep.chunks import TICK_S, TrialType, cores
from harness.sweep.table import wilson
from harness.sweep.trials import trial_type
from harness.trial.scenario import Scenario
from models.cmec import MAX_WAYPOINTS
from models.modes import BEFORE_RECALL, Mode
from models.system import System

OVER = frozenset(Mode) - BEFORE_RECALL
PLACE = ("plant.position_north", "plant.position_east")
OBSERVED = ("controller.mode", "controller.directional_commands")
OWN = (  # of each candidate, where the system has them
    "controller.waypoint_count",
    *(f"controller.waypoint_{axis}[{i + 1}]" for axis in ("north", "east") for i in range(MAX_WAYPOINTS)),
    "plant.start_heading",
    "plant.start_heading_deviation",
)
PIECES = 4  # of a round, for each core

Integers = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Score:
    """The trials of a candidate.

    Attributes:
        ticks: (trials,) the tick on which a trial succeeded, 0 if it failed.
        entered: (trials,) the number of the first area that the dog was in, 0 for none.
        reached: (trials,) was the end reached, whatever was entered?
        commands: (trials,) LEFT and RIGHT that were issued.
    """

    ticks: Integers
    entered: Integers
    reached: npt.NDArray[np.bool_]
    commands: Integers

    @property
    def trials(self) -> int:
        """Number of trials."""
        return len(self.ticks)

    @cached_property
    def successes(self) -> int:
        """Trials in which the dog reached the end and was in no area."""
        return int(np.count_nonzero(self.ticks))

    @property
    def success_rate(self) -> float:
        """Share of successes."""
        return self.successes / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the success rate."""
        return wilson(self.successes, self.trials)

    @cached_property
    def entries(self) -> int:
        """Trials in which the dog was in an area."""
        return int(np.count_nonzero(self.entered))

    @property
    def entry_rate(self) -> float:
        """Share of trials in which the dog was in an area."""
        return self.entries / self.trials

    @property
    def entry_interval(self) -> tuple[float, float]:
        """95 % interval of that share."""
        return wilson(self.entries, self.trials)

    @cached_property
    def mean_time(self) -> float | None:
        """Mean time to the end [s] of the trials that succeeded; None if there are none."""
        return TICK_S * float(self.ticks[self.ticks > 0].mean()) if self.successes else None

    @cached_property
    def mean_commands(self) -> float | None:
        """Mean number of stimuli, LEFT and RIGHT, in the trials that succeeded; None if there are none."""
        return float(self.commands[self.ticks > 0].mean()) if self.successes else None

    def by_area(self, areas: Sequence[Area]) -> dict[str, float]:
        """Share of trials that first entered each area, of those that were entered, by its name."""
        counts = np.bincount(self.entered, minlength=len(areas) + 1)[1:]
        entries: Counter[str] = Counter()
        for area, count in zip(areas, counts, strict=True):
            if count:
                entries[area.name] += int(count)
        return {name: count / self.trials for name, count in entries.items()}

    def joined(self, further: Score) -> Score:
        """With the trials that come behind these."""
        return Score(
            *(
                np.concatenate([getattr(self, name), getattr(further, name)])
                for name in ("ticks", "entered", "reached", "commands")
            )
        )


class Scorer:
    """Tries candidates with one dog and one controller.

    Args:
        scenario: the dog and the controller; its start and its waypoints are replaced.
        system: what the scenario runs in.
        areas: that the dog may not enter.
    """

    def __init__(self, scenario: Scenario, system: System, areas: Sequence[Area], begin: Place) -> None:
        self.scenario, self.system, self.begin = scenario, system, begin
        self.areas = Areas([rings_of(area.shape) for area in areas])
        parameters = {
            f"{name}.{parameter}"
            for name, block in system.components.items() for parameter in block.flat_names("parameter")
        }  # fmt: skip
        self.own = [name for name in OWN if name in parameters]
        stop = ("controller.mode", OVER)
        self.batch = Batch(system, self.own, OBSERVED, stop, watch=PLACE)

    def scenario_of(self, candidate: Candidate) -> Scenario:
        """The scenario with a candidate's waypoints; the dog is set down facing the first."""
        return route_scenario(self.scenario, self.begin, candidate.waypoints)

    def trial_type(self, candidate: Candidate) -> TrialType:
        """A candidate's trial, resolved.

        Raises:
            ScenarioError: the scenario does not fit the system.
        """
        return trial_type(self.scenario_of(candidate), self.system)

    def run(self, candidates: Sequence[Candidate], first: int, last: int) -> list[Score]:
        """Try each candidate by the trials first <= i < last, on all cores.

        Raises:
            CompileError: the compiler refuses the batch runner.
        """
        types = [self.trial_type(candidate) for candidate in candidates]
        values = types[0].values
        rows = np.array([[each.flat.get(name, 0.0) for name in self.own] for each in types])
        number = np.arange(len(candidates) * (last - first), dtype=np.int64)
        point, trial = np.divmod(number, last - first)
        seed = self.scenario.seed + first + trial

        def run(part: slice) -> Any:
            return self.batch.run(
                values, rows, point[part], seed[part], types[0].ticks,
                changes=types[0].changes, areas=self.areas,
            )  # fmt: skip

        run(slice(0, 0))  # compile once, before the threads start
        size = max(1, math.ceil(len(number) / (PIECES * cores())))
        with ThreadPoolExecutor(cores()) as pool:
            parts = [slice(at, at + size) for at in range(0, len(number), size)]
            results = list(pool.map(run, parts))
        mode, commands = np.concatenate([each.values for each in results]).astype(np.int32).T
        entered = np.concatenate([each.entered for each in results])
        ticks = np.concatenate([each.ticks for each in results])
        reached = mode == Mode.RECALL
        ticks = np.where(reached & (entered == 0), ticks, 0)
        shape = (len(candidates), last - first)
        return [
            Score(*columns)
            for columns in zip(
                *(each.reshape(shape) for each in (ticks, entered, reached, commands)), strict=True
            )
        ]


def route_scenario(scenario: Scenario, begin: Place, waypoints: Sequence[Place]) -> Scenario:
    """A scenario that leads along these waypoints; the dog is set down facing the first."""
    (north, east), (to_north, to_east) = begin, waypoints[0]
    heading = math.degrees(math.atan2(to_east - east, to_north - north))
    return replace(scenario, waypoints=tuple(waypoints), start=(north, east, heading))
