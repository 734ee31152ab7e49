"""Decodes Foxglove messages of cameras, images, transforms, point clouds and joint states."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from scipy.spatial.transform import Rotation

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.depth_image import depth_in_metres

# Both are OpenCV's lens model, usually with 5 and 8 coefficients; it takes any of these numbers.
_DISTORTION_MODELS = ("plumb_bob", "rational_polynomial")
_DISTORTION_COUNTS = (4, 5, 8, 12, 14)

# What lenses have: the ratio of the focal length to the size of the image, for 175 to 1 degree,
_WIDEST_LENS, _NARROWEST_LENS = 0.02, 60.0
# and the distance of the principal point from the image's centre, as a share of the size.
_FARTHEST_CENTRE = 2.0

ImageMessage: TypeAlias = RawImage | CompressedImage

MILLIMETRES_PER_METRE = 1000.0

_LENGTH_TOLERANCE = 0.1  # of a unit quaternion; for those written with few digits

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
# Depth encodings of a RawImage.
_RAW_DEPTH = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
# Label encodings of a RawImage.
_RAW_LABEL = {
    **{"mono8": "u1", "8UC1": "u1", "8SC1": "i1"},
    **{"16UC1": "u2", "mono16": "u2", "16SC1": "i2", "32SC1": "i4"},
}

# Before the PNG of a "compressedDepth" image: an enumeration and two parameters of inverse depth.
_DEPTH_HEADER = struct.Struct("<iff")
_JPEG_MAGIC = b"\xff\xd8"


@dataclass(frozen=True, eq=False)
class Calibration:
    """The intrinsics and lens distortion of a recorded camera.

    Attributes:
        frame_id: The name of the camera's optical frame.
        width: Image width [px].
        height: Image height [px].
        K: (3, 3) intrinsic matrix [px].
        distortion: (D,) coefficients of OpenCV's lens model; empty for rectified images.
    """

    frame_id: str
    width: int
    height: int
    K: np.ndarray
    distortion: np.ndarray

    def same_view(self, other: "Calibration") -> bool:
        """Returns whether two cameras at the same pose take the same image of a scene."""
        return (
            (self.width, self.height) == (other.width, other.height)
            and np.array_equal(self.K, other.K)
            and np.array_equal(self.distortion, other.distortion)
        )


def decode_calibration(message: CameraCalibration) -> Calibration:
    """Returns the calibration in a message.

    Raises:
        InvalidValueError: if K or D is invalid, or the distortion model is not supported.
    """
    K, distortion = np.array(message.K), np.array(message.D)
    size = np.array([message.width, message.height])
    if not (np.all(np.isfinite(distortion)) and _is_intrinsic_matrix(K, size)):
        raise InvalidValueError(
            f"the calibration is invalid: {size[0]} x {size[1]} pixels, K = {K.tolist()}, D = "
            f"{distortion.tolist()}.",
            remedy="Record the images' size, K = [fx, 0, cx, 0, fy, cy, 0, 0, 1] in pixels, and "
            "finite numbers in D.",
        )
    if not np.any(distortion):
        distortion = np.zeros(0)
    elif message.distortion_model not in _DISTORTION_MODELS:
        raise InvalidValueError(
            f"the distortion model '{message.distortion_model}' is not supported.",
            remedy=f"Use {' or '.join(_DISTORTION_MODELS)}, or record rectified images.",
        )
    elif len(distortion) not in _DISTORTION_COUNTS:
        raise InvalidValueError(
            f"the calibration has {len(distortion)} distortion coefficients: "
            f"{distortion.tolist()}.",
            remedy=f"Record {', '.join(map(str, _DISTORTION_COUNTS[:-1]))} or "
            f"{_DISTORTION_COUNTS[-1]} coefficients in OpenCV's order (k1, k2, p1, p2, k3, ...), "
            "or rectified images.",
        )
    frame = frame_name(message.frame_id)
    return Calibration(frame, message.width, message.height, K.reshape(3, 3), distortion)


def _is_intrinsic_matrix(K: np.ndarray, size: np.ndarray) -> bool:
    """Returns whether K (9,) can be that of a lens for images of a size (2,), both in [px]."""
    if K.size != 9 or not np.array_equal(K[[3, 6, 7, 8]], [0.0, 0.0, 0.0, 1.0]):
        return False
    share, centre = K[[0, 4]] / np.maximum(size, 1), K[[2, 5]] / np.maximum(size, 1)
    in_view = np.all(np.abs(centre - 0.5) <= _FARTHEST_CENTRE) and abs(K[1]) <= K[0]
    return bool(in_view and np.all((share >= _WIDEST_LENS) & (share <= _NARROWEST_LENS)))


def frame_name(recorded: str) -> str:
    """Returns the name of a frame without the leading slash that old ROS tools write."""
    return recorded.removeprefix("/")


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

    As usual, integer images are in millimetres, and float images are in metres. 65535 is invalid:
    some cameras write it where they measure nothing. Compressed images are 16-bit PNG, with or
    without the header of ROS's `compressed_depth_image_transport`, which also packs float images.

    Raises:
        InvalidValueError: if the encoding is unknown or does not fit the data.
    """
    if isinstance(message, RawImage):
        pixels = _raw_channel(message, "depth", _RAW_DEPTH)
        return depth_in_metres(pixels, step=1.0 / MILLIMETRES_PER_METRE)
    pixels = _decompress(message)
    if pixels.ndim != 2 or pixels.dtype != np.uint16:
        raise _wrong_pixels(message, "depth", pixels)
    if not (message.format.startswith("32FC1") and _has_header(message)):
        return depth_in_metres(pixels, step=1.0 / MILLIMETRES_PER_METRE)
    _, scale, offset = _DEPTH_HEADER.unpack_from(message.data)
    inverse = pixels.astype(np.float32) - np.float32(offset)
    inverse[(pixels == 0) | (inverse <= 0.0)] = np.nan
    return depth_in_metres(np.float32(scale) / inverse, step=1.0)


