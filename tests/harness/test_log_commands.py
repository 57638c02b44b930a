"""The commands that take logs: exports, comparisons, recoveries."""

import json
import zipfile
from pathlib import Path

import pytest

from harness.log.log import read_log
from tests.harness.command import canine

RUN = ["run", "two_waypoint", "--set", "canine.shaking=false"]


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_a_log_is_exported_beside_itself_or_where_it_is_told(
    to: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given
    canine(capsys, *RUN, "--out", tmp_path)
    log = read_log(tmp_path / "trial.mcap")
    # when
    status, text, errors = canine(capsys, "export", tmp_path / "trial.mcap", "--to", to)
    canine(capsys, "export", tmp_path / "trial.mcap", "--to", to, "--out", tmp_path / "data")
    # then
    names = {*(f"{channel.component}.{to}" for channel in log.channels), "units.json"}
    assert (status, errors) == (0, "")
    assert text == f"{tmp_path}/{to}/: {', '.join(sorted(names))}\n"
    assert {path.name for path in (tmp_path / "data").iterdir()} == names
    if to == "csv":
        lines = (tmp_path / "csv" / "plant.csv").read_text().splitlines()
        assert lines[0].split(",")[0] == "time"
        assert [float(line.split(",")[0]) for line in lines[1:]] == log.time.tolist()


def test_the_export_of_a_scenario_says_to_run_it_first(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for scenario in ("three_waypoint", str(tmp_path / "my.toml")):
        status, _, errors = canine(capsys, "export", scenario, "--to", "csv")
        assert status == 2
        assert f"expected a log; `canine run {scenario}` writes one" in errors


def test_a_trial_is_exported_as_a_package(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # when, with what changes the trial
    package = tmp_path / "new" / "it.ssp"
    changes = ("--seed", 7, "--set", "canine.shaking=false", "--estimator", "six_state", "--fmi", 3)
    result = canine(capsys, "export", "two_waypoint", *changes, "--ssp", package)
    # then
    assert result == (0, f"{package}\n", "")
    with zipfile.ZipFile(package) as archive:
        structure = archive.read("SystemStructure.ssd").decode()
        assert "resources/six_state.fmu" in archive.namelist()
    assert '<ssv:Parameter name="shaking">' in structure
    assert '<ssv:Integer value="7" />' in structure


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ([], "export trial.mcap: expected --to csv, --to parquet, or --ssp FILE.ssp"),
        (["--to", "csv", "--ssp", "x.ssp"], "expected --to csv, --to parquet, or --ssp FILE.ssp"),
        (["--ssp", "x.ssp", "--out", "here"], "--out here is for --to; --ssp x.ssp names the file itself"),
        (["--to", "csv", "--seed", "3"], "--to csv: a log is exported as it is; what changes a trial is for"),
        (["--to", "csv", "--ahrs"], "--to csv: a log is exported as it is; what changes a trial is for"),
    ],
)
def test_options_of_exports_that_do_not_go_together_are_refused(
    options: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, errors = canine(capsys, "export", "trial.mcap", *options)
    assert status == 2
    assert text in errors


def test_the_export_of_a_cut_log_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given the first nine tenths of a log
    canine(capsys, *RUN, "--out", tmp_path)
    log = tmp_path / "trial.mcap"
    log.write_bytes(log.read_bytes()[: log.stat().st_size * 9 // 10])
    # when
    status, _, errors = canine(capsys, "export", log, "--to", "csv")
    # then
    assert status == 0
    assert f"note: {log}: the log is not whole, the file ends early" in errors.replace("\n", "")
    assert len((tmp_path / "csv" / "plant.csv").read_text().splitlines()) == len(read_log(log).time) + 1


@pytest.fixture
def runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """A folder with a run, the same one again, and one whose dog drifts otherwise."""
    for name, drift in (("one", 1), ("again", 1), ("other", 4)):
        out = ("--out", tmp_path / name)
        assert canine(capsys, *RUN, "--set", f"canine.drift={drift}", *out)[0] == 0
    return tmp_path


def test_logs_are_compared_by_path_or_folder_and_the_status_tells(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, again, other = (runs / name for name in ("one", "again", "other"))
    log = one / "trial.mcap"
    # given the same run twice, then it agrees bit for bit
    until = read_log(log).time[-1]
    status, text, errors = canine(capsys, "compare", one, again / "trial.mcap")
    assert (status, errors) == (0, "")
    assert text.startswith(f"{log} and {again}/trial.mcap agree: 0 of ")
    assert text.endswith(f" rows up to {until:g} s\n")
    # and another dog differs: first the plant, within the first seconds, as the logs say it
    status, text, errors = canine(capsys, "compare", one, other, "--json")
    result = json.loads(text)
    assert (status, errors, result["agree"]) == (1, "", False)
    first = result["first"]
    logs = read_log(log), read_log(other / "trial.mcap")
    values = [read[first["signal"]] for read in logs]
    assert [first["a"], first["b"]] == [float(v[first["tick"]]) for v in values]
    assert (values[0][: first["tick"]] == values[1][: first["tick"]]).all()
    assert {"name": "scenario.parameters.canine.drift", "a": 1, "b": 4} in result["statements"]
    # and the table names each signal that differs
    _, text, _ = canine(capsys, "compare", one, other)
    assert text.startswith(f"first difference: tick {first['tick']}, ")
    named = [line.split()[0] for line in text.splitlines()]
    assert [signal["signal"] for signal in result["signals"]] == [n for n in named if n in logs[0]]


def test_a_tolerance_decides_and_metadata_may_be_left_out(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pair = ("compare", runs / "one", runs / "other", "--json")
    result = json.loads(canine(capsys, *pair, "--tolerance", 0.5, "--tolerance", "plant.north=1e-3")[1])
    for signal in result["signals"]:
        tolerance = 1e-3 if signal["signal"] == "plant.north" else 0.5
        assert signal["tolerance"] == tolerance
        assert signal["max"] > tolerance
    # given a package whose other parameter nobody uses, then nothing differs
    changed = ("--set", "canine.drift=1", "--set", "cmec.moving_deviation=48.999")
    canine(capsys, *RUN, *changed, "--out", runs / "stated")
    stated = ("compare", runs / "one", runs / "stated")
    status, text, _ = canine(capsys, *stated)
    assert status == 1
    assert "scenario.parameters.cmec.moving_deviation  none" in text
    status, text, _ = canine(capsys, *stated, "--values-only")
    assert status == 0
    assert "parameters.controller.moving_deviation" in text


def test_a_log_that_was_cut_is_compared_as_far_as_it_goes_with_a_note(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given
    whole = runs / "one" / "trial.mcap"
    cut = runs / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:400_000])
    last = read_log(cut).time[-1]
    # then
    status, text, errors = canine(capsys, "compare", cut, whole)
    assert status == 0
    assert text.endswith(f" rows up to {last:g} s\n")
    assert errors.startswith(f"note: {cut}: the log is not whole, the file ends early, at byte 400000")
    assert errors.endswith("; what is after that does not count\n")


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("--tolerance", "-1"), "--tolerance -1.0: expected a number from 0 on"),
        (("--tolerance", "plant.norht=1"), "--tolerance plant.norht: neither log has such a signal; did you"),
        (("--tolerance", "1", "--tolerance", "2"), "--tolerance 2: one for all signals is given already"),
    ],
)
def test_a_tolerance_that_cannot_hold_is_wrong_usage(
    arguments: tuple[str, ...], error: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    canine(capsys, *RUN, "--out", tmp_path)
    status, text, errors = canine(capsys, "compare", tmp_path, tmp_path, *arguments)
    assert (status, text, errors.count("\n")) == (2, "", 1)
    assert errors.startswith(f"canine: {error}")


def test_a_recovered_log_runs_again_and_is_exported_fitted_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a run whose log was cut in its last second
    monkeypatch.chdir(tmp_path)
    canine(capsys, *RUN, "--out", "whole")
    data = Path("whole/trial.mcap").read_bytes()
    Path("killed").mkdir()
    Path("killed/trial.mcap").write_bytes(data[: len(data) * 9 // 10])
    # when
    status, text, errors = canine(capsys, "recover", "killed")
    # then it is said what was recovered, what was lost, and how far the trial came
    out = Path("killed/trial-recovered.mcap")
    log = read_log(out)
    lines = text.splitlines()
    assert (status, errors) == (0, "")
    assert lines[0].startswith("killed/trial.mcap: the file ends early, at byte ")
    assert lines[1].startswith(f"recovered: {len(log.time)} ticks up to {log.time[-1]:g} s; messages of /sen")
    assert lines[2].startswith("lost: ")
    assert "outcome               stopped" in [line.rstrip() for line in lines]
    assert lines[-1] == str(out)
    # and the new log does all that a log does
    canine(capsys, "run", out, "--out", "again")
    assert Path("again/trial.mcap").read_bytes() == data
    assert canine(capsys, "compare", out, "whole")[0] == 0
    assert canine(capsys, "export", out, "--to", "csv", "--out", "csv")[0] == 0
    assert Path("csv/plant.csv").read_text().count("\n") == len(log.time) + 1
    assert canine(capsys, "fit", out)[0] == 0
    # and it is whole, as is the first: neither is written anew
    for path in (out, Path("whole/trial.mcap")):
        status, text, _ = canine(capsys, "recover", path)
        assert status == 0
        assert text.startswith(f"{path}: the log is whole, ")
    assert sorted(p.name for p in Path("whole").glob("*.mcap")) == ["trial.mcap"]


def test_a_recovery_as_json_and_into_a_file_of_ones_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    canine(capsys, *RUN, "--out", tmp_path)
    log, out = tmp_path / "trial.mcap", tmp_path / "new" / "a.mcap"
    data = log.read_bytes()[:400_000]
    log.write_bytes(data)
    status, text, _ = canine(capsys, "recover", log, "--out", out, "--json")
    result = json.loads(text)
    assert status == 0
    assert (result["out"], result["complete"], result["summary"]["log"]) == (str(out), False, "a.mcap")
    assert result["messages"]["/plant"] == result["ticks"] == len(read_log(out).time)
    # and what is there is not written over
    for taken in (out, log):
        status, _, errors = canine(capsys, "recover", log, "--out", taken)
        assert (status, errors) == (2, f"canine: --out {taken}: is there already; choose another file, "
                                       "or remove that one\n")  # fmt: skip
    assert log.read_bytes() == data


def test_a_log_that_was_cut_has_a_report_up_to_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a log of which the end is gone
    canine(capsys, *RUN, "--out", tmp_path / "run")
    log = tmp_path / "run" / "trial.mcap"
    whole = (tmp_path / "run" / "trial.html").read_text()
    log.write_bytes(log.read_bytes()[:-100_000])
    # when
    status, text, errors = canine(capsys, "report", tmp_path / "run")
    # then the page is that of the ticks that are left
    assert status == 0
    assert "the log is not whole, the file ends early" in errors
    assert text.splitlines()[-1] == str(tmp_path / "run" / "trial.html")
    page = (tmp_path / "run" / "trial.html").read_text()
    assert "This log is not whole: the file ends early" in page
    assert "This log is not whole" not in whole
    assert f'"ticks": {len(read_log(log).time)}' in canine(capsys, "report", log, "--json")[1]
    # and a page elsewhere leaves that one
    canine(capsys, "report", log, "--out", tmp_path / "mine.html")
    assert (tmp_path / "mine.html").read_text() == page


def test_a_report_of_no_log_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.toml").write_text("seed = 1")
    status, _, errors = canine(capsys, "report", tmp_path / "a.toml")
    assert status == 1
    assert "not an MCAP file" in errors


def test_two_logs_are_compared_in_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given two trials with other seeds
    for seed in (1, 2):
        canine(capsys, *RUN, "--seed", seed, "--out", tmp_path / str(seed))
    page = tmp_path / "both.html"
    # when
    status, text, _ = canine(capsys, "compare", tmp_path / "1", tmp_path / "2", "--html", page)
    # then the page says what the terminal says, and where it is
    lines = text.splitlines()
    assert status == 1
    assert lines[-1] == str(page)
    assert lines[-2].partition(" differ: ")[2] in page.read_text()
