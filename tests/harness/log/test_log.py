"""The log keeps every bit, survives what ends the process, and shows in viewers what the run did."""

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
from types import FrameType
from typing import Any

import numpy as np
import pytest
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC, Writer
from mcap_protobuf.decoder import DecoderFactory

from harness.cosim.loop import BATCH
from harness.log.channel import Channel
from harness.log.log import LogError, read_log
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


def write_ticks(log: LogWriter, ticks: Ticks, batch: int = BATCH) -> None:
    """Hand over ticks from t = 0, some at a time."""
    for start in range(0, len(ticks), batch):
        rows = ticks[start : start + batch]
        times = np.arange(start, start + len(rows), dtype=np.float64) * TICK
        log.write_rows(times, {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]})


def write(path: Path, channels: list[Channel], ticks: Ticks, batch: int = BATCH) -> None:
    with LogWriter(
        path, channels, origin=ORIGIN, metadata=METADATA, attachments={"full.ssp": b"PK\0\1"}
    ) as log:
        write_ticks(log, ticks, batch)


def walk(ticks: int) -> Ticks:
    """North at 0.1 m a tick with a digit in every place."""
    return [{"plant": [1.0, k / 10 + 1e-13, -k / 3, 0.1]} for k in range(ticks)]


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


def test_channels_metadata_and_attachments_come_back(tmp_path: Path) -> None:
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
    ("ticks", "batch"),
    [(1, 1), (2, 1), (40, 1), (137, 1), (26, BATCH), (99, BATCH), (100, BATCH), (137, BATCH)],
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


def interrupted_after(lines: int, files: set[str]) -> Any:
    """A trace function that raises KeyboardInterrupt at a line of these files."""
    left = lines

    def trace(frame: FrameType, event: str, _: object) -> Any:
        nonlocal left
        if event == "call" and Path(frame.f_code.co_filename).name not in files:
            return None
        if event == "line":
            left -= 1
            if left < 0:
                raise KeyboardInterrupt
        return trace

    return trace


def test_an_interrupt_at_any_line_of_writing_leaves_a_log_without_gap_or_repeat(tmp_path: Path) -> None:
    ticks, before, lines, whole = walk(30), 3, 0, False
    path = tmp_path / "a.mcap"
    while not whole:
        # given a log with three ticks, and an interrupt while 27 more are written, some of them to a chunk
        log = open_writer(path, [PLANT])
        write_ticks(log, ticks[:before])
        times = np.arange(before, len(ticks), dtype=np.float64) * TICK
        rows = {"plant": np.array([row["plant"] for row in ticks[before:]])}
        outer = sys.gettrace()
        try:
            sys.settrace(interrupted_after(lines, {"writer.py", "container.py"}))
            log.write_rows(times, rows)
            whole = True
        except KeyboardInterrupt:
            pass
        finally:
            sys.settrace(outer)
        # when
        log.abort("ended by the user")
        # then both readers see the first ticks, each once
        with path.open("rb") as file:
            reader = make_reader(file)
            summary = reader.get_summary()
            messages = [message for _, _, message in reader.iter_messages(topics=["/plant"])]
        assert summary is not None
        assert summary.statistics is not None
        assert [message.log_time for message in messages] == [k * 40_000_000 for k in range(len(messages))]
        assert len(messages) >= before
        assert sum(summary.statistics.channel_message_counts.values()) == summary.statistics.message_count
        assert summary.statistics.channel_message_counts[1] == len(messages)
        back = read_log(path)
        assert back.broken == "ended by the user"
        assert back["plant.north"].tolist() == [row["plant"][1] for row in ticks[: len(messages)]]
        lines += 1
    assert lines > 50


def test_a_run_that_ends_before_its_first_tick_leaves_no_log(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), open_writer(tmp_path / "a.mcap", [PLANT]):
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


