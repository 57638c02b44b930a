"""A real walk with a u-blox receiver and an IMU, and small made-up folders with every fault."""

import dataclasses
import os
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pyubx2 import GET, UBXMessage

from harness.recording.read import read_recording
from harness.recording.recording import WEEK_S, Recording, RecordingError
from harness.recording.signals import SensorSignals, sensor_signals
from harness.recording.tags import GPS_EPOCH_S

PROJECT = Path(__file__).resolve().parents[3]
DATA = Path(os.environ.get("CANINE_DATA", PROJECT.parent / "shared" / "data"))
WALK = DATA / "walk_ublox_imu" if (DATA / "walk_ublox_imu").is_dir() else DATA

TICK_S = 0.04
TOW = 415_800.0  # s, start of the made-up recordings in GPS week 2381


# --- the real walk ---


@pytest.fixture(scope="session")
def walk() -> Recording:
    if not any(WALK.glob("*.ubx")):
        pytest.skip(f"no recording in {WALK}; set CANINE_DATA to the folder of walk_ublox_imu")
    return read_recording(WALK)


@pytest.fixture(scope="session")
def whole(walk: Recording) -> SensorSignals:
    return sensor_signals(walk)


def test_walk_has_536_fixes_at_4_hz_and_no_checksum_error(walk: Recording) -> None:
    assert len(walk.fixes.t) == 536
    np.testing.assert_allclose(np.diff(walk.fixes.t), 0.25, atol=1e-9)
    assert walk.dropped == {}


def test_walk_has_its_whole_imu_at_152_hz(walk: Recording) -> None:
    # 20457 lines, the cut first and last left out, over the 134.252 s between ticks 3326345 and 3460597.
    assert len(walk.imu_t) == 20455
    assert walk.imu_t[-1] - walk.imu_t[0] == pytest.approx(134.252, abs=1e-6)


def test_walk_positions_and_velocities_agree_with_rtklib(walk: Recording) -> None:
    table = [line.split() for line in next(WALK.glob("*.pos")).read_text().splitlines() if line[0] != "%"]
    assert len(table) == len(walk.fixes.t)
    latitude, longitude, height, north, east = (
        np.array([float(row[i]) for row in table]) for i in (2, 3, 4, 15, 16)
    )
    assert np.ptp(height) < 5  # above the geoid there, so only the horizontal is compared
    metres = 6_371_000 * np.radians(1.0)
    assert np.max(np.abs(np.degrees(walk.fixes.latitude) - latitude)) * metres < 0.02
    assert np.max(np.abs(np.degrees(walk.fixes.longitude) - longitude)) * metres < 0.02
    assert np.max(np.abs(walk.fixes.velocity_north - north)) < 0.002
    assert np.max(np.abs(walk.fixes.velocity_east - east)) < 0.002


def test_walk_local_positions_agree_with_the_integrated_velocity(whole: SensorSignals) -> None:
    at = whole.reference_fix & (whole.t > 12) & (whole.t < 100)
    speed, course = whole.reference_speed[at], whole.reference_course[at]
    for position, velocity in (
        (whole.reference_north[at], speed * np.cos(course)),
        (whole.reference_east[at], speed * np.sin(course)),
    ):
        travelled = np.sum((velocity[1:] + velocity[:-1]) / 2) * 0.25
        assert position[-1] - position[0] == pytest.approx(travelled, abs=1.0)


def test_walk_at_rest_feels_gravity_upwards(whole: SensorSignals) -> None:
    rest = whole.t < 8
    force = [float(np.mean(axis[rest])) for axis in (whole.accel_x, whole.accel_y, whole.accel_z)]
    assert np.linalg.norm(force) == pytest.approx(9.8, abs=0.15)  # its scale is 1.2 % high
    assert force[2] == pytest.approx(-9.8, abs=0.15)
    assert np.degrees(np.abs(whole.pitch_meas[rest]).mean()) < 3


