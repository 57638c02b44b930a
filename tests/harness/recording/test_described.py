"""A recording.toml: the example of the page, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from harness.recording.described import ATTITUDE_COLUMNS, GPS_COLUMNS, IMU_COLUMNS, UNITS, read_description
from harness.recording.read import read_recording
from harness.recording.recording import Recording, RecordingError
from tests.harness.recording import made_up
from tests.harness.recording.made_up import Array, force_and_rate
from tests.harness.recording.test_ways_in import assert_is_the_walk

PAGE = (Path(__file__).parents[3] / "harness" / "recording" / "README.md").read_text()
EXAMPLE = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)[0]
MOUNTING = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # of the example


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The folder of the page's example: one logger whose clock counts ms."""
    gps = ["t,lat,lon,speed,course,type,satellites,satellites"]
    for t in made_up.fix_times():
        where, (north, east) = made_up.place(float(t)), made_up.velocity(float(t))
        course = np.degrees(np.arctan2(east, north)) % 360
        gps.append(
            f"{1e6 + 1000 * t:.0f},{where['lat']:.9f},{where['lon']:.9f},"
            f"{3.6 * np.hypot(north, east):.5f},{course:.5f},3,7,7"
        )
    gps.insert(5, "1000000,0,0,0,0,0,7,7")  # no fix
    gps.insert(9, "oops")
    times = np.arange(0, made_up.DURATION, 0.01)
    force, rate = force_and_rate(times)
    table = np.column_stack([1e6 + 1000 * times, force @ MOUNTING / made_up.G, np.degrees(rate @ MOUNTING)])
    imu = ["# a comment", *(";".join(f"{value:.6f}" for value in row) for row in table)]
    (tmp_path / "gps.csv").write_text("\r\n".join(gps))
    (tmp_path / "imu.csv").write_text("\n".join(imu))
    (tmp_path / "recording.toml").write_text(EXAMPLE)
    return tmp_path


def test_the_example_of_the_page_reads_a_walk(folder: Path) -> None:
    recording = read_recording(folder)
    assert_is_the_walk(recording, clock=0.001)
    assert len(recording.imu_t) == 6000
    assert len(recording.fixes.t) == len(made_up.fix_times())
    np.testing.assert_allclose(recording.fixes.h_acc, 2.5)
    assert recording.dropped == {"lines that are no fix": 1, "lines without their numbers": 1}


@pytest.mark.parametrize("header", [True, False])
def test_a_line_that_is_dropped_takes_its_time_where_a_rate_stands_for_the_clock(
    folder: Path, header: bool
) -> None:
    # given an IMU without a time column whose samples 1000 to 1299 are not numbers
    lines = [line.split(";", 1)[1] for line in (folder / "imu.csv").read_text().splitlines()[1:]]
    lines[1000:1300] = ["nan;nan;nan;nan;nan;nan"] * 300
    (folder / "imu.csv").write_text("\n".join([*["x;y;z;p;q;r"] * header, *lines]))
    columns = re.sub(r"(?m)^time = { column = 1, .*\n", "", EXAMPLE)
    columns = re.sub(r"column = ([2-7])", lambda found: f"column = {int(found[1]) - 1}", columns)
    columns = columns.replace('separator = ";"', 'separator = ";"\nrate = 100')
    columns = re.sub(r"(?m)^imu_offset = 0", "imu_offset = 1000", columns)
    (folder / "recording.toml").write_text(columns)
    # when it is read, then the samples behind them keep their time
    recording = read_recording(folder)
    assert recording.dropped["lines without their numbers"] == 1 + 300
    assert np.diff(recording.imu_t).max() == pytest.approx(3.01)
    assert recording.imu_t[-1] - recording.imu_t[0] == pytest.approx(59.99)
    inner = recording.imu_t > 20
    start = recording.fixes.t[0] - 0.25
    _, rate = force_and_rate(recording.imu_t[inner] - start)
    np.testing.assert_allclose(recording.rate[inner], rate, atol=2e-3)


def test_the_page_names_every_unit_and_column() -> None:
    for units in UNITS.values():
        for unit in filter(None, units):
            assert f"`{unit}`" in PAGE, unit
    for column in (*IMU_COLUMNS, *ATTITUDE_COLUMNS, *GPS_COLUMNS):
        assert f"`{column}`" in PAGE or f"\n{column} = " in EXAMPLE, column


