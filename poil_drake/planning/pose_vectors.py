"""Poses as vectors in which the straight line is a rigid motion, for planners on vectors."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from poil_drake.geometry.rigid_transform import make_transform, quaternion
from poil_drake.planning.rrt_connect import State, make_bounds


def poses_of(vectors: np.ndarray) -> np.ndarray:
    """Returns the poses (B, 4, 4) of vectors (B, 7): position [m], and a quaternion of any length.

    The quaternion is (w, x, y, z). On the straight line between two of the same length, whose
    product is not negative, the pose turns about one axis by the smaller angle between the ends.
    """
    w, x, y, z = (vectors[:, 3:] / np.linalg.norm(vectors[:, 3:], axis=1)[:, None]).T
    R = np.empty((len(vectors), 3, 3))
    R[:, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    R[:, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    R[:, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    R[:, 0, 1], R[:, 1, 0] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
    R[:, 0, 2], R[:, 2, 0] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
    R[:, 1, 2], R[:, 2, 1] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)
    return make_transform(R, vectors[:, :3])


def vectors_of(X: np.ndarray, radius: float) -> np.ndarray:
    """Returns the vectors (B, 7) of poses (B, 4, 4), each quaternion on the side of the one before.

    Its length is twice the radius [m], so that small distances between vectors are about what a
    point at that distance from the origin moves, and at least 1 / sqrt(2) of it.
    """
    q = quaternion(X[:, :3, :3])
    q *= 2.0 * radius / np.linalg.norm(q, axis=1)[:, None]
    return same_side(np.concatenate([X[:, :3, 3], q], axis=1))


def same_side(vectors: np.ndarray) -> np.ndarray:
    """Returns the vectors (B, 7) with each quaternion of the sign that is nearer the one before."""
    products = np.einsum("bi,bi->b", vectors[1:, 3:], vectors[:-1, 3:])
    signs = np.cumprod(np.concatenate([[1.0], np.where(products < 0.0, -1.0, 1.0)]))
    vectors = vectors.copy()
    vectors[:, 3:] *= signs[:, None]
    return vectors


@dataclass(frozen=True, eq=False)
class PoseSpace:
    """Poses as vectors (7,) in OMPL, with their origin within a box.

    Attributes:
        lower: (3,) lowest position [m].
        upper: (3,) highest position [m].
        radius: Of the body [m]; see `vectors_of`.
    """

    lower: np.ndarray
    upper: np.ndarray
    radius: float

    def make(self, base: Any) -> Any:
        """Returns SE(3), with angles measured by what a point at the radius moves."""
        space = base.SE3StateSpace()
        space.setBounds(make_bounds(base, self.lower, self.upper))
        # OMPL's distance between rotations is half the angle.
        space.setSubspaceWeight(1, 2.0 * self.radius)
        return space

    def read(self, state: State) -> np.ndarray:
        """Returns the vector (7,)."""
        q = state.rotation()
        vector = np.array([state.getX(), state.getY(), state.getZ(), q.w, q.x, q.y, q.z])
        vector[3:] *= 2.0 * self.radius
        return vector

    def write(self, state: State, values: np.ndarray) -> None:
        """Sets the pose of a vector (7,)."""
        x, y, z = values[:3].tolist()
        state.setXYZ(x, y, z)
        q = state.rotation()
        q.w, q.x, q.y, q.z = (values[3:] / np.linalg.norm(values[3:])).tolist()
