"""The container has the bytes of mcap's own writer."""

import io
import random
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import Writer

from harness.log.container import LEVEL, Container

TOPICS = ("/plant", "/sensors", "/log/events")


def drawn(seed: int, seconds: int) -> list[list[tuple[int, int, bytes]]]:
    """Messages of some seconds (channel, time in ns, data), in the order of their times."""
    draw = random.Random(seed)
    return [
        [
            (draw.randrange(1, 4), 10**9 * second + 4 * 10**7 * tick, draw.randbytes(draw.randrange(400)))
            for tick in range(25)
            for _ in range(draw.randrange(4))
        ]
        for second in range(seconds)
    ]


@pytest.mark.parametrize("seconds", [0, 1, 7])
def test_a_file_is_byte_for_byte_that_of_mcaps_writer(seconds: int, monkeypatch: pytest.MonkeyPatch) -> None:
    # given mcap's writer, with our level of compression, which gets messages one by one
    monkeypatch.setattr(zstandard, "compress", zstandard.ZstdCompressor(level=LEVEL).compress)
    chunks = drawn(seconds, seconds)
    expected = io.BytesIO()
    writer: Any = Writer(expected, chunk_size=2**30, enable_data_crcs=True)
    writer.start("guided-canine", "guided-canine")
    writer.add_metadata("scenario", {"name": "little", "seed": "3"})
    writer.add_attachment(0, 0, "full.ssp", "application/zip", b"PK\0\1")
    schema = writer.register_schema("canine", "jsonschema", b"{}")
    for topic in TOPICS:
        writer.register_channel(topic, "json", schema, {"component": topic})
    for messages in chunks:
        for channel, time, data in messages:
            writer.add_message(channel, time, data, time)
        writer.flush()
    writer.add_metadata("ended", {"reason": "a fault"})
    writer.finish()
    # when the container gets the same in batches
    file = io.BytesIO()
    container = Container(file, "guided-canine")
    container.add_metadata("scenario", {"name": "little", "seed": "3"})
    container.add_attachment("full.ssp", "application/zip", b"PK\0\1")
    number = container.add_schema("canine", "jsonschema", b"{}")
    for topic in TOPICS:
        container.add_channel(topic, "json", number, {"component": topic})
    for messages in chunks:
        for part in (messages[:9], messages[9:]):
            channels, times = [channel for channel, _, _ in part], [time for _, time, _ in part]
            container.add_messages(channels, times, [data for _, _, data in part])
        container.flush()
    container.add_metadata("ended", {"reason": "a fault"})
    container.finish()
    # then
    assert file.getvalue() == expected.getvalue()


def test_a_batch_that_spans_chunks_gives_the_bytes_of_its_parts() -> None:
    def written(parts: list[tuple[list[int], list[int]]]) -> bytes:
        file = io.BytesIO()
        container = Container(file, "guided-canine")
        schema = container.add_schema("s", "jsonschema", b"{}")
        for topic in TOPICS[:2]:
            container.add_channel(topic, "json", schema)
        for times, ends in parts:
            channels = [1 + i % 2 for i in range(len(times))]
            container.add_messages(channels, times, [b"%d" % time for time in times], ends)
        container.finish()
        return file.getvalue()

    # given messages that began a chunk, and a batch that ends it and two more
    whole = written([([0, 0], []), ([1, 1, 2, 2, 3, 3, 4, 4], [1, 3])])
    # when they come chunk by chunk, then
    assert whole == written([([0, 0, 1, 1], [1]), ([2, 2, 3, 3], [3]), ([4, 4], [])])
    assert whole != written([([0, 0], []), ([1, 1, 2, 2, 3, 3, 4, 4], [])])


def test_messages_of_a_batch_come_in_the_order_of_their_times() -> None:
    # given two channels' messages, one channel after the other
    file = io.BytesIO()
    container = Container(file, "guided-canine")
    schema = container.add_schema("s", "jsonschema", b"{}")
    for topic in TOPICS[:2]:
        container.add_channel(topic, "json", schema)
    container.add_messages([1, 1, 2, 2], np.array([0, 40, 0, 40]), [b"a", b"c", b"b", b"d"])
    container.finish()
    file.seek(0)
    # when mcap's reader reads them as they lie in the file
    read = make_reader(file).iter_messages(log_time_order=False)
    # then those of one time keep the order in which they were given
    assert [(c.topic, m.log_time, m.data) for _, c, m in read] == [
        ("/plant", 0, b"a"), ("/sensors", 0, b"b"), ("/plant", 40, b"c"), ("/sensors", 40, b"d")
    ]  # fmt: skip
