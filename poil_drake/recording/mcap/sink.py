"""Writes messages to an MCAP file."""

import json
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, BinaryIO

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from poil_drake.errors import InvalidValueError
from poil_drake.recording.mcap.message_encoder import EncodedMessage
from poil_drake.recording.mcap.plain_json import json_schema

METADATA_RECORD = "poil"
"""Name of the metadata record in files that poil_drake writes."""


class McapSink:
    """Writes Foxglove messages and JSON to an MCAP file.

    Messages are collected in chunks, and each chunk is written when it is full. Until `close`, the
    file lacks its index and footer, but its written chunks can be read, and `mcap recover` repairs
    the file. After an error of the disk, nothing more is written, so that the chunks before it stay
    readable.

    Args:
        stream: The file, opened for writing.
        chunk_size: Size of the chunks before compression [bytes]; smaller ones are written sooner,
            but compress less well.
    """

    def __init__(self, stream: BinaryIO, *, chunk_size: int = 1 << 20):
        self._stream = stream
        # The checksum of the data section lets a reader notice any damaged byte.
        self._writer = Writer(self._stream, chunk_size=chunk_size, enable_data_crcs=True)
        self._writer.start(library="poil_drake")
        self._failed = False
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, tuple[int, str]] = {}

    def write(self, topic: str, message: EncodedMessage, *, time: int) -> None:
        """Writes a Foxglove message at `time` [ns]."""
        name = message.message_type.DESCRIPTOR.full_name
        if name not in self._schemas:
            self._schemas[name] = register_schema(self._writer, message.message_type)
        self._add(topic, name, MessageEncoding.Protobuf, message.data, time)

    def write_json(self, topic: str, record: Mapping[str, Any], *, schema: str, time: int) -> None:
        """Writes a JSON message at `time` [ns].

        Args:
            topic: The topic.
            record: The message, without NaN and infinity, which JSON does not have.
            schema: The name of the JSON schema, which is made from the first message of this name.
            time: When the message was logged [ns].
        """
        if schema not in self._schemas:
            text = json.dumps(json_schema(schema, record))
            self._schemas[schema] = self._writer.register_schema(
                schema, SchemaEncoding.JSONSchema, text.encode()
            )
        data = json.dumps(record, allow_nan=False).encode()
        self._add(topic, schema, MessageEncoding.JSON, data, time)

    def add_metadata(self, values: Mapping[str, str]) -> None:
        """Adds entries to the file's metadata."""
        self._writer.add_metadata(METADATA_RECORD, dict(values))

    def add_attachment(self, name: str, *, media_type: str, data: bytes) -> None:
        """Adds a file as an attachment."""
        self._writer.add_attachment(0, 0, name, media_type, data)

    def close(self) -> None:
        """Writes the index and footer unless writing has failed before, and closes the file."""
        if self._failed:
            with suppress(OSError):  # What is left in the buffer cannot be written, either.
                self._stream.close()
            return
        try:
            self._writer.finish()
        finally:
            self._stream.close()

    def _add(self, topic: str, schema: str, encoding: str, data: bytes, time: int) -> None:
        if topic not in self._channels:
            channel = self._writer.register_channel(topic, encoding, self._schemas[schema])
            self._channels[topic] = (channel, schema)
        channel, known_schema = self._channels[topic]
        if schema != known_schema:
            raise InvalidValueError(
                f"Topic {topic} holds {known_schema} messages and cannot take a {schema} message.",
                remedy="Use a separate topic for each type of message.",
            )
        try:
            self._writer.add_message(channel, log_time=time, data=data, publish_time=time)
            self._stream.flush()  # A full chunk reaches the disk even if the process is killed.
        except OSError:
            self._failed = True
            raise
