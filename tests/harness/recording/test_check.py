"""`canine check RECORDING`: what it says of recordings whose content is known."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from harness.recording.check import check
from tests.harness.command import canine
from tests.harness.recording import made_up

PROJECT = Path(__file__).resolve().parents[3]
DATA = Path(os.environ.get("CANINE_DATA", PROJECT.parent / "shared" / "data"))
CAPTURES, WALK = DATA / "ubx_captures", DATA / "walk_ublox_imu"
captures_are_there = pytest.mark.skipif(not CAPTURES.is_dir(), reason=f"no captures in {CAPTURES}")
walk_is_there = pytest.mark.skipif(not WALK.is_dir(), reason=f"no recording in {WALK}")

Z_UP = np.diag([1.0, -1.0, -1.0])


def described(folder: Path, imu_offset: float, mounting: str = "roll = 0, pitch = 0, yaw = 0") -> Path:
    """The made-up walk in a csv whose clock has 0 at its start, and a stream of fixes."""
    times = np.arange(0, made_up.DURATION, 0.01)
    force, rate = made_up.force_and_rate(times)
    rows = [",".join(f"{value:.6f}" for value in row) for row in np.column_stack([times, force, rate])]
    (folder / "dog.csv").write_text("\n".join(rows))
    (folder / "gnss.ubx").write_bytes(b"".join(made_up.pvt(float(t)) for t in made_up.fix_times()))
    columns = "".join(
        f'{name}_{axis} = {{ column = {first + i}, unit = "{unit}" }}\n'
        for name, first, unit in (("accel", 2, "m/s2"), ("gyro", 5, "rad/s"))
        for i, axis in enumerate("xyz")
    )
    (folder / "recording.toml").write_text(
        f'[gps]\nfile = "gnss.ubx"\n[imu]\nfile = "dog.csv"\nmounting = {{ {mounting} }}\n'
        f'[imu.columns]\ntime = {{ column = 1, unit = "s" }}\n{columns}'
        f"[clock]\nimu_offset = {made_up.TOW + imu_offset}\n"
    )
    return folder


def test_the_offset_of_the_clocks_is_found_by_each_correlation(tmp_path: Path) -> None:
    # given an IMU whose time is 0.4 s too early
    result = check(described(tmp_path, imu_offset=-0.4))
    # then turns, sideways and forward force each say what is to be added
    for name in ("turning", "swerving", "pushing"):
        offset = result["offset"][name]
        assert offset["seconds"] == pytest.approx(0.4, abs=0.03), name
        assert offset["correlation"] > 0.95
    assert result["warnings"] == ["by its turns the clock of the IMU is 0.40 s early: see clock.imu_offset"]


def test_gravity_tells_a_mounting_that_is_upside_down(tmp_path: Path) -> None:
    result = check(described(tmp_path, imu_offset=0, mounting="roll = 180, pitch = 0, yaw = 0"))
    (warning,) = result["warnings"]
    assert warning.startswith(
        "gravity is 179 deg off the mounting that is used; by gravity, the IMU sits at roll -1, pitch 0 deg"
    )
    assert result["mounting"]["off_deg"] > 175


def test_a_mounting_that_faces_backward_is_told_by_the_force_forward(tmp_path: Path) -> None:
    result = check(described(tmp_path, imu_offset=0, mounting="roll = 0, pitch = 0, yaw = 180"))
    pushing = result["offset"]["pushing"]
    assert pushing["seconds"] is None
    assert pushing["correlation"] < -0.95
    assert pushing["reason"] == "one is the reverse of the other, correlation -1.00"
    assert result["offset"]["turning"]["seconds"] == pytest.approx(0, abs=0.03)
    (warning,) = result["warnings"]
    assert warning.startswith("the force is turned by 180 deg to the ")


def test_holes_have_a_place_and_a_length(tmp_path: Path) -> None:
    # given a csv without the samples from 20 to 23 s, and fixes without those of 30 to 32 s
    folder = described(tmp_path, imu_offset=0)
    lines = (folder / "dog.csv").read_text().splitlines()
    (folder / "dog.csv").write_text("\n".join(lines[:2000] + lines[2300:]))
    times = [float(t) for t in made_up.fix_times() if not 30 < t < 32]
    (folder / "gnss.ubx").write_bytes(b"".join(made_up.pvt(t) for t in times))
    result = check(folder)
    (hole,) = result["imu"]["holes"]
    assert (hole["start_s"], hole["length_s"]) == (pytest.approx(19.99), pytest.approx(3.01))
    (hole,) = result["fixes"]["holes"]
    assert (hole["start_s"], hole["length_s"]) == (pytest.approx(29.75), pytest.approx(2.0))
    assert result["imu"]["rate_hz"] == pytest.approx(100)
    assert result["fixes"]["rate_hz"] == pytest.approx(4)


def test_gaps_that_a_replay_bridges_are_no_holes(tmp_path: Path) -> None:
    # given an IMU that is silent for 90 ms, which is nine samples, and two fixes missing in a row
    folder = described(tmp_path, imu_offset=0)
    lines = (folder / "dog.csv").read_text().splitlines()
    del lines[2000:2008]
    (folder / "dog.csv").write_text("\n".join(lines))
    times = np.delete(made_up.fix_times(), [100, 101])
    (folder / "gnss.ubx").write_bytes(b"".join(made_up.pvt(float(t)) for t in times))
    # when it is checked, then only the fixes have a hole, as in a replay
    result = check(folder)
    assert result["imu"]["holes"] == []
    (hole,) = result["fixes"]["holes"]
    assert hole["length_s"] == pytest.approx(0.75)


def test_samples_on_a_clock_of_unknown_ticks_have_no_duration_and_no_rate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a u-blox stream with too few fixes to tell the unit of its time tags
    stream = made_up.stream(Z_UP)
    (tmp_path / "f9r.ubx").write_bytes(stream[: len(stream) // 40])
    # when it is checked, then nothing is said in seconds
    imu = check(tmp_path)["imu"]
    assert imu["n"] > 100
    assert [imu[key] for key in ("duration_s", "rate_hz", "interval_s", "holes")] == [None] * 4
    status, text, _ = canine(capsys, "check", tmp_path)
    assert status == 1
    assert f"imu       f9r.ubx: {imu['n']}, on a clock of unknown ticks\n" in text


def test_all_that_is_dropped_is_counted(tmp_path: Path) -> None:
    # given a sample twice, one with a force that no IMU measures, one that is not finite, and a fix twice
    folder = described(tmp_path, imu_offset=0)
    lines = (folder / "dog.csv").read_text().splitlines()
    lines[1000] = lines[999]
    lines[2000] = lines[2000].replace("-9.80665", "-999.0")
    lines[3000] = lines[3000].replace("-9.80665", "nan")
    (folder / "dog.csv").write_text("\n".join(lines))
    (folder / "gnss.ubx").write_bytes((folder / "gnss.ubx").read_bytes() + made_up.pvt(59.75))
    # when it is checked, then each has its cause
    result = check(folder)
    assert result["imu"]["dropped"] == {
        "lines without their numbers": 1, "IMU samples out of range": 1, "IMU samples repeated": 1,
    }  # fmt: skip
    assert result["imu"]["n"] == 5997
    assert result["fixes"]["dropped"] == {"fixes repeated": 1}
    json.dumps(result, allow_nan=False)


def test_who_stands_still_cannot_be_told_an_offset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(made_up, "velocity", lambda t: (0.0, 0.0))
    result = check(described(tmp_path, imu_offset=0))
    for offset in result["offset"].values():
        assert offset["seconds"] is None
        assert offset["reason"] == "only 0 pairs of moving fixes, 30 are needed"


def test_a_recording_is_shown_in_lines_and_as_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = described(tmp_path, imu_offset=0)
    status, text, _ = canine(capsys, "check", folder)
    assert status == 0
    for line in (
        "messages  NAV-PVT 239",
        "fixes     gnss.ubx: 239 in 59.5 s, 4 Hz, one every 250 to 250 ms (p5 to p95)",
        "imu       dog.csv: 6000 in 60.0 s, 100 Hz, one every 10 to 10 ms (p5 to p95)",
        "clocks    tied by the clock.imu_offset in recording.toml",
        "replay    59.5 s with both sensors",
    ):
        assert line in text
    status, text, _ = canine(capsys, "check", folder, "--json")
    assert status == 0
    assert json.loads(text) == [check(folder)]


def test_a_recording_without_an_imu_is_described_and_ends_with_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "gnss.ubx").write_bytes(made_up.pvt(1.0) + made_up.pvt(2.0))
    status, text, error = canine(capsys, "check", tmp_path)
    assert status == 1
    assert "fixes     gnss.ubx: 2 in 1.0 s, 1 Hz" in text
    assert "imu       none" in text
    assert error.startswith("canine: ")
    assert "got no inertial samples, expected UBX-ESF-RAW or UBX-ESF-MEAS" in error
    assert len(error.splitlines()) == 1


def test_several_recordings_are_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("good", "without"):
        (tmp_path / name).mkdir()
    described(tmp_path / "good", imu_offset=0)
    (tmp_path / "without" / "gnss.ubx").write_bytes(made_up.pvt(1.0))
    status, text, error = canine(capsys, "check", tmp_path)
    assert status == 1
    assert "good" in text
    assert "59.5" in text
    assert "1 of 2 recordings cannot be replayed: without" in error


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["--role", "plant"], "is a recording; a role is for an FMU"), ([], "got no recording, here or below")],
    ids=["role", "empty"],
)
def test_wrong_usage_of_check_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    status, _, error = canine(capsys, "check", tmp_path, *arguments)
    assert status in (1, 2)
    assert message in error


@walk_is_there
def test_the_walk_is_described_as_its_readme_says() -> None:
    result = check(WALK)
    assert result["fixes"]["n"] == 536
    assert result["fixes"]["rate_hz"] == pytest.approx(4.0)
    assert result["imu"]["n"] == 20_455
    assert result["mounting"]["off_deg"] < 5
    assert result["problem"] == ""
    # its bearer swings the unit ahead of him: the yaw leads, the force does not; both are near 0
    assert result["offset"]["turning"]["seconds"] == pytest.approx(-0.2, abs=0.1)
    assert result["offset"]["swerving"]["seconds"] == pytest.approx(0.12, abs=0.1)
    assert result["offset"]["pushing"]["seconds"] is None


@captures_are_there
def test_the_captures_are_described_as_they_are() -> None:
    mixed = check(CAPTURES / "pygpsdata-MIXED.log")
    assert mixed["messages"]["NAV-PVT"] == 39
    assert mixed["fixes"]["n"] == 39
    assert mixed["fixes"]["rate_hz"] == pytest.approx(1.0)
    assert "got no inertial samples" in mixed["problem"]
    calibration = check(CAPTURES / "pygpsdata-SF-calibration.log")
    assert calibration["messages"]["NAV-PVAT"] == calibration["messages"]["ESF-STATUS"] == 527
    assert calibration["imu"] is None
