"""A day that was simulated and logged: `canine fit` finds what the dog was given."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness import open_log
from models.commands import Command
from tests.harness.command import canine

MISSIONS = 5
OPTIONS = ["--missions", MISSIONS, "--rest", 60, "--days", 2, "--reading", "field", "--logs", 1]


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a day with the logs of its missions, and of the fit in it."""
    from harness import main  # noqa: PLC0415

    folder = tmp_path_factory.mktemp("logged")
    assert main.run(["day", "left_90", *map(str, OPTIONS), "--out", str(folder)]) == 0
    day = folder / "cmec-rest60" / "day-1"
    assert main.run(["fit", str(day), "--rest", "60", "--out", str(folder / "fit")]) == 0
    return folder


@pytest.fixture(scope="module")
def found(logged: Path) -> Any:
    return json.loads((logged / "fit" / "fit.json").read_text())["day"]


def test_the_days_are_logged_mission_by_mission(logged: Path) -> None:
    logs = sorted(logged.rglob("trial.mcap"))
    assert [log.parent.name for log in logs] == [f"mission-{k + 1}" for k in range(MISSIONS)]
    # then each begins as tired as the day says, from the second mission on
    starts = [open_log(log)["plant.fatigue"][0] for log in logs]
    assert starts[0] == 0
    assert np.all(np.diff(starts) > 0.02)


def test_the_fit_follows_the_fatigue_of_the_simulated_dog(logged: Path, found: Any) -> None:
    for (fatigue, _), number in zip(found["speeds"], range(1, MISSIONS + 1), strict=True):
        log = open_log(logged / "cmec-rest60" / "day-1" / f"mission-{number}" / "trial.mcap")
        running = np.isin(log["controller.command"], (Command.FORWARD, Command.RECALL))[1:]
        before = log["plant.fatigue"][:-1]
        cruising = running & np.isclose(log["plant.speed"][1:], 4.86 * (1 - 0.5 * before), rtol=1e-9)
        assert fatigue == pytest.approx(before[cruising].mean(), abs=1e-3)


def test_the_fit_finds_what_fatigue_does_to_the_simulated_dog(found: Any) -> None:
    # given shares of 0.5 of the speed, and 0.3 s of each response
    slows, delays = (found["effects"][name] for name in ("fatigue_slows", "fatigue_delays"))
    assert slows["estimate"] == pytest.approx(0.5, abs=1e-3)
    assert slows["rested"] == pytest.approx(4.86, abs=1e-3)
    # a delay ends with a tick, which is a ninth of what fatigue adds here
    assert delays["estimate"] == pytest.approx(0.3, abs=0.1)
    assert slows["verdict"] == delays["verdict"] == "shown"
    assert found["parameters"]["canine.fatigue_slows"] == pytest.approx(slows["estimate"], rel=1e-3)


def test_the_fit_leaves_a_picture_a_page_and_parameters_for_a_day(logged: Path) -> None:
    assert (logged / "fit" / "fit-day.png").is_file()
    assert "fatigue_slows" in (logged / "fit" / "fit.html").read_text()
    lines = (logged / "fit" / "fit.toml").read_text().splitlines()
    assert any(line.startswith('# "canine.fatigue_slows" = 0.') for line in lines)


def test_logs_of_a_longer_day_do_not_stay_among_those_of_a_shorter_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given two logged days of two missions, another rest's, and a file of the user's
    def run(*options: Any) -> str:
        status, _, errors = canine(capsys, "day", "left_90", "--days", 2, "--out", tmp_path, *options)
        assert status == 0
        return errors

    assert "logged missions" not in run("--missions", 2, "--rest", "60,600", "--logs", 2)
    (tmp_path / "cmec-rest60" / "day-2" / "notes.txt").write_text("mine")
    # when one day of one mission with one of these rests is logged there
    errors = run("--missions", 1, "--rest", 60, "--logs", 1)
    # then the folders of that rest hold its log alone, and the others are as they were
    below = tmp_path / "cmec-rest60"
    assert [log.parent.relative_to(below) for log in below.rglob("*.mcap")] == [Path("day-1", "mission-1")]
    assert (below / "day-2" / "notes.txt").read_text() == "mine"
    assert len(list((tmp_path / "cmec-rest600").rglob("*.mcap"))) == 4
    assert "had 4 logged missions of an earlier run, which these replace" in errors
    assert "has 4 logged missions of an earlier run, which stay" in errors
    # and a day without logs tells that those are not its own
    errors = run("--missions", 1, "--rest", 60, "--seed", 5)
    assert "has 5 logged missions of an earlier run, which stay" in errors
    assert len(list(tmp_path.rglob("*.mcap"))) == 5


def test_logs_of_an_earlier_day_go_before_the_results_of_another_one_come(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a logged day
    options = ("day", "left_90", "--days", 2, "--missions", 1, "--logs", 1, "--out", tmp_path)
    assert canine(capsys, *options)[0] == 0
    before = (tmp_path / "day.json").read_bytes()

    # when another one ends as it is about to write its results
    def end(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("harness.day.report.write_set", end)
    with pytest.raises(KeyboardInterrupt):
        canine(capsys, *options, "--seed", 5)
    # then the results are the first one's, and no logs are beside them that could be taken for the other's
    assert (tmp_path / "day.json").read_bytes() == before
    assert not list(tmp_path.rglob("*.mcap"))


def test_a_fit_of_trials_in_no_order_has_no_day(
    logged: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given the results of a day's fit in the same folder
    (tmp_path / "fit-day.png").write_bytes(b"old")
    logs = logged / "cmec-rest60"
    status, _, _ = canine(capsys, "fit", logs, "--out", tmp_path)
    assert status == 0
    assert "day" not in json.loads((tmp_path / "fit.json").read_text())
    assert not (tmp_path / "fit-day.png").exists()
    # and what is taken as given of a day acts in a day alone
    status, _, errors = canine(capsys, "fit", logs, "--set", "canine.fatigue_way=500", "--out", tmp_path)
    assert status == 2
    assert "acts with --rest alone" in errors