def test_a_mounting_is_angles_or_the_same_matrix(folder: Path) -> None:
    angles = read_description(folder / "recording.toml").mounting
    matrix = EXAMPLE.replace("{ roll = 180, pitch = 0, yaw = -90 }", "[[0, -1, 0], [-1, 0, 0], [0, 0, -1]]")
    (folder / "recording.toml").write_text(matrix)
    np.testing.assert_array_equal(read_description(folder / "recording.toml").mounting, angles)
    np.testing.assert_array_equal(angles, MOUNTING)


def test_without_velocities_those_of_the_positions_are_taken(folder: Path) -> None:
    text = re.sub(r"(?m)^(speed|course|s_acc) = .*\n", "", EXAMPLE)
    (folder / "recording.toml").write_text(text)
    recording = read_recording(folder)
    start = recording.fixes.t[0] - 0.5
    north = [made_up.velocity(float(t - start - 0.125))[0] for t in recording.fixes.t]
    np.testing.assert_allclose(recording.fixes.velocity_north, north, atol=0.02)
    np.testing.assert_allclose(recording.fixes.s_acc, 2.5 * 2**0.5 / 0.25)


def with_attitude(folder: Path, columns: Array, lines: str) -> None:
    """Put columns (6000, k), from number 8 on, behind those of the IMU, and lines behind its description."""
    rows = (folder / "imu.csv").read_text().splitlines()
    more = [";".join(f"{value:.9f}" for value in row) for row in columns]
    (folder / "imu.csv").write_text("\n".join([rows[0], *map(";".join, zip(rows[1:], more, strict=True))]))
    text = EXAMPLE.replace("[clock]", lines + "\n[clock]")
    (folder / "recording.toml").write_text(text)


EULER = """
roll = { column = 8, unit = "rad" }
pitch = { column = 9, unit = "deg", sense = -1 }
heading = { column = 10, unit = "deg", sense = -1 }
"""
QUATERNION = """
q_w = { column = 8 }
q_x = { column = 9 }
q_y = { column = 10 }
q_z = { column = 11 }
"""


def attitude_of_the_walk() -> Array:
    """Of a body that leans, too: roll, pitch and heading at each sample of the example, (n, 3) rad."""
    times = np.arange(0, made_up.DURATION, 0.01)
    return np.column_stack([0.2 * np.sin(times), 0.3 * np.cos(times), made_up.at(times, made_up.HEADING)])


def assert_is_that_attitude(recording: Recording) -> None:
    assert recording.attitude is not None
    difference = recording.attitude - attitude_of_the_walk()
    np.testing.assert_allclose(np.angle(np.exp(1j * difference)), 0, atol=1e-6)


def test_angles_of_an_attitude_are_the_bodys_and_may_count_the_other_way(folder: Path) -> None:
    """A z-up unit's yaw is counter-clockwise, and its pitch is nose down."""
    roll, pitch, heading = attitude_of_the_walk().T
    with_attitude(folder, np.column_stack([roll, -np.degrees(pitch), -np.degrees(heading)]), EULER)
    assert_is_that_attitude(read_recording(folder))


@pytest.mark.parametrize("earth", ["NED", "ENU", "NWU"])
def test_a_quaternion_turns_the_axes_of_the_imu_into_those_of_the_earth(folder: Path, earth: str) -> None:
    """Not those of the body: the mounting turns them."""
    roll, pitch, heading = attitude_of_the_walk().T
    body = Rotation.from_euler("ZYX", np.column_stack([heading, pitch, roll]))
    north, east, down = body.apply(MOUNTING.T[0]), body.apply(MOUNTING.T[1]), body.apply(MOUNTING.T[2])
    imu = np.stack([north, east, down], axis=2)  # the axes of the IMU, each as north, east, down
    axes = {"N": imu[:, 0], "E": imu[:, 1], "D": imu[:, 2], "U": -imu[:, 2], "W": -imu[:, 1]}
    turned = Rotation.from_matrix(np.stack([axes[letter] for letter in earth], axis=1)).as_quat()
    columns = 1.01 * turned[:, [3, 0, 1, 2]]
    columns[7] = 0.0  # is none
    with_attitude(folder, columns, QUATERNION)
    text = (folder / "recording.toml").read_text().replace("[imu]", f'[imu]\nearth = "{earth}"')
    (folder / "recording.toml").write_text(text)
    recording = read_recording(folder)
    assert recording.attitude is not None
    assert recording.dropped["IMU samples out of range"] == 1
    difference = recording.attitude - np.delete(attitude_of_the_walk(), 7, axis=0)
    np.testing.assert_allclose(np.angle(np.exp(1j * difference)), 0, atol=1e-6)


