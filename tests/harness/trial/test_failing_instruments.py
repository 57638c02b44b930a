"""Trials whose instruments fail: rules 5 and 6 of SAFETY.md in the co-simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from harness import Scenario, run_trial
from harness.log.log import Log
from models.commands import Command
from models.given_heading import GivenHeading
from models.system import ESTIMATORS

GIVEN = [name for name, block in ESTIMATORS.items() if issubclass(block, GivenHeading)]


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes longer than the trials."""
    monkeypatch.setattr("harness.trial.trial.trial_png", lambda log: b"")


def far(name: str, parameters: dict[str, Any]) -> Scenario:
    """A leg of a minute."""
    return Scenario(name, waypoints=((150.0, 0.0),), reading="guarded", duration=60.0, parameters=parameters)


def led(log: Log) -> npt.NDArray[np.bool_]:
    """The ticks on which the animal gets a cue that leads it, (ticks,)."""
    return np.isin(log["controller.command"], [Command.NONE, Command.STOP], invert=True)


@pytest.mark.parametrize("estimator", GIVEN)
@pytest.mark.parametrize("error", [60.0, 180.0])
def test_rule_6_a_dog_is_not_led_on_by_a_heading_that_its_courses_contradict(
    tmp_path: Path, estimator: str, error: float
) -> None:
    # given a heading that is wrong by the mounting, and a controller that sends the dog on all the same
    scenario = far("mounted", {"sensors.heading_error": error})
    trial = run_trial(scenario, estimator=estimator, out=tmp_path, parameters={"cmec.moving_deviation": 180})
    # then it is stopped after it has moved for a few seconds, for good, and the log tells why
    log = trial.log
    doubted = (log["estimator.heading_ok"] == 0) | (
        log["estimator.heading_sd"] > 1.0
    )  # the tracker's own doubt
    (first, *_) = np.flatnonzero(doubted & (log.time > 1.0))
    assert 1.0 <= (log["plant.speed"][:first] > 1.0).sum() * 0.04 <= 6.0
    assert not led(log)[first:].any()
    assert not log["estimator.valid"][first:].any()
    if estimator != "canine_tracker":
        assert trial.anomalies["CONTRADICTED_HEADING"] == 1


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_rule_6_a_dog_is_stopped_while_its_inertial_unit_repeats_itself(
    tmp_path: Path, estimator: str
) -> None:
    # given a unit that is frozen from 6 s to 9 s of a trial
    frozen = {"sensors.frozen_start": 6.0, "sensors.frozen_time": 3.0}
    wide = {
        f"{estimator}.max_{what}_sd": 1e6 for what in ("speed", "position")
    }  # Table C.1's tuning needs it
    scenario = far("frozen", frozen | wide)
    log = run_trial(scenario, estimator=estimator, out=tmp_path).log
    # then from 0.4 s on nothing leads the dog, until the unit lives
    silent = (log.time > 6.45) & (log.time < 8.98)
    assert not led(log)[silent].any()
    assert not log["estimator.valid"][silent].any()
    assert led(log)[log.time < 6.4].any()
    assert log["estimator.valid"][(log.time > 9.1) & (log.time < 9.5)].all()


def test_rule_6_a_set_without_noise_is_led_in_the_readings_of_the_text(tmp_path: Path) -> None:
    noiseless = {"sensors.noisy": False, "plant.shaking": False}
    scenario = Scenario("noiseless", waypoints=((25.0, 0.0),), parameters=noiseless)
    assert run_trial(scenario, out=tmp_path).outcome == "success"


def test_rule_5_rejected_fixes_jumps_and_recoveries_are_in_the_summary(tmp_path: Path) -> None:
    # given reflected signals that put fixes 300 m off
    reflected = {"sensors.multipath": 300.0, "sensors.multipath_rate": 0.2, "sensors.multipath_time": 8.0}
    scenario = far("reflected", reflected)
    trial = run_trial(scenario, out=tmp_path)
    log = trial.log
    assert trial.anomalies["REJECTED_FIX"] == log["estimator.rejected_fixes"][-1] > 10
    assert trial.anomalies["RECOVERY"] == log["estimator.recoveries"][-1] > 0
