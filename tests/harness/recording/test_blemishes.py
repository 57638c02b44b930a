"""Recordings with ordinary blemishes: the damaged part is lost, nothing else, and it is counted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.recording.read import read_recording
from harness.recording.recording import FixStream, Recording, RecordingError, SampleStream
from harness.recording.signals import sensor_signals
from tests.harness.recording.walks import FIXES, fixes, frame, pvt, samples, write_walk


def at_fix_60(change: Callable[[bytes], bytes]) -> list[bytes]:
    """A walk's stream with what the receiver sent for fix 60 changed."""
    return [change(sent) if k == 60 else sent for k, sent in enumerate(fixes())]


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return read_recording(write_walk(tmp_path_factory.mktemp("clean")))


def furthest(recording: Recording, clean: Recording) -> float:
    """The greatest distance [m] between the two recordings' positions on the ticks."""
    got, expected = sensor_signals(recording), sensor_signals(clean)
    north, east = got.gps_north - expected.gps_north, got.gps_east - expected.gps_east
    return float(np.hypot(north, east).max())


def test_a_clean_walk_drops_nothing(clean: Recording) -> None:
    assert clean.dropped == {}
    assert (len(clean.fixes.t), len(clean.imu_t)) == (FIXES, 1550)
    np.testing.assert_allclose(np.diff(clean.fixes.t), 0.25, atol=1e-9)


MARKED_INVALID = "fixes whose position the receiver marks invalid"
STREAMS: dict[str, tuple[list[bytes], int, dict[str, int]]] = {  # stream, fixes left, what is counted
    "a false header that claims 8191 bytes": (
        at_fix_60(lambda sent: b"\xb5\x62\x01\x07\xff\x1f" + sent),
        FIXES,
        {"UBX frames of an impossible length": 1},
    ),
    "a false header with a possible length": (
        at_fix_60(lambda sent: b"\xb5\x62\x01\x07\x5c\x00" + sent),
        FIXES,
        {"UBX frames with a wrong checksum": 1},
    ),
    "stray sync bytes": (at_fix_60(lambda sent: b"\xb5\x62" + sent), FIXES, {}),
    "a poll": (at_fix_60(lambda sent: frame(7, b"") + sent), FIXES, {}),
    "NMEA with noise": (at_fix_60(lambda sent: b"$GNRMC,1\xfe\xff2,A*00\r\n" + sent), FIXES, {}),
    "a message of another class": (at_fix_60(lambda sent: frame(7, sent, of_class=5)), FIXES, {}),
    "a wrong byte": (
        at_fix_60(lambda sent: sent[:40] + bytes([sent[40] ^ 1]) + sent[41:]),
        FIXES - 1,
        {"UBX frames with a wrong checksum": 1},
    ),
    "a lost byte": (
        at_fix_60(lambda sent: sent[:40] + sent[41:]),
        FIXES - 1,
        {"UBX frames with a wrong checksum": 1},
    ),
    "the end cut off": (
        [*fixes()[:-1], fixes()[-1][:50]],
        FIXES - 1,
        {"UBX frames cut off by the end of the file": 1},
    ),
    "a fix twice": (at_fix_60(lambda sent: sent + sent), FIXES, {"fixes repeated": 1}),
    "two fixes swapped": (
        [*fixes()[:60], fixes()[61], fixes()[60], *fixes()[62:]],
        FIXES - 1,
        {"fixes out of order": 1},
    ),
    "a clock set late": (
        [pvt(k, late_ms=2000 * (k < 3)) for k in range(FIXES)],
        FIXES - 3,
        {"fixes whose time is not that of their arrival": 3},
    ),
    "invalid positions": (
        [pvt(k, flags3=int(50 <= k < 70), north_m=200.0 * (50 <= k < 70)) for k in range(FIXES)],
        FIXES - 20,
        {MARKED_INVALID: 20},
    ),
    "messages of 84 bytes": ([pvt(k, length=84, flags3=1) for k in range(FIXES)], FIXES, {}),
}


@pytest.mark.parametrize(("stream", "left", "dropped"), STREAMS.values(), ids=STREAMS.keys())
def test_a_damaged_stream_loses_the_damaged_fix_alone(
    tmp_path: Path, clean: Recording, stream: list[bytes], left: int, dropped: dict[str, int]
) -> None:
    recording = read_recording(write_walk(tmp_path, stream))
    assert len(recording.fixes.t) == left
    assert recording.dropped == dropped
    held_s = (FIXES - left) * 0.25  # for so long a position is held at 1.5 m/s
    start = clean.fixes.t[-1] - recording.fixes.t[-1]
    if start < 1e-6:
        assert furthest(recording, clean) <= 1.5 * held_s + 1e-6


