"""Decodes the Foxglove messages of cameras: `CameraCalibration` and `FrameTransform`."""

from dataclasses import dataclass

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from scipy.spatial.transform import Rotation

from poil_drake.errors import InvalidValueError

# Both are OpenCV's lens model, with 5 and 8 coefficients.
_DISTORTION_MODELS = ("plumb_bob", "rational_polynomial")


@dataclass(frozen=True, eq=False)
class Calibration:
    """Intrinsics of a recorded camera.

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


def decode_calibration(message: CameraCalibration) -> Calibration:
    """Returns the intrinsics of a message.

    Raises:
        InvalidValueError: if the camera is not calibrated or its lens model is unknown.
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
            "a rigid motion.",
            remedy="Write a finite translation and a unit quaternion.",
        )
    X_PC[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    return X_PC
