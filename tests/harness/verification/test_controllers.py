"""The page on controllers and dogs: its numbers, and the committed page."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.trial.scenario import load
from harness.verification import controllers
from harness.verification.controllers import CONTROLLERS, DOGS, PAGE, rate
from harness.verification.page import RESULTS
from harness.verification.runs import Size


def test_the_committed_page_has_what_a_run_gives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given a page of a single dog
    chosen = "in streets"
    monkeypatch.setattr(controllers, "DOGS", {chosen: DOGS[chosen]})
    # when
    controllers.write(tmp_path, Size())
    # then its row is that of the whole page, and so is what is not made of numbers
    page, committed = (tmp_path / PAGE).read_text(), (RESULTS / PAGE).read_text()
    (row,) = [line for line in page.splitlines() if line.startswith(f"| {chosen}")]
    assert row in committed.splitlines()
    assert page.split("The controllers:")[1] == committed.split("The controllers:")[1]


def test_each_dog_differs_from_the_default_one() -> None:
    cmec = CONTROLLERS["CMEC, field"]
    default, *others = (rate(cmec, led, 400) for led in DOGS.values())
    assert all(rate != default for rate in others)


def test_a_heading_that_is_off_is_off_all_the_time() -> None:
    offset, noise = controllers.with_bias(load("right_90")).faults
    assert (offset.kind, offset.value, offset.at, offset.until) == ("offset", 5.0, 0.0, None)
    assert (noise.kind, noise.value, noise.until) == ("noise", 3.0, None)
