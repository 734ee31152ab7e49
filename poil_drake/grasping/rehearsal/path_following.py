"""Follows gripper paths with the arm, for many grasps at once."""

from dataclasses import dataclass

import numpy as np

from poil_drake.robots.inverse_kinematics import (
    InverseKinematicsConfig,
    damped_step,
    pose_error,
)
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel


@dataclass(frozen=True, kw_only=True)
class PathFollowingConfig:
    """How a path is followed and when it counts as left.

    Attributes:
        iterations: Steps at most for each sample of the path.
        centering_gain: Speed of the pull to the nominal posture per distance [1/s]. This and the
            next match the controller that will follow the path.
        centering_speed: Largest speed of that pull [rad/s].
        limit_margin: Distance kept from the joint limits [rad], a little more than the controller
            keeps, so that what is planned can be done.
        damping: Damping of the least squares, see `InverseKinematicsConfig`.
        rotation_scale: Length that one radian counts as [m].
        largest_step: Largest joint step of one iteration [rad]; a larger one means that the arm
            would have to jump.
        position_tolerance: Largest accepted position error [m].
        rotation_tolerance: Largest accepted rotation error [rad].
    """

    iterations: int = 6
    centering_gain: float = 1.0
    centering_speed: float = 0.3
    limit_margin: float = 0.07
    damping: float = 0.005
    rotation_scale: float = 0.15
    largest_step: float = 0.25
    position_tolerance: float = 1e-3
    rotation_tolerance: float = 5e-3


def follow_path(
    model: PandaModel,
    q_start: np.ndarray,
    X_WG: np.ndarray,
    times: np.ndarray,
    *,
    nominal: np.ndarray = NOMINAL_POSTURE,
    config: PathFollowingConfig | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Follows one path of gripper poses from each start, sample by sample, as differential IK does.

    Where a sample cannot be reached the arm stays as near as it comes, and goes on.

    Args:
        model: The arm.
        q_start: (B, 7) configurations near the first samples [rad].
        X_WG: (B, T, 4, 4) gripper poses to pass through, in the world.
        times: (T,) when [s], increasing or decreasing.
        nominal: (7,) posture preferred where the path leaves a choice [rad].
        config: Limits, tolerances and effort.

    Returns:
        The configurations (B, T, 7) [rad] and the errors (B, T, 2): position [m] and rotation
        [rad].
    """
    config = config or PathFollowingConfig()
    step_config = InverseKinematicsConfig(
        damping=config.damping,
        rotation_scale=config.rotation_scale,
        largest_step=config.largest_step,
        limit_margin=config.limit_margin,
        posture_gain=1.0,
    )
    B, T = X_WG.shape[:2]
    path, errors = np.empty((B, T, 7)), np.empty((B, T, 2))
    q = np.array(q_start, dtype=float)
    for k in range(T):
        duration = abs(times[k] - times[k - 1]) if k else 0.0
        wanted = q + _pull(nominal - q, duration, config)
        q = damped_step(model, q, X_WG[:, k], wanted, step_config)
        active = np.arange(B)
        for _ in range(config.iterations - 1):
            error = _errors(model, q[active], X_WG[active, k])
            off = (error[:, 0] > config.position_tolerance) | (
                error[:, 1] > config.rotation_tolerance
            )
            active = active[off]
            if active.size == 0:
                break
            q[active] = damped_step(model, q[active], X_WG[active, k], q[active], step_config)
        path[:, k] = q
        errors[:, k] = _errors(model, q, X_WG[:, k])
    return path, errors


def manipulability(model: PandaModel, q: np.ndarray, rotation_scale: float) -> np.ndarray:
    """Returns the smallest singular value (...) of the Jacobian: 0 at a singularity.

    Args:
        model: The arm.
        q: (..., 7) joint positions [rad].
        rotation_scale: Length that one radian counts as [m].
    """
    _, jacobian = model.gripper_pose_and_jacobian(q)
    scale = np.array([rotation_scale] * 3 + [1.0] * 3)[:, None]
    gram = (scale * jacobian) @ np.swapaxes(scale * jacobian, -1, -2)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(gram)[..., 0], 0.0))


def carried_poses(X_WG: np.ndarray, X_W: np.ndarray) -> np.ndarray:
    """Returns the gripper poses (B, T, 4, 4) while it carries the object along.

    Args:
        X_WG: (B, 4, 4) gripper poses at the grasp.
        X_W: (T, 4, 4) rigid motion of the object from there, in the world.
    """
    return X_W[None] @ X_WG[:, None]


def backed_off_poses(X_WG: np.ndarray, distances: np.ndarray) -> np.ndarray:
    """Returns the gripper poses (B, S, 4, 4) backed off along the approach direction.

    Args:
        X_WG: (B, 4, 4) gripper poses.
        distances: (S,) how far [m].
    """
    X = np.repeat(X_WG[:, None], len(distances), axis=1)
    X[..., :3, 3] -= distances[:, None] * X[..., :3, 2]
    return X


def _pull(offset: np.ndarray, duration: float, config: PathFollowingConfig) -> np.ndarray:
    pull = min(config.centering_gain * duration, 1.0) * offset
    length = np.linalg.norm(pull, axis=-1, keepdims=True)
    longest = config.centering_speed * duration
    return pull * np.minimum(1.0, longest / np.maximum(length, 1e-12))


def _errors(model: PandaModel, q: np.ndarray, X_WG: np.ndarray) -> np.ndarray:
    error = pose_error(X_WG, model.gripper_pose(q))
    return np.stack(
        [np.linalg.norm(error[..., 3:], axis=-1), np.linalg.norm(error[..., :3], axis=-1)], axis=-1
    )
