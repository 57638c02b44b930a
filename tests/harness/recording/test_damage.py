"""Bytes changed, lost or added in any file of a recording: our errors alone, and no quiet wrong answer."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from harness.recording.read import read_recording
from harness.recording.recording import Recording
from harness.recording.signals import sensor_signals
from models.errors import CanineError
from tests.harness.recording.walks import write_walk

PROJECT = Path(__file__).resolve().parents[3]
DATA = Path(os.environ.get("CANINE_DATA", PROJECT.parent / "shared" / "data"))
WALK = DATA / "walk_ublox_imu"
FILES = ("gnss.ubx", "gnss.ubx.tag", "imu.csv", "imu.csv.tag")

Damage = tuple[str, float, bytes]  # what, where (0 to 1), bytes
damages = st.lists(
    st.tuples(st.sampled_from(("change", "lose", "add")), st.floats(0, 1), st.binary(min_size=1, max_size=9)),
    min_size=1,
    max_size=4,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_walk(tmp_path_factory.mktemp("whole"))


@pytest.fixture(scope="module")
def clean(folder: Path) -> Recording:
    return read_recording(folder)


def spoil(content: bytes, damage: list[Damage]) -> bytes:
    """The content with each damage done to it."""
    for what, where, some in damage:
        at = round(where * (len(content) - 1)) if content else 0
        behind = at if what == "add" else at + len(some)
        content = content[:at] + (b"" if what == "lose" else some) + content[behind:]
    return content


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(FILES), damages)
def test_a_damaged_recording_is_read_or_refused_with_our_error(
    folder: Path, clean: Recording, tmp_path: Path, name: str, damage: list[Damage]
) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    (tmp_path / name).write_bytes(spoil((folder / name).read_bytes(), damage))
    try:
        recording = read_recording(tmp_path)
    except CanineError:  # no other
        return
    _is_the_same_or_counted(recording, clean)


def _is_the_same_or_counted(recording: Recording, clean: Recording) -> None:
    """All fixes of the clean recording are there, or some are counted; all that are there are right."""
    span = recording.fixes.t[-1] - recording.fixes.t[0]  # nothing tells of a fix beyond it, at 4 Hz
    lost = round(4 * float(span)) + 1 - len(recording.fixes.t)
    assert lost <= sum(recording.dropped.values())
    assert span >= clean.fixes.t[-1] - clean.fixes.t[0] - 2.0
    assert len(clean.imu_t) - len(recording.imu_t) <= sum(recording.dropped.values()) + 9  # a newline lost
    places = {tuple(row) for row in np.column_stack([clean.fixes.latitude, clean.fixes.longitude])}
    got = np.column_stack([recording.fixes.latitude, recording.fixes.longitude])
    assert {tuple(row) for row in got} <= places
    signals = sensor_signals(recording)
    for field in ("accel_x", "gyro_z", "pitch_meas", "heading_meas", "gps_north", "gps_east"):
        assert np.isfinite(getattr(signals, field)).all(), field


@pytest.mark.parametrize("seed", range(6))
def test_bytes_changed_in_the_real_walk_lose_the_frames_that_they_hit_alone(
    tmp_path: Path, seed: int
) -> None:
    if not WALK.is_dir():
        pytest.skip(f"no recording in {WALK}; set CANINE_DATA to the folder of walk_ublox_imu's parent")
    whole = read_recording(WALK)
    for path in WALK.iterdir():
        shutil.copy(path, tmp_path)
    [stream] = tmp_path.glob("*.ubx")
    dice = np.random.default_rng(seed)
    content = bytearray(stream.read_bytes())
    hits = dice.integers(0, len(content), 300)  # 536 frames of 100 bytes are 3.5 % of it
    for at in hits:
        content[at] ^= int(dice.integers(1, 256))
    stream.write_bytes(content)

    recording = read_recording(tmp_path)

    lost = len(whole.fixes.t) - len(recording.fixes.t)
    assert 0 < lost <= sum(recording.dropped.values()) < 30
    assert set(recording.fixes.latitude) <= set(whole.fixes.latitude)
