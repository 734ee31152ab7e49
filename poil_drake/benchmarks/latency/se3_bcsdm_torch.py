"""BCSDM on poses in PyTorch, written directly from its formulas: the baseline for latency.

It takes a batch of poses, as the published implementation does. The logarithm of the rotation
between a pose and every sample of the reference is computed by the textbook formula.

Imports torch: import this module inside functions only.
"""

import numpy as np
import torch

from poil_drake.benchmarks.control.policies.se3_bcsdm import PoseTrajectory, Se3BcsdmConfig


class TorchSe3Bcsdm:
    """The field of `se3_bcsdm` for batches of poses, in double precision on the CPU.

    Args:
        reference: The demonstrated motion.
        config: Parameters of the field.
    """

    def __init__(self, reference: PoseTrajectory, config: Se3BcsdmConfig):
        X = torch.tensor(reference.X_WO)
        self._config = config
        self._R, self._p = X[:, :3, :3], X[:, :3, 3]
        skew = np.cross(np.eye(3), reference.omegas[:, None])
        self._R_velocities = self._R @ torch.tensor(skew)
        self._p_velocities = torch.tensor(reference.velocities)

    @torch.no_grad()
    def __call__(self, X_WO: torch.Tensor) -> torch.Tensor:
        """Returns the field (B, 6), (omega [rad/s], v [m/s]) in the world, at poses (B, 4, 4)."""
        config = self._config
        R, p = X_WO[:, :3, :3], X_WO[:, :3, 3]
        # Distances (B, T) to every sample, and the closest.
        logs = _log(self._R.mT[None] @ R[:, None])
        rotation = (logs**2).sum(dim=(-2, -1))
        position = ((self._p[None] - p[:, None]) ** 2).sum(dim=-1)
        distances = config.rotation_weight * rotation + config.position_weight * position
        tau = distances.sqrt().argmin(dim=1)
        R_star, p_star = self._R[tau], self._p[tau]
        # Mimicking, by parallel transport from R* to R, and contraction.
        half = _exp(0.5 * _log(R_star.mT @ R))
        R_mimic = R_star @ half @ (R_star.mT @ self._R_velocities[tau]) @ half
        R_dot = R_mimic + config.rotation_gain * R @ _log(R.mT @ R_star)
        p_dot = self._p_velocities[tau] + config.position_gain * (p_star - p)
        return torch.cat([_vee(R_dot @ R.mT), p_dot], dim=-1)


def _log(R: torch.Tensor) -> torch.Tensor:
    """Returns log R = t / (2 sin t) (R - R^T) (..., 3, 3) with cos t = (tr R - 1) / 2."""
    cosine = 0.5 * (R.diagonal(dim1=-2, dim2=-1).sum(dim=-1) - 1.0)
    angle = torch.acos(cosine.clamp(-1.0, 1.0))
    sine = torch.sin(angle)
    factor = torch.where(sine.abs() > 1e-7, 0.5 * angle / sine, 0.5)
    return factor[..., None, None] * (R - R.mT)


def _exp(S: torch.Tensor) -> torch.Tensor:
    """Returns exp S of skew-symmetric matrices S (..., 3, 3) by Rodrigues' formula."""
    angle = _vee(S).norm(dim=-1)[..., None, None]
    small = angle < 1e-7
    safe = torch.where(small, 1.0, angle)
    first = torch.where(small, 1.0, torch.sin(safe) / safe)
    second = torch.where(small, 0.5, (1.0 - torch.cos(safe)) / safe**2)
    return torch.eye(3, dtype=S.dtype) + first * S + second * (S @ S)


def _vee(S: torch.Tensor) -> torch.Tensor:
    return torch.stack([S[..., 2, 1], S[..., 0, 2], S[..., 1, 0]], dim=-1)
