"""Reads MCAP files record by record, so that damage is found before anything relies on them."""

import io
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Message, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from poil_drake.errors import DemonstrationError

# What the parsers of damaged bytes raise; the LZ4 library's own error is a RuntimeError.
_PARSE_ERRORS = (
    *(McapError, zstandard.ZstdError, struct.error),
    *(ValueError, KeyError, EOFError, RuntimeError, MemoryError, OverflowError),
)
_FRAMING = struct.Struct("<BQ")

LARGEST_CHUNK = 256 << 20
"""How much a chunk may hold [bytes]: an image of 8192 x 8192 pixels, and far more than recorders
write at once."""


@dataclass(frozen=True)
class Location:
    """Where a message stands in a file.

    Attributes:
        record: Offset of the record in the file that is, or whose chunk holds, the message.
        start: Offset of the message's data in the (decompressed) content of that record.
        size: Size of the message's data [bytes].
    """

    record: int
    start: int
    size: int


@dataclass(frozen=True)
class ScannedMessage:
    """A message met on the way through a file.

    Attributes:
        topic: Its topic.
        schema: The name of its schema; "" for none.
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


class CutOffError(DemonstrationError):
    """A file ends before its footer: whoever wrote it was stopped."""


class _DamageError(ValueError):
    """Bytes that are not what MCAP wants."""


def scan(path: Path) -> Iterator[ScannedMessage | Metadata | Attachment]:
    """Yields the messages, metadata and attachments of a file, in its order.

    Chunks are checked against their CRC, and the data section against its own where there is one.

    Raises:
        CutOffError: if the file is cut off, after all that it holds.
        DemonstrationError: if it cannot be opened, is empty, is not MCAP, or is damaged.
    """
    position = 0
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            _check_start(path, file.read(len(MCAP0_MAGIC)))
            crc = zlib.crc32(MCAP0_MAGIC)
            schemas: dict[int, Schema] = {}
            channels: dict[int, Channel] = {}
            while True:
                position = file.tell()
                opcode, content = _read_record(file, size)
                if opcode == Opcode.FOOTER:
                    if file.read() != MCAP0_MAGIC:
                        raise EOFError
                    return
                if opcode == Opcode.DATA_END:
                    wanted = DataEnd.read(ReadDataStream(io.BytesIO(content))).data_section_crc
                    if wanted not in (0, crc):
                        raise _DamageError("the checksum of the data section does not fit")
                crc = zlib.crc32(content, zlib.crc32(_FRAMING.pack(opcode, len(content)), crc))
                yield from _interpret(position, opcode, content, schemas, channels)
    except EOFError as error:
        raise CutOffError(
            f"{path} is cut off: it ends inside the record at byte {position}, without a footer.",
            remedy="Its recorder was stopped before it finished. Record again, or save what is "
            f"left with `mcap recover {path} -o recovered.mcap`.",
        ) from error
    except OSError as error:
        raise _unreadable(path, error) from error
    except _PARSE_ERRORS as error:
        raise _damaged(path, position, error) from error


def read_messages(path: Path, locations: Sequence[Location]) -> list[bytes]:
    """Returns the data of several messages; a chunk that holds more than one is read once.

    Raises:
        DemonstrationError: if the file has changed or vanished since it was scanned.
    """
    contents: dict[int, bytes] = {}
    record = 0
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            for record in sorted({location.record for location in locations}):
                file.seek(record)
                opcode, content = _read_record(file, size)
                contents[record] = _decompress(content) if opcode == Opcode.CHUNK else content
    except OSError as error:
        raise _unreadable(path, error) from error
    except _PARSE_ERRORS as error:
        raise _damaged(path, record, error) from error
    return [contents[at.record][at.start : at.start + at.size] for at in locations]


def _check_start(path: Path, magic: bytes) -> None:
    if not magic:
        raise DemonstrationError(f"{path} is empty.", remedy="Record the demonstration again.")
    if magic != MCAP0_MAGIC[: len(magic)]:
        raise DemonstrationError(
            f"{path} is not an MCAP file.",
            remedy="Convert the recording to MCAP in the layout of docs/demonstration_format.md.",
        )


def _read_record(file: BinaryIO, size: int) -> tuple[int, bytes]:
    framing = file.read(_FRAMING.size)
    if len(framing) < _FRAMING.size:
        raise EOFError
    opcode, length = _FRAMING.unpack(framing)
    # Asked for before reading: a damaged length must not ask for terabytes of memory.
    if length > size - file.tell():
        raise EOFError
    return opcode, file.read(length)


def _interpret(
    position: int,
    opcode: int,
    content: bytes,
    schemas: dict[int, Schema],
    channels: dict[int, Channel],
) -> Iterator[ScannedMessage | Metadata | Attachment]:
    """Yields what one record of the file holds."""
    stream = ReadDataStream(io.BytesIO(content))
    if opcode == Opcode.CHUNK:
        data = _decompress(content)
        for start, inner_opcode, inner in _records_in(data):
            yield from _interpret_small(position, start, inner_opcode, inner, schemas, channels)
    elif opcode == Opcode.METADATA:
        yield Metadata.read(stream)
    elif opcode == Opcode.ATTACHMENT:
        yield Attachment.read(stream)
    else:
        yield from _interpret_small(position, 0, opcode, content, schemas, channels)


def _interpret_small(
    position: int,
    start: int,
    opcode: int,
    content: bytes,
    schemas: dict[int, Schema],
    channels: dict[int, Channel],
) -> Iterator[ScannedMessage]:
    """Handles a record that stands either in the file itself or in a chunk."""
    stream = ReadDataStream(io.BytesIO(content))
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(stream)
        schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(stream)
        channels[channel.id] = channel
    elif opcode == Opcode.MESSAGE:
        message = Message.read(stream, len(content))
        channel = channels[message.channel_id]
        offset = len(content) - len(message.data)
        yield ScannedMessage(
            topic=channel.topic,
            schema=schemas[channel.schema_id].name if channel.schema_id else "",
            encoding=channel.message_encoding,
            log_time=message.log_time,
            data=message.data,
            location=Location(position, start + offset, len(message.data)),
        )


def _decompress(content: bytes) -> bytes:
    """Returns the records of a chunk after checking its CRC.

    How large they are is asked for before: a small file must not ask for terabytes of memory.
    """
    chunk = Chunk.read(ReadDataStream(io.BytesIO(content)))
    sizes = [chunk.uncompressed_size]
    if chunk.compression == "zstd":
        sizes.append(zstandard.frame_content_size(chunk.data))
    if max(sizes) > LARGEST_CHUNK:
        raise _DamageError(
            f"a chunk unfolds to {max(sizes) >> 20} MiB, of which {LARGEST_CHUNK >> 20} are allowed"
        )
    if chunk.compression == "lz4":
        unpacked = lz4.frame.LZ4FrameDecompressor()
        # With room to spare, as the end of the frame is seen after the last byte only.
        data = unpacked.decompress(chunk.data, chunk.uncompressed_size + 1)
        if not unpacked.eof:
            raise _DamageError("a chunk unfolds to something else than is written on it")
        chunk = replace(chunk, compression="", data=data)
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    return stream.read(size)


def _records_in(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Yields the offset of the content, the opcode and the content of a chunk's records."""
    at = 0
    while at < len(data):
        opcode, length = _FRAMING.unpack_from(data, at)
        at += _FRAMING.size
        if length > len(data) - at:
            raise _DamageError("a record in a chunk is longer than the chunk")
        yield at, opcode, data[at : at + length]
        at += length


def _unreadable(path: Path, error: OSError) -> DemonstrationError:
    return DemonstrationError(
        f"{path} cannot be read: {error.strerror or error}.",
        remedy="Check the path and its permissions.",
    )


def _damaged(path: Path, position: int, error: Exception) -> DemonstrationError:
    return DemonstrationError(
        f"{path} is damaged in the record at byte {position}: {error or type(error).__name__}.",
        remedy="Copy the file again from where it was recorded, or save what is left with "
        f"`mcap recover {path} -o recovered.mcap`.",
    )
