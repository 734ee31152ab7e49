"""Speeds of point sets, and the velocities of points that move rigidly."""

import numpy as np

from poil_drake.geometry.rigid_transform import rotation_log


def rms_length(vectors: np.ndarray) -> np.ndarray:
    """Returns the root mean square length (...) of the vectors (..., N, 3) of N points."""
    return np.sqrt(np.mean(np.sum(vectors**2, axis=-1), axis=-1))


def rigid_velocities(
    X: np.ndarray, origins: np.ndarray, positions: np.ndarray, period: float
) -> np.ndarray:
    """Returns the velocities (K, N, 3) [m/s] of a rigid body's points, from differences of poses.

    Each sample's velocities are those of a rigid motion: the central difference of the poses, at
    the first sample the forward difference, and at the last sample zero.

    Args:
        X: (K, 4, 4) poses of the body; only the rotations are used.
        origins: (K, 3) positions of a point of the body [m], about which it turns.
        positions: (K, N, 3) positions of the body's points [m].
        period: Time between the samples [s].
    """
    after = np.arange(1, len(X))
    before = np.maximum(after - 2, 0)
    spans = period * (after - before)[:, None]
    turns = X[after, :3, :3] @ X[before, :3, :3].swapaxes(-1, -2)
    omega = rotation_log(turns) / spans
    v = (origins[after] - origins[before]) / spans
    velocities = np.zeros_like(positions)
    arms = positions[:-1] - origins[:-1, None]
    velocities[:-1] = v[:, None] + np.cross(omega[:, None], arms)
    return velocities
