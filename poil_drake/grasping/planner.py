"""Plans an execution from matchings and point clouds."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np

from poil_drake.errors import PlanningError
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.grasping.candidates.grasp_candidate import (
    GRIPPER,
    GraspCandidate,
    GraspSamplingConfig,
)
from poil_drake.grasping.candidates.sampling import sample_antipodal_grasps
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.grasping.grasp_motions import WorkspaceCheck, plan_approach, plan_descent
from poil_drake.grasping.rehearsal.object_path import LIFT_HEIGHT, ObjectPathConfig
from poil_drake.grasping.rehearsal.rehearsal import FeasibilityConfig
from poil_drake.grasping.rehearsal.selection import GraspChoice, rank_grasps
from poil_drake.robots.collision import RobotCollisionChecker
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import make_robot_spheres
from poil_drake.transfer.matching import Matching
from poil_drake.transfer.progress import Progress

_OBJECT_PADDING = 0.012
"""Scene points within this distance of the object's cloud belong to the object [m], because its
mask misses some pixels."""

_TABLE_THICKNESS = 0.008
"""Scene points less than this above the table's surface belong to the table [m]."""

_ROBOT_PADDING = 0.03
"""Scene points within this distance of the robot's spheres belong to the robot [m], because
calibration and depth have errors of this size."""

_APPROACH_ATTEMPTS = 4  # How many of the best grasps to plan an approach for.


@dataclass(frozen=True, kw_only=True)
class PlannerConfig:
    """How an execution is planned.

    Attributes:
        sampling: How grasps are sampled.
        path: How the object's motion is predicted.
        feasibility: Requirements on a grasp.
    """

    sampling: GraspSamplingConfig = field(default_factory=GraspSamplingConfig)
    path: ObjectPathConfig = field(default_factory=ObjectPathConfig)
    feasibility: FeasibilityConfig = field(default_factory=FeasibilityConfig)


@dataclass(frozen=True, eq=False)
class PlanningResult:
    """A plan and the data that it was chosen from.

    Attributes:
        plan: The plan.
        choice: The grasp and the matching that the plan executes.
        feasible: The sampled grasps that are feasible under at least one matching.
        rejected: The other sampled grasps.
        scene_points: (Q, 3) the obstacles, without the table, the object and the robot [m, world].
    """

    plan: ExecutionPlan
    choice: GraspChoice
    feasible: list[GraspCandidate]
    rejected: list[GraspCandidate]
    scene_points: np.ndarray


