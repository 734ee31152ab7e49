"""Collision-free joint paths by RRT-Connect (OMPL), the same for the same seed."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from poil_drake.errors import MissingDependencyError, PlanningError
from poil_drake.grasping.robot_model import PandaModel

State = Any  # of OMPL, which is imported where it is needed

IsFree = Callable[[np.ndarray], np.ndarray]
"""Tells of configurations (B, 7) which are free: (B,) bool."""


@dataclass(frozen=True, kw_only=True)
class ApproachConfig:
    """How a free path is searched.

    Attributes:
        limit_margin: Distance kept from the joint limits [rad].
        range: Longest edge of the search tree [rad].
        resolution: Distance between the configurations checked along an edge [rad]; in 0.05 rad
            the hand moves 3 cm at full reach, within the spheres' bulge and the margin.
        iterations: The search ends after this many rounds of tree growth. Counted, not timed, so
            that the outcome does not depend on the machine's speed.
        shortcuts: Attempts to shorten the path found.
        smoothing: Length over which corners are rounded off [rad], where there is room.
    """

    limit_margin: float = 0.03
    range: float = 0.6
    resolution: float = 0.05
    iterations: int = 3000
    shortcuts: int = 60
    smoothing: float = 0.5


def plan_joint_path(
    model: PandaModel,
    is_free: IsFree,
    q_start: np.ndarray,
    q_goal: np.ndarray,
    *,
    config: ApproachConfig | None = None,
    seed: int = 0,
) -> np.ndarray:
    """Returns a free, smooth path (K, 7) [rad] between two configurations.

    The straight line where it is free, else a path of RRT-Connect that is then shortened and
    rounded off.

    Args:
        model: The arm, for its joint limits.
        is_free: The collision check.
        q_start: (7,) where to start [rad].
        q_goal: (7,) where to end [rad].
        config: Resolution and effort.
        seed: Seed of the search and the shortcuts.

    Raises:
        PlanningError: An end is in collision, or no path was found.
        MissingDependencyError: OMPL is needed and not installed.
    """
    config = config or ApproachConfig()
    edges = EdgeChecker(is_free, config.resolution)
    for q, name in ((q_start, "start"), (q_goal, "end")):
        if not is_free(q[None])[0]:
            raise PlanningError(
                f"The {name} of the approach, q = {np.round(q, 3).tolist()}, is in collision with "
                "the scene cloud.",
                remedy="Clear the space around the robot, check the cameras' poses, or lower "
                "CollisionConfig.robot_margin.",
            )
    if edges.is_free(q_start, q_goal):
        return edges.samples(q_start, q_goal)
    found = _rrt_connect(model, is_free, edges, q_start, q_goal, config, seed)
    rng = np.random.default_rng(seed)
    return _rounded(_shortcut(found, edges, config.shortcuts, rng), edges, config)


class EdgeChecker:
    """Checks straight joint-space edges."""

    def __init__(self, is_free: IsFree, resolution: float):
        """Keeps the check.

        Args:
            is_free: The collision check.
            resolution: Distance between the configurations checked [rad].
        """
        self._is_free = is_free
        self._resolution = resolution

    def samples(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Returns configurations (K, 7), K >= 2, along the edge, both ends included."""
        count = max(int(np.ceil(np.linalg.norm(last - first) / self._resolution)), 1)
        return first + np.linspace(0.0, 1.0, count + 1)[:, None] * (last - first)

    def is_free(self, first: np.ndarray, last: np.ndarray) -> bool:
        """Returns whether the edge is free; the middle is looked at first, as it seldom is."""
        samples = self.samples(first, last)
        middle = len(samples) // 2
        return bool(self._is_free(samples[middle : middle + 1])[0] and self._is_free(samples).all())

    def path_is_free(self, path: np.ndarray) -> bool:
        """Returns whether all configurations (K, 7) of a path are free."""
        return bool(self._is_free(path).all())


