"""Candidates tried in rounds, and the choice between those that are left.

Successive halving: all candidates are tried 256 times. Then, round by round, half of them, eight at least, go
on with twice as many trials, until the trials asked for are reached. Candidates that succeed less than half
as often as the best go first. Of the others those go on that no other one beats in success, time, stimuli and
entries at once, then those that only these beat, and so on. The shortest way without a waypoint between its
corners goes on in any case, to be compared with.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from harness.routes.candidates import Candidate
from harness.routes.problem import Problem
from harness.routes.score import Score, route_scenario
from harness.sweep.recommend import best_for_success
from harness.terminal import percent
from harness.trial.scenario import Scenario

FIRST = 256  # trials of each candidate in the first round
FINALISTS = 8
FLOOR = 0.5  # success below which what is recommended comes with a warning: the dog more often fails
OFFERED = 0.5  # share of the best's success below which a candidate goes first


@dataclass(frozen=True)
class Round:
    """How many candidates were tried how often; one that goes on keeps its trials."""

    candidates: int
    trials: int


@dataclass(frozen=True)
class Result:
    """The candidates that are left, all with the same trials.

    Attributes:
        tried: by candidate.
        reference: the shortest way, unsplit.
    """

    problem: Problem
    tried: dict[Candidate, Score]
    reference: Candidate
    rounds: list[Round] = field(default_factory=list)

    @cached_property
    def ranked(self) -> list[Candidate]:
        """By success, the best first."""
        return sorted(self.tried, key=lambda c: (-self.tried[c].success_rate, _cost(self.tried[c])))

    @cached_property
    def front(self) -> list[Candidate]:
        """Those that no other one beats in success, time, stimuli and entries at once, best success first."""
        able = [c for c in self.ranked if self.tried[c].successes]
        layers = _layers([_objectives(self.tried[c]) for c in able])
        return [c for c, layer in zip(able, layers, strict=True) if layer == 0]

    @cached_property
    def as_good(self) -> list[Candidate]:
        """Those not shown to succeed less often than the best (`harness.sweep.recommend`)."""
        ticks = np.stack([self.tried[c].ticks for c in self.ranked])
        named = best_for_success(ticks.astype(np.uint32)).named
        return [c for c, is_named in zip(self.ranked, named, strict=True) if is_named]

    @cached_property
    def able(self) -> list[Candidate]:
        """Those of `as_good` that ever succeed."""
        return [c for c in self.as_good if self.tried[c].successes]

    @cached_property
    def clearest(self) -> list[Candidate]:
        """Those of `able` that are not shown to enter areas more often than another one."""
        outside = [(self.tried[c].entered == 0).astype(np.uint32) for c in self.able]
        named = best_for_success(np.stack(outside)).named if outside else ()
        return [c for c, is_named in zip(self.able, named, strict=True) if is_named]

    @cached_property
    def recommended(self) -> Candidate | None:
        """The fastest of `clearest`; None if no candidate ever succeeded."""
        return min(self.clearest, key=lambda c: _cost(self.tried[c]), default=None)

    @property
    def caution(self) -> str:
        """A warning of a recommended route that succeeds too seldom; "" if it does not."""
        if self.recommended is None or self.tried[self.recommended].success_rate >= FLOOR:
            return ""
        return (
            f"the recommended route succeeds in {percent(self.tried[self.recommended].success_rate)} of the "
            f"trials, less than {100 * FLOOR:g} %: none of those tried is shown to be better, and no dog "
            "should be led along it; take other spacings, clearances or ways, a nearer end, or another "
            "controller"
        )

    def scenario_of(self, candidate: Candidate, name: str) -> Scenario:
        """The scenario of a candidate, for `canine run`."""
        problem = self.problem
        return replace(route_scenario(problem.base, problem.begin, candidate.waypoints), name=name)


def run(problem: Problem, progress: Callable[[float], None] | None = None) -> Result:
    """Try the candidates in rounds.

    Args:
        progress: called after each further round, with its trials as a share of those asked for.

    Raises:
        CompileError: the compiler refuses the batch runner.
    """
    scorer, reference = problem.scorer, problem.candidates[0]
    trials = min(FIRST, problem.asked.trials)
    tried = dict(zip(problem.candidates, scorer.run(problem.candidates, 0, trials), strict=True))
    rounds = [Round(len(tried), trials)]
    while trials < problem.asked.trials:
        kept = _kept(tried, reference)
        further = min(2 * trials, problem.asked.trials)
        scores = scorer.run(kept, trials, further)
        tried = {c: tried[c].joined(score) for c, score in zip(kept, scores, strict=True)}
        trials = further
        rounds.append(Round(len(kept), trials))
        if progress:
            progress(trials / problem.asked.trials)
    return Result(problem, tried, reference, rounds)


def _objectives(score: Score) -> tuple[float, ...]:
    """What is to be small: failures, time, stimuli, entries."""
    infinite = float("inf")
    return (
        1 - score.success_rate,
        infinite if score.mean_time is None else score.mean_time,
        infinite if score.mean_commands is None else score.mean_commands,
        score.entry_rate,
    )


def _cost(score: Score) -> float:
    """The time, by which candidates with the same success are ranked."""
    return _objectives(score)[1]


def _layers(objectives: Sequence[tuple[float, ...]]) -> list[int]:
    """The Pareto layer of each: 0 for those that none beats, 1 for those that only these beat, and so on."""
    layers = [-1] * len(objectives)
    for layer in itertools.count():
        left = [i for i, own in enumerate(layers) if own < 0]
        if not left:
            return layers
        for i in left:
            if not any(_beats(objectives[k], objectives[i]) for k in left):
                layers[i] = layer
    raise AssertionError


def _beats(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one != other and all(a <= b for a, b in zip(one, other, strict=True))


def _kept(tried: dict[Candidate, Score], reference: Candidate) -> list[Candidate]:
    """The half that goes on, FINALISTS at least, and the reference; in the order of `tried`."""
    count = max(FINALISTS, -(-len(tried) // 2))
    most = max(score.success_rate for score in tried.values())
    names = list(tried)
    layers = _layers([_objectives(tried[c]) for c in names])

    def rank(i: int) -> tuple[Any, ...]:
        rate = tried[names[i]].success_rate
        return rate < OFFERED * most, layers[i], -rate

    kept = {names[i] for i in sorted(range(len(names)), key=rank)[:count]} | {reference}
    return [c for c in names if c in kept]
