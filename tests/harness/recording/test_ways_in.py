"""Each way to keep a recording gives the same walk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.recording.esf import FORCES, RATES, decode_meas, decode_raw, esf_samples
from harness.recording.find import find_parts, recordings_below
from harness.recording.mounting import euler_angles, rotation
from harness.recording.pos import read_pos
from harness.recording.read import read_recording
from harness.recording.recording import Recording, RecordingError
from harness.recording.ubx import Frame
from harness.recording.xsens import find_samples, read_xsens
from tests.harness.recording import made_up
from tests.harness.recording.made_up import DURATION, TOW, Array, force_and_rate

Z_UP = np.diag([1.0, -1.0, -1.0])
MTDATA = bytes.fromhex(
    "faff32323e800000bdcccccd411cf5c33c23d70abca3d70a3cf5c28f3e4ccccd"
    "00000000bf4ccccd3fc00000c00000004234000004d2d4"
)  # 0.25, -0.1, 9.81 m/s2; 0.01, -0.02, 0.03 rad/s; counter 1234
POS_HEADER = (
    "% program   : RTKLIB\n"
    "%  GPST  latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) "
    "age(s) ratio"
)
POS_VELOCITY = " vn(m/s) ve(m/s) vu(m/s) sdvn sdve sdvu sdvne sdveu sdvun"


def assert_is_the_walk(recording: Recording, clock: float, rounding: float = 2e-3) -> None:
    """The walk's motion, on a clock that is right to `clock` [s] and in numbers that are rounded."""
    fixes = recording.fixes
    start = fixes.t[0] - 0.25  # of the walk on the clock of the recording, whose first fix was at 0.25 s
    inner = (recording.imu_t > start + 1) & (recording.imu_t < start + DURATION - 1)
    force, rate = force_and_rate(recording.imu_t[inner] - start)
    # rates change by at most 0.35 rad/s2, forces by at most 2.1 m/s3
    np.testing.assert_allclose(recording.rate[inner], rate, atol=0.35 * clock + rounding)
    np.testing.assert_allclose(recording.specific_force[inner], force, atol=2.1 * clock + rounding)
    north, east = np.transpose([made_up.velocity(float(t - start)) for t in fixes.t])
    np.testing.assert_allclose(fixes.velocity_north, north, atol=2e-3)
    np.testing.assert_allclose(fixes.velocity_east, east, atol=2e-3)


@pytest.mark.parametrize("tag_unit", [1e-3, 1 / 25_600])
def test_a_u_blox_stream_with_esf_raw_is_read_across_the_wrap_of_its_tags(
    tmp_path: Path, tag_unit: float
) -> None:
    path = tmp_path / "f9r.ubx"
    path.write_bytes(made_up.stream(Z_UP, tag_unit, first_tag=2**32 - 1000))
    recording = read_recording(path)
    assert len(recording.imu_t) == 6000
    assert_is_the_walk(recording, clock=0.06)


def test_a_u_blox_stream_with_esf_meas_is_read(tmp_path: Path) -> None:
    times = np.arange(0, DURATION, 0.02)
    force, rate = force_and_rate(times)
    events = [(t + 0.04, made_up.pvt(float(t))) for t in made_up.fix_times()]
    events += [
        (t, made_up.esf_meas(round(t * 1000) + 77, f @ Z_UP, w @ Z_UP))
        for t, f, w in zip(times, force, rate, strict=True)
    ]
    (tmp_path / "gnss.ubx").write_bytes(b"".join(m for _, m in sorted(events, key=lambda event: event[0])))
    recording = read_recording(tmp_path)  # a folder with one stream
    assert len(recording.imu_t) == 3000
    assert_is_the_walk(recording, clock=0.06)


def test_measurements_of_esf_are_signed_numbers_of_24_bits() -> None:
    # given -1.5 deg/s about z (type 5) and 9.75 m/s2 along z (type 18), by hand
    raw = bytes(4) + (0x05FFE800).to_bytes(4, "little") + (7).to_bytes(4, "little")
    raw += (0x12002700).to_bytes(4, "little") + (8).to_bytes(4, "little")
    assert decode_raw(raw) == [(5, -6144, 7), (18, 9984, 8)]  # -1.5 * 4096, 9.75 * 1024
    meas = (9).to_bytes(4, "little") + (2 << 11).to_bytes(2, "little") + bytes(2) + raw[4:8] + raw[12:16]
    assert decode_meas(meas) == [(5, -6144, 9), (18, 9984, 9)]
    # and a length that is none is no measurement
    assert decode_raw(raw[:-1]) == decode_meas(meas[:-1]) == decode_meas(meas + bytes(4)) == []