@pytest.mark.parametrize(
    ("lines", "reason"),
    [
        ('heading = { column = 8, unit = "deg" }', r"imu\.columns\.roll is missing"),
        (
            EULER.replace("sense = -1", "sense = 0", 1),
            r"pitch\.sense is 0, expected 1, or -1 for the reverse",
        ),
        (QUATERNION, r"imu\.earth is None, expected one of NED, ENU, NWU with a quaternion"),
        (QUATERNION.replace("q_x", "qx"), r'unknown key imu\.columns\.qx; did you mean "q_x"\?'),
    ],
)
def test_half_an_attitude_is_refused(folder: Path, lines: str, reason: str) -> None:
    with_attitude(folder, np.zeros((6000, 4)), lines)
    with pytest.raises(RecordingError, match=reason):
        read_recording(folder)


ROLL = "{ roll = 180, pitch = 0, yaw = -90 }"
WRONG = {
    "key": ("mounting =", "mountng =", r'unknown key imu\.mountng; did you mean "mounting"\?'),
    "table": ("[clock]", "[clocks]", r'unknown key clocks; did you mean "clock"\?'),
    "column": ("accel_x =", "acel_x =", r'unknown key imu\.columns\.acel_x; did you mean "accel_x"\?'),
    "missing": ('accel_x = { column = 2, unit = "g" }', "", r"imu\.columns\.accel_x is missing; say where"),
    "unit": (
        'unit = "km/h"',
        'unit = "mph"',
        r"gps\.columns\.speed\.unit is 'mph', expected one of m/s,",
    ),
    "name": ('column = "lat"', 'column = "latt"', r'gps\.csv: got no column "latt".*did you mean "lat"\?'),
    "number": ("column = 2,", "column = 0,", r"accel_x\.column is 0, expected its name or its number from 1"),
    "both": ("{ value = 2.5,", "{ column = 2, value = 2.5,", r"h_acc expected either a column or one value"),
    "none": (f"mounting = {ROLL}\n", "", r"imu\.mounting is missing, expected how the IMU sits in the body"),
    "angles": (ROLL, "{ roll = 180 }", r"imu\.mounting is .*roll.*expected how the IMU sits in the body"),
    "mirror": (ROLL, "[[1, 0, 0], [0, 1, 0], [0, 0, -1]]", r"no rotation, it mirrors"),
    "skew": (ROLL, "[[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]", r"no rotation, its rows are not at right angles"),
    "file": ('"gps.csv"', '"gsp.csv"', r"gps\.file is 'gsp\.csv', but .*gsp\.csv is not there"),
    "rate": ("rate = 4 ", "rate = 40 ", r"gps\.csv: its clock runs at 4 lines a second, .* says 40 Hz"),
    "standing": ('{ column = "t", unit', "{ column = 7, unit", r"its clock runs at 0 lines a second"),
    "fixes": (
        "fixes = [3, 4]",
        "fixes = [7]",
        r"gps\.csv: got no fix in \d+ lines; are gps\.fixes the",
    ),
    "clock": ("imu_offset = 0 ", "", r"nothing ties the clocks; give clock\.imu_offset in s"),
    "accuracy": ("{ value = 2.5,", "{ value = -1,", r"h_acc\.value is -1, expected an accuracy above 0"),
    "exact": ("{ value = 0.3,", "{ value = 0,", r"s_acc\.value is 0, expected an accuracy above 0"),
    "twice": ("{ column = 2,", "{ column = 5,", r"imu\.columns\.\w+ is column 5, as another is"),
    "namesakes": (
        '{ column = "type" }',
        '{ column = "satellites" }',
        r'2 columns are called "satellites"; give that of fix by its number',
    ),
    "toml": ("[imu]", "[imu", r"recording\.toml: line 16 is `\[imu`: expected '\]'"),
    "deep": ("imu_offset = 0 ", "imu_offset = " + "[" * 5000, r"line 31: brackets are nested 17 deep"),
    "long": ("imu_offset = 0 ", "imu_offset = " + "1" * 8000, r"line 31: .* has 8000 characters"),
}


@pytest.mark.parametrize(("old", "new", "message"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_description_is_refused_with_its_place(
    folder: Path, old: str, new: str, message: str
) -> None:
    assert old in EXAMPLE
    (folder / "recording.toml").write_text(EXAMPLE.replace(old, new, 1))
    with pytest.raises(RecordingError, match=message):
        read_recording(folder)


def test_numbers_that_only_python_reads_are_dropped_and_counted(folder: Path) -> None:
    lines = (folder / "imu.csv").read_text().split("\n")
    lines[500] = lines[500].replace(".", "_", 1)
    (folder / "imu.csv").write_text("\n".join(lines))
    assert read_recording(folder).dropped["lines without their numbers"] == 2  # and "oops"
