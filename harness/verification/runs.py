"""The trials that are run: those of `canine sweep`, and one like the example of Figure 5.2."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from codegen.scratch import Scratch
from harness.log.channel import Array
from harness.log.log import Log, read_log
from harness.sweep.chunks import ANOMALIES, TICK_S, Outcomes, batch_of, pool_at, run_all
from harness.sweep.plots import trend
from harness.sweep.recommend import Ticks, error_shares
from harness.sweep.sweep import Sweep, plan_sweep
from harness.sweep.table import Z_95, Point, table_of
from harness.trial import trial
from harness.trial.plots import equal_stretches
from harness.trial.prepare import prepared
from harness.trial.request import Request, build_missing
from harness.trial.scenario import load
from models.cmec import Cmec
from models.commands import Command, Status
from models.readings import PUBLISHED
from models.sets import sets_of


@dataclass(frozen=True)
class Size:
    """Numbers of trials.

    Attributes:
        curve: at each threshold of the curves; 1000 in 5.3.5 and 5.3.6.
        rate: for each rate that is compared with the field's.
        ranked: at each threshold of the recommendations.
        long: over each distance.
        street: of each type on each map of streets.
        shipped: of each scenario with streets.
        gain: at each gain of habituation, for each count of the field.
        straight: along a straight way, for each distance of waypoints and each gain.
        seeds: among which the trial of Figure 5.2 is sought.
    """

    curve: int = 1000
    rate: int = 40_000
    ranked: int = 10_000
    long: int = 10_000
    street: int = 8000
    shipped: int = 2000
    gain: int = 8000
    straight: int = 5000
    seeds: int = 1000


def _of_table_5_1(*parameters: str) -> tuple[str, ...]:
    """What Table 5.1 has for some parameters of the dog, as settings."""
    values = sets_of("plant")["table_5_1"]
    return tuple(f"canine.{name}={values[name]:g}" for name in parameters)


SEARCH = _of_table_5_1("bumper_search_min", "bumper_search_max")
WATCH = ("canine.start_delay=0.5",)
CAUSES = {  # 5.3.7.1
    "search for the bumper, 1 to 5 s": SEARCH,
    "each response 0.1 s late": ("canine.response_delay=0.1",),
    "each response 0.2 s late": ("canine.response_delay=0.2",),
    "each response 0.3 s late": ("canine.response_delay=0.3",),
    "watch started 0.5 s early": WATCH,
    "search, responses 0.1 s late": (*SEARCH, "canine.response_delay=0.1"),
    "all: search, 0.2 s late, watch 0.5 s early": (*SEARCH, "canine.response_delay=0.2", *WATCH),
}
ALL_CAUSES = list(CAUSES)[-1]
OBEDIENT = ("canine.right_success=1", "canine.left_success=1")
SAME_DRIFT = ("canine.drift_deviation=0",)
SAME_TURNS = ("canine.right_turn_rate_deviation=0", "canine.left_turn_rate_deviation=0")
SAME_DOG = (*SAME_DRIFT, *SAME_TURNS, "canine.start_heading_deviation=0")
STRAIGHT = ("canine.drift=0", *SAME_DRIFT)
DOGS = {
    "Table 5.1": (),
    "turn success rates 1 and 1": OBEDIENT,
    "turn success rates halved, 0.30 and 0.32": ("canine.right_success=0.3", "canine.left_success=0.32"),
    "turn rates always their means": SAME_TURNS,
    "drift always its mean": SAME_DRIFT,
    "no drift": STRAIGHT,
    "drift at its mean, no deviations": SAME_DOG,
    "drift at its mean, no deviations, rates 1": (*SAME_DOG, *OBEDIENT),
    "no drift, no deviations, rates 1": ("canine.drift=0", *SAME_DOG, *OBEDIENT),
}
# with one waypoint beyond the start no turn is told behind one: `field` is `calibrated` there, trial by trial
DIFFERENT = {"two": ("calibrated", "literal"), "three": PUBLISHED}
DRAWN = ("canine=table_5_1",)
EXPLANATIONS = {  # of the field's counts: a reading and a dog
    "calibrated": ("calibrated", ()),
    "literal": ("literal", ()),
    "`field`": ("field", ()),
    "calibrated, dog `table_5_1`": ("calibrated", DRAWN),
    "literal, dog `table_5_1`": ("literal", DRAWN),
    "`field`, dog `table_5_1`": ("field", DRAWN),
}
DRAWS = {  # what of the dog's speed is drawn for each trial
    "the means": (),
    "speed drawn": _of_table_5_1("cruise_speed_deviation"),
    "accelerations drawn": _of_table_5_1("speeding_up_deviation", "slowing_down_deviation"),
    "all, and the search: `table_5_1`": DRAWN,
}
AIMS = {"the CMEC": (), "mean drift": ("cmec=aim_off_mean",), "learnt drift": ("cmec=aim_off",)}
REDRAWN = ("canine.drift_redrawn=true",)
FORGETFUL = ("cmec.drift_persistence=0.9",)
LATE = ("canine.response_delay=0.3",)
AIMED_DOGS = {
    "Table 5.1, means": (),
    "`table_5_1`": DRAWN,
    "its drift drawn at each FORWARD": REDRAWN,
    "means, `cmec.drift_persistence=0.9`": FORGETFUL,
    "drawn at each FORWARD, `cmec.drift_persistence=0.9`": (*REDRAWN, *FORGETFUL),
    "0.3 s late": LATE,
    "0.3 s late, `cmec.response_time=0.3`": (*LATE, "cmec.response_time=0.3"),
    "0.3 s late, learnt from 0.1 ± 0.2 s": (*LATE, "cmec.response_time=0.1", "cmec.response_sd=0.2"),
    "means, `cmec.braking=2.72`": ("cmec.braking=2.72",),
    "means, `cmec.starting_time=2.74`": ("cmec.starting_time=2.74",),
}
DISTANCES = (25, 50, 100, 200, 500)  # m
NO_LIMIT = ("cmec.max_turns=1000",)
ROUTES = {3: "right_90", 4: "four_waypoint", 5: "five_waypoint"}
EXAMPLE = (
    Command.RIGHT,
    Command.NONE,
    Command.RIGHT,
    Command.FORWARD,
)  # 5.2: ignored, silence, obeyed


@dataclass(frozen=True, eq=False)
class Simulated:
    """The results of a sweep over thresholds; ticks (thresholds, trials) as in `chunks.Outcomes`."""

    sweep: Sweep
    table: list[Point]
    ticks: Ticks

    @property
    def thresholds(self) -> Array:
        """h' in deg."""
        return np.array([float(point.written[0]) for point in self.table])

    @property
    def rates(self) -> Array:
        """Success rates."""
        return np.array([point.success_rate for point in self.table])

    def at(self, threshold: float) -> Point:
        """The point at this h' [deg]."""
        return self.table[int(np.flatnonzero(self.thresholds == threshold)[0])]

    @property
    def trend(self) -> tuple[Callable[[Array], Array], float]:
        """The trend line through the success rates and its R2, as `canine sweep` draws it.

        Raises:
            ValueError: all rates are equal, or there are too few.
        """
        fitted = trend(self.thresholds, self.rates)
        if fitted is None:
            raise ValueError("all success rates are equal, or there are too few; run more trials")
        return fitted


