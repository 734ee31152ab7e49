"""Messages whose bulk is kept apart from them."""

from typing import Any, Generic, NamedTuple, TypeVar

_M = TypeVar("_M")

_LENGTH_DELIMITED = 2
"""Wire type of bytes, see https://protobuf.dev/programming-guides/encoding."""


class MessageParts(NamedTuple, Generic[_M]):
    """A protobuf message without its field `data`, and what belongs there.

    The message may so be filled again and again, and the bulk is not copied into it first. The C
    library of protobuf never frees what a message's own bytes once took, while the message lives.

    Attributes:
        message: The message; its `data` is empty.
        data: What belongs there.
    """

    message: _M
    data: bytes

    def whole(self) -> _M:
        """Returns the message, with its data from now on."""
        self.message.data = self.data  # type: ignore[attr-defined]
        return self.message

    def serialized(self) -> bytes:
        """Returns the message as bytes, with its data, as `whole` would be."""
        message: Any = self.message
        number = type(message).DESCRIPTOR.fields_by_name["data"].number
        # Fields may come in any order.
        head = _varint(number << 3 | _LENGTH_DELIMITED) + _varint(len(self.data))
        return b"".join((message.SerializeToString(), head, self.data))


def _varint(number: int) -> bytes:
    """Returns a number that is not negative, seven bits a byte, the lowest first."""
    encoded = bytearray()
    while number > 0x7F:
        encoded.append(number & 0x7F | 0x80)
        number >>= 7
    encoded.append(number)
    return bytes(encoded)
