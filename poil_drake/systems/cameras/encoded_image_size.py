"""How large a PNG or JPEG image is, without decoding it."""

import struct

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
# Start of frame, of all kinds; between them are the tables of Huffman and arithmetic codes.
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_START_OF_SCAN, _END = 0xDA, 0xD9
_WITHOUT_LENGTH = frozenset({0x01, *range(0xD0, 0xD9)})
_FILL = 0xFF


def encoded_image_size(data: bytes) -> tuple[int, int] | None:
    """Returns (height, width) [px] by the image's own header, or None where there is none.

    A PNG says them in its first chunk (IHDR), a JPEG in its start of frame (SOF), which comes
    before any pixels.

    Args:
        data: A PNG or a JPEG, or anything else.
    """
    try:
        if data[:8] == _PNG and data[12:16] == b"IHDR":
            width, height = struct.unpack_from(">II", data, 16)
            return height, width
        if data[:2] == _JPEG:
            return _jpeg_size(data)
    except (struct.error, IndexError):
        pass
    return None


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    at = 2
    while data[at] == _FILL:
        marker = data[at + 1]
        if marker == _FILL:
            at += 1
        elif marker in _WITHOUT_LENGTH:
            at += 2
        elif marker in _FRAMES:
            # The segment's length (2 bytes) and the bits per sample come first.
            height, width = struct.unpack_from(">HH", data, at + 5)
            return height, width
        elif marker in (_START_OF_SCAN, _END):
            break
        else:
            (length,) = struct.unpack_from(">H", data, at + 2)
            at += 2 + length
    return None
