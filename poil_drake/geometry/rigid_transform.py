"""Rigid transforms as (4, 4) arrays, and the exponential and logarithm of rotations.

All functions accept any number of leading dimensions.
"""

import numpy as np


def make_transform(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Returns transforms (..., 4, 4) from rotations (..., 3, 3) and translations (..., 3) [m]."""
    rotation = np.asarray(rotation, dtype=float)
    translation = np.asarray(translation, dtype=float)
    leading = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    X = np.zeros((*leading, 4, 4))
    X[..., :3, :3] = rotation
    X[..., :3, 3] = translation
    X[..., 3, 3] = 1.0
    return X


def inverse(X: np.ndarray) -> np.ndarray:
    """Returns the inverses X_BA of rigid transforms X_AB (..., 4, 4)."""
    R_transposed = X[..., :3, :3].swapaxes(-1, -2)
    X_BA = np.zeros(X.shape)
    X_BA[..., :3, :3] = R_transposed
    X_BA[..., :3, 3:] = -(R_transposed @ X[..., :3, 3:])
    X_BA[..., 3, 3] = 1.0
    return X_BA


def transform_points(X: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Transforms points from frame B to frame A.

    Args:
        X: X_AB: (4, 4), or (..., 4, 4) for many transforms.
        points: p_B [m]: (..., 3) for one transform. For many, sets (..., N, 3) of points, whose
            leading dimensions broadcast with those of X.

    Returns:
        p_A [m]: (..., 3) for one transform, (..., N, 3) for many.
    """
    R = X[..., :3, :3]
    if X.ndim == 2:
        return points @ R.T + X[:3, 3]
    return points @ np.swapaxes(R, -1, -2) + X[..., None, :3, 3]


def cross(a: np.ndarray, b: np.ndarray, axis: int = -1) -> np.ndarray:
    """Returns the cross product a x b of broadcastable arrays with the coordinates on `axis`.

    It takes a third of the time of `np.cross`.
    """
    y, z = [1, 2, 0], [2, 0, 1]
    return a.take(y, axis) * b.take(z, axis) - a.take(z, axis) * b.take(y, axis)


def skew(v: np.ndarray) -> np.ndarray:
    """Returns the matrices [v] (..., 3, 3) with [v] u = v x u, for vectors v (..., 3)."""
    v = np.asarray(v, dtype=float)
    S = np.zeros((*v.shape, 3))
    S[..., 0, 1] = -v[..., 2]
    S[..., 0, 2] = v[..., 1]
    S[..., 1, 0] = v[..., 2]
    S[..., 1, 2] = -v[..., 0]
    S[..., 2, 0] = -v[..., 1]
    S[..., 2, 1] = v[..., 0]
    return S


def vee(S: np.ndarray) -> np.ndarray:
    """Returns the vectors (..., 3) whose `skew` is the skew-symmetric part of S (..., 3, 3)."""
    return 0.5 * np.stack(
        [
            S[..., 2, 1] - S[..., 1, 2],
            S[..., 0, 2] - S[..., 2, 0],
            S[..., 1, 0] - S[..., 0, 1],
        ],
        axis=-1,
    )


def rotation_exp(rotation_vector: np.ndarray) -> np.ndarray:
    """Returns the rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad].

    By Rodrigues' formula, R = I + (sin t / t) [w] + ((1 - cos t) / t^2) [w]^2 with t = |w|. Both
    factors are computed with sinc, which has full precision at t = 0.
    """
    w = np.asarray(rotation_vector, dtype=float)
    angle = np.sqrt(np.sum(w * w, axis=-1))[..., None, None]
    S = skew(w)
    # (1 - cos t) / t^2 = sinc(t / 2)^2 / 2 has no cancellation.
    return (
        np.eye(3) + np.sinc(angle / np.pi) * S + 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2 * (S @ S)
    )


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Returns quaternions (w, x, y, z), (..., 4), of rotation matrices (..., 3, 3).

    The quaternions have arbitrary length and sign. Shepperd's method chooses, for each matrix, the
    formula with the largest divisor, so it is accurate at all angles, including pi.
    """
    R = np.asarray(rotation, dtype=float)
    # Four times the outer product q q^T.
    Q = np.empty((*R.shape[:-2], 4, 4))
    r00, r11, r22 = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    Q[..., 0, 0] = 1.0 + r00 + r11 + r22
    Q[..., 1, 1] = 1.0 + r00 - r11 - r22
    Q[..., 2, 2] = 1.0 - r00 + r11 - r22
    Q[..., 3, 3] = 1.0 - r00 - r11 + r22
    Q[..., 0, 1] = Q[..., 1, 0] = R[..., 2, 1] - R[..., 1, 2]
    Q[..., 0, 2] = Q[..., 2, 0] = R[..., 0, 2] - R[..., 2, 0]
    Q[..., 0, 3] = Q[..., 3, 0] = R[..., 1, 0] - R[..., 0, 1]
    Q[..., 1, 2] = Q[..., 2, 1] = R[..., 0, 1] + R[..., 1, 0]
    Q[..., 1, 3] = Q[..., 3, 1] = R[..., 0, 2] + R[..., 2, 0]
    Q[..., 2, 3] = Q[..., 3, 2] = R[..., 1, 2] + R[..., 2, 1]
    largest = np.argmax(np.diagonal(Q, axis1=-2, axis2=-1), axis=-1)
    return np.take_along_axis(Q, largest[..., None, None], axis=-2)[..., 0, :]


def rotation_log(rotation: np.ndarray) -> np.ndarray:
    """Returns the rotation vectors (..., 3) [rad] of rotation matrices (..., 3, 3).

    Their length is at most pi. A rotation by exactly pi has two opposite vectors; one of them is
    returned.
    """
    q = quaternion(rotation)
    q = np.where(q[..., :1] < 0.0, -q, q)
    vector = q[..., 1:]
    length = np.sqrt(np.sum(vector * vector, axis=-1, keepdims=True))
    # atan2 accepts the quaternion at any scale. Below 1e-150 the vector part is zero to rounding.
    angle = 2.0 * np.arctan2(length, q[..., :1])
    return vector * np.where(length > 1e-150, angle / np.maximum(length, 1e-150), 0.0)


def interpolate_poses(X_start: np.ndarray, X_end: np.ndarray, share: float) -> np.ndarray:
    """Returns the pose after a `share` of the motion between two poses (4, 4).

    The origin moves on a straight line, and the rotation is by a constant axis (slerp).
    """
    turn = rotation_log(X_start[:3, :3].T @ X_end[:3, :3])
    X = X_start.copy()
    X[:3, :3] = X_start[:3, :3] @ rotation_exp(share * turn)
    X[:3, 3] += share * (X_end[:3, 3] - X_start[:3, 3])
    return X


def rotation_angle(rotation: np.ndarray) -> np.ndarray:
    """Returns the angle in [0, pi] [rad] of each rotation matrix (..., 3, 3)."""
    R = np.asarray(rotation, dtype=float)
    sine = np.linalg.norm(vee(R), axis=-1)
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    return np.arctan2(sine, cosine)


def moved_by_twist(X: np.ndarray, V: np.ndarray, origin: np.ndarray, duration: float) -> np.ndarray:
    """Returns the poses of bodies after a step with constant twists.

    In the step, a body turns about a point that moves along a straight line.

    Args:
        X: (..., 4, 4) poses before the step.
        V: (..., 6) twists (omega [rad/s], v [m/s]) in the base frame of X, where v is the velocity
            of the point.
        origin: (..., 3) positions of the point before the step [m], in the base frame of X.
        duration: Duration of the step [s].
    """
    turns = rotation_exp(V[..., :3] * duration)
    moved = X.copy()
    moved[..., :3, :3] = turns @ X[..., :3, :3]
    arms = (X[..., :3, 3] - origin)[..., None]
    moved[..., :3, 3] = (turns @ arms)[..., 0] + origin + V[..., 3:] * duration
    return moved