@pytest.mark.parametrize(("apart", "kept"), [(14, 3), (16, 2)])
def test_a_rate_needs_a_force_within_one_and_a_half_of_their_gaps(apart: int, kept: int) -> None:
    # given forces at the tags 0, 10, 20, and rates at 0, 10 and some ticks behind the last force
    def measured(types: tuple[int, ...], tag: int) -> bytes:
        return b"".join((t << 24).to_bytes(4, "little") + tag.to_bytes(4, "little") for t in types)

    content = [measured(FORCES, tag) for tag in (0, 10, 20)]
    content += [measured(RATES, tag) for tag in (0, 10, 20 + apart)]
    # when
    samples = esf_samples("f9r.ubx", [Frame(b"\x10\x03", bytes(4) + b"".join(content), 0)])
    # then the far one is dropped and counted
    assert samples is not None
    assert len(samples.clock) == kept
    assert samples.dropped.get("ESF rates without a force beside them", 0) == 3 - kept


def test_a_sensor_clock_of_an_unknown_unit_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "f9r.ubx"
    path.write_bytes(made_up.stream(Z_UP, tag_unit=1e-4))
    with pytest.raises(RecordingError, match=r"ticks of 100\.1 us, expected 1000 or 39\.0625 us"):
        read_recording(path)


def test_a_stream_without_inertial_samples_says_what_to_switch_on(tmp_path: Path) -> None:
    path = tmp_path / "gnss.ubx"
    path.write_bytes(b"".join(made_up.pvt(float(t)) for t in made_up.fix_times()))
    with pytest.raises(RecordingError, match="got no inertial samples, expected UBX-ESF-RAW or UBX-ESF-MEAS"):
        read_recording(path)


def _mt_pieces(rate_hz: int = 50) -> list[tuple[float, bytes]]:
    times = np.arange(0, DURATION, 1 / rate_hz)
    force, rate = force_and_rate(times)
    return [
        (float(t) + 0.01, made_up.mtdata(f @ Z_UP, w @ Z_UP, 65_000 + k))
        for k, (t, f, w) in enumerate(zip(times, force, rate, strict=True))
    ]


def test_an_xsens_log_with_time_tags_is_read(tmp_path: Path) -> None:
    made_up.write_ubx(tmp_path)
    made_up.write_with_tag(tmp_path / "mt.mtb", _mt_pieces())
    recording = read_recording(tmp_path)
    assert len(recording.imu_t) == 3000
    assert_is_the_walk(recording, clock=0.012)


def test_an_mtdata_has_the_values_of_the_units_manual(tmp_path: Path) -> None:
    (tmp_path / "mt.mtb").write_bytes(MTDATA)
    samples = read_xsens(tmp_path / "mt.mtb", rate_hz=100)
    np.testing.assert_allclose(samples.specific_force, [[0.25, -0.1, 9.81]], rtol=1e-6)
    np.testing.assert_allclose(samples.rate, [[0.01, -0.02, 0.03]], rtol=1e-6)
    # roll 1.5, pitch -2 and yaw 45 deg of forward, left, up: nose up, and 45 deg to the left of north
    assert samples.attitude is not None
    angles = np.degrees(euler_angles(samples.attitude @ Z_UP.T))
    np.testing.assert_allclose(angles, [[1.5, 2.0, -45.0]], atol=1e-5)
    assert samples.ends.tolist() == [len(MTDATA)]


def test_damaged_mtdata_are_lost_and_nothing_else() -> None:
    # given a false header, a damaged sample, one of another mode, a good one, and one that is cut
    damaged = MTDATA[:20] + bytes([MTDATA[20] ^ 1]) + MTDATA[21:]
    other = b"\xfa\xff\x32\x04abcd"
    other += bytes([-sum(other[1:]) % 256])
    ends, dropped = find_samples(b"\xfa\xff\x32\x32" + MTDATA + damaged + other + MTDATA + MTDATA[:30])
    # then the good ones are found
    assert ends == [4 + 55, 4 + 55 + 55 + len(other) + 55]
    assert dropped == {
        "MTData with a wrong checksum": 2, "MTData of another mode": 1, "MTData cut at the end": 1,
    }  # fmt: skip


def test_samples_that_an_mt_lost_repeated_or_sent_after_a_restart_are_counted(tmp_path: Path) -> None:
    zero = np.zeros(3)
    counters = [65_534, 65_535, 0, 0, 3, 4, 1, 2]
    (tmp_path / "mt.mtb").write_bytes(b"".join(made_up.mtdata(zero, zero, k) for k in counters))
    samples = read_xsens(tmp_path / "mt.mtb", rate_hz=100)
    np.testing.assert_allclose(samples.clock, [0, 0.01, 0.02, 0.05, 0.06])
    assert samples.dropped == {
        "MTData whose counter did not move": 1,
        "MTData after a restart of the unit": 2,
        "MTData lost, by the counter": 2,
    }


