"""The log keeps every bit, survives what ends the process, and shows in viewers what the run did."""

import dataclasses
import json
import math
import os
import resource
import signal
import struct
import subprocess
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from harness.cosim.loop import ROWS
from harness.log.log import Channel, LogError, read_log
from harness.log.writer import LogWriter

TICK = 0.04  # s
ORIGIN = (32.6, -85.5)  # deg
NAN, INF = math.nan, math.inf
PARAMETERS = {
    "controller.waypoint_count": "1",
    "controller.waypoint_north[1]": "25.0",
    "controller.waypoint_east[1]": "-3.0",
    "controller.home_north": "0.0",
    "controller.home_east": "0.0",
    "controller.capture_radius": "7.0",
}
Ticks = list[dict[str, list[float]]]  # of each tick the components' rows
METADATA = {"scenario": {"name": "little", "seed": "3"}, "parameters": PARAMETERS}


def channel(component: str, block: str, **signals: str) -> Channel:
    """Signals as name=type; the unit is m, the meaning names the signal."""
    names = tuple(signals)
    units = tuple("m" if kind == "Real" else "" for kind in signals.values())
    return Channel(
        component, block, names, units, tuple(signals.values()), tuple(f"the {name}" for name in names)
    )


PLANT = channel("plant", "canine", command="Integer", north="Real", east="Real", heading="Real")
SENSORS = channel(
    "sensors", "sensors", gps_fix="Boolean", gps_north="Real", gps_east="Real", gps_h_acc="Real"
)
CONTROLLER = channel(
    "controller", "cmec", command="Integer", status="Integer", waypoint="Integer", anomaly="Integer"
)


def open_writer(path: Path, channels: list[Channel], origin: tuple[float, float] = ORIGIN) -> LogWriter:
    return LogWriter(path, channels, origin=origin, metadata={}, attachments={})


def write_ticks(log: LogWriter, ticks: Ticks, batch: int = ROWS) -> None:
    """Hand over ticks from t = 0, some at a time."""
    for start in range(0, len(ticks), batch):
        rows = ticks[start : start + batch]
        times = np.arange(start, start + len(rows), dtype=np.float64) * TICK
        log.write_rows(times, {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]})


def write(path: Path, channels: list[Channel], ticks: Ticks, batch: int = ROWS) -> None:
    with LogWriter(
        path, channels, origin=ORIGIN, metadata=METADATA, attachments={"full.ssp": b"PK\0\1"}
    ) as log:
        write_ticks(log, ticks, batch)


def walk(ticks: int) -> Ticks:
    """North at 0.1 m a tick with a digit in every place."""
    return [{"plant": [1.0, k / 10 + 1e-13, -k / 3, 0.1]} for k in range(ticks)]