def changed(i: int, change: Callable[[str], str]) -> list[str]:
    """A walk's lines with one changed."""
    return [change(line) if k == i else line for k, line in enumerate(samples())]


LINES: dict[str, tuple[list[str], int, dict[str, int]]] = {  # lines, samples lost, what is counted
    **{
        word: (
            [*samples()[:700], f"0,0,1,{word},0,0,19000", *samples()[701:]],
            1,
            {"IMU lines without seven numbers (the first: line 702)": 1},
        )
        for word in ("nan", "inf", "1e308", "", "oops", "1_0", "\udcff")
    },
    "a field too few": (
        changed(700, lambda line: line.partition(",")[2]),
        1,
        {"IMU lines without seven numbers (the first: line 702)": 1},
    ),
    "beyond any gyro": (
        changed(700, lambda line: line.replace(",0.01,", ",99999.0,")),
        1,
        {"IMU samples out of range": 1},
    ),
    "a millisecond twice": (
        changed(700, lambda line: line.replace("0.0001", "0.0002").replace(",19000", ",18980")),
        0,
        {},
    ),
    "a line twice": (
        [line for i, line in enumerate(samples()) for _ in range(2 if i == 700 else 1)],
        0,
        {"IMU samples repeated": 1},
    ),
    "two lines swapped": (
        [*samples()[:700], samples()[701], samples()[700], *samples()[702:]],
        1,
        {"IMU samples out of order": 1},
    ),
    "a tick too large at the end": (
        changed(len(samples()) - 1, lambda line: line.rpartition(",")[0] + ",9999999"),
        1,
        {"IMU samples with a time after their arrival": 1},
    ),
}


@pytest.mark.parametrize(("lines", "lost", "dropped"), LINES.values(), ids=LINES.keys())
def test_a_damaged_csv_loses_the_damaged_line_alone(
    tmp_path: Path, clean: Recording, lines: list[str], lost: int, dropped: dict[str, int]
) -> None:
    if "after their arrival" in str(dropped):
        write_walk(tmp_path)  # the tag of the clean walk, whose last line is a byte shorter
        content, tag = (tmp_path / "imu.csv").read_bytes(), (tmp_path / "imu.csv.tag").read_bytes()
        spoiled = content.replace(b",35980\n", b",99999\n")
        assert spoiled != content
        (tmp_path / "imu.csv").write_bytes(spoiled)
        assert (tmp_path / "imu.csv.tag").read_bytes() == tag
    else:
        write_walk(tmp_path, lines=lines)
    recording = read_recording(tmp_path)
    assert len(recording.imu_t) == len(clean.imu_t) - lost
    assert recording.dropped == dropped
    got, expected = sensor_signals(recording), sensor_signals(clean)
    for name in ("accel_y", "gyro_z", "pitch_meas"):  # one sample of 1550 held for 20 ms longer
        np.testing.assert_allclose(getattr(got, name), getattr(expected, name), atol=0.01)


@pytest.mark.parametrize(
    ("far", "lost"),
    [({60}, 1), ({0}, 1), ({FIXES - 1}, 1), ({60, 61, 62}, 3), ({30, 31, 90}, 3)],
    ids=["one", "the first", "the last", "three in a row", "two places"],
)
def test_fixes_where_nothing_moves_so_fast_are_dropped_and_counted(
    tmp_path: Path, clean: Recording, far: set[int], lost: int
) -> None:
    # given a receiver that states some fixes 1 km off
    stream = [pvt(k, north_m=1000.0 * (k in far)) for k in range(FIXES)]
    # when
    recording = read_recording(write_walk(tmp_path, stream))
    # then they alone are lost
    assert len(recording.fixes.t) == len(clean.fixes.t) - lost
    assert recording.dropped == {"fixes where nothing moves so fast": lost}
    assert np.ptp(recording.fixes.latitude) < 1e-5


def test_positions_that_jump_within_their_accuracy_are_kept(tmp_path: Path, clean: Recording) -> None:
    # given a fix 1.5 m off, whose neighbours state 0.8 m and which is 0.25 s from them
    stream = [pvt(k, north_m=1.5 * (k == 60)) for k in range(FIXES)]
    assert len(read_recording(write_walk(tmp_path, stream)).fixes.t) == len(clean.fixes.t)


