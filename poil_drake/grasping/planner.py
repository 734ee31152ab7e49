"""From matchings and clouds to an execution plan."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from poil_drake.errors import PlanningError
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.grasping.approach import ApproachConfig
from poil_drake.grasping.candidates.grasp_candidate import GraspSamplingConfig
from poil_drake.grasping.candidates.sampling import sample_antipodal_grasps
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.grasping.grasp_motions import plan_approach, plan_descent
from poil_drake.grasping.rehearsal.selection import (
    GraspChoice,
    PartMatching,
    Progress,
    SelectionConfig,
    rank_grasps,
)
from poil_drake.grasping.workspace_check import WorkspaceCheck
from poil_drake.planning.joint_timing import JointTimingConfig
from poil_drake.robots.collision import SceneCloud
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import make_robot_spheres


@dataclass(frozen=True, kw_only=True)
class PlannerConfig:
    """How an execution is planned.

    Attributes:
        sampling: How grasps are sampled.
        selection: How they are rehearsed and chosen.
        approach: How the way to the pre-grasp is searched.
        timing: How fast that way is travelled.
        object_padding: Scene points this near to the object's belong to it [m]: pixels that its
            mask left out.
        robot_padding: Scene points this near to the robot's spheres belong to it [m]: error of
            calibration and depth.
        descent_step: Distance between the samples of the straight way to the grasp [m].
        approach_attempts: So many of the best grasps are tried until the way to one is found.
    """

    sampling: GraspSamplingConfig = field(default_factory=GraspSamplingConfig)
    selection: SelectionConfig = field(default_factory=SelectionConfig)
    approach: ApproachConfig = field(default_factory=ApproachConfig)
    timing: JointTimingConfig = field(default_factory=JointTimingConfig)
    object_padding: float = 0.012
    robot_padding: float = 0.03
    descent_step: float = 0.005
    approach_attempts: int = 4


def plan_execution(
    matchings: Sequence[PartMatching],
    *,
    object_label: str,
    part_label: str,
    object_cloud: PointCloud,
    part_points: np.ndarray,
    scene_points: np.ndarray,
    q_start: np.ndarray,
    model: PandaModel | None = None,
    config: PlannerConfig | None = None,
    seed: int = 0,
    metadata: Mapping[str, object] | None = None,
    progress: Progress | None = None,
) -> ExecutionPlan:
    """Samples grasps, chooses grasp and matching, and plans the way to the grasp.

    Args:
        matchings: How the part may be matched: target points and their references.
        object_label: The object's label, for the plan.
        part_label: The functional part's label, for the plan.
        object_cloud: The whole object [m, world].
        part_points: (M, 3) its functional part as far as it was seen [m, world].
        scene_points: (Q, 3) all that the cameras see [m, world]; points on the object and on the
            robot are left out here.
        q_start: (7,) where the arm stands [rad].
        model: The arm, by default the Panda of example-robot-data.
        config: All parameters.
        seed: Seeds the choice of surface points and the search of the way.
        metadata: What else to note in the plan, such as the scenario's name.
        progress: Told how far the planning is.

    Raises:
        NoFeasibleGraspError: No grasp is feasible; the message counts why.
        PlanningError: No way to the best grasps was found, or the arm stands outside its boxes.
    """
    config = config or PlannerConfig()
    model = model or PandaModel()
    feasibility = config.selection.feasibility
    q_start = np.asarray(q_start, dtype=float)
    workspace = WorkspaceCheck.of(model, q_start, feasibility)
    # The demonstrated part's points stand for what the cameras did not see of it.
    part_points = np.concatenate([part_points, *(m.target_points for m in matchings)])
    spheres = make_robot_spheres(
        finger_opening=feasibility.spheres.gripper.max_width, config=feasibility.spheres
    )
    scene = (
        SceneCloud(scene_points, config=feasibility.collision)
        .without_object(object_cloud.points, config.object_padding)
        .without_robot(spheres, model.link_poses(q_start), config.robot_padding)
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
    )
    choices = rank_grasps(
        candidates,
        matchings,
        model=model,
        scene=scene,
        object_points=object_cloud.points,
        part_points=part_points,
        config=config.selection,
        progress=progress,
    )
    crowded = scene.with_points(object_cloud.points)
    choice, approach, descent = _first_reachable(
        choices, model, crowded, q_start, workspace, config, seed, progress
    )
    finding = choice.feasibility
    notes = {
        "seed": seed,
        "matching": choice.matching,
        "matchings": len(matchings),
        "candidates": len(candidates),
        "rehearsed_pairs": choice.rehearsed,
        "feasible_pairs": choice.feasible,
        "cost": finding.cost,
        "limit_margin": finding.limit_margin,
        "clearance": finding.clearance,
        "singular_value": finding.singular_value,
        "expected_duration": float(choice.path.times[-1]),
    }
    matching = matchings[choice.matching]
    return ExecutionPlan(
        object_label=object_label,
        part_label=part_label,
        target_points=matching.target_points,
        object_points=object_cloud.points,
        part_points=part_points,
        reference=matching.reference,
        grasp=choice.candidate,
        approach=approach,
        descent=descent,
        lift_height=config.selection.path.lift_height,
        retreat_distance=feasibility.retreat_distance,
        nominal_posture=np.array(feasibility.nominal_posture),
        metadata={**notes, **(metadata or {})},
    )


def _first_reachable(
    choices: Sequence[GraspChoice],
    model: PandaModel,
    scene: SceneCloud,
    q_start: np.ndarray,
    workspace: WorkspaceCheck | None,
    config: PlannerConfig,
    seed: int,
    progress: Progress | None,
) -> tuple[GraspChoice, JointTrajectory, JointTrajectory]:
    """Returns the first choice to which there is a way, the way to its pre-grasp, and the rest."""
    attempts = choices[: config.approach_attempts]
    for number, choice in enumerate(attempts):
        if progress:
            progress("planning the approach", number / len(attempts))
        descent = plan_descent(
            model,
            choice.candidate,
            choice.feasibility.q_approach[-1],
            step=config.descent_step,
            feasibility=config.selection.feasibility,
            timing=config.timing,
        )
        try:
            if workspace is not None:
                workspace.require(descent.positions, "The way to the grasp")
            approach = plan_approach(
                model,
                scene,
                q_start,
                descent.positions[0],
                opening=choice.candidate.pregrasp_width,
                feasibility=config.selection.feasibility,
                approach=config.approach,
                timing=config.timing,
                seed=seed,
            )
        except PlanningError:
            if number == len(attempts) - 1:
                raise
            continue
        if progress:
            progress("planning the approach", 1.0)
        return choice, approach, descent
    raise PlanningError(
        "PlannerConfig.approach_attempts leaves no grasp to try.", remedy="Set it to 1 or more."
    )
