"""The page on habituation: what the field's counts say, and the committed page."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from harness.routes.problem import HABITUATION
from harness.verification import __main__ as command
from harness.verification import habituation
from harness.verification.habituation import OPEN, PAGE, Allowed
from harness.verification.page import RESULTS
from harness.verification.runs import Size
from models.day import BOUNDS


def test_the_counts_are_those_of_the_open_field() -> None:
    assert [(f.waypoints, f.threshold, f.successes, f.trials) for f in OPEN] == [
        ("two", 23, 33, 35), ("two", 30, 34, 35), ("two", 37, 35, 35), ("three", 37, 27, 35)
    ]  # fmt: skip


def test_likeliest_gain_interval_and_bound_are_those_of_the_likelihood_ratio() -> None:
    # given rates that fall with the gain as a line, and the log-likelihood of the counts by hand
    gains = np.linspace(0, 0.6, 13)
    fine = np.linspace(0, 0.6, 60_001)

    def rates(gain: np.ndarray) -> np.ndarray:
        return np.column_stack([0.99 - 0.1 * gain] * 3 + [0.9 - gain])

    counts, trials = [33, 34, 35, 27], [35] * 4
    logs = binom.logpmf(counts, trials, rates(fine)).sum(axis=1)
    ratio = 2 * (logs.max() - logs)
    # when
    found = Allowed(gains, rates(gains))
    # then; 3.841 and 2.706 are the 95 and 90 % points of chi-square with one degree of freedom
    inside = fine[ratio <= 3.841]
    assert found.likeliest == pytest.approx(fine[logs.argmax()], abs=2e-3)
    assert found.interval == pytest.approx((inside[0], inside[-1]), abs=3e-3)
    assert found.bound == pytest.approx(fine[ratio <= 2.706][-1], abs=3e-3)
    assert found.interval[0] < found.likeliest < found.bound < found.interval[1]


def test_the_committed_page_has_what_a_run_gives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given a page of a single dog, two gains at the field's counts, and a single distance
    monkeypatch.setattr(habituation, "DOGS", {"default": ()})
    monkeypatch.setattr(habituation, "GAINS", "0.2:0.4:0.2")
    monkeypatch.setattr(habituation, "PARTS", (4,))
    # when
    habituation.write(tmp_path, Size())
    # then its rows are those of the whole page
    page, committed = (tmp_path / PAGE).read_text(), (RESULTS / PAGE).read_text()
    begins = ("| the field", "| default | 0.2 | 9", "| default | 0.4 | 9", "| 50 m")
    rows = [line for line in page.splitlines() if line.startswith(begins)]
    assert len(rows) == len(begins)
    assert set(rows) <= set(committed.splitlines())
    # and so is what is not made of numbers
    for begin, end in (
        ("# Habituation", "| dog"),
        ("So there is", "| way"),
        ("**A dog that", "!"),
    ):
        said, stands = (text[text.index(begin) :].partition(end)[0] for text in (page, committed))
        assert said == stands


def test_what_is_called_unlikely_is_what_the_page_says() -> None:
    # given the page's bounds, of the default dog and of the one with drawn speeds
    page = (RESULTS / PAGE).read_text()
    bounds = [float(bound) for bound in re.findall(r"\| .* to .* \| ([\d.]+) \|", page)]
    assert len(bounds) == 2
    # then `canine day` warns from the larger one on
    assert BOUNDS["habituation_gain"].most == pytest.approx(max(bounds), abs=0.01)


def test_the_best_distances_are_those_that_a_plan_states() -> None:
    # given the page's tables of the straight way: distances, and the rates at each gain
    tables = [
        np.array(
            [[float(cell.split()[0]) for cell in row.strip("| ").split(" | ")] for row in table.splitlines()]
        )
        for table in re.findall(r"(?:^\| [\d.]+ m \|.*\n)+", (RESULTS / PAGE).read_text(), re.MULTILINE)
    ]
    assert len(tables) == len(habituation.DOGS)
    for distances, *rates in (table.T for table in tables):
        # then the nearest is best for a dog that does not habituate, and for the others what a plan says
        none, *others = (distances[column.argmax()] for column in rates)
        assert none == distances.min()
        for best, (least, most) in zip(others, ((40, 50), (50, 67), (50, 67)), strict=True):
            assert least <= best <= most
            assert f"every {least} to {most} m" in HABITUATION


def test_a_page_is_made_by_its_name_and_its_verdict_is_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made: list[str] = []
    pages = {"streets": lambda: made.append("streets"), "habituation": lambda: "the likeliest gain"}
    monkeypatch.setattr(command, "PAGES", pages)
    assert command.main(["habituation"]) == 0
    assert capsys.readouterr().out == "the likeliest gain\n"
    assert made == []
    assert command.main([]) == 0
    assert made == ["streets"]
    assert command.main(["street"]) == 2
    assert 'there is no page "street"; expected one of streets, habituation' in capsys.readouterr().err
