"""The page on controllers and dogs: its numbers, and the committed page."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.trial.scenario import load
from harness.verification import controllers
from harness.verification.controllers import CONTROLLERS, DOGS, PAGE, Led, rate
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


def test_the_page_s_conclusions_are_what_trials_show() -> None:
    # given what each says of two cells, 400 trials of each type
    def of(controller: str, dog: str) -> float:
        return rate(CONTROLLERS[controller], DOGS[dog], 400)

    default, late, streets = "Table 5.1, means", "0.3 s late", "in streets"
    field, mean, learnt = "CMEC, field", "field, mean drift", "field, learnt drift"
    # then turns by waypoint win much, and not in streets
    assert of(field, default) - of("CMEC, calibrated", default) > 0.2
    assert abs(of(field, streets) - of("CMEC, calibrated", streets)) < 0.05
    # and aiming off wins half of the rest in the open; it costs where walls cancel the drift or a dog is late
    assert 1 - of(learnt, default) < 0.5 * (1 - of(field, default))
    assert of(field, streets) - of(mean, streets) > 0.04
    assert abs(of(field, streets) - of(learnt, streets)) < 0.03
    assert of(field, late) > of(learnt, late)
    # a lead that is learnt makes up for both kinds of late dogs, and costs each of the others hardly anything
    lead = "field, learnt drift and lead"
    assert of(lead, late) > of(field, late) + 0.12
    assert of(lead, "tired") > of(learnt, "tired") + 0.05
    for dog in DOGS.keys() - {late, "tired"}:
        assert abs(of(lead, dog) - of(learnt, dog)) < 0.01, dog
    # and a tired dog that answers at once is led nearly as well by a controller that aims off as a rested one
    tired = DOGS["tired"]
    awake = Led((*tired.settings, "canine_all_day.fatigue_delays=0"), plant=tired.plant)
    assert rate(CONTROLLERS[learnt], awake, 400) - of(learnt, "tired") > 0.05


def test_a_heading_that_is_off_is_off_all_the_time() -> None:
    offset, noise = controllers.with_bias(load("right_90")).faults
    assert (offset.kind, offset.value, offset.at, offset.until) == ("offset", 5.0, 0.0, None)
    assert (noise.kind, noise.value, noise.until) == ("noise", 3.0, None)
