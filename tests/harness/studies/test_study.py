"""The frame of studies: the command, its files, wrong usage."""

from __future__ import annotations

import json
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from harness.main import run
from harness.studies import STUDIES
from harness.studies.study import Options, find_study, in_threads, run_study
from models.errors import UsageError


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_has_what_a_study_needs(name: str) -> None:
    study = find_study(name)
    assert {"seeds", "set", "recording"} >= study.TAKES
    assert all(callable(getattr(study, part)) for part in ("run", "show", "draw"))
    assert import_module(f"harness.studies.{name}").__doc__


def test_the_command_without_a_name_lists_the_studies(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["study"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(STUDIES)


def test_the_command_writes_json_and_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given a folder that is not there yet
    folder = tmp_path / "here"
    assert run(["study", "pitch", "--seeds", "2", "--out", str(folder), "--json"]) == 0
    printed: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert printed == json.loads((folder / "pitch.json").read_text())
    assert printed["study"] == "pitch"
    assert sorted(path.name for path in folder.iterdir()) == ["pitch.json", "pitch.png", "study.html"]
    assert (folder / "pitch.png").read_bytes().startswith(b"\x89PNG")


def test_pictures_of_a_recording_do_not_stay_beside_those_of_simulated_paths(tmp_path: Path) -> None:
    # given a picture that only a study of a recording has, and one of the user's
    for name in ("outage_recorded_path.png", "outage_mine.png"):
        (tmp_path / name).write_bytes(b"old")
    # when
    assert run(["study", "outage", "--seeds", "2", "--set", "ideal", "--out", str(tmp_path)]) == 0
    # then
    names = sorted(path.name for path in tmp_path.glob("outage_*"))
    assert names == ["outage_detection.png", "outage_mine.png", "outage_running.png"]


def test_results_of_other_options_are_replaced_with_a_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    # given the results of a study in its default folder
    assert run(["study", "pitch", "--seeds", "2"]) == 0
    assert "note" not in capsys.readouterr().err
    # when it is carried out again, nothing is said; with other options, what differs is
    assert run(["study", "pitch", "--seeds", "2"]) == 0
    assert "note" not in capsys.readouterr().err
    assert run(["study", "pitch", "--seeds", "3"]) == 0
    assert capsys.readouterr().err == (
        "note: out/study-pitch: has the results of other options, which these replace "
        "(options.seeds: 2, now 3)\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["pich"], 'there is no study "pich"; did you mean "pitch"?'),
        (["pitch", "--seeds", "1"], "--seeds 1: expected 2 or more, since a spread is stated"),
        (["pitch", "--seeds", "1000000000"], "--seeds 1000000000: expected at most 5000"),
        (
            ["outage", "--set", "ideal", "--set", "measured"],
            "--set ideal --set measured: a study takes one set, or all without --set",
        ),
        (["pitch", "--set", "ideal"], "study pitch has no use for --set; it takes --seeds"),
    ],
)
def test_wrong_usage_is_told_in_a_line(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["study", *arguments, "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == f"canine: {message}\n"
    assert not (tmp_path / "out").exists()


def test_a_recording_is_refused_where_none_is_studied(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="study pitch has no use for a recording"):
        run_study("pitch", Options(recording=tmp_path))


def test_work_in_threads_comes_in_order_and_ends_when_nobody_waits() -> None:
    # given a thousand items, of which the fourth raises what Ctrl-C raises
    begun: list[int] = []

    def work(item: int) -> int:
        begun.append(item)
        time.sleep(0.002)
        if item == 3:
            raise KeyboardInterrupt
        return item

    results = in_threads(work, range(1000))
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(KeyboardInterrupt):
        next(results)
    assert len(begun) < 100
