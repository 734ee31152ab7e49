"""Cameras as Foxglove messages: `CameraCalibration` and `FrameTransform`."""

from dataclasses import dataclass

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from scipy.spatial.transform import Rotation

from poil_drake.errors import InvalidValueError
from poil_drake.perception.images import CameraModel
from poil_drake.recording.mcap.timestamps import set_timestamp

# Both are OpenCV's model, with 5 and 8 coefficients.
_DISTORTION_MODELS = ("plumb_bob", "rational_polynomial")


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a recording says of a camera, without its pose.

    Attributes:
        frame_id: The name of the camera's optical frame.
        width: Image width [px].
        height: Image height [px].
        K: (3, 3) intrinsic matrix [px].
        distortion: (D,) coefficients of OpenCV's model; empty for a rectified image.
    """

    frame_id: str
    width: int
    height: int
    K: np.ndarray
    distortion: np.ndarray


def encode_calibration(camera: CameraModel, *, stamp: int, frame_id: str) -> CameraCalibration:
    """Returns a camera's intrinsics as a message; the image is taken as rectified."""
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
    set_timestamp(message, stamp)
    return message


def decode_calibration(message: CameraCalibration) -> Calibration:
    """Returns the intrinsics of a message.

    Raises:
        InvalidValueError: if the camera is not calibrated or its lens model is not known.
    """
    K = np.array(message.K, dtype=float)
    if K.size != 9 or not np.all(np.isfinite(K)) or K[0] <= 0.0 or K[4] <= 0.0:
        raise InvalidValueError(
            f"the camera is not calibrated (K = {list(message.K)}).",
            remedy="Calibrate the camera, and write K as 9 numbers in row order.",
        )
    distortion = np.array(message.D, dtype=float)
    if not np.all(np.isfinite(distortion)):
        raise InvalidValueError(
            f"the distortion {list(message.D)} is not finite.", remedy="Calibrate the camera."
        )
    if not np.any(distortion):
        distortion = np.zeros(0)
    elif message.distortion_model not in _DISTORTION_MODELS:
        raise InvalidValueError(
            f"the lens has the distortion model '{message.distortion_model}'.",
            remedy=f"Use {' or '.join(_DISTORTION_MODELS)}, or record rectified images.",
        )
    return Calibration(message.frame_id, message.width, message.height, K.reshape(3, 3), distortion)


def encode_transform(
    X_PC: np.ndarray,
    *,
    parent: str,
    child: str,
    stamp: int,
    message: FrameTransform | None = None,
) -> FrameTransform:
    """Returns the (4, 4) pose of frame `child` in frame `parent` [m] as a message.

    Args:
        X_PC: The pose.
        parent: The frame that it is in.
        child: The frame that it is of.
        stamp: When it was there [ns].
        message: One of an earlier call for the same frames, which is filled again and returned;
            None: a new one.
    """
    if message is None:
        message = FrameTransform(parent_frame_id=parent, child_frame_id=child)
    set_timestamp(message, stamp)
    for axis, value in zip("xyz", X_PC[:3, 3], strict=True):
        setattr(message.translation, axis, value)
    for axis, value in zip("xyzw", Rotation.from_matrix(X_PC[:3, :3]).as_quat(), strict=True):
        setattr(message.rotation, axis, value)
    return message


def decode_transform(message: FrameTransform) -> np.ndarray:
    """Returns the (4, 4) pose of the child frame in the parent frame [m].

    Raises:
        InvalidValueError: if the quaternion is zero or a value is not finite.
    """
    quaternion = np.array([getattr(message.rotation, axis) for axis in "xyzw"])
    X_PC = np.eye(4)
    X_PC[:3, 3] = [getattr(message.translation, axis) for axis in "xyz"]
    if not np.all(np.isfinite([*quaternion, *X_PC[:3, 3]])) or not np.any(quaternion):
        raise InvalidValueError(
            f"the transform from '{message.parent_frame_id}' to '{message.child_frame_id}' is no "
            "rigid motion.",
            remedy="Write a finite translation and a unit quaternion.",
        )
    X_PC[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    return X_PC
