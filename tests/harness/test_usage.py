"""Wrong usage: one line in one style for every command, and one rule for the exit status."""

import os
from pathlib import Path

import pytest

from harness.files import make_folder, nearest_file
from harness.main import FAULT, USAGE
from models.errors import UsageError
from tests.harness.command import canine


@pytest.mark.parametrize(
    ("command_line", "line"),
    [
        ("rnu", 'there is no command "rnu"; did you mean "run"?'),
        ("bark", 'there is no command "bark"; known: build, c, check, compare, '),
        ("--bark", 'there is no option "--bark"; known: --help, --version'),
        ("run --sed 3", 'run has no option "--sed"; did you mean "--seed"?'),
        ("run -x", 'run has no option "-x"; known: --ahrs, '),
        ("--seed 3 run", '"--seed" stands after the command, as in `canine run --seed`'),
        ("run --seed", "--seed has no value; expected a whole number from 0 to 2147483647"),
        ("run --seed many", '--seed is "many"; expected a whole number from 0 to 2147483647'),
        ("run --seed -1", '--seed is "-1"; expected a whole number from 0 to 2147483647'),
        ("run --fmi 4", '--fmi is "4"; expected one of 2, 3'),
        (
            "run --order jacoby",
            '--order is "jacoby"; expected one of sequential, jacobi; did you mean "jacobi"?',
        ),
        ("run --json=3", "--json has a value; expected none, it is a switch"),
        ("run a b (c)", 'run has no argument for "b (c)"; expected [SCENARIO.toml|SYSTEM.ssp|LOG.mcap]'),
        (
            "run two_waypoint cmec.max_turns=1",
            'run has no argument for "cmec.max_turns=1"; did you mean --set cmec.max_turns=1?',
        ),
        ("scenarios x", 'scenarios has no argument for "x"; expected none'),
        ("run --plant dog.fnu", 'there is no plant "dog.fnu"'),
        ("run --plant dag.fmu", 'there is no FMU "dag.fmu"; did you mean "dog.fmu"?'),
        (
            "run --plant folder",
            '"folder" is a folder; expected the path of an FMU, or the name of one of ours',
        ),
        ("run --out dog.fmu", '--out: "dog.fmu" is a file; expected a folder'),
        ("check", "check lacks X.fmu|RECORDING, as in `canine check dog.fmu --role plant`"),
        ("check none/dog.fmu", 'there is no "none/dog.fmu"; there is no folder "none"'),
        ("compare a", "compare lacks B, as in `canine compare out/demo/trial.mcap out/again/trial.mcap`"),
        ("recover dog.mcap --out folder", '--out: "folder" is a folder; expected a file'),
        ("c", "c lacks BLOCK, as in `canine c cmec`"),
        ("replay folder --outage 0", '--outage is "0"; expected a number from 1 to 600, s without GPS'),
        (
            "pil",
            "pil lacks --target; expected one of cortex-m4f, rabbit4000, as in "
            "`canine pil --target cortex-m4f`",
        ),
        (
            "export dog.mcap --to cvs",
            '--to is "cvs"; expected one of csv, parquet; did you mean "csv"?',
        ),
    ],
)
def test_wrong_usage_is_one_line_that_says_what_is_expected(
    command_line: str,
    line: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # given a folder with an FMU and a folder
    monkeypatch.chdir(tmp_path)
    Path("dog.fmu").touch()
    Path("folder").mkdir()
    # when
    status, text, errors = canine(capsys, *command_line.split(maxsplit=2 if "(" in command_line else -1))
    # then
    assert (status, text, errors.count("\n")) == (USAGE, "", 1)
    assert errors.startswith(f"canine: {line}")
    assert errors == f"canine: {line}\n" or line.endswith((", ", '"'))


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["run", "two_waypoint", "--out", ""], "--out"),
        (["run", "two_waypoint", "--out="], "--out"),
        (["sweep", "two", "--thresholds", "", "--trials", "1"], "--thresholds"),
        (["run", ""], "an argument"),
    ],
)
def test_an_empty_argument_is_refused_before_anything_is_written(
    arguments: list[str],
    what: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    status, _, errors = canine(capsys, *arguments)
    assert status == USAGE
    assert errors == f"canine: {what} is empty; expected a value: is a variable of the shell unset?\n"
    assert not list(tmp_path.iterdir())


def test_a_command_line_without_a_command_shows_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, errors = canine(capsys)
    assert status == USAGE
    assert "canine run two_waypoint --seed 7" in errors


@pytest.mark.parametrize(
    "command_line",
    [
        "run none.toml",
        "run none.ssp",
        "run none.mcap",
        "run --plant none.fmu",
        "wiring none.toml",
        "wiring none.ssp",
        "check none.fmu",
        "replay none.mcap",
        "replay none",
        "sweep none.toml",
        "fit none.mcap",
        "fit none",
        "export none.mcap --to csv",
        "export . --to csv",
        "compare none.mcap none.mcap",
        "compare none none",
        "recover none.mcap",
        "firmware --insecure --target host --out fw --parameters none.toml",
        "pil none.toml --target cortex-m4f",
    ],
)
def test_a_missing_input_is_wrong_usage_in_every_command(
    command_line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    # when
    status, text, errors = canine(capsys, *command_line.split())
    # then
    assert (status, text, errors.count("\n")) == (USAGE, "", 1)
    assert "none" in errors or "Is a directory" in errors
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "command_line",
    [
        "run two_waypoint",
        "run two_waypoint --seeds 1:2",
        "replay trial.mcap",
        "sweep two --trials 1 --thresholds 40:41",
        "fit trial.mcap",
        "export trial.mcap --to csv",
        "firmware --insecure --target host",
        "c cmec",
        "pil two_waypoint --target cortex-m4f",
    ],
)
def test_a_folder_that_cannot_be_written_is_wrong_usage_in_every_command(
    command_line: str,
    log: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # given a log, and a file where a folder should be
    monkeypatch.chdir(tmp_path)
    Path("trial.mcap").write_bytes(log.read_bytes())
    Path("file").touch()
    # when
    status, _, errors = canine(capsys, *command_line.split(), "--out", "file/x")
    # then
    assert (status, errors.count("\n")) == (USAGE, 1)
    assert "file/x" in errors
    assert "Not a directory" in errors


@pytest.mark.parametrize(
    "command_line",
    [
        "run damaged.mcap",
        "replay damaged.mcap",
        "fit damaged.mcap",
        "export damaged.mcap --to csv",
        "compare damaged.mcap damaged.mcap",
        "recover damaged.mcap",
    ],
)
def test_a_damaged_log_is_a_fault_in_every_command(
    command_line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("damaged.mcap").write_bytes(b"no log")
    status, _, errors = canine(capsys, *command_line.split())
    assert (status, errors.count("\n")) == (FAULT, 1)
    assert "damaged.mcap" in errors


def test_an_existing_folder_without_write_permission_is_wrong_usage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK | os.X_OK)
    with pytest.raises(UsageError, match=r"the folder cannot be written into; choose another folder"):
        make_folder(tmp_path)


def test_the_hint_at_a_missing_file_names_those_of_its_kind_that_are_there(tmp_path: Path) -> None:
    # given one file of a kind, and many of another
    for name in ("base.toml", *(f"{letter * 9}.ssp" for letter in "abcdefg"), "base.txt"):
        (tmp_path / name).touch()
    # then the one is meant, or the nearest, or a few are listed
    assert nearest_file(tmp_path / "qq.toml") == f'; did you mean "{tmp_path}/base.toml"?'
    assert nearest_file(tmp_path / "bbbbbbb.ssp") == f'; did you mean "{tmp_path}/bbbbbbbbb.ssp"?'
    listed = ", ".join(f"{letter * 9}.ssp" for letter in "abcde")
    assert nearest_file(tmp_path / "xyz.ssp") == f"; there are {listed}, ..."
    assert nearest_file(tmp_path / "xyz.mcap") == ""
    assert nearest_file(tmp_path / "none" / "base.toml") == f'; there is no folder "{tmp_path}/none"'


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a trial."""
    from harness.front_door import run_trial  # noqa: PLC0415

    return run_trial("three_waypoint", out=tmp_path_factory.mktemp("log")).log_path
