"""Kinematics of the Panda, for many configurations at once."""

import numpy as np

from poil_drake.geometry.frozen_array import frozen_array
from poil_drake.geometry.rigid_transform import cross
from poil_drake.robots.joint_limits import JointLimits
from poil_drake.robots.panda import ACCELERATION_LIMITS, GRIPPER_FRAME, NUM_JOINTS
from poil_drake.robots.robot_description import panda_urdf


class PandaModel:
    """The Panda arm with locked fingers, read by Pinocchio from the URDF.

    NumPy evaluates the chain of seven revolute joints for a whole batch of configurations in one
    call, as planning needs; from Python, Pinocchio takes one configuration at a time. A leading
    "..." in a shape stands for any batch dimensions.

    Attributes:
        joint_limits: All limits of the joints.
        lower: (7,) lower joint limits [rad].
        upper: (7,) upper joint limits [rad].
        velocity: (7,) joint velocity limits [rad/s].
        X_WB: (4, 4) pose of the robot's base, panda_link0.
    """

    def __init__(self, *, X_WB: np.ndarray | None = None):
        """Reads the URDF.

        Args:
            X_WB: (4, 4) pose of the robot's base; None places it at the world's origin.

        Raises:
            MissingDependencyError: if the Panda's description is not installed.
        """
        import pinocchio

        full = pinocchio.buildModelFromUrdf(str(panda_urdf()))
        fingers = [i for i, name in enumerate(full.names) if "finger" in name]
        arm = pinocchio.buildReducedModel(full, fingers, pinocchio.neutral(full))
        self.joint_limits = JointLimits(
            lower=arm.lowerPositionLimit,
            upper=arm.upperPositionLimit,
            velocity=arm.velocityLimit,
            acceleration=np.array(ACCELERATION_LIMITS),
        )
        self.lower, self.upper = self.joint_limits.lower, self.joint_limits.upper
        self.velocity = self.joint_limits.velocity
        self.X_WB = frozen_array(
            np.eye(4) if X_WB is None else X_WB, name="PandaModel.X_WB", shape=(4, 4)
        )
        self._placements = np.array(
            [arm.jointPlacements[i + 1].homogeneous for i in range(NUM_JOINTS)]
        )
        self._X_7G = arm.frames[arm.getFrameId(GRIPPER_FRAME)].placement.homogeneous
        frames = [*self._placements, self._X_7G]
        self.link_lengths = np.array([np.linalg.norm(X[:3, 3]) for X in frames])
        """(8,) distances [m] between successive frame origins, from panda_link0 to the gripper."""

    def link_poses(self, q: np.ndarray) -> np.ndarray:
        """Returns the world poses (..., 9, 4, 4) of panda_link0 to panda_link7 and the gripper.

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
        jacobian = np.concatenate([axes, cross(axes, arms)], axis=-1)
        return poses[..., 8, :, :], np.swapaxes(jacobian, -1, -2)

    def limit_margin(self, q: np.ndarray) -> np.ndarray:
        """Returns the distance (...) [rad] to the nearest joint limit; negative beyond it.

        Args:
            q: (..., 7) joint positions [rad].
        """
        return np.minimum(q - self.lower, self.upper - q).min(axis=-1)
