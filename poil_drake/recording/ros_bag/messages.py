"""Converts messages of ROS to Foxglove messages, with their stamps, and without decoding images."""

from typing import Any

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from poil_drake.errors import InvalidValueError


def convert_image(message: Any) -> RawImage | CompressedImage:
    """Converts a sensor_msgs/Image or sensor_msgs/CompressedImage; its data stay as they are.

    Raises:
        InvalidValueError: if the pixels have more than one byte per channel, highest first.
    """
    data = message.data.tobytes()
    if not hasattr(message, "encoding"):
        return _stamped(CompressedImage(format=message.format, data=data), message.header)
    if message.is_bigendian and any(bits in message.encoding for bits in ("16", "32")):
        raise InvalidValueError(
            f"an image with encoding '{message.encoding}' is big-endian.",
            remedy="Record it on a little-endian machine.",
        )
    image = RawImage(
        width=message.width,
        height=message.height,
        encoding=message.encoding,
        step=message.step,
        data=data,
    )
    return _stamped(image, message.header)


def convert_calibration(message: Any, *, rectified: bool) -> CameraCalibration:
    """Converts a sensor_msgs/CameraInfo.

    Args:
        message: The message, of ROS 1 or 2.
        rectified: Whether the calibration is for rectified images, which have the intrinsics in P
            and no distortion, or for the images of the lens, which have K and D.
    """
    D, K, R, P = (
        getattr(message, key if hasattr(message, key) else key.lower()).tolist() for key in "DKRP"
    )
    calibration = CameraCalibration(
        width=message.width,
        height=message.height,
        distortion_model=message.distortion_model,
        D=[] if rectified else D,
        K=[*P[0:3], *P[4:7], *P[8:11]] if rectified else K,
        R=R,
        P=P,
    )
    return _stamped(calibration, message.header)


def convert_transform(message: Any) -> FrameTransform:
    """Converts a geometry_msgs/TransformStamped."""
    p, q = message.transform.translation, message.transform.rotation
    transform = FrameTransform(
        parent_frame_id=message.header.frame_id, child_frame_id=message.child_frame_id
    )
    transform.translation.x, transform.translation.y, transform.translation.z = p.x, p.y, p.z
    transform.rotation.x, transform.rotation.y, transform.rotation.z = q.x, q.y, q.z
    transform.rotation.w = q.w
    _set_stamp(transform, message.header)
    return transform


def _stamped(message: Any, header: Any) -> Any:
    """Returns a message with the frame and stamp of a std_msgs/Header."""
    message.frame_id = header.frame_id
    _set_stamp(message, header)
    return message


def _set_stamp(message: Any, header: Any) -> None:
    message.timestamp.FromNanoseconds(header.stamp.sec * 10**9 + header.stamp.nanosec)
    message.timestamp.SetInParent()