@cache
def simulate(
    target: str, thresholds: str, trials: int, reading: str = "calibrated", settings: tuple[str, ...] = ()
) -> Simulated:
    """The trials of `canine sweep TARGET --thresholds ... --reading ... --set ...`."""
    return run(plan_sweep(target, thresholds=thresholds, trials=trials, reading=reading, settings=settings))


def run(sweep: Sweep) -> Simulated:
    """The trials of a sweep."""
    outcomes = Outcomes(sweep.job)
    with pool_at(None, sweep.job) as pool:
        share = -(-sweep.job.total // pool.width)  # one chunk for each core: large chunks run faster
        run_all(outcomes, pool, keep=lambda chunk: None, size=share)
    return Simulated(sweep, table_of(sweep.points, outcomes), outcomes.ticks)


def mean_time_error(point: Point) -> float:
    """Half the width of a mean time's 95 % interval, s."""
    return Z_95 * (point.sd_time or 0.0) / math.sqrt(max(point.successes, 1))


def time_difference(ticks: Ticks, other: Ticks) -> tuple[float, float]:
    """How much longer [s] one row's successful trials take on average than another's, and its standard error.

    The rows are of the same seeds, so their common variation drops out.
    """
    means = [float(row[row > 0].mean()) for row in (ticks, other)]
    shares = error_shares(ticks, means[0]) - error_shares(other, means[1])
    return TICK_S * (means[0] - means[1]), TICK_S * float(np.sqrt(np.sum(shares**2)))


@dataclass(frozen=True)
class Example:
    """A trial like that of Figure 5.2; times in s.

    Attributes:
        commanded, silenced, repeated: when RIGHT began, ended, and began again.
        obeyed: when FORWARD followed.
        end: of the trial.
    """

    seed: int
    commanded: float
    silenced: float
    repeated: float
    obeyed: float
    end: float
    log: Log


def find_example(seeds: int) -> Example:
    """The first trial of right_90, among the seeds from 1 on, that goes as in Figure 5.2.

    It is a success with one TURN FAILURE and no other anomaly, and its RIGHT is obeyed when it is repeated.
    The batch runner searches the seeds; then the trial runs through the FMUs, as with `canine run`.

    Raises:
        LookupError: no seed gives such a trial.
    """
    job = plan_sweep("right_90").job
    (trial_type,) = job.trial_types
    numbers = np.arange(1, seeds + 1, dtype=np.int32)
    threshold = np.array([[Cmec.moving_deviation.start[0]]])
    results = batch_of(job).run(
        trial_type.values, threshold, np.zeros_like(numbers), numbers, trial_type.ticks
    )
    anomalies = results.values[:, 2:]
    failure = anomalies[:, ANOMALIES.index("turn_failure")]
    fits = (results.values[:, 0] == Status.SUCCESS) & (failure == 1) & (anomalies.sum(axis=1) == 1)
    for seed in numbers[fits]:
        log = _run_trial("right_90", int(seed))
        held = equal_stretches(log["controller.command"])
        for k in range(len(held) - 3):
            if tuple(value for _, _, value in held[k : k + 4]) == EXAMPLE:
                begins = (float(log.time[first]) for first, _, _ in held[k : k + 4])
                commanded, silenced, repeated, obeyed = begins
                end = float(log.time[-1])
                return Example(int(seed), commanded, silenced, repeated, obeyed, end, log)
    raise LookupError(f"right_90: none of the seeds 1 to {seeds} gives the trial of Figure 5.2")


def _run_trial(name: str, seed: int) -> Log:
    """A trial through the FMUs, the true state into the controller."""
    request = Request(replace(load(name), system="cts", seed=seed))
    build_missing(request)
    with prepared(request) as ready, Scratch() as scratch:
        folder = scratch / name  # the scratch folder has a lock already
        trial.run(request, ready, folder)
        return read_log(folder / trial.LOG)
