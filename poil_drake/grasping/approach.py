"""Collision-free joint paths by RRT-Connect (OMPL), the same for the same seed."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import PlanningError
from poil_drake.planning.path_shortening import EdgeChecker, IsFree, round_corners, shorten_path
from poil_drake.planning.rrt_connect import VectorSpace, rrt_connect
from poil_drake.robots.panda_kinematics import PandaModel


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
    found = rrt_connect(
        VectorSpace(
            np.minimum(model.lower + config.limit_margin, q_start),
            np.maximum(model.upper - config.limit_margin, q_start),
        ),
        q_start,
        q_goal,
        is_free=is_free,
        edge_is_free=edges.is_free,
        max_edge=config.range,
        iterations=config.iterations,
        seed=seed,
    )
    if found is None:
        raise PlanningError(
            f"No free path to the pre-grasp was found in {config.iterations} rounds of search.",
            remedy="Clear the space between the arm and the object, widen the box that the arm may "
            "be in, or raise ApproachConfig.iterations.",
        )
    corners = shorten_path(found, edges, config.shortcuts, np.random.default_rng(seed))
    return round_corners(corners, edges, width=config.smoothing)