def plan_execution(
    matchings: Sequence[Matching],
    *,
    object_label: str,
    part_label: str,
    object_cloud: PointCloud,
    part_points: np.ndarray,
    scene_points: np.ndarray,
    q_start: np.ndarray,
    model: PandaModel,
    config: PlannerConfig | None = None,
    seed: int = 0,
    metadata: Mapping[str, object] | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> PlanningResult:
    """Samples grasps, selects a grasp and a matching, and plans the motion to the grasp.

    Args:
        matchings: The ways in which the demonstrated part matches the object's part.
        object_label: The object's label, for the plan.
        part_label: The functional part's label, for the plan.
        object_cloud: The whole object [m, world].
        part_points: (M, 3) the visible surface of the object's functional part [m, world].
        scene_points: (Q, 3) all points that the cameras see [m, world]. Points on the table, the
            object and the robot do not count as obstacles.
        q_start: (7,) the arm's present configuration [rad].
        model: The arm.
        config: None for the defaults.
        seed: Seed for choosing surface points and for searching the approach.
        metadata: Further entries of the plan's metadata, such as the scenario's name.
        executor: Does half of the work on grasps; None: this process does all.
        progress: Called with the current activity and its completed fraction.

    Raises:
        NoFeasibleGraspError: No grasp is feasible; the message says how many fail for each reason.
        PlanningError: No approach to any of the best grasps was found, or the arm starts outside
            its workspace boxes.
    """
    config = config or PlannerConfig()
    feasibility = config.feasibility
    q_start = np.asarray(q_start, dtype=float)
    workspace = WorkspaceCheck(model=model, q_start=q_start, feasibility=feasibility)
    # The transferred points complete the visible surface of the part.
    part_points = np.concatenate([part_points, *(m.target_points for m in matchings)])
    spheres = make_robot_spheres(finger_opening=GRIPPER.max_width)
    centers = spheres.world_centers(model.link_poses(q_start))
    scene = (
        SceneCloud(
            scene_points,
            ground_height=feasibility.collision.ground_height,
            ground_thickness=_TABLE_THICKNESS,
        )
        .without_points(object_cloud.points, _OBJECT_PADDING)
        .without_balls(centers, spheres.radii + _ROBOT_PADDING)
    )
    if progress:
        progress("sampling grasps", 0.0)
    candidates = sample_antipodal_grasps(
        object_cloud,
        part_points,
        obstacle_points=scene.points,
        ground_height=feasibility.collision.ground_height,
        config=config.sampling,
        seed=seed,
        executor=executor,
    )
    choices = rank_grasps(
        candidates,
        matchings,
        model=model,
        scene=scene,
        object_points=object_cloud.points,
        part_points=part_points,
        path=config.path,
        feasibility=feasibility,
        executor=executor,
        progress=progress,
    )
    choice, approach, descent = _first_reachable(
        choices[:_APPROACH_ATTEMPTS],
        model,
        scene.with_points(object_cloud.points),
        q_start,
        workspace,
        feasibility,
        seed,
        progress,
    )
    finding, matching = choice.feasibility, matchings[choice.matching]
    notes = {
        "seed": seed,
        "matching": choice.matching,
        "matchings": len(matchings),
        "candidates": len(candidates),
        "rehearsed_pairs": len(candidates) * len(matchings),
        "feasible_pairs": len(choices),
        "cost": finding.cost,
        "limit_margin": finding.limit_margin,
        "clearance": finding.clearance,
        "singular_value": finding.singular_value,
        "expected_duration": float(choice.path.times[-1]),
    }
    plan = ExecutionPlan(
        object_label=object_label,
        part_label=part_label,
        target_points=matching.target_points,
        object_points=object_cloud.points,
        part_points=part_points,
        reference=matching.reference,
        grasp=choice.candidate,
        approach=approach,
        descent=descent,
        lift_height=LIFT_HEIGHT,
        retreat_distance=feasibility.retreat_distance,
        nominal_posture=NOMINAL_POSTURE,
        metadata={**notes, **(metadata or {})},
    )
    accepted = {id(choice.candidate) for choice in choices}
    feasible = [c for c in candidates if id(c) in accepted]
    rejected = [c for c in candidates if id(c) not in accepted]
    return PlanningResult(plan, choice, feasible, rejected, scene.points)


def _first_reachable(
    choices: Sequence[GraspChoice],
    model: PandaModel,
    scene: SceneCloud,
    q_start: np.ndarray,
    workspace: WorkspaceCheck,
    feasibility: FeasibilityConfig,
    seed: int,
    progress: Progress | None,
) -> tuple[GraspChoice, JointTrajectory, JointTrajectory]:
    """Returns the first choice for which an approach is found, with its approach and descent.

    If there is none, the error of the last choice is raised.
    """
    failure: PlanningError | None = None
    for number, choice in enumerate(choices):
        if progress:
            progress("planning the approach", number / len(choices))
        q_grasp = choice.feasibility.q_approach[-1]
        descent = plan_descent(model, choice.candidate, q_grasp, feasibility.pregrasp_distance)
        opening = choice.candidate.pregrasp_width
        checker = RobotCollisionChecker(
            model=model,
            spheres=make_robot_spheres(finger_opening=opening),
            scene=scene,
            config=feasibility.collision,
        )
        try:
            workspace.require(descent.positions, "The descent to the grasp")
            approach = plan_approach(
                model, checker, workspace, q_start, descent.positions[0], seed=seed
            )
        except PlanningError as error:
            failure = error
            continue
        if progress:
            progress("planning the approach", 1.0)
        return choice, approach, descent
    assert failure is not None  # There is at least one choice.
    raise failure
