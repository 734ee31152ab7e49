"""Collision-free joint paths by RRT-Connect (OMPL), reproducible for a given seed."""

import numpy as np

from poil_drake.errors import PlanningError
from poil_drake.planning.path_shortening import EdgeChecker, IsFree, round_corners, shorten_path
from poil_drake.planning.rrt_connect import VectorSpace, rrt_connect
from poil_drake.robots.panda_kinematics import PandaModel

_RESOLUTION = 0.05
"""Distance between the configurations checked along an edge [rad]. In between, the hand is at most
3 cm from its nearest checked position. The collision margin and the robot's spheres, which are
larger than its links, cover most of this distance."""

_LIMIT_MARGIN = 0.03  # [rad] Distance kept from the joint limits.
_LONGEST_EDGE = 0.6  # [rad] Of the search tree.
_SHORTCUTS = 60  # Attempts to shorten the path.
_SMOOTHING = 0.5  # [rad] Length over which corners are rounded off, where there is space.


def plan_joint_path(
    model: PandaModel,
    is_free: IsFree,
    q_start: np.ndarray,
    q_goal: np.ndarray,
    *,
    iterations: int = 3000,
    seed: int = 0,
) -> np.ndarray:
    """Returns a smooth, collision-free path (K, 7) [rad] between two configurations.

    The straight path is used if it is free. Otherwise RRT-Connect finds a path, which is then
    shortened and rounded off.

    Args:
        model: The arm, whose joint limits bound the search.
        is_free: Returns which configurations (B, 7) [rad] are free of collisions: (B,) bool.
        q_start: (7,) first configuration [rad].
        q_goal: (7,) last configuration [rad].
        iterations: Largest number of rounds of tree growth.
        seed: Seed of the search and the shortcuts.

    Raises:
        PlanningError: One end of the path is in collision, or no path was found.
    """
    edges = EdgeChecker(is_free, _RESOLUTION)
    for q, name in ((q_start, "start"), (q_goal, "end")):
        if not is_free(q[None])[0]:
            raise PlanningError(
                f"At the {name} of the approach, q = {np.round(q, 3).tolist()} rad, the robot is "
                "in collision with the scene or with itself.",
                remedy="Clear the space around the robot, and check the cameras' poses.",
            )
    if edges.is_free(q_start, q_goal):
        return edges.samples(q_start, q_goal)
    found = rrt_connect(
        VectorSpace(
            np.minimum(model.lower + _LIMIT_MARGIN, q_start),
            np.maximum(model.upper - _LIMIT_MARGIN, q_start),
        ),
        q_start,
        q_goal,
        is_free=is_free,
        edge_is_free=edges.is_free,
        max_edge=_LONGEST_EDGE,
        iterations=iterations,
        seed=seed,
    )
    if found is None:
        raise PlanningError(
            f"No collision-free path to the pre-grasp was found in {iterations} rounds of search.",
            remedy="Clear the space between the arm and the object, or widen the arm's workspace "
            "box (poil.safety.posture).",
        )
    corners = shorten_path(found, edges, _SHORTCUTS, np.random.default_rng(seed))
    return round_corners(corners, edges, width=_SMOOTHING)
