"""Represents poses as vectors, so that planners can connect them by straight lines."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from ompl import base
from scipy.spatial.transform import Rotation

from poil_drake.geometry.rigid_transform import make_transform, quaternion
from poil_drake.planning.rrt_connect import State, VectorSpace, make_bounds


def poses_of(vectors: np.ndarray) -> np.ndarray:
    """Returns the poses (B, 4, 4) of vectors (B, 7): position [m] and quaternion of any length.

    The quaternion is (w, x, y, z). Between two quaternions of equal length with a non-negative dot
    product, the straight line turns the pose about one axis, by the smaller angle.
    """
    R = Rotation.from_quat(vectors[:, 3:], scalar_first=True).as_matrix()
    return make_transform(R, vectors[:, :3])


def vectors_of(X: np.ndarray, radius: float) -> np.ndarray:
    """Returns the vectors (B, 7) of poses (B, 4, 4), with the quaternions' signs of `same_side`.

    Each quaternion is twice as long as the radius [m]. A small distance between vectors then
    approximates the motion of a point at this radius, and is at least 1 / sqrt(2) of this motion.
    """
    q = quaternion(X[:, :3, :3])
    q *= 2.0 * radius / np.linalg.norm(q, axis=1)[:, None]
    return same_side(np.concatenate([X[:, :3, 3], q], axis=1))


def same_side(vectors: np.ndarray) -> np.ndarray:
    """Returns the vectors (B, 7), with the quaternions' signs that keep successive ones close."""
    products = np.einsum("bi,bi->b", vectors[1:, 3:], vectors[:-1, 3:])
    signs = np.cumprod(np.concatenate([[1.0], np.where(products < 0.0, -1.0, 1.0)]))
    vectors = vectors.copy()
    vectors[:, 3:] *= signs[:, None]
    return vectors


@dataclass(frozen=True, eq=False)
class PoseSpace(VectorSpace):
    """OMPL's space of the poses with positions in a box [m], read and written as vectors (7,).

    Attributes:
        radius: Radius of the body [m], which scales the quaternions as in `vectors_of`.
    """

    radius: float

    def make(self) -> Any:
        """Returns the OMPL space SE(3), where an angle counts as the motion of a point at `radius`.

        Positions count in metres.
        """
        space = base.SE3StateSpace()
        space.setBounds(make_bounds(self.lower, self.upper))
        # OMPL's distance between rotations is half the angle.
        space.setSubspaceWeight(1, 2.0 * self.radius)
        return space

    def read(self, state: State) -> np.ndarray:
        """Returns the vector (7,) of a state."""
        q = state.rotation()
        vector = np.array([state.getX(), state.getY(), state.getZ(), q.w, q.x, q.y, q.z])
        vector[3:] *= 2.0 * self.radius
        return vector

    def write(self, state: State, values: np.ndarray) -> None:
        """Sets a state to the pose of a vector (7,)."""
        x, y, z = values[:3].tolist()
        state.setXYZ(x, y, z)
        q = state.rotation()
        q.w, q.x, q.y, q.z = (values[3:] / np.linalg.norm(values[3:])).tolist()
