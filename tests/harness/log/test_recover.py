"""A log that was cut gets back its end: all that was written whole, and a file that is whole again."""

import errno
import os
import signal
import struct
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap import records
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from harness.log.log import Log, LogError, NoLogError, read_log, read_records
from harness.log.recover import default_out, recover
from models.errors import UsageError
from tests.harness.log.test_damage import GOOD, about, crafted, is_prefix, packed, row
from tests.harness.log.test_log import (
    CONTROLLER,
    PLANT,
    SENSORS,
    channel,
    open_writer,
    walk,
    write,
    write_ticks,
)

TICKS: list[dict[str, list[float]]] = [
    {**rows, "sensors": [k % 6 == 0, k / 7, -k, 3.0], "controller": [1, k // 9, 0, 0]}
    for k, rows in enumerate(walk(80))
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A log of five chunks: the first tick, and up to 0.96, 1.96, 2.96 and 3.16 s."""
    path = tmp_path_factory.mktemp("log") / "a.mcap"
    write(path, [PLANT, SENSORS, CONTROLLER], TICKS)
    return path.read_bytes()


def chunks(data: bytes) -> list[tuple[int, int]]:
    """Where each chunk begins and ends, by the lengths that MCAP states: an opcode, 8 bytes, the content."""
    places, at = [], 8
    while at < len(data) - 8:
        (length,) = struct.unpack_from("<Q", data, at + 1)
        if data[at] == 0x06:
            places.append((at, at + 9 + length))
        at += 9 + length
    return places


def messages(data: bytes, path: Path) -> list[tuple[str, int, bytes]]:
    """Topic, time and data of all messages of a file that is whole, as mcap's own reader reads them."""
    path.write_bytes(data)
    with path.open("rb") as file:
        list(StreamReader(file, validate_crcs=True).records)  # raises if a checksum differs
        file.seek(0)
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_summary() is not None
        return [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages(log_time_order=False)]


def check_recovered(data: bytes, whole: bytes, folder: Path) -> Log:
    """Recover a cut log and fail unless it has all chunks that it had whole, and nothing else."""
    path = folder / "cut.mcap"
    path.write_bytes(data)
    recovery = recover(path)
    out = recovery.out
    assert out == folder / "cut-recovered.mcap"
    assert sorted(folder.iterdir()) == [out, path]
    assert path.read_bytes() == data
    # mcap's reader finds what it finds in the whole log up to the last chunk that is there
    kept = [end for _, end in chunks(whole) if end <= len(data)]
    until = [0, 960_000_000, 1_960_000_000, 2_960_000_000, 3_160_000_000][len(kept) - 1]
    expected = [m for m in messages(whole, folder / "w") if m[1] <= until]
    assert messages(out.read_bytes(), folder / "r") == expected
    assert dict(recovery.messages or {}) == Counter(topic for topic, _, _ in expected)
    # and the bytes up to there are those that were written
    assert out.read_bytes()[: kept[-1]] == data[: kept[-1]]
    log = read_log(out)
    assert log.damage == ""
    assert log.time[-1] == until / 1e9
    assert is_prefix(log, read_log(folder / "w"))
    out.unlink()
    return log


def test_a_log_cut_at_every_kind_of_place_keeps_each_chunk_that_was_whole(
    whole: bytes, tmp_path: Path
) -> None:
    # given the places of chunks, and around each the edges, the head, the times, the middle
    places = chunks(whole)
    assert len(places) == 5
    cuts = {places[0][1], len(whole) - 1, len(whole) - 8, len(whole) - 9, len(whole) - 40}
    for start, end in places[1:]:
        cuts |= {start, start + 1, start + 8, start + 9, start + 24, start + 25, (start + end) // 2}
        cuts |= {end - 1, end, end + 1, end + 9, end + 30}
    for number, cut in enumerate(sorted(cuts)):
        folder = tmp_path / str(number)
        folder.mkdir()
        # then what is there is kept, and nothing half-written lies beside it
        check_recovered(whole[:cut], whole, folder)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_log_cut_anywhere_is_made_whole_or_has_no_tick(
    data: st.DataObject, whole: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    cut = data.draw(st.integers(0, len(whole) - 1))
    folder = tmp_path_factory.mktemp("cut")
    if cut >= chunks(whole)[0][1]:
        check_recovered(whole[:cut], whole, folder)
        return
    (folder / "cut.mcap").write_bytes(whole[:cut])
    with pytest.raises(LogError, match=r"no tick to read|is empty"):
        recover(folder / "cut.mcap")
    assert [path.name for path in folder.iterdir()] == ["cut.mcap"]


def test_a_log_cut_behind_its_data_gets_its_very_bytes_back(whole: bytes, tmp_path: Path) -> None:
    # given a log of which a part of the index is missing: its run came to its end
    for cut in (whole.rindex(struct.pack("<BQ", 0x0F, 4)) + 13, len(whole) - 1):
        path = tmp_path / f"{cut}.mcap"
        path.write_bytes(whole[:cut])
        recovery = recover(path)
        assert recovery.is_complete
        assert recovery.lost == ()
        assert recovery.out is not None
        assert recovery.out.read_bytes() == whole
        assert read_log(recovery.out).broken == ""
        assert recovery.words()[-1] == "lost: nothing, the index is made anew"


def test_what_was_lost_is_said(whole: bytes, tmp_path: Path) -> None:
    # given a log that was cut 100 bytes into its third chunk, which has the ticks from 1 s to 1.96 s
    start, end = chunks(whole)[2]
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: start + 100])
    recovery = recover(path)
    # then
    assert recovery.lost == (f"a chunk from 1 to 1.96 s, of which 100 of {end - start} bytes are there",)
    assert not recovery.is_complete
    early = f"the file ends early, at byte {start + 100}: the run was killed or the file was cut"
    kept = "its ticks up to 0.96 s are kept"
    first, second, third = recovery.words()
    assert first == f"{path}: {early}; {kept}"
    assert second.startswith("recovered: 25 ticks up to 0.96 s; messages of /plant 25, /sensors 25, ")
    assert third == f"lost: {recovery.lost[0]}; what its run had not written yet, if anything"
    # and the new log says what it is
    assert recovery.out is not None
    assert read_log(recovery.out).broken == f"recovered, {early}; {kept}"
    assert recovery.facts()["until_s"] == 0.96
    # and a cut before the times of the chunk, or between two records, names no time
    for cut, lost in ((start + 20, ("the last 20 bytes, part of a record",)), (start, ())):
        path = tmp_path / f"{cut}.mcap"
        path.write_bytes(whole[:cut])
        assert recover(path).lost == lost


def test_a_log_that_is_whole_is_not_written_anew(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(whole)
    recovery = recover(path, tmp_path / "b.mcap")
    assert recovery.out is None
    whole_log = f"{path}: the log is whole, 80 ticks up to 3.16 s: nothing to recover"
    assert recovery.words() == [f"{whole_log}, {tmp_path / 'b.mcap'} is not written"]
    assert recover(path).words() == [whole_log]
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


def test_a_log_whose_run_a_fault_ended_is_whole_and_says_so(tmp_path: Path) -> None:
    # given a run that a fault ended; its log is whole
    path = tmp_path / "a.mcap"
    log = open_writer(path, [PLANT])
    write_ticks(log, walk(30))
    log.abort("plant dog.fmu: speed is NaN at 1.2 s")
    written = path.read_bytes()
    assert recover(path).words()[0].endswith("; its run ended early: plant dog.fmu: speed is NaN at 1.2 s")
    # when its index is cut, or the end of its data too, then the recovered log has the reason of its run
    for cut in (len(written) - 9, written.rindex(struct.pack("<BQ", 0x0F, 4))):
        path = tmp_path / f"{cut}.mcap"
        path.write_bytes(written[:cut])
        recovery = recover(path)
        # then it has the very bytes
        assert recovery.out is not None
        assert recovery.out.read_bytes() == written
        assert read_log(path).metadata == read_log(recovery.out).metadata


def test_a_recovered_log_is_whole(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    first = recover(path).out
    assert first is not None
    assert recover(first).out is None


def test_nothing_that_is_there_is_written_over(whole: bytes, tmp_path: Path) -> None:
    # given a cut log, and files where the new one should be
    path, other = tmp_path / "cut.mcap", tmp_path / "other.mcap"
    path.write_bytes(whole[:-100])
    for out in (path, other, default_out(path)):
        out.exists() or out.write_bytes(b"mine")
    (tmp_path / "link.mcap").symlink_to(path)
    # then each is refused, the log itself too
    for taken in (path, other, None, tmp_path / "link.mcap", tmp_path):
        with pytest.raises(UsageError, match="is there already; choose another file"):
            recover(path, taken)
    assert path.read_bytes() == whole[:-100]
    assert other.read_bytes() == default_out(path).read_bytes() == b"mine"


def test_a_file_that_comes_while_the_log_is_recovered_is_not_written_over(
    whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given somebody who makes the file after it was found missing
    path, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    path.write_bytes(whole[:-100])

    def meanwhile(*arguments: Any) -> str:
        out.write_bytes(b"theirs")
        return read_records(*arguments)

    monkeypatch.setattr("harness.log.recover.read_records", meanwhile)
    # then
    with pytest.raises(UsageError, match="is there already; choose another file"):
        recover(path, out)
    assert out.read_bytes() == b"theirs"
    assert sorted(tmp_path.iterdir()) == [path, out]


@pytest.mark.parametrize(
    ("source", "error"),
    [("/proc/self/mem", "Input/output error"), ("/nowhere", "No such file or directory")],
)
def test_a_log_that_cannot_be_read_again_is_not_a_file_that_cannot_be_written(
    source: str, error: str, whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a log that was read once, and now gives an error
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[:-100])
    log = read_log(path)
    path.unlink()
    path.symlink_to(source)
    monkeypatch.setattr("harness.log.recover.read_log", lambda path: log)
    monkeypatch.setattr("harness.log.recover.read_records", lambda path, file, size, copy: file.read(1))
    # then
    with pytest.raises(LogError) as caught:
        recover(path)
    assert str(caught.value) == f"log {path}: cannot be read ({error})"
    assert [p.name for p in tmp_path.iterdir()] == ["cut.mcap"]


def test_a_new_folder_is_made_and_one_that_cannot_be_is_refused(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[:-100])
    assert recover(path, tmp_path / "new" / "deep" / "a.mcap").out == tmp_path / "new/deep/a.mcap"
    with pytest.raises(UsageError, match="the folder cannot be made"):
        recover(path, path / "a.mcap")


def test_a_full_disk_leaves_nothing_behind(whole: bytes, tmp_path: Path) -> None:
    # given room for half of the file, in a process of its own
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[:-100])
    code = (
        "import resource, signal, sys; from pathlib import Path; from harness.log.recover import recover\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]),) * 2)\n"
        "recover(Path(sys.argv[1]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path), str(len(whole) // 2)],
        capture_output=True, text=True, check=False, cwd=Path(__file__).parents[3],
    )  # fmt: skip
    # then
    assert "cut-recovered.mcap: cannot be written (File too large); make room, or choose" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["cut.mcap"]


def test_a_run_that_is_killed_leaves_no_unfinished_file_with_the_name(whole: bytes, tmp_path: Path) -> None:
    # given a process that is killed as soon as its new file is there and empty
    path, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    path.write_bytes(whole[:-1])
    code = (
        "import os, signal, sys; from pathlib import Path; from harness.log.recover import recover\n"
        "path, out = map(Path, sys.argv[1:])\n"
        "def look(*_):\n"
        "    if os.path.exists(out) and os.stat(out).st_size == 0: os.kill(os.getpid(), signal.SIGKILL)\n"
        "sys.addaudithook(look)\n"
        "recover(path, out)\n"
    )
    command = [sys.executable, "-c", code, str(path), str(out)]
    # then it comes to its end
    assert subprocess.run(command, check=False, cwd=Path(__file__).parents[3]).returncode == 0
    assert out.read_bytes() == whole
    assert sorted(tmp_path.iterdir()) == [path, out]


def test_a_folder_without_links_gets_its_file_all_the_same(
    whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: Path, target: Path) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    path, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    path.write_bytes(whole[:-1])
    monkeypatch.setattr(Path, "hardlink_to", refuse)
    # when, then
    recover(path, out)
    assert out.read_bytes() == whole
    assert sorted(tmp_path.iterdir()) == [path, out]
    with pytest.raises(UsageError, match="is there already"):
        recover(path, out)


def no_mcap(path: Path) -> None:
    path.write_bytes(b"time,north\n0,1\n")


def foreign(path: Path) -> None:
    with path.open("wb") as file:
        writer: Any = Writer(file)
        writer.start(profile="ros2")
        writer.finish()


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (no_mcap, 'not an MCAP file; give a log that "canine run" wrote'),
        (foreign, 'an MCAP file with profile "ros2"'),
        (Path.touch, "the file is empty"),
        (Path.mkdir, "Is a directory"),
        (lambda path: None, "No such file"),
    ],
)
def test_what_is_no_log_is_refused(make: Any, error: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    make(path)
    with pytest.raises(LogError) as caught:
        recover(path)
    assert error in str(caught.value)
    assert isinstance(caught.value, NoLogError) == (make is Path.mkdir or "No such" in error)
    assert not default_out(path).exists()


def test_a_log_that_is_damaged_in_the_middle_keeps_what_stands_before(whole: bytes, tmp_path: Path) -> None:
    # given a byte of the third chunk that is another
    start, end = chunks(whole)[2]
    damaged = bytearray(whole)
    damaged[(start + end) // 2] ^= 0xFF
    path = tmp_path / "a.mcap"
    path.write_bytes(damaged)
    recovery = recover(path)
    # then the two before it are kept
    assert recovery.lost == (f"all from byte {start} on, {len(whole) - start} bytes",)
    assert recovery.out is not None
    log = read_log(recovery.out)
    assert (len(log.time), log.damage) == (25, "")
    assert "recovered, the file is damaged at byte" in log.broken
    # and one in an index loses no row, though nobody knows whether the run came to its end
    damaged = bytearray(whole)
    damaged[chunks(whole)[4][1] + 20] ^= 1
    path.write_bytes(damaged)
    (tmp_path / "a-recovered.mcap").unlink()
    recovery = recover(path)
    assert (recovery.lost, recovery.is_complete) == ((), False)
    assert recovery.out is not None
    assert len(read_log(recovery.out).time) == 80


def test_rows_of_a_tick_that_not_all_components_have_are_counted_as_lost(tmp_path: Path) -> None:
    # given three rows of a plant, two of a dog and three notes, without chunks, in a file that was closed
    dog, notes = about(2, component="dog"), records.Channel(3, "/notes", "text", {}, 0)
    rows = [row(tick=tick, number=number) for tick in range(3) for number in (1, 2, 3)]
    rows = [message for message in rows if (message.channel_id, message.log_time) != (2, 80_000_000)]
    path = crafted(tmp_path / "a.mcap", *GOOD[:3], dog, notes, *rows)
    recovery = recover(path)
    # then two ticks are whole, and the row and the note of the third are left out
    assert recovery.lost == ("2 messages of ticks that not all components have",)
    assert dict(recovery.messages or {}) == {"/plant": 2, "/dog": 2, "/notes": 2}
    assert recovery.out is not None
    log = read_log(recovery.out)
    assert (len(log.time), log.damage) == (2, "")
    assert "not all components have the same ticks" in log.broken


def test_rows_before_a_damaged_one_in_a_chunk_are_kept(tmp_path: Path) -> None:
    path = crafted(tmp_path / "a.mcap", *GOOD[:3], packed(GOOD[3], row(tick=1), row(b"{}", 2), row(tick=3)))
    out = recover(path).out
    assert out is not None
    assert read_log(out).time.tolist() == [0, 0.04]


def test_topics_of_another_tool_and_logs_without_chunks_are_kept(tmp_path: Path) -> None:
    # given a log by mcap's writer with 40,000 rows outside chunks, and notes of somebody without a schema
    path = tmp_path / "a.mcap"
    one = channel("plant", "canine", north="Real")
    note = b"n" * 100
    with path.open("wb") as file:
        writer: Any = Writer(file, use_chunking=False)
        writer.start(profile="guided-canine")
        writer.add_metadata("log", {"format": "1", "latitude": "0", "longitude": "0"})
        schema = writer.register_schema("canine", "jsonschema", one.schema())
        rows = writer.register_channel("/plant", "json", schema, {"component": "plant", "block": "canine"})
        notes = writer.register_channel("/notes", "text", 0)
        for tick in range(40_000):
            time = tick * 40_000_000
            writer.add_message(rows, time, b'{"north":%d}' % tick, time)
            writer.add_message(notes, time, note, time)
    # when its last bytes, of a note, are cut
    data = path.read_bytes()
    path.write_bytes(data[:-50])
    recovery = recover(path)
    # then every row is there and every note but the last, in chunks that each are read at once
    assert dict(recovery.messages or {}) == {"/plant": 40_000, "/notes": 39_999}
    assert recovery.out is not None
    assert np.array_equal(read_log(recovery.out)["plant.north"], np.arange(40_000))
    with recovery.out.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert max(index.uncompressed_size for index in summary.chunk_indexes) < 4 * 2**20
        assert summary.channels[2].topic == "/notes"
        assert summary.channels[2].schema_id == 0


def test_a_run_that_is_killed_is_recovered_and_agrees_with_the_whole(tmp_path: Path) -> None:
    # given a trial whose process is killed with -9 at 12 s, and the same trial to its end
    code = (
        "import os, sys; from harness import run_trial\n"
        "def kill(time):\n"
        "    if time >= float(sys.argv[2]): os.kill(os.getpid(), 9)\n"
        "run_trial('three_waypoint', out=sys.argv[1], progress=kill)\n"
    )
    root = Path(__file__).parents[3]
    env = {**os.environ, "PYTHONPATH": str(root)}
    for name, until, status in (("killed", "12", -signal.SIGKILL), ("whole", "inf", 0)):
        done = subprocess.run([sys.executable, "-c", code, name, until], cwd=tmp_path, env=env, check=False)
        assert done.returncode == status
    # when
    killed = tmp_path / "killed" / "trial.mcap"
    recovery = recover(killed)
    # then all that the killed process wrote is there, and as the whole run has it
    assert recovery.out is not None
    log, of = read_log(recovery.out), read_log(tmp_path / "whole" / "trial.mcap")
    assert 10 < log.time[-1] < of.time[-1]
    assert is_prefix(log, of)
    with killed.open("rb") as file:
        written = sum(isinstance(r, records.Message) for r in before_the_cut(file))
    assert sum((recovery.messages or {}).values()) == written


def before_the_cut(file: IO[bytes]) -> Iterator[records.McapRecord]:
    """mcap's records of a file, up to where it is cut."""
    with suppress(EndOfFile):
        yield from StreamReader(file).records