def _rrt_connect(
    model: PandaModel,
    is_free: IsFree,
    edges: EdgeChecker,
    q_start: np.ndarray,
    q_goal: np.ndarray,
    config: ApproachConfig,
    seed: int,
) -> np.ndarray:
    """Returns the corners (K, 7) of a free path."""
    try:
        from ompl import base, geometric, util
    except ImportError as error:
        raise MissingDependencyError(
            "OMPL, which plans the way around obstacles, is not installed.",
            remedy="Install it with: pip install 'ompl>=2.0'",
        ) from error

    class BatchMotionValidator(base.MotionValidator):
        """Checks an edge's configurations all at once, which is what makes Python fast enough."""

        def checkMotion(self, first: State, last: State, *last_valid: Any) -> bool:
            return edges.is_free(_array(first), _array(last))

    util.noOutputHandler()
    # Every generator made from here on draws its seed from this one; 0 is not a valid seed.
    util.RNG.setSeed(seed + 1)
    space = base.RealVectorStateSpace(7)
    bounds = base.RealVectorBounds(7)
    for joint in range(7):
        bounds.setLow(joint, min(model.lower[joint] + config.limit_margin, q_start[joint]))
        bounds.setHigh(joint, max(model.upper[joint] - config.limit_margin, q_start[joint]))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(lambda state: bool(is_free(_array(state)[None])[0]))
    validator = BatchMotionValidator(information)
    information.setMotionValidator(validator)
    information.setup()
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(_state(information, q_start), _state(information, q_goal))
    planner = geometric.RRTConnect(information)
    planner.setProblemDefinition(problem)
    planner.setRange(config.range)
    planner.setup()
    rounds = iter(range(config.iterations))
    planner.solve(base.PlannerTerminationCondition(lambda: next(rounds, None) is None))
    if not problem.hasExactSolution():
        raise PlanningError(
            f"No free path to the pre-grasp was found in {config.iterations} rounds of search.",
            remedy="Clear the space between the arm and the object, or raise "
            "ApproachConfig.iterations.",
        )
    return np.array([_array(state) for state in problem.getSolutionPath().getStates()])


def _array(state: State) -> np.ndarray:
    return np.array([state[joint] for joint in range(7)])


def _state(information: Any, q: np.ndarray) -> State:
    state = information.allocState()
    for joint in range(7):
        state[joint] = float(q[joint])
    return state


def _shortcut(
    corners: np.ndarray, edges: EdgeChecker, attempts: int, rng: np.random.Generator
) -> np.ndarray:
    """Returns the corners (K, 7) of a shorter path: random pairs of points on it are joined."""
    for _ in range(attempts):
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        low, high = np.sort(rng.uniform(0.0, along[-1], 2))
        before, after = (np.searchsorted(along, value, side="right") - 1 for value in (low, high))
        after = min(after, len(lengths) - 1)
        if before == after:
            continue
        first, last = (
            corners[k] + (value - along[k]) / lengths[k] * (corners[k + 1] - corners[k])
            for k, value in ((before, low), (after, high))
        )
        if edges.is_free(first, last):
            corners = np.vstack([corners[: before + 1], first, last, corners[after + 1 :]])
            keep = np.r_[True, np.linalg.norm(np.diff(corners, axis=0), axis=1) > 1e-6]
            keep[-1] = True
            corners = corners[keep]
    return corners


def _rounded(corners: np.ndarray, edges: EdgeChecker, config: ApproachConfig) -> np.ndarray:
    """Returns an even path (K, 7) with its corners rounded off as far as there is room."""
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    count = max(int(np.ceil(along[-1] / config.resolution)), 2)
    even = np.linspace(0.0, along[-1], count + 1)
    width = config.smoothing
    while width > config.resolution:
        path = _smoothed(corners, along, even, width)
        if edges.path_is_free(path):
            return path
        width *= 0.5
    return _smoothed(corners, along, even, 0.0)


def _smoothed(corners: np.ndarray, along: np.ndarray, even: np.ndarray, width: float) -> np.ndarray:
    """Returns the mean of the path over a window around each length; narrower near the ends."""
    halves = np.minimum(0.5 * width, np.minimum(even, along[-1] - even))
    offsets = np.linspace(-1.0, 1.0, 21)
    at = np.clip(even[:, None] + halves[:, None] * offsets, 0.0, along[-1])
    values = np.stack([np.interp(at, along, corners[:, k]) for k in range(corners.shape[1])], -1)
    return values.mean(axis=1)
