"""`canine run --seeds`: a folder and a row for each trial, whatever ends the command."""

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from harness.trial import instances, trial
from harness.trial.seeds import csv_of, parse_seeds
from models.errors import UsageError
from tests.harness.command import canine
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

RUN = ["run", "two_waypoint", "--set", "canine.shaking=false"]
# it runs north at 5 m/s on FORWARD and back on RECALL
DOG = [V("command", "input", "Integer"), *(V(n, unit=u) for n, u in (("north", "m"), ("east", "m")))]
DOG += [V("heading", unit="rad"), V("speed", unit="m/s"), V("seed", "parameter", start="0")]
MOVES = "v[4] = v[0] == 1 || v[0] == 3 ? 5 : 0; v[3] = v[0] == 3 ? 3.141592653589793 : 0;"
MOVES += "v[1] += (v[0] == 3 ? -1 : 1) * v[4] * h;"


def seeds_in(table: Path) -> list[str]:
    return [row["seed"] for row in csv.DictReader(table.open())]


def test_each_seed_gets_the_trial_that_it_gets_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # when
    status, text, _ = canine(capsys, *RUN, "--seeds", "3:5", "--out", tmp_path / "seeds", "--json")
    canine(capsys, *RUN, "--seed", 4, "--out", tmp_path / "alone")
    # then
    assert status == 0
    assert [summary["seed"] for summary in json.loads(text)] == [3, 4, 5]
    alone, among = tmp_path / "alone", tmp_path / "seeds" / "4"
    assert (among / "trial.mcap").read_bytes() == (alone / "trial.mcap").read_bytes()
    assert {p.name for p in among.iterdir()} == {p.name for p in alone.iterdir()}
    assert seeds_in(tmp_path / "seeds" / "seeds.csv") == ["3", "4", "5"]


def test_the_table_is_printed_and_lies_by_default_beside_the_trials(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    status, text, _ = canine(capsys, *RUN, "--seeds", "7:8")
    lines = text.splitlines()
    assert status == 0
    assert " ".join(lines[0].split()) == "seed outcome time [s] waypoints commands position error [m]"
    assert [line.split()[0] for line in lines[1:3]] == ["7", "8"]
    assert lines[3].endswith("of 2 trials succeeded (100%)")
    assert lines[4] == "out/two_waypoint-seeds/: seeds.csv, and a folder for each seed"
    assert {p.name for p in (tmp_path / "out" / "two_waypoint-seeds").iterdir()} == {"7", "8", "seeds.csv"}


def test_a_row_has_no_position_error_without_an_estimator() -> None:
    summary = {
        "seed": 9, "outcome": "timeout", "time_s": 1.5, "waypoints_reached": 0, "directional_commands": 2,
        "position_error_m": None,
    }  # fmt: skip
    assert csv_of([summary]).decode().splitlines()[1] == "9,timeout,1.5,0,2,,,"


def test_ctrl_c_leaves_whole_trials_and_their_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a user who has enough in the third trial, when a part of its log is written
    whole = trial.run

    def interrupted(request: Any, ready: Any, out: Path, *more: Any) -> dict[str, Any]:
        if request.scenario.seed < 3:
            return whole(request, ready, out, *more)
        out.mkdir()
        (out / "trial.mcap").write_bytes(b"a part")
        raise KeyboardInterrupt

    monkeypatch.setattr(trial, "run", interrupted)
    # when
    status, _, errors = canine(capsys, *RUN, "--seeds", "1:9", "--out", tmp_path)
    # then
    assert status == 130
    assert errors == f"canine: ended by Ctrl-C; 2 of 9 trials are done: {tmp_path}/seeds.csv\n"
    assert {p.name for p in tmp_path.iterdir()} == {"1", "2", "seeds.csv"}
    assert seeds_in(tmp_path / "seeds.csv") == ["1", "2"]


def test_ctrl_c_before_the_new_log_is_opened_keeps_an_earlier_runs_trial(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a trial of an earlier run, and a user who has enough while FMUs are loaded
    earlier = {"trial.mcap", "summary.json", "trial.html", "trial.png"}
    (tmp_path / "1").mkdir()
    for name in earlier:
        (tmp_path / "1" / name).write_text("of an earlier run")

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(instances, "Simulation", interrupted)
    # when
    status, _, _ = canine(capsys, *RUN, "--seeds", "1:9", "--out", tmp_path)
    alone, _, errors = canine(capsys, *RUN, "--seed", 1, "--out", tmp_path / "1")
    # then
    assert (status, alone) == (130, 130)
    assert {p.name for p in (tmp_path / "1").iterdir()} == earlier
    assert errors == "canine: ended by Ctrl-C; nothing was logged\n"


def test_two_runs_with_seeds_do_not_write_into_one_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a folder into which another run writes, with its table
    (tmp_path / "seeds.csv").write_text("of the other run")
    with trial.alone_in(tmp_path):
        status, _, errors = canine(capsys, *RUN, "--seeds", "1:9", "--out", tmp_path)
    # then
    assert status == 2
    assert f"{tmp_path}: another trial is being written there" in errors
    assert [p.name for p in tmp_path.iterdir()] == ["seeds.csv"]


def test_a_fault_ends_the_trials_with_its_name_and_keeps_its_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a dog whose speed is not a number in the trial with seed 2, and a table of an earlier run
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES + "if (v[5] == 2 && t > 0.99) v[4] = NAN;", depends=False)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "seeds.csv").write_text("of an earlier run")
    # when
    status, _, errors = canine(
        capsys, "run", "two_waypoint", "--plant", dog, "--seeds", "1:9", "--out", tmp_path / "out"
    )
    # then
    assert status == 1
    assert 'canine: plant dog.fmu: output "speed" is nan at t = 1.04 s' in errors
    assert errors.count("has no parameter") == 1  # the note, once for all trials
    assert seeds_in(tmp_path / "out" / "seeds.csv") == ["1", "2"]
    written = {"trial.mcap", "summary.json", "trial.html", "trial.png"}
    assert {p.name for p in (tmp_path / "out" / "2").iterdir()} == written
    summary = json.loads((tmp_path / "out" / "2" / "summary.json").read_text())
    assert (summary["outcome"], summary["time_s"], summary["fault"]["kind"]) == (
        "stopped",
        1.04,
        "not finite",
    )
    assert 'output "speed" is nan' in summary["stopped_by"]
    assert not (tmp_path / "out" / "3").exists()


@pytest.mark.parametrize("text", ["5", "5:", ":5", "2:1", "a:b", "-1:2", "1:2147483648", "1:2:3", "1.0:2"])
def test_seeds_without_a_first_and_a_last_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match=f"--seeds {text}: expected a:b, the first and the last seed"):
        parse_seeds(text)


def test_a_range_of_seeds_has_both_its_ends() -> None:
    assert list(parse_seeds("0:2")) == [0, 1, 2]
    assert list(parse_seeds("2147483647:2147483647")) == [2147483647]


def test_one_seed_and_a_range_of_seeds_exclude_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, errors = canine(capsys, *RUN, "--seed", 1, "--seeds", "1:2")
    assert (status, errors) == (2, "canine: --seed 1 and --seeds 1:2: expected one of both\n")
