"""Cameras that are not where their calibration says."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.perception.images import CameraModel


@dataclass(frozen=True, kw_only=True)
class ExtrinsicsError:
    """A wrong pose of a camera in its calibration, from beginning to end.

    Attributes:
        camera: The camera's name.
        translation: Error of the position, along the axes of the optical frame [m].
        rpy: Error of the orientation: roll, pitch and yaw about these axes [deg].
    """

    camera: str
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def X_CE(self) -> np.ndarray:
        """The (4, 4) pose of the calibrated optical frame E in the true one, C."""
        rotation = Rotation.from_euler("xyz", self.rpy, degrees=True).as_matrix()
        return make_transform(rotation, np.array(self.translation))


def miscalibrated(
    cameras: Sequence[CameraModel], faults: Sequence[object]
) -> tuple[CameraModel, ...]:
    """Returns the cameras' models with the `ExtrinsicsError`s among the faults."""
    found = []
    for camera in cameras:
        for fault in faults:
            if isinstance(fault, ExtrinsicsError) and fault.camera == camera.name:
                camera = replace(camera, X_WC=camera.X_WC @ fault.X_CE)
        found.append(camera)
    return tuple(found)
