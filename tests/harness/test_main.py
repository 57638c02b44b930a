"""The command line: what a user types, sees, and finds on the disk."""

import json
import zipfile
from pathlib import Path

import pytest

from fmus.folder import build_folder
from harness.log.log import read_log
from harness.log.writer import LogWriter
from harness.trial import trial
from tests.harness.command import canine
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

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


def test_a_fault_ends_with_its_name_status_1_and_all_files_up_to_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a dog whose speed is not a number from the step at 1 s on
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES + "if (t > 0.99) v[4] = NAN;", depends=False)
    dog.with_suffix(".toml").write_text(MAPPING)
    (tmp_path / "summary.json").write_text("of an earlier trial")
    # when
    status, text, error = canine(capsys, "run", "two_waypoint", "--plant", dog, "--out", tmp_path)
    # then the table, the last line and the summary say so
    words = 'plant dog.fmu: output "v" is nan at t = 1.04 s; expected a finite number'
    assert status == 1
    assert f"ended by              {words}" in text
    assert error.splitlines()[-1] == f"canine: {words}"
    assert json.loads((tmp_path / "summary.json").read_text())["fault"]["text"] == words
    log = read_log(tmp_path / "trial.mcap")
    assert log.time[-1] == pytest.approx(1.04)
    assert "is nan at t = 1.04 s" in log.broken


def test_ctrl_c_keeps_the_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a user who has enough after the first batch of rows
    write = LogWriter.write_rows

    def interrupted(self: LogWriter, times: object, rows: object) -> None:
        write(self, times, rows)  # type: ignore[arg-type]
        raise KeyboardInterrupt

    monkeypatch.setattr(LogWriter, "write_rows", interrupted)
    # when
    status, _, errors = canine(capsys, *RUN, "--out", tmp_path)
    # then
    assert status == 130
    assert "ended by Ctrl-C; the log up to there is" in errors
    assert len(read_log(tmp_path / "trial.mcap").time) == 25
    assert [p.name for p in tmp_path.iterdir()] == ["trial.mcap"]


