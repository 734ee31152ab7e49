"""Encodes calibrations, images, points and joint states as Foxglove messages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from scipy.spatial.transform import Rotation

from poil_drake.errors import InvalidValueError
from poil_drake.perception.images import CameraModel
from poil_drake.recording.mcap.message_decoders import MILLIMETRES_PER_METRE, cloud_fields

_LENGTH_DELIMITED = 2
"""Protobuf's wire type of bytes; see https://protobuf.dev/programming-guides/encoding."""


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


class EncodedMessage(NamedTuple):
    """A serialized protobuf message.

    Attributes:
        message_type: Its Foxglove message class.
        data: Its bytes.
    """

    message_type: Any
    data: bytes


class MessageEncoder:
    """Encodes arrays as Foxglove messages, reusing the message objects.

    Each time protobuf has freed 10,000 blocks, it calls `malloc_trim`, which blocks the other
    Python threads for 10 ms. The encoder therefore keeps and reuses its messages. The large field
    `data` is serialized separately, because a kept message would also keep its bytes.

    Only one thread at a time may use an encoder. All stamps are in [ns].

    Args:
        color: How colour images are encoded.
        exact_depth: Whether depth is encoded as 32FC1 [m], twice the size of 16UC1 [mm].
    """

    def __init__(self, *, color: ColorEncoding | None = None, exact_depth: bool = False):
        self._color, self._exact_depth = color or ColorEncoding(), exact_depth
        # Returns the same message for the same arguments, which are its constant fields.
        self._kept: Callable[..., Any] = lru_cache(maxsize=None)(
            lambda make, *args, **fields: make(*args, **fields)
        )

    def calibration(self, camera: CameraModel, *, stamp: int, frame_id: str) -> EncodedMessage:
        """Encodes a camera's intrinsics, with zero distortion."""
        message = CameraCalibration(
            frame_id=frame_id,
            width=camera.width,
            height=camera.height,
            distortion_model="plumb_bob",
            D=[0.0] * 5,
            K=camera.K.ravel(),
            R=np.eye(3).ravel(),
            P=np.hstack([camera.K, np.zeros((3, 1))]).ravel(),
        )
        return _serialized(message, stamp)

    def transform(self, X_PC: np.ndarray, *, parent: str, child: str, stamp: int) -> EncodedMessage:
        """Encodes the (4, 4) pose of frame `child` in frame `parent` [m]."""
        message = self._kept(FrameTransform, parent_frame_id=parent, child_frame_id=child)
        p, q = message.translation, message.rotation
        p.x, p.y, p.z = X_PC[:3, 3].tolist()
        q.x, q.y, q.z, q.w = Rotation.from_matrix(X_PC[:3, :3]).as_quat().tolist()
        return _serialized(message, stamp)

    def image(self, kind: str, pixels: np.ndarray, *, stamp: int, frame_id: str) -> EncodedMessage:
        """Encodes an image; `kind` is "image" (colour), "depth" or "label"."""
        encode = {"image": self.color, "depth": self.depth, "label": self.label}[kind]
        return encode(pixels, stamp=stamp, frame_id=frame_id)

    def color(self, rgb: np.ndarray, *, stamp: int, frame_id: str) -> EncodedMessage:
        """Encodes an (H, W, 3) uint8 colour image."""
        encoding = self._color
        if encoding.format == "raw":
            return self._raw_image(rgb, "rgb8", stamp, frame_id)
        bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
        if encoding.format == "jpeg":
            _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, encoding.jpeg_quality])
        else:
            _, data = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        message = self._kept(CompressedImage, frame_id=frame_id, format=encoding.format)
        return _serialized(message, stamp, data.tobytes())

    def depth(self, depth: np.ndarray, *, stamp: int, frame_id: str) -> EncodedMessage:
        """Encodes an (H, W) depth image [m] as 16UC1 [mm], or as 32FC1 [m] if `exact_depth`.

        Rounding to 16UC1 adds 0.29 mm rms, less than a depth camera's noise. Depth that is not
        finite, is negative or reaches 65.535 m becomes 0, which means invalid.
        """
        if self._exact_depth:
            return self._raw_image(depth.astype("<f4"), "32FC1", stamp, frame_id)
        millimetres = np.rint(depth * MILLIMETRES_PER_METRE)
        valid = (millimetres >= 0.0) & (millimetres < np.iinfo(np.uint16).max)
        millimetres[~valid] = 0.0
        return self._raw_image(millimetres.astype("<u2"), "16UC1", stamp, frame_id)

    def label(self, label: np.ndarray, *, stamp: int, frame_id: str) -> EncodedMessage:
        """Encodes an (H, W) int16 label image as 16UC1."""
        return self._raw_image(label.astype("<i2").view("<u2"), "16UC1", stamp, frame_id)

    def points(
        self,
        points: np.ndarray,
        *,
        stamp: int,
        frame_id: str,
        confidence: np.ndarray | None = None,
        exact: bool = False,
    ) -> EncodedMessage:
        """Encodes (N, 3) points [m] and, if given, (N,) confidences as a float32 point cloud.

        NaN points are kept, so that each point keeps its index; viewers do not draw them. If
        `exact`, the cloud is float64 and the values are not rounded.
        """
        names = ("x", "y", "z") if confidence is None else ("x", "y", "z", "confidence")
        columns = points if confidence is None else np.column_stack([points, confidence])
        size = 8 if exact else 4
        data = np.ascontiguousarray(columns, dtype=f"<f{size}").tobytes()
        return _serialized(self._kept(_empty_cloud, frame_id, names, size), stamp, data)

    def joint_states(
        self,
        names: Sequence[str],
        *,
        stamp: int,
        position: np.ndarray | None = None,
        velocity: np.ndarray | None = None,
        effort: np.ndarray | None = None,
    ) -> EncodedMessage:
        """Encodes (J,) positions [rad], velocities [rad/s] and torques [N m]; None stays unset."""
        message = self._kept(_empty_joint_states, tuple(names))
        for key, array in (("position", position), ("velocity", velocity), ("effort", effort)):
            if array is None:
                for joint in message.joints:
                    joint.ClearField(key)
            else:
                for joint, value in zip(message.joints, array.tolist(), strict=True):
                    setattr(joint, key, value)
        return _serialized(message, stamp)

    def _raw_image(
        self, pixels: np.ndarray, encoding: str, stamp: int, frame_id: str
    ) -> EncodedMessage:
        height, width = pixels.shape[:2]
        step = pixels.nbytes // height
        message = self._kept(
            RawImage, frame_id=frame_id, width=width, height=height, encoding=encoding, step=step
        )
        return _serialized(message, stamp, pixels.tobytes())