def messages(path: Path, topic: str) -> list[tuple[int, str, Any]]:
    """What mcap's own reader and protobuf decoder make of a topic: time, schema, message."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [
            (message.log_time, schema.name, decoded)
            for schema, _, message, decoded in reader.iter_decoded_messages(topics=[topic])
            if schema is not None
        ]


def test_every_bit_comes_back(tmp_path: Path) -> None:
    # given reals that printing with few digits, JSON or a text cache would change
    reals = [0.1 + 0.2, -0.0, 0.0, 5e-324, -1.7976931348623157e308, 1 / 3, NAN, INF, -INF, 1.0, True, 2**53]
    hard = channel("hard", "Hard", real="Real", integer="Integer", yes="Boolean")
    # when they are logged, twice so that held values are seen too
    write(tmp_path / "a.mcap", [hard], [{"hard": [x, -7.0, i % 2]} for i, x in enumerate(reals * 2)])
    log = read_log(tmp_path / "a.mcap")
    # then each comes back with the same bits
    assert struct.pack("<24d", *log["hard.real"]) == struct.pack("<24d", *reals * 2)
    assert log["hard.integer"].tolist() == [-7.0] * 24
    assert log["hard.yes"].tolist() == [0.0, 1.0] * 12
    assert log.time[:3].tolist() == [0.0, 0.04, 0.08]
    assert log.broken == ""


def test_all_that_was_given_comes_back(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", [PLANT], walk(3))
    log = read_log(tmp_path / "a.mcap")
    assert log.channels == (PLANT,)
    assert log.metadata == METADATA
    assert log.attachments == {"full.ssp": b"PK\0\1"}
    assert log.origin == ORIGIN
    assert log.parameter("controller.capture_radius") == 7.0
    assert log.parameter("controller.nothing") is None
    assert log.values["plant"].shape == (3, 4)


def test_messages_are_json_with_types_units_and_meanings(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", [SENSORS], [{"sensors": [1, NAN, 2.5, 3]}])
    with (tmp_path / "a.mcap").open("rb") as file:
        schema, held_as, message = next(make_reader(file).iter_messages(topics=["/sensors"]))
    assert schema is not None
    assert (schema.name, schema.encoding, held_as.message_encoding) == ("sensors", "jsonschema", "json")
    north = {"type": "number", "unit": "m", "description": "the gps_north"}
    assert json.loads(schema.data)["properties"]["gps_north"] == north
    assert message.data == b'{"gps_fix":true,"gps_north":"NaN","gps_east":2.5,"gps_h_acc":3.0}'
    assert message.log_time == message.publish_time == 0


def test_the_same_run_writes_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        write(tmp_path / name, [PLANT], walk(100))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("batch", [1, 7, 30, 200])
def test_the_batches_in_which_rows_come_leave_no_trace(tmp_path: Path, batch: int) -> None:
    # given 137 ticks with fixes at 4 Hz and a controller that changes its mind
    ticks: Ticks = [
        {**rows, "sensors": [k % 6 == 0, k / 7, -k, 3.0], "controller": [k // 40, 1, k // 60, k == 50]}
        for k, rows in enumerate(walk(137))
    ]
    channels = [PLANT, SENSORS, CONTROLLER]
    write(tmp_path / "usual", channels, ticks)
    # when they come in other batches
    write(tmp_path / "other", channels, ticks, batch)
    # then
    assert (tmp_path / "other").read_bytes() == (tmp_path / "usual").read_bytes()


@pytest.mark.parametrize(
    ("ticks", "batch"), [(1, 1), (2, 1), (40, 1), (137, 1), (26, ROWS), (99, ROWS), (100, ROWS), (137, ROWS)]
)
def test_a_killed_run_loses_at_most_a_second(tmp_path: Path, ticks: int, batch: int) -> None:
    # given a process that is killed with -9 after some ticks, whose rows are handed over some at a time
    code = (
        "import os, sys; from pathlib import Path; from tests.harness.log import test_log as t\n"
        "ticks, batch = map(int, sys.argv[2:])\n"
        "log = t.open_writer(Path(sys.argv[1]), [t.PLANT])\n"
        "t.write_ticks(log, t.walk(ticks // batch * batch), batch)\n"
        "os.kill(os.getpid(), 9)"
    )
    path = tmp_path / "a.mcap"
    roots = [str(Path(__file__).parents[3])]
    killed = subprocess.run(
        [sys.executable, "-c", code, str(path), str(ticks), str(batch)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(roots)},
        check=False,
    )
    assert killed.returncode == -signal.SIGKILL
    # when what is left is read
    log = read_log(path)
    # then at most the ticks of the last second are missing, those there are right, and the log says so
    assert (ticks - 1) * TICK - log.time[-1] <= 1.0
    assert log["plant.north"].tolist() == [row["plant"][1] for row in walk(len(log.time))]
    assert f"killed or the file was cut; its ticks up to {log.time[-1]:g} s are kept" in log.broken


def test_a_file_cut_anywhere_gives_a_prefix(tmp_path: Path) -> None:
    # given a log of four chunks
    write(tmp_path / "whole.mcap", [PLANT, CONTROLLER], [
        {**rows, "controller": [1, 1, 0, 0]} for rows in walk(80)
    ])  # fmt: skip
    data, whole = (tmp_path / "whole.mcap").read_bytes(), read_log(tmp_path / "whole.mcap")
    lengths: set[int] = set()
    # when it is cut at every 37th byte
    for end in range(0, len(data), 37):
        (tmp_path / "cut.mcap").write_bytes(data[:end])
        try:
            log = read_log(tmp_path / "cut.mcap")
        except LogError as error:
            assert len(lengths) == 0, f"byte {end} of {len(data)}: {error}"  # noqa: PT017 (no tick yet)
            continue
        # then its rows begin as the whole log's do, and it says that it is cut
        ticks = len(log.time)
        lengths.add(ticks)
        assert f"at byte {end}" in log.broken
        for name, values in log.values.items():
            assert np.array_equal(values, whole.values[name][:ticks])
    assert lengths == {1, 25, 50, 75, 80}


def test_a_damaged_byte_is_never_read_as_data(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", [PLANT], walk(80))
    data, whole = (tmp_path / "a.mcap").read_bytes(), read_log(tmp_path / "a.mcap")
    first = data.index(b"zstd")
    for at in range(first, len(data), 97):
        damaged = bytearray(data)
        damaged[at] ^= 0xFF
        (tmp_path / "b.mcap").write_bytes(damaged)
        try:
            log = read_log(tmp_path / "b.mcap")
        except LogError as error:
            assert "no tick to read" in str(error)  # noqa: PT017 (the first chunk may be what is damaged)
            continue
        assert np.array_equal(log.values["plant"], whole.values["plant"][: len(log.time)])


def test_a_fault_ends_the_log_with_its_text(tmp_path: Path) -> None:
    # given a fault after a second and five ticks
    log = open_writer(tmp_path / "a.mcap", [PLANT])
    write_ticks(log, walk(30))
    with pytest.raises(RuntimeError), log:
        raise RuntimeError("plant dog.fmu: speed is NaN at 1.2 s")
    # then all ticks before it are there, and a reader is told
    read = read_log(tmp_path / "a.mcap")
    assert read.broken == "plant dog.fmu: speed is NaN at 1.2 s"
    assert read["plant.north"].tolist() == [row["plant"][1] for row in walk(30)]


def foreign(path: Path) -> None:
    with path.open("wb") as file:
        writer: Any = Writer(file)
        writer.start(profile="ros2")
        writer.finish()


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda path: None, "cannot be read (No such file or directory)"),
        (lambda path: path.write_bytes(b""), "the file is empty; run the trial again"),
        (lambda path: path.write_bytes(b"hi"), 'not an MCAP file; give a log that "canine run" wrote'),
        (foreign, 'an MCAP file with profile "ros2", expected "guided-canine"'),
        (lambda path: write(path, [PLANT], []), "no tick to read, it was closed before the first"),
    ],
)
def test_what_is_no_log_is_refused(tmp_path: Path, make: object, expected: str) -> None:
    path = tmp_path / "a.mcap"
    assert callable(make)
    make(path)
    with pytest.raises(LogError) as caught:
        read_log(path)
    assert expected in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_file_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"cannot be written \(No such file or directory\); make room, or"):
        LogWriter(tmp_path / "no" / "a.mcap", [PLANT], origin=ORIGIN, metadata={}, attachments={})


@pytest.mark.parametrize("attached", [10, 100_000])
def test_a_disk_that_is_full_before_the_first_tick_leaves_no_log(tmp_path: Path, attached: int) -> None:
    # given room for 64 bytes, which the metadata exceed, be they small enough to wait in a buffer or not
    path = tmp_path / "a.mcap"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64, before[1]))
    # when
    try:
        with pytest.raises(LogError) as caught:
            LogWriter(
                path, [PLANT], origin=ORIGIN, metadata=METADATA, attachments={"full.ssp": bytes(attached)}
            )
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    # then
    assert str(caught.value) == (
        f"log {path}: cannot be written (File too large); make room, or choose another folder with --out"
    )
    assert not path.exists()


def test_an_unknown_signal_names_the_nearest(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", [PLANT], walk(1))
    log = read_log(tmp_path / "a.mcap")
    assert "plant.north" in log
    assert "plant.norht" not in log
    with pytest.raises(LogError, match=r'no signal "plant.norht"; did you mean "plant.north"\?'):
        log["plant.norht"]


def test_the_map_shows_positions_about_the_origin(tmp_path: Path) -> None:
    # given a fix 100 m north and 200 m east of an origin at 30 deg, on the second of two ticks
    path = tmp_path / "a.mcap"
    with open_writer(path, [SENSORS], origin=(30.0, -85.5)) as log:
        write_ticks(log, [{"sensors": [0, 5.0, 5.0, 3.0]}, {"sensors": [1, 100.0, 200.0, 3.0]}])
    # when viewers read it
    [(time, schema, fix)] = messages(path, "/map/gps")
    # then it is where the tables of WGS 84 put it: a degree at 30 deg is 110.852 km north, 96.486 km east
    assert (time, schema) == (40_000_000, "foxglove.LocationFix")
    assert fix.latitude - 30 == pytest.approx(100 / 110_852, rel=1e-5)
    assert fix.longitude + 85.5 == pytest.approx(200 / 96_486, rel=1e-5)
    assert fix.position_covariance[0] == 2.25  # (3 m / 2)**2
    assert (fix.timestamp.seconds, fix.timestamp.nanos) == (0, 40_000_000)


def test_the_map_and_3d_panels_get_five_poses_a_second(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", [PLANT], walk(51))  # 2 s
    truth = messages(tmp_path / "a.mcap", "/map/truth")
    assert [time / 1e9 for time, *_ in truth] == [0, 0.2, 0.4, 0.6, 0.8, 1, 1.2, 1.4, 1.6, 1.8, 2]
    _, schema, frames = messages(tmp_path / "a.mcap", "/3d/frames")[5]
    assert schema == "foxglove.FrameTransforms"
    [dog] = frames.transforms
    assert (dog.parent_frame_id, dog.child_frame_id) == ("map", "dog")
    assert dog.translation.x == pytest.approx(-25 / 3)  # east is x
    assert dog.translation.y == pytest.approx(2.5)
    # heading 0.1 clockwise from north is pi/2 - 0.1 counterclockwise from east
    assert 2 * math.atan2(dog.rotation.z, dog.rotation.w) == pytest.approx(math.pi / 2 - 0.1)


def test_the_scene_has_the_waypoints_with_their_circles_once(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", [PLANT], walk(30))
    [(time, schema, scene)] = messages(tmp_path / "a.mcap", "/3d/scene")
    assert (time, schema) == (0, "foxglove.SceneUpdate")
    entities = {entity.id: entity for entity in scene.entities}
    assert set(entities) == {"dog", "waypoint 1", "home"}
    circle = entities["waypoint 1"].lines[0]
    assert (circle.pose.position.x, circle.pose.position.y) == (-3.0, 25.0)
    assert all(math.hypot(p.x, p.y) == pytest.approx(7.0) for p in circle.points)


def test_events_tell_what_the_controller_did(tmp_path: Path) -> None:
    # given command, status, waypoint, anomaly over six ticks; the anomaly is reported on two ticks running
    ticks = [(0, 0, 0, 0), (1, 1, 0, 0), (1, 1, 0, 1), (2, 1, 0, 1), (3, 1, 1, 0), (9, 2, 1, 0)]
    write(tmp_path / "a.mcap", [CONTROLLER], [{"controller": list(tick)} for tick in ticks])
    told = messages(tmp_path / "a.mcap", "/log/events")
    assert [(round(time / 4e7), event.message, event.level) for time, _, event in told] == [
        (1, "trial RUNNING", 2),
        (1, "command FORWARD", 2),
        (2, "anomaly FORWARD_FAILURE", 3),
        (3, "command STOP", 2),
        (3, "anomaly FORWARD_FAILURE", 3),
        (4, "command RECALL", 2),
        (4, "waypoint 1 reached", 2),
        (5, "trial SUCCESS", 2),
        (5, "command 9", 2),
    ]


def test_topics_are_there_only_for_what_the_system_has(tmp_path: Path) -> None:
    def topics(*channels: Channel) -> set[str]:
        path = tmp_path / "a.mcap"
        write(path, list(channels), [{c.component: [0.0] * len(c.names) for c in channels}])
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
            assert summary is not None
            return {c.topic for c in summary.channels.values()}

    assert topics(CONTROLLER) == {"/controller", "/log/events", "/3d/scene"}
    assert topics(PLANT) == {"/plant", "/map/truth", "/3d/frames", "/3d/scene"}
    assert "/map/gps" in topics(SENSORS)
    estimator = dataclasses.replace(PLANT, component="estimator", block="four_state")
    assert "/map/estimate" in topics(PLANT, estimator)


def test_memory_stays_flat_while_writing(tmp_path: Path) -> None:
    # given a signal that never repeats a value, and a writer that has reached its usual size
    one = channel("one", "One", value="Real")
    with open_writer(tmp_path / "a", [one]) as log:

        def write_seconds(first: int, last: int) -> None:
            for start in range(25 * first, 25 * last, 25):
                ticks = np.arange(start, start + 25, dtype=np.float64)
                log.write_rows(ticks * TICK, {"one": ticks[:, None] + 0.1})

        write_seconds(0, 200)
        tracemalloc.start()
        # when 10,000 more ticks are written, 400 s of trial time and 1 MB of messages
        write_seconds(200, 600)
        grown, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    # then what remains is the index of their 400 chunks, 1 kB each, and the texts of a batch: the messages,
    # 10,000 objects of 50 bytes and more, are gone
    assert grown < 400 * 1000 + 25 * 1000