def other_writer(path: Path, rows: list[bytes], *, chunks: bool = True, latitude: str = "0") -> None:
    """A log of one signal by mcap's own writer."""
    with path.open("wb") as file:
        writer: Any = Writer(file, use_chunking=chunks)
        writer.start(profile="guided-canine")
        writer.add_metadata("log", {"format": "1", "latitude": latitude, "longitude": "0"})
        about = channel("plant", "canine", north="Real")
        schema = writer.register_schema("canine", "jsonschema", about.schema())
        number = writer.register_channel("/plant", "json", schema, {"component": "plant", "block": "canine"})
        for tick, row in enumerate(rows):
            writer.add_message(number, tick * 40_000_000, row, tick * 40_000_000)
        writer.finish()


@pytest.mark.parametrize("chunks", [False, True])
def test_messages_are_read_in_chunks_and_outside(chunks: bool, tmp_path: Path) -> None:
    other_writer(tmp_path / "a.mcap", [b'{"north":1.5}', b'{"north":2.5}'], chunks=chunks)
    log = read_log(tmp_path / "a.mcap")
    assert log["plant.north"].tolist() == [1.5, 2.5]
    assert log.time.tolist() == [0, 0.04]
    assert not log.broken


@pytest.mark.parametrize("chunks", [False, True])
@pytest.mark.parametrize("row", [b"null", b'{"north":null}', b'{"south":1}', b"{", b"1", b"[]"])
def test_a_message_that_is_not_a_row_is_an_error(row: bytes, chunks: bool, tmp_path: Path) -> None:
    other_writer(tmp_path / "a.mcap", [row], chunks=chunks)
    with pytest.raises(LogError, match=r"no tick to read, .* damaged"):
        read_log(tmp_path / "a.mcap")


@pytest.mark.parametrize("latitude", ["north", "nan", "inf"])
def test_an_origin_that_is_not_a_finite_number_marks_the_log(tmp_path: Path, latitude: str) -> None:
    other_writer(tmp_path / "a.mcap", [b'{"north":1.5}'], latitude=latitude)
    log = read_log(tmp_path / "a.mcap")
    assert log["plant.north"].tolist() == [1.5]
    assert log.origin == (0.0, 0.0)
    assert "damaged" in log.broken


def test_a_chunk_that_ends_within_a_record_is_an_error(tmp_path: Path) -> None:
    # given a chunk, without a check sum, whose data ends within the head of a record
    path = tmp_path / "a.mcap"
    builder: Any = RecordBuilder()
    records.Header("guided-canine", "").write(builder)
    records.Chunk("", b"\x05\x01", 0, 0, 0, 2).write(builder)
    path.write_bytes(MCAP0_MAGIC + builder.end())
    # then
    with pytest.raises(LogError, match="no tick to read, the file is damaged"):
        read_log(path)


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
def test_a_file_that_holds_no_run_is_refused(tmp_path: Path, make: object, expected: str) -> None:
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


def test_viewers_find_their_topics_by_the_schemas_names(tmp_path: Path) -> None:
    rows: Ticks = [{"plant": [1, 0, 0, 0], "sensors": [1, 2, 3, 3], "controller": [0, 1, 0, 0]}]
    write(tmp_path / "a.mcap", [PLANT, SENSORS, CONTROLLER], rows)
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        topics = ["/map/truth", "/map/gps", "/3d/frames", "/3d/scene", "/log/events"]
        messages = reader.iter_decoded_messages(topics)
        read = {c.topic: (s.name, message) for s, c, _, message in messages if s is not None}
    assert {topic: name for topic, (name, _) in read.items()} == {
        "/map/truth": "foxglove.LocationFix",
        "/map/gps": "foxglove.LocationFix",
        "/3d/frames": "foxglove.FrameTransforms",
        "/3d/scene": "foxglove.SceneUpdate",
        "/log/events": "foxglove.Log",
    }
    # and the origin and the waypoints of the log are theirs
    assert (read["/map/truth"][1].latitude, read["/map/truth"][1].longitude) == pytest.approx(ORIGIN)
    assert [entity.id for entity in read["/3d/scene"][1].entities] == ["dog", "waypoint 1", "home"]


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
