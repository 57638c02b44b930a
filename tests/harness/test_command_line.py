"""The commands beside trials, sweeps, replays and logs: lists, the C of a block, the version."""

import json
import tomllib
from pathlib import Path

import pytest

from codegen.blocks.block_c import generate
from fmus.folder import build_folder
from harness.log.log import read_log
from harness.trial.scenario import load, shipped
from models.cmec import Cmec
from tests.harness.command import canine

RUN = ["run", "two_waypoint", "--set", "canine.shaking=false"]


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert canine(capsys, "--version") == (0, f"canine {project['version']}\n", "")


def test_scenarios_are_listed_by_name_with_what_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    # when
    status, text, _ = canine(capsys, "scenarios")
    entries = json.loads(canine(capsys, "scenarios", "--json")[1])
    # then
    assert status == 0
    assert [entry["name"] for entry in entries] == shipped()
    assert [line.split()[0] for line in text.splitlines()[1:] if line[0] != " "] == ["scenario", *shipped()]
    (two,) = [entry for entry in entries if entry["name"] == "two_waypoint"]
    assert two == {
        "name": "two_waypoint", "system": "full", "waypoints": [[25.0, 0.0]],
        "duration_s": load("two_waypoint").duration,
        "about": "Two waypoints: the start, and a point 25 m north of it (5.3.3)",
    }  # fmt: skip
    (distance,) = [entry for entry in entries if entry["name"] == "distance_100"]
    assert distance["about"] == "Two waypoints 100 m apart, to see what distance does (5.3.5, Figure 5.4)"


def test_a_default_folder_names_the_trial_that_is_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a trial in the default folder, run again
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert canine(capsys, *RUN)[2] == ""
    # when others take its place, then what differs is named
    begin = "note: out/two_waypoint-1: has another trial, which this replaces"
    _, _, error = canine(capsys, *RUN, "--set", "cmec.moving_deviation=37")
    assert error == f"{begin} (parameters.cmec.moving_deviation: none, now 37)\n"
    _, _, error = canine(capsys, *RUN, "--order", "jacobi")
    assert error == (
        f"{begin} (parameters.cmec.moving_deviation: 37, now none, run.order: sequential, now jacobi)\n"
    )
    # and so is a log that was cut before its first tick; a folder of one's own is one's own matter
    Path("out/two_waypoint-1/trial.mcap").write_bytes(b"cut")
    _, _, error = canine(capsys, *RUN)
    assert error == "note: out/two_waypoint-1: has a log that cannot be read, which this replaces\n"
    assert canine(capsys, *RUN, "--order", "jacobi", "--out", "out/two_waypoint-1")[2] == ""


def test_a_replay_names_the_replay_that_it_replaces(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a replay in the default folder, made twice
    monkeypatch.chdir(tmp_path)
    canine(capsys, "run", "three_waypoint")
    replay = ("replay", "out/three_waypoint-1/trial.mcap", "--every", 10)
    for _ in range(2):
        assert canine(capsys, *replay, "--outage", 5)[2] == ""
    # when another takes its place, then what differs is named
    _, _, error = canine(capsys, *replay, "--outage", 4)
    begin = "note: out/replay-three_waypoint-1: has another replay, which this replaces"
    assert error == f"{begin} (outage_s: 5.0, now 4.0)\n"
    _, _, error = canine(capsys, *replay, "--outage", 4, "--attitude", "own")
    assert error == f"{begin} (attitude: recorded, now own)\n"


def test_an_attitude_that_a_replay_does_not_know_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, error = canine(capsys, "replay", tmp_path, "--attitude", "xsens")
    assert (status, error) == (2, "canine: the attitude is 'xsens', expected own or recorded\n")


def test_trials_with_seeds_name_the_trials_that_they_replace(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):
        assert canine(capsys, *RUN, "--seeds", "1:2", "--out", tmp_path)[2] == ""
    _, _, error = canine(capsys, *RUN, "--set", "cmec.dead_time=2", "--seeds", "1:2", "--out", tmp_path)
    begin = f"note: {tmp_path}/1: has another trial, which this replaces"
    assert error == f"{begin} (parameters.cmec.dead_time: none, now 2)\n"


def test_the_c_of_a_block_is_what_the_generator_gives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    # when
    status, text, _ = canine(capsys, "c", "cmec", "--precision", "float")
    canine(capsys, "c", "controller", "--out", "double")
    # then
    assert (status, text) == (0, "out/c/cmec.h\nout/c/cmec.c\n")
    assert {p.name: p.read_text() for p in Path("out/c").iterdir()} == generate(Cmec, "float")
    assert {p.name: p.read_text() for p in Path("double").iterdir()} == generate(Cmec, "double")


def test_a_block_without_float_arithmetic_is_refused_in_float(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, errors = canine(capsys, "c", "canine", "--precision", "float")
    assert (status, errors) == (2, "canine: --precision float: canine comes in double only\n")


def test_an_estimator_from_a_file_takes_the_place_of_ours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given our own estimator's FMI 3.0 FMU
    fmu = build_folder() / "fmi3" / "four_state.fmu"
    canine(capsys, *RUN, "--out", tmp_path / "own")
    # when
    status, _, errors = canine(capsys, *RUN, "--estimator", fmu, "--out", tmp_path / "swapped")
    # then
    own, swapped = (read_log(tmp_path / name / "trial.mcap") for name in ("own", "swapped"))
    assert (status, errors) == (0, "")
    assert swapped.metadata["swaps"] == {"estimator": "estimator.fmu"}
    assert (own["estimator.north_sd"] == swapped["estimator.north_sd"]).all()
    assert canine(capsys, "wiring", "--estimator", fmu) == canine(capsys, "wiring")


def test_an_estimator_does_not_fit_a_system_without_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = tmp_path / "true.toml"
    scenario.write_text('system = "cts"\nwaypoints = [[25, 0]]')
    fmu = build_folder() / "fmi3" / "four_state.fmu"
    status, _, errors = canine(capsys, "run", scenario, "--estimator", fmu, "--out", tmp_path / "out")
    assert status == 2
    assert 'canine: system "cts" has no component "estimator"; known: ' in errors
    assert not (tmp_path / "out").exists()


def test_help_of_each_command_shows_how_to_call_it(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("export", "compare", "recover", "parameters", "c"):
        status, text, _ = canine(capsys, command, "--help")
        assert status == 0
        assert f"\n  canine {command} " in text


def test_a_folder_or_a_file_that_a_command_does_not_take_names_what_it_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given the folder of a trial
    canine(capsys, *RUN, "--out", tmp_path)
    log = tmp_path / "trial.mcap"
    # then commands that take its log say so
    for command in (("check", tmp_path), ("export", tmp_path, "--to", "csv")):
        status, _, error = canine(capsys, *command)
        assert status != 0
        assert str(log) in error, command
    # and so do those that take no log and no scenario
    (tmp_path / "mine.toml").write_text("")
    for name, taken in (("trial.mcap", "canine replay` takes logs"), ("mine.toml", "canine run` takes")):
        status, _, error = canine(capsys, "check", tmp_path / name)
        assert status == 2
        assert taken in error


@pytest.mark.parametrize("command", [("replay",), ("check",), ("run", "--plant")])
def test_a_name_too_long_for_a_file_is_refused(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, error = canine(capsys, *command, "x" * 300)
    assert status == 2
    assert 'there is no "xxx' in error or 'there is no plant "xxx' in error
