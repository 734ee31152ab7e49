"""Decodes Foxglove image messages: `RawImage` and `CompressedImage`."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from poil_drake.errors import InvalidValueError

ImageMessage: TypeAlias = RawImage | CompressedImage

MILLIMETRES_PER_METRE = 1000.0

# Colour encodings of a RawImage: number of channels, and OpenCV's conversion to RGB.
_RAW_COLOR = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "8UC3": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB),
    "8UC1": (1, cv2.COLOR_GRAY2RGB),
}
_RAW_16_BIT = ("16UC1", "mono16")


@dataclass(frozen=True, kw_only=True)
class ColorEncoding:
    """How colour images are encoded.

    Attributes:
        format: For an image of 640 x 480 pixels, "jpeg" takes 2 ms and 90 kB; "raw" is lossless and
            takes 3 ms and, after compression, 0.8 MB; "png" is lossless and takes 40 ms and 0.6 MB.
        jpeg_quality: In [0, 100]. At 95 and above, the loss is below a camera's noise.
    """

    format: Literal["jpeg", "raw", "png"] = "jpeg"
    jpeg_quality: int = 95

    def __post_init__(self) -> None:
        if self.format not in ("jpeg", "raw", "png"):
            raise InvalidValueError(
                f"ColorEncoding.format is '{self.format}', which is unknown.",
                remedy="Use 'jpeg', 'raw' or 'png'.",
            )


def decode_color(message: ImageMessage) -> np.ndarray:
    """Returns the (H, W, 3) uint8 RGB image of a message.

    Raises:
        InvalidValueError: if the encoding is unknown or does not fit the data.
    """
    if isinstance(message, CompressedImage):
        return cv2.cvtColor(_decompress(message, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    if message.encoding not in _RAW_COLOR:
        raise InvalidValueError(
            f"a colour image has the unsupported encoding '{message.encoding}'.",
            remedy=f"Use one of {', '.join(_RAW_COLOR)}, or a CompressedImage.",
        )
    channels, conversion = _RAW_COLOR[message.encoding]
    pixels = _raw_pixels(message, np.dtype(np.uint8), channels)
    return pixels if conversion is None else cv2.cvtColor(pixels, conversion)


def decode_depth(message: ImageMessage) -> np.ndarray:
    """Returns the (H, W) float32 depth [m] of a message; 0 where invalid.

    As usual, integer images are in millimetres, and float images are in metres.

    Raises:
        InvalidValueError: if the encoding is unknown or does not fit the data.
    """
    if isinstance(message, RawImage) and message.encoding == "32FC1":
        depth = _raw_pixels(message, np.dtype("<f4"), 1)[..., 0].astype(np.float32)
        return np.where(np.isfinite(depth) & (depth > 0.0), depth, np.float32(0.0))
    return (_pixels_16_bit(message, "depth") / np.float32(MILLIMETRES_PER_METRE)).astype(np.float32)


def decode_label(message: ImageMessage) -> np.ndarray:
    """Returns the (H, W) int16 label image of a message.

    Raises:
        InvalidValueError: if the encoding is unknown or does not fit the data.
    """
    return _pixels_16_bit(message, "label").view(np.int16)


def _pixels_16_bit(message: ImageMessage, kind: str) -> np.ndarray:
    """Returns the (H, W) uint16 pixels of a one-channel image, which errors call a `kind` image."""
    if isinstance(message, CompressedImage):
        pixels = _decompress(message, cv2.IMREAD_UNCHANGED)
        if pixels.ndim != 2 or pixels.dtype != np.uint16:
            raise InvalidValueError(
                f"a compressed {kind} image has {pixels.dtype} pixels of shape {pixels.shape}, "
                "not uint16 of shape (H, W).",
                remedy="Use a 16-bit PNG with one channel.",
            )
        return pixels
    if message.encoding not in _RAW_16_BIT:
        raise InvalidValueError(
            f"a {kind} image has the unsupported encoding '{message.encoding}'.",
            remedy=f"Use one of {', '.join(_RAW_16_BIT)}"
            + (" (millimetres) or 32FC1 (metres)." if kind == "depth" else "."),
        )
    return _raw_pixels(message, np.dtype("<u2"), 1)[..., 0].astype(np.uint16)


def _raw_pixels(message: RawImage, dtype: np.dtype, channels: int) -> np.ndarray:
    """Returns the (H, W, channels) pixels of a RawImage, whose rows may be padded."""
    row = message.width * channels * dtype.itemsize
    step = message.step or row
    try:
        if row == 0 or message.height == 0 or step < row:
            raise ValueError("the rows are too short")
        shape = (message.height, message.width, channels)
        strides = (step, channels * dtype.itemsize, dtype.itemsize)
        return np.ndarray(shape, dtype, message.data, strides=strides).copy()
    except (TypeError, ValueError) as error:
        raise InvalidValueError(
            f"a {message.width} x {message.height} image with encoding '{message.encoding}' does "
            f"not fit its data of {len(message.data)} bytes with a step of {message.step} bytes.",
            remedy="Record the image with a width, height and step that fit its data.",
        ) from error


def _decompress(message: CompressedImage, flags: int) -> np.ndarray:
    try:
        pixels = cv2.imdecode(np.frombuffer(message.data, np.uint8), flags)
    except cv2.error:
        pixels = None
    if pixels is None:
        raise InvalidValueError(
            f"a compressed image of format '{message.format}' cannot be decoded.",
            remedy="Record the demonstration again with jpeg, png or webp images.",
        )
    return pixels
