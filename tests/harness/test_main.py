"""The command line: what a user types, sees, and finds on the disk."""

import json
import sys
from pathlib import Path

import pytest
from tiny_fmu import V, tiny_fmu

from fmus.build import BUILD
from harness import main, trial
from harness.log import read_log

RUN = ["run", "two_waypoint", "--set", "canine.shaking=false"]
DOG = [
    V("command", "input", "Integer"),
    V("north", unit="m"),
    V("east", unit="m"),
    V("heading", unit="rad"),
    V("v", unit="km/h"),
]
# it runs north at 18 km/h = 5 m/s when told to, and south on recall
MOVES = "v[4] = v[0] == 1 ? 18 : v[0] == 3 ? 18 : 0; v[3] = v[0] == 3 ? 3.141592653589793 : 0;"
MOVES += "v[1] += (v[0] == 3 ? -1 : 1) * v[4] / 3.6 * h;"
MAPPING = '[outputs]\nspeed = { name = "v", factor = 0.2777777777777778 }'


def canine(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Exit status, standard output and error of the command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["canine", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            main.main()
    said = capsys.readouterr()
    return int(caught.value.code or 0), said.out, said.err


def test_a_trial_leaves_its_files_and_says_how_it_went(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # when
    status, text, _ = canine(capsys, *RUN, "--seed", 3, "--out", tmp_path / "a", "--json")
    # then
    summary = json.loads(text)
    assert status == 0
    assert (summary["scenario"], summary["seed"]) == ("two_waypoint", 3)
    assert json.loads((tmp_path / "a" / "summary.json").read_text()) == summary
    assert {p.name for p in (tmp_path / "a").iterdir()} == {
        "trial.mcap", "summary.json", "trial.html", "trial.png"
    }  # fmt: skip
    log = read_log(tmp_path / "a" / "trial.mcap")
    assert log.parameter("plant.seed") == 3
    assert log.parameter("plant.shaking") == 0
    assert len(log.time) == summary["ticks"]


def test_a_log_runs_again_to_the_same_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for fmi in ("2", "3"):
        first, second = tmp_path / f"a{fmi}", tmp_path / f"b{fmi}"
        canine(capsys, *RUN, "--fmi", fmi, "--order", "jacobi", "--out", first)
        canine(capsys, "run", first / "trial.mcap", "--out", second)
        assert (first / "trial.mcap").read_bytes() == (second / "trial.mcap").read_bytes()
    # and both versions give the same trial
    two, three = read_log(tmp_path / "a2" / "trial.mcap"), read_log(tmp_path / "a3" / "trial.mcap")
    for name in two.values:
        assert (two.values[name] == three.values[name]).all()


def test_a_dog_made_elsewhere_runs_and_is_logged_by_the_roles_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES, depends=False)
    dog.with_suffix(".toml").write_text(MAPPING)
    scenario = tmp_path / "straight.toml"
    scenario.write_text('system = "cts"\nwaypoints = [[25, 0]]')
    # when
    status, text, notes = canine(capsys, "run", scenario, "--plant", dog, "--out", tmp_path, "--json")
    # then 18 m at 5 m/s to d' = 7 m, the stop, and back again
    assert status == 0
    assert json.loads(text)["outcome"] == "success"
    log = read_log(tmp_path / "trial.mcap")
    assert log["plant.speed"].max() == 5.0
    assert log["plant.north"].max() == pytest.approx(18.0, abs=0.4)
    assert "plant dog.fmu: has no parameter seed, start_north" in notes
    # and again from the log alone
    dog.unlink()
    canine(capsys, "run", tmp_path / "trial.mcap", "--out", tmp_path / "again")
    assert (tmp_path / "again" / "trial.mcap").read_bytes() == (tmp_path / "trial.mcap").read_bytes()


def test_a_fault_ends_with_its_name_status_1_and_the_log_up_to_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a dog whose speed is no number from the step at 1 s on
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES + "if (t > 0.99) v[4] = NAN;", depends=False)
    dog.with_suffix(".toml").write_text(MAPPING)
    (tmp_path / "summary.json").write_text("of an earlier trial")
    # when
    status, text, error = canine(capsys, "run", "two_waypoint", "--plant", dog, "--out", tmp_path)
    # then
    assert (status, text) == (1, "")
    assert error.splitlines()[-1] == (
        'canine: plant dog.fmu: output "v" is nan at t = 1.04 s; expected a finite number'
    )
    assert not (tmp_path / "summary.json").exists()
    log = read_log(tmp_path / "trial.mcap")
    assert log.time[-1] == pytest.approx(1.04)
    assert "is nan at t = 1.04 s" in log.broken


def test_ctrl_c_keeps_the_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a user who has enough after the first batch of rows
    write = trial._Table.write

    def interrupted(self: trial._Table, log: object, times: object, values: object) -> None:
        write(self, log, times, values)  # type: ignore[arg-type]
        raise KeyboardInterrupt

    monkeypatch.setattr(trial._Table, "write", interrupted)
    # when
    status, _, _ = canine(capsys, *RUN, "--out", tmp_path)
    # then
    assert status == 130
    assert len(read_log(tmp_path / "trial.mcap").time) == 25
    assert [p.name for p in tmp_path.iterdir()] == ["trial.mcap"]


@pytest.mark.parametrize(
    ("arguments", "status", "text"),
    [
        (["run", "three"], 2, 'canine: there is no scenario "three"'),
        (["run", "two_waypoint", "--set", "cmec.max_turn=1"], 2, 'did you mean "max_turns"?'),
        (["run", "nowhere.mcap"], 1, "canine: log nowhere.mcap"),
        (["run", "nowhere.ssp"], 2, "canine: nowhere: there is no package"),
        (["run", "--order", "backwards"], 2, "backwards"),
        (["run", "--plant", "nowhere.fmu"], 2, "nowhere.fmu"),
        (["check", __file__], 1, "not a readable ZIP archive"),
        (["fetch"], 2, "fetch"),
    ],
)
def test_errors_are_a_line_and_a_status(
    arguments: list[str], status: int, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    got, out, err = canine(capsys, *arguments)
    assert got == status
    assert text in err
    assert out == ""
    assert "Traceback" not in err


def test_check_says_what_is_wrong_or_that_it_fits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given a dog whose speed is called v, in km/h
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES, depends=False)
    # when, then
    status, _, error = canine(capsys, "check", dog, "--role", "plant")
    assert status == 1
    assert 'canine: plant dog.fmu: has no output "speed" (Real, m/s), which the plant role needs' in error
    dog.with_suffix(".toml").write_text(MAPPING)
    status, text, _ = canine(capsys, "check", dog, "--role", "plant")
    assert status == 0
    assert (
        text == "dog.fmu: FMI 2 co-simulation, 1 inputs, 4 outputs, 0 parameters; runs; fits the plant role\n"
    )


def test_a_package_and_a_controller_from_a_file_give_the_same_trial(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given one trial of our system, of its package alone, and with the FMI 3.0 controller swapped in
    canine(capsys, "run", "--out", tmp_path / "own")
    own = read_log(tmp_path / "own" / "trial.mcap")
    cmec = BUILD / "fmi3" / "cmec.fmu"
    for name, arguments in (("ssp", [BUILD / "full.fmi3.ssp"]), ("swap", ["--controller", cmec])):
        # when
        status, _, error = canine(capsys, "run", *arguments, "--out", tmp_path / name)
        # then
        assert (status, error) == (0, "")
        other = read_log(tmp_path / name / "trial.mcap")
        assert own.metadata["parameters"] == other.metadata["parameters"]
        for component in own.values:
            assert (own.values[component] == other.values[component]).all()


def test_wiring_tells_order_and_delays(capsys: pytest.CaptureFixture[str]) -> None:
    status, text, _ = canine(capsys, "wiring", "--json")
    wiring = json.loads(text)
    delays = {link["link"]: link["ticks"] for link in wiring["links"]}
    assert status == 0
    assert wiring["order"] == ["sensors", "estimator", "controller", "command_module", "plant"]
    assert wiring["step_s"] == 0.04
    assert delays["plant.north -> sensors.north"] == 1
    assert delays["estimator.north -> controller.north"] == 0
    assert delays["controller.command -> plant.command"] == 0


def test_help_shows_examples(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("run", "wiring", "check", "build"):
        status, text, _ = canine(capsys, command, "--help")
        assert status == 0
        assert f"\n  canine {command}" in text