def _rates(s: SensorSignals, lag: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Between moving fixes: the course's rate, the yaw rate and lateral force `lag` s earlier."""
    fix = np.flatnonzero(s.reference_fix & (s.reference_speed > 0.5))
    pairs = np.diff(s.t[fix]) < 0.3
    elapsed = np.diff(s.t[fix])[pairs]
    course = np.diff(np.unwrap(s.reference_course[fix]))[pairs] / elapsed
    means = []
    for signal in (s.gyro_z, s.accel_y + 9.81 * np.sin(s.roll_meas)):
        summed = np.interp(s.t[fix] - lag, s.t, np.cumsum(signal) * TICK_S)
        means.append(np.diff(summed)[pairs] / elapsed)
    return course, means[0], means[1]


def test_walk_clocks_and_mounting_are_right(whole: SensorSignals) -> None:
    """A unit held ahead of its bearer swings out: its course leads its yaw, but not its lateral force."""
    lags = np.arange(-2, 2.01, 0.1)
    yaw, lateral = np.array(
        [[np.corrcoef(course, gyro)[0, 1], np.corrcoef(course, force)[0, 1]]
         for course, gyro, force in (_rates(whole, lag) for lag in lags)]
    ).T  # fmt: skip
    assert yaw.max() > 0.8
    assert abs(lags[yaw.argmax()]) <= 0.4
    assert lateral.max() > 0.7
    assert abs(lags[lateral.argmax()]) <= 0.2


def _inputs(s: SensorSignals) -> dict[str, np.ndarray]:
    values = {field.name: np.asarray(getattr(s, field.name)) for field in dataclasses.fields(s)}
    return {name: value for name, value in values.items() if not name.startswith("reference_")}


def test_walk_signals_use_no_fix_inside_an_outage(walk: Recording) -> None:
    window = (50.0, 60.0)
    inside = (walk.fixes.t >= window[0]) & (walk.fixes.t <= window[1])
    assert inside.sum() == 41
    noise = np.random.default_rng(1).normal(size=inside.sum())
    garbage = {
        name: np.where(inside, 0.0, getattr(walk.fixes, name))
        for name in ("latitude", "longitude", "height", "velocity_north", "velocity_east", "h_acc", "s_acc")
    }
    garbage["velocity_east"][inside] = 5 + noise
    other = dataclasses.replace(walk, fixes=dataclasses.replace(walk.fixes, **garbage))

    expected, got = _inputs(sensor_signals(walk, [window])), _inputs(sensor_signals(other, [window]))

    for name, values in expected.items():
        assert np.array_equal(got[name], values), name
    t, fix = expected["t"], expected["gps_fix"]
    assert not fix[(t >= 50.0) & (t <= 60.0)].any()
    assert fix.sum() == 490
    assert not np.array_equal(_inputs(sensor_signals(walk))["heading_meas"], expected["heading_meas"])


def test_walk_signals_are_causal(walk: Recording) -> None:
    # given a recording cut short, to be quick, and the same with other motion and fixes from 20 s on
    imu, fix = walk.imu_t < 25, walk.fixes.t < 25
    fixes = dataclasses.replace(
        walk.fixes, **{f.name: getattr(walk.fixes, f.name)[fix] for f in dataclasses.fields(walk.fixes)}
    )
    short = dataclasses.replace(
        walk, fixes=fixes, imu_t=walk.imu_t[imu], specific_force=walk.specific_force[imu], rate=walk.rate[imu]
    )
    later = short.imu_t > 20
    changed = dataclasses.replace(
        short,
        specific_force=np.where(later[:, None], short.specific_force + 3, short.specific_force),
        rate=np.where(later[:, None], short.rate - 1, short.rate),
        fixes=dataclasses.replace(
            fixes, velocity_north=np.where(fixes.t > 20, fixes.velocity_north + 2, fixes.velocity_north)
        ),
    )

    expected, got = _inputs(sensor_signals(short)), _inputs(sensor_signals(changed))

    before = expected["t"] <= 20
    for name in expected.keys() - {"origin_latitude", "origin_longitude"}:
        assert np.array_equal(got[name][before], expected[name][before]), name
    for name in ("accel_x", "gyro_z", "pitch_meas", "heading_meas", "gps_speed"):
        assert not np.array_equal(got[name][~before], expected[name][~before]), name


def test_walk_refuses_an_outage_that_hides_the_origin(walk: Recording) -> None:
    with pytest.raises(RecordingError, match=r"outage from 0\.0 to 10\.0 s: expected 0 < start <= end"):
        sensor_signals(walk, [(0.0, 10.0)])


# --- made-up folders ---


def _write_tag(path: Path, arrivals: list[tuple[float, int]], start: float = TOW) -> None:
    seconds = GPS_EPOCH_S + 2381 * WEEK_S + int(start)
    header = b"TIMETAG RTKLIB".ljust(60, b"\0") + struct.pack("<IId", 0, seconds, start % 1)
    pairs = b"".join(struct.pack("<II", round((at - start) * 1000), size) for at, size in arrivals)
    path.with_name(path.name + ".tag").write_bytes(header + pairs)


def _write_ubx(folder: Path, times: list[float], fix_type: int = 3) -> None:
    content, arrivals = b"", []
    for t in times:
        message = UBXMessage(
            "NAV", "NAV-PVT", GET, iTOW=round(t * 1000), fixType=fix_type, gnssFixOk=int(fix_type > 0),
            validTime=1, lat=40.0, lon=-105.0, height=1_580_000, velN=1000, velE=0, hAcc=14, sAcc=70,
        )  # fmt: skip
        content += message.serialize()
        arrivals.append((t + 0.05, len(content)))
    (folder / "gnss.ubx").write_bytes(content)
    _write_tag(folder / "gnss.ubx", arrivals)


def _write_imu(folder: Path, times: list[float], newline: str = "\n") -> None:
    lines, arrivals = ["7,1.0,0.0,0.0,0.0,0" + newline], []
    for t in times:
        lines.append(f"0.01,0.02,1.0,0.1,0.2,0.3,{round((t - TOW) * 1000) + 5000}{newline}")
        arrivals.append((t, sum(map(len, lines))))
    lines.append("0.01,0.")
    arrivals.append((times[-1], sum(map(len, lines))))
    (folder / "imu.csv").write_bytes("".join(lines).encode())
    _write_tag(folder / "imu.csv", arrivals)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    _write_ubx(tmp_path, [TOW + 0.25 * i for i in range(1, 121)])
    _write_imu(tmp_path, [TOW + 0.1 + 0.02 * i for i in range(1500)])
    return tmp_path


def test_a_made_up_folder_is_read(folder: Path) -> None:
    recording = read_recording(folder)
    assert recording.fixes.t[0] == 0
    assert recording.imu_t[0] == pytest.approx(-0.15, abs=1e-6)
    np.testing.assert_allclose(recording.specific_force[0], np.array([-0.02, -0.01, -1.0]) * 9.80665)
    np.testing.assert_allclose(np.degrees(recording.rate[0]), [-0.2, -0.1, -0.3])


def test_lines_that_lost_their_carriage_returns_after_tagging_are_read(folder: Path) -> None:
    expected = read_recording(folder)
    _write_imu(folder, [TOW + 0.1 + 0.02 * i for i in range(1500)], newline="\r\n")
    tagged = read_recording(folder)
    (folder / "imu.csv").write_bytes((folder / "imu.csv").read_bytes().replace(b"\r", b""))
    stripped = read_recording(folder)
    np.testing.assert_array_equal(tagged.imu_t, expected.imu_t)
    np.testing.assert_array_equal(stripped.imu_t, expected.imu_t)


def test_fixes_are_read_from_posllh_with_velned(folder: Path) -> None:
    content, arrivals = b"", []
    for i in range(1, 121):
        tow = round((TOW + 0.25 * i) * 1000)
        position = UBXMessage(
            "NAV", "NAV-POSLLH", GET, iTOW=tow, lat=40.0, lon=-105.0, height=1_580_000, hAcc=3500
        )
        velocity = UBXMessage("NAV", "NAV-VELNED", GET, iTOW=tow, velN=100, velE=-50, sAcc=30)
        content += position.serialize() + velocity.serialize()
        arrivals.append((tow / 1000 + 0.05, len(content)))
    (folder / "gnss.ubx").write_bytes(content)
    _write_tag(folder / "gnss.ubx", arrivals)

    fixes = read_recording(folder).fixes

    last = [float(getattr(fixes, field.name)[-1]) for field in dataclasses.fields(fixes)]
    np.testing.assert_allclose(last, [29.75, np.radians(40), np.radians(-105), 1580, 1.0, -0.5, 3.5, 0.3])


def test_a_corrupt_frame_is_dropped_and_counted(folder: Path) -> None:
    content = bytearray((folder / "gnss.ubx").read_bytes())
    content[150] ^= 0xFF  # inside the payload of the second message of 100 bytes
    (folder / "gnss.ubx").write_bytes(content)
    recording = read_recording(folder)
    assert recording.dropped == {"UBX frames with a wrong checksum": 1}
    assert len(recording.fixes.t) == 119


def test_fixes_fall_on_the_first_tick_at_or_after_them(folder: Path) -> None:
    s = sensor_signals(read_recording(folder))
    assert np.flatnonzero(s.gps_fix)[:5].tolist() == [0, 7, 13, 19, 25]  # 0, 0.25, 0.5, 0.75, 1.0 s


def test_positions_are_metres_on_the_ellipsoid_at_the_height_of_the_origin(folder: Path) -> None:
    # At 40 deg a degree of latitude is 111.035 km of WGS84, one of longitude 85.394 km; 1580 m higher
    # they are longer by 1580 m * 1 deg = 27.58 m and by 1580 m * cos(40 deg) * 1 deg = 21.12 m.
    recording = read_recording(folder)
    latitude, longitude = recording.fixes.latitude.copy(), recording.fixes.longitude.copy()
    latitude[-1] += np.radians(1e-3)
    longitude[-1] += np.radians(1e-3)
    fixes = dataclasses.replace(recording.fixes, latitude=latitude, longitude=longitude)

    s = sensor_signals(dataclasses.replace(recording, fixes=fixes))

    assert (s.gps_north[0], s.gps_east[0]) == (0, 0)
    assert s.gps_north[-1] == pytest.approx(111.0626, abs=0.002)
    assert s.gps_east[-1] == pytest.approx(85.4151, abs=0.002)


def _cut_lines(folder: Path) -> None:
    lines = (folder / "imu.csv").read_bytes().split(b"\n")
    lines[1:800] = [b"0.01,oops"] * 799
    (folder / "imu.csv").write_bytes(b"\n".join(lines))


def _shorten_tag(folder: Path) -> None:
    tag = folder / "imu.csv.tag"
    tag.write_bytes(tag.read_bytes()[:-3])


def _shorten_csv(folder: Path) -> None:
    (folder / "imu.csv").write_bytes((folder / "imu.csv").read_bytes()[:30000])


def _shift_gps(folder: Path) -> None:
    _write_ubx(folder, [TOW + 25 + 0.25 * i for i in range(120)])


def _offset_computer_clock(folder: Path) -> None:
    tag = folder / "gnss.ubx.tag"
    content = bytearray(tag.read_bytes())
    content[64:68] = struct.pack("<I", struct.unpack_from("<I", content, 64)[0] - 18)
    tag.write_bytes(content)


def _drift(folder: Path) -> None:
    _write_imu(folder, [TOW + 0.1 + 0.02 * i for i in range(1500)])
    size = np.frombuffer((folder / "imu.csv.tag").read_bytes(), "<u4", offset=76)[1::2]
    _write_tag(folder / "imu.csv", [(TOW + 0.1 + 0.021 * i, int(n)) for i, n in enumerate(size)])


WRONG: dict[str, tuple[Callable[[Path], object], str]] = {
    "no ubx": (lambda f: (f / "gnss.ubx").unlink(), r"got none for \*\.ubx, expected one file"),
    "two csv": (
        lambda f: (f / "imu2.csv").touch(),
        r"got imu\.csv, imu2\.csv for imu\*\.csv, expected one file",
    ),
    "no tag": (lambda f: (f / "imu.csv.tag").unlink(), r"imu\.csv\.tag: missing; expected the time tag"),
    "empty": (lambda f: (f / "imu.csv").write_bytes(b""), r"imu\.csv: got an empty file"),
    "one line": (lambda f: (f / "imu.csv").write_bytes(b"1,2"), r"imu\.csv: got 1 lines, expected samples"),
    "no csv": (_cut_lines, r"imu\.csv, line 2: got '0\.01,oops', expected the seven numbers"),
    "truncated tag": (_shorten_tag, r"imu\.csv\.tag: got \d+ bytes, expected TIMETAG RTKLIB.*truncated"),
    "truncated csv": (_shorten_csv, r"imu\.csv: got 30000 bytes, expected \d+ by its tag"),
    "no fixes": (
        lambda f: _write_ubx(f, [TOW + 1], fix_type=0),
        r"gnss\.ubx: got no fixes \(1 epochs without a three-dimensional fix\), expected NAV-PVT",
    ),
    "overlap": (_shift_gps, r"gnss\.ubx and imu\.csv overlap by 5\.1 s, expected at least 20\.0 s"),
    "computer in UTC": (
        _offset_computer_clock,
        r"fixes arrive -17\.950 s after their epoch, expected 0 to 0\.5 s",
    ),
    "drift": (_drift, r"clock drifts 0\.7\d+ s against the computer's, expected at most 0\.05 s"),
}


@pytest.mark.parametrize(("spoil", "message"), WRONG.values(), ids=WRONG.keys())
def test_a_folder_with_a_fault_is_refused_with_its_reason(
    folder: Path, spoil: Callable[[Path], object], message: str
) -> None:
    spoil(folder)
    with pytest.raises(RecordingError, match=message):
        read_recording(folder)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="nowhere: no such folder; expected the folder of a recording"):
        read_recording(tmp_path / "nowhere")