def pos_lines(velocities: bool) -> list[str]:
    """The walk's fixes as RTKLIB writes a solution."""
    lines = []
    for t in made_up.fix_times():
        (latitude, longitude), (north, east) = made_up.place(float(t)).values(), made_up.velocity(float(t))
        second = t + 30 * 60  # 415800 s is Thursday, 19:30
        line = (
            f"2025/08/28 19:{int(second // 60):02d}:{second % 60:06.3f} "
            f"{latitude:.9f} {longitude:.9f} {made_up.HEIGHT} 2 12 0.03 0.04 0.1 0 0 0 0.5 3.0"
        )
        lines.append(line + f" {north:.6f} {east:.6f} 0 0.06 0.08 0.1 0 0 0" * velocities)
    return lines


def _write_imu_csv(folder: Path, name: str = "imu.csv") -> None:
    """As the rig writes it: its axes have roll, pitch, yaw = 180, 0, -90 deg in the body."""
    times = np.arange(0, DURATION, 0.01)
    force, rate = (values @ rotation(180, 0, -90) for values in force_and_rate(times))
    pieces = [(0.0, b"cut\n")]
    for t, f, w in zip(times, force / made_up.G, np.degrees(rate), strict=True):
        numbers = ",".join(f"{value:.6f}" for value in (*f, *w))
        pieces.append((float(t) + 0.004, f"{numbers},{round(t * 1000) + 5000}\n".encode()))
    made_up.write_with_tag(folder / name, [*pieces, (DURATION, b"cut")])


def test_a_pos_with_an_imu_csv_is_read(tmp_path: Path) -> None:
    (tmp_path / "walk.pos").write_text("\n".join([POS_HEADER + POS_VELOCITY, *pos_lines(velocities=True)]))
    _write_imu_csv(tmp_path)
    recording = read_recording(tmp_path)
    assert_is_the_walk(recording, clock=0.006)
    np.testing.assert_allclose(recording.fixes.h_acc, 0.05)  # of 3 and 4 cm
    np.testing.assert_allclose(recording.fixes.s_acc, 0.1)  # of 6 and 8 cm/s


def test_a_pos_without_velocities_has_those_of_its_positions(tmp_path: Path) -> None:
    lines = pos_lines(velocities=False)
    lines.insert(3, "2025/08/28 19:30:oops")
    lines.insert(9, lines[8].replace(f"{made_up.HEIGHT} 2 12", f"{made_up.HEIGHT} 0 0"))
    (tmp_path / "walk.pos").write_text("\n".join([POS_HEADER, *lines]))
    _write_imu_csv(tmp_path)
    parts = find_parts(tmp_path)
    fixes, _ = parts.streams()
    # then each but the first has the mean velocity since the one before it, and an accuracy that is said
    assert len(fixes.rows) == len(made_up.fix_times()) - 1
    north, east = np.transpose([made_up.velocity(t - 0.125) for t in fixes.rows[:, 0] - TOW])
    np.testing.assert_allclose(fixes.rows[:, 4], north, atol=0.02)
    np.testing.assert_allclose(fixes.rows[:, 5], east, atol=0.02)
    np.testing.assert_allclose(fixes.rows[:, 7], 0.05 * 2**0.5 / 0.25)
    assert fixes.kinds == {"float": len(made_up.fix_times())}
    assert fixes.dropped == {
        "lines of the solution that cannot be read": 1,
        "epochs without a solution": 1,
        "fixes without one before them to take a velocity from": 1,
    }


@pytest.mark.parametrize(
    ("header", "got"),
    [("", "without names"), (POS_HEADER.replace("latitude(deg)", "x-ecef(m)"), "GPST x-ecef")],
    ids=["none", "ecef"],
)
def test_a_pos_of_another_format_is_refused_with_what_to_choose(
    tmp_path: Path, header: str, got: str
) -> None:
    (tmp_path / "walk.pos").write_text("\n".join([header, *pos_lines(velocities=False)]))
    _write_imu_csv(tmp_path)
    with pytest.raises(RecordingError, match=rf"got columns {got}.*expected GPST or UTC, latitude\(deg\)"):
        read_recording(tmp_path)


