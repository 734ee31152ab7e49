"""BCSDM on the pose of an object: the baseline whose metric mixes radians and metres.

The formulas are those of Lee, Lee, Ha and Park, "Behavior-Controllable Stable Dynamics Models on
Riemannian Configuration Manifolds". For a pose (R, p), with the closest sample (R*, p*) at

    tau = argmin c |log(R*^T R)|_F^2 + d |p* - p|^2,

the field is p' = p*'(tau) + eta_p (p* - p) and R' = PT(R*'(tau)) + eta_R R log(R^T R*), where PT is
the parallel transport on SO(3) from R* to R: PT(V) = R* exp(w/2) (R*^T V) exp(w/2) with
w = log(R*^T R).
"""

from dataclasses import dataclass

import numpy as np

from poil_drake.benchmarks.control.policies.policy import CommandedTwist, Observation, Policy
from poil_drake.geometry.rigid_transform import rotation_exp, rotation_log


@dataclass(frozen=True, kw_only=True)
class Se3BcsdmConfig:
    """Parameters of the field; the metric is the published one.

    Attributes:
        rotation_weight: c, the weight of the squared Frobenius norm of the rotation's logarithm.
        position_weight: d, the weight of the squared distance [1/m^2].
        rotation_gain: eta_R [1/s].
        position_gain: eta_p [1/s].
    """

    rotation_weight: float = 1.0
    position_weight: float = 100.0
    rotation_gain: float = 3.0
    position_gain: float = 3.0


@dataclass(frozen=True, eq=False)
class PoseTrajectory:
    """T sampled poses and their velocities.

    Attributes:
        X_WO: (T, 4, 4) the object's poses.
        omegas: (T, 3) angular velocities in the object's own frame [rad/s].
        velocities: (T, 3) velocities of the object's origin [m/s, world]. Both velocities are
            forward differences, and zero in the last sample.
    """

    X_WO: np.ndarray
    omegas: np.ndarray
    velocities: np.ndarray

    @classmethod
    def of(cls, times: np.ndarray, X_WO: np.ndarray) -> "PoseTrajectory":
        """Returns the trajectory through poses X_WO (T, 4, 4) at increasing times (T,) [s]."""
        R, p = X_WO[:, :3, :3], X_WO[:, :3, 3]
        steps = np.diff(times)[:, None]
        omegas, velocities = np.zeros((2, times.size, 3))
        omegas[:-1] = rotation_log(R[:-1].swapaxes(-1, -2) @ R[1:]) / steps
        velocities[:-1] = np.diff(p, axis=0) / steps
        return cls(X_WO, omegas, velocities)


def closest_pose(X_WO: np.ndarray, reference: PoseTrajectory, config: Se3BcsdmConfig) -> int:
    """Returns the index of the first sample of the reference that is closest to a pose (4, 4).

    The norm |log R|_F is sqrt(2) times the angle of R, whose cosine is (tr R - 1) / 2.
    """
    R, p = reference.X_WO[:, :3, :3], reference.X_WO[:, :3, 3]
    traces = np.einsum("tij,ij->t", R, X_WO[:3, :3])
    angles = np.arccos(np.clip(0.5 * (traces - 1.0), -1.0, 1.0))
    offsets = p - X_WO[:3, 3]
    squares = np.einsum("ti,ti->t", offsets, offsets)
    distances = config.rotation_weight * 2.0 * angles**2 + config.position_weight * squares
    return int(distances.argmin())


def se3_bcsdm(
    X_WO: np.ndarray, reference: PoseTrajectory, config: Se3BcsdmConfig
) -> tuple[np.ndarray, int]:
    """Returns the field at a pose, and the index of the closest sample.

    Args:
        X_WO: (4, 4) the object's pose.
        reference: The demonstrated motion.
        config: Parameters of the field.

    Returns:
        V: (6,) (omega [rad/s], v [m/s] of the object's origin), world.
        index: Index of the closest sample.
    """
    index = closest_pose(X_WO, reference, config)
    X = reference.X_WO[index]
    R = X_WO[:3, :3]
    # log(R^T R*) = -w. In the object's frame the transported angular velocity is that of the
    # reference, rotated by exp(-w/2).
    toward = rotation_log(R.T @ X[:3, :3])
    omega = rotation_exp(0.5 * toward) @ reference.omegas[index] + config.rotation_gain * toward
    v = reference.velocities[index] + config.position_gain * (X[:3, 3] - X_WO[:3, 3])
    return np.concatenate([R @ omega, v]), index


class Se3BcsdmPolicy(Policy):
    """Follows the field at the object's true pose. This policy has no state.

    Args:
        reference: The demonstrated motion.
        config: Parameters of the field.
    """

    def __init__(self, reference: PoseTrajectory, config: Se3BcsdmConfig):
        self._reference, self._config = reference, config

    def step(self, state: None, observation: Observation) -> tuple[None, CommandedTwist]:
        """Returns None for the state, and the twist of the field at the object's pose."""
        V, _ = se3_bcsdm(observation.X_WO, self._reference, self._config)
        return None, CommandedTwist(V, observation.X_WO[:3, 3].copy())