def decode_label(message: ImageMessage) -> np.ndarray:
    """Returns the (H, W) int16 label image of a message, with one integer for each pixel.

    Raises:
        InvalidValueError: if the encoding is unknown or does not fit the data, or a label has more
            than 16 bits.
    """
    if isinstance(message, CompressedImage):
        pixels = _decompress(message)
        is_jpeg = message.data.startswith(_JPEG_MAGIC)  # Between two labels, it has others.
        if pixels.ndim != 2 or pixels.dtype not in (np.uint8, np.uint16) or is_jpeg:
            raise _wrong_pixels(message, "label", pixels)
    else:
        pixels = _raw_channel(message, "label", _RAW_LABEL)
    labels: np.ndarray = pixels.astype(np.int16)
    # 16-bit labels may be signed or not; larger ones must fit.
    if pixels.dtype == np.int32 and np.any(labels != pixels):
        raise InvalidValueError(
            f"a label image holds the label {pixels[labels != pixels][0]}.",
            remedy="Use labels from 0 to 32767.",
        )
    return labels


def _has_header(message: CompressedImage) -> bool:
    return "compressedDepth" in message.format


def _raw_channel(message: RawImage, kind: str, types: dict[str, str]) -> np.ndarray:
    """Returns the (H, W) pixels of a one-channel image, which errors call a `kind` image."""
    if message.encoding not in types:
        raise InvalidValueError(
            f"a {kind} image has the unsupported encoding '{message.encoding}'.",
            remedy=f"Use one of {', '.join(types)}.",
        )
    dtype = np.dtype(types[message.encoding])
    return _raw_pixels(message, dtype, 1)[..., 0]


def _wrong_pixels(message: CompressedImage, kind: str, pixels: np.ndarray) -> InvalidValueError:
    return InvalidValueError(
        f"a compressed {kind} image of format '{message.format}' has {pixels.dtype} pixels of "
        f"shape {pixels.shape}.",
        remedy="Use a PNG with one channel: 16-bit for depth, 8-bit or 16-bit for labels.",
    )


def _raw_pixels(message: RawImage, dtype: np.dtype, channels: int) -> np.ndarray:
    """Returns the (H, W, channels) pixels of a raw image, whose rows may be padded."""
    row = message.width * channels * dtype.itemsize
    step = message.step or row
    try:
        if row == 0 or message.height == 0 or step < row:
            raise ValueError("the rows are too short")
        shape = (message.height, message.width, channels)
        strides = (step, channels * dtype.itemsize, dtype.itemsize)
        stored = np.ndarray(shape, dtype.newbyteorder("<"), message.data, strides=strides)
        return stored.astype(dtype)
    except (TypeError, ValueError) as error:
        raise InvalidValueError(
            f"a {message.width} x {message.height} image with encoding '{message.encoding}' does "
            f"not fit its data of {len(message.data)} bytes with a step of {message.step} bytes.",
            remedy="Record the image with a width, height and step that fit its data.",
        ) from error


