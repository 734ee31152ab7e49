"""Follows gripper paths with the arm, for many grasps at once."""

import numpy as np

from poil_drake.robots.inverse_kinematics import (
    ROTATION_SCALE,
    InverseKinematicsConfig,
    damped_step,
    pose_error,
)
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel

STRAIGHT_SPEED = 0.1
"""Speed of the gripper's straight motions to the grasp and away from the released object [m/s]."""

LIMIT_MARGIN = 0.07
"""Distance kept from the joint limits [rad]: a little more than the controller keeps, so that the
controller can follow the plan."""

POSITION_TOLERANCE, ROTATION_TOLERANCE = 1e-3, 5e-3
"""Largest accepted errors of the gripper's pose [m], [rad]."""

_ITERATIONS = 6  # At most, for each sample of the path.
_CENTERING_GAIN, _CENTERING_SPEED = 1.0, 0.3  # [1/s], [rad/s] The controller's values.
_STEP = InverseKinematicsConfig(
    damping=0.005,
    largest_step=0.25,  # A larger step would be a jump of the arm.
    limit_margin=LIMIT_MARGIN,
    posture_gain=1.0,
)


def follow_path(
    model: PandaModel, q_start: np.ndarray, X_WG: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the arm's configurations along gripper paths, each from its own start configuration.

    The arm follows the poses one by one, like differential inverse kinematics. Motion in the null
    space pulls it towards its nominal posture. Where the arm cannot reach a pose, it gets as
    close as possible and continues with the next pose.

    Args:
        model: The arm.
        q_start: (B, 7) start configurations [rad], near the first poses.
        X_WG: (B, T, 4, 4) gripper poses to pass through, in the world.
        times: (T,) times of the poses [s], increasing or decreasing.

    Returns:
        The configurations (B, T, 7) [rad] and the errors (B, T, 2): position [m] and rotation
        [rad].
    """
    B, T = X_WG.shape[:2]
    path, errors = np.empty((B, T, 7)), np.empty((B, T, 2))
    q = np.array(q_start, dtype=float)
    for k in range(T):
        duration = abs(times[k] - times[k - 1]) if k else 0.0
        q = damped_step(model, q, X_WG[:, k], q + _pull(NOMINAL_POSTURE - q, duration), _STEP)
        active = np.arange(B)
        for _ in range(_ITERATIONS - 1):
            error = _errors(model, q[active], X_WG[active, k])
            active = active[(error > [POSITION_TOLERANCE, ROTATION_TOLERANCE]).any(axis=1)]
            if active.size == 0:
                break
            q[active] = damped_step(model, q[active], X_WG[active, k], q[active], _STEP)
        path[:, k] = q
        errors[:, k] = _errors(model, q, X_WG[:, k])
    return path, errors


def back_off(
    model: PandaModel, q_start: np.ndarray, X_WG: np.ndarray, distances: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns `follow_path` along straight gripper paths against the approach direction.

    Args:
        model: The arm.
        q_start: (B, 7) start configurations [rad].
        X_WG: (B, 4, 4) gripper poses from which to back off, in the world.
        distances: (T,) distances from these poses [m], covered at `STRAIGHT_SPEED`.
    """
    X = np.repeat(X_WG[:, None], len(distances), axis=1)
    X[..., :3, 3] -= distances[:, None] * X[..., :3, 2]
    return follow_path(model, q_start, X, distances / STRAIGHT_SPEED)


def manipulability(model: PandaModel, q: np.ndarray) -> np.ndarray:
    """Returns the smallest singular value (...) of the gripper's Jacobian: 0 at a singularity.

    A radius of about the hand's size converts the Jacobian's rotations to lengths.

    Args:
        model: The arm.
        q: (..., 7) joint positions [rad].
    """
    _, jacobian = model.gripper_pose_and_jacobian(q)
    scale = np.array([ROTATION_SCALE] * 3 + [1.0] * 3)[:, None]
    gram = (scale * jacobian) @ np.swapaxes(scale * jacobian, -1, -2)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(gram)[..., 0], 0.0))


def _pull(offset: np.ndarray, duration: float) -> np.ndarray:
    pull = min(_CENTERING_GAIN * duration, 1.0) * offset
    length = np.linalg.norm(pull, axis=-1, keepdims=True)
    longest = _CENTERING_SPEED * duration
    return pull * np.minimum(1.0, longest / np.maximum(length, 1e-12))


def _errors(model: PandaModel, q: np.ndarray, X_WG: np.ndarray) -> np.ndarray:
    error = pose_error(X_WG, model.gripper_pose(q))
    return np.stack(
        [np.linalg.norm(error[..., 3:], axis=-1), np.linalg.norm(error[..., :3], axis=-1)], axis=-1
    )
