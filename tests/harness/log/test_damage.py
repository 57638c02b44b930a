"""A damaged or crafted log gives what the whole one gave, or says what is wrong: never another content."""

import json
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC, Writer

from harness.log.log import Log, LogError, read_log
from tests.harness.log.test_log import CONTROLLER, PLANT, channel, walk, write
from tests.memory import PRINT_PEAK

ONE = channel("plant", "canine", north="Real")
SECOND = 10**9  # ns


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A log of three chunks."""
    path = tmp_path_factory.mktemp("log") / "a.mcap"
    write(
        path,
        [PLANT, CONTROLLER],
        [{**rows, "controller": [1, k // 9, 0, 0]} for k, rows in enumerate(walk(30))],
    )
    return path.read_bytes()


def killed(whole: bytes) -> bytes:
    """The log as a run leaves it that is killed before its last chunk."""
    third = [at for at in range(len(whole)) if whole.startswith(b"zstd", at)][2]
    return whole[: third - 100]


def is_prefix(log: Log, of: Log) -> bool:
    """Does the log have the first ticks of the other, bit for bit, and all that stands before the ticks?"""
    n = len(log.time)
    return (
        (log.metadata, log.attachments, log.origin) == (of.metadata, of.attachments, of.origin)
        and log.channels == of.channels
        and log.time.tobytes() == of.time[:n].tobytes()
        and all(log.values[name].tobytes() == of.values[name][:n].tobytes() for name in of.values)
    )


def check_damaged(data: bytes, of: Log, path: Path) -> None:
    """Fails if the file is read as another content, or as less than the whole without a word."""
    path.write_bytes(data)
    try:
        log = read_log(path)
    except LogError as error:
        assert "\n" not in str(error)  # noqa: PT017 - what it says is another test
        return
    assert is_prefix(log, of)
    assert len(log.time) == len(of.time) or log.broken


@pytest.mark.parametrize("cut", [False, True], ids=["closed", "killed"])
@pytest.mark.parametrize("bit", range(8))
def test_a_flipped_bit_is_harmless_or_noticed(bit: int, cut: bool, whole: bytes, tmp_path: Path) -> None:
    # given the log of a run that came to its end, and of one that was killed
    data = killed(whole) if cut else whole
    (tmp_path / "a.mcap").write_bytes(data)
    of = read_log(tmp_path / "a.mcap")
    assert bool(of.broken) == cut
    # when one bit is flipped, at another place for each bit
    for at in range(bit * 13, len(data), 103):
        damaged = bytearray(data)
        damaged[at] ^= 1 << bit
        # then the content is the same, or a shorter one that says so, or the log is refused
        check_damaged(bytes(damaged), of, tmp_path / "b.mcap")


def test_a_length_that_no_memory_has_is_damage(whole: bytes, tmp_path: Path) -> None:
    # given the second chunk's data with a length above 2^63: the top bit of the field after "zstd"
    second = whole.index(b"zstd", whole.index(b"zstd") + 4)
    data = bytearray(whole)
    data[second + 4 + 7] |= 0x80
    (tmp_path / "a.mcap").write_bytes(data)
    # then the first chunk's tick is there
    log = read_log(tmp_path / "a.mcap")
    assert len(log.time) == 1
    assert "damaged at byte" in log.broken


@pytest.mark.parametrize("cut", [False, True], ids=["closed", "killed"])
@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        (b"little", b"litthe", "metadata scenario"),
        (b"25.0", b"35.0", "metadata parameters"),
        (b"controller.home_north", b"controllor.home_north", "metadata parameters"),
        (b"PK\0\1", b"PK\0\0", "attachment full.ssp"),
        (b"32.6", b"32.7", "metadata log"),
        (b"scenario", b"scenarjo", "metadata scenario"),
    ],
)
def test_a_log_whose_run_is_not_certain_is_refused(
    old: bytes, new: bytes, what: str, *, cut: bool, whole: bytes, tmp_path: Path
) -> None:
    # given a log in which a scenario, a parameter, a package differs, and none of MCAP's own checks knows
    data = (killed(whole) if cut else whole).replace(old, new, 1)
    if b"PK" in old:
        at = data.index(new) + len(new)
        data = data[:at] + bytes(4) + data[at + 4 :]  # the attachment's own checksum: none
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    # then it says which, and no run comes of it
    with pytest.raises(LogError, match=f"the {what} is damaged .*: which run it is cannot be told"):
        read_log(path)


def test_the_checksums_are_mcaps_own(whole: bytes, tmp_path: Path) -> None:
    # given mcap's reader, which checks that of each chunk and of all the data
    path = tmp_path / "a.mcap"
    path.write_bytes(whole)
    with path.open("rb") as file:
        read = list(StreamReader(file, emit_chunks=True, validate_crcs=True).records)
    (end,) = (record for record in read if isinstance(record, records.DataEnd))
    (footer,) = (record for record in read if isinstance(record, records.Footer))
    at = whole.rindex(struct.pack("<BQ", 0x0F, 4))
    assert end.data_section_crc == zlib.crc32(whole[:at])
    assert footer.summary_crc != 0
    # and a byte of an index, which no chunk covers, differs for it
    damaged = bytearray(whole)
    damaged[at - 1] ^= 1
    path.write_bytes(damaged)
    with path.open("rb") as file, pytest.raises((ValueError, McapError)):
        list(StreamReader(file, validate_crcs=True).records)
    assert "the checksum over all before is" in read_log(path).broken


def test_a_log_that_another_tool_wrote_anew_is_still_whole(whole: bytes, tmp_path: Path) -> None:
    # given a copy, message by message, whose metadata come in another order
    (tmp_path / "a.mcap").write_bytes(whole)
    with (tmp_path / "a.mcap").open("rb") as file, (tmp_path / "b.mcap").open("wb") as copy:
        reader = make_reader(file)
        writer: Any = Writer(copy, chunk_size=300)
        writer.start("guided-canine", "another tool")
        for metadata in list(reader.iter_metadata())[::-1]:
            writer.add_metadata(metadata.name, metadata.metadata)
        for attachment in reader.iter_attachments():
            writer.add_attachment(0, 0, attachment.name, attachment.media_type, attachment.data)
        numbers = {}
        for schema, about, message in reader.iter_messages():
            if about.id not in numbers:
                assert schema is not None
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[about.id] = writer.register_channel(
                    about.topic, about.message_encoding, number, about.metadata
                )
            writer.add_message(numbers[about.id], message.log_time, message.data, message.log_time)
        writer.finish()
    log, of = read_log(tmp_path / "b.mcap"), read_log(tmp_path / "a.mcap")
    assert is_prefix(log, of)
    assert len(log.time) == 30


def crafted(path: Path, *parts: Any) -> Path:
    """An MCAP file of some records, which came to its end."""
    builder: Any = RecordBuilder()
    for record in (records.Header("guided-canine", ""), *parts, records.DataEnd(0), records.Footer(0, 0, 0)):
        record.write(builder)
    path.write_bytes(MCAP0_MAGIC + builder.end() + MCAP0_MAGIC)
    return path


OWN = records.Metadata("log", {"format": "1", "latitude": "0", "longitude": "0"})
SCHEMA = records.Schema(id=1, data=ONE.schema(), encoding="jsonschema", name="canine")


def about(number: int = 1, schema: int = 1, component: str = "plant") -> records.Channel:
    return records.Channel(
        number, f"/{component}", "json", {"component": component, "block": "canine"}, schema
    )


def row(data: bytes = b'{"north":1.0}', tick: float = 0, number: int = 1) -> records.Message:
    time = int(tick * 40_000_000)
    return records.Message(number, time, data, time, 0)


GOOD = [OWN, SCHEMA, about(), row()]


def packed(*parts: Any, compression: str = "zstd", data: bytes | None = None, size: int | None = None) -> Any:
    """A chunk of some records, or one that states something else than it holds."""
    builder: Any = RecordBuilder()
    for record in parts:
        record.write(builder)
    content = builder.end()
    content = zstandard.compress(content) if data is None else data
    whole = len(zstandard.decompress(content)) if size is None else size
    return records.Chunk(compression, content, 0, 0, 0, whole)


def outcome(path: Path) -> tuple[int, str]:
    """How many ticks of a file are read, and what is said about the others."""
    try:
        log = read_log(path)
    except LogError as error:
        return 0, str(error).removeprefix(f"log {path}: ")
    return len(log.time), log.broken


DEEP = b"[" * 100_000
HUGE = zstandard.compress(bytes(2**28))  # 256 MiB of zeros in 8 kB


@pytest.mark.parametrize(
    ("parts", "ticks", "text"),
    [
        ([row(b"1", 1)], 1, 'the row of "plant" at 0.04 s is a int; expected an object'),
        ([row(b"[1.0]", 1)], 1, 'the row of "plant" at 0.04 s is a list; expected an object'),
        ([row(b'{"north":' + DEEP, 1)], 1, 'a row of "plant" is no JSON (depth limit exceeded'),
        ([row(b"{}", 1)], 1, "at 0.04 s lacks the signal 'north', unlike its schema"),
        ([row(b'{"north":1.0,"east":2}', 1)], 1, "at 0.04 s has a signal 'east', unlike its schema"),
        ([row(b'{"north":"1.5"}', 1)], 1, "\"plant.north\" is '1.5'; expected a Real"),
        ([row(b'{"north":true}', 1)], 1, '"plant.north" is True; expected a Real'),
        ([row(b'{"north":null}', 1)], 1, '"plant.north" is None; expected a Real'),
        ([row(b'{"north":1},{"north":2}', 1)], 1, 'a message of "plant" is not one row'),
        ([row(tick=1), row(tick=1)], 2, "the time does not grow after the tick at 0.04 s"),
        ([row(tick=2), row(tick=1)], 2, "the time does not grow after the tick at 0.08 s"),
        ([row(tick=2**63 / 4e7)], 1, "a tick is at 9.22337e+09 s; a log has none after 9.0072e+06 s"),
        ([packed(row(tick=1)), row(tick=2), row(tick=4)], 3, "ticks between 0.08 and 0.16 s are missing"),
        ([about(component="dog")], 1, "two channels have the number 1"),
        ([about(2)], 1, 'two channels have the rows of "plant"'),
        ([about(2, 7, "dog")], 1, 'channel "/dog" names schema 7, which is missing'),
        ([records.Schema(id=1, data=b"{}", encoding="", name="")], 1, "two schemas have the number 1"),
        ([about(2, component="dog"), row(tick=1)], 0, "the same ticks: 2 of plant, 0 of dog"),
        ([row(number=9)], 1, "a message of channel 9, which is missing"),
        ([packed(row(tick=1, number=9))], 1, "a message of channel 9, which is missing"),
        ([packed(data=HUGE, size=2**28)], 1, "a chunk unpacks to 256 MiB, more than a log's chunk holds"),
        ([packed(data=HUGE, size=100)], 1, "a chunk of 100 bytes unpacks to 268435456"),
        ([packed(data=b"\x04\x22\x4d\x18bad", size=9, compression="lz4")], 1, "LZ4F_"),
        ([packed(data=b"bad", size=9)], 1, "Unknown frame descriptor"),
        ([packed(data=b"bad", size=9, compression="")], 1, "a chunk of 9 bytes unpacks to 3"),
        ([packed(data=b"", size=0, compression="brotli")], 1, 'has compression "brotli"; expected zstd'),
        ([packed(data=b"\5\xff\0\0\0\0\0\0\0", size=9, compression="")], 1, "a record leaves its chunk"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_crafted_log_is_named_with_its_place(
    parts: list[Any], ticks: int, text: str, tmp_path: Path
) -> None:
    # given a log with one good tick before what is crafted
    path = crafted(tmp_path / "a.mcap", *GOOD[:3], packed(GOOD[3]), *parts)
    # then that tick is kept, and the rest is told
    read, said = outcome(path)
    assert text in said
    assert read == ticks
    assert "damaged" in said


@pytest.mark.parametrize(
    "schema",
    [
        b"", b"[]", b"{}", b'{"properties":[]}', b'{"properties":{"a":1}}', b'{"properties":{"a":{}}}', DEEP,
        b'{"properties":{"a":{"type":"text","unit":"","description":""}}}',
        b'{"properties":{"a":{"type":["number"],"unit":"","description":""}}}',
        b'{"properties":{"a":{"type":"number","unit":1,"description":""}}}',
    ],
)  # fmt: skip
def test_a_schema_that_describes_no_rows_is_named(schema: bytes, tmp_path: Path) -> None:
    wrong = records.Schema(id=1, data=schema, encoding="jsonschema", name="canine")
    read, said = outcome(crafted(tmp_path / "a.mcap", OWN, wrong, about(), row()))
    assert read == 0
    assert 'the schema of "plant" ' in said


def test_a_crafted_log_costs_bounded_time_and_memory(tmp_path: Path) -> None:
    # given 300 kB that unpack to 1.5 GB, whose chunk says so, says less, or comes a hundred times
    bomb = zstandard.compress(bytes(1_500_000_000), 1)
    large = zstandard.compress(bytes(100 * 2**20), 1)
    for name, parts in {
        "true": [packed(data=bomb, size=1_500_000_000)],
        "small": [packed(data=bomb, size=1000)],
        "many": [packed(data=large, size=100 * 2**20)] * 100,
        "deep": [row(DEEP, 1)],
    }.items():
        crafted(tmp_path / f"{name}.mcap", *GOOD, *parts)
    code = (
        "import sys; from pathlib import Path; from harness.log.log import read_log\n"
        "for path in sorted(Path(sys.argv[1]).glob('*.mcap')): print(len(read_log(path).time))\n"
        f"{PRINT_PEAK}"
    )
    # when they are read, in a process of their own
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        capture_output=True, check=True, text=True, timeout=60, cwd=Path(__file__).parents[3],
    )  # fmt: skip
    # then the good tick of each is kept, and the process has stayed below 600 MiB
    *ticks, mebibytes = map(int, done.stdout.split())
    assert ticks == [1, 1, 1, 1]
    assert mebibytes < 600


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_bytes_cut_flipped_moved_or_put_in_are_harmless_or_noticed(
    data: st.DataObject, whole: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("fuzz")
    (folder / "a.mcap").write_bytes(whole)
    damaged = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 3))):
        at, length = data.draw(st.integers(0, len(whole))), data.draw(st.integers(0, 40))
        damaged[at : at + length] = data.draw(st.binary(max_size=40))
    check_damaged(bytes(damaged), read_log(folder / "a.mcap"), folder / "b.mcap")


KEYS = st.sampled_from(["north", "properties", "type"])
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=6,
).map(lambda value: json.dumps(value).encode())
NUMBERS = st.integers(0, 3)
TIMES = st.integers(0, 5).map(float) | st.just(2**63 / 4e7)
NAMES = st.sampled_from(["log", "ended", "crc32"])
VALUES = st.dictionaries(st.sampled_from(["format", "latitude", "reason"]), st.text(max_size=4))
PARTS = (
    st.builds(row, JSON, TIMES, NUMBERS)
    | st.builds(row, st.floats().map(lambda x: f'{{"north":{x}}}'.encode()), TIMES, NUMBERS)
    | st.builds(about, NUMBERS, NUMBERS, st.sampled_from(["plant", "dog", "a\nb"]))
    | st.builds(lambda number, data: records.Schema(number, data, "", ""), NUMBERS, JSON)
    | st.builds(records.Metadata, NAMES, VALUES)
)


@settings(max_examples=100, deadline=None)
@given(parts=st.lists(PARTS, max_size=8), first=st.integers(0, 4), chunked=st.booleans())
def test_records_in_any_order_raise_nothing_but_errors_of_ours(
    parts: list[Any], first: int, chunked: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    made = [*GOOD[:first], *([packed(*parts)] if chunked else parts)]
    path = crafted(tmp_path_factory.mktemp("fuzz") / "a.mcap", *made)
    ticks, said = outcome(path)
    assert said.isprintable()
    assert ticks <= 9


@pytest.mark.parametrize(
    ("own", "text"),
    [
        ({"format": "3"}, 'format "3", expected "2"; update canine'),
        ({"latitude": "0"}, 'damaged, it has no metadata "log"; take another copy'),
        ({"format": "2"}, "the metadata log is damaged"),
    ],
)
def test_a_log_of_another_format_is_refused(own: dict[str, str], text: str, tmp_path: Path) -> None:
    read, said = outcome(crafted(tmp_path / "a.mcap", records.Metadata("log", own), *GOOD[1:]))
    assert read == 0
    assert text in said


def test_a_file_whose_first_record_is_not_a_header_is_refused(tmp_path: Path) -> None:
    builder: Any = RecordBuilder()
    for record in GOOD:
        record.write(builder)
    (tmp_path / "a.mcap").write_bytes(MCAP0_MAGIC + builder.end())
    with pytest.raises(LogError, match="damaged at its first record, which is not a header"):
        read_log(tmp_path / "a.mcap")
