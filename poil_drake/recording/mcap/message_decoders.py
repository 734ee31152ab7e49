"""Decodes Foxglove messages of cameras, images, transforms, point clouds and joint states."""

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

# Both are OpenCV's lens model, usually with 5 and 8 coefficients; it takes any of these numbers.
_DISTORTION_MODELS = ("plumb_bob", "rational_polynomial")
_DISTORTION_COUNTS = (4, 5, 8, 12, 14)

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


def decode_calibration(message: CameraCalibration) -> Calibration:
    """Returns the calibration in a message.

    Raises:
        InvalidValueError: if K or D is invalid, or the distortion model is not supported.
    """
    K, distortion = np.array(message.K, dtype=float), np.array(message.D, dtype=float)
    if K.size != 9 or not np.all(np.isfinite([*K, *distortion])) or K[0] <= 0.0 or K[4] <= 0.0:
        raise InvalidValueError(
            f"the calibration is invalid: K = {list(message.K)}, D = {list(message.D)}.",
            remedy="Record a 3 x 3 K with positive focal lengths, and finite numbers in K and D.",
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
            f"the calibration has {len(distortion)} distortion coefficients: {list(message.D)}.",
            remedy=f"Record {', '.join(map(str, _DISTORTION_COUNTS[:-1]))} or "
            f"{_DISTORTION_COUNTS[-1]} coefficients in OpenCV's order (k1, k2, p1, p2, k3, ...), "
            "or rectified images.",
        )
    frame = frame_name(message.frame_id)
    return Calibration(frame, message.width, message.height, K.reshape(3, 3), distortion)


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
    some cameras write it where they measure nothing.

    Raises:
        InvalidValueError: if the encoding is unknown or does not fit the data.
    """
    if isinstance(message, RawImage) and message.encoding == "32FC1":
        depth = _raw_pixels(message, np.dtype("<f4"), 1)[..., 0].astype(np.float32)
        return np.where(np.isfinite(depth) & (depth > 0.0), depth, np.float32(0.0))
    pixels = _pixels_16_bit(message, "depth")
    pixels[pixels == np.iinfo(np.uint16).max] = 0
    return (pixels / np.float32(MILLIMETRES_PER_METRE)).astype(np.float32)


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


def decode_transform(message: FrameTransform) -> np.ndarray:
    """Returns the (4, 4) pose of the child frame in the parent frame [m].

    Raises:
        InvalidValueError: if the quaternion is zero or a value is not finite.
    """
    p, q = message.translation, message.rotation
    quaternion = np.array([q.x, q.y, q.z, q.w])
    X_PC = np.eye(4)
    X_PC[:3, 3] = [p.x, p.y, p.z]
    if not np.all(np.isfinite([*quaternion, *X_PC[:3, 3]])) or not np.any(quaternion):
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
