"""Kinematics of the Panda, for many configurations at once."""

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from poil_drake.errors import InvalidValueError, MissingDependencyError
from poil_drake.geometry.frozen_array import frozen_array
from poil_drake.robots.robot_description import panda_description_directory

GRIPPER_FRAME = "panda_hand_tcp"
"""The gripper frame G: +z is the approach direction, the fingers close along y."""

NOMINAL_POSTURE = frozen_array(
    [0.0, -np.pi / 4, 0.0, -3.0 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4],
    name="NOMINAL_POSTURE",
    shape=(7,),
)
"""The Panda's usual ready posture [rad]: elbow up, gripper pointing down, far from every limit."""


class PandaModel:
    """The Panda arm with its fingers locked, read by Pinocchio from a URDF.

    Pinocchio parses the description; the chain of seven revolute joints is then evaluated with
    NumPy for a whole batch of configurations at once, which planning needs and which Pinocchio's
    interface does not offer from Python. A leading "..." in a shape is any batch shape.

    Attributes:
        urdf_path: The description that was read.
        lower: (7,) lower joint limits [rad].
        upper: (7,) upper joint limits [rad].
        velocity: (7,) joint velocity limits [rad/s].
        X_WB: (4, 4) pose of the robot's base, panda_link0.
    """

    def __init__(self, *, urdf_path: Path | str | None = None, X_WB: np.ndarray | None = None):
        """Reads the description.

        Args:
            urdf_path: A URDF of the Panda with its hand. By default the one with primitive
                collision shapes in the package example-robot-data.
            X_WB: (4, 4) where the robot's base stands; None: at the world's origin.

        Raises:
            MissingDependencyError: Pinocchio is not installed.
            InvalidValueError: The file is missing or does not describe such an arm.
        """
        pinocchio = _import_pinocchio()
        self.urdf_path = Path(
            urdf_path or panda_description_directory() / "urdf" / "panda_collision.urdf"
        )
        model = _read_arm(pinocchio, self.urdf_path)
        self.lower = frozen_array(model.lowerPositionLimit, name="lower limits", shape=(7,))
        self.upper = frozen_array(model.upperPositionLimit, name="upper limits", shape=(7,))
        self.velocity = frozen_array(model.velocityLimit, name="velocity limits", shape=(7,))
        self.X_WB = frozen_array(
            np.eye(4) if X_WB is None else X_WB, name="PandaModel.X_WB", shape=(4, 4)
        )
        self._placements = np.array(
            [model.jointPlacements[i + 1].homogeneous for i in range(model.nq)]
        )
        frame = model.frames[model.getFrameId(GRIPPER_FRAME)]
        self._X_7G = frame.placement.homogeneous

    def link_poses(self, q: np.ndarray) -> np.ndarray:
        """Returns X_W (..., 9, 4, 4) of panda_link0 to panda_link7 and of the gripper frame.

        Args:
            q: (..., 7) joint positions [rad].
        """
        q = np.asarray(q, dtype=float)
        poses = np.empty((*q.shape[:-1], 9, 4, 4))
        poses[..., 0, :, :] = self.X_WB
        cos, sin = np.cos(q)[..., None], np.sin(q)[..., None]
        for joint, placement in enumerate(self._placements):
            before = poses[..., joint, :, :] @ placement
            c, s = cos[..., joint, :], sin[..., joint, :]
            after = poses[..., joint + 1, :, :]
            after[...] = before
            after[..., :, 0] = c * before[..., :, 0] + s * before[..., :, 1]
            after[..., :, 1] = c * before[..., :, 1] - s * before[..., :, 0]
        poses[..., 8, :, :] = poses[..., 7, :, :] @ self._X_7G
        return poses

    def gripper_pose(self, q: np.ndarray) -> np.ndarray:
        """Returns the pose X_WG (..., 4, 4) of the gripper frame.

        Args:
            q: (..., 7) joint positions [rad].
        """
        return self.link_poses(q)[..., 8, :, :]

    def gripper_pose_and_jacobian(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns X_WG (..., 4, 4) and the Jacobian (..., 6, 7) of the gripper frame's origin.

        The Jacobian maps joint velocities to the spatial velocity V_WG = (ω, v) in the world.

        Args:
            q: (..., 7) joint positions [rad].
        """
        poses = self.link_poses(q)
        axes = poses[..., 1:8, :3, 2]
        arms = poses[..., 8, None, :3, 3] - poses[..., 1:8, :3, 3]
        jacobian = np.concatenate([axes, np.cross(axes, arms)], axis=-1)
        return poses[..., 8, :, :], np.swapaxes(jacobian, -1, -2)

    def limit_margin(self, q: np.ndarray) -> np.ndarray:
        """Returns the distance (...) to the nearest joint limit [rad]; negative outside.

        Args:
            q: (..., 7) joint positions [rad].
        """
        return np.minimum(q - self.lower, self.upper - q).min(axis=-1)


def _import_pinocchio() -> ModuleType:
    try:
        import pinocchio
    except ImportError as error:
        raise MissingDependencyError(
            "Pinocchio, which reads the robot's description, is not installed.",
            remedy="Install it with: pip install pin",
        ) from error
    return pinocchio


def _read_arm(pinocchio: ModuleType, urdf_path: Path) -> Any:
    remedy = "Pass the panda.urdf or panda_collision.urdf of the package example-robot-data."
    if not urdf_path.is_file():
        raise InvalidValueError(f"There is no robot description '{urdf_path}'.", remedy=remedy)
    full = pinocchio.buildModelFromUrdf(str(urdf_path))
    fingers = [i for i, name in enumerate(full.names) if "finger" in name]
    model = pinocchio.buildReducedModel(full, fingers, pinocchio.neutral(full))
    revolute = all(joint.shortname() == "JointModelRZ" for joint in list(model.joints)[1:])
    if model.nq != 7 or not revolute or not model.existFrame(GRIPPER_FRAME):
        raise InvalidValueError(
            f"'{urdf_path}' does not describe a chain of 7 joints with a frame '{GRIPPER_FRAME}'.",
            remedy=remedy,
        )
    return model
