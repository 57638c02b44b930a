"""An MCAP file written a chunk at a time, from batches of messages.

The file holds the bytes that mcap's `Writer` would write: one message costs that Writer as much as a tick
costs the FMUs, and each chunk costs it a new compressor. The records are mcap's; only messages and their
index, thousands a second, are laid out in numpy.

An exception may end any method, between any two lines: what it did counts as a whole or not at all, and the
container can be used further. Each write ends with one assignment that says so; a write that did not come so
far is written over by the next.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import IO, TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

if TYPE_CHECKING:
    from harness.log.live import Viewers

COMPRESSION = "zstd"
LEVEL = 1  # the third costs a third more time and saves 3 % of space
T = TypeVar("T")
Times = npt.NDArray[np.int64]
Index = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]  # (n,) channels, (n, 2) log times and places


class _Part(NamedTuple):
    """Of a chunk that is not written yet: records, their index if they are messages, the size with them."""

    data: bytes
    places: Index | None
    end: int


_PREFIX = 9  # bytes before every record: opcode, length of what follows
_MESSAGE = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
_INDEX = struct.Struct("<BQHI")  # opcode, length of what follows, channel, length of the entries
_INDEX_ENTRY = 16  # bytes: log time, place in the chunk


class Container:
    """Writes an MCAP file.

    Messages, schemas and channels gather in a chunk until `flush` compresses and writes it; everything else
    is written at once. Log time and publish time are equal, and every sequence number is 0. Viewers are sent
    the messages once the container has them.

    Raises:
        OSError: from every method, if the file cannot be written.
    """

    def __init__(self, file: IO[bytes], profile: str, viewers: Viewers | None = None) -> None:
        self._file = file
        self._viewers = viewers
        self._position = 0
        self._checksum = 0  # CRC-32 of what is before the position
        self._compressor = zstandard.ZstdCompressor(level=LEVEL)
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        # by place in the file: the index of a record, if it has one, and its messages by channel
        self._written: dict[int, tuple[Any, dict[int, int]]] = {}
        self._pending: list[_Part] = []
        self._is_writing = False
        self._write(MCAP0_MAGIC)
        self._write(_encoded(records.Header(profile, profile)))

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        data = _encoded(records.Metadata(name, dict(values)))
        self._write(data, records.MetadataIndex(self._position, len(data), name))

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment, dated to time 0."""
        record = _encoded(records.Attachment(0, 0, name, media_type, data))
        index = records.AttachmentIndex(self._position, len(record), 0, 0, len(data), name, media_type)
        self._write(record, index)

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema to the chunk; its number."""
        number = len(self._schemas) + 1
        self._schemas.append(records.Schema(id=number, data=data, encoding=encoding, name=name))
        self._append(_encoded(self._schemas[-1]))
        return number

    def add_channel(
        self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Add a channel of messages of a schema to the chunk; its number."""
        number = len(self._channels) + 1
        self._channels.append(records.Channel(number, topic, encoding, dict(metadata or {}), schema))
        self._append(_encoded(self._channels[-1]))
        if self._viewers is not None:
            self._viewers.add_channel(self._channels[-1], self._schemas[schema - 1])
        return number

    def add_messages(
        self,
        channels: npt.ArrayLike,
        times: npt.ArrayLike,
        messages: Sequence[bytes],
        ends: npt.ArrayLike = (),
    ) -> None:
        """Add messages in the order of their times; messages of one time keep their order.

        Args:
            channels: (n,) the channel of each message.
            times: (n,) the log time of each message, ns.
            messages: n encoded messages.
            ends: (m,) ascending log times, ns, after each of which the chunk is flushed.
        """
        order = np.argsort(times, kind="stable")
        numbers, moments = np.asarray(channels)[order], np.asarray(times)[order]
        ordered = [messages[i] for i in order.tolist()]
        headers = np.zeros(len(ordered), dtype=_MESSAGE)
        headers["opcode"] = Opcode.MESSAGE
        lengths = np.fromiter(map(len, ordered), dtype=np.int64, count=len(ordered)) + _MESSAGE.itemsize
        headers["length"] = lengths - _PREFIX
        headers["channel"] = numbers
        headers["log_time"] = headers["publish_time"] = moments
        places = np.cumsum(lengths) - lengths
        pieces = [b""] * (2 * len(ordered))
        pieces[::2] = headers.view(f"V{_MESSAGE.itemsize}").tolist()
        pieces[1::2] = ordered
        bounds = [0, *np.searchsorted(moments, ends, side="right").tolist(), len(ordered)]
        for i, (start, end) in enumerate(pairwise(bounds)):
            if start < end:
                entries = np.empty((end - start, 2), dtype="<i8")
                entries[:, 0] = moments[start:end]
                entries[:, 1] = places[start:end] + (self._size - places[start])
                self._append(b"".join(pieces[2 * start : 2 * end]), (numbers[start:end], entries))
            if i < len(bounds) - 2:
                self.flush()
        if self._viewers is not None:
            self._viewers.send(numbers.tolist(), moments.tolist(), ordered)

    def flush(self) -> None:
        """Compress the messages so far into a chunk, and hand it to the operating system."""
        if index := [part.places for part in self._pending if part.places is not None]:
            self._write_chunk(b"".join(part.data for part in self._pending), index)
        self._file.flush()

    def _write_chunk(self, data: bytes, index: Sequence[Index]) -> None:
        """Write a chunk and the index of its messages: by channel, their times and places in `data`."""
        channels, entries = index[0]
        if len(index) > 1:
            channels = np.concatenate([numbers for numbers, _ in index])
            entries = np.concatenate([places for _, places in index])
        first, last = int(entries[0, 0]), int(entries[-1, 0])
        compressed = self._compressor.compress(data)
        pieces = [_encoded(records.Chunk(COMPRESSION, compressed, last, first, zlib.crc32(data), len(data)))]
        length = end = len(pieces[0])
        offsets, counts = {}, {}
        by_channel = entries[np.argsort(channels, kind="stable")].tobytes()
        ends = (np.cumsum(np.bincount(channels)) * _INDEX_ENTRY).tolist()
        for number in dict.fromkeys(channels.tolist()):  # in the order in which they come in the chunk
            places = by_channel[ends[number - 1] : ends[number]]
            offsets[number] = self._position + end
            head = _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(places), number, len(places))
            pieces += [head, places]
            end += len(head) + len(places)
            counts[number] = len(places) // _INDEX_ENTRY
        noted = records.ChunkIndex(
            chunk_length=length,
            chunk_start_offset=self._position,
            compression=COMPRESSION,
            compressed_size=len(compressed),
            message_end_time=last,
            message_index_length=end - length,
            message_index_offsets=offsets,
            message_start_time=first,
            uncompressed_size=len(data),
        )
        self._write(b"".join(pieces), noted, counts, pending=[])

    def finish(self) -> None:
        """Write the last chunk and the summary: nothing can be added after it."""
        self.flush()
        self._write(_encoded(records.DataEnd(self._checksum)))
        groups: dict[Opcode, Iterable[Any]] = {
            Opcode.SCHEMA: self._schemas,
            Opcode.CHANNEL: self._channels,
            Opcode.STATISTICS: [self._statistics()],
            Opcode.CHUNK_INDEX: self._indices(records.ChunkIndex),
            Opcode.ATTACHMENT_INDEX: self._indices(records.AttachmentIndex),
            Opcode.METADATA_INDEX: self._indices(records.MetadataIndex),
        }
        start = self._position
        summary, offsets = b"", b""
        for opcode, group in groups.items():
            data = b"".join(_encoded(record) for record in group)
            offsets += _encoded(records.SummaryOffset(opcode, start + len(summary), len(data)))
            summary += data
        offsets_start = start + len(summary)
        summary += offsets
        # the sum covers the footer up to the sum itself
        footer = _encoded(records.Footer(start, offsets_start, 0))[:-4]
        self._write(summary)
        self._write(_encoded(records.Footer(start, offsets_start, zlib.crc32(footer, zlib.crc32(summary)))))
        self._write(MCAP0_MAGIC)

    def _indices(self, kind: type[T]) -> list[T]:
        """The index of all records of a kind, in the order of the file."""
        return [index for index, _ in self._written.values() if isinstance(index, kind)]

    def _statistics(self) -> records.Statistics:
        chunks = self._indices(records.ChunkIndex)
        counts: Counter[int] = Counter()
        for _, of_record in self._written.values():
            counts.update(of_record)
        return records.Statistics(
            attachment_count=len(self._indices(records.AttachmentIndex)),
            channel_count=len(self._channels),
            channel_message_counts=counts,
            chunk_count=len(chunks),
            message_count=counts.total(),
            message_end_time=chunks[-1].message_end_time if chunks else 0,
            message_start_time=chunks[0].message_start_time if chunks else 0,
            metadata_count=len(self._indices(records.MetadataIndex)),
            schema_count=len(self._schemas),
        )

    @property
    def _size(self) -> int:
        """Bytes of the chunk so far."""
        return self._pending[-1].end if self._pending else 0

    def _append(self, data: bytes, index: Index | None = None) -> None:
        self._pending.append(_Part(data, index, self._size + len(data)))

    def _write(
        self,
        data: bytes,
        index: Any = None,
        counts: dict[int, int] | None = None,
        pending: list[_Part] | None = None,
    ) -> None:
        """Write a record, and note its index and its messages by channel; `pending` is what remains then."""
        remaining = self._pending if pending is None else pending
        if self._is_writing:  # the last write did not come to its end
            self._file.seek(self._position)
            self._file.truncate()
        end, checksum = self._position + len(data), zlib.crc32(data, self._checksum)
        self._is_writing = True
        self._written[self._position] = index, counts or {}
        self._file.write(data)
        # one step: no call in between after which an interrupt could act
        self._position, self._checksum, self._pending, self._is_writing = end, checksum, remaining, False


def _encoded(record: Any) -> bytes:
    builder: Any = RecordBuilder()  # mcap types half of it
    record.write(builder)
    data: bytes = builder.end()
    return data