def test_recordings_below_a_folder_are_found(tmp_path: Path) -> None:
    for name in ("b", "a/inner"):
        (tmp_path / name).mkdir(parents=True)
        made_up.write_ubx(tmp_path / name)
        _write_imu_csv(tmp_path / name)
    (tmp_path / "log.txt").write_text("no recording")
    (tmp_path / "text.log").write_text("no recording")
    (tmp_path / "f9r.log").write_bytes(made_up.pvt(1.0))
    expected = [tmp_path / "a" / "inner", tmp_path / "b", tmp_path / "f9r.log"]
    assert recordings_below(tmp_path) == expected
    assert recordings_below(tmp_path / "b") == [tmp_path / "b"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match="got no recording, here or below"):
        recordings_below(tmp_path / "empty")


def test_the_axes_of_a_mounting_are_turned_in_the_aerospace_order() -> None:
    # given an IMU that looks right (yaw 90) and is then pitched up by 90: its x axis points up
    x_axis: Array = rotation(0, 90, 90) @ np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(x_axis, [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(rotation(0, 0, 90) @ [1, 0, 0], [0, 1, 0])
    np.testing.assert_array_equal(rotation(180, 0, -90), [[0, -1, 0], [-1, 0, 0], [0, 0, -1]])


def test_a_walk_that_is_too_short_is_refused_with_its_length(tmp_path: Path) -> None:
    path = tmp_path / "f9r.ubx"
    stream = made_up.stream(Z_UP)
    path.write_bytes(stream[: len(stream) // 5])
    with pytest.raises(RecordingError, match=r"overlap by 11\.\d s, expected at least 20\.0 s; record both"):
        read_recording(path)


def test_a_stream_with_too_few_fixes_between_samples_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "f9r.ubx"
    stream = made_up.stream(Z_UP)
    path.write_bytes(stream[: len(stream) // 40])
    with pytest.raises(RecordingError, match=r"got [1-9] fixes with ESF messages before and behind them"):
        read_recording(path)


def test_a_recording_has_notes_of_what_it_rests_on(tmp_path: Path) -> None:
    # given an IMU whose z axis points down where up is assumed, tied by the order of the messages
    path = tmp_path / "f9r.ubx"
    path.write_bytes(made_up.stream(np.eye(3)))
    recording = read_recording(path)
    (order,), (tilt,) = recording.notes, recording.doubts
    assert order == "clocks are tied by the order of the messages in the stream, to 0.05 s"
    assert tilt.startswith("gravity is 179 deg off the mounting that is used")


def test_the_times_of_a_solution_are_dates_or_weeks_in_gps_time_or_utc(tmp_path: Path) -> None:
    # given one epoch in each of the ways; UTC is 18 s behind
    rest = "40.0 -105.0 1580.0 5 9 3 4 8 0 0 0 0 0 1 0.5 0 0.1 0.1 0.1 0 0 0"
    header = POS_HEADER + POS_VELOCITY
    times = []
    for system, time in (
        ("GPST", "2025/08/28 19:30:00.250"),
        ("GPST", "2381 415800.250"),
        ("UTC", "2025/08/28 19:29:42.250"),
    ):
        (tmp_path / "walk.pos").write_text(f"{header.replace('GPST', system)}\n{time} {rest}\n")
        fixes = read_pos(tmp_path / "walk.pos")
        times.append(fixes.rows[0, 0])
        assert fixes.kinds == {"single": 1}
    # then all have the same time of week
    np.testing.assert_allclose(times, TOW + 0.25)


@pytest.mark.parametrize("time", ["2016/12/31 23:59:59.750", "1929 604799.750"])
def test_a_solution_in_utc_from_before_the_last_leap_second_is_refused(tmp_path: Path, time: str) -> None:
    rest = "40.0 -105.0 1580.0 5 9 3 4 8 0 0 0 0 0 1 0.5 0 0.1 0.1 0.1 0 0 0"
    header = (POS_HEADER + POS_VELOCITY).replace("GPST", "UTC")
    (tmp_path / "walk.pos").write_text(f"{header}\n{time} {rest}\n")
    with pytest.raises(RecordingError, match=r"in UTC of .*, expected one since 2017.*write GPS time"):
        read_pos(tmp_path / "walk.pos")


def test_a_receiver_that_was_restarted_is_refused(tmp_path: Path) -> None:
    # given a stream whose sensor begins to count anew after 30 s
    path = tmp_path / "f9r.ubx"
    whole = made_up.stream(Z_UP, first_tag=100_000_000)
    again = made_up.stream(Z_UP, first_tag=1)
    path.write_bytes(whole[: len(whole) // 2] + again[len(again) // 2 :])
    with pytest.raises(RecordingError, match=r"cut (the recording|it) at a restart"):
        read_recording(path)