def test_positions_that_jump_all_the_time_are_refused() -> None:
    rows = np.column_stack(
        [np.arange(2500.0), np.tile([0.0, 1.0], 1250), np.zeros((2500, 4)), np.ones((2500, 2))]
    )
    stream = FixStream("gps.csv", rows, np.arange(2500))
    with pytest.raises(RecordingError, match=r"gps\.csv: 2499 times the position jumps .* above 100 m/s"):
        stream.in_order()


@pytest.mark.parametrize(
    ("column", "value"), [(4, 101.0), (5, -101.0), (6, 0.0), (6, -1.0), (7, 0.0), (7, 2e6), (6, np.inf)]
)
def test_a_fix_with_an_impossible_speed_or_accuracy_is_dropped(column: int, value: float) -> None:
    rows = np.column_stack([np.arange(5.0), np.zeros((5, 5)), np.ones((5, 2))])
    rows[2, column] = value
    assert FixStream("gps.csv", rows, np.arange(5)).in_order().dropped == {"fixes out of range": 1}


@pytest.mark.parametrize(("value", "lost"), [(199.0, 0), (201.0, 1)])
def test_a_sample_beyond_200_m_s2_or_100_rad_s_is_dropped(value: float, lost: int) -> None:
    force, rate = np.zeros((3, 3)), np.zeros((3, 3))
    force[1, 1], rate[1, 2] = value, value / 2
    stream = SampleStream("imu.csv", np.arange(3.0), force, np.zeros((3, 3)), np.arange(3))
    assert sum(stream.in_order().dropped.values()) == lost
    stream = SampleStream("imu.csv", np.arange(3.0), np.zeros((3, 3)), rate, np.arange(3))
    assert sum(stream.in_order().dropped.values()) == lost


def test_a_tag_that_lost_bytes_does_not_shift_the_clocks(tmp_path: Path, clean: Recording) -> None:
    # given a time tag that lost 21 pairs, 0.42 s: the time of the first goes with the size of the last
    tag = write_walk(tmp_path) / "imu.csv.tag"
    content = tag.read_bytes()
    pairs = np.frombuffer(content, "<u4", offset=76).reshape(-1, 2).copy()
    pairs[721, 0] = pairs[700, 0]
    tag.write_bytes(content[:76] + np.delete(pairs, slice(700, 721), axis=0).tobytes())
    # when
    recording = read_recording(tmp_path)
    # then the lines that seem to arrive before their time are dropped, and the clocks are tied as before
    assert 19 <= recording.dropped["IMU samples with a time after their arrival"] <= 21
    shift = float(recording.imu_t[0] - clean.imu_t[0])  # from the first fix, of one each 0.25 s
    assert abs((shift + 0.125) % 0.25 - 0.125) <= 0.021


def test_a_clock_that_was_set_amid_the_recording_is_refused(tmp_path: Path) -> None:
    stream = [pvt(k, late_ms=2000 * (k < FIXES // 2)) for k in range(FIXES)]
    folder = write_walk(tmp_path, stream)
    with pytest.raises(RecordingError, match=r"fixes arrive -0\.950 s after their epoch"):
        read_recording(folder)


@pytest.mark.parametrize("pair", ["<II", "<IQ"])
def test_tags_with_positions_of_4_and_of_8_bytes_are_read(
    tmp_path: Path, clean: Recording, pair: str
) -> None:
    recording = read_recording(write_walk(tmp_path, pair=pair))
    np.testing.assert_array_equal(recording.imu_t, clean.imu_t)
    np.testing.assert_array_equal(recording.fixes.t, clean.fixes.t)


@pytest.mark.parametrize("longitude", [1_799_999_000, -1_799_999_900, 1_800_000_000])
@pytest.mark.parametrize("latitude", [100_000_000, -100_000_000])
def test_a_walk_over_the_antimeridian_is_the_same_walk(
    tmp_path: Path, clean: Recording, latitude: int, longitude: int
) -> None:
    stream = [pvt(k, origin=(latitude, longitude)) for k in range(FIXES)]
    recording = read_recording(write_walk(tmp_path, stream))
    if longitude == 1_799_999_000:
        assert np.ptp(recording.fixes.longitude) > 6  # it does cross
    assert furthest(recording, clean) < 0.02


def test_a_tag_whose_start_is_damaged_is_refused_naming_the_byte(tmp_path: Path) -> None:
    tag = write_walk(tmp_path) / "gnss.ubx.tag"
    content = tag.read_bytes()
    tag.write_bytes(content[:68] + b"\xff" * 8 + content[76:])
    with pytest.raises(RecordingError, match=r"gnss\.ubx\.tag: got a start with nan s .* at byte 68"):
        read_recording(tmp_path)
