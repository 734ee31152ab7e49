"""Encodes and decodes RGB-D images as the `lcmt_image_array` that Drake's cameras send."""

import io
import struct
import zlib
from typing import Any

import cv2
import numpy as np
from drake import lcmt_image, lcmt_image_array
from PIL import Image

from poil_drake.errors import InvalidValueError, NoImageError
from poil_drake.geometry.depth_image import depth_in_metres
from poil_drake.perception.images import RgbdImage

_COLOUR = {
    # Pixel format: number of channels, and OpenCV's conversion to RGB.
    lcmt_image.PIXEL_FORMAT_RGB: (3, None),
    lcmt_image.PIXEL_FORMAT_BGR: (3, cv2.COLOR_BGR2RGB),
    lcmt_image.PIXEL_FORMAT_RGBA: (4, cv2.COLOR_RGBA2RGB),
    lcmt_image.PIXEL_FORMAT_BGRA: (4, cv2.COLOR_BGRA2RGB),
}
_DTYPES: dict[int, np.dtype] = {
    lcmt_image.CHANNEL_TYPE_UINT8: np.dtype("u1"),
    lcmt_image.CHANNEL_TYPE_INT16: np.dtype("i2"),
    lcmt_image.CHANNEL_TYPE_UINT16: np.dtype("u2"),
    lcmt_image.CHANNEL_TYPE_FLOAT32: np.dtype("f4"),
}
_MILLIMETRE = 1e-3
_MOST_IMAGES = 8
_REMEDY = (
    "Send lcmt_image_array messages as Drake's cameras do, each with a colour and a depth image "
    "of the size in the camera's settings."
)


def encode_images(image: RgbdImage, *, camera: str) -> bytes:
    """Returns one camera's images as an encoded `lcmt_image_array`, without compression.

    The message holds colour as RGB, depth as 32-bit floats [m], and labels if there are any.

    Args:
        image: The image. Its stamp is in [s since the epoch], on the clock of the receivers.
        camera: The camera's name.
    """
    message = lcmt_image_array()
    message.header.utime = round(1e6 * image.stamp)
    message.header.frame_name = camera
    message.images = [
        _image(image.rgb, lcmt_image.PIXEL_FORMAT_RGB, lcmt_image.CHANNEL_TYPE_UINT8),
        _image(image.depth, lcmt_image.PIXEL_FORMAT_DEPTH, lcmt_image.CHANNEL_TYPE_FLOAT32),
    ]
    if image.label is not None:
        message.images.append(
            _image(image.label, lcmt_image.PIXEL_FORMAT_LABEL, lcmt_image.CHANNEL_TYPE_INT16)
        )
    message.num_images = len(message.images)
    return message.encode()


def decode_images(message: bytes, *, size: tuple[int, int]) -> RgbdImage:
    """Returns the images of a message, with the stamp of its header.

    Colour may be 8-bit RGB, BGR, RGBA or BGRA. Depth may be 32-bit floats [m], or 16-bit integers
    [mm] with 65535 for "too far", which becomes 0 (invalid). Labels are 16-bit integers. Images may
    be uncompressed, or compressed with zlib or PNG; colour also with JPEG.

    Args:
        message: An encoded `lcmt_image_array`.
        size: (height, width) [px] of every image in the message.

    Raises:
        NoImageError: if the message is invalid, or lacks a colour or depth image of that size.
    """
    try:
        array = lcmt_image_array.decode(message)
    except (ValueError, struct.error, UnicodeDecodeError) as error:
        raise _unusable(
            f"the message's {len(message)} bytes are no lcmt_image_array ({error})"
        ) from error
    if len(array.images) > _MOST_IMAGES:
        raise _unusable(f"the message has {len(array.images)} images, more than {_MOST_IMAGES}")
    rgb = depth = label = None
    for image in array.images:
        if image.pixel_format in _COLOUR:
            channels, conversion = _COLOUR[image.pixel_format]
            pixels = _pixels(image, size, channels)
            rgb = pixels if conversion is None else cv2.cvtColor(pixels, conversion)
        elif image.pixel_format == lcmt_image.PIXEL_FORMAT_DEPTH:
            try:
                depth = depth_in_metres(_pixels(image, size, 1)[:, :, 0], step=_MILLIMETRE)
            except InvalidValueError as error:
                raise NoImageError(error.problem, remedy=error.remedy) from error
        elif image.pixel_format == lcmt_image.PIXEL_FORMAT_LABEL:
            label = _pixels(image, size, 1)[:, :, 0].astype(np.int16)
    if array.header.utime <= 0:
        raise _unusable(f"its header.utime is {array.header.utime}, not the time of capture")
    if rgb is None or rgb.dtype != np.uint8 or depth is None:
        raise _unusable(f"the message has no {'depth' if depth is None else '8-bit colour'} image")
    return RgbdImage(rgb=rgb, depth=depth, stamp=1e-6 * array.header.utime, label=label)


