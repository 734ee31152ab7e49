"""RRT-Connect (Kuffner and LaValle 2000) by OMPL, among vectors and among poses as vectors."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from ompl import base, geometric, util
from scipy.spatial.transform import Rotation

from poil_drake.geometry.rigid_transform import make_transform, quaternion
from poil_drake.planning.path_shortening import IsFree

State = Any  # An OMPL state; the bindings have no types.


@dataclass(frozen=True, eq=False)
class VectorSpace:
    """Vectors in a box, such as joint positions, and their conversion to and from OMPL states.

    Attributes:
        lower: (D,) lowest values.
        upper: (D,) highest values.
    """

    lower: np.ndarray
    upper: np.ndarray

    def make(self) -> Any:
        """Returns the OMPL state space."""
        space = base.RealVectorStateSpace(len(self.lower))
        space.setBounds(_bounds(self.lower, self.upper))
        return space

    def read(self, state: State) -> np.ndarray:
        """Returns the vector (D,) of a state."""
        return np.array([state[k] for k in range(len(self.lower))])

    def write(self, state: State, values: np.ndarray) -> None:
        """Sets a state to a vector (D,)."""
        for k, value in enumerate(values.tolist()):
            state[k] = value


def _bounds(lower: np.ndarray, upper: np.ndarray) -> Any:
    """Returns the OMPL bounds of the box between two corners (D,)."""
    bounds = base.RealVectorBounds(len(lower))
    bounds.low, bounds.high = lower.tolist(), upper.tolist()
    return bounds


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
        space.setBounds(_bounds(self.lower, self.upper))
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


def rrt_connect(
    space: VectorSpace,
    start: np.ndarray,
    goal: np.ndarray,
    *,
    is_free: IsFree,
    edge_is_free: Callable[[np.ndarray, np.ndarray], bool],
    max_edge: float,
    iterations: int,
    seed: int,
) -> np.ndarray | None:
    """Returns the corners (K, D) of a free path from start to goal; None if no path is found.

    The outcome depends only on the arguments, not on the machine's speed.

    Args:
        space: The space to search.
        start: (D,) start of the path.
        goal: (D,) end of the path.
        is_free: Returns which configurations (B, D) are free: (B,) bool.
        edge_is_free: Returns whether the straight edge between two configurations (D,) is free.
        max_edge: Longest edge of the search trees, in the space's metric.
        iterations: Largest number of rounds of tree growth.
        seed: Seed of the samples.
    """
    util.noOutputHandler()
    # Generators created from now on draw their seeds from this one; 0 is not a valid seed.
    util.RNG.setSeed(seed + 1)

    class BatchMotionValidator(base.MotionValidator):
        """Checks the configurations of an edge in one batch, which is fast enough in Python."""

        def checkMotion(self, first: State, last: State, *last_valid: Any) -> bool:
            return edge_is_free(space.read(first), space.read(last))

    information = base.SpaceInformation(space.make())
    information.setStateValidityChecker(lambda state: bool(is_free(space.read(state)[None])[0]))
    information.setMotionValidator(BatchMotionValidator(information))
    information.setup()

    def state_of(values: np.ndarray) -> State:
        state = information.allocState()
        space.write(state, values)
        return state

    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(state_of(start), state_of(goal))
    planner = geometric.RRTConnect(information)
    planner.setProblemDefinition(problem)
    planner.setRange(max_edge)
    planner.setup()
    rounds = iter(range(iterations))
    planner.solve(base.PlannerTerminationCondition(lambda: next(rounds, None) is None))
    if not problem.hasExactSolution():
        return None
    return np.array([space.read(state) for state in problem.getSolutionPath().getStates()])
