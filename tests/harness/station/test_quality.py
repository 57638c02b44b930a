"""What is told of the link, from counts and clocks of its two ends alone."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from codegen.firmware.telemetry import FIELDS, Telemetry
from harness.station.quality import REMEMBERED, Quality

FIRST = replace(Telemetry(*[0] * len(FIELDS)), session=5, time_ms=1000)


@pytest.fixture
def link() -> Any:
    """A laptop's end, of which only the counts are looked at."""
    decoder = SimpleNamespace(errors=3, forged=20)
    return SimpleNamespace(decoder=decoder, counter=0, lost=7, replayed=300, unanswered=11, sessions=2)


@pytest.fixture
def quality(link: Any) -> Quality:
    return Quality(link)


def send(quality: Quality, link: Any, now: float, counter: int) -> None:
    link.counter = counter
    quality.send(now)


def test_before_the_first_telemetry_age_and_round_trip_are_not_known(quality: Quality) -> None:
    told = quality.at(12.0)
    assert (told.age_s, told.round_trip_s, quality.age(12.0)) == (None, None, None)
    assert (told.lost, told.late, told.errors, told.forged, told.replayed) == (7, 0, 3, 20, 300)
    assert (told.unanswered, told.sessions) == (11, 2)


def test_the_counts_of_both_ends_are_added(quality: Quality) -> None:
    quality.receive(1.0, replace(FIRST, link_errors=4, link_forged=50, link_replayed=600))
    told = quality.at(3.5)
    assert (told.errors, told.forged, told.replayed, told.age_s) == (7, 70, 900, 2.5)


@pytest.mark.parametrize(
    ("took", "vest_ms", "late"),
    [
        (0.5, 200, 0),  # 0.3 s more than the vest's clock says are allowed
        (0.5078125, 200, 1),
        (1.5, 1200, 0),  # a telemetry that was lost between them makes none late
        (1.5078125, 1200, 1),
    ],
)
def test_telemetry_is_late_by_the_clock_of_the_vest(
    quality: Quality, took: float, vest_ms: int, late: int
) -> None:
    quality.receive(0.0, FIRST)
    quality.receive(took, replace(FIRST, time_ms=FIRST.time_ms + vest_ms))
    assert quality.at(took).late == late


def test_what_comes_of_another_session_is_not_late(quality: Quality) -> None:
    quality.receive(0.0, FIRST)
    quality.receive(60.0, replace(FIRST, session=6, time_ms=0))
    assert quality.at(60.0).late == 0


def test_a_round_trip_is_from_a_frame_to_the_first_telemetry_that_names_it(
    quality: Quality, link: Any
) -> None:
    quality.receive(0.0, FIRST)
    send(quality, link, 1.0, 256)
    send(quality, link, 1.5, 257)
    quality.receive(2.0, replace(FIRST, received=256))
    assert quality.at(2.0).round_trip_s == 1.0
    quality.receive(9.0, replace(FIRST, received=256))  # the same answer, told again
    assert quality.at(9.0).round_trip_s == 1.0
    quality.receive(9.5, replace(FIRST, received=257))
    assert quality.at(9.5).round_trip_s == 8.0
    quality.receive(9.75, replace(FIRST, received=999))  # of nothing that was sent
    assert quality.at(9.75).round_trip_s == 8.0


def test_counters_of_an_earlier_session_measure_nothing(quality: Quality, link: Any) -> None:
    quality.receive(0.0, FIRST)
    send(quality, link, 1.0, 256)
    quality.receive(2.0, replace(FIRST, session=6))
    quality.receive(3.0, replace(FIRST, session=6, received=256))
    assert quality.at(3.0).round_trip_s is None


def test_the_newest_frames_are_remembered(quality: Quality, link: Any) -> None:
    quality.receive(0.0, FIRST)
    for counter in range(1, REMEMBERED + 2):
        send(quality, link, 1.0, counter)
    quality.receive(2.0, replace(FIRST, received=1))  # one more than are remembered
    assert quality.at(2.0).round_trip_s is None
    quality.receive(3.0, replace(FIRST, received=2))
    assert quality.at(3.0).round_trip_s == 2.0