@pytest.mark.parametrize(
    ("arguments", "status", "text"),
    [
        (["run", "three"], 2, 'canine: there is no scenario "three"'),
        (["run", "two_waypoint", "--set", "cmec.max_turn=1"], 2, 'did you mean "max_turns"?'),
        (["run", "nowhere.mcap"], 2, 'canine: there is no log "nowhere.mcap"'),
        (["run", "nowhere.toml"], 2, 'canine: there is no file "nowhere.toml"'),
        (["check", __file__, "--role", "plnat"], 2, 'there is no role "plnat"; did you mean "plant"?'),
        (["build", "--platform", "foo"], 2, 'canine: platform "foo" is not known'),
        (["run", "nowhere.ssp"], 2, 'canine: there is no package "nowhere.ssp"'),
        (["run", "--order", "backwards"], 2, "backwards"),
        (["run", "--plant", "nowhere.fmu"], 2, 'canine: there is no FMU "nowhere.fmu"'),
        (
            ["run", "--plant", "canin"],
            2,
            'there is no plant "canin"; expected the path of an FMU, or the name of',
        ),
        (["run", "--controller", "quarter"], 2, 'did you mean "quarter_turn"?'),
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
    counts = "1 input, 4 outputs, 0 parameters; any step: every tick of 0.04 s"
    assert text == f"dog.fmu: FMI 2 co-simulation, {counts}; runs, resets; fits the plant role\n"


def test_a_package_and_a_controller_from_a_file_give_the_same_trial(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given one trial of our system, of its package alone, and with the FMI 3.0 controller swapped in
    canine(capsys, "run", "--out", tmp_path / "own")
    own = read_log(tmp_path / "own" / "trial.mcap")
    cmec = build_folder() / "fmi3" / "cmec.fmu"
    for name, arguments in (("ssp", [build_folder() / "full.fmi3.ssp"]), ("swap", ["--controller", cmec])):
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


def test_a_log_runs_again_beside_its_folder_and_is_never_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a trial where it lies by default
    monkeypatch.chdir(tmp_path)
    canine(capsys, *RUN)
    log = tmp_path / "out" / "two_waypoint-1" / "trial.mcap"
    content = log.read_bytes()
    # when it is run again, and then into its own folder
    status, text, _ = canine(capsys, "run", "out/two_waypoint-1/trial.mcap")
    refused, _, error = canine(capsys, "run", log, "--out", log.parent / ".." / "two_waypoint-1", "--seed", 2)
    # then
    assert status == 0
    assert "out/two_waypoint-1-again/: " in text
    assert (tmp_path / "out" / "two_waypoint-1-again" / "trial.mcap").read_bytes() == content
    assert refused == 2
    assert "holds the log that is read" in error
    assert log.read_bytes() == content
    assert (log.parent / "summary.json").exists()


def test_a_controller_with_names_of_its_own_is_started_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a controller that ends the trial 1 s after go, unless it is told otherwise, and waypoints in km
    outputs = [V("command", type="Integer"), V("status", type="Integer")]
    inputs = [V("go", "input", "Boolean", start="false"), V("order", "input", "Integer")]
    variables = [*outputs, *inputs, V("w", "parameter", start="0"), V("seen")]
    step = "v[0] = 1; v[5] = v[4]; if (v[2] != 0 && t >= 0.99) v[1] = v[3] == 2 ? 4 : 2;"
    ctl = tiny_fmu(tmp_path / "ctl.fmu", variables, step)
    ctl.with_suffix(".toml").write_text(
        '[inputs]\nstart = "go"\noverride = "order"\n'
        '[parameters]\n"waypoint_north[1]" = { name = "w", factor = 0.001 }'
    )
    scenario = tmp_path / "told.toml"
    scenario.write_text(
        'system = "cts"\nduration = 3\nwaypoints = [[25, 0]]\n'
        '[[set]]\nat = 0.5\n"controller.override" = "STOP"'
    )
    for target, outcome in (("two_waypoint", "success"), (scenario, "stopped")):
        # when
        status, text, _ = canine(
            capsys, "run", target, "--controller", ctl, "--out", tmp_path / "out", "--json"
        )
        # then
        assert status == 0
        assert json.loads(text)["outcome"] == outcome
        log = read_log(tmp_path / "out" / "trial.mcap")
        assert log["controller.seen"][-1] == pytest.approx(0.025)
        assert log.parameter("controller.waypoint_north[1]") == pytest.approx(25.0)


SSD = """<?xml version="1.0"?><SystemStructureDescription version="1.0" name="toy"
xmlns="http://ssp-standard.org/SSP1/SystemStructureDescription"
xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"><System name="toy"><Elements>
<Component name="plant" source="dog.fmu">{}</Component></Elements></System></SystemStructureDescription>"""
BOUND = """<ParameterBindings><ParameterBinding><ParameterValues><ssv:ParameterSet version="1.0" name="s">
<ssv:Parameters><ssv:Parameter name="start_heading"><ssv:Real value="30"/></ssv:Parameter></ssv:Parameters>
</ssv:ParameterSet></ParameterValues></ParameterBinding></ParameterBindings>"""


def test_a_package_in_a_folder_runs_and_runs_again_from_its_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a plant with a heading in deg in a folder that holds other things too
    folder = tmp_path / "toy"
    folder.mkdir()
    heading = V("start_heading", "parameter", unit="deg")
    tiny_fmu(folder / "dog.fmu", [V("heading", unit="rad"), heading], "v[0] = v[1];", depends=False)
    (folder / "SystemStructure.ssd").write_text(SSD.format(""))
    (folder / "notes.txt").write_text("x")
    # when nobody converts the heading, then it is refused by name
    status, _, error = canine(capsys, "run", folder, "--out", tmp_path / "a")
    assert status == 2
    assert 'parameter "start_heading" has unit "deg", the plant role needs "rad"' in error
    # when the package gives it
    (folder / "SystemStructure.ssd").write_text(SSD.format(BOUND))
    first = tmp_path / "first" / "trial.mcap"
    for target in (folder, folder / "SystemStructure.ssd"):
        status, _, error = canine(capsys, "run", target, "--out", first.parent)
        assert status == 0
        assert "note: plant dog.fmu: has no parameter seed, start_north" in error
    # then the log holds the package, and runs again without the folder
    log = read_log(first)
    assert log["plant.heading"][-1] == 30.0
    (tmp_path / "system.ssp").write_bytes(log.attachments["system.ssp"])
    with zipfile.ZipFile(tmp_path / "system.ssp") as archive:
        assert set(archive.namelist()) == {"SystemStructure.ssd", "dog.fmu"}
    for path in folder.iterdir():
        if path.is_file():
            path.unlink()
    status, _, _ = canine(capsys, "run", first)
    assert status == 0
    assert (tmp_path / "first-again" / "trial.mcap").read_bytes() == first.read_bytes()


def test_fmi_is_refused_where_the_package_holds_the_fmus(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, error = canine(capsys, "run", build_folder() / "cts.fmi2.ssp", "--fmi", "3")
    assert status == 2
    assert "canine: --fmi 3: cts.fmi2.ssp is run with the FMUs that it holds; leave --fmi out" in error


def test_two_trials_do_not_write_into_one_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given a folder into which another trial is writing
    with trial.alone_in(tmp_path):
        # then a second one is refused, and leaves nothing there
        status, _, errors = canine(capsys, *RUN, "--out", tmp_path)
    assert status == 2
    assert f"{tmp_path}: another trial is being written there; choose another folder" in errors
    assert not list(tmp_path.iterdir())


def test_a_log_that_is_cut_is_used_with_a_note(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given the first nine tenths of a log
    canine(capsys, "run", "three_waypoint", "--out", tmp_path / "a")
    whole = (tmp_path / "a" / "trial.mcap").read_bytes()
    cut = tmp_path / "cut" / "trial.mcap"
    cut.parent.mkdir()
    cut.write_bytes(whole[: len(whole) * 9 // 10])
    for arguments in (("run", cut, "--out", tmp_path / "b"), ("replay", cut.parent, "--out", tmp_path / "c")):
        status, _, errors = canine(capsys, *arguments)
        assert status == 0
        assert f"note: {cut}: the log is not whole, the file ends early" in errors.replace("\n", "")


def test_a_folder_that_cannot_be_made_is_refused_by_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a file where a folder should be
    (tmp_path / "file").write_text("")
    # when
    status, _, errors = canine(capsys, *RUN, "--out", tmp_path / "file" / "x")
    # then
    assert status == 2
    reason = "the folder cannot be made (Not a directory); choose another folder"
    assert errors == f"canine: --out {tmp_path}/file/x: {reason}\n"
