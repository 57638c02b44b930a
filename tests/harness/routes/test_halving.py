"""Rounds and choice: which candidates go on, which are on the Pareto front, which one is recommended."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from harness.routes import halving, report
from harness.routes.candidates import Candidate
from harness.routes.halving import Result
from harness.routes.score import Score
from harness.routes.way import Way


def candidate(number: int) -> Candidate:
    return Candidate(Way(((0.0, 0.0), (100.0, float(number))), "open"), None, ((100.0, float(number)),))


def score(rate: float, seconds: float, commands: int = 5, entries: float = 0.0, trials: int = 1000) -> Score:
    """Successes come first, then entries, then other failures."""
    successes, entered = round(rate * trials), round(entries * trials)
    number = np.arange(trials)
    return Score(
        np.where(number < successes, round(seconds / 0.04), 0).astype(np.int32),
        ((number >= successes) & (number < successes + entered)).astype(np.int32),
        number < successes,
        np.full(trials, commands, dtype=np.int32),
    )


def result(*scores: Score) -> Result:
    tried = {candidate(k): each for k, each in enumerate(scores)}
    return Result(SimpleNamespace(), tried, candidate(0))  # type: ignore[arg-type]


def numbers(candidates: list[Candidate]) -> list[int]:
    return [round(each.waypoints[0][1]) for each in candidates]


def test_a_score_counts_successes_entries_times_and_stimuli() -> None:
    one = score(0.6, 30.0, commands=4, entries=0.3)
    assert (one.successes, one.success_rate, one.entries, one.entry_rate) == (600, 0.6, 300, 0.3)
    assert (one.mean_time, one.mean_commands) == (30.0, 4.0)
    assert one.interval[0] < 0.6 < one.interval[1]
    none = score(0.0, 1.0)
    assert (none.mean_time, none.mean_commands) == (None, None)
    assert one.joined(none).success_rate == 0.3


def test_entries_are_told_by_the_area_that_is_entered_first_and_parts_of_one_name_are_one() -> None:
    one = score(0.5, 10.0, trials=8)
    entered = Score(one.ticks, np.array([0, 0, 0, 0, 1, 2, 3, 3], np.int32), one.reached, one.commands)
    areas: Any = [SimpleNamespace(name=name) for name in ("hall", "labs", "hall")]
    assert entered.by_area(areas) == {"hall": 3 / 8, "labs": 1 / 8}


def test_the_front_holds_those_that_no_other_beats_in_all_four() -> None:
    # given the best for success, for time, for stimuli, one beaten by the first, one with no success
    tried = result(
        score(0.9, 40, 8), score(0.5, 20, 8), score(0.6, 45, 3), score(0.8, 41, 8), score(0.0, 10, 0)
    )
    # then the front comes with the best success first
    assert numbers(tried.front) == [0, 2, 1]
    # and fewer entries keep one on it that all others beat
    tried = result(score(0.9, 40, 8, entries=0.05), score(0.8, 41, 9))
    assert numbers(tried.front) == [0, 1]


def test_the_fastest_of_those_not_shown_to_be_worse_than_the_best_is_recommended() -> None:
    # given the best, a faster one that is as good within chance, and a much faster one that is not
    tried = result(score(0.90, 40), score(0.895, 30), score(0.7, 10))
    assert numbers(tried.as_good) == [0, 1]
    assert tried.recommended == candidate(1)
    # and none, if none ever succeeds
    assert result(score(0.0, 10), score(0.0, 20)).recommended is None


def test_of_those_as_good_the_ones_that_enter_areas_less_are_preferred() -> None:
    # given the fastest, which enters areas in 8 % of the trials, and slower ones in 0 and 0.2 %
    tried = result(score(0.90, 30, entries=0.08), score(0.90, 50), score(0.895, 40, entries=0.002))
    # then it is the faster one of those whose entries may differ by chance
    assert numbers(tried.as_good) == [0, 1, 2]
    assert numbers(tried.clearest) == [1, 2]
    assert tried.recommended == candidate(2)


@pytest.mark.parametrize(
    ("scores", "ties"),
    [
        ([score(0.9, 30)], ""),
        ([score(0.02, 30), score(0.0, 20), score(0.0, 20)], ""),  # none of the others ever succeeds
        (
            [score(0.90, 30), score(0.90, 40)],
            "; 2 are not shown to succeed less often than the best; it is the fastest of these",
        ),
        (
            [score(0.90, 30, entries=0.08), score(0.90, 50), score(0.895, 40, entries=0.002)],
            "; 3 are not shown to succeed less often than the best, 2 of them not to enter areas more often; "
            "it is the fastest of these",
        ),
        (
            [score(0.90, 30, entries=0.08), score(0.90, 50)],
            "; 2 are not shown to succeed less often than the best; of these it enters areas least",
        ),
    ],
)
def test_the_words_beneath_the_table_say_what_decided(scores: list[Score], ties: str) -> None:
    assert report.ties_of(result(*scores)) == ties


def test_a_recommended_route_that_fails_more_often_than_not_comes_with_a_caution() -> None:
    bad, fair = result(score(0.02, 30), score(0.01, 20)), result(score(0.5, 30))
    assert bad.recommended
    assert "the recommended route succeeds in 2.0 % of the trials, less than 50 %" in bad.caution
    assert fair.caution == ""
    assert result(score(0.0, 10)).caution == ""


def test_half_goes_on_with_the_reference_and_without_those_that_succeed_half_as_often_as_the_best() -> None:
    # given 30: the reference; ten hopeless that are fast, so that none beats them; ten of the front that are
    # slower the better they are; nine that these beat
    hopeless = [score(0.20 + k / 100, 5 + k) for k in range(10)]
    front = [score(0.70 + k / 100, 30 + k) for k in range(10)]
    beaten = [score(0.50 + k / 100, 50) for k in range(9)]
    scores = [score(0.1, 20), *hopeless, *front, *beaten]
    tried = {candidate(k): each for k, each in enumerate(scores)}
    # when
    kept = numbers(halving._kept(tried, candidate(0)))
    # then 15, the better of those that are beaten among them, and the reference
    assert kept == [0, *range(11, 21), *range(25, 30)]


def test_of_an_odd_number_the_larger_half_goes_on() -> None:
    tried = {candidate(k): score(0.9 - k / 100, 40) for k in range(31)}
    assert numbers(halving._kept(tried, candidate(0))) == list(range(16))


def test_each_round_has_trials_of_its_own() -> None:
    # given a scorer that notes which trials it is asked for
    spans: list[tuple[int, int]] = []

    def run(candidates: list[Candidate], first: int, last: int) -> list[Score]:
        spans.append((first, last))
        return [score(0.9, 40, trials=last - first) for _ in candidates]

    problem: Any = SimpleNamespace(
        asked=SimpleNamespace(trials=900), candidates=[candidate(0)], scorer=SimpleNamespace(run=run)
    )
    # when
    tried = halving.run(problem).tried
    # then none is tried twice, and all count
    assert spans == [(0, 256), (256, 512), (512, 900)]
    assert [each.trials for each in tried.values()] == [900]


def test_those_that_only_the_front_beats_come_next() -> None:
    assert halving._layers([(1.0, 1.0), (2.0, 2.0), (0.5, 3.0), (3.0, 3.0), (2.0, 2.0)]) == [0, 1, 0, 2, 1]
