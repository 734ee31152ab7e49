"""Reads MCAP files sequentially; any damage raises a `DemonstrationError`."""

import io
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import zstandard
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import MAGIC_SIZE, StreamReader, breakup_chunk
from mcap.well_known import MessageEncoding
from mcap.writer import MCAP0_MAGIC

from poil_drake.errors import DemonstrationError, InvalidValueError

# What the parsers raise on damaged bytes; the LZ4 library's own error is a RuntimeError.
_PARSE_ERRORS = (
    *(McapError, zstandard.ZstdError, struct.error, ValueError, LookupError, AttributeError),
    *(EOFError, RuntimeError, MemoryError, OverflowError),
)
# Each call makes a new decompressor, because threads must not share one of zstandard's.
_DECOMPRESSORS = {
    "zstd": lambda data: zstandard.ZstdDecompressor().stream_reader(data),
    "lz4": lambda data: lz4.frame.open(io.BytesIO(data)),
}

LARGEST_CHUNK = 256 << 20
"""Largest size of a decompressed chunk [bytes]. It holds an image of 8192 x 8192 pixels, far more
than recorders write at once."""

Location = tuple[int, int]
"""Where a message is in a file: the offset [bytes] of its record, or of the chunk that holds it,
and its index among the records of that chunk (0 without a chunk)."""


class ScannedMessage(NamedTuple):
    """A message in a file, not yet decoded.

    Attributes:
        topic: Its topic.
        schema: The name of its schema; "" if it has none.
        encoding: Its message encoding, e.g. "protobuf".
        log_time: When it was logged [ns].
        data: Its bytes.
        location: Where to find it again.
    """

    topic: str
    schema: str
    encoding: str
    log_time: int
    data: bytes
    location: Location

    def message_type(self, *candidates: Any) -> Any:
        """Returns the Foxglove class in `candidates` that the schema names, or None."""
        if self.encoding != MessageEncoding.Protobuf:
            return None
        return next((c for c in candidates if c.DESCRIPTOR.full_name == self.schema), None)

    def decode(self, *candidates: Any) -> Any:
        """Returns the message, decoded as the Foxglove class in `candidates` that its schema names.

        Raises:
            InvalidValueError: if its schema names no candidate, or the message is damaged.
        """
        message_type = self.message_type(*candidates)
        if message_type is None:
            names = " or ".join(candidate.DESCRIPTOR.full_name for candidate in candidates)
            raise InvalidValueError(
                f"the topic holds '{self.schema}' messages encoded as '{self.encoding}', not "
                f"{names} encoded as 'protobuf'.",
                remedy="Convert the topic as described in docs/demonstration_format.md.",
            )
        try:
            return message_type.FromString(self.data)
        except DecodeError as error:
            raise InvalidValueError(
                f"a message is damaged: {error}.", remedy="Record the demonstration again."
            ) from error


class CutOffError(DemonstrationError):
    """A file ends before its footer, e.g. because its recorder was killed."""


