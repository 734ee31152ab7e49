"""Inverse kinematics by damped least squares, for many targets at once."""

from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.rigid_transform import inverse, rotation_log, transform_points
from poil_drake.robots.panda_kinematics import NOMINAL_POSTURE, PandaModel


@dataclass(frozen=True, kw_only=True)
class InverseKinematicsConfig:
    """How configurations are searched and which are accepted.

    Attributes:
        damping: Damping of the least squares, relative to translations in metres and rotations
            scaled by `rotation_scale`. Larger is calmer near singularities and slower elsewhere.
        rotation_scale: Length that one radian counts as [m]: about the hand's size.
        posture_gain: Share of the way to the nominal posture gone in each step within the
            motions that leave the gripper in place.
        largest_step: Largest joint step of one iteration [rad]; the linearisation holds that far.
        iterations: Steps at most. Panda grasps converge within 20 to 40.
        position_tolerance: Largest accepted position error [m].
        rotation_tolerance: Largest accepted rotation error [rad].
        limit_margin: Distance kept from the joint limits [rad], so that the controller, which
            starts from there, can move both ways.
        wrist_seeds: Offsets of joint 7 tried around the nominal posture [rad].
        elbow_seeds: Offsets of joints 1 and -3 tried [rad]: the elbow swung to either side.
        distinct: Solutions closer than this in every joint count as one [rad].
    """

    damping: float = 0.01
    rotation_scale: float = 0.15
    posture_gain: float = 0.1
    largest_step: float = 0.35
    iterations: int = 60
    position_tolerance: float = 5e-4
    rotation_tolerance: float = 3e-3
    limit_margin: float = 0.05
    wrist_seeds: tuple[float, ...] = (-2.4, -1.2, 0.0, 1.2)
    elbow_seeds: tuple[float, ...] = (0.0, 0.7, -0.7)
    distinct: float = 0.2


def pose_error(X_target: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Returns the error (..., 6): rotation vector [rad] and translation [m] from X to the target.

    Args:
        X_target: (..., 4, 4) wanted poses.
        X: (..., 4, 4) present poses.
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

    The step is J+ e + (I - J+ J) k (q_nominal - q) with the damped pseudo-inverse
    J+ = J^T (J J^T + d^2 I)^-1. A joint that would leave its limits is held there and the step is
    solved again with the other joints, so that the redundancy is used before the target is given
    up.

    Args:
        model: The arm.
        q: (B, 7) present joint positions [rad].
        X_target: (B, 4, 4) wanted gripper poses in the world.
        nominal: (7,) or (B, 7) posture preferred where the target leaves a choice [rad].
        config: Damping, limits and step size.
    """
    X, jacobian = model.gripper_pose_and_jacobian(q)
    scale = np.array([config.rotation_scale] * 3 + [1.0] * 3)
    error = scale * pose_error(X_target, X)
    jacobian = scale[:, None] * jacobian
    posture = config.posture_gain * (nominal - q)
    lower, upper = model.lower + config.limit_margin, model.upper - config.limit_margin
    free = np.ones_like(q)
    step = _solve_step(jacobian, error, posture, free, config.damping)
    for _ in range(2):
        outside = (q + step < lower - 1e-9) | (q + step > upper + 1e-9)
        if not outside.any():
            break
        free[outside] = 0.0
        # The held joint still moves up to its limit, which the others must account for.
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
    model: PandaModel,
    X_WG: np.ndarray,
    seeds: np.ndarray,
    *,
    nominal: np.ndarray = NOMINAL_POSTURE,
    config: InverseKinematicsConfig | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Searches a configuration for each gripper pose from each seed.

    Args:
        model: The arm.
        X_WG: (B, 4, 4) wanted gripper poses in the world.
        seeds: (B, 7) configurations to start from [rad].
        nominal: (7,) preferred posture [rad].
        config: Tolerances, limits and effort.

    Returns:
        The configurations (B, 7) [rad], inside the limits, and whether each reaches its pose: (B,)
        bool.
    """
    config = config or InverseKinematicsConfig()
    lower, upper = model.lower + config.limit_margin, model.upper - config.limit_margin
    q = np.clip(seeds, lower, upper)
    reached = np.zeros(len(q), dtype=bool)
    active = np.arange(len(q))
    for _ in range(config.iterations):
        q[active] = damped_step(model, q[active], X_WG[active], nominal, config)
        reached[active] = is_reached(model, q[active], X_WG[active], config)
        active = np.flatnonzero(~reached)
        if active.size == 0:
            break
    return q, reached


def is_reached(
    model: PandaModel, q: np.ndarray, X_WG: np.ndarray, config: InverseKinematicsConfig
) -> np.ndarray:
    """Returns whether each configuration (B, 7) reaches its gripper pose (B, 4, 4): (B,) bool."""
    error = pose_error(X_WG, model.gripper_pose(q))
    return (np.linalg.norm(error[..., 3:], axis=-1) <= config.position_tolerance) & (
        np.linalg.norm(error[..., :3], axis=-1) <= config.rotation_tolerance
    )


def distinct_solutions(
    model: PandaModel,
    X_WG: np.ndarray,
    *,
    nominal: np.ndarray = NOMINAL_POSTURE,
    config: InverseKinematicsConfig | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Finds different configurations for each of many gripper poses.

    Args:
        model: The arm.
        X_WG: (B, 4, 4) wanted gripper poses in the world.
        nominal: (7,) preferred posture [rad].
        config: Seeds, tolerances, limits and effort.

    Returns:
        The configurations (S, 7) [rad] and the index (S,) of the pose that each one reaches, in
        the order of the poses and, for one pose, of the seeds.
    """
    config = config or InverseKinematicsConfig()
    offsets = _seed_offsets(config)
    seeds = np.repeat((nominal + offsets)[None], len(X_WG), axis=0)
    # The first joint turns the nominal posture, which works in the x-z plane, to the target.
    p_BG = transform_points(inverse(model.X_WB), X_WG[:, :3, 3])
    seeds[:, :, 0] += np.arctan2(p_BG[:, 1], p_BG[:, 0])[:, None]
    pose_index = np.repeat(np.arange(len(X_WG)), len(offsets))
    q, reached = solve_inverse_kinematics(
        model, X_WG[pose_index], seeds.reshape(-1, 7), nominal=nominal, config=config
    )
    kept: list[int] = []
    for i in np.flatnonzero(reached):
        same_pose = [k for k in kept if pose_index[k] == pose_index[i]]
        if all(np.abs(q[k] - q[i]).max() > config.distinct for k in same_pose):
            kept.append(int(i))
    return q[kept], pose_index[kept]


def _seed_offsets(config: InverseKinematicsConfig) -> np.ndarray:
    """Returns offsets (S, 7) from the nominal posture [rad]."""
    offsets = np.zeros((len(config.wrist_seeds), len(config.elbow_seeds), 7))
    offsets[..., 6] = np.array(config.wrist_seeds)[:, None]
    offsets[..., 0] = np.array(config.elbow_seeds)
    offsets[..., 2] = -np.array(config.elbow_seeds)
    return offsets.reshape(-1, 7)
