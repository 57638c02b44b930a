"""The words for what a controller tells."""

from __future__ import annotations

import pytest

from harness.log.events import ENDS_A_TRIAL, cause_of_stop, in_words
from models.commands import Command, Status
from models.modes import Anomaly


def test_every_status_and_anomaly_has_words_of_its_own() -> None:
    told = [in_words("status", status) for status in Status]
    told += [in_words("anomaly", anomaly) for anomaly in Anomaly if anomaly]
    assert len(set(told)) == len(told) == len(Status) + len(Anomaly) - 1
    assert not any(anomaly.name in text for text in told for anomaly in Anomaly)


def test_what_only_returns_to_none_has_no_words() -> None:
    assert [in_words("anomaly", Anomaly.NONE), in_words("waypoint", 0)] == ["", ""]
    assert in_words("command", Command.NONE) == "command NONE"


@pytest.mark.parametrize(
    ("output", "words"),
    [("status", "the status of the trial is 9"), ("command", "command 9"), ("anomaly", "anomaly 99")],
)
def test_a_number_without_a_name_is_told_as_it_is(output: str, words: str) -> None:
    assert in_words(output, float(words.rpartition(" ")[2])) == words


def test_what_ends_no_trial_came_by_chance_with_the_operators_stop() -> None:
    by_operator = {anomaly for anomaly in Anomaly if cause_of_stop(anomaly) == "the operator"}
    assert by_operator == set(Anomaly) - ENDS_A_TRIAL
    assert {Anomaly.LOST_LINK, Anomaly.BUDGET_SPENT, Anomaly.OUTSIDE_FENCE} <= ENDS_A_TRIAL
    assert {Anomaly.INVALID_ESTIMATE, Anomaly.TRIAL_FAILURE}.isdisjoint(ENDS_A_TRIAL)
    assert cause_of_stop(99) == "anomaly 99"