def _empty_cloud(frame_id: str, names: Sequence[str], size: int) -> PointCloud:
    fields = cloud_fields(names, size)
    message = PointCloud(frame_id=frame_id, point_stride=size * len(names), fields=fields)
    # Readers would interpret an unset pose as one with the zero quaternion.
    message.pose.orientation.w = 1.0
    message.pose.position.SetInParent()
    return message


def _empty_joint_states(names: Sequence[str]) -> JointStates:
    return JointStates(joints=[JointState(name=name) for name in names])


def _serialized(message: Any, stamp: int, data: bytes | None = None) -> EncodedMessage:
    """Serializes a message with the `stamp` [ns] and, if given, the bytes of its field `data`."""
    message.timestamp.FromNanoseconds(stamp)
    message.timestamp.SetInParent()
    parts = [message.SerializeToString()]
    if data is not None:  # Fields may come in any order.
        number = type(message).DESCRIPTOR.fields_by_name["data"].number
        parts += [_varint(number << 3 | _LENGTH_DELIMITED), _varint(len(data)), data]
    return EncodedMessage(type(message), b"".join(parts))


def _varint(number: int) -> bytes:
    """Encodes a non-negative number as a protobuf varint: 7 bits per byte, lowest first."""
    encoded = bytearray()
    while number > 0x7F:
        encoded.append(number & 0x7F | 0x80)
        number >>= 7
    encoded.append(number)
    return bytes(encoded)
