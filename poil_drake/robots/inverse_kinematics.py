"""Inverse kinematics by damped least squares, for many targets at once."""

from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.rigid_transform import inverse, rotation_log, transform_points
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel

_WRIST_SEEDS = (-2.4, -1.2, 0.0, 1.2)
"""Searches start at these offsets of joint 7 from the nominal posture [rad]."""

_ELBOW_SEEDS = (0.0, 0.7, -0.7)
"""Start offsets of joint 1, and of joint 3 with the opposite sign [rad]; they move the elbow."""

ROTATION_SCALE = 0.15
"""Length that converts radians to metres in pose errors [m]: about the hand's size."""

_SCALE = np.array([ROTATION_SCALE] * 3 + [1.0] * 3)

_ITERATIONS = 60
"""Largest number of steps; grasps of the Panda converge within 20 to 40."""

POSITION_TOLERANCE, ROTATION_TOLERANCE = 5e-4, 3e-3
"""Largest accepted position error [m] and rotation error [rad]."""

DISTINCT = 0.2
"""Solutions closer than this in every joint count as one [rad]."""


@dataclass(frozen=True, kw_only=True)
class InverseKinematicsConfig:
    """Parameters of the search for a configuration.

    Attributes:
        damping: Damping of the least squares [m]. A larger value makes the steps smaller near
            singularities and the convergence slower elsewhere.
        posture_gain: Share of the way to the nominal posture that each step covers within the null
            space of the gripper's motion.
        largest_step: Largest change of a joint in a step [rad]; the linearisation holds that far.
        limit_margin: Distance of the solutions from the joint limits [rad]. It lets a controller
            that starts from a solution move every joint both ways.
    """

    damping: float = 0.01
    posture_gain: float = 0.1
    largest_step: float = 0.35
    limit_margin: float = 0.05


def pose_error(X_target: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Returns the error (..., 6) of X: rotation vector [rad] and translation [m] to the target.

    Args:
        X_target: (..., 4, 4) desired poses.
        X: (..., 4, 4) current poses.
    """
    rotation = rotation_log(X_target[..., :3, :3] @ np.swapaxes(X[..., :3, :3], -1, -2))
    return np.concatenate([rotation, X_target[..., :3, 3] - X[..., :3, 3]], axis=-1)


def damped_step(
    model: PandaModel,
    q: np.ndarray,
    X_target: np.ndarray,
    nominal: np.ndarray,
    config: InverseKinematicsConfig,
) -> np.ndarray:
    """Returns the configurations (B, 7) after one damped least-squares step towards the targets.

    The step is J+ e + (I - J+ J) k (nominal - q), with the pose error e, k = `posture_gain` and
    J+ = J^T (J J^T + d^2 I)^-1, d = `damping`. A joint that would leave its limits stops there, and
    the step is solved again for the other joints, so that these compensate as far as they can.

    Args:
        model: The arm.
        q: (B, 7) current joint positions [rad].
        X_target: (B, 4, 4) target poses of the gripper in the world.
        nominal: (7,) or (B, 7) posture that the motion in the null space approaches [rad].
        config: Damping, limits and step size.
    """
    X, jacobian = model.gripper_pose_and_jacobian(q)
    error = _SCALE * pose_error(X_target, X)
    jacobian = _SCALE[:, None] * jacobian
    posture = config.posture_gain * (nominal - q)
    lower, upper = model.lower + config.limit_margin, model.upper - config.limit_margin
    free = np.ones_like(q)
    step = _solve_step(jacobian, error, posture, free, config.damping)
    for _ in range(2):
        outside = (q + step < lower - 1e-9) | (q + step > upper + 1e-9)
        if not outside.any():
            break
        free[outside] = 0.0
        # The held joint still moves up to its limit; the others account for that motion.
        held = (np.clip(q, lower, upper) - q) * (1.0 - free)
        left = error - (jacobian @ held[..., None])[..., 0]
        step = held + _solve_step(jacobian, left, posture, free, config.damping)
    largest = np.abs(step).max(axis=-1, keepdims=True)
    step = step * np.minimum(1.0, config.largest_step / np.maximum(largest, 1e-12))
    return np.clip(q + step, lower, upper)


def _solve_step(
    jacobian: np.ndarray, error: np.ndarray, posture: np.ndarray, free: np.ndarray, damping: float
) -> np.ndarray:
    J = jacobian * free[:, None, :]
    gram = J @ np.swapaxes(J, -1, -2) + damping**2 * np.eye(6)
    posture = posture * free
    residual = error - (J @ posture[..., None])[..., 0]
    step = np.swapaxes(J, -1, -2) @ np.linalg.solve(gram, residual[..., None])
    return posture + step[..., 0] * free


def solve_inverse_kinematics(
    model: PandaModel, X_WG: np.ndarray, seeds: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Searches for a configuration for each gripper pose, starting from a seed for each.

    Args:
        model: The arm.
        X_WG: (B, 4, 4) target poses of the gripper in the world.
        seeds: (B, 7) initial configurations [rad].

    Returns:
        The configurations (B, 7) [rad], within the limits, and whether each reaches its pose: (B,)
        bool.
    """
    config = InverseKinematicsConfig()
    lower, upper = model.lower + config.limit_margin, model.upper - config.limit_margin
    q = np.clip(seeds, lower, upper)
    reached = np.zeros(len(q), dtype=bool)
    active = np.arange(len(q))
    for _ in range(_ITERATIONS):
        q[active] = damped_step(model, q[active], X_WG[active], NOMINAL_POSTURE, config)
        error = pose_error(X_WG[active], model.gripper_pose(q[active]))
        reached[active] = (np.linalg.norm(error[:, 3:], axis=-1) <= POSITION_TOLERANCE) & (
            np.linalg.norm(error[:, :3], axis=-1) <= ROTATION_TOLERANCE
        )
        active = np.flatnonzero(~reached)
        if active.size == 0:
            break
    return q, reached


def distinct_solutions(model: PandaModel, X_WG: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Finds, for each gripper pose, the distinct configurations that reach it.

    Args:
        model: The arm.
        X_WG: (B, 4, 4) target poses of the gripper in the world.

    Returns:
        The configurations (S, 7) [rad] and the index (S,) of the pose that each reaches,
        ordered by pose and then by seed.
    """
    offsets = np.array(
        [[elbow, 0, -elbow, 0, 0, 0, wrist] for wrist in _WRIST_SEEDS for elbow in _ELBOW_SEEDS]
    )
    seeds = np.repeat((NOMINAL_POSTURE + offsets)[None], len(X_WG), axis=0)
    # Joint 1 turns the nominal posture, which lies in the x-z plane, towards the target.
    p_BG = transform_points(inverse(model.X_WB), X_WG[:, :3, 3])
    seeds[:, :, 0] += np.arctan2(p_BG[:, 1], p_BG[:, 0])[:, None]
    pose_index = np.repeat(np.arange(len(X_WG)), len(offsets))
    q, reached = solve_inverse_kinematics(model, X_WG[pose_index], seeds.reshape(-1, 7))
    kept: list[int] = []
    for i in np.flatnonzero(reached):
        same_pose = [k for k in kept if pose_index[k] == pose_index[i]]
        if all(np.abs(q[k] - q[i]).max() > DISTINCT for k in same_pose):
            kept.append(int(i))
    return q[kept], pose_index[kept]