def scan(path: Path) -> Iterator[ScannedMessage | Metadata | Attachment]:
    """Yields the messages, metadata and attachments of a file, in file order.

    Checks the CRC of each chunk, and that of the data section if it has one.

    Raises:
        CutOffError: if the file is cut off; raised after yielding all items before the cut.
        DemonstrationError: if the file cannot be opened, is empty, is not MCAP, or is damaged.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    with _open(path) as file:
        start = file.peek(MAGIC_SIZE)[:MAGIC_SIZE]
        if not start:
            raise DemonstrationError(f"{path} is empty.", remedy="Record the demonstration again.")
        if not MCAP0_MAGIC.startswith(start):
            raise DemonstrationError(
                f"{path} is not an MCAP file.",
                remedy="Convert the recording to MCAP in the layout of "
                "docs/demonstration_format.md. If it is a ROS bag, use `poil demo import`.",
            )
        for outer in file.records():
            for entry, record in enumerate(_unpack(outer)):
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    yield ScannedMessage(
                        topic=channel.topic,
                        schema=schemas[channel.schema_id].name if channel.schema_id else "",
                        encoding=channel.message_encoding,
                        log_time=record.log_time,
                        data=record.data,
                        location=(file.position, entry),
                    )
                elif isinstance(record, Metadata | Attachment):
                    yield record


def read_messages(path: Path, locations: Sequence[Location]) -> list[bytes]:
    """Returns the data of several messages, in the order of `locations`; reads each chunk once.

    Raises:
        DemonstrationError: if the file has changed or vanished since it was scanned.
    """
    records: dict[int, Any] = {}
    with _open(path) as file:
        for position in sorted({position for position, _ in locations}):
            file.seek(position)
            records[position] = _unpack(next(file.records(skip_magic=True)))
        return [records[position][entry].data for position, entry in locations]


class _CheckedFile(io.BufferedReader):
    """A file whose reads either return all requested bytes or raise an error.

    The `mcap` library's `StreamReader` does not notice a short read, and a damaged length field
    makes it allocate any amount of memory.

    Attributes:
        position: Offset of the current record of `records` [bytes].
    """

    def __init__(self, path: Path):
        super().__init__(io.FileIO(path))
        self._path, self._size, self.position = path, path.stat().st_size, MAGIC_SIZE

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > self._size - self.tell():
            # A complete file starts and ends with the magic bytes.
            if self._size >= 2 * MAGIC_SIZE:
                self.seek(-MAGIC_SIZE, io.SEEK_END)
                if super().read() == MCAP0_MAGIC:
                    raise ValueError("the record reaches beyond the end of the file")
            raise CutOffError(
                f"{self._path} is cut off: it ends inside the record at byte {self.position}, "
                "without a footer.",
                remedy="Record again, or save what is left with "
                f"`mcap recover {self._path} -o recovered.mcap`.",
            )
        return super().read(size)

    def records(self, *, skip_magic: bool = False) -> Iterator[McapRecord]:
        """Yields the records from the current offset to the footer, without unpacking chunks."""
        records = StreamReader(
            self, skip_magic, emit_chunks=True, validate_crcs=True, record_size_limit=None
        ).records
        self.position = max(self.tell(), MAGIC_SIZE)
        for record in records:
            yield record
            self.position = self.tell()


@contextmanager
def _open(path: Path) -> Iterator[_CheckedFile]:
    """Opens a file; errors of reading or parsing it raise a `DemonstrationError`."""
    try:
        with _CheckedFile(path) as file:
            try:
                yield file
            except _PARSE_ERRORS as error:
                raise DemonstrationError(
                    f"{path} is damaged in the record at byte {file.position}: "
                    f"{error or type(error).__name__}.",
                    remedy="Copy the file again from its origin, or save what is left "
                    f"with `mcap recover {path} -o recovered.mcap`.",
                ) from error
    except OSError as error:
        raise DemonstrationError(
            f"{path} cannot be read: {error.strerror or error}.",
            remedy="Check the path and its permissions.",
        ) from error


def _unpack(record: McapRecord) -> list[McapRecord]:
    """Returns the records in a chunk, after checking its size and CRC; otherwise `[record]`.

    Rejects a chunk larger than `LARGEST_CHUNK`, because decompressing it could exhaust the memory.
    """
    if not isinstance(record, Chunk):
        return [record]
    size = record.uncompressed_size
    if size > LARGEST_CHUNK:
        raise ValueError(
            f"a chunk decompresses to {size >> 20} MiB, more than {LARGEST_CHUNK >> 20} MiB"
        )
    if record.compression:
        if record.compression not in _DECOMPRESSORS:
            raise UnsupportedCompressionError(record.compression)
        with _DECOMPRESSORS[record.compression](record.data) as stream:
            data = stream.read(size + 1)
        if len(data) != size:
            raise ValueError("a chunk does not decompress to its stated size")
        record = replace(record, compression="", data=data)
    return breakup_chunk(record, validate_crc=True)
