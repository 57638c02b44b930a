"""Replays of all recordings below a folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from harness.recording.mounting import rotation
from harness.replay.several import show
from tests.harness.command import canine
from tests.harness.cosim.tiny_fmu import V, tiny_fmu
from tests.harness.recording import made_up


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes longer than the replays."""
    monkeypatch.setattr("harness.replay.replay.replay_picture", lambda *_, **__: b"")


@pytest.fixture
def field(tmp_path: Path) -> Path:
    """A folder with the made-up walk twice, as a u-blox receiver with an IMU records it, and one without."""
    walk = made_up.stream(rotation(180, 0, 0))
    for name, content in (("monday", walk), ("short", made_up.pvt(1.0)), ("tuesday", walk)):
        (tmp_path / "field" / name).mkdir(parents=True)
        (tmp_path / "field" / name / "f9r.ubx").write_bytes(content)
    return tmp_path / "field"


def test_a_folder_of_recordings_is_replayed_into_a_folder_each(
    field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # when
    arguments = ("replay", field, "--outage", 5, "--every", 20, "--out", tmp_path / "out")
    status, text, _ = canine(capsys, *arguments)
    # then there is a line for each, results for those that could be replayed, and why the other could not
    assert status == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"monday", "tuesday"}
    first = json.loads((tmp_path / "out" / "monday" / "outages.json").read_text())
    median = first["configurations"]["pitch"]["position_error_m"]["median"]
    assert np.isfinite(median)
    for words in ("monday", "tuesday", f"{median:.2f}", "short: ", "got no inertial samples"):
        assert words in text
    # and as JSON it is what the files hold
    status, text, _ = canine(capsys, *arguments, "--json")
    results = json.loads(text)
    assert [result["recording"] for result in results] == ["monday", "short", "tuesday"]
    assert results[0]["configurations"] == first["configurations"]
    assert "got no inertial samples" in results[1]["problem"]


def test_an_estimator_that_one_recording_has_no_sensors_for_has_a_dash_there(
    capsys: pytest.CaptureFixture[str],
) -> None:
    # given two results, of which only the second has the seven states
    def result(recording: str, **medians: float) -> dict[str, Any]:
        errors = {name: {"position_error_m": {"median": median}} for name, median in medians.items()}
        return {
            "recording": recording, "problem": "", "configurations": errors, "outages": [1], "left_out": {},
            "dropped": {}, "notes": [], "verdicts": {},
        }  # fmt: skip

    show([result("walk", pitch=1.25), result("run", pitch=2.5, seven_state=3.75)], Console(width=120))
    # then the first has none
    rows = {
        line.split()[0]: line.split()[-2:] for line in capsys.readouterr().out.splitlines() if line.strip()
    }
    assert rows["walk"] == ["1.25", "-"]
    assert rows["run"] == ["2.50", "3.75"]


def test_an_fmu_that_crashes_is_named_behind_the_results_of_all_others(
    field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given an FMU that crashes in each recording
    variables = [V("gps_north", "input"), V("north"), V("east"), V("speed")]
    bad = tiny_fmu(tmp_path / "bad.fmu", variables, "*(volatile int *)8 = 1;")
    # when
    arguments = ("--estimator", f"{bad},two_bias", "--outage", 5, "--every", 20, "--out", tmp_path / "out")
    status, text, error = canine(capsys, "replay", field, *arguments)
    # then
    assert status == 1
    rows = {line.split()[0]: line.split() for line in text.splitlines() if line.strip()}
    for recording in ("monday", "tuesday"):
        assert rows[recording].count("failed") == 1
        assert f"{recording}: estimator bad.fmu: fmi2DoStep ended the process" in error


def test_a_folder_of_recordings_of_which_none_can_be_replayed_is_a_fault(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.ubx", "b.ubx"):
        (tmp_path / name).write_bytes(made_up.pvt(1.0))
    status, text, error = canine(capsys, "replay", tmp_path, "--out", tmp_path / "out")
    assert status == 1
    assert "none of 2 recordings can be replayed" in error
    assert "a: " in text
    assert not (tmp_path / "out").exists()


def test_a_capture_that_stands_still_says_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a stream with fixes and samples that never moves
    monkeypatch.setattr(made_up, "velocity", lambda t: (0.0, 0.0))
    path = tmp_path / "desk.ubx"
    path.write_bytes(made_up.stream(rotation(180, 0, 0)))
    # when it is replayed, then one line says that motion is missing
    status, _, error = canine(capsys, "replay", path, "--out", tmp_path / "out")
    assert status == 1
    problem = [line for line in error.splitlines() if line.startswith("canine: ")]
    assert len(problem) == 1
    assert "no outage of 10 s can be judged" in problem[0]
    assert "expected 10 s of motion" in problem[0]