def _image(pixels: np.ndarray, pixel_format: int, channel_type: int) -> lcmt_image:
    image = lcmt_image()
    data = np.ascontiguousarray(pixels, _DTYPES[channel_type].newbyteorder("<"))
    image.height, image.width = pixels.shape[:2]
    image.row_stride = data.strides[0]
    image.size = data.nbytes
    image.data = data.data.cast("B")
    image.pixel_format, image.channel_type = pixel_format, channel_type
    image.compression_method = lcmt_image.COMPRESSION_METHOD_NOT_COMPRESSED
    return image


def _pixels(image: Any, size: tuple[int, int], channels: int) -> np.ndarray:
    """Returns the pixels (H, W, channels) of one image of a message; `size` is (H, W)."""
    height, width = size
    if (image.height, image.width) != size:
        raise _unusable(
            f"an image has {image.width} x {image.height} pixels, not {width} x {height}"
        )
    if image.channel_type not in _DTYPES:
        raise _unusable(f"an image has the unsupported channel type {image.channel_type}")
    dtype = _DTYPES[image.channel_type]
    row = width * channels * dtype.itemsize
    data = image.data
    if image.compression_method == lcmt_image.COMPRESSION_METHOD_ZLIB:
        data = _inflated(data, height * row)
    elif image.compression_method != lcmt_image.COMPRESSION_METHOD_NOT_COMPRESSED:
        return _decompressed(image, (height, width, channels), dtype)
    if len(data) != height * row:
        raise _unusable(f"an image holds {len(data)} bytes instead of {height * row}")
    pixels = np.frombuffer(data, dtype.newbyteorder(">" if image.bigendian else "<"))
    return pixels.reshape(height, width, channels).astype(dtype, copy=False)


def _inflated(data: bytes, size: int) -> bytes:
    try:
        # One byte more than needed at most, however large the decompressed data would be.
        return zlib.decompressobj().decompress(data, size + 1)
    except zlib.error as error:
        raise _unusable(f"an image holds invalid zlib data ({error})") from error


def _decompressed(image: Any, shape: tuple[int, int, int], dtype: np.dtype) -> np.ndarray:
    if image.compression_method not in (
        lcmt_image.COMPRESSION_METHOD_JPEG,
        lcmt_image.COMPRESSION_METHOD_PNG,
    ):
        raise _unusable(f"an image has the unsupported compression {image.compression_method}")
    if len(image.data) > shape[0] * shape[1] * shape[2] * dtype.itemsize + 4096:
        raise _unusable(f"a compressed image has {len(image.data)} bytes, more than its raw pixels")
    # Before decoding: a few bytes may decode to very many pixels.
    said = _encoded_size(image.data)
    if said != shape[:2]:
        found = "an unreadable size" if said is None else f"{said[1]} x {said[0]} pixels"
        raise _unusable(f"a JPEG or PNG image has {found}, not {shape[1]} x {shape[0]}")
    try:
        pixels = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        pixels = None
    if pixels is None or pixels.dtype != dtype or pixels.size != np.prod(shape):
        found = "nothing" if pixels is None else f"{pixels.dtype} {pixels.shape}"
        raise _unusable(f"a JPEG or PNG image decodes to {found}, not to {dtype} {shape}")
    pixels = pixels.reshape(shape)
    # OpenCV decodes files to BGR.
    if shape[2] == 3 and image.pixel_format == lcmt_image.PIXEL_FORMAT_RGB:
        return cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)
    if shape[2] == 4 and image.pixel_format == lcmt_image.PIXEL_FORMAT_RGBA:
        return cv2.cvtColor(pixels, cv2.COLOR_BGRA2RGBA)
    return pixels


def _encoded_size(data: bytes) -> tuple[int, int] | None:
    """Returns (height, width) [px] from a PNG or JPEG header; None if it cannot be read."""
    try:
        with Image.open(io.BytesIO(data), formats=("PNG", "JPEG")) as image:
            return image.height, image.width
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return None


def _unusable(what: str) -> NoImageError:
    return NoImageError(f"A message on the camera's channel is unusable: {what}.", remedy=_REMEDY)