def _decompress(message: CompressedImage, flags: int = cv2.IMREAD_UNCHANGED) -> np.ndarray:
    data = np.frombuffer(message.data, np.uint8)
    try:
        pixels = cv2.imdecode(data[_DEPTH_HEADER.size if _has_header(message) else 0 :], flags)
    except cv2.error:
        pixels = None
    if pixels is None:
        raise InvalidValueError(
            f"a compressed image of format '{message.format}' cannot be decoded.",
            remedy="Record the demonstration again with jpeg, png or webp images; depth and labels "
            "as png.",
        )
    return pixels


def decode_transform(message: FrameTransform) -> np.ndarray:
    """Returns the (4, 4) pose of the child frame in the parent frame [m].

    Raises:
        InvalidValueError: if a value is not finite, or the quaternion's length is not about 1.
    """
    p, q = message.translation, message.rotation
    quaternion = np.array([q.x, q.y, q.z, q.w])
    X_PC = np.eye(4)
    X_PC[:3, 3] = [p.x, p.y, p.z]
    length = math.hypot(*quaternion)
    if not np.all(np.isfinite(X_PC)) or not abs(length - 1.0) < _LENGTH_TOLERANCE:
        raise InvalidValueError(
            f"the transform from '{message.parent_frame_id}' to '{message.child_frame_id}' is not "
            f"rigid: translation {X_PC[:3, 3].tolist()}, quaternion {quaternion.tolist()}.",
            remedy="Record a finite translation and a unit quaternion.",
        )
    X_PC[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    return X_PC


def cloud_fields(names: Sequence[str], size: int) -> list[PackedElementField]:
    """Returns the fields of a point cloud: for each name, a float of `size` bytes (4 or 8)."""
    kind = PackedElementField.FLOAT64 if size == 8 else PackedElementField.FLOAT32
    return [PackedElementField(name=n, offset=size * i, type=kind) for i, n in enumerate(names)]


def decode_points(message: PointCloud) -> tuple[np.ndarray, np.ndarray]:
    """Returns the (N, 3) points [m] and their (N,) confidences, which are 1 if not recorded.

    Raises:
        InvalidValueError: if the cloud's layout is not that of `MessageEncoder.points`.
    """
    names, stride = [field.name for field in message.fields], message.point_stride
    size = 8 if PackedElementField.FLOAT64 in {field.type for field in message.fields} else 4
    if (
        names not in (["x", "y", "z"], ["x", "y", "z", "confidence"])
        or list(message.fields) != cloud_fields(names, size)
        or stride != size * len(names)
        or len(message.data) % stride
    ):
        raise InvalidValueError(
            f"a point cloud has an unsupported layout: fields {names}, a stride of {stride} bytes "
            f"and {len(message.data)} bytes of data.",
            remedy="Use a log written by poil run.",
        )
    columns = np.frombuffer(message.data, f"<f{size}").reshape(-1, len(names)).astype(float)
    confidence = columns[:, 3].copy() if len(names) == 4 else np.ones(len(columns))
    return columns[:, :3].copy(), confidence


def decode_joint_states(message: JointStates, names: Sequence[str]) -> np.ndarray:
    """Returns (3, J) positions [rad], velocities [rad/s] and torques [N m]; NaN where unset.

    Args:
        message: The message.
        names: The joints' names, in the order of the result's columns.

    Raises:
        InvalidValueError: if a joint is missing.
    """
    joints = {joint.name: joint for joint in message.joints}
    try:
        wanted = [joints[name] for name in names]
    except KeyError as error:
        raise InvalidValueError(
            f"a joint state lacks the joint {error}.", remedy="Use a log written by poil run."
        ) from error
    return np.array(
        [
            [getattr(joint, key) if joint.HasField(key) else np.nan for joint in wanted]
            for key in ("position", "velocity", "effort")
        ]
    )
